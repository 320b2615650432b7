"""Is σ true? (estimate − truth)/σ of the whole instrument, on the scenario's own scene or on planes drawn at random."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import geometry
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.config.scanner import RangefinderName
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.ranging.ranges import Columns
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.raster import RasterScan, raster_aim
from scanner_sim.scene.objects import Scene
from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, mean_of

Array = NDArray[np.float64]

_RUNS = 64
"""Seeds, each with its own pattern of the pixels' response, which all voxels of a seed have in common."""
_VOXELS = 400
"""Voxels of a plane."""
_DRAWN = 1600
"""Voxels that are drawn from the scan of a scene, of which many lie on edges or on bare metal."""
_FEWEST = 40
"""Voxels of a seed from which its mean counts."""
_FEWEST_RUNS = 8
"""Seeds of so many voxels from which there is a scatter."""
_STEEP = math.tan(math.radians(60.0))
"""Largest slope of a surface for which σ is true."""
_BEND = 0.2
"""Bend of the surface within the spot, over σ, that does no harm."""
_CONTRAST = 1e-3
"""Difference of a surface's speckle from what σ assumes: where any of the light keeps its polarisation there is a lobe,
whose slope over the beam moves the spot by more than σ (on retro-reflecting sheets by up to 3 σ)."""
_UNBIASED = ("maximum_likelihood", "gaussian")
_VARIANCE, _MEAN, _SHARE = 0.05, 0.03, 0.01
"""What the first order of σ leaves: of the variance of the pulls, of their mean, of their share within 1.96 σ."""
_STEADY_CLOCK: dict[str, Any] = {
    "scanner": {"lidar": {"digitiser": {"drift": 0.0}, "photodiode": {"noise": {"clock": False}}}}
}
"""A drift of the clock is common to all shots, and its jitter would hide what the timing of the pulse states."""
_CLIPPED = 0.95
"""Height of an echo, over the amplifier's saturation, from which it may be clipped."""
_CAUTIOUS = ("leading_edge", "constant_fraction")
_HALF, _ASIDE = 0.03, 0.3
"""Deflections to each side of a plane's middle, and of that middle itself [rad], where the mirrors reach them."""


def _honest(setting: ComparisonSetup) -> str:
    chosen = setting.scenario.processing
    if "triangulation" not in setting.scenario.rangefinders:
        return "the scenario ranges by time of flight alone"
    if chosen.bias_correction == "none" and chosen.peak not in _UNBIASED and not setting.own_peak:
        return f"{chosen.peak} has a systematic error, which no σ holds, and it is not corrected"
    return _surveyed(setting)


def _timed(setting: ComparisonSetup) -> str:
    chosen = setting.scenario.processing.pulse
    if "tof" not in setting.scenario.rangefinders:
        return "the scenario ranges by triangulation alone"
    if chosen.timing in _CAUTIOUS:
        return f"σ of {chosen.timing} is cautious, about a fifth larger than its errors"
    return _surveyed(setting)


def _surveyed(setting: ComparisonSetup) -> str:
    """Return why no errors can be gathered on the scene or on planes; empty where they can."""
    scenario = setting.scenario
    course = scenario.scanner.mirrors.temperature
    if course.rate or course.amplitude:
        return "the mirrors drift, which is common to all voxels"
    if not setting.own_scene:
        return ""
    if scenario.scan.layout != "image":
        return "the scenario's scan is no raster; name flat targets with --target"
    if scenario.scan.shots < 4 * _FEWEST:
        return f"the scan has {scenario.scan.shots} voxels only; name flat targets with --target"
    return ""


def _numbers(layers: Columns) -> dict[str, Array]:
    return {name: np.asarray(values, dtype=np.float64) for name, values in layers.items()}


def _on_scene(
    setting: ComparisonSetup, seeds: tuple[int, ...], ranging: RangefinderName
) -> Iterator[tuple[dict[str, Array], NDArray[np.bool_]]]:
    """Yield the layers of voxels drawn from the scenario's scan for each seed, and which of them σ speaks of."""
    scenario = setting.scenario.changed(ranging=ranging, transport=test_bench.ANEW, **_STEADY_CLOCK)
    instrument = Instrument(scenario, device=setting.device)
    scan, dwell = scenario.raster, scenario.scanner.dwell
    for seed in seeds:
        random = np.random.default_rng(seed)
        shots = random.choice(scan.shots, size=min(_DRAWN, scan.shots), replace=False).astype(np.uint32)
        aim = raster_aim(scan, np.sort(shots), dwell)
        # What was loaded and rendered, such as the background, is that of all seeds.
        fresh = Instrument(
            scenario.model_copy(update={"seed": seed}), device=setting.device, reuse=instrument
        )
        layers = _numbers(fresh.measure(aim))
        yield layers, _smooth(setting, fresh, aim, layers) & _unclipped(fresh, layers)


