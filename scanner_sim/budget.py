"""The error budget: each source of error alone and all together, and which of them dominates where.

On a facing flat target the range is measured many times at a few places of the spot in its pixel, with one source
switched on and the estimator told of them all: it weighs the pixels as it does in a scan, so that the sources alone add
up to the whole in quadrature. What the estimator errs without any noise is taken off the errors, shot by shot, and is
a source of its own.

Not in the budget: Sun and Earth (the target stands in the dark). Sources that make less than 10⁻⁶ of the range are at
the rounding of single precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim.detector.encoders import read_encoders
from scanner_sim.errors import InputError
from scanner_sim.optics.deflection import ERRORS
from scanner_sim.products.budget import BudgetRow, Dominance
from scanner_sim.ranging.triangulation import position_sigma, range_from_position, range_jacobian
from scanner_sim.render.device import DeviceChoice
from scanner_sim.scan.raster import Aim, raster_aim, tiled_order
from scanner_sim.scenario import Scenario
from scanner_sim.scene.lighting import Lighting
from scanner_sim.scene.objects import Scene
from scanner_sim.status import Status
from scanner_sim.workbench import Workbench

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

FARTHEST = 30.0
"""Farthest distance of the target [m]."""
PLACES = 4
"""Places of the spot in its pixel."""
_SIDE = 22
"""Shots along each side of the target."""
HALF = 0.05
"""Deflection to each side at which the target is measured [rad]: far enough apart that no speckle is shared."""
_BATCH = 65536
_QUIET, _ALL = "estimator", "all"

_NOISE = {"shot": "shot", "read": "read", "quantisation": "quantisation", "response": "prnu"}
"""Switch of the detector for each source of noise."""
_SYSTEMATIC = (_QUIET, "response")
"""Sources that are the same for all shots at one place: one value for each place."""


def sources_of(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the sources of error that a scenario has, ``all`` and ``estimator`` included."""
    scanner = scenario.scanner
    noise, mirrors = scanner.position_sensor.noise, scanner.mirrors
    course = mirrors.temperature
    names = [name for name, switch in _NOISE.items() if getattr(noise, switch)]
    names += ["speckle"] if scanner.laser.speckle else []
    moved = [name for name, keys in ERRORS.items() if any(getattr(mirrors, key) for key in keys)]
    names += [name for name in moved if name != "drift" or course.rate or course.amplitude]
    return (*names, _QUIET, _ALL)


def distances_of(scenario: Scenario, count: int) -> Array:
    """Return evenly spaced distances in logarithms [m], from the nearest range to 30 m or the farthest.

    Raises
    ------
    InputError
        If the array sees nothing that is nearer than 30 m.
    """
    nearest, farthest = 1.1 * scenario.scanner.nearest_range, 0.9 * scenario.scanner.farthest_range
    if nearest >= min(FARTHEST, farthest):
        raise InputError(
            f"the array sees ranges from {nearest:.4g} m only.",
            remedy="Raise position_sensor.pixels or pitch: the budget goes to 30 m.",
        )
    return np.geomspace(nearest, min(FARTHEST, farthest), count)


def measure_budget(
    scenario: Scenario,
    distances: Array,
    reflectance: float,
    *,
    device: DeviceChoice = "auto",
    progress: Progress | None = None,
) -> tuple[BudgetRow, ...]:
    """Measure the standard deviation of the range on a facing target, for each source alone and for all together.

    Parameters
    ----------
    scenario
        Instrument and processing; scene and lighting are left out. The scan gives the sweep of a dwell.
    distances
        Distances of the target [m].
    reflectance
        Of the target, Lambertian.
    device
        Where to compute.
    progress
        Called with the targets done and the targets in all.

    Returns
    -------
    tuple of BudgetRow
        For each source and distance, with 95 % intervals of χ²; the analytic value is left open. NaN where fewer than
        half of the shots have a range.
    """
    told = Workbench(_alone(scenario, _ALL, Scene()), device=device)
    names = sources_of(scenario)
    rows: dict[str, list[BudgetRow]] = {name: [] for name in names}
    done, total = 0, len(distances) * len(names) * PLACES
    for step, distance in enumerate(distances.tolist()):
        errors: dict[str, list[Array]] = {name: [] for name in names}
        for place, where in enumerate(_places(told, distance)):
            for name in (_QUIET, *(name for name in names if name != _QUIET)):
                seed = (scenario.seed + 101 * step + 17 * place + 1) % 2**63
                found = _errors(scenario, told, name, where, reflectance, seed, device)
                if name not in (_QUIET, _ALL):
                    found = found - errors[_QUIET][place]
                errors[name].append(found * (distance / where) ** (1 if name == _QUIET else 2))
                done += 1
                if progress is not None:
                    progress(done, total)
        for name in names:
            rows[name].append(_row(name, distance, errors[name]))
    return tuple(row for name in names for row in rows[name])


