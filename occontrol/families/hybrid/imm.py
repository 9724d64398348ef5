"""The jumping-mode estimator on a problem's own terms: sampled arrays, and a filter along given measurements.

Unknowns at a step: means (modes, n), roots of covariances (modes, n, n), log-probabilities (modes,); see
families/hybrid/imm_kernel.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.signal import Signal
from occontrol.families.hybrid.equations import (
    correct,
    form_covariances,
    match_moments,
    predict_measurement,
    weigh_modes,
)
from occontrol.families.hybrid.imm_kernel import JumpModel, predict_step
from occontrol.families.hybrid.plant import JumpPlant
from occontrol.families.hybrid.sensor import JumpSensor
from occontrol.numerics.linalg import normalised_square, square_root

GUARD_TOLERANCE = 5e-4


def sample_signals(signals: Sequence[Signal], steps: int) -> np.ndarray:
    """Matrices at the steps 1 .. steps; a single entry when none of them changes.

    Parameters
    ----------
    signals : Signals of k with equal shapes
    steps : number of steps

    Returns
    -------
    (steps or 1, len(signals), rows, columns)
    """
    constant = all(signal.constant for signal in signals)
    times = np.arange(1.0, 2.0 if constant else steps + 1.0)
    return np.stack([signal.sample(times) for signal in signals], axis=1)


def sample_model(
    plant: JumpPlant,
    sensors: Sequence[JumpSensor],
    groups: Sequence[Sequence[int]],
    steps: int,
    position: Sequence[int],
    tolerance: float = GUARD_TOLERANCE,
) -> JumpModel:
    """The arrays of a plant and its groups of sensors; each group is stacked into one fictional sensor.

    Parameters
    ----------
    plant : JumpPlant
    sensors : of JumpSensor
    groups : positions of the sensors of each group
    steps : number of steps
    position : components of the state that count as position
    tolerance : wanted error of guard probabilities with three independent rows or more

    Returns
    -------
    JumpModel. Liu & Hwang, equations (1), (4), (5) and the remark on assumption 1.
    """
    noise, roots, drift = [], [], []
    for mode in plant.modes:
        F, W = sample_signals([mode.F], steps)[:, 0], sample_signals([mode.W], steps)[:, 0]
        product = F @ W @ F.transpose(0, 2, 1)
        noise.append((product + product.transpose(0, 2, 1)) / 2)
        roots.append(_wide_root(F @ square_root(W), plant.states))
        if mode.B is None or mode.input is None:
            drift.append(np.zeros((1, plant.states)))
        else:
            B, u = sample_signals([mode.B], steps)[:, 0], sample_signals([mode.input], steps)[:, 0]
            drift.append((B @ u)[:, :, 0])
    first = np.cumsum([0] + [sensor.rows for sensor in sensors])
    rows = np.array([sum(sensors[j].rows for j in group) for group in groups], dtype=np.int64)
    widest, count = int(rows.max()), len(groups)
    place = np.zeros((count, widest), dtype=np.int64)
    length = max(1 if sensor.C.constant and sensor.R.constant else steps for sensor in sensors)
    C = np.zeros((length, count, widest, plant.states))
    R, R_root = np.zeros((length, count, widest, widest)), np.zeros((length, count, widest, widest))
    for g, group in enumerate(groups):
        at = 0
        for j in group:
            p = sensors[j].rows
            C[:, g, at : at + p] = sample_signals([sensors[j].C], steps)[:, 0]
            given = sample_signals([sensors[j].R], steps)[:, 0]
            R[:, g, at : at + p, at : at + p] = given
            R_root[:, g, at : at + p, at : at + p] = square_root(given)
            place[g, at : at + p] = first[j] + np.arange(p)
            at += p
    arrays = {
        **_transitions(plant),
        "A": sample_signals([mode.A for mode in plant.modes], steps),
        "noise": np.stack(np.broadcast_arrays(*noise), axis=1),
        "noise_root": np.stack(np.broadcast_arrays(*_as_wide(roots)), axis=1),
        "drift": np.stack(np.broadcast_arrays(*drift), axis=1),
        "C": C,
        "R": R,
        "R_root": R_root,
        "rows": rows,
        "place": place,
        "position": np.array(position, dtype=np.int64),
    }
    # fresh writable copies, so that the compiled kernel meets the same types whatever the user gave
    return JumpModel(tolerance=float(tolerance), **{name: np.array(value, order="C") for name, value in arrays.items()})


def _wide_root(root: np.ndarray, states: int) -> np.ndarray:
    """A root (K, n, q) with q <= n columns of the same matrices."""
    if root.shape[2] <= states:
        return root
    triangles = np.asarray(np.linalg.qr(root.transpose(0, 2, 1), mode="r"))
    return triangles.transpose(0, 2, 1)


def _as_wide(roots: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The roots with columns of zeros, so that all have as many."""
    most = max(root.shape[2] for root in roots)
    return [np.pad(root, ((0, 0), (0, 0), (0, most - root.shape[2]))) for root in roots]


