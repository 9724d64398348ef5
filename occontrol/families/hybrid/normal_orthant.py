"""Probability that every entry of a Gaussian vector is negative, singular covariances included.

Unknowns: y = mean + L z with z standard normal of dimension rank(covariance) and L in row-echelon form, so that row
i of y <= 0 bounds the z of its last column, given the earlier ones. Rank 1 is closed, rank 2 a one-dimensional adaptive
quadrature, from rank 3 on the product form of Genz (J. Comp. Graph. Stat. 1, 1992, 141-149) is averaged over shifted
lattices.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_FAR = 38.0
_SMOOTH = 1e-13
_MOST_PANELS = 2000
_SHIFTS = 8
_STUDENT = 5.0  # standard errors of eight shifts that hold 99.8 % of Student's distribution; three hold 98 %
_LATTICE_FIRST = 128
_LATTICE_LAST = 1 << 15
_ROOTS = np.sqrt(
    np.array([2.0, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89, 97])
)
MAX_ROWS = len(_ROOTS) + 1


@njit(cache=True, error_model="numpy")
def normal_cdf(x: float) -> float:
    """Standard normal distribution function, with full relative accuracy in the lower tail.

    Parameters
    ----------
    x : any number, infinities included
    """
    return 0.5 * math.erfc(-x * 0.7071067811865476)


@njit(cache=True, error_model="numpy")
def normal_quantile(probability: float) -> float:
    """Inverse of `normal_cdf`: a rational start (P. J. Acklam) and one Halley step on the complementary error function.

    Parameters
    ----------
    probability : in [0, 1]; 0 and 1 give values beyond +-37
    """
    p = min(max(probability, 1e-300), 1.0 - 1e-16)
    if p < 0.02425 or p > 0.97575:
        q = math.sqrt(-2.0 * math.log(p if p < 0.5 else 1.0 - p))
        top = ((((-7.784894002430293e-3 * q - 0.3223964580411365) * q - 2.400758277161838) * q - 2.549732539343734) * q
               + 4.374664141464968) * q + 2.938163982698783  # fmt: skip
        low = (
            ((7.784695709041462e-3 * q + 0.3224671290700398) * q + 2.445134137142996) * q + 3.754408661907416
        ) * q + 1
        x = top / low if p < 0.5 else -top / low
    else:
        q = p - 0.5
        r = q * q
        top = ((((-39.69683028665376 * r + 220.9460984245205) * r - 275.9285104469687) * r + 138.357751867269) * r
               - 30.66479806614716) * r + 2.506628277459239  # fmt: skip
        low = ((((-54.47609879822406 * r + 161.5858368580409) * r - 155.6989798598866) * r + 66.80131188771972) * r
               - 13.28068155288572) * r + 1  # fmt: skip
        x = q * top / low
    slope = (normal_cdf(x) - p) * 2.5066282746310002 * math.exp(min(0.5 * x * x, 700.0))
    return x - slope / (1.0 + 0.5 * x * slope)


@njit(cache=True, error_model="numpy")
def _between(low: float, high: float) -> float:
    if high <= low:
        return 0.0
    return normal_cdf(-low) - normal_cdf(-high) if low > 0 else normal_cdf(high) - normal_cdf(low)


@njit(cache=True, error_model="numpy")
def _echelon(mean, covariance):
    """(threshold, L, last column of each row, rank, error) with y <= 0 where L z <= threshold; rank -1: nowhere."""
    size = len(mean)
    kept = 0
    scaled, chosen = np.empty(size), np.empty(size, np.int64)
    for i in range(size):
        if covariance[i, i] > 0.0:
            scaled[kept] = -mean[i] / math.sqrt(covariance[i, i])
            chosen[kept] = i
            kept += 1
        elif mean[i] > 0.0:
            return scaled[:0], np.zeros((0, 0)), chosen[:0], -1, 0.0
    factor, last = np.zeros((kept, kept)), np.zeros(kept, np.int64)
    owner = np.empty(kept, np.int64)
    rank, error = 0, 0.0
    for i in range(kept):
        remaining = 1.0
        for c in range(rank):
            j = owner[c]
            total = covariance[chosen[i], chosen[j]] / math.sqrt(
                covariance[chosen[i], chosen[i]] * covariance[chosen[j], chosen[j]]
            )
            for k in range(c):
                total -= factor[i, k] * factor[j, k]
            factor[i, c] = total / factor[j, c]
            remaining -= factor[i, c] ** 2
        # what rounding leaves of a dependent row must not become a dimension of its own
        if remaining > (1e-15 if i < 2 else 1e-13):
            factor[i, rank] = math.sqrt(remaining)
            last[i] = rank
            owner[rank] = i
            rank += 1
            continue
        error += 0.16 * math.sqrt(max(remaining, 0.0))
        for c in range(rank):
            if abs(factor[i, c]) > 1e-7:
                last[i] = c
    return scaled[:kept], factor, last, rank, error


@njit(cache=True, error_model="numpy")
def _limits(column, z, threshold, factor, last):
    low, high = -np.inf, np.inf
    for i in range(len(threshold)):
        if last[i] == column:
            total = threshold[i]
            for c in range(column):
                total -= factor[i, c] * z[c]
            total /= factor[i, column]
            if factor[i, column] > 0:
                high = min(high, total)
            else:
                low = max(low, total)
    return low, high


@njit(cache=True, error_model="numpy")
def _panel(left, right, z, threshold, factor, last):
    total = 0.0
    for i in range(len(_NODES)):
        z[0] = 0.5 * (left + right) + 0.5 * (right - left) * _NODES[i]
        low, high = _limits(1, z, threshold, factor, last)
        total += _WEIGHTS[i] * math.exp(-0.5 * z[0] * z[0]) * _between(low, high)
    return total * 0.5 * (right - left) * 0.3989422804014327


@njit(cache=True, error_model="numpy")
def _plane(threshold, factor, last):
    """Rank 2: integrate the inner interval's probability over the first coordinate, broken around its steps."""
    z = np.zeros(2)
    start, end = _limits(0, z, threshold, factor, last)
    start, end = max(start, -_FAR), min(end, _FAR)
    if end <= start:
        return 0.0, 0.0
    breaks = np.empty(3 * len(threshold) + 7)
    breaks[:7] = np.array([start, -9.0, -3.0, 0.0, 3.0, 9.0, end])
    count = 7
    for i in range(len(threshold)):
        if last[i] == 1 and abs(factor[i, 0]) > 1e-12:
            centre, width = threshold[i] / factor[i, 0], 8.0 * abs(factor[i, 1] / factor[i, 0])
            breaks[count], breaks[count + 1], breaks[count + 2] = centre - width, centre, centre + width
            count += 3
    breaks = np.sort(np.clip(breaks[:count], start, end))
    total, error, panels = 0.0, 0.0, 0
    left, right, value = np.empty(64), np.empty(64), np.empty(64)
    for piece in range(count - 1):
        if breaks[piece + 1] <= breaks[piece]:
            continue
        left[0], right[0] = breaks[piece], breaks[piece + 1]
        value[0] = _panel(left[0], right[0], z, threshold, factor, last)
        depth = 1
        while depth:
            depth -= 1
            a, b, coarse = left[depth], right[depth], value[depth]
            middle = 0.5 * (a + b)
            first = _panel(a, middle, z, threshold, factor, last)
            second = _panel(middle, b, z, threshold, factor, last)
            off = abs(first + second - coarse)
            panels += 1
            # what rounding leaves must not be refined for ever
            if off < _SMOOTH or depth > 60 or panels > _MOST_PANELS:
                total += first + second
                error += off
                continue
            left[depth], right[depth], value[depth] = a, middle, first
            left[depth + 1], right[depth + 1], value[depth + 1] = middle, b, second
            depth += 2
    return total, error


