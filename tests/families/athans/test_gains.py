"""Gains and deviations of a run by their formulas, and the filter's own word on its consistency."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import occontrol as oc
from occontrol.core.schedule import Schedule
from tests.families.athans.random_problems import random_problem


def certified():
    problem = random_problem(6, intervals=6, rows=2)
    names = tuple(problem.sensors.names)
    return problem, oc.certify(problem, Schedule(problem.edges, np.eye(3)[[0, 1, 2, 2, 0, 1]], names))


def test_the_continuous_gain_is_that_of_kalman_and_bucy():
    problem, solution = certified()
    P, found = solution.arrays["covariance"], solution.arrays["continuous_gain"]
    for k, j in enumerate([0, 1, 2, 2, 0, 1, 1]):  # the last node uses the last interval's sensor
        sensor, t = problem.sensors[j], problem.edges[k]
        expected = P[k] @ sensor.C.at(t).T @ np.linalg.inv(sensor.noise.at(t))
        np.testing.assert_allclose(found[k], expected, rtol=1e-9, atol=1e-12)


def filtered(factor: float):
    problem, solution = certified()
    measurements, _ = oc.simulate(problem, solution, seed=3)
    louder = [dataclasses.replace(m, values=factor * np.asarray(m.values)) for m in measurements]
    return problem, oc.run_filter(problem, solution, louder)


def test_the_deviation_of_the_output_is_that_of_its_covariance():
    problem, estimate = filtered(1.0)
    D = problem.output.at(0.0)
    for k, P in enumerate(estimate.covariance):
        np.testing.assert_allclose(estimate.output_deviation[k], np.sqrt(np.diag(D @ P @ D.T)), rtol=1e-12)
        np.testing.assert_allclose(estimate.output[k], D @ estimate.mean[k], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("factor", "word"), [(1.0, "inside"), (30.0, "OUTSIDE"), (0.0, "OUTSIDE")])
def test_innovations_that_are_too_large_or_too_small_are_told(factor, word):
    _, estimate = filtered(factor)
    (note,) = [note for note in estimate.notes if note.startswith("NIS: ")]
    assert f"per value on average, {word} its 99 % band [" in note
