"""The methods of the athans family as values: each a frozen dataclass of its own options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from occontrol.core.method import Method, check_options

STARTS = ("best-single", "round-robin", "greedy", "random")


@dataclass(frozen=True)
class Relaxed(Method):
    """The convex relaxation alone: fractional weights, certified.

    Parameters
    ----------
    relative_gap : target of (J - bound)/|J|, > 0
    max_iterations : steps
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "relaxed"
    relative_gap: float = 1e-4
    max_iterations: int = 3000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        check_options(self, positive=("relative_gap", "time_limit"), whole={"max_iterations": 1})


@dataclass(frozen=True)
class RelaxRoundPolish(Method):
    """The default: relax, round, polish on the true cost, certify.

    Parameters
    ----------
    relative_gap : target of the relaxation
    max_iterations : steps of the relaxation
    polish : rounds of exact single exchanges after rounding, 0 is none
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "schedule"
    relative_gap: float = 1e-4
    max_iterations: int = 3000
    polish: int = 200
    time_limit: float | None = None

    def __post_init__(self) -> None:
        check_options(self, positive=("relative_gap", "time_limit"), whole={"max_iterations": 1, "polish": 0})


@dataclass(frozen=True)
class HMinimal(Method):
    """Kelley's H-minimal sweep with partial steps; `full_step` is the plain method, which may cycle.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    max_iterations : sweeps
    full_step : replace the policy everywhere at once (epsilon = 1 always)
    tolerance : stop when the predicted decrease is below this share of |J|
    start : "best-single", "round-robin", "greedy", "random": the first guess
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "hminimal"
    relative_gap: float = 1e-4
    max_iterations: int = 3000
    full_step: bool = False
    tolerance: float = 1e-9
    start: str = "best-single"
    time_limit: float | None = None

    def __post_init__(self) -> None:
        check_options(
            self,
            positive=("relative_gap", "time_limit"), at_least={"tolerance": 0}, whole={"max_iterations": 1},
            one_of={"start": STARTS},
        )


@dataclass(frozen=True)
class BestSingle(Method):
    """Baseline: the best fixed choice, used whenever it is available.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    """

    name: ClassVar[str] = "best-single"
    relative_gap: float = 1e-4

    def __post_init__(self) -> None:
        check_options(self, positive=("relative_gap",))


@dataclass(frozen=True)
class RoundRobin(Method):
    """Baseline: the sensors in turn.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    dwell : intervals between switches
    """

    name: ClassVar[str] = "round-robin"
    relative_gap: float = 1e-4
    dwell: int = 1

    def __post_init__(self) -> None:
        check_options(self, positive=("relative_gap",), whole={"dwell": 1})


@dataclass(frozen=True)
class Random(Method):
    """Baseline: a random available choice on every interval.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    seed : of the random numbers
    """

    name: ClassVar[str] = "random"
    relative_gap: float = 1e-4
    seed: int = 1

    def __post_init__(self) -> None:
        check_options(self, positive=("relative_gap",), whole={"seed": 0})


@dataclass(frozen=True)
class Greedy(Method):
    """Baseline: on every interval the choice that would be best if measuring ended with it.

    Parameters
    ----------
    relative_gap : target of the relaxation whose bound stands beside the result
    """

    name: ClassVar[str] = "greedy"
    relative_gap: float = 1e-4

    def __post_init__(self) -> None:
        check_options(self, positive=("relative_gap",))


@dataclass(frozen=True)
class Collocation(Method):
    """Ipopt direct collocation of the relaxed problem: the independent judge for small problems, not the engine.

    Parameters
    ----------
    relative_gap : target of (J - bound)/|J| for its policy under the common recursion
    scheme : "radau" or "legendre"
    stages : collocation points per element
    max_iterations : of Ipopt
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "collocation"
    relative_gap: float = 1e-4
    scheme: str = "radau"
    stages: int = 3
    max_iterations: int = 300
    time_limit: float | None = None

    def __post_init__(self) -> None:
        check_options(
            self,
            positive=("relative_gap", "time_limit"),
            one_of={"scheme": ("radau", "legendre")}, whole={"stages": 1, "max_iterations": 1},
        )


METHODS: dict[str, type] = {
    m.name: m for m in (RelaxRoundPolish, HMinimal, Relaxed, Collocation, BestSingle, RoundRobin, Random, Greedy)
}
