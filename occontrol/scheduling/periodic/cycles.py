"""The best cycle: all of the shorter ones, and of the longer ones those near the best.

All cycles of a length are looked at as long as they are not too many. Longer ones come from the best that are known:
joined, repeated, and changed in single letters.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.periodic.letters import Letters
from occontrol.scheduling.periodic.phases import Phases, always
from occontrol.scheduling.periodic.potential import Cycle, cycle_of

CHUNK = 2_000  # words between two looks at the clock
ALL = 300_000  # words of a length up to which all of them are looked at
POOL = 12  # cycles that longer ones are made of
TRIES = 4_000  # cycles looked at near the best
PHASED_TRIES = 20_000  # the same where windows repeat: single letters of long cycles
NEVER = 1 << 30


@dataclass(frozen=True, eq=False)
class CycleRules:
    """What a cycle has to keep.

    Parameters
    ----------
    uses : (A, M) 1 where a letter uses a sensor
    shortest : (M,) steps that a sensor stays on at least, once it is on
    most_uses : (M,) steps of one cycle at which a sensor may be used
    most_changes : steps of one cycle at which the choice changes
    """

    uses: np.ndarray
    shortest: np.ndarray
    most_uses: np.ndarray
    most_changes: int = NEVER

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """The four, as the compiled loops take them."""
        ints = (np.ascontiguousarray(a, dtype=np.int64) for a in (self.uses, self.shortest, self.most_uses))
        uses, shortest, most = ints
        return uses, shortest, most, int(self.most_changes)


def free(uses: np.ndarray) -> CycleRules:
    """No rules, for `uses` (A, M)."""
    sensors = uses.shape[1]
    return CycleRules(uses, np.ones(sensors), np.full(sensors, NEVER))


@dataclass
class Found:
    """The best cycles that were found.

    Parameters
    ----------
    best : the best one
    by_period : the least cost of every length that was looked at
    complete_to : every cycle up to this length was looked at
    looked : cycles looked at
    pool : words of good cycles, the best first
    """

    best: Cycle | None = None
    by_period: dict[int, float] = field(default_factory=dict)
    complete_to: int = 0
    looked: int = 0
    pool: list[tuple[float, tuple[int, ...]]] = field(default_factory=list)


def search(
    letters: Letters, most_period: int, rules: CycleRules, monitor: Monitor, seed: int = 1, phases: Phases | None = None
) -> Found:
    """The best cycle of up to so many steps that can be found.

    Parameters
    ----------
    letters : in units in which the smallest covariance is the identity
    most_period : longest cycle
    rules : what it has to keep
    monitor : Monitor
    seed : of the changes of longer cycles
    phases : which letters there are at which step; None is all of them always
    """
    found, phases = Found(), phases or always(letters.count)
    for p in range(phases.count, most_period + 1, phases.count):
        alike = p if phases.count == 1 else 1  # words that are one cycle
        if phases.words(p) > ALL * alike or not _all_of(letters, p, phases, rules, found, monitor):
            break
        found.complete_to = p
    if found.complete_to + phases.count <= most_period and not monitor.stop:
        _longer(letters, most_period, phases, rules, found, monitor, seed)
    return found


def _all_of(letters: Letters, p: int, phases: Phases, rules: CycleRules, found: Found, monitor: Monitor) -> bool:
    """Every cycle of length p; False when the monitor stopped it."""
    from occontrol.scheduling.periodic.scan import scan

    word = np.array([phases.at(k)[0] for k in range(p)], dtype=np.int64)
    best = word.copy()
    cost, done, begun = np.inf, False, False
    while not done:
        if monitor.stop:
            return False
        now, done, looked = scan(*letters.arrays, phases.opened, word, begun, CHUNK, cost, best, *rules.arrays)
        cost, begun, found.looked = now, True, found.looked + looked
    if np.isfinite(cost):
        found.by_period[p] = float(cost)
        _keep(letters, found, best)
    return True


def _keep(letters: Letters, found: Found, word: np.ndarray) -> bool:
    """Note a cycle that keeps the rules; whether it is the best so far."""
    cycle = cycle_of(letters, word)
    if cycle is None:
        return False
    p = len(cycle.word)
    found.by_period[p] = min(found.by_period.get(p, np.inf), cycle.cost)
    entry = (cycle.cost, tuple(int(a) for a in cycle.word))
    if entry[1] not in [w for _, w in found.pool]:
        found.pool = sorted([*found.pool, entry])[:POOL]
    if found.best is None or cycle.cost < found.best.cost - 1e-10 * abs(found.best.cost):
        found.best = cycle
        return True
    return False


def _longer(
    letters: Letters, most: int, phases: Phases, rules: CycleRules, found: Found, monitor: Monitor, seed: int
) -> None:
    """Cycles near the best ones, up to the longest length."""
    from occontrol.scheduling.periodic.scan import keeps

    random, phased = np.random.default_rng(seed), phases.count > 1
    first = [(a,) for a in range(letters.count)] + [tuple(range(letters.count))]
    if phased:
        first = [phases.drawn(random) for _ in range(POOL)]
    pool = [w for _, w in found.pool] or [w for w in first if len(w) <= most]
    seen = set() if phased else {canonical(w) for w in pool}
    for tried in range(PHASED_TRIES if phased else TRIES):
        if tried % 64 == 0 and monitor.stop:
            return
        pool = [w for _, w in found.pool] or pool
        word = phases.changed(pool, most, random) if phased else _changed(pool, letters.count, most, random)
        if not 1 <= len(word) <= most or (key := phases.canonical(word) if phased else canonical(word)) in seen:
            continue
        seen.add(key)
        found.looked += 1
        array = np.array(key, dtype=np.int64)
        if keeps(array, *rules.arrays):
            _keep(letters, found, array)


def _changed(pool: list[tuple[int, ...]], letters: int, most: int, random: np.random.Generator) -> tuple[int, ...]:
    """A cycle made of one or two of the pool."""
    word = list(pool[int(random.integers(len(pool)))])
    if random.random() < 0.5:
        other = pool[int(random.integers(len(pool)))]
        shift = int(random.integers(len(other)))
        word = word * int(random.integers(1, 3)) + list(other[shift:] + other[:shift])
    for _ in range(int(random.integers(0, 3))):
        k, kind = int(random.integers(len(word))), random.random()
        if kind < 0.4:
            word[k] = int(random.integers(letters))
        elif kind < 0.7 and len(word) < most:
            word.insert(k, int(random.integers(letters)))
        elif len(word) > 1:
            del word[k]
    return tuple(word[:most]) if len(word) <= most else ()


def canonical(word: tuple[int, ...]) -> tuple[int, ...]:
    """The same cycle, as short as it can be written, beginning where it comes first in the alphabet."""
    p = len(word)
    for d in range(1, p + 1):
        if p % d == 0 and word == word[:d] * (p // d):
            word = word[:d]
            break
    return min(word[k:] + word[:k] for k in range(len(word)))
