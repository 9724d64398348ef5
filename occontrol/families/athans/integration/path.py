"""Covariance, costate and switching functions at the edges of the schedule, and the parts of its cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.families.athans.integration.folded import Extrapolated, Folded
from occontrol.families.athans.integration.integrator import Evaluation, Integrator
from occontrol.families.athans.integration.local_error import node_matrices
from occontrol.families.athans.node_path import Path, node_path


@dataclass(frozen=True, eq=False)
class Parts:
    """A policy's path and what its cost is made of.

    Parameters
    ----------
    path : Path; `updated` is empty where an interval has several steps
    observation : alpha times the observation cost
    prediction : tr(W Sigma(T))
    """

    path: Path
    observation: float
    prediction: float


def parts_of(integrator: Integrator, found: Evaluation) -> Parts:
    """The path of a policy that was evaluated, extrapolated as its cost was.

    Parameters
    ----------
    integrator : Integrator
    found : Evaluation
    """
    v, r = found.weights, integrator.recursion
    if found.on is None:
        path = node_path(r, integrator.halves, v)
        return Parts(path, float(np.vdot(r.cost, v)), float(np.vdot(r.terminal, path.covariance[-1])))
    meshes = [found.on] if isinstance(found.on, Folded) else [found.on.half, found.on.whole]
    shares = [1.0] if len(meshes) == 1 else [4 / 3, -1 / 3]
    for folded in meshes:
        folded.cost_and_gradient(v)
    observation = sum(s * float(np.vdot(f.fine.cost, v[f.mesh.owner])) for s, f in zip(shares, meshes, strict=True))
    whole = [node_matrices(f, v) for f in meshes]
    first = [np.append(f.first, len(f.mesh)) for f in meshes]
    nothing = np.zeros(())
    covariance = sum([s * S[at] for s, (S, _), at in zip(shares, whole, first, strict=True)], nothing)
    costate = sum([s * P[at] for s, (_, P), at in zip(shares, whole, first, strict=True)], nothing)
    switching = found.gradient / integrator.problem.steps[:, None]
    path = Path(covariance, np.empty((0, r.states, r.states)), costate, switching)
    return Parts(path, observation, float(np.vdot(r.terminal, covariance[-1])))


def finer_steps(found: Evaluation) -> bool:
    """Whether an interval has several steps of integration."""
    return isinstance(found.on, Folded | Extrapolated) and found.steps > len(found.weights)
