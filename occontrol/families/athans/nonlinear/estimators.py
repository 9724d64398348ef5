"""Extended and unscented Kalman filters on roots: the covariance is P = S S', S a lower triangle.

    prediction   EKF  [F S, Q^1/2]           UKF  [(f(s_i) - mean)/sqrt(2n), Q^1/2]          made a triangle gives S+
    reading      EKF  [H S, R^1/2; S, 0]    UKF  [(h(s_i) - mean)/sqrt(2n), R^1/2; (s_i - x)/sqrt(2n), 0]

made a triangle gives [D, 0; X, S+] with D D' the innovation's covariance and X D^-1 the gain. Sigma points are
x +- sqrt(n) S_i with equal weights. The iterated EKF relinearises h at the estimate until that stands still.
Differences of angles are taken between -pi and pi.
Sources: Kailath, Sayed & Hassibi (2000), section 12.3; Bell & Cathey (1993) for the iterated update; Julier & Uhlmann
(2004), kappa = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from occontrol.families.athans.nonlinear.readout import Readout
from occontrol.families.athans.nonlinear.wrap import wrapped
from occontrol.numerics.flow import Flow
from occontrol.numerics.linalg import square_root, symmetrise
from occontrol.numerics.square_root_filter import gain_of, triangularise, whitened

MOST_ITERATIONS = 30
SETTLED = 1e-12  # of a standard deviation


@dataclass(frozen=True, eq=False)
class Joint:
    """A state and what is read of it, before the reading: means and one root of their joint covariance.

    Parameters
    ----------
    mean : (n,) of the state, in state units
    expected : (m,) of the reading, in measurement units
    array : (m + n, s) rows of the reading first; array @ array' is their covariance
    """

    mean: np.ndarray
    expected: np.ndarray
    array: np.ndarray

    def judged(self, error: np.ndarray, which: np.ndarray) -> float:
        """The normalised square of the values `which` of an innovation `error` (m,), by themselves."""
        array = np.ascontiguousarray(self.array[which])
        triangularise(array, len(which))
        return float(np.sum(whitened(np.ascontiguousarray(array[:, : len(which)]), error[which]) ** 2))

    def taken(self, error: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Mean, root and NIS after the values `which` of an innovation `error` (m,)."""
        m, n = len(which), len(self.mean)
        array = np.ascontiguousarray(np.vstack([self.array[which], self.array[len(self.expected) :]]))
        array = np.hstack([array, np.zeros((m + n, max(0, m + n - array.shape[1])))])
        triangularise(array, m + n)
        root = np.ascontiguousarray(array[m:, m : m + n])
        if not m:
            return self.mean, root, np.nan
        D, X = np.ascontiguousarray(array[:m, :m]), np.ascontiguousarray(array[m:, :m])
        white = whitened(D, error[which])
        return self.mean + gain_of(X, D) @ error[which], root, float(white @ white)


def triangle(array: np.ndarray) -> np.ndarray:
    """(r, r) lower triangle with the same square as `array` (r, s)."""
    r = len(array)
    array = np.ascontiguousarray(np.hstack([array, np.zeros((r, max(0, r - array.shape[1])))]))
    triangularise(array, r)
    return np.ascontiguousarray(array[:, :r])


@dataclass(frozen=True, eq=False)
class Extended:
    """The extended Kalman filter.

    Parameters
    ----------
    iterated : whether the reading is linearised anew at the estimate until that stands still
    """

    iterated: bool = False

    def predicted(self, flow: Flow, mean: np.ndarray, root: np.ndarray, span: tuple[float, float, int]):
        """Mean and root after a span (beginning, length, substeps) from `mean` (n,) and `root` (n, n)."""
        if span[1] == 0:
            return mean, root
        mean, F, Q = flow.across(mean, *span)
        return mean, triangle(np.hstack([F @ root, square_root(Q, floor=0.0)]))

    def reading(self, readout: Readout, mean: np.ndarray, root: np.ndarray, time: float) -> Joint:
        """A state `mean` (n,) with `root` (n, n) and the reading that it lets one expect at a `time`."""
        H, R = readout.slope(mean, time), readout.covariance(mean, time)
        m, n = H.shape
        array = np.block([[H @ root, square_root(R, floor=0.0)], [root, np.zeros((n, m))]])
        return Joint(mean, readout.values(mean[None], time)[0], array)

    def averaged(self, readout: Readout, mean: np.ndarray, root: np.ndarray, span: tuple[float, float, int]) -> Joint:
        """State and average over a span, both at its end, from `mean` (n,) and `root` (n, n) at its beginning."""
        n, m, h = len(mean), readout.rows, span[1]
        end, F, Q = readout.integrated.across(np.append(mean, np.zeros(m)), *span)
        scale = np.append(np.ones(n), np.full(m, 1 / h))
        F, Q = (scale[:, None] * F)[:, :n], scale[:, None] * Q * scale
        Q[n:, n:] += readout.covariance(end[:n], span[0] + h)
        order = np.append(np.arange(n, n + m), np.arange(n))
        array = np.hstack([F @ root, square_root(symmetrise(Q), floor=0.0)])[order]
        return Joint(end[:n], end[n:] / h, array)

    def after(self, readout: Readout, joint: Joint, z: np.ndarray, which: np.ndarray, root: np.ndarray, time: float):
        """Mean, root and NIS after the values `which` of a reading `z` (m,); `root` (n, n) is the one before."""
        error = wrapped(z - joint.expected, readout.angles)
        mean, after, nis = joint.taken(error, which)
        if not self.iterated or not len(which):
            return mean, after, nis
        deviation = np.sqrt(np.maximum(np.sum(root**2, axis=1), 1e-300))
        for _ in range(MOST_ITERATIONS):
            H, R = readout.slope(mean, time), readout.covariance(mean, time)
            m, n = H.shape
            array = np.block([[H @ root, square_root(R, floor=0.0)], [root, np.zeros((n, m))]])
            here = readout.values(mean[None], time)[0]
            again = wrapped(z - here, readout.angles) - H @ (joint.mean - mean)
            last = mean
            mean, after, _ = Joint(joint.mean, here, array).taken(again, which)
            if np.all(np.abs(mean - last) <= SETTLED * deviation):
                break
        return mean, after, nis


