"""The least precision that meets a covariance bound: feasibility first, then a solver, then the proof.

Unknowns: lambda (m,), one precision per scalar measurement.

    minimise  sum_i price_i lambda_i   subject to   Sigma+(lambda) <= P^d,   0 <= lambda <= caps

Das & Bhattacharya, theorem 1. No solver's status is believed: the answer is made exactly feasible, its posterior is
computed anew from equation (11), and the objective is held against a bound proved by the dual matrix.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from occontrol.core.errors import ProblemError
from occontrol.core.kinds import VectorField, unless_given
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.precision.barrier import Iterate, barrier
from occontrol.families.precision.feasibility import Feasibility, feasibility
from occontrol.families.precision.moments import Moments, posterior_covariance
from occontrol.families.precision.normal_form import Factored, NormalForm, factor_form, factored, reduced_form
from occontrol.numerics.linalg import solve_lower
from occontrol.numerics.sdp import LARGEST, solve_lmi

MEETS = 1e-8  # of the bound: a posterior above this is never reported as solved
NEGLIGIBLE = (
    1e-9  # of the largest precision (in signal-to-noise units): below, a sensor may be dropped if that costs nothing
)
SECOND_OPINION = 50  # rows up to which Clarabel is asked when the barrier stalls
ROUTES = ("barrier", "clarabel", "factor")


@dataclass(frozen=True, eq=False)
class Program:
    """One program.

    Parameters
    ----------
    moments : Moments of n bounded states and m scalar measurements
    bound : (n, n) P^d, symmetric positive definite, [state unit]^2
    prices : (m,) > 0, cost per unit of precision; ones if None
    caps : (m,) >= 0, largest precisions, infinity where there is none; infinity if None
    fixed : (m,) precisions that are given, NaN where they are to be chosen; all to be chosen if None
    """

    moments: Moments
    bound: np.ndarray
    prices: VectorField = unless_given(None)
    caps: VectorField = unless_given(None)
    fixed: VectorField = unless_given(None)

    def __post_init__(self) -> None:
        m = self.moments.sensors
        defaults = {"prices": 1.0, "caps": np.inf, "fixed": np.nan}
        for name, default in defaults.items():
            value = getattr(self, name)
            value = np.full(m, default) if value is None else np.asarray(value, dtype=float) * np.ones(m)
            object.__setattr__(self, name, value)
        if not np.all(self.prices > 0):
            raise ProblemError("a price is not positive", "prices > 0")
        if not np.all(self.caps >= 0):
            raise ProblemError("a cap is negative", "caps >= 0")
        if np.any(self.fixed < 0):
            raise ProblemError("a fixed precision is negative", "fixed >= 0")

    @property
    def free(self) -> np.ndarray:
        """Indices of the precisions that are to be chosen."""
        return np.flatnonzero(np.isnan(self.fixed))

    def without(self, dropped: np.ndarray) -> Program:
        """The same program without the sensors whose indices are `dropped` (k,)."""
        caps = self.caps.copy()
        caps[dropped] = 0.0
        return replace(self, caps=caps)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What was found and what is proven.

    Parameters
    ----------
    status : CERTIFIED, LIMIT (the target gap was not reached), INTERRUPTED, INFEASIBLE or FAILED
    message : one sentence
    precisions : (m,), None unless they meet the bound
    objective, lower_bound : sum_i price_i lambda_i, and what no choice of precisions can undercut
    margin : smallest eigenvalue of P^d - Sigma+, [state unit]^2
    relative_margin : the same in units of the bound
    posterior : (n, n) Sigma+
    feasibility : Feasibility
    route : the solver that gave the answer
    iterations : int
    note : that solver's own words
    """

    status: Status
    message: str
    precisions: Any
    objective: float
    lower_bound: float
    margin: float
    relative_margin: float
    posterior: np.ndarray | None
    feasibility: Feasibility
    route: str
    iterations: int = 0
    note: str = ""

    @property
    def relative_gap(self) -> float:
        """(objective - lower_bound)/objective, 0 when both vanish."""
        return (self.objective - self.lower_bound) / self.objective if self.objective else 0.0


