"""The reference pages of the documentation site, from what the program itself says: commands, keys, public names.

    python scripts/docs_reference.py docs/_reference

Called by docs/conf.py. Docstrings are shown as they are, in a fixed pitch: their equations are drawn with characters.
"""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import typer

HOUSE = Path(__file__).resolve().parents[1] / "occontrol"


def commands() -> str:
    """Every command with what it does, its arguments and options."""
    from occontrol.cli.application import app

    group = typer.main.get_command(app)
    parts = ["# Command line", "", "`occontrol COMMAND --help` says the same.", ""]
    for name, command in vars(group)["commands"].items():
        parts += [f"## {name}", "", *(command.help or "").split("\n"), ""]
        parts += ["| | |", "|---|---|"] if command.params else []
        for parameter in command.params:
            names = [*parameter.opts, *parameter.secondary_opts] if parameter.param_type_name == "option" else []
            label, told = ", ".join(names) or str(parameter.metavar or parameter.name).upper(), parameter.help or ""
            parts.append(f"| `{_cell(label)}` | {_cell(told)} |")
        parts.append("")
    return "\n".join(parts)


def keys(family: str) -> str:
    """The keys of a family's problem files, from its JSON Schema."""
    schema = json.loads((HOUSE / "families" / family / "schema.json").read_text(encoding="utf-8"))
    parts = [f"# Keys: {family}", "", f"`occontrol schema {family}` prints the schema that editors read.", ""]
    files = [entry["$ref"].rsplit("/", 1)[-1] for entry in schema.get("anyOf", ()) if "$ref" in entry]
    if not files:
        parts += _object("The file", schema)
    else:
        parts += ["A file is one of these: " + ", ".join(f"[{name}](#{name.lower()})" for name in files) + ".", ""]
    known = schema.get("$defs", {})
    for name in (*files, *(name for name in known if name not in files)):
        if "properties" in known[name]:
            parts += _object(name, known[name])
    return "\n".join(parts)


def _object(title: str, schema: dict) -> list[str]:
    required = set(schema.get("required", ()))
    rows = [f"## {title}", "", "| key | takes | if left out |", "|---|---|---|"]
    for key, entry in schema.get("properties", {}).items():
        default = "must be there" if key in required else _default(entry)
        rows.append(f"| `{key}` | {_cell(_takes(entry))} | {_cell(default)} |")
    return [*rows, ""]


def _default(entry: dict) -> str:
    value = entry.get("default")
    return "" if value is None else f"`{json.dumps(value)}`"


def _takes(entry: dict) -> str:
    told = entry.get("description")
    return told if told else _kind(entry)


def _kind(entry: dict) -> str:
    if "$ref" in entry:
        return entry["$ref"].rsplit("/", 1)[-1]
    if "enum" in entry or "const" in entry:
        return ", ".join(map(str, entry.get("enum", [entry.get("const")])))
    if "anyOf" in entry:
        kinds = dict.fromkeys(_kind(e) for e in entry["anyOf"] if e.get("type") != "null")
        return " or ".join(kinds)
    if entry.get("type") == "array":
        return f"list of {_kind(entry.get('items', {}))}"
    if entry.get("type") == "object" and "name" in entry.get("properties", {}):
        return "mapping with name"
    return str(entry.get("type", "anything"))


def names() -> str:
    """Every public name with its signature and its docstring."""
    import occontrol as oc

    parts = ["# Python", "", "```text", inspect.getdoc(oc) or "", "```", ""]
    for name in oc.__all__:
        parts += _described(f"occontrol.{name}", getattr(oc, name))
    for family, modules in oc._FAMILIES.items():
        own = [n for found in modules.values() for n in found if n not in oc.__all__ or _elsewhere(oc, family, n)]
        for name in own:
            parts += _described(f"occontrol.{family}.{name}", getattr(getattr(oc, family), name))
    return "\n".join(parts)


def _elsewhere(oc: object, family: str, name: str) -> bool:
    return getattr(oc, name) is not getattr(getattr(oc, family), name)


def _described(title: str, thing: object) -> Iterator[str]:
    yield from (f"## {title}", "")
    try:
        signature = str(inspect.signature(thing))  # type: ignore[arg-type]
    except (TypeError, ValueError):
        signature = ""
    yield from ("```text", f"{title.rsplit('.', 1)[-1]}{signature}", "", inspect.getdoc(thing) or "", "```", "")
    if not inspect.isclass(thing):
        return
    for name, member in vars(thing).items():
        if name.startswith("_") or not (callable(member) or isinstance(member, property | classmethod | staticmethod)):
            continue
        told = inspect.getdoc(getattr(thing, name, member))
        if told:
            yield from (f"### {title.rsplit('.', 1)[-1]}.{name}", "", "```text", told, "```", "")


def _cell(text: str) -> str:
    return " ".join(str(text).split()).replace("|", "\\|")


def write(folder: Path) -> None:
    """Write all reference pages into a folder.

    Parameters
    ----------
    folder : made where it is missing
    """
    from occontrol.families import names as families

    folder.mkdir(parents=True, exist_ok=True)
    pages = {"commands.md": commands(), "python.md": names()}
    pages |= {f"keys_{family}.md": keys(family) for family in families()}
    for name, text in pages.items():
        (folder / name).write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
