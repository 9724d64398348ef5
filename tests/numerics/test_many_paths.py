"""Many states over one span in one call: the same numbers as one after the other, to the last bit."""

from __future__ import annotations

import casadi
import numpy as np
import pytest

from occontrol.numerics.flow import Flow
from occontrol.numerics.many_paths import Columns, across


def pendulum(noise: str, discrete: bool = False) -> Flow:
    """A pendulum, or one step of it, whose noise may depend on the state."""
    x, t = casadi.SX.sym("x", 2), casadi.SX.sym("t")
    right = casadi.vertcat(x[1], -9.81 * casadi.sin(x[0]) + 0.1 * t)
    Xi = casadi.diag(casadi.vertcat(0, 0.02 if noise == "constant" else 0.02 + x[0] ** 2 + 0.01 * t))
    end = x + 0.05 * right if discrete else right
    functions = (casadi.Function("right", [x, t], [end]), casadi.Function("noise", [x, t], [casadi.densify(Xi)]))
    return Flow(*functions, 2, discrete)


@pytest.mark.parametrize("noise", ["constant", "of the state"])
@pytest.mark.parametrize("discrete", [False, True])
def test_each_state_moves_as_it_does_alone(noise: str, discrete: bool) -> None:
    flow, states = pendulum(noise, discrete), np.random.default_rng(1).standard_normal((7, 2))
    length = 1.0 if discrete else 0.4
    ends, F, Q = across(flow, states, 3.0, length, 5)
    for b, x in enumerate(states):
        end, one, noise_of_it = flow.across(x, 3.0, length, 5)
        np.testing.assert_allclose(ends[b], end, rtol=1e-14)
        np.testing.assert_allclose(F[b], one, rtol=1e-13, atol=1e-15)
        np.testing.assert_allclose(Q[b], noise_of_it, rtol=1e-13, atol=1e-17)
    for part in (slice(0, 1), slice(2, 6)):
        for whole, own in zip((ends, F, Q), across(flow, states[part], 3.0, length, 5), strict=True):
            np.testing.assert_array_equal(whole[part], own)


def test_nothing_moves_in_no_time_and_no_state_is_no_work() -> None:
    flow = pendulum("constant")
    ends, F, Q = across(flow, np.ones((3, 2)), 0.0, 0.0, 5)
    np.testing.assert_array_equal(ends, np.ones((3, 2)))
    np.testing.assert_array_equal(F, np.tile(np.eye(2), (3, 1, 1)))
    assert not np.any(Q)
    assert [part.shape for part in Columns(flow.step)(np.ones((0, 2)), np.ones((0, 1)), np.ones((0, 1)))] == [
        (0, 2),
        (0, 4),
    ]
