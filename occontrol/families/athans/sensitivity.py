"""What the optimal cost would change by if a price, a noise, a window or the number of places changed: from one sweep.

J* is the relaxed optimum, which no schedule undercuts, at its policy v. By the envelope theorem its derivatives are
those of J at v held fixed, and g = dJ/dv holds them all:
    price       dJ*/dq_j  = alpha h.v_j                        for a constant added to q_j
    noise       dJ*/dln f = -sum_k v_kj (g_kj - price_kj)      for Theta_j times f: information h v_j L_j/f
    row         dJ*/dp    = -c M_j c',  M_j = int v_j Sigma P Sigma dt      for a further row c of C_j with precision p
    matrix      dJ*/dTheta_j = Theta^-1 C M_j C' Theta^-1                   where C_j and Theta_j are constant
    entry       a sensor that v never uses enters when its price falls by  min_k (g_kj - lambda_k)/(alpha h_k)
    window      dJ*/dt = min_w s.w with the sensor - min_w s.w without it, at the end of the window; s = g/h there
    places      J*(m + 1) >= J + min over m + 1 places of g.(w - v): J is convex, so this is a bound
lambda_k is the marginal gradient of interval k, that of the last place. Athans (1971), (5.4), (5.12) for s.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.kinds import PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.result import ResultData
from occontrol.core.scaled_signal import scaled
from occontrol.core.sensor import Sensor
from occontrol.core.solution import Certificate, Solution, Status
from occontrol.families.athans.balanced import balanced
from occontrol.families.athans.discretise import feasible_set
from occontrol.families.athans.integration.folded import Folded
from occontrol.families.athans.integration.integrator import Evaluation, Integrator
from occontrol.families.athans.integration.local_error import node_matrices
from occontrol.families.athans.integration.relaxed import relax
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.window_ends import window_ends
from occontrol.scheduling.proof import Proof, prove
from occontrol.scheduling.relaxation import RelaxedOptions

GAP = 1e-8  # of the relaxation whose policy is differentiated
MOST_STEPS = 3000
USED = 1e-7  # of the horizon: a sensor that is used less is not used


@dataclass(frozen=True)
class Sensitivities(ResultData):
    """What the optimal cost would change by.

    Parameters
    ----------
    name : of the problem
    cost, lower_bound : of the relaxed optimum that is differentiated, on the problem's edges
    sensors : {name: {time, share, price, noise, noise_matrix, entry_price, states}}: time in use, its share of the
        horizon, dJ/dq, dJ/dln of a factor on the noise, dJ/dTheta, by how much the price must fall until an unused
        sensor is used, dJ/dp of a further row that reads one state with precision p
    windows : [{sensor, t, end: start | end, longer, shorter}]: dJ/dt of moving an end of a window outwards and inwards
    select : {value, one_more}: the places, and what no schedule with one more place undercuts at these edges
    changes : certified intervals of J* where a price or a noise changes, {sensor: {what: [low, high]}}; empty where
        they were not asked for
    """

    name: str
    cost: float
    lower_bound: float
    sensors: PlainDict
    windows: list[PlainDict]
    select: PlainDict
    changes: PlainDict = field(default_factory=dict)

    @property
    def relative_gap(self) -> float:
        """(cost - lower_bound)/|cost|"""
        return (self.cost - self.lower_bound) / abs(self.cost) if self.cost else 0.0


@dataclass(frozen=True, eq=False)
class Use:
    """A relaxed optimum and its gradient, from which the numbers of a sensor follow.

    Parameters
    ----------
    lengths : (N,) of the decisions; 1 for readings
    upper : (N, M) largest weights
    weights, gradient : (N, M) the policy and dJ/dv
    prices : (N, M) the part of the gradient that prices make
    """

    lengths: np.ndarray
    upper: np.ndarray
    weights: np.ndarray
    gradient: np.ndarray
    prices: np.ndarray

    @cached_property
    def marginal(self) -> np.ndarray:
        """(N,) the gradient of the last place of every decision: what a sensor has to undercut."""
        return np.max(np.where(self.weights > USED, self.gradient, -np.inf), axis=1)

    def of(self, j: int, cost_weight: float) -> PlainDict:
        """Time, share, price, noise and, for what is not used, the entry price of sensor j.

        Parameters
        ----------
        j : number of the sensor
        cost_weight : alpha
        """
        h, v, g = self.lengths, self.weights[:, j], self.gradient[:, j]
        whole = float(np.sum(h))
        time = float(h @ v) if h @ v > USED * whole else 0.0
        found: PlainDict = {
            "time": time,
            "share": time / whole,
            "price": cost_weight * time,
            "noise": max(0.0, -float(v @ (g - self.prices[:, j]))) if time else 0.0,
        }
        open_now = self.upper[:, j] > 0
        if not time and cost_weight and np.any(open_now):
            distance = (g - self.marginal)[open_now] / (cost_weight * h[open_now])
            found["entry_price"] = -max(0.0, float(np.min(distance)))
        return found


def sensitivity(
    problem: SchedulingProblem, solution: Solution | None, monitor: Monitor, change: float | None = None
) -> Sensitivities:
    """Derivatives of the relaxed optimum of a problem.

    Parameters
    ----------
    problem : of continuous sensing, without rules
    solution : of it, whose relaxed policy is the start; None where there is none
    monitor : Monitor
    change : share by which price and noise of every sensor in use go down and up, each solved again, so that the change
        of J* lies between proven bounds; None: they are not solved again

    Raises UsageError for problems with rules, InfeasibleError where no schedule exists.
    """
    if problem.ruled:
        hint = "leave the rules out: what they cost is the difference of the two bounds"
        raise UsageError(f"sensitivities are those of a problem without rules\n  hint: {hint}")
    problem.require_feasible()
    inner, units = balanced(problem)
    integrator = Integrator(inner, GAP)
    start = None if solution is None else solution.arrays.get("relaxed_weights")
    if start is not None and start.shape != inner.upper.shape:
        start = None
    monitor.stage = "relaxation"
    found = relax(integrator, RelaxedOptions(GAP, MOST_STEPS), monitor, start).outcome
    if found.status is Status.INTERRUPTED:
        raise UsageError("interrupted before the relaxation was done")
    at = integrator.evaluate(found.weights)
    proof = _proven(integrator, at, found.lower_bound)
    use = Use(problem.steps, problem.upper, at.weights, at.gradient, _prices(integrator, at))
    moments = [units.inverse.covariance(M) for M in _moments(integrator, at)]
    sensors = {
        sensor.name: {**use.of(j, problem.cost_weight), **_of_rows(problem, sensor, moments[j])}
        for j, sensor in enumerate(problem.sensors)
        if sensor.rows
    }
    return Sensitivities(
        name=problem.name,
        cost=proof.certificate.cost,
        lower_bound=proof.certificate.lower_bound,
        sensors=sensors,
        windows=window_ends(inner, integrator, at),
        select={"value": inner.select, "one_more": _one_more(inner, at, proof.allowance)},
        changes={} if change is None else _changes(inner, proof.certificate, at.weights, change, monitor),
    )


def _proven(integrator: Integrator, at: Evaluation, bound: float) -> Proof:
    """Cost and lower bound of a relaxed optimum in square-root form, as those of a solve are proven."""
    return prove([at.judged(integrator.recursion)], feasible_set(integrator.problem), bound)


def _changes(
    problem: SchedulingProblem, at: Certificate, weights: np.ndarray, change: float, monitor: Monitor
) -> PlainDict:
    """[low, high] of the change of J* for each sensor in use, from bounds on both sides of the same edges."""
    found: PlainDict = {}
    for j, sensor in enumerate(problem.sensors):
        if not sensor.rows or not np.any(weights[:, j] > USED):
            continue
        one = np.ones(sensor.rows)
        found[sensor.name] = {}
        for word, factor in ((f"-{100 * change:g} %", 1 - change), (f"+{100 * change:g} %", 1 + change)):
            root = np.sqrt(factor) * one
            cheaper = replace(sensor, cost=scaled(sensor.cost, np.array([factor]), np.array([1.0])))
            noisier = replace(sensor, noise=scaled(sensor.noise, root, root))
            for what, other in (("price", cheaper), ("noise", noisier)):
                monitor.stage = f"{what} of {sensor.name} {word}"
                integrator = Integrator(with_sensor(problem, j, other), GAP)
                found_now = relax(integrator, RelaxedOptions(GAP, MOST_STEPS), monitor, weights).outcome
                again = _proven(integrator, integrator.evaluate(found_now.weights), found_now.lower_bound).certificate
                low, high = again.lower_bound - at.cost, again.cost - at.lower_bound
                found[sensor.name][f"{what} {word}"] = [low, high]
    return found


def with_sensor(problem: SchedulingProblem, j: int, sensor: Sensor) -> SchedulingProblem:
    """The problem with another sensor in place of sensor j.

    Parameters
    ----------
    problem : SchedulingProblem
    j : number of the sensor
    sensor : Sensor
    """
    sensors = [*problem.sensors]
    sensors[j] = sensor
    return replace(problem, sensors=replace(problem.sensors, sensors=tuple(sensors)))


def _of_rows(problem: SchedulingProblem, sensor: Sensor, moment: np.ndarray) -> PlainDict:
    """What further rows of a sensor and changes of its noise are worth; `moment` (n, n) in the user's states."""
    found: PlainDict = {"states": (-np.diag(moment)).tolist()}
    if sensor.C.constant and sensor.noise.constant:
        t = float(problem.edges[0])
        weighed = np.linalg.solve(sensor.noise.at(t), sensor.C.at(t))
        found["noise_matrix"] = (weighed @ moment @ weighed.T).tolist()
    return found


