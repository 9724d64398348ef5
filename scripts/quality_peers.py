"""Rules by a model of the norm, for HiGHS, beside the search here; both judged on the true cost.

    .venv/bin/python scripts/quality_peers.py [SECONDS] [CASE ..]

Combinatorial integral approximation (Sager, Jung, Kirches 2011): whole schedules w that follow the relaxed policy v,

    min theta,   | sum_{i <= k} h_i (v_ij - w_ij) | <= theta for all k and j,      sum_j w_kj = 1

with the same rules: starts s_kj >= w_kj - w_(k-1)j, at most K of them beside the first; a use that starts is on for its
dwell. HiGHS (scipy.optimize.milp) has SECONDS of wall time a case. pycombina would be the natural peer; pip has no
package of that name, it is built from source. Cases as in scripts/quality_rules.py, of one sensor at a time.
"""

from __future__ import annotations

import json
import sys
import time

import numpy as np
from quality_rules import OUT, percent, ruled
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from occontrol.core.monitor import Monitor
from occontrol.families.athans.balanced import balanced
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import relax
from occontrol.families.athans.integration.refine import search_space
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.rules.setting import prepared, setting_of
from occontrol.scheduling.rules.check import keeps
from occontrol.scheduling.rules.grid import counts
from occontrol.scheduling.rules.task import Task

DEFAULT = ["M/dwell20", "M/maxsw5", "attitude_telemetry/dwell20", "tracking_network/dwell20"]


def model(task: Task, v: np.ndarray, limit: float) -> tuple[np.ndarray | None, str]:
    """The schedule (N, M) that HiGHS finds for the norm, or None, and how it ended.

    Parameters
    ----------
    task : with the rules; min_on and max_switches count
    v : (N, M) relaxed policy
    limit : seconds
    """
    rules, (N, M) = task.rules, v.shape
    grid, open_ = task.oracle.grid, task.oracle.open
    h, need = grid.steps, counts(rules, grid).need
    usable = np.stack([np.any(open_[:, task.oracle.automaton.on[:, j]], axis=1) for j in range(M)], axis=1)
    W, S, T = np.arange(N * M).reshape(N, M), N * M + np.arange(N * M).reshape(N, M), 2 * N * M
    rows: list[tuple[list[int], list[float], float, float]] = []
    for j in range(M):
        for k in range(N):
            total, below = float(h[: k + 1] @ v[: k + 1, j]), list(W[: k + 1, j])
            rows.append(([*below, T], [*h[: k + 1], 1.0], total, np.inf))
            rows.append(([*below, T], [*h[: k + 1], -1.0], -np.inf, total))
            before = [W[k - 1, j]] if k else []
            rows.append(([S[k, j], W[k, j], *before], [1.0, -1.0, *[1.0] * len(before)], 0.0, np.inf))
            rows.extend(([W[i, j], S[k, j]], [1.0, -1.0], 0.0, np.inf) for i in range(k, min(k + need[k, j], N)))
    rows += [(list(W[k]), [1.0] * M, 1.0, 1.0) for k in range(N)]
    if rules.max_switches is not None:
        rows.append((list(S[1:].ravel()), [1.0] * (N - 1) * M, -np.inf, float(rules.max_switches)))
    at = np.repeat(np.arange(len(rows)), [len(r[0]) for r in rows])
    entries = np.concatenate([r[1] for r in rows]), (at, np.concatenate([r[0] for r in rows]))
    A = coo_array(entries, shape=(len(rows), T + 1)).tocsr()
    upper = np.concatenate([usable.astype(float).ravel(), np.ones(N * M), [np.inf]])
    found = milp(
        np.append(np.zeros(T), 1.0),
        integrality=np.append(np.ones(T), 0.0),
        bounds=Bounds(np.zeros(T + 1), upper),
        constraints=LinearConstraint(A, [r[2] for r in rows], [r[3] for r in rows]),
        options={"time_limit": limit},
    )
    return (None if found.x is None else np.round(found.x[: N * M]).reshape(N, M)), str(found.message)


def main() -> int:
    """One line for every case: the true cost of the schedule of HiGHS, and how far it lies above the bound."""
    limit = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    known = json.loads(OUT.read_text()) if OUT.exists() else {}
    for case in sys.argv[2:] or DEFAULT:
        inner, _ = balanced(prepared(ruled(case), 1e-4))
        integrator, sweep = search_space(inner, RelaxRoundPolish(), Monitor())
        v = relax(sweep, feasible_set(inner), Monitor(), 1e-4).weights
        task = setting_of(inner, integrator).task
        began = time.process_time()
        w, ended = model(task, v, limit)
        seconds = time.process_time() - began
        if w is None:
            print(f"{case}: no schedule, {ended}, {seconds:.1f} s", flush=True)
            continue
        cost, kept = task.sweep.cost(w), keeps(task.rules, task.edges, w > 0.5)
        text = f"{case}: cost {cost:.7g}, rules {'kept' if kept else 'broken'}, {seconds:.1f} s, {ended}"
        if case in known:
            bound, own = known[case]["bound"], known[case]["cost"]
            text += f"; {percent(cost, bound)} % above the bound, the search here {percent(own, bound)} %"
        print(text, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
