"""Plans for a target that no solver has seen, and a Kalman filter that shares no code with the one that is written."""

from __future__ import annotations

import numpy as np

from occontrol.core.target import TargetModel, TargetPlan


def random_plan(
    seed: int = 0, intervals: int = 12, states: int = 3, rows: tuple[int, ...] = (1, 2), outputs: int = 2,
    active: list[tuple[int, ...]] | None = None, names: tuple[str, ...] | None = None, rank: int | None = None,
) -> TargetPlan:  # fmt: skip
    """A plan with random matrices; sensor by sensor in turn unless `active` says otherwise."""
    rng = np.random.default_rng(seed)
    N, n = intervals, states
    turns = active if active is not None else [tuple(j for j in range(len(rows)) if (k >> j) & 1) for k in range(N)]
    counts = [sum(rows[j] for j in each) for each in turns]
    F = np.eye(n) + 0.3 * rng.standard_normal((N, n, n))
    roots = []
    for m in counts:
        root = 0.4 * rng.standard_normal((n + m, n + m if rank is None else rank + m))
        root[n:] += np.hstack((np.zeros((m, root.shape[1] - m)), 0.3 * np.eye(m)))
        roots.append(root @ np.eye(root.shape[1], n + m) if rank is not None else root)
    P = rng.standard_normal((n, n))
    D = rng.standard_normal((N + 1, outputs, n))
    spread = rng.standard_normal((N + 1, outputs, outputs))
    return TargetPlan(
        edges=np.cumsum(np.append(1.0, rng.uniform(0.5, 1.5, N))),
        names=names or tuple(f"sensor {j}" for j in range(len(rows))),
        rows=rows,
        active=turns,
        instants=False,
        model=TargetModel(
            transition=F,
            input=rng.standard_normal((N, n)),
            observe=[rng.standard_normal((m, n)) for m in counts],
            offset=[rng.standard_normal(m) for m in counts],
            noise_root=roots,
            mean=rng.standard_normal(n),
            covariance=P @ P.T + 0.1 * np.eye(n),
            predict_matrix=D,
            predict_offset=rng.standard_normal((N + 1, outputs)),
            predict_noise=spread @ np.swapaxes(spread, 1, 2),
        ),
    )


def plain_filter(model: TargetModel, samples: list[np.ndarray]) -> dict[str, np.ndarray]:
    """x, P, w, its variances and nis at every node by the textbook: P - K Y K', samples NaN where missing."""
    n, x, P, nis = model.states, model.mean.copy(), model.covariance.copy(), 0.0
    found: dict[str, list] = {name: [] for name in ("x", "P", "w", "v", "nis")}
    for k in range(len(model.transition) + 1):
        D = model.predict_matrix[k]
        found["x"].append(x)
        found["P"].append(P)
        found["w"].append(D @ x + model.predict_offset[k])
        found["v"].append(np.diag(D @ P @ D.T + model.predict_noise[k]))
        found["nis"].append(nis)
        if k == len(model.transition):
            break
        joint = model.noise_root[k] @ model.noise_root[k].T
        there = np.flatnonzero(~np.isnan(samples[k]))
        F, H = model.transition[k], model.observe[k][there]
        Q, S, R = joint[:n, :n], joint[:n, n:][:, there], joint[n:, n:][np.ix_(there, there)]
        e = samples[k][there] - H @ x - model.offset[k][there]
        Y, X = H @ P @ H.T + R, F @ P @ H.T + S
        K = X @ np.linalg.inv(Y)
        nis = float(e @ np.linalg.inv(Y) @ e)
        x, P = F @ x + model.input[k] + K @ e, F @ P @ F.T + Q - K @ Y @ K.T
    return {name: np.array(value) for name, value in found.items()}
