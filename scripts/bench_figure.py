"""The figure of scripts/bench.py: gap against time beside the peers, rate of a sweep, time and sweeps of all sizes."""

from __future__ import annotations

from pathlib import Path
from statistics import median

import numpy as np

from occontrol.files.figures.style import ACCENT, GREY, PALETTE, SLIDE, house_style, new_figure


def draw(compared: list, rates: list[dict], found: dict, file: Path) -> None:
    """Draw and save.

    Parameters
    ----------
    compared : Comparison, one panel each
    rates : of bench_targets.rates
    found : our relaxation by (n, M, N, gap)
    file : PNG
    """
    with house_style():
        figure = new_figure(
            SLIDE,
            "A certified relaxation at the price of a few sweeps",
            "oscillator chains (states, sensors, intervals), seed 0; one thread",
        )
        panels = figure.subplots(2, 2)
        for axes, done in zip(panels[0], compared, strict=False):
            _race(axes, done)
        _rates(panels[1][0], rates)
        _sizes(panels[1][1], found)
        figure.savefig(file, dpi=120)


def _race(axes, done) -> None:
    seconds, gaps = np.array(done.trace).T
    axes.step(seconds, gaps, where="post", color=ACCENT, lw=2.5)
    labels = [(seconds[-1], gaps[-1], "this project (certified)", ACCENT)]
    for colour, (name, runs) in zip(PALETTE[1:], done.peers.items(), strict=False):
        points = [(s, g) for s, g in (runs[-1].gaps if runs else []) if g > 0]
        if not points:
            continue
        s, g = np.array(points).T
        best = np.minimum.accumulate(g)
        axes.step(s, best, where="post", color=colour)
        axes.plot(s[-1], best[-1], "o", color=colour)
        labels.append((s[-1], best[-1], name, colour))
    axes.axhline(1e-4, color=GREY, lw=0.8, ls=":")
    axes.set(xscale="log", yscale="log", xlabel="seconds", ylabel="relative gap", title=done.name, ylim=(3e-7, 3))
    taken: list[tuple[float, float]] = []
    last = max(x for x, *_ in labels)
    axes.set_xlim(right=2 * last)
    for x, y, text, colour in sorted(labels):
        right, up = x > 0.05 * last, 6
        while any(abs(np.log10(y) + up / 30 - b) < 0.4 and abs(np.log10(x) - a) < 1.2 for a, b in taken):
            up -= 13
        taken.append((np.log10(x), np.log10(y) + up / 30))
        axes.annotate(
            text, (x, y), (-8 if right else 8, up), textcoords="offset points", color=colour, fontsize=9,
            ha="right" if right else "left",
        )  # fmt: skip
    axes.grid(True)


def _rates(axes, rates: list[dict]) -> None:
    x = np.arange(len(rates))
    axes.bar(x - 0.2, [r["dgemm"] for r in rates], 0.4, color="#cccccc", label="dgemm")
    bars = axes.bar(x + 0.2, [r["sweep"] for r in rates], 0.4, color=ACCENT, label="one sweep")
    axes.bar_label(bars, [f"{100 * r['share']:.0f} %" for r in rates], fontsize=9)
    axes.set_xticks(x, [f"n = {r['n']}" for r in rates])
    axes.set(ylabel="Gflop/s", title="Rate of a sweep")
    axes.legend(loc="upper left", ncols=2)
    axes.set_ylim(0, 1.35 * max(r["dgemm"] for r in rates))


def _sizes(axes, found: dict) -> None:
    cases = [(key, case) for key, case in found.items() if key[3] == 1e-4 or key[0] == 200]
    cases.sort(key=lambda c: (c[0][0], c[0][2]))
    x = np.arange(len(cases))
    values = [median(r["seconds"] for r in case["runs"]) for _, case in cases]
    bars = axes.bar(x, values, 0.6, color=ACCENT)
    axes.bar_label(bars, [f"{median(r['sweeps'] for r in case['runs']):g}" for _, case in cases], fontsize=9)
    names = [f"{n}\n{M}\n{N}" + ("" if gap == 1e-4 else f"\n({gap:g})") for (n, M, N, gap), _ in cases]
    axes.set_xticks(x, names, fontsize=8)
    axes.set(yscale="log", ylabel="seconds", title="Time to a certified gap of 1e-4, and sweeps")
    axes.set_xlabel("states, sensors, intervals (gap if another)", fontsize=8)
    axes.set_ylim(top=8 * max(values))
