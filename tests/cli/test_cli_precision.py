"""The precision family on the command line: exit codes and messages."""

import json
from pathlib import Path

import pytest

from occontrol.cli import run as command

OUT_OF_REACH = """
family: precision
plant: {f: ["x2", "-sin(x1)"], step: 0.1, substeps: 2}
measurement: {h: ["x1"], names: [angle]}
initial: {mean: [1, 0], covariance: {identity: 2}}
filter: ukf
bound: {factor: 0.01}
"""


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        code = command([str(a) for a in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.mark.parametrize(
    "words", [["check"], ["solve"], ["compare"], ["compare", "--json"], ["simulate", "--out", "m.csv"]], ids=" ".join
)
def test_a_bound_out_of_reach_is_exit_4_everywhere(run, words):
    Path("p.yaml").write_text(OUT_OF_REACH)
    code, out, err = run(words[0], "p.yaml", *words[1:])
    assert code == 4
    assert "the smallest is 0.984236" in err
    assert not Path("m.csv").exists()
    if "--json" in words:
        assert all(row["status"] == "infeasible" for row in json.loads(out)["methods"])
