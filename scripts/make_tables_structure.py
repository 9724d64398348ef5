"""Tables of problems/large_structure.yaml: a tensioned mast with a payload and a damper, in modal coordinates.

Unknowns: 12 modal amplitudes eta_k [mm], then 12 modal rates [mm/s]. Pinned-pinned beam of length 40 m under tension,
w(x, t) = sum_k eta_k(t) sin(k pi x/L):

    M eta'' + C eta' + K eta = forces,    K_kk = EI (k pi/L)^4 L/2 + T (k pi/L)^2 L/2,   M_kk = mu L/2

A payload of mass m at x_p adds m phi phi' to M, a damper at x_d adds c phi phi' to C (phi = mode shapes at that point):
both couple all modes. Forces: a thruster's noise at the payload and a distributed disturbance that reaches every mode.
Source: Meirovitch, Fundamentals of Vibrations, chapters 7 and 8.

Run from the project's folder:  python scripts/make_tables_structure.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

LENGTH, LINE_MASS = 40.0, 2.0  # m, kg/m
STIFFNESS, TENSION = 3.0e2, 5.0e2  # EI in N m^2, N
PAYLOAD, PAYLOAD_AT = 12.0, 27.0  # kg, m
DAMPER, DAMPER_AT = 6.0, 9.0  # N s/m, m
DAMPING = 0.005  # of every mode of the bare mast
MODES = 12
THRUSTER, DISTRIBUTED = 4.0, 0.25  # N^2 s at the payload; N^2 s per metre, as intensities, in (0.1 N)^2 s
STRAIN_AT = np.linspace(1.5, 38.5, 20)  # m; strain gauges
RATE_AT = np.linspace(3.0, 37.0, 14)  # m; velocity pickups
DEPTH = 0.3  # m: gauges sit this far from the neutral axis


def shapes(places: np.ndarray, derivative: int = 0) -> np.ndarray:
    """(len(places), MODES) sin(k pi x/L), or its second derivative [1/m^2]."""
    wave = np.arange(1, MODES + 1) * np.pi / LENGTH
    value = np.sin(np.outer(np.atleast_1d(places), wave))
    return -value * wave**2 if derivative == 2 else value


def tables() -> dict[str, np.ndarray]:
    """A [1/s], noise intensity [mm^2/s^3], initial covariance, and one row per sensor."""
    wave = np.arange(1, MODES + 1) * np.pi / LENGTH
    payload, damper = shapes(PAYLOAD_AT)[0], shapes(DAMPER_AT)[0]
    bare_mass = np.eye(MODES) * LINE_MASS * LENGTH / 2
    mass = bare_mass + PAYLOAD * np.outer(payload, payload)
    stiffness = np.diag((STIFFNESS * wave**4 + TENSION * wave**2) * LENGTH / 2)
    bare = np.sqrt(np.diag(stiffness) / np.diag(bare_mass))
    damping = np.diag(2 * DAMPING * bare * np.diag(bare_mass)) + DAMPER * np.outer(damper, damper)
    inverse = np.linalg.inv(mass)
    A = np.block([[np.zeros((MODES, MODES)), np.eye(MODES)], [-inverse @ stiffness, -inverse @ damping]])
    force = THRUSTER * np.outer(payload, payload) + DISTRIBUTED * (LENGTH / 2) * np.eye(MODES)
    noise = np.zeros_like(A)
    noise[MODES:, MODES:] = inverse @ force @ inverse.T * 1e4  # (0.1 N)^2 = 1e-2 N^2; m^2 = 1e6 mm^2
    noise = (noise + noise.T) / 2
    result = {"t": np.array([0.0]), "A": A[None], "noise": noise[None]}
    # strain in microstrain: depth * curvature, where 1 m * 1 mm/m^2 is 1e3 microstrain; z positive in tension
    for i, row in enumerate(-DEPTH * shapes(STRAIN_AT, 2) * 1e3, start=1):
        result[f"strain_{i:02d}"] = np.concatenate([row, np.zeros(MODES)])[None, None]
    for i, row in enumerate(shapes(RATE_AT), start=1):
        result[f"rate_{i:02d}"] = np.concatenate([np.zeros(MODES), row])[None, None]
    result["payload"] = np.concatenate([payload, np.zeros(MODES)])[None, None]
    return result


def main() -> None:
    made = tables()
    target = Path(__file__).resolve().parent.parent / "problems" / "large_structure.npz"
    np.savez_compressed(target, **made)  # type: ignore[arg-type]
    poles = np.linalg.eigvals(made["A"][0])
    poles = poles[poles.imag > 0][np.argsort(np.abs(poles[poles.imag > 0]))]
    print("frequencies [rad/s]:", np.abs(poles).round(2))
    print("damping ratios [%]: ", (-100 * poles.real / np.abs(poles)).round(2))
    vibration = np.sqrt(np.diag(solve_continuous_lyapunov(made["A"][0], -made["noise"][0])))
    print("left alone, one standard deviation [mm]:  ", vibration[:MODES].round(2))
    print("                                   [mm/s]:", vibration[MODES:].round(2))
    print(f"{target.name}: {target.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
