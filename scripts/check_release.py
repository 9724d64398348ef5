"""What a release has to pass: its wheel, an empty environment, licences, the lowest versions, the shipped problems.

    scripts/check-release [--short] [wheel] [install] [licences] [lowest] [pythons] [gallery]       all if none is named

wheel     built twice from the committed files, in two folders: equal byte for byte; it holds every template, schema,
          problem and table that is committed, and says the version of CITATION.cff and CHANGELOG.md
install   the wheel in an empty environment, used from an empty folder: list, init, solve, every export format
licences  of everything that is installed there: scripts/licences, with sbom.json beside the wheel
lowest    the oldest versions that pyproject.toml admits, extras too: a solve of every family's template, and tests
pythons   the same with the newest versions on every Python that pyproject.toml names and this machine has
gallery   every shipped problem checked from the installed wheel, the short ones solved to what they expect; the site
          without a warning; the problems of docs/gallery.md solved, with pictures, to what it shows
--short   of `lowest` and `pythons` the templates and a minute of tests, in place of half an hour; no pictures
Results stand in build/release.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "build" / "release"
FORMATS = ("csv", "json", "npz", "mat", "c", "flight", "fmu", "matlab")
SHORT_FORM = "--short"
SHORT = ("scalar_on_off", "reactor_assays", "five_targets", "robust_oscillator", "oshman_every_step", "moments_small")
FEW_TESTS = ("tests/core", "tests/cli/test_writing_commands.py", "tests/test_public_names.py", "tests/test_adapters.py")
MORE_TESTS = (
    *FEW_TESTS, "tests/numerics", "tests/scheduling", "tests/files", "tests/cli", "tests/studies",
    *(f"tests/families/{name}" for name in ("test_conformance.py", "hybrid", "precision", "robust", "vlambda")),
)  # fmt: skip
TOOLS = ("pytest", "pytest-xdist", "hypothesis", "jsonschema", "control>=0.10.1", "filterpy")
EXTRAS = ("examples", "pandas", "xarray", "stonesoup", "cluster")


def run(*command: object, cwd: Path | None = None, code: int = 0, **more: str) -> str:
    """Standard output of a command; another exit code than `code` ends the check with what it printed."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | more
    done = subprocess.run([str(c) for c in command], cwd=cwd, env=environment, capture_output=True, text=True)
    if done.returncode != code:
        print(done.stdout[-3000:], done.stderr[-3000:], sep="\n", file=sys.stderr)
        sys.exit(f"failed with {done.returncode}: {' '.join(map(str, command))}")
    return done.stdout


def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def environment(name: str, *packages: object, base: str = sys.executable) -> Path:
    """The python of a fresh virtual environment with these packages, of the interpreter `base`."""
    folder = OUT / name
    shutil.rmtree(folder, ignore_errors=True)
    run(base, "-m", "venv", folder)
    python = folder / "bin" / "python"
    if packages:
        run(python, "-m", "pip", "install", "-q", *packages)
    return python


def committed() -> list[str]:
    return run("git", "ls-files", cwd=ROOT).split("\n")


def built() -> Path:
    """The wheel, built now if it is not there."""
    found = sorted(OUT.glob("*.whl"))
    if not found:
        wheel()
    return sorted(OUT.glob("*.whl"))[-1]


