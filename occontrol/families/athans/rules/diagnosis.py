"""Why no schedule keeps the rules: the first interval that none gets past, and the rules that stand in the way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from occontrol.core.errors import InfeasibleError
from occontrol.families.athans.rules.frame import Frame, spelt
from occontrol.scheduling.rules.check import RELATIVE
from occontrol.scheduling.rules.oracle import Prices
from occontrol.scheduling.rules.rules import Rules


def lacking(frame: Frame, rules: Rules) -> tuple[str, int | None] | None:
    """What makes rules impossible, as far as it is seen without a search: a sentence and an interval.

    Parameters
    ----------
    frame : Frame of the problem
    rules : Rules
    """
    # what changes cost is no part of a budget
    free = replace(rules, switch_cost=np.zeros_like(rules.switch_cost), start_cost=0.0)
    oracle, N = frame.oracle(free), frame.intervals
    k = oracle.first_impossible()
    if k is not None and k < N:
        return f"no schedule keeps the rules beyond {frame.interval(k)}", k
    if k is not None:
        return f"no schedule keeps the rules to the end, {frame.end}", k
    none, zero = Prices.none(N, rules.sensors), np.zeros(oracle.shape)
    budgets = []
    if np.isfinite(rules.max_observation):
        prices = Prices(frame.spend, none.start, none.stop)
        budgets.append((spelt("max_observation", None), prices, rules.max_observation))
    for j, name in enumerate(rules.names):
        if np.isfinite(rules.max_time[j]):
            on = np.zeros_like(none.on)
            on[:, j] = oracle.grid.steps
            limit = float(rules.max_time[j]) + oracle.grid.slack
            budgets.append((spelt("max_time", name), Prices(on, none.start, none.stop), limit))
    for text, prices, limit in budgets:
        least, _ = oracle.minimise(zero, prices)
        if least > limit * (1 + RELATIVE):
            return (
                f"every schedule that keeps the other rules needs {least:.6g} of {text}, {limit:.6g} is allowed",
                None,
            )
    return None


def blamed(frame: Frame, rules: Rules) -> list[str]:
    """The rules without which, each alone, nothing more is seen to be impossible, in the user's words.

    Parameters
    ----------
    frame : Frame of the problem
    rules : Rules that are impossible
    """
    found = []
    for rule, sensor in rules.stated():
        if lacking(frame, rules.without(rule, sensor)) is None:
            found.append(spelt(rule, None if sensor is None else rules.names[sensor]))
    return found


def refusal(text: str, found: list[str]) -> InfeasibleError:
    """The error that says so.

    Parameters
    ----------
    text : what is impossible
    found : the rules of `blamed`
    """
    hint = "relax more than one rule, widen a window, or add 'idle' to the sensors"
    if found:
        hint = f"there would be one without {' or without '.join(found)}"
    return InfeasibleError(f"{text}\n  hint: {hint}")


def require_rules_feasible(frame: Frame) -> None:
    """Raise InfeasibleError, with the first interval and the rule, where no schedule keeps the rules.

    Parameters
    ----------
    frame : Frame of the problem
    """
    found = lacking(frame, frame.rules)
    if found is not None:
        raise refusal(found[0], blamed(frame, frame.rules))
