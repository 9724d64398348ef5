"""Many targets for ever, from a file to a run folder: bounds and cycles against enumeration and closed forms."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import document, family_of
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status
from occontrol.families.athans.endless.bound import Shared, targets_of
from occontrol.scheduling.periodic.potential import cycle_of
from occontrol.scheduling.periodic.prices import best_prices
from tests.plain_cycles import mean_cost

THREE = """family: athans
name: three for ever
horizon: {infinite: true, step: 0.5}
resources:
  - {name: radar, capacity: 1}
target_models:
  aircraft:
    A: [[0, 1], [0, -0.5]]
    noise: {diag: [0.02, q]}
    initial: {covariance: {diag: [4, 1]}}
    running: {diag: [1, 0]}
  drifter: {A: [[0]], noise: [[q]], initial: {covariance: [[1]]}, running: [[1]]}
targets:
  - {table: {name: [a, b], q: [0.3, 1.0], r: [0.02, 0.05]}, model: aircraft}
  - {table: {name: [c], q: [0.5], r: [0.03]}, model: drifter, weight: 0.7}
looks:
  - {resource: radar, C: [[1, 0]], noise: [[r]], model: aircraft}
  - {resource: radar, C: [[1]], noise: [[r]], cost: 0.1, model: drifter}
method: {name: periodic, max_period: 6, max_nodes: 900, time_limit: null}
"""


def problem_of(text: str, folder: Path):
    """The problem in a text."""
    (folder / "problem.yaml").write_text(text, encoding="utf-8")
    return oc.read_problem(folder / "problem.yaml")


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory):
    """The problem of three targets and its solution."""
    problem = problem_of(THREE, tmp_path_factory.mktemp("three"))
    return problem, oc.solve(problem)


def enumerated(problem, longest: int) -> float:
    """The least cost of all joint cycles with one resource of one look."""
    targets, known, best = targets_of(problem), {}, np.inf
    for p in range(1, longest + 1):
        for looked in product(range(-1, problem.targets), repeat=p):
            total = 0.0
            for i, target in enumerate(targets):
                word = tuple(int(x == i) for x in looked)
                if (i, word) not in known:
                    cycle = cycle_of(target.letters, np.array(word))
                    known[i, word] = np.inf if cycle is None else cycle.cost
                total += known[i, word]
            best = min(best, total)
    return best


@pytest.mark.slow
def test_three_targets_have_the_best_cycle_and_a_bound_below_it(solved) -> None:
    problem, solution = solved
    best = enumerated(problem, 5)
    bounds = solution.numbers.bounds
    assert solution.cost == pytest.approx(best, rel=1e-9) and solution.numbers.period <= 12
    assert bounds["averaged"] < bounds["integer"] <= best and solution.certificate.relative_gap < 0.002
    assert solution.status is Status.FEASIBLE and "whole steps" in solution.message
    parts = solution.arrays["per_target_bound"]
    price = solution.arrays["prices"][0, 0]
    assert np.sum(parts) - price == pytest.approx(bounds["integer"], rel=1e-9) and price > 0
    assert np.sum(solution.arrays["per_target_cost"]) == pytest.approx(solution.cost, rel=1e-12)


def test_a_file_and_a_run_become_the_same_again(solved, tmp_path: Path) -> None:
    problem, solution = solved
    oc.write_run(tmp_path / "run", problem, solution)
    again, recorded = oc.read_run(tmp_path / "run")
    assert document(again) == document(problem)
    judged = oc.certify(again, recorded.schedule, family_of(again).claims_of(again, recorded))
    assert judged.status is solution.status and judged.cost == pytest.approx(solution.cost, rel=1e-12)
    assert judged.certificate.lower_bound == pytest.approx(solution.certificate.lower_bound, rel=1e-9)
    higher = family_of(again).claims_of(again, recorded)
    higher = type(higher)(higher.cost, 0.5 * (solution.cost + solution.certificate.lower_bound))
    assert "could be proven" in oc.certify(again, recorded.schedule, higher).message
    lines = dict(family_of(problem).summarise(problem, solution))
    assert "whenever looks begin and end" in lines["averaged bound"] and "at 3 targets" in lines["looks of radar"]
    assert dict(family_of(problem).describe(problem))["horizon"] == "looks last 0.5, for ever"
    figures = family_of(problem).figures(problem, solution)
    assert set(figures) == {"overview", "looks"} and all(figure.axes for figure in figures.values())


def test_anybodys_cycle_of_looks_is_judged(solved, tmp_path: Path) -> None:
    problem, solution = solved
    lines = ["start,end,resource,target", "0,0.5,radar,a", "0.5,1,radar,b", "1,1.5,radar,c"]
    (tmp_path / "s.csv").write_text("\n".join(lines), encoding="utf-8")
    judged = oc.certify(problem, oc.read_schedule(tmp_path / "s.csv", problem))
    expected = sum(
        mean_cost(target.letters, tuple(int(k == i) for k in range(3))) for i, target in enumerate(targets_of(problem))
    )
    assert (
        judged.numbers.period == 3 and judged.cost == pytest.approx(expected, rel=1e-9) and judged.cost >= solution.cost
    )
    (tmp_path / "s.csv").write_text("\n".join([*lines, "1,1.5,radar,a"]), encoding="utf-8")
    with pytest.raises(oc.ProblemError, match="resource 'radar' gives 2 looks at t = 1"):
        oc.certify(problem, oc.read_schedule(tmp_path / "s.csv", problem))


def test_shares_of_scalar_targets_cost_what_the_formula_says(tmp_path: Path) -> None:
    """K scalars that walk or settle: min sum w (a + sqrt(a^2 + q L v)) / (L v), sum v <= c, by one price."""
    from scipy.optimize import minimize

    a, q, r, w = [0.0, 0.2, -0.3, 0.1], [0.5, 0.2, 1.0, 0.4], [0.1, 0.3, 0.05, 0.2], [1.0, 2.0, 0.5, 1.5]
    text = f"""family: athans
