"""The documentation site builds without a warning, and what the program says of itself is on it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "scripts"))


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="the extra docs is not installed")
    line = [sys.executable, "-m", "sphinx", "-W", "-q", "-d", str(tmp_path / "trees"), str(ROOT / "docs")]
    found = subprocess.run([*line, str(tmp_path / "site")], capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    pages = {page.relative_to(tmp_path / "site").as_posix() for page in (tmp_path / "site").rglob("*.html")}
    assert {"index.html", "how_to.html", "families/robust.html", "_reference/commands.html"} <= pages
    every = {f"{page.stem}.html" for page in (ROOT / "docs").glob("*.md")}
    assert every <= pages
    assert "warm" in (tmp_path / "site" / "_reference" / "commands.html").read_text(encoding="utf-8")


def test_the_reference_holds_every_command_key_and_name() -> None:
    import docs_reference

    import occontrol as oc
    from occontrol.cli.application import COMMANDS
    from occontrol.families import names

    commands = docs_reference.commands()
    assert all(f"\n## {name}\n" in commands for name in COMMANDS) and "`--jobs, -j`" in commands
    assert all(f"## occontrol.{name}\n" in docs_reference.names() for name in oc.__all__)
    for family in names():
        page = docs_reference.keys(family)
        assert all(f"| `{key}` |" in page for key in ("family", "initial", "method")) and "must be there" in page
