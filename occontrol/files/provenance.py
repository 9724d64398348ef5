"""Where a result comes from: the machine, the libraries' threads, the command line, start and end."""

from __future__ import annotations

import os
import platform
import sys
import time
from datetime import UTC, datetime

from occontrol.core.kinds import PlainDict

STARTED = time.time()
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def provenance() -> PlainDict:
    """The content of provenance.json but for the digests of its files; times are UTC."""
    return {
        "machine": {
            "name": platform.node(),
            "system": platform.platform(),
            "processor": platform.machine(),
            "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
            "python": platform.python_version(),
        },
        "blas": _blas(),
        "threads": {name: os.environ.get(name) for name in _THREADS},
        "command": [text[:1000] for text in sys.argv[:100]],
        "folder": os.getcwd(),
        "start": _utc(STARTED),
        "end": _utc(time.time()),
    }


def _blas() -> dict[str, str]:
    import numpy as np

    try:
        found = np.show_config(mode="dicts")["Build Dependencies"]["blas"]  # type: ignore[index]
    except (TypeError, KeyError):
        return {}
    return {key: str(found[key]) for key in ("name", "version") if key in found}


def _utc(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="seconds")