name: scalars
horizon: {{infinite: true, step: 0.1}}
resources: [{{name: eye, capacity: 1}}]
target_models: {{m: {{A: [[a]], noise: [[q]], initial: {{covariance: [[1]]}}, running: [[1]]}}}}
targets: [{{table: {{a: {a}, q: {q}, r: {r}, w: {w}}}, model: m, weight: w}}]
looks: [{{resource: eye, C: [[1]], noise: [[r]]}}]
"""
    problem = problem_of(text, tmp_path)
    found = best_prices([Shared(t) for t in targets_of(problem)], np.ones(1), Monitor())
    A, Q, L, W = np.array(a), np.array(q), 1 / np.array(r), np.array(w)

    def f(v: np.ndarray) -> float:
        return float(np.sum(W * (A + np.sqrt(A**2 + Q * L * v)) / (L * v)))

    whole = [{"type": "eq", "fun": lambda v: np.sum(v) - 1}]
    options = {"ftol": 1e-14, "maxiter": 300}
    done = minimize(f, np.full(4, 0.25), bounds=[(1e-4, 1)] * 4, constraints=whole, method="SLSQP", options=options)
    assert found.lower_bound <= done.fun * (1 + 1e-9) and found.lower_bound == pytest.approx(done.fun, rel=3e-5)
    assert found.used[:, 0] == pytest.approx(done.x, abs=0.02)


WRONG = [
    (
        "{name: radar, capacity: 1}",
        '{name: radar, capacity: "1 + t"}',
        "capacity of resource 'radar' changes with t",
    ),
    ("noise: [[r]], model: a", 'noise: [["r*(1+t)"]], model: a', "changes with t\n  hint: for ever there is one plant"),
    ("{name: radar, capacity: 1}", "{name: radar, windows: [[0, 1]]}", "resource 'radar' has windows: looks for ever"),
    (
        "running: {diag: [1, 0]}",
        "running: {diag: [1, 0]}\n    output: [[1, 0]]",
        "output belongs to a horizon that ends",
    ),
    ("model: drifter, weight: 0.7", "model: drifter, windows: {radar: [[0, 1]]}", "targets for ever have no windows"),
    ("step: 0.5}", "step: 0.5, repeat: 2}", "repeat is for windows, which targets for ever do not have"),
    ("step: 0.5}", "step: -1}", "step is -1, it must be a time above 0"),
    ("name: periodic", "name: greedy", "periodic"),
]


@pytest.mark.parametrize(("old", "new", "said"), WRONG)
def test_what_is_wrong_is_said_with_its_place(old: str, new: str, said: str, tmp_path: Path) -> None:
    assert THREE.count(old) >= 1
    with pytest.raises(oc.ProblemError, match=said) as error:
        problem_of(THREE.replace(old, new, 1), tmp_path)
    assert "problem.yaml:" in str(error.value)


def test_what_is_not_done_for_targets_for_ever_is_refused(solved, tmp_path: Path) -> None:
    problem, solution = solved
    for method in ("greedy", "largest-trace"):
        with pytest.raises(oc.UsageError, match=f"{method} does not do targets for ever"):
            oc.solve(problem, method)
    with pytest.raises(oc.UsageError, match="simulate does not do targets for ever"):
        oc.simulate(problem, solution, 1)
    blind = THREE.replace("A: [[0]]", "A: [[0.2]]").replace("C: [[1]], noise", "C: [[0]], noise")
    with pytest.raises(oc.InfeasibleError, match="target 'c': no schedule keeps the covariance bounded"):
        oc.solve(problem_of(blind, tmp_path))
