"""Optimal sensor scheduling, with a proven lower bound beside every schedule.

    import occontrol as oc
    problem = oc.read_problem("problems/attitude_telemetry.yaml")
    solution = oc.solve(problem)
    solution.certificate.relative_gap

Problems and methods of a family are found below its name: oc.robust.Optimal(), oc.vlambda.Random(). A name that only
one family has is found here as well: oc.Eigenspace(). A name that several families have, as Random, is here that of
athans, and not here at all where athans has none. Everything is looked up when it is first used, so that the import
itself is quick.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

from occontrol.core import compile_cache

compile_cache.guard()

# module: the public names that it holds
_COMMON: Mapping[str, tuple[str, ...]] = {
    "api": (
        "certify", "document", "export_run", "json_schema", "online", "plot", "read_measurements", "read_problem",
        "read_run", "read_schedule", "run_filter", "simulate", "solve", "tradeoff", "write_run",
    ),
    "files.frames": ("to_frame", "to_xarray"),
    "adapters.state_space": ("matrices_of", "plant_from"),
    "core.claims": ("Claims",),
    "core.errors": (
        "FileAccessError", "InfeasibleError", "OccontrolError", "ProblemError", "SolveFailed", "UsageError",
    ),
    "core.measurement": ("Estimate", "Measurement"),
    "core.monitor": ("Monitor",),
    "core.plant": ("DiscretePlant", "LinearPlant"),
    "core.schedule": ("Schedule",),
    "core.sensor": ("Sensor", "SensorSuite", "idle_sensor"),
    "core.solution": ("Certificate", "Solution", "Status"),
    "core.trajectory": ("Trajectory",),
}  # fmt: skip
# family: {module of it: the public names that it holds}; athans first, its names are never hidden by another's
_FAMILIES: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "athans": {
        "base": ("AthansProblem",),
        "problem": ("SchedulingProblem",),
        "readings.problem": ("ReadingsProblem",),
        "readings.clock": ("SampleTimes", "Steps"),
        "periodic.problem": ("PeriodicProblem",),
        "methods": (
            "BestSingle", "Collocation", "Greedy", "HMinimal", "Periodic", "Random", "Relaxed", "RelaxRoundPolish",
            "RoundRobin", "Shares",
        ),
        "filter.online": ("MatchedFilter",),
        "nonlinear.linearise": ("Replanning",),
        "replanning.online": ("ReplanningLoop",),
    },
    "vlambda": {
        "problem": ("SelectionProblem",),
        "methods": ("Eigenspace", "Fixed", "Lookahead", "Optimal", "Random", "RoundRobin", "Trace"),
        "sensor": ("DiscreteSensor", "Region"),
        "online": ("OnlineSelector",),
    },
    "hybrid": {
        "problem": ("JumpProblem",),
        "methods": ("Alternate", "ExpectedCovariance", "Fixed", "Random", "Scheduled"),
        "plant": ("JumpPlant", "Mode"),
        "sensor": ("JumpSensor",),
        "guard": ("Guard", "Threshold"),
    },
    "precision": {
        "problem": ("PrecisionProblem",),
        "methods": ("Barrier", "ClarabelRoute", "Uniform"),
        "plant": ("NonlinearPlant",),
        "measurement": ("NonlinearMeasurement",),
        "ensemble": ("EnsembleFilter",),
        "unscented": ("UnscentedFilter",),
    },
    "robust": {
        "problem": ("SwitchingProblem",),
        "methods": (
            "All", "BestSingle", "Fixed", "OneStep", "Optimal", "Random", "RelaxedShares", "RoundRobin",
        ),
        "plant": ("UncertainPlant",),
        "online": ("OnlineSwitching",),
    },
}  # fmt: skip


def _homes() -> dict[str, str]:
    """Every name found at the top, with its module, by the rule in the docstring above."""
    homes = {name: module for module, names in _COMMON.items() for name in names}
    owned = [
        (name, family, module)
        for family, modules in _FAMILIES.items()
        for module, names in modules.items()
        for name in names
    ]
    everyone = [name for name, _, _ in owned]
    for name, family, module in owned:
        if family == "athans" or everyone.count(name) == 1:
            homes[name] = f"families.{family}.{module}"
    return homes


_HOMES = _homes()
__all__ = sorted(_HOMES)


class FamilyNames:
    """The public names of one family, each imported when it is first used.

    Parameters
    ----------
    family : its name
    """

    def __init__(self, family: str):
        self._family = family
        self._homes = {name: module for module, names in _FAMILIES.get(family, {}).items() for name in names}

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name in self._homes:
            return getattr(importlib.import_module(f"occontrol.families.{self._family}.{self._homes[name]}"), name)
        from occontrol.families import find_family

        family = find_family(self._family)
        for kind in (*family.methods.values(), family.problem_type):  # also those that the table does not list
            if kind.__name__ == name:
                return kind
        raise AttributeError(f"occontrol.{self._family} has no '{name}'; there are: {', '.join(dir(self))}")

    def __dir__(self) -> list[str]:
        if self._homes:
            return sorted(self._homes)
        from occontrol.families import find_family

        family = find_family(self._family)  # one that the table does not list
        return sorted(kind.__name__ for kind in (*family.methods.values(), family.problem_type))

    def __repr__(self) -> str:
        return f"<the problems and methods of family {self._family}>"


def __getattr__(name: str) -> Any:
    """The public object called `name`, imported now."""
    if name in _HOMES:
        return getattr(importlib.import_module(f"occontrol.{_HOMES[name]}"), name)
    if not name.startswith("_"):
        from occontrol.families import names

        if name in names():
            return FamilyNames(name)
    raise AttributeError(f"module 'occontrol' has no attribute '{name}'")


def __dir__() -> list[str]:
    from occontrol.families import names

    return sorted([*__all__, *names()])
