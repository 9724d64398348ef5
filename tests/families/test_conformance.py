"""What every family promises (families/family.py), asked of every family in the table."""

from __future__ import annotations

import functools
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import occontrol as oc
from occontrol.api import choose_method, compare_figure, document, estimate_figures, family_of, sensitivity
from occontrol.core.result import ResultData
from occontrol.core.solution import Solution, Status
from occontrol.families import find_family, names, template, title
from occontrol.families.family import Ability, Family
from occontrol.files.plain_json import plain, to_json
from occontrol.files.tables import write_measurements

FAMILIES = names()
# of the templates that are too large for every method to take a moment
SMALLER = {
    "athans": [("intervals: 200", "intervals: 24")],
    "vlambda": [("steps: 120", "steps: 30")],
    "hybrid": [("steps: 60", "steps: 12"), ("runs: 100", "runs: 20")],
    "precision": [],
    "robust": [("slots: 8", "slots: 3"), ("samples: 20", "samples: 4"), ('"-1-0.2*sin(3*t)"', "-1")],
}
# methods that reach the target gap on the template; of vlambda's movable sensor and of hybrid runs nothing is proven
PROVES: dict[str, set[str]] = {
    "athans": {"schedule", "relaxed"},
    "vlambda": set(),
    "hybrid": set(),
    "precision": {"barrier", "clarabel"},
    "robust": {"optimal", "all", "relaxed"},
}
# methods that do nothing without an option
NEEDS = {("robust", "fixed"): {"sequence": "position"}}
CALLS = {
    Ability.CERTIFY: lambda p, s: oc.certify(p, s.schedule),
    Ability.SIMULATE: lambda p, s: oc.simulate(p, s),
    Ability.FILTER: lambda p, s: oc.run_filter(p, s, []),
    Ability.ONLINE: lambda p, s: oc.online(p, s),
    Ability.TRADEOFF: lambda p, s: oc.tradeoff(p, [0.1]),
    Ability.SENSITIVITY: lambda p, s: sensitivity(p, s),
}
METHODS_OF_ABILITY = {
    Ability.CERTIFY: "certify", Ability.SIMULATE: "simulate", Ability.FILTER: "run_filter", Ability.ONLINE: "online",
    Ability.TRADEOFF: "tradeoff", Ability.SENSITIVITY: "sensitivity",
}  # fmt: skip