@njit(cache=True, error_model="numpy")
def _lattice(threshold, factor, last, rank, tolerance):
    """Rank 3 and more: shifted Richtmyer lattices, doubled until three standard errors are below the tolerance."""
    z, shift = np.zeros(rank), np.empty(rank)
    points = _LATTICE_FIRST
    while True:
        values = np.empty(_SHIFTS)
        state = np.uint64(88172645463325252)
        for s in range(_SHIFTS):
            for c in range(rank):
                state ^= state << np.uint64(13)
                state ^= state >> np.uint64(7)
                state ^= state << np.uint64(17)
                shift[c] = (state >> np.uint64(11)) * (1.0 / 9007199254740992.0)
            total = 0.0
            for k in range(points):
                product = 1.0
                for c in range(rank):
                    low, high = _limits(c, z, threshold, factor, last)
                    inside = _between(low, high)
                    product *= inside
                    if product == 0.0:
                        break
                    if c < rank - 1:
                        u = ((k + 1) * _ROOTS[c] + shift[c]) % 1.0
                        u = abs(2.0 * u - 1.0)
                        if low > 0:
                            z[c] = -normal_quantile(normal_cdf(-low) - u * inside)
                        else:
                            z[c] = normal_quantile(normal_cdf(low) + u * inside)
                total += product
            values[s] = total / points
        average = np.mean(values)
        deviation = math.sqrt(np.sum((values - average) ** 2) / (_SHIFTS * (_SHIFTS - 1)))
        if 3.0 * deviation < tolerance or points >= _LATTICE_LAST:
            return average, _STUDENT * deviation
        points *= 2


@njit(cache=True, error_model="numpy")
def orthant_probability(mean: np.ndarray, covariance: np.ndarray, tolerance: float) -> tuple[float, float]:
    """Probability that y <= 0 in every row, for a Gaussian y.

    Phi_v(mean, covariance) = Pr{y <= 0}

    Parameters
    ----------
    mean : (v,)
    covariance : (v, v) symmetric positive semidefinite, singular ones included; a row without variance is a plain
        yes or no
    tolerance : wanted error from rank 3 on; the quadratures below that are accurate to 1e-8 or better whatever it is

    Returns
    -------
    probability, error: an estimate of the error (five standard errors from rank 3 on).

    Liu & Hwang, step 1, the v-dimensional Gaussian distribution function.
    """
    threshold, factor, last, rank, error = _echelon(mean, covariance)
    if rank < 0:
        return 0.0, 0.0
    if rank == 0:
        return 1.0, 0.0
    if rank == 1:
        low, high = _limits(0, threshold, threshold, factor, last)
        return _between(low, high), error
    if rank == 2:
        value, off = _plane(threshold, factor, last)
    else:
        value, off = _lattice(threshold, factor, last, rank, tolerance)
    return min(max(value, 0.0), 1.0), error + off  # type: ignore[return-value]
