"""Many independent targets and a few resources that look at them: the scheduling problem in its block form.

J = alpha int sum q v dt + sum_i w_i [int tr(R_i Sigma_i) dt + tr(D_i Sigma_i(T) D_i')]
sum over targets of v_{i,rho}(t) <= capacity_rho(t),   0 <= v <= 1, only where the look is open
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from occontrol.core.clock import elapsed, lengths
from occontrol.core.errors import Collector, Mistake
from occontrol.core.kinds import PlainMapping
from occontrol.core.look_schedule import LookSchedule
from occontrol.core.method import Method
from occontrol.families.athans.base import AthansProblem
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.targets.groups import TargetGroup, merged_names


@dataclass(frozen=True, eq=False)
class Resource:
    """Something that looks at targets, such as a radar or a telescope.

    Parameters
    ----------
    name : str
    capacity : (N,) whole numbers: looks that it gives on each interval
    """

    name: str
    capacity: np.ndarray


@dataclass(frozen=True)
class LookName:
    """A resource that looks at a target, as measurement files call it: TARGET@RESOURCE.

    Parameters
    ----------
    name : the two names
    rows : values of one measurement
    """

    name: str
    rows: int


class LookNames(Sequence[LookName]):
    """Every pair of a target and a resource that sees it; `names` as a SensorSuite has them."""

    def __init__(self, looks: Sequence[LookName]):
        self._looks = list(looks)

    def __len__(self) -> int:
        return len(self._looks)

    def __getitem__(self, index):
        return self._looks[index]

    @property
    def names(self) -> list[str]:
        """TARGET@RESOURCE, target by target."""
        return [look.name for look in self._looks]


@dataclass(frozen=True, eq=False)
class TargetsProblem(AthansProblem):
    """Choose which resource looks at which target when, to minimise J of this file's header.

    Parameters
    ----------
    name : str
    edges : (N+1,) increasing times t0 .. T; a choice is kept between them
    resources : Resources
    groups : TargetGroups; targets are counted through all of them
    statement : resources, target_models, targets and looks as a problem file states them, tables embedded
    cost_weight : alpha >= 0
    method : an options object of the family's methods for targets, or None for the default
    expect : {source, cost, tolerance}, the known answer, if any
    integration : accuracy or steps of the integration; looks are taken on intervals that their windows cover

    Raises ProblemError for repeated names and for a problem without an open look.
    """

    name: str
    edges: np.ndarray  # type: ignore[assignment]
    resources: tuple[Resource, ...]
    groups: tuple[TargetGroup, ...]
    statement: PlainMapping = field(repr=False)
    cost_weight: float = 1.0
    method: Method | None = None
    expect: PlainMapping | None = None
    integration: Integration = field(default_factory=Integration)
    family: str = field(default="athans", init=False)
    of_targets: ClassVar[bool] = True
    rules = None
    minimise = "cost"

    def __post_init__(self) -> None:
        found = Collector()
        object.__setattr__(self, "edges", np.asarray(self.edges, dtype=float))
        for kind, names in (("resource", self.resource_names), ("target", self.target_names)):
            seen: set[str] = set()
            for name in names:
                if name in seen:
                    what = f"the name '{name}' of a {kind} is used twice"
                    found.add((f"{kind}s",), what, f"{kind} names must differ")
                    break
                seen.add(name)
        if not (np.isfinite(self.cost_weight) and self.cost_weight >= 0):
            what = f"cost_weight is {self.cost_weight:g}, it must be finite and not negative"
            found.add(("objective", "cost_weight"), what, "cost_weight >= 0")
        found.mistakes += self.integration.mistakes()
        if not found.mistakes and not np.any(self.seen):
            what = "no resource ever sees a target"
            found.mistakes.append(Mistake(("looks",), what, "give looks, and windows that cover whole intervals"))
        found.raise_if_any()

    @property
    def resource_names(self) -> list[str]:
        """In the user's order."""
        return [resource.name for resource in self.resources]

    @cached_property
    def target_names(self) -> list[str]:
        """In the order of the file."""
        return merged_names(self.groups)

    @cached_property
    def first(self) -> np.ndarray:
        """(groups + 1,) number of the first target of every group."""
        return np.concatenate([[0], np.cumsum([len(group) for group in self.groups])])

    @property
    def targets(self) -> int:
        """How many targets there are."""
        return int(self.first[-1])

    @property
    def states(self) -> int:  # type: ignore[override]
        """States of all targets together."""
        return sum(len(group) * group.states for group in self.groups)

    @property
    def intervals(self) -> int:  # type: ignore[override]
        """N"""
        return len(self.edges) - 1

    @property
    def places(self) -> int:  # type: ignore[override]
        """Looks that all resources give on the fullest interval."""
        return int(np.max(np.sum([r.capacity for r in self.resources], axis=0)))

    @cached_property
    def steps(self) -> np.ndarray:
        """(N,) lengths of the intervals."""
        return lengths(self.edges)

    @cached_property
    def elapsed(self) -> np.ndarray:
        """(N+1,) times since the start."""
        return elapsed(self.edges)

    @cached_property
    def sensors(self) -> LookNames:  # type: ignore[override]
        """Pairs of a target and a resource that sees it, for measurement files."""
        found = []
        for group in self.groups:
            for i, name in enumerate(group.names):
                for looks in group.looks:
                    if np.any(looks.target == i):
                        pair = f"{name}@{self.resources[looks.resource].name}"
                        found.append(LookName(pair, looks.C.shape[1]))
        return LookNames(found)

    @cached_property
    def seen(self) -> np.ndarray:
        """(targets,) whether some resource may look at each of them at some time."""
        seen = np.zeros(self.targets, dtype=bool)
        for g, group in enumerate(self.groups):
            for looks in group.looks:
                open_ = self.resources[looks.resource].capacity[looks.interval] > 0
                seen[self.first[g] + looks.target[open_]] = True
        return seen

    def group_of(self, target: int) -> tuple[int, int]:
        """Number of the group of a target, and its place in there."""
        g = int(np.searchsorted(self.first, target, side="right")) - 1
        return g, target - int(self.first[g])

    def make_schedule(self, edges: np.ndarray, weights: np.ndarray) -> LookSchedule:
        """The schedule of looks from the arrays of a run.

        Parameters
        ----------
        edges : (N+1,) times
        weights : (L, 4) interval, resource, target and share of every look
        """
        listed = np.reshape(weights, (-1, 4))
        columns = [listed[:, i].astype(np.int64) for i in range(3)]
        k, rho, i = columns
        names = tuple(self.resource_names), tuple(self.target_names)
        return LookSchedule(np.asarray(edges, dtype=float), k, rho, i, listed[:, 3], names[0], names[1])

    def require_feasible(self) -> None:
        """Nothing: to look at nothing is always allowed."""
