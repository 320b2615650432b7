"""Artefacts through light, detector and estimator: the clouds of their surfaces, repetition by repetition."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from scanner_sim.acceptance.plan import LengthBar, Plate
from scanner_sim.acceptance.setup import SEEDED, Setup, Surface
from scanner_sim.acceptance.shapes import Cloud, Sight
from scanner_sim.config.built import same_instrument
from scanner_sim.config.calibration import believed_geometry, design_of
from scanner_sim.config.scanner import speckle_optics
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.status import Status
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.instrument.closed_loop.visit_errors import (
    beam_radius,
    range_variances,
    spot_packets,
)
from scanner_sim.instrument.common_errors import ranged_by
from scanner_sim.instrument.simulate import simulate_many
from scanner_sim.optics.deflection import deflected_frame, wobble_correlation
from scanner_sim.products.image import RangeImage
from scanner_sim.ranging.calibration import errors_in_common, parameter_effects
from scanner_sim.render.libraries import DeviceChoice

Array = NDArray[np.float64]

_FAINT = 1e-3
"""Share of the strongest part of a correlation below which a part is left out."""
_STEP, _MARGIN = 0.5, 5.0
"""Distance of the nodes of unlike pixels, and how far they go beyond the images, over an image's width."""


def measured_clouds(
    setup: Setup, *, device: DeviceChoice = "auto", progress: Callable[[int, int], None] | None = None
) -> Iterator[tuple[Surface, tuple[Cloud, ...]]]:
    """Scan each surface as often as the plan says.

    Parameters
    ----------
    setup
        The test.
    device
        Where to compute.
    progress
        Called with the surfaces that are done, and with all.

    Yields
    ------
    Surface, tuple of Cloud
        A surface, and its points in each repetition.

    Raises
    ------
    ScenarioError
        If a scene cannot be measured.
    """
    seeds = host_generator(setup.plan.seed, Stream.ACCEPTANCE, SEEDED).integers(
        2**62, size=(len(setup.surfaces), setup.plan.repetitions)
    )
    for number, (surface, own) in enumerate(zip(setup.surfaces, seeds.tolist(), strict=True), start=1):
        scenario = _scenario(setup, surface)
        repeated = (scenario.replace({"seed": seed}) for seed in own)
        images = simulate_many(repeated, device=device)
        yield surface, tuple(_cloud(scenario, image) for image in images)
        if progress is not None:
            progress(number, len(setup.surfaces))


def _scenario(setup: Setup, surface: Surface) -> Scenario:
    """Return the scenario of the scan of a surface."""
    plan, base = setup.plan, setup.base
    changes: dict[str, object] = {
        "seed": 0,
        "ranging": setup.rangefinder,
        "scene": {"objects": _objects(setup, surface.artefact)},
        "scan": {
            "type": "raster",
            "rows": _voxels(surface, surface.vertical, plan.across),
            "columns": _voxels(surface, surface.horizontal, plan.across),
            "horizontal": surface.horizontal,
            "vertical": surface.vertical,
            "motion": "stepped",
        },
        "lighting": {},
        "pose": {},
        "output": {},
    }
    return same_instrument(base, changes, f"the scan of {surface.name}")


def _voxels(surface: Surface, window: tuple[float, float], most: int) -> int:
    """Return the number of voxels over a window, fewer where spots would overlap: their speckle would be the same."""
    return min(most, int((window[1] - window[0]) * surface.nearest / surface.spot) + 1)


def _objects(setup: Setup, artefact: int) -> list[dict[str, object]]:
    """Return the objects of an artefact as it is made."""
    one, made = list(setup.plan.artefacts.values())[artefact], float(setup.made[artefact])
    material = one.material if isinstance(one.material, str) else one.material.model_dump()
    if isinstance(one, Plate):
        turns = one.rotation if isinstance(one.rotation, tuple) else (one.rotation,)
        look = {"shape": "rectangle", "size": one.size, "rotation": [turn.model_dump() for turn in turns]}
        return [{"name": one.name, "position": one.position, "material": material, **look}]
    places = one.ends(made).tolist() if isinstance(one, LengthBar) else [one.position]
    diameter = one.diameter if isinstance(one, LengthBar) else made
    return [
        {
            "name": f"ball-{end}",
            "shape": "sphere",
            "diameter": diameter,
            "position": tuple(place),
            "material": material,
        }
        for end, place in enumerate(places, start=1)
    ]


def _cloud(scenario: Scenario, image: RangeImage) -> Cloud:
    """Return the points of an image with what their errors have in common."""
    channels, valid = image.channels, image.channels["status"] == Status.VALID

    def flat(name: str) -> Array:
        return np.asarray(channels[name][valid].astype(np.float64))

    points = np.stack([flat(f"P.{axis}") for axis in "XYZ"], axis=1)
    covariance = np.empty((len(points), 3, 3))
    for axis, name in enumerate("xyz"):
        covariance[:, axis, axis] = flat(f"sigma_{name}_m") ** 2
    for one, other in ((0, 1), (0, 2), (1, 2)):
        name = f"cov_{'xyz'[one]}{'xyz'[other]}_m2"
        covariance[:, one, other] = covariance[:, other, one] = flat(name)
    common = _of_calibration(scenario, points, flat("range_m"))
    shared, sight = _of_mirrors(scenario, valid, points, flat("range_m")), None
    if scenario.rangefinders == ("triangulation",):
        pixels = _of_pixels(scenario, points, flat("range_m"), flat("Y"), flat("peak_px"))
        shared = np.concatenate([shared, pixels], axis=2)
        sight = _sight(scenario, points, flat("range_m"))
    told = np.concatenate([common, shared], axis=2)
    return Cloud(points, _without(covariance, told), shared, common, flat("sigma_texture_m") ** 2, sight)


