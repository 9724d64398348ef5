"""The keys of a criterion in problem files."""

from __future__ import annotations

from pydantic import Field

from occontrol.families.athans.criteria.statement import CriterionChoice
from occontrol.files.schema.common import Strict


class CriterionKeys(Strict):
    """What of the outputs' covariance counts."""

    name: str = Field(
        description="name: trace, log-trace, logdet, largest-eigenvalue, schatten, or peak",
        json_schema_extra={"enum": ["trace", "log-trace", "logdet", "largest-eigenvalue", "schatten", "peak"]},
    )
    p: float | None = Field(None, description="p: of schatten, at least 1")
    at: str | None = Field(None, description="at: posterior or prior, of a peak of readings")
    since: float | None = Field(None, alias="from", description="from: the first time at which a peak counts")
    limit: float | None = Field(None, description="limit: what the peak may not exceed; a constraint")


def choice_of(keys: CriterionKeys | None) -> CriterionChoice | None:
    """The choice that a file states, or None.

    Parameters
    ----------
    keys : as read
    """
    return None if keys is None else CriterionChoice(keys.name, keys.p, keys.at, keys.since, keys.limit)
