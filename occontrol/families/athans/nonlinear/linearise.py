"""A nonlinear plant and its sensors become linear ones along the nominal path: what the rest of the family plans with.

    A(t) = df/dx,  C_j(t) = dh_j/dx,  Xi(t), Theta_j(t)  at x(t);   from reading to reading F and Q of numerics/flow.py

Where a sensor is not visible along the path it has no window. Everything that follows (recursion, bound, rules) is of
this linear problem; its certificate is no statement about the nonlinear plant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import cast

import numpy as np

from occontrol.core.errors import Collector
from occontrol.core.plant import DiscretePlant, LinearPlant
from occontrol.core.sensor import Sensor
from occontrol.core.signal import Signal
from occontrol.families.athans.nonlinear.nominal import IntegratorOptions, Nominal, make_nominal
from occontrol.families.athans.nonlinear.path import along, common, evaluate, runs_above_zero, times_above_zero
from occontrol.families.athans.nonlinear.plant import FormulaPlant
from occontrol.families.athans.nonlinear.sensor import FormulaSensor
from occontrol.families.athans.readings.known_gaps import KnownGaps

LOOKED_AT = 513  # times between which visibility is followed, at least
RESOLUTION = 1e-9  # of the horizon: how exactly a rise or a set is found


@dataclass(frozen=True)
class Replanning:
    """How a loop plans anew on the way.

    Parameters
    ----------
    every : readings between two plans
    horizon : readings that a plan looks ahead; None is to the end
    gap : relative gap of a plan's relaxation
    estimator : "ekf", "iterated" (an EKF whose update is iterated) or "ukf"
    deadline : seconds that a plan may take, or None

    Raises ProblemError for numbers that make no sense.
    """

    every: int = 1
    horizon: int | None = None
    gap: float = 1e-3
    estimator: str = "ekf"
    deadline: float | None = None

    def __post_init__(self) -> None:
        found = Collector()
        for name in ("every", "horizon"):
            value = getattr(self, name)
            if value is not None and value < 1:
                found.add((name,), f"replan.{name} is {value}", "a whole number from 1 on")
        for name in ("gap", "deadline"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                found.add((name,), f"replan.{name} is {value:g}", "a number above 0")
        if self.estimator not in ESTIMATORS:
            found.add(("estimator",), f"replan.estimator is '{self.estimator}'", f"one of: {', '.join(ESTIMATORS)}")
        found.raise_if_any()

    def as_dict(self) -> Mapping[str, object]:
        """What differs from the defaults, for a problem file."""
        return {key: value for key, value in vars(self).items() if value is not None}


ESTIMATORS = ("ekf", "iterated", "ukf")


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Where a linear problem comes from.

    Parameters
    ----------
    plant : FormulaPlant
    sensors : FormulaSensor by name, as stated; 'idle' is not among them
    nominal : Nominal
    integrator : IntegratorOptions, as stated
    replan : Replanning, as stated, or None
    """

    plant: FormulaPlant
    sensors: Mapping[str, FormulaSensor]
    nominal: Nominal
    integrator: IntegratorOptions
    replan: Replanning | None = None

    @property
    def estimator(self) -> str:
        """The filter that belongs to the problem."""
        return "ekf" if self.replan is None else self.replan.estimator

    @property
    def hides(self) -> bool:
        """Whether some sensor cannot always be seen."""
        return any(s.visible is not None for s in self.sensors.values())


@dataclass(frozen=True, eq=False)
class LinearisedPlant(LinearPlant):
    """A continuous plant along the nominal path; x is the state itself, its mean the initial one.

    Parameters
    ----------
    linearised : Linearisation
    gaps : the maps between readings, where readings are taken at instants
    """

    linearised: Linearisation | None = None
    gaps: KnownGaps | None = field(default=None, repr=False)


@dataclass(frozen=True, eq=False)
class LinearisedSteps(DiscretePlant):
    """A plant in discrete time along the nominal path.

    Parameters
    ----------
    linearised : Linearisation
    """

    linearised: Linearisation | None = None


