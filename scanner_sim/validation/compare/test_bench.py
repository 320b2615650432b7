"""The test bench: the scenario's instrument before flat targets, with chosen sources of error.

What is measured here comes from the simulator alone: light, detector, estimator and ranging. On the test bench the
laser always shines, the mirrors rest during a dwell, and the test of the spot's shape and the subtraction of a
background, which the closed forms do not have, are off; laws of the whole scenario are not measured on it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.objects import Scene
from scanner_sim.signals.processing import PeakMethod
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup

Array = NDArray[np.float64]

SceneKeys: TypeAlias = dict[str, Any]
"""The keys of an object of a scene, as a file would have them."""

_BARE = {"background": False, "shape": False, "misfit": 0.0, "max_reflectance": None, "isolated": None}
ANEW: dict[str, object] = {"light_seed": None}
"""Keys of ``transport`` with which every seed draws errors of the mirrors and paths of light of its own."""
_AHEAD = RasterScan(rows=1, columns=1, horizontal=(0.0, 0.0), vertical=(0.0, 0.0), motion="stepped")


def plate(
    distance: float,
    reflectance: float,
    *,
    theta: float = 0.0,
    phi: float = 0.0,
    separation: float = 0.0,
    size: float = 1.0,
    tilt: float = 0.0,
    axis: str = "y",
    name: str = "target",
) -> SceneKeys:
    """Return a square plate that faces the beam at the range R in a direction (Θ, φ), or is tilted against it.

    Parameters
    ----------
    distance
        R [m].
    reflectance
        Of its Lambertian surface.
    theta, phi, separation
        Direction [rad], and the mirrors' D_g [m].
    size
        Side [m]: single precision places a plate to 2·10⁻⁷ of it.
    tilt, axis
        Turn [rad] about the plate's own axis ``x`` or ``y``, before all others.
    name
        Of the plate.
    """
    arm = distance * math.cos(theta) - separation
    return {
        "name": name,
        "shape": "rectangle",
        "size": [size, size],
        "position": [distance * math.sin(theta), arm * math.sin(phi), separation + arm * math.cos(phi)],
        "rotation": [
            {"axis": axis, "angle": tilt},
            {"axis": "y", "angle": theta},
            {"axis": "x", "angle": -phi},
        ],
        "material": {"reflectance": reflectance},
    }


def on_test_bench(
    setting: ComparisonSetup,
    *targets: SceneKeys,
    seed: int,
    noise: tuple[str, ...] = (),
    speckle: bool = False,
    mirrors: Mirrors | None = None,
    peak: PeakMethod | None = None,
    **changes: Any,
) -> Scenario:
    """Return the scenario's instrument before a target, in the dark, with the named sources of error only.

    Parameters
    ----------
    setting
        Whose instrument.
    targets
        Of :func:`plate`, each with a name of its own.
    seed
        Of the random numbers.
    noise
        Switches of the line sensor that are on.
    speckle
        Whether the laser's light is coherent.
    mirrors
        The mirrors with their errors; by default they have none.
    peak
        Another estimator than the scenario's.
    changes
        Other parts of the scenario, by name.
    """
    scenario = setting.scenario
    switches = NoiseSwitches(**{name: name in noise for name in NoiseSwitches.model_fields})
    parts = {
        "laser": {"speckle": speckle},
        "mirrors": mirrors or scenario.scanner.mirrors.still(),
        "position_sensor": {"noise": switches},
        "laser_off": 0.0,
    }
    settings: dict[str, object] = {"validation": _BARE, "ambiguity": 1.0, "range_gate": None}
    if peak is not None:
        settings |= {"peak": peak, "bias_correction": "none"}
    whole: dict[str, object] = {
        "seed": seed,
        "ranging": "triangulation",
        "scanner": parts,
        "scene": Scene.model_validate({"objects": list(targets)}),
        "lighting": Lighting(),
        "scan": _AHEAD,
        "transport": ANEW,
        "processing": settings,
    }
    return scenario.changed(**whole | changes)


def mirrors_with_errors(setting: ComparisonSetup) -> Mirrors:
    """Return the scenario's mirrors with their random errors, at an even temperature."""
    return setting.scenario.scanner.mirrors.changed(temperature={"amplitude": 0.0, "rate": 0.0})


def directions(theta: ArrayLike, phi: ArrayLike, mirrors: Mirrors, dwell: float) -> Aim:
    """Return shots in some directions [rad] with mirrors at rest, far enough apart in time to wobble apart."""
    along, across = (np.array(a, dtype=np.float64).ravel() for a in np.broadcast_arrays(theta, phi))
    shot, zero = np.arange(along.size, dtype=np.uint32), np.zeros(along.size)
    time = (max(dwell, 2.0 * mirrors.wobble_time) * shot).astype(np.float64)
    return Aim(shot, along, across, time, zero, zero)


def square(half: float, shots: int) -> tuple[Array, Array]:
    """Return a square grid of at most as many directions (Θ, φ) within ±half [rad]."""
    side = np.linspace(-half, half, math.isqrt(shots))
    theta, phi = np.meshgrid(side, side)
    return theta.ravel(), phi.ravel()


def measure(
    setting: ComparisonSetup, scenario: Scenario, aim: Aim, seeds: Sequence[int] | None = None
) -> dict[str, Array]:
    """Return all layers of shots as float64, NaN where a shot has no range; those of ``seeds`` one by one."""
    layers = Instrument(scenario, device=setting.device).measure(aim, seeds=seeds)
    return {name: values.astype(np.float64) for name, values in layers.items()}


def lines(setting: ComparisonSetup, scenario: Scenario, aim: Aim) -> Array:
    """Return the charges [electron] of the lines of shots, shape (n, pixels), as the converter has them."""
    sensor = scenario.scanner.position_sensor
    charges = np.zeros((len(aim.shot), sensor.pixels))
    _, groups = Instrument(scenario, device=setting.device).expose(aim)
    for group in groups:
        number = group.signal.lines().astype(np.float64)
        charges[group.index] = (number - sensor.bias) * sensor.electrons_per_number
    return charges


def range_errors(setting: ComparisonSetup, scenario: Scenario, aim: Aim) -> Array:
    """Return measured ranges less those along the true directions [m], shape (n,)."""
    layers = measure(setting, scenario, aim)
    return layers["range_m"] - layers["truth.range_m"]
