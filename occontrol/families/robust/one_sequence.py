"""Methods that pick one sequence and prove nothing themselves; and what all methods of the family share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from occontrol.core.errors import Mistake
from occontrol.core.method import check_options
from occontrol.core.solution import Status

if TYPE_CHECKING:
    from occontrol.core.monitor import Monitor
    from occontrol.core.solution import Solution
    from occontrol.families.robust.problem import Problem
    from occontrol.families.robust.slots import Slots


class SwitchingMethod:
    """What the methods of this family share: `run` makes a Solution from the problem and its table of slots."""

    name: ClassVar[str]
    time_limit: float | None = None  # seconds; an option of those that may take long

    def check(self, problem: Problem) -> Sequence[Mistake]:
        """What is wrong with the options for `problem`, paths below `method`; its horizon may itself be wrong."""
        return ()

    def stated(self, problem: Problem) -> list[int] | None:
        """The sequence (N,) that the method names without looking at the plant; None for methods that must look."""
        return None

    def run(self, problem: Problem, slots: Slots, monitor: Monitor) -> Solution:
        """Solve.

        Parameters
        ----------
        problem : Problem
        slots : its table
        monitor : Monitor
        """
        raise NotImplementedError


class OneSequence(SwitchingMethod):
    """A method that picks one sequence and proves nothing; the relaxation gives the bound beside it."""

    remark: ClassVar[str] = "A baseline."

    def pick(self, problem: Problem, slots: Slots) -> list[int]:
        """The sensor (N,) of every slot."""
        sequence = self.stated(problem)
        if sequence is None:
            raise NotImplementedError
        return sequence

    def run(self, problem: Problem, slots: Slots, monitor: Monitor) -> Solution:
        """The picked sequence with a proven bound."""
        from occontrol.families.robust.assemble import sequence_solution
        from occontrol.families.robust.bound import relaxed_policy

        sequence = self.pick(problem, slots)
        bound = relaxed_policy(slots, monitor=monitor)[2]
        return sequence_solution(
            problem,
            slots,
            sequence,
            method=self.name,
            lower_bound=bound,
            status=Status.FEASIBLE,
            message=self.remark,
            monitor=monitor,
        )


@dataclass(frozen=True)
class OneStep(OneSequence):
    """One step ahead (theorem 4.1): at every switching time the sensor whose set is smallest at the next one."""

    name: ClassVar[str] = "one-step"
    remark: ClassVar[str] = "One step ahead: a greedy rule, the bound says what it may cost."

    def pick(self, problem: Problem, slots: Slots) -> list[int]:
        """The greedy sequence."""
        from occontrol.families.robust.slots import one_step

        return one_step(slots, problem.plant.weight, problem.plant.center, problem.plant.level)


@dataclass(frozen=True)
class Fixed(OneSequence):
    """A given sequence.

    Parameters
    ----------
    sequence : sensor names or numbers 1 .. M, one per slot; one name alone stands for all slots
    """

    name: ClassVar[str] = "fixed"
    remark: ClassVar[str] = "The given sequence; the bound says what another one could save."
    sequence: str | list[str | int] = ()  # type: ignore[assignment]

    def check(self, problem: Problem) -> Sequence[Mistake]:
        """What is wrong with the sequence; without a horizon the names can still be looked at."""
        slots = problem.slots if problem.slots > 0 else max(1, len(self.sequence))
        return self._resolve([sensor.name for sensor in problem.sensors], slots)[1]

    def stated(self, problem: Problem) -> list[int] | None:
        """The sequence itself."""
        return self._resolve(problem.sensors.names, problem.slots)[0]

    def _resolve(self, names: Sequence[str], slots: int) -> tuple[list[int], list[Mistake]]:
        """Sensor indices of every slot, and what is wrong with them (paths within the method)."""
        given = [self.sequence] * slots if isinstance(self.sequence, str) else list(self.sequence)
        place: tuple[str | int, ...] = ("sequence",)
        hint = "names or numbers of sensors, one per slot: " + ", ".join(names)
        if not given:
            return [], [Mistake(place, f"a fixed schedule needs a sequence of {slots} sensors", hint)]
        found, mistakes = [], []
        for k, entry in enumerate(given):
            at = place if isinstance(self.sequence, str) else (*place, k)
            if isinstance(entry, str) and entry in names:
                found.append(list(names).index(entry))
            elif isinstance(entry, int) and not isinstance(entry, bool):
                if not 1 <= entry <= len(names):
                    mistakes.append(Mistake(at, f"sensor number {entry} does not exist", f"1 .. {len(names)}"))
                found.append(entry - 1)
            else:
                mistakes.append(Mistake(at, f"there is no sensor '{entry}'", "sensors: " + ", ".join(names)))
        if len(given) != slots:
            what = f"the sequence has {len(given)} entries, there are {slots} slots"
            mistakes.append(Mistake(place, what, "one sensor per slot"))
        return found, mistakes


@dataclass(frozen=True)
class BestSingle(OneSequence):
    """The one sensor that is best when it is used all the time: a baseline."""

    name: ClassVar[str] = "best-single"

    def pick(self, problem: Problem, slots: Slots) -> list[int]:
        """The best sensor in every slot."""
        alone = np.repeat(np.arange(slots.sensors)[:, None], slots.count, axis=1)
        return [int(np.argmin(slots.costs(alone)))] * slots.count


@dataclass(frozen=True)
class RoundRobin(OneSequence):
    """One sensor after the other: a baseline."""

    name: ClassVar[str] = "round-robin"

    def stated(self, problem: Problem) -> list[int] | None:
        """Sensors in their order, again and again."""
        return [k % len(problem.sensors) for k in range(problem.slots)]


@dataclass(frozen=True)
class Random(OneSequence):
    """Any sensor in every slot: a baseline.

    Parameters
    ----------
    seed : of the generator
    """

    name: ClassVar[str] = "random"
    seed: int = 0

    def __post_init__(self) -> None:
        check_options(self, whole={"seed": 0})

    def stated(self, problem: Problem) -> list[int] | None:
        """What the generator draws."""
        drawn = np.random.default_rng(self.seed).integers(len(problem.sensors), size=problem.slots)
        return [int(i) for i in drawn]
