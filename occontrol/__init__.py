"""Optimal sensor scheduling, with a proven lower bound beside every schedule.

    import occontrol as oc
    problem = oc.read_problem("problems/attitude_telemetry.yaml")
    solution = oc.solve(problem)
    solution.certificate.relative_gap

The names below are looked up when they are first used, so that the import itself is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from occontrol.core import compile_cache

if TYPE_CHECKING:
    from occontrol.api import certify, plot, read_run, run_filter, simulate, solve, tradeoff, write_run
    from occontrol.core.errors import (
        FileAccessError,
        InfeasibleError,
        OccontrolError,
        ProblemError,
        SolveFailed,
        UsageError,
    )
    from occontrol.core.measurement import Estimate, Measurement
    from occontrol.core.monitor import Monitor
    from occontrol.core.plant import DiscretePlant, LinearPlant
    from occontrol.core.schedule import Schedule
    from occontrol.core.sensor import Sensor, SensorSuite, idle_sensor
    from occontrol.core.solution import Certificate, Solution, Status
    from occontrol.core.trajectory import Trajectory
    from occontrol.families.athans.filter.online import MatchedFilter
    from occontrol.families.athans.methods import (
        BestSingle,
        Collocation,
        Greedy,
        HMinimal,
        Random,
        Relaxed,
        RelaxRoundPolish,
        RoundRobin,
    )
    from occontrol.families.athans.problem import SchedulingProblem
    from occontrol.families.hybrid.guard import Guard, Threshold
    from occontrol.families.hybrid.plant import JumpPlant, Mode
    from occontrol.families.hybrid.sensor import JumpSensor
    from occontrol.families.precision.ensemble import EnsembleFilter
    from occontrol.families.precision.measurement import NonlinearMeasurement
    from occontrol.families.precision.plant import NonlinearPlant
    from occontrol.families.precision.unscented import UnscentedFilter
    from occontrol.families.robust.online import OnlineSwitching
    from occontrol.families.robust.plant import UncertainPlant
    from occontrol.families.robust.problem import SwitchingProblem
    from occontrol.families.vlambda.online import OnlineSelector
    from occontrol.families.vlambda.problem import SelectionProblem
    from occontrol.families.vlambda.sensor import DiscreteSensor, Region
    from occontrol.files.data_files import read_measurements, read_schedule
    from occontrol.files.export import export_run
    from occontrol.files.problem_file import read_problem

compile_cache.guard()

# module: the public names that it holds
_HOME = {
    "core.errors": (
        "OccontrolError",
        "ProblemError",
        "UsageError",
        "InfeasibleError",
        "SolveFailed",
        "FileAccessError",
    ),
    "core.measurement": ("Measurement", "Estimate"),
    "core.monitor": ("Monitor",),
    "core.plant": ("LinearPlant", "DiscretePlant"),
    "core.schedule": ("Schedule",),
    "families.athans.problem": ("SchedulingProblem",),
    "families.vlambda.sensor": ("DiscreteSensor", "Region"),
    "core.sensor": ("Sensor", "SensorSuite", "idle_sensor"),
    "core.solution": ("Solution", "Certificate", "Status"),
    "core.trajectory": ("Trajectory",),
    "families.robust.plant": ("UncertainPlant",),
    "families.hybrid.plant": ("JumpPlant", "Mode"),
    "families.hybrid.sensor": ("JumpSensor",),
    "families.hybrid.guard": ("Guard", "Threshold"),
    "families.precision.plant": ("NonlinearPlant",),
    "families.precision.measurement": ("NonlinearMeasurement",),
    "families.precision.ensemble": ("EnsembleFilter",),
    "families.precision.unscented": ("UnscentedFilter",),
    "families.robust.problem": ("SwitchingProblem",),
    "families.robust.online": ("OnlineSwitching",),
    "families.vlambda.problem": ("SelectionProblem",),
    "api": ("solve", "certify", "simulate", "run_filter", "tradeoff", "plot", "read_run", "write_run"),
    "families.athans.filter.online": ("MatchedFilter",),
    "families.vlambda.online": ("OnlineSelector",),
    "families.athans.methods": (
        "RelaxRoundPolish",
        "HMinimal",
        "Relaxed",
        "Collocation",
        "BestSingle",
        "RoundRobin",
        "Random",
        "Greedy",
    ),
    "files.problem_file": ("read_problem",),
    "files.data_files": ("read_schedule", "read_measurements"),
    "files.export": ("export_run",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "BestSingle",
    "Certificate",
    "Collocation",
    "DiscretePlant",
    "DiscreteSensor",
    "EnsembleFilter",
    "Estimate",
    "FileAccessError",
    "Greedy",
    "Guard",
    "HMinimal",
    "InfeasibleError",
    "JumpPlant",
    "JumpSensor",
    "LinearPlant",
    "MatchedFilter",
    "Measurement",
    "Mode",
    "Monitor",
    "NonlinearMeasurement",
    "NonlinearPlant",
    "OccontrolError",
    "OnlineSelector",
    "OnlineSwitching",
    "ProblemError",
    "Random",
    "Region",
    "RelaxRoundPolish",
    "Relaxed",
    "RoundRobin",
    "Schedule",
    "SchedulingProblem",
    "SelectionProblem",
    "Sensor",
    "SensorSuite",
    "Solution",
    "SolveFailed",
    "Status",
    "SwitchingProblem",
    "Threshold",
    "Trajectory",
    "UncertainPlant",
    "UnscentedFilter",
    "UsageError",
    "certify",
    "export_run",
    "idle_sensor",
    "plot",
    "read_measurements",
    "read_problem",
    "read_run",
    "read_schedule",
    "run_filter",
    "simulate",
    "solve",
    "tradeoff",
    "write_run",
]


def __getattr__(name: str) -> Any:
    """The public object called `name`, imported now."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'occontrol' has no attribute '{name}'")
    return getattr(importlib.import_module(f"occontrol.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
