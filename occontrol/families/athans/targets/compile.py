"""Entries of `targets` become TargetGroups: formulas of columns are evaluated for all rows at once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from occontrol.core.checks import check_shape
from occontrol.core.errors import Collector, Mistake, plural, suggest
from occontrol.core.sensor import check_name
from occontrol.families.athans.targets.compile_looks import LookBuilder
from occontrol.families.athans.targets.documents import TargetEntry, TargetModel
from occontrol.families.athans.targets.formulas import evaluate
from occontrol.families.athans.targets.groups import TargetGroup
from occontrol.families.athans.targets.matrix_columns import MatrixColumns, alike, semidefinite
from occontrol.families.athans.targets.tables import Columns


class GroupBuilder:
    """Makes the TargetGroup of one entry of `targets`.

    Parameters
    ----------
    models : by name
    looks : what makes the looks of a group
    """

    def __init__(self, models: Mapping[str, TargetModel], looks: LookBuilder):
        self.models, self.looks, self.numbered = models, looks, dict.fromkeys(models, 0)
        self.matrices: MatrixColumns = looks.matrices
        self.context, self.found = looks.matrices.context, looks.matrices.found

    def build(self, entry: TargetEntry, k: int, columns: Columns, passes: Columns | None) -> TargetGroup | None:
        """The group of an entry; None after a mistake.

        Parameters
        ----------
        entry : number `k` of `targets`
        columns : of its table; {} for a single target
        passes : of its table of passes
        """
        before = len(self.found.mistakes)
        model = self.models.get(entry.model)
        if model is None:
            hint = suggest(entry.model, self.models)
            self.found.add(("targets", k, "model"), f"there is no target model '{entry.model}'", hint)
            return None
        G = len(next(iter(columns.values()))) if columns else 1
        numbers = {name: c for name, c in columns.items() if c.dtype != object}
        names = self._names(entry, k, columns, G)
        here = ("target_models", entry.model)
        A = self.matrices.shared(model.A, (*here, "A"), numbers, G)
        noise = self.matrices.shared(model.noise, (*here, "noise"), numbers, G)
        if A is None or noise is None:
            return None
        n = A.shape[-2]
        self.matrices.require_square(A, (*here, "A"), n)
        self.matrices.require_square(noise, (*here, "noise"), n, covariance=True)
        own = entry.initial
        where = ("targets", k, "initial") if own is not None and own.covariance is not None else (*here, "initial")
        stated = own.covariance if own is not None and own.covariance is not None else model.initial.covariance
        covariance = self.matrices.fixed(stated, (*where, "covariance"), numbers, G)
        mean = self._mean(entry, model, k, numbers, G, n)
        running = (
            self.matrices.fixed(model.running, (*here, "running"), numbers, G) if model.running is not None else None
        )
        output = self.matrices.fixed(model.output, (*here, "output"), numbers, G) if model.output is not None else None
        weight = self.matrices.fixed(entry.weight, ("targets", k, "weight"), numbers, G)
        if model.running is None and model.output is None:
            what = f"target model '{entry.model}' has neither 'running' nor 'output'"
            self.found.add(here, what, "running: what counts all the time, output: what counts at the end", True)
        for value, path in ((covariance, (*where, "covariance")), (running, (*here, "running"))):
            if value is not None:
                self.matrices.require_square(value, path, n, covariance=True)
        if output is not None:
            shape = (output.shape[1], output.shape[2])
            hint = f"the model has {plural(n, 'state')}"
            self.found.mistakes += check_shape("output", shape, None, n, (*here, "output"), hint)
        if weight is not None and np.any(weight < 0):
            self.found.add(("targets", k, "weight"), f"weight is {np.min(weight):g}", "a weight is not negative")
        looks = self.looks.build(entry, k, numbers, names, passes, n)
        if len(self.found.mistakes) > before or covariance is None or mean is None or weight is None:
            return None
        zero = np.zeros((G, n, n))
        return TargetGroup(
            entry.model, tuple(names), A, noise, mean, covariance, weight[:, 0, 0],
            zero if running is None else semidefinite(running),
            zero if output is None else np.swapaxes(output, 1, 2) @ output, tuple(looks),
        )  # fmt: skip

    # ---- parts

    def _names(self, entry: TargetEntry, k: int, columns: Columns, G: int) -> list[str]:
        given = columns.get("name")
        if given is not None:
            names = [str(name) for name in given]
        elif entry.name is not None and not columns:
            names = [entry.name]
        else:
            start = self.numbered[entry.model]
            names = [f"{entry.model}_{start + i + 1}" for i in range(G)]
        self.numbered[entry.model] += G
        for name in names:
            mark = len(self.found.mistakes)
            with self.found.under("targets", k):
                inner = Collector()
                check_name(name, inner)
                inner.raise_if_any()
            for i in range(mark, len(self.found.mistakes)):
                m = self.found.mistakes[i]
                path = ("targets", k, "table" if columns else "name")
                self.found.mistakes[i] = Mistake(path, m.what.replace("sensor", "target"), m.hint)
            if len(self.found.mistakes) > mark:
                break
        return names

    def _mean(
        self, entry: TargetEntry, model: TargetModel, k: int, numbers: Columns, G: int, n: int
    ) -> np.ndarray | None:
        own = entry.initial is not None and entry.initial.mean is not None
        value = entry.initial.mean if entry.initial is not None and own else model.initial.mean
        path = ("targets", k, "initial", "mean") if own else ("target_models", entry.model, "initial", "mean")
        if value is None:
            return np.zeros((G, n))
        entries = self.context.entries(value, *path, variables=tuple(numbers) or ("t",))
        if entries is None:
            return None
        if len(entries) != n:
            self.found.add(path, f"mean has {plural(len(entries), 'entry')}, the model has {plural(n, 'state')}")
            return None
        return alike(evaluate([entries], numbers)[:, 0, 0], G)
