"""Entries of `looks` become LookSets: which resource sees which target when, through windows and passes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occontrol.core.checks import check_shape
from occontrol.core.clock import resolution
from occontrol.core.errors import Collector, Mistake, Path, plural, suggest
from occontrol.core.sensor import Sensor
from occontrol.families.athans.targets.documents import LookEntry, TargetEntry
from occontrol.families.athans.targets.groups import LookSet
from occontrol.families.athans.targets.matrix_columns import MatrixColumns, Times
from occontrol.families.athans.targets.tables import Columns, column_numbers

PASS_COLUMNS = ("target", "resource", "start", "end")


def open_between(windows: Sequence[Sequence[float]], times: Times, path: Path, found: Collector) -> np.ndarray:
    """(N,) whether each interval lies inside the windows; mistakes are noted at `path`."""
    mark = len(found.mistakes)
    with found.under(*path):
        nothing = np.zeros((0, 1)), np.zeros((0, 0))
        sensor = Sensor("look", *nothing, windows=[tuple(w) for w in windows])  # type: ignore[arg-type]
        return sensor.available_between(times.edges)
    found.mistakes[mark:] = [
        Mistake(path, m.what.replace(" of sensor 'look'", "").replace("sensor 'look' has", "there is"), m.hint)
        for m in found.mistakes[mark:]
    ]
    return np.zeros(len(times.steps), dtype=bool)


class LookBuilder:
    """Makes the looks at the targets of one entry.

    Parameters
    ----------
    entries : `looks` of the file
    resources : names
    matrices : reads formulas, and notes mistakes
    """

    def __init__(self, entries: Sequence[LookEntry], resources: list[str], matrices: MatrixColumns):
        self.entries, self.resources, self.matrices = entries, resources, matrices
        self.times, self.context, self.found = matrices.times, matrices.context, matrices.found

    def build(
        self, entry: TargetEntry, k: int, numbers: Columns, names: list[str], passes: Columns | None, n: int
    ) -> list[LookSet]:
        """The looks at the targets of entry number `k`; mistakes are noted.

        Parameters
        ----------
        entry : of `targets`
        k : its number
        numbers : (G,) columns of its table
        names : of its G targets
        passes : its table of passes, or None
        n : states of a target
        """
        found: list[LookSet] = []
        for key in ("noise", "C", "windows"):
            for resource in getattr(entry, key) or {}:
                if resource not in self.resources:
                    hint = suggest(resource, self.resources)
                    self.found.add(("targets", k, key, resource), f"there is no resource '{resource}'", hint, True)
        by_pass = None if passes is None else self._passes(passes, k, names)
        for j, look in enumerate(self.entries):
            if look.model is not None and look.model != entry.model:
                continue
            for name in [look.resource] if isinstance(look.resource, str) else look.resource:
                made = None
                if name in self.resources:
                    made = self._look(entry, look, j, name, k, numbers, by_pass, len(names), n)
                elif k == 0:
                    hint = suggest(name, self.resources)
                    self.found.add(("looks", j, "resource"), f"there is no resource '{name}'", hint)
                if made is not None:
                    found.append(made)
        return found

    def _look(
        self, entry: TargetEntry, look: LookEntry, j: int, name: str, k: int, numbers: Columns,
        passes: Columns | None, G: int, n: int,
    ) -> LookSet | None:  # fmt: skip
        rho, N = self.resources.index(name), len(self.times.steps)
        target, interval = np.repeat(np.arange(G, dtype=np.int32), N), np.tile(np.arange(N, dtype=np.int32), G)
        columns, S = numbers, G
        which = target
        if passes is not None:
            row = np.flatnonzero(passes["resource"] == rho)
            of = passes["target"][row].astype(np.int64)
            columns = {c: v[of] for c, v in numbers.items()}
            columns |= {c: v[row] for c, v in passes.items() if c not in PASS_COLUMNS}
            S = len(row)
            which, interval = _inside(self.times, passes["start"][row], passes["end"][row])
            target = of[which]
        if entry.windows is not None and name in entry.windows:
            kept = open_between(entry.windows[name], self.times, ("targets", k, "windows", name), self.found)[interval]
            target, interval, which = target[kept], interval[kept], which[kept]
        noise = self._noise(entry, look, j, name, k)
        if S == 0 or noise is None:
            return None
        theta_value, path, scale = noise
        own = entry.C is not None and name in entry.C
        c_path: Path = ("targets", k, "C", name) if own else ("looks", j, "C")
        C = self.matrices.varying(entry.C[name] if own and entry.C is not None else look.C, c_path, columns, S)
        theta = self.matrices.varying(theta_value, path, columns, S)
        cost = self.matrices.varying(look.cost, ("looks", j, "cost"), columns, S)
        if C is None or theta is None or cost is None:
            return None
        r, before = C.shape[2], len(self.found.mistakes)
        has = f"the model has {plural(n, 'state')}"
        for given, rows, width, where, hint in (
            (C, None, n, c_path, has), (theta, r, r, path, f"C has {plural(r, 'row')}"),
            (cost, 1, 1, ("looks", j, "cost"), "a number or a formula"),
        ):  # fmt: skip
            shape = given.shape[2], given.shape[3]
            self.found.mistakes += check_shape(self.context.name(where), shape, rows, width, where, hint)
        if len(self.found.mistakes) == before:
            self.matrices.require_covariances(theta.reshape(-1, r, r), path, definite=True)
        if np.any(cost < 0):
            self.found.add(("looks", j, "cost"), f"cost is {np.min(cost):g}", "a cost is not negative")
        if len(self.found.mistakes) > before:
            return None
        K = max(part.shape[1] for part in (C, theta, cost))
        full = [np.broadcast_to(p, (S, K, *p.shape[2:])).reshape(S * K, *p.shape[2:]) for p in (C, theta * scale, cost)]
        which = which if K == 1 else which * K + interval
        return LookSet(rho, full[0], full[1], full[2][:, 0, 0], target, interval, which)

    def _noise(
        self, entry: TargetEntry, look: LookEntry, j: int, name: str, k: int
    ) -> tuple[object, Path, float] | None:
        """What stands for the intensity, where, and the factor that makes it one; None after a mistake."""
        if entry.noise is not None and name in entry.noise:
            return entry.noise[name], ("targets", k, "noise", name), 1.0
        if (look.noise is None) == (look.variance is None):
            what = f"the looks of '{name}' have " + ("no 'noise'" if look.noise is None else "noise and variance")
            mistake = Mistake(("looks", j), what, "noise: the intensity, variance times the length of a look", key=True)
            self.found.mistakes += [] if mistake in self.found.mistakes else [mistake]
            return None
        if look.noise is not None:
            return look.noise, ("looks", j, "noise"), 1.0
        if np.ptp(self.times.steps) > 1e-9 * self.times.steps[0]:
            what = "variance needs intervals of equal length"
            self.found.add(("looks", j, "variance"), what, "give noise, an intensity")
        return look.variance, ("looks", j, "variance"), float(self.times.steps[0])

    def _passes(self, passes: Columns, k: int, names: list[str]) -> Columns | None:
        path = ("targets", k, "passes")
        lacking = [name for name in PASS_COLUMNS if name not in passes]
        if lacking:
            hint = "columns: " + ", ".join(PASS_COLUMNS)
            self.found.add(path, f"the table of passes has no column '{lacking[0]}'", hint)
            return None
        target = column_numbers(passes["target"], names, "target", path, self.context)
        resource = column_numbers(passes["resource"], self.resources, "resource", path, self.context)
        if target is None or resource is None:
            return None
        return {**passes, "target": target, "resource": resource}


def _inside(times: Times, starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(owner, interval) of all intervals that lie inside [start, end] of each pass."""
    slack = resolution(times.edges) + 1e-9 * float(np.min(times.steps))
    first = np.searchsorted(times.edges[:-1], starts - slack)
    last = np.searchsorted(times.edges[1:], ends + slack, side="right")
    count = np.maximum(last - first, 0)
    owner = np.repeat(np.arange(len(starts)), count)
    offset = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    return owner, first[owner] + offset
