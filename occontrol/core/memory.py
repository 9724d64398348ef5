"""How much memory this process may still have, and a refusal with numbers before any of it is asked for."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from occontrol.core.errors import Mistake, ProblemError

_MEMORY = Path("/proc/meminfo")
_STATUS = Path("/proc/self/status")
_GROUPS = (
    (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current")),
    (Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"), Path("/sys/fs/cgroup/memory/memory.usage_in_bytes")),
)


def available() -> int | None:
    """Bytes that this process may still allocate: free memory, its own limit, its container's; None if unknown."""
    bounds = []
    with suppress(OSError, ValueError):
        bounds.append(_field(_MEMORY, "MemAvailable:"))
    with suppress(ImportError, OSError, ValueError):
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            bounds.append(limit - _field(_STATUS, "VmSize:"))
    for limit_file, used_file in _GROUPS:
        with suppress(OSError, ValueError):
            bounds.append(int(limit_file.read_text()) - int(used_file.read_text()))
    return max(0, min(bounds)) if bounds else None


def require(need: int, what: str, hint: str) -> None:
    """ProblemError when `need` bytes are more than this process may have.

    Parameters
    ----------
    need : bytes
    what : needs them
    hint : what to do
    """
    there = available()
    if there is not None and need > there:
        raise ProblemError(Mistake((), f"{what} needs at least {size(need)} of memory, {size(there)} are there", hint))


def size(count: float) -> str:
    """A number of bytes as text.

    Parameters
    ----------
    count : bytes
    """
    for unit, power in (("TB", 40), ("GB", 30), ("MB", 20)):
        if count >= 2**power:
            return f"{count / 2**power:.3g} {unit}"
    return f"{count / 1024:.3g} kB"


def _field(path: Path, name: str) -> int:
    """A number of kB in a file of the kernel, in bytes."""
    for line in path.read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith(name):
            return 1024 * int(line.split()[1])
    raise ValueError(name)
