"""When a comparison of policies is decided, and what may then be said: one error for all looks and policies together.

Looks are taken at fixed numbers of runs, L of them with the last. With P policies beside the nominal plan every
difference in cost is judged by z standard errors, z the two-sided quantile of ERROR / (L P) (Bonferroni): that any
difference is called one that is none happens with probability ERROR at most, wherever the comparison stops.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from occontrol.core.kinds import PlainDict

LOOK = 100  # runs between two looks
ERROR = 0.05  # two-sided, of all looks and policies together
MARGIN = 0.01  # of the nominal cost: what is known as well as that is known well enough


def looks_at(runs: int, early: bool) -> list[int]:
    """Numbers of runs at which the comparison is looked at, the last one all of them.

    Parameters
    ----------
    runs : at most
    early : whether it may end before
    """
    return [*(range(LOOK, runs, LOOK) if early else ()), runs]


def quantile(looks: int, others: int) -> float:
    """z for so many looks at so many differences."""
    from scipy.special import ndtri

    return float(ndtri(1 - ERROR / (2 * looks * max(others, 1))))


def standard_error(values: np.ndarray) -> float:
    """Of the mean of `values` (K,); not a number where there is only one."""
    return float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")


def decided(costs: Mapping[str, np.ndarray], z: float) -> bool:
    """Whether every difference to the nominal plan is away from 0 by z standard errors, or known to MARGIN.

    Parameters
    ----------
    costs : {policy: (K,) costs of paired runs}
    z : of `quantile`
    """
    base = costs.get("nominal")
    if base is None or len(costs) < 2:
        return False
    margin = MARGIN * abs(float(np.mean(base)))
    for name, other in costs.items():
        if name != "nominal":
            with np.errstate(invalid="ignore"):
                difference = other - base
            if not np.all(np.isfinite(difference)):
                return False
            mean, error = float(np.mean(difference)), standard_error(difference)
            if not (abs(mean) > z * error or z * error < margin):
                return False
    return True


def verdict(table: PlainDict, done: int, ended: bool, z: float, judged: str = "cost") -> str:
    """In words what the numbers say.

    Parameters
    ----------
    table : {policy: its numbers}
    done : runs that were made
    ended : whether it was decided before all runs were made
    z : of `quantile`
    judged : what is compared, in a word
    """
    said, nominal = [], table.get("nominal")
    for name, row in table.items():
        if nominal is not None and name != "nominal" and row.get("difference_error") is not None:
            said.append(f"{name}: {_about(name, row, nominal, z, judged)}")
    begin = f"decided after {done} runs" if ended else f"{done} runs"
    if not said:
        return f"{begin}. "
    together = "" if len(said) == 1 and z < 1.97 else f", all intervals together at {1 - ERROR:.0%}"
    return f"{begin}{together}. {'; '.join(said)}."


def _about(name: str, row: PlainDict, nominal: PlainDict, z: float, judged: str) -> str:
    """What is said of one policy."""
    replanned = name == "replanned"
    if not row["difference_error"]:
        return "the nominal plan itself" + (": replanning does not pay" if replanned and not row["difference"] else "")
    base = abs(nominal["cost"] or float("nan"))
    share, interval = row["difference"] / base, z * row["difference_error"] / base
    away = row["difference"] / row["difference_error"]
    if abs(away) < z:
        text = f"no difference to the nominal plan is seen ({share:+.2%} +- {interval:.2%})"
    else:
        text = f"{'less' if away < 0 else 'more'} {judged} than the nominal plan ({share:+.2%} +- {interval:.2%})"
    if replanned:
        pays = away < -z and row["diverged"] <= nominal["diverged"]
        text += ": replanning pays" if pays else ": replanning does not pay"
        if row["diverged"] > nominal["diverged"]:
            text += f", {row['diverged']:.1%} of its runs diverged, {nominal['diverged']:.1%} of the nominal plan's"
    return text
