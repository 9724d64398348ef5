"""What scripts/bench.py runs, and the targets."""

from __future__ import annotations

SEEDS = [0, 1, 2, 3, 4]
SWEEPS = {(6, 4): (30, 90), (12, 8): (60, 180), (20, 40): (120, 360), (30, 20): (100, 300)}
RATES = {6: 0.10, 30: 0.40, 100: 0.65, 200: 0.65}
RATIOS = {"collocation": (500, 600), "single shooting": (60, 300), "SDP, Clarabel": (30, 120)}
NOT_RUN = "not run"
# n, M, N, target gap, seeds, threads; the first ones are the quick ones
CASES: list[tuple[int, int, int, float, list[int], int]] = [
    (2, 2, 100, 1e-4, SEEDS, 1),
    (6, 4, 100, 1e-4, SEEDS, 1),
    (2, 2, 10_000, 1e-4, SEEDS, 1),
    *((n, M, 400, gap, SEEDS, 1) for n, M in SWEEPS for gap in (1e-4, 1e-6)),
    (12, 8, 100, 1e-4, SEEDS, 1),
    *((n, M, 6400, 1e-4, SEEDS, 1) for n, M in ((6, 4), (12, 8))),
    (60, 100, 200, 1e-4, [0, 1], 1),
    (100, 200, 200, 1e-4, [0], 1),
    (200, 500, 500, 1e-3, [0], 1),
]
QUICK = 2