def _without(covariance: Array, shared: Array) -> Array:
    """Return what covariances leave each point alone, when what it shares with others is taken off."""
    values, axes = np.linalg.eigh(covariance - shared @ np.swapaxes(shared, 1, 2))
    return np.asarray((axes * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(axes, 1, 2))


def _of_calibration(scenario: Scenario, points: Array, range_m: Array) -> Array:
    """Return what the calibration's errors move the points by, shape (n, 3, c); c is 0 without any."""
    geometry = believed_geometry(scenario)
    calibration = geometry.calibration
    if calibration is None or not calibration.is_uncertain:
        return np.zeros((len(points), 3, 0))
    _, theta, phi = geometry.sight_of(*points.T)
    (way,) = ranged_by(scenario.rangefinders, geometry)[""]
    return errors_in_common(calibration, way, range_m, theta, phi)[1]


def _grain(scenario: Scenario, distance: float) -> Array:
    """Return V, the speckle of single pixels by which the fit of a resting spot weighs them, at a range [m]."""
    scanner, away = scenario.scanner, np.array([distance])
    if not scanner.laser.speckle:
        return np.zeros(1)
    image = 0.5 * beam_radius(scanner, away) * scanner.receiver.focal_length
    variance = (image / (away * scanner.position_sensor.pitch)) ** 2
    light = spot_packets(scanner, speckle_optics(scanner), variance, away)
    return np.asarray(scenario.processing.speckle_contrast**2 * light.energy * light.ratio**4)


def _sight(scenario: Scenario, points: Array, range_m: Array) -> Sight:
    """Return how triangulation saw points."""
    scanner = scenario.scanner
    _, theta, phi = believed_geometry(scenario).sight_of(*points.T)
    trigonometry = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    frame = deflected_frame(*trigonometry, scanner.mirrors.axis_separation, scanner.receiver.baseline)
    axes = np.stack([np.stack(axis, axis=-1) for axis in (frame.across, frame.normal, frame.along)], axis=1)
    return Sight(range_m, theta, axes, 0.5 * beam_radius(scanner, range_m), scanner.receiver.baseline)


def _of_mirrors(scenario: Scenario, valid: NDArray[np.bool_], points: Array, range_m: Array) -> Array:
    """Return what the mirrors' wobble moves the points by, in independent parts (n, 3, k).

    The encoders miss it, and what is read of the spot or of the pulse's way is that of the true beam: a point is off by
    ∂(x, y, z)/∂(Θ, φ) at a fixed spot or way (:func:`~scanner_sim.ranging.believed.believed_points`), along its beam,
    too.
    The wobble in Θ goes by the row's φ and time, that in φ by the column's Θ and the row's time
    (:func:`~scanner_sim.optics.deflection.wobble_correlation`); a row takes far less than the time in which it changes.
    """
    mirrors, raster = scenario.scanner.mirrors, scenario.raster
    if not mirrors.wobble:
        return np.zeros((len(points), 3, 0))
    (theta, phi), (row, column) = raster.angles(), np.nonzero(valid)
    time = raster.row_times(scenario.scanner.dwell) / mirrors.wobble_time

    def alike(values: Array) -> Array:
        return wobble_correlation(values[:, None] - values)

    by_row = _root(alike(phi / mirrors.wobble_angle) * alike(time))[row]
    by_column = _root(alike(theta / mirrors.wobble_angle))[column]
    by_time = _root(alike(time))[row]
    by_both = (by_time[:, :, None] * by_column[:, None]).reshape(
        len(row), by_time.shape[1] * by_column.shape[1]
    )
    geometry = believed_geometry(scenario)
    _, along, down = geometry.sight_of(*points.T)
    (way,) = ranged_by(scenario.rangefinders, geometry)[""]
    slopes = parameter_effects(design_of(scenario.scanner), way, range_m, along, down).by_readings
    by_theta, by_phi = (mirrors.wobble * slopes[..., axis, None] for axis in (0, 1))
    return np.concatenate([by_theta * by_row[:, None], by_phi * by_both[:, None]], axis=2)


def _root(correlation: Array) -> Array:
    """Return A with A Aᵀ a correlation, of the parts that are not faint, shape (n, k)."""
    values, axes = np.linalg.eigh(correlation)
    kept = values > _FAINT * values[-1]
    return np.asarray(axes[:, kept] * np.sqrt(values[kept]))


def _of_pixels(scenario: Scenario, points: Array, range_m: Array, signal: Array, peak: Array) -> Array:
    """Return what unlike pixels move the points by, (n, 3, k), along their beams.

    Images of standard deviation s weigh unlike responses by h(u) = u exp(−u²/2) (2/√π)^½, u = (x − x_i)/s: independent
    numbers at nodes half an s apart give pairs of images the correlation of
    :func:`~scanner_sim.tracking.errors.pixel_correlation`.
    """
    if not len(points):
        return np.zeros((0, 3, 0))
    scanner = scenario.scanner
    _, theta, _ = believed_geometry(scenario).sight_of(*points.T)
    grain = _grain(scenario, float(np.median(range_m)))
    _, variance, widths = range_variances(scanner, scenario.processing.peak, range_m, theta, signal, grain)
    at = peak / float(np.median(widths))
    node = np.arange(at.min() - _MARGIN, at.max() + _MARGIN + _STEP, _STEP)
    apart = node - at[:, None]
    weight = apart * np.exp(-0.5 * apart**2) * np.sqrt(2.0 * _STEP / np.sqrt(np.pi))
    along = points / np.linalg.norm(points, axis=1)[:, None]
    moved = np.sqrt(variance)[:, None] * weight
    return np.asarray(along[:, :, None] * moved[:, None, :])
