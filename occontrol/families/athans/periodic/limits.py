"""Rules of a cycle: how long a sensor stays on, how often it is used in one cycle, how often the choice changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from occontrol.core.errors import Mistake, suggest
from occontrol.core.kinds import PlainDict
from occontrol.scheduling.periodic.cycles import NEVER, CycleRules, free

NEAR = 1e-9  # of a step


@dataclass(frozen=True)
class CycleLimits:
    """What a cycle has to keep; times are steps in discrete time.

    Parameters
    ----------
    min_on : {sensor: time that it stays on at least}
    max_uses : {sensor: steps of one cycle at which it is used, at most}
    max_switches : steps of one cycle at which the choice changes, at most, or None
    """

    min_on: Mapping[str, float] = field(default_factory=dict)
    max_uses: Mapping[str, int] = field(default_factory=dict)
    max_switches: int | None = None

    def mistakes(self, names: Sequence[str]) -> list[Mistake]:
        """What is wrong with the statement, for the `names` of the sensors; paths in a problem file."""
        found = []
        for key in ("min_on", "max_uses"):
            for name, value in getattr(self, key).items():
                if name not in names:
                    found.append(Mistake(("constraints", key), f"there is no sensor '{name}'", suggest(name, names)))
                    continue
                where = ("sensors", list(names).index(name), key)
                if not (np.isfinite(value) and value >= 0):
                    what = f"{key} of sensor '{name}' is {value:g}"
                    found.append(Mistake(where, what, "a number from 0 upwards"))
        if self.max_switches is not None and self.max_switches < 0:
            what = f"max_switches is {self.max_switches}"
            found.append(Mistake(("constraints", "max_switches"), what, "a whole number from 0 upwards"))
        return found

    def of_sensor(self, name: str) -> PlainDict:
        """The rules of the sensor called `name` as they stand in a problem file; None where there is none."""
        return {"min_on": self.min_on.get(name), "max_uses": self.max_uses.get(name)}


def cycle_rules(limits: CycleLimits | None, uses: np.ndarray, names: Sequence[str], step: float) -> CycleRules:
    """The rules in steps.

    Parameters
    ----------
    limits : or None
    uses : (A, M) 1 where a letter uses a sensor
    names : of the M sensors
    step : length of one
    """
    if limits is None:
        return free(uses)
    shortest = [max(1, int(np.ceil(limits.min_on.get(name, 0.0) / step - NEAR))) for name in names]
    most = [limits.max_uses.get(name, NEVER) for name in names]
    changes = NEVER if limits.max_switches is None else limits.max_switches
    return CycleRules(uses, np.array(shortest), np.array(most), changes)


def broken(limits: CycleLimits | None, weights: np.ndarray, names: Sequence[str], step: float) -> list[str]:
    """In words, the rules that a cycle breaks.

    Parameters
    ----------
    limits : or None
    weights : (p, M) 1 where a sensor is used
    names : of the M sensors
    step : length of one
    """
    if limits is None:
        return []
    found, p = [], len(weights)
    for j, name in enumerate(names):
        on = weights[:, j] > 0.5
        total = int(np.sum(on))
        if total > limits.max_uses.get(name, p):
            found.append(f"sensor '{name}' is used at {total} steps of the cycle, max_uses is {limits.max_uses[name]}")
        least = limits.min_on.get(name, 0.0)
        if 0 < total < p:
            starts = [k for k in range(p) if on[k] and not on[k - 1]]
            runs = [next(r for r in range(1, p + 1) if not on[(k + r) % p]) for k in starts]
            if min(runs) * step < least * (1 - NEAR):
                found.append(f"sensor '{name}' is on for {min(runs) * step:g}, min_on is {least:g}")
    changes = int(np.sum(np.any(weights != np.roll(weights, 1, axis=0), axis=1)))
    if limits.max_switches is not None and changes > limits.max_switches:
        found.append(f"the cycle changes {changes} times, max_switches is {limits.max_switches}")
    return found
