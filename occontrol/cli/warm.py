"""occontrol warm: compile once, before the first problem."""

from __future__ import annotations

from occontrol.cli.output import note, print_pairs
from occontrol.cli.problems import FamilyName


def warm(family: FamilyName = None) -> int:
    """Compile the loops of one family, or of all, so that the first problem need not wait for it."""
    import time

    from occontrol.cli.watch import announce
    from occontrol.families import find_family, names

    chosen = names() if family is None else [find_family(family).name]
    announce(f"compiling {', '.join(chosen)} (once, about a minute in all)")
    from occontrol.studies.warm import warm as compile_all

    began, remarks = time.perf_counter(), set()
    for _, remark in compile_all(chosen):
        remarks.add(remark)
    for remark in sorted(remarks - {""}):
        note(remark)
    print_pairs([("ready", f"{', '.join(chosen)}, {time.perf_counter() - began:.0f} s")])
    return 0
