"""Many targets and few resources without an end: which resource looks at which target when, for ever.

J = limsup (1/T) int_0^T [alpha sum q v + sum_i w_i tr(R_i Sigma_i)] dt,   looks begin and end at multiples of `step`
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.plant import LinearPlant
from occontrol.core.sensor import Sensor, idle_sensor
from occontrol.core.signal import ConstantSignal
from occontrol.families.athans.periodic.problem import PeriodicProblem
from occontrol.families.athans.targets.problem import TargetsProblem

MOST_STEPS = 10_000  # of a cycle that anybody wrote
MOST_LOOKS = 4  # resources that see one target: their combinations are its choices


@dataclass(frozen=True, eq=False)
class EndlessTargetsProblem(TargetsProblem):
    """Choose for ever which resource looks at which target, to minimise J of this file's header.

    Parameters
    ----------
    edges : (2,) 0 and `step`: the step that is repeated, everything else as of a TargetsProblem

    Raises ProblemError where something changes with time, counts at the end, or is seen by too many resources.
    """

    infinite: ClassVar[bool] = True  # type: ignore[misc]

    def __post_init__(self) -> None:
        super().__post_init__()
        found = []
        for group in self.groups:
            path = ("target_models", group.model)
            if np.any(group.terminal):
                what = "output belongs to a horizon that ends"
                found.append(Mistake((*path, "output"), what, "running: a weight that counts for ever", key=True))
            if len({looks.resource for looks in group.looks}) > MOST_LOOKS:
                what = f"targets of model '{group.model}' are seen by more than {MOST_LOOKS} resources"
                found.append(Mistake(("looks",), what, "fewer resources, or targets apart"))
        if found:
            raise ProblemError(list(dict.fromkeys(found)))

    @property
    def step(self) -> float:
        """The length of a look."""
        return float(self.edges[1])

    @property
    def capacity(self) -> np.ndarray:
        """(R,) looks a step of the resources."""
        return np.array([int(r.capacity[0]) for r in self.resources])

    @property
    def per(self) -> str:
        """What the cost is per."""
        return "unit of time"

    def cycle_edges(self, steps: int) -> np.ndarray:
        """(steps+1,) edges of a cycle of so many steps."""
        return self.step * np.arange(steps + 1)

    def seen_by(self, target: int) -> list[int]:
        """The resources that see a target, in order."""
        g, i = self.group_of(target)
        return [looks.resource for looks in self.groups[g].looks if np.any(looks.target == i)]

    def alone(self, target: int) -> PeriodicProblem:
        """One target with a sensor for every resource that sees it, named TARGET@RESOURCE, and idle; no prices."""
        g, i = self.group_of(target)
        group = self.groups[g]
        A, noise = group.plant_of(i)
        sensors = []
        for looks in group.looks:
            if np.any(looks.target == i):
                s = looks.which[int(np.flatnonzero(looks.target == i)[0])]
                name = f"{group.names[i]}@{self.resources[looks.resource].name}"
                sensors.append(
                    Sensor(name, ConstantSignal(looks.C[s]), ConstantSignal(looks.noise[s]), float(looks.cost[s]))
                )
        return PeriodicProblem(
            name=group.names[i], plant=LinearPlant(A, noise, group.covariance[i], group.mean[i]),
            sensors=[*sensors, idle_sensor(group.states)], running=ConstantSignal(group.weight[i] * group.running[i]),
            sensing="rate", step=self.step, cost_weight=self.cost_weight,
            select=(0, max(1, len(sensors))),
        )  # fmt: skip

    def schedule_of(self, words: list[list[tuple[int, ...]]]) -> LookSchedule:
        """A cycle as a schedule: of every target and step the resources that look at it."""
        looks = [(k, r, i) for i, word in enumerate(words) for k, used in enumerate(word) for r in used]
        k, r, i = (np.array([x[j] for x in looks], dtype=np.int64) for j in range(3))
        names = tuple(self.resource_names), tuple(self.target_names)
        return LookSchedule(self.cycle_edges(len(words[0])), k, r, i, np.ones(len(looks)), *names)

    def one_cycle(self, schedule: LookSchedule) -> LookSchedule:
        """What was read on many steps, cut after the last look."""
        steps = int(np.max(schedule.interval, initial=0)) + 1
        parts = schedule.interval, schedule.resource, schedule.target, schedule.share
        return LookSchedule(self.cycle_edges(steps), *parts, schedule.resources, schedule.targets)

    @property
    def long(self) -> LongCycle:
        """Edges and names of a long cycle: what a schedule that anybody wrote is read for."""
        return LongCycle(self.cycle_edges(MOST_STEPS), self.resource_names, self.target_names)


@dataclass(frozen=True, eq=False)
class LongCycle:
    """Edges (N+1,) of a long cycle, and the names of resources and targets."""

    edges: np.ndarray
    resource_names: list[str]
    target_names: list[str]
