"""A self-calibration as plain data."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np

from scanner_sim.calibration.holdout import Misfit
from scanner_sim.calibration.selfcal import SelfCalibrated
from scanner_sim.calibration.setup import Setup
from scanner_sim.foundation.parameters import INDEX, PARAMETERS


def about(result: SelfCalibrated) -> str:
    """Return a sentence on how a calibration was made."""
    field, adjusted = result.field, result.adjusted
    return (
        f"self-calibration: {len(field.sightings)} sightings of {len(field.targets.names)} targets on "
        f"{len(field.targets.boards)} boards from {len(field.stations)} stations, "
        f"unit weight {adjusted.unit_weight:.3f}"
    )


def report(setup: Setup, result: SelfCalibrated, warnings: tuple[str, ...]) -> dict[str, object]:
    """Return everything that is known of a self-calibration, in SI, as plain data."""
    field, adjusted = result.field, result.adjusted
    return {
        "software": f"scanner-sim {version('scanner-sim')}",
        "instrument": setup.digest,
        "sightings": "simulated" if setup.plan.sightings is None else setup.plan.sightings.name,
        "seed": setup.plan.seed,
        "ranging": setup.rangefinder,
        "parameters": {
            name: {
                "unit": PARAMETERS[INDEX[name]].dimension.unit,
                "value": value,
                "sigma": sigma,
                "tolerance": field.tolerance[name],
            }
            for name, value, sigma in zip(
                field.sought, result.values.tolist(), result.sigma.tolist(), strict=True
            )
        },
        "correlation": {"of": list(field.sought), "matrix": result.correlations.tolist()},
        "unobserved": [
            {
                "combination": one.words,
                "parts": dict(one.parts),
                "sigma_over_tolerance": one.sigma,
            }
            for one in result.unobserved
        ],
        "unit_weight": adjusted.unit_weight,
        "degrees_of_freedom": adjusted.freedom,
        "steps": adjusted.steps,
        "doubted_sightings": [
            {"station": station, "target": target, "weight": weight}
            for station, target, weight in result.doubted
        ],
        "misfit": {
            "fitted": _misfit(result.fitted),
            "held_out": None if result.held_out is None else _misfit(result.held_out),
        },
        "stations": _poses(
            field.stations, adjusted.unknowns.stations.position, adjusted.unknowns.stations.rotation
        ),
        "boards": _poses(
            field.targets.boards, adjusted.unknowns.boards.position, adjusted.unknowns.boards.rotation
        ),
        "warnings": list(warnings),
    }


def _misfit(found: Misfit) -> dict[str, object]:
    return {
        "as_designed": found.designed,
        "calibrated": found.calibrated,
        "improvement": found.improvement,
        "views": found.views,
        "sightings": found.targets,
    }


def _poses(names: tuple[str, ...], position: np.ndarray, rotation: np.ndarray) -> dict[str, object]:
    return {
        name: {"position_m": place.tolist(), "rotation": turn.tolist()}
        for name, place, turn in zip(names, position, rotation, strict=True)
    }
