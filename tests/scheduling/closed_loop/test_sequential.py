"""The sequential test: its error by simulation, its end, its words."""

from __future__ import annotations

import numpy as np
import pytest

from occontrol.scheduling.closed_loop.sequential import ERROR, decided, looks_at, quantile, standard_error, verdict


def ended(base: np.ndarray, others: np.ndarray) -> tuple[int, list[bool]]:
    """Where one comparison ends, and which policies are then called different; `others` (P, K)."""
    looks = looks_at(len(base), True)
    z = quantile(len(looks), len(others))
    for end in looks:
        costs = {"nominal": base[:end], **{str(i): other[:end] for i, other in enumerate(others)}}
        if end == len(base) or decided(costs, z):
            found = [(other[:end] - base[:end]) for other in others]
            return end, [bool(abs(np.mean(d)) > z * standard_error(d)) for d in found]
    raise AssertionError


@pytest.mark.parametrize("policies", [1, 3])
def test_equal_policies_are_seldom_called_different(policies: int) -> None:
    """2000 comparisons of policies that are all the same as the plan: at most ERROR of them say anything of any."""
    rng, wrong, count = np.random.default_rng(4), 0, 2000
    for _ in range(count):
        base = 100 + 30 * rng.standard_normal(400)
        wrong += any(ended(base, base + 20 * rng.standard_normal((policies, 400)))[1])
    assert 0.05 * ERROR < wrong / count < ERROR + 3 * np.sqrt(ERROR * (1 - ERROR) / count)


def test_a_clear_difference_ends_it_early_and_a_doubt_does_not() -> None:
    rng = np.random.default_rng(5)
    base = 100 + 30 * rng.standard_normal(1000)
    noise = rng.standard_normal((2, 1000))
    assert ended(base, base + np.array([[-9.0], [5.0]]) + 10 * noise) == (100, [True, True])
    assert ended(base, base + 0.5 * noise) == (100, [False, False])  # known to 1 %
    assert ended(base, base + np.array([[-9.0], [0.5]]) + 40 * noise)[0] == 1000
    assert not decided({"nominal": base, "a": np.append(base[:-1], np.inf)}, 2.0)
    assert looks_at(400, False) == [400] and looks_at(350, True) == [100, 200, 300, 350]
    assert quantile(1, 1) == pytest.approx(1.959964, rel=1e-6)
    assert quantile(4, 3) == pytest.approx(2.865, abs=1e-3)  # two-sided 0.05 / 12


def test_the_verdict_says_when_replanning_does_not_pay() -> None:
    nominal = {"cost": 100.0, "diverged": 0.01, "difference_error": None}

    def said(difference: float, error: float, diverged: float = 0.01) -> str:
        row = {"cost": 100 + difference, "difference": difference, "difference_error": error, "diverged": diverged}
        return verdict({"nominal": nominal, "replanned": row, "greedy": dict(row)}, 400, False, 2.5)

    assert "less cost than the nominal plan (-5.00% +- 2.50%): replanning pays;" in said(-5, 1)
    assert "no difference to the nominal plan is seen (-2.40% +- 2.50%): replanning does not pay" in said(-2.4, 1)
    assert "more cost than the nominal plan (+5.00% +- 2.50%): replanning does not pay" in said(5, 1)
    assert "replanning does not pay, 3.0% of its runs diverged, 1.0% of the nominal plan's" in said(-5, 1, 0.03)
    assert "the nominal plan itself: replanning does not pay" in said(0, 0)
    assert said(-5, 1).startswith("400 runs, all intervals together at 95%. ")
