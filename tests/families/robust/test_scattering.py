"""Span elements of the game Riccati flow against direct integration and their own algebra."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from occontrol.core.signal import TableSignal, as_signal
from occontrol.families.robust.game import shape_rate
from occontrol.families.robust.scattering import Flow, advance, identity, retreat, star

A = [[0, 1], [-1, -0.4]]
B = [[0], [1]]
K = [[0.5, 0.2]]
C = [[[1, 0]], [[0.3, 1]]]


def constant_flow():
    return Flow(as_signal(A), as_signal(B), as_signal(K), [as_signal(c) for c in C])


def varying_flow():
    table = TableSignal(
        np.array([0.0, 0.7, 1.1, 3.0]), np.array([[[1.0, 0]], [[0, 2.0]], [[1, 1.0]], [[2, 0.0]]]), "previous"
    )
    return Flow(
        as_signal([[0, 1], ["-1-0.8*sin(3*t)", -0.4]]),
        as_signal([["0.2*t"], ["1+exp(-t)"]]),
        as_signal([["0.5*cos(t)", 0.2]]),
        [as_signal([["1+t", 0]]), table],
    )


def integrated(flow, P, start, end, sensor):
    n = len(P)
    cuts = flow.cuts(start, end)
    inner = cuts[(cuts > start) & (cuts < end)]
    for a, b in zip([start, *inner], [*inner, end], strict=True):

        def rate(t, z, b=b):
            t = min(t, b - 1e-13)
            return shape_rate(
                z.reshape(n, n), flow.A.at(t), flow.B.at(t), flow.K.at(t), flow.rows[sensor].at(t)
            ).ravel()

        P = solve_ivp(rate, (a, b), P.ravel(), "DOP853", rtol=1e-12, atol=1e-13).y[:, -1].reshape(n, n)
    return P


@pytest.mark.parametrize("flow", [constant_flow(), varying_flow()], ids=["constant", "varying"])
@pytest.mark.parametrize("sensor", [0, 1])
def test_an_element_carries_any_start_as_direct_integration_does(flow, sensor):
    rng = np.random.default_rng(sensor)
    element = flow.element(0.2, 1.9, sensor)
    for _ in range(3):
        root = rng.normal(size=(2, 2))
        P = 0.5 * root @ root.T
        assert advance(P, element) == pytest.approx(integrated(flow, P, 0.2, 1.9, sensor), rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("flow", [constant_flow(), varying_flow()], ids=["constant", "varying"])
def test_elements_compose(flow):
    whole = flow.element(0.1, 1.7, 1)
    halves = star(flow.element(0.1, 0.8, 1), flow.element(0.8, 1.7, 1))
    for one, two in zip(whole, halves, strict=True):
        assert two == pytest.approx(one, rel=1e-11, abs=1e-12)
    for one, two in zip(star(identity(2), whole), whole, strict=True):
        assert one == pytest.approx(two, abs=1e-15)


def test_a_stiff_sensor_and_a_long_span_lose_nothing():
    """Scalar: the limit is the root of the algebraic equation 2 a p + (k^2 - c^2) p^2 + b^2 = 0."""
    a, b, k, c = 0.3, 0.7, 0.4, 1e4
    flow = Flow(*(as_signal([[v]]) for v in (a, b, k)), [as_signal([[c]])])
    s = k * k - c * c
    limit = (-a - np.sqrt(a * a - s * b * b)) / s
    assert advance(np.array([[5.0]]), flow.element(0, 50.0, 0))[0, 0] == pytest.approx(limit, rel=1e-12)


@pytest.mark.parametrize("flow", [constant_flow(), varying_flow()], ids=["constant", "varying"])
def test_complex_weights_give_the_exact_derivative(flow):
    P, v, step, e = np.diag([0.5, 1.0]), np.array([[0.3, 0.7]]), 1e-5, np.array([[1.0, 0.0]])

    def after(weights):
        return advance(P, tuple(part[0] for part in flow.elements(np.array([0.0]), np.array([0.6]), weights)))

    exact = after(v + 1e-30j * e).imag / 1e-30
    difference = (after(v + step * e) - after(v - step * e)) / (2 * step)
    assert exact == pytest.approx(difference, rel=1e-7, abs=1e-9)


def test_retreat_is_the_adjoint_of_advance():
    rng = np.random.default_rng(3)
    element, P = constant_flow().element(0, 0.5, 0), np.diag([0.5, 1.0])
    weight, change = (m + m.T for m in rng.normal(size=(2, 2, 2)))
    step = 1e-6
    difference = (advance(P + step * change, element) - advance(P - step * change, element)) / (2 * step)
    assert np.sum(weight * difference) == pytest.approx(np.sum(retreat(P, weight, element) * change), rel=1e-8)


def test_a_jump_anywhere_in_a_formula_is_found():
    """Against constant pieces: steps whose inner points all lie on one side of a jump must not pass."""
    rest = (as_signal(B), as_signal(K), [as_signal(c) for c in C])
    before, after = (Flow(as_signal([[0, 1], [-1, x]]), *rest) for x in (0.4, -0.4))
    for at, known in ((0.777, True), (0.3, False), (1.2345, False), (0.0101, True), (1.99, False)):
        jump = f"-0.4*sign(t-{at})" if known else f"-0.4*sign(erf(t-{at}))"
        flow = Flow(as_signal([[0, 1], [-1, jump]]), *rest)
        exact = star(before.element(0, at, 0), after.element(at, 2, 0))
        for one, two in zip(flow.element(0, 2, 0), exact, strict=True):
            assert one == pytest.approx(two, abs=1e-10)
        assert min(abs(t - at) for t in (flow.cuts(0, 2) if known else flow.kinks)) < 1e-9


@pytest.mark.parametrize("strength", [1.0, 1e3, 1e5])
def test_a_strong_time_varying_sensor_takes_few_steps_and_is_right(strength):
    # position measured a thousand times better than it moves: C'C h is 1e5 to 1e9, the filter itself is slow
    row = as_signal([[f"{strength}*(1+0.5*sin(5*t))", 0]])
    flow = Flow(as_signal([[0, 1], ["-1-0.2*sin(3*t)", -0.4]]), as_signal(B), as_signal(K), [row])
    start, end, one = np.array([0.2]), np.array([0.7]), np.ones((1, 1))
    steps = len(flow.partition(start, end, one, flow.scales(start, end, one))[1])
    assert steps <= 64 * np.sqrt(strength)

    def rate(t, z):  # of P^-1, which a strong sensor does not make small
        Q, A0, B0, K0, C0 = z.reshape(2, 2), *(s.at(t) for s in (flow.A, flow.B, flow.K, row))
        return (-A0.T @ Q - Q @ A0 + C0.T @ C0 - K0.T @ K0 - Q @ B0 @ B0.T @ Q).ravel()

    weight = np.array([[2.0, 0.3], [0.3, 1.0]])
    judged = solve_ivp(rate, (0.2, 0.7), weight.ravel(), "Radau", rtol=1e-9, atol=1e-9).y[:, -1].reshape(2, 2)
    found = advance(np.linalg.inv(weight), flow.element(0.2, 0.7, 0))
    np.testing.assert_allclose(np.linalg.inv(found) / judged, 1, rtol=1e-6)


def test_a_sensor_beyond_all_steps_is_refused_with_the_knob():
    from occontrol.core.errors import SolveFailed

    flow = Flow(as_signal([["sin(t)"]]), as_signal([[1.0]]), as_signal([[0.1]]), [as_signal([["1e12*(2+sin(t))"]])])
    with pytest.raises(SolveFailed, match=r"more than 200000 steps\n  hint: a sensor is very strong"):
        flow.element(0.0, 1.0, 0)
