"""occontrol show: what a run folder holds, and where it comes from."""

from __future__ import annotations

from occontrol.cli.export import RunFolder
from occontrol.cli.output import number, percent, print_json, print_pairs
from occontrol.cli.solve import JsonFlag
from occontrol.core.kinds import Plain, PlainDict
from occontrol.core.printed import rounded_down


def show(run: RunFolder, json: JsonFlag = False) -> int:
    """Print a run's numbers, its versions and digest, and the machine and command that made it."""
    from occontrol.files.run_show import shown_run

    result, origin = shown_run(run)
    if json:
        print_json({"result": result, "provenance": origin})
        return 0
    top = result.get("top")
    first = top if isinstance(top, dict) else result
    pairs = [
        ("run", f"{run}/"),
        ("family", str(result["family"])),
        ("status", f"{result['status']}: {result.get('message', '')}"),
        ("method", f"{result['method']}, {number(result.get('iterations'))} iterations, {_seconds(result)}"),
    ]
    if isinstance(first.get("cost"), int | float):
        pairs.append(("cost", number(first.get("cost"))))
    if isinstance(first.get("lower_bound"), int | float):
        bound = f"{rounded_down(first['lower_bound'], 8)}   {_gap(first)}"
        pairs.append(("lower bound", bound))
    pairs.append(("digest", str(result.get("digest", "not recorded (written by the first edition)"))))
    pairs.append(("versions", _listed(result.get("versions"))))
    if origin is None:
        pairs.append(("provenance", "not recorded (written by the first edition)"))
    else:
        pairs += [(key, _listed(origin.get(key))) for key in ("machine", "blas", "threads", "start", "end", "folder")]
        command = origin.get("command")
        pairs.append(("command", " ".join(map(str, command)) if isinstance(command, list) else "-"))
    if (run / "interrupted" / "result.json").exists():
        pairs.append(("interrupted", f"{run / 'interrupted'}/ holds a result that was not finished; solve --resume"))
    print_pairs(pairs)
    return 0


def _gap(first: PlainDict) -> str:
    gap = first.get("relative_gap")
    return f"gap {number(gap, 3)} (a difference)" if first.get("gap") == "difference" else f"gap {percent(gap)}"


def _seconds(result: PlainDict) -> str:
    return f"{number(result.get('seconds'), 4)} s"


def _listed(value: Plain) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {entry}" for key, entry in value.items() if entry is not None) or "-"
    return "-" if value is None else str(value)
