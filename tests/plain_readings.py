"""Random problems of readings, their costs by a textbook filter, and all their schedules: no code of the product."""

from __future__ import annotations

from itertools import combinations, pairwise, product
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from tests.plain_criteria import counted, plain_criterion


def random_document(rng: np.random.Generator, most_readings: int = 6, budget: bool = False) -> dict[str, Any]:
    """A problem file with at most 5 states, 4 sensors and `most_readings` readings, small enough to enumerate."""
    n, M = int(rng.integers(1, 6)), int(rng.integers(1, 5))
    N = int(rng.integers(2, most_readings + 1))
    discrete = bool(rng.random() < 0.5)

    def covariance(size: int, scale: float, rank: int | None = None) -> list:
        root = rng.standard_normal((size, size if rank is None else rank)) * np.sqrt(scale / size)
        return (root @ root.T).tolist()

    times = np.arange(N, dtype=float) if discrete else np.sort(rng.choice(np.linspace(0, 3, 25), N, replace=False))
    sensors: list[Any] = []
    for j in range(M):
        m = int(rng.integers(1, min(n, 2) + 1))
        C, R = rng.standard_normal((m, n)).tolist(), (np.array(covariance(m, 0.3)) + 0.02 * np.eye(m)).tolist()
        cost: Any = float(np.round(rng.random() * 0.3, 3))
        if rng.random() < 0.2:
            cost = f"{cost} + 0.05*{'k' if discrete else 't'}"
        entry = {"name": f"s{j}", "cost": cost}
        entry |= {"H": C, "R": R} if discrete else {"C": C, "noise": R}
        if rng.random() < 0.3:
            first = int(rng.integers(0, N))
            entry["windows"] = [[float(times[first]), float(times[min(N - 1, first + int(rng.integers(1, N)))]) + 0.5]]
        sensors.append(entry)
    kind = rng.integers(0, 3)
    select: Any = int(rng.integers(1, min(M, 2) + 1))
    if kind == 0 or any("windows" in s for s in sensors):
        sensors.append("idle")
    elif kind == 1:
        select = [int(rng.integers(0, select)), select]
    objective: dict[str, Any] = {"cost_weight": float(np.round(rng.random() + 0.1, 2))}
    objective["output"] = rng.standard_normal((int(rng.integers(1, n + 1)), n)).tolist()
    running = rng.random() < 0.5
    if running:
        objective["running"] = covariance(n, 1.0)
    prior = covariance(n, float(10.0 ** rng.uniform(-1, 1)), None if rng.random() < 0.8 else 1)
    initial = {"mean": rng.standard_normal(n).tolist(), "covariance": prior}
    document: dict[str, Any] = {"family": "athans", "name": "random"}
    if discrete:
        F: list = (rng.standard_normal((n, n)) * 0.9 / np.sqrt(n)).tolist()
        if rng.random() < 0.4:
            F[0][0] = f"{F[0][0]} + 0.3*cos(k)"
        plant: dict[str, Any] = {"F": F, "Q": covariance(n, 0.3), "initial": initial}
        if rng.random() < 0.3:
            plant |= {"G": rng.standard_normal((n, 1)).tolist(), "Q": [[0.2]]}
        document["horizon"] = {"steps": N, "epoch": int(rng.integers(1, 3)) if rng.random() < 0.3 else 1}
        objective["at"] = str(rng.choice(["predicted", "posterior"]))
        if running:
            objective["running_at"] = str(rng.choice(["posterior", "prior"]))
    else:
        A: list = (rng.standard_normal((n, n)) / np.sqrt(n)).tolist()
        if rng.random() < 0.3:
            A[0][0] = f"{A[0][0]} + 0.4*sin(2*t)"
        plant = {"A": A, "noise": covariance(n, 0.3), "initial": initial}
        end = float(times[-1]) if rng.random() < 0.3 else 3.2
        document["horizon"] = {"start": 0.0, "end": end, "sample_times": times.tolist()}
        if rng.random() < 0.4:
            document["horizon"]["predict_at"] = end + 0.7
        document["sensing"] = "samples"
        if running:
            objective["running_at"] = str(rng.choice(["integral", "posterior", "prior"]))
    document |= {"plant": plant, "sensors": sensors, "select": select, "objective": objective}
    if budget:
        document["horizon"].pop("epoch", None)
        b = int(rng.integers(0, N + 1))
        document["budget"] = {"total": b} if rng.random() < 0.5 else {f"s{int(rng.integers(0, M))}": min(b, 2)}
    return document


