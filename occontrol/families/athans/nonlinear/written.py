"""Nonlinear plants and sensors as they stand in a problem file."""

from __future__ import annotations

from occontrol.core.kinds import PlainDict
from occontrol.core.state_labels import default_names
from occontrol.families.athans.nonlinear.linearise import Linearisation
from occontrol.families.athans.nonlinear.sensor import FormulaSensor
from occontrol.files.schema.common import prune


def plant_document(linearised: Linearisation) -> PlainDict:
    """The plant as it stands in a problem file."""
    plant = linearised.plant
    key = "next" if plant.discrete else "f"
    unnamed = plant.states == tuple(default_names(len(plant.mean)))
    return prune(
        {
            key: list(plant.formulas),
            "states": None if unnamed else list(plant.states or ()),
            "units": list(plant.units) or None,
            "parameters": {name: dict(p) for name, p in (plant.parameters or {}).items()} or None,
            "noise": [list(row) for row in plant.noise],
            "initial": {"mean": plant.mean.tolist(), "covariance": plant.covariance.tolist()},
            "nominal": None if plant.nominal is None else plant.nominal.document(),
        }
    )


def options_documents(linearised: Linearisation) -> PlainDict:
    """`integrator` and `replan` as they stand in a problem file."""
    replan = linearised.replan
    return {
        "integrator": dict(linearised.integrator.as_dict()) or None,
        "replan": None if replan is None else dict(replan.as_dict()),
    }


def sensor_document(sensor: FormulaSensor) -> PlainDict:
    """A sensor as it stands in a problem file, without its rules."""
    angles = sensor.angles
    return prune(
        {
            "name": sensor.name,
            "h": list(sensor.h),
            "angle": None if not any(angles) else True if all(angles) else list(angles),
            "noise": [list(row) for row in sensor.noise],
            "visible": sensor.visible,
            "cost": sensor.cost.document(),
            "windows": None if sensor.windows is None else [list(window) for window in sensor.windows],
        }
    )
