"""Memory is compared with what is there before anything is asked for."""

from __future__ import annotations

import pytest

from occontrol.core import memory
from occontrol.core.errors import ProblemError


def test_more_than_there_is_is_refused_with_both_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available", lambda: 3 * 2**30)
    memory.require(3 * 2**30, "a solve", "fewer intervals")
    with pytest.raises(ProblemError, match=r"a solve needs at least 4 GB of memory, 3 GB are there\n  hint: fewer"):
        memory.require(4 * 2**30, "a solve", "fewer intervals")


def test_some_memory_is_there() -> None:
    assert memory.available() is None or memory.available() > 2**20
