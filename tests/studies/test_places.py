"""Chunks of many targets in processes, on Dask and here: the same numbers, and nothing lost with a process."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from occontrol.cli import run
from occontrol.core.errors import SolveFailed, UsageError
from occontrol.core.monitor import Monitor
from occontrol.core.spread import HERE
from occontrol.families.athans.targets.fill import fill
from occontrol.families.athans.targets.whole import whole_looks
from occontrol.scheduling.blocks.relaxation import relax
from occontrol.scheduling.whole.bound import Effort, relaxed_prices
from occontrol.scheduling.whole.certificate import answer, joined
from occontrol.studies.engines.places import places
from tests.plain_looks import small
from tests.target_problems import read

EFFORT = Effort(10, 1e-3)
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory):
    document = small(17)
    problem = read(document, tmp_path_factory.mktemp("small"))
    filled = fill(problem, document["horizon"]["substeps"])
    sweep = filled.sweep()
    return filled, sweep, relax(sweep, filled.allowed, 1e-4, 2000, Monitor())


def same(one, other) -> None:
    assert one.bounds.tobytes() == other.bounds.tobytes()
    kinds = [[one.plans, *zip(*one.lines, strict=True)], [other.plans, *zip(*other.lines, strict=True)]]
    for these, those in zip(*kinds, strict=True):
        for x, y in zip(these, those, strict=True):
            assert x.height == y.height and np.array_equal(x.at, y.at) and np.array_equal(x.share, y.share)


@pytest.mark.parametrize("count", [1, 2, 3, 50])
def test_parts_hold_every_target_once_and_answer_as_the_whole(filled, count: int) -> None:
    at, sweep, relaxed = filled
    chunk = whole_looks(at, sweep, relaxed.weights, EFFORT).chunk
    parts = chunk.parts(count)
    assert [n for part in parts for n in part.numbers] == list(chunk.numbers) and len(parts) <= count
    prices = relaxed_prices(relaxed.gradient, at.allowed)
    for every in (None, [(1, 2, 4)] * len(chunk.courses)):
        whole = replace(chunk, every=every)
        same(joined([answer(part, prices) for part in whole.parts(count)]), answer(whole, prices))


@pytest.mark.parametrize("cluster", [None, "dask"])
def test_the_bound_does_not_depend_on_where_the_targets_are_asked(filled, cluster: str | None) -> None:
    if cluster is not None:
        pytest.importorskip("distributed")
    at, sweep, relaxed = filled
    start = relaxed_prices(relaxed.gradient, at.allowed)
    here = whole_looks(at, sweep, relaxed.weights, EFFORT, HERE).bound(start)
    with places(2, cluster) as spread:
        there = whole_looks(at, sweep, relaxed.weights, EFFORT, spread).bound(start)
    assert there.bound == here.bound and there.prices.tobytes() == here.prices.tobytes()
    assert there.rounds == here.rounds


def pid_or_end(piece: Path, end: bool) -> int:
    """The process that keeps a piece; ends it once, as a fault of the machine would."""
    if end and not piece.exists():
        piece.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.getpid()


def always_ends(piece: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_process_that_dies_is_replaced_once(tmp_path: Path) -> None:
    with places(2) as spread:
        ask = spread.hold(pid_or_end, [tmp_path / "a", tmp_path / "b"])
        before = ask(False)
        (tmp_path / "b").touch()
        after = ask(True)  # the first one dies at it
        assert after[0] != before[0] and after[1] == before[1] and ask(False) == after
        with pytest.raises(SolveFailed, match="died twice"):
            spread.hold(always_ends, [0])()


def test_addresses_that_anybody_could_reach_are_refused() -> None:
    with pytest.raises(UsageError, match="only tls://"), places(1, "tcp://10.0.0.1:8786"):
        pass
    with places(1) as spread:
        assert spread is HERE


def test_the_command_writes_the_same_numbers_whoever_works(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bounds = []
    for number, more in enumerate([[], ["--jobs", "2"]]):
        words = ["--json", "--no-figures", "--out", str(tmp_path / str(number)), *more]
        assert run(["solve", str(ROOT / "problems" / "five_targets.yaml"), *words]) == 0
        content = json.loads(capsys.readouterr().out)
        bounds.append((content["cost"], content["lower_bound"], content["bounds"]))
    assert bounds[0] == bounds[1]
