"""A proof tree checked anew, from its words and one matrix each, by other equations than those that made it.

Everything is in prior information Y instead of covariances, in the units of the problem, for all leaves at once:
    Y' = (F (Y + L)^-1 F' + Q)^-1,   dY' = N dY N',   N = Y' F (Y + L)^-1
and a leaf's bound is the tangent at its matrix, minimised over 0 <= Y <= Y_max. Where windows repeat there are a
potential and a prefix code for every phase; otherwise there is one phase.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.scheduling.periodic.letters import Letters
from occontrol.scheduling.periodic.phases import Phases, always

ROUNDING = 1e-15  # of what is added up, for every state
WHOLE = 1e-9  # eigenvalues of a potential below this share of the largest are rounding


@dataclass(frozen=True, eq=False)
class TreeProof:
    """What a proof tree leaves behind.

    Parameters
    ----------
    words : (K, D) letters of the leaves, filled up with -1
    points : (K, n, n) a prior information for each
    potential : (P, n, n) Z of every phase
    starts : (K,) phase in which each leaf begins
    """

    words: np.ndarray
    points: np.ndarray
    potential: np.ndarray
    starts: np.ndarray


def words_array(words: Sequence[Sequence[int]]) -> np.ndarray:
    """Words of different lengths as one array (K, D), filled up with -1."""
    array = np.full((len(words), max(map(len, words), default=0)), -1, dtype=np.int64)
    for i, word in enumerate(words):
        array[i, : len(word)] = word
    return array


def faults(proof: TreeProof, letters: Letters, phases: Phases | None = None) -> list[str]:
    """What is wrong with the form of a proof: words that are no complete prefix code, a potential that is none.

    Parameters
    ----------
    proof : TreeProof
    letters : of the problem
    phases : which letters there are at which step; None is all of them always
    """
    words, points, Z, n = proof.words, proof.points, proof.potential, letters.states
    phases = phases or always(letters.count)
    P, starts = phases.count, proof.starts
    sizes = points.shape == (len(words), n, n) and Z.shape == (P, n, n) and starts.shape == (len(words),)
    if words.ndim != 2 or not len(words) or not sizes:
        return ["the tree of the proof has the wrong sizes"]
    if not np.all(np.isin(starts, np.arange(P))):
        return ["a word of the proof begins at a phase that there is not"]
    if not (np.all(np.isfinite(points)) and np.all(np.isfinite(Z)) and np.array_equal(words, np.rint(words))):
        return ["the tree of the proof holds what is no number"]
    if np.any(words < -1) or np.any(words >= letters.count):
        return ["a word of the proof has a letter that there is not"]
    found = []
    if not all(_complete(words[starts == k].astype(np.int64), k, phases) for k in range(P)):
        found.append("the words of the proof do not stand for all schedules: they are no complete prefix code")
    for z in Z:
        if not np.array_equal(z, z.T) or np.min(np.linalg.eigvalsh(z)) < -WHOLE * np.max(np.abs(z)):
            found.append("the potential of the proof is not positive semidefinite")
            break
    return found


def _complete(words: np.ndarray, start: int, phases: Phases) -> bool:
    """Whether the words are exactly the leaves of a tree in which every inner node has all children of its phase."""
    listed = sorted(tuple(int(a) for a in word[word >= 0]) for word in words)
    lengths = np.sum(words >= 0, axis=1)
    if not len(words) or min(lengths) == 0:
        return False
    if any(np.any(word[length:] >= 0) for word, length in zip(words, lengths, strict=True)):
        return False
    # in the order of the alphabet each leaf is followed by the next one that a counter would give
    word: list[int] = []
    for k, following in enumerate(listed):
        if k:
            while word and word[-1] == phases.at(start + len(word) - 1)[-1]:
                word.pop()
            if not word:
                return False
            letters = phases.at(start + len(word) - 1)
            if word[-1] not in letters:
                return False
            word[-1] = letters[letters.index(word[-1]) + 1]
        shared = len(word)
        first = [phases.at(start + i)[0] for i in range(shared, len(following))]
        if list(following[:shared]) != word or list(following[shared:]) != first:
            return False
        word = list(following)
    return all(a == phases.at(start + i)[-1] for i, a in enumerate(word))


def checked_bound(proof: TreeProof, letters: Letters, smallest: np.ndarray) -> float:
    """The bound a step that a proof tree proves, recomputed; -inf where it proves nothing.

    Parameters
    ----------
    proof : TreeProof without faults
    letters : of the problem, in its own units
    smallest : (n, n) covariance below which no schedule stays
    """
    words, n = proof.words.astype(np.int64), letters.states
    lengths = np.sum(words >= 0, axis=1)
    P, Y = len(proof.potential), proof.points
    before = proof.potential[proof.starts.astype(np.int64)]
    after = proof.potential[(proof.starts.astype(np.int64) + lengths) % P]
    root = np.linalg.cholesky(smallest)
    inverse, eye = np.linalg.inv(root), np.eye(n)
    value = np.einsum("kij,kij->k", before, Y)
    size, largest, strongest = np.abs(value), np.ones(len(words)), np.ones(len(words))
    jacobian = np.broadcast_to(eye, Y.shape)
    slope = before.copy()
    with np.errstate(all="ignore"):
        for k in range(words.shape[1]):
            on = np.flatnonzero(lengths > k)
            a, y, J = words[on, k], Y[on], jacobian[on]
            charge = letters.constant[a]
            for i in range(letters.seen.shape[1]):
                X = np.linalg.inv(y + letters.seen[a, i])
                M = letters.weight[a, i]
                charge = charge + np.einsum("kij,kij->k", M, X)
                slope[on] -= _pulled(J, X @ M @ X)
            X = np.linalg.inv(y + letters.L[a])
            F = letters.F[a]
            S = F @ X @ np.swapaxes(F, 1, 2) + letters.Q[a]
            following = np.linalg.inv((S + np.swapaxes(S, 1, 2)) / 2)
            value[on] += charge
            size[on] += np.abs(charge)
            Y = Y.copy()
            Y[on] = (following + np.swapaxes(following, 1, 2)) / 2
            jacobian = jacobian.copy()
            jacobian[on] = Y[on] @ F @ X @ J
            largest[on] = np.maximum(largest[on], _traces(inverse @ S @ inverse.T))
            strongest[on] = np.maximum(strongest[on], _traces(root.T @ letters.L[a] @ root))
        last = np.einsum("kij,kij->k", after, Y)
        value -= last
        slope -= _pulled(jacobian, after)
        scaled = inverse @ slope @ inverse.T
        usable = np.all(np.isfinite(scaled), axis=(1, 2)) & np.isfinite(value)
        scaled[~usable] = 0.0
        negative = np.sum(np.minimum(np.linalg.eigvalsh(scaled), 0.0), axis=1)
        tangent = np.einsum("kij,kij->k", slope, proof.points)
        allowance = ROUNDING * n * (1 + strongest) * (1 + largest)
        allowance = allowance * (size + np.abs(last) + np.sum(np.abs(scaled), axis=(1, 2)))
        bounds = (value - tangent + negative * (1 + 1e-12) - allowance) / lengths
    bounds[~usable | ~np.isfinite(bounds)] = -np.inf
    return float(np.min(bounds))


def _pulled(J: np.ndarray, X: np.ndarray) -> np.ndarray:
    """J' X J for every leaf."""
    return np.swapaxes(J, 1, 2) @ X @ J


def _traces(X: np.ndarray) -> np.ndarray:
    return np.einsum("kii->k", X)