def _row(name: str, distance: float, errors: list[Array]) -> BudgetRow:
    """Return the standard deviation of the errors at a few places, with its interval."""
    count = sum(int(np.isfinite(values).sum()) for values in errors)
    if count < 0.5 * sum(values.size for values in errors) or not all(
        np.isfinite(values).any() for values in errors
    ):
        return BudgetRow("triangulation", name, distance, math.nan, math.nan, math.nan, math.nan, 0)
    if name in _SYSTEMATIC:
        squares, freedom = np.array([np.nanmean(values) ** 2 for values in errors]), len(errors)
    elif name == _ALL:
        squares, freedom = np.array([np.nanmean(values**2) for values in errors]), count
    else:
        squares, freedom = np.array([np.nanvar(values, ddof=1) for values in errors]), count - len(errors)
    sigma = float(np.sqrt(squares.mean()))
    low, high = (sigma * math.sqrt(freedom / float(chi2.ppf(share, freedom))) for share in (0.975, 0.025))
    return BudgetRow("triangulation", name, distance, math.nan, sigma, low, high, freedom)


def _places(told: Workbench, distance: float) -> Iterator[float]:
    """Yield distances about one, at which the spot lies at evenly spaced places in its pixel."""
    pixel = round(float(told.spot.pixel(distance, 0.0, 1.0)))
    for place in range(PLACES):
        yield float(told.spot.range(pixel + (place + 0.5) / PLACES - 0.5, 0.0, 1.0))


def _errors(
    scenario: Scenario,
    told: Workbench,
    name: str,
    distance: float,
    reflectance: float,
    seed: int,
    device: DeviceChoice,
) -> Array:
    """Return the errors of the range of all shots on a target [m]; NaN where there is none."""
    from scanner_sim.signals.peaks import find_peaks

    scene = _target(scenario, distance, reflectance)
    bench = Workbench(_alone(scenario, name, scene).model_copy(update={"seed": seed}), device=device)
    aim = _aim(scenario)
    mirrors = bench.scenario.scanner.mirrors
    _, pointing = bench.fire(aim)
    theta, _ = read_encoders(
        aim.shot, aim.theta + pointing.seen_theta, aim.phi + pointing.seen_phi, mirrors, seed
    )
    truth, groups = bench.expose(aim)
    peak = np.full(aim.theta.size, np.nan)
    for group in groups:
        found = find_peaks(
            group.signal,
            scenario.scanner.position_sensor,
            told.scenario.processing,
            scenario.scanner.dwell,
            told.spot,
            aim.theta[group.index].astype(np.float32),
            told.bias,
            told.expected_speckle(),
        )
        peak[group.index] = found.position.numpy()
    geometry = told.geometry
    measured = range_from_position(geometry.position(peak), theta, geometry.focal_length, geometry.baseline)
    return np.asarray(measured - truth.distance.numpy().astype(np.float64))


def _aim(scenario: Scenario) -> Aim:
    """Return shots over the target, each with the sweep that the scenario's scan has, and far apart in time."""
    angles = np.linspace(-HALF, HALF, _SIDE)
    phi, theta = (values.ravel() for values in np.meshgrid(angles, angles, indexing="ij"))
    shot = np.arange(theta.size, dtype=np.uint32)
    travel = np.full(theta.shape, scenario.raster.travel)
    time = 2.0 * scenario.scanner.mirrors.wobble_time * shot.astype(np.float64)
    return Aim(shot, theta, phi, time, travel, np.zeros(theta.shape))


def _target(scenario: Scenario, distance: float, reflectance: float) -> Scene:
    """Return a facing plate, no larger than is lit: single precision places it to a share of its size."""
    size = 2.0 * (HALF + abs(scenario.raster.travel)) * distance + 8.0 * scenario.scanner.laser.radius(
        distance
    )
    plate = {
        "name": "target",
        "shape": "rectangle",
        "size": (1.1 * size, 1.1 * size),
        "position": (0.0, 0.0, distance),
        "material": {"reflectance": reflectance},
    }
    return Scene.model_validate({"objects": [plate]})


