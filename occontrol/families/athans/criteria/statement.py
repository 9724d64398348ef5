"""Which function of the outputs' covariance counts, as a problem states it, and what can be wrong with that."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from occontrol.core.errors import Collector, Mistake, suggest
from occontrol.core.kinds import PlainDict

if TYPE_CHECKING:
    from occontrol.families.athans.base import AthansProblem

TRACE, LOG_TRACE, LOGDET, LARGEST, SCHATTEN, PEAK = NAMES = (
    "trace", "log-trace", "logdet", "largest-eigenvalue", "schatten", "peak",
)  # fmt: skip
LOGARITHMIC = (LOG_TRACE, LOGDET)
AT = ("posterior", "prior")
_PATH = ("objective", "criterion")
_NOT_CONVEX = {"lambda-min", "lambda_min", "smallest-eigenvalue", "least-eigenvalue", "condition-number", "condition"}


@dataclass(frozen=True)
class CriterionChoice:
    """A criterion of X = D Sigma D'.

    Parameters
    ----------
    name : "trace", "log-trace" ln tr X, "logdet" ln det X, "largest-eigenvalue", "schatten" (tr X^p)^(1/p), or "peak",
        the largest tr X along the way
    p : of schatten, at least 1; 4 if left out
    at : "posterior" or "prior", of a peak of readings: after or before each of them
    since : the first time, or step, at which a peak counts; the start if left out
    limit : what the peak may not exceed; the peak is then no part of the cost
    """

    name: str = TRACE
    p: float | None = None
    at: str | None = None
    since: float | None = None
    limit: float | None = None

    def mistakes(self, problem: AthansProblem) -> list[Mistake]:
        """What is wrong with this choice for `problem`."""
        found = Collector()
        if self.name in _NOT_CONVEX:
            what = f"the criterion '{self.name}' is not offered: it is not convex, so that no bound could be proven"
            found.add((*_PATH, "name"), what, f"one of: {', '.join(NAMES)}")
            return found.mistakes
        if self.name not in NAMES:
            found.add((*_PATH, "name"), f"unknown criterion '{self.name}'", suggest(self.name, NAMES))
            return found.mistakes
        if self.p is not None and self.name != SCHATTEN:
            found.add((*_PATH, "p"), "p belongs to the criterion schatten", "leave p out", True)
        elif self.p is not None and not (np.isfinite(self.p) and self.p >= 1):
            found.add((*_PATH, "p"), f"p of schatten is {self.p:g}", "a number of at least 1")
        if self.name != PEAK:
            hint = "terminal criteria follow objective.at" if self.at is not None else "name: peak"
            for key, value in (("at", self.at), ("from", self.since), ("limit", self.limit)):
                if value is not None:
                    found.add((*_PATH, key), f"{key} belongs to the criterion peak", hint, True)
            return found.mistakes
        found.mistakes += self._of_peak(problem)
        return found.mistakes

    def _of_peak(self, problem: AthansProblem) -> list[Mistake]:
        found = Collector()
        if self.at is not None and not problem.takes_readings:
            found.add((*_PATH, "at"), "at belongs to readings: a rate has no before and after", "leave it out", True)
        elif self.at not in (None, *AT):
            found.add((*_PATH, "at"), f"at is '{self.at}'", f"one of: {', '.join(AT)}")
        last = float(problem.clock.times[-1]) if problem.takes_readings else float(problem.edges[-1])  # type: ignore[attr-defined]
        if self.since is not None and not (np.isfinite(self.since) and self.since <= last):
            what = f"from is {self.since:g}, the last time at which the peak could count is {last:g}"
            found.add((*_PATH, "from"), what, "an earlier one")
        if self.limit is not None and not (np.isfinite(self.limit) and self.limit > 0):
            found.add((*_PATH, "limit"), f"limit is {self.limit:g}", "a variance above 0")
        return found.mistakes

    @property
    def power(self) -> float:
        """p"""
        return 4.0 if self.p is None else float(self.p)

    @property
    def when(self) -> str:
        """`at`, or what stands for it."""
        return self.at or AT[0]

    @property
    def logarithmic(self) -> bool:
        """Whether gaps are differences and not shares."""
        return self.name in LOGARITHMIC

    @property
    def text(self) -> str:
        """In one line for people."""
        names = {
            TRACE: "trace of the outputs' covariance X",
            LOG_TRACE: "ln tr X of the outputs' covariance X",
            LOGDET: "ln det X of the outputs' covariance X, twice the log volume of the error ellipsoid",
            LARGEST: "largest eigenvalue of the outputs' covariance X, the variance in the worst direction",
            SCHATTEN: f"Schatten norm (tr X^p)^(1/p) of the outputs' covariance X, p = {self.power:g}",
            PEAK: "largest trace of the outputs' covariance along the way",
        }
        text = names[self.name]
        if self.since is not None:
            text += f", from {self.since:g} on"
        return text if self.limit is None else f"{text}: at most {self.limit:g}, a constraint"

    def document(self) -> PlainDict:
        """As it stands in a problem file."""
        values = {"name": self.name, "p": self.p, "at": self.at, "from": self.since, "limit": self.limit}
        return {key: value for key, value in values.items() if value is not None}


def mistakes_of(problem: AthansProblem) -> list[Mistake]:
    """What is wrong with the criterion of a problem, alone and beside its rules.

    Parameters
    ----------
    problem : whose fields are set
    """
    choice = problem.criterion
    if choice is None:
        return []
    found = choice.mistakes(problem)
    if choice.name == TRACE:
        return found
    if problem.minimise == "observation":
        what = "minimise: observation leaves the criterion out of what is minimised"
        hint = "minimise: cost; or criterion: {name: peak, limit: ..}, which is a constraint"
        found.append(Mistake(("objective", "minimise"), what, hint))
    if problem.rules is not None and problem.rules.max_error is not None:
        what = f"max_error is of the trace, and the criterion is {choice.name}"
        found.append(Mistake(("constraints", "max_error"), what, "criterion: {name: peak, limit: ..}", True))
    return found
