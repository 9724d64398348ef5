"""Targets beside what was measured, and the details behind them."""

from __future__ import annotations

from importlib import import_module
from statistics import median
from typing import Any

from bench_cases import CASES, NOT_RUN, RATES, RATIOS, SWEEPS
from bench_targets import flops


def _line(what: str, measured: str, target: str, met: bool | None) -> list[str]:
    return [what, measured, target, {True: "met", False: "missed", None: ""}[met]]


def targets(compared: list, found: dict, rates: list[dict], start: dict, more: dict) -> list[list[str]]:
    """Rows what, measured, target, met or missed.

    Parameters
    ----------
    compared : Comparison of every instance with peers
    found : records of our relaxation by (n, M, N, gap)
    rates, start, more : from bench_targets and bench_start
    """
    rows = []
    by_name = {c.name: c for c in compared}
    for peer, wanted in RATIOS.items():
        for name, factor in zip(("(6,4,100)", "(12,8,100)"), wanted, strict=True):
            what, done = f"time to gap 1e-4 against {peer}, {name}", by_name.get(name)
            if done is None or peer not in done.ratios:
                rows.append(_line(what, NOT_RUN if done is None else "failed", f"{factor} times", None))
                continue
            ratio, lower = done.ratios[peer]
            rows.append(
                _line(what, f"{'at least ' if lower else ''}{ratio:.0f} times", f"{factor} times", ratio >= factor)
            )
    for (n, M), limits in SWEEPS.items():
        for gap, limit in zip((1e-4, 1e-6), limits, strict=True):
            case, what = found.get((n, M, 400, gap)), f"sweeps to gap {gap:g}, ({n},{M}), N = 400, median (worst)"
            if case is None:
                rows.append(_line(what, NOT_RUN, f"{limit}", None))
                continue
            counts = [r["sweeps"] for r in case["runs"]]
            rows.append(_line(what, f"{median(counts):g} ({max(counts)})", f"{limit}", median(counts) <= limit))
    for n, M in ((6, 4), (12, 8)):
        few, many = found.get((n, M, 400, 1e-4)), found.get((n, M, 6400, 1e-4))
        what = f"sweeps as N goes 400 to 6400, ({n},{M}), medians"
        if few is None or many is None:
            rows.append(_line(what, NOT_RUN, "+20 %", None))
            continue
        a, b = (median(r["sweeps"] for r in case["runs"]) for case in (few, many))
        rows.append(_line(what, f"{a:g} to {b:g}, {100 * (b / a - 1):+.0f} %", "+20 %", b <= 1.2 * a))
    by_n = {rate["n"]: rate for rate in rates}
    for n, share in RATES.items():
        what = f"flop rate of a sweep against dgemm, n = {n}"
        if n not in by_n:
            rows.append(_line(what, NOT_RUN, f"{100 * share:.0f} %", None))
            continue
        rows.append(_line(what, f"{100 * by_n[n]['share']:.0f} %", f"{100 * share:.0f} %", by_n[n]["share"] >= share))
    for name, most in (("N", 1.05), ("n", 3.1), ("M", 1.05)):
        value = more.get("exponents", {}).get(name)
        what = f"exponent of the time of a sweep in {name}"
        rows.append(
            _line(what, f"{value[0]:.2f}" if value else NOT_RUN, f"{most}", value[0] <= most if value else None)
        )
    large = next(c for c in CASES if c[0] == 200)
    case, what = found.get(large[:4]), "(200,500), N = 500"
    if case is None:
        rows.append(_line(what, NOT_RUN, "certified gap 1e-3, < 2048 MiB", None))
    else:
        run, peak = case["runs"][0], case["peak_MiB"]
        floor = case["flops"] / (by_n[200]["dgemm"] * 1e9) if 200 in by_n else float("nan")
        said = f"gap {run['gap']:.1e}, {peak:.0f} MiB, {run['seconds']:.1f} s, {run['sweeps']} sweeps"
        said += f" (flop floor of as many sweeps with two sensors in use, one thread of dgemm: {floor:.1f} s)"
        rows.append(_line(what, said, "certified gap 1e-3, < 2048 MiB", run["gap"] <= 1e-3 and peak < 2048))
    heavy = ", ".join(start["imported"]) or "none of the heavy libraries imported"
    said = f"{start['ratio']:.1f} times ({1e3 * start['help']:.0f} against {1e3 * start['nothing']:.0f} ms); {heavy}"
    good = start["ratio"] <= 8 and not start["imported"]
    rows.append(_line("occontrol --help against python -c pass", said, "8 times, none imported", good))
    return rows


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def details(report: Any, rates: list[dict], start: dict, more: dict, quick: bool) -> None:
    """What the targets rest on: rates with the formula, exponents, the switch, first results, the other families.

    Parameters
    ----------
    report : Report
    rates, start, more : as above
    quick : whether the other families' benchmarks are left out
    """
    rows = [
        [str(r["n"]), str(r["M"]), str(r["N"]), f"{r['flops_per_interval']:.4g}",
         f"{r['microseconds_per_interval']:.3g}",
         f"{r['sweep']:.3g}", f"{r['dgemm_same']:.3g}", f"{r['dgemm']:.3g}", f"{100 * r['share']:.0f} %"]
        for r in rates
    ]  # fmt: skip
    head = "n|M|N|flops per interval|us per interval|sweep, Gflop/s|dgemm at n, Gflop/s"
    head += "|dgemm, the better of n and 1000|share"
    report.table("Rate of one sweep (cost and gradient)", head, rows)
    said = " ".join((flops.__doc__ or "").split())
    report.say("", said, "Seconds of one thread's processor time, medians of 9 in turn.")
    for name, (slope, cases) in more.get("exponents", {}).items():
        report.say("", f"Time of a sweep goes with {name} to the power {slope:.2f} ({cases}).")
    if "crossover" in more:
        rows = [[str(r["n"]), f"{r['loops']:.3g}", f"{r['blas']:.3g}", r["taken"]] for r in more["crossover"]]
        report.table("Loops against BLAS, microseconds per interval of a sweep", "n|loops|BLAS|taken", rows)
    rows = [["occontrol --help", "", f"{start['help']:.2f}"]]
    rows += [[r["command"], f"{r['cold']:.1f}", f"{r['warm']:.2f}"] for r in more.get("first", [])]
    report.table("First results, seconds", "command|nothing compiled yet|again", rows)
    report.table("Other families", "benchmark|record", _others(quick))


def _others(quick: bool) -> list[list[str]]:
    rows = []
    for name in ("vlambda", "hybrid", "precision"):
        if quick:
            rows.append([name, NOT_RUN])
            continue
        try:
            records = import_module(f"bench_{name}").rows(name != "precision")
        except ModuleNotFoundError:
            continue
        rows += [[name, ", ".join(f"{k}: {_text(v)}" for k, v in record.items())] for record in records]
    return rows
