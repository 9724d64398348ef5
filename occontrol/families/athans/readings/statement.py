"""What is wrong with rules on readings beside what is wrong with any rules: those that a clock does not know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields

from occontrol.core.errors import Mistake
from occontrol.core.sensor import Sensor
from occontrol.families.athans.rules.statement import Constraints, SensorRules, mistakes

OF_SAMPLES = {"max_uses", "max_switches", "switch_cost", "max_observation_cost", "max_error"}


def wrong_rules(
    rules: Constraints | None,
    minimise: str,
    sensors: Sequence[Sensor],
    places: int,
    discrete: bool,
    budget: Mapping[str, int] | None,
) -> list[Mistake]:
    """Mistakes in the rules of a problem of readings, by their places in its file.

    Parameters
    ----------
    rules : Constraints, or None
    minimise : what is minimised
    sensors : of the problem
    places : how many are read at a time, at most
    discrete : whether the clock counts steps
    budget : exact numbers of readings, or None
    """
    found = mistakes(rules, minimise, sensors, places)
    if rules is None and minimise == "cost":
        return found
    if budget is not None:
        what = "a budget is of exact numbers of readings, and rules are searched without it"
        hint = "constraints: {max_observation_cost: ..} and max_uses limit readings, too; or leave the rules out"
        found.append(Mistake(("budget",), what, hint, key=True))
    if rules is None or discrete:
        return found
    names = [s.name for s in sensors]
    stated = [(("constraints", f.name), f.name) for f in fields(Constraints) if _stated(rules, f.name)]
    for name, own in rules.sensors.items():
        if name in names:
            place = ("sensors", names.index(name))
            stated += [((*place, f.name), f.name) for f in fields(SensorRules) if getattr(own, f.name) is not None]
    hint = f"rules on samples: {', '.join(sorted(OF_SAMPLES))}"
    known = {m.path for m in found}
    found += [
        Mistake(path, f"{name} is a time, and samples are instants", hint, key=True)
        for path, name in stated
        if name not in OF_SAMPLES and path not in known
    ]
    return found


def _stated(rules: Constraints, name: str) -> bool:
    value = getattr(rules, name)
    return name != "sensors" and value is not None and value != "free"
