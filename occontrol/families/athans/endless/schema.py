"""Problem files with many targets and no end: the problem from a document, and the document from a problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from pydantic import Field

from occontrol.core.errors import ProblemError
from occontrol.core.kinds import PlainDict, PlainMapping
from occontrol.families.athans.endless.problem import EndlessTargetsProblem
from occontrol.families.athans.periodic.documents import SteppedHorizon
from occontrol.families.athans.periodic.method import Periodic
from occontrol.families.athans.periodic.schema import method_document
from occontrol.families.athans.targets import schema as targets
from occontrol.families.athans.targets.documents import TargetsDocument, TargetsHorizon
from occontrol.families.athans.targets.problem import TargetsProblem
from occontrol.files.schema.common import Context


class EndlessTargetsDocument(TargetsDocument):
    """A problem file of the family athans with many targets, for ever."""

    horizon: SteppedHorizon = Field(description="horizon: {infinite: true, step: ..}")  # type: ignore[assignment]


def is_endless(data: PlainMapping) -> bool:
    """Whether a file of targets has no end.

    Parameters
    ----------
    data : the plain content of the file
    """
    horizon = data.get("horizon")
    return isinstance(horizon, Mapping) and "infinite" in horizon


def build(document: EndlessTargetsDocument, context: Context) -> EndlessTargetsProblem:
    """The problem that the document describes; ProblemError with every mistake."""
    found, step = context.found, document.horizon.step
    for i, resource in enumerate(document.resources):
        if resource.windows is not None:
            what = f"resource '{resource.name}' has windows: looks for ever have none"
            found.add(("resources", i, "windows"), what, key=True)
    for k, target in enumerate(document.targets):
        for key in ("windows", "passes"):
            if getattr(target, key) is not None:
                found.add(("targets", k, key), f"targets for ever have no {key}", "", True)
    ruled = [("looks", j, "dwell") for j, look in enumerate(document.looks) if look.dwell > 1]
    ruled += [("resources", i, "slew") for i, resource in enumerate(document.resources) if resource.slew]
    ruled += [("targets", k, "revisit") for k, target in enumerate(document.targets) if target.revisit]
    for path in ruled:
        found.add(path, f"looks for ever have no {path[-1]}", "make the step as long as a look", True)
    if document.horizon.repeat is not None:
        found.add(("horizon", "repeat"), "repeat is for windows, which targets for ever do not have", "", True)
    if not 0 < step < float("inf"):
        found.add(("horizon", "step"), f"step is {step:g}, it must be a time above 0")
    if ruled or not 0 < step < float("inf"):
        raise ProblemError(found.mistakes)
    method = None if document.method is None else context.method(document.method, {Periodic.name: Periodic})
    once = TargetsHorizon(start=0.0, end=step, intervals=1)  # type: ignore[call-arg]
    whole = targets.build(document.model_copy(update={"horizon": once, "method": None}), context, fixed=True)
    assert isinstance(whole, TargetsProblem)
    kept = {f.name: getattr(whole, f.name) for f in fields(whole) if f.init}
    kept["statement"] = {**whole.statement, "horizon": {"infinite": True, "step": float(step)}}
    problem = context.attempt(EndlessTargetsProblem, **{**kept, "method": method})
    found.raise_if_any()
    return problem


def document(problem: EndlessTargetsProblem) -> PlainDict:
    """The problem as a JSON-able document with all tables embedded; `build` of it gives the identical problem."""
    written = targets.document(problem)
    if problem.method is not None:
        written["method"] = method_document(problem.method)
    return written