def wheel() -> None:
    requires = project()["build-system"]["requires"]
    python = environment("build", *requires)
    stamp = run("git", "log", "-1", "--format=%ct", cwd=ROOT).strip()
    found = []
    for part in ("one", "other"):
        source, target = OUT / f"source_{part}", OUT / f"wheel_{part}"
        for folder in (source, target):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
        archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True).stdout
        subprocess.run(["tar", "-x", "-C", source], input=archive, check=True)
        build = f"from setuptools.build_meta import build_wheel; build_wheel({str(target)!r})"
        run(python, "-c", build, cwd=source, SOURCE_DATE_EPOCH=stamp)
        found.append(next(target.glob("*.whl")))
    one, other = (hashlib.sha256(path.read_bytes()).hexdigest() for path in found)
    if one != other:
        sys.exit(f"two builds differ: {one} and {other}")
    for old in OUT.glob("*.whl"):
        old.unlink()
    shutil.copy2(found[0], OUT)
    names = set(zipfile.ZipFile(found[0]).namelist())
    data = [f for f in committed() if f.startswith("occontrol/") and not f.endswith(".md")]
    data += [f"occontrol/examples/{f[9:]}" for f in committed() if re.fullmatch(r"problems/[^/]+\.(yaml|npz|mat)", f)]
    if missing := sorted(f for f in data if f not in names):
        sys.exit(f"not in the wheel: {', '.join(missing)}")
    version = project()["project"]["version"]
    if f"version: {version}" not in (ROOT / "CITATION.cff").read_text() or f"## {version}" not in (
        ROOT / "CHANGELOG.md"
    ).read_text(encoding="utf-8"):
        sys.exit(f"CITATION.cff or CHANGELOG.md does not know version {version}")
    size = found[0].stat().st_size / 1024
    print(f"wheel     {found[0].name}, {size:.0f} kB, {len(names)} files, sha256 {one[:16]}, twice")


def installed() -> Path:
    """The python of an environment with the wheel."""
    python = OUT / "empty" / "bin" / "python"
    if not python.exists():
        python = environment("empty", built())
    return python


def empty_folder(name: str) -> Path:
    folder = OUT / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def install() -> None:
    shutil.rmtree(OUT / "empty", ignore_errors=True)
    begun, used = time.time(), os.times()
    python = installed()
    away, folder = {"HOME": str(empty_folder("home")), "NUMBA_CACHE_DIR": str(OUT / "cache")}, empty_folder("away")
    shutil.rmtree(OUT / "cache", ignore_errors=True)
    command = (python, "-m", "occontrol")
    run(*command, "init", "--example", "reactor_assays", cwd=folder, **away)
    run(*command, "solve", "reactor_assays.yaml", cwd=folder, **away)
    after = os.times()
    cpu = after.children_user + after.children_system - used.children_user - used.children_system
    wall = time.time() - begun
    print(f"install   from pip install to pictures of reactor_assays: {cpu:.0f} s of processor, {wall:.0f} s")
    pictures = list((folder / "runs" / "reactor_assays" / "figures").glob("*.png"))
    if not pictures:
        sys.exit("no picture was drawn")
    run(*command, "list", cwd=folder, **away)
    run(*command, "init", "athans", "p.yaml", cwd=folder, **away)
    run(*command, "solve", "p.yaml", "--no-figures", cwd=folder, **away)
    for form in FORMATS:
        run(*command, "export", "runs/p", "--to", form, "--out", f"as_{form}", cwd=folder, **away)


def licences() -> None:
    text = run(installed(), ROOT / "scripts" / "licences", "--sbom", OUT / "sbom.json")
    print(f"licences  {len(text.splitlines())} distributions, all allowed; build/release/sbom.json")


def lowest() -> None:
    extras = project()["project"]["optional-dependencies"]
    wanted = [*project()["project"]["dependencies"], *dict.fromkeys(line for e in EXTRAS for line in extras[e])]
    pins = [line.replace(">=", "==") for line in wanted]
    passed = tried(environment("lowest", *pins, *TOOLS), "lowest")
    print(f"lowest    {' '.join(pins)}: {passed}")


