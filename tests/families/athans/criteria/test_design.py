"""Experiments without a prior from the file to the run: the known answers of the literature, refusals, equivalence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import occontrol as oc
from occontrol.core.errors import InfeasibleError
from tests.families.athans.problem_texts import written

PROBLEMS = Path(__file__).resolve().parents[4] / "problems"
COMPARTMENT = (PROBLEMS / "compartment_design.yaml").read_text().partition("expect:")[0]
KNOWN = {
    "trace": (0.822240785533346, 0.80888835967, [0.166, 0.333, 1, 1.5, 2, 24]),
    "logdet": (np.log(3.736997226694786e-6), np.log(3.73254950737e-6), [0.166, 0.333, 1.5, 2, 12, 24]),
    "largest-eigenvalue": (0.609438998343452, 0.60904416377, [0.166, 1, 1.5, 2, 2.5, 24]),
}


@pytest.mark.parametrize("name", KNOWN)
def test_six_samples_of_a_compartment(tmp_path: Path, name: str) -> None:
    cost, shared, times = KNOWN[name]
    gap = "method: {name: schedule, relative_gap: 1.0e-5}\n"
    s = oc.solve(written(tmp_path, COMPARTMENT, ("{name: logdet}", f"{{name: {name}}}"), more=gap))
    r = s.result
    assert r["cost"] == pytest.approx(cost, rel=1e-11)
    assert [entry["t"] for entry in r["schedule"] if entry["sensors"] == ["sample"]] == times
    assert r["lower_bound"] <= shared + 1e-9 * abs(shared) and r["lower_bound"] >= shared - 1.1e-5 * max(abs(shared), 1)
    assert s.status == "certified"
    if name != "largest-eigenvalue":  # whose relaxed optimum has a corner
        check = r["equivalence"]
        assert check["others_save_at_most"] <= check["used_save_at_least"] * (1 + 5e-3)
    assert s.arrays["information"].shape == (19, 3, 3)
    known = np.isfinite(s.arrays["covariance"][:, 0, 0])
    assert not known[2] and known[7:].all()  # the third of six times determines the three parameters


def test_all_designs_are_tried_where_the_file_asks_for_the_proven_optimum(tmp_path: Path) -> None:
    exact = "method: {name: schedule, exact: true}\n"
    small = COMPARTMENT.replace("0.166, 0.333, 0.5, 0.666, 1, 1.5, 2, 2.5, 3, 4, 5, 6,", "0.333, 1, 2, 4, 6,")
    r = oc.solve(written(tmp_path, small, more=exact)).result
    assert r["proven_optimal"] and r["schedules"] == 924 and r["lower_bound"] == pytest.approx(r["cost"], abs=1e-6)


def test_a_large_prior_tends_to_none(tmp_path: Path) -> None:
    """kappa I in its place: the known values, from below and towards the one without a prior."""
    trace = ("{name: logdet}", "{name: trace}")
    values = []
    for kappa, known in ((1e3, 0.821751657), (1e6, 0.8222402961546)):
        prior = ("covariance: none", f"covariance: {{identity: 3, scale: {kappa}}}")
        values.append(oc.solve(written(tmp_path, COMPARTMENT, trace, prior)).result["cost"])
        assert values[-1] == pytest.approx(known, rel=1e-9)
    assert values[0] < values[1] < 0.822240785533346


def test_the_support_of_the_continuous_volume_design(tmp_path: Path) -> None:
    """Three times share equally, and the sensitivity nowhere exceeds the number of parameters (Kiefer, Wolfowitz)."""
    t = sorted({0.05, 0.5, 5, 40, *np.round(np.r_[0.19:0.27:0.01, 1.33:1.45:0.01, 18.3:18.55:0.01], 2)})
    start = COMPARTMENT.index("sample_times")
    stop = COMPARTMENT.index("]", start)
    text = f"{COMPARTMENT[:start]}sample_times: {[float(x) for x in t]}{COMPARTMENT[stop + 1 :]}"
    p = written(tmp_path, text, ("{total: 6}", "{total: 1}"), more="method: {name: relaxed, relative_gap: 1.0e-7}\n")
    s = oc.solve(p)
    assert s.status == "certified"
    shares = s.arrays["weights"][:, 0]
    for near, at in ((0.23, 0.228772), (1.39, 1.388586), (18.42, 18.416838)):
        close = np.abs(np.array(t) - near) < 0.3 * near
        assert np.sum(shares[close]) == pytest.approx(1 / 3, abs=1e-4)
        assert np.array(t)[close][np.argmax(shares[close])] == pytest.approx(near)
        assert np.sum(shares[close] * np.array(t)[close]) * 3 == pytest.approx(at, abs=6e-3)
    sensitivity = s.arrays["switching"][:, 1] - s.arrays["switching"][:, 0]
    assert np.max(sensitivity) == pytest.approx(3, abs=1e-5)


@pytest.mark.parametrize(
    ("cells", "rate", "known"),
    [(10, -2.0, 149.7778538201801), (2000, -2.0, 149.7515069875663), (10, -0.5, 15.207367203002965)],
)
def test_when_to_watch_an_exponential(tmp_path: Path, cells: int, rate: float, known: float) -> None:
    """x' = p x from 1, watched for a fifth of the unit of time: the least variance of p, cell by cell exactly."""
    edges = np.linspace(0, 1, cells + 1)
    a = 2 * rate  # int t^2 exp(a t) dt = exp(a t) (t^2/a - 2 t/a^2 + 2/a^3)
    integral = np.exp(a * edges) * (edges**2 / a - 2 * edges / a**2 + 2 / a**3)
    rows = np.sqrt(np.diff(integral))[:, None, None]
    document = {
        "family": "athans",
        "horizon": {"start": 0, "end": 1, "sample_times": ((edges[1:] + edges[:-1]) / 2).tolist()},
        "sensing": "samples",
        "plant": {"A": [[0]], "noise": [[0]], "initial": {"covariance": "none"}},
        "sensors": [
            {
                "name": "watch",
                "C": {"times": ((edges[1:] + edges[:-1]) / 2).tolist(), "values": rows.tolist()},
                "noise": [[1]],
            }
        ],
        "budget": {"total": cells // 5},
        "objective": {"output": [[1]]},
    }
    path = tmp_path / "x.json"
    path.write_text(json.dumps(document))
    r = oc.solve(oc.read_problem(path)).result
    assert r["cost"] == pytest.approx(known, rel=1e-12)
    assert r["lower_bound"] == pytest.approx(known, rel=1e-4) and r["lower_bound"] <= known
    if cells == 2000:
        used = [entry["t"] for entry in r["schedule"] if entry["sensors"] == ["watch"]]
        assert (min(used) - 0.00025, max(used) + 0.00025) == pytest.approx((0.4065, 0.6065), abs=1e-9)


def test_every_method_and_a_certified_design(tmp_path: Path) -> None:
    p = written(tmp_path, COMPARTMENT)
    best = KNOWN["logdet"][0]
    for name in ("schedule", "relaxed", "greedy", "round-robin"):
        r = oc.solve(p, name).result
        assert r["lower_bound"] <= best and (name == "relaxed" or r["cost"] >= best - 1e-10)
    s = oc.solve(p, "round-robin")
    oc.write_run(tmp_path / "run", p, s)
    again, read = oc.read_run(tmp_path / "run")
    assert again.prior is False and oc.document(again) == oc.document(p)
    judged = oc.certify(p, read.schedule)
    assert judged.result["cost"] == pytest.approx(s.result["cost"], rel=1e-12)
    with pytest.raises(oc.UsageError, match="collocation does not do"):
        oc.solve(p, "collocation")


def test_the_filter_is_least_squares_once_there_is_enough(tmp_path: Path) -> None:
    from occontrol.core.measurement import Measurement

    p = written(tmp_path, COMPARTMENT)
    s = oc.solve(p, "round-robin")
    times = [entry["t"] for entry in s.result["schedule"] if entry["sensors"] == ["sample"]]
    rows = np.array([p.sensors[0].C.at(t)[0] for t in times])
    z = rows @ [0.06, 4.1, 20.0] + np.random.default_rng(0).standard_normal(len(times))
    found = oc.run_filter(p, s, [Measurement(t, "sample", np.array([v])) for t, v in zip(times, z, strict=True)])
    known = np.isfinite(found.mean[:, 0])
    assert not known[0] and known[-1] and np.array_equal(known, np.isfinite(found.standard_deviation[:, 2]))
    np.testing.assert_allclose(found.mean[-1], np.linalg.lstsq(rows, z, rcond=None)[0], rtol=1e-8)
    np.testing.assert_allclose(found.covariance[-1], np.linalg.inv(rows.T @ rows), rtol=1e-7)
    for refused in (lambda: oc.simulate(p, s), lambda: oc.tradeoff(p, [1.0])):
        with pytest.raises(oc.UsageError, match="needs an initial covariance"):
            refused()


def test_directions_that_no_sample_sees(tmp_path: Path) -> None:
    blind = ('exp(-0.05884*t) - exp(-4.298*t)"', '42*t*exp(-4.298*t)"')
    with pytest.raises(InfeasibleError, match=r"no schedule sees the direction x2 - 0\.519 x3 of the states"):
        oc.solve(written(tmp_path, COMPARTMENT, blind))
    seen = ("output: {identity: 3}", "output: [[1, 0, 0], [0, 21.8, 42]]")
    s = oc.solve(written(tmp_path, COMPARTMENT, blind, seen))  # what is not seen is not needed
    assert np.isfinite(s.result["cost"]) and "1 directions of the states that no reading sees" in s.message
    with pytest.raises(InfeasibleError, match="determine"):
        oc.solve(written(tmp_path, COMPARTMENT, ("{total: 6}", "{total: 2}")))


def test_what_goes_without_a_prior_and_what_does_not(tmp_path: Path) -> None:
    for change, words in (
        (("noise: {diag: [0, 0, 0]}", "noise: {diag: [0, 1, 0]}"), "without a prior the plant has no noise"),
        (("criterion: {name: logdet}", "criterion: {name: peak}"), "a peak is infinite before"),
        (("output: {identity: 3},", "output: {identity: 3}, running: {identity: 3},"), "a running weight is infinite"),
    ):
        with pytest.raises(oc.ProblemError, match=words):
            written(tmp_path, COMPARTMENT, change)
