"""Flight code compiled: no warning, every bit as in Python, every flipped bit found, mistakes as a status."""

from __future__ import annotations

import ctypes
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from occontrol.core.errors import UsageError
from occontrol.files.export.flight import texts_of
from occontrol.files.export.flight.content import Options, make_content
from occontrol.files.export.flight.reference import ReferenceFilter, Status
from occontrol.files.export.flight.text import check_prefix, enumerators, prefix_of
from tests.files.flight.machine import CC, COMPILERS, Machine, built, needs_compiler, selftest, written
from tests.files.flight.plans import random_plan

VARIANTS = {
    "double": Options(),
    "single": Options(precision="single"),
    "gains": Options(gains_only=True),
    "no plan": Options(no_plan=True),
    "single gains": Options(precision="single", gains_only=True),
}
CORNERS = {
    "one interval": random_plan(intervals=1, active=[(1,)]),
    "idle only": random_plan(intervals=3, rows=(0,), active=[()] * 3, names=("idle",)),
    "nothing predicted": random_plan(outputs=0),
    "one state, one value": random_plan(states=1, rows=(1,), active=[(0,)] * 12),
    "singular noise": random_plan(rank=1),
    "names": random_plan(names=('a "quoted" */ name', "größe ?")),
    "readings": random_plan(),
}
object.__setattr__(CORNERS["readings"], "instants", True)


@needs_compiler
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("variant", VARIANTS)
def test_the_self_test_passes_without_a_warning(compiler: str, variant: str, tmp_path: Path) -> None:
    written(tmp_path, random_plan(), VARIANTS[variant])
    done = selftest(tmp_path, compiler)
    assert done.returncode == 0 and done.stdout.startswith("passed: "), done.stdout


@needs_compiler
@pytest.mark.parametrize("corner", CORNERS)
def test_corners_compile_and_pass(corner: str, tmp_path: Path) -> None:
    for variant in ("double", "no plan", "single gains"):
        written(tmp_path, CORNERS[corner], VARIANTS[variant])
        done = selftest(tmp_path, CC)
        assert done.returncode == 0, (variant, done.stdout)


@needs_compiler
def test_no_optimisation_changes_a_bit_and_no_sanitizer_complains(tmp_path: Path) -> None:
    written(tmp_path, random_plan())
    for flags in (["-O0"], ["-O3"], ["-O3", "-std=gnu99"], ["-O1", "-g", "-fsanitize=address,undefined"]):
        if "-g" in flags and subprocess.run([CC, *flags, "-xc", "-", "-o", tmp_path / "x"], input=b"int main(void){return 0;}", capture_output=True).returncode:  # fmt: skip # noqa: E501
            continue  # a compiler without sanitizers
        done = selftest(tmp_path, CC, "-std=c99", *flags)
        assert done.returncode == 0, (flags, done.stdout, done.stderr)
    with pytest.raises(AssertionError, match="fast-math"):
        selftest(tmp_path, CC, "-std=c99", "-ffast-math")


FLIP = """
#include "oc_filter.h"
#include <stdio.h>
int main(void)
{
    unsigned long missed = 0UL, flipped = 0UL, i;
    int bit;
%s
    printf("%%lu %%lu %%d\\n", flipped, missed, (int)oc_check());
    return 0;
}
"""


@needs_compiler
@pytest.mark.parametrize("variant", ["double", "single"])
def test_any_flipped_bit_of_any_table_is_found(variant: str, tmp_path: Path) -> None:
    content = written(tmp_path, random_plan(intervals=3, states=2), VARIANTS[variant])
    loop = "    for (i = 0; i < sizeof(oc_{0}); i++) for (bit = 0; bit < 8; bit++) {{ unsigned char *p = (unsigned char *)oc_{0} + i; *p ^= (unsigned char)(1 << bit); flipped++; missed += oc_check() != OC_BAD_TABLE; *p ^= (unsigned char)(1 << bit); }}"  # noqa: E501
    (tmp_path / "flip.c").write_text(FLIP % "\n".join(loop.format(table.name) for table in content.tables))
    sources = [tmp_path / name for name in ("oc_filter.c", "oc_tables.c", "flip.c")]
    program = built(CC, sources, tmp_path / "flip", "-std=c99", "-O2", "-Dconst=")
    flipped, missed, after = map(int, subprocess.run([program], capture_output=True, text=True).stdout.split())
    assert flipped == 8 * sum(table.values.nbytes for table in content.tables)
    assert (missed, after) == (0, Status.OK)


