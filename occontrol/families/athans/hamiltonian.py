"""Athans' Hamiltonian, written once; everything else follows from it by automatic differentiation.

Letters of the paper: Sigma covariance, P costate, v weights, Xi plant noise, L_j = C_j' Theta_j^-1 C_j information
rate of sensor j, q_j cost rate, alpha cost weight. Full n x n matrices throughout: nothing is packed here.
Athans (1971), equations (5.2), (5.3), (5.4), (5.12).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from occontrol.core.kinds import Casadi, CasadiFunction


def hamiltonian(
    covariance: Casadi,
    costate: Casadi,
    weights: Casadi,
    A: Casadi,
    noise: Casadi,
    rates: Sequence[Casadi],
    costs: Casadi,
    cost_weight: Casadi,
    running: Casadi,
) -> Casadi:
    """The Hamiltonian of the scheduling problem.

    H = alpha sum_j q_j v_j + tr(R Sigma) + tr[(A Sigma + Sigma A' + Xi - Sigma (sum_j v_j L_j) Sigma) P']

    The scan of (5.2) prints '+' before the quadratic term; it is '-'. tr(R Sigma) is the optional running cost.

    Parameters
    ----------
    covariance, costate : (n, n) CasADi matrices
    weights : (M, 1)
    A, noise, running : (n, n)
    rates : M matrices L_j (n, n), see `information_rates`
    costs : (M, 1)
    cost_weight : scalar

    Returns
    -------
    scalar, the same kind as the arguments
    """
    import casadi

    information = sum((weights[j] * rate for j, rate in enumerate(rates)), casadi.SX.zeros(*covariance.shape))
    rate = A @ covariance + covariance @ A.T + noise - covariance @ information @ covariance
    observation = cost_weight * casadi.dot(costs, weights)
    return observation + casadi.trace(running @ covariance) + casadi.trace(rate @ costate.T)


@lru_cache(maxsize=32)
def canonical_equations(states: int, sensors: int) -> CasadiFunction:
    """The canonical equations and the switching functions, from `hamiltonian` by CasADi's AD.

    dSigma/dt = dH/dP,   dP/dt = -dH/dSigma,   s_j = dH/dv_j

    Parameters
    ----------
    states : n
    sensors : M

    Returns
    -------
    casadi.Function with inputs covariance, costate, A, noise, running (n, n), weights, costs (M, 1), cost_weight,
    rates (n, n M), the matrices L_j side by side; and outputs hamiltonian (1, 1), covariance_rate,
    costate_rate (n, n), switching (M, 1). For symmetric arguments they are Athans (1971), (5.2), (5.3), (5.4), (5.12).
    """
    import casadi

    n, m = states, sensors
    covariance, costate = casadi.SX.sym("Sigma", n, n), casadi.SX.sym("P", n, n)
    A, noise, running = casadi.SX.sym("A", n, n), casadi.SX.sym("Xi", n, n), casadi.SX.sym("R", n, n)
    weights, costs, cost_weight = casadi.SX.sym("v", m), casadi.SX.sym("q", m), casadi.SX.sym("alpha")
    rates = casadi.SX.sym("L", n, n * m)
    parts = [rates[:, j * n : (j + 1) * n] for j in range(m)]
    value = hamiltonian(covariance, costate, weights, A, noise, parts, costs, cost_weight, running)
    inputs = {
        "covariance": covariance,
        "costate": costate,
        "weights": weights,
        "A": A,
        "noise": noise,
        "rates": rates,
        "costs": costs,
        "cost_weight": cost_weight,
        "running": running,
    }
    outputs = {
        "hamiltonian": value,
        "covariance_rate": casadi.gradient(value, costate),
        "costate_rate": -casadi.gradient(value, covariance),
        "switching": casadi.gradient(value, weights),
    }
    return casadi.Function("canonical", [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])


def information_rates(C: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """L = C' Theta^-1 C, the rate at which a sensor delivers information; Athans (1971), equation (5.10).

    Parameters
    ----------
    C : (..., m, n)
    noise : (..., m, m) intensity Theta, symmetric positive definite

    Returns
    -------
    (..., n, n) symmetric; zero for the idle sensor (m = 0)
    """
    if C.shape[-2] == 0:
        return np.zeros((*C.shape[:-2], C.shape[-1], C.shape[-1]))
    rate = np.swapaxes(C, -1, -2) @ np.linalg.solve(noise, C)
    return (rate + np.swapaxes(rate, -1, -2)) / 2
