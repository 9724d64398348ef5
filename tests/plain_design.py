"""Random experiments of continuous sensing without a prior, and what their schedules cost: no code of the product."""

from __future__ import annotations

import copy
import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm

from tests.plain_criteria import plain_criterion
from tests.plain_readings import PlainReadings, evaluated, random_document
from tests.plain_rules_of_readings import PlainRules, with_rules
from tests.scheduling.rules.enumeration import Small, allowed, measures, spent, switching, words
from tests.scheduling.rules.small_problems import small

CRITERIA = ("trace", "logdet", "largest-eigenvalue", "log-trace", "schatten")
NODES = 24  # of a rule on a quarter of an interval


@dataclass
class Experiment:
    """A problem file as data, and the same as plain numbers.

    Parameters
    ----------
    document : the problem file
    small : grid, rules and prices
    told : (N, M, n, n) the information of a sensor that is used for an interval
    output : (p, n) as a function of the state at the start
    alpha : cost_weight
    """

    document: dict[str, Any]
    small: Small
    told: np.ndarray
    output: np.ndarray
    alpha: float

    def value(self, word: list[tuple[int, ...]] | tuple[tuple[int, ...], ...]) -> float:
        """F of a word; inf where a direction is not seen."""
        chosen = list(word)
        shares = np.array([[float(j in s and measures(self.small, chosen, k, j)) for j in range(len(self.small.L))]
                           for k, s in enumerate(chosen)])  # fmt: skip
        criterion = self.criterion(shares)
        return self.alpha * spent(self.small, chosen) + criterion + switching(self.small, chosen)

    def criterion(self, shares: np.ndarray) -> float:
        """phi(F^-1) of shares (N, M)."""
        F = np.einsum("kj,kjab->ab", shares, self.told)
        scale = np.sqrt(np.diagonal(F))
        if not np.all(scale > 0) or np.linalg.cond(F / np.outer(scale, scale)) > 1e11:
            return np.inf
        half = np.linalg.inv(np.linalg.cholesky(F / np.outer(scale, scale))) / scale
        Z = self.output @ half.T
        return plain_criterion(self.document["objective"]["criterion"], Z @ Z.T, [])

    def optimum(self) -> tuple[float, int]:
        """The least F of all words that keep the rules, and how many have a finite one."""
        costs = [self.value(w) for w in words(self.small) if allowed(self.small, list(w))]
        finite = [c for c in costs if np.isfinite(c)]
        return min(finite, default=np.inf), len(finite)


