"""What a family of problems is to the rest of the house: one object with declared abilities.

`families/<name>/family.py` holds `FAMILY`, of a subclass of `Family`. `abilities` says what it can do; what is not
declared there raises UsageError with one sentence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, Protocol

from occontrol.core.claims import Claims
from occontrol.core.conversion import Asked
from occontrol.core.errors import Mistake, UsageError
from occontrol.core.kinds import PlainDict
from occontrol.core.measurement import OnlineLoop
from occontrol.core.method import Method, options_in_common
from occontrol.core.problem import BaseProblem
from occontrol.core.result import ResultData
from occontrol.core.solution import Tradeoff
from occontrol.core.trajectory import Trajectory
from occontrol.families.abilities import Ability
from occontrol.families.closed_loop import ClosedLoop

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

    from matplotlib.figure import Figure

    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.monitor import Monitor
    from occontrol.core.schedule import Schedule
    from occontrol.core.solution import Solution
    from occontrol.core.target import TargetPlan
    from occontrol.files.page import Group, Table

NOTHING = Asked()


class Family(ClosedLoop, Protocol):
    """One family of problems.

    Attributes
    ----------
    name : as in `family: NAME` of a problem file
    title : one line
    methods : {name: frozen dataclass of options}, see core/method.py; the first is the default
    further_methods : methods of some of its problems only, {name: class}; problem files may name them
    compared : the method names that `compare` runs when none are given
    columns : the numbers of a result that the table of `compare` shows; empty: cost, bound and gap
    abilities : what it can do beside solve, describe, summarise and draw
    filter_options : the options of `run_filter`
    compared_curve : arrays of times and values of one curve of a solution, and what it is, that methods are compared by
    estimate_band : half width of an estimate's bands, in standard deviations, and what they are in words
    begins_anew : why a solve that is resumed begins anew; empty where a method can go on from an earlier solution
    seed_paths : the keys of a problem file that hold seeds of random numbers
    problem_type : the frozen dataclass of its problems (with `name`, `family`, `method`)
    result_type : the frozen dataclass of its results, with `as_dict` and `from_dict` (core/result.py)
    """

    name: ClassVar[str]
    title: ClassVar[str]
    methods: ClassVar[Mapping[str, type]]
    further_methods: ClassVar[Mapping[str, type]] = {}
    compared: ClassVar[Sequence[str]]
    columns: ClassVar[Sequence[str]] = ()
    abilities: ClassVar[frozenset[Ability]]
    filter_options: ClassVar[Sequence[str]] = ()
    compared_curve: ClassVar[tuple[str, str, str] | None] = None
    estimate_band: ClassVar[tuple[float, str]] = (2.0, "two standard deviations")
    begins_anew: ClassVar[str] = ""
    seed_paths: ClassVar[Sequence[str]] = ()
    problem_type: ClassVar[type]
    result_type: ClassVar[type]

    # ---- every family

    def solve(self, problem: BaseProblem, method: Method, monitor: Monitor) -> Solution:
        """Solve `problem` with `method`, an object of one of `methods`, under the eyes of `monitor`."""
        ...

    def describe(self, problem: BaseProblem) -> list[tuple[str, str]]:
        """(label, text) lines that `check` prints."""
        ...

    def summarise(self, problem: BaseProblem, solution: Solution) -> list[tuple[str, str]]:
        """(label, text) lines that the command line and the report print after a solve."""
        ...

    def schema(self) -> ModuleType:
        """The module with `Document` (pydantic), `build(document, context)` and `document(problem)`."""
        ...

    def figures(self, problem: BaseProblem, solution: Solution) -> dict[str, Figure]:
        """Every figure of a solution by name, the most telling first."""
        ...

    def compare_figure(self, problem: BaseProblem, solutions: Mapping[str, Solution]) -> Figure | None:
        """One figure of several solutions by method name, or None."""
        return None

    def estimate_figures(
        self, problem: BaseProblem, solution: Solution, estimate: Estimate, truth: Trajectory | None = None
    ) -> dict[str, Figure]:
        """The figures of an estimate by name."""
        from occontrol.files.figures.estimates import draw
        return draw(problem, solution, estimate, truth)

    def groups(self, problem: BaseProblem, solution: Solution) -> list[Group]:
        """What the page of a solution draws: panels over one axis of time, in groups that zoom together."""
        from occontrol.files.page import usual
        return usual.usual_groups(problem, solution)

    def tables(self, problem: BaseProblem, solution: Solution) -> list[Table]:
        """Tables of the page of a solution, beside those of its schedule and its sensors."""
        return []

    def method_named(self, problem: BaseProblem, name: str) -> Method | None:
        """The method that carries an argument in its name, such as fixed:radar; None for any other name."""
        return None

    def compare_names(self, problem: BaseProblem) -> list[str]:
        """The method names that `compare` runs on `problem` when none are given."""
        return list(self.compared)

    def require_feasible(self, problem: BaseProblem) -> None:
        """Raise InfeasibleError where it can be seen without solving that no schedule exists."""
        return None

    def warnings(self, problem: BaseProblem) -> list[Mistake]:
        """What `problem` says that is allowed and hardly meant, with paths in its document."""
        return []

    def mistakes(self, problem: BaseProblem, method: Method) -> list[Mistake]:
        """What is wrong with the options of `method` for `problem`, paths below the problem; nothing is solved."""
        return [mistake.under("method") for mistake in method.check(problem) or ()]

    def truth_remark(self, estimate: Estimate, truth: Trajectory, source: object) -> str:
        """One sentence on an estimate beside the true states; `source` is the file they came from."""
        from occontrol.files.figures.estimates import truth_remark
        return truth_remark(estimate, truth, source)

    def filter_tables(self, problem: BaseProblem, solution: Solution) -> PlainDict:
        """Arrays {name: array} from which another program runs the filter; empty where there are none."""
        return {}

    def target_plan(self, problem: BaseProblem, solution: Solution) -> TargetPlan:
        """The schedule, and the filter along it where there is one, for code on a target.

        Parameters
        ----------
        problem, solution : of the run

        Raises UsageError where the family has nothing that another computer could follow.
        """
        raise UsageError(f"family {self.name} has no schedule and no filter for a target")

    def converted(self, problem: BaseProblem, family: str, asked: Asked = NOTHING) -> tuple[PlainDict, list[str]]:
        """The problem as a document of another family, and sentences on what is left behind.

        Parameters
        ----------
        problem : of this family
        family : name of the other one
        asked : what the user adds where this family does not know what the other one needs

        Raises UsageError for families that have no common ground with this one.
        """
        raise UsageError(f"a problem of family {self.name} does not become one of family {family}")

    # ---- what `abilities` declares

    def certify(self, problem: BaseProblem, schedule: Schedule, claims: Claims | None = None) -> Solution:
        """Cost, lower bound and gap of anybody's schedule."""
        self._cannot(Ability.CERTIFY)

    def claims_of(self, problem: BaseProblem, solution: Solution) -> Claims | None:
        """What a run says of its schedule, for `certify` to check; None where it says nothing."""
        return None

    def simulate(
        self, problem: BaseProblem, solution: Solution | None, seed: int
    ) -> tuple[list[Measurement], Trajectory]:
        """A true trajectory and what the scheduled sensors report of it."""
        self._cannot(Ability.SIMULATE)

    def run_filter(
        self, problem: BaseProblem, solution: Solution, measurements: Sequence[Measurement], **options: object
    ) -> Estimate:
        """The estimate that the schedule's filter makes of measurements."""
        self._cannot(Ability.FILTER)

    def online(
        self, problem: BaseProblem, solution: Solution | None = None, method: Method | None = None
    ) -> OnlineLoop:
        """The object for a loop on a target: `step(measurements) -> Step` (core/measurement.py)."""
        self._cannot(Ability.ONLINE)

    def filter_loop(self, problem: BaseProblem, solution: Solution, **options: object) -> OnlineLoop:
        """The filter of `run_filter`, step by step, with the same options.

        Parameters
        ----------
        problem, solution : of the run
        options : as of `run_filter`

        Raises UsageError for an option that the family does not have.
        """
        if options:
            raise UsageError(f"the filter of family {self.name} has no {', '.join(options)}")
        return self.online(problem, solution)

    def tradeoff(self, problem: BaseProblem, cost_weights: Sequence[float], monitor: Monitor) -> Tradeoff:
        """The certified front of observation cost against prediction error."""
        self._cannot(Ability.TRADEOFF)

    def budgets(self, problem: BaseProblem, caps: Sequence[float], monitor: Monitor) -> Tradeoff:
        """The certified front of prediction error over caps on the observation cost."""
        self._cannot(Ability.TRADEOFF)

    def write_tradeoff(self, folder: Path, front: Tradeoff, figures: bool = True) -> list[Path]:
        """Write what `tradeoff` returned to a folder, with pictures if `figures`; the files written."""
        self._cannot(Ability.TRADEOFF)

    def sensitivity(
        self, problem: BaseProblem, solution: Solution | None, monitor: Monitor, change: float | None = None
    ) -> ResultData:
        """What the optimal cost would change by; with `change` also between proven bounds, by solving again."""
        self._cannot(Ability.SENSITIVITY)

    def sensitivity_figure(self, found: ResultData) -> Figure:
        """A picture of what `sensitivity` found."""
        self._cannot(Ability.SENSITIVITY)

    # ---- what follows from the above

    def can(self, ability: Ability) -> bool:
        """Whether the family declares `ability`."""
        return ability in self.abilities

    def _cannot(self, ability: Ability) -> NoReturn:
        raise UsageError(f"family {self.name} cannot {ability}")

    def default_method(self) -> Method:
        """The first of `methods` with its default options."""
        return next(iter(self.methods.values()))()

    def choose(self, problem: BaseProblem, method: Method | str | None = None) -> Any:
        """The method object to run: the given one, the one of that name, the problem's own, or the default.

        Options that the problem states for its own method and that a named one has too, such as relative_gap, are
        kept. Raises UsageError for an unknown name and for a method of another family.
        """
        own = getattr(problem, "method", None)
        if method is None:
            return self.default_method() if own is None else own
        if isinstance(method, str):
            special = self.method_named(problem, method)
            if special is not None:
                return special
            if method not in self.methods:
                raise UsageError(f"family {self.name} has no method '{method}'\n  hint: {self._methods_hint(method)}")
            kind = self.methods[method]
            return own if isinstance(own, kind) else kind(**options_in_common(own, kind))
        if type(method) not in self.methods.values():
            what = f"{_described(method)} is not a method of family {self.name}"
            raise UsageError(f"{what}\n  hint: {self._python_hint()}")
        return method

    def _methods_hint(self, name: str) -> str:
        from occontrol.core.errors import suggest

        return suggest(name, self.methods)

    def _python_hint(self) -> str:
        made = ", ".join(kind.__name__ + "()" for kind in self.methods.values())
        return f"there are: {', '.join(self.methods)}; in Python occontrol.{self.name}.{made}"


def _described(method: Method) -> str:
    """What a caller gave as a method: "Random of family athans", or its type."""
    kind = method if isinstance(method, type) else type(method)
    home = kind.__module__.split(".")
    owner = f" of family {home[2]}" if home[:2] == ["occontrol", "families"] and len(home) > 3 else ""
    return f"{'the class ' if isinstance(method, type) else ''}{kind.__name__}{owner}"