@needs_compiler
def test_the_self_test_notices_a_changed_number_and_a_changed_operation(tmp_path: Path) -> None:
    written(tmp_path, random_plan())
    source = tmp_path / "oc_filter.c"
    whole = source.read_text()
    for old, new in (
        ("e[r] = z[kept[r]] - oc_affine(", "e[r] = z[kept[r]] + oc_affine("),
        ("x[r - count] += multiple[r] * e[i];", "x[r - count] -= multiple[r] * e[i];"),
        ("nis += (e[i] * e[i]) * inverse;", "nis += e[i] * e[i];"),
        ("own[c] -= multiple[i] * before[c];", "own[c] += multiple[i] * before[c];"),
        ("two = row[c + 1U] - (last * before[c + 1U]);", "two = row[c + 1U];"),
        ("sum += m[i * apart] * lower[((i * (i - 1U)) / 2U) + c];", "sum += m[i * apart] * lower[i - c - 1U];"),
        ("x[r] += K[(i * OC_STATES) + r] * e[i];", "x[r] += K[i + r] * e[i];"),
        ("v[r] += (row[c] * pivot[c]) * row[c];", "v[r] += row[c] * row[c];"),
    ):
        assert whole.count(old) == 1, old
        source.write_text(whole.replace(old, new))
        assert selftest(tmp_path, CC, "-std=c99", "-O1").returncode == 1, old


@needs_compiler
@pytest.mark.parametrize("variant", VARIANTS)
def test_two_filters_interleaved_are_two_alone_and_python(variant: str, tmp_path: Path) -> None:
    content = written(tmp_path, random_plan(seed=2), VARIANTS[variant])
    machine, rng = Machine(tmp_path, content), np.random.default_rng(7)
    z = rng.standard_normal((2, 12, content.values)).astype(content.options.dtype)
    z[1][rng.random(z[1].shape) < 0.3] = np.nan
    both = [machine.new(), machine.new()]
    alone = [machine.new(), machine.new()]
    references = [ReferenceFilter(content), ReferenceFilter(content)]
    said: list[list[np.ndarray]] = [[], []]
    for k in range(12):
        for i in (0, 1):
            status = machine.step(both[i], z[i, k])
            assert status == references[i].step(z[i, k]) == Status.OK
            said[i].append(machine.said(both[i]))
            assert np.array_equal(np.array(both[i].x), references[i].x)
            assert np.array_equal(said[i][-1][machine.n + 4 :][: machine.n], references[i].variance())
    for i in (0, 1):
        for k in range(12):
            machine.step(alone[i], z[i, k])
            assert np.array_equal(machine.said(alone[i]), said[i][k])


@needs_compiler
def test_mistakes_are_a_status_and_leave_the_filter_as_it_was(tmp_path: Path) -> None:
    plan = random_plan(seed=2, active=[(0, 1)] * 12)
    content = written(tmp_path, plan)
    machine, reference = Machine(tmp_path, content), ReferenceFilter(content)
    code, f, good = machine.code, machine.new(), np.array([0.1, 0.2, 0.3])
    before = machine.said(f)
    code.oc_time.restype, code.oc_words.restype, code.oc_digest.restype = ctypes.c_double, *[ctypes.c_char_p] * 2
    assert machine.step(f, np.array([0.1, np.inf, 0.3])) == reference.step(np.array([0.1, np.inf, 0.3])) == 3
    assert code.oc_step(None, machine.array(good), None) == code.oc_step(ctypes.byref(f), None, None) == 1
    assert machine.step(f, np.full(3, 1.7e308)) == reference.step(np.full(3, 1.7e308)) == Status.OVERFLOW
    assert machine.step(f, np.array([np.nan, 1.7e308, 1.7e308])) == Status.OVERFLOW
    assert np.array_equal(machine.said(f), before)
    assert machine.step(f, np.array([0.1, np.inf, 0.3]), np.array([1, 0, 1])) == Status.OK  # it does not count
    assert f.planned == 0 and f.dimension == 2
    assert code.oc_init_at(ctypes.byref(f), 13, machine.array(np.zeros(3))) == Status.OUTSIDE
    assert code.oc_init_at(ctypes.byref(f), 3, machine.array(np.array([0, np.nan, 0]))) == Status.BAD_STATE
    assert code.oc_init_at(ctypes.byref(f), 12, machine.array(np.zeros(3))) == Status.OK
    assert machine.step(f, good) == Status.END and code.oc_next(ctypes.byref(f), (ctypes.c_uint8 * 2)()) == Status.END
    f.k = 4000  # never initialised
    assert code.oc_variance(ctypes.byref(f), (ctypes.c_double * 3)()) == Status.OUTSIDE
    k = ctypes.c_uint32()
    for t, want in ((plan.edges[0], 0), (plan.edges[4], 4), (plan.edges[-1], 11), (np.mean(plan.edges[6:8]), 6)):
        assert code.oc_interval(ctypes.c_double(t), ctypes.byref(k)) == 0 and k.value == want
    for t in (plan.edges[0] - 1e-9, np.nan, plan.edges[-1] + 1):
        assert code.oc_interval(ctypes.c_double(t), ctypes.byref(k)) == Status.OUTSIDE
    assert [code.oc_time(i) for i in range(13)] == plan.edges.tolist()
    assert code.oc_words(3) == b"a sample is infinite" and code.oc_words(77) == b"no such status"
    assert re.fullmatch(rb"[0-9a-f]{64}", code.oc_digest())


