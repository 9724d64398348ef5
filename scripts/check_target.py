"""Everything that code for a target promises, tried with the compilers and tools of this computer.

scripts/check-target                      every shipped problem and the corners, by quick methods
scripts/check-target RUN ..               run folders that are there already

Wanted: gcc, clang, cppcheck, qemu-arm, arm-linux-gnueabihf-gcc, arm-none-eabi-gcc, octave-cli, FMPy and cmake. What is
missing is named and left out. Ends with 1 where a promise is broken. The letters are those of docs/onto_a_target.md.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import occontrol  # noqa: E402
from occontrol.api import family_of, read_run, write_run  # noqa: E402
from occontrol.core.errors import OccontrolError  # noqa: E402
from occontrol.core.target import TargetPlan  # noqa: E402
from occontrol.files.export.flight import texts_of, write_flight  # noqa: E402
from occontrol.files.export.flight.content import Options, make_content  # noqa: E402
from occontrol.files.export.fmu import fmu_texts, write_fmu  # noqa: E402
from scripts.check_target_filter import against_filter, octave_differs  # noqa: E402
from scripts.check_target_fmu import fmus_agree  # noqa: E402
from tests.files.flight.machine import STRICT  # noqa: E402
from tests.files.flight.plans import random_plan  # noqa: E402
from tests.files.flight.test_flight_endless import cycle  # noqa: E402
from tests.files.flight.test_flight_formulas import MAP, TANK, every_function, plan_of  # noqa: E402

VARIANTS = {
    "double": Options(),
    "single": Options(precision="single"),
    "gains": Options(gains_only=True),
    "no plan": Options(no_plan=True),
}
QUICK = {"athans": "greedy", "hybrid": "alternate"}
TOOLS = "gcc clang cppcheck qemu-arm arm-linux-gnueabihf-gcc arm-none-eabi-gcc octave-cli cmake".split()
THERE = {name: shutil.which(name) is not None for name in TOOLS}
BROKEN: list[str] = []


def promise(letter: str, what: str, kept: bool, more: str = "") -> None:
    """Print a promise that is kept or broken."""
    print(f"   {letter}) {'ok    ' if kept else 'BROKEN'} {what}{': ' + more if more else ''}", flush=True)
    if not kept:
        BROKEN.append(f"{letter}) {what}")


def call(*command: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, cwd=cwd, errors="replace")


def built_and_run(folder: Path, compiler: list[str], flags: list[str], before: list[str]) -> str:
    """Empty where the self-test passes, else what went wrong."""
    done = call(*compiler, *flags, "-o", folder / "st", *sorted(folder.glob("*.c")), folder / "host" / "selftest.c")
    if done.returncode:
        return done.stderr.strip().splitlines()[0]
    result = call(*before, folder / "st")
    return "" if result.returncode == 0 else (result.stdout + result.stderr).strip()[:200]


def compilers() -> Iterator[tuple[str, list[str], list[str], list[str]]]:
    """Name, command, flags, emulator."""
    for name in ("gcc", "clang"):
        if THERE[name]:
            for level in ("-O0", "-O1", "-O2", "-O3"):
                yield f"{name} {level}", [name], [*STRICT, level], []
            yield f"{name} -O3 -march=native", [name], [*STRICT, "-O3", "-march=native"], []
    if THERE["gcc"]:
        yield "gcc sanitizers", ["gcc"], [*STRICT, "-O1", "-g", "-fsanitize=address,undefined"], []
    if THERE["qemu-arm"] and THERE["arm-linux-gnueabihf-gcc"]:
        yield "qemu-arm", ["arm-linux-gnueabihf-gcc", "-static"], [*STRICT, "-O2"], ["qemu-arm"]


def check_code(folder: Path, content, full: bool, few: bool, misra: bool) -> None:
    """Compile, run, look into the objects; `few` builds where others of the same plan have many; `misra` is slow."""
    wrong = {}
    some = ("gcc -O2",) if few else ("gcc -O2", "clang -O2", "qemu-arm")
    chosen = [each for each in compilers() if full or each[0] in some]
    for name, compiler, flags, before in chosen:
        text = built_and_run(folder, compiler, flags, before)
        if text:
            wrong[name] = text
    promise("a, c, e, h", f"no warning, every bit, {len(chosen)} builds", not wrong, str(wrong) if wrong else "")
    source = next(folder.glob("*_filter.c"))
    if THERE["arm-none-eabi-gcc"]:
        core = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
        done = call("arm-none-eabi-gcc", *STRICT, "-Os", *core, "-c", source, "-o", folder / "m4.o")
        names = call("arm-none-eabi-nm", "-u", folder / "m4.o").stdout.split()[1::2]
        own = {f"oc_{table.name}" for table in content.tables}
        others = [name for name in names if name not in own and not re.fullmatch(r"__aeabi_\w+|mem(cpy|set)", name)]
        size = call("arm-none-eabi-size", folder / "m4.o").stdout.split()
        promise("a, f", "Cortex-M4: no warning, no library", not done.returncode and not others, " ".join(others))
        promise("g", "code bytes on a Cortex-M4", True, size[6] if len(size) > 6 else "?")
    if THERE["gcc"]:
        check_stack(folder, source)
    if THERE["cppcheck"] and misra:
        listed = set(json.loads((folder / "host" / "MANIFEST.json").read_text())["deviations"])
        found: set[str] = set()
        for each in sorted(folder.glob("*.c")):
            text = call("cppcheck", "--addon=misra", "--std=c99", "--quiet", each.name, cwd=folder).stderr
            found |= set(re.findall(r"misra-c2012-([0-9.]+)\]", text))
        promise("b", "MISRA: only the advisory rules of the manifest", found <= listed, ", ".join(sorted(found)))
    if THERE["gcc"] and full:
        check_flips(folder, content)


def check_stack(folder: Path, source: Path) -> None:
    """Bounded stack, no recursion."""
    call("gcc", "-std=c99", "-O1", "-fcallgraph-info=su", "-c", source, "-o", folder / "x.o", cwd=folder)
    text = next(folder.glob("*.ci")).read_text()
    node = r'node: \{ title: "([^"]+)" label: "[^"]*\\n(\d+) bytes \((?:static|dynamic,bounded)\)'
    frames = dict(re.findall(node, text))
    calls: dict[str, set[str]] = {}
    for caller, callee in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text):
        calls.setdefault(caller, set()).add(callee)
    circle = False

    def depth(name: str, above: tuple[str, ...] = ()) -> int:
        nonlocal circle
        if name in above:
            circle = True
            return 0
        below = [depth(each, (*above, name)) for each in calls.get(name, ())]
        return int(frames.get(name, 0)) + max(below, default=0)

    deepest = max(depth(name) for name in frames)
    promise("g", "stack is bounded, no recursion", not circle and "(dynamic)" not in text, f"{deepest} bytes")


FLIP = """
#include "oc_filter.h"
#include <stdio.h>
int main(void)
{
    unsigned long missed = 0UL, flipped = 0UL;
%s
    printf("%%lu %%lu %%d\\n", flipped, missed, (int)oc_check());
    return 0;
}
"""
ONE = (
    "    {{ unsigned char *p = (unsigned char *)oc_{0} + {1}; *p ^= {2}; flipped++; "
    "missed += oc_check() != OC_BAD_TABLE; *p ^= {2}; }}"
)


def check_flips(folder: Path, content) -> None:
    """Eight bits of every table; tests/files/flight flips every bit of a small one."""
    rng = np.random.default_rng(0)
    lines = [
        ONE.format(table.name, rng.integers(table.values.nbytes), 1 << rng.integers(8))
        for table in content.tables
        for _ in range(8)
    ]
    (folder / "flip.c").write_text(FLIP % "\n".join(lines))
    files = [folder / name for name in ("oc_filter.c", "oc_tables.c", "flip.c")]
    done = call("gcc", "-std=c99", "-O2", "-Dconst=", "-o", folder / "flip", *files)
    words = call(folder / "flip").stdout.split()
    (folder / "flip.c").unlink()
    promise("d", "a flipped bit is found", not done.returncode and words[1:] == ["0", "0"], f"{words[:1]} bits")


def check(name: str, plan: TargetPlan, full: bool, scratch: Path, misra: bool = False) -> None:
    """One plan, as flight code in every variant and as FMUs."""
    print(f"{name}: {plan.intervals} intervals" + ("" if plan.filter else f", no filter: {plan.why}"), flush=True)
    for label, options in VARIANTS.items():
        if label != "double" and (plan.filter is None or (plan.formulas and label != "single")):
            continue
        print(f"  {label}")
        folder = scratch / re.sub(r"\W", "_", f"{name} {label}")
        content = make_content(plan, options)
        texts = texts_of(content, "oc", name, "sha256:0")
        again = texts_of(make_content(plan, options), "oc", name, "sha256:0")
        promise("l", "the same bytes", texts == again)
        write_flight(folder, texts)
        check_code(folder, content, full and label in ("double", "single"), label != "double", misra)
    if plan.filter is None:
        return
    content = make_content(plan, Options())
    paths = {
        edition: write_fmu(scratch / f"{edition}.fmu", fmu_texts(plan, Options(), "oc", name, "sha256:0", edition))[0]
        for edition in (2, 3)
    }
    try:
        said = fmus_agree(paths, content, run=full and THERE["cmake"])
    except ImportError:
        print("   i) not tried: FMPy is not installed")
        return
    promise("i", "FMUs are valid and end with the same bits", not said, str(said) if said else "")


def solved(problem, endless: bool):
    """A solution by a quick method where that does the problem, else by its own."""
    if not endless and problem.family in QUICK:
        try:
            return occontrol.solve(problem, QUICK[problem.family])
        except OccontrolError:
            pass
    return occontrol.solve(problem)


def check_filter(run: Path, folder: Path, problem, solution, plan: TargetPlan) -> None:
    """Beside `occontrol filter`, for the families whose measurement files have the times of the plan."""
    if plan.filter is None or problem.family not in ("athans", "vlambda"):
        return
    try:
        away, digits = against_filter(problem, solution, plan)
    except (OccontrolError, np.linalg.LinAlgError) as error:
        print(f"   c) not tried beside the filter: {str(error).splitlines()[0]}")
        return
    more = "" if away < 1e-12 else f"; the digits of the estimate leave {digits:.1e} open"
    promise("c", "the filter's estimate, in standard deviations", away < max(1e-12, digits), f"{away:.1e}{more}")
    if THERE["octave-cli"] and plan.model is not None and problem.family == "athans" and plan.again is None:
        away = octave_differs(run, folder, problem, solution, plan)
        promise("j", "Octave agrees to 1e-10 standard deviations", away < 1e-10, f"{away:.1e}")


def main(runs: list[str]) -> int:
    missing = [name for name, there in THERE.items() if not there]
    print(f"not on this computer: {', '.join(missing) or 'nothing is missing'}")
    with tempfile.TemporaryDirectory() as place:
        scratch = Path(place)
        if not runs:
            for name, plan in corners().items():
                check(name, plan, True, scratch, misra=name[3:] in COVERING)
        shipped = [*sorted((ROOT / "problems").glob("*.yaml")), *sorted((ROOT / "problems" / "endless").glob("*.yaml"))]
        for path in [Path(run) for run in runs] or shipped:
            try:
                if path.is_dir():
                    problem, solution = read_run(path)
                    run = path
                else:
                    problem = occontrol.read_problem(path)
                    if hasattr(problem, "runs"):
                        object.__setattr__(problem, "runs", 2)
                    solution = solved(problem, path.parent.name == "endless")
                    problem = solution.problem or problem
                    run = scratch / f"run {path.stem}"
                    write_run(run, problem, solution)
                plan = family_of(problem).target_plan(problem, solution)
            except OccontrolError as error:
                print(f"{path.stem}: {str(error).splitlines()[0]}", flush=True)
                continue
            check(path.stem, plan, bool(runs), scratch)
            check_filter(run, scratch / f"{path.stem} matlab", problem, solution, plan)
    print(f"{len(BROKEN)} promises broken" + "".join(f"\n  {each}" for each in BROKEN))
    return 1 if BROKEN else 0


# these hold every part of the templates together
COVERING = "any plan,nothing predicted,a cycle of readings,a cycle,nonlinear,discrete,every function".split(",")


def corners() -> dict[str, TargetPlan]:
    found = {
        "k) any plan": random_plan(),
        "k) one interval": random_plan(intervals=1, active=[(1,)]),
        "k) idle only": random_plan(intervals=3, rows=(0,), active=[()] * 3, names=("idle",)),
        "k) nothing predicted": random_plan(outputs=0),
        "k) one state, one value": random_plan(states=1, rows=(1,), active=[(0,)] * 12),
        "k) singular noise": random_plan(rank=1),
        'k) names "quoted" */ größe': random_plan(names=('a "quoted" */ name', "größe ?")),
        "k) a cycle": cycle(0),
        "k) a cycle of readings": cycle(1, True),
        "k) nonlinear": plan_of(TANK)[2],
        "k) discrete": plan_of(MAP)[2],
        "k) every function": every_function(),
    }
    return found


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