def _transitions(plant: JumpPlant) -> dict[str, np.ndarray]:
    guards, modes = plant.guards or (), plant.names
    extra = 0 if plant.threshold is None else plant.threshold.size
    most = max((len(guard.b) for guard in guards), default=1)
    L, b = np.zeros((len(guards), most, plant.states + extra)), np.zeros((len(guards), most))
    for g, guard in enumerate(guards):
        L[g, : len(guard.b)], b[g, : len(guard.b)] = guard.L, guard.b
    matrix = np.eye(len(modes)) if plant.transition_matrix is None else plant.transition_matrix
    return {
        "transition_matrix": np.array(matrix, dtype=float),
        "source": np.array([modes.index(guard.source) for guard in guards], dtype=np.int64),
        "target": np.array([modes.index(guard.target) for guard in guards], dtype=np.int64),
        "guard_rows": np.array([len(guard.b) for guard in guards], dtype=np.int64),
        "guard_L": L,
        "guard_b": b,
        "threshold_mean": np.zeros(0) if plant.threshold is None else plant.threshold.mean.copy(),
        "threshold_covariance": np.zeros((0, 0)) if plant.threshold is None else np.array(plant.threshold.covariance),
    }


@dataclass(frozen=True, eq=False)
class JumpEstimate:
    """What the filter knows after each step, k = 0 first.

    Parameters
    ----------
    mean, covariance : (K+1, n), (K+1, n, n) of the state
    probabilities : (K+1, modes)
    nis : (K+1,) innovation squared, normalised by the covariance of the modes' mixture; NaN where nothing was measured
    dimension : (K+1,) number of values behind each nis
    """

    mean: np.ndarray
    covariance: np.ndarray
    probabilities: np.ndarray
    nis: np.ndarray
    dimension: np.ndarray


def start(plant: JumpPlant) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, roots of covariances and log-probabilities of the modes at k = 0.

    Parameters
    ----------
    plant : JumpPlant
    """
    modes = len(plant.modes)
    with np.errstate(divide="ignore"):
        chances = np.log(plant.probabilities)
    return np.tile(plant.mean, (modes, 1)), np.tile(square_root(plant.covariance), (modes, 1, 1)), chances


def filter_measurements(
    plant: JumpPlant, sensors: Sequence[JumpSensor], steps: int, readings: dict[int, list[tuple[int, np.ndarray]]]
) -> JumpEstimate:
    """Estimate along measurements that anybody's schedule brought; any set of sensors may report at a step, or none.

    Parameters
    ----------
    plant : JumpPlant
    sensors : of JumpSensor
    steps : number of steps
    readings : by step 1 .. steps: the position of a sensor and its values (m,); a NaN is a missing value

    Returns
    -------
    JumpEstimate. Liu & Hwang, steps 1, 2, 4, 5 and 6.
    """
    n, modes = plant.states, len(plant.modes)
    model = sample_model(plant, sensors, [[j] for j in range(len(sensors))], steps, range(n))
    means, roots, chances = start(plant)
    mean, covariance = np.zeros((steps + 1, n)), np.zeros((steps + 1, n, n))
    probabilities = np.zeros((steps + 1, modes))
    nis, dimension = np.full(steps + 1, np.nan), np.zeros(steps + 1, dtype=int)
    mean[0], covariance[0], probabilities[0] = plant.mean, plant.covariance, plant.probabilities
    for k in range(1, steps + 1):
        means, roots, chances, _, _ = predict_step(model, k, means, roots, chances)
        given = readings.get(k, [])
        if given:
            at = [min(k, len(model.C)) - 1 for _ in given]
            C = np.vstack([model.C[a, j, : sensors[j].rows] for a, (j, _) in zip(at, given, strict=True)])
            R, row = np.zeros((len(C), len(C))), 0
            for a, (j, _) in zip(at, given, strict=True):
                p = sensors[j].rows
                R[row : row + p, row : row + p] = model.R[a, j, :p, :p]
                row += p
            values = np.concatenate([z for _, z in given]).astype(float)
            there = np.flatnonzero(~np.isnan(values))
            C, R, values = C[there].copy(), R[np.ix_(there, there)].copy(), values[there]
        if given and len(values):
            nis[k] = _normalised(chances, means, form_covariances(roots), C, R, values)
            dimension[k] = len(values)
            means, roots, likelihoods = correct(means, roots, C, square_root(R), values)
            chances = weigh_modes(chances, likelihoods)
        probabilities[k] = np.exp(chances)
        combined, spread = match_moments(probabilities[k : k + 1], means, form_covariances(roots))
        mean[k], covariance[k] = combined[0], spread[0]
    return JumpEstimate(mean, covariance, probabilities, nis, dimension)


def _normalised(chances, means, covariances, C, R, values) -> float:
    """Squared innovation in units of the covariance that the mixture of the modes predicts for it."""
    expected, spread, _ = predict_measurement(means, covariances, C, R)
    centre, total = match_moments(np.exp(chances)[None], expected, spread)
    innovation = values - centre[0]
    return float(normalised_square(innovation, total[0]))
