"""MATLAB and GNU Octave: run.mat, and run_schedule.m, which filters with it and needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from occontrol.core.errors import UsageError
from occontrol.core.problem import BaseProblem
from occontrol.core.solution import Solution
from occontrol.files.atomic import write_text
from occontrol.files.export import mat

SCRIPT = """\
function [x, sd, w, sd_w, nis] = run_schedule(file, z)
% Filter samples along the schedule of a run: [x, sd, w, sd_w, nis] = run_schedule('run.mat', z)
%
%   file   run.mat beside this function
%   z      N x m, row k the values of interval k, one sensor after the other in the order of
%          load(file).sensors; NaN where one is missing, and beyond the values of an interval
%   x, sd, w, sd_w, nis   one row per node: estimate, standard deviations, prediction, its
%          standard deviations, normalised innovation squared of the values before (NaN: none)
  run = load(file);
  f = run.filter;
  N = size(f.transition, 1);
  n = size(f.transition, 2);
  m = size(f.observe, 2);
  p = size(f.predict_matrix, 2);
  x = zeros(N + 1, n); sd = x; w = zeros(N + 1, p); sd_w = w; nis = NaN(N + 1, 1);
  mean = f.mean(:);
  P = reshape(f.covariance(1, :, :), n, n);
  for k = 1:N + 1
    D = reshape(f.predict_matrix(k, :, :), p, n);
    spread = D * P * D' + reshape(f.predict_noise(k, :, :), p, p);
    x(k, :) = mean'; sd(k, :) = sqrt(diag(P))';
    w(k, :) = (D * mean + reshape(f.predict_offset(k, :), p, 1))'; sd_w(k, :) = sqrt(diag(spread))';
    if k > N
      break
    end
    count = double(f.values(k));
    values = reshape(z(k, 1:count), count, 1);
    here = reshape(find(isfinite(values)), [], 1);
    F = reshape(f.transition(k, :, :), n, n);
    H = reshape(f.observe(k, :, :), m, n); H = H(here, :);
    S = reshape(f.cross(k, :, :), n, m); S = S(:, here);
    R = reshape(f.reading_noise(k, :, :), m, m); R = R(here, here);
    d = reshape(f.offset(k, :), m, 1);
    e = values(here) - H * mean - d(here);
    Y = H * P * H' + R;
    K = (F * P * H' + S) / Y;
    if ~isempty(here)
      nis(k + 1) = e' * (Y \\ e);
    end
    mean = F * mean + reshape(f.input(k, :), n, 1) + K * e;
    P = (F - K * H) * P * (F - K * H)' + reshape(f.noise(k, :, :), n, n) - K * S' - S * K' + K * R * K';
    P = (P + P') / 2;
  end
end
"""


def write(problem: BaseProblem, solution: Solution, tables: Mapping[str, np.ndarray], target: Path) -> list[Path]:
    """Write the folder.

    Parameters
    ----------
    problem : the problem
    solution : Solution
    tables : arrays of the filter, by name, of any shape
    target : the folder

    Raises UsageError for a family without filter tables and when an array is too large for the format.
    """
    if not tables:
        if getattr(getattr(problem, "plant", None), "linearised", None) is not None:
            hint = "--to fmu, or --to flight for a C Caller block"
            raise UsageError(f"the filter of a nonlinear plant has no tables for MATLAB\n  hint: {hint}")
        raise UsageError(f"family {problem.family} has no filter for MATLAB\n  hint: --to mat writes its arrays")
    target.mkdir(parents=True, exist_ok=True)
    return [
        *mat.write(problem, solution, tables, target / "run.mat"),
        write_text(target / "run_schedule.m", SCRIPT),
    ]
