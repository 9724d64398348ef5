"""How fast the certified relaxation is: instances, peers and targets, on the screen and in docs/bench.md.

    python scripts/bench.py [--quick] [--limit 120]

Without --quick it also writes docs/bench.md and docs/figures/bench.png. One thread for linear algebra everywhere: two
make the largest case slower.
"""

from __future__ import annotations

import argparse
import datetime
import os
import sys
from pathlib import Path
from statistics import median

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import bench_start  # noqa: E402  (after the number of threads is set)
import bench_targets  # noqa: E402
from bench_cases import CASES, NOT_RUN, QUICK  # noqa: E402
from bench_compare import Comparison, compare  # noqa: E402
from bench_summary import details, targets  # noqa: E402
from bench_targets import solve_apart  # noqa: E402

ROOT = Path(__file__).resolve().parent.parent


class Report:
    """Tables that go to the screen at once and to docs/bench.md at the end."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, *lines: str) -> None:
        """Print, and keep for the file."""
        self.lines += lines
        print(*lines, sep="\n", flush=True)

    def table(self, title: str, head: str, rows: list[list[str]]) -> None:
        """A markdown table under a title."""
        columns = head.split("|")
        self.say("", f"## {title}", "", f"| {' | '.join(columns)} |", "|" + "---|" * len(columns))
        self.say(*(f"| {' | '.join(row)} |" for row in rows))


def machine() -> str:
    """Processor, cores and versions."""
    import platform

    from occontrol.core.versions import versions

    info = Path("/proc/cpuinfo")
    names = (
        [x.split(":")[1].strip() for x in info.read_text().splitlines() if x.startswith("model name")]
        if info.exists()
        else []
    )
    used = ", ".join(f"{k} {v}" for k, v in versions().items())
    processor = names[0] if names else platform.machine()
    return f"{processor}, {os.cpu_count()} cores, Python {platform.python_version()}, {used}"


def instances(report: Report, quick: bool) -> dict[tuple, dict]:
    """Our relaxation on every instance, each in a process of its own."""
    found, rows = {}, []
    for i, (n, M, N, gap, seeds, threads) in enumerate(CASES):
        name = [f"({n},{M})", str(N), f"{gap:g}"]
        if quick and i >= QUICK:
            rows.append([*name, *[NOT_RUN] * 6])
            continue
        print(f"... ({n},{M}), N = {N}, gap {gap:g}", file=sys.stderr, flush=True)
        case = found[n, M, N, gap] = solve_apart(n, M, N, gap, seeds, threads)
        runs = case["runs"]
        seconds, sweeps = sorted(r["seconds"] for r in runs), sorted(r["sweeps"] for r in runs)
        worst = max(r["gap"] for r in runs)
        ok = all(r["status"] == "certified" for r in runs)
        rows.append(
            [*name, str(len(seeds)), f"{worst:.2g}" + ("" if ok else " (not certified)"),
             f"{median(seconds):.3g} / {seconds[-1]:.3g}",
             f"{median(sweeps):g} / {sweeps[-1]}", f"{1e3 * median(r['seconds'] / r['sweeps'] for r in runs):.3g}",
             f"{case['peak_MiB']:.0f}"]
        )  # fmt: skip
    head = "(n,M)|N|target gap|seeds|worst certified gap|seconds, median / worst|sweeps, median / worst"
    head += "|ms per sweep, all in|peak MiB"
    report.table("Instances: our relaxation", head, rows)
    report.say(
        "",
        "A sweep is one cost and gradient. Peak memory is that of the whole process; the first row shows what the",
        "libraries alone take.",
    )
    return found


def against(report: Report, quick: bool, limit: float) -> list[Comparison]:
    """Peers on (6,4) and (12,8), N = 100."""
    found, rows = [], []
    for n, M in ((6, 4), (12, 8)):
        if quick and n > 6:
            rows.append([f"({n},{M},100)", *[NOT_RUN] * 7])
            continue
        done = compare(n, M, 100, limit)
        found.append(done)
        for line in done.lines:
            rows.append(line)
    head = "instance|method|seconds to gap 1e-4|its last gap|times ours|runs|peak MiB|how it ended"
    report.table("Peers", head, rows)
    report.say(
        "",
        "Every policy is scored by the plain recursion (numpy, none of the compiled loops): its cost, and its gap",
        "to the bound that the same plain recursion proves. '>=': the gap was not reached within what the peer ran, so",
        "the factor is a lower limit. Collocation and the SDP are scored at their end only; the SDP's seconds are",
        "Clarabel's own, without CVXPY's; L-BFGS-B uses our own exact gradient. Ours is measured in turn with each",
        "run, from the problem to the certified gap, compiled functions warm; peers run in a process of their own. A",
        "peer that takes longer than 6 seconds runs once, beside the median of five of ours.",
    )
    return found


def main() -> None:
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="up to (6,4,N=100), under three minutes")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds for a peer")
    options = parser.parse_args()
    report, quick = Report(), options.quick
    report.say("# Benchmarks", "", f"Made by `python scripts/bench.py` on {datetime.date.today()}: {machine()}.")
    if quick:
        compared = against(report, quick, min(options.limit, 60.0))
    else:
        report.say("", "![Gap against time, rate of a sweep](figures/bench.png)")
        compared = against(report, quick, options.limit)
    found = instances(report, quick)
    rates = bench_targets.rates([(6, 4, 400), (30, 20, 200), *([] if quick else [(100, 200, 40), (200, 500, 10)])])
    start = bench_start.help_against_nothing()
    more = (
        {}
        if quick
        else {
            "exponents": bench_targets.exponents(),
            "crossover": bench_targets.crossover(),
            "first": bench_start.first_results(),
        }
    )
    report.table("Targets", "what|measured|target|", targets(compared, found, rates, start, more))
    details(report, rates, start, more, quick)
    if quick:
        return
    from bench_figure import draw

    (ROOT / "docs" / "bench.md").write_text("\n".join([*report.lines, ""]))
    draw(compared, rates, found, ROOT / "docs" / "figures" / "bench.png")


if __name__ == "__main__":
    main()