def _alone(scenario: Scenario, name: str, scene: Scene) -> Scenario:
    """Return the scenario in the dark before a scene, with one source of error, or with ``all``."""
    scanner = scenario.scanner.model_copy(update={"laser_off": 0.0})
    if name != _ALL:
        sensor = scanner.position_sensor
        switches = sensor.noise.only("dark", "saturation", *([_NOISE[name]] if name in _NOISE else []))
        scanner = scanner.model_copy(
            update={
                "laser": scanner.laser.model_copy(update={"speckle": name == "speckle"}),
                "mirrors": scanner.mirrors.still(but=name),
                "position_sensor": sensor.model_copy(update={"noise": switches}),
            }
        )
    processing = scenario.processing.model_copy(update={"range_gate": None})
    return scenario.model_copy(
        update={"scanner": scanner, "scene": scene, "lighting": Lighting(), "processing": processing}
    )


class _Part(NamedTuple):
    """A source in the peak's σ: its name, and what the σ model is told without it."""

    name: str
    noise: dict[str, bool]
    speckle: bool = True
    misfit: bool = True


_PARTS = (
    _Part("shot", {"shot": False}),
    _Part("read", {"read": False}),
    _Part("quantisation", {"quantisation": False}),
    _Part("response", {"prnu": False}),
    _Part("speckle", {}, speckle=False),
    _Part("misfit", {}, misfit=False),
)


def dominating(
    scenario: Scenario, *, device: DeviceChoice = "auto", progress: Progress | None = None
) -> Dominance:
    """Tell for each voxel of a scenario's scan which source makes most of the stated σ of its range.

    Each part of the variance is what goes when the σ model is no longer told of its source: σ² with all less σ²
    without it, on the same signal. For the maximum-likelihood fit, whose weights follow, that is a little less than the
    source's share. Mirrors' parts are those of the Jacobian.

    Parameters
    ----------
    scenario
        The whole scenario, scene and lighting included.
    device, progress
        As for :func:`measure_budget`.

    Returns
    -------
    Dominance
    """
    bench = Workbench(scenario, device=device)
    scan, geometry = scenario.raster, bench.geometry
    f, d, mirrors = geometry.focal_length, geometry.baseline, scenario.scanner.mirrors
    names = (*(part.name for part in _PARTS), "synchronisation", "deflection")
    variances = np.full((len(names), scan.shots), np.nan)
    order = tiled_order(scan)
    for start in range(0, scan.shots, _BATCH):
        shots = order[start : start + _BATCH]
        aim = raster_aim(scan, shots, scenario.scanner.dwell)
        peak, parts = _peak_parts(bench, aim)
        position = geometry.position(peak)
        by_position, by_theta = range_jacobian(position, aim.theta, f, d)
        apart = position_sigma(position, 0.0, f, geometry.pitch, geometry.synchronisation)
        variances[: len(_PARTS), shots] = parts * (by_position * geometry.pitch) ** 2
        variances[-2, shots] = (by_position * apart) ** 2
        variances[-1, shots] = (by_theta * mirrors.reading_sigma(aim.theta, aim.time)) ** 2
        if progress is not None:
            progress(start + len(shots), scan.shots)
    theta, phi = scan.angles()
    return Dominance(names, variances.reshape(len(names), scan.rows, scan.columns), theta, phi)


def _peak_parts(bench: Workbench, aim: Aim) -> tuple[Array, Array]:
    """Return peaks [pixel], shape (n,), and the parts of their variance [pixel²], shape (parts, n)."""
    from scanner_sim.signals.peaks import find_peaks

    scenario = bench.scenario
    sensor, processing = scenario.scanner.position_sensor, scenario.processing
    peak, parts = np.full(aim.theta.size, np.nan), np.full((len(_PARTS), aim.theta.size), np.nan)
    _, groups = bench.expose(aim)
    for group in groups:
        theta = aim.theta[group.index].astype(np.float32)
        valid = group.peaks.status.numpy() == Status.VALID
        position, whole = (
            np.asarray(a.numpy(), np.float64) for a in (group.peaks.position, group.peaks.sigma)
        )
        peak[group.index] = np.where(valid, position, np.nan)
        for number, part in enumerate(_PARTS):
            noise = sensor.noise.model_copy(update=part.noise)
            told = sensor.model_copy(update={"noise": noise})
            misfit = processing.validation.misfit if part.misfit else 0.0
            validation = processing.validation.model_copy(update={"misfit": misfit, "shape": False})
            without = find_peaks(
                group.signal,
                told,
                processing.model_copy(update={"validation": validation}),
                scenario.scanner.dwell,
                bench.spot,
                theta,
                bench.bias,
                bench.expected_speckle() if part.speckle else None,
            )
            left = np.asarray(without.sigma.numpy(), dtype=np.float64)
            # What the changed model refuses it says nothing about.
            left = np.where(np.isfinite(left), left, whole)
            parts[number, group.index] = np.where(valid, np.maximum(whole**2 - left**2, 0.0), np.nan)
    return peak, parts
