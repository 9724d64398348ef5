"""A chooser walked over the whole horizon without data: the covariances that it would bring about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.core.monitor import Monitor
from occontrol.families.vlambda.baselines import HoldChooser
from occontrol.families.vlambda.online import OnlineSelector
from occontrol.families.vlambda.sampled_plant import SampledPlant
from occontrol.families.vlambda.sensor_choice import Choice, Chooser


@dataclass(frozen=True, eq=False)
class Selection:
    """Choices and covariances of one run, scaled states; index k = 0 .. K-1.

    Parameters
    ----------
    choices : one Choice per epoch
    eigenvalues : (K, n) of P(k|k), descending
    eigenvectors : (K, n, n) of P(k|k), columns, the largest entry of each positive
    covariance : (K, n, n) P(k|k)
    predicted_eigenvalues : (K, n) of P(k|k-1), descending
    notes : announcements of the filter
    held_from : first k of the epochs that kept the last choice because the monitor said stop, or None
    """

    choices: tuple[Choice, ...]
    eigenvalues: np.ndarray
    eigenvectors: np.ndarray
    covariance: np.ndarray
    predicted_eigenvalues: np.ndarray
    notes: tuple[str, ...]
    held_from: int | None = None

    @property
    def traces(self) -> np.ndarray:
        """(K,) traces of P(k|k)."""
        return self.eigenvalues.sum(axis=1)


def run_selection(
    plant: SampledPlant, starts: np.ndarray, select: int, chooser: Chooser, monitor: Monitor | None = None
) -> Selection:
    """Walk the horizon with `chooser`; the covariance does not depend on measured values.

    Parameters
    ----------
    plant, select, chooser : as in OnlineSelector
    starts : (E+1,), as in OnlineSelector
    monitor : asked at every step whether to stop; the last choice is then kept to the end
    """
    loop = OnlineSelector(plant, starts, select, chooser)
    posterior, predicted, held = [], [], None
    while not loop.finished:
        predicted.append(loop.filter.factors.eigenvalues)
        loop.step()
        posterior.append(loop.posterior)
        if held is None and monitor is not None and monitor.stop and len(loop.choices) < len(starts) - 1:
            held, loop.chooser = int(starts[len(loop.choices)]), HoldChooser(loop.choice)
    vectors = np.array([f.vectors for f in posterior])
    largest = np.take_along_axis(vectors, np.argmax(np.abs(vectors), axis=1)[:, None, :], axis=1)
    return Selection(
        tuple(loop.choices),
        np.array([f.eigenvalues for f in posterior]),
        vectors * np.sign(largest),
        np.array([f.covariance for f in posterior]),
        np.array(predicted),
        loop.filter.notes,
        held,
    )
