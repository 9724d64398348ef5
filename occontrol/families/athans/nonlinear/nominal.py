"""The nominal path of a nonlinear plant, with as many substeps as accuracy asks for, and its maps from span to span."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import Collector, Mistake, ProblemError
from occontrol.core.signal import Signal
from occontrol.families.athans.nonlinear.path import Path, SmoothPath, StatedPath, SteppedPath, evaluate
from occontrol.families.athans.nonlinear.plant import FormulaPlant
from occontrol.numerics.flow import Spans, charges, combined

ACCURACY = 1e-10  # relative, of path and maps when the substeps are doubled
LOOSEST = 1e-3  # what a path must reach
MOST_STEPS = 400_000  # single Runge-Kutta steps of a whole path
MOST_BEYOND = 1000  # spans between the end and the prediction
MOST_HOPED = 256  # substeps with which a path that leaves the numbers is tried again
MOST_ALONG_A_TABLE = 64  # substeps: a table is no smoother than its lines


@dataclass(frozen=True)
class IntegratorOptions:
    """How the path is integrated.

    Parameters
    ----------
    substeps : of every span between two readings (of every interval); chosen by accuracy if left out
    accuracy : relative change of path and maps that doubling them may make; 1e-10 if left out

    Raises ProblemError for numbers that make no sense.
    """

    substeps: int | None = None
    accuracy: float | None = None

    def __post_init__(self) -> None:
        found = Collector()
        if self.substeps is not None and not 1 <= self.substeps <= MOST_STEPS:
            hint = f"a whole number from 1 to {MOST_STEPS}"
            found.add(("substeps",), f"integrator.substeps is {self.substeps}", hint)
        if self.accuracy is not None and not 1e-14 <= self.accuracy <= LOOSEST:
            found.add(("accuracy",), f"integrator.accuracy is {self.accuracy:g}", f"from 1e-14 to {LOOSEST:g}")
        if self.substeps is not None and self.accuracy is not None:
            what = "integrator has both 'substeps' and 'accuracy'"
            found.add(("accuracy",), what, "give one of them", key=True)
        found.raise_if_any()

    def as_dict(self) -> Mapping[str, float]:
        """What is stated, for a problem file."""
        return {k: v for k, v in (("substeps", self.substeps), ("accuracy", self.accuracy)) if v is not None}


@dataclass(frozen=True, eq=False)
class Nominal:
    """A path and its maps over G spans.

    Parameters
    ----------
    plant : FormulaPlant
    origin : time that `since` is counted from, in the unit of time
    since : (G+1,) where the spans begin and end
    substeps : of every span
    path : Path at any time
    spans : Spans
    """

    plant: FormulaPlant
    origin: float
    since: np.ndarray
    substeps: int
    path: Path
    spans: Spans

    @property
    def change(self) -> float:
        """How much path and maps change, relatively, when the substeps are doubled; 0 in discrete time."""
        if self.plant.discrete:
            return 0.0
        return difference(self.spans, spans_of(self.plant, self.origin, self.since, 2 * self.substeps), _sizes(self))

    def charges(self, weight: Signal, spans: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """M (G, n, n) and c (G,) of the running integral of tr(R S) over the first spans, see numerics/flow.py.

        Parameters
        ----------
        weight : R, (n, n)
        spans : how many, G; all if left out
        """
        some = Spans(*(part[:spans] for part in vars(self.spans).values()))
        times = some.times
        inner = np.clip(times, times[:, :1], times[:, :1] + (times[:, -1:] - times[:, :1]) * (1 - 1e-9))
        R = np.array(weight.sample(inner.ravel())).reshape(*times.shape, *weight.shape)
        return charges(some, (R + np.swapaxes(R, 2, 3)) / 2)


def make_nominal(plant: FormulaPlant, origin: float, since: np.ndarray, options: IntegratorOptions) -> Nominal:
    """The nominal path of a plant.

    Parameters
    ----------
    plant : FormulaPlant
    origin : a time
    since : (G+1,) times of the spans, counted from `origin`; neighbours may be equal
    options : IntegratorOptions

    Raises ProblemError where the path leaves the numbers, or cannot be integrated.
    """
    if plant.discrete:
        return _nominal(plant, origin, since, 1)
    if options.substeps is not None:
        return _nominal(plant, origin, since, options.substeps)
    accuracy = ACCURACY if options.accuracy is None else options.accuracy
    count = max(len(since) - 1, 1)
    most = MOST_ALONG_A_TABLE if plant.nominal is not None else max(MOST_STEPS // (2 * count), 1)
    substeps, coarse, change = 1, None, np.inf
    while True:
        try:
            fine = spans_of(plant, origin, since, substeps)
        except ProblemError:
            if 2 * substeps > min(most, MOST_HOPED):
                raise
            fine = None  # a step that was too long for the plant
        if fine is not None:
            last, change = change, np.inf if coarse is None else difference(coarse, fine, _scales(plant, fine))
            if change <= accuracy or 2 * substeps > most or (change < 1e-9 and change > last / 2):
                break  # accurate, or at the end of what digits or memory allow
        substeps, coarse = 2 * substeps, fine
    if change > LOOSEST and plant.nominal is None:
        what = f"the path changes by {change:.3g} of itself when its {substeps} substeps of a span are doubled"
        hint = "the plant is too fast for these spans: a shorter horizon, more samples, or integrator: {substeps: ..}"
        raise ProblemError(Mistake(("plant",), what, hint))
    return _nominal(plant, origin, since, max(substeps // 2, 1) if change <= accuracy else substeps)


def and_beyond(since: np.ndarray, last: float) -> np.ndarray:
    """Times of spans with those from their end to a `last` one, none longer than the longest before.

    Parameters
    ----------
    since : (G+1,) times, in the unit of time
    last : the time of the prediction; one before the end adds a span of length 0
    """
    end, longest = float(since[-1]), float(np.max(np.diff(since), initial=0.0))
    if last <= end or longest == 0:
        return np.append(since, max(last, end))
    count = min(int(np.ceil((last - end) / longest * (1 - 1e-12))), MOST_BEYOND)
    return np.append(since, np.append(end + (last - end) * np.arange(1, count) / count, last))


def spans_of(
    plant: FormulaPlant, origin: float, since: np.ndarray, substeps: int, start: np.ndarray | None = None
) -> Spans:
    """The maps of all spans along the nominal path, or along the path from another state.

    Parameters
    ----------
    plant : FormulaPlant with n states
    origin : a time
    since : (G+1,) times of the spans, counted from `origin`
    substeps : of every span
    start : (n,) the state at the first time, in state units; None: along the nominal path

    Raises ProblemError where the path, or its linearisation, is not finite.
    """
    flow, G, n = plant.flow, len(since) - 1, len(plant.names)
    count = 1 if plant.discrete else 2 * substeps
    lengths = np.diff(since)
    times = origin + since[:-1, None] + lengths[:, None] * np.arange(count + 1) / count
    times[:, -1] = origin + since[1:]  # so that neighbouring spans share their nodes
    steps = np.repeat(lengths / count, count)
    if plant.nominal is None or start is not None:
        states, halves = flow.path(plant.whole_mean if start is None else start, times[:, :-1].ravel(), steps)
        nodes = np.concatenate([states[:-1].reshape(G, count, n), states[count::count].reshape(G, 1, n)], axis=1)
    else:
        nodes = StatedPath(plant.nominal).at(times.ravel()).reshape(G, count + 1, n)
        halves = flow.derivatives(nodes[:, :-1].reshape(-1, n), times[:, :-1].ravel(), steps)
    halves = halves.reshape(G, count, n, n)
    bad = ~(np.all(np.isfinite(nodes[:, 1:]), axis=2) & np.all(np.isfinite(halves), axis=(2, 3)))
    if np.any(bad) or not np.all(np.isfinite(nodes[:, 0])):
        i, j = np.unravel_index(int(np.argmax(bad)), bad.shape)
        what = f"the nominal path, or its derivative, is not finite after {plant.variable} = {times[i, j]:.6g}"
        hint = "look for a pole of the formulas along the path, or a plant that grows without bound"
        raise ProblemError(Mistake(("plant", "next" if plant.discrete else "f"), what, hint))
    at = slice(0, 1) if plant.discrete else slice(None)
    asked = nodes[:, at].reshape(-1, n), times[:, at].ravel()
    Xi = flow.intensities(*asked).reshape(G, -1, n, n)
    if not np.all(np.isfinite(Xi)):
        k = int(np.argmax(~np.all(np.isfinite(Xi.reshape(len(asked[1]), -1)), axis=1)))
        what = f"noise of the plant is not finite at {plant.variable} = {asked[1][k]:.6g} of the nominal path"
        raise ProblemError(Mistake(("plant", "noise"), what, "it must be finite along the whole path"))
    F, Q = combined(halves, Xi, lengths)
    return Spans(nodes, times, F, Q, halves, Xi)


def difference(coarse: Spans, fine: Spans, sizes: np.ndarray) -> float:
    """The largest relative change of states at the ends and of maps, in units of the states' sizes.

    Parameters
    ----------
    coarse, fine : of the same spans
    sizes : (n,) of the states
    """
    moved = np.max(np.abs(fine.ends - coarse.ends) / sizes, initial=0.0)
    unit = sizes[None, :] / sizes[:, None]
    turned = np.max(np.abs(fine.transition - coarse.transition) * unit, axis=(1, 2), initial=0.0)
    largest = np.max(np.abs(fine.transition) * unit, axis=(1, 2), initial=1.0)
    return float(max(moved, np.max(turned / largest, initial=0.0)))


def _scales(plant: FormulaPlant, spans: Spans) -> np.ndarray:
    sizes = np.max(np.abs(spans.nodes), axis=(0, 1)) + np.sqrt(np.diag(plant.whole_covariance))
    return np.where(sizes > 0, sizes, 1.0)


def _sizes(nominal: Nominal) -> np.ndarray:
    return _scales(nominal.plant, nominal.spans)


def _nominal(plant: FormulaPlant, origin: float, since: np.ndarray, substeps: int) -> Nominal:
    spans, path = spans_of(plant, origin, since, substeps), None
    if plant.nominal is not None:
        path = StatedPath(plant.nominal)
    elif plant.discrete:
        path = SteppedPath(np.vstack([spans.nodes[0, :1], spans.ends]))
    else:
        times, index = np.unique(spans.times.ravel(), return_index=True)
        states = spans.nodes.reshape(-1, spans.nodes.shape[2])[index]
        path = SmoothPath(times, states, evaluate(plant.right, states, times)[:, :, 0])
    return Nominal(plant, origin, since, substeps, path, spans)