def evaluated(value: Any, name: str, at: float) -> Any:
    """A number, formula or nested list of them at a time."""
    if isinstance(value, list):
        return [evaluated(each, name, at) for each in value]
    if isinstance(value, str):
        return eval(value, {"cos": np.cos, "sin": np.sin, name: at})  # the tests' own strings
    return value


class PlainReadings:
    """Costs of schedules of a document of `random_document`.

    Parameters
    ----------
    document : the problem file as data
    """

    def __init__(self, document: dict[str, Any]):
        self.d = document
        self.discrete = "steps" in document["horizon"]
        h = document["horizon"]
        self.times = [float(k) for k in range(h["steps"])] if self.discrete else list(h["sample_times"])
        self.sensors = [s for s in document["sensors"] if s != "idle"]
        self.idle = "idle" in document["sensors"]
        self.S0 = np.array(document["plant"]["initial"]["covariance"])
        self.gaps: dict[int, tuple] = {}
        self.condition = 1.0
        if not self.discrete:
            stops = [h["start"], *self.times, h["end"], h.get("predict_at", h["end"])]
            for k, (a, b) in enumerate(pairwise(stops)):
                self.gaps[k] = self._flow(a, b)

    def _flow(self, a: float, b: float) -> tuple:
        """Phi, Q, M and c over [a, b]: exponentials of blocks for a constant plant, otherwise by an adaptive solver."""
        n = len(self.S0)
        noise = np.array(self.d["plant"]["noise"])
        R = np.array(self.d["objective"].get("running", np.zeros((n, n))))

        if not any(isinstance(x, str) for row in self.d["plant"]["A"] for x in row):
            A, h, zero, one = np.array(self.d["plant"]["A"], dtype=float), b - a, np.zeros((n, n)), np.eye(n)
            pieces = max(1, int(np.ceil(np.linalg.norm(A) * h)))
            h /= pieces
            E = expm(h * np.block([[-A.T, one, zero], [zero, -A.T, R], [zero, zero, A]]))
            V = expm(h * np.block([[-A, noise], [zero, A.T]]))
            F = E[2 * n :, 2 * n :]
            M, inside, Q = F.T @ E[n : 2 * n, 2 * n :], F.T @ E[:n, 2 * n :], F @ V[:n, n:]
            Phi, total, Ms, c = one, zero, zero, 0.0
            for _ in range(pieces):  # one piece after the other
                c += float(np.sum(M * total) + np.sum(noise * inside))
                Ms = Ms + Phi.T @ M @ Phi
                Phi, total = F @ Phi, F @ total @ F.T + Q
            return Phi, total, Ms, c

        def rate(t: float, y: np.ndarray) -> np.ndarray:
            A = np.array(evaluated(self.d["plant"]["A"], "t", t), dtype=float)
            P, Q, _ = (y[i * n * n : (i + 1) * n * n].reshape(n, n) for i in range(3))
            return np.concatenate(
                [(A @ P).ravel(), (A @ Q + Q @ A.T + noise).ravel(), (P.T @ R @ P).ravel(), [np.sum(R * Q)]]
            )

        y = np.concatenate([np.eye(n).ravel(), np.zeros(2 * n * n + 1)])
        if b > a:
            y = solve_ivp(rate, (a, b), y, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
        return (*(y[i * n * n : (i + 1) * n * n].reshape(n, n) for i in range(3)), float(y[-1]))

    def cost(self, chosen: list[tuple[int, ...]]) -> float:
        """J of a schedule: the sensors read at every instant."""
        d, o, variable = self.d, self.d["objective"], "k" if self.discrete else "t"
        S, total, peaks = self.S0, 0.0, []
        criterion = o.get("criterion", {"name": "trace"})
        R = np.array(o["running"]) if "running" in o else None
        where = o.get("running_at", "posterior" if self.discrete else "integral")
        if not self.discrete:
            S, charged = self._across(0, S, where == "integral")
            total += charged
        for k, t in enumerate(self.times):
            if R is not None and where == "prior":
                total += float(np.trace(R @ S))
            if counted(criterion, "prior", t):
                peaks.append(float(np.trace(self._outputs(t) @ S @ self._outputs(t).T)))
            for j in chosen[k]:
                sensor = self.sensors[j]
                C = np.array(evaluated(sensor["H" if self.discrete else "C"], variable, t), dtype=float)
                noise = np.array(sensor["R" if self.discrete else "noise"])
                K = S @ C.T @ np.linalg.inv(C @ S @ C.T + noise)
                left = np.eye(len(S)) - K @ C
                S = left @ S @ left.T + K @ noise @ K.T
                total += o["cost_weight"] * float(evaluated(sensor["cost"], variable, t))
            if R is not None and where == "posterior":
                total += float(np.trace(R @ S))
            if counted(criterion, "posterior", t):
                peaks.append(float(np.trace(self._outputs(t) @ S @ self._outputs(t).T)))
            if not self.discrete:
                S, charged = self._across(k + 1, S, where == "integral")
                total += charged
            elif k < len(self.times) - 1 or o.get("at", "predicted") == "predicted":
                F = np.array(evaluated(d["plant"]["F"], "k", t), dtype=float)
                G = np.array(d["plant"].get("G", np.eye(len(F))))
                S = F @ S @ F.T + G @ np.array(d["plant"]["Q"]) @ G.T
        D = self._outputs(self.times[-1])
        if not self.discrete:
            D = D @ self.gaps[len(self.times) + 1][0]
        value = plain_criterion(criterion, D @ S @ D.T, peaks)
        self.condition = float(np.linalg.cond(D @ S @ D.T))  # of X of the last schedule
        if "limit" in criterion:  # a constraint, and no part of the cost
            return total if value <= criterion["limit"] * (1 + 1e-9) else float("inf")
        return total + value

    def _outputs(self, t: float) -> np.ndarray:
        return np.array(self.d["objective"].get("output", np.eye(len(self.S0))), dtype=float)

    def _across(self, k: int, S: np.ndarray, charge: bool) -> tuple[np.ndarray, float]:
        Phi, Q, M, c = self.gaps[k]
        return Phi @ S @ Phi.T + Q, float(np.trace(M @ S)) + c if charge else 0.0

    def schedules(self):
        """Every legal schedule, as lists of tuples of sensors, one for every instant."""
        select = self.d["select"]
        least, most = select if isinstance(select, list) else (0 if self.idle else select, select)
        if "budget" in self.d:
            least = 0
        epoch = self.d["horizon"].get("epoch", 1)
        starts = range(0, len(self.times), epoch)
        ways = []
        for first in starts:
            steps = self.times[first : first + epoch]
            open_ = [
                j
                for j, s in enumerate(self.sensors)
                if all(any(a <= t <= b for a, b in s.get("windows", [[-1e9, 1e9]])) for t in steps)
            ]
            ways.append([c for size in range(least, most + 1) for c in combinations(open_, size)])
        for choice in product(*ways):
            whole = [choice[k // epoch] for k in range(len(self.times))]
            if all(self._used(whole, key) == b for key, b in self.d.get("budget", {}).items()):
                yield whole

    def _used(self, whole: list[tuple[int, ...]], key: str) -> int:
        """How many readings a schedule takes of a sensor, or of all."""
        names = [self.sensors[j]["name"] for chosen in whole for j in chosen]
        return len(names) if key == "total" else names.count(key)

    def count(self) -> int:
        """How many schedules there are."""
        return sum(1 for _ in self.schedules())