def random_experiment(seed: int, most: int = 7, ruled: bool = True) -> Experiment:
    """An experiment with rules of every kind, or with none.

    Parameters
    ----------
    seed : of everything
    most : intervals
    ruled : whether there are rules
    """
    p, alpha, _ = small(seed, most)
    rng = np.random.default_rng((seed, 17))
    r, M, n = p.rules, len(p.L), int(rng.integers(1, 4))
    r["max_error"] = np.inf
    if not ruled:
        nothing, _, _ = small(seed, most)
        blank = {"min_on": 0.0, "max_on": np.inf, "min_off": 0.0, "warm": 0.0, "max_uses": np.inf, "max_time": np.inf,
                 "revisit": np.inf}  # fmt: skip
        r = nothing.rules | {key: [value] * M for key, value in blank.items()}
        r |= {"duty": [(np.inf, np.inf)] * M, "max_switches": None, "switch": np.zeros((M, M)), "start": 0.0,
              "delay": np.zeros((M, M)), "before": None, "max_observation": np.inf, "max_error": np.inf}  # fmt: skip
        p.rules = r
    A = np.zeros((n, n)) if rng.random() < 0.4 else 0.5 * rng.standard_normal((n, n))
    sensors: list[Any] = []
    forms = []
    for j in range(M):
        if p.idle[j]:
            sensors.append("idle")
            forms.append(None)
            continue
        rows, theta = int(rng.integers(1, 3)), float(10 ** rng.uniform(-1.5, 0.0))
        a, b, w = (rng.standard_normal((rows, n)).round(3) for _ in range(3))
        C = [[f"{a[i, c]}*cos({w[i, c]}*t) + {b[i, c]}*t*exp(-t/3)" for c in range(n)] for i in range(rows)]
        forms.append((a, b, w, theta))
        sensors.append({"name": f"s{j}", "C": C, "noise": (theta * np.eye(rows)).tolist(), "cost": float(p.rate[j])})
    output = rng.standard_normal((int(rng.integers(1, n + 1)), n))
    name = str(rng.choice(CRITERIA))
    criterion: dict[str, Any] = {"name": name, **({"p": 3} if name == "schatten" else {})}
    ends = p.times
    beyond = float(rng.choice([0.0, 0.6]))
    document: dict[str, Any] = {
        "family": "athans",
        "name": f"experiment {seed}",
        "horizon": {"edges": ends.tolist(), "predict_at": float(ends[-1] + beyond)},
        "plant": {"A": A.tolist(), "noise": np.zeros((n, n)).tolist(), "initial": {"covariance": "none"}},
        "sensors": sensors,
        "objective": {"cost_weight": alpha, "output": output.tolist(), "criterion": criterion},
        "method": {"name": "schedule", "exact": {"relative_gap": 1e-6, "max_nodes": 20000, "time_limit": 60}},
    }
    _with_rules(document, p)
    told = np.zeros((len(ends) - 1, M, n, n))
    x, weights = np.polynomial.legendre.leggauss(NODES)
    for k, (start, stop) in enumerate(itertools.pairwise(ends)):
        for part in range(4):
            h = (stop - start) / 4
            for t, weight in zip(start + h * (part + (x + 1) / 2), weights * h / 2, strict=True):
                across = expm(A * (t - ends[0]))
                for j, form in enumerate(forms):
                    if form is not None:
                        a, b, w, theta = form
                        H = (a * np.cos(w * t) + b * t * np.exp(-t / 3)) @ across
                        told[k, j] += weight / theta * H.T @ H
    last = output @ expm(A * (ends[-1] + beyond - ends[0]))
    return Experiment(document, p, told, last, alpha)


def _with_rules(document: dict[str, Any], p: Small) -> None:
    """Write the rules of a small problem into a problem file."""
    r, names = p.rules, ["idle" if idle else f"s{j}" for j, idle in enumerate(p.idle)]
    ends, constraints = p.times, {}
    own = {"min_on": "min_on", "max_on": "max_on", "min_off": "min_off", "warm": "warm_up", "max_uses": "max_uses",
           "max_time": "max_time", "revisit": "revisit"}  # fmt: skip
    for j, sensor in enumerate(document["sensors"]):
        if sensor == "idle":
            continue
        for key, word in own.items():
            value = r[key][j]
            if np.isfinite(value) and (value > 0 or key in ("max_time", "max_uses")):
                sensor[word] = int(value) if key == "max_uses" else float(value)
        window, most = r["duty"][j]
        if np.isfinite(window):
            sensor["duty"] = {"window": window, "time": most}
        closed = p.upper[:, j] == 0
        if np.any(closed):
            sensor["windows"] = [[float(ends[int(np.sum(closed))]), float(ends[-1])]]
    if r["max_switches"] is not None:
        constraints["max_switches"] = r["max_switches"]
    if p.select == 1:
        for key, word in (("switch", "switch_cost"), ("delay", "switch_delay")):
            table = {a: {b: float(r[key][i][j]) for j, b in enumerate(names) if j != i and r[key][i][j] > 0}
                     for i, a in enumerate(names)}  # fmt: skip
            table = {a: row for a, row in table.items() if row}
            if table:
                constraints[word] = table
        if r["before"] is not None:
            constraints["before"] = {"sensor": names[r["before"][0]], "for": r["before"][1]}
    else:
        document["select"] = p.select
        if r["start"]:
            constraints["switch_cost"] = r["start"]
    if r["enforce"]:
        constraints["after"] = "enforce"
    if np.isfinite(r["max_observation"]):
        constraints["max_observation_cost"] = r["max_observation"]
    if constraints:
        document["constraints"] = constraints


