"""What a formula and its slope are over whole intervals of time: numbers that certainly enclose them.

Interval arithmetic, rounded outwards after every operation: for t in [low, high] the value of the formula lies in
[value low, value high] and its slope, where it has one, in [slope low, slope high]. What is not known well is the
whole line: too wide, never wrong. Source: R. E. Moore, Interval Analysis (1966).
"""

from __future__ import annotations

import ast
from dataclasses import dataclass

import numpy as np

OUT = 16 * np.finfo(float).eps  # functions of NumPy are right to a few units in the last place
CRITICAL = 1e-9  # slack with which an extreme of sin counts as inside

Pair = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Enclosure:
    """Bounds of a formula and of its slope over K intervals.

    Parameters
    ----------
    value : (low, high), each (K,), in the unit of what the formula stands for
    slope : (low, high), each (K,), per unit of time
    """

    value: Pair
    slope: Pair

    @property
    def known(self) -> np.ndarray:
        """(K,) whether the value is a single number."""
        return self.value[0] == self.value[1]


def enclose(node: ast.expr, low: np.ndarray, high: np.ndarray, constants: dict[str, float]) -> Enclosure:
    """Bounds of a checked formula of one variable, and of its slope.

    Parameters
    ----------
    node : the formula's syntax tree
    low, high : (K,) ends of the intervals of its variable, in the unit of time
    constants : numbers that have names in formulas; any other name is the variable
    """
    with np.errstate(all="ignore"):
        return _Reader(low, high, constants).read(node)


class _Reader:
    def __init__(self, low: np.ndarray, high: np.ndarray, constants: dict[str, float]):
        self.time, self.constants = (low, high), constants
        self.zero = np.zeros_like(low)

    def fixed(self, number: float) -> Enclosure:
        return Enclosure((self.zero + number, self.zero + number), (self.zero, self.zero))

    def read(self, node: ast.expr) -> Enclosure:
        if isinstance(node, ast.Constant):
            return self.fixed(float(node.value))  # type: ignore[arg-type]
        if isinstance(node, ast.Name):
            if node.id in self.constants:
                return self.fixed(self.constants[node.id])
            return Enclosure(self.time, (self.zero + 1.0, self.zero + 1.0))
        if isinstance(node, ast.UnaryOp):
            inside = self.read(node.operand)
            if isinstance(node.op, ast.Not):
                return _truth(*(1.0 - end for end in inside.value[::-1]))
            return _minus(inside) if isinstance(node.op, ast.USub) else inside
        if isinstance(node, ast.BoolOp):
            low, high = zip(*(self.read(part).value for part in node.values), strict=True)
            join = np.min if isinstance(node.op, ast.And) else np.max
            return _truth(join(low, axis=0), join(high, axis=0))
        if isinstance(node, ast.Compare):
            parts = [self.read(part) for part in (node.left, *node.comparators)]
            held = [_holds(_add(b, _minus(a)), op) for a, op, b in zip(parts, node.ops, parts[1:], strict=False)]
            return _truth(*(np.min(ends, axis=0) for ends in zip(*held, strict=True)))
        if isinstance(node, ast.BinOp):
            return self.binary(node)
        assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        return _call(node.func.id, [self.read(a) for a in node.args])

    def binary(self, node: ast.BinOp) -> Enclosure:
        left, right = self.read(node.left), self.read(node.right)
        if isinstance(node.op, ast.Add):
            return _add(left, right)
        if isinstance(node.op, ast.Sub):
            return _add(left, _minus(right))
        if isinstance(node.op, ast.Mult):
            return Enclosure(_times(left.value, right.value), _product_slope(left, right))
        if isinstance(node.op, ast.Div):
            inverse = _inverse(right.value)
            slope = _times(_plus(left.slope, _negative(_times(_times(left.value, inverse), right.slope))), inverse)
            return Enclosure(_times(left.value, inverse), slope)
        return _power(left, right)


