"""The product's problems of the 60-digit judge's data, what the default method finds for them, and its proof."""

from __future__ import annotations

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.families.athans.balanced import balanced
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.integration.refine import search_space
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.scheduling.proof import Proof, prove
from tests.decimal_recursion import Data


def as_problem(data: Data) -> SchedulingProblem:
    """The product's problem of the judge's data, with one step an interval as the judge has."""
    sensors = [
        Sensor(f"s{j}", C, theta, q) if len(C) else idle_sensor(len(data.A))
        for j, (C, theta, q) in enumerate(data.sensors)
    ]
    plant = LinearPlant(data.A, data.noise, data.covariance)
    more = {"cost_weight": data.cost_weight, "running": data.running, "integration": Integration(substeps=1)}
    return SchedulingProblem("random", plant, sensors, data.edges, data.output, **more)


def proven(problem: SchedulingProblem) -> tuple[np.ndarray, Proof]:
    """The schedule that the default method finds, and the proof of its cost."""
    inner, _ = balanced(problem)
    method, monitor = RelaxRoundPolish(relative_gap=1e-7, max_iterations=300), Monitor()
    integrator, sweep = search_space(inner, method, monitor)
    allowed = feasible_set(inner)
    found = method.run(inner, sweep, allowed, monitor)
    policies = [integrator.evaluate(v).judged(integrator.recursion) for v in (found.weights, found.relaxed.weights)]
    return found.weights, prove(policies, allowed, found.relaxed.lower_bound)
