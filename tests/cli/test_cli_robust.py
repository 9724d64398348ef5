"""The robust family on the command line: exit codes, JSON, data in and out."""

import json
from pathlib import Path

import pytest

from occontrol.cli import run as command

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        code = command([str(a) for a in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def test_escape_is_exit_4_with_eight_digits(run):
    code, out, err = run("solve", PROBLEMS / "robust_escape.yaml", "--json", "--out", "nowhere")
    content = json.loads(out)
    assert code == 4
    assert content["status"] == "infeasible"
    assert content["observability_horizon"] == pytest.approx(0.7390188311873873, abs=1e-10)
    assert content["escape_time"] == pytest.approx(0.9199619726008745, abs=1e-10)
    assert "0.73901883" in err
    assert not Path("nowhere").exists()


@pytest.mark.parametrize(
    "words", [["check"], ["compare"], ["compare", "--json"], ["simulate", "--out", "m.csv"]], ids=" ".join
)
def test_every_command_says_exit_4_where_no_schedule_exists(run, words):
    code, _, err = run(words[0], PROBLEMS / "robust_escape.yaml", *words[1:])
    assert code == 4
    assert "0.73901883" in err
    assert "shares slots" not in err
    assert not Path("m.csv").exists()
    assert not list(Path().rglob("*.png"))


@pytest.mark.parametrize(("end", "escapes"), [(2.0, False), (4.0, True)])
def test_a_baseline_that_is_asked_for_has_its_own_escape_time(run, tmp_path, end, escapes):
    from scipy.integrate import solve_ivp

    def rate(t, q, c):  # of q = 1/P, whose zero is the escape: A = 0.1, B = K = 1
        return -0.2 * q - (1 - c * c) - q * q

    def zero(t, q, c):
        return q[0]

    zero.terminal = True
    q, escape = [1.0], None
    for k, c in enumerate([0.5, 2.0, 0.5, 2.0]):
        span = (end / 4 * k, end / 4 * (k + 1))
        done = solve_ivp(rate, span, q, "DOP853", args=(c,), events=zero, rtol=1e-12, atol=1e-14)
        if len(done.t_events[0]):
            escape = float(done.t_events[0][0])
            break
        q = done.y[:, -1]
    path = tmp_path / "turns.yaml"
    path.write_text((PROBLEMS / "robust_escape.yaml").read_text().replace("end: 2.0", f"end: {end}"))
    code, out, _ = run("solve", path, "--method", "round-robin", "--json")
    content = json.loads(out)
    assert code == 4
    assert (escape is not None) == escapes
    assert content["escape_time"] == (pytest.approx(escape, abs=1e-9) if escapes else None)


def test_a_run_from_problem_to_filter(run, tmp_path):
    folder, data, out = tmp_path / "run", tmp_path / "m.csv", tmp_path / "f.csv"
    code, text, _ = run("solve", PROBLEMS / "robust_oscillator.yaml", "--json", "--out", folder)
    assert code == 0
    assert json.loads(text)["cost"] == pytest.approx(1.6498563079, abs=1e-8)
    assert {p.name for p in folder.iterdir()} >= {"problem.json", "result.json", "arrays.npz"}
    assert run("simulate", PROBLEMS / "robust_oscillator.yaml", "--run", folder, "--out", data, "--seed", 2)[0] == 0
    code, _, err = run("filter", folder, data, "--out", out)
    assert code == 0
    assert "101 of 101 true states" in err
    assert out.read_text().startswith("t,x1,x2,sd_x1,sd_x2")
    code, text, _ = run("certify", folder, "--json")
    assert code == 0
    assert json.loads(text)["cost"] == pytest.approx(1.6498563079, abs=1e-8)


def test_unknown_method_and_too_many_sequences(run, tmp_path):
    code, _, err = run("solve", PROBLEMS / "robust_vehicle.yaml", "--method", "best")
    assert code == 2
    assert "best-single" in err
    code, _, err = run("solve", PROBLEMS / "robust_vehicle.yaml", "--method", "all", "--out", tmp_path / "x")
    assert code == 3
    assert "would rank 3^40 sequences" in err


@pytest.mark.parametrize(("key", "factor"), [("cost", 0.9), ("lower_bound", 1.1), ("level", 2.0)])
def test_certify_refutes_what_a_run_states_falsely(run, tmp_path, key, factor):
    folder = tmp_path / "run"
    assert run("solve", PROBLEMS / "robust_oscillator.yaml", "--out", folder, "--no-figures")[0] == 0
    assert run("certify", folder)[0] == 0
    content = json.loads((folder / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps({**content, key: content[key] * factor}))
    for words in ([folder], [PROBLEMS / "robust_oscillator.yaml", folder]):
        code, out, _ = run("certify", *words, "--json")
        assert (code, json.loads(out)["status"]) == (7, "disagrees")
