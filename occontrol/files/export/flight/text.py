"""The C text of a target: templates with the names, sizes and tables of one run.

A template holds occ_ and OCC_, which become the prefix, words between @ signs, which are replaced, and parts between
the lines /*?flag*/ and /*.*/, which are kept where every flag holds (!flag: does not hold).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.resources import files

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.state_labels import default_names
from occontrol.files.export.c_text import comment
from occontrol.files.export.flight.content import Content
from occontrol.files.export.flight.formula_tables import elementary_flags, formula_source
from occontrol.files.export.flight.tables import Table

PARTS = ("a_head.c", "b_full.c", "b_move.c", "c_step.c", "d_moments.c", "e_schedule.c")
LONGEST_PREFIX = 24
KEYWORDS = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while".split()
)


def prefix_of(name: str) -> str:
    """oc_ and the `name` of a run, every character but letters, digits and _ replaced by _."""
    return "oc_" + re.sub(r"[^A-Za-z0-9_]", "_", name)[:LONGEST_PREFIX]


def check_prefix(prefix: str) -> str:
    """The `prefix` itself; UsageError unless it is an identifier of C that is free."""
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,30}", prefix) is None or prefix in KEYWORDS:
        hint = "letters, digits and _, a letter first, at most 31 characters, no keyword of C"
        raise UsageError(f"'{prefix}' cannot begin the names of C functions\n  hint: {hint}")
    return prefix


def template(name: str) -> str:
    """The text of the template of flight code called `name`."""
    return packaged("occontrol.files.export.flight", name)


def packaged(package: str, name: str) -> str:
    """The text of the template called `name` of a `package`."""
    return (files(package) / "templates" / name).read_text(encoding="utf-8")


def kept_parts(text: str, flags: set[str]) -> str:
    """The lines of a template `text` whose parts hold for `flags`."""
    lines, open_parts = [], []
    for line in text.splitlines():
        if match := re.fullmatch(r"/\*\?(.*)\*/", line):
            words = match[1].split()
            open_parts.append(all((w[1:] not in flags) if w[0] == "!" else (w in flags) for w in words))
        elif line == "/*.*/":
            open_parts.pop()
        elif all(open_parts):
            lines.append(line)
    return "\n".join(lines) + "\n"


def filled(text: str, prefix: str, words: dict[str, str]) -> str:
    """A template `text` with its `words` and its `prefix` in place."""
    for name, value in words.items():
        text = text.replace(f"@{name}@", value)
    return re.sub(r"\bocc_", f"{prefix}_", re.sub(r"\bOCC_", f"{prefix.upper()}_", re.sub(r"\bocc\b", prefix, text)))


def words_of(content: Content, title: str, digest: str) -> dict[str, str]:
    """What the templates say of one run.

    Parameters
    ----------
    content : Content
    title : of the run, in words
    digest : of the run, hexadecimal
    """
    plan = content.plan
    k = "k" if plan.variable == "k" else "t"
    interval = f"The number of the interval around {k}"
    time = "Start of interval k, the time of the estimate after k steps; its values arrive at the time of k + 1."
    if plan.instants:
        interval = f"The number of the interval that ends at the first reading not before {k}"
        time = "Time of the estimate after k steps: the start, then every reading."
    return {
        "TITLE": comment(title),
        "KIND": content.options.words if plan.filter else "schedule only",
        "DIGEST": digest,
        "SHORT_DIGEST": digest[:12],
        "SIZES": _sizes(content, digest),
        "ENUMS": _enums(content),
        "DECLARATIONS": "\n".join(f"extern {table.declarator};" for table in content.tables),
        "CHECKS": ",\n".join(_check(table) for table in content.tables),
        "INTERVAL": interval,
        "TIME": time,
        "AT": comment(plan.predicted_for),
        "NOW": "occ_time(f.k)" if plan.again is None else "occ_time_after(&f, 0U)",
        "NOW_K": "occ_time(k)" if plan.again is None else "occ_time_after(f, 0U)",
        "EARLY": "t" if plan.again is None else "(here + slack)",
        "LATE": "t" if plan.again is None else "(here - slack)",
    }


def header(content: Content, prefix: str, words: dict[str, str]) -> str:
    """PREFIX_filter.h of `content`, with its `prefix` and `words`."""
    return filled(kept_parts(template("filter.h"), content.flags), prefix, words)


def source(content: Content, prefix: str, words: dict[str, str]) -> str:
    """PREFIX_filter.c of `content`, with its `prefix` and `words`."""
    parts = PARTS if content.plan.filter is not None else ("a_schedule.c", "e_schedule.c")
    texts = [kept_parts(template(name), content.flags) for name in parts]
    if content.plan.formulas is not None:
        flags = elementary_flags(content.flags, content.programs)
        elementary = kept_parts(template("b_elementary.c"), flags) if flags else ""
        dtype = content.options.dtype
        texts.insert(1, formula_source("".join(texts), content.plan, content.programs, dtype, elementary))
    return filled("".join(texts), prefix, words)


def tables(content: Content, prefix: str, words: dict[str, str]) -> str:
    """PREFIX_tables.c of `content`, with its `prefix` and `words`."""
    head = f"/* {words['TITLE']}\n * tables of run {words['SHORT_DIGEST']} */\n#include \"occ_filter.h\"\n\n"
    return filled(head, prefix, {}) + "\n".join(
        filled(table.declarator, prefix, {}) + table.definition()[len(table.declarator) :] for table in content.tables
    )


def _check(table: Table) -> str:
    numbers = f"{table.values.nbytes}U, {table.values.itemsize}U, 0x{table.crc:08X}U"
    return f"        {{(const unsigned char *)occ_{table.name}, {numbers}}}"


def _sizes(content: Content, digest: str) -> str:
    plan, single = content.plan, content.options.precision == "single"
    numbers = {"INTERVALS": plan.intervals, "SENSORS": len(plan.names)}
    lines = []
    if plan.filter is not None:
        n = plan.filter.states
        numbers |= {"STATES": n, "VALUES": content.values, "LOWER": max(1, n * (n - 1) // 2)}
        if plan.filter.outputs:
            numbers["OUTPUTS"] = plan.filter.outputs
        if plan.formulas is not None:
            numbers |= {"SQUARE": n * n, "SUBSTEPS": plan.formulas.substeps, "LAST": plan.formulas.last}
        kind, ending = ("float", "F") if single else ("double", "")
        largest = np.finfo(content.options.dtype).max
        lines += [f"typedef {kind} occ_value; /* {content.options.precision} precision */", ""]
        smallest = np.finfo(content.options.dtype).tiny
        lines += [f"#define OCC_LARGEST {largest!s}{ending}", f"#define OCC_SMALLEST {smallest!s}{ending}"]
        lines += [f"#define OCC_ZERO 0.0{ending}"]
        lines += [f"#define OCC_ONE 1.0{ending}", f"#define OCC_HAS_PLAN {int('plan' in content.flags)}U"]
    if plan.again is not None:
        numbers["AGAIN"] = plan.again
    lines += [f"#define OCC_{name} {value}U" for name, value in numbers.items()]
    lines += [f'#define OCC_DIGEST "{digest}"']
    return "\n".join(lines)


def _enums(content: Content) -> str:
    plan, text = content.plan, _enum("sensor", content.plan.names)
    if plan.filter is None:
        return text
    return f"{text}\n\n{_enum('state', plan.states or default_names(plan.filter.states))}"


def _enum(kind: str, names: Sequence[str]) -> str:
    keys = enumerators(f"OCC_{kind.upper()}_", names)
    lines = [f"    {key} = {j}{',' if j + 1 < len(keys) else ' '} /* {comment(name)} */"
             for j, (key, name) in enumerate(zip(keys, names, strict=True))]  # fmt: skip
    return "\n".join(["typedef enum {", *lines, f"}} occ_{kind};"])


def enumerators(head: str, names: Sequence[str]) -> list[str]:
    """Identifiers of C for names that may hold anything, all different.

    Parameters
    ----------
    head : what they begin with
    names : in any letters; a unit in brackets is left out
    """
    found: list[str] = []
    for name in names:
        plain = re.sub(r" \[.*\]$", "", name).upper().encode("ascii", "replace").decode()
        key = head + re.sub(r"[^A-Z0-9]", "_", plain)[:40]
        others = (f"{key}_{i}" for i in range(1, len(names) + 1))
        found.append(key if key not in found else next(other for other in others if other not in found))
    return found

