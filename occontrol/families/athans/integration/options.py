"""How a problem is integrated: accuracy, fixed steps, and which times may become edges of the schedule."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from occontrol.core.errors import Mistake
from occontrol.core.kinds import PlainDict

LEAST_ACCURACY = 1e-6  # of the accuracy that follows from the method's relative gap
SHARE_OF_GAP = 0.1
MOST_SUBSTEPS = 10_000


@dataclass(frozen=True)
class Integration:
    """The steps of integration apart from the decisions of the schedule.

    Parameters
    ----------
    accuracy : largest relative difference between the cost and the same schedule's cost in continuous time; a tenth of
        the method's relative gap, at least LEAST_ACCURACY, if None
    substeps : that many equal steps on every interval instead, and no further edge; a search under rules, which needs
        one convex recursion, states a number for each interval
    windows : "edges" makes the ends of windows edges, "cover" uses a sensor only on intervals that its windows cover
    refine : whether intervals that one choice spoils may be cut
    """

    accuracy: float | None = None
    substeps: int | tuple[int, ...] | None = None
    windows: str = "edges"
    refine: bool = True

    def mistakes(self) -> list[Mistake]:
        """What is wrong with the options, by their places in a problem file."""
        found = []
        accuracy, substeps = self.accuracy, self.substeps
        if accuracy is not None and not (np.isfinite(accuracy) and accuracy > 0):
            what = f"horizon.accuracy is {accuracy:g}"
            found.append(Mistake(("horizon", "accuracy"), what, "a relative difference above 0, such as 1.0e-5"))
        if isinstance(substeps, int) and not 1 <= substeps <= MOST_SUBSTEPS:
            what = f"horizon.substeps is {substeps}, it must be at least 1 and at most {MOST_SUBSTEPS}"
            found.append(Mistake(("horizon", "substeps"), what))
        if self.windows not in ("edges", "cover"):
            what = f"horizon.windows is '{self.windows}'"
            found.append(Mistake(("horizon", "windows"), what, "edges or cover"))
        if substeps is not None and accuracy is not None:
            what = "horizon has both 'substeps' and 'accuracy'"
            found.append(Mistake(("horizon", "accuracy"), what, "give one of them"))
        return found

    def steps(self, intervals: int, otherwise: int = 1) -> int:
        """How many steps are stated for all intervals; so many an interval where none are.

        Parameters
        ----------
        intervals : N
        otherwise : steps an interval
        """
        parts = self.substeps or otherwise
        return sum(parts) if isinstance(parts, tuple) else parts * intervals

    def target(self, relative_gap: float) -> float:
        """The relative accuracy of the cost that is aimed at.

        Parameters
        ----------
        relative_gap : of the method
        """
        return self.accuracy if self.accuracy is not None else max(SHARE_OF_GAP * relative_gap, LEAST_ACCURACY)

    def as_dict(self) -> PlainDict:
        """The options that are not left out, for a problem file."""
        return {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) != f.default}
