"""The extended Kalman filter of a nonlinear plant for a target: formulas and spans, as core/target.py wants them."""

from __future__ import annotations

from occontrol.core.kinds import CasadiFunction
from occontrol.core.schedule import Schedule
from occontrol.core.target import FormulaModel, TargetPlan, schedule_alone
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.nonlinear.linearise import linearisation_of
from occontrol.families.athans.nonlinear.online import NonlinearFilter
from occontrol.families.athans.nonlinear.plant import FormulaPlant
from occontrol.families.athans.nonlinear.sensor import FormulaSensor


def target_plan(problem: AthansProblem, schedule: Schedule) -> TargetPlan:
    """The schedule of a nonlinear plant and its filter for code on a target.

    Parameters
    ----------
    problem : with a nonlinear plant and an initial covariance
    schedule : to follow

    The schedule alone where the filter is not the extended one, or where sensors report averages over intervals.
    Raises TypeError for a linear plant.
    """
    origin = linearisation_of(problem)
    if origin is None:
        raise TypeError("the plant is linear")
    if origin.estimator != "ekf":
        why = f"the filter of this run is '{origin.estimator}', and of a nonlinear plant only 'ekf' is written"
        return schedule_alone(schedule, why)
    if not problem.takes_readings:
        return schedule_alone(schedule, "of a nonlinear plant averages over intervals have no step that is written")
    matched = NonlinearFilter(problem, schedule)
    chain, plant = matched.chain, origin.plant
    sensors = [origin.sensors.get(name) for name in matched.names]
    return TargetPlan(
        edges=matched.edges,
        names=matched.names,
        rows=matched.rows,
        active=matched.active,
        instants=True,
        variable=plant.variable,
        predicted_for=_when(problem),
        formulas=FormulaModel(
            right=_right(plant),
            noise=_noise(plant),
            reports=[None if sensor is None else _report(sensor) for sensor in sensors],
            angles=[() if sensor is None else tuple(sensor.angles) for sensor in sensors],
            mean=plant.whole_mean,
            covariance=plant.whole_covariance,
            since=chain.since,
            lengths=chain.lengths,
            substeps=chain.substeps,
            discrete=plant.discrete,
            output=matched.prediction.output[:0] if not matched.prediction.output.any() else matched.prediction.output,
            last=matched.prediction.last,
        ),
    )


def _when(problem: AthansProblem) -> str:
    at = getattr(problem, "output_at", None)
    return "" if at is None else f" at {'k' if problem.discrete else 't'} = {float(at):g}"


def _right(plant: FormulaPlant) -> CasadiFunction:
    import casadi

    x, t = casadi.SX.sym("x", len(plant.names)), casadi.SX.sym("t")
    right = plant.right(x, t)
    return casadi.Function("right", [x, t], [right, casadi.jacobian(right, x)])


def _noise(plant: FormulaPlant) -> CasadiFunction | None:
    import casadi

    x, t = casadi.SX.sym("x", len(plant.names)), casadi.SX.sym("t")
    found = casadi.sparsify(plant.flow.noise(x, t))
    if found.nnz() == 0:
        return None
    return casadi.Function("noise", [x, t], [(found + found.T) / 2])


def _report(sensor: FormulaSensor) -> CasadiFunction:
    import casadi

    x, t = casadi.SX.sym("x", len(sensor.plant.names)), casadi.SX.sym("t")
    h = sensor.values()(x, t)
    return casadi.Function("report", [x, t], [h, casadi.jacobian(h, x), sensor.covariance()(x, t)])
