"""Flight code: the schedule and its filter as C for a target, with a self-test beside it.

`FlightFolder.write` puts PREFIX_filter.h, PREFIX_filter.c and PREFIX_tables.c into a folder, for the target, and into
its folder host/ what belongs to the computer beside it.
"""

from __future__ import annotations

from pathlib import Path

from occontrol.core.target import TargetPlan
from occontrol.core.versions import versions
from occontrol.files.atomic import write_text
from occontrol.files.export.flight.content import Content, Options, make_content
from occontrol.files.export.flight.manifest import manifest, run_digest
from occontrol.files.export.flight.readme import example, sizes_in_words
from occontrol.files.export.flight.text import filled, header, kept_parts, source, tables, template, words_of
from occontrol.files.export.flight.vectors import vectors
from occontrol.files.plain_json import to_json


def flight_texts(plan: TargetPlan, options: Options, prefix: str, title: str, problem: str) -> dict[str, str]:
    """Every file of the folder, {path: text}.

    Parameters
    ----------
    plan : TargetPlan
    options : Options
    prefix : of every name in C and of the files
    title : of the run, in words
    problem : digest of the problem

    Raises UsageError where a number does not fit into the precision.
    """
    return texts_of(make_content(plan, options), prefix, title, problem)


def texts_of(content: Content, prefix: str, title: str, problem: str) -> dict[str, str]:
    """The same of a `content`, with `prefix`, `title` and the digest of the `problem`."""
    digest = run_digest(content, problem)
    words = words_of(content, title, digest)
    words |= {"EXAMPLE": example(content), "TEXT": sizes_in_words(content)}
    found = {
        f"{prefix}_filter.h": header(content, prefix, words),
        f"{prefix}_filter.c": source(content, prefix, words),
        f"{prefix}_tables.c": tables(content, prefix, words),
    }
    for name in ("selftest.c", "Makefile", "CMakeLists.txt", "README.md"):
        found[f"host/{name}"] = filled(kept_parts(template(name), content.flags), prefix, words)
    vector = vectors(content) if "filter" in content.flags else "/* there is no filter */\n"
    found["host/vectors.h"] = filled(vector, prefix, {})
    version = versions().get("occontrol", "")
    found["host/MANIFEST.json"] = to_json(manifest(content, found, digest, problem, version)) + "\n"
    return found


def write_flight(folder: Path, texts: dict[str, str]) -> list[Path]:
    """Write `texts` {path: text} into a `folder`; returns the files. Each is written whole or not at all."""
    written = []
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        written.append(write_text(path, text))
    return written
