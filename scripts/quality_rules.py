"""Rules at full size: gaps that a minute of search leaves, beside those of a prototype and the targets.

    .venv/bin/python scripts/quality_rules.py run [SECONDS] [CASE ..]     measures, into runs/quality_rules.json
    .venv/bin/python scripts/quality_rules.py table                       the table of docs/rules_quality.md
    .venv/bin/python scripts/quality_rules.py figure FILE.png             bounds and costs over seconds and over nodes

Two processes share the tree where no cap is asked for (PLACES in the environment: another number). Seconds are of the
processors, all processes together, divided by their number: what a quiet machine with as many cores takes. They count
from the relaxation on. A case is INSTANCE/RULE, for example M/maxsw5;
the instances are the oscillators of scripts/instances.py with seed 0 (M, L, XL: 6, 12, 30 states) and problems of
problems/, all with one step of integration an interval and the edges of the file. large_structure is dense: it takes
seconds a node.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
from instances import oscillators
from matplotlib.figure import Figure

import occontrol as oc
from occontrol.core.monitor import Monitor
from occontrol.families.athans.balanced import balanced
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.found import relax
from occontrol.families.athans.integration.refine import search_space
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.rules.search import MOVES, Work, searched, seeds_of
from occontrol.families.athans.rules.setting import frame_of, prepared, setting_of
from occontrol.families.athans.rules.statement import Constraints
from occontrol.files.figures import style
from occontrol.scheduling.rules.tree import TreeOptions
from occontrol.studies.engines.places import places

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "runs" / "quality_rules.json"
SIZES = {"M": (6, 4), "L": (12, 8), "XL": (30, 20)}
MARKS = (3.0, 10.0)  # seconds at which the gap is kept
# case: the prototype's gap in percent (0 is proven), and the one to reach
CASES: dict[str, tuple[float, float]] = {
    "M/dwell20": (0, 0), "M/maxsw5": (0, 0), "M/swcost": (0, 0),
    "tracking_network/dwell5": (0.10, 0.05), "tracking_network/dwell20": (0.28, 0.15),
    "tracking_network/maxsw5": (0, 0),
    "attitude_telemetry/dwell20": (0.15, 0.05), "attitude_telemetry/maxsw5": (1.03, 0.5),
    "L/dwell20": (1.9, 1.0), "L/maxsw5": (2.6, 1.5),
    "survey_panel/dwell5": (1.5, 0.7), "survey_panel/dwell20": (5.0, 2.0), "survey_panel/maxsw5": (13.3, 6.0),
    "XL/dwell20": (3.8, 2.0), "XL/maxsw5": (15.8, 8.0),
    "large_structure/dwell20": (16.4, 8.0), "large_structure/maxsw5": (18.5, 10.0),
    "tracking_network/error1.5": (16.5, 3.0),
}  # fmt: skip


def instance(name: str) -> SchedulingProblem:
    """A problem with one step an interval, without rules."""
    if name in SIZES:
        p = oscillators(*SIZES[name], 400, 0)
    else:
        read: SchedulingProblem = oc.read_problem(ROOT / "problems" / f"{name}.yaml")  # type: ignore[assignment]
        p = replace(read, expect=None, method=None)
    return replace(p, integration=replace(p.integration, substeps=1))


def ruled(case: str) -> SchedulingProblem:
    """The problem of a case with its rule."""
    name, rule = case.split("/")
    p = instance(name)
    if rule.startswith("dwell"):
        return replace(p, rules=Constraints(min_on=int(rule[5:]) * float(np.median(np.diff(p.edges)))))
    if rule.startswith("maxsw"):
        return replace(p, rules=Constraints(max_switches=int(rule[5:])))
    r = oc.solve(p).result
    if rule == "swcost":
        return replace(p, rules=Constraints(switch_cost=0.002 * r["relaxed_cost"]))
    error = float(rule[5:]) * (r["running_cost"] + r["prediction_error"])
    return replace(p, rules=Constraints(max_error=error), minimise="observation")


def processor_seconds() -> float:
    """Of this process and of its children."""
    ticks, total = os.sysconf("SC_CLK_TCK"), time.process_time()
    for child in multiprocessing.active_children():
        fields = Path(f"/proc/{child.pid}/stat").read_text().rpartition(")")[2].split()
        total += (int(fields[11]) + int(fields[12])) / ticks
    return total


def measured(case: str, limit: float, count: int) -> dict:
    """Bounds and costs of a case over processor seconds and nodes; `count` processes."""
    p, method = ruled(case), RelaxRoundPolish()
    count = 1 if p.minimise != "cost" else count
    history: list[list[float]] = []
    watch = Monitor()

    def show(record: dict) -> None:
        seconds = (processor_seconds() - began) / count
        history.append([seconds, record["iteration"], record["cost"], record["lower_bound"]])
        if seconds > limit:
            watch.time_limit = 0.0

    with ExitStack() as held:
        watch.spread = held.enter_context(places(count)) if count > 1 else watch.spread
        began, watch.show = processor_seconds(), show
        return _searched(case, p, method, watch, history, lambda: (processor_seconds() - began) / count)


def _searched(
    case: str,
    p: SchedulingProblem,
    method: RelaxRoundPolish,
    watch: Monitor,
    history: list[list[float]],
    seconds: Callable[[], float],
) -> dict:
    """Relax, search, and what came of it."""
    inner, _ = balanced(prepared(p, method.relative_gap))
    integrator, sweep = search_space(inner, method, Monitor())
    allowed = feasible_set(inner)
    base = relax(sweep, allowed, Monitor(), method.relative_gap)
    setting = setting_of(inner, integrator)
    work = Work(setting.task, frame_of(p), sweep, allowed, base.relaxed, watch)  # type: ignore[arg-type]
    options = TreeOptions(1e-6, 10**6, MOVES, 10**6)
    _, tree = searched(setting.task, base.relaxed, options, watch, seeds_of(work), allowed)  # type: ignore[arg-type]
    best = float("nan") if tree.best is None else tree.best.value
    relaxed = base.relaxed.lower_bound if base.relaxed is not None and p.minimise == "cost" else -np.inf
    bound = max(tree.lower_bound, relaxed)
    return {
        "case": case,
        "cost": best,
        "relaxed_bound": relaxed,
        "hull_bound": max(tree.root.lower_bound, relaxed),
        "bound": bound,
        "nodes": tree.nodes,
        "proven": tree.complete,
        "seconds": seconds(),
        "history": [[*h[:3], max(h[3], relaxed)] for h in history],
    }


def at(result: dict, seconds: float) -> str:
    """The gap in percent after so many seconds."""
    known = [h for h in result["history"] if h[0] <= seconds and np.isfinite(h[2])]
    if not known:
        return "-"
    return percent(known[-1][2], known[-1][3])


def percent(cost: float, bound: float) -> str:
    """The gap in percent, in few digits."""
    return f"{100 * max(cost - bound, 0.0) / abs(cost):.3g}"


def table(results: list[dict]) -> str:
    """The table as Markdown."""
    head = ["case", "prototype", "to reach", "hull", *(f"{s:g} s" for s in MARKS), "at the end", "seconds", "nodes",
            "cost", "bound", "reached"]  # fmt: skip
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for r in results:
        before, wanted = CASES[r["case"]]
        gap = 100 * max(r["cost"] - r["bound"], 0.0) / abs(r["cost"])
        reached = r["proven"] if wanted == 0 else gap <= wanted
        cells = [r["case"], "proven" if before == 0 else f"{before:g}", "proven" if wanted == 0 else f"{wanted:g}"]
        cells += [percent(r["cost"], r["hull_bound"]), *(at(r, s) for s in MARKS)]
        cells += ["proven" if r["proven"] else f"{gap:.3g}", f"{r['seconds']:.1f}", str(r["nodes"])]
        cells += [f"{r['cost']:.7g}", f"{r['bound']:.7g}", "yes" if reached else "no"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def drawn(results: list[dict]) -> Figure:
    """The gap that is left of every case, over seconds and over nodes."""
    with style.house_style():
        figure = style.new_figure((12, 0.5 + 2.3 * -(-len(results) // 3)), "Rules at full size", "")
        axes = figure.subplots(-(-len(results) // 3), 3, squeeze=False).ravel()
        for ax, r in zip(axes, results, strict=False):
            h = np.array([x for x in r["history"] if np.isfinite(x[2])])
            last = float(h[-1, 2])
            ax.plot(h[:, 0], 100 * (h[:, 2] / last - 1), color=style.ACCENT, label="cost")
            ax.plot(h[:, 0], 100 * (h[:, 3] / last - 1), color=style.SECOND, label="bound")
            nodes = ax.secondary_xaxis("top", functions=_between(h[:, 0], h[:, 1]))
            nodes.tick_params(labelsize=7)
            nodes.set_xticks([0, int(h[-1, 1])])
            ax.set_title(r["case"], fontsize=9, pad=16)
            ax.tick_params(labelsize=8)
            ax.grid(axis="y")
        for ax in axes[len(results) :]:
            ax.axis("off")
        axes[0].legend(fontsize=8)
        figure.supylabel("% of the last cost", fontsize=9)
        figure.supxlabel("seconds below, nodes above", fontsize=9)
        return figure


def _between(seconds: np.ndarray, nodes: np.ndarray) -> tuple[Callable, Callable]:
    """From seconds to nodes and back, by straight lines."""
    return (
        lambda x: np.interp(x, seconds, nodes, left=0.0, right=float(nodes[-1])),
        lambda x: np.interp(x, nodes, seconds, left=0.0, right=float(seconds[-1])),
    )


def main() -> int:
    """Measure, or print the table."""
    known = json.loads(OUT.read_text()) if OUT.exists() else {}
    if sys.argv[1:2] == ["table"]:
        print(table([known[case] for case in CASES if case in known]))
        return 0
    if sys.argv[1:2] == ["figure"]:
        drawn([known[case] for case in CASES if case in known]).savefig(sys.argv[2], dpi=100)
        return 0
    if sys.argv[1:2] != ["run"]:
        print(__doc__)
        return 2
    limit = float(sys.argv[2]) if len(sys.argv) > 2 else 60.0
    for case in sys.argv[3:] or CASES:
        known[case] = measured(case, limit, int(os.environ.get("PLACES", "2")))
        OUT.parent.mkdir(exist_ok=True)
        OUT.write_text(json.dumps(known))
        print(table([known[case]]).splitlines()[-1], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
