"""What must not change a whole solve of the athans family: clocks, units, costs, order, sensors that add nothing.

Every function returns a dict of the invariances that were tried: None where it holds, or what is wrong in words.

    clock, time     the same schedule costs the same to 1e-9, by recursion and check; both solves are compatible
                    (where rounding decides how many steps the accuracy takes, to the errors that they state)
    states          cost, bound and exact check of the whole solve to the last bit
    costs           the same schedule's cost to 1e-12
    order, twice, useless, irrelevant   both solves are compatible
    cut             an interval cut in two, with one decision: the same schedule costs the same; solves are compatible
    finer           every interval halved: the exact bounds lie below the exact costs, both ways
    command line    the numbers of `occontrol solve` and of the library, to the last bit
    certify         cost of the same schedule to 1e-12, bound below the cost of the other

Two solves are compatible when no bound, of grid or check, lies above a cost of the other, and relaxed costs differ by
less than their gaps. That much and no more is certain: rounding decides which schedule a search ends at.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from occontrol import certify, read_problem, solve
from occontrol.api.files import document
from occontrol.cli import run
from occontrol.core.errors import OccontrolError
from occontrol.core.problem import BaseProblem
from occontrol.core.schedule import Schedule
from occontrol.core.solution import Solution
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.problem import SchedulingProblem
from tests.decimal_problems import as_problem
from tests.decimal_recursion import Data

ORIGIN, UNIT = 1.7e9, 1e9
CHECK = 1e-9  # of J: what the exact check states at least
TIMED = ("seconds", "versions", "history", "digest", "files", "name")  # what a second run may say otherwise
MESHES = 5.0  # errors of integration by which costs on two meshes may differ


def far_problem(data: Data, origin: float, mode: str) -> SchedulingProblem:
    """The product's problem of plain data, for the modes "one step", "integrated" (no edge is added) and "default"."""
    problem = replace(as_problem(data), edges=origin + data.edges, predict_at=None)
    return problem if mode == "one step" else replace(problem, integration=Integration(refine=mode == "default"))


def coarse(edges: np.ndarray) -> np.ndarray:
    """Edges (N+1,) moved to multiples of 1/64, which a double at ORIGIN resolves without rounding."""
    return np.ceil(edges[-1] / (len(edges) - 1) * 64) / 64 * np.arange(len(edges))


def in_states(data: Data, factors: np.ndarray) -> Data:
    """The same problem in the states factors (n,) * x."""
    both = np.outer(factors, factors)
    sensors = [(C / factors, theta, q) for C, theta, q in data.sensors]
    running = None if data.running is None else data.running / both
    parts = {"noise": data.noise * both, "covariance": data.covariance * both, "output": data.output / factors}
    return replace(data, A=data.A * np.outer(factors, 1 / factors), sensors=sensors, running=running, **parts)


def in_time(data: Data, unit: float) -> Data:
    """The same problem with its clock in another unit."""
    sensors = [(C, theta * unit, q / unit) for C, theta, q in data.sensors]
    running = None if data.running is None else data.running / unit
    parts = {"A": data.A / unit, "noise": data.noise / unit, "edges": data.edges * unit}
    return replace(data, sensors=sensors, running=running, **parts)


def dearer(data: Data, factor: float) -> Data:
    """The same problem with the whole cost times factor^2."""
    running = None if data.running is None else data.running * factor**2
    return replace(data, output=data.output * factor, cost_weight=data.cost_weight * factor**2, running=running)


def permuted(data: Data, order: np.ndarray) -> Data:
    """The same problem with its states in another order (n,)."""
    both = np.ix_(order, order)
    sensors = [(C[:, order] if len(C) else C, theta, q) for C, theta, q in data.sensors]
    running = None if data.running is None else data.running[both]
    parts = {"noise": data.noise[both], "covariance": data.covariance[both], "output": data.output[:, order]}
    return replace(data, A=data.A[both], sensors=sensors, running=running, **parts)


def wider(data: Data) -> Data:
    """The same problem with one more state, which nothing sees and nothing depends on."""

    def bordered(matrix: np.ndarray, corner: float) -> np.ndarray:
        full = np.zeros((len(matrix) + 1, len(matrix) + 1))
        full[:-1, :-1], full[-1, -1] = matrix, corner
        return full

    rate = 1.0 / float(data.edges[-1])
    sensors = [(np.pad(C, ((0, 0), (0, 1))), theta, q) for C, theta, q in data.sensors]
    running = None if data.running is None else bordered(data.running, 0.0)
    parts = {"noise": bordered(data.noise, rate), "covariance": bordered(data.covariance, 1.0)}
    output = np.pad(data.output, ((0, 0), (0, 1)))
    return replace(data, A=bordered(data.A, -rate), sensors=sensors, running=running, output=output, **parts)