def relative_margin(posterior: np.ndarray, bound: np.ndarray) -> float:
    """Smallest eigenvalue of I - C^-1 Sigma+ C^-T with P^d = C C': positive when the bound is met.

    `posterior` is Sigma+ (n, n), `bound` is P^d (n, n).
    """
    root = np.linalg.cholesky(bound)
    scaled = solve_lower(root, solve_lower(root, posterior).T)
    return 1.0 - float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[-1])


def examine(program: Program) -> tuple[Factored, Feasibility, Moments]:
    """Condition on the fixed precisions, scale, and decide feasibility in closed form."""
    free = program.free
    moments = program.moments
    if len(free) < moments.sensors:
        moments = moments.given(np.nan_to_num(program.fixed)).only(free)
    caps = program.caps[free]
    usable = np.flatnonzero(caps > 0)
    moments = moments.only(usable)
    split = factored(moments, program.bound)
    return split, feasibility(split, caps[usable]), moments


def solve_program(
    program: Program,
    route: str = "barrier",
    relative_gap: float = 1e-6,
    tolerance: float = 1e-12,
    max_iterations: int = 100,
    monitor: Monitor | None = None,
) -> Outcome:
    """Solve a Program by one of ROUTES and prove how good the answer is.

    Parameters
    ----------
    route : barrier, clarabel (reduced form) or factor (Clarabel on the factor form)
    relative_gap : (objective - lower bound)/objective above which the status is LIMIT
    tolerance : what the solver aims at

    A barrier that stalls above `relative_gap` is followed by Clarabel where that is small enough; the better counts.

    Raises ProblemError where the matrix inequality has too many rows for the route.
    """
    monitor = monitor or Monitor()
    split, verdict, _ = examine(program)
    free = program.free
    index = free[program.caps[free] > 0]
    paid = float(np.nansum(np.where(np.isnan(program.fixed), 0.0, program.prices * program.fixed)))
    zero = np.where(np.isnan(program.fixed), 0.0, program.fixed)
    if verdict.idle:
        return _finish(
            program, zero, paid, verdict, "closed form", Iterate(None, None, None, 0, ""), relative_gap, monitor
        )
    if not verdict.feasible:
        message = (
            f"The bound cannot be met: the smallest reachable bound is {verdict.factor:.10g} times the present one."
        )
        nan = float("nan")
        return Outcome(Status.INFEASIBLE, message, None, nan, nan, nan, nan, None, verdict, "closed form")
    prices, caps = program.prices[index], program.caps[index]
    slack = 2e-9 if verdict.tight else 0.0
    reduced = reduced_form(split, prices, caps, verdict.keep, slack)
    best: Outcome | None = None
    for name in (route, "clarabel") if route == "barrier" else (route,):
        form = factor_form(split, prices, caps) if name == "factor" else reduced
        if name != "barrier" and form.rows > (LARGEST if name == route else SECOND_OPINION):
            if name == route:
                hint = "use the method 'barrier'"
                raise ProblemError(
                    f"the matrix inequality has {form.rows} rows, too many for the method '{route}'", hint
                )
            break
        iterate = _run(form, name, tolerance, max_iterations, monitor)
        lower = max(0.0, form.unit * form.lower_bound(iterate.dual)) if iterate.dual is not None else 0.0
        precisions = _repair(program, zero, index, form, iterate)
        found = _finish(program, precisions, paid + lower, verdict, name, iterate, relative_gap, monitor)
        if best is None or best.precisions is None or found.relative_gap < best.relative_gap:
            best = found
        if best.status in (Status.CERTIFIED, Status.INTERRUPTED) or monitor.stop:
            break
    assert best is not None
    return best


