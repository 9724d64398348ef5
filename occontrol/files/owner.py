"""Who writes: this process as pid, start and boot, in a form that fits into a file name; and whether it still lives."""

from __future__ import annotations

import os
import re
import secrets
from functools import lru_cache
from pathlib import Path

_BOOT = Path("/proc/sys/kernel/random/boot_id")
MARK = re.compile(r"\.writing-(\d{1,10})-([0-9a-f]{8})-([0-9a-f]{8})$")


@lru_cache(maxsize=1)
def boot() -> str:
    """Eight hexadecimal digits that change when the machine starts anew; zeros where they cannot be known."""
    try:
        return _BOOT.read_text(encoding="ascii").strip()[:8]
    except (OSError, ValueError):
        return "0" * 8


def mark() -> str:
    """The end of the name of something unfinished, '.writing-PID-BOOT-RANDOM'; another one each time."""
    return f".writing-{os.getpid()}-{boot()}-{secrets.token_hex(4)}"


def alive(pid: int, booted: str) -> bool:
    """Whether the process that called itself so may still be at work; in doubt it is.

    Parameters
    ----------
    pid : its number
    booted : what `boot` said to it
    """
    if booted != boot():
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def left_by_the_dead(name: str) -> bool:
    """Whether a file of this name is the unfinished work of a process that is no more.

    Parameters
    ----------
    name : without folder
    """
    found = MARK.search(name)
    return found is not None and name.startswith(".") and not alive(int(found[1]), found[2])