def slack(a: Solution) -> float:
    """By how much the numbers of a solution may be off: rounding, integration, and the exact check's own."""
    error = a.result["integration_error"]
    return a.result["allowance"] + (MESHES * error if np.isfinite(error) else 0.0) + CHECK * abs(a.result["cost"])


def same_cost(a: Solution, b: Solution, share: float, factor: float = 1.0, recursion: bool = True) -> str | None:
    """Whether the same schedule costs the same, by check and `recursion`; costs of `b` are `factor` times as large."""
    x, y = a.result["cost"], b.result["cost"] / factor
    allowed = share * abs(x) + a.result["allowance"] + b.result["allowance"] / factor
    room = allowed
    meshes = [(each.result["integration_steps"], len(each.problem.edges)) for each in (a, b)]
    if meshes[0] != meshes[1]:
        # other edges, or rounding decided how many steps the accuracy takes: what they state counts then
        room += MESHES * (a.result["integration_error"] + b.result["integration_error"] / factor)
    if recursion and abs(x - y) > room:
        return f"costs {x:.12g} and {y:.12g}, {abs(x - y) / abs(x):.2g} apart"
    if a.result["top"]["of"] == b.result["top"]["of"] == "continuous":
        x, y = a.result["top"]["cost"], b.result["top"]["cost"] / factor
        if abs(x - y) > allowed + 2 * CHECK * abs(x):
            return f"exact costs {x:.12g} and {y:.12g}, {abs(x - y) / abs(x):.2g} apart"
    return None


def compatible(a: Solution, b: Solution, same_grid: bool = True) -> str | None:
    """Whether no bound of either solution lies above a cost of the other, and relaxed costs agree.

    Two solutions may have added different edges: then bounds that hold for schedules on these edges do not compare.
    """
    room, size = slack(a) + slack(b), max(abs(a.result["cost"]), abs(b.result["cost"]))
    for x, y in ((a, b), (b, a)):
        if x.result["top"]["of"] == y.result["top"]["of"] == "continuous":
            over = x.result["top"]["lower_bound"] - y.result["top"]["cost"]
            if over > room:
                return f"the exact bound {x.result['top']['lower_bound']:.12g} is above a cost by {over / size:.2g}"
        if same_grid and x.result["lower_bound"] - y.result["cost"] > room:
            return f"the bound {x.result['lower_bound']:.12g} is above the cost {y.result['cost']:.12g}"
    if not same_grid or not all(str(s.status) == "certified" for s in (a, b)):
        return None
    gaps = sum(s.result["relaxed_cost"] - s.result["relaxed_lower_bound"] for s in (a, b))
    apart = abs(a.result["relaxed_cost"] - b.result["relaxed_cost"])
    return f"relaxed costs {apart / size:.2g} apart" if apart > gaps + room else None


def cut(data: Data, where: np.ndarray) -> Data:
    """The same problem with further edges in the middle of the intervals `where` (K,)."""
    middles = 0.5 * (data.edges[where] + data.edges[where + 1])
    return replace(data, edges=np.sort(np.append(data.edges, middles)))


def by_command_line(problem: BaseProblem) -> str | None:
    """Whether `occontrol solve --json` prints what the library finds for the same file."""
    out = io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem.json"
        file.write_text(json.dumps(document(problem)), encoding="utf-8")
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
            code = run(["solve", str(file), "--json", "--no-figures", "--out", str(Path(folder) / "run")])
        library = solve(read_problem(file))
    printed, found = json.loads(out.getvalue()), json.loads(json.dumps(plain(library.as_dict())))
    if code != library.status.exit_code:
        return f"exit code {code}, the library says {library.status}"
    wrong = [key for key, value in found.items() if key not in TIMED and not alike(printed.get(key), value)]
    return f"other values of {', '.join(wrong)}" if wrong else None


def plain(value: object) -> object:
    """Arrays and numbers of NumPy as lists and numbers of Python."""
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(each) for each in value]
    return value.item() if isinstance(value, np.generic) else value


