"""The instrument before plates: the set-up that most equations are tried on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.scan.protocol import Aim
from scanner_sim.validation.reproduce.item import Task

Array = NDArray[np.float64]

FOCAL, BASE, SEPARATION, PITCH = 0.1, 0.2, 0.05, 50e-6
"""Focal length f, base d, axis separation D_g and pixel pitch of the preset [m]."""
DWELL = 50e-6
"""Time of a voxel [s]."""
STILL: Mapping[str, float] = {
    "jitter": 0.0,
    "wobble": 0.0,
    "synchronisation": 0.0,
    "readout_noise": 0.0,
    "readout_step": 0.0,
}
"""Mirrors without errors."""
SILENT: Mapping[str, bool] = dict.fromkeys(
    ("shot", "read", "dark", "prnu", "saturation", "quantisation"), False
)
"""A line sensor without noise."""
QUIET: Mapping[str, object] = {
    "laser": {"speckle": False},
    "mirrors": dict(STILL),
    "position_sensor": {"noise": dict(SILENT)},
    "filter": "none",
}
"""An instrument without any noise, in the dark."""
FIT: Mapping[str, object] = {"peak": "maximum_likelihood"}


def plate(distance: float, half: float, reflectance: float = 0.5) -> dict[str, object]:
    """Return a facing plate that fills a field of ±``half`` [rad] at a distance [m]."""
    size = 2.4 * float(np.tan(half)) * distance + 0.2
    return {
        "name": "plate",
        "shape": "rectangle",
        "size": (size, size),
        "position": (0.0, 0.0, distance),
        "material": {"reflectance": reflectance},
    }


def bench(
    task: Task,
    objects: Sequence[Mapping[str, object]],
    scanner: Mapping[str, object] | None = None,
    *,
    step: int = 0,
    **rest: object,
) -> Instrument:
    """Return the preset, changed, before objects; ``step`` makes the random numbers those of another experiment."""
    scenario = Scenario.model_validate(
        {
            "schema": 1,
            "seed": task.seed + step,
            "scanner": dict(scanner or {}),
            "scene": {"objects": list(objects)},
            "scan": {"rows": 1, "columns": 1, "horizontal": (0.0, 0.0), "vertical": (0.0, 0.0)},
            **rest,
        }
    )
    return Instrument(scenario, device=task.device)


def aim(theta: ArrayLike, phi: ArrayLike, apart: float = DWELL) -> Aim:
    """Return shots with resting mirrors at (Θ, φ) [rad], which broadcast, a time apart [s]."""
    angles = np.broadcast_arrays(np.asarray(theta, dtype=np.float64), np.asarray(phi, dtype=np.float64))
    theta, phi = (np.ravel(angle).astype(np.float64) for angle in angles)
    shot = np.arange(theta.size, dtype=np.uint32)
    still = np.zeros(theta.size)
    return Aim(shot, theta, phi, apart * shot.astype(np.float64), still, still)


def grid(half: float, side: int) -> tuple[Array, Array]:
    """Return Θ and φ of ``side``² directions over ±``half`` [rad]."""
    angles = np.linspace(-half, half, side)
    phi, theta = np.meshgrid(angles, angles, indexing="ij")
    return theta.ravel(), phi.ravel()


def layers_of(made: Instrument, shots: Aim) -> dict[str, Array]:
    """Return the measured layers of shots, float64."""
    return {name: np.asarray(values, dtype=np.float64) for name, values in made.measure(shots).items()}


def slope(x: ArrayLike, y: ArrayLike) -> float:
    """Return the exponent of y in x: the slope of the straight line through their logarithms."""
    return float(np.polyfit(np.log(np.asarray(x)), np.log(np.asarray(y)), 1)[0])
