"""Compiled loops over eight independent blocks at a time: cost and gradient of one group of lanes, start to end.

Entry (i, j) of the same matrix of eight blocks is one vector at offset (i n + j) WIDTH. A slot is one sensor of every
lane: which weight it has, and where its scaled rows c lie; a lane without a sensor names the weight that is always 0.
Unknowns of step k, as in scheduling/kernels.py:
    S- = F S F' + Q,     S+ = (S-^-1 + h sum_s v_s c_s c_s')^-1
backwards, with P = dJ/dS+, y = S+ c, z = P y and K = I - sum_s w_s y_s c_s':
    dJ/dv_s -= h c' S+ P S+ c,     P- = K' P K,     P <- F' P- F
All of S+ of one group stays in the cache; the covariance of the whole plant is never stored.
"""

from __future__ import annotations

from numba import njit

from occontrol.scheduling.kernels import CANCEL
from occontrol.scheduling.vectors import OPTIONS, WIDTH, axpy, load, store, times, zero


@njit(**OPTIONS)
def _predict(f, fo, transposed, q, qo, s, so, t, x, xo, n):
    """x <- F s F' + q, or F' s F + q where `transposed`; t is work space, x symmetric and may be s.

    Two sums at a time: one would wait for its own last term.
    """
    row, step = (1, n) if transposed else (n, 1)
    for i in range(n):
        from_f = fo + i * row * WIDTH
        for j in range(0, n, 2):
            one, other = zero(), zero()
            second = j + 1 if j + 1 < n else j
            for m in range(n):
                entry, at = load(f, from_f + m * step * WIDTH), so + m * n * WIDTH
                one = times(entry, load(s, at + j * WIDTH), one)
                other = times(entry, load(s, at + second * WIDTH), other)
            store(t, (i * n + j) * WIDTH, one)
            store(t, (i * n + second) * WIDTH, other)
    for i in range(n):
        for j in range(0, i + 1, 2):
            one, other = zero(), zero()
            second = j + 1 if j < i else j
            if q.size:
                one, other = load(q, qo + (i * n + j) * WIDTH), load(q, qo + (i * n + second) * WIDTH)
            for m in range(n):
                entry, at = load(t, (i * n + m) * WIDTH), fo + m * step * WIDTH
                one = times(entry, load(f, at + j * row * WIDTH), one)
                other = times(entry, load(f, at + second * row * WIDTH), other)
            store(x, xo + (i * n + j) * WIDTH, one)
            store(x, xo + (j * n + i) * WIDTH, one)
            store(x, xo + (i * n + second) * WIDTH, other)
            store(x, xo + (second * n + i) * WIDTH, other)


@njit(**OPTIONS)
def _trace(a, ao, b, bo, n):
    """tr(a b) of two symmetric matrices, lane by lane."""
    found = zero()
    for i in range(n * n):
        found = times(load(a, ao + i * WIDTH), load(b, bo + i * WIDTH), found)
    return found


@njit(**OPTIONS)
def _dot(x, xo, y, yo, n):
    """x'y, lane by lane."""
    found = zero()
    for i in range(n):
        found = times(load(x, xo + i * WIDTH), load(y, yo + i * WIDTH), found)
    return found


@njit(**OPTIONS)
def _add(weight, at, factor, P, size):
    """P <- P + factor times the matrices at weight[at:]"""
    for i in range(0, size, WIDTH):
        store(P, i, axpy(factor, load(weight, at + i), load(P, i)))


@njit(**OPTIONS)
def _gather(c, rows, slot, row, n, out, to):
    """out[to:] (n, WIDTH) <- row number `row` of what every lane of a slot measures, from c (.., n)."""
    for lane in range(WIDTH):
        at = (rows[slot, lane] + row) * n
        for i in range(n):
            out[to + i * WIDTH + lane] = c[at + i]