def tried(python: Path, name: str) -> str:
    """What an environment with all dependencies passes: the wheel solves every template, and tests of this checkout."""
    run(python, "-m", "pip", "install", "-q", "--no-deps", built())
    folder, cache = empty_folder(f"{name}_runs"), {"NUMBA_CACHE_DIR": str(OUT / f"{name}_cache")}
    for family in ("athans", "vlambda", "hybrid", "precision", "robust"):
        run(python, "-m", "occontrol", "init", family, f"{family}.yaml", cwd=folder, **cache)
        run(python, "-m", "occontrol", "solve", f"{family}.yaml", "--no-figures", cwd=folder, **cache)
    tests = FEW_TESTS if SHORT_FORM in sys.argv else MORE_TESTS
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    options = ("-o", "addopts=--import-mode=importlib", "-p", "no:cacheprovider", "-n", "2", "-W", "ignore")
    told = run(python, "-m", "pytest", *options, "-m", "not slow", *tests, cwd=ROOT, **cache, **threads)
    counted = re.findall(r"(\d+) passed", told)
    return f"five families solved, {counted[-1]} tests passed"


def pythons() -> None:
    """Every named Python but the one that runs this; what is missing here is said, and not passed."""
    named = [c.rsplit(" ", 1)[1] for c in project()["project"]["classifiers"] if ":: Python :: 3." in c]
    for version in named:
        if version == f"{sys.version_info.major}.{sys.version_info.minor}":
            continue
        base = interpreter(version)
        if base is None:
            print(f"pythons   {version} is not on this machine: not tried")
            continue
        extras = ",".join(EXTRAS)
        python = environment(f"python_{version}", f"{built()}[{extras}]", *TOOLS, base=base)
        print(f"pythons   {version}: {tried(python, f'python_{version}')}")


def interpreter(version: str) -> str | None:
    """A Python of this version that starts, or None."""
    folders = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    for candidate in (shutil.which(f"python{version}"), *map(str, folders)):
        if candidate and subprocess.run([candidate, "-c", ""], capture_output=True).returncode == 0:
            return candidate
    return None


def gallery() -> None:
    python, folder = installed(), empty_folder("gallery")
    names = sorted(Path(f).stem for f in committed() if re.fullmatch(r"problems/[^/]+\.yaml", f))
    for name in names:
        run(python, "-m", "occontrol", "init", "--example", name, cwd=folder)
        run(python, "-m", "occontrol", "check", f"{name}.yaml", cwd=folder, code=4 if name == "robust_escape" else 0)
    for name in SHORT:
        run(python, "-m", "occontrol", "solve", f"{name}.yaml", "--no-figures", cwd=folder)
        files = (folder / "runs" / name / file for file in ("problem.json", "result.json"))
        problem, result = (json.loads(path.read_text(encoding="utf-8")) for path in files)
        expect = problem["expect"]
        for key in ("cost", "objective"):
            if key in expect and abs(result[key] - expect[key]) > expect["tolerance"] * abs(expect[key]):
                sys.exit(f"{name}: {key} is {result[key]}, {expect[key]} is expected")
    print(f"gallery   {len(names)} problems checked, {len(SHORT)} solved to what they expect")
    run(python, "-m", "pip", "install", "-q", *project()["project"]["optional-dependencies"]["docs"])
    begun = time.time()
    run(python, "-m", "sphinx", "-W", "-q", "-d", folder / "trees", ROOT / "docs", folder / "site", cwd=ROOT)
    pages = len(list((folder / "site").rglob("*.html")))
    print(f"gallery   the site has {pages} pages and no warning, {time.time() - begun:.0f} s")
    if SHORT_FORM not in sys.argv:
        told = run(python, ROOT / "scripts" / "docs_gallery.py", "--check", cwd=folder)
        print(f"gallery   {len(told.splitlines())} problems of docs/gallery.md solved to what it shows, with pictures")


PARTS = {part.__name__: part for part in (wheel, install, licences, lowest, pythons, gallery)}


def main(chosen: Sequence[str]) -> None:
    if unknown := [name for name in chosen if name not in PARTS]:
        sys.exit(f"there is no part '{unknown[0]}'; there are: {', '.join(PARTS)}")
    OUT.mkdir(parents=True, exist_ok=True)
    for name in chosen or PARTS:
        PARTS[name]()


if __name__ == "__main__":
    main([name for name in sys.argv[1:] if name != SHORT_FORM])
