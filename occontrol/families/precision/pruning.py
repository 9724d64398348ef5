"""Fewer sensors: drop the least precise and solve again, or search for the best set of a given size.

Unknowns: which groups of measurements may be used at all. Das & Bhattacharya, section 4.2, after Li et al. (2008):
sort the precisions, drop the smallest, solve again, until the bound cannot be met. What each removal costs is kept, and
a removal that the linearised plant cannot spare is refused (an error would grow that no sensor sees).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import Collector
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.precision.program import Outcome, Program, examine

Solve = Callable[[Program], Outcome]
ACTIVE = 1e-9  # of the largest share of signal to noise: below, a sensor is not in use


@dataclass(frozen=True)
class Pruning:
    """How to prune.

    Parameters
    ----------
    sensors : stop when at most this many are in use; None goes on until the bound could not be met
    by : `use` counts every measurement of the batch, `sensor` all uses of one sensor together
    together : how many are dropped before solving again (fewer when that many cannot be spared)
    rise : largest allowed objective, relative to the unpruned one, e.g. 1.5; None is no limit
    exact : search for the cheapest set of `sensors` (or of the smallest possible size); for small sets
    """

    sensors: int | None = None
    by: str = "use"
    together: int = 1
    rise: float | None = None
    exact: bool = False

    def __post_init__(self) -> None:
        found = Collector()
        for name in ("sensors", "together"):
            value = getattr(self, name)
            if value is not None and (isinstance(value, bool) or int(value) != value or value < 1):
                found.add((name,), f"{name} is {value}", "a whole number, at least 1")
        if self.by not in ("use", "sensor"):
            found.add(("by",), f"prune.by is '{self.by}'", "by: use | sensor")
        if self.rise is not None and not self.rise >= 1:
            found.add(("rise",), f"rise is {self.rise:g}", "at least 1: the objective relative to the unpruned one")
        found.raise_if_any()


@dataclass(frozen=True, eq=False)
class Removal:
    """One step of the pruning: which groups left, the objective afterwards, and what that cost."""

    groups: tuple[int, ...]
    objective: float
    price: float
    remaining: int


@dataclass(frozen=True, eq=False)
class Pruned:
    """The outcome.

    Parameters
    ----------
    result : Outcome of the program without the dropped sensors
    removals : one record per removal, in order; unused sensors go first and cost nothing
    refused : groups that were kept because the linearised plant would lose its detectability
    reason : why it ended
    dropped : indices of the measurements that are out
    proven : whether the set is the best of its size (exact search only)
    """

    result: Outcome
    removals: tuple[Removal, ...]
    refused: tuple[int, ...]
    reason: str
    dropped: np.ndarray
    proven: bool = False


def shares(program: Program, precisions: np.ndarray) -> np.ndarray:
    """(m,) lambda_i Y_ii, the signal to noise ratio of every measurement, a pure number; `precisions` lambda (m,)."""
    return precisions * np.diag(program.moments.measurement)


def active(program: Program, precisions: np.ndarray) -> np.ndarray:
    """Indices of the measurements that `precisions` (m,) put to use."""
    share = shares(program, precisions)
    return np.flatnonzero(share > ACTIVE * np.max(share, initial=0.0))


def prune(
    program: Program,
    solve: Solve,
    first: Outcome,
    groups: Sequence[np.ndarray],
    options: Pruning,
    spared: Callable[[np.ndarray], bool] | None = None,
    monitor: Monitor | None = None,
) -> Pruned:
    """Drop groups one after another, starting from the solution `first` of the whole program.

    Parameters
    ----------
    groups : arrays (k,) of indices of measurements; groups with fixed precisions should be left out
    spared : whether the plant can do with these measurements alone, indices (k,); always, if None
    """
    monitor = monitor or Monitor()
    assert first.precisions is not None
    current, removals, refused = first, [], []
    used = _groups_in_use(program, first.precisions, groups)
    unused = [g for g in range(len(groups)) if g not in used]
    dropped: list[int] = []
    if unused and (spared is None or spared(_left(program, groups, unused))):
        dropped = unused
        removals.append(Removal(tuple(unused), first.objective, 0.0, len(used)))
        used_groups = used
    else:
        used_groups = list(range(len(groups)))
    reason = "no further sensor can be dropped"
    count = options.together
    while len(_groups_in_use(program, current.precisions, groups)) > max(options.sensors or 1, 1):
        if monitor.stop:
            reason = "stopped"
            break
        order = [g for g in _ascending(program, current.precisions, groups) if g in used_groups and g not in refused]
        if options.sensors is not None:
            count = min(count, max(1, len(used_groups) - options.sensors))
        batch = order[:count]
        if not batch:
            break
        if spared is not None and not spared(_left(program, groups, dropped + batch)):
            if len(batch) == 1:
                refused += batch
            count = max(1, len(batch) // 2)
            continue
        tried = solve(program.without(_indices(groups, dropped + batch)))
        over = options.rise is not None and tried.objective > options.rise * first.objective
        if tried.precisions is None or over:
            if len(batch) > 1:
                count = len(batch) // 2
                continue
            what = "the objective would rise above its limit" if over else "the bound could not be met with fewer"
            reason = what if tried.status in (Status.INFEASIBLE, Status.CERTIFIED, Status.LIMIT) else tried.message
            break
        dropped += batch
        used_groups = [g for g in used_groups if g not in batch]
        price = tried.objective - current.objective
        current = tried
        removals.append(Removal(tuple(batch), tried.objective, price, len(used_groups)))
    else:
        reason = f"{len(_groups_in_use(program, current.precisions, groups))} sensors are left"
    return Pruned(current, tuple(removals), tuple(refused), reason, _indices(groups, dropped))


def best_set(
    program: Program,
    solve: Solve,
    groups: Sequence[np.ndarray],
    sensors: int | None,
    spared: Callable[[np.ndarray], bool] | None = None,
    max_nodes: int = 5000,
    monitor: Monitor | None = None,
) -> Pruned | None:
    """The cheapest program that uses at most `sensors` groups, by branch and bound; None if there is none.

    With `sensors` None the smallest number that can meet the bound is found first. A node's bound is the program where
    every sensor that is not yet ruled out may be used: it can only be cheaper.

    `groups` holds arrays (k,) of indices of measurements; `spared` takes such an array (k,).
    """
    monitor = monitor or Monitor()
    if sensors is None:
        _, verdict, _ = examine(program)
        widest = max(len(g) for g in groups)
        start = max(1, -(-verdict.least_active // widest))
        for count in range(start, len(groups) + 1):
            found = best_set(program, solve, groups, count, spared, max_nodes, monitor)
            if found is not None:
                return found
        return None
    best: Outcome | None = None
    best_out: list[int] = []
    nodes, proven = 0, True
    stack: list[tuple[list[int], list[int]]] = [([], [])]
    while stack:
        forced, out = stack.pop()
        nodes += 1
        if nodes > max_nodes or monitor.stop:
            proven = False
            break
        if len(forced) == sensors:
            out = [g for g in range(len(groups)) if g not in forced]
        if spared is not None and not spared(_left(program, groups, out)):
            continue
        found = solve(program.without(_indices(groups, out)))
        if found.precisions is None or (best is not None and found.lower_bound >= best.objective * (1 - 1e-9)):
            continue
        used = _groups_in_use(program, found.precisions, groups)
        unused = [g for g in range(len(groups)) if g not in used]
        if len(used) <= sensors and (spared is None or spared(_left(program, groups, unused))):
            if best is None or found.objective < best.objective:
                best, best_out = found, unused
            continue
        if len(forced) == sensors:
            continue
        strength = {g: _strength(program, found.precisions, groups[g]) for g in range(len(groups)) if g not in out}
        choices = [g for g in strength if g not in forced]
        if not choices:
            continue
        branch = max(choices, key=lambda g: strength[g])
        stack.append((forced, [*out, branch]))
        stack.append(([*forced, branch], out))
    if best is None:
        return None
    reason = f"best set of at most {sensors}" + ("" if proven else f", not proven after {nodes} nodes")
    removal = Removal(tuple(best_out), best.objective, float("nan"), len(groups) - len(best_out))
    return Pruned(best, (removal,), (), reason, _indices(groups, best_out), proven)


def _indices(groups: Sequence[np.ndarray], chosen: Sequence[int]) -> np.ndarray:
    return np.concatenate([groups[g] for g in chosen]).astype(int) if len(chosen) else np.zeros(0, dtype=int)


def _left(program: Program, groups: Sequence[np.ndarray], dropped: Sequence[int]) -> np.ndarray:
    """Indices of the measurements that may still be used."""
    usable = (program.caps > 0) & ~(program.fixed == 0)
    usable[_indices(groups, dropped)] = False
    return np.flatnonzero(usable)


def _strength(program: Program, precisions: np.ndarray, group: np.ndarray) -> float:
    return float(np.sum((program.prices * precisions)[group]))


def _groups_in_use(program: Program, precisions: np.ndarray, groups: Sequence[np.ndarray]) -> list[int]:
    on = set(active(program, precisions).tolist())
    return [g for g, members in enumerate(groups) if on & set(members.tolist())]


def _ascending(program: Program, precisions: np.ndarray, groups: Sequence[np.ndarray]) -> list[int]:
    return sorted(range(len(groups)), key=lambda g: _strength(program, precisions, groups[g]))