def linearise(
    plant: FormulaPlant,
    sensors: Sequence[FormulaSensor],
    origin: float,
    since: np.ndarray,
    looked: np.ndarray,
    integrator: IntegratorOptions | None = None,
    replan: Replanning | None = None,
    readings: bool = True,
) -> tuple[LinearPlant | DiscretePlant, dict[str, Sensor]]:
    """The linear plant and sensors along the nominal path.

    Parameters
    ----------
    plant : FormulaPlant with n states
    sensors : of it
    origin : a time
    since : (G+1,) times of the spans, counted from `origin`: start, readings (or edges), end, prediction
    looked : (K,) the times of readings; of continuous sensing start and end
    integrator, replan : as stated
    readings : whether sensors are read at instants

    Raises ProblemError where path, Jacobians or noise are not finite, and for a sensor that never sees the path.
    """
    integrator = integrator or IntegratorOptions()
    nominal = make_nominal(plant, origin, since, integrator)
    origin_of = Linearisation(plant, {s.name: s for s in sensors}, nominal, integrator, replan)
    found, n, path = Collector(), len(plant.names), nominal.path
    linear: dict[str, Sensor] = {}
    for j, sensor in enumerate(sensors):
        C, noise = along(sensor.slope(), path, n), along(sensor.covariance(), path, n)
        values = {"h": along(sensor.values(), path, n), "derivative of h": C, "noise": noise}
        windows = _windows(sensor, nominal, looked, readings)
        if windows is not None and not windows:
            what = f"sensor '{sensor.name}' never sees the nominal path: visible is not above 0 inside its windows"
            found.add(("sensors", j, "visible"), what, "another start or horizon, or leave the sensor out")
            continue
        asked = looked if readings else np.linspace(looked[0], looked[-1], LOOKED_AT)
        times = _inside(asked, windows)
        for word, signal in values.items():
            bad = ~np.all(np.isfinite(signal.sample(times)), axis=(1, 2))
            if np.any(bad):
                when = f"{plant.variable} = {times[int(np.argmax(bad))]:.6g}"
                key = "noise" if word == "noise" else "h"
                what = f"{word} of sensor '{sensor.name}' is not finite at {when} of the nominal path"
                found.add(("sensors", j, key), what, "a pole of the formula: keep it out by 'visible' or by windows")
                break
        else:
            C, noise = _held(C, windows), _held(noise, windows)
            with found.under("sensors", j):
                linear[sensor.name] = Sensor(sensor.name, C, noise, sensor.cost, windows, plant.variable)
    found.raise_if_any()
    labels = {"names": plant.names, "units": tuple(plant.units)}
    mean, S0 = plant.whole_mean, plant.whole_covariance
    if plant.discrete:
        F, Q = along(plant.flow.slope, path, n), along(plant.flow.noise, path, n)
        return LinearisedSteps(F=F, Q=Q, covariance=S0, mean=mean, linearised=origin_of, **labels), linear
    A, Xi = along(plant.flow.slope, path, n), along(plant.flow.noise, path, n)
    gaps = _gaps(nominal, len(looked)) if readings else None
    return LinearisedPlant(A=A, noise=Xi, covariance=S0, mean=mean, linearised=origin_of, gaps=gaps, **labels), linear


def _gaps(nominal: Nominal, readings: int) -> KnownGaps:
    """The maps between so many readings."""
    spans, count = nominal.spans, readings + 1
    F, Q = np.eye(len(nominal.plant.names)), np.zeros_like(nominal.spans.noise[0])
    for step, noise in zip(spans.transition[count:], spans.noise[count:], strict=True):
        F, Q = step @ F, step @ Q @ step.T + noise
    until = partial(nominal.charges, spans=count)
    return KnownGaps(spans.transition[:count], spans.noise[:count], (F, Q), until)


def linearisation_of(problem: object) -> Linearisation | None:
    """Where a problem's plant was linearised; None for a linear one."""
    return cast("Linearisation | None", getattr(getattr(problem, "plant", None), "linearised", None))


def _windows(
    sensor: FormulaSensor, nominal: Nominal, looked: np.ndarray, readings: bool
) -> Sequence[tuple[float, float]] | None:
    """The stated windows as far as the sensor sees the path; None is always, an empty list never."""
    stated = None if sensor.windows is None else [(float(a), float(b)) for a, b in sensor.windows]
    seen = sensor.seen()
    if seen is None:
        return stated
    if nominal.plant.discrete:
        values = evaluate(seen, nominal.path.at(looked), looked)[:, 0, 0]
        open_ = [(float(looked[a]), float(looked[b])) for a, b in runs_above_zero(values)]
        if len(open_) == 1 and open_[0] == (looked[0], looked[-1]):
            return stated
    else:
        start, end = float(looked[0]), float(looked[-1])
        times = np.union1d(looked, np.linspace(start, end, LOOKED_AT))
        inner = nominal.spans.times.ravel()
        times = np.union1d(times, inner[(inner > start) & (inner < end)])
        open_ = times_above_zero(seen, nominal.path, times, RESOLUTION * max(end - start, 1e-300))
        if len(open_) == 1 and open_[0] == (start, end):
            return stated
        # a reading at the very end of a stretch stays inside; nothing is read at a point that lasts no time
        slack = 1e-7 * max(end - start, 1.0)
        open_ = [(a, b) if b > a else (a - slack, b + slack) for a, b in open_] if readings else open_
    cut = common(stated, open_) if stated is not None else open_
    return [w for w in cut if w[1] > w[0] or nominal.plant.discrete]


def _inside(times: np.ndarray, windows: Sequence[tuple[float, float]] | None) -> np.ndarray:
    if windows is None:
        return times
    return times[np.any([(a <= times) & (times <= b) for a, b in windows], axis=0)]


def _held(signal: Signal, windows: Sequence[tuple[float, float]] | None) -> Signal:
    """Outside the windows the values of the nearest time inside: a formula may have a pole where nobody looks."""
    if windows is None or signal.constant:
        return signal
    return _Windowed(signal, windows)


@dataclass(frozen=True, eq=False)
class _Windowed(Signal):
    """A signal that is asked inside its windows only."""

    inner: Signal
    windows: Sequence[tuple[float, float]]

    @property
    def shape(self) -> tuple[int, int]:  # type: ignore[override]
        return self.inner.shape

    def sample(self, times: np.ndarray) -> np.ndarray:
        times = np.asarray(times, dtype=float)
        choices = np.array([np.clip(times, a, b) for a, b in self.windows])
        nearest = np.argmin(np.abs(choices - times), axis=0)
        return self.inner.sample(choices[nearest, np.arange(len(times))])

    def document(self):
        return self.inner.document()
