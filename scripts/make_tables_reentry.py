"""Tables of problems/reentry_waveforms.yaml: a ballistic trajectory, its linearisation, and what a radar sees of it.

Unknowns, in this order: downrange x [km], altitude h [km], dx/dt [km/s], dh/dt [km/s], b = relative error of the drag
coefficient rho*Cd*S/m [1].

    x' = vx,  h' = vh,  vx' = -D vx,  vh' = -D vh - g(h),  b' = 0,     D = (1 + b) rho0 exp(-h/H) |v| / (2 beta)

The reference trajectory (b = 0) is integrated to the ground; A(t) is the Jacobian of the right side along it, C(t) the
Jacobian of what each waveform measures. Both Jacobians are taken by complex steps, so no derivative is written by hand.
Sources: exponential atmosphere and ballistic coefficient as in Zarchan, Tactical and Strategic Missile Guidance (AIAA).

Run from the project's folder:  python scripts/make_tables_reentry.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.80665e-3  # km/s^2 at sea level
EARTH = 6371.0  # km
DENSITY, SCALE_HEIGHT = 1.225e9, 7.2  # kg/km^3 at sea level, km
BALLISTIC = 5000e6  # beta = m/(Cd S): 5000 kg/m^2 in kg/km^2
START = np.array(
    [-160.0, 100.0, 5.2, -2.9, 0.0]
)  # 100 km up, 5.95 km/s, 29 degrees below the horizon, heading for the radar
RADAR = np.array([25.0, 0.0])  # km, some 15 km behind the point of impact


def rate(state: np.ndarray) -> np.ndarray:
    """Right side of the equations of motion; complex states are allowed."""
    _, h, vx, vh, b = state
    speed = np.sqrt(vx**2 + vh**2)
    drag = (1 + b) * DENSITY * np.exp(-h / SCALE_HEIGHT) * speed / (2 * BALLISTIC)
    return np.array([vx, vh, -drag * vx, -drag * vh - GRAVITY * (EARTH / (EARTH + h)) ** 2, 0 * b])


def tracking(state: np.ndarray) -> np.ndarray:
    """Range waveform: range [km] and angle across the line of sight, as a length at 100 km [km]."""
    across, up = state[0] - RADAR[0], state[1] - RADAR[1]
    return np.array([np.sqrt(across**2 + up**2), 100.0 * np.arctan(across / up)])


def doppler(state: np.ndarray) -> np.ndarray:
    """Doppler waveform: range rate [km/s]."""
    across, up = state[0] - RADAR[0], state[1] - RADAR[1]
    return np.array([(across * state[2] + up * state[3]) / np.sqrt(across**2 + up**2)])


def wake(state: np.ndarray) -> np.ndarray:
    """Wake waveform: drag deceleration [km/s^2], which the length and the brightness of the wake give away."""
    vx, vh = state[2], state[3]
    return np.array(
        [
            -(rate(state)[2] * vx + rate(state)[3] * vh + GRAVITY * (EARTH / (EARTH + state[1])) ** 2 * vh)
            / np.sqrt(vx**2 + vh**2)
        ]
    )


def jacobian(function, state: np.ndarray) -> np.ndarray:
    """Derivative by complex steps, exact to rounding."""
    columns = [function(state + 1e-30j * unit).imag / 1e-30 for unit in np.eye(len(state))]
    return np.stack(columns, axis=1)


def reference(step: float = 0.05):
    """Times from entry to the ground, the states there, and the instant of impact."""

    def ground(_, state):
        return state[1]

    ground.terminal = True
    path = solve_ivp(
        lambda _, s: rate(s), (0, 200), START, method="DOP853", rtol=1e-12, atol=1e-12, events=ground, dense_output=True
    )
    impact = float(path.t_events[0][0])
    times = np.append(np.arange(0, impact, step), impact)
    return times, path.sol(times).T, impact


def tables(step: float = 0.05) -> dict[str, np.ndarray]:
    """Everything that goes into reentry_waveforms.npz."""
    times, states, _ = reference(step)
    result = {"t": times, "A": np.array([jacobian(rate, s) for s in states]), "reference": states}
    for name, function in (("tracking", tracking), ("doppler", doppler), ("wake", wake)):
        result[f"C_{name}"] = np.array([jacobian(function, s) for s in states])
    vx, vh = states[-1, 2], states[-1, 3]
    # the point of impact moves with the position there and, while the target still flies on, with how high it is
    result["D"] = np.array([[1.0, -vx / vh, 0, 0, 0]])
    return result


def main() -> None:
    made = tables()
    target = Path(__file__).resolve().parent.parent / "problems" / "reentry_waveforms.npz"
    np.savez_compressed(target, **{name: value for name, value in made.items() if name != "D"})
    states, times = made["reference"], made["t"]
    print(f"impact at t = {times[-1]:.4f} s, x = {states[-1, 0]:.3f} km, {np.hypot(*states[-1, 2:4]):.3f} km/s")
    print(f"D = {made['D'][0].round(6)}")
    for t in (10, 20, 25, 30, 35):
        k = int(np.searchsorted(times, t))
        print(f"t = {t:2d} s: altitude {states[k, 1]:7.3f} km, drag {wake(states[k])[0] / GRAVITY:7.2f} g")
    print(f"{target.name}: {target.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
