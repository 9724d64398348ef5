"""TEMPORARY: a family module of functions seen as a Family, until it has a FAMILY of its own; then this file goes."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

from occontrol.core.result import PlainResult
from occontrol.families.family import Ability, Family

_FUNCTIONS = {
    Ability.CERTIFY: "certify", Ability.SIMULATE: "simulate", Ability.FILTER: "run_filter", Ability.ONLINE: "online",
    Ability.TRADEOFF: "tradeoff",
}  # fmt: skip


@functools.cache
def adapted(name: str, module: ModuleType) -> Family:
    """The module of functions as a Family."""
    return _ModuleFamily(name, module)


class _ModuleFamily(Family):
    def __init__(self, name: str, module: ModuleType):
        from occontrol.families import title

        own: Any = self
        own.name, own.module, own.title = name, module, title(name)
        own.methods, own.compared = module.METHODS, module.COMPARE
        own.columns = getattr(module, "COLUMNS", ())
        can = {ability for ability, function in _FUNCTIONS.items() if hasattr(module, function)}
        own.abilities = frozenset(can | {Ability.COMPARE})
        own.problem_type, own.result_type = module.Problem, PlainResult
        own.drawing = importlib.import_module(f"occontrol.families.{name}.figures")

    def solve(self, problem, method, monitor):
        return self.module.solve(problem, method, monitor)

    def describe(self, problem):
        return self.module.describe(problem)

    def summarise(self, problem, solution):
        return self.module.summarise(problem, solution)

    def schema(self):
        return importlib.import_module(f"occontrol.families.{self.name}.schema")

    def figures(self, problem, solution):
        return self.drawing.draw(problem, solution)

    def compare_figure(self, problem, solutions: Mapping):
        return self.drawing.draw_compare(problem, solutions) if hasattr(self.drawing, "draw_compare") else None

    def estimate_figures(self, problem, solution, estimate, truth=None):
        own = getattr(self.drawing, "draw_estimate", super().estimate_figures)
        return own(problem, solution, estimate, truth)

    def method_named(self, problem, name):
        special = getattr(self.module, "method_named", None)
        return None if special is None else special(problem, name)

    def compare_names(self, problem):
        special = getattr(self.module, "compare_names", None)
        return list(self.compared) if special is None else special(problem)

    def require_feasible(self, problem):
        if hasattr(problem, "require_feasible"):
            problem.require_feasible()

    def mistakes(self, problem, method):
        return super().mistakes(problem, method) if hasattr(method, "check") else []

    def truth_remark(self, estimate, truth, source):
        return getattr(self.module, "truth_remark", super().truth_remark)(estimate, truth, source)

    def certify(self, problem, schedule, claims=None):
        return self.module.certify(problem, schedule, claims)

    def claims_of(self, problem, solution):
        special = getattr(self.module, "claims_of", None)
        return None if special is None else special(problem, solution)

    def simulate(self, problem, solution, seed):
        return self.module.simulate(problem, solution, seed)

    def run_filter(self, problem, solution, measurements: Sequence, **options):
        return self.module.run_filter(problem, solution, measurements, **options)

    def online(self, problem, solution=None, method=None):
        return self.module.online(problem) if method is None else self.module.online(problem, method)
