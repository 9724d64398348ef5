"""The methods of the robust family as values: each a frozen dataclass of its own options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from occontrol.core.errors import Collector, Mistake


def _at_least_one(options: object, *keys: str) -> None:
    found = Collector()
    for key in keys:
        if getattr(options, key) < 1:
            found.add((key,), f"{key} is {getattr(options, key)}, it must be at least 1")
    found.raise_if_any()


@dataclass(frozen=True)
class Optimal:
    """The best sequence: layered search with proofs.

    Parameters
    ----------
    relative_gap : target of (cost - bound)/cost; small problems are solved exactly whatever it is
    node_limit : nodes after which only the most promising few of every layer are followed
    width : nodes of a layer that are kept at most
    merge_above : nodes of a layer up to which nothing is merged
    time_limit : seconds, None is no limit
    """

    name: ClassVar[str] = "optimal"
    relative_gap: float = 1e-2
    node_limit: int = 100_000
    width: int = 3000
    merge_above: int = 1000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        _at_least_one(self, "node_limit", "width", "merge_above")


@dataclass(frozen=True)
class OneStep:
    """One step ahead (theorem 4.1): at every switching time the sensor whose set is smallest at the next one."""

    name: ClassVar[str] = "one-step"


@dataclass(frozen=True)
class Fixed:
    """A given sequence.

    Parameters
    ----------
    sequence : sensor names or numbers 1 .. M, one per slot; one name alone stands for all slots
    """

    name: ClassVar[str] = "fixed"
    sequence: str | list[str | int] = ()  # type: ignore[assignment]

    def resolve(self, names: Sequence[str], slots: int) -> tuple[list[int], list[Mistake]]:
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
class All:
    """Every sequence, ranked.

    Parameters
    ----------
    limit : how many sequences there may be
    """

    name: ClassVar[str] = "all"
    limit: int = 300_000

    def __post_init__(self) -> None:
        _at_least_one(self, "limit")


@dataclass(frozen=True)
class RelaxedShares:
    """The convex relaxation alone: a slot may be shared between sensors. Its bound holds for every sequence.

    Parameters
    ----------
    relative_gap : target of the relaxation
    """

    name: ClassVar[str] = "relaxed"
    relative_gap: float = 1e-5


@dataclass(frozen=True)
class BestSingle:
    """The one sensor that is best when it is used all the time: a baseline."""

    name: ClassVar[str] = "best-single"


@dataclass(frozen=True)
class RoundRobin:
    """One sensor after the other: a baseline."""

    name: ClassVar[str] = "round-robin"


@dataclass(frozen=True)
class Random:
    """Any sensor in every slot: a baseline.

    Parameters
    ----------
    seed : of the generator
    """

    name: ClassVar[str] = "random"
    seed: int = 0
