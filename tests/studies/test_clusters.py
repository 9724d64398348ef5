"""SLURM arrays under bash with SLURM's variable, Dask on this machine, and addresses that are refused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from occontrol.core.errors import UsageError
from occontrol.studies.engines.dask import check_address
from occontrol.studies.folder import StudyFolder
from tests.studies.study_texts import write_study


def run(*words: str, **variables: str) -> subprocess.CompletedProcess:
    """A command in a process of its own."""
    return subprocess.run(
        list(words), capture_output=True, text=True, timeout=300, env={**os.environ, **variables}, check=False
    )


def occontrol(*words: str) -> subprocess.CompletedProcess:
    """The command line."""
    return run(sys.executable, "-m", "occontrol", *words)


@pytest.mark.slow
def test_the_elements_of_a_job_array_do_the_study_between_them(tmp_path: Path) -> None:
    home = tmp_path / "a folder with 'quotes' and spaces"
    home.mkdir()
    study = write_study(home)
    written = occontrol("sweep", str(study), "--cluster", "slurm-array", "--tasks-per-job", "3")
    assert written.returncode == 0, written.stderr
    assert "sbatch --array=0-1 " in written.stdout
    folder = StudyFolder(home / "study")
    _, entries = folder.read()
    script = str(folder.path / "slurm.sh")
    lone = run("bash", script)
    assert lone.returncode != 0 and "start it with sbatch --array" in lone.stderr
    first = run("bash", script, SLURM_ARRAY_TASK_ID="0")
    assert first.returncode == 0, first.stderr
    assert [folder.done(e.identity) for e in entries] == [True, False] * 3
    assert occontrol("sweep", str(study), "--status").returncode == 5
    assert run("bash", script, SLURM_ARRAY_TASK_ID="1").returncode == 0
    collected = occontrol("sweep", str(study), "--collect", "--no-figures")
    assert collected.returncode == 0, collected.stderr
    assert (folder.path / "table.csv").read_text().count("certified") == 6


@pytest.mark.parametrize("part", ["2/2", "-1/2", "x", "1/0", "1"])
def test_a_part_that_is_none_is_refused(tmp_path: Path, part: str) -> None:
    found = occontrol("work", str(tmp_path), "--part", part) if part == "2/2" else None
    if found is not None:
        assert found.returncode == 2 and "--part 2/2 is not I/N" in found.stderr
    from occontrol.cli.sweep import _part

    with pytest.raises(UsageError, match=r"I = 0 \.\. N-1"):
        _part(part)


@pytest.mark.parametrize("address", ["tcp://head:8786", "ucx://head:1", "tls://"])
def test_an_address_without_certificates_is_refused_with_the_reason(address: str) -> None:
    with pytest.raises(UsageError, match="whoever reaches an open scheduler can run any program on it"):
        check_address(address)


def test_an_engine_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="slurm-array, dask, or tls://HOST:PORT"):
        check_address("ray")


@pytest.mark.slow
def test_dask_finds_what_the_processes_of_this_machine_find(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    study = write_study(tmp_path)
    here = occontrol("sweep", str(study), "--jobs", "2", "--no-figures", "--out", str(tmp_path / "here"))
    there = occontrol("sweep", str(study), "--cluster", "dask", "--no-figures", "--out", str(tmp_path / "there"))
    assert (here.returncode, there.returncode) == (0, 0), there.stderr
    tables = [(tmp_path / name / "table.csv").read_bytes() for name in ("here", "there")]
    assert tables[0] == tables[1]
    for path in (tmp_path / "here" / "results").iterdir():
        other = tmp_path / "there" / "results" / path.name / "arrays.npz"
        assert (path / "arrays.npz").read_bytes() == other.read_bytes()
