"""The package has no error of types, by basedpyright with the settings of pyproject.toml."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def errors(*arguments: str) -> list[str]:
    """What basedpyright calls an error, one line each."""
    command = [sys.executable, "-m", "basedpyright", "--pythonpath", sys.executable, "--outputjson", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    report = json.loads(done.stdout)
    assert report["summary"]["filesAnalyzed"] > 0, done.stderr
    return [
        f"{Path(d['file']).name}:{d['range']['start']['line'] + 1} {d['message']}"
        for d in report["generalDiagnostics"]
        if d["severity"] == "error"
    ]


@pytest.mark.slow
def test_the_package_has_no_error_of_types() -> None:
    assert not errors()


@pytest.mark.slow
def test_the_check_can_fail(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.py"
    wrong.write_text("def double(x: float) -> float:\n    return 2 * x\n\n\ndouble('two')\n", encoding="utf-8")
    (found,) = errors(str(wrong))
    assert found.startswith("wrong.py:5") and '"float"' in found
