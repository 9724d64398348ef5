"""Many states carried over one span at once, each by itself: a state has the same numbers whatever stands beside it.

One call of a compiled CasADi function does all of them, through plain memory; the equations are those of `flow.py`.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.kinds import CasadiFunction
from occontrol.numerics.flow import Flow, combined

KEPT = 64  # numbers of columns for which a function is kept


class Columns:
    """A CasADi function evaluated at many columns of its arguments in one call.

    Parameters
    ----------
    function : whose arguments are columns; outputs may be sparse
    steps : so many applications, each from the end of the last one, the first output; 1 is the function itself
    """

    def __init__(self, function: CasadiFunction, steps: int = 1):
        import casadi

        arguments = [casadi.SX.sym(f"a{i}", *function.size_in(i)) for i in range(function.n_in())]
        dense = [casadi.densify(value) for value in function.call(arguments)]
        made = casadi.Function("columns", arguments, dense)
        self._one = made if steps == 1 else made.mapaccum("columns", steps)
        self._made: dict[int, tuple] = {}

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """The outputs (B, size) of B columns, each output's entries column by column.

        Parameters
        ----------
        arguments : (B, size) of every argument
        """
        B = len(arguments[0])
        if B not in self._made:
            if len(self._made) >= KEPT:
                self._made.clear()
            many = self._one.map(B) if B else None
            self._made[B] = (many, *many.buffer()) if many is not None else (None,)
        found = [np.empty((B, self._one.size1_out(i) * self._one.size2_out(i))) for i in range(self._one.n_out())]
        if B:
            _, buffer, run = self._made[B]
            given = [np.ascontiguousarray(a, dtype=float) for a in arguments]  # alive until the call is over
            for i, values in enumerate(given):
                buffer.set_arg(i, values.data)
            for i, values in enumerate(found):
                buffer.set_res(i, values.data)
            run()
        return found


def across(
    flow: Flow, states: np.ndarray, since: float, length: float, substeps: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends (B, n), F and Q (B, n, n) of one span from B states.

    Parameters
    ----------
    flow : of the plant
    states : (B, n), in state units
    since : when the span begins, in the unit of time; k in discrete time
    length : of the span, in the unit of time; a span of length 0 moves nothing
    substeps : of the span
    """
    B, n = states.shape
    if length == 0:
        return states, np.broadcast_to(np.eye(n), (B, n, n)), np.zeros((B, n, n))
    count = 1 if flow.discrete else 2 * substeps
    columns = flow.kept(("columns", count), lambda: Columns(flow.step, count))
    times = since + length * np.arange(count + 1) / count
    found = columns(states, np.tile(times[:-1], (B, 1)), np.full((B, count), length / count))
    nodes = np.concatenate([states[:, None], found[0].reshape(B, count, n)], axis=1)
    halves = np.swapaxes(found[1].reshape(B, count, n, n), 2, 3)
    at = slice(0, 1) if flow.discrete else slice(None)
    F, Q = combined(halves, _intensities(flow, nodes[:, at], times[at]), np.full(B, length))
    return nodes[:, -1], F, Q


def _intensities(flow: Flow, nodes: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(B, K, n, n) the noise at nodes (B, K, n) of B paths."""
    B, K, n = nodes.shape
    noise = flow.noise
    if not any(noise.jac_sparsity(0, i).nnz() for i in range(2)):
        constant = flow.kept("constant noise", lambda: flow.intensities(np.zeros((1, n)), np.zeros(1))[0])
        return np.broadcast_to(constant, (B, K, n, n))
    columns = flow.kept("noise columns", lambda: Columns(noise))
    found = columns(nodes.reshape(B * K, n), np.tile(times, B)[:, None])[0].reshape(B, K, n, n)
    return (found + np.swapaxes(found, 2, 3)) / 2
