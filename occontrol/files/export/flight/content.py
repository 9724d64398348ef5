"""A plan for a target as tables: what the C text and its reference in Python both read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.target import TargetModel, TargetPlan
from occontrol.files.export.flight.formula_tables import (
    PREDICTIONS,
    formula_flags,
    formula_rows,
    programs_of,
    replayed,
    time_tables,
)
from occontrol.files.export.flight.plan import FlightPlan, make_plan, same_intervals, unit_factor
from occontrol.files.export.flight.program import Program
from occontrol.files.export.flight.tables import Table, shared, smallest
from occontrol.numerics.linalg import square_root


@dataclass(frozen=True)
class Options:
    """What of the filter goes onto the target.

    Parameters
    ----------
    precision : "double" or "single"
    gains_only : the planned gains and variances, without the code that computes a covariance
    no_plan : no planned gains and covariances, the covariance is always computed
    """

    precision: str = "double"
    gains_only: bool = False
    no_plan: bool = False

    def __post_init__(self) -> None:
        if self.precision not in ("double", "single"):
            raise UsageError(f"there is no precision '{self.precision}'\n  hint: there are: double, single")
        if self.gains_only and self.no_plan:
            raise UsageError("--gains-only and --no-plan leave nothing of the filter\n  hint: one of them")

    @property
    def dtype(self) -> str:
        """The numbers of the filter, as NumPy calls them."""
        return "f8" if self.precision == "double" else "f4"

    @property
    def words(self) -> str:
        """The options in words."""
        kind = "gains only" if self.gains_only else "no plan" if self.no_plan else "full"
        return f"{self.precision} precision, {kind}"


@dataclass(frozen=True, eq=False)
class Content:
    """Everything that is written for a target.

    Parameters
    ----------
    plan : TargetPlan
    options : Options
    tables : list of Table, those of the schedule first
    values : most values of one interval, at least 1
    """

    plan: TargetPlan
    options: Options
    tables: list[Table]
    values: int

    @property
    def flags(self) -> set[str]:
        """The parts of the templates that are kept."""
        found = {"instants"} if self.plan.instants else set()
        model, formulas = self.plan.filter, self.plan.formulas
        if model is None:
            return found
        found |= {"filter", self.options.precision} | ({"predict", "affine"} if model.outputs else set())
        if formulas is not None:
            return found | {"full"} | formula_flags(self.plan, formulas)
        found |= {"endless"} if self.plan.again is not None else set()
        found |= {"linear", "affine"} | (set() if self.options.gains_only else {"full"})
        return found | (set() if self.options.no_plan else {"plan"})

    @cached_property
    def programs(self) -> dict[str, Program]:
        """The formulas of a nonlinear filter by their names in C."""
        return programs_of(self.plan)

    @property
    def predicted_every(self) -> int:
        """After how many steps a replay asks for a prediction."""
        return 1 if self.plan.formulas is None else -(-self.plan.intervals // PREDICTIONS)

    @property
    def replayed(self) -> int:
        """How many intervals a replay runs over."""
        return replayed(self.plan)

    @cached_property
    def _named(self) -> dict[str, np.ndarray]:
        return {table.name: table.values for table in self.tables}

    def table(self, name: str) -> np.ndarray:
        """The numbers of one table; KeyError where there is none of that `name`."""
        return self._named[name]

    def row(self, name: str, k: int) -> np.ndarray:
        """The row of table `name` that belongs to `k`, (width,); the two parts of a factor share their list of rows."""
        index = f"{name}_row" if f"{name}_row" in self._named else f"{name.rsplit('_', 1)[0]}_row"
        return self._named[name][self._named[index][k]]


def make_content(plan: TargetPlan, options: Options) -> Content:
    """The tables of a plan.

    Parameters
    ----------
    plan : TargetPlan with N intervals and M sensors
    options : Options

    Raises UsageError where a number does not fit into the precision.
    """
    in_use = np.zeros((plan.intervals, len(plan.names)), dtype="u1")
    for k, active in enumerate(plan.active):
        in_use[k, list(active)] = 1
    tables = [Table("edges", plan.edges[:, None].astype("f8")), *shared("schedule", in_use)]
    values = 1
    if plan.filter is not None:
        counts = [sum(plan.rows[j] for j in active) for active in plan.active]
        values = max([1, *counts])
        tables.append(Table("sensor_values", smallest(np.array([plan.rows]))))
        tables.append(Table("values", smallest(np.array(counts))))
    if plan.model is not None:
        tables += _filter_tables(plan.model, plan.edges, options, values)
    if plan.formulas is not None:
        if options.gains_only:
            what = "the gains of a nonlinear plant follow from the estimates, there are none beforehand"
            raise UsageError(f"{what}\n  hint: leave --gains-only out")
        rows = formula_rows(plan, plan.formulas)
        rows |= _factors("root", [square_root(plan.formulas.covariance, floor=0.0)], plan.formulas.states)
        tables += [*time_tables(plan, plan.formulas), *_shared_tables(rows, plan.formulas.mean, options)]
    return Content(plan, options, tables, values)


def _filter_tables(model: TargetModel, edges: np.ndarray, options: Options, m: int) -> list[Table]:
    same = same_intervals(model, edges)
    plan = make_plan(model, same)
    n, N = model.states, len(same)
    rows: dict[str, np.ndarray] = {"transition": _columns(model.transition[same]), "input": model.input}
    observe, offset = np.zeros((N, n, m)), np.zeros((N, m))
    for k, j in enumerate(same):
        count = len(model.offset[k])
        observe[k, :, :count] = model.observe[j].T
        offset[k, :count] = model.offset[k]
    rows |= {"observe": observe.reshape(N, n * m), "offset": offset}
    if not options.gains_only:
        rows |= _factors("noise", [_values_first(model.noise_root[j], n) for j in same], n + m)
        rows |= _factors("root", list(plan.root[:1] if options.no_plan else plan.root), n)
    if not options.no_plan:
        rows |= _planned(plan, n, m)
        if options.gains_only:
            rows["planned_variance"] = np.einsum("kij,kij->ki", plan.root, plan.root)
    if model.outputs:
        D = model.predict_matrix
        rows["predict_matrix"], rows["predict_offset"] = _columns(D), model.predict_offset
        variance = np.einsum("kii->ki", model.predict_noise).copy()
        if options.gains_only:
            spread = D @ plan.root
            variance += np.einsum("kij,kij->ki", spread, spread)
        rows["predict_variance"] = variance
    return _shared_tables(rows, model.mean, options)


def _shared_tables(rows: dict[str, np.ndarray], mean: np.ndarray, options: Options) -> list[Table]:
    tables = [Table("mean", _rounded("mean", mean[None], options))]
    joined = {"noise_lower": "noise_pivot", "root_lower": "root_pivot", "innovation_lower": "innovation_pivot"}
    for name, value in rows.items():
        if name in joined.values():
            continue
        if name in joined:
            width = value.shape[1]
            both = _rounded(name, np.hstack((value, rows[joined[name]])), options)
            stem = name.split("_")[0]
            found, index = shared(stem, both)
            tables.append(Table(name, np.ascontiguousarray(found.values[:, :width])))
            tables.append(Table(joined[name], np.ascontiguousarray(found.values[:, width:])))
            tables.append(index)
        else:
            tables += shared(name, _rounded(name, value, options))
    return tables


def _planned(plan: FlightPlan, n: int, m: int) -> dict[str, np.ndarray]:
    gain = np.zeros((len(plan.gain), m, n))
    for k, K in enumerate(plan.gain):
        # without a variance there is no gain, and the step says so
        gain[k, : K.shape[1]] = np.where(np.all(np.isfinite(K)), K, 0.0).T
    return {"gain": gain.reshape(-1, m * n), **_factors("innovation", plan.innovation_root, m)}


def _factors(name: str, roots: list[np.ndarray], size: int) -> dict[str, np.ndarray]:
    """L and d of every root, padded to matrices of (size, size)."""
    lower, pivot = np.zeros((len(roots), max(1, size * (size - 1) // 2))), np.zeros((len(roots), size))
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    for k, root in enumerate(roots):
        key = root.tobytes()
        if key not in known:
            known[key] = unit_factor(root)
        L, d = known[key]
        lower[k, : len(L)], pivot[k, : len(d)] = L, d
    return {f"{name}_lower": lower, f"{name}_pivot": pivot}


def _values_first(root: np.ndarray, n: int) -> np.ndarray:
    return np.concatenate((root[n:], root[:n]))


def _columns(matrices: np.ndarray) -> np.ndarray:
    return np.swapaxes(matrices, 1, 2).reshape(len(matrices), -1)


def _rounded(name: str, value: np.ndarray, options: Options) -> np.ndarray:
    with np.errstate(over="ignore"):
        found = np.ascontiguousarray(value, dtype=options.dtype)
    if not np.all(np.isfinite(found)):
        what = f"the table '{name}' has numbers that {options.precision} precision does not hold"
        raise UsageError(f"{what}\n  hint: --precision double, or other units")
    return found + np.zeros((), dtype=options.dtype)  # -0 becomes 0: rows that are equal are then the same bytes
