"""The JSON Schemas that the package ships are those of the documents."""

import json

import pytest

from occontrol.api import json_schema
from occontrol.families import names, shipped_schema
from occontrol.files.schema.matrices import LARGEST


@pytest.mark.parametrize("family", names())
def test_shipped_schema_is_up_to_date(family):
    shipped = json.loads(shipped_schema(family).read_text(encoding="utf-8"))
    assert shipped == json_schema(family), "run: scripts/write_schemas.py"
    forms = [shipped]
    if "anyOf" in shipped:  # a family with several kinds of files
        forms = [shipped["$defs"][form["$ref"].rpartition("/")[2]] for form in shipped["anyOf"]]
    assert all(form["additionalProperties"] is False and "family" in form["required"] for form in forms)


def test_athans_in_detail():
    whole = json_schema("athans")
    schema = whole["$defs"]["Document"] | {"$defs": whole["$defs"]}
    assert [form["$ref"].rpartition("/")[2] for form in whole["anyOf"]] == [
        "Document", "StepsDocument", "SamplesDocument",
        "FormulaDocument", "FormulaStepsDocument", "FormulaSamplesDocument", "TargetsDocument",
        "EndlessStepsDocument", "EndlessContinuousDocument",
    ]  # fmt: skip
    assert set(schema["required"]) == {"family", "horizon", "plant", "sensors", "objective"}
    named, *options = schema["properties"]["method"]["anyOf"]
    assert named["enum"][0] == "schedule" and {"relaxed", "hminimal", "greedy", "costate-index"} <= set(named["enum"])
    relaxed = next(form for form in options if form["properties"]["name"] == {"const": "relaxed"})
    assert relaxed["properties"]["relative_gap"]["type"] == "number" and relaxed["additionalProperties"] is False
    matrix = schema["$defs"]["Plant"]["properties"]["A"]["anyOf"]
    assert {"identity", "scale"} == set(next(f for f in matrix if f.get("title") == "identity")["properties"])
    assert LARGEST == next(f for f in matrix if f.get("title") == "identity")["properties"]["identity"]["maximum"]
