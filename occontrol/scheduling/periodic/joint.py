"""Many targets for ever: cycles of looks at all of them, laid out by their rates and improved by exact exchanges.

A joint cycle is a letter for every target and step; resource r gives c_r looks a step at most. Its cost is the sum of
what each target's own cycle costs, so an exchange between two targets changes two terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.scheduling.periodic.letters import Letters

KEPT = 200_000  # costs of single cycles that are remembered
BETTER = 1e-12


@dataclass(eq=False)
class Costs:
    """Costs of cycles of single targets, remembered.

    Parameters
    ----------
    letters : of every target, in units in which its smallest covariance is the identity
    uses : (A, R) of every target: what its letters use of the resources
    """

    letters: Sequence[Letters]
    uses: Sequence[np.ndarray]
    known: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._arrays = [letters.arrays for letters in self.letters]
        self._room = [np.eye(letters.states) for letters in self.letters]

    def of(self, target: int, word: np.ndarray) -> float:
        """Mean charge a step of a cycle of one target; inf where its covariance has no limit.

        Parameters
        ----------
        target : which
        word : (P,) letters
        """
        from occontrol.scheduling.periodic.steady import cycle_cost

        key = target, word.tobytes()
        found = self.known.get(key)
        if found is None:
            n = self.letters[target].states
            priors = np.empty((len(word) + 1, n, n))
            found = float(cycle_cost(*self._arrays[target], word, self._room[target], priors))
            if len(self.known) > KEPT:
                self.known.clear()
            self.known[key] = found
        return found

    def all(self, words: np.ndarray) -> np.ndarray:
        """(K,) costs of a joint cycle.

        Parameters
        ----------
        words : (K, P) letters
        """
        return np.array([self.of(i, np.ascontiguousarray(word)) for i, word in enumerate(words)])

    def used(self, words: np.ndarray) -> np.ndarray:
        """(P, R) looks that a joint cycle takes of the resources in every step.

        Parameters
        ----------
        words : (K, P) letters
        """
        return np.sum([uses[word] for uses, word in zip(self.uses, words, strict=True)], axis=0)


def laid_out(
    costs: Costs, rates: Sequence[np.ndarray], period: int, capacity: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """A joint cycle (K, P) in which every look comes as evenly as the others allow.

    Parameters
    ----------
    costs : of the targets
    rates : (A,) of every target: how many of each letter a step; letter 0 is no look
    period : P
    capacity : (R,) looks a step
    random : where a target begins
    """
    K, free = len(rates), np.tile(capacity, (period, 1)).astype(int)
    words, events = np.zeros((K, period), dtype=np.int64), []
    for i, rate in enumerate(rates):
        wanted = rate[1:] * period
        whole = np.floor(wanted).astype(int)
        whole += random.random(len(whole)) < wanted - whole
        if np.any(wanted > 1e-3) and not np.any(whole):
            whole[np.argmax(wanted)] = 1
        total, start = int(np.sum(whole)), random.random()
        spread = random.permutation(np.repeat(np.arange(1, len(rate)), whole))
        events += [((start + k) / total * period, i, int(a)) for k, a in enumerate(spread[:period])]
    for time, i, a in sorted(events):
        # the step that is nearest and has room
        for step in sorted(range(period), key=lambda k: min(abs(k - time), period - abs(k - time))):
            if words[i, step] == 0 and np.all(free[step] >= costs.uses[i][a]):
                words[i, step] = a
                free[step] -= costs.uses[i][a].astype(int)
                break
    return words


def improved(
    costs: Costs, words: np.ndarray, capacity: np.ndarray, tries: int, random: np.random.Generator, monitor: Monitor
) -> tuple[np.ndarray, float]:
    """The joint cycle (K, P) after single exchanges that make it cheaper, and its cost a step.

    Parameters
    ----------
    costs : of the targets
    words : (K, P) to begin with
    capacity : (R,) looks a step
    tries : exchanges that are tried
    random : generator
    monitor : Monitor
    """
    words = words.copy()
    K, P = words.shape
    own, used = costs.all(words), costs.used(words)
    for tried in range(tries):
        if tried % 256 == 0 and monitor.stop:
            break
        i, k = int(random.integers(K)), int(random.integers(P))
        letters = len(costs.uses[i])
        if letters < 2:
            continue
        changed = {i: words[i].copy()}
        kind = random.random()
        near = int((k + random.integers(-4, 5)) % P) if random.random() < 0.7 else int(random.integers(P))
        if kind < 0.3:  # another letter, or none
            changed[i][k] = int(random.integers(letters))
        elif kind < 0.6:  # two steps of one target
            changed[i][k], changed[i][near] = words[i, near], words[i, k]
        else:  # two targets give each other their steps, or one hands its look on
            j = int(random.integers(K))
            if j == i or len(costs.uses[j]) < 2:
                continue
            changed[j] = words[j].copy()
            if kind < 0.85 and len(costs.uses[j]) == letters:
                changed[i][k], changed[j][k] = words[j, k], words[i, k]
                if near != k:
                    changed[i][near], changed[j][near] = words[j, near], words[i, near]
            else:
                changed[i][k], changed[i][near] = words[i, near], words[i, k]
                changed[j][k], changed[j][near] = words[j, near], words[j, k]
        load = used.copy()
        for target, word in changed.items():
            load += costs.uses[target][word] - costs.uses[target][words[target]]
        if np.any(load > capacity) or all(np.array_equal(w, words[t]) for t, w in changed.items()):
            continue
        new = {target: costs.of(target, word) for target, word in changed.items()}
        before, after = float(sum(own[t] for t in changed)), sum(new.values())
        if after < np.inf if before == np.inf else after < before - BETTER * abs(before):
            used = load
            for target, word in changed.items():
                words[target], own[target] = word, new[target]
    return words, float(np.sum(own))
