"""Bounds for ever against every cycle: random small plants, and three named ones with the bound over time.

    .venv/bin/python scripts/campaign_periodic.py [--plants 100] [--longest 12] [--nodes 3000] [--figure FILE.png]

Of each plant (1 to 3 states, 2 scalar sensors, prices, charged before or after the reading) all cycles up to the
longest are counted by the compiled scan, and the best of each length again by a filter that is iterated. Prints the
plants whose averaged or tree bound lies above the best cycle (none, if all is right) and how far apart they are.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))


def main() -> int:
    """Run the campaign; 1 where a bound lies above a cycle."""
    from occontrol.core.monitor import Monitor
    from occontrol.scheduling.periodic.averaged import averaged_steps
    from occontrol.scheduling.periodic.certificate import checked_bound, faults
    from occontrol.scheduling.periodic.cycles import free, search
    from occontrol.scheduling.periodic.letters import smallest_covariance
    from occontrol.scheduling.periodic.potential import potentials
    from occontrol.scheduling.periodic.tree import ProofTree
    from tests.plain_cycles import mean_cost, on_off, random_plant, unstable, vehicle

    options = argparse.ArgumentParser()
    options.add_argument("--plants", type=int, default=100)
    options.add_argument("--longest", type=int, default=12)
    options.add_argument("--nodes", type=int, default=3000)
    options.add_argument("--figure", type=Path)
    asked = options.parse_args()

    def prepared(letters):
        smallest = smallest_covariance(letters.F[0], letters.Q[0], np.sum(letters.L, axis=0))
        root = np.linalg.cholesky(smallest)
        return letters.in_units(root), root, smallest

    wrong, gaps, averaged_gaps, differences = [], [], [], []
    for seed in range(asked.plants):
        letters = random_plant(seed, 1 + seed % 3, 2)
        scaled, root, smallest = prepared(letters)
        found = search(scaled, asked.longest, free(np.eye(2)), Monitor()).best
        if found is None:
            print(f"plant {seed}: no cycle has a limit")
            continue
        plain = mean_cost(letters, found.word)
        averaged = averaged_steps(scaled)
        tree = ProofTree(scaled, potentials(scaled, found)["harmonic mean of the cycle"], found.cost)
        tree.grow(found.cost * (1 - 1e-4), asked.nodes, Monitor())
        proof = tree.proof(root)
        checked = checked_bound(proof, letters, smallest)
        best = min(found.cost, plain)
        if faults(proof, letters) or max(averaged.lower_bound, tree.bound, checked) > best:
            wrong.append(seed)
        gaps.append(1 - tree.bound / best)
        averaged_gaps.append(1 - averaged.lower_bound / best)
        differences.append(max(abs(plain / found.cost - 1), abs(checked / tree.bound - 1)))
    print(f"{len(gaps)} plants, every cycle up to {asked.longest}: bounds above the best cycle: {wrong or 'none'}")
    for name, values in (("averaged bound", averaged_gaps), (f"tree of {asked.nodes} words", gaps)):
        low, middle, high = 100 * np.quantile(values, [0.0, 0.5, 1.0])
        print(f"{name}: {low:.3g} to {high:.3g} % below the best cycle, median {middle:.3g} %")
    print(f"by other code, at most {max(differences):.2g} off")

    curves = {}
    for name, make, target in (("on and off", on_off, 1e-6), ("vehicle", vehicle, 1e-4), ("unstable", unstable, 1e-2)):
        letters, _, _ = prepared(make())
        found = search(letters, 6, free(np.eye(letters.count)), Monitor()).best
        assert found is not None
        tree = ProofTree(letters, potentials(letters, found)["harmonic mean of the cycle"], found.cost)
        began, curve, size = time.process_time(), [], 30
        while size < 60_000 and tree.bound < found.cost * (1 - target):
            tree.grow(found.cost * (1 - target), size, Monitor())
            curve.append((time.process_time() - began, 100 * (1 - tree.bound / found.cost), tree.count))
            size *= 2
        curves[name] = np.array(curve)
        shown = "; ".join(f"{gap:.3g} % in {t:.2g} s, {count:.0f} words" for t, gap, count in curve)
        print(f"{name}: best cycle {found.cost:.8g}, {shown}")
    if asked.figure is not None:
        _draw(curves, asked.figure)
    return 1 if wrong else 0


def _draw(curves: dict[str, np.ndarray], path: Path) -> None:
    from occontrol.files.figures import save, style

    with style.house_style():
        figure = style.new_figure((9, 5), "how fast the proof closes", "one thread; best cycle up to six steps")
        axes = figure.subplots()
        for (name, curve), colour in zip(curves.items(), style.PALETTE, strict=False):
            axes.loglog(curve[:, 0], np.maximum(curve[:, 1], 1e-5), "o-", ms=4, color=colour, label=name)
        axes.set_xlabel("seconds of processor time")
        axes.set_ylabel("proven bound below the best cycle, %")
        axes.grid(which="major")
        axes.legend()
        save(figure, path)


if __name__ == "__main__":
    sys.exit(main())
