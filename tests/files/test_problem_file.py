"""A problem file says what it says: every form of a matrix, tables in files, and the way back."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import occontrol.core.sensor as sensors
from occontrol.api import document, read_problem
from occontrol.core.errors import ProblemError
from occontrol.core.plant import LinearPlant
from occontrol.core.signal import TableSignal
from occontrol.families.athans.methods import HMinimal, Relaxed
from occontrol.families.athans.problem import SchedulingProblem

FULL = """\
family: athans
name: two radars
horizon: {start: 0, end: 10, intervals: 400, predict_at: 12}
plant:
  A: [[0, 1], ["-(1+0.2*sin(t))", -0.4]]
  B: [[0], [1]]
  input: ["sin(t)"]
  noise: [[0, 0], [0, 0.5]]
  initial: {mean: [1, 0], covariance: {diag: [5, 5]}}
sensors:
  - {name: range,   C: [[1, 0]], noise: [[0.1]], cost: 2.0, windows: [[0, 4], [6, 10]]}
  - {name: doppler, C: [[0, 1]], noise: [[0.4]], cost: 0.5}
  - idle
select: 1
objective: {cost_weight: 0.1, output: [[1, 0]], running: {diag: [0, 0]}}
method: {name: relaxed, relative_gap: 1.0e-4}
expect: {source: "...", cost: 1.234, tolerance: 1.0e-4}
"""


def read(folder: Path, text: str, name: str = "x.yaml"):
    (folder / name).write_text(text, encoding="utf-8")
    return read_problem(folder / name)


def with_noise(text: str) -> str:
    return FULL.replace("noise: [[0, 0], [0, 0.5]]", f"noise: {text}")


def same(one: SchedulingProblem, two: SchedulingProblem) -> bool:
    """Bit-identical in every number."""
    times = np.concatenate([one.edges, np.linspace(one.edges[0], one.edges[-1], 57)])
    assert np.array_equal(one.edges, two.edges) and one.predict_at == two.predict_at
    assert list(one.signals) == list(two.signals)
    for path, signal in one.signals.items():
        assert np.array_equal(signal.sample(times), two.signals[path].sample(times)), path
    assert np.array_equal(one.plant.mean, two.plant.mean)
    assert np.array_equal(one.plant.covariance, two.plant.covariance)
    assert [s.windows for s in one.sensors] == [s.windows for s in two.sensors]
    assert one.sensors.names == two.sensors.names
    assert (one.name, one.select, one.cost_weight, one.method) == (two.name, two.select, two.cost_weight, two.method)
    return one.expect == two.expect


def test_every_key_arrives(tmp_path):
    p = read(tmp_path, FULL)
    assert (p.name, p.select, p.cost_weight, p.predict_at, p.intervals) == ("two radars", 1, 0.1, 12.0, 400)
    assert np.array_equal(p.edges, np.linspace(0, 10, 401))
    assert p.plant.A.at(2.0)[1, 0] == pytest.approx(-(1 + 0.2 * np.sin(2.0)), rel=1e-15)
    assert p.plant.input.at(2.0)[0, 0] == pytest.approx(np.sin(2.0), rel=1e-15)
    assert np.array_equal(p.plant.mean, [1, 0]) and np.array_equal(p.plant.covariance, 5 * np.eye(2))
    assert p.sensors.names == ["range", "doppler", "idle"] and p.sensors[2].is_idle
    assert p.sensors[0].windows == ((0, 4), (6, 10)) and p.sensors[1].windows is None
    assert p.sensors[0].cost.at(0)[0, 0] == 2 and p.sensors[0].noise.at(0)[0, 0] == 0.1
    assert p.method == Relaxed(relative_gap=1e-4)
    assert p.expect == {"source": "...", "cost": 1.234, "tolerance": 1e-4}


def test_what_may_be_left_out(tmp_path):
    text = """
    family: athans
    horizon: {edges: [1, 1.5, 4]}
    plant: {A: 0.5, noise: 1, initial: {covariance: 1}}
    sensors: [{name: Größe 1, C: 1, noise: 2}]
    objective: {output: 1}
    method: hminimal
    """
    p = read(tmp_path, text, "a small one.yml")
    assert (p.name, p.predict_at, p.select, p.cost_weight) == ("a small one", 4.0, 1, 1.0)
    assert np.array_equal(p.edges, [1, 1.5, 4]) and np.array_equal(p.plant.mean, [0])
    assert p.sensors.names == ["Größe 1"] and p.sensors[0].cost.at(0)[0, 0] == 0 and p.running is None
    assert p.method == HMinimal()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("[[1, 2e-3], [2.0e-3, .5]]", [[1, 2e-3], [2e-3, 0.5]]),
        ("{diag: [1, 2]}", [[1, 0], [0, 2]]),
        ("{diag: [1, 'exp(-t)']}", [[1, 0], [0, np.exp(-3.0)]]),
        ("{identity: 2, scale: 3.0}", [[3, 0], [0, 3]]),
        ("{identity: 2}", [[1, 0], [0, 1]]),
        ("{identity: 2, scale: 2+t}", [[5, 0], [0, 5]]),
        ("[[2, sin(pi)], [sin(pi), 0x10]]", [[2, np.sin(np.pi)], [np.sin(np.pi), 16]]),
        ("{times: [0, 12], values: [{diag: [0, 0]}, {identity: 2, scale: 12}]}", [[3, 0], [0, 3]]),
        ("{times: [0, 3.5], values: [[[1, 0], [0, 1]], [[5, 0], [0, 5]]], interpolation: previous}", [[1, 0], [0, 1]]),
    ],
)
def test_forms_of_a_matrix(tmp_path, text, value):
    p = read(tmp_path, with_noise(text))
    assert np.allclose(p.plant.noise.at(3.0), value, rtol=1e-15, atol=0)
    assert same(p, read(tmp_path, json.dumps(document(p)), "again.json"))


def test_tables_in_a_file_beside_or_below(tmp_path):
    t = np.linspace(0, 12, 25)
    values = np.einsum("k,ij->kij", 1 + np.sin(t) ** 2, np.eye(2))
    (tmp_path / "below").mkdir()
    np.savez(tmp_path / "below" / "tables.npz", t=t, Xi=values)
    p = read(tmp_path, with_noise("{file: below/tables.npz, times: t, values: Xi, interpolation: linear}"))
    assert np.array_equal(p.plant.noise.at(0.25), (values[0] + values[0 + 1]) / 2)
    embedded = document(p)
    assert embedded["plant"]["noise"]["times"] == t.tolist()
    assert same(p, read(tmp_path, json.dumps(embedded), "problem.json"))


def test_table_files_that_are_refused(tmp_path):
    folder = tmp_path / "problem"
    folder.mkdir()
    good = {
        "t": np.array([0.0, 12.0]),
        "Xi": np.array([np.eye(2)] * 2),
        "flat": np.zeros((2, 2)),
        "word": np.array(["a", "b"]),
    }
    np.savez(tmp_path / "outside.npz", **good)
    np.savez(folder / "good.npz", **good)
    np.savez(folder / "pickled.npz", t=good["t"], Xi=np.array([{"a": 1}, None], dtype=object))
    (folder / "link.npz").symlink_to(tmp_path / "outside.npz")
    (folder / "text.npz").write_text("not a zip file")
    (folder / "sub.npz").mkdir()
    form = "{{file: {}, times: {}, values: {}}}"
    for file, times, values, words in (
        ("../outside.npz", "t", "Xi", "x.yaml:8:17: the table file '../outside.npz' lies outside the folder"),
        (str(tmp_path / "outside.npz"), "t", "Xi", "lies outside the folder of the problem file"),
        ("link.npz", "t", "Xi", "the table file 'link.npz' lies outside the folder of the problem file"),
        ("/etc/passwd", "t", "Xi", "the table file '/etc/passwd' lies outside the folder"),
        ("none.npz", "t", "Xi", "x.yaml:8:17: there is no table file 'none.npz'"),
        ("sub.npz", "t", "Xi", "there is no table file 'sub.npz'"),
        ("text.npz", "t", "Xi", "text.npz is not an .npz file of plain arrays"),
        ("pickled.npz", "t", "Xi", "pickled.npz is not an .npz file of plain arrays"),
        ("good.npz", "time", "Xi", "x.yaml:8:34: good.npz has no array 'time'"),
        ("good.npz", "t", "xi", "good.npz has no array 'xi'\n  hint: did you mean 'Xi'?"),
        ("good.npz", "t", "flat", "noise of the plant: times has shape (2,), values (2, 2)"),
        ("good.npz", "t", "word", "the array 'word' of good.npz does not hold numbers"),
        ("7", "t", "Xi", "file is 7, it must be the name of an .npz or .mat file"),
    ):
        with pytest.raises(ProblemError) as error:
            read(folder, with_noise(form.format(file, times, values)))
        assert words in str(error.value)


def test_a_problem_file_may_be_reached_through_a_link_and_tables_lie_beside_the_link(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "x.yaml").write_text(FULL)
    (tmp_path / "x.yaml").symlink_to(tmp_path / "real" / "x.yaml")
    assert read_problem(tmp_path / "x.yaml").name == "two radars"


def test_the_document_of_a_problem_built_in_python(tmp_path):
    rng = np.random.default_rng(7)
    root = rng.normal(size=(3, 3))
    times = np.sort(rng.uniform(0, 5, 9))
    times[0], times[-1] = 0, 6
    problem = SchedulingProblem(
        name="python",
        plant=LinearPlant(
            A=rng.normal(size=(3, 3)),
            noise=TableSignal(times, np.array([root @ root.T * (k + 1) for k in range(9)])),
            covariance=root @ root.T,
            mean=rng.normal(size=3),
            B=[[0], ["cos(t)"], [1]],
            input=["t**2"],
        ),
        sensors=[
            sensors.Sensor("a", rng.normal(size=(2, 3)), np.diag([0.1, 0.3]), "1+t", [(3, 4), (0, 1.1)]),
            sensors.Sensor("b", [[1, "t", 0]], 0.25),
            sensors.idle_sensor(3),
        ],
        edges=np.sort(np.concatenate([[0, 5], rng.uniform(0, 5, 20)])),
        output=rng.normal(size=(1, 3)),
        predict_at=5.5,
        cost_weight=0.3,
        select=2,
        method=HMinimal(max_iterations=12),
        expect={"cost": np.float64(1.5), "source": "nowhere"},
    )
    written = document(problem)
    assert written["method"] == {"name": "hminimal", **{k: v for k, v in written["method"].items() if k != "name"}}
    again = read(tmp_path, json.dumps(written), "problem.json")
    assert same(problem, again) and document(again) == written


def test_shipped_problems_survive_the_round_trip(tmp_path):
    files = sorted(Path(__file__).parents[2].glob("problems/*.yaml"))
    files = [file for file in files if "family: athans" in file.read_text(encoding="utf-8")]
    assert files
    for file in files:
        problem = read_problem(file)
        again = read(tmp_path, json.dumps(document(problem)), "problem.json")
        if hasattr(problem, "predict_at"):
            assert same(problem, again), file
        assert document(again) == document(problem), file  # of many targets all that there is to compare


def test_template_is_a_problem():
    template = Path(sensors.__file__).parents[1] / "families" / "athans" / "template.yaml"
    read_problem(template).require_feasible()


def test_large_tables_in_json_read_fast(tmp_path):
    import time

    times = np.linspace(0, 12, 20_001)
    values = np.einsum("k,ij->kij", 1 + times, np.eye(2))
    data = document(read(tmp_path, FULL))
    data["plant"]["noise"] = {"times": times.tolist(), "values": values.tolist()}
    path = tmp_path / "problem.json"
    path.write_text(json.dumps(data))
    start = time.process_time()
    problem = read_problem(path)
    assert time.process_time() - start < 5
    assert np.array_equal(problem.plant.noise.at(times[777]), values[777])


def test_a_problem_of_numbers_needs_no_heavy_library(tmp_path):
    text = FULL.replace('"-(1+0.2*sin(t))"', "-1").replace('["sin(t)"]', "[1]")
    (tmp_path / "x.yaml").write_text(text)
    code = (
        "import sys; from occontrol.api import read_problem; read_problem(sys.argv[1]); print([m for m "
    )
    code += "in ('casadi', 'numba', 'scipy', 'matplotlib') if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "x.yaml")], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
