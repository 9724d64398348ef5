"""Flight code of nonlinear plants: elementary functions, formulas, the step, against three routes of their own."""

from __future__ import annotations

import ctypes
import math
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import occontrol
from occontrol.api import family_of, run_filter, simulate
from occontrol.core.errors import UsageError
from occontrol.core.target import FormulaModel, TargetPlan
from occontrol.files.export import matlab
from occontrol.files.export.flight.content import Options, make_content
from occontrol.files.export.flight.elementary import Elementary
from occontrol.files.export.flight.program import Program
from occontrol.files.export.flight.reference import Status
from occontrol.files.export.flight.vectors import reference_of
from tests.files.flight.machine import CC, COMPILERS, Machine, needs_compiler, selftest, written

BOTH = {"double": Options(), "single": Options(precision="single")}
TANK = """\
family: athans
name: a tank and a turning boat
horizon: {start: 0, end: 3, samples: 6, predict_at: 4}
sensing: samples
integrator: {substeps: 2}
plant:
  states: [x, y, a]
  parameters: {speed: {mean: 1.2, sd: 0.2}}
  f: ["speed*cos(a)", "speed*sin(a)", "0.3*tanh(2 - t) + 0.1*exp(-x**2)"]
  noise: [["0.01 + 0.02*y**2", 0.005, 0], [0.005, 0.02, 0], [0, 0, 0.01]]
  initial: {mean: [1, 2, 2.8], covariance: {diag: [0.04, 0.09, 0.02]}}
sensors:
  - {name: bearing, h: ["atan2(y, x)", a], angle: true, noise: [[0.01, 0.004], [0.004, "0.01 + 0.001*x**2"]]}
  - {name: range, h: ["hypot(x, y)"], noise: "0.02*(1 + sqrt(x**2 + y**2))"}
select: 1..2
objective: {output: [x, y]}
"""
MAP = """\
family: athans
name: a map
horizon: {steps: 6}
plant:
  states: [p, q]
  next: ["p + 0.1*q", "q - 0.1*sin(p) + if_else(k < 3, 0.1, -0.1)"]
  noise: {diag: [0, "0.01*(1 + p**2)"]}
  initial: {mean: [1, 0], covariance: {diag: [0.1, 0.1]}}
sensors:
  - {name: level, h: [p], noise: 0.05}
  - {name: bend, h: ["q*abs(p)"], noise: 0.02}
objective: {output: [p]}
"""


