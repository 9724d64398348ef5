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
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]

from fault_mutants import PROBLEM, Mutants  # noqa: E402  (found below the path above)

BYTES = 2**30  # that this process may hold

# the system's own functions that change files; a child dies right before its n-th call of any of them
DYING = """
import os, signal, sys
left = int(sys.argv[1])
def count():
    global left
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    left -= 1
def dying(function):
    def call(*args, **more):
        count()
        return function(*args, **more)
    return call
def opened(event, args):
    if event == "open" and args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
        count()
import pickle
from occontrol.files.run_folder import write_run
for name in ("mkdir", "rename", "replace", "symlink", "link", "unlink", "rmdir", "fsync", "write", "ftruncate"):
    setattr(os, name, dying(getattr(os, name)))
sys.addaudithook(opened)
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
        numbers = dataclasses.replace(one.numbers, cost=one.cost + 1)  # type: ignore[type-var]
        other = dataclasses.replace(one, numbers=numbers, arrays=dict(one.arrays))
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
        return Mutants(self.folder, self.problem, self.blame).run(count, self.document, self.solutions[0])


def most_held() -> int:
    """Bytes that this process has held at most; getrusage also counts what its parent held when it was started."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))
    except (OSError, StopIteration, ValueError):
        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main(arguments: list[str] | None = None) -> int:
    """Run the kinds that are asked for and print the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    for name, count in (("kills", 400), ("contests", 60), ("signals", 36), ("starts", 40), ("mutants", 5000)):
        parser.add_argument(f"--{name}", type=int, default=count)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="campaign-") as folder:
        campaign = Campaign(Path(folder), options.seed)
        done = {"calls": 0}

        def at_calls() -> int:
            done["calls"] = campaign.kills_at_calls(options.kills // 2)
            return done["calls"]

        for name, work in (
            ("kills at calls of the file system", at_calls),
            # a write has fewer calls than half of many kills: the others come at random moments
            ("kills at random moments", lambda: campaign.kills_at_moments(options.kills - done["calls"])),
            ("contests", lambda: campaign.contests(options.contests)),
            ("signals while starting", lambda: campaign.signals(options.starts, 0.6, True) if options.starts else 0),
            ("signals while solving", lambda: campaign.signals(options.signals, 4.0, True) if options.signals else 0),
            ("mutants", lambda: campaign.mutants(options.mutants) if options.mutants else 0),
        ):
            before, began = len(campaign.wrong), time.monotonic()
            tried = work()
            seconds = time.monotonic() - began
            print(f"{name}: {tried} tried, {len(campaign.wrong) - before} wrong, {seconds:.0f} s", flush=True)
        held = most_held()
        if held > BYTES:
            campaign.blame(f"{held / 2**20:.0f} MB were held")
        return int(bool(campaign.wrong))


if __name__ == "__main__":
    sys.exit(main())
