"""The set of possible states: against direct integration, sampled truths, and a truth that touches it."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from occontrol.core.errors import UsageError
from occontrol.core.signal import as_signal
from occontrol.families.robust.ellipsoid_size import Size
from occontrol.families.robust.game import center_rate, shape_rate
from occontrol.families.robust.history import history
from occontrol.families.robust.online import OnlineSwitching
from occontrol.families.robust.plant import UncertainPlant
from occontrol.families.robust.sampling import sample_truths
from occontrol.families.robust.scattering import Flow
from occontrol.families.robust.search import search
from occontrol.families.robust.set_membership import initial_states, propagate
from occontrol.families.robust.slots import slot_table

A, B, K = np.array([[0, 1.0], [-1, -0.4]]), np.array([[0.0], [1]]), np.array([[0.5, 0.2]])
C = [np.array([[1.0, 0]]), np.array([[0, 1.0]])]
PLANT = UncertainPlant(A, B, K, np.diag([2.0, 1.0]), [1.0, -0.5], 1.0)
EDGES = np.linspace(0, 2.0, 6)
CONSTANT = Flow(PLANT.A, PLANT.B, PLANT.K, [as_signal(c) for c in C])
VARYING = Flow(
    as_signal([[0, 1], ["-1-0.3*sin(3*t)", -0.4]]),
    as_signal([["0.1*cos(t)"], [1]]),
    as_signal([["0.5*exp(-t)", 0.2]]),
    [as_signal([["1+0.5*sin(2*t)", 0]]), as_signal([[0.2, 1]])],
)
SEQUENCE = [1, 1, 0, 0, 1]


def direct(flow, samples):
    """Center, shape and level by integrating (4), (5), (7)."""
    z = np.concatenate([np.linalg.inv(PLANT.weight).ravel(), PLANT.center, [0.0]])
    for (start, end, sensor), y in samples:

        def rate(t, z, sensor=sensor, y=y):
            P, x = z[:4].reshape(2, 2), z[4:6]
            At, Bt, Kt, Ct = (s.at(t) for s in (flow.A, flow.B, flow.K, flow.rows[sensor]))
            dx, spent = center_rate(x, y, P, At, Kt, Ct)
            return np.concatenate([shape_rate(P, At, Bt, Kt, Ct).ravel(), dx, [spent]])

        z = solve_ivp(rate, (start, end), z, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return z[4:6], z[:4].reshape(2, 2), PLANT.level + z[6]


@pytest.mark.parametrize("flow", [CONSTANT, VARYING], ids=["constant", "varying"])
@pytest.mark.parametrize("scale", [0.3, 1e3])
def test_held_samples_are_taken_in_exactly(flow, scale):
    rng = np.random.default_rng(1)
    grid = np.linspace(0, 2, 11)
    samples = [
        ((a, b, SEQUENCE[k // 2]), scale * rng.normal(size=1)) for k, (a, b) in enumerate(itertools.pairwise(grid))
    ]
    states = initial_states(0.0, PLANT.center, PLANT.weight, PLANT.level)
    for (_, end, sensor), y in samples:
        states = propagate(flow, states, end, sensor, y)
    center, shape, level = direct(flow, samples)
    assert states.center == pytest.approx(center, rel=1e-9, abs=1e-9)
    assert states.shape == pytest.approx(shape, rel=1e-9, abs=1e-10)
    assert states.level == pytest.approx(level, rel=1e-9)


@pytest.mark.parametrize("flow", [CONSTANT, VARYING], ids=["constant", "varying"])
def test_no_admissible_truth_leaves_the_set(flow):
    """4,000 norm-bounded uncertainties: switching, constant, pushing outwards as hard as they may; and 1,333 pushes."""
    truths = sample_truths(flow, PLANT, EDGES, SEQUENCE, 5333, seed=1, steps=20)
    assert np.max(truths.share) <= 1 + 1e-9
    # and not because the sets were huge: truths that start on the edge stay near it for a while
    assert np.max(truths.share[2]) > 0.9
    along = history(flow, EDGES, SEQUENCE, PLANT.weight, PLANT.center, PLANT.level, Size.of("trace"), 20)
    assert np.all(truths.level <= along.level[:, None] * (1 + 1e-7))


def test_an_admissible_truth_touches_the_set():
    """Backwards from an edge point with w = B'P^-1 (x - center): it spends exactly the energy that there is."""
    rng = np.random.default_rng(4)
    grid = np.linspace(0, 2, 21)
    held, path = [], []
    states = initial_states(0.0, PLANT.center, PLANT.weight, PLANT.level)
    for k in range(20):
        path.append(states)
        held.append(C[SEQUENCE[k // 4]] @ states.center + 0.3 * rng.normal(size=1))
        states = propagate(CONSTANT, states, grid[k + 1], SEQUENCE[k // 4], held[k])
    assert states.level > 0
    direction = rng.normal(size=2)
    edge = states.center + direction * np.sqrt(states.level / (direction @ states.inverse @ direction))
    assert states.share(edge) == pytest.approx(1.0, abs=1e-12)
    x, energy = edge, 0.0
    for k in reversed(range(20)):
        c, y, span = C[SEQUENCE[k // 4]], held[k], (grid[k], grid[k + 1])
        start = np.concatenate([path[k].shape.ravel(), path[k].center])

        def estimator(t, z, c=c, y=y):
            P = z[:4].reshape(2, 2)
            return np.concatenate([shape_rate(P, A, B, K, c).ravel(), center_rate(z[4:], y, P, A, K, c)[0]])

        inner = solve_ivp(estimator, span, start, "DOP853", dense_output=True, rtol=1e-12, atol=1e-13).sol

        def backward(t, z, inner=inner, c=c, y=y):
            now, x = inner(t), z[:2]
            w = B.T @ np.linalg.solve(now[:4].reshape(2, 2), x - now[4:])
            v, unseen = y - c @ x, K @ x
            return np.concatenate([A @ x + B @ w, [w @ w + v @ v - unseen @ unseen]])

        done = solve_ivp(backward, span[::-1], np.append(x, 0.0), "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        x, energy = done[:2], energy - done[2]
    spent = (x - PLANT.center) @ PLANT.weight @ (x - PLANT.center) + energy
    assert spent == pytest.approx(PLANT.level, abs=1e-8)


def test_a_missing_sample_leaves_a_larger_set():
    states = initial_states(0.0, PLANT.center, PLANT.weight, PLANT.level)
    with_sample = propagate(CONSTANT, states, 0.2, 0, CONSTANT.rows[0].at(0) @ PLANT.center)
    without = propagate(CONSTANT, states, 0.2, 0, None)
    assert np.linalg.eigvalsh(without.shape - with_sample.shape)[-1] > 1e-3
    assert np.linalg.eigvalsh(without.shape - with_sample.shape)[0] > -1e-12


def online(terms):
    table = slot_table(CONSTANT, EDGES, PLANT.weight, PLANT.center, PLANT.level, Size.of(terms))
    assert table is not None
    return table, OnlineSwitching(table, PLANT)


@pytest.mark.parametrize("terms", ["trace", {"volume": 1, "longest-axis": 10}])
def test_online_the_guarantee_never_grows_and_holds(terms):
    table, loop = online(terms)
    rng = np.random.default_rng(0)
    assert loop.guarantee == pytest.approx(search(table).cost, rel=1e-9)
    guarantees = [loop.guarantee]
    while loop.sensor is not None:
        middle = (loop.states.time + loop.slot_end) / 2
        for until in (middle, None):
            y = C[loop.sensor] @ loop.states.center + 0.1 * rng.normal(size=1)
            loop.measure(y, until)
        guarantees.append(loop.guarantee)
    assert np.all(np.diff(guarantees) <= 1e-12 * np.array(guarantees[:-1]))
    assert guarantees[-1] < guarantees[0]
    reached = float(Size.of(terms).value(loop.states.shape, loop.states.level))
    assert reached == pytest.approx(loop.guarantee, rel=1e-12)
    with pytest.raises(UsageError, match="horizon is over"):
        loop.measure(None)


def test_measurements_matter_only_for_sizes_of_mixed_degree():
    """Homogeneous sizes are searched once; sums of different degree at every switching time, and plans may change."""
    _, loop = online("trace")
    _, mixed = online({"trace": 1, "longest-axis": 3})
    for each in (loop, mixed):
        while each.sensor is not None:
            each.measure(C[each.sensor] @ each.states.center)
    assert loop.searches == 1
    assert mixed.searches == 5
    rng, changed = np.random.default_rng(0), 0
    for _ in range(8):
        flow = Flow(
            as_signal(A), as_signal(B), as_signal(K), [as_signal(rng.normal(size=(1, 2)) * 2) for _ in range(3)]
        )
        plans = []
        for level in (0.02, 50.0):
            table = slot_table(flow, EDGES, PLANT.weight, np.zeros(2), level, Size.of({"trace": 1, "longest-axis": 3}))
            assert table is not None
            plans.append(search(table).sequence)
        changed += plans[0] != plans[1]
    assert changed > 0


def test_steps_by_name_are_the_measurements_of_the_sensor_in_use():
    _, plain = online("trace")
    table, _ = online("trace")
    named = OnlineSwitching(table, PLANT, names=("left", "right", "third")[: table.sensors])
    k = 0
    while not named.finished:
        (name,) = named.next_sensors
        y = None if k == 1 else C[plain.sensor] @ plain.states.center + 0.05
        states = plain.measure(y)
        step = named.step({name: y} if k < 1 else y if k > 1 else {name: [np.nan]})
        assert step.time == states.time and step.dimension == (0 if y is None else 1)
        assert np.array_equal(step.estimate, states.center) and step.level == states.level
        assert np.array_equal(step.covariance, states.shape * states.level)
        assert step.standard_deviation == pytest.approx(states.half_widths, rel=1e-12)
        assert step.guarantee == plain.guarantee and step.next_sensors == named.next_sensors
        assert step.prediction.shape == (0,) and np.isnan(step.nis)
        k += 1
    assert k == len(EDGES) - 1 and step.next_sensors == ()
    again = OnlineSwitching(table, PLANT)
    assert again.next_sensors == (f"sensor {again.sensor + 1}",)
    with pytest.raises(UsageError, match=r"there is no sensor 'sensr 1'\n  hint: did you mean 'sensor 1'\?"):
        again.step({"sensr 1": [0.0]})
    other = "sensor 2" if again.sensor == 0 else "sensor 1"
    with pytest.raises(UsageError, match=f"{other}' is not in use, in use: sensor"):
        again.step({other: [0.0]})
    with pytest.raises(UsageError, match="is 1 finite values, not"):
        again.step([0.0, 1.0])
