"""State spaces of python-control, SciPy and others: in as a plant, out as matrices. Nothing of theirs is imported.

plant, C = oc.plant_from(system, noise=Q, covariance=P0)
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.plant import LinearPlant


class StateSpace(Protocol):
    """What has A, B, C, D and perhaps a sampling time dt, of any shape: control.StateSpace, scipy.signal.StateSpace."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


def plant_from(
    system: StateSpace | tuple[np.ndarray, ...],
    noise: np.ndarray,
    through: np.ndarray | None = None,
    covariance: np.ndarray | None = None,
    mean: np.ndarray | None = None,
) -> tuple[LinearPlant, np.ndarray]:
    """dx/dt = A x + G w, z = C x of a state space in continuous time; its known input is left out.

    Parameters
    ----------
    system : with the attributes A, B, C, D, or the tuple (A, B, C, D)
    noise : (p, p) intensity of w, [unit of w]^2 * time; p = n without `through`
    through : G, (n, p); the identity if left out
    covariance : (n, n) of the initial state; the identity if left out
    mean : (n,) of the initial state; zero if left out

    Returns the plant and C (m, n). Raises ProblemError for a system in discrete time, one whose D is not zero, and
    matrices that do not fit.
    """
    A, _, C, D = (np.array(part, dtype=float) for part in _parts(system))
    step = getattr(system, "dt", None)
    if (step is not None and not isinstance(step, bool) and step != 0) or step is True:
        raise _wrong(f"the system is in discrete time, dt = {step}", "give the one in continuous time")
    if np.any(D != 0):
        raise _wrong("D of the system is not zero", "subtract D u from the measurements, and give a system without D")
    n = len(A)
    G = np.eye(n) if through is None else np.array(through, dtype=float)
    driving = np.atleast_2d(np.array(noise, dtype=float))
    if G.shape != (n, len(driving)):
        size = "x".join(map(str, G.shape))
        raise _wrong(f"through is {size}, it must be {n}x{len(driving)}", "one row per state, one column per noise")
    whole = driving if through is None else G @ driving @ G.T
    return LinearPlant(A, whole, np.eye(n) if covariance is None else covariance, mean), C


def matrices_of(plant: LinearPlant, C: np.ndarray, t: float = 0.0) -> tuple[np.ndarray, ...]:
    """(A, B, C, D) of a plant at one time, as control.ss and scipy.signal.StateSpace take them; D is zero.

    Parameters
    ----------
    plant : LinearPlant with n states
    C : (m, n)
    t : at which a plant that varies is looked at, in the unit of time
    """
    B = np.zeros((plant.states, 1)) if plant.B is None else plant.B.at(t)
    C = np.atleast_2d(np.asarray(C, dtype=float))
    return plant.A.at(t).copy(), B.copy(), C.copy(), np.zeros((len(C), B.shape[1]))


def _parts(system: StateSpace | tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    if isinstance(system, tuple):
        if len(system) != 4:
            raise _wrong(f"the tuple has {len(system)} entries", "(A, B, C, D)")
        return system
    lacking = [name for name in "ABCD" if not hasattr(system, name)]
    if lacking:
        raise _wrong(f"{type(system).__name__} has no {', '.join(lacking)}", "a state space with A, B, C, D")
    return system.A, system.B, system.C, system.D


def _wrong(what: str, hint: str) -> ProblemError:
    return ProblemError(Mistake((), what, hint))
