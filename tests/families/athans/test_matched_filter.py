"""The on-line filter against an independent Kalman filter, with and without missing samples; every refusal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.integrate import solve_ivp

from occontrol.core.errors import ProblemError, UsageError
from occontrol.core.measurement import Measurement
from occontrol.families.athans.filter.kalman_bucy import run_filter
from occontrol.families.athans.filter.online import MatchedFilter
from occontrol.families.athans.filter.simulate import simulate
from tests.families.athans.scheduling_cases import cycling, moving


def flow(plant, a, b):
    """Phi, input and noise over a span by integrating their differential equations."""
    n = plant.states

    def rate(t, flat):
        phi, push, Q = flat[: n * n].reshape(n, n), flat[n * n : n * n + n], flat[n * n + n :].reshape(n, n)
        A = plant.A.at(t)
        drive = (plant.B.at(t) @ plant.input.at(t)).ravel()
        return np.concatenate([(A @ phi).ravel(), A @ push + drive, (A @ Q + Q @ A.T + plant.noise.at(t)).ravel()])

    start = np.concatenate([np.eye(n).ravel(), np.zeros(n + n * n)])
    end = solve_ivp(rate, (a, b), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return end[: n * n].reshape(n, n), end[n * n : n * n + n], end[n * n + n :].reshape(n, n)


def judge(problem, schedule, samples):
    """A plain split filter out of somebody else's Kalman filter (Joseph form)."""
    plant, edges = problem.plant, problem.edges
    kalman = KalmanFilter(dim_x=plant.states, dim_z=1, dim_u=1)
    kalman.x, kalman.P, kalman.B = plant.mean[:, None].copy(), plant.covariance.copy(), np.eye(plant.states)
    means, covariances = [plant.mean], [plant.covariance]
    for k in range(problem.intervals):
        a, b = edges[k], edges[k + 1]
        middle = (a + b) / 2
        F, push, Q = flow(plant, a, middle)
        kalman.predict(u=push[:, None], F=F, Q=Q)
        for j in np.flatnonzero(schedule.weights[k]):
            sensor = problem.sensors[j]
            z = samples.get((k, sensor.name))
            if sensor.rows and z is not None:
                kalman.dim_z = sensor.rows
                noise = sensor.noise.at(middle) / (b - a)
                kalman.update(z[:, None], R=noise, H=sensor.C.at(middle))
        F, push, Q = flow(plant, middle, b)
        kalman.predict(u=push[:, None], F=F, Q=Q)
        means.append(kalman.x[:, 0].copy())
        covariances.append(kalman.P.copy())
    return np.array(means), np.array(covariances)


def case(select=1):
    problem = moving(24, select)
    schedule = cycling(problem)
    measurements, truth = simulate(problem, schedule, 3)
    return problem, schedule, measurements, truth


def by_interval(problem, measurements):
    return {(int(np.argmin(np.abs(problem.edges[1:] - m.time))), m.sensor): m.values for m in measurements}


