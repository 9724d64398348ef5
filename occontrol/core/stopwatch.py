"""The one clock behind `seconds` and `time_limit`: it stands still while the loops are compiled.

Numba compiles a loop when it is first called with arguments of a kind, and keeps it in a cache. Whoever runs a problem
for the first time, or on a new machine, waits for that; it says nothing about the problem, so it is counted nowhere:

    seconds() = time.perf_counter() - (time that this process has spent in `stopped`)

`core/compile_cache.py` puts every compilation, and every loading of compiled code, inside `stopped`.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_lock = threading.Lock()
_inside = 0  # how many compilations are under way: they nest, and threads compile beside each other
_since = 0.0  # perf_counter when the first of them began
_lost = 0.0  # seconds spent in those that are done
_compiling = 0
_listener: Callable[[], None] | None = None


def seconds() -> float:
    """Seconds from an arbitrary origin without those spent compiling; it never runs backwards."""
    with _lock:
        return (_since if _inside else time.perf_counter()) - _lost


@contextmanager
def stopped() -> Iterator[None]:
    """The clock stands still inside."""
    global _inside, _since, _lost
    with _lock:
        if not _inside:
            _since = time.perf_counter()
        _inside += 1
    try:
        yield
    finally:
        with _lock:
            _inside -= 1
            if not _inside:
                _lost += time.perf_counter() - _since


def compiling() -> bool:
    """Whether some loop is being compiled now, not merely loaded."""
    return _compiling > 0


def tell(listener: Callable[[], None] | None) -> None:
    """Have `listener` called when the next compilation begins, and not again.

    Parameters
    ----------
    listener : called once, without arguments; None tells nobody
    """
    global _listener
    _listener = listener


def begin() -> None:
    """A compilation begins; called by `core/compile_cache.py`."""
    global _compiling, _listener
    with _lock:
        _compiling += 1
        listener, _listener = _listener, None
    if listener is not None:
        listener()


def end() -> None:
    """A compilation is done; called by `core/compile_cache.py`."""
    global _compiling
    with _lock:
        _compiling -= 1
