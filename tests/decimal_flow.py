"""Costs of schedules in continuous time in 60 digits: exact flows of the covariance, no steps, no code of the product.

    [X; Y]' = [[A, Xi], [L, -A']] [X; Y],  S = X Y^-1

solves the Riccati equation S' = A S + S A' + Xi - S L S while one sensor is in use. Without a running weight. The flow
of a short time is taken from the exponential and doubled in the form

    S(h) = Q + F S (I + O S)^-1 F'

which loses no digits however precise a sensor is, while exp(M h) itself may grow by e^100000.
"""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np

from tests.decimal_recursion import DIGITS, Data, exact, exponential, inverse


class Flows:
    """Exact costs of schedules of one problem; `data.edges` plays no part.

    Parameters
    ----------
    data : Data without a running weight
    """

    def __init__(self, data: Data):
        if data.running is not None:
            raise ValueError("the exact flow has no running weight")
        self.data, self._known = data, {}
        with localcontext() as context:
            context.prec = DIGITS
            D = exact(data.output)
            self.start, self.W = exact(data.covariance), D.T @ D
            self.A, self.noise = exact(data.A), exact(data.noise)
            self.L = [C_t_C(C, theta, len(data.A)) for C, theta, _ in data.sensors]

    def flow(self, sensor: int, length: float) -> tuple[np.ndarray, ...]:
        """F, Q, O (n, n) of the header."""
        key = sensor, length
        if key not in self._known:
            with localcontext() as context:
                context.prec = 2 * DIGITS
                n, one = len(self.A), exact(np.eye(len(self.A)))
                M = np.block([[self.A, self.noise], [self.L[sensor], -self.A.T]]) * Decimal(length)
                halvings = max(0, int(np.ceil(np.log2(max(float(np.max(np.abs(M))), 1e-30)))) + 2)
                E = exponential(M / Decimal(2**halvings))
                back = inverse(E[n:, n:])
                F, Q, seen = back.T, E[:n, n:] @ back, back @ E[n:, :n]
                for _ in range(halvings):
                    middle = inverse(one + Q @ seen)
                    F, Q, seen = F @ middle @ F, Q + F @ middle @ Q @ F.T, seen + F.T @ seen @ middle @ F
                self._known[key] = F, Q, seen
        return self._known[key]

    def step(self, S: np.ndarray, sensor: int, length: float) -> tuple[np.ndarray, Decimal]:
        """Covariance after an interval and what its measurement costs."""
        F, Q, seen = self.flow(sensor, length)
        after = Q + F @ S @ inverse(exact(np.eye(len(S))) + seen @ S) @ F.T
        price = Decimal(float(self.data.cost_weight)) * Decimal(float(self.data.sensors[sensor][2]))
        return after, price * Decimal(length)

    def cost(self, choice: list[int], lengths: list[float]) -> Decimal:
        """J of a schedule: the sensor of each interval, and the intervals' lengths."""
        with localcontext() as context:
            context.prec = 2 * DIGITS
            S, total = self.start, Decimal(0)
            for sensor, length in zip(choice, lengths, strict=True):
                S, spent = self.step(S, sensor, length)
                total += spent
            return total + np.trace(self.W @ S)

    def optimum(self, lengths: list[float]) -> Decimal:
        """Least J of all schedules that use one sensor on each interval."""
        with localcontext() as context:
            context.prec = 2 * DIGITS
            known = [(self.start, Decimal(0))]
            for length in lengths:
                after = []
                for S, spent in known:
                    for j in range(len(self.L)):
                        later, more = self.step(S, j, length)
                        after.append((later, spent + more))
                known = after
            return min(spent + np.trace(self.W @ S) for S, spent in known)


def C_t_C(C: np.ndarray, theta: np.ndarray, n: int) -> np.ndarray:
    """C' Theta^-1 C, zero for a sensor without rows."""
    if not len(C):
        return exact(np.zeros((n, n)))
    rows = exact(C)
    return rows.T @ inverse(exact(theta)) @ rows
