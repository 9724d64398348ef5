"""Caps on all shipped problems of the family athans that take them: bounds and schedules at the price of the cap.

    .venv/bin/python scripts/quality_caps.py run [NAME ..]     measures, into runs/quality_caps.json
    .venv/bin/python scripts/quality_caps.py tree [NAME ..]    the same; the tree goes on where more than .1 % is left
    .venv/bin/python scripts/quality_caps.py table             the table of docs/rules_quality.md

A problem is first solved as it stands. Then at most half of that observation cost may be spent, with the least error;
and the error may be 1.5 times as large, with the least observation cost. Rules of the file are kept, seconds are of the
processor. What a problem refuses is printed in its words.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import occontrol as oc
from occontrol.core.errors import OccontrolError
from occontrol.families.athans.methods import RelaxRoundPolish
from occontrol.families.athans.rules.statement import Constraints

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "runs" / "quality_caps.json"
CAPS = {"max_observation_cost": "error", "max_error": "observation"}
WIDE, TREE = 1e-3, 2000  # a gap that the tree is asked to close, and its nodes
HALF, LARGER = 0.5, 1.5  # of the observation cost, and of the error, of the problem as it stands


def names() -> list[str]:
    """The shipped problems of the family, by name."""
    found = sorted((ROOT / "problems").glob("*.yaml"))
    return [path.stem for path in found if "\nfamily: athans\n" in f"\n{path.read_text()}"]


def problem(name: str) -> Any:
    """A problem without method and known answer, with one step an interval where it is integrated."""
    read = replace(oc.read_problem(ROOT / "problems" / f"{name}.yaml"), expect=None, method=None)  # type: ignore[call-arg]
    steps = getattr(read, "integration", None)
    return read if steps is None else replace(read, integration=replace(steps, substeps=1))  # type: ignore[call-arg]


def measured(name: str, tree: bool) -> dict:
    """Bound, schedule and seconds for either cap; or why there is none."""
    found: dict = {"problem": name}
    try:
        p = problem(name)
        free = oc.solve(p).result
    except OccontrolError as error:
        return found | {"refused": str(error).splitlines()[0]}
    if p.of_targets:
        return found | {"refused": "many targets have no caps"}
    limits = {
        "max_observation_cost": HALF * free["observation_cost"],
        "max_error": LARGER * (free["running_cost"] + free["prediction_error"]),
    }
    for cap, goal in CAPS.items():
        began = time.process_time()
        try:
            rules = replace(p.rules or Constraints(), **{cap: limits[cap]})
            r = oc.solve(replace(p, rules=rules, minimise=goal)).result
            if tree and r["relative_gap"] > WIDE:
                exact = RelaxRoundPolish(exact={"max_nodes": TREE})
                r = oc.solve(replace(p, rules=rules, minimise=goal), exact).result
        except OccontrolError as error:
            found[cap] = {"refused": str(error).splitlines()[0]}
            continue
        seconds = time.process_time() - began
        found[cap] = {
            "bound": r["lower_bound"], "cost": r["cost"], "limit": limits[cap], "seconds": seconds,
            "proven": bool(r["proven_optimal"]), "nodes": r["nodes"],
        }  # fmt: skip
    return found


def cell(at: dict) -> str:
    """Bound, value and gap in percent; or why there are none."""
    if "refused" in at:
        return f"refused: {at['refused']}"
    gap = 100 * max(at["cost"] - at["bound"], 0.0) / abs(at["cost"]) if at["cost"] else 0.0
    how = "proven" if at["proven"] else f"{gap:.2g}"
    return f"{at['bound']:.7g}, {at['cost']:.7g}, {how} ({at['nodes']}, {at['seconds']:.1f} s)"


def table(results: list[dict]) -> str:
    """The table as Markdown."""
    lines = [
        "| problem | cap on the cost: bound, error, gap % | cap on the error: bound, observation cost, gap % |",
        "|---|---|---|",
    ]
    for r in results:
        cells = [f"refused: {r['refused']}", ""] if "refused" in r else [cell(r[cap]) for cap in CAPS]
        lines.append(f"| {r['problem']} | {cells[0]} | {cells[1]} |")
    return "\n".join(lines)


def main() -> int:
    """Measure, or print the table."""
    known = json.loads(OUT.read_text()) if OUT.exists() else {}
    if sys.argv[1:2] == ["table"]:
        print(table([known[name] for name in names() if name in known]))
        return 0
    if sys.argv[1:2] not in (["run"], ["tree"]):
        print(__doc__)
        return 2
    for name in sys.argv[2:] or names():
        known[name] = measured(name, sys.argv[1] == "tree")
        OUT.parent.mkdir(exist_ok=True)
        OUT.write_text(json.dumps(known))
        print(table([known[name]]).splitlines()[-1], flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
