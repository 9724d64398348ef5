"""The filter along a cycle in its periodic steady state: the cycle is unrolled into a horizon that ends.

The covariance at the start of the unrolled horizon is that of the cycle for ever, so that all gains repeat from cycle
to cycle, and everything else is the filter of readings at instants, or that of continuous sensing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from occontrol.core.errors import SolveFailed, UsageError
from occontrol.core.measurement import Estimate, Measurement
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.core.target import TargetModel, TargetPlan
from occontrol.core.trajectory import Trajectory
from occontrol.families.athans.filter.online import MatchedFilter, MatchedStep
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.periodic.prove import setting_of, unbounded
from occontrol.families.athans.periodic.rounds import without_windows
from occontrol.families.athans.periodic.words import word_of
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.readings.clock import SampleTimes, Steps
from occontrol.families.athans.readings.problem import ReadingsProblem
from occontrol.numerics.linalg import symmetrise
from occontrol.scheduling.periodic.potential import cycle_of

MOST_CYCLES, SETTLED = 500, 1e-13  # of the search for the filter's steady state
SIMULATED = 200  # steps of a simulation, at least; whole cycles
Unrolled = tuple[ReadingsProblem | SchedulingProblem, Schedule]


def steady_start(problem: PeriodicProblem, schedule: Schedule) -> np.ndarray:
    """The prior covariance (n, n) at the start of a cycle that is repeated for ever.

    Parameters
    ----------
    problem : PeriodicProblem
    schedule : one cycle

    Raises InfeasibleError where it has no limit.
    """
    setting, word = setting_of(problem), word_of(problem, schedule)
    cycle = cycle_of(setting.letters, word)
    if cycle is None:
        raise unbounded([problem.letters[a] for a in word])
    return symmetrise(setting.root @ cycle.priors[0] @ setting.root.T)


def filter_start(problem: PeriodicProblem, schedule: Schedule) -> np.ndarray:
    """The covariance (n, n) at the start of a cycle of the filter itself, which for continuous sensing has samples.

    Parameters
    ----------
    problem : PeriodicProblem
    schedule : one cycle

    Raises InfeasibleError where it has no limit.
    """
    start = steady_start(problem, schedule)
    if problem.sensing != "rate":
        return start
    for _ in range(MOST_CYCLES):
        ended, whole = unrolled(problem, schedule, 1, start)
        after = MatchedFilter(ended, whole, "exact").plan.covariance[-1]
        change = np.max(np.abs(after - start)) / np.max(np.abs(after))
        start = after
        if change <= SETTLED:
            break
    return start


def unrolled(problem: PeriodicProblem, schedule: Schedule, cycles: int, start: np.ndarray) -> Unrolled:
    """So many cycles as a problem whose horizon ends, and its schedule.

    Parameters
    ----------
    problem : PeriodicProblem
    schedule : one cycle of p steps
    cycles : how many
    start : (n, n) covariance at the start
    """
    period = len(schedule.weights)
    N, h = cycles * period, problem.step
    names = list(schedule.names)
    order = [names.index(s.name) for s in problem.sensors]
    weights = np.tile(schedule.weights[:, order], (cycles, 1))
    nothing, sensors = np.zeros((1, problem.states)), without_windows(problem.sensors)
    if problem.sensing == "rate":
        ended = SchedulingProblem(
            problem.name, replace(problem.flowing, covariance=start), sensors, h * np.arange(N + 1), nothing,
            cost_weight=problem.cost_weight, running=problem.running, select=problem.places,
        )  # fmt: skip
        return ended, Schedule(ended.edges, weights, tuple(problem.sensors.names))
    clock = Steps(N) if problem.discrete else SampleTimes(h * np.arange(N), 0.0, h * N)
    ended = ReadingsProblem(
        problem.name, replace(problem.plant, covariance=start), sensors, clock, nothing,
        cost_weight=problem.cost_weight, running=problem.running, running_at=problem.running_at, select=problem.select,
    )  # fmt: skip
    return ended, ended.make_schedule(ended.edges, weights)


def simulate(problem: PeriodicProblem, schedule: Schedule, seed: int) -> tuple[list[Measurement], Trajectory]:
    """A true trajectory over whole cycles of at least 200 steps, and what is measured of it.

    Parameters
    ----------
    problem : PeriodicProblem
    schedule : one cycle
    seed : of the random generator
    """
    cycles = -(-SIMULATED // len(schedule.weights))
    ended, whole = unrolled(problem, schedule, cycles, steady_start(problem, schedule))
    if isinstance(ended, ReadingsProblem):
        from occontrol.families.athans.readings.filter import simulate as simulate_readings

        return simulate_readings(ended, whole, seed)
    from occontrol.families.athans.filter.simulate import simulate as simulate_rate

    return simulate_rate(ended, whole, seed)


def run_filter(
    problem: PeriodicProblem,
    solution: Solution,
    measurements: Sequence[Measurement],
    model: str | None,
    gate: float | None,
) -> Estimate:
    """The estimate from the first step to the end of the cycle in which the last measurement lies.

    Parameters
    ----------
    problem : PeriodicProblem
    solution : with one cycle as its schedule
    measurements : in the order of time
    model : of continuous sensing, "split" or "exact"; None or "exact" of readings
    gate : probability, or None

    Raises UsageError for another model, ProblemError for measurements that do not belong to the cycle.
    """
    schedule = _schedule(solution)
    h, period = problem.step, len(schedule.weights)
    last = max((m.time for m in measurements), default=0.0)
    steps = int(np.ceil(last / h - 1e-6)) + (problem.sensing != "rate")
    cycles = max(1, -(-steps // period))
    ended, whole = unrolled(problem, schedule, cycles, filter_start(problem, schedule))
    if isinstance(ended, ReadingsProblem):
        from occontrol.families.athans.readings.filter import run_filter as run_readings

        if model not in (None, "exact"):
            what = f"readings have one filter, which is exact; there is no model '{model}'"
            raise UsageError(f"{what}\n  hint: leave it out")
        return run_readings(ended, whole, measurements, gate)
    from occontrol.families.athans.filter.kalman_bucy import run_filter as run_rate

    return run_rate(ended, whole, measurements, model or "exact", gate)


def _schedule(solution: Solution) -> Schedule:
    if solution.schedule is None:
        raise SolveFailed("the solution has no schedule to follow")
    return solution.schedule


def _two_cycles(problem: PeriodicProblem, solution: Solution) -> tuple[MatchedFilter, np.ndarray, int]:
    """A filter over two cycles, of which the second has no first reading before it, D at its nodes, the period."""
    schedule = _schedule(solution)
    ended, whole = unrolled(problem, schedule, 2, filter_start(problem, schedule))
    period = len(schedule.weights)
    if isinstance(ended, ReadingsProblem):
        from occontrol.families.athans.readings.filter import matched_filter

        matched = matched_filter(ended, whole)
    else:
        matched = MatchedFilter(ended, whole, "exact")
    return matched, np.zeros((2 * period + 1, 1, problem.states)), period


class EndlessFilter:
    """The matched filter of a cycle in its steady state: one `step` per step, for ever.

    Parameters
    ----------
    inner : MatchedFilter over two cycles
    period : steps of one
    """

    def __init__(self, inner: MatchedFilter, period: int):
        self.inner, self.period, self.offset = inner, period, 0.0
        self._length = float(inner.model.edges[-1] - inner.model.edges[-1 - period])

    @property
    def next_sensors(self) -> tuple[str, ...]:
        """Names of the sensors to read at the coming step."""
        return self.inner.next_sensors

    def step(self, sample: Mapping[str, np.ndarray] | np.ndarray | None = None) -> MatchedStep:
        """Advance by one step with what was measured; see MatchedFilter.

        Parameters
        ----------
        sample : {sensor name: (m,) values}, the values alone of one sensor, or None

        Raises ProblemError for a sensor that is not in use and for wrong values.
        """
        inner = self.inner
        done = inner.step(sample)
        time = done.time + self.offset
        if inner.finished:
            inner.k = self.period
            self.offset += self._length
            if inner.planned:
                inner.root = inner.plan.root[self.period]
        return replace(done, time=time, next_sensors=inner.next_sensors)


def online(problem: PeriodicProblem, solution: Solution) -> EndlessFilter:
    """The filter for a loop on a target.

    Parameters
    ----------
    problem : PeriodicProblem
    solution : with one cycle as its schedule
    """
    matched, _, period = _two_cycles(problem, solution)
    return EndlessFilter(matched, period)


def cycle_target(problem: PeriodicProblem, solution: Solution) -> TargetPlan:
    """One cycle and its filter in the steady state, for code on a target that begins it again for ever.

    Parameters
    ----------
    problem : PeriodicProblem
    solution : with one cycle as its schedule

    Of readings the first interval is empty and leads to the reading at the start; the others make the cycle.
    """
    from occontrol.families.athans.filter.predictor import Predictor
    from occontrol.families.athans.filter.target import plan_of

    matched, nothing, period = _two_cycles(problem, solution)
    nodes, n, rate = len(nothing), problem.states, problem.sensing == "rate"
    none = Predictor(np.zeros((nodes, 0, n)), np.zeros((nodes, 0)), np.zeros((nodes, 0, 0)))
    whole = plan_of(matched.model, none, instants=not rate, variable=problem.variable)
    model = whole.model
    assert isinstance(model, TargetModel)
    again = 0 if rate else 1
    N = period + again
    return replace(
        whole, edges=np.asarray(whole.edges)[: N + 1], active=list(whole.active)[:N], again=again,
        model=replace(
            model, transition=model.transition[:N], input=model.input[:N], observe=list(model.observe)[:N],
            offset=list(model.offset)[:N], noise_root=list(model.noise_root)[:N], predict_matrix=none.matrix[: N + 1],
            predict_offset=none.offset[: N + 1], predict_noise=none.noise[: N + 1],
        ),
    )  # fmt: skip


def cycle_tables(problem: PeriodicProblem, solution: Solution) -> dict[str, np.ndarray]:
    """The filter of one cycle in its steady state, by the names of filter/tables.py.

    Parameters
    ----------
    problem : PeriodicProblem
    solution : with one cycle as its schedule

    Interval k leads to the reading at step k; the first begins at the last step of the cycle before.
    """
    from occontrol.families.athans.filter.tables import tables_of

    matched, output, period = _two_cycles(problem, solution)
    tables = tables_of(matched, output)
    cut = {name: array if name == "mean" else array[period:] for name, array in tables.items()}
    cut["edges"] = cut["edges"] - cut["edges"][-1] + problem.step * period * (problem.sensing == "rate")
    if problem.sensing != "rate":
        cut["edges"] = cut["edges"] + problem.step * (period - 1)
    return cut
