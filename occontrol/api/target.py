"""A run onto a target: flight code, FMU, and whether the code computes what Python does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from occontrol.api.files import document, read_run
from occontrol.api.problems import family_of
from occontrol.core.errors import UsageError
from occontrol.core.state_labels import state_labels
from occontrol.core.target import TargetPlan

if TYPE_CHECKING:
    from occontrol.files.export.flight.content import Options
    from occontrol.files.export.flight.verify import Verification

FLIGHT = ("precision", "gains_only", "no_plan", "prefix")
FMU = (*FLIGHT, "fmi", "build")


@dataclass(frozen=True)
class _Target:
    plan: TargetPlan
    options: Options
    prefix: str
    title: str
    digest: str

    def flight(self) -> dict[str, str]:
        from occontrol.files.export.flight import flight_texts

        return flight_texts(self.plan, self.options, self.prefix, self.title, self.digest)


def export_target(run: str | Path, to: str, out: str | Path | None = None, **options: object) -> list[Path]:
    """Write code of a run's schedule and filter; the run folder alone is enough.

    Parameters
    ----------
    run : the run folder
    to : flight or fmu
    out : folder (file, for an FMU) to write [RUN/flight, RUN/export.fmu]
    options : precision ("double" or "single"), gains_only (planned gains and variances only), no_plan (without the
        tables of the plan: covariance and gain are computed at every step), prefix (of every name in C, oc_ and the
        run's name if left out); of an FMU also fmi (2 or 3) and build (put a binary of this computer into it)

    Returns the files written. Raises UsageError for families without a schedule or filter for a target and for
    options that do not fit, ProblemError for a damaged run folder, FileAccessError when the files cannot be written,
    SolveFailed where a binary cannot be built.
    """
    place = _place(run, to, out)
    if to == "flight":
        from occontrol.files.export.flight import write_flight

        return write_flight(place, _target(run, options, FLIGHT, to).flight())
    from occontrol.files.export.fmu import fmu_texts, write_fmu

    edition, build = options.pop("fmi", 3), bool(options.pop("build", False))
    target = _target(run, options, FMU, to)
    texts = fmu_texts(
        target.plan, target.options, target.prefix, target.title, target.digest, edition if edition in (2, 3) else 0
    )
    return write_fmu(place, texts, target.prefix if build else "")


def verify_target(run: str | Path, to: str, out: str | Path | None = None, **options: object) -> Verification:
    """Whether flight code that was written from a run is what the run gives, and computes what Python does.

    Parameters
    ----------
    run, to, out, options : as they were written, see `export_target`

    Returns what was tried and how it ended. Raises what `export_target` raises, UsageError for other formats.
    """
    from occontrol.files.export.flight.verify import verify

    if to != "flight":
        raise UsageError(f"there is nothing to verify in --to {to}\n  hint: --verify is for --to flight")
    target = _target(run, options, FLIGHT, to)
    return verify(_place(run, to, out), target.flight(), target.prefix, target.plan.filter is not None)


def _place(run: str | Path, to: str, out: str | Path | None) -> Path:
    from occontrol.files.export import TARGETS
    from occontrol.files.run_record import refuse_run_files

    place = Path(run) / TARGETS[to] if out is None else Path(out)
    if place.is_dir() and Path(TARGETS[to]).suffix:
        place = place / TARGETS[to]
    refuse_run_files(Path(run), place)
    return place


def _target(run: str | Path, given: dict[str, object], known: tuple[str, ...], to: str) -> _Target:
    from occontrol.files.export.flight.content import Options
    from occontrol.files.export.flight.text import check_prefix, prefix_of
    from occontrol.files.run_choice import problem_digest

    run, options = Path(run), dict(given)
    unknown = [word for word in options if word not in known]
    if unknown:
        raise UsageError(f"--to {to} has no {unknown[0]}\n  hint: {', '.join(known)}")
    prefix = options.pop("prefix", None)
    name = prefix_of(run.resolve().name) if prefix is None else check_prefix(str(prefix))
    chosen = Options(**options)  # type: ignore[arg-type]
    problem, solution = read_run(run)
    plan = family_of(problem).target_plan(problem, solution)
    if plan.filter is not None and len(state_labels(problem)) == plan.filter.states:
        plan = replace(plan, states=tuple(state_labels(problem)))
    title = f"{problem.name}; family {problem.family}, method {solution.method}"
    return _Target(plan, chosen, name, title, problem_digest(document(problem)))