@needs_compiler
def test_an_innovation_without_variance_is_refused(tmp_path: Path) -> None:
    plan = random_plan(intervals=2, states=1, rows=(1,), active=[(0,), (0,)])
    assert plan.model is not None
    plan.model.covariance[:] = 0.0
    plan.model.noise_root[0][:] = 0.0
    for options in (Options(), Options(no_plan=True)):
        content = written(tmp_path, plan, options)
        machine = Machine(tmp_path, content)
        f = machine.new()
        assert machine.step(f, np.array([1.0])) == ReferenceFilter(content).step(np.array([1.0])) == Status.SINGULAR
        assert f.k == 0


@needs_compiler
def test_the_schedule_is_looked_up_by_number_and_by_name(tmp_path: Path) -> None:
    plan = random_plan(rows=(1, 2), names=("radar-1", "radar 1"))
    content = written(tmp_path, plan)
    code = Machine(tmp_path, content).code
    header = (tmp_path / "oc_filter.h").read_text()
    assert "OC_SENSOR_RADAR_1 = 0, /* radar-1 */" in header and "OC_SENSOR_RADAR_1_1 = 1  /* radar 1 */" in header
    assert "OC_STATE_X3 = 2  /* x3 */" in header
    assert enumerators("S_", ["a", "a [m]", "A_1", "a", "vx [m/s]"]) == ["S_A", "S_A_1", "S_A_1_1", "S_A_2", "S_VX"]
    in_use, first, count = (ctypes.c_uint8 * 2)(), ctypes.c_uint32(), ctypes.c_uint32()
    for k, active in enumerate(plan.active):
        assert code.oc_in_use(k, in_use) == 0
        assert tuple(np.flatnonzero(list(in_use))) == tuple(active)
        for j in range(2):
            assert code.oc_place(k, j, ctypes.byref(first), ctypes.byref(count)) == 0
            want = (sum(plan.rows[i] for i in active if i < j), plan.rows[j]) if j in active else count.value * (0, 0)
            assert (first.value, count.value) == want if j in active else count.value == 0
    assert code.oc_in_use(12, in_use) == Status.OUTSIDE and code.oc_place(0, 2, None, None) == Status.NULL_POINTER


def test_the_same_plan_gives_the_same_bytes_and_no_path() -> None:
    content = make_content(random_plan(), Options())
    one, two = (texts_of(make_content(random_plan(), Options()), "oc", "a plan", "sha256:0") for _ in range(2))
    assert one == two and set(one) > {"oc_filter.h", "oc_filter.c", "oc_tables.c"}
    for name, text in one.items():
        assert "/home" not in text and "occ_" not in text and "@" not in text.replace("$@", ""), name
        assert name.endswith(("vectors.h", ".json")) or all(len(line) <= 120 for line in text.splitlines()), name
    assert texts_of(content, "oc", "a plan", "sha256:1")["oc_filter.h"] != one["oc_filter.h"]  # another run's digest


def test_prefixes() -> None:
    assert prefix_of("two radars") == "oc_two_radars" and prefix_of("größe") == "oc_gr__e"
    assert check_prefix("oc_2") == "oc_2"
    for wrong in ("2x", "a-b", "", "while", "x" * 32, "é"):
        with pytest.raises(UsageError, match="cannot begin the names of C functions"):
            check_prefix(wrong)


def test_numbers_that_single_precision_does_not_hold() -> None:
    plan = random_plan()
    assert plan.model is not None
    plan.model.input[3, 1] = 1e39
    with pytest.raises(UsageError, match="the table 'input' has numbers that single precision does not hold"):
        make_content(plan, Options(precision="single"))
