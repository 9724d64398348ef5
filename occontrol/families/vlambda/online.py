"""Selection and estimation on-line: measurements of one step in, estimate and the sensors to use next out.

This is what a loop on a target calls. Chooser, criterion and estimator are apart: the chooser is any object with
`choose(Epoch) -> Choice`, the estimator is the V-Lambda filter. Covariance runs without data use the same object.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.families.vlambda.eigenfactor import Eigenfactors
from occontrol.families.vlambda.filter import EigenfactorFilter
from occontrol.families.vlambda.sampled_plant import SampledPlant
from occontrol.families.vlambda.sensor_choice import Choice, Chooser, Epoch


@dataclass(frozen=True, eq=False)
class OnlineStep:
    """What one step returns, in the user's units.

    Parameters
    ----------
    step : k
    mean, standard_deviations : (n,) of x(k) given the measurements up to k
    innovation : normalised innovation squared; NaN when nothing was measured
    dimension : how many values were used
    missing : names of the selected sensors that brought nothing
    next_step : k + 1, or None at the end of the horizon
    next_sensors : names of the sensors to use at next_step
    next_locations : where the movable ones of them should be
    """

    step: int
    mean: np.ndarray
    standard_deviations: np.ndarray
    innovation: float
    dimension: int
    missing: tuple[str, ...]
    next_step: int | None
    next_sensors: tuple[str, ...]
    next_locations: Mapping[str, np.ndarray]


class OnlineSelector:
    """The paper's loop: at the start of an epoch choose, at every step measure, then propagate.

    Parameters
    ----------
    plant : SampledPlant over the horizon
    starts : (E+1,) first step of every epoch, then the number of steps
    select : how many sensors at a time
    chooser : Chooser

    Attributes
    ----------
    choice : the Choice of the current epoch; `sensors` names its sensors
    choices : all of them so far
    filter : EigenfactorFilter, before the measurement of the current step
    posterior : Eigenfactors of P(k|k) of the last step that was done
    """

    def __init__(self, plant: SampledPlant, starts: np.ndarray, select: int, chooser: Chooser):
        self.plant, self.starts, self.select, self.chooser = plant, np.asarray(starts, dtype=int), select, chooser
        self.filter = EigenfactorFilter.start(plant.covariance, plant.mean)
        self.choices: list[Choice] = []
        self.posterior: Eigenfactors = self.filter.factors
        self._begin_epoch()

    @property
    def step_number(self) -> int:
        """The k that the next call of `step` is about."""
        return self.filter.step

    @property
    def finished(self) -> bool:
        """Whether the horizon is over."""
        return self.filter.step >= self.plant.steps

    @property
    def choice(self) -> Choice:
        """The choice that holds now."""
        return self.choices[-1]

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors to use now."""
        return tuple(self.plant.names[j] for j in self.choice.sensors)

    def _begin_epoch(self) -> None:
        index = len(self.choices)
        if index < len(self.starts) - 1 and self.filter.step == self.starts[index]:
            start, stop = int(self.starts[index]), int(self.starts[index + 1])
            epoch = Epoch(self.plant, index, start, stop, self.filter.factors, self.select)
            self.choices.append(self.chooser.choose(epoch))

    def matrices(self, sensor: int) -> tuple[np.ndarray, np.ndarray]:
        """H (m, n), in scaled states, and R (m, m) of a sensor at the current step, where it is now.

        Raises UsageError for a movable sensor that was not chosen, for it is nowhere.
        """
        k, where = self.filter.step, self.choice.locations.get(sensor)
        sampled = self.plant.sensors[sensor]
        if sampled.sensor.movable and where is None:
            raise UsageError(
                f"sensor '{sampled.sensor.name}' was not selected at k = {k}, so its location is not known"
            )
        H, R = sampled.matrices(k, k + 1, where)
        return H[0], R[0]

    def _arrived(
        self, pairs: dict[int, tuple[np.ndarray, np.ndarray]], measurements: Mapping[str, np.ndarray]
    ) -> tuple[dict[int, tuple[np.ndarray, np.ndarray]], np.ndarray | None]:
        """H and R of the values that are no NaN, by sensor, and these values, whitened."""
        kept, values = {}, []
        for j, (H, R) in pairs.items():
            name = self.plant.names[j]
            given = np.atleast_1d(np.asarray(measurements[name], dtype=float))
            if given.shape != (len(H),):
                raise UsageError(f"sensor '{name}' has {len(H)} values, {given.size} came at k = {self.filter.step}")
            if np.any(np.isinf(given)):
                raise UsageError(f"sensor '{name}' brings an infinite value at k = {self.filter.step}")
            there = np.flatnonzero(~np.isnan(given))
            if len(there):
                kept[j] = H[there], R[np.ix_(there, there)]
                values.append(np.linalg.solve(np.linalg.cholesky(kept[j][1]), given[there]))
        return kept, np.concatenate(values) if values else None

    def step(self, measurements: Mapping[str, np.ndarray] | None = None) -> OnlineStep:
        """Take the measurements of the current step in, go on to the next.

        Parameters
        ----------
        measurements : values (m,) by sensor name; a selected sensor that is left out counts as missing, and so does a
            single value that is NaN; another sensor's values are used too. None: every selected sensor measures,
            only the covariance is wanted.

        Returns OnlineStep. Raises UsageError after the end of the horizon or for a sensor that does not exist.
        """
        k = self.filter.step
        if self.finished:
            raise UsageError(f"the horizon of {self.plant.steps} steps is over")
        names = self.plant.names
        planned = list(self.choice.sensors)
        unknown = [name for name in measurements or {} if name not in names]
        if unknown:
            raise UsageError(f"there is no sensor '{unknown[0]}'\n  hint: there are: {', '.join(names)}")
        used = planned if measurements is None else [j for j, name in enumerate(names) if name in measurements]
        pairs, values = {j: self.matrices(j) for j in used}, None
        if measurements is not None:
            pairs, values = self._arrived(pairs, measurements)
        missing = tuple(names[j] for j in planned if j not in pairs)
        innovation, dimension = float("nan"), 0
        if pairs:
            rows = np.concatenate([np.linalg.solve(np.linalg.cholesky(R), H) for H, R in pairs.values()])
            innovation = self.filter.measure(rows, values)
            dimension = 0 if values is None else len(values)
        self.posterior, mean = self.filter.factors, self.filter.mean * self.plant.scales
        self.filter.propagate(self.plant.transition[k], self.plant.noise_root[k])
        self._begin_epoch()
        over = self.finished
        return OnlineStep(
            k,
            mean,
            self.posterior.standard_deviations * self.plant.scales,
            innovation,
            dimension,
            missing,
            None if over else k + 1,
            () if over else self.sensors,
            {} if over else {names[j]: place for j, place in self.choice.locations.items()},
        )