def _out(low: np.ndarray, high: np.ndarray) -> Pair:
    bad = np.isnan(low) | np.isnan(high)
    low, high = low - OUT * np.abs(low), high + OUT * np.abs(high)
    return np.where(bad, -np.inf, low), np.where(bad, np.inf, high)


def _line(like: np.ndarray) -> Pair:
    return np.full_like(like, -np.inf), np.full_like(like, np.inf)


def _negative(a: Pair) -> Pair:
    return -a[1], -a[0]


def _plus(a: Pair, b: Pair) -> Pair:
    return _out(a[0] + b[0], a[1] + b[1])


def _times(a: Pair, b: Pair) -> Pair:
    ends = np.stack([x * y for x in a for y in b])
    return _out(np.min(ends, axis=0), np.max(ends, axis=0))


def _hull(a: Pair, b: Pair) -> Pair:
    return np.minimum(a[0], b[0]), np.maximum(a[1], b[1])


def _pick(which: np.ndarray, a: Pair, b: Pair) -> Pair:
    return np.where(which, a[0], b[0]), np.where(which, a[1], b[1])


def _inverse(a: Pair) -> Pair:
    bad = (a[0] <= 0) & (a[1] >= 0)
    return _pick(bad, _line(a[0]), _out(1 / np.where(bad, 1.0, a[1]), 1 / np.where(bad, 1.0, a[0])))


def _minus(a: Enclosure) -> Enclosure:
    return Enclosure(_negative(a.value), _negative(a.slope))


def _add(a: Enclosure, b: Enclosure) -> Enclosure:
    return Enclosure(_plus(a.value, b.value), _plus(a.slope, b.slope))


def _product_slope(a: Enclosure, b: Enclosure) -> Pair:
    return _plus(_times(a.slope, b.value), _times(a.value, b.slope))


def _truth(low: np.ndarray, high: np.ndarray) -> Enclosure:
    """Something that is constant wherever its bounds agree, and jumps elsewhere."""
    same = low == high
    return Enclosure((low, high), _pick(same, (np.zeros_like(low), np.zeros_like(low)), _line(low)))


def _holds(right_less_left: Enclosure, op: ast.cmpop) -> Pair:
    """0 or 1: whether left < right, and the like; where both are equal either may be."""
    low, high = right_less_left.value if isinstance(op, ast.Lt | ast.LtE) else _negative(right_less_left.value)
    return (low > 0).astype(float), (high >= 0).astype(float)


def _power(base: Enclosure, exponent: Enclosure) -> Enclosure:
    p = float(exponent.value[0][0]) if len(exponent.value[0]) else 1.0
    fixed = bool(np.all(exponent.known & (exponent.value[0] == p) & (exponent.slope[0] == 0)))
    if not fixed:
        bad = base.value[0] <= 0
        return _guard(bad, _call("exp", [_times_both(exponent, _call("log", [base]))]))
    if p == 0:
        return Enclosure((base.value[0] * 0 + 1, base.value[0] * 0 + 1), (base.value[0] * 0, base.value[0] * 0))
    value = _power_value(base.value, p)
    outer = tuple(p * end for end in _power_value(base.value, p - 1))
    return Enclosure(value, _times(base.slope, (np.minimum(*outer), np.maximum(*outer))))


def _power_value(a: Pair, p: float) -> Pair:
    if p == 0:
        return a[0] * 0 + 1, a[0] * 0 + 1
    if p < 0:
        return _inverse(_power_value(a, -p))
    ends = np.stack([a[0] ** p, a[1] ** p])  # no number where a root of something negative is asked for
    low, high = np.min(ends, axis=0), np.max(ends, axis=0)
    if float(p).is_integer() and p % 2 == 0:
        low = np.where((a[0] <= 0) & (a[1] >= 0), 0.0, low)
    return _out(low, high)


def _times_both(a: Enclosure, b: Enclosure) -> Enclosure:
    return Enclosure(_times(a.value, b.value), _product_slope(a, b))


def _guard(bad: np.ndarray, a: Enclosure) -> Enclosure:
    line = _line(a.value[0])
    return Enclosure(_pick(bad, line, a.value), _pick(bad, line, a.slope))