def _prices(integrator: Integrator, at: Evaluation) -> np.ndarray:
    """(N, M) the part of the gradient that prices make."""
    if at.on is None:
        return integrator.recursion.decision_cost
    return sum((share * f.gathered(f.fine.cost) for share, f in _meshes(at)), np.zeros(()))


def _meshes(at: Evaluation) -> list[tuple[float, Folded]]:
    if isinstance(at.on, Folded):
        return [(1.0, at.on)]
    return [] if at.on is None else [(4 / 3, at.on.half), (-1 / 3, at.on.whole)]


def _moments(integrator: Integrator, at: Evaluation) -> np.ndarray:
    """(M, n, n) int v_j Sigma P Sigma dt by the trapezoidal rule on the steps, extrapolated as the cost is."""
    meshes = _meshes(at)
    if not meshes:
        mesh = Folded(integrator.spans, integrator.first if not integrator.plain else integrator.fixed.mesh)
        meshes = [(1.0, mesh)]
    total = np.zeros(())
    for share, folded in meshes:
        folded.cost_and_gradient(at.weights)
        S, P = node_matrices(folded, at.weights)
        T = S @ P @ S
        spans = folded.mesh.steps[:, None] * at.weights[folded.mesh.owner]
        total = total + share * np.einsum("kj,kab->jab", spans, (T[1:] + T[:-1]) / 2)
    return total


def _one_more(problem: SchedulingProblem, at: Evaluation, allowance: float) -> float | None:
    """What no schedule with one more place undercuts at these edges; None where there are no sensors for one.

    `allowance` is what rounding may have moved the cost; the tangent's own sums are lowered by their last digits.
    """
    more = problem.select + 1
    upper = np.where(problem.upper > 0, np.maximum(problem.upper, [s.rows == 0 and more for s in problem.sensors]), 0.0)
    if np.any(np.sum(upper, axis=1) < more):
        return None
    wider = replace(feasible_set(problem), select=more, upper=upper)
    change = at.gradient * (wider.vertex(at.gradient) - at.weights)
    digits = change.size * np.finfo(float).eps * float(np.sum(np.abs(at.gradient) * wider.upper))
    return at.cost + float(np.sum(change)) - at.error - allowance - digits
