"""A cache of compiled code that is damaged, or that cannot be written, costs time and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODULE = "from numba import njit\n\n\n@njit(cache=True)\ndef twice(x):\n    return 2 * x\n"
USE = "import occontrol\nfrom occontrol.core import compile_cache\nimport twice\nprint(twice.twice(3))\n"
USE += "print(compile_cache.remark())\n"
UNWRITABLE = """\
from numba.core import caching
def no(self):
    raise OSError(30, "Read-only file system")
caching._CacheLocator.ensure_cache_path = no
"""


def said(folder: Path, before: str = "") -> list[str]:
    """The lines that a fresh process prints."""
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{folder}", "TMPDIR": str(folder)}
    environment.pop("NUMBA_CACHE_DIR", None)  # the cache is looked for beside the module
    done = subprocess.run(
        [sys.executable, "-c", before + USE], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()


def test_damage_and_missing_permission_cost_a_compilation(tmp_path: Path) -> None:
    (tmp_path / "twice.py").write_text(MODULE)
    assert said(tmp_path) == ["6", ""]
    index = next((tmp_path / "__pycache__").glob("*.nbi"))
    index.write_bytes(b"")  # as after a full disk: EOFError, which is not Ctrl-C
    assert said(tmp_path) == ["6", "compiled code could not be read and is compiled anew (EOFError)"]
    assert said(tmp_path) == ["6", ""]  # the damage is mended
    lines = said(tmp_path, "import occontrol\n" + UNWRITABLE)
    assert lines[0] == "6" and "HOME can be written: compiled code is kept in" in lines[1]
    assert (next(tmp_path.glob("occontrol-compiled-*")).stat().st_mode & 0o777) == 0o700
