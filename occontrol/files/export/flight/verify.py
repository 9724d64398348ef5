"""Whether a folder of flight code is what its run gives and computes what Python does, by the compilers there are."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from occontrol.files.export.flight.text import filled, template

COMPILERS = ("gcc", "clang", "cc")
FLAGS = ("-std=c99", "-O2")
CROSS = ("arm-linux-gnueabihf-gcc", "qemu-arm")  # a compiler for another processor, and what runs its programs here
SECONDS = 300.0  # for a compiler or a self-test


@dataclass
class Verification:
    """What was tried and how it ended.

    Parameters
    ----------
    lines : (what, how it ended), in the order in which it was tried
    differs : whether anything was not as it should be
    """

    lines: list[tuple[str, str]] = field(default_factory=list)
    differs: bool = False

    def add(self, what: str, result: str, good: bool = True) -> None:
        """Note that `what` ended with `result`, which was `good` or not."""
        self.lines.append((what, result))
        self.differs |= not good


def verify(folder: Path, texts: Mapping[str, str], prefix: str, has_filter: bool = True) -> Verification:
    """Compare the files of a folder with what should be written, compile them, run the self-test.

    Parameters
    ----------
    folder : with flight code
    texts : {path: text} that the run gives now
    prefix : of the names in C
    has_filter : whether there is a step whose time can be measured
    """
    found = Verification()
    _compare(folder, texts, found)
    tried: set[Path] = set()
    missing = []
    for name in COMPILERS:
        path = shutil.which(name)
        if path is None:
            missing.append(name)
        elif Path(path).resolve() not in tried:
            tried.add(Path(path).resolve())
            _try(folder, prefix, [path], [], name, found)
            if has_filter and len(tried) == 1 and not found.differs:
                _measure(folder, prefix, path, found)
    cross, emulator = map(shutil.which, CROSS)
    if cross and emulator:
        _try(folder, prefix, [cross, "-static"], [emulator], " and ".join(CROSS), found)
    else:
        missing += [name for name, path in zip(CROSS, (cross, emulator), strict=True) if path is None]
    if missing:
        found.add("not tried", f"{', '.join(missing)}: not found on this computer")
    if not tried:
        found.add("compiled", "nothing: no compiler was found")
    return found


def _compare(folder: Path, texts: Mapping[str, str], found: Verification) -> None:
    different = []
    for name, text in texts.items():
        try:
            same = (folder / name).read_bytes() == text.encode()
        except OSError:
            same = False
        if not same:
            different.append(name)
    if different:
        found.add("files", f"DIFFERENT from what the run gives: {', '.join(different)}", good=False)
    else:
        found.add("files", f"{len(texts)} files are what the run gives")


def _try(
    folder: Path, prefix: str, compiler: list[str], emulator: list[str], name: str, found: Verification
) -> None:
    with tempfile.TemporaryDirectory() as place:
        program = Path(place) / "selftest"
        done = _built(folder, prefix, compiler, folder / "host" / "selftest.c", program)
        if done:
            found.add(name, f"FAILED to compile: {done}", good=False)
            return
        result = _run([*emulator, str(program)])
        text = result.stdout.strip() or f"ended with {result.returncode}"
        found.add(name, text, good=result.returncode == 0)


def _measure(folder: Path, prefix: str, compiler: str, found: Verification) -> None:
    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / "timing.c"
        text = filled(template("timing.c"), prefix, {})
        host = (folder / "host").resolve()
        source.write_text(text.replace('"../', f'"{host.parent}/').replace('"vectors.h"', f'"{host}/vectors.h"'))
        program = Path(place) / "timing"
        if _built(folder, prefix, [compiler], source, program):
            return
        words = _run([str(program)]).stdout.split()
        if len(words) == 2:
            found.add("time", f"{words[0]} ns a step; {words[1]} ns after a value was missing")


def _built(folder: Path, prefix: str, compiler: list[str], main: Path, program: Path) -> str:
    """The first line that a compiler complains with; empty where it made the program."""
    sources = [str(folder / f"{prefix}_{part}.c") for part in ("filter", "tables")]
    done = _run([*compiler, *FLAGS, "-o", str(program), *sources, str(main)])
    return "" if done.returncode == 0 else ([*done.stderr.strip().splitlines(), "no message"])[0]


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, errors="replace")
    except (OSError, subprocess.TimeoutExpired) as error:
        return subprocess.CompletedProcess(command, 1, "", str(error))