def _cosine(a: Pair) -> Pair:
    turn, slack = 2 * np.pi, CRITICAL * (1 + np.maximum(np.abs(a[0]), np.abs(a[1])))
    ends = np.stack([np.cos(a[0]), np.cos(a[1])])
    low, high = _out(np.min(ends, axis=0), np.max(ends, axis=0))

    def inside(phase: float) -> np.ndarray:
        return ~(np.floor((a[1] + slack - phase) / turn) < np.ceil((a[0] - slack - phase) / turn))

    return np.where(inside(np.pi), -1.0, low), np.where(inside(0.0), 1.0, high)


def _sine(a: Pair) -> Pair:
    shifted = _plus(a, (a[0] * 0 - np.pi / 2, a[1] * 0 - np.pi / 2))
    low, high = _cosine(shifted)
    ends = np.stack([np.sin(a[0]), np.sin(a[1])])  # nearer to the zeros than the shifted cosine
    near_low, near_high = _out(np.min(ends, axis=0), np.max(ends, axis=0))
    return np.where(low == -1.0, low, near_low), np.where(high == 1.0, high, near_high)


def _rising(f: np.ufunc, a: Pair) -> Pair:
    return _out(f(a[0]), f(a[1]))


def _call(name: str, given: list[Enclosure]) -> Enclosure:
    a = given[0]
    low, high = a.value
    if name in ("sin", "cos"):
        outer = _cosine(a.value) if name == "sin" else _negative(_sine(a.value))
        return Enclosure(_sine(a.value) if name == "sin" else _cosine(a.value), _times(outer, a.slope))
    if name in ("exp", "log", "sqrt", "tanh", "atan"):
        value = _rising({"atan": np.arctan}.get(name) or getattr(np, name), a.value)
        square = _power_value(value if name == "tanh" else a.value, 2.0)
        ones = (low * 0 + 1, low * 0 + 1)
        outer = {
            "exp": lambda: value,
            "log": lambda: _inverse(a.value),
            "sqrt": lambda: _inverse((2 * value[0], 2 * value[1])),
            "tanh": lambda: _plus(ones, _negative(square)),
            "atan": lambda: _inverse(_plus(ones, square)),
        }[name]()
        return Enclosure(value, _times(outer, a.slope))
    if name == "abs":
        value = (np.where((low <= 0) & (high >= 0), 0.0, np.minimum(np.abs(low), np.abs(high))), np.maximum(-low, high))
        back = _negative(a.slope)
        return Enclosure(value, _pick(low >= 0, a.slope, _pick(high <= 0, back, _hull(a.slope, back))))
    if name in ("min", "max"):
        for b in given[1:]:
            a = _smaller(a, b) if name == "min" else _minus(_smaller(_minus(a), _minus(b)))
        return a
    if name in ("floor", "ceil"):
        return _truth(getattr(np, name)(low), getattr(np, name)(high))
    if name == "sign":
        return _truth(np.where(low > 0, 1.0, -1.0), np.where(high < 0, -1.0, 1.0))
    if name == "step":
        return _truth((low > 0).astype(float), (high >= 0).astype(float))
    if name == "if_else":
        one, other = given[1:]
        either = Enclosure(_hull(one.value, other.value), _line(low))
        chosen = Enclosure(_pick(low > 0, one.value, other.value), _pick(low > 0, one.slope, other.slope))
        return Enclosure(
            _pick(a.known, chosen.value, either.value),
            _pick(a.known, chosen.slope, either.slope),
        )
    return Enclosure(_line(low), _line(low))


def _smaller(a: Enclosure, b: Enclosure) -> Enclosure:
    value = (np.minimum(a.value[0], b.value[0]), np.minimum(a.value[1], b.value[1]))
    first, second = a.value[1] <= b.value[0], b.value[1] <= a.value[0]
    slope = _pick(first, a.slope, _pick(second, b.slope, _hull(a.slope, b.slope)))
    return Enclosure(value, slope)
