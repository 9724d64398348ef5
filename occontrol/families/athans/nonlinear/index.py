"""How far a plan may trust its linearisation: what the curvature of f and h does to the plan's own uncertainty.

Sigma points x +- sqrt(r) S_i of the planned covariance P = S S' (r states are uncertain):

    reading      kappa = | mean h(sigma) - h(x) |   in units of the reading's noise, R^-1/2
    prediction   kappa = | mean f(sigma) - f(x) |   in units of the predicted covariance, P^-1/2

`readings` is the largest of all planned readings, `predictions` the sum over all predictions. Well below 1 an extended
Kalman filter along the plan does what the plan says; above 1 it may diverge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.clock import elapsed
from occontrol.core.solution import Solution
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.nonlinear.linearise import Linearisation, linearisation_of
from occontrol.families.athans.nonlinear.nominal import and_beyond, spans_of
from occontrol.families.athans.nonlinear.path import evaluate
from occontrol.families.athans.nonlinear.wrap import wrapped
from occontrol.numerics.flow import Spans
from occontrol.numerics.linalg import square_root, whiten, whitener

USED = 1e-9


@dataclass(frozen=True)
class Nonlinearity:
    """The index of a plan.

    Parameters
    ----------
    readings : largest of its readings
    predictions : sum over its predictions
    """

    readings: float
    predictions: float

    @classmethod
    def without_prior(cls) -> Nonlinearity:
        """Nothing says how far from the path the state may be."""
        return cls(np.nan, np.nan)

    @property
    def worst(self) -> float:
        """The larger of the two."""
        return max(self.readings, self.predictions)

    def as_dict(self) -> dict[str, float]:
        """For result.json."""
        return {"readings": self.readings, "predictions": self.predictions}

    @property
    def text(self) -> str:
        """In words."""
        if np.isnan(self.readings):
            return "not known without a prior"
        return f"readings {self.readings:.3g}, predictions {self.predictions:.3g}"


@dataclass(frozen=True, eq=False)
class Stages:
    """A problem as a chain: span 0, readings, span 1, readings, .., the last span.

    Parameters
    ----------
    origin : Linearisation
    spans : Spans, one more than there are times of readings
    since, lengths : (G,) of the spans
    times : (N,) of the readings
    share : (N,) what a reading's noise is divided by: 1, or the length of the interval for continuous sensing
    substeps : of every span
    """

    origin: Linearisation
    spans: Spans
    since: np.ndarray
    lengths: np.ndarray
    times: np.ndarray
    share: np.ndarray
    substeps: int


def stages(problem: AthansProblem, edges: np.ndarray | None = None) -> Stages:
    """The chain of a problem whose plant was linearised; of continuous sensing, samples at the ends of intervals.

    Parameters
    ----------
    problem : with a linearised plant
    edges : (N+1,) of the intervals of continuous sensing, in the unit of time; the problem's if left out

    Raises TypeError for a linear one.
    """
    origin = linearisation_of(problem)
    if origin is None:
        raise TypeError("the plant is linear")
    nominal = origin.nominal
    if problem.takes_readings and not problem.discrete:
        since, times = nominal.since, problem.clock.times  # type: ignore[attr-defined]
        starts, N = nominal.origin + since[:-1], len(times)
        return Stages(origin, nominal.spans, starts, np.diff(since), times, np.ones(N), nominal.substeps)
    edges = np.asarray(problem.edges if edges is None or problem.discrete else edges, dtype=float)
    if problem.discrete:
        spans, since, times = nominal.spans, edges[:-1], edges[:-1]
        still = spans_of(origin.plant, 0.0, np.zeros(2), 1)  # nothing moves before the first reading
        n = len(origin.plant.names)
        F = np.concatenate([np.eye(n)[None], spans.transition])
        Q = np.concatenate([np.zeros((1, n, n)), spans.noise])
        nodes = np.concatenate([np.repeat(spans.nodes[:1, :1], 2, axis=1), spans.nodes])
        chain = Spans(nodes, np.vstack([np.zeros((1, 2)), spans.times]), F, Q, still.halves, still.intensity)
        starts, lengths = np.append(0.0, since), np.append(0.0, np.ones(len(since)))
        return Stages(origin, chain, starts, lengths, times, np.ones(len(times)), 1)
    since = elapsed(edges)
    last = max(float(getattr(problem, "predict_at", None) or edges[-1]) - edges[0], since[-1])
    whole = and_beyond(since, last)
    lengths = np.diff(whole)
    substeps = max(1, int(np.ceil(nominal.substeps * np.max(np.diff(since)) / np.max(np.diff(nominal.since)))))
    spans = spans_of(origin.plant, float(edges[0]), whole, substeps)
    return Stages(origin, spans, edges[0] + whole[:-1], lengths, edges[1:], np.diff(since), substeps)


def nonlinearity(problem: AthansProblem, weights: np.ndarray) -> Nonlinearity:
    """The index of a policy.

    Parameters
    ----------
    problem : with a linearised plant and M sensors
    weights : (N, M) of every reading, or of every interval
    """
    chain = stages(problem)
    origin, spans, flow = chain.origin, chain.spans, chain.origin.plant.flow
    sensors = [origin.sensors.get(s.name) for s in problem.sensors]
    P = origin.plant.whole_covariance
    readings = predictions = 0.0
    for k in range(len(chain.lengths)):
        before = P
        P = spans.transition[k] @ before @ spans.transition[k].T + spans.noise[k]
        P = (P + P.T) / 2
        if chain.lengths[k] > 0:
            x = spans.nodes[k, 0]
            points = sigma_points(x, before)
            moved = flow.advance(points, float(chain.since[k]), float(chain.lengths[k]), chain.substeps)
            predictions += float(np.linalg.norm((np.mean(moved, axis=1) - spans.ends[k]) @ whitener(P)))
        if k >= len(chain.times):
            continue
        t, x = chain.times[k : k + 1], spans.ends[k]
        for j in np.flatnonzero(weights[k] > USED):
            if (sensor := sensors[j]) is None:
                continue
            points = sigma_points(x, P)
            at = evaluate(sensor.values(), points.T, np.repeat(t, points.shape[1]))[:, :, 0]
            here = evaluate(sensor.values(), x[None], t)[0, :, 0]
            bias = np.mean(wrapped(at - here, sensor.angles), axis=0)
            R = evaluate(sensor.covariance(), x[None], t)[0] / (chain.share[k] * weights[k, j])
            readings = max(readings, float(np.linalg.norm(whiten(R, bias)[0])))
            P = updated(P, evaluate(sensor.slope(), x[None], t)[0], R)
    return Nonlinearity(readings, predictions)


def sigma_points(x: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(n, 2 r) points x +- sqrt(r) S_i around a state, r the number of uncertain states.

    Parameters
    ----------
    x : (n,), in state units
    covariance : (n, n) P = S S'
    """
    r = int(np.sum(np.diag(covariance) > 0))
    if r == 0:
        return x[:, None]
    root = square_root(covariance, floor=0.0)
    columns = root[:, np.argsort(np.linalg.norm(root, axis=0))[-r:]] * np.sqrt(r)
    return np.hstack([x[:, None] + columns, x[:, None] - columns])


