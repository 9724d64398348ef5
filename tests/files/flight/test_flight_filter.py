"""The filter of the target, in Python: it is the Kalman filter, whatever arrives, and what `occontrol filter` says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from occontrol.api import family_of, run_filter, simulate
from occontrol.core.measurement import Measurement
from occontrol.files.export.flight.content import Options, make_content
from occontrol.files.export.flight.plan import unit_factor
from occontrol.files.export.flight.reference import ReferenceFilter, Status
from occontrol.files.export.flight.tables import distinct
from tests.files.flight.plans import plain_filter, random_plan

EPS = np.finfo(float).eps
LOST = ("none", "first", "random")


def lose(samples: list[np.ndarray], pattern: str, seed: int = 0) -> list[np.ndarray]:
    """Some values become NaN."""
    rng, found = np.random.default_rng(seed), [z.copy() for z in samples]
    if pattern == "first":
        next(z for z in found if len(z))[0] = np.nan
    if pattern == "random":
        for z in found:
            z[rng.random(len(z)) < 0.3] = np.nan
    return found


def replay(reference: ReferenceFilter, samples: list[np.ndarray]) -> dict[str, np.ndarray]:
    found: dict[str, list] = {name: [] for name in ("x", "P", "w", "v", "nis")}
    for k in range(len(samples) + 1):
        w, v = reference.predict()
        values = (reference.x, reference.covariance(), w, v, reference.nis)
        for name, value in zip(found, values, strict=True):
            found[name].append(value)
        assert np.array_equal(np.diag(found["P"][-1]), reference.variance())
        if k < len(samples):
            assert reference.step(samples[k]) == Status.OK
    return {name: np.array(value, dtype=float) for name, value in found.items()}


@pytest.mark.parametrize("pattern", LOST)
@pytest.mark.parametrize("options", [Options(), Options(no_plan=True), Options(precision="single")], ids=str)
@pytest.mark.parametrize("rank", [None, 1])
def test_it_is_the_textbook_filter(pattern: str, options: Options, rank: int | None) -> None:
    plan = random_plan(seed=3, rank=rank)
    assert plan.model is not None
    rng = np.random.default_rng(1)
    samples = lose([rng.standard_normal(len(d)) for d in plan.model.offset], pattern)
    found, want = replay(ReferenceFilter(make_content(plan, options)), samples), plain_filter(plan.model, samples)
    close = 1e-11 if options.precision == "double" else 2e-4
    for name, value in want.items():
        assert np.allclose(found[name], value, rtol=close, atol=close * float(np.max(np.abs(value)))), name


CASES = [(name, pattern) for name in ("radar_discrete", "survey_panel", "small") for pattern in LOST]


@pytest.mark.parametrize("name, pattern", [*CASES, ("tracking_network", "random")])
def test_it_says_what_occontrol_filter_says(name: str, pattern: str, solved, small_solution) -> None:
    """Within 1e-12 standard deviations, for rates with the split and the exact model, and for readings."""
    solution = small_solution if name == "small" else solved(name)
    problem = solution.problem
    plan = family_of(problem).target_plan(problem, solution)
    given = lose([s.values for s in simulate(problem, solution, 5)[0]], pattern)
    measurements = [
        Measurement(s.time, s.sensor, z)
        for s, z in zip(simulate(problem, solution, 5)[0], given, strict=True)
    ]
    want = run_filter(problem, solution, measurements)
    samples = [np.full(len(d), np.nan) for d in plan.model.offset]
    for s in measurements:
        j = plan.names.index(s.sensor)
        k = int(np.argmin(np.abs(plan.edges[1:] - s.time)))
        if plan.instants and len(plan.edges) > 1 and plan.edges[1] == plan.edges[0] == s.time:
            k = 0
        first = sum(plan.rows[i] for i in plan.active[k] if i < j)
        samples[k][first : first + plan.rows[j]] = s.values
    found = replay(ReferenceFilter(make_content(plan, Options())), samples)
    sd = want.standard_deviation
    # a mean of many standard deviations loses one in its own last place at every step
    off = np.abs(found["x"] - want.mean) - len(samples) * EPS * np.max(np.abs(want.mean), axis=0)
    assert np.max(off / sd) < 1e-12
    assert np.max(np.abs(np.sqrt(np.einsum("kii->ki", found["P"])) / sd - 1)) < 1e-12
    terms = np.einsum("kpn,kn->kp", np.abs(plan.model.predict_matrix), np.abs(want.mean))
    off = np.abs(found["w"] - want.predicted) - len(samples) * EPS * np.max(terms, axis=0)
    assert np.max(off / want.predicted_deviation) < 1e-12
    assert np.max(np.abs(np.sqrt(found["v"]) / want.predicted_deviation - 1)) < 1e-12


def test_planned_and_computed_steps_agree() -> None:
    plan = random_plan(seed=8)
    rng = np.random.default_rng(2)
    samples = [rng.standard_normal(len(d)) for d in plan.model.offset]
    planned = replay(ReferenceFilter(make_content(plan, Options())), samples)
    computed = replay(ReferenceFilter(make_content(plan, Options(no_plan=True))), samples)
    for name, value in planned.items():
        assert np.allclose(computed[name], value, rtol=1e-12, atol=1e-12 * np.max(np.abs(value))), name


def test_a_diffuse_start_beside_an_accurate_sensor_keeps_its_digits() -> None:
    """P = 1e16, R = 1e-12: by the information form, in whole numbers of 50 digits, P+ = 1e-12/(1 + 1e-28)."""
    plan = random_plan(seed=1, intervals=1, states=1, rows=(1,), outputs=0, active=[(0,)])
    model = plan.model
    assert model is not None
    model.transition[:], model.observe[0][:], model.covariance[:] = 1.0, 1.0, 1e16
    model.noise_root[0][:] = [[0.0, 0.0], [0.0, 1e-6]]
    for options in (Options(), Options(no_plan=True)):
        reference = ReferenceFilter(make_content(plan, options))
        assert reference.step(np.array([2.0])) == Status.OK
        assert reference.variance()[0] == pytest.approx(1e-12, rel=1e-12)


def test_a_factor_of_a_singular_matrix_is_that_matrix() -> None:
    for root in (np.array([[0.0, 0.0], [0.0, 1.0]]), np.array([[1.0, 2.0], [3.0, 6.0], [1.0, 0.0]])):
        packed, pivot = unit_factor(root)
        L = np.eye(len(root))
        L[np.tril_indices(len(root), -1)] = packed
        assert np.allclose(L @ np.diag(pivot) @ L.T, root @ root.T, rtol=0, atol=1e-14)
    assert unit_factor(np.array([[1.0], [2.0]]))[1][1] == 0.0


def test_rows_that_differ_by_rounding_are_one() -> None:
    rows = np.array([[1.0, 0.0], [1.0 + 2e-16, 0.0], [1.0, 1e-20], [1.0 + 1e-10, 0.0]])
    kept, index = distinct(rows, np.array([[1e-13, 1e-23]] * 4))
    assert kept.tolist() == [0, 2, 3] and index.tolist() == [0, 0, 1, 2]
    assert distinct(rows)[1].tolist() == [0, 1, 2, 3]


def test_an_equal_grid_has_few_different_intervals(solved) -> None:
    solution = solved("radar_discrete")
    plan = family_of(solution.problem).target_plan(solution.problem, solution)
    content = make_content(plan, Options())
    assert len(content.table("transition")) == 2  # to the first reading, and between readings
    assert len(content.table("noise_pivot")) < plan.intervals


def test_gains_alone_know_that_the_plan_no_longer_holds() -> None:
    plan = random_plan(seed=4, active=[(0, 1)] * 12)
    reference, full = (ReferenceFilter(make_content(plan, o)) for o in (Options(gains_only=True), Options()))
    z = np.array([0.3, -0.2, 0.5])
    assert reference.step(z) == full.step(z) == Status.OK
    assert reference.planned and np.array_equal(reference.x, full.x)
    assert np.allclose(reference.variance(), full.variance(), rtol=1e-13)
    assert np.allclose(reference.predict()[1], full.predict()[1], rtol=1e-12)
    K = plan_gain(full)
    x = plan.model.transition[1] @ reference.x + plan.model.input[1]
    e = z - plan.model.observe[1] @ reference.x - plan.model.offset[1]
    assert reference.step(np.array([0.3, np.nan, 0.5])) == Status.OK
    assert np.allclose(reference.x, x + K[:, [0, 2]] @ e[[0, 2]], rtol=1e-13)
    assert not reference.planned and reference.dimension == 0


def plan_gain(reference: ReferenceFilter) -> np.ndarray:
    return reference.content.row("gain", 1).reshape(reference.m, reference.n).T


def test_a_start_in_the_middle_has_the_planned_covariance(tmp_path: Path) -> None:
    plan = random_plan(seed=6)
    through, late = ReferenceFilter(make_content(plan, Options())), ReferenceFilter(make_content(plan, Options()))
    rng = np.random.default_rng(0)
    samples = [rng.standard_normal(len(d)) for d in plan.model.offset]
    for k in range(5):
        through.step(samples[k])
    assert late.init_at(5, through.x) == Status.OK
    for k in range(5, plan.intervals):
        assert through.step(samples[k]) == late.step(samples[k]) == Status.OK
    assert np.array_equal(through.x, late.x) and np.array_equal(through.covariance(), late.covariance())