@pytest.mark.parametrize("select", [1, 2])
@pytest.mark.parametrize("dropped", [(), (0, 5, 6, 17)])
def test_filter_against_an_independent_kalman_filter(select, dropped):
    problem, schedule, measurements, _ = case(select)
    kept = [m for i, m in enumerate(measurements) if i not in dropped]
    estimate = run_filter(problem, schedule, kept)
    means, covariances = judge(problem, schedule, by_interval(problem, kept))
    np.testing.assert_allclose(estimate.mean, means, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(estimate.covariance, covariances, rtol=1e-10, atol=1e-10)
    announced = [note for note in estimate.notes if "missing" in note]
    assert len(announced) == bool(dropped)
    if dropped:
        lost = sum(len(measurements[i].values) for i in dropped)
        planned = sum(len(m.values) for m in measurements)
        assert announced[0].startswith(f"{lost} of {planned} planned values are missing, the first over [0, ")
        assert "computed anew" in announced[0]


def test_a_single_missing_value_leaves_the_others_of_its_sample():
    problem, schedule, measurements, _ = case()
    i = next(i for i, m in enumerate(measurements) if m.sensor == "both")
    partial = list(measurements)
    partial[i] = replace(measurements[i], values=np.array([measurements[i].values[0], np.nan]))
    estimate = run_filter(problem, schedule, partial)
    full = run_filter(problem, schedule, measurements)
    without = run_filter(problem, schedule, measurements[:i] + measurements[i + 1 :])
    k = by_interval(problem, [partial[i]]).popitem()[0][0] + 1
    traces = [np.trace(e.covariance[k]) for e in (full, estimate, without)]
    assert traces[0] < traces[1] < traces[2]
    assert estimate.dimension[k] == 1 and "1 of " in estimate.notes[0]


def test_the_order_of_the_measurements_does_not_matter():
    problem, schedule, measurements, _ = case(2)
    forward, backward = run_filter(problem, schedule, measurements), run_filter(problem, schedule, measurements[::-1])
    assert np.array_equal(forward.mean, backward.mean)


def test_rows_standard_deviations_and_outputs():
    problem, schedule, measurements, _ = case()
    estimate = run_filter(problem, schedule, measurements)
    assert np.array_equal(estimate.times, problem.edges)
    np.testing.assert_allclose(estimate.standard_deviation**2, np.diagonal(estimate.covariance, axis1=1, axis2=2))
    assert np.isnan(estimate.nis[0]) and estimate.dimension[0] == 0
    D = problem.output.at(problem.edges[7])
    np.testing.assert_allclose(estimate.output[7], D @ estimate.mean[7])
    np.testing.assert_allclose(estimate.output_deviation[7] ** 2, np.diag(D @ estimate.covariance[7] @ D.T))
    assert np.all(np.diff(estimate.predicted_deviation[:, 0]) <= 1e-12)  # information about w(Tp) is never lost


def test_steps_on_line_are_the_filter():
    problem, schedule, measurements, _ = case()
    estimate = run_filter(problem, schedule, measurements)
    samples = by_interval(problem, measurements)
    online = MatchedFilter(problem, schedule)
    k = 0
    while not online.finished:
        names = online.next_sensors
        step = online.step({name: samples[k, name] for name in names} if names else None)
        k += 1
        assert np.array_equal(step.estimate, estimate.mean[k]) and step.time == problem.edges[k]
        assert np.array_equal(step.prediction, estimate.predicted[k]) and step.planned
    assert k == 24 and online.next_sensors == ()
    with pytest.raises(ProblemError, match="the horizon is over"):
        online.step(None)
    online.restart()
    assert online.next_sensors == ("place",)
    assert not online.step(None).planned


def test_values_alone_are_enough_when_one_sensor_is_in_use():
    problem, schedule, measurements, _ = case()
    named, bare = MatchedFilter(problem, schedule), MatchedFilter(problem, schedule)
    first = measurements[0]
    assert np.array_equal(named.step({first.sensor: first.values}).estimate, bare.step(first.values).estimate)
    with pytest.raises(ProblemError, match="sensor 'place' is not in use, in use: speed"):
        bare.step({"place": [1.0]})
    with pytest.raises(ProblemError, match="1 finite values"):
        bare.step([1.0, 2.0])


def test_the_exact_model_is_offered_and_others_are_refused():
    problem, schedule, measurements, _ = case()
    split, exact = (run_filter(problem, schedule, measurements, model) for model in ("split", "exact"))
    assert not np.allclose(split.mean[-1], exact.mean[-1], atol=1e-9)
    np.testing.assert_allclose(split.mean[-1], exact.mean[-1], atol=0.05)
    with pytest.raises(UsageError, match="no filter model 'exakt'"):
        run_filter(problem, schedule, measurements, "exakt")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"time": -1.0}, r"'place' at t = -1 lies outside the horizon \[0, 4\]"),
        ({"time": 0.0}, r"outside the horizon"),
        ({"time": 4.5}, r"outside the horizon"),
        ({"time": 0.1}, r"'place' at t = 0.1 is not at the end of an interval"),
        ({"sensor": "speed"}, r"'speed' is not in use over \[0, .*in use: place"),
        ({"sensor": "radar"}, r"no sensor 'radar'"),
        ({"values": np.array([1.0, 2.0])}, r"'place' has 2 values, it must have 1"),
        ({"values": np.array([np.inf])}, r"'place' is infinite"),
        ({"time": np.nan}, r"'place' has no finite time"),
    ],
)
def test_samples_that_do_not_belong_are_refused_by_name_and_line(changed, words):
    import re

    problem, schedule, measurements, _ = case()
    wrong = [replace(measurements[0], line=14, **changed), *measurements[1:]]
    with pytest.raises(ProblemError) as caught:
        run_filter(problem, schedule, wrong)
    text = str(caught.value)
    assert text.startswith("line 14: ") and re.search(words, text, re.DOTALL), text


def test_a_second_sample_and_several_mistakes_together():
    problem, schedule, measurements, _ = case()
    twice = [*measurements, replace(measurements[2], line=40), Measurement(9.0, "place", np.array([1.0]), 41)]
    with pytest.raises(ProblemError) as caught:
        run_filter(problem, schedule, twice)
    assert "line 40: sensor 'both' has a second sample" in str(caught.value) and "line 41: " in str(caught.value)