def updated(P: np.ndarray, H: np.ndarray, R: np.ndarray) -> np.ndarray:
    """The covariance after a reading, in Joseph's form.

    Parameters
    ----------
    P : (n, n), in state units squared
    H : (m, n)
    R : (m, m) of the reading's noise
    """
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    left = np.eye(len(P)) - K @ H
    return left @ P @ left.T + K @ R @ K.T


def in_turn(problem: AthansProblem) -> np.ndarray:
    """(N, M) every sensor in turn, as far as it can be used: a plan that everybody can think of.

    Parameters
    ----------
    problem : with M sensors
    """
    upper = np.asarray(problem.upper)  # type: ignore[attr-defined]
    if problem.takes_readings:
        upper = upper[problem.clock.owner]  # type: ignore[attr-defined]
    weights, turn = np.zeros(upper.shape), 0
    real = [j for j, s in enumerate(problem.sensors) if not s.is_idle]
    for k in range(len(weights)):
        open_ = [real[(turn + i) % len(real)] for i in range(len(real))] if real else []
        chosen = [j for j in open_ if upper[k, j] > 0][: problem.places]
        weights[k, chosen] = 1.0
        turn = (real.index(chosen[-1]) + 1) % len(real) if chosen else turn
    return weights


def index_of(problem: AthansProblem, solution: Solution) -> Nonlinearity:
    """The index of the plan of a solution.

    Parameters
    ----------
    problem : with a linearised plant
    solution : of it
    """
    weights = solution.arrays.get("measuring", solution.arrays["weights"])
    return nonlinearity(problem, np.asarray(weights))
