"""How long the first results take: the command line cold and warm, and what it imports."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from bench_targets import interleaved

PROBLEM = Path(__file__).parents[1] / "problems" / "scalar_on_off.yaml"
HEAVY = ("casadi", "numba", "scipy", "matplotlib")
RUN = "import sys; from occontrol.cli import main; sys.argv[0] = 'occontrol'; main()"


def _run(words: list[str], **environment: str) -> None:
    subprocess.run(
        words, env={**os.environ, **environment}, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )


def help_against_nothing(repeats: int = 7) -> dict:
    """Seconds of `occontrol --help` and of `python -c pass`, in turn, and which heavy libraries the former imported."""
    calls = {
        "help": lambda: _run([sys.executable, "-c", RUN, "--help"]),
        "nothing": lambda: _run([sys.executable, "-c", "pass"]),
    }
    seconds = interleaved(calls, repeats)
    look = f"""
import sys
from occontrol.cli import main
try:
    main(["--help"])
except SystemExit:
    pass
print("|".join(m for m in {HEAVY!r} if m in sys.modules))
"""
    said = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True).stdout.splitlines()
    ratio = median(a / b for a, b in zip(seconds["help"], seconds["nothing"], strict=True))
    both = {name: median(times) for name, times in seconds.items()}
    return {**both, "ratio": ratio, "imported": [m for m in said[-1].split("|") if m]}


def first_results() -> list[dict]:
    """Seconds of `check` and `solve scalar_on_off`, with nothing compiled yet and again."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for name, words in {
            "check scalar_on_off": ["check", str(PROBLEM)],
            "solve scalar_on_off": ["solve", str(PROBLEM), "--out", f"{folder}/run"],
        }.items():
            seconds = []
            for turn in range(4):
                started = time.perf_counter()
                if words[0] == "solve":
                    words[-1] = f"{folder}/run{turn}"
                _run([sys.executable, "-c", RUN, *words], NUMBA_CACHE_DIR=f"{folder}/{words[0]}")
                seconds.append(time.perf_counter() - started)
            found.append({"command": name, "cold": seconds[0], "warm": median(seconds[1:])})
    return found
