"""FMUs through FMPy: valid by its rules, built by it, and the last state that of the reference, bit by bit."""

from __future__ import annotations

import subprocess
import tempfile
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np

from occontrol.files.export.flight.content import Content
from occontrol.files.export.flight.vectors import reference_of, samples


def fmus_agree(paths: dict[int, Path], content: Content, run: bool) -> list[str]:
    """What is wrong with FMUs; empty where nothing is. ImportError without FMPy.

    Parameters
    ----------
    paths : {edition of FMI: file}
    content : of the plan that they were written from
    run : whether to build and simulate them too
    """
    from fmpy.validation import validate_fmu

    wrong = []
    for edition, path in paths.items():
        wrong += [f"FMI {edition}: {problem}" for problem in validate_fmu(str(path))]
        if run:
            last = _last_state(path, content)
            reference = reference_of(content)
            for z in samples(content):
                reference.step(z)
            if last != reference.x.tolist():
                wrong.append(f"FMI {edition}: the last state is {last}, not {reference.x.tolist()}")
    return wrong


def _spans(content: Content, count: int) -> list[tuple[float, float]]:
    """Beginning and end of so many intervals; those of a cycle go on after its end."""
    reference, found = reference_of(content), []
    for _ in range(count):
        found.append((reference.time_after(0), reference.time_after(1)))
        reference.k += 1
        if reference.k == content.plan.intervals and content.plan.again is not None:
            reference.k, reference.round = content.plan.again, reference.round + 1
    return found


def _last_state(path: Path, content: Content) -> list[float]:
    import fmpy
    from fmpy.build import build_platform_binary
    from fmpy.model_description import read_model_description

    z = samples(content)
    edges = np.append(content.plan.edges[0], [end for _, end in _spans(content, len(z))])
    quiet = partial(subprocess.run, check=True, capture_output=True)  # FMPy lets cmake speak
    with tempfile.TemporaryDirectory() as place, patch("subprocess.check_call", quiet):
        fmpy.extract(str(path), place)
        build_platform_binary(place)
        described = read_model_description(place)
        reference = {v.name: v.valueReference for v in described.modelVariables}
        kind = fmpy.fmi2.FMU2Slave if described.fmiVersion == "2.0" else fmpy.fmi3.FMU3Slave
        simulation = described.coSimulation
        assert simulation is not None
        fmu = kind(
            guid=described.guid,
            unzipDirectory=place,
            modelIdentifier=simulation.modelIdentifier,
            instanceName="one",
        )
        fmu.instantiate()
        two = described.fmiVersion == "2.0"
        real, flag = (fmu.setReal, fmu.setBoolean) if two else (fmu.setFloat64, fmu.setBoolean)
        places = {name: [reference[f"{name}[{i + 1}]"] for i in range(content.values)] for name in ("z", "valid")}

        def put(k: int) -> None:
            real(places["z"], np.where(np.isnan(z[k]), 0.0, z[k]).tolist())
            flag(places["valid"], [not np.isnan(value) for value in z[k]])

        if two:
            fmu.setupExperiment(startTime=float(edges[0]))
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=float(edges[0]))
        put(0)
        fmu.exitInitializationMode()
        for k in range(1 if edges[1] == edges[0] else 0, len(z)):
            put(k)
            step = float(edges[k + 1]) - float(edges[k])
            fmu.doStep(currentCommunicationPoint=float(edges[k]), communicationStepSize=step)
        states = [reference[f"x[{i + 1}]"] for i in range(content.table("mean").shape[1])]
        found = list(fmu.getReal(states) if two else fmu.getFloat64(states))
        fmu.terminate()
        fmu.freeInstance()
        return found