def test_a_coarse_grid_is_announced():
    problem = moving(2)
    problem = replace(problem, plant=replace(problem.plant, covariance=[[250.0, 0], [0, 250.0]]))
    schedule = cycling(problem)
    measurements, _ = simulate(problem, schedule, 1)
    assert any("coarse" in note for note in run_filter(problem, schedule, measurements).notes)
    assert not any("coarse" in note for note in run_filter(problem, schedule, measurements, "exact").notes)


def spoilt(measurements, i, jump):
    wrong = list(measurements)
    wrong[i] = replace(measurements[i], values=measurements[i].values + jump)
    return wrong


def test_an_outlier_is_located_by_time_sensor_and_nis():
    problem, schedule, measurements, _ = case()
    assert not any("outlier" in note for note in run_filter(problem, schedule, measurements).notes)
    i = next(i for i, m in enumerate(measurements) if m.sensor == "speed" and m.time > 2)
    notes = run_filter(problem, schedule, spoilt(measurements, i, 60.0)).notes
    (note,) = [note for note in notes if "outlier" in note]
    assert note.startswith(f"outlier: the sample of sensor 'speed' at t = {measurements[i].time:.9g}"), note
    assert "exceeds 23.93 once in a million for 1 value; a gate leaves such samples out" in note
    loop = MatchedFilter(problem, schedule)
    samples = by_interval(problem, spoilt(measurements, i, 60.0))
    found = {}
    while not loop.finished:
        k = loop.k
        found |= {k: loop.step({n: samples[k, n] for n in loop.next_sensors}).samples}
    nis = max(value for each in found.values() for value, _ in each.values())
    assert f"its NIS is {nis:.4g}, " in note


@pytest.mark.parametrize("select", [1, 2])
def test_a_gate_leaves_an_outlier_out_and_says_so(select):
    problem, schedule, measurements, _ = case(select)
    i = next(i for i, m in enumerate(measurements) if m.sensor == "both" and m.time > 2)
    gated = run_filter(problem, schedule, spoilt(measurements, i, 80.0), gate=0.99999)
    without = run_filter(problem, schedule, measurements[:i] + measurements[i + 1 :])
    np.testing.assert_array_equal(gated.mean, without.mean)
    np.testing.assert_array_equal(gated.covariance, without.covariance)
    np.testing.assert_array_equal(gated.dimension, without.dimension)
    assert gated.notes[0].startswith(
        f"gate 0.99999: 1 sample left out (it is of sensor 'both' at t = {measurements[i].time:.9g}, NIS "
    )
    assert not any("missing" in note or "outlier" in note for note in gated.notes)
    clean = run_filter(problem, schedule, measurements, gate=0.99999)
    np.testing.assert_array_equal(clean.mean, run_filter(problem, schedule, measurements).mean)
    assert not any("gate" in note for note in clean.notes)
    with pytest.raises(UsageError, match="gate is 2, it must be a probability between 0 and 1"):
        run_filter(problem, schedule, measurements, gate=2)


def test_a_sensor_is_judged_by_its_own_innovation():
    """With two sensors in an interval the good one stays; its NIS is that of its own rows."""
    problem, schedule, measurements, _ = case(2)
    loop = MatchedFilter(problem, schedule, gate=0.9999)
    P, model = problem.plant.covariance, loop.model
    first = [m for m in measurements if m.time == problem.edges[1]]
    assert len(first) == 2
    sample = {first[0].sensor: first[0].values, first[1].sensor: first[1].values + 1e3}
    done = loop.step(sample)
    assert done.skipped == (first[1].sensor,) and done.dimension == len(first[0].values) and not done.planned
    for j, place in model.places(0).items():
        H, R = model.observe[0][place], model.reading_noise[0][place, place]
        e = sample[model.names[j]] - H @ problem.plant.mean - model.offset[0][place]
        expected = e @ np.linalg.solve(H @ P @ H.T + R, e)
        assert done.samples[model.names[j]] == (pytest.approx(expected, rel=1e-12), len(e))


def test_a_schedule_over_another_horizon_is_refused():
    problem, schedule, _, _ = case()
    shorter = replace(schedule, edges=schedule.edges / 2)
    for model in ("split", "exact"):
        with pytest.raises(ProblemError, match="nothing is scheduled between t = 2 and 4"):
            MatchedFilter(problem, shorter, model)
