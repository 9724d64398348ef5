"""Eight doubles at a time inside compiled loops: what the loops of the small sweep are written in.

A compiler that is left alone keeps reloading and storing accumulators, since it must assume that arrays overlap, and it
runs the last n mod 8 columns one by one. Here rows are padded with zeros to a multiple of WIDTH, and accumulators are
values.
Arrays are addressed by the flat offset from their first entry; nothing is checked. Source: numba.extending.intrinsic.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic, models, register_model

from occontrol.numerics.loops import ENTRY

WIDTH = 8
FAST = {"contract", "nsz", "nnan", "reassoc"}
OPTIONS = {"cache": True, "nogil": True, "fastmath": FAST, "error_model": "numpy", **ENTRY}
# Arguments of `product` and `copy`: written as 0, True and False they would be literals, and each compiled by itself
START, WHOLE, LOWER = np.int64(0), np.bool_(False), np.bool_(True)
_FLAGS = ("contract", "nsz", "nnan")
_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)


class _Vector(types.Type):
    def __init__(self) -> None:
        super().__init__(name="eight_doubles")


_vector = _Vector()


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _VECTOR)


def _address(context, builder, array_type, array, offset):
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [offset])


@intrinsic
def load(typing, array, offset):
    """The vector array[offset : offset + WIDTH], offset counted from the first entry."""

    def build(context, builder, signature, args):
        at = _address(context, builder, signature.args[0], *args)
        found = builder.load(builder.bitcast(at, _VECTOR.as_pointer()), typ=_VECTOR)
        found.align = 8
        return found

    return _vector(array, types.intp), build


@intrinsic
def scalar(typing, array, offset):
    """The number array[offset]."""

    def build(context, builder, signature, args):
        return builder.load(_address(context, builder, signature.args[0], *args))

    return types.float64(array, types.intp), build


@intrinsic
def store(typing, array, offset, vector):
    """array[offset : offset + WIDTH] = vector"""

    def build(context, builder, signature, args):
        at = _address(context, builder, signature.args[0], *args[:2])
        builder.store(args[2], builder.bitcast(at, _VECTOR.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, vector), build


@intrinsic
def zero(typing):
    """Eight zeros."""

    def build(context, builder, signature, args):
        return ir.Constant(_VECTOR, [0.0] * WIDTH)

    return _vector(), build


def _spread(builder, x):
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), x, ir.Constant(ir.IntType(32), 0))
    mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), mask)


@intrinsic
def axpy(typing, x, vector, total):
    """total + x * vector, for a number x."""

    def build(context, builder, signature, args):
        product = builder.fmul(_spread(builder, args[0]), args[1], flags=_FLAGS)
        return builder.fadd(args[2], product, flags=_FLAGS)

    return _vector(types.float64, _vector, _vector), build


@intrinsic
def times(typing, one, other, total):
    """total + one * other, entry by entry."""

    def build(context, builder, signature, args):
        return builder.fadd(args[2], builder.fmul(args[0], args[1], flags=_FLAGS), flags=_FLAGS)

    return _vector(_vector, _vector, _vector), build


@intrinsic
def summed(typing, vector):
    """The sum of the eight entries."""

    def build(context, builder, signature, args):
        found, width = args[0], WIDTH
        while width > 1:
            width //= 2
            order = [i + width if i < width else 0 for i in range(WIDTH)]
            mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), order)
            other = builder.shuffle_vector(found, ir.Constant(_VECTOR, ir.Undefined), mask)
            found = builder.fadd(found, other, flags=_FLAGS)
        return builder.extract_element(found, ir.Constant(ir.IntType(32), 0))

    return types.float64(_vector), build


def _transposed(builder, rows):
    for distance in (1, 2, 4):
        low = [i if not i & distance else i - distance + WIDTH for i in range(WIDTH)]
        high = [i + distance for i in low]
        masks = [ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), order) for order in (low, high)]
        for i in range(WIDTH):
            if not i & distance:
                pair = rows[i], rows[i + distance]
                rows[i], rows[i + distance] = (builder.shuffle_vector(*pair, mask) for mask in masks)
    return rows


_block = types.UniTuple(_vector, WIDTH)


@intrinsic
def transpose(typing, rows):
    """The transpose of a block of eight rows."""

    def build(context, builder, signature, args):
        found = _transposed(builder, [builder.extract_value(args[0], i) for i in range(WIDTH)])
        return context.make_tuple(builder, signature.return_type, found)

    return _block(_block), build


@intrinsic
def symmetric(typing, rows):
    """The symmetric block of eight rows that has the lower triangle of the given one."""

    def build(context, builder, signature, args):
        own = [builder.extract_value(args[0], i) for i in range(WIDTH)]
        found = _transposed(builder, list(own))
        for i in range(WIDTH):
            mask = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [j if j <= i else j + WIDTH for j in range(WIDTH)])
            found[i] = builder.shuffle_vector(own[i], found[i], mask)
        return context.make_tuple(builder, signature.return_type, found)

    return _block(_block), build


def padded(array: np.ndarray) -> np.ndarray:
    """A copy of (..., n) whose last axis is filled with zeros up to a multiple of WIDTH.

    Parameters
    ----------
    array : (..., n)
    """
    n = array.shape[-1]
    found = np.zeros((*array.shape[:-1], width(n)))
    found[..., :n] = array
    return found


def width(n: int) -> int:
    """n rounded up to a multiple of WIDTH."""
    return -(-n // WIDTH) * WIDTH


@njit(**OPTIONS)
def copy(A, a, B, b, size):
    """B[b : b + size] = A[a : a + size] of flat arrays (a slice assignment takes numba seconds to compile)."""
    for i in range(size):
        B[b + i] = A[a + i]


@njit(**OPTIONS)
def product(A, a, lda, B, b, ldb, C, c, ldc, D, d, rows, inner, columns, lower):
    """C = A B + D by tiles of four rows; a, b, c, d are offsets, lda, ldb, ldc the (padded) lengths of a row.

    A (rows, inner), B (inner, columns), C and D (rows, columns) with row length ldc; D is left out when it is empty.
    With `lower`, tiles wholly above the diagonal are left out.
    """
    added = D.size > 0
    i = 0
    while i + 4 <= rows:
        p = a + i * lda
        q = c + i * ldc
        stop = i + 4 if lower and i + 4 < columns else columns
        for j in range(0, stop, WIDTH):
            if added:
                e = d + i * ldc + j
                x0, x1, x2, x3 = load(D, e), load(D, e + ldc), load(D, e + 2 * ldc), load(D, e + 3 * ldc)
            else:
                x0, x1, x2, x3 = zero(), zero(), zero(), zero()
            at = b + j
            for m in range(inner):
                y = load(B, at + m * ldb)
                x0 = axpy(scalar(A, p + m), y, x0)
                x1 = axpy(scalar(A, p + lda + m), y, x1)
                x2 = axpy(scalar(A, p + 2 * lda + m), y, x2)
                x3 = axpy(scalar(A, p + 3 * lda + m), y, x3)
            store(C, q + j, x0)
            store(C, q + ldc + j, x1)
            store(C, q + 2 * ldc + j, x2)
            store(C, q + 3 * ldc + j, x3)
        i += 4
    while i < rows:
        p = a + i * lda
        two = i + 1 < rows
        stop = i + 2 if lower and i + 2 < columns else columns
        for j in range(0, stop, WIDTH):
            x0, x1 = zero(), zero()
            if added:
                x0 = load(D, d + i * ldc + j)
                if two:
                    x1 = load(D, d + (i + 1) * ldc + j)
            at = b + j
            if two:
                for m in range(inner):
                    y = load(B, at + m * ldb)
                    x0 = axpy(scalar(A, p + m), y, x0)
                    x1 = axpy(scalar(A, p + lda + m), y, x1)
                store(C, c + (i + 1) * ldc + j, x1)
            else:
                for m in range(inner):
                    x0 = axpy(scalar(A, p + m), load(B, at + m * ldb), x0)
            store(C, c + i * ldc + j, x0)
        i += 2 if two else 1


@njit(**OPTIONS)
def mirror(X, at, n, width):
    """Make the (n, n) matrix at X[at:], rows `width` apart, symmetric from its lower triangle, by blocks of eight."""
    if n < WIDTH:
        for i in range(n):
            for j in range(i):
                X[at + j * width + i] = X[at + i * width + j]
        return
    for i in range(0, n, WIDTH):
        p = at + i * width
        left = n - i
        for j in range(0, i + 1, WIDTH):
            block = (
                load(X, p + j),
                load(X, p + j + width) if left > 1 else zero(),
                load(X, p + j + 2 * width) if left > 2 else zero(),
                load(X, p + j + 3 * width) if left > 3 else zero(),
                load(X, p + j + 4 * width) if left > 4 else zero(),
                load(X, p + j + 5 * width) if left > 5 else zero(),
                load(X, p + j + 6 * width) if left > 6 else zero(),
                load(X, p + j + 7 * width) if left > 7 else zero(),
            )
            to, rows = at + j * width + i, WIDTH
            if i == j:
                block = symmetric(block)
                rows = left if left < WIDTH else WIDTH
            else:
                block = transpose(block)
            store(X, to, block[0])
            if rows > 1:
                store(X, to + width, block[1])
            if rows > 2:
                store(X, to + 2 * width, block[2])
            if rows > 3:
                store(X, to + 3 * width, block[3])
            if rows > 4:
                store(X, to + 4 * width, block[4])
            if rows > 5:
                store(X, to + 5 * width, block[5])
            if rows > 6:
                store(X, to + 6 * width, block[6])
            if rows > 7:
                store(X, to + 7 * width, block[7])