def _smooth(
    setting: ComparisonSetup, instrument: Instrument, aim: Aim, layers: dict[str, Array]
) -> NDArray[np.bool_]:
    """Return which voxels lie on one surface that is plane, not steep, and has the speckle that σ assumes."""
    scenario = setting.scenario
    # A spot on an edge may have a range though its axis goes by.
    good: NDArray[np.bool_] = (layers["status"] == Status.VALID) & np.isfinite(layers["truth.range_m"])
    if scenario.scanner.laser.speckle:
        contrast = np.sqrt(np.asarray(instrument.loaded.coherence.numpy(), dtype=np.float64))
        assumed = scenario.processing.speckle_contrast
        good &= np.abs(contrast[layers["truth.material"].astype(np.intp)] - assumed) < _CONTRAST
    some = np.flatnonzero(good)
    if not some.size:
        return good
    laser, R = scenario.scanner.laser, layers["truth.range_m"][some]
    radius = beam_radius(R, laser.waist_radius, laser.waist_distance, laser.wavelength, laser.m_squared)
    apart = 2.0 * radius / R + 0.5 * np.abs(aim.travel_theta[some])
    fine = np.ones(some.size, dtype=bool)
    for axis in ("theta", "phi"):
        low, high = (_truth(instrument, aim, some, axis, side * apart) for side in (-1.0, 1.0))
        bend = np.abs(low[0] + high[0] - 2.0 * R) < _BEND * layers["sigma_range_m"][some]
        fine &= bend & (np.abs(high[0] - low[0]) < 2.0 * _STEEP * apart * R)
        for number, name in ((1, "truth.object"), (2, "truth.material")):
            own = layers[name][some]
            fine &= (low[number] == own) & (high[number] == own)
    good[some] = fine
    return good


def _unclipped(instrument: Instrument, layers: dict[str, Array]) -> NDArray[np.bool_]:
    """Return which voxels have no echo that the amplifier clips: on those σ of time of flight is cautious."""
    if "triangulation" in instrument.scenario.rangefinders:
        return np.ones(layers["Y"].shape, dtype=bool)
    unit = instrument.time_of_flight
    return layers["Y"] * unit.amperes_per_electron < _CLIPPED * unit.unit.photodiode.saturation


def _truth(
    instrument: Instrument, aim: Aim, some: NDArray[np.intp], axis: str, apart: Array
) -> tuple[Array, ...]:
    """Return range, object and material at some shots of an aim, moved along one axis."""
    moved = {name: getattr(aim, name)[some] for name in Aim.__dataclass_fields__}
    moved[axis] = moved[axis] + apart
    truth, _ = instrument.expose(Aim(**moved))
    found = (truth.distance, truth.object, truth.material)
    with np.errstate(invalid="ignore"):
        return tuple(np.asarray(values.numpy(), dtype=np.float64) for values in found)


def _on_planes(
    setting: ComparisonSetup, seeds: tuple[int, ...], ranging: RangefinderName
) -> Iterator[tuple[dict[str, Array], NDArray[np.bool_]]]:
    """Yield the layers of a small scan of a plane drawn at random for each seed; all its voxels count."""
    scenario, closed = setting.scenario, ClosedForms(setting.scenario)
    ranges, side = setting.flat.ranges, math.isqrt(_VOXELS)
    limit = scenario.scanner.mirrors.max_deflection
    half = min(_HALF, 0.5 * limit)
    aside = min(_ASIDE, limit - half)
    for seed in seeds:
        random = np.random.default_rng(seed)
        distance = float(np.exp(random.uniform(math.log(ranges[0]), math.log(ranges[-1]))))
        tilt, theta, phi = (random.uniform(-1.0, 1.0, 3) * [math.radians(50.0), aside, aside]).tolist()
        size = 2.6 * distance * math.tan(half) / math.cos(abs(tilt) + half)
        plane = test_bench.plate(
            distance,
            setting.flat.reflectance,
            theta=theta,
            phi=phi,
            separation=closed.D,
            size=size,
            tilt=tilt,
            axis="xy"[seed % 2],
        )
        scan = RasterScan(
            rows=side,
            columns=side,
            horizontal=(theta - half, theta + half),
            vertical=(phi - half, phi + half),
        )
        made = scenario.changed(
            seed=seed,
            ranging=ranging,
            scene=Scene.model_validate({"objects": [plane]}),
            lighting=type(scenario.lighting)(),
            scan=scan,
            transport=test_bench.ANEW,
            processing={"range_gate": None},
            **_STEADY_CLOCK,
        )
        instrument = Instrument(made, device=setting.device)
        aim = raster_aim(scan, np.arange(scan.shots, dtype=np.uint32), made.scanner.dwell)
        layers = _numbers(instrument.measure(aim))
        yield layers, _unclipped(instrument, layers)


