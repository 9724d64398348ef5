"""Problem files with many targets: the problem from a document, and the document from a problem."""

from __future__ import annotations

import numpy as np

from occontrol.core.clock import lengths
from occontrol.core.errors import Mistake, ProblemError
from occontrol.core.kinds import PlainDict
from occontrol.families.athans.integration.options import Integration
from occontrol.families.athans.methods import METHODS as PLAIN
from occontrol.families.athans.problem import SchedulingProblem
from occontrol.families.athans.schema_parts import edges_of
from occontrol.families.athans.targets.compile import GroupBuilder
from occontrol.families.athans.targets.compile_looks import LookBuilder, open_between
from occontrol.families.athans.targets.documents import ResourceEntry, TargetsDocument
from occontrol.families.athans.targets.groups import TargetGroup
from occontrol.families.athans.targets.matrix_columns import FIXED, MatrixColumns, Times
from occontrol.families.athans.targets.methods import METHODS
from occontrol.families.athans.targets.problem import Resource, TargetsProblem
from occontrol.families.athans.targets.ruled import LookRules, as_one_plant
from occontrol.families.athans.targets.tables import plain_columns, read_table
from occontrol.files.schema.common import Context, options_document, plain, prune

MOST_WEIGHTS = 200_000_000


def build(document: TargetsDocument, context: Context, fixed: bool = False) -> TargetsProblem | SchedulingProblem:
    """The problem that the document describes, as one plant where there are rules on looks; ProblemError with every
    mistake. With `fixed` nothing may change with time."""
    found = context.found
    edges = edges_of(document.horizon, context)
    ruled = any(look.dwell > 1 for look in document.looks) or any(r.slew for r in document.resources)
    ruled = ruled or any(entry.revisit for entry in document.targets)
    method = None if document.method is None else context.method(document.method, PLAIN if ruled else METHODS)
    expect = context.expect(document.expect)
    if edges is None:
        raise ProblemError(found.mistakes)
    edges = np.asarray(edges, dtype=float)
    times = Times(edges, (edges[1:] + edges[:-1]) / 2, lengths(edges), fixed)
    resources = [_resource(entry, i, times, context) for i, entry in enumerate(document.resources)]
    for j, look in enumerate(document.looks):
        if look.model is not None and look.model not in document.target_models:
            found.add(("looks", j, "model"), f"there is no target model '{look.model}'")
    look_builder = LookBuilder(document.looks, [r.name for r in resources], MatrixColumns(times, context))
    builder = GroupBuilder(document.target_models, look_builder)
    groups: list[TargetGroup] = []
    stated: list[PlainDict] = []
    for k, entry in enumerate(document.targets):
        columns, passes = {}, None
        plain_entry = entry.model_dump(exclude_none=True, exclude_defaults=True)
        if entry.table is not None:
            if entry.name is not None:
                found.add(("targets", k, "name"), "a table of targets has no name", "give a column 'name'", True)
            columns = read_table(entry.table, ("targets", k, "table"), context)
            if columns is None:
                continue
            have = len(next(iter(columns.values())))
            if entry.rows is not None:
                if not 1 <= entry.rows <= have:
                    what = f"rows is {entry.rows}, the table has {have}"
                    found.add(("targets", k, "rows"), what, "leave it out for all of them")
                    continue
                columns = {name: column[: entry.rows] for name, column in columns.items()}
            plain_entry["table"] = plain_columns(columns)
            plain_entry.pop("rows", None)
        if entry.passes is not None:
            passes = read_table(entry.passes, ("targets", k, "passes"), context)
            if passes is None:
                continue
            plain_entry["passes"] = plain_columns(passes)
        stated.append({**plain_entry, "model": entry.model})
        group = builder.build(entry, k, columns, passes)
        if group is not None:
            groups.append(group)
    found.raise_if_any()
    statement = {
        "constants": document.constants,
        "resources": [
            r.model_dump(exclude_none=True, exclude_defaults=True) | {"name": r.name} for r in document.resources
        ],
        "target_models": {n: m.model_dump(exclude_none=True) for n, m in document.target_models.items()},
        "targets": stated,
        "looks": [x.model_dump(exclude_none=True, exclude_defaults=True) for x in document.looks],
        "horizon": document.horizon.model_dump(exclude_none=True, exclude_defaults=True),
    }
    steps = Integration(document.horizon.accuracy, document.horizon.substeps, windows="cover", refine=False)
    problem = context.attempt(
        TargetsProblem, name=context.title(document.name), edges=edges, resources=tuple(resources),
        groups=tuple(groups), statement=plain(statement), cost_weight=document.objective.cost_weight, method=method,
        expect=expect, integration=steps,
    )  # fmt: skip
    found.raise_if_any()
    return as_one_plant(problem, _rules(document, groups), method) if ruled else problem


def _rules(document: TargetsDocument, groups: list[TargetGroup]) -> LookRules:
    dwell, revisit = {}, {}
    for look in reversed(document.looks):
        models = document.target_models if look.model is None else [look.model]
        dwell |= dict.fromkeys(models, look.dwell)
    for entry, group in zip(document.targets, groups, strict=True):
        if entry.revisit is not None:
            revisit |= dict.fromkeys(group.names, entry.revisit)
    slew = {r.name: r.slew for r in document.resources if r.slew}
    return LookRules({m: d for m, d in dwell.items() if d > 1}, slew, revisit)


def _resource(entry: ResourceEntry, i: int, times: Times, context: Context) -> Resource:
    path = ("resources", i, "capacity")
    signal = context.signal(entry.capacity, *path)
    capacity = np.ones(len(times.steps), dtype=np.int64)
    if signal is not None and times.fixed and not signal.constant:
        context.found.add(path, f"the capacity of resource '{entry.name}' changes with t", FIXED)
    elif signal is not None:
        values = signal.sample(times.middle)
        whole = values.shape[1:] == (1, 1) and np.all(np.isfinite(values)) and np.all(values >= 0)
        whole = whole and np.all(np.abs(values - np.round(values)) < 1e-9)
        if whole:
            capacity = np.round(values[:, 0, 0]).astype(np.int64)
        else:
            what = f"the capacity of resource '{entry.name}' is no whole number"
            context.found.mistakes.append(Mistake(path, what, "looks on one interval: 0, 1, 2, .."))
    if entry.windows is not None:
        open_ = open_between(entry.windows, times, ("resources", i, "windows"), context.found)
        capacity = np.where(open_, capacity, 0)
    return Resource(entry.name, capacity)


def document(problem: TargetsProblem) -> PlainDict:
    """The problem as a JSON-able document with all tables embedded; `build` of it gives the identical problem."""
    stated = problem.statement
    return prune(
        {
            "family": "athans",
            "name": problem.name,
            "constants": stated["constants"],
            "horizon": stated["horizon"],
            "resources": stated["resources"],
            "target_models": stated["target_models"],
            "targets": stated["targets"],
            "looks": stated["looks"],
            "objective": {"cost_weight": float(problem.cost_weight)},
            "method": options_document(problem.method),
            "expect": None if problem.expect is None else plain(problem.expect),
        }
    )
