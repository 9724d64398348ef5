"""What a solve found, as data: the mixin of every family's result dataclass."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Self

from occontrol.core.kinds import Plain, PlainDict, PlainMapping


class ResultData:
    """Mixin for a frozen dataclass whose fields are the family's entries of result.json.

    Fields keep the order of the file. A field whose metadata has `optional` is left out of `as_dict` when it is None;
    a field called `extra` is a mapping of further entries, put in where it stands.
    """

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Plain: ...

    def as_dict(self) -> PlainDict:
        """The family's part of result.json, in the order of the fields."""
        content: PlainDict = {}
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if field.name == "extra":
                content |= value
            elif value is not None or not field.metadata.get("optional"):
                plain = getattr(value, "as_dict", None)
                content[field.name] = value if plain is None else plain()
        return content

    @classmethod
    def from_dict(cls, content: PlainMapping) -> Self:
        """The result that `content`, read from a result.json, describes; what is not there is None.

        Entries that are no fields go to `extra` where the class has it, and are dropped otherwise.
        """
        fields = {f.name: f for f in dataclasses.fields(cls) if f.init and f.name != "extra"}  # type: ignore[arg-type]
        known = {name: content.get(name) for name in fields}
        if any(f.name == "extra" for f in dataclasses.fields(cls)):  # type: ignore[arg-type]
            known["extra"] = {k: v for k, v in content.items() if k not in fields}
        return cls(**known)


@dataclasses.dataclass(frozen=True)
class PlainResult(ResultData):
    """Entries of a result.json that no family has given its own type yet; they are attributes, too.

    Parameters
    ----------
    extra : the entries by name
    """

    extra: PlainMapping

    def __getattr__(self, name: str) -> Plain:
        entries = self.__dict__.get("extra", {})
        if name not in entries:
            raise AttributeError(f"the result has no '{name}'")
        return entries[name]
