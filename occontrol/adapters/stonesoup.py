"""Stone Soup flies a schedule, and takes the models of a problem: needs `pip install 'occontrol[stonesoup]'`.

Stone Soup's times are naive; those with an offset are compared in UTC. Sensors that the plan leaves out get no action,
and it is up to the caller that they do not measure.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta

import numpy as np

from occontrol.core.calendar import UNITS
from occontrol.core.errors import UsageError
from occontrol.core.plant import LinearPlant
from occontrol.core.schedule import INTEGER, Schedule
from occontrol.core.sensor import Sensor
from occontrol.numerics.transition import transitions

try:
    from stonesoup.base import Property  # type: ignore[import-not-found]
    from stonesoup.models.measurement.linear import LinearGaussian  # type: ignore[import-not-found]
    from stonesoup.models.transition.linear import (  # type: ignore[import-not-found]
        LinearGaussianTimeInvariantTransitionModel,
    )
    from stonesoup.sensormanager.base import SensorManager  # type: ignore[import-not-found]
except ImportError:
    raise UsageError("Stone Soup is not installed\n  hint: pip install 'occontrol[stonesoup]'") from None


class ScheduledSensorManager(SensorManager):
    """Gives the sensors that a schedule uses at a time their default action, and the others none."""

    schedule: Schedule = Property(doc="What to fly")  # type: ignore[assignment]
    start: datetime = Property(doc="The instant of t = 0")  # type: ignore[assignment]
    names: Mapping = Property(doc="{Stone Soup's sensor: its name in the schedule}")  # type: ignore[assignment]
    unit: str = Property(default="s", doc="What t counts: s, min, h or d")  # type: ignore[assignment]

    def time_of(self, timestamp: datetime) -> float:
        """t of an instant, in the unit of time.

        Parameters
        ----------
        timestamp : naive, or with an offset
        """
        return (_naive(timestamp) - _naive(self.start)) / timedelta(seconds=UNITS[self.unit])

    def in_use(self, timestamp: datetime) -> list[str]:
        """The names of the sensors that the schedule uses then; none outside its horizon.

        Parameters
        ----------
        timestamp : naive, or with an offset
        """
        edges, t = self.schedule.edges, self.time_of(timestamp)
        if not edges[0] <= t <= edges[-1]:
            return []
        k = min(int(np.searchsorted(edges, t, side="right")) - 1, len(edges) - 2)
        return [name for name, v in zip(self.schedule.names, self.schedule.weights[k], strict=True) if v > INTEGER]

    def choose_actions(self, timestamp: datetime, nchoose: int = 1, **kwargs: object) -> list[dict]:
        """One choice {sensor: its default actions} of the sensors in use at `timestamp`."""
        used = set(self.in_use(timestamp))
        sensors: set = self.sensors  # type: ignore[assignment]
        return [
            {
                each: [g.default_action for g in each.actions(timestamp)]
                for each in sensors
                if self.names.get(each) in used
            }
        ]


def _naive(instant: datetime) -> datetime:
    return instant if instant.tzinfo is None else instant.astimezone(UTC).replace(tzinfo=None)


def models(plant: LinearPlant, sensor: Sensor, step: float) -> tuple[object, object]:
    """Stone Soup's transition model over a step, and its measurement model of one average over that step.

    Parameters
    ----------
    plant : LinearPlant that does not vary with time
    sensor : of rate, whose noise is an intensity
    step : length of the step, in the unit of time

    Raises UsageError for what varies with time, and for a C that does more than pick states.
    """
    if not (plant.A.constant and plant.noise.constant and sensor.C.constant and sensor.noise.constant):
        raise UsageError("Stone Soup's models here do not vary with time, and this plant or sensor does")
    F, Q = (part[0] for part in transitions(plant.A, plant.noise, np.zeros(1), np.full(1, float(step))))
    C, n = sensor.C.at(0.0), plant.states
    transition = LinearGaussianTimeInvariantTransitionModel(transition_matrix=F, covariance_matrix=Q)
    picked = [int(np.flatnonzero(row)[0]) for row in C if np.count_nonzero(row) == 1 and np.sum(row) == 1]
    if len(picked) < len(C):
        raise UsageError("a measurement model of Stone Soup picks states; this C does more")
    return transition, LinearGaussian(ndim_state=n, mapping=picked, noise_covar=sensor.noise.at(0.0) / step)
