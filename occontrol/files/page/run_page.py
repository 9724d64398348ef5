"""The page of one run: what is the same for every family, from the content of its files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from occontrol.core.kinds import Plain, PlainDict, PlainMapping
from occontrol.files.page.content import Group, Page, Picture, Table
from occontrol.files.plain_json import plain

HOLDS = {
    "continuous": "for every schedule, whenever it switches",
    "grid": "for every schedule that changes at these edges and keeps the rules, if there are any",
    "problem": "for every schedule of this problem",
}
MOST_NUMBERS = 24  # of one list that are shown of a problem; its file has all of them
LONGEST = 40_000  # letters of a problem that are shown


@dataclass(frozen=True, eq=False, kw_only=True)
class RunParts:
    """What a page of a run is made of.

    Parameters
    ----------
    name : of the problem
    content : of result.json
    document : the problem as a dict
    rows : (label, text) that the family says of the result
    schedule : list of records, as result.json has it
    groups : of panels, the family's
    tables : the family's, below the schedule
    pictures : in the order of the page
    origin : of provenance.json
    """

    name: str
    content: PlainMapping
    document: PlainMapping
    rows: Sequence[tuple[str, str]]
    schedule: Plain = None
    groups: Sequence[Group] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    origin: PlainMapping = field(default_factory=dict)


def run_page(parts: RunParts) -> Page:
    """The page of a run.

    Parameters
    ----------
    parts : RunParts
    """
    content, document = parts.content, parts.document
    tables = [schedule_table(parts.schedule), *parts.tables, _sensors(document)]
    texts = [("model", _model(document)), ("rules", _rules(document)), ("problem", short_text(document))]
    return Page(
        title=parts.name,
        kind=f"run of family {content.get('family')}, method {content.get('method')}",
        sentences=sentences(content),
        numbers=top_numbers(content),
        facts=[*parts.rows, *_origin(content, parts.origin)],
        groups=parts.groups,
        tables=[table for table in tables if table is not None],
        texts=[(title, text) for title, text in texts if text],
        pictures=parts.pictures,
    )


def _top(content: PlainMapping) -> PlainMapping:
    top = content.get("top")
    return top if isinstance(top, Mapping) else content


def top_numbers(content: PlainMapping) -> list[tuple[str, str]]:
    """Cost, bound and gap that stand at the top, with every digit of result.json.

    Parameters
    ----------
    content : of result.json
    """
    top, found = _top(content), []
    for key, label in (("cost", "cost"), ("lower_bound", "proven lower bound")):
        if _is_number(top.get(key)):
            found.append((label, json.dumps(top[key])))
    if len(found) == 2 and _is_number(top.get("relative_gap")):
        found.append(("gap", f"{100 * float(top['relative_gap']):.3g} %"))  # type: ignore[arg-type]
    return found


def sentences(content: PlainMapping) -> list[str]:
    """What was found, in words: the message, and what the bound holds for.

    Parameters
    ----------
    content : of result.json
    """
    top, said = _top(content), [f"{str(content.get('status', '')).capitalize()}: {content.get('message', '')}".strip()]
    gap = top.get("relative_gap")
    if _is_number(top.get("lower_bound")) and _is_number(top.get("cost")) and _is_number(gap):
        holds = HOLDS.get(str(top.get("of", "")), "for everything that this problem allows")
        left = f"at most {100 * float(gap):.3g} % of the cost" if float(gap) > 0 else "nothing"  # type: ignore[arg-type]
        said.append(f"The bound holds {holds}: {left} could still be saved.")
    return said


def _is_number(value: Plain) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def schedule_table(schedule: Plain) -> Table | None:
    """The schedule as result.json lists it; copied as CSV it is a schedule file that `certify` reads.

    Parameters
    ----------
    schedule : list of records
    """
    records = [r for r in schedule if isinstance(r, Mapping)] if isinstance(schedule, list) else []
    if not records:
        return None
    columns: dict[str, list[Plain]] = {}
    if "start" in records[0]:
        columns = {key: [r.get(key) for r in records] for key in ("start", "end")}
    elif at := next((key for key in ("k", "t") if key in records[0]), ""):
        columns["start"] = columns["end"] = [r.get(at) for r in records]  # one instant
    for key in ("resource", "target"):
        if key in records[0]:
            columns[key] = [r.get(key) for r in records]
    if isinstance(records[0].get("sensors"), list):
        columns["sensors"] = [";".join(map(str, r.get("sensors") or ())) for r in records]  # type: ignore[arg-type]
    if any(r.get("weights") for r in records):
        columns["weights"] = [";".join(json.dumps(w) for w in r.get("weights") or ()) for r in records]
    return Table(title="schedule", columns=columns)


def _sensors(document: PlainMapping) -> Table | None:
    """One row for every sensor of the problem file, one column for every key that any of them has."""
    listed = document.get("sensors")
    records = [r if isinstance(r, Mapping) else {"name": str(r)} for r in listed] if isinstance(listed, list) else []
    keys = list(dict.fromkeys(key for record in records for key in record))
    if not records or len(keys) < 2:
        return None
    return Table(title="sensors", columns={key: [_cell(r.get(key)) for r in records] for key in keys})


def _cell(value: Plain) -> Plain:
    """A number, or a matrix in few letters."""
    if value is None or isinstance(value, str | int | float):
        return value
    if isinstance(value, Mapping) and isinstance(value.get("times"), list):
        return f"table of {len(value['times'])} times"
    while isinstance(value, list) and len(value) == 1:
        value = value[0]
    if not isinstance(value, list | Mapping):
        return value
    text = json.dumps(shortened(value, 9), ensure_ascii=False)
    return text if len(text) <= 90 else text[:89] + "…"


def _model(document: PlainMapping) -> str:
    keys = ("plant", "modes", "transition", "measurement", "initial", "noise", "objective", "criterion")
    shown = {key: document[key] for key in keys if document.get(key) is not None}
    return short_text(shown) if shown else ""


def _rules(document: PlainMapping) -> str:
    rules = document.get("constraints")
    return short_text(rules) if isinstance(rules, Mapping) and rules else ""


def short_text(document: Plain | PlainMapping) -> str:
    """A document as indented text, its long lists of numbers cut short.

    Parameters
    ----------
    document : nested mappings, lists and numbers
    """
    text = _lines(shortened(plain(document), MOST_NUMBERS), 0)
    cut = f"\n… and {len(text) - LONGEST} letters more; problem.json has all" if len(text) > LONGEST else ""
    return text[:LONGEST] + cut


def shortened(value: Plain, most: int) -> Plain:
    """The same with the first entries of long lists only, and a word on the rest.

    Parameters
    ----------
    value : nested mappings, lists and numbers
    most : entries of a list
    """
    if isinstance(value, Mapping):
        return {key: shortened(entry, most) for key, entry in value.items()}
    if isinstance(value, list):
        kept = [shortened(entry, most) for entry in value[:most]]
        return kept if len(value) <= most else [*kept, f"… {len(value) - most} more"]
    return value


def _lines(value: Plain, depth: int) -> str:
    """Like YAML: a mapping has a line for every key, a list of plain values stands on one line."""
    pad = "  " * depth
    if isinstance(value, Mapping) and value:
        return "\n".join(f"{pad}{key}:{_below(entry, depth)}" for key, entry in value.items())
    if isinstance(value, list) and any(isinstance(entry, Mapping) for entry in value):
        return "\n".join(f"{pad}- {_lines(entry, depth + 1).lstrip()}" for entry in value)
    return pad + _flat(value)


def _below(value: Plain, depth: int) -> str:
    text = _lines(value, depth + 1)
    return f"\n{text}" if "\n" in text or (isinstance(value, Mapping) and value) else f" {text.lstrip()}"


def _flat(value: Plain) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _origin(content: PlainMapping, origin: PlainMapping) -> list[tuple[str, str]]:
    """Versions, command line, machine and digest."""
    command, machine = origin.get("command"), origin.get("machine")
    versions: PlainDict = dict(content.get("versions") or {})  # type: ignore[arg-type]
    rows = [("versions", ", ".join(f"{name} {text}" for name, text in versions.items()))]
    if isinstance(machine, Mapping):
        known = [f"{key} {machine[key]}" for key in ("system", "cores", "python") if key in machine]
        rows.append(("machine", ", ".join(known)))
    if isinstance(command, list):
        rows.append(("command", " ".join(["occontrol", *map(str, command[1:])])))
    rows += [(key, str(origin[key])) for key in ("start", "end") if origin.get(key)]
    rows.append(("digest of the problem", str(content.get("digest", "not recorded"))))
    return [(label, text) for label, text in rows if text]
