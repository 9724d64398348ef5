"""Selection and estimation on-line: measurements of one step in, estimate and the sensors to use next out.

This is what a loop on a target calls. Chooser, criterion and estimator are apart: the chooser is any object with
`choose(Epoch) -> Choice`, the estimator is the V-Lambda filter. Covariance runs without data use the same object.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from occontrol.core.errors import UsageError, suggest
from occontrol.core.measurement import Step
from occontrol.families.vlambda.eigenfactor import Eigenfactors
from occontrol.families.vlambda.filter import EigenfactorFilter
from occontrol.families.vlambda.sampled_plant import SampledPlant
from occontrol.families.vlambda.sensor_choice import Choice, Chooser, Epoch
from occontrol.numerics.linalg import whiten


@dataclass(frozen=True, eq=False, kw_only=True)
class OnlineStep(Step):
    """What one step returns, in the user's units: x(k) given the measurements up to k = `time`.

    Parameters
    ----------
    missing : names of the selected sensors that brought nothing
    next_step : k + 1, the step of `next_sensors`; None at the end of the horizon
    next_locations : where the movable ones of `next_sensors` should be
    """

    missing: tuple[str, ...]
    next_step: int | None
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
    filter : EigenfactorFilter, before the measurement of the current step; it replaces its arrays, it changes none
    """

    def __init__(self, plant: SampledPlant, starts: np.ndarray, select: int, chooser: Chooser):
        self.plant, self.starts, self.select, self.chooser = plant, np.asarray(starts, dtype=int), select, chooser
        self.filter = EigenfactorFilter.start(plant.covariance, plant.mean)
        self.choices: list[Choice] = []
        self._after = copy.copy(self.filter)  # as it was after the last measurement
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
    def posterior(self) -> Eigenfactors:
        """Eigenfactors of P(k|k) of the last step that was done, in scaled states; decomposed when asked for."""
        return self._after.factors

    @property
    def choice(self) -> Choice:
        """The choice that holds now."""
        return self.choices[-1]

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors to use now."""
        return tuple(self.plant.names[j] for j in self.choice.sensors)

    @property
    def next_sensors(self) -> tuple[str, ...]:
        """The same; () at the end of the horizon."""
        return () if self.finished else self.sensors

    @property
    def times_left(self) -> np.ndarray:
        """The steps k that are still to come."""
        return np.arange(self.filter.step, self.plant.steps, dtype=float)

    def _begin_epoch(self) -> None:
        index = len(self.choices)
        if index < len(self.starts) - 1 and self.filter.step == self.starts[index]:
            start, stop = int(self.starts[index]), int(self.starts[index + 1])
            epoch = Epoch(self.plant, index, start, stop, self.filter.factors, self.select)
            self.choices.append(self.chooser.choose(epoch))

    def matrices(self, sensor: int) -> tuple[np.ndarray, np.ndarray]:
        """H (m, n), in scaled states, and R (m, m) of a sensor at the current step, where it is now.

        Raises UsageError for a movable sensor that was not chosen, because it has no place.
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
                values += whiten(kept[j][1], given[there])
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
            raise UsageError(f"there is no sensor '{unknown[0]}'\n  hint: {suggest(unknown[0], names)}")
        used = planned if measurements is None else [j for j, name in enumerate(names) if name in measurements]
        pairs, values = {j: self.matrices(j) for j in used}, None
        if measurements is not None:
            pairs, values = self._arrived(pairs, measurements)
        missing = tuple(names[j] for j in planned if j not in pairs)
        innovation, dimension = float("nan"), 0
        if pairs:
            rows = np.concatenate([whiten(R, H)[0] for H, R in pairs.values()])
            innovation = self.filter.measure(rows, values)
            dimension = 0 if values is None else len(values)
        self._after = copy.copy(self.filter)
        root = self._after.covariance_root * self.plant.scales[:, None]
        self.filter.propagate(self.plant.transition[k], self.plant.noise_root[k])
        self._begin_epoch()
        over = self.finished
        return OnlineStep(
            time=float(k),
            estimate=self._after.mean * self.plant.scales,
            covariance=root @ root.T,
            nis=innovation,
            dimension=dimension,
            next_sensors=() if over else self.sensors,
            missing=missing,
            next_step=None if over else k + 1,
            next_locations={} if over else {names[j]: place for j, place in self.choice.locations.items()},
        )