def _run(form: NormalForm, name: str, tolerance: float, max_iterations: int, monitor: Monitor) -> Iterate:
    if name == "barrier":
        return barrier(form, tolerance, max_iterations, monitor)
    left = float("inf") if monitor.time_limit is None else max(0.1, monitor.time_limit - monitor.seconds)
    found = solve_lmi(form.constant, form.factors, form.costs, form.upper, tolerance, max(max_iterations, 100), left)
    usable = np.all(np.isfinite(found.values)) and np.all(np.isfinite(found.dual))
    if not usable:
        return Iterate(None, None, None, found.iterations, found.status)
    eigenvalues, vectors = np.linalg.eigh(found.dual)
    dual = (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
    return Iterate(np.clip(found.values, 0.0, form.upper), dual, found.slack, found.iterations, found.status)


def _repair(
    program: Program, zero: np.ndarray, index: np.ndarray, form: NormalForm, iterate: Iterate
) -> np.ndarray | None:
    """Drop what is negligible, then move out by the least amount that meets the bound; None if nothing near does."""
    if iterate.values is None or iterate.slack is None:
        return None
    values = iterate.values
    # a sensor is out when its multiplier dwarfs its share; both are pure numbers in the normal form
    out = (values <= NEGLIGIBLE * np.max(values, initial=0.0)) & (iterate.slack > 1e-6 * form.costs)
    where = index[form.index]
    for candidate in (np.where(out, 0.0, values), values):
        for excess in (0.0, *(10.0 ** np.arange(-14, -4.9, 0.5))):
            precisions = zero.copy()
            moved = np.minimum(candidate * (1 + excess), form.upper) * form.scale
            precisions[where] = np.minimum(moved, program.caps[where])
            posterior = posterior_covariance(program.moments, precisions)
            margin = relative_margin(posterior, program.bound)
            if margin >= -1e-12 or (margin >= -MEETS / 2 and np.all(moved >= program.caps[where] * (1 - 1e-12))):
                return precisions
    posterior = posterior_covariance(program.moments, precisions)
    return precisions if relative_margin(posterior, program.bound) >= -MEETS / 2 else None


def _finish(
    program: Program,
    precisions: Any,
    lower: float,
    verdict: Feasibility,
    route: str,
    iterate: Iterate,
    relative_gap: float,
    monitor: Monitor,
) -> Outcome:
    nan = float("nan")
    if precisions is None:
        message = f"The solver ended with nothing that meets the bound ({iterate.note}); try the other method."
        return Outcome(
            Status.FAILED, message, None, nan, lower, nan, nan, None, verdict, route, iterate.iterations, iterate.note
        )
    posterior = posterior_covariance(program.moments, precisions)
    posterior = (posterior + posterior.T) / 2
    objective = float(program.prices @ precisions)
    lower = min(lower, objective)
    margin = float(np.linalg.eigvalsh(program.bound - posterior)[0])
    relative = relative_margin(posterior, program.bound)
    gap = (objective - lower) / objective if objective else 0.0
    if relative < -MEETS:
        status = Status.FAILED
        message = f"The posterior misses the bound by {-relative:.1e} of it: not a solution."
        precisions = None
    elif gap <= relative_gap:
        status = Status.CERTIFIED
        message = (
            "No measurement is needed."
            if objective == 0
            else f"Optimal within {max(gap, 0.0):.1e}, proven by the dual matrix."
        )
    elif iterate.note == "stopped" and monitor.interrupted:
        status, message = Status.INTERRUPTED, Status.INTERRUPTED.text
    else:
        status, message = (
            Status.LIMIT,
            f"The bound is met, the proven gap is {gap:.1e}; raise max_iterations or relative_gap.",
        )
    return Outcome(
        status,
        message,
        precisions,
        objective,
        lower,
        margin,
        relative,
        posterior,
        verdict,
        route,
        iterate.iterations,
        iterate.note,
    )
