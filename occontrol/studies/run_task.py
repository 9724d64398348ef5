"""The one function that every engine calls: a task's file in, its result folder out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from occontrol.studies.folder import StudyFolder

if TYPE_CHECKING:
    from occontrol.core.solution import Solution

RESULT = "result.json"


def run_task(folder: str, identity: str, start: str | None = None) -> str:
    """Do one task of a study; where its result is there already, nothing.

    Parameters
    ----------
    folder : of the study
    identity : of the task
    start : identity of the task whose result it begins at; where that has no schedule, it begins anew

    Returns an empty text when the result is there, else why the task failed. That no schedule exists is a result.
    """
    from occontrol.core.errors import InfeasibleError, OccontrolError

    place = StudyFolder(Path(folder))
    if place.done(identity):
        return ""
    try:
        return _solve(place, identity, start)
    except InfeasibleError as error:
        _without_schedule(place, identity, str(error))
        return ""
    except OccontrolError as error:
        return str(error)
    except MemoryError:
        return "out of memory"
    except Exception as error:  # a fault of ours costs this task its try and no other task anything
        return f"unexpected {type(error).__name__}: {' '.join(str(error).split())}"


def _solve(place: StudyFolder, identity: str, start: str | None) -> str:
    from occontrol.api import read_problem, solve, write_run
    from occontrol.core.monitor import Monitor
    from occontrol.core.solution import Status

    problem = read_problem(place.task_file(identity))
    monitor = Monitor()
    monitor.resume = _neighbour(place, start)
    solution = solve(problem, None, monitor)
    if solution.status is Status.INFEASIBLE:
        _without_schedule(place, identity, solution.message or solution.status.text)
        return ""
    if solution.status in (Status.FAILED, Status.INTERRUPTED):
        return f"{solution.status}: {solution.message or solution.status.text}"
    with place.staged(identity) as stage:
        write_run(stage, solution.problem, solution)
    return ""


def _neighbour(place: StudyFolder, start: str | None) -> Solution | None:
    from occontrol.api import read_run
    from occontrol.core.errors import OccontrolError

    if start is None or not place.done(start):
        return None
    try:
        return read_run(place.result_folder(start))[1]
    except OccontrolError:  # that no schedule exists is a result without one
        return None


def _without_schedule(place: StudyFolder, identity: str, message: str) -> None:
    from occontrol.files.atomic import write_text
    from occontrol.files.plain_json import load_json, to_json

    document = load_json(place.task_file(identity))
    content = {"family": document.get("family"), "status": "infeasible", "message": message}
    with place.staged(identity) as stage:
        write_text(stage / RESULT, to_json(content))
