"""The loop of docs/replan_in_a_loop.py runs as the page says."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parent.parent / "docs" / "replan_in_a_loop.py"


def test_the_loop_of_the_page_flies_and_prints_its_latencies(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), "2"])
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    first, step, plan, late = capsys.readouterr().out.splitlines()
    assert first == "2 runs of 30 readings, one in ten lost, a plan every 5"
    numbers = [re.match(r"a step.*median +([0-9.]+) ms +largest +([0-9.]+) ms +of ([0-9]+)$", x) for x in (step, plan)]
    (middle, most, count), (_, _, plans) = ([float(x) for x in found.groups()] for found in numbers if found)
    assert 0 < middle <= most and count + plans == 60 and 6 <= plans <= 10
    assert re.match(r"late plans +[0-9]+ of [0-9]+$", late)
