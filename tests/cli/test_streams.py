"""What a command does with its streams, and with what the libraries below it would like to say."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from occontrol.cli import run

PROGRAM = "from occontrol.cli import main; main()"


def started(*arguments: str, **more: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", PROGRAM, *arguments], text=True, stderr=subprocess.PIPE, **more)  # type: ignore[call-overload]


def test_a_reader_that_leaves_early_is_no_failure(small_file: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as closed:
        done = started("check", str(small_file), stdout=closed, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_a_file_that_cannot_be_written(small_file: Path) -> None:
    for unbuffered in ("", "1"):
        with open("/dev/full", "w") as full:
            done = started("check", str(small_file), stdout=full, env={**os.environ, "PYTHONUNBUFFERED": unbuffered})
        assert done.returncode == 8 and "No space left" in done.stderr and "Traceback" not in done.stderr


def test_without_any_standard_output(small_file: Path) -> None:
    again = f"os.execv(sys.executable, [sys.executable, '-c', {PROGRAM!r}, *sys.argv[1:]])"
    closing = f"import os, sys; os.close(1); {again}"
    done = subprocess.run(
        [sys.executable, "-c", closing, "check", str(small_file)], text=True, stderr=subprocess.PIPE, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_names_that_the_alphabet_of_the_terminal_lacks(small_text: str, tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    file.write_text("name: Prüfung\n" + "\n".join(x for x in small_text.split("\n") if not x.startswith("name:")))
    done = started("check", str(file), stdout=subprocess.PIPE, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0, done.stderr
    assert "Pr\\xfcfung" in done.stdout


@pytest.mark.parametrize("seed", ["-1", "1.5", "x"])
def test_a_seed_is_a_whole_number_from_0_upwards(small_file: Path, tmp_path: Path, seed: str, capsys) -> None:
    assert run(["simulate", str(small_file), "--out", str(tmp_path / "m.csv"), "--seed", seed]) == 2
    assert "--seed" in capsys.readouterr().err


def test_compare_with_no_method_at_all(small_file: Path, tmp_path: Path, capsys) -> None:
    assert run(["compare", str(small_file), "--methods", " , ", "--out", str(tmp_path)]) == 2
    assert "--methods names no method\n  hint: for example --methods schedule," in capsys.readouterr().err


def test_simulate_looks_at_its_folder_before_it_solves(small_file: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr("occontrol.families.athans.family.AthansFamily.solve", None)
    monkeypatch.chdir(tmp_path)
    assert run(["simulate", str(small_file), "--out", "nowhere/m.csv"]) == 8
    assert "cannot write nowhere/m.csv: there is no folder nowhere" in capsys.readouterr().err


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("3", "3")])
def test_one_thread_for_small_matrices_unless_the_user_says_otherwise(given: str | None, used: str) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    if given:
        environment["OPENBLAS_NUM_THREADS"] = given
    program = (
        "import sys, os; from occontrol.cli import prepare; assert 'numpy' not in sys.modules; prepare(); "
        "print(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == used