def alike(a: object, b: object) -> bool:
    """Equal, where what is no number or infinite is written as null."""
    if isinstance(b, float) and not np.isfinite(b):
        return a is None or a == b
    if isinstance(a, dict) and isinstance(b, dict):
        return set(a) == set(b) and all(alike(a[key], b[key]) for key in b if key not in TIMED)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(alike(x, y) for x, y in zip(a, b, strict=True))
    return a == b


def numbers(a: Solution) -> tuple:
    """What must be the same to the last bit."""
    return a.result["cost"], a.result["lower_bound"], a.result["top"], a.result["relaxed_cost"]


def athans(rng: np.random.Generator, data: Data, origin: float, mode: str, unit: float = UNIT) -> dict[str, str | None]:
    """Which invariances hold for one problem."""
    found: dict[str, str | None] = {}

    def solved(data: Data, at: float = origin) -> Solution:
        return solve(far_problem(data, at, mode))

    def moved(a: Solution, edges: np.ndarray) -> Schedule:
        assert a.schedule is not None
        return Schedule(edges, a.schedule.weights, a.schedule.names)

    def one_grid(a: Solution, b: Solution) -> bool:
        return len(a.problem.edges) == len(b.problem.edges) == len(data.edges)

    def tried(name: str, judge) -> None:
        try:
            found[name] = judge()
        except OccontrolError as error:
            found[name] = f"refused: {str(error).splitlines()[0]}"

    first = solved(data)

    def states() -> str | None:
        other = solved(in_states(data, 2.0 ** rng.integers(-20, 21, len(data.A))))
        return None if numbers(other) == numbers(first) else f"{numbers(first)} and {numbers(other)}"

    def time() -> str | None:
        there = far_problem(in_time(data, unit), origin * unit, mode)
        edges = there.edges[0] + (first.schedule.edges - first.schedule.edges[0]) * unit
        edges[-1] = there.edges[-1]
        inside = np.searchsorted(first.schedule.edges, first.problem.edges[0] + data.edges)
        if len(data.edges) == len(edges):
            edges[inside] = there.edges
        return same_cost(certified(first), certify(there, moved(first, edges)), 1e-9) or compatible(
            first, other := solve(there), one_grid(first, other)
        )

    def clock() -> str | None:
        even = replace(data, edges=coarse(data.edges))
        a, b = solved(even), solved(even, ORIGIN)
        if len(a.problem.edges) == len(even.edges):
            there = certify(far_problem(even, ORIGIN, mode), moved(a, ORIGIN + a.schedule.edges))
            return same_cost(certified(a), there, 1e-9) or compatible(a, b, one_grid(a, b))
        return compatible(a, b, False)

    def certified(a: Solution) -> Solution:
        return certify(a.problem, a.schedule)

    def again() -> str | None:
        other = certified(first)
        return same_cost(first, other, 1e-12) or compatible(first, other)

    def costs() -> str | None:
        factor = 2.0 ** int(rng.integers(-9, 10)) * 1.25
        there = far_problem(dearer(data, factor), origin, mode)
        other = certify(there, first.schedule)
        return same_cost(certified(first), other, 1e-12, factor**2)

    def cut_once() -> str | None:
        # in one step an interval, two halves are another recursion: only the exact costs compare then
        there = cut(data, rng.integers(len(data.edges) - 1, size=1))
        again = certify(far_problem(there, origin, mode), first.schedule)
        apart = same_cost(certified(first), again, 1e-9, recursion=mode != "one step")
        return apart or compatible(first, solved(there), False)

    def finer() -> str | None:
        return compatible(first, solved(cut(data, np.arange(len(data.edges) - 1))), False)

    def against(other: Data) -> str | None:
        return compatible(first, b := solved(other), one_grid(first, b))

    tried("states", states)
    if origin == 0.0:
        tried("time", time)
    if origin == 0.0 and 0.1 < data.edges[-1] < 10.0:
        tried("clock", clock)
    tried("costs", costs)
    tried("certify", again)
    n, some = len(data.A), data.sensors
    tried("order", lambda: against(permuted(replace(data, sensors=[some[i] for i in (1, 0, 2)]), rng.permutation(n))))
    tried("twice", lambda: against(replace(data, sensors=[some[0], *some])))
    useless = (some[0][0], some[0][1] * 1e12, some[0][2] + 1.0 / data.edges[-1])
    tried("useless", lambda: against(replace(data, sensors=[useless, *some])))
    tried("irrelevant", lambda: against(wider(data)))
    tried("cut", cut_once)
    tried("finer", finer)
    tried("command line", lambda: by_command_line(first.problem))
    return found
