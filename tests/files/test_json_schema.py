"""The JSON Schemas that the package ships are those of the documents."""

import json
import subprocess
import sys
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from occontrol.api import json_schema
from occontrol.families import names, shipped_schema, template
from occontrol.files.examples import heading
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
        "EndlessTargetsDocument",
        "EndlessStepsDocument", "EndlessContinuousDocument",
    ]  # fmt: skip
    assert set(schema["required"]) == {"family", "horizon", "plant", "sensors", "objective"}
    assert schema["properties"]["method"] == {"$ref": "#/$defs/Method"}
    named, *options = whole["$defs"]["Method"]["anyOf"]
    assert named["enum"][0] == "schedule" and {"relaxed", "hminimal", "greedy", "costate-index"} <= set(named["enum"])
    relaxed = next(form for form in options if form["properties"]["name"] == {"const": "relaxed"})
    assert relaxed["properties"]["relative_gap"]["type"] == "number" and relaxed["additionalProperties"] is False
    assert schema["$defs"]["Plant"]["properties"]["A"]["$ref"] == "#/$defs/Matrix"
    matrix = whole["$defs"]["Matrix"]["anyOf"]
    assert {"identity", "scale"} == set(next(f for f in matrix if f.get("title") == "identity")["properties"])
    assert LARGEST == next(f for f in matrix if f.get("title") == "identity")["properties"]["identity"]["maximum"]


def files(family: str | None) -> list[Path]:
    """The shipped problems and templates of a family, or of all."""
    root = shipped_schema().parents[2]
    found = [*root.glob("problems/*.yaml"), *root.glob("occontrol/families/*/template.yaml")]
    return [path for path in found if family is None or heading(path)[0] == family]


def wrong(schema: Path, text: str) -> bool:
    """Whether an outside validator refuses a problem file."""
    validator = jsonschema.Draft202012Validator(json.loads(schema.read_text(encoding="utf-8")))
    return not validator.is_valid(YAML(typ="safe", pure=True).load(text))


@pytest.mark.parametrize("family", names())
def test_an_outside_validator_passes_every_problem_and_template(family):
    found = files(family)
    assert found and not [path for path in found if wrong(shipped_schema(family), path.read_text(encoding="utf-8"))]


def test_the_checker_of_editors_passes_them_all_by_one_schema():
    command = [sys.executable, "-m", "check_jsonschema", "--schemafile", str(shipped_schema()), *map(str, files(None))]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("family", ["athans", None])
def test_an_outside_validator_refuses_a_misspelt_key(family):
    text = template("athans").read_text()
    assert not wrong(shipped_schema(family), text)
    for old, new in (("horizon:", "horizont:"), ("covariance: {diag", "covarianz: {diag"), ("{diag: [5", "{dieg: [5")):
        assert old in text and wrong(shipped_schema(family), text.replace(old, new, 1))
    assert wrong(shipped_schema(family), text.replace("family: athans", "family: athens"))


def test_every_schema_knows_constants_and_has_a_name():
    for family in names():
        text = shipped_schema(family).read_text(encoding="utf-8")
        assert f'"$id": "urn:occontrol:0.2:{family}"' in text and '"constants"' in text
