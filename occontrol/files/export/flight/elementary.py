"""Elementary functions of +, -, *, / and comparisons alone, so that every processor finds the same bits.

The same operations in the same order as templates/b_elementary.c. Arguments are reduced to a small interval, where a
Taylor series ends below the last place; results are a few last places from the true value.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from functools import cached_property

import numpy as np

PI = Fraction(3141592653589793238462643383279502884197169399375105820974944592307816406286, 10**75)
LN2 = Fraction(693147180559945309417232121458176568075500134360255254120680009493393621969, 10**75)


def parts_of(value: Fraction, bits: int, count: int) -> list[float]:
    """So many numbers (`count`) of so many `bits` each that add up to `value`, below 2, the last one rounded."""
    found, unit = [], Fraction(1)
    for _ in range(count - 1):
        part = Fraction(math.floor(value / unit * 2**bits)) * unit / 2**bits
        found.append(float(part))
        value, unit = value - part, unit / 2**bits
    return [*found, float(value)]


class Elementary:
    """The functions for numbers of one type; each takes and returns scalars of it.

    Parameters
    ----------
    dtype : "f8" or "f4"
    quick : Python's own numbers, which are double and raise ZeroDivisionError where NumPy's become infinite
    """

    def __init__(self, dtype: str, quick: bool = False):
        self.type: Callable[[float], float] = float if quick else np.dtype(dtype).type
        self.double = dtype == "f8"
        self.largest = self.type(np.finfo(dtype).max)
        self.half_pi, self.pi, self.ln2 = (self.type(value) for value in (math.pi / 2, math.pi, math.log(2)))
        self.most = self.type(800 if self.double else 110)
        self.whole = self.type(2.0**52 if self.double else 2.0**23)  # from here on every number is whole

    @cached_property
    def constants(self) -> dict[str, list]:
        """{name: numbers} of what the functions read, as the C text has them."""
        few, f = not self.double, math.factorial
        area = range(3, 11 if few else 23, 2)
        steps = [64, 64, 32, 16, 8, 4, 2, 1] if few else [512, 512, 256, 128, 64, 32, 16, 8, 4, 2, 1]
        found: dict[str, list[float]] = {
            "half_pi": parts_of(PI / 2, 9 if few else 33, 4),
            "sine": [(-1) ** (k // 2) / f(k) for k in range(3, 11 if few else 19, 2)],
            "cosine": [(-1) ** (k // 2) / f(k) for k in range(4, 12 if few else 18, 2)],
            "ln2": parts_of(LN2, 12 if few else 33, 2),
            "exponential": [1 / f(k) for k in range(2, 8 if few else 14)],
            "hyperbolic": [1 / f(k) for k in range(3, 13 if few else 19, 2)],
            "area": [2 / k for k in area],
            "arc": [(-1) ** (k // 2) / k for k in range(3, 9 if few else 15, 2)],
            "arcs": [math.atan(k / 8) for k in range(9)],
            "powers": [2.0**k for k in steps],
            "fractions": [2.0**-k for k in steps],
        }
        return {name: [self.type(value) for value in values] for name, values in found.items()}

    @cached_property
    def _steps(self) -> list[tuple]:
        """(2^step, 2^-step, step) from the largest on."""
        powers, fractions = self.constants["powers"], self.constants["fractions"]
        return [(p, q, round(math.log2(float(p)))) for p, q in zip(powers, fractions, strict=True)]

    def _polynomial(self, name: str, x: float) -> float:
        coefficients = self.constants[name]
        total = coefficients[-1]
        for c in coefficients[-2::-1]:
            total = total * x + c
        return total

    def floor(self, x: float) -> float:
        """The largest whole number up to `x`."""
        if not abs(x) < self.whole:
            return x
        whole = self.type(int(x))
        return whole - self.type(1) if whole > x else whole

    def ceil(self, x: float) -> float:
        """The smallest whole number from `x` on."""
        return -self.floor(-x)

    def sign(self, x: float) -> float:
        """1, -1 or 0."""
        return self.type(1) if x > 0 else self.type(-1) if x < 0 else x

    def _turn(self, x: float, shift: int) -> float:
        """cos x where `shift` is 1, sin x where it is 0."""
        one, half, four = self.type(1), self.type(0.5), self.type(4)
        k = self.floor(x / self.half_pi + half)
        turned = k + self.type(shift)
        quarter = turned - four * self.floor(turned / four)
        r = x
        for part in self.constants["half_pi"]:
            r = r - k * part
        z = r * r
        if 0.5 < quarter < 1.5 or quarter > 2.5:
            r = (one - half * z) + (z * z) * self._polynomial("cosine", z)
        else:
            r = r + (r * z) * self._polynomial("sine", z)
        return -r if quarter > 1.5 else r

    def sin(self, x: float) -> float:
        """Sine of `x` [rad]."""
        return self._turn(x, 0)

    def cos(self, x: float) -> float:
        """Cosine of `x` [rad]."""
        return self._turn(x, 1)

    def tan(self, x: float) -> float:
        """Tangent of `x` [rad]."""
        return self.sin(x) / self.cos(x)

    def _scale(self, m: float, e: int) -> float:
        """m 2^e."""
        for power, fraction, step in self._steps:
            if e >= step:
                m, e = m * power, e - step
            elif e <= -step:
                m, e = m * fraction, e + step
        return m

    def _split(self, x: float) -> tuple[float, int]:
        """m from 1 to 2 and e with x = m 2^e, x above 0 and finite."""
        e = 0
        for power, fraction, step in self._steps:
            if x >= power:
                x, e = x * fraction, e + step
            elif x * power < 2:
                x, e = x * power, e - step
        return x, e

    def exp(self, x: float) -> float:
        """e to the power `x`."""
        if not x <= self.largest:
            return x
        x = self.most if x > self.most else -self.most if x < -self.most else x
        high, low = self.constants["ln2"]
        k = self.floor(x / self.ln2 + self.type(0.5))
        r = (x - k * high) - k * low
        return self._scale((r + (r * r) * self._polynomial("exponential", r)) + self.type(1), int(k))

    def expm1(self, x: float) -> float:
        """e to the power `x`, less 1."""
        if abs(x) < self.type(0.3125):
            return x + (x * x) * self._polynomial("exponential", x)
        return self.exp(x) - self.type(1)

    def sinh(self, x: float) -> float:
        """Hyperbolic sine of `x`."""
        if abs(x) < 1:
            z = x * x
            return x + (x * z) * self._polynomial("hyperbolic", z)
        high = self.exp(abs(x))
        found = self.type(0.5) * high - self.type(0.5) / high
        return -found if x < 0 else found

    def cosh(self, x: float) -> float:
        """Hyperbolic cosine of `x`."""
        high = self.exp(abs(x))
        return self.type(0.5) * high + self.type(0.5) / high

    def tanh(self, x: float) -> float:
        """Hyperbolic tangent of `x`."""
        one, two = self.type(1), self.type(2)
        if abs(x) < 1:
            high = self.exp(abs(x))
            return self.sinh(x) / (self.type(0.5) * high + self.type(0.5) / high)
        found = one - two / (self.exp(two * abs(x)) + one)
        return -found if x < 0 else found

    def _area(self, s: float) -> float:
        """log((1 + s)/(1 - s)) near 0."""
        z = s * s
        return self.type(2) * s + (s * z) * self._polynomial("area", z)

    def log(self, x: float) -> float:
        """Natural logarithm of `x`."""
        if not x > 0 or not x <= self.largest:
            return -self.type(1) / abs(x) if x == 0 else (x - x) / (x - x) if x < 0 else x
        m, e = self._split(x)
        if m > self.type(1.4375):
            m, e = m * self.type(0.5), e + 1
        high, low = self.constants["ln2"]
        k = self.type(e)
        return k * high + (self._area((m - self.type(1)) / (m + self.type(1))) + k * low)

    def log1p(self, x: float) -> float:
        """Logarithm of 1 + `x`."""
        if abs(x) < self.type(0.3125):
            return self._area(x / (self.type(2) + x))
        return self.log(self.type(1) + x)

    def asinh(self, x: float) -> float:
        """The number whose sinh is `x`."""
        a = abs(x)
        found = self.log1p(a + (a * a) / (self.type(1) + self.sqrt(a * a + self.type(1))))
        return -found if x < 0 else found

    def acosh(self, x: float) -> float:
        """The number whose cosh is `x`."""
        return self.log(x + self.sqrt((x - self.type(1)) * (x + self.type(1))))

    def atanh(self, x: float) -> float:
        """The number whose tanh is `x`."""
        a = abs(x)
        found = self.type(0.5) * self.log1p((self.type(2) * a) / (self.type(1) - a))
        return -found if x < 0 else found

    def atan(self, x: float) -> float:
        """The angle [rad] whose tangent is `x`."""
        a, one = abs(x), self.type(1)
        b = one / a if a > one else a
        if not b <= one:
            return x
        k = self.floor(self.type(8) * b + self.type(0.5))
        c = k * self.type(0.125)
        t = (b - c) / (one + b * c)
        z = t * t
        found = self.constants["arcs"][int(k)] + (t + (t * z) * self._polynomial("arc", z))
        found = self.half_pi - found if a > one else found
        return -found if x < 0 else found

    def atan2(self, y: float, x: float) -> float:
        """The angle [rad] of the point (`x`, `y`)."""
        a, b = abs(y), abs(x)
        found = self.half_pi - self.atan(b / a) if a > b else self.atan(a / b) if b > 0 else a
        found = self.pi - found if x < 0 else found
        return -found if y < 0 else found

    def asin(self, x: float) -> float:
        """The angle [rad] whose sine is `x`."""
        return self.atan2(x, self.sqrt((self.type(1) - x) * (self.type(1) + x)))

    def acos(self, x: float) -> float:
        """The angle [rad] whose cosine is `x`."""
        return self.atan2(self.sqrt((self.type(1) - x) * (self.type(1) + x)), x)

    def sqrt(self, x: float) -> float:
        """Square root of `x`."""
        if not x > 0 or not x <= self.largest:
            return (x - x) / (x - x) if x < 0 else x
        m, e = self._split(x)
        if e % 2:
            m, e = m * self.type(2), e - 1
        root = self.type(0.6875) + self.type(0.34375) * m
        for _ in range(4):
            root = self.type(0.5) * (root + m / root)
        return self._scale(root, e // 2)

    def hypot(self, x: float, y: float) -> float:
        """Length of (`x`, `y`)."""
        a, b = abs(x), abs(y)
        large, small = (a, b) if a > b else (b, a)
        if not large > 0:
            return large
        q = small / large
        return large * self.sqrt(self.type(1) + q * q)

    def pow(self, x: float, y: float) -> float:
        """`x` to the power `y`."""
        one = self.type(1)
        if x > 0 or np.isnan(x):
            return self.exp(y * self.log(x))
        if x == 0:
            return self.type(0) if y > 0 else one if y == 0 else one / abs(x)
        if self.floor(y) != y:
            return (x - x) / (x - x)
        found = self.exp(y * self.log(-x))
        return found if self.type(2) * self.floor(y * self.type(0.5)) == y else -found
