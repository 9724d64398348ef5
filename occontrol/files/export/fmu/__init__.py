"""A run as a functional mock-up unit: source code for FMI 2.0 or 3.0, without a binary."""

from __future__ import annotations

import io
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from occontrol.core.errors import SolveFailed, UsageError
from occontrol.core.target import TargetPlan
from occontrol.core.versions import versions
from occontrol.files.atomic import write_bytes
from occontrol.files.export.flight.content import Options, make_content
from occontrol.files.export.flight.manifest import run_digest
from occontrol.files.export.flight.text import filled, header, kept_parts, packaged, source, tables, words_of
from occontrol.files.export.fmu.description import build_description, model_description, references, token
from occontrol.files.export.fmu.functions import access, refused

EDITIONS = (2, 3)


def fmu_texts(
    plan: TargetPlan, options: Options, prefix: str, title: str, problem: str, edition: int
) -> dict[str, str]:
    """Every file of the FMU, {path: text}.

    Parameters
    ----------
    plan : TargetPlan
    options : Options
    prefix : of every name in C, and the model's identifier
    title : of the run, in words
    problem : digest of the problem
    edition : of FMI, 2 or 3

    Raises UsageError for another edition and for a plan without a filter.
    """
    if edition not in EDITIONS:
        raise UsageError(f"there is no FMI {edition} for --fmi\n  hint: there are: 2, 3")
    if plan.filter is None:
        raise UsageError(f"an FMU needs a filter: {plan.why}\n  hint: --to flight writes the schedule alone")
    content = make_content(plan, options)
    digest = run_digest(content, problem)
    words = words_of(content, title, digest)
    names = "\n".join(f"#define OCC_REF_{name} {at}U" for name, at in references(content).items())
    words |= {"REFERENCES": f'{names}\n#define OCC_TOKEN "{token(digest)}"'}
    words |= {"ACCESS": access(edition), "REFUSED": refused(edition)}
    wrapper = "".join(
        kept_parts(packaged("occontrol.files.export.fmu", name), content.flags)
        for name in ("instance.c", f"fmi{edition}.c")
    )
    sources = [f"{prefix}_fmu.c", f"{prefix}_filter.c", f"{prefix}_tables.c"]
    version = versions().get("occontrol", "")
    found = {
        "modelDescription.xml": model_description(content, edition, prefix, title, digest, version, sources),
        f"sources/{sources[0]}": filled(wrapper, prefix, words),
        f"sources/{sources[1]}": source(content, prefix, words),
        f"sources/{sources[2]}": tables(content, prefix, words),
        f"sources/{prefix}_filter.h": header(content, prefix, words),
    }
    if edition == 3:
        found["sources/buildDescription.xml"] = build_description(prefix, sources)
    return found


def write_fmu(path: Path, texts: dict[str, str], build: str = "") -> list[Path]:
    """Write an FMU; the same texts are the same bytes.

    Parameters
    ----------
    path : the file
    texts : {path: text} of its content
    build : the model's identifier where a binary of this computer is to be added

    Raises SolveFailed where there is no compiler, or where it fails.
    """
    content = io.BytesIO()
    added = _binary(texts, build) if build else {}
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in ({name: text.encode() for name, text in texts.items()} | added).items():
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    path.parent.mkdir(parents=True, exist_ok=True)
    return [write_bytes(path, content.getvalue())]


def _binary(texts: dict[str, str], prefix: str) -> dict[str, bytes]:
    """{path: content} of the shared library for this computer."""
    compiler = next((found for found in map(shutil.which, ("cc", "gcc", "clang")) if found), None)
    if compiler is None or sys.platform == "win32":
        raise SolveFailed("no C compiler was found to build the FMU with\n  hint: without --build importers build it")
    system, ending = ("darwin", "dylib") if sys.platform == "darwin" else ("linux", "so")
    machine = platform.machine().lower().replace("amd64", "x86_64").replace("arm64", "aarch64")
    folder = f"{machine}-{system}"
    if 'fmiVersion="2.0"' in texts["modelDescription.xml"]:
        folder = f"{system}64" if machine == "x86_64" else folder
    with tempfile.TemporaryDirectory() as place:
        for name, text in texts.items():
            if name.startswith("sources/"):
                (Path(place) / name[8:]).write_text(text)
        library = Path(place) / f"{prefix}.{ending}"
        flags = ["-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-o", str(library)]
        sources = [str(each) for each in sorted(Path(place).glob("*.c"))]
        done = subprocess.run([compiler, *flags, *sources, "-lm"], capture_output=True, text=True, errors="replace")
        if done.returncode:
            raise SolveFailed(f"the FMU cannot be built: {(done.stderr.splitlines() or ['no message'])[0]}")
        return {f"binaries/{folder}/{prefix}.{ending}": library.read_bytes()}
