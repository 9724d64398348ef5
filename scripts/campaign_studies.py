"""Kill what works at a study at random moments and count what is torn, lost or done twice.

    python scripts/campaign_studies.py --kills 50 --tasks 300 --engine local|dask|work

Each round starts `occontrol sweep` (or `work`) on what is left, waits for a random time and kills a worker, the parent
or, with Dask, the scheduler. A result counts as torn when its folder cannot be read as a run. In the end the study is
swept once more without a kill; every task must then have exactly one result, and the arrays must be those of a study
that nobody disturbed, byte for byte.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import occontrol as oc
from occontrol.studies.folder import StudyFolder

BASE = """\
family: athans
name: thermometer
horizon: {start: 0, end: 4, intervals: INTERVALS}
plant: {A: [[-0.3, 1], [0, -0.1]], noise: {diag: [0.2, 0.1]}, initial: {covariance: {diag: [2, 1]}}}
sensors:
  - {name: fine, C: [[1, 0]], noise: [[0.2]], cost: 0.4}
  - {name: slow, C: [[0, 1]], noise: [[0.1]], cost: 0.3}
  - idle
objective: {cost_weight: 0.1, output: [[1, 0]]}
"""


def main() -> None:
    """Parse, run, print one line of figures; exit 1 when anything is torn, lost or different."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--tasks", type=int, default=300)
    parser.add_argument("--intervals", type=int, default=60)
    parser.add_argument("--engine", choices=("local", "dask", "work"), default="local")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as home:
        (Path(home) / "base.yaml").write_text(BASE.replace("INTERVALS", str(options.intervals)))
        text = "base: base.yaml\nvary:\n  objective.cost_weight: {from: 0.01, to: 1, points: COUNT, scale: log}\n"
        for name in ("shaken", "quiet"):
            (Path(home) / f"{name}.yaml").write_text(text.replace("COUNT", str(options.tasks)))
        print(_campaign(Path(home), options, rng))


def _campaign(home: Path, options: argparse.Namespace, rng: random.Random) -> str:
    shaken, quiet = StudyFolder(home / "shaken"), StudyFolder(home / "quiet")
    began = time.monotonic()
    _start(quiet.path, "local", 2).wait()
    whole = time.monotonic() - began
    killed = {"worker": 0, "parent": 0, "scheduler": 0}
    torn = 0
    for _ in range(options.kills):
        if _done(shaken) == options.tasks:
            torn += _torn(shaken)
            shaken = StudyFolder(home / f"shaken{sum(killed.values())}")
            (home / f"{shaken.path.name}.yaml").write_text((home / "shaken.yaml").read_text())
        process = _start(shaken.path, options.engine, 2)
        time.sleep(rng.uniform(0.5, 2.0 + whole / 6))
        victim = rng.choice(["worker", "parent"] + ["scheduler"] * (options.engine == "dask"))
        if _kill(process.pid, victim, rng):
            killed[victim] += 1
        if victim == "worker":
            time.sleep(rng.uniform(0, 1))
        process.kill()
        process.wait()
        time.sleep(1.2)  # the workers end with their parent
    code = _start(shaken.path, "local", 2).wait()
    torn += _torn(shaken)
    _, entries = shaken.read()
    lost = [e.identity for e in entries if not shaken.done(e.identity)]
    for identity in lost:
        print(f"lost: {identity}: {shaken.failures(identity) or 'never tried'}")
    kept = [e.identity for e in entries if e.identity not in lost]
    different = sum(_arrays(shaken, identity) != _arrays(quiet, identity) for identity in kept)
    left = [p.name for p in (shaken.path / "results").iterdir() if p.name.startswith(".")]
    same = (shaken.path / "table.csv").read_bytes() == (quiet.path / "table.csv").read_bytes()
    if torn or lost or different or left or code or not same:
        print(f"FAILED: torn {torn}, lost {len(lost)}, different {different}, left {left}, code {code}, table {same}")
        sys.exit(1)
    return (
        f"{options.engine}: {sum(killed.values())} kills {killed}; {len(entries)} tasks: 0 torn, 0 lost, 0 different; "
        f"undisturbed {whole:.1f} s"
    )


def _start(folder: Path, engine: str, jobs: int) -> subprocess.Popen:
    study = str(folder.with_suffix(".yaml"))
    if engine == "work" and (folder / "study.json").exists():
        words = ["work", str(folder), "--part", "0/1"]
    else:
        words = ["sweep", study, "--jobs", str(jobs), "--no-figures"]
        words += ["--cluster", "dask"] if engine == "dask" else []
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    return subprocess.Popen([sys.executable, "-m", "occontrol", *words], **quiet)


def _children(pid: int) -> list[int]:
    try:
        found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return []
    own = [int(word) for word in found]
    return own + [below for child in own for below in _children(child)]


def _kill(pid: int, victim: str, rng: random.Random) -> bool:
    if victim == "parent" or victim == "scheduler":  # Dask's local scheduler lives in the parent
        os.kill(pid, signal.SIGKILL)
        return True
    workers = [child for child in _children(pid) if b"resource_tracker" not in _words_of(child)]
    if not workers:
        return False
    os.kill(rng.choice(workers), signal.SIGKILL)
    return True


def _words_of(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def _done(folder: StudyFolder) -> int:
    results = folder.path / "results"
    return sum(not p.name.startswith(".") for p in results.iterdir()) if results.is_dir() else 0


def _torn(folder: StudyFolder) -> int:
    count = 0
    for path in (folder.path / "results").iterdir():
        if not path.name.startswith("."):
            try:
                oc.read_run(path)
            except Exception as error:
                print(f"torn: {path}: {error}")
                count += 1
    return count


def _arrays(folder: StudyFolder, identity: str) -> bytes:
    return (folder.result_folder(identity) / "arrays.npz").read_bytes()


if __name__ == "__main__":
    main()
