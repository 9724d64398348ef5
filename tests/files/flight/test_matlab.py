"""run.mat and run_schedule.m: GNU Octave, which reads both, finds the numbers of `occontrol filter`."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from occontrol.api import export_run, family_of, run_filter, simulate, write_run
from occontrol.core.errors import UsageError
from occontrol.core.measurement import Measurement


@pytest.mark.skipif(not shutil.which("octave-cli"), reason="no octave-cli on this computer")
@pytest.mark.parametrize("name", ["small", "radar_discrete"])
def test_octave_filters_as_python_does(name: str, solved, small_solution, tmp_path: Path) -> None:
    from scipy.io import loadmat, savemat

    solution = small_solution if name == "small" else solved(name)
    problem = solution.problem
    write_run(tmp_path / "run", problem, solution)
    export_run(tmp_path / "run", "matlab", tmp_path / "out")
    plan = family_of(problem).target_plan(problem, solution)
    measurements: list[Measurement] = simulate(problem, solution, 1)[0][:-3]  # the last ones are lost
    want = run_filter(problem, solution, measurements)
    z = np.full((plan.intervals, max(len(d) for d in plan.model.offset)), np.nan)
    for s in measurements:
        j, k = plan.names.index(s.sensor), int(np.argmin(np.abs(plan.edges[1:] - s.time)))
        first = sum(plan.rows[i] for i in plan.active[k] if i < j)
        z[k, first : first + plan.rows[j]] = s.values
    savemat(tmp_path / "out" / "z.mat", {"z": z})
    code = "load z.mat; [x, sd, w, sd_w, nis] = run_schedule('run.mat', z); save -v6 said.mat x sd w sd_w nis"
    done = subprocess.run(["octave-cli", "--eval", code], cwd=tmp_path / "out", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    said = loadmat(tmp_path / "out" / "said.mat")
    assert np.max(np.abs(said["x"] - want.mean) / want.standard_deviation) < 1e-10
    assert np.max(np.abs(said["sd"] / want.standard_deviation - 1)) < 1e-10
    assert np.max(np.abs(said["w"] - want.predicted) / want.predicted_deviation) < 1e-10
    assert np.max(np.abs(said["sd_w"] / want.predicted_deviation - 1)) < 1e-10
    assert np.allclose(said["nis"][:, 0], want.nis, rtol=1e-9, equal_nan=True)


def test_families_without_filter_tables_are_refused(solved, tmp_path: Path) -> None:
    solution = solved("robust_oscillator")
    write_run(tmp_path / "run", solution.problem, solution)
    with pytest.raises(UsageError, match="family robust has no filter for MATLAB\n  hint: --to mat writes its arrays"):
        export_run(tmp_path / "run", "matlab")