class BlindReadings(PlainReadings):
    """Costs of schedules of readings without a prior, by the information on the state at the start."""

    def __init__(self, document: dict[str, Any]):
        self.blind = document
        known = copy.deepcopy(document)
        n = len(document["objective"]["output"][0])
        known["plant"]["initial"]["covariance"] = np.eye(n).tolist()
        super().__init__(known)

    def cost(self, chosen: list[tuple[int, ...]]) -> float:
        """J of a schedule; inf where a direction is not seen."""
        d, o, variable = self.d, self.d["objective"], "k" if self.discrete else "t"
        n = len(self.S0)
        across, F, spent_ = np.eye(n), np.zeros((n, n)), 0.0
        if not self.discrete:
            across = self.gaps[0][0]
        for k, t in enumerate(self.times):
            for j in chosen[k]:
                sensor = self.sensors[j]
                H = np.array(evaluated(sensor["H" if self.discrete else "C"], variable, t), dtype=float) @ across
                F = F + H.T @ np.linalg.inv(np.array(sensor["R" if self.discrete else "noise"])) @ H
                spent_ += o["cost_weight"] * float(evaluated(sensor["cost"], variable, t))
            if not self.discrete:
                across = self.gaps[k + 1][0] @ across
            elif k < len(self.times) - 1 or o.get("at", "predicted") == "predicted":
                across = np.array(evaluated(d["plant"]["F"], "k", t), dtype=float) @ across
        if not self.discrete:
            across = self.gaps[len(self.times) + 1][0] @ across
        scale = np.sqrt(np.diagonal(F))
        if not np.all(scale > 0) or np.linalg.cond(F / np.outer(scale, scale)) > 1e11:
            return np.inf
        half = np.linalg.inv(np.linalg.cholesky(F / np.outer(scale, scale))) / scale
        Z = self._outputs(self.times[-1]) @ across @ half.T
        self.condition = float(np.linalg.cond(Z @ Z.T))
        return spent_ + plain_criterion(o.get("criterion", {"name": "trace"}), Z @ Z.T, [])


class BlindRules(PlainRules):
    """Rules on readings without a prior."""

    def __init__(self, document: dict[str, Any]):
        known = copy.deepcopy(document)
        n = len(document["objective"]["output"][0])
        known["plant"]["initial"]["covariance"] = np.eye(n).tolist()
        super().__init__(known)
        free = copy.deepcopy(document)
        free["objective"]["cost_weight"] = 0.0
        self.plain, self.error = BlindReadings(document), BlindReadings(free)


def blind_document(rng: np.random.Generator, most: int = 6) -> dict[str, Any]:
    """A problem of readings with rules and without a prior.

    Parameters
    ----------
    rng : of everything
    most : readings
    """
    while True:
        d = random_document(rng, most)
        if len(d["plant"]["initial"]["covariance"]) <= 3:
            break
    d = with_rules(rng, d)
    n = len(d["plant"]["initial"]["covariance"])
    d["plant"].pop("G", None)
    d["plant"]["Q" if "steps" in d["horizon"] else "noise"] = np.zeros((n, n)).tolist()
    d["plant"]["initial"]["covariance"] = "none"
    for key in ("running", "running_at"):
        d["objective"].pop(key, None)
    d["constraints"].pop("max_error", None)
    if d["objective"].get("minimise") == "observation":
        d["objective"]["minimise"] = "cost"
    name = str(rng.choice(CRITERIA))
    d["objective"]["criterion"] = {"name": name, **({"p": 3} if name == "schatten" else {})}
    return d
