"""Cycles on a target: rounds without an end, times far along, against the loop in Python and exact arithmetic."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from occontrol.core.target import TargetPlan
from occontrol.files.export.flight.content import Options, make_content
from occontrol.files.export.flight.reference import ReferenceFilter, Status
from tests.files.flight.machine import CC, Machine, needs_compiler, selftest, written
from tests.files.flight.plans import plain_filter, random_plan

VARIANTS = {
    "double": Options(),
    "single": Options(precision="single"),
    "gains": Options(gains_only=True),
    "no plan": Options(no_plan=True),
}


def cycle(again: int, instants: bool = False, step: float = 0.3) -> TargetPlan:
    """Five intervals, of which those before `again` are passed once."""
    plan = random_plan(intervals=5, outputs=0)
    lengths = step * np.array([0.0 if instants else 1.0, 1, 2, 1, 1.5])
    return replace(plan, edges=np.cumsum(np.append(0.0, lengths)), again=again, instants=instants)


@needs_compiler
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("again", [0, 1])
def test_three_rounds_are_bit_for_bit_those_of_python(again: int, variant: str, tmp_path: Path) -> None:
    content = written(tmp_path, cycle(again, bool(again)), VARIANTS[variant])
    assert content.replayed == 5 + 2 * (5 - again)
    done = selftest(tmp_path, CC)
    assert done.returncode == 0 and done.stdout.startswith("passed: "), done.stdout


@needs_compiler
@pytest.mark.parametrize("again", [0, 1])
def test_rounds_are_the_intervals_one_after_the_other(again: int, tmp_path: Path) -> None:
    plan, rng = cycle(again), np.random.default_rng(1)
    machine, model = Machine(tmp_path, written(tmp_path, plan, Options(no_plan=True))), plan.model
    assert model is not None
    order = [*range(5), *([*range(again, 5)] * 3)]
    long = replace(
        model,
        transition=model.transition[order], input=model.input[order], observe=[model.observe[k] for k in order],
        offset=[model.offset[k] for k in order], noise_root=[model.noise_root[k] for k in order],
        predict_matrix=np.zeros((len(order) + 1, 0, 3)), predict_offset=np.zeros((len(order) + 1, 0)),
        predict_noise=np.zeros((len(order) + 1, 0, 0)),
    )  # fmt: skip
    samples = [rng.standard_normal(len(model.offset[k])) for k in order]
    want, f = plain_filter(long, samples), machine.new()
    for i, z in enumerate(samples):
        assert f.k == order[i] and machine.step(f, np.append(z, np.zeros(3 - len(z)))) == Status.OK
        sd = np.sqrt(np.diag(want["P"][i + 1]))
        assert np.max(np.abs(np.array(f.x) - want["x"][i + 1]) / sd) < 1e-10
    assert f.round == 4 and f.k == again
    assert machine.code.oc_next(ctypes.byref(f), (ctypes.c_uint8 * 2)()) == Status.OK
    x = (ctypes.c_double * 3)(1, 2, 3)
    if hasattr(machine.code, "oc_init_at"):
        assert machine.code.oc_init_at(ctypes.byref(f), 5, x) == Status.OUTSIDE


@needs_compiler
@pytest.mark.parametrize(("again", "instants"), [(0, False), (1, True)])
@pytest.mark.parametrize("step", [0.3, 0.5, 7.0])
def test_times_of_later_rounds(step: float, again: int, instants: bool, tmp_path: Path) -> None:
    plan = cycle(again, instants, step)
    machine = Machine(tmp_path, written(tmp_path, plan))
    look, after = machine.code.oc_interval, machine.code.oc_time_after
    look.argtypes, after.restype = [ctypes.c_double, ctypes.POINTER(ctypes.c_uint32)], ctypes.c_double
    edges = plan.edges
    length = Fraction(float(edges[-1])) - Fraction(float(edges[again]))
    f, reference, k = machine.new(), ReferenceFilter(make_content(plan, Options())), ctypes.c_uint32()
    for rounds in (0, 1, 2, 17, 10**6, 4 * 10**9):  # the last: some 40 years of cycles of 0.3 s
        for at in range(again, 5):
            f.round, f.k = rounds, at
            reference.round, reference.k = rounds, at
            for steps in (0, 1, 6):
                assert after(ctypes.byref(f), steps) == reference.time_after(steps)
            exact = Fraction(float(edges[at])) + rounds * length
            place = Fraction(float(np.spacing(float(exact) + 1e-300)))
            assert abs(Fraction(after(ctypes.byref(f), 0)) - exact) <= 2 * place
            # at the edge that the code names, and in the middle of the interval
            assert look(after(ctypes.byref(f), 1 if instants else 0), ctypes.byref(k)) == Status.OK and k.value == at
            middle = float(exact + (Fraction(float(edges[at + 1])) - Fraction(float(edges[at]))) / 2)
            assert look(middle, ctypes.byref(k)) == Status.OK and k.value == at, (rounds, at)
    for wrong in (-1.0, np.nan, np.inf):
        assert look(wrong, ctypes.byref(k)) == Status.OUTSIDE