@dataclass(frozen=True, eq=False)
class Unscented:
    """The unscented Kalman filter, 2 n sigma points."""

    def predicted(self, flow: Flow, mean: np.ndarray, root: np.ndarray, span: tuple[float, float, int]):
        """Mean and root after a span (beginning, length, substeps) from `mean` (n,) and `root` (n, n)."""
        if span[1] == 0:
            return mean, root
        points = flow.advance(_points(mean, root), *span)
        noise = flow.across(mean, *span)[2]
        mean = np.mean(points, axis=1)
        spread = (points - mean[:, None]) / np.sqrt(points.shape[1])
        return mean, triangle(np.hstack([spread, square_root(noise, floor=0.0)]))

    def reading(self, readout: Readout, mean: np.ndarray, root: np.ndarray, time: float) -> Joint:
        """A state `mean` (n,) with `root` (n, n) and the reading that it lets one expect at a `time`."""
        points = _points(mean, root)
        here = readout.values(mean[None], time)[0]
        off = wrapped(readout.values(points.T, time) - here, readout.angles).T
        centre = np.mean(off, axis=1)
        R = square_root(readout.covariance(mean, time), floor=0.0)
        scale = 1 / np.sqrt(points.shape[1])
        above = np.hstack([(off - centre[:, None]) * scale, R])
        below = np.hstack([(points - mean[:, None]) * scale, np.zeros((len(mean), len(R)))])
        return Joint(mean, here + centre, np.vstack([above, below]))

    def averaged(self, readout: Readout, mean: np.ndarray, root: np.ndarray, span: tuple[float, float, int]) -> Joint:
        """State and average over a span, both at its end, from `mean` (n,) and `root` (n, n) at its beginning."""
        n, m, h = len(mean), readout.rows, span[1]
        points = _points(mean, root)
        ends = readout.integrated.advance(np.vstack([points, np.zeros((m, points.shape[1]))]), *span)
        start = np.append(mean, np.zeros(m))
        noise = readout.integrated.across(start, *span)[2]
        scale = np.append(np.ones(n), np.full(m, 1 / h))
        ends, noise = scale[:, None] * ends, scale[:, None] * noise * scale
        centre = np.mean(ends, axis=1)
        noise[n:, n:] += readout.covariance(centre[:n], span[0] + h)
        order = np.append(np.arange(n, n + m), np.arange(n))
        spread = (ends - centre[:, None]) / np.sqrt(points.shape[1])
        return Joint(centre[:n], centre[n:], np.hstack([spread, square_root(symmetrise(noise), floor=0.0)])[order])

    def after(self, readout: Readout, joint: Joint, z: np.ndarray, which: np.ndarray, root: np.ndarray, time: float):
        """Mean, root and NIS after the values `which` of a reading `z` (m,); `root` (n, n) is the one before."""
        return joint.taken(wrapped(z - joint.expected, readout.angles), which)


def _points(mean: np.ndarray, root: np.ndarray) -> np.ndarray:
    """(n, 2 n) sigma points."""
    wide = np.sqrt(len(mean)) * root
    return np.hstack([mean[:, None] + wide, mean[:, None] - wide])


def estimator_named(name: str) -> Extended | Unscented:
    """The estimator of a name: "ekf", "iterated" or "ukf"."""
    return Unscented() if name == "ukf" else Extended(iterated=name == "iterated")
