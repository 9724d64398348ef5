"""Observation cost against error over caps: the least error for every budget, certified one by one.

For a cap b on the observation cost q,  e(b) = min { e : q <= b }  falls as b grows, so what bounds the error for one
cap bounds it for every smaller one, and a schedule for one cap is one for every larger one. Rules of the problem stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from occontrol.core.errors import FileAccessError, InfeasibleError, ProblemError, SolveFailed, UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Solution, Status
from occontrol.core.versions import stamped
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.result import AthansResult
from occontrol.families.athans.rules.statement import Constraints
from occontrol.families.family import Family
from occontrol.files.atomic import replacing, write_text
from occontrol.files.plain_json import to_json
from occontrol.files.tables import write_table

CAP = "max_observation_cost"


@dataclass(frozen=True, eq=False)
class BudgetFront:
    """The least error of one problem over caps on its observation cost.

    Parameters
    ----------
    problem : whose other rules hold
    budgets : (B,) caps, increasing
    solutions : one for every cap
    lower_bound : (B,) no schedule within the cap has a smaller error
    refused : {cap: why no schedule keeps it}
    status : the worst of the points, or interrupted
    """

    problem: AthansProblem
    budgets: np.ndarray
    solutions: list[Solution]
    lower_bound: np.ndarray
    refused: dict[float, str]
    status: Status

    @property
    def errors(self) -> np.ndarray:
        """(B,) what the schedules cost beside their observation cost."""
        return np.array([_top(s)[0] for s in self.solutions])

    @property
    def prices(self) -> np.ndarray:
        """(B,) what one more unit of the cap lowers the bound by."""
        return np.array([_price(s) for s in self.solutions])

    def as_dict(self) -> dict:
        """The front as plain data, point by point."""
        points = []
        for i, solution in enumerate(self.solutions):
            numbers: AthansResult = solution.numbers  # type: ignore[assignment]
            error, bound = float(self.errors[i]), float(self.lower_bound[i])
            points.append(
                {
                    "budget": float(self.budgets[i]),
                    "price": float(self.prices[i]),
                    "observation_cost": float(numbers.observation_cost),
                    "error": error,
                    "lower_bound": bound,
                    "relative_gap": (error - bound) / abs(error) if error else 0.0,
                    "proven_optimal": bool(numbers.proven_optimal),
                    "switches": numbers.switches,
                    "schedule": [] if solution.schedule is None else solution.schedule.segments(),
                }
            )
        return {
            "family": self.problem.family,
            "name": self.problem.name,
            "status": str(self.status),
            "of": "problem" if self.problem.takes_readings else "grid",
            "points": points,
            "refused": [{"budget": budget, "why": why} for budget, why in self.refused.items()],
        }


def _top(solution: Solution) -> tuple[float, float]:
    numbers: AthansResult = solution.numbers  # type: ignore[assignment]
    pair = numbers.top or solution.certificate
    if pair is None:
        raise SolveFailed("a schedule has no certificate")
    return pair.cost, pair.lower_bound


def _price(solution: Solution) -> float:
    numbers: AthansResult = solution.numbers  # type: ignore[assignment]
    return float((numbers.multipliers or {}).get(CAP, 0.0))


def budgets(problem: AthansProblem, caps: Sequence[float], family: Family, monitor: Monitor) -> BudgetFront:
    """The least error for every cap on the observation cost.

    Parameters
    ----------
    problem : its own goal, cost weight and cap play no part
    caps : values of the cap, in any order
    family : that solves the problem
    monitor : Monitor; interrupted, the points found so far are returned

    Raises ProblemError when no sensor costs anything, InfeasibleError when no cap leaves a schedule, UsageError for a
    criterion other than the trace and without a prior.
    """
    if problem.measured or not problem.prior:
        what = "fronts over caps " + ("are of the trace" if problem.measured else "need an initial covariance")
        raise UsageError(f"{what}\n  hint: solve with several values of objective.cost_weight")
    family.require_feasible(problem)
    at = np.concatenate([problem.edges, (problem.edges[1:] + problem.edges[:-1]) / 2])
    if not any(np.any(s.cost.sample(at)) for s in problem.sensors if s.rows):
        raise ProblemError("no sensor costs anything: there is nothing to trade", "give the sensors a cost")
    method = problem.method if isinstance(problem.method, RelaxRoundPolish) else RelaxRoundPolish()
    rules = problem.rules or Constraints()
    refused: dict[float, str] = {}
    kept: list[tuple[float, Solution]] = []
    last: InfeasibleError | None = None
    for cap in sorted({float(b) for b in caps}):
        watch = monitor.child()
        watch.stage = f"budget {cap:.4g}"
        watch.resume = kept[-1][1] if kept else None
        limits = replace(rules, max_observation_cost=cap)
        capped = replace(problem, rules=limits, minimise="error", expect=None)  # type: ignore[type-var]
        try:
            solution = family.solve(capped, method, watch)
        except InfeasibleError as error:
            refused[cap], last = str(error).split("\n")[0], error
            continue
        if solution.status is Status.INTERRUPTED and kept:
            break
        kept.append((cap, solution))
        if monitor.stop:
            break
    if not kept:
        raise last if last is not None else InfeasibleError("no budget was given")
    found = [solution for _, solution in kept]
    bounds = np.array([_top(s)[1] for s in found])
    status = Status.CERTIFIED
    for solution in found:
        status = status if solution.status is Status.CERTIFIED else solution.status
    status = Status.INTERRUPTED if monitor.interrupted else status
    # a bound for one cap holds for every smaller one
    return BudgetFront(
        problem,
        np.array([cap for cap, _ in kept]),
        found,
        np.maximum.accumulate(bounds[::-1])[::-1],
        refused,
        status,
    )


def write_budgets(folder: str | Path, front: BudgetFront, figures: bool = True) -> list[Path]:
    """Write a front over caps; each file is replaced only when its successor is complete.

    Parameters
    ----------
    folder : created if missing
    front : BudgetFront
    figures : whether to draw

    Returns the files written. Raises FileAccessError.
    """
    folder, content = Path(folder), stamped(front.as_dict())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        written = [write_text(folder / "tradeoff.json", to_json(content))]
        keys = ("budget", "price", "observation_cost", "error", "lower_bound", "relative_gap", "switches")
        rows = [[point[key] for key in keys] for point in content["points"]]
        written.append(write_table(folder / "front.csv", keys, rows))
        arrays = {"budgets": front.budgets, "edges": front.solutions[0].arrays["edges"]}
        arrays["weights"] = np.array([s.arrays["weights"] for s in front.solutions])
        with replacing(folder / "arrays.npz") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        written.append(folder / "arrays.npz")
        if figures:
            from occontrol.families.athans.figures_budgets import draw_budgets
            from occontrol.files.figures import save

            for name, figure in draw_budgets(front).items():
                save(figure, folder / f"{name}.png")
                written.append(folder / f"{name}.png")
    except OSError as error:
        raise FileAccessError(f"cannot write to {folder}: {error.strerror or error}") from error
    return written
