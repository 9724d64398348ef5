"""The matched filter as plain arrays, for programs that know nothing of this package.

Per interval k, values padded with zeros to the largest number m of them (`values`[k] says how many there are):

    z- = H x + d,  Y = H P H' + R,  K = (F P H' + S) Y^-1
    x  = F x + g + K (z - z-),  P = (F - K H) P (F - K H)' + Q - K S' - S K' + K R K'
    w  = predict_matrix x + predict_offset,  cov w = predict_matrix P predict_matrix' + predict_noise

While nothing is missing, K, Y and P are `gain`, `innovation` and `covariance`. See sampled_model.py.
"""

from __future__ import annotations

import numpy as np

from occontrol.core.schedule import Schedule
from occontrol.families.athans.filter.online import MatchedFilter
from occontrol.families.athans.problem import SchedulingProblem


def filter_tables(problem: SchedulingProblem, schedule: Schedule, model: str = "split") -> dict[str, np.ndarray]:
    """Everything that an on-line filter needs, by name.

    Parameters
    ----------
    problem : SchedulingProblem with n states and M sensors
    schedule : Schedule with N intervals
    model : "split" or "exact"

    Returns edges (N+1,), mean (n,), values (N,), sensor (N, m) the position among the sensors of each value's sensor or
    -1, transition F (N, n, n), input g (N, n), noise Q (N, n, n), observe H (N, m, n), offset d (N, m), reading_noise R
    (N, m, m), cross S (N, n, m), gain K (N, n, m), innovation Y (N, m, m), covariance P (N+1, n, n), predict_matrix
    (N+1, p, n), predict_offset (N+1, p), predict_noise (N+1, p, p), output (N+1, p, n) D(t).
    """
    matched = MatchedFilter(problem, schedule, model)
    return tables_of(matched, np.array(problem.output.sample(matched.model.edges)))


def tables_of(matched: MatchedFilter, output: np.ndarray) -> dict[str, np.ndarray]:
    """The tables of an on-line filter that is ready.

    Parameters
    ----------
    matched : MatchedFilter with N intervals
    output : (N+1, p, n) D at its nodes
    """
    model_, plan = matched.model, matched.plan
    N, n = model_.intervals, model_.states
    m = int(np.max(model_.dimension, initial=0))
    result = {
        "edges": model_.edges,
        "mean": model_.mean,
        "values": model_.dimension,
        "sensor": np.full((N, m), -1),
        "transition": model_.transition,
        "input": model_.input,
        "noise": model_.noise,
        "observe": np.zeros((N, m, n)),
        "offset": np.zeros((N, m)),
        "reading_noise": np.zeros((N, m, m)),
        "cross": np.zeros((N, n, m)),
        "gain": np.zeros((N, n, m)),
        "innovation": np.zeros((N, m, m)),
        "covariance": plan.covariance,
        "predict_matrix": matched.predictor.matrix,
        "predict_offset": matched.predictor.offset,
        "predict_noise": matched.predictor.noise,
        "output": output,
    }
    for k in range(N):
        r = len(model_.offset[k])
        for j, place in model_.places(k).items():
            result["sensor"][k, place] = j
        result["observe"][k, :r], result["offset"][k, :r] = model_.observe[k], model_.offset[k]
        result["reading_noise"][k, :r, :r], result["cross"][k, :, :r] = model_.reading_noise[k], model_.cross[k]
        result["gain"][k, :, :r], result["innovation"][k, :r, :r] = plan.gain[k], plan.innovation[k]
    return result
