"""Every point of a study as a task: a whole problem, checked before any work, known by the digest of what it asks.

Two tasks are the same exactly when problem, method, seeds and the version of this program are: a changed file never
meets the results of the old one.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from occontrol.core.errors import Mistake, Path, ProblemError
from occontrol.core.kinds import Plain, PlainDict, PlainMapping
from occontrol.core.problem import BaseProblem
from occontrol.core.versions import versions
from occontrol.families import find_family, names
from occontrol.files.plain_json import plain
from occontrol.files.positions import Text, in_order
from occontrol.files.problem_file import LoadedDocument, documents_of, load_document
from occontrol.studies.paths import NAME, NoSuchPath, moved, resolve, with_values
from occontrol.studies.study_file import Study

_NOT_ASKED = ("name", "expect")


@dataclass(frozen=True)
class Task:
    """One problem of a study.

    Parameters
    ----------
    identity : 16 hexadecimal digits, the digest of what is asked
    point : {path as the study writes it: value}
    seed : of the random numbers, or None
    document : the whole problem, tables embedded
    start : identity of the task whose result it begins at, or None
    """

    identity: str
    point: PlainMapping
    seed: int | None
    document: PlainDict
    start: str | None = None


def plan(study: Study) -> list[Task]:
    """The tasks of a study, in its order; each of its problems is built and checked.

    Parameters
    ----------
    study : Study

    Raises ProblemError with every mistake: what is wrong with a value that varies at its place in the study file, what
    is wrong with the base at its place there.
    """
    loaded = load_document(study.base, names(), lambda name: find_family(name).schema())
    require_readable(loaded)
    found: list[Mistake] = []
    known = sorted({key for model in documents_of(loaded.schema) for key in model.model_fields})
    places = {path: _resolved(loaded.text.data, path, known, found) for path in study.axes}
    seeded = _seed_paths(loaded, study, found)
    if study.warm_start is not None and (why := find_family(loaded.family).begins_anew):
        found.append(Mistake(("warm_start",), f"family {loaded.family} always begins anew: {why}", "leave it out"))
    if found:
        raise _placed(study, found)
    tasks: dict[str, Task] = {}
    before: dict[str, str] = {}  # the last task of every row along the axis of warm starts
    for number, point in enumerate(study.points):
        for seed in study.seeds or (None,):
            values = [(places[path], value) for path, value in point.items()]
            values += [(path, seed) for path in seeded]
            document = _built(study, loaded, values, point, number, found)
            if document is None:
                break
            row = _row(study, point, seed)
            start = before.get(row) if row else None
            identity = digest(document, start)
            if identity not in tasks:
                tasks[identity] = Task(identity, dict(point), seed, document, start)
                before[row] = identity
            else:
                found.append(Mistake(_where(study, point, number), f"{_said(point)} is the same problem as another"))
        if len(found) > 20:
            break
    if found:
        raise _placed(study, found)
    return list(tasks.values())


def _method_check(loaded: LoadedDocument) -> Callable[[BaseProblem], list[Mistake]]:
    family = find_family(loaded.family)
    return lambda problem: [] if problem.method is None else family.mistakes(problem, problem.method)


def require_readable(loaded: LoadedDocument) -> None:
    """Raise ProblemError, with places in the base file, unless the base problem itself is a good one.

    Parameters
    ----------
    loaded : the base problem
    """
    loaded.build(_method_check(loaded))


def _row(study: Study, point: PlainMapping, seed: int | None) -> str:
    """What the points of one row along the axis of warm starts have in common; empty where nothing starts warm."""
    if study.warm_start is None:
        return ""
    return json.dumps([{path: plain(v) for path, v in point.items() if path != study.warm_start}, seed], sort_keys=True)


def digest(document: PlainMapping, start: str | None = None) -> str:
    """16 hexadecimal digits of what a problem asks, its method and this program's version; its name does not count.

    Parameters
    ----------
    document : the problem with all tables embedded
    start : identity of the task whose result it begins at: the last digits of a result depend on that
    """
    asked = {key: value for key, value in document.items() if key not in _NOT_ASKED}
    parts = [versions()["occontrol"], plain(asked)] + ([start] if start else [])
    text = json.dumps(parts, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]


def _resolved(document: Plain, path: str, known: Sequence[str], found: list[Mistake]) -> Path:
    try:
        return resolve(document, path, known)
    except NoSuchPath as error:
        found.append(Mistake(("vary", path), error.what, error.hint, key=True))
        return ()


def _seed_paths(loaded: LoadedDocument, study: Study, found: list[Mistake]) -> list[Path]:
    """Where the problem keeps the seeds of its random numbers; a mistake where seeds are asked for and it has none."""
    if not study.seeds:
        return []
    family = find_family(loaded.family)
    paths: list[Path] = [tuple(path.split(".")) for path in family.seed_paths]
    if not paths and _seeded_methods(study, loaded):
        paths = [("method", "seed")]
    if not paths:
        what = f"nothing in this problem of family {family.name} is random: a seed changes no number"
        found.append(Mistake(("seeds",), what, "leave seeds out"))
    return paths


def _seeded_methods(study: Study, loaded: LoadedDocument) -> bool:
    methods = find_family(loaded.family).methods
    own = loaded.text.data.get("method")
    used = [p["method.name"] for p in study.points if "method.name" in p]
    used = used or [own.get("name") if isinstance(own, dict) else own]
    return bool(used) and all(_has(methods.get(name), "seed") for name in used)


def _has(method: type | None, option: str) -> bool:
    return method is not None and any(f.name == option and f.init for f in dataclasses.fields(method))


def _built(
    study: Study,
    loaded: LoadedDocument,
    values: list[tuple[Path, Plain]],
    point: PlainMapping,
    number: int,
    found: list[Mistake],
) -> PlainDict | None:
    """The whole problem of one point; its mistakes go to `found`."""
    family = find_family(loaded.family)
    data = with_values(loaded.text.data, values)
    chosen = dict(values).get(NAME)
    if chosen is not None:
        data["method"] = _options_it_has(data["method"], family.methods.get(str(chosen)), [p for p, _ in values])
    text = Text(loaded.text.file, data, loaded.text.find_places)
    varied = [(path, said) for (path, _), said in zip(values, point, strict=False)]

    try:
        problem = replace(loaded, text=text).build_unplaced(_method_check(loaded))
    except ProblemError as error:
        for mistake in error.mistakes:
            said = moved(mistake, varied)
            where = _where(study, point, number) if said is None else _where(study, {said: point[said]}, number)
            found.append(Mistake(where, f"{_said(point)}: {mistake.what}", mistake.hint))
        return None
    return family.schema().document(problem)


def _options_it_has(method: PlainDict, kind: type | None, stated: Sequence[Path]) -> PlainDict:
    """The options of the base's method that another method has too; those that the study itself states stay."""
    if kind is None:
        return method
    kept = {path[1] for path in stated if path[0] == "method" and len(path) > 1}
    return {key: value for key, value in method.items() if key in kept or key == "name" or _has(kind, key)}


def _where(study: Study, point: PlainMapping, number: int) -> Path:
    """Where the study file states the first value of a point."""
    for path, value in point.items():
        if isinstance(study.text and study.text.data.get("vary"), list):
            return ("vary", number, path)
        given = study.text.data["vary"].get(path) if study.text else None
        return ("vary", path, given.index(value)) if isinstance(given, list) else ("vary", path)
    return ("base",)


def _said(point: PlainMapping) -> str:
    return ", ".join(f"{path} = {value}" for path, value in point.items()) or "the base problem"


def _placed(study: Study, mistakes: list[Mistake]) -> ProblemError:
    return in_order(mistakes) if study.text is None else study.text.placed(mistakes)

