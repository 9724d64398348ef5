"""The problem of Das & Bhattacharya: which precision must each sensor have for a required accuracy?"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.checks import check_covariance
from occontrol.core.errors import Collector, InfeasibleError, Mistake, UsageError
from occontrol.core.kinds import Kept, MatrixLike, PlainMapping, VectorField, unless_given
from occontrol.core.method import Method
from occontrol.core.problem import BaseProblem
from occontrol.families.precision.ensemble import EnsembleFilter
from occontrol.families.precision.measurement import NonlinearMeasurement
from occontrol.families.precision.moments import Moments, check_moments
from occontrol.families.precision.plant import NonlinearPlant
from occontrol.families.precision.program import Program, examine
from occontrol.families.precision.pruning import Pruning
from occontrol.families.precision.reach import infeasible_text
from occontrol.families.precision.sigma_points import noise_root
from occontrol.families.precision.unscented import UnscentedFilter

MOST_MEASUREMENTS = 2000
SIZE_WORDS = ("it needs", "bounded states")  # in the sentences about sizes that follow from other parts


@dataclass(frozen=True)
class ScalarSensor:
    """A sensor's name, and that one measurement of it is one number."""

    name: str
    rows: int = 1


@dataclass(frozen=True, eq=False)
class Problem(BaseProblem):
    """Choose precisions lambda >= 0 of least total price such that the posterior covariance stays below a bound.

    minimise  sum_i price_i lambda_i   subject to   Sigma+(lambda) <= P^d,   lambda <= caps

    Parameters
    ----------
    name : str
    moments : Moments of a single measurement; or give plant, measurement and filter
    plant : NonlinearPlant with n states
    measurement : NonlinearMeasurement with m scalar sensors
    filter : EnsembleFilter or UnscentedFilter
    bound_factor : P^d = factor times the initial covariance (times `moments.state` where there is no plant)
    bound_matrix : P^d itself, (n, n) positive definite, [state unit]^2; one of the two
    batch : q, the number of steps whose measurements are chosen together; the bound holds at the last
    batches : how many batches are run one after another, against a simulated truth
    caps, prices, fixed : numbers, or lists of m (alike in every step) or q*m entries; None entries: no cap, not fixed
    prune : Pruning, or None
    truth_seed : of the simulated truth and measurement noise
    method : an object of one of the family's methods, or None for the first
    expect : {source, cost, tolerance}, the known answer, if any

    Raises ProblemError naming every mistake. Das & Bhattacharya, theorem 1 and section 4.2.
    """

    name: str
    moments: Moments | None = None
    plant: NonlinearPlant | None = None
    measurement: NonlinearMeasurement | None = None
    filter: EnsembleFilter | UnscentedFilter | None = None
    bound_factor: float | None = None
    bound_matrix: Kept[MatrixLike | None, np.ndarray | None] = unless_given(None)
    batch: int = 1
    batches: int = 1
    caps: VectorField = unless_given(None)
    prices: VectorField = unless_given(None)
    fixed: VectorField = unless_given(None)
    prune: Pruning | None = None
    truth_seed: int = 0
    method: Method | None = None
    expect: PlainMapping | None = None
    family: str = field(default="precision", init=False)
    bound: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        found = Collector()
        if (self.moments is None) == (self.plant is None):
            what = "neither a plant nor moments" if self.plant is None else "both a plant and moments"
            found.add((), f"the problem has {what}", "plant, measurement and filter; or moments alone")
        elif self.plant is not None:
            for key in ("measurement", "filter"):
                if getattr(self, key) is None:
                    found.add((), f"the problem has a plant but no {key}", f"add {key}: {{..}}", key=True)
        elif self.moments is not None:
            for key in ("measurement", "filter"):
                if getattr(self, key) is not None:
                    found.add((key,), f"{key} does not go with moments", "leave it out, or give a plant", key=True)
            found.mistakes += [m.under("moments") for m in check_moments(self.moments)]
        structure = not found.mistakes or self.moments is not None
        sized = True
        for key, most in (("batch", 1000), ("batches", 10_000)):
            value = getattr(self, key)
            if isinstance(value, bool) or int(value) != value or not 1 <= value <= most:
                found.add((key,), f"{key} is {value}", f"a whole number from 1 to {most}")
                sized &= key != "batch"
            elif self.moments is not None and value != 1:
                found.add((key,), f"{key} is {value}, but moments are a single batch", "leave it out, or give a plant")
                object.__setattr__(self, key, 1)  # and so the rest is judged
        if not structure:
            found.raise_if_any()
        if sized and self.measurements > MOST_MEASUREMENTS:
            what = f"there are {self.measurements} precisions to choose (sensors times batch)"
            found.add(("batch",), what, f"at most {MOST_MEASUREMENTS}")
            sized = False
        found.mistakes += self._check_bound(any(m.path[:1] == ("moments",) for m in found.mistakes))
        for key, lowest, default in (("caps", 0.0, np.inf), ("prices", None, 1.0), ("fixed", 0.0, np.nan)):
            self._spread(found, key, lowest, default, sized)
        if sized and isinstance(self.filter, UnscentedFilter) and self.plant is not None:
            size = self.plant.states + self.batch * noise_root(self.plant.noise).shape[1]
            if size + self.filter.kappa <= 0:
                what = f"kappa is {self.filter.kappa:g}, the augmented state has {size} entries"
                found.add(("filter", "kappa"), what, f"kappa > {-size}")
        found.raise_if_any()

    def _check_bound(self, moments_wrong: bool) -> list[Mistake]:
        n = self.states
        if (self.bound_factor is None) == (self.bound_matrix is None):
            what = "neither factor nor matrix" if self.bound_factor is None else "both factor and matrix"
            return [Mistake(("bound",), f"bound has {what}", "bound: {factor: 0.6} or bound: {matrix: ..}", key=True)]
        if self.bound_factor is not None:
            if not (np.isfinite(self.bound_factor) and self.bound_factor > 0):
                return [Mistake(("bound", "factor"), f"bound.factor is {self.bound_factor:g}", "factor > 0")]
            if moments_wrong:
                return []  # it would only be said again
            base = self.moments.state if self.moments is not None else self.plant.covariance  # type: ignore[union-attr]
            matrix, path = self.bound_factor * base, ("bound", "factor")
            name = "the bound (factor times the initial covariance)"
        else:
            matrix, path, name = np.atleast_2d(np.asarray(self.bound_matrix, dtype=float)), ("bound", "matrix"), "bound"
        if matrix.shape != (n, n):
            rows, columns = matrix.shape
            what = f"the bound is {rows}x{columns}, but there are {n} bounded states"
            return [Mistake(path, what, f"it must be {n}x{n}")]
        scale = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
        mistakes = check_covariance(name, matrix, path) or check_covariance(
            name, matrix / scale / scale[:, None], path, True
        )
        object.__setattr__(self, "bound", (matrix + matrix.T) / 2)
        return mistakes

    def _spread(self, found: Collector, key: str, lowest: float | None, default: float, sized: bool) -> None:
        """A number or a list becomes one number per measurement; mistakes are noted, those of size if that is known."""
        value, total, each = getattr(self, key), self.measurements if sized else 0, self.sensor_count
        items = list(value) if isinstance(value, list | tuple | np.ndarray) else [value]
        numbers = np.array([default if v is None else float(v) for v in items])
        bad = ~(numbers > 0 if lowest is None else numbers >= lowest) & ~np.isnan(numbers)
        if key != "fixed":
            bad |= np.isnan(numbers)
        if key != "caps":
            bad |= np.isinf(numbers)
        for i in np.flatnonzero(bad):
            where, path = (f" entry {i + 1}", (key, int(i))) if len(items) > 1 else ("", (key,))
            what = f"{key}{where} is {numbers[i]:g}"
            found.add(path, what, "more than 0" if lowest is None else "not negative")
        if not sized:
            return
        if len(numbers) == 1:
            numbers = np.full(total, numbers[0])
        elif len(numbers) == each:
            numbers = np.tile(numbers, self.batch)
        elif len(numbers) != total:
            sizes = f"{each}" if each == total else f"{each} (one per sensor) or {total} (one per sensor and step)"
            found.add((key,), f"{key} has {len(numbers)} entries, it needs {sizes}", "or a single number for all")
            return
        object.__setattr__(self, key, numbers)

    @property
    def states(self) -> int:
        """The number n of bounded states."""
        return self.moments.states if self.moments is not None else self.plant.states  # type: ignore[union-attr]

    @property
    def sensor_count(self) -> int:
        """The number m of scalar sensors."""
        return self.moments.sensors if self.moments is not None else self.measurement.sensors  # type: ignore[union-attr]

    @property
    def sensors(self) -> tuple[ScalarSensor, ...]:
        """The sensors, for whoever reads their measurements."""
        return tuple(ScalarSensor(name) for name in self.names)

    @property
    def measurements(self) -> int:
        """q*m, the number of precisions chosen together."""
        return self.sensor_count * int(self.batch)

    @property
    def names(self) -> tuple[str, ...]:
        """The m sensor names."""
        return (
            tuple(self.measurement.names or ())
            if self.measurement is not None
            else tuple(f"y{i + 1}" for i in range(self.sensor_count))
        )

    @property
    def factor(self) -> float:
        """What `smallest_factor` is a multiple of: bound.factor, or 1 for a bound matrix."""
        return 1.0 if self.bound_factor is None else float(self.bound_factor)

    def program(self, moments: Moments) -> Program:
        """The program of one batch with these moments."""
        return Program(moments, self.bound, self.prices, self.caps, self.fixed)

    def dynamics(self, what: str) -> tuple[NonlinearPlant, NonlinearMeasurement, EnsembleFilter | UnscentedFilter]:
        """Plant, measurement and filter; UsageError for plain moments, which have no plant to `what`."""
        if self.plant is None or self.measurement is None or self.filter is None:
            raise UsageError(
                f"a problem with plain moments has no plant to {what}\n  hint: give plant, measurement and filter"
            )
        return self.plant, self.measurement, self.filter

    def first_moments(self) -> Moments:
        """The moments that the first batch will be decided by."""
        if self.moments is not None:
            return self.moments
        plant, measurement, filter_ = self.dynamics("forecast")
        return filter_.start(plant, measurement).forecast(self.batch).moments

    def require_feasible(self) -> None:
        """Raise InfeasibleError when the first batch cannot meet the bound; later ones depend on what is measured."""
        _, verdict, _ = examine(self.program(self.first_moments()))
        if not verdict.feasible:
            raise InfeasibleError(infeasible_text(self, verdict))

    def groups(self) -> list[np.ndarray]:
        """What pruning may drop together: single measurements, or all those of one sensor; never what is fixed."""
        index = np.arange(self.measurements)
        free = np.isnan(self.fixed) & (self.caps > 0)
        by_sensor = self.prune is not None and self.prune.by == "sensor"
        groups = (
            [index[k :: self.sensor_count] for k in range(self.sensor_count)]
            if by_sensor
            else list(index.reshape(-1, 1))
        )
        return [group[free[group]] for group in groups if np.any(free[group])]

    def labels(self) -> list[str]:
        """A name for each of the q*m measurements: the sensor's, with the step of the batch where there are several."""
        if self.batch == 1:
            return list(self.names)
        return [f"{name}@{j + 1}" for j in range(self.batch) for name in self.names]


PrecisionProblem = Problem  # its name outside of the family
