"""Direct collocation of the relaxed problem by Ipopt: the independent judge for small problems, not the engine.

It starts from a simulated feasible policy, never from an optimum, and shares nothing with the recursion or the sweep.
The unknowns and their order stand in collocation_program.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.athans.collocation.mesh import Mesh, simulate_mesh
from occontrol.families.athans.collocation.points import butcher_table
from occontrol.families.athans.collocation.program import Transcription, frames
from occontrol.families.athans.collocation.simulation import terminal_weight
from occontrol.families.athans.hamiltonian import information_rates
from occontrol.families.athans.methods import Collocation
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.numerics.nlp import IpoptOptions

ROUNDS = 6
STEP = 0.7
GROWTH_STEP = 3.0
INFORMATION = 2.0
SHARE = 0.9
# Where MUMPS counts a wrong inertia, look at the curvature along the step (Chiang, Zavala 2016) and add to the Hessian
# only if it is not positive: the problem is convex in the weights but nearly flat in most directions, the count is then
# not to be trusted, and what Ipopt would add turns Newton's steps into hundreds of gradient steps.
FIRST = (("neg_curv_test_tol", 1e-14), ("mu_init", 0.1))
AGAIN = (("neg_curv_test_tol", 1e-14), ("mu_init", 1e-3), ("bound_push", 1e-6), ("bound_frac", 1e-6))


@dataclass(frozen=True, eq=False)
class RawOutcome:
    """What the collocation found, in plain arrays.

    Parameters
    ----------
    weights : (N, M), made exactly feasible
    cost : of the collocated problem
    covariance, costate : (N + 1, n, n) at the nodes; the costate from the multipliers
    iterations : of Ipopt, all rounds together
    status, message
    elements : of the last mesh
    """

    weights: np.ndarray
    cost: float
    covariance: np.ndarray
    costate: np.ndarray
    iterations: int
    status: Status
    message: str
    elements: int


def solve_collocation(
    problem: SchedulingProblem, options: Collocation | None = None, monitor: Monitor | None = None
) -> RawOutcome:
    """Minimise the relaxed cost over weights that are constant on each interval, by collocation and Ipopt.

    The policy found is simulated again; where the collocated covariance does not follow it, elements are cut and
    Ipopt continues from there.

    Parameters
    ----------
    problem : SchedulingProblem with n states (n^6 growth: up to about 8), M sensors, N intervals
    options : Collocation
    monitor : Monitor

    Raises SolveFailed when there is no usable iterate.
    Athans (1971), (4.1)-(4.4), with 0 <= v <= 1.
    """
    options = options or Collocation()
    monitor = (monitor or Monitor()).child(options.time_limit)
    table = butcher_table(options.scheme, options.stages)
    W = terminal_weight(problem)
    weights = uniform_policy(problem)
    information = information_form(problem)
    by_growth = information and problem.running is None
    longest = GROWTH_STEP if by_growth else STEP
    mesh = simulate_mesh(problem, weights, table[2], longest, by_growth)
    iterations, accuracy = 0, 0.1 * options.relative_gap
    tolerance = max(0.01 * options.relative_gap, 1e-9)
    # so that the gradient by the weights of one interval is about 1, as Ipopt's barrier and tolerances expect
    unit = abs(simulated_cost(problem, weights, mesh, table, W)) / problem.intervals or 1.0
    for turn in range(ROUNDS):
        transcription = Transcription(problem, table, mesh, W, information)
        limits = IpoptOptions(options.max_iterations - iterations, tolerance, more=FIRST if turn == 0 else AGAIN)
        found = transcription.solve(weights, limits, monitor, unit)
        iterations += found.iterations
        weights = feasible_policy(problem, transcription.weights(found.x))
        covariance = transcription.covariances(found.x)
        costate = np.concatenate([transcription.costates(found), W[None]])
        step = longest / (1.0 if problem.running is None else 2.0 ** (turn + 1))  # the quadrature of tr(R Sigma)
        again = simulate_mesh(problem, weights, table[2], step, by_growth, mesh.starts)
        off = abs(simulated_cost(problem, weights, again, table, W) - found.objective) / max(
            abs(found.objective), 1e-300
        )
        if found.status is not Status.FEASIBLE or off <= accuracy or turn == ROUNDS - 1:
            break
        cuts = np.append(mesh.starts, finer_cuts(mesh, covariance, costate, again))
        mesh = simulate_mesh(problem, weights, table[2], step, by_growth, cuts)
    message = found.message
    if found.status is Status.FAILED and found.violation < 0.1:
        status = Status.LIMIT
    else:
        status = found.status
    if status is Status.FEASIBLE and off > accuracy:
        message += f"; its cost is {off:.1e} off a simulation of its policy: use more intervals"
    nodes = np.append(mesh.first, len(mesh.starts))
    return RawOutcome(
        weights=weights,
        cost=found.objective,
        covariance=covariance[nodes],
        costate=costate[nodes],
        iterations=iterations,
        status=status,
        message=message,
        elements=len(mesh.starts),
    )


def finer_cuts(mesh: Mesh, covariance: np.ndarray, costate: np.ndarray, simulated: Mesh) -> np.ndarray:
    """Inner quarters of the elements that make up most of the error, in the cost or relative to the covariance.

    tr(P dSigma) at the end of an element is what the departure dSigma of the collocated from the simulated covariance
    will cost; what it changes by over an element is that element's share. Where dSigma is not small, in steep falls,
    its size relative to Sigma counts instead: both sets are cut.

    Parameters
    ----------
    mesh : Mesh of E elements
    covariance, costate : (E + 1, n, n) collocated, at their ends
    simulated : Mesh, a refinement, with the covariance of the same policy
    """
    place = np.append(0, np.append(np.searchsorted(simulated.starts, mesh.starts[1:]), len(simulated.starts)))
    off = covariance - simulated.ends[place]
    inverse = np.linalg.inv(frames(simulated.ends[place]))
    relative = np.linalg.norm(inverse @ off @ np.swapaxes(inverse, 1, 2), axis=(1, 2))
    in_cost = np.abs(np.diff(np.einsum("eij,eij->e", costate, off)))
    chosen = np.union1d(_most(in_cost), _most(np.maximum(np.diff(relative), 0.0)))
    return (mesh.starts[chosen, None] + mesh.lengths[chosen, None] * np.array([0.25, 0.5, 0.75])).ravel()


def _most(shares: np.ndarray) -> np.ndarray:
    """The fewest indices whose shares are together SHARE of the sum."""
    order = np.argsort(-shares)
    sums = np.cumsum(shares[order])
    return order[: 1 + np.searchsorted(sums, SHARE * sums[-1])]


def information_form(problem: SchedulingProblem) -> bool:
    """Whether the unknowns are better the inverses of the covariances.

    A large prior meets a sharp sensor at a time that is itself unknown: there the covariance falls by orders of
    magnitude within an interval, and polynomials through it are worthless, while its inverse grows like a straight
    line.
    """
    prior, start = problem.plant.covariance, problem.edges[:1]
    values = np.linalg.eigvalsh(prior)
    if not values[0] > 1e-10 * values[-1]:
        return False
    rates = [np.trace(information_rates(s.C.sample(start), s.noise.sample(start))[0] @ prior) for s in problem.sensors]
    growth = float(np.trace(np.linalg.solve(prior, problem.plant.noise.at(float(start[0])))))
    return max(rates) > max(growth, INFORMATION / float(np.max(problem.steps)))


def uniform_policy(problem: SchedulingProblem) -> np.ndarray:
    """(N, M): every available sensor the same share of its room."""
    return problem.upper * (problem.select / np.sum(problem.upper, axis=1, keepdims=True))


def simulated_cost(
    problem: SchedulingProblem, weights: np.ndarray, mesh: Mesh, table: tuple, terminal: np.ndarray
) -> float:
    """The cost of a policy with the covariance that SciPy gave, by the quadrature of the mesh.

    Parameters
    ----------
    problem : SchedulingProblem
    weights : (N, M)
    mesh : Mesh, simulated with these weights
    table : Butcher table
    terminal : (n, n) W
    """
    times = mesh.times(table[2])
    rule = mesh.lengths[:, None] * table[1]
    rates = np.stack([x.cost.sample(times.ravel()).reshape(times.shape) for x in problem.sensors], axis=-1)
    cost = problem.cost_weight * np.einsum("es,esm,em->", rule, rates, weights[mesh.interval])
    if problem.running is not None:
        running = problem.running.sample(times.ravel()).reshape(mesh.stages.shape)
        cost += np.einsum("es,esij,esij->", rule, running, mesh.stages)
    return float(cost + np.vdot(terminal, mesh.ends[-1]))


def feasible_policy(problem: SchedulingProblem, weights: np.ndarray) -> np.ndarray:
    """Weights clipped to their bounds, and what that changed given back in proportion to the room left.

    `weights` (N, M), as is the result.
    """
    clipped = np.clip(weights, 0.0, problem.upper)
    for _ in range(3):
        missing = problem.select - np.sum(clipped, axis=1, keepdims=True)
        room = np.where(missing > 0, problem.upper - clipped, clipped)
        total = np.sum(room, axis=1, keepdims=True)
        clipped = clipped + missing * np.divide(room, total, out=np.zeros_like(room), where=total > 0)
    return np.clip(clipped, 0.0, problem.upper)
