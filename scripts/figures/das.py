"""Figures 1 to 4 of Das & Bhattacharya: precision of every sensor against the required bound, Lorenz-96.

What the paper leaves open is fixed here: the initial mean (uniform on [0, 8], seed 1), the initial covariance (random
directions, eigenvalues evenly from 25 to 65, seed 1), the ensemble's seed, inflation 1, mean centring, and for the
unscented filter alpha = 1 (the printed 0.001 is shown apart).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from occontrol.api import read_problem
from occontrol.families.precision.ensemble import EnsembleFilter
from occontrol.families.precision.family import Problem
from occontrol.families.precision.moments import Moments
from occontrol.families.precision.program import PrecisionResult, solve_program
from occontrol.families.precision.text import first_moments
from occontrol.families.precision.unscented import UnscentedFilter
from occontrol.files.figures import save
from occontrol.files.figures.style import SLIDE, house_style, new_figure

PROBLEM = Path(__file__).parents[2] / "problems" / "lorenz96_enkf.yaml"
# number: (title, filter, batch, cap, number of bounds)
FIGURES: dict[int, tuple[str, Any, int, float, int]] = {
    1: ("Ensemble filter, one step, no cap", EnsembleFilter(members=41), 1, np.inf, 21),
    2: ("Ensemble filter, three steps, cap 15", EnsembleFilter(members=121), 3, 15.0, 7),
    3: ("Unscented filter, one step, no cap", UnscentedFilter(alpha=1.0), 1, np.inf, 21),
    4: ("Unscented filter, three steps, cap 3", UnscentedFilter(alpha=1.0), 3, 3.0, 7),
}
CAPS = (np.inf, 3.0, 2.5, 2.0, 1.8, 1.7, 1.6)


def sweep(problem: Problem, moments: Moments, factors: np.ndarray) -> list[PrecisionResult]:
    """Solve the same batch for one bound after another."""
    program, base = problem.program(moments), problem.plant.covariance  # type: ignore[union-attr]
    return [solve_program(replace(program, bound=factor * base)) for factor in factors]


def setting(filter_: Any, batch: int, cap: float) -> tuple[Problem, Moments]:
    """The problem of one figure and the moments of its first batch."""
    problem = replace(
        read_problem(PROBLEM), filter=filter_, batch=batch, caps=None if np.isinf(cap) else cap, prices=None, fixed=None
    )
    return problem, first_moments(problem)


def heat_map(title: str, text: str, factors: np.ndarray, results: list[PrecisionResult], batch: int) -> Figure:
    """Rows: sensors, blocks of steps from the first on top; columns: bounds from loose to tight, as in the paper."""
    values = np.array([np.full(20 * batch, np.nan) if r.precisions is None else r.precisions for r in results]).T
    figure = new_figure(SLIDE, title, text)
    axes = figure.add_subplot()
    shown = np.where(values > 0, values, np.nan)
    image = axes.imshow(shown, aspect="auto", cmap="viridis_r", interpolation="nearest", vmin=0)
    figure.colorbar(image, ax=axes, pad=0.01).set_label("precision λ = 1 / noise variance (white: not used)")
    axes.set_xticks(np.arange(len(factors)), [f"{f:.2f}" if len(factors) < 10 else f"{f:.3f}" for f in factors])
    axes.tick_params(axis="x", labelrotation=90 if len(factors) > 10 else 0)
    axes.set_xlabel("bound on the covariance after the batch, as a factor of the initial covariance")
    ticks = np.arange(0, 20 * batch, 1 if batch == 1 else 5)
    axes.set_yticks(ticks, [str(k % 20 + 1) for k in ticks])
    axes.set_ylabel("sensor")
    for j in range(1, batch):
        axes.axhline(20 * j - 0.5, color="black", lw=1.2)
    if batch > 1:
        for j in range(batch):
            name = f"step {j + 1}" + (" (bound)" if j == batch - 1 else "")
            axes.annotate(name, (-0.045, 1 - (j + 0.5) / batch), xycoords="axes fraction", rotation=90,
                          ha="center", va="center", fontweight="bold", annotation_clip=False)  # fmt: skip
        axes.yaxis.labelpad = 34
    axes.spines[:].set_visible(False)
    return figure


def caps_figure(problem: Problem, moments: Moments, factor: float) -> tuple[Figure, list[str]]:
    """Where in the batch the precision goes as the cap falls."""
    figure = new_figure(
        SLIDE, "Caps spread the sensing over the batch", f"ensemble filter, three steps, bound factor {factor:g}"
    )
    axes = figure.add_subplot()
    lines: list[str] = []
    program = replace(problem.program(moments), bound=factor * problem.plant.covariance)  # type: ignore[union-attr]
    solved: list[tuple[str, np.ndarray, float]] = []
    for cap in CAPS:
        found = solve_program(replace(program, caps=np.full(60, cap)))
        name = "no cap" if np.isinf(cap) else f"cap {cap:g}"
        if found.precisions is None:
            lines.append(f"| {name} | not reachable: smallest factor {factor * found.feasibility.factor:.4f} | | |")
            continue
        steps = found.precisions.reshape(3, 20).sum(axis=1)
        solved.append((name, steps, found.objective))
        used = int(np.sum(found.precisions > 0))
        lines.append(f"| {name} | {found.objective:.5g} | {used} | " + " / ".join(f"{s:.4g}" for s in steps) + " |")
    width = 0.84 / len(solved)
    for j, (name, steps, total) in enumerate(solved):
        colour = matplotlib.colormaps["viridis_r"](0.15 + 0.8 * j / max(1, len(solved) - 1))
        where = np.arange(3) + (j + 0.5) * width - 0.42
        axes.bar(where, steps, 0.92 * width, color=colour, label=f"{name}: total {total:.4g}")
    axes.set_xticks(np.arange(3), ["step 1", "step 2", "step 3 (bound)"])
    axes.set_ylabel("total precision of the step")
    axes.legend(loc="upper left")
    axes.set_title("Total precision by step")
    return figure, lines


def main(folder: Path) -> int:
    """Draw the figures into `folder` and print the tables of docs/das.md."""
    print(
        "| figure | filter | factor .9 | .75 | .6 | active .9 / .6 | smallest factor | share of step 1 / 2 / 3 at .6 |"
    )
    print("|---|---|---|---|---|---|---|---|")
    kept = None
    for number, (title, filter_, batch, cap, count) in FIGURES.items():
        problem, moments = setting(filter_, batch, cap)
        factors = np.linspace(0.9, 0.6, count)
        results = sweep(problem, moments, factors)
        if number == 2:
            kept = problem, moments
        worst = max(r.relative_gap for r in results)
        margin = min(r.relative_margin for r in results)
        text = (
            f"figure {number} of Das & Bhattacharya; Lorenz-96, 20 states; total precision "
            f"{results[0].objective:.3g} to {results[-1].objective:.3g}; every gap below {max(worst, 1e-12):.0e}"
        )
        with house_style():
            save(heat_map(title, text, factors, results, batch), folder / f"das_figure_{number}.png")
        by_step = results[-1].precisions.reshape(batch, 20).sum(axis=1) / results[-1].objective  # type: ignore[union-attr]
        middle = results[count // 2].objective
        active = [int(np.sum(r.precisions > 0)) for r in (results[0], results[-1])]  # type: ignore[operator]
        print(
            f"| {number} | {filter_.name} | {results[0].objective:.4g} | {middle:.4g} | {results[-1].objective:.4g} "
            f"| {active[0]} / {active[1]} | {results[-1].feasibility.factor * 0.6:.4f} | "
            + " / ".join(f"{100 * s:.0f} %" for s in by_step)
            + f" | margin {margin:.0e}"
        )
        monotone = np.all(np.diff([r.objective for r in results]) > 0)
        print(f"  total rises with every tightening: {bool(monotone)}")
    problem, moments = setting(UnscentedFilter(alpha=1.0), 3, np.inf)
    free = sweep(problem, moments, np.array([0.6]))[0]
    shares = free.precisions.reshape(3, 20).sum(axis=1) / free.objective  # type: ignore[union-attr]
    print(f"figure 4 without its cap: {free.objective:.4g}, by step " + " / ".join(f"{100 * s:.0f} %" for s in shares))
    assert kept is not None
    with house_style():
        figure, lines = caps_figure(*kept, 0.6)
        save(figure, folder / "das_caps.png")
    print("\n".join(["| cap | total | used | by step |", "|---|---|---|---|", *lines]))
    print(
        "| alpha | mean prior variance, one step | three steps | total precision at .6, one step |\n|---|---|---|---|"
    )
    for alpha in (1.0, 0.5, 0.1, 0.01, 0.001):
        (problem, one), (_, three) = (setting(UnscentedFilter(alpha=alpha), q, np.inf) for q in (1, 3))
        found = sweep(problem, one, np.array([0.6]))[0]
        total = "not reachable" if found.precisions is None else f"{found.objective:.4g}"
        print(f"| {alpha:g} | {np.trace(one.state) / 20:.4g} | {np.trace(three.state) / 20:.4g} | {total} |")
    climate = _climate_variance()
    print(f"variance of a free run: {climate:.3g}")
    return 0


def _climate_variance() -> float:
    """Variance per state of a long free run: what a forecast error can saturate at is about twice this."""
    problem = read_problem(PROBLEM)
    states = problem.plant.mean[:, None] + np.random.default_rng(0).standard_normal((20, 50))
    kept = []
    for k in range(60):
        states = problem.plant.advance(states, float(k))
        if k >= 20:
            kept.append(states)
    return float(np.mean(np.var(np.hstack(kept), axis=1)))
