"""Mutated problem files, schedules, measurements, run folders and tables, for campaign_faults.py."""

from __future__ import annotations

import io
import json
import random
import shutil
import time
import zipfile
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

PROBLEM = """\
family: athans
name: two radars
horizon: {start: 0, end: 4, intervals: 40, predict_at: 5}
plant:
  A: [[0, 1], ["-(1+0.2*sin(t))", -0.4]]
  noise: [[0, 0], [0, 0.5]]
  initial: {mean: [1, 0], covariance: {diag: [5, 5]}}
sensors:
  - {name: range, C: [[1, 0]], noise: [[0.1]], cost: 2.0, windows: [[0, 2], [3, 4]]}
  - {name: doppler, C: [[0, 1]], noise: [[0.4]], cost: 0.5}
  - idle
objective: {cost_weight: 0.1, output: [[1, 0]]}
method: {name: greedy}
"""
CODES = {0, 2, 3, 4, 5, 7, 8}  # what a user may meet; 6 is a failure of the numerics, and none of these files is one
SECONDS = 20.0  # that one command may take

PIECES = [b"\0", b"\n", b"\t", b"-", b": ", b"[", b"]", b"{", b"}", b"1e999", b"nan", b"\xff\xfe", b"null", b"''", b'"',
          b"9" * 40, b"../x", b"&a ", b"*a", b"!!int ", b"sin(t)", "\uff53\uff49\uff4e(t)".encode(), b"idle",
          b"-1", b","]  # fmt: skip


def npy(array: object) -> bytes:
    """An array as the bytes of a .npy file."""
    import numpy as np

    buffer = io.BytesIO()
    np.save(buffer, array)  # type: ignore[arg-type]
    return buffer.getvalue()


def in_process(words: list[str]) -> tuple[int, float, str]:
    """Exit code, seconds and messages of one command in this process."""
    from occontrol.cli import run

    out, err = io.StringIO(), io.StringIO()
    began = time.process_time()
    with redirect_stdout(out), redirect_stderr(err):
        code = run(words)
    return code, time.process_time() - began, err.getvalue()


class Mutants:
    """Mutated files of every kind, run through the command line of this process.

    Parameters
    ----------
    folder : a temporary one, in which `problem` lies
    problem : a problem file with PROBLEM
    blame : called with what went wrong
    """

    def __init__(self, folder: Path, problem: Path, blame: Callable[[str], None]):
        self.folder, self.problem, self.blame = folder, problem, blame
        self.random = random.Random()

    def run(self, count: int, document: dict[str, Any], solution: Any) -> int:
        """`count` mutants in turn; the run folders among them are of `solution` to the problem `document`."""
        from occontrol.files.run_folder import write_run

        base = self.folder / "mutants"
        base.mkdir(exist_ok=True)
        write_run(base / "run", document, solution)
        kinds: list[Callable[[Path], list[str]]] = [
            self.problem_mutant, self.schedule_mutant, self.measurement_mutant, self.run_mutant, self.table_mutant,
        ]  # fmt: skip
        outside = sorted(str(p) for p in base.parent.iterdir())
        for i in range(count):
            self.random.seed(i)
            words = kinds[i % len(kinds)](base)
            code, seconds, text = in_process(words)
            where = f"mutant {i} ({kinds[i % len(kinds)].__name__})"
            if code not in CODES:
                self.blame(f"{where}: code {code}: {text[-300:]}")
            if seconds > SECONDS:
                self.blame(f"{where}: {seconds:.1f} s")
        if sorted(str(p) for p in base.parent.iterdir()) != outside:
            self.blame("mutants: something appeared outside of their folder")
        return count

    def mutated(self, content: bytes) -> bytes:
        """A few random edits of bytes."""
        for _ in range(self.random.randint(1, 4)):
            at, kind = self.random.randrange(len(content) + 1), self.random.random()
            cut = self.random.choice((0, 1, 1, 3, 20))
            piece = self.random.choice(PIECES) if kind < 0.7 else bytes([self.random.randrange(256)])
            content = content[:at] + piece + content[at + cut :]
        return content

    def problem_mutant(self, base: Path) -> list[str]:
        """A problem file."""
        (base / "p.yaml").write_bytes(self.mutated(PROBLEM.encode()))
        return ["check", str(base / "p.yaml")]

    def schedule_mutant(self, base: Path) -> list[str]:
        """A schedule in CSV or JSON."""
        if self.random.random() < 0.5:
            content, name = b"start,end,sensors\n0,2,range\n2,4,doppler\n", "s.csv"
        else:
            content = b'[{"start": 0, "end": 2, "sensors": ["range"]}, {"start": 2, "end": 4, "sensors": ["idle"]}]'
            name = "s.json"
        (base / name).write_bytes(self.mutated(content))
        return ["certify", str(self.problem), str(base / name)]

    def measurement_mutant(self, base: Path) -> list[str]:
        """A measurement file."""
        (base / "m.csv").write_bytes(self.mutated(b"t,sensor,z1\n0.1,range,0.5\n0.2,doppler,-0.1\n"))
        return ["filter", str(base / "run"), str(base / "m.csv"), "--out", str(base / "e.csv"), "--no-figures"]

    def run_mutant(self, base: Path) -> list[str]:
        """One file of a run folder, its digest mended so that the damage is met behind it."""
        import hashlib

        damaged = base / "damaged"
        shutil.rmtree(damaged, ignore_errors=True)
        shutil.copytree((base / "run" / "current").resolve(), damaged)
        name = self.random.choice(("problem.json", "arrays.npz", "result.json", "arrays.npz"))
        (damaged / name).write_bytes(self.mutated((damaged / name).read_bytes()))
        if name != "result.json":
            content = json.loads((damaged / "result.json").read_text())
            content["files"][name] = "sha256:" + hashlib.sha256((damaged / name).read_bytes()).hexdigest()
            (damaged / "result.json").write_text(json.dumps(content))
        words = self.random.choice((["export", str(damaged), "--to", "csv", "--out", str(base / "csv")],
                                    ["export", str(damaged), "--to", "npz", "--out", str(base / "x.npz")],
                                    ["show", str(damaged)]))  # fmt: skip
        return list(words)

    def table_mutant(self, base: Path) -> list[str]:
        """A table of a time-varying C."""
        import numpy as np

        times = np.linspace(0, 4, 5)
        np.savez(base / "t.npz", t=times, v=np.ones((5, 1, 2)))
        content = self.mutated((base / "t.npz").read_bytes())
        if self.random.random() < 0.3:  # a header that claims more than there is
            buffer = io.BytesIO()
            with zipfile.ZipFile(buffer, "w") as archive:
                header = io.BytesIO()
                shape = self.random.choice(((10**9, 1, 2), (5, 1, 10**9), (5, 10**5, 2), (-1, 1, 2)))
                np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
                archive.writestr("v.npy", header.getvalue() + bytes(80))
                archive.writestr("t.npy", npy(times))
            content = buffer.getvalue()
        (base / "t.npz").write_bytes(content)
        text = PROBLEM.replace("C: [[1, 0]]", "C: {file: t.npz, times: t, values: v}")
        (base / "t.yaml").write_text(text)
        return ["check", str(base / "t.yaml")]