@njit(**OPTIONS)
def _share(v, entry, slot, h, w, wo):
    """w[wo:] (WIDTH,) <- h v of a slot; whether any is positive."""
    used = 0.0
    for lane in range(WIDTH):
        x = h * v[entry[slot, lane]]
        w[wo + lane] = x
        used = max(used, x)
    return used > 0.0


@njit(**OPTIONS)
def _multiply(s, so, c, co, y, yo, n):
    """y[yo:] (n, WIDTH) <- s c of a symmetric s"""
    for i in range(0, n, 2):
        one, other = zero(), zero()
        second = i + 1 if i + 1 < n else i
        for m in range(n):
            entry, at = load(c, co + m * WIDTH), so + m * n * WIDTH
            one = times(entry, load(s, at + i * WIDTH), one)
            other = times(entry, load(s, at + second * WIDTH), other)
        store(y, yo + i * WIDTH, one)
        store(y, yo + second * WIDTH, other)


@njit(**OPTIONS)
def _update_row(s, so, c, w, b, g, n):
    """One row with information w (WIDTH,) in every lane, in place on s; in Joseph's form where much would cancel."""
    _multiply(s, so, c, 0, b, 0, n)
    end = n * WIDTH
    store(g, end, _dot(b, 0, c, 0, n))
    largest = 0.0
    for lane in range(WIDTH):
        innovation = w[lane] * g[end + lane]
        largest = max(largest, innovation)
        g[end + lane] = -w[lane] / (1.0 + innovation)
    gain = load(g, end)
    for i in range(n):
        x = times(gain, load(b, i * WIDTH), zero())
        store(g, i * WIDTH, x)
        for j in range(i + 1):
            at = so + (i * n + j) * WIDTH
            y = times(x, load(b, j * WIDTH), load(s, at))
            store(s, at, y)
            store(s, so + (j * n + i) * WIDTH, y)
    if largest < CANCEL:
        return
    # second factor of (I - kc')S(I - kc')' + kk'/w, k = -g: s <- s - (s c - k/w) k'
    for lane in range(WIDTH):
        if w[lane] > 0.0:
            for i in range(n):
                x = 0.0
                for m in range(n):
                    x += s[so + (i * n + m) * WIDTH + lane] * c[m * WIDTH + lane]
                b[i * WIDTH + lane] = x + g[i * WIDTH + lane] / w[lane]
            for i in range(n):
                for j in range(n):
                    s[so + (i * n + j) * WIDTH + lane] += b[i * WIDTH + lane] * g[j * WIDTH + lane]
            for i in range(n):
                for j in range(i):
                    low, high = so + (i * n + j) * WIDTH + lane, so + (j * n + i) * WIDTH + lane
                    s[low] = s[high] = 0.5 * (s[low] + s[high])


@njit(**OPTIONS)
def _reduce(P, w, cs, ys, zs, count, u, n):
    """P <- K' P K = P - sum_a (c_a u_a' + u_a c_a') of `count` rows, u_a = w_a (z_a - sum_b w_b (y_a' z_b) c_b / 2)."""
    size = n * WIDTH
    for a in range(count):
        wa = load(w, a * WIDTH)
        for i in range(n):
            store(u, i * WIDTH, load(zs, a * size + i * WIDTH))
        for b in range(count):
            shared = times(load(w, b * WIDTH), _dot(ys, a * size, zs, b * size, n), zero())
            shared = axpy(-0.5, shared, zero())
            for i in range(n):
                at = b * size + i * WIDTH
                store(u, i * WIDTH, times(shared, load(cs, at), load(u, i * WIDTH)))
        for i in range(n):
            x = axpy(-1.0, times(wa, load(u, i * WIDTH), zero()), zero())
            store(u, i * WIDTH, x)
        for i in range(n):
            x, c = load(u, i * WIDTH), load(cs, a * size + i * WIDTH)
            for j in range(i + 1):
                at = (i * n + j) * WIDTH
                y = times(x, load(cs, a * size + j * WIDTH), times(c, load(u, j * WIDTH), load(P, at)))
                store(P, at, y)
                store(P, (j * n + i) * WIDTH, y)


