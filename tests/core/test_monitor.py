"""Children of a Monitor: interruption goes through, limits and clocks do not."""


import pytest

from occontrol.core import stopwatch
from occontrol.core.monitor import Monitor


def test_the_limit_of_one_child_never_reaches_parent_or_sister():
    parent = Monitor(stage="compare")
    first = parent.child(time_limit=0.0)
    first.stage = "relaxation"
    first.started -= 1.0
    second = parent.child()
    assert first.timed_out and first.stop
    assert not parent.stop and not second.stop
    assert parent.time_limit is None and second.time_limit is None
    assert parent.stage == "compare" and second.stage == "compare"


@pytest.mark.parametrize(
    ("outer", "inner", "tighter"), [(1e5, 3e4, 3e4), (3e4, 1e5, 3e4), (3e4, None, 3e4), (None, 3e4, 3e4)]
)
def test_the_tighter_limit_counts_from_now_on(outer, inner, tighter):
    parent = Monitor(time_limit=outer)
    child = parent.child(inner)
    # limits of hours, so that the seconds that a busy machine takes for this do not matter
    assert child.time_limit == pytest.approx(tighter, abs=1e3)
    assert child.seconds < 1e3 and parent.time_limit == outer
    late = Monitor(time_limit=outer, started=stopwatch.seconds() - 2e4).child(inner)
    assert late.time_limit == pytest.approx(min(x for x in (inner, outer and outer - 2e4) if x is not None), abs=1e3)


def test_a_limit_that_the_parent_gets_later_holds_for_the_child():
    parent = Monitor()
    child = parent.child(100.0)
    parent.time_limit = -1.0
    assert child.timed_out and child.stop


@pytest.mark.parametrize("silent", [False, True])
def test_an_interruption_reaches_everybody_from_everywhere(silent):
    parent = Monitor()
    child = parent.child(silent=silent)
    grandchild, sister = child.child(), parent.child()
    parent.interrupted = 2
    assert (child.interrupted, grandchild.interrupted, sister.stop) == (2, 2, True)
    other = Monitor()
    other.child().child(silent=silent).interrupted = 15  # Ipopt's own handler sets it where it runs
    assert other.interrupted == 15 and other.stop
    assert Monitor(interrupted=2).child(silent=silent).stop


def test_records_go_up_unless_the_child_is_silent():
    seen = []
    parent = Monitor(show=seen.append, started=stopwatch.seconds() - 1e5)
    child = parent.child()
    child.stage = "polish"
    child.child().report(3, 2.0, 1.0, nodes=7)
    parent.child(silent=True).report(4, 2.0, 1.0)
    child.silent().report(5, 2.0, 1.0)
    assert [(r["iteration"], r["stage"], r["nodes"]) for r in seen] == [(3, "polish", 7)]
    assert parent.history == seen and seen[0]["seconds"] >= 1e5  # by the parent's clock
    assert len(child.history) == 1 and child.history[0]["seconds"] < 5e4