def text_of(family: str) -> str:
    """The family's template, made small."""
    text = template(family).read_text(encoding="utf-8")
    for old, new in SMALLER.get(family, []):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def problems(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The small template problem of every family."""
    folder, found = tmp_path_factory.mktemp("templates"), {}
    for family in FAMILIES:
        path = folder / f"{family}.yaml"
        path.write_text(text_of(family), encoding="utf-8")
        found[family] = oc.read_problem(path)
    return found


@pytest.fixture(scope="module")
def solved(problems: dict[str, Any]):
    """solved(family, method): found once."""

    @functools.cache
    def solve(family: str, method: str | None = None) -> Solution:
        kind = find_family(family).methods.get(method)
        options = NEEDS.get((family, method))
        return oc.solve(problems[family], method if options is None else kind(**options))

    return solve


def all_methods() -> list[tuple[str, str]]:
    """(family, method name) of every method of every family."""
    return [(family, method) for family in FAMILIES for method in find_family(family).methods]


# ---- the table


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_is_what_the_table_says(name: str, problems: dict[str, Any]) -> None:
    family = find_family(name)
    assert Family in type(family).__mro__
    assert family.name == name and family.title == title(name)
    assert family_of(problems[name]) is family and isinstance(problems[name], family.problem_type)
    assert {kind.name for kind in family.methods.values()} == set(family.methods)
    assert family.compared and set(family.compared) <= set(family.methods)
    assert issubclass(family.result_type, ResultData)
    assert document(problems[name])["family"] == name


def test_an_unknown_family_is_refused_by_name() -> None:
    with pytest.raises(oc.UsageError, match=r"there is no family 'rebust'\n  hint: did you mean 'robust'\?"):
        find_family("rebust")


def test_what_is_no_problem_is_refused_by_its_type() -> None:
    with pytest.raises(oc.UsageError, match="dict is not a problem of any family"):
        oc.solve({"family": "athans"})


# ---- methods


@pytest.mark.parametrize(("family", "method"), all_methods())
def test_every_method_solves_the_template(family: str, method: str, problems: dict[str, Any], solved) -> None:
    solution = solved(family, method)
    assert solution.family == family and solution.method == method
    # a family may solve on more edges than were asked for, and says so
    assert solution.problem is problems[family] or solution.problem.added_edges
    assert solution.status is (Status.CERTIFIED if method in PROVES[family] else Status.FEASIBLE)
    kind = find_family(family).result_type
    assert isinstance(solution.numbers, kind)
    assert kind.from_dict(solution.result).as_dict() == solution.numbers.as_dict() == dict(solution.result)
    with pytest.raises(TypeError):
        solution.result["cost"] = 0.0
    again = pickle.loads(pickle.dumps(solution))
    assert to_json(again.as_dict()) == to_json(solution.as_dict())
    if solution.certificate is not None:
        assert solution.certificate.lower_bound <= solution.certificate.cost


@pytest.mark.parametrize("family", FAMILIES)
def test_the_first_method_is_the_default(family: str, problems: dict[str, Any]) -> None:
    assert type(find_family(family).default_method()) is next(iter(find_family(family).methods.values()))
    assert choose_method(problems[family]) == problems[family].method


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("other", FAMILIES)
def test_a_method_of_another_family_is_refused(family: str, other: str, problems: dict[str, Any]) -> None:
    if family == other:
        return
    for name, kind in find_family(other).methods.items():
        foreign = kind(**NEEDS.get((other, name), {}))
        with pytest.raises(oc.UsageError) as error:
            oc.solve(problems[family], foreign)
        said = str(error.value)
        assert said.startswith(f"{kind.__name__} of family {other} is not a method of family {family}\n")
        assert "there are: " + ", ".join(find_family(family).methods) in said
        assert error.value.exit_code == 2


def test_a_class_or_anything_else_is_no_method(problems: dict[str, Any]) -> None:
    with pytest.raises(oc.UsageError, match="the class Random of family athans is not a method of family athans"):
        oc.solve(problems["athans"], oc.Random)
    with pytest.raises(oc.UsageError, match="int is not a method of family robust"):
        oc.solve(problems["robust"], 3)


@pytest.mark.parametrize("family", FAMILIES)
def test_an_unknown_name_is_refused_before_any_work(family: str, problems: dict[str, Any]) -> None:
    with pytest.raises(oc.UsageError, match=f"family {family} has no method '12345'\n  hint: there are: "):
        oc.solve(problems[family], "12345")


# ---- options


@pytest.mark.parametrize(("family", "method"), all_methods())
def test_an_unknown_option_is_placed_in_the_file(family: str, method: str, tmp_path: Path) -> None:
    lines = text_of(family).split("\n")
    at = next(i for i, line in enumerate(lines) if line.startswith("method:"))
    lines[at] = f"method: {{name: {method}, warp: 3}}"
    (tmp_path / "x.yaml").write_text("\n".join(lines[: at + 1]) + "\n", encoding="utf-8")
    with pytest.raises(oc.ProblemError, match=rf"x\.yaml:{at + 1}:\d+: unknown option 'warp' of method '{method}'"):
        oc.read_problem(tmp_path / "x.yaml")


@pytest.mark.parametrize(("family", "method"), all_methods())
@pytest.mark.parametrize("value", [-1.0, 0.0, float("nan"), "much"])
@pytest.mark.parametrize("option", ["relative_gap", "time_limit"])
def test_a_gap_or_limit_that_makes_no_sense_is_refused_when_the_method_is_made(
    family: str, method: str, option: str, value: Any
) -> None:
    kind = find_family(family).methods[method]
    if option not in kind.__dataclass_fields__:
        return
    if option == "relative_gap" and value == 0:  # some searches are exact
        return
    with pytest.raises(oc.ProblemError, match=f"{option}") as error:
        kind(**{option: value})
    assert error.value.mistakes[0].path == (option,) and error.value.exit_code == 3


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{name: round-robin, dwell: 0}", "dwell of method round-robin is 0\n  hint: a whole number of at least 1"),
        ("{name: round-robin, dwell: -3}", "dwell of method round-robin is -3\n  hint: a whole number of at least 1"),
        ("{name: relaxed, max_iterations: -5}", "max_iterations of method relaxed is -5"),
        ("{name: hminimal, start: nowhere}", "start of method hminimal is 'nowhere'\n  hint: one of: best-single"),
    ],
)
def test_options_in_a_file_are_refused_at_their_place(line: str, said: str, tmp_path: Path) -> None:
    lines = text_of("athans").split("\n")
    at = next(i for i, text in enumerate(lines) if text.startswith("method:"))
    lines[at] = f"method: {line}"
    (tmp_path / "x.yaml").write_text("\n".join(lines[: at + 1]) + "\n", encoding="utf-8")
    with pytest.raises(oc.ProblemError) as error:
        oc.read_problem(tmp_path / "x.yaml")
    column = len("method: {name: ") + line.index(":", line.index(",")) + 2 - len("{name: ") + 1
    assert str(error.value).startswith(f"{tmp_path / 'x.yaml'}:{at + 1}:{column}: {said}")


# ---- abilities


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("ability", list(CALLS))
def test_what_is_declared_works_and_what_is_not_is_refused(
    family: str, ability: Ability, problems: dict[str, Any], solved
) -> None:
    found = find_family(family)
    name = METHODS_OF_ABILITY[ability]
    assert found.can(ability) == (getattr(type(found), name) is not getattr(Family, name))
    if found.can(ability):
        assert CALLS[ability](problems[family], solved(family)) is not None
        return
    able = ", ".join(name for name in FAMILIES if find_family(name).can(ability))
    with pytest.raises(oc.UsageError) as error:
        CALLS[ability](problems[family], solved(family))
    assert str(error.value) == f"family {family} cannot {ability}\n  hint: these can: {able}"


@pytest.mark.parametrize("family", FAMILIES)
def test_solve_certify_plot(family: str, problems: dict[str, Any], solved) -> None:
    problem, solution = problems[family], solved(family)
    if find_family(family).can(Ability.CERTIFY):
        judged = oc.certify(problem, solution.schedule, find_family(family).claims_of(problem, solution))
        # athans alone has a bound of its own within the target; vlambda's template is movable, robust's is not relaxed
        assert judged.status is (Status.CERTIFIED if family == "athans" else Status.FEASIBLE)
        assert abs(judged.cost - solution.cost) <= 1e-9 * abs(solution.cost)
        if family != "vlambda":  # its template has a movable sensor, of which nothing is proven
            assert judged.certificate is not None and judged.certificate.lower_bound <= solution.cost * (1 + 1e-9)
    drawn = oc.plot(solution)
    assert isinstance(drawn, dict) and drawn
    first = next(iter(drawn))
    assert oc.plot(solution, problem, first).axes
    with pytest.raises(oc.UsageError, match="there is no figure 'nothing'"):
        oc.plot(solution, figure="nothing")
    labels = [label for label, _ in find_family(family).summarise(problem, solution)]
    assert labels and len(set(labels)) == len(labels)
    assert find_family(family).describe(problem)
    if find_family(family).can(Ability.COMPARE):
        assert compare_figure(problem, {solution.method: solution}) is not None


@pytest.mark.parametrize("family", FAMILIES)
def test_simulate_filter_export_and_back(family: str, problems: dict[str, Any], solved, tmp_path: Path) -> None:
    problem, solution = problems[family], solved(family)
    content = oc.write_run(tmp_path / "run", solution.problem, solution)
    again, back = oc.read_run(tmp_path / "run")
    assert document(again) == document(solution.problem)
    assert type(back.numbers) is type(solution.numbers)
    assert {**back.as_dict(), "files": content["files"], "digest": content["digest"]} == plain(content)
    assert all(np.array_equal(back.arrays[name], value, equal_nan=True) for name, value in solution.arrays.items())
    for to in ("csv", "json", "npz", "mat", "c"):
        assert all(path.stat().st_size for path in oc.export_run(tmp_path / "run", to))
    if not {Ability.SIMULATE, Ability.FILTER} <= find_family(family).abilities:
        return
    measurements, truth = oc.simulate(again, back, seed=3)
    same, _ = oc.simulate(problem, solution, seed=3)
    assert [m.time for m in same] == [m.time for m in measurements]
    write_measurements(tmp_path / "z.csv", measurements)
    samples = oc.read_measurements(tmp_path / "z.csv", problem)
    estimate = oc.run_filter(again, back, samples)
    assert estimate.mean.shape == estimate.standard_deviation.shape and np.all(np.isfinite(estimate.mean))
    assert estimate_figures(problem, solution, estimate)
    if truth.values.shape[0] == len(estimate.times):
        assert "truth.csv" in find_family(family).truth_remark(estimate, truth, "truth.csv")
    with pytest.raises(oc.UsageError, match=f"the filter of family {family} has no option 'speed'"):
        oc.run_filter(problem, solution, samples, speed=2)


@pytest.mark.parametrize("family", [name for name in FAMILIES if find_family(name).can(Ability.CERTIFY)])
def test_a_wrong_schedule_is_refused_with_its_line(
    family: str, problems: dict[str, Any], solved, tmp_path: Path
) -> None:
    edges = solved(family).schedule.edges
    sensor = problems[family].sensors.names[0]
    half = (edges[0] + edges[-1]) / 2
    for rows, said in (
        ([f"{edges[0]:g},{edges[-1]:g},nobody"], r":2: there is no sensor 'nobody'"),
        ([f"{edges[0]:g},{half:g},{sensor}"], r":2: nothing is scheduled between"),
        ([f"{edges[0]:g},soon,{sensor}"], r":2: end is 'soon', it must be a finite number"),
    ):
        path = tmp_path / "s.csv"
        path.write_text("\n".join(["start,end,sensors", *rows]) + "\n")
        with pytest.raises(oc.ProblemError, match=r"s\.csv" + said):
            oc.certify(problems[family], oc.read_schedule(path, problems[family]))