@cache
def plan_of(text: str):
    """Problem, solution and plan of a problem file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.yaml"
        path.write_text(text)
        problem = occontrol.read_problem(path)
    solution = occontrol.solve(problem, "greedy")
    return problem, solution, family_of(problem).target_plan(problem, solution)


@needs_compiler
@pytest.mark.parametrize("compiler", [name for name in COMPILERS if name != "cc"] or COMPILERS)
@pytest.mark.parametrize("precision", BOTH)
@pytest.mark.parametrize("text", [TANK, MAP], ids=["continuous", "discrete"])
def test_the_self_test_passes_without_a_warning(text: str, precision: str, compiler: str, tmp_path: Path) -> None:
    plan = plan_of(text)[2]
    content = written(tmp_path, plan, BOTH[precision])
    assert {"nonlinear", "noise"} <= content.flags and "#include <math.h>" not in (tmp_path / "oc_filter.c").read_text()
    done = selftest(tmp_path, compiler)
    assert done.returncode == 0 and done.stdout.startswith("passed: "), done.stdout


@pytest.mark.parametrize("lost", [0, 3])
@pytest.mark.parametrize("text", [TANK, MAP], ids=["continuous", "discrete"])
def test_the_step_is_that_of_the_filter(text: str, lost: int) -> None:
    problem, solution, plan = plan_of(text)
    measurements = list(simulate(problem, solution, 3)[0])[lost:]
    want, reference = run_filter(problem, solution, measurements), reference_of(make_content(plan, Options()))
    for k in range(plan.intervals):
        z = [np.full(plan.rows[j], np.nan) for j in plan.active[k]]
        for s in measurements:
            if s.time == pytest.approx(plan.edges[k + 1]):
                z[plan.active[k].index(plan.names.index(s.sensor))] = s.values
        assert reference.step(np.concatenate([*z, np.zeros(0)])) == Status.OK
        sd = want.standard_deviation[k + 1]
        assert np.max(np.abs(reference.x - want.mean[k + 1]) / sd) < 1e-12
        assert np.max(np.abs(np.sqrt(reference.variance()) / sd - 1)) < 1e-12
        w, v = reference.predict()
        assert np.max(np.abs(w - want.predicted[k + 1]) / want.predicted_deviation[k + 1]) < 1e-12
        assert np.max(np.abs(np.sqrt(v) / want.predicted_deviation[k + 1] - 1)) < 1e-12
        assert reference.nis == pytest.approx(np.nan_to_num(want.nis[k + 1]), rel=1e-9)


RANGES = {
    "sin": (-50, 50), "cos": (-50, 50), "tan": (-1.5, 1.5), "exp": (-80, 80), "expm1": (-2, 2), "sinh": (-20, 20),
    "cosh": (-20, 20), "tanh": (-5, 5), "log": (1e-9, 9), "log1p": (-0.9, 5), "asinh": (-5, 5), "acosh": (1.1, 10),
    "atanh": (-0.99, 0.99), "atan": (-10, 10), "asin": (-1, 1), "acos": (-1, 1), "sqrt": (0, 1e6),
}  # fmt: skip


@pytest.mark.parametrize("dtype", ["f8", "f4"])
def test_elementary_functions_are_within_a_few_last_places(dtype: str) -> None:
    m, rng = Elementary(dtype), np.random.default_rng(0)
    with np.errstate(all="ignore"):
        for name, (low, high) in RANGES.items():
            for x in rng.uniform(low, high, 200).astype(dtype):
                want = getattr(math, name)(float(x))
                assert abs(getattr(m, name)(x) - want) <= 8 * np.spacing(m.type(abs(want))), (name, x)
        for x, y in rng.uniform(-3, 3, (200, 2)).astype(dtype):
            for name in ("atan2", "hypot"):
                want = getattr(math, name)(float(x), float(y))
                assert abs(getattr(m, name)(x, y) - want) <= 8 * np.spacing(m.type(abs(want))), (name, x, y)
            want = abs(float(x)) ** float(y)
            assert abs(m.pow(abs(x), y) - want) <= 16 * np.spacing(m.type(want)), (x, y)
        far = m.type(np.inf)
        assert m.exp(m.type(-1000)) == 0 and m.exp(m.type(1000)) == far and m.log(m.type(0)) == -far
        assert np.isnan(m.log(m.type(-1))) and np.isnan(m.sqrt(m.type(-1))) and np.isnan(m.sin(far))
        assert m.pow(m.type(-2), m.type(3)) == pytest.approx(-8) and np.isnan(m.pow(m.type(-2), m.type(0.5)))
        assert m.atan2(m.type(0), m.type(-1)) == m.type(math.pi) and m.atan2(m.type(0), m.type(0)) == 0
        assert m.floor(m.type(-2.5)) == -3 and m.ceil(m.type(-2.5)) == -2 and m.sign(m.type(-3)) == -1


def every_function() -> TargetPlan:
    """A plan whose formulas use every function that is written."""
    import casadi

    x, t = casadi.SX.sym("x", 3), casadi.SX.sym("t")
    u = 0.3 + 0.1 * casadi.tanh(x[0])  # from 0.2 to 0.4, so that every function is defined
    one = [getattr(casadi, name)(u) for name in RANGES if name != "acosh"] + [casadi.acosh(1 + u)]
    two = [casadi.atan2(u, x[1]), casadi.hypot(u, x[1]), u ** (1 + u), u**2.5, casadi.fmin(u, x[2]), casadi.fmax(u, t)]
    three = [casadi.floor(x[2]), casadi.ceil(x[1]), casadi.sign(x[1]), casadi.fabs(x[2]), 1 / u, casadi.log1p(u)]
    three += [casadi.if_else(x[1] > 0.1, u, 2 * u), casadi.logic_and(u > 0, x[1] < 3) + casadi.expm1(u)]
    f = casadi.vertcat(sum(one) - x[0] * 9, sum(two) - x[1] * 6, sum(three) - x[2] * 8)
    right = casadi.Function("right", [x, t], [f, casadi.jacobian(f, x)])
    h = casadi.vertcat(x[0] + x[1], casadi.sin(x[2]))
    report = casadi.Function("report", [x, t], [h, casadi.jacobian(h, x), casadi.SX.eye(2) * 0.01])
    N = 8
    return TargetPlan(
        edges=np.linspace(0, 0.4, N + 1), names=("one",), rows=(2,), active=[(0,)] * N, instants=True,
        formulas=FormulaModel(
            right=right, noise=None, reports=[report], angles=[(False, True)], mean=np.array([0.2, 0.4, 0.7]),
            covariance=np.eye(3) * 0.01, since=np.arange(N) * 0.05, lengths=np.full(N, 0.05), substeps=2,
            discrete=False, output=np.eye(1, 3), last=N,
        ),
    )  # fmt: skip


@needs_compiler
@pytest.mark.parametrize("precision", BOTH)
def test_every_function_has_the_same_bits_in_c(precision: str, tmp_path: Path) -> None:
    content = written(tmp_path, every_function(), BOTH[precision])
    used = content.programs["right"].needs
    assert set(RANGES) <= used | {"absolute"} and {"pow", "atan2", "hypot", "floor", "ceil", "sign"} <= used
    done = selftest(tmp_path, CC)
    assert done.returncode == 0, done.stdout


def test_operations_are_those_of_casadi() -> None:
    import casadi

    x, t = casadi.SX.sym("x", 3), casadi.SX.sym("t")
    value = casadi.vertcat(x[0] * x[1] / (1 + x[2] ** 2), (x[0] - t) ** 3, 1 / x[1], casadi.if_else(x[0] > 0, x[1], t))
    for entries, exact in ((value, True), (casadi.sin(value) + casadi.exp(-value), False)):
        function = casadi.Function("f", [x, t], [entries, casadi.jacobian(entries, x)])
        run = Program("f", function).runner("f8")
        for seed in range(20):
            at = np.random.default_rng(seed).normal(size=3)
            for mine, theirs in zip(run(at, np.float64(0.3)), map(casadi.DM.full, function(at, 0.3)), strict=True):
                assert np.array_equal(mine, theirs) if exact else np.allclose(mine, theirs, rtol=1e-13, atol=1e-14)
    with np.errstate(divide="ignore"):
        poles = Program("g", casadi.Function("g", [x, t], [1 / x])).runner("f8")(np.zeros(3), np.float64(0))[0]
    assert np.isinf(poles).all()


@needs_compiler
def test_a_failed_step_changes_nothing_and_a_missing_value_counts(tmp_path: Path) -> None:
    content = written(tmp_path, plan_of(TANK)[2])
    machine = Machine(tmp_path, content)
    f, none = machine.new(), np.full(content.values, np.nan)
    before = machine.said(f)
    assert machine.step(f, np.full(content.values, np.inf)) == Status.BAD_SAMPLE
    assert np.array_equal(machine.said(f), before)
    far = machine.new()
    assert machine.step(far, np.full(content.values, 1e308)) == Status.OK
    x = np.array(far.x)
    assert machine.step(far, np.full(content.values, -1e308)) == Status.OVERFLOW
    assert np.array_equal(far.x, x) and far.k == 1
    assert machine.step(f, none) == Status.OK and f.dimension == 0 and f.nis == 0 and f.planned == 0
    reference = reference_of(content)
    reference.step(none)
    assert list(f.x) == reference.x.tolist() and list(f.pivot) == reference.pivot.tolist()
    g = machine.new()
    valid = np.zeros(content.values)
    assert machine.step(g, np.ones(content.values), valid) == Status.OK
    assert np.array_equal(machine.said(g), machine.said(f))
    place, count = ctypes.c_uint32(), ctypes.c_uint32()
    assert machine.code.oc_place(0, 0, ctypes.byref(place), ctypes.byref(count)) == 0


def test_what_is_not_written_is_said() -> None:
    import casadi

    plan = plan_of(TANK)[2]
    with pytest.raises(UsageError, match="the gains of a nonlinear plant follow from the estimates"):
        make_content(plan, Options(gains_only=True))
    x, t = casadi.SX.sym("x", 1), casadi.SX.sym("t")
    with pytest.raises(UsageError, match="formulas with erf are not written for a target"):
        Program("f", casadi.Function("f", [x, t], [casadi.erf(x)]))
    big = casadi.Function("f", [x, t], [1e200 * x])
    with pytest.raises(UsageError, match=r"1e[+]200, which single precision does not hold"):
        Program("f", big).text(["f[1]"], "f4")
    unscented = TANK.replace("objective:", "replan: {estimator: ukf}\nobjective:")
    alone = plan_of(unscented)[2]
    assert alone.filter is None and "'ekf' is written" in alone.why
    averages = TANK.replace("samples: 6, predict_at: 4}\nsensing: samples", "intervals: 6}")
    alone = plan_of(averages)[2]
    assert alone.filter is None and "averages over intervals" in alone.why
    assert replace(plan, formulas=None).filter is None
    problem, solution, _ = plan_of(TANK)
    with pytest.raises(UsageError, match="the filter of a nonlinear plant has no tables for MATLAB\n  hint: --to fmu"):
        matlab.write(problem, solution, {}, Path("nowhere"))
