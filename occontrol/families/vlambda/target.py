"""Choices that were made beforehand, and the Kalman filter along them, for code on a target.

The filter measures, then propagates; on a target every step leads from the last measurement to the next one:

    x(k) = F(k-1) x(k-1) + G w(k-1),   y(k) = H(k) x(k) + v(k) = H F x(k-1) + H G w + v

so that values arrive at k = 0 .. K-1, and the first interval, from 0 to 0, is empty.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.target import TargetModel, TargetPlan
from occontrol.families.vlambda.online import OnlineSelector
from occontrol.families.vlambda.sampled_plant import SampledPlant
from occontrol.families.vlambda.sensor_choice import Chooser
from occontrol.numerics.linalg import square_root


def target_plan(plant: SampledPlant, starts: np.ndarray, chooser: Chooser) -> TargetPlan:
    """The plan of choices, in the user's units.

    Parameters
    ----------
    plant : SampledPlant with K steps
    starts : (E+1,) first step of every epoch, then the number of steps
    chooser : that repeats the choices
    """
    s, n, K = plant.scales, plant.states, plant.steps
    loop = OnlineSelector(plant, starts, 1, chooser)
    F = np.concatenate([np.eye(n)[None], plant.transition[:-1] * s[:, None] / s])
    active, observe, roots = [], [], []
    for k in range(K):
        pairs = [loop.matrices(j) for j in loop.choice.sensors]
        H = np.concatenate([np.zeros((0, n)), *(H / s for H, _ in pairs)])
        W = plant.noise_root[k - 1] * s[:, None] if k else np.zeros((n, plant.noise_root.shape[2]))
        root = np.zeros((n + len(H), W.shape[1] + len(H)))
        root[:n, : W.shape[1]], root[n:, : W.shape[1]] = W, H @ W
        at = 0
        for _, R in pairs:
            m = len(R)
            place = slice(W.shape[1] + at, W.shape[1] + at + m)
            root[n + at : n + at + m, place] = square_root(R, floor=0.0)
            at += m
        active.append(tuple(loop.choice.sensors))
        observe.append(H @ F[k])
        roots.append(root)
        loop.step()
    return TargetPlan(
        edges=np.concatenate([[0.0], np.arange(K, dtype=float)]),
        names=tuple(plant.names),
        rows=tuple(sensor.sensor.rows for sensor in plant.sensors),
        active=active,
        instants=True,
        variable="k",
        model=TargetModel(
            transition=F,
            input=np.zeros((K, n)),
            observe=observe,
            offset=[np.zeros(len(H)) for H in observe],
            noise_root=roots,
            mean=plant.mean * s,
            covariance=plant.covariance * np.outer(s, s),
            predict_matrix=np.zeros((K + 1, 0, n)),
            predict_offset=np.zeros((K + 1, 0)),
            predict_noise=np.zeros((K + 1, 0, 0)),
        ),
    )