@njit(**OPTIONS)
def sweep_lanes(
    first, last, n, rows, initial, F, Q, predict, terminal, R, running_set, charges, steps, slots, entry, row, C, v,
    keep, gradient, costs, kept, work, most,
):  # fmt: skip
    """Cost and, with `keep`, gradient of lane groups first .. last - 1.

    initial, terminal (G, n, n, W) flat; F, Q (G, U, n, n, W) flat; predict (K+1,); R (G, V, n, n, W) flat or empty;
    slots (G, K+1) where the slots of each step begin; entry, row (S, W); C (.., n) flat; v (E+1,) with v[E] = 0
    gradient (E+1,) is added to, costs (G W,) is set; kept (K, n, n, W) flat; most: rows of the busiest step
    work : (3 n n + 3 n + 1 + (3 n + 1) most) W numbers
    """
    K, size, line = len(steps), n * n * WIDTH, n * WIDTH
    U, V = F.size // initial.size, R.size // initial.size
    none = R[:0]
    S, T, P = work[:size], work[size : 2 * size], work[2 * size : 3 * size]
    rest = work[3 * size :]
    c, b, g = rest[:line], rest[line : 2 * line], rest[2 * line : 3 * line + WIDTH]
    rest = rest[3 * line + WIDTH :]
    cs, ys, zs, w = rest[: most * line], rest[most * line :], rest[2 * most * line :], rest[3 * most * line :]
    for group in range(first, last):
        total = zero()
        X, before = S, 0
        for i in range(size):
            S[i] = initial[group * size + i]
        for k in range(K):
            u = (group * U + predict[k]) * size
            at = k * size if keep else 0
            target = kept if keep else S
            _predict(F, u, False, Q, u, X, before, T, target, at, n)
            X, before = target, at
            weight = 0
            if V:
                weight = (group * V + running_set[k]) * size
                total = axpy(charges[k, 0], _trace(R, weight, X, at, n), total)
            for s in range(slots[group, k], slots[group, k + 1]):
                if _share(v, entry, s, steps[k], w, 0):
                    for r in range(rows):
                        _gather(C, row, s, r, n, c, 0)
                        _update_row(X, at, c, w, b, g, n)
            if V:
                total = axpy(charges[k, 1], _trace(R, weight, X, at, n), total)
        u = (group * U + predict[K]) * size
        _predict(F, u, False, Q, u, X, before, T, P, 0, n)
        total = axpy(1.0, _trace(terminal, group * size, P, 0, n), total)
        store(costs, group * WIDTH, total)
        if not keep:
            continue
        _predict(F, u, True, none, 0, terminal, group * size, T, P, 0, n)
        for k in range(K - 1, -1, -1):
            at, h = k * size, steps[k]
            weight = 0
            if V:
                weight = (group * V + running_set[k]) * size
                _add(R, weight, charges[k, 1], P, size)
            changed, count = False, 0
            for s in range(slots[group, k], slots[group, k + 1]):
                used = _share(v, entry, s, h, w, count * WIDTH)
                changed = changed or used
                for r in range(rows):
                    o = count * line
                    if r:
                        store(w, count * WIDTH, load(w, (count - 1) * WIDTH))
                    _gather(C, row, s, r, n, cs, o)
                    _multiply(kept, at, cs, o, ys, o, n)
                    _multiply(P, 0, ys, o, zs, o, n)
                    store(g, 0, _dot(ys, o, zs, o, n))
                    for lane in range(WIDTH):
                        gradient[entry[s, lane]] -= h * g[lane]
                    count += 1
            if changed:
                _reduce(P, w, cs, ys, zs, count, b, n)
            if V:
                _add(R, weight, charges[k, 0], P, size)
            u = (group * U + predict[k]) * size
            _predict(F, u, True, none, 0, P, 0, T, P, 0, n)
