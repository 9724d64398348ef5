"""A problem file (.yaml, .json, or the problem.json of a run folder) -> a validated problem of whatever family."""

from __future__ import annotations

import stat
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from occontrol.core.errors import Collector, FileAccessError, Mistake, ProblemError, one_per_cause
from occontrol.core.errors import Path as Place
from occontrol.core.problem import BaseProblem
from occontrol.core.versions import newer
from occontrol.files.positions import Text, at

if TYPE_CHECKING:
    from pydantic import BaseModel

MAX_YAML = 2 * 2**20
MAX_JSON = 64 * 2**20


@dataclass(frozen=True, eq=False)
class LoadedDocument:
    """A problem file that is well formed and whose family is known; `build` makes the problem."""

    path: Path
    text: Text
    family: str
    schema: ModuleType

    def build(self, check: Callable[[BaseProblem], list[Mistake]] | None = None) -> BaseProblem:
        """The family's problem; ProblemError with every mistake, those of `check` too, and its place."""
        try:
            return self.build_unplaced(check)
        except ProblemError as error:
            raise self.text.placed(error.mistakes) from None

    def build_unplaced(self, check: Callable[[BaseProblem], list[Mistake]] | None = None) -> BaseProblem:
        """The same; the mistakes of its ProblemError carry paths into the document, not yet lines."""
        from occontrol.files.schema.common import Context
        from occontrol.files.schema.dates import with_times
        from occontrol.files.schema.validation import validate

        found = Collector()
        data, calendar = with_times(self.text.data, found)
        if found.mistakes:
            raise ProblemError(one_per_cause([*self.text.mistakes, *found.mistakes]))
        context = Context(data, self.path.parent, self.path.stem, calendar)
        context.found.mistakes += self.text.mistakes
        lacking: set[Place] = set()
        several = documents_of(self.schema)
        model = several[0] if len(several) == 1 else self.schema.model_for(data)
        document = validate(model, data, context.found, lacking)
        said = list(context.found.mistakes)
        with context.found.under():
            problem = self.schema.build(document, context)
        # nothing that is said about the stand-ins for what is lacking counts
        context.found.mistakes = [
            m for m in context.found.mistakes if m in said or not any(m.path[: len(p)] == p for p in lacking)
        ]
        context.found.raise_if_any()
        if check is not None:
            context.found.mistakes += check(problem)
            context.found.raise_if_any()
        return problem


def documents_of(schema: ModuleType) -> tuple[type[BaseModel], ...]:
    """The forms that a problem file may have: `Document`, or several `DOCUMENTS` among which `model_for(data)` chooses.

    Parameters
    ----------
    schema : the schema module of a family
    """
    return getattr(schema, "DOCUMENTS", (schema.Document,))


def read_bytes(path: Path, limit: int, kind: str) -> bytes:
    """The content of a regular file of at most `limit` bytes; FileAccessError or ProblemError."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise FileAccessError(f"{path} is a folder, not a {kind}")
        if not stat.S_ISREG(mode):
            raise FileAccessError(f"{path} is not an ordinary file")
        with path.open("rb") as file:
            content = file.read(limit + 1)
    except FileNotFoundError:
        raise FileAccessError(f"there is no file {path}") from None
    except (OSError, ValueError) as error:
        raise FileAccessError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    if len(content) > limit:
        hint = "put tables into an .npz file beside it" if limit == MAX_YAML else ""
        raise at(str(path), 1, 1, f"the file is larger than {limit / 2**20:g} MB", hint)
    return content


def read_text(path: Path, limit: int, kind: str) -> str:
    """The text of a file; binary data, other encodings than UTF-8 and empty files are mistakes.

    Raises ProblemError for these, FileAccessError where the file cannot be read.
    """
    content = read_bytes(path, limit, kind)
    if b"\0" in content:
        raise at(str(path), 1, 1, f"this is binary data, not a {kind}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = content[: error.start]
        line, column = before.count(b"\n") + 1, error.start - before.rfind(b"\n")
        raise at(str(path), line, column, "this is not UTF-8 text", "save the file as UTF-8") from None
    if not text.strip():
        raise at(str(path), 1, 1, "the file is empty")
    return text


def load_document(path: str | Path, families: Sequence[str], schema_of: Callable[[str], ModuleType]) -> LoadedDocument:
    """Read and parse a problem file and find its family; nothing is built yet.

    Parameters
    ----------
    path : a .yaml, .yml or .json file
    families : the names that `family:` may have
    schema_of : the schema module of a family, imported when it is called

    Raises ProblemError with the place of what is wrong, FileAccessError where the file cannot be read.
    """
    from occontrol.files.json_text import read_json
    from occontrol.files.schema.crowd import family_in, refuse_crowd
    from occontrol.files.schema.words import shown, suggest
    from occontrol.files.yaml_text import read_yaml

    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (".yaml", ".yml", ".json"):
        read_bytes(path, 0, "problem file") if not path.exists() or path.is_dir() else None
        raise at(str(path), 1, 1, f"the file name ends in '{suffix}'", "problem files end in .yaml, .yml or .json")
    is_json = suffix == ".json"
    source = read_text(path, MAX_JSON if is_json else MAX_YAML, "problem file")
    if not is_json and (crowded := family_in(source)) in families:
        models = documents_of(schema_of(str(crowded)))
        refuse_crowd(source, str(path), sorted({name for model in models for name in model.model_fields}))
    text = (read_json if is_json else read_yaml)(source, str(path))
    if not isinstance(text.data, dict):
        raise at(
            str(path), 1, 1, f"the file holds {shown(text.data)}, it must be a mapping", "begin with family: athans"
        )
    if later := newer(text.data):
        raise text.placed([later])
    family = text.data.get("family")
    known = list(families)
    if family not in known:
        what = "the problem has no 'family'" if family is None else f"family is {shown(family)}, it must be a name"
        hint = "family: " + " | ".join(known)
        if isinstance(family, str):
            what, hint = f"unknown family '{family[:60]}'", suggest(family, known)
        raise text.placed([*text.mistakes, Mistake(("family",), what, hint)])
    return LoadedDocument(path, text, family, schema_of(family))
