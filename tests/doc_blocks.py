"""The blocks of code of README, docs and the families' pages, and what each is."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = ["README.md", *sorted(p.relative_to(ROOT).as_posix() for p in ROOT.glob("docs/*.md"))]
PAGES += sorted(p.relative_to(ROOT).as_posix() for p in ROOT.glob("occontrol/families/*/README.md"))
_MATHEMATICS = re.compile(
    r"[′ₖΣΞξΔ²∫≥≤→·Φρ½]|\bcov w\b|\bsum_|\bm(?:in|ax) over|d[xJP]/d|S\(k\|k\)|-dY/dt|J >=|c_u\(|P = M"
)


@dataclass(frozen=True)
class Block:
    """Lines of code in a page.

    Parameters
    ----------
    page : its path in the repository
    line : where it begins, from 1
    fence : the word behind ```, empty for indented lines
    lines : without their indentation
    """

    page: str
    line: int
    fence: str
    lines: tuple[str, ...]

    @property
    def name(self) -> str:
        """Page and first words, which stay when lines move."""
        return f"{self.page}: {self.lines[0][:28].strip()}"

    @property
    def text(self) -> str:
        """The whole block."""
        return "\n".join(self.lines) + "\n"

    @property
    def kind(self) -> str:
        """python, problem, study, part (of a problem file), commands, c, printed or formula."""
        first = self.lines[0]
        if self.fence == "python" or first.startswith(("import ", "from ")):
            return "python"
        if self.fence == "yaml":
            return "study" if first.startswith("base:") else "problem"
        if self.commands:
            return "commands"
        if re.match(r"[a-z_]+_filter f;", first):
            return "c"
        if _MATHEMATICS.search(first):
            return "formula"
        return "part" if re.match(r"[a-z]+: ", first) else "printed"

    @property
    def commands(self) -> list[str]:
        """What a shell is given, without prompts and remarks."""
        shown = [line.removeprefix("$ ") for line in self.lines if line.startswith("$ ")]
        if not shown:
            shown = [s for s in self.lines if re.match(r"(occontrol|python|scripts/\w+|\.venv/bin/\S+)\b", s)]
        return [re.split(r"\s{2,}#", line)[0].strip() for line in shown]


def blocks() -> Iterator[Block]:
    """Every block of every page; includes and tables of contents of the site are none."""
    for page in PAGES:
        lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
        at = 0
        while at < len(lines):
            end = at + 1
            if lines[at].startswith("```"):
                while not lines[end].startswith("```"):
                    end += 1
                if "{" not in lines[at]:
                    yield Block(page, at + 1, lines[at][3:], tuple(lines[at + 1 : end]))
                end += 1
            elif lines[at].startswith("    ") and (at == 0 or not lines[at - 1].startswith(("- ", "* ", "  "))):
                while end < len(lines) and (lines[end].startswith("    ") or not lines[end].strip()):
                    end += 1
                found = lines[at:end]
                while not found[-1].strip():
                    found.pop()
                yield Block(page, at + 1, "", tuple(line[4:] for line in found))
            at = end
