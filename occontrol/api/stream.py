"""A filter that is fed line by line: JSON lines in, one answer each, so that ROS, MQTT or a shell can drive it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator

import numpy as np

from occontrol.api.problems import require
from occontrol.core.arrange import TIME_SLACK
from occontrol.core.errors import OccontrolError, ProblemError, suggest
from occontrol.core.kinds import PlainDict
from occontrol.core.measurement import OnlineLoop, Step
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.families.family import Ability
from occontrol.files.plain_json import plain

KEYS = ("t", "readings")
HINT = 'for example {"t": 0.5, "readings": {"radar": [1.2]}}'


def filter_stream(
    problem: BaseProblem, solution: Solution, lines: Iterable[str], **options: object
) -> Iterator[PlainDict]:
    """The answers of the filter along a schedule, one for every line that holds anything.

    Parameters
    ----------
    problem, solution : of the run
    lines : JSON objects {"t": time, "readings": {sensor: [values]}}: t as in a measurement file, the next such time if
        left out; what lies between is missing, and so are null and sensors left out. {} asks for what is known now
    options : model and gate, as of `run_filter`, where the family has them

    Yields {"t", "estimate", "deviation", "predicted", "predicted_deviation", "nis", "dimension", "next_sensors",
    "next_t", ..}, and {"error", "line"} for a line whose values are refused; time goes on to where they belong.
    Raises UsageError for families that do not run on line and for options that they do not have.
    """
    family = require(problem, Ability.ONLINE)
    loop, step = family.filter_loop(problem, solution, **options), None
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            given = _read(line)
            if given:
                step = _advance(loop, given)
            yield plain(_answer(loop, step))  # type: ignore[misc]
        except OccontrolError as error:
            yield {"error": str(error), "line": number}


def _read(line: str) -> PlainDict:
    """The object of a line, its readings as arrays."""
    try:
        given = json.loads(line, object_pairs_hook=_once, parse_constant=_refuse)
    except (json.JSONDecodeError, RecursionError):
        raise ProblemError("the line is not one JSON object", HINT) from None
    if not isinstance(given, dict):
        raise ProblemError("the line is not one JSON object", HINT)
    for key in given:
        if key not in KEYS:
            raise ProblemError(f"there is no key '{key}'", suggest(key, KEYS))
    if "t" in given and (isinstance(given["t"], bool) or not isinstance(given["t"], int | float)):
        raise ProblemError("t is not a number", HINT)
    readings = given.get("readings", {})
    if not isinstance(readings, dict):
        raise ProblemError("readings is not an object of sensors", HINT)
    for name, values in readings.items():
        listed = values if isinstance(values, list) else [values]
        if not all(v is None or (isinstance(v, int | float) and not isinstance(v, bool)) for v in listed):
            raise ProblemError(f"the values of sensor '{name}' are not numbers or null", HINT)
        readings[name] = np.array([math.nan if v is None else float(v) for v in listed])
    return given


def _once(pairs: list[tuple[str, object]]) -> PlainDict:
    found: PlainDict = {}
    for key, value in pairs:
        if key in found:
            raise ProblemError(f"'{key}' stands twice in the line", "each key once")
        found[key] = value
    return found


def _refuse(word: str) -> float:
    raise ProblemError(f"{word} is no number of JSON", "null for a value that is missing")


def _advance(loop: OnlineLoop, given: PlainDict) -> Step:
    """Up to the time of the line without values, then with its values."""
    readings = given.get("readings", {})
    for _ in range(_gaps(loop.times_left, given.get("t"))):
        loop.step({})
    return loop.step(readings)


def _gaps(times: np.ndarray, t: float | None) -> int:
    """How many steps end before `t`."""
    if not len(times):
        raise ProblemError("the horizon is over")
    if t is None:
        return 0
    i = int(np.argmin(np.abs(times - t)))
    beside = np.abs(np.diff(times[max(i - 1, 0) : i + 2]))
    gap = float(np.min(beside[beside > 0], initial=np.inf))
    if not abs(times[i] - t) <= TIME_SLACK * (gap if np.isfinite(gap) else 1.0) + 4 * np.spacing(abs(t)):
        near = " and ".join(f"{each:.9g}" for each in times[max(i - 1, 0) : i + 2][:2])
        raise ProblemError(f"no values arrive at t = {t:.9g}", f"the nearest times from here on: {near}")
    return i


def _answer(loop: OnlineLoop, step: Step | None) -> PlainDict:
    left = loop.times_left
    coming: PlainDict = {
        "next_sensors": list(loop.next_sensors),
        "next_t": float(left[0]) if len(left) else None,
    }
    if step is None:
        return coming
    found: PlainDict = {
        "t": float(step.time),
        "estimate": step.estimate,
        "deviation": step.standard_deviation,
        "nis": step.nis,
        "dimension": int(step.dimension),
        **coming,
    }
    if len(step.prediction):
        found["predicted"] = step.prediction
        found["predicted_deviation"] = np.sqrt(np.maximum(np.diag(step.prediction_covariance), 0.0))
    for name in ("planned", "skipped", "missing", "level", "guarantee"):
        if hasattr(step, name):
            found[name] = getattr(step, name)
    return found
