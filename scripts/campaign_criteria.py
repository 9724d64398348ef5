"""Random problems by every criterion at the end, against the enumeration of all their schedules.

The judge is a filter in plain inverses on the same discrete plant; it shares no code with sweep, criteria and bounds.
Run from the project's folder:

    python -m scripts.campaign_criteria [count] [seed]

Counts costs that are off by more than 1e-12, bounds above the optimum and relaxations that were not certified. The
logarithm of a volume loses the digits that its X is ill-conditioned by, here and in the judge (compared with 40 digits:
3e-11 at a condition of 1e6): of these, only what is beyond eps cond(X) is wrong.
"""

from __future__ import annotations

import itertools
import sys

import numpy as np

from occontrol.families.athans.discretise import discretise, feasible_set
from occontrol.scheduling.criteria import LargestEigenvalue, LogDeterminant, LogTrace, Schatten
from occontrol.scheduling.criterion import TraceCriterion
from occontrol.scheduling.criterion_sweep import CriterionSweep
from occontrol.scheduling.recursion import Recursion
from occontrol.scheduling.relaxation import RelaxedOptions, minimise_relaxed
from occontrol.scheduling.smoothed import minimise_smoothed
from occontrol.scheduling.sweep import Sweep
from tests.families.athans.random_problems import random_policy, random_problem

CRITERIA = {
    "trace": (lambda D: TraceCriterion(D.T @ D), lambda s: np.sum(s)),
    "log-trace": (LogTrace, lambda s: np.log(np.sum(s))),
    "logdet": (LogDeterminant, lambda s: np.sum(np.log(s))),
    "largest-eigenvalue": (LargestEigenvalue, lambda s: s[0]),
    "schatten": (Schatten, lambda s: np.sum(s**4) ** 0.25),
}


def plain_outputs(r: Recursion, word: tuple[int, ...], D: np.ndarray) -> tuple[float, np.ndarray]:
    """Price of a schedule, and the singular values of D S D' at its end; one step an interval."""
    S, price = r.initial, 0.0
    for k, j in enumerate(word):
        F = r.transition[r.predict[k]]
        S = F @ S @ F.T + r.noise[r.predict[k]]
        H = r.rows[r.row_set[k]][r.offsets[j] : r.offsets[j + 1]]
        S = np.linalg.inv(np.linalg.inv(S) + r.steps[k] * H.T @ H)
        price += r.cost[k, j]
    F = r.transition[r.predict[len(word)]]
    return price, np.linalg.svd(D @ (F @ S @ F.T + r.noise[r.predict[len(word)]]) @ D.T, compute_uv=False)


def judged(seed: int) -> dict[str, tuple[float, float, float, bool]]:
    """By criterion: largest error of a cost, the same beyond conditioning, optimum less bound, whether certified."""
    rng = np.random.default_rng(seed)
    features = {name: bool(rng.integers(2)) for name in ("idle", "varying")}
    problem = random_problem(
        seed, states=int(rng.integers(2, 5)), intervals=4, rows=int(rng.integers(1, 3)), **features
    )
    recursion, allowed = discretise(problem), feasible_set(problem)
    D, M = problem.output.at(0.0), recursion.sensors
    words = list(itertools.product(range(M), repeat=4))
    plain = [plain_outputs(recursion, word, D) for word in words]
    found = {}
    for name, (make, measure) in CRITERIA.items():
        sweep = Sweep(recursion, criterion=make(D))
        truth = np.array([price + measure(s) for price, s in plain])
        costs = np.array([sweep.cost(np.eye(M)[list(word)]) for word in words])
        off = np.abs(costs - truth) / (1 + np.abs(truth))
        if name == "logdet":
            room = np.array([np.finfo(float).eps * s[0] / s[-1] for _, s in plain])
            beyond = np.max(off - room)
        else:
            beyond = np.max(off)
        options = RelaxedOptions(absolute_gap=1e-3 * (1 + abs(float(truth.min()))))
        if name == "largest-eigenvalue":
            relaxed = minimise_smoothed(CriterionSweep(recursion, LargestEigenvalue(D)), allowed, options=options)
        else:
            relaxed = minimise_relaxed(sweep, allowed, options=options)
        v = random_policy(problem, rng)
        J, g = sweep.cost_and_gradient(v)
        bound = max(relaxed.lower_bound, allowed.bound(J, v, g))
        found[name] = float(np.max(off)), float(beyond), float(truth.min()) - bound, relaxed.status == "certified"
    return found


def main() -> None:
    """Run and print one line a criterion; ends with exit code 1 where a cost is off or a bound is false."""
    count, first = (int(x) for x in (sys.argv[1:] + ["200", "0"][len(sys.argv) - 1 :])[:2])
    every = [judged(seed) for seed in range(first, first + count)]
    bad = 0
    for name in CRITERIA:
        off, beyond, room, certified = (np.array(x) for x in zip(*(e[name] for e in every), strict=True))
        false = int(np.sum(room < -1e-10 * np.ones(count)))
        wrong = int(np.sum(beyond > 1e-12))
        bad += false + wrong
        print(
            f"{name:20s} cost off by at most {off.max():.1e} ({int(np.sum(off > 1e-12))} above 1e-12, "
            f"{wrong} beyond conditioning), bounds above the optimum {false}, "
            f"certified {int(certified.sum())} of {count}"
        )
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
