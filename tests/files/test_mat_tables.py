"""Matrices in .mat files beside a problem file: equal bits, MATLAB's order of axes, and what is refused."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_array

import occontrol as oc
from occontrol.core.errors import ProblemError

TEXT = """
family: athans
horizon: {{end: 4, intervals: 8}}
plant: {{A: {A}, noise: {{identity: 2}}, initial: {{covariance: {{identity: 2}}}}}}
sensors: [{{name: a, C: {C}, noise: 1.0}}]
objective: {{output: {{identity: 2}}}}
"""
RANDOM = np.random.default_rng(3)
A, T = RANDOM.normal(size=(2, 2)), np.array([0.0, 1.5, 4.0])
V = RANDOM.normal(size=(1, 2, 3))  # V(:,:,k) belongs to T(k)
WHOLE = {"A": "{file: m.mat, values: A}", "C": "{file: m.mat, times: T, values: V, interpolation: linear}"}


def read(folder: Path, **given: str) -> oc.SchedulingProblem:
    (folder / "p.yaml").write_text(TEXT.format(**WHOLE | given))
    return oc.read_problem(folder / "p.yaml")  # type: ignore[return-value]


@pytest.mark.parametrize("options", [{"do_compression": True}, {"do_compression": False}, {"format": "4"}])
def test_matrices_of_matlab_arrive_with_every_bit(tmp_path: Path, options: dict) -> None:
    content = {"A": A, "T": T} | ({} if "format" in options else {"V": V})
    savemat(tmp_path / "m.mat", content, **options)
    problem = read(tmp_path, **({"C": "[[1, 0]]"} if "format" in options else {}))
    assert np.array_equal(problem.plant.A.at(0), A) and problem.plant.A.constant
    if "V" in content:
        C = problem.sensors[0].C
        assert all(np.array_equal(C.at(t), V[:, :, k]) for k, t in enumerate(T))
        assert C.at(0.75) == pytest.approx((V[:, :, 0] + V[:, :, 1]) / 2, rel=1e-15)


def test_one_matrix_of_an_npz_file_needs_no_times_and_may_stand_in_a_block(tmp_path: Path) -> None:
    np.savez(tmp_path / "m.npz", a=A[:1, :1], c=A[1:])
    given = {"A": "{block_diag: [{file: m.npz, values: a}, 3]}", "C": "{file: m.npz, values: c}"}
    problem = read(tmp_path, **given)
    assert np.array_equal(problem.plant.A.at(0), [[A[0, 0], 0], [0, 3]])
    assert np.array_equal(problem.sensors[0].C.at(0), A[1:])


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"A": "{file: m.mat, values: a}"}, "m.mat has no array 'a'\n  hint: did you mean 'A'?"),
        ({"A": "{file: m.mat, values: word}"}, "the array 'word' of m.mat does not hold numbers"),
        ({"A": "{file: m.mat, values: S}"}, "the array 'S' of m.mat does not hold numbers"),
        ({"A": "{file: m.mat, values: Z}"}, "m.mat: the array 'Z' does not hold real numbers"),
        ({"A": "{file: m.mat, values: N}"}, "the array holds a value that is not finite"),
        ({"A": "{file: m.mat, values: V}"}, "A has no 'times'\n  hint: matrices that vary with time"),
        ({"A": "{file: m.mat, values: A, interpolation: linear}"}, "A has no 'times'"),
        ({"A": "{file: m.mat, values: A, time: T}"}, "unknown key 'time' beside 'file'\n  hint: did you mean 'times'?"),
        ({"A": "{file: bomb.mat, values: A}"}, "unpacks to more than 5 MB"),
        ({"A": "{file: h5.mat, values: A}"}, "version 7.3, which is HDF5\n  hint: in MATLAB: save -v7"),
        ({"A": "{file: cut.mat, values: A}"}, "cut.mat: not a readable .mat file"),
        ({"C": "{file: m.mat, values: B3}"}, "C of sensor 'a' is 1x3, but the plant has 2 states"),
    ],
)
def test_what_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: dict[str, str], what: str
) -> None:
    monkeypatch.setattr("occontrol.files.mat_file.PACKED", 5 * 2**20)
    more = {"word": "text", "S": csc_array(A), "Z": A + 1j, "N": np.full((2, 2), np.nan), "B3": np.ones((1, 3))}
    savemat(tmp_path / "m.mat", {"A": A, "T": T, "V": V, **more})
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    block = zlib.compress(bytes(2**20))
    (tmp_path / "bomb.mat").write_bytes(head + 7 * (struct.pack("<II", 15, len(block)) + block))
    (tmp_path / "h5.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n")
    (tmp_path / "cut.mat").write_bytes((tmp_path / "m.mat").read_bytes()[:200])
    with pytest.raises(ProblemError) as caught:
        read(tmp_path, **given)
    assert what in str(caught.value)
