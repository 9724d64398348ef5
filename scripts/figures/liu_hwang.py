"""Figures 2, 3, 5, 6 and table I of Liu & Hwang, and the trade-off curve of the position weight.

What the paper leaves open is fixed in problems/turning_target.yaml (initial state, its covariance, the truth) and here
(the numbers of the illustrative example of figures 2 and 3, of which the paper gives none).
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from occontrol.api import read_problem
from occontrol.core.solution import Solution
from occontrol.families.hybrid.bhattacharyya import error_bound
from occontrol.families.hybrid.equations import form_covariances, predict
from occontrol.families.hybrid.family import FAMILY as hybrid
from occontrol.families.hybrid.methods import Alternate, ExpectedCovariance, Fixed, Random, Scheduled
from occontrol.families.hybrid.monte_carlo import run_some
from occontrol.families.hybrid.problem import Problem
from occontrol.families.hybrid.runs import experiment
from occontrol.files.figures import save
from occontrol.files.figures.style import GREY, INK, PALETTE, SLIDE, house_style, new_figure

PROBLEM = Path(__file__).parents[2] / "problems" / "turning_target.yaml"
PAPER = {"scheduled": (4.3354, 3.5233, 17), "one": (7.5244, 4.4327, 35), "two": (5.8382, 4.2359, 33)}
WEIGHTS = (0.0, 0.003, 0.006, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2, 0.5, 1.0, 3.0)
BLUE, ORANGE, GREEN = PALETTE[0], PALETTE[1], PALETTE[2]


def illustration() -> tuple[Figure, list[str]]:
    """Figures 2 and 3: two modes pull one Gaussian apart along the first axis; which axis should be measured?"""
    mean, covariance = np.array([0.0, 0.0]), np.array([[1.0, 0.3], [0.3, 0.8]])
    A = np.array([[[1.0, 0.2], [0.0, 1.0]], [[0.9, -0.4], [0.1, 0.9]]])
    drift, noise_roots = np.array([[1.5, 2.0], [5.0, 2.6]]), np.array([np.sqrt(0.3) * np.eye(2)] * 2)
    prior = np.array([0.6, 0.4])
    starts, roots = np.array([mean] * 2), np.array([np.linalg.cholesky(covariance)] * 2)
    means, roots = predict(np.eye(2), starts, roots, A, noise_roots, drift)
    covariances = form_covariances(roots)
    figure = new_figure(
        SLIDE, "Which sensor tells the modes apart?", "figures 2 and 3 of Liu & Hwang, numbers chosen here"
    )
    grid = figure.add_gridspec(2, 2, width_ratios=[1, 1.15])
    plane = figure.add_subplot(grid[:, 0])
    _ellipse(plane, mean, covariance, INK, "time k")
    for j, colour in enumerate((BLUE, ORANGE)):
        _ellipse(plane, means[j], covariances[j], colour, f"time k+1, if mode {j + 1}")
        plane.annotate("", means[j], mean, arrowprops={"arrowstyle": "->", "color": colour, "shrinkB": 8})
    plane.set_aspect("equal", adjustable="datalim")
    plane.set_xlabel("x1, seen by sensor 1")
    plane.set_ylabel("x2, seen by sensor 2")
    plane.set_title("one step under two hypotheses (1-σ ellipses)")
    plane.legend(loc="lower right")
    plane.grid(True)
    lines = []
    for i in range(2):
        axes = figure.add_subplot(grid[i, 1])
        r, s = means[:, i], covariances[:, i, i] + 0.2
        z = np.linspace((r - 4 * np.sqrt(s)).min(), (r + 4 * np.sqrt(s)).max(), 2000)
        joint = prior[:, None] * np.exp(-((z - r[:, None]) ** 2) / (2 * s[:, None])) / np.sqrt(2 * np.pi * s[:, None])
        risk = float(np.sum(joint.min(axis=0)) * (z[1] - z[0]))
        bound = error_bound(np.log(prior), r[:, None], s[:, None, None])
        for j, colour in enumerate((BLUE, ORANGE)):
            axes.plot(z, joint[j], color=colour)
        axes.fill_between(z, joint.min(axis=0), color=GREY, alpha=0.5, linewidth=0)
        axes.set_title(f"sensor {i + 1}: risk of a wrong mode {risk:.3f} (shaded), bound {bound:.3f}")
        axes.set_xlabel(f"measurement of sensor {i + 1}")
        axes.set_ylabel("likelihood × prior")
        axes.set_ylim(bottom=0)
        lines.append(f"illustration, sensor {i + 1}: Bayes risk {risk:.4f}, bound {bound:.4f}")
    return figure, lines


def _ellipse(axes: Axes, mean: np.ndarray, covariance: np.ndarray, colour: str, label: str) -> None:
    values, vectors = np.linalg.eigh(covariance)
    angle = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
    size = 2 * np.sqrt(values[::-1])
    look = {"fill": False, "edgecolor": colour, "linewidth": 1.8, "label": label, "zorder": 3}
    axes.add_patch(Ellipse(mean, size[0], size[1], angle=angle, **look))
    axes.plot(*mean, "o", color=colour, markersize=4)


def trajectory(problem: Problem) -> Figure:
    """Figure 5: one target, and where three observation set-ups saw it."""
    chosen = {"sensor 1 only": Fixed("one"), "sensor 2 only": Fixed("two"), "two sensors, scheduled": Scheduled()}
    colours = (ORANGE, GREEN, BLUE)
    figure = new_figure(
        SLIDE, "Target trajectory and position estimates", "figure 5 of Liu & Hwang; run 1, right: a part of it"
    )
    whole, part = figure.subplots(1, 2, width_ratios=[1.2, 1])
    window = slice(80, 101)
    for i, (name, method) in enumerate(chosen.items()):
        tried = experiment(problem, method)
        runs = run_some(tried, tried.models(), [0])
        truth, estimate = runs.truths.states[0], np.vstack([problem.plant.mean, runs.estimates[0]])
        for axes, rows in ((whole, slice(None)), (part, window)):
            if i == 0:
                axes.plot(truth[rows, 0], truth[rows, 2], color=INK, linewidth=2.4, label="actual trajectory")
            style = {"color": colours[i], "linewidth": 1.0 + 0.4 * i, "label": name}
            axes.plot(estimate[rows, 0], estimate[rows, 2], ".-", markersize=4 if rows is window else 2, **style)
    corners = truth[window]
    low, high = corners[:, [0, 2]].min(axis=0) - 20, corners[:, [0, 2]].max(axis=0) + 20
    whole.add_patch(_box(low, high))
    for axes in (whole, part):
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("ξ [m]")
        axes.set_ylabel("η [m]")
        axes.grid(True)
    part.set_title("k = 80 to 100")
    whole.legend(loc="best")
    return figure


def _box(low: np.ndarray, high: np.ndarray):
    from matplotlib.patches import Rectangle

    return Rectangle(tuple(low), *(high - low), fill=False, color=GREY, linewidth=1)


def rms_figure(solutions: dict[str, Solution]) -> Figure:
    """Figure 6: RMS position errors over time, 100 runs, and the baseline that the paper does not show."""
    figure = new_figure(
        (12, 6), "RMS error of the position estimates", "figure 6 of Liu & Hwang, 100 runs; dashed: not in the paper"
    )
    axes = figure.subplots()
    shown = {
        "two sensors, scheduled": ("scheduled", "-", BLUE),
        "sensor 1 only": ("one", "-", ORANGE),
        "sensor 2 only": ("two", "-", GREEN),
        "the sensors in turn": ("alternate", "--", INK),
        "scheduled with position weight 0.03": ("weighted", "--", PALETTE[3]),
    }
    for name, (key, dashes, colour) in shown.items():
        solution = solutions[key]
        times, curve, error = (solution.arrays[a] for a in ("times", "rms", "rms_standard_error"))
        axes.plot(times[1:], curve, dashes, color=colour, label=name)
        axes.fill_between(times[1:], curve - error, curve + error, color=colour, alpha=0.15, linewidth=0)
    axes.set_xlim(0, times[-1])
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("RMS position error [m]; band: one standard error")
    axes.grid(axis="y")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3)
    return figure


def tradeoff_figure(problem: Problem, others: dict[str, Solution]) -> tuple[Figure, list[str]]:
    """Average RMS against mode errors as the position weight grows, with the baselines as points; 1,000 runs."""
    results = [hybrid.solve(replace(problem, position_weight=w), Scheduled()).result for w in WEIGHTS]
    rms, errors = ([r[key] for r in results] for key in ("average_rms", "mode_errors"))
    figure = new_figure(
        (12, 7),
        "Knowing the mode or knowing the position",
        f"criterion: bound + λ × position variance; {problem.runs} runs",
    )
    axes = figure.subplots()
    axes.plot(errors, rms, "o-", color=BLUE, label="scheduled, λ written beside")
    for weight, x, y in zip(WEIGHTS, errors, rms, strict=True):
        if weight <= 0.2:
            axes.annotate(f"{weight:g}", (x, y), textcoords="offset points", xytext=(6, 5), fontsize=10)
    points = {
        "sensor 1 only": "one",
        "sensor 2 only": "two",
        "in turn, or least covariance": "alternate",
        "random": "random",
    }
    for i, (name, key) in enumerate(points.items()):
        result, colour = others[key].result, PALETTE[1 + i]
        axes.plot(result["mode_errors"], result["average_rms"], "s", color=colour, markersize=9, label=name)
    axes.set_xlabel(f"steps with the wrong mode, of {problem.steps}")
    axes.set_ylabel("average RMS position error [m]")
    axes.set_ylim(bottom=0)
    axes.grid(True)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.11), ncols=5)
    lines = ["| λ | average RMS | mode errors | use of sensor 1 |", "|---|---|---|---|"]
    for weight, r in zip(WEIGHTS, results, strict=True):
        lines.append(
            f"| {weight:g} | {_pm(r, 'average_rms')} | {_pm(r, 'mode_errors')} | {100 * r['use']['one']:.1f} % |"
        )
    return figure, lines


def known_mode_rms(problem: Problem, sensor: str, runs: int) -> float:
    """Average RMS of a Kalman filter that is told the true mode: nothing that must find it can be better."""
    tried = experiment(problem, Fixed(sensor))
    truths = run_some(tried, tried.models(), range(runs)).truths
    plant, j = problem.plant, problem.sensors.index(sensor)
    first = sum(s.rows for s in problem.sensors[:j])
    C, R = problem.sensors[j].C.at(1), problem.sensors[j].R.at(1)
    A = np.array([m.A.at(1) for m in plant.modes])
    Q = np.array([m.F.at(1) @ m.W.at(1) @ m.F.at(1).T for m in plant.modes])
    x, P = np.tile(plant.mean, (runs, 1)), np.tile(plant.covariance, (runs, 1, 1))
    curve = []
    for k in range(1, problem.steps + 1):
        q = truths.modes[:, k]
        x, P = np.einsum("rij,rj->ri", A[q], x), A[q] @ P @ A[q].transpose(0, 2, 1) + Q[q]
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        z = truths.values[:, k - 1, first : first + len(C)]
        x = x + np.einsum("rij,rj->ri", K, z - x @ C.T)
        P = P - K @ C @ P
        error = (x - truths.states[:, k])[:, list(problem.position or ())]
        curve.append(math.sqrt(np.mean(np.sum(error**2, axis=1))))
    return float(np.mean(curve))


def _pm(result, key: str) -> str:
    return f"{result[key]:.3f} ± {result[f'{key}_standard_error']:.3f}"


def main(folder: Path) -> int:
    """Draw the figures into `folder` and print the tables of docs/liu_hwang.md."""
    paper = read_problem(PROBLEM)
    many = replace(paper, runs=1000)
    weighted = replace(paper, position_weight=0.03)
    methods = {
        "scheduled": Scheduled(),
        "one": Fixed("one"),
        "two": Fixed("two"),
        "alternate": Alternate(),
        "random": Random(),
    }
    few = {name: hybrid.solve(paper, method) for name, method in methods.items()}
    few["weighted"] = hybrid.solve(weighted, Scheduled())
    found = {name: hybrid.solve(many, method) for name, method in methods.items()}
    found["weighted"] = hybrid.solve(replace(weighted, runs=1000), Scheduled())
    found["covariance"] = hybrid.solve(many, ExpectedCovariance())
    print(
        "| 1000 runs | peak RMS (paper) | average RMS (paper) | mode errors (paper) | sensor 1 |\n|---|---|---|---|---|"
    )
    for name, solution in found.items():
        r, printed = solution.result, PAPER.get(name)
        cells = [_pm(r, key) for key in ("peak_rms", "average_rms", "mode_errors")]
        if printed is not None:
            cells = [f"{cell} ({value:g})" for cell, value in zip(cells, printed, strict=True)]
        print(f"| {name} | " + " | ".join(cells) + f" | {100 * r['use']['one']:.1f} % |")
    print("| 100 runs, the problem file's seed | peak RMS | average RMS | mode errors |\n|---|---|---|---|")
    for name, solution in few.items():
        print(
            f"| {name} | "
            + " | ".join(_pm(solution.result, key) for key in ("peak_rms", "average_rms", "mode_errors"))
            + " |"
        )
    for key in ("average_rms", "mode_errors"):
        for other in ("one", "two"):
            a, b = found["scheduled"].result, found[other].result
            spread = math.hypot(a[f"{key}_standard_error"], b[f"{key}_standard_error"])
            less = b[key] - a[key]
            print(f"{key}: scheduled below {other} by {less:.3f} = {less / spread:.0f} standard errors")
    for sensor in ("one", "two"):
        print(
            f"a filter that knows the mode, sensor {sensor} only: average RMS {known_mode_rms(paper, sensor, 1000):.3f}"
        )
    with house_style():
        figure, lines = illustration()
        save(figure, folder / "liu_hwang_figures_2_3.png")
        save(trajectory(paper), folder / "liu_hwang_figure_5.png")
        save(rms_figure(few), folder / "liu_hwang_figure_6.png")
        curve, table = tradeoff_figure(many, found)
        save(curve, folder / "liu_hwang_tradeoff.png")
    print("\n".join([*lines, *table]))
    return 0
