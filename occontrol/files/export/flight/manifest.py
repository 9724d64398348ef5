"""What was written and how large it is: host/MANIFEST.json."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from occontrol.core.kinds import PlainDict
from occontrol.core.versions import KEY, SCHEMA_VERSION
from occontrol.files.export.flight.content import Content


def run_digest(content: Content, problem: str) -> str:
    """SHA-256 over the problem's digest and the tables: what of a run reaches the target, whenever it was solved.

    Parameters
    ----------
    content : Content
    problem : digest of the problem
    """
    digest = hashlib.sha256(problem.encode())
    for table in content.tables:
        digest.update(f"{table.declarator}:{table.crc:08x};".encode())
        digest.update(table.values.astype(table.values.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def sizes(content: Content) -> PlainDict:
    """Bytes of the tables, of one filter and of its working arrays, and multiplications of a step.

    Parameters
    ----------
    content : Content
    """
    tables = {table.name: int(table.values.nbytes) for table in content.tables}
    found: PlainDict = {"tables": {"total": sum(tables.values()), **tables}}
    if content.plan.filter is None:
        return found
    n, m = content.plan.filter.states, content.values
    byte = 8 if content.options.precision == "double" else 4
    full, rows = "full" in content.flags, n + m
    numbers = n + 1 + (n + max(1, n * (n - 1) // 2) if full else 0)
    found["filter"] = -(-(numbers * byte + 9) // byte) * byte
    if content.plan.formulas is not None:
        return found | _sizes_of_formulas(content, int(found["filter"]), byte)  # type: ignore[call-overload]
    found["stack_of_working_arrays"] = byte * (n + m) + 4 * m
    multiplications = n * (n + m)
    if "plan" in content.flags:
        found["multiplications_planned"] = multiplications + m * (m - 1) // 2 + 2 * m + n * m
    if full:
        columns = 2 * ((n + rows + 1) // 2)
        found["stack_of_working_arrays"] += byte * (columns * (rows + 2) + rows + n + max(1, n * (n - 1) // 2))
        found["stack_of_working_arrays"] += 4 * rows
        sweep = sum((n + i + 1) * (1 + (rows - i) + (rows - i - 1)) for i in range(rows))
        found["multiplications_full"] = multiplications + rows * n * (n - 1) // 2 + sweep
    return found


def _sizes_of_formulas(content: Content, one: int, byte: int) -> PlainDict:
    """Bytes of the arrays that the step of a nonlinear filter works in, and operations of each formula."""
    n, m = content.table("mean").shape[1], content.values
    rows, columns = n + m, 2 * ((n + n + m + 1) // 2)
    sweep = byte * (columns + rows + n + max(1, n * (n - 1) // 2))
    array = byte * (rows * columns + columns + rows) + 4 * rows
    work = byte * max(program.work for program in content.programs.values())
    move = array + byte * 4 * n * n + max(sweep, byte * (3 * n + 3 * n * n) + work)
    step = one + array + byte * (m + m * n + m * m) + max(sweep, move)
    operations = {name: program.count for name, program in content.programs.items()}
    return {"stack_of_working_arrays": step, "operations": operations}


def manifest(content: Content, texts: Mapping[str, str], digest: str, problem: str, version: str) -> PlainDict:
    """The content of MANIFEST.json.

    Parameters
    ----------
    content : Content
    texts : {path: text} of every other file
    digest : of the run
    problem : digest of the problem
    version : of the writer
    """
    plan, model = content.plan, content.plan.filter
    return {
        KEY: SCHEMA_VERSION,
        "run": digest,
        "problem": problem,
        "occontrol": version,
        "options": {
            "precision": content.options.precision,
            "gains_only": content.options.gains_only,
            "no_plan": content.options.no_plan,
        },
        "filter": plan.why if model is None else content.options.words,
        "intervals": plan.intervals,
        "sensors": list(plan.names),
        "states": None if model is None else model.states,
        "bytes": sizes(content),
        "deviations": DEVIATIONS,
        "files": {path: hashlib.sha256(text.encode()).hexdigest() for path, text in sorted(texts.items())},
    }


# advisory rules of MISRA C:2012 that are not kept, and why; no required one
DEVIATIONS = {
    "2.4": "the enumeration of the sensors is for the caller",
    "2.5": "macros of the header are for the caller",
    "8.7": "functions are for the caller",
    "8.9": "constants that one function reads stand beside those that several do",
    "15.5": "a call returns where it finds a mistake, before it has changed anything",
    "19.2": "the checksum reads the bits of a number through a union",
}
