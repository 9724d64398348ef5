"""The rules that choose a reading by its worth: against the family that has one of them, and by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import occontrol as oc
from occontrol.families.athans.replanning import policies
from occontrol.families.athans.replanning.chain import chain_of
from occontrol.families.athans.replanning.filter import predicted, updated

PLANT = """\
  F: [[1, 1, 0, 0], [0, 0.97, 0, 0], [0, 0, 1, 1], [0, 0, 0, 0.95]]
  Q: {diag: [0.01, 0.04, 0.02, 0.03]}
  initial: {covariance: {diag: [100, 4, 90, 5]}}
"""
SENSORS = (
    ("east", "[[1, 0, 0, 0]]", "[[0.5]]"),
    ("north", "[[0, 0, 1, 0]]", '[["0.5+0.4*cos(0.5*k)"]]'),
    ("both", "[[0.6, 0, 0.8, 0], [0, 1, 0, 0]]", "{diag: [0.7, 2]}"),
)


def read(folder: Path, family: str) -> oc.Problem:
    """The same plant and sensors for a family."""
    lines = "\n".join(f"  - {{name: {name}, H: {H}, R: {R}}}" for name, H, R in SENSORS)
    objective = "objective: {output: {identity: 4}}\n" if family == "athans" else ""
    text = f"family: {family}\nhorizon: {{steps: 40}}\nplant:\n{PLANT}sensors:\n{lines}\n{objective}"
    path = folder / f"{family}.yaml"
    path.write_text(text, encoding="utf-8")
    return oc.read_problem(path)


def test_the_eigenspace_rule_chooses_as_the_family_that_it_comes_from(tmp_path: Path) -> None:
    chain = chain_of(read(tmp_path, "athans"))
    policy = policies.Eigenspace(chain)
    policy.begin(1, np.zeros((1, 40, 3)))
    mean, P, chosen = np.zeros((1, 4)), np.diag([100.0, 4, 90, 5])[None], []
    for i in range(40):
        mean, transition, noise = chain.span(i, mean)
        P = predicted(P, transition, noise)
        used = policy.choose(i, mean, P, np.zeros(1, dtype=bool))[0]
        chosen.append(int(np.argmax(used)))
        assert np.sum(used) == 1 and np.array_equal(policy.paid(i)[0], used)
        seen = chain.seen(i, chosen[-1], mean)
        mean, P, _ = updated(mean, P, seen, seen.value, chain.angles(chosen[-1]))
    other = oc.solve(read(tmp_path, "vlambda"))
    assert other.method == "eigenspace" and len(set(chosen)) > 1
    np.testing.assert_array_equal(chosen, np.argmax(other.schedule.weights, axis=1))


def test_a_multiple_eigenvalue_and_a_tie_are_seen_as_such(tmp_path: Path) -> None:
    chain = chain_of(read(tmp_path, "athans"))
    worth = policies.Eigenspace(chain).worth(3, np.zeros((2, 4)), np.array([np.eye(4), np.diag([1, 9, 1, 1.0])]))
    R = 0.5 + 0.4 * np.cos(1.5)
    np.testing.assert_allclose(worth[0], [1 / 0.5, 1 / R, 1 / 0.7 + 1 / 2], rtol=1e-12)  # all of the information
    np.testing.assert_allclose(worth[1], [0, 0, 1 / 2], atol=1e-12)
