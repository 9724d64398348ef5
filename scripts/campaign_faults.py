#!/usr/bin/env python3
"""Real faults against the writing and reading of files, counted: kills, contests, signals, mutants.

    scripts/campaign_faults.py --kills 400 --contests 60 --signals 36 --starts 40 --mutants 5000

Writers are killed at a random moment or at their n-th call of the file system; two runs contend for one folder;
signals come while solving and while starting; problem files, schedules, measurements, run folders and tables are
mutated. Each kind says how many were tried and what went wrong; the exit code is 1 when anything did. Everything
happens in a temporary folder, and a snapshot of what lies around the run folder must not change.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

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
SECONDS, BYTES = 20.0, 2**30

# the system's own functions that change files; a child dies right before its n-th call of any of them
DYING = """
import os, signal, sys
left = int(sys.argv[1])
def dying(function):
    def call(*args, **more):
        global left
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        left -= 1
        return function(*args, **more)
    return call
for name in ("open", "mkdir", "rename", "replace", "symlink", "link", "unlink", "rmdir", "fsync", "write", "ftruncate"):
    setattr(os, name, dying(getattr(os, name)))
import pickle
from occontrol.files.run_folder import write_run
document, solution = pickle.load(open(sys.argv[2], "rb"))
write_run(sys.argv[3], document, solution)
"""
WRITING = """
import pickle, sys
from occontrol.files.run_folder import write_run
document, solutions = pickle.load(open(sys.argv[1], "rb"))
for i in range(int(sys.argv[3])):
    write_run(sys.argv[2], document, solutions[i % 2])
