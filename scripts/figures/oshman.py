"""Figures 1 to 4 of Oshman (1994), and the numbers behind what its text says about them.

Called by scripts/reproduce.py. Everything is computed anew from problems/oshman_example.yaml.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from occontrol.api import compare_figure, read_problem, solve
from occontrol.files.figures import save, style
from occontrol.files.figures.style import tidy_time_axis

PROBLEMS = Path(__file__).parents[2] / "problems"


def main(folder: Path) -> int:
    """Draw the figures into `folder` and print the comparison; 0 when the choices are the paper's."""
    problem = read_problem(PROBLEMS / "oshman_example.yaml")
    names = ["eigenspace", "fixed:one", "fixed:two", "fixed:three", "round-robin", "trace", "lookahead", "optimal"]
    runs = {name: solve(problem, name) for name in names}
    chosen = [problem.sensors.index(entry["sensors"][0]) + 1 for entry in runs["eigenspace"].result["schedule"]]
    print("figure 1, selected subsystem at k = 0, 25, ..:", *chosen)
    print("the exact search over 3^12 sequences agrees:", chosen == _numbers(problem, runs["optimal"]))
    print(f"search: {runs['optimal'].result['nodes']} epochs walked; {runs['optimal'].message}")
    print("\nlargest standard deviation from k = 25 on (where), and the end of the run")
    for name in names[:4]:
        deviations = runs[name].arrays["standard_deviations"]
        peaks = [f"x{i + 1} {deviations[25:, i].max():8.4f} at {25 + deviations[25:, i].argmax():3d}" for i in range(3)]
        print(f"  {name:12s}", "   ".join(peaks), "   end", np.round(deviations[-1], 4))
    one, best = (runs[name].arrays["standard_deviations"][25:] for name in ("fixed:one", "eigenspace"))
    print("\noptimised over subsystem 1, largest ratio after k = 25:", np.round(np.max(best / one, axis=0), 2))
    print("subsystem 1 over optimised, largest ratio after k = 25:", np.round(np.max(one / best, axis=0), 2))
    every = solve(read_problem(PROBLEMS / "oshman_every_step.yaml"))
    print("largest eigenvalue after k = 25: a choice every 25 steps", end=" ")
    print(f"{runs['eigenspace'].arrays['largest_eigenvalue'][26:].max():.4f},", end=" ")
    print(f"at every step {every.arrays['largest_eigenvalue'][26:].max():.4f}")
    with style.house_style():
        save(_figures(problem, runs), folder / "oshman_figures_1_to_4.png")
    comparison = compare_figure(problem, runs)
    if comparison is not None:
        save(comparison, folder / "oshman_compare.png")
    print(f"\n{folder / 'oshman_figures_1_to_4.png'}\n{folder / 'oshman_compare.png'}")
    return 0 if chosen == [3, 2, 2, 2, 3, 2, 1, 2, 1, 2, 2, 2] else 1


def _numbers(problem, run) -> list[int]:
    return [problem.sensors.index(entry["sensors"][0]) + 1 for entry in run.result["schedule"]]


def _figures(problem, runs):
    figure = style.new_figure(
        style.SLIDE, "Oshman (1994), figures 1 to 4", "the paper's rule against subsystem 1 alone"
    )
    axes = figure.subplots(2, 2).ravel()
    steps = np.append(np.arange(0, problem.steps, problem.epoch), problem.steps)
    chosen = _numbers(problem, runs["eigenspace"])
    axes[0].stairs(chosen, steps, color=style.ACCENT, linewidth=2.2, baseline=None)
    axes[0].set_yticks([1, 2, 3])
    axes[0].set_ylim(0.5, 3.5)
    axes[0].set_ylabel("subsystem")
    axes[0].set_title("1  measurement strategy")
    for i in range(3):
        one = axes[i + 1]
        for name, colour, label in (
            ("eigenspace", style.ACCENT, "optimised"),
            ("fixed:one", style.SECOND, "subsystem 1"),
        ):
            one.plot(runs[name].arrays["standard_deviations"][:, i], color=colour, label=label)
        one.set_yscale("log")
        one.set_ylabel(f"standard deviation of x{i + 1}")
        one.set_title(f"{i + 2}  estimation error of x{i + 1}")
        one.grid(axis="y")
        one.legend(loc="upper right")
    for one in axes:
        tidy_time_axis(one, 0, problem.steps, False)
        one.tick_params(labelbottom=True)
        one.set_xlabel("step k")
    return figure
