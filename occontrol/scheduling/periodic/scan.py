"""Compiled: every cycle of one length, each once, those left out that cannot be the best.

Cycles that differ by where they begin are one: of them the word that is first in the alphabet stands for all (a Lyndon
word; words that repeat a shorter one are cycles of that length). Words come in the order of the alphabet. Where the
letters there are depend on the phase, where a cycle begins matters, and all words are looked at.
Source: Fredricksen, Kessler & Maiorana; Knuth, The Art of Computer Programming 4A, algorithm 7.2.1.1F.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from occontrol.scheduling.periodic.kernels import charge_of, predict, update
from occontrol.scheduling.periodic.matrices import OPTIONS
from occontrol.scheduling.periodic.steady import cycle_cost

BETTER = 1e-12  # relative: a later word has to be cheaper by so much


@njit(**OPTIONS)
def keeps(word, uses, shortest, most_uses, most_changes):
    """Whether a cycle keeps its rules: runs of at least `shortest` (M,), at most `most_uses` (M,) uses, changes.

    word (p,), uses (A, M) 1 where a letter uses a sensor; `most_changes` counts steps at which the letter changes.
    """
    p = word.shape[0]
    changes = 0
    for k in range(p):
        changes += word[k] != word[k - 1]
    if changes > most_changes:
        return False
    for j in range(uses.shape[1]):
        total = 0
        for k in range(p):
            total += uses[word[k], j]
        if total > most_uses[j]:
            return False
        if shortest[j] > 1 and 0 < total < p:
            for k in range(p):
                if uses[word[k], j] == 1 and uses[word[k - 1], j] == 0:
                    run = 0
                    while uses[word[(k + run) % p], j] == 1:
                        run += 1
                    if run < shortest[j]:
                        return False
    return True


@njit(**OPTIONS)
def move_on(word, opened):
    """Move `word` (p,) to the next that `opened` (P, A) allows: the place that was changed, -1 at the end.

    With one phase it is the next that can begin a Lyndon word; it is one itself where the last place was changed.
    """
    p, P, A = word.shape[0], opened.shape[0], opened.shape[1]
    for j in range(p - 1, -1, -1):
        for a in range(word[j] + 1, A):
            if opened[j % P, a]:
                word[j] = a
                for k in range(j + 1, p):
                    if P == 1:
                        word[k] = word[k - j - 1]
                    else:
                        word[k] = 0
                        while not opened[k % P, word[k]]:
                            word[k] += 1
                return p - 1 if P > 1 else j
    return -1


@njit(**OPTIONS)
def scan(
    F, Q, L, seen, weight, constant, opened, word, begun, most, incumbent, best, uses, shortest, most_uses, most_changes
):
    """Look at the next `most` words of one length from `word` (p,), which is moved on; fills `best` (p,).

    Returns the least cost (that of `incumbent` where nothing is cheaper), whether the length is done, and how many
    words were looked at. `begun` says whether `word` itself has been looked at; `opened` (P, A) the letters of phases.
    """
    p, A, n = word.shape[0], F.shape[0], F.shape[1]
    start = np.zeros((n, n))
    for i in range(n):
        start[i, i] = 1.0
    least = np.inf
    for a in range(A):
        least = min(least, charge_of(start, seen[a], weight[a], constant[a]))
    priors = np.empty((p + 1, n, n))
    looked, fresh = 0, not begun
    while looked < most:
        if not fresh:
            j = move_on(word, opened)
            if j < 0:
                return incumbent, True, looked
            if j != p - 1:
                continue
        elif p > 1 and opened.shape[0] == 1:  # the first word repeats a letter: a cycle of length 1
            fresh = False
            continue
        fresh = False
        looked += 1
        # from the smallest covariance every charge is at most that of the cycle
        S, total, kept = start, 0.0, p
        for k in range(p):
            a = word[k]
            total += charge_of(S, seen[a], weight[a], constant[a])
            if total + (p - 1 - k) * least > p * incumbent:
                kept = k
                break
            S = predict(F[a], Q[a], update(S, L[a]))
        if kept < p:
            for k in range(kept + 1, p):  # whatever begins so is as dear
                word[k] = A - 1
            continue
        if not keeps(word, uses, shortest, most_uses, most_changes):
            continue
        cost = cycle_cost(F, Q, L, seen, weight, constant, word, start, priors)
        if cost < incumbent - BETTER * abs(incumbent) or (cost < incumbent and incumbent == np.inf):
            incumbent = cost
            best[:] = word
    return incumbent, False, looked
