"""Run the matched filter of an exported schedule with NumPy alone: no other package is needed on the target.

occontrol export RUN --to npz --out run.npz        (or --to json --out run.json)
python run_the_schedule.py run.npz measurements.csv estimate.csv
"""

import csv
import json
import sys

import numpy as np


def load(path):
    if path.endswith(".json"):
        with open(path) as file:
            data = json.load(file)
        return data["sensors"], {name: np.array(value) for name, value in data["filter"].items()}
    with np.load(path) as data:
        return list(data["sensors"]), {name[7:]: data[name] for name in data.files if name.startswith("filter_")}


def run(names, f, samples):
    """Rows t, x, sd of x, predicted w, sd of w, nis; `samples` maps (interval, sensor) to the values read there."""
    x, P, rows, nis = f["mean"], f["covariance"][0], [], np.nan
    for k in range(len(f["edges"])):
        D = f["predict_matrix"][k]
        w, spread = D @ x + f["predict_offset"][k], D @ P @ D.T + f["predict_noise"][k]
        rows.append([f["edges"][k], *x, *np.sqrt(np.diag(P)), *w, *np.sqrt(np.diag(spread)), nis])
        if k == len(f["transition"]):
            return rows
        z, sensor = np.full(f["values"][k], np.nan), f["sensor"][k][: f["values"][k]]
        for j in set(sensor):
            z[sensor == j] = samples.get((k, names[j]), np.nan)
        i = np.flatnonzero(np.isfinite(z))  # what arrived
        F, H, S, R = f["transition"][k], f["observe"][k][i], f["cross"][k][:, i], f["reading_noise"][k][np.ix_(i, i)]
        e, Y = z[i] - H @ x - f["offset"][k][i], H @ P @ H.T + R
        K = np.linalg.solve(Y, (F @ P @ H.T + S).T).T
        nis = e @ np.linalg.solve(Y, e) if len(i) else np.nan
        x = F @ x + f["input"][k] + K @ e
        P = (F - K @ H) @ P @ (F - K @ H).T + f["noise"][k] - K @ S.T - S @ K.T + K @ R @ K.T


if __name__ == "__main__":
    names, tables = load(sys.argv[1])
    with open(sys.argv[2]) as file:
        lines = [line for line in csv.reader(file) if line][1:]
    samples = {}
    for t, name, *values in lines:
        k = int(np.argmin(np.abs(tables["edges"][1:] - float(t))))
        size = np.sum(tables["sensor"][k] == names.index(name))
        samples[k, name] = np.array([float(value or "nan") for value in values[:size]])
    np.savetxt(sys.argv[3], np.array(run(names, tables, samples)), delimiter=",", fmt="%.17g")