"""


class Campaign:
    """A temporary folder with a solved problem, and the count of what went wrong."""

    def __init__(self, folder: Path, seed: int):
        import dataclasses
        import pickle

        import occontrol
        from occontrol.api import document

        self.folder, self.random = folder, random.Random(seed)
        self.wrong: list[str] = []
        self.problem = folder / "radars.yaml"
        self.problem.write_text(PROBLEM)
        problem = occontrol.read_problem(self.problem)
        one = occontrol.solve(problem)
        other = dataclasses.replace(one, result={**one.result, "cost": one.cost + 1}, arrays=dict(one.arrays))
        other.arrays["switching"] = other.arrays["switching"] + 1  # type: ignore[index]
        self.solutions, self.document = (one, other), document(problem)
        for name, content in (("one", one), ("other", other)):
            with open(folder / f"{name}.pickle", "wb") as file:
                pickle.dump((self.document, dataclasses.replace(content, problem=None)), file)
        with open(folder / "both.pickle", "wb") as file:
            pickle.dump((self.document, [dataclasses.replace(s, problem=None) for s in self.solutions]), file)
        self.environment = {**os.environ, "PYTHONPATH": str(ROOT)}

    def start(self, *words: object, **more: object) -> subprocess.Popen:
        """A Python of ours with these words."""
        return subprocess.Popen([sys.executable, *map(str, words)], env=self.environment, **more)  # type: ignore[call-overload]

    def blame(self, what: str) -> None:
        """Note one thing that went wrong."""
        self.wrong.append(what)
        print(f"  WRONG: {what}", flush=True)

    def sound(self, folder: Path, where: str) -> bool:
        """Whether the folder shows one whole result: to read_run, and to whoever opens the paths that he knows."""
        from occontrol.api import read_run
        from occontrol.core.errors import OccontrolError

        try:
            _, solution = read_run(folder)
        except OccontrolError as error:
            self.blame(f"{where}: {error}")
            return False
        cost = json.loads((folder / "result.json").read_text())["cost"]
        if cost != solution.cost or cost not in [s.cost for s in self.solutions]:
            self.blame(f"{where}: a mixture")
        return True

    def swept(self, folder: Path, where: str) -> None:
        """The next write leaves nothing behind and at most one earlier result."""
        from occontrol.files.run_folder import write_run

        write_run(folder, self.document, self.solutions[0])
        left = [str(p) for p in folder.rglob("*") if ".writing-" in p.name]
        runs = [p.name for p in (folder / ".runs").iterdir() if p.is_dir()]
        if left or len(runs) > 2:
            self.blame(f"{where}: left {left} {runs}")

    def kills_at_calls(self, count: int) -> int:
        """Kill a writer right before its n-th call that changes files, for every n or `count` of them."""
        from occontrol.files.run_folder import write_run

        base, done = self.folder / "calls", 0
        for n in self.spread(count):
            shutil.rmtree(base, ignore_errors=True)
            write_run(base / "run", self.document, self.solutions[0])
            (base / "mine.txt").write_text("mine")
            child = self.start("-c", DYING, n, self.folder / "other.pickle", base / "run")
            ended = child.wait() == 0
            done += 1
            if self.sound(base / "run", f"killed at call {n}"):
                self.swept(base / "run", f"killed at call {n}")
            if sorted(p.name for p in base.iterdir()) != ["mine.txt", "run"]:
                self.blame(f"killed at call {n}: the parent changed")
            if ended:
                break  # it has fewer calls than that
        return done

    def spread(self, count: int) -> Iterator[int]:
        """0, 1, 2, .. or, for few, numbers further and further apart."""
        n = 0
        for i in range(count):
            yield n
            n += 1 if count >= 100 else 1 + i * 100 // (count * 12)

    def kills_at_moments(self, count: int) -> int:
        """Kill a writer that writes again and again, at random moments."""
        from occontrol.files.run_folder import write_run

        folder = self.folder / "moments"
        write_run(folder, self.document, self.solutions[0])
        for i in range(count):
            child = self.start("-c", WRITING, self.folder / "both.pickle", folder, 10**6)
            time.sleep(self.random.uniform(0.4, 1.4))
            child.kill()
            child.wait()
            if self.sound(folder, f"kill {i}"):
                self.swept(folder, f"kill {i}")
        return count

    def contests(self, count: int) -> int:
        """Two writers in one folder: one of them is refused at once, or both results appear one after the other."""
        from occontrol.api import read_run

        for i in range(count):
            folder = self.folder / f"contest-{i}"
            pair = [
                self.start("-c", WRITING, self.folder / "both.pickle", folder, 3, stderr=subprocess.PIPE, text=True)
                for _ in range(2)
            ]
            reads = 0
            while any(child.poll() is None for child in pair):
                if (folder / "current").exists():
                    read_run(folder)
                    reads += 1
            said = [child.communicate()[1] for child in pair]
            if not any(child.returncode == 0 for child in pair):
                self.blame(f"contest {i}: nobody finished: {said}")
            for child, text in zip(pair, said, strict=True):
                if child.returncode and "in use by pid" not in text:
                    self.blame(f"contest {i}: {text[-300:]}")
            self.sound(folder, f"contest {i}")
            shutil.rmtree(folder)
        return count

    def signals(self, count: int, latest: float, better: bool) -> int:
        """SIGINT and SIGTERM up to `latest` seconds after the start: one line, right code, the better result kept."""
        from occontrol.api import read_run

        folder = self.folder / "signals"
        program = "from occontrol.cli import main; main()"
        words = ["solve", self.problem, "--out", folder, "--no-figures", "--method", "schedule"]
        self.start("-c", program, *words, stdout=subprocess.DEVNULL).wait()
        before = read_run(folder)[1].certificate.relative_gap  # type: ignore[union-attr]
        for i in range(count):
            number = (signal.SIGINT, signal.SIGTERM)[i % 2]
            # from the moment on at which the program is entered; before it the interpreter itself starts
            told = program.replace("; ", "; import sys; sys.stderr.write('up\\n'); sys.stderr.flush(); ")
            streams = {"stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL, "text": True}
            child = self.start("-c", told, *words, **streams)
            assert child.stderr is not None
            child.stderr.readline()
            time.sleep(0.002 + self.random.uniform(0, latest))
            child.send_signal(number)
            text = child.communicate()[1]
            if child.returncode not in (0, 128 + number) or "Traceback" in text or "unexpected" in text:
                self.blame(f"signal {i}: code {child.returncode}: {text[-300:]}")
            if child.returncode == 128 + number and not text.strip():
                self.blame(f"signal {i}: silence")
            if better and read_run(folder)[1].certificate.relative_gap > before + 1e-12:  # type: ignore[union-attr]
                self.blame(f"signal {i}: a worse result replaced the better one")
        return count

    def mutants(self, count: int) -> int:
        """Mutated files of every kind through the command line of this process."""
        from occontrol.files.run_folder import write_run

        base = self.folder / "mutants"
        base.mkdir(exist_ok=True)
        write_run(base / "run", self.document, self.solutions[0])
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
                np.lib.format.write_array_header_1_0(
                    header, {"descr": "<f8", "fortran_order": False, "shape": shape}
                )
                archive.writestr("v.npy", header.getvalue() + bytes(80))
                archive.writestr("t.npy", npy(times))
            content = buffer.getvalue()
        (base / "t.npz").write_bytes(content)
        text = PROBLEM.replace("C: [[1, 0]]", "C: {file: t.npz, times: t, values: v}")
        (base / "t.yaml").write_text(text)
        return ["check", str(base / "t.yaml")]


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


def main(arguments: list[str] | None = None) -> int:
    """Run the kinds that are asked for and print the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    for name, count in (("kills", 400), ("contests", 60), ("signals", 36), ("starts", 40), ("mutants", 5000)):
        parser.add_argument(f"--{name}", type=int, default=count)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="campaign-") as folder:
        campaign = Campaign(Path(folder), options.seed)
        for name, work in (
            ("kills at calls of the file system", lambda: campaign.kills_at_calls(options.kills // 2)),
            ("kills at random moments", lambda: campaign.kills_at_moments(options.kills - options.kills // 2)),
            ("contests", lambda: campaign.contests(options.contests)),
            ("signals while starting", lambda: campaign.signals(options.starts, 0.6, True) if options.starts else 0),
            ("signals while solving", lambda: campaign.signals(options.signals, 4.0, True) if options.signals else 0),
            ("mutants", lambda: campaign.mutants(options.mutants) if options.mutants else 0),
        ):
            before, began = len(campaign.wrong), time.monotonic()
            tried = work()
            seconds = time.monotonic() - began
            print(f"{name}: {tried} tried, {len(campaign.wrong) - before} wrong, {seconds:.0f} s", flush=True)
        held = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        if held > BYTES:
            campaign.blame(f"{held / 2**20:.0f} MB were held")
        return int(bool(campaign.wrong))


if __name__ == "__main__":
    sys.exit(main())
