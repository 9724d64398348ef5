"""Second moments of state and measurement, and what a measurement of given precision makes of them.

Unknowns: lambda (m,), the precision (inverse noise variance) of every scalar measurement; S = diag(lambda).
P = M Sigma_xx M' (the block of the state that is bounded), G = M Sigma_xy, Y = Sigma_yy. Das & Bhattacharya, section 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from occontrol.core.checks import check_covariance
from occontrol.core.errors import Mistake


@dataclass(frozen=True, eq=False)
class Moments:
    """Joint second moments of n states and m scalar measurements, before noise.

    Parameters
    ----------
    state : (n, n) P, [state unit]^2
    cross : (n, m) G
    measurement : (m, m) Y; may be singular
    anomalies : (n + m, N) a factor of the joint moment, [P G; G' Y] = anomalies anomalies', where there is one:
        rank decisions are then made on singular values, which keep twice the digits

    Das & Bhattacharya, equations (9), (10), (12), (13).
    """

    state: np.ndarray
    cross: np.ndarray
    measurement: np.ndarray
    anomalies: np.ndarray | None = None

    @property
    def states(self) -> int:
        """The number n of bounded states."""
        return self.state.shape[0]

    @property
    def sensors(self) -> int:
        """The number m of scalar measurements."""
        return self.measurement.shape[0]

    def only(self, index: Sequence[int] | np.ndarray) -> Moments:
        """The moments of a subset of the measurements. `index` (k,)."""
        index = np.asarray(index, dtype=int)
        anomalies = self.anomalies
        if anomalies is not None:
            anomalies = np.vstack([anomalies[: self.states], anomalies[self.states + index]])
        return Moments(self.state, self.cross[:, index], self.measurement[np.ix_(index, index)], anomalies)

    def given(self, precisions: np.ndarray) -> Moments:
        """The moments that are left after a measurement with `precisions` (m,); zero is not measured.

        Both the states and the noise-free measurements are conditioned, so that further sensors can be chosen on top.
        """
        joint = np.block([[self.state, self.cross], [self.cross.T, self.measurement]])
        n = self.states
        after = posterior_covariance(Moments(joint, joint[:, n:], self.measurement), precisions)
        anomalies = None
        if self.anomalies is not None:
            anomalies = self.anomalies @ square_root_transform(self.anomalies[n:], precisions)
            after = anomalies @ anomalies.T
        return Moments(after[:n, :n], after[:n, n:], after[n:, n:], anomalies)


def moments_of_anomalies(state: np.ndarray, measurement: np.ndarray) -> Moments:
    """Moments of anomalies `state` (n, N) and `measurement` (m, N) that already hold the square roots of the weights.

    P = A_x A_x',  G = A_x A_y',  Y = A_y A_y'

    Das & Bhattacharya, equations (9) and (10), with the factor 1/(N-1) inside the anomalies.
    """
    return Moments(state @ state.T, state @ measurement.T, measurement @ measurement.T, np.vstack([state, measurement]))


def _scaled(measurement: np.ndarray, precisions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    root = np.sqrt(np.asarray(precisions, dtype=float))
    return root, np.eye(len(root)) + root[:, None] * measurement * root


def posterior_covariance(moments: Moments, precisions: np.ndarray) -> np.ndarray:
    """Covariance (n, n) of the states after measurements with `precisions` (m,) >= 0.

    Sigma+ = P - G S^(1/2) (I + S^(1/2) Y S^(1/2))^-1 S^(1/2) G'

    Equal to equation (11) of Das & Bhattacharya with R = S^-1, and valid for zero precisions and singular Y.
    """
    from scipy.linalg import solve_triangular

    root, inner = _scaled(moments.measurement, precisions)
    seen = (moments.cross * root).T
    try:
        half = solve_triangular(np.linalg.cholesky(inner), seen, lower=True)
    except np.linalg.LinAlgError:
        # Y is indefinite in its last digits and the precisions magnify that; I + Y >= I holds all the same
        values, vectors = np.linalg.eigh(inner)
        half = (vectors / np.sqrt(np.maximum(values, 1.0))).T @ seen
    return moments.state - half.T @ half


def gain(cross: np.ndarray, measurement: np.ndarray, precisions: np.ndarray) -> np.ndarray:
    """Kalman gain (n, m), zero columns where the precision is zero.

    `cross` is G (n, m), `measurement` is Y (m, m), `precisions` is the diagonal (m,) of S.

    K = G S (I + Y S)^-1 = G S^(1/2) (I + S^(1/2) Y S^(1/2))^-1 S^(1/2)

    Das & Bhattacharya, equation (8), in a form that needs no noise covariance.
    """
    root, inner = _scaled(measurement, precisions)
    return np.linalg.solve(inner, (cross * root).T).T * root


def square_root_transform(measurement: np.ndarray, precisions: np.ndarray) -> np.ndarray:
    """Symmetric T (N, N) with anomalies after = anomalies before @ T.

    T = (I + A_y' S A_y)^(-1/2)

    Its square gives exactly equation (11); with mean-centred anomalies T 1 = 1, so the mean stays where it is.

    `measurement` holds anomalies A_y (m, N); `precisions` (m,).
    """
    count = measurement.shape[1]
    eigenvalues, vectors = np.linalg.eigh(
        np.eye(count) + measurement.T @ (np.asarray(precisions)[:, None] * measurement)
    )
    return (vectors / np.sqrt(np.maximum(eigenvalues, 1.0))) @ vectors.T


def printed_blocks(moments: Moments, bound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Constant (n+m, n+m) and factors (m, n+m) of the matrix inequality as it is printed: it needs Y nonsingular.

    [[P^d - P, 0], [0, Y^-1]] + sum_i lambda_i f_i f_i' >= 0,  f_i = [g_i; e_i]

    Das & Bhattacharya, equation (16). Kept for comparison; the solvers use `solvers.precision_normal`.

    `bound` is P^d (n, n).
    """
    n, m = moments.states, moments.sensors
    constant = np.zeros((n + m, n + m))
    constant[:n, :n] = bound - moments.state
    constant[n:, n:] = np.linalg.inv(moments.measurement)
    return constant, np.hstack([moments.cross.T, np.eye(m)])


def check_moments(moments: Moments) -> list[Mistake]:
    """What is wrong with moments that a user gave; paths are state, cross and measurement.

    Parameters
    ----------
    moments : Moments whose state and measurement are square
    """
    n, m = moments.state.shape[0], moments.measurement.shape[0]
    mistakes = check_covariance("state", moments.state, ("state",))
    mistakes += check_covariance("measurement", moments.measurement, ("measurement",))
    if moments.cross.shape != (n, m):
        rows, columns = moments.cross.shape
        what = f"cross is {rows}x{columns}, but state is {n}x{n} and measurement {m}x{m}"
        hint = f"it must be {n}x{m}: one row per state, one column per sensor"
        mistakes.append(Mistake(("cross",), what, hint))
    if mistakes:
        return mistakes
    joint = np.block([[moments.state, moments.cross], [moments.cross.T, moments.measurement]])
    scale = np.sqrt(np.maximum(np.diag(joint), 0.0))
    if np.any((scale == 0) & np.any(joint != 0, axis=1)):
        i = int(np.argmax((scale == 0) & np.any(joint != 0, axis=1)))
        which = f"state {i + 1}" if i < n else f"measurement {i - n + 1}"
        return [
            Mistake(
                ("cross",),
                f"{which} has variance 0 but a covariance with others",
                "no random vector has these moments",
            )
        ]
    safe = np.where(scale > 0, scale, 1.0)
    smallest = float(np.linalg.eigvalsh(joint / safe / safe[:, None])[0])
    if smallest < -1e-7:
        what = "state, cross and measurement together are not positive semidefinite: "
        what += f"smallest eigenvalue {smallest:g} (unit diagonal)"
        return [Mistake((), what, "no random vector has these moments; measurement is Syy without the sensor noise")]
    return []
