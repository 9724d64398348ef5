"""What simulated runs of a policy came to, and the numbers that are said of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.kinds import PlainDict
from occontrol.scheduling.closed_loop.sequential import standard_error

DIVERGED = 10.0  # mean NEES per state


@dataclass(frozen=True, eq=False)
class Outcomes:
    """What B runs of one policy came to.

    Parameters
    ----------
    error : (B,) running plus terminal squared error, weighted as the objective weighs covariances
    price : (B,) of the readings and changes, as the objective weighs them
    nees : (B,) mean of e' P^-1 e / n over the readings
    nis : (B,) mean of the normalised innovation squared per value
    lost : (B,) readings that brought nothing
    readings : (B,) that brought something
    plans, late : (B,) new plans, and those of them that the deadline has cut off
    """

    error: np.ndarray
    price: np.ndarray
    nees: np.ndarray
    nis: np.ndarray
    lost: np.ndarray
    readings: np.ndarray
    plans: np.ndarray
    late: np.ndarray

    @property
    def cost(self) -> np.ndarray:
        """(B,) error and price together: what the plan makes small."""
        return self.error + self.price

    @staticmethod
    def joined(parts: Sequence[Outcomes]) -> Outcomes:
        """One after the other.

        Parameters
        ----------
        parts : of consecutive runs
        """
        names = Outcomes.__dataclass_fields__
        return Outcomes(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def numbers(own: Outcomes, nominal: Outcomes | None, milliseconds: Sequence[float]) -> PlainDict:
    """Mean, median, standard error, divergence, consistency and what was paid, of one policy.

    Parameters
    ----------
    own : of the policy
    nominal : of the nominal plan on the same runs, for the difference; None where it was not flown
    milliseconds : of the policy's decisions
    """
    finite = np.isfinite(own.error)
    error = own.error[finite]
    found: PlainDict = {
        "mean": float(np.mean(error)) if len(error) else None,
        "median": float(np.median(own.error)),
        "standard_error": standard_error(error) if len(error) > 1 else None,
        "diverged": float(np.mean(~finite | (own.nees > DIVERGED))),
        "nees": float(np.mean(own.nees[np.isfinite(own.nees)])) if np.any(np.isfinite(own.nees)) else None,
        "nis": float(np.nanmean(own.nis)) if np.any(np.isfinite(own.nis)) else None,
        "cost": float(np.mean(own.cost[finite])) if len(error) else None,
        "lost": float(np.mean(own.lost)),
        "readings": float(np.mean(own.readings)),
        "late": float(np.sum(own.late) / np.sum(own.plans)) if np.any(own.plans) else None,
        "milliseconds": float(np.median(milliseconds)) if milliseconds else 0.0,
    }
    if nominal is not None and nominal is not own:
        both = finite & np.isfinite(nominal.error)
        difference = own.cost[both] - nominal.cost[both]
        found["difference"] = float(np.mean(difference)) if len(difference) else None
        found["difference_error"] = standard_error(difference) if len(difference) > 1 else None
    return found