def _pulls(setting: ComparisonSetup, ranging: RangefinderName) -> Iterator[tuple[Array, Array]]:
    """Yield (estimate − truth)/σ of the range, and χ² of the point, of the voxels of each seed."""
    count = setting.shots(_RUNS) * setting.seeds
    first = setting.seed(16 if ranging == "triangulation" else 18)[0]
    seeds = tuple((first + 17 * number) % 2**63 for number in range(count))
    measured = _on_scene if setting.own_scene else _on_planes
    for layers, good in measured(setting, seeds, ranging):
        valid = good & (layers["status"] == Status.VALID)
        if valid.sum() < _FEWEST:
            continue
        some = {name: values[valid] for name, values in layers.items()}
        truth = geometry.point_from_shot(
            some["truth.range_m"],
            some["truth.theta_rad"],
            some["truth.phi_rad"],
            ClosedForms(setting.scenario).D,
        )
        error = np.stack([some["P.X"], some["P.Y"], some["P.Z"]], axis=-1) - truth
        covariance = np.empty((len(error), 3, 3))
        for i, one in enumerate("xyz"):
            covariance[:, i, i] = some[f"sigma_{one}_m"] ** 2
            for j in range(i):
                covariance[:, i, j] = covariance[:, j, i] = some[f"cov_{'xyz'[j]}{one}_m2"]
        pull = (some["range_m"] - some["truth.range_m"]) / some["sigma_range_m"]
        # Without errors of the angles points err along the beam alone, and their covariance has no inverse.
        spread = ClosedForms(setting.scenario).angle_sigma > 0.0
        solved = np.linalg.solve(covariance, error[..., None])[..., 0] if spread else error
        yield pull, np.sum(error * solved, axis=1)


_CASES = ("mean", "mean square", "share within 1.96 σ", "point: χ² of three, over three")


def _measure(setting: ComparisonSetup, *, ranging: RangefinderName) -> dict[str, Measured]:
    rows = np.array(
        [
            (pull.mean(), np.mean(pull**2), np.mean(np.abs(pull) < 1.959964), squares.mean() / 3.0)
            for pull, squares in _pulls(setting, ranging)
        ]
    )
    if len(rows) < _FEWEST_RUNS:
        return {}
    cases = _CASES if ClosedForms(setting.scenario).angle_sigma > 0.0 else _CASES[:-1]
    return {case: mean_of(rows[:, column]) for column, case in enumerate(cases)}


def _predict(setting: ComparisonSetup) -> dict[str, Predicted]:  # noqa: ARG001 (σ is true of every instrument)
    about = "(R̂ − R)/σ"
    numbers = (
        Predicted(about, "", 0.0, _MEAN, 1.0, "σ"),
        Predicted(about, "", 1.0, _VARIANCE),
        Predicted(about, "", 0.95, _SHARE),
        Predicted("error by its covariance", "", 1.0, _VARIANCE),
    )
    return dict(zip(_CASES, numbers, strict=True))


_FEW = "too few voxels lie on smooth, depolarising surfaces inclined by less than 60 deg; name targets with --target"
COVERAGE = Law(
    "coverage",
    "The stated σ is true",
    "(estimate − truth)/σ is standard normal",
    "Mean 0, variance 1, 95 % within 1.96 σ, and χ² of the point with its covariance, over voxels whose spot lies "
    "on one smooth, depolarising surface inclined by less than 60 deg. Every source of error on; seeds are the "
    "samples, since the pixels' response is common to all voxels of one.",
    "scene",
    _honest,
    partial(_measure, ranging="triangulation"),
    _predict,
    _FEW,
    exercises="peak",
)
TOF_COVERAGE = Law(
    "tof_coverage",
    "The stated σ of time of flight is true",
    "(estimate − truth)/σ is standard normal",
    "As the same law of triangulation, by the scenario's timing of the pulse: mean 0, variance 1, 95 % within 1.96 σ, "
    "and χ² of the point, over echoes that the amplifier does not clip. Every source of error on but the clock, which "
    "has a law of its own.",
    "scene",
    _timed,
    partial(_measure, ranging="tof"),
    _predict,
    _FEW,
    exercises="pulse",
    rangefinder="tof",
)
