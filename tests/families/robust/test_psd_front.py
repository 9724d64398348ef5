"""Dominance in the positive semidefinite order against eigenvalues."""

import numpy as np

from occontrol.families.robust.psd_front import front


def test_every_matrix_is_kept_or_has_one_below_it():
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(200, 3, 3))
    matrices = roots @ np.swapaxes(roots, 1, 2) + 0.05 * np.eye(3)
    matrices = matrices[np.argsort(np.trace(matrices, axis1=1, axis2=2))]
    for factor in (1.0, 1.3):
        owner = front(matrices, factor)
        kept = owner == np.arange(len(owner))
        assert 0 < np.sum(kept) < len(kept)
        for b in np.nonzero(~kept)[0]:
            assert kept[owner[b]]
            assert np.linalg.eigvalsh(factor * matrices[b] - matrices[owner[b]])[0] > -1e-12
        alive = matrices[kept]
        for j, b in enumerate(alive):
            assert not any(np.linalg.eigvalsh(factor * b - a)[0] > 1e-9 for a in alive[:j])


def test_copies_are_merged_and_badly_scaled_states_are_not_confused():
    small = np.diag([1e12, 1e-12])
    other = np.diag([1e12, 0.5e-12])
    assert list(front(np.array([small, small, other]))) == [0, 0, 2]
