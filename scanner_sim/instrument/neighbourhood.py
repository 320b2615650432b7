"""What the neighbours in a raster image say of its voxels: isolated ranges, uneven spots, mixed ones; fused again.

All of it comes after the shots are measured, from the image alone: so it does not depend on how the shots were
grouped.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.calibration import believed_geometry
from scanner_sim.config.scanner import speckle_optics
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.packets import dwell_average
from scanner_sim.foundation.channels import MEASURED_BY
from scanner_sim.foundation.status import Status
from scanner_sim.optics.speckle import Packets, packets_of
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.ranging.covariance import PointCovariance
from scanner_sim.ranging.fusion import fuse_points
from scanner_sim.ranging.mixed_voxels import is_faint, is_mixed
from scanner_sim.ranging.neighbours import is_isolated
from scanner_sim.ranging.ranges import Deflections, Layers, Ranges, layers_of
from scanner_sim.ranging.shared_noise import Overlap, SharedNoise
from scanner_sim.ranging.uneven import Raster, is_rugged, pitch_of, relief, texture, window
from scanner_sim.scan.raster import raster_aim

Array = NDArray[np.float64]

_FAINT = 2.0
"""Height of a peak over the detection threshold below which noise may hide its neighbours."""
_FAINT_ECHO = 10.0
"""The same of an echo, over the noise: twice a usual threshold."""
_NEAREST = 0.1
"""Least range at which the spot is looked at [m]."""
_TOGETHER = 1 << 18
"""Voxels that are judged together: bounds the memory."""
_BANDS_OVER_REACH = 6
"""Least rows of a band over those on each side of it that have a say in it."""


@dataclass(frozen=True)
class _Voxels:
    """Voxels of a scenario's raster, at ranges [m] of shape (rows, columns), with what follows of them alone.

    ``prefix`` is that of the layers of their way of ranging.
    """

    scenario: Scenario
    range_m: Array
    prefix: str = ""

    @cached_property
    def raster(self) -> Raster:
        """Their geometry; a pulse finds the beam at one place."""
        spot = _spot(self.scenario, self.range_m)
        travel = 0.0 if self.prefix else _travel(self.scenario)
        return Raster.of(self.range_m, _pitch(self.scenario), spot, travel)

    @cached_property
    def overlap(self) -> Overlap:
        """What their beams see alike."""
        radius = 2.0 * self.raster.spot
        return Overlap(self.raster.across / radius, self.raster.down / radius)

    @cached_property
    def packets(self) -> tuple[Packets, tuple[Array, Array]]:
        """The packets of their speckle, and what a dwell leaves of the variances of energy and position."""
        scanner, raster = self.scenario.scanner, self.raster
        image = np.square(
            raster.spot * scanner.receiver.focal_length / (self.range_m * scanner.position_sensor.pitch)
        )
        left = dwell_average(raster.travel, 0.0 * raster.travel, 2.0 * raster.spot)
        return packets_of(speckle_optics(scanner), image, image, scanner.seen_at(self.range_m)), left

    @cached_property
    def speckle_m2(self) -> tuple[Array, Array]:
        """Variances of their ranges by speckle: what moves as the energy does, and what moves as the centroid [m²].

        Pulses have none.
        """
        if self.prefix:
            return np.zeros(self.range_m.shape), np.zeros(self.range_m.shape)
        scanner, (packets, (energy, position)) = self.scenario.scanner, self.packets
        line, baseline = scanner.receiver.line_image, scanner.receiver.baseline
        depth = self.range_m - line.slope * baseline
        pixel = depth**2 * scanner.position_sensor.pitch / (line.scale * baseline)
        variance = (_contrast(self.scenario) * pixel * packets.ratio * packets.sigma) ** 2 * packets.energy
        return variance * (1.0 - packets.on_surface) * energy, variance * packets.on_surface * position

    def shared(self, own: Array, energy: Array, position: Array) -> SharedNoise:
        """Return noise of theirs by its variances."""
        return SharedNoise(own, energy, position, self.overlap)


def reach(scenario: Scenario) -> int:
    """Return how many voxels to each side have a say in a voxel of the scenario's raster."""
    nearest = min(scenario.scanner.seen_by(name)[0] for name in scenario.rangefinders)
    distance = max(_NEAREST, nearest)
    return window(float(_spot(scenario, np.array(distance))) / distance, _pitch(scenario))


def judge_neighbours(
    scenario: Scenario, layers: Layers, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> None:
    """Let the voxels of an image judge one another; ``layers`` change in place.

    Ranges that agree with none of their neighbours are refused as ``ISOLATED``, in triangulation only: time of flight
    knows no background that moves a peak. What unevenness does to a range enters its σ and the layer
    ``sigma_texture_m``. Spots on edges are refused as ``MIXED``, by either method of ranging. Then both are
    fused again.

    Parameters
    ----------
    scenario
        What was measured, and how it is processed.
    layers
        Layers of shape (rows, columns), float32.
    rows, columns
        Rows and columns of the scenario's raster that the layers are of.
    """
    far, above = reach(scenario), {name: values[:0] for name, values in layers.items()}
    for first, last in bands(len(rows), len(columns), far):
        low, high = max(0, first - far), min(len(rows), last + far)
        # Those above are as they were measured, though they are judged already.
        part = {name: np.concatenate([own, layers[name][first:high]]) for name, own in above.items()}
        above = {name: values[max(last - far - low, 0) : last - low].copy() for name, values in part.items()}
        _judge(scenario, part, rows[low:high], columns)
        for name, values in part.items():
            if name not in layers:
                layers[name] = np.empty((len(rows), len(columns)), dtype=values.dtype)
            layers[name][first:last] = values[first - low : last - low]
    if "snr_detection" not in layers:
        for name in (*MEASURED_BY["tof.status"], "tof.status"):
            if name in layers:
                layers[name.removeprefix("tof.")] = layers[name]


def bands(rows: int, columns: int, far: int) -> list[tuple[int, int]]:
    """Return the first rows of the bands of an image that are judged one after the other, and those behind their last.

    ``far`` is how many rows to each side have a say in a voxel (:func:`reach`).
    """
    height = max(_TOGETHER // columns, _BANDS_OVER_REACH * far)
    return [(first, min(first + height, rows)) for first in range(0, rows, height)]


def most_together(scenario: Scenario) -> int:
    """Return how many voxels of the scenario's raster are judged together, at most; 0 for a scan without rows."""
    if scenario.scan.layout != "image":
        return 0
    scan, far = scenario.raster, reach(scenario)
    height = max(last - first for first, last in bands(scan.rows, scan.columns, far))
    return min(height + 2 * far, scan.rows) * scan.columns


def _judge(scenario: Scenario, layers: Layers, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> None:
    """Let voxels judge one another: see :func:`judge_neighbours`."""
    settings = scenario.processing.validation
    prefixes = [prefix for prefix in ("", "tof.") if f"{prefix}snr_detection" in layers]
    if "" in prefixes and settings.isolated is not None:
        _refuse(layers, "", _isolated(scenario, layers, rows, columns), Status.ISOLATED)
    for prefix in prefixes:
        voxels = _Voxels(scenario, layers[f"{prefix}range_m"].astype(np.float64), prefix)
        _state_unevenness(voxels, layers, rows, columns)
        if settings.mixed is not None:
            _refuse(layers, prefix, _mixed(voxels, layers, settings.mixed), Status.MIXED)
    if "fused.status" in layers:
        _fuse_again(scenario, layers, rows, columns)


def _refuse(layers: Layers, prefix: str, where: NDArray[np.bool_], code: Status) -> None:
    """Take the measured numbers of some voxels away, by one method of ranging."""
    layers[f"{prefix}status"][where] = code
    for name in MEASURED_BY[f"{prefix}status"]:
        if name in layers:
            layers[name][where] = np.nan


def _isolated(
    scenario: Scenario, layers: Layers, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> NDArray[np.bool_]:
    settings, (theta, phi) = scenario.processing.validation, scenario.raster.angles()
    return is_isolated(
        layers["range_m"],
        layers["sigma_range_m"],
        layers["status"].astype(np.uint32),
        theta[columns],
        phi[rows],
        float(settings.isolated or 0.0),
        settings.steepest,
    )


def _state_unevenness(
    voxels: _Voxels, layers: Layers, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> None:
    """Add to σ and to the covariance what uneven spots may move ranges by, along the beam."""
    scenario, range_m, raster, prefix = voxels.scenario, voxels.range_m, voxels.raster, voxels.prefix
    sigma = layers[f"{prefix}sigma_range_m"].astype(np.float64)
    added = np.where(np.isfinite(range_m), 0.0, np.nan)
    if scenario.processing.validation.uneven:
        noise = _range_noise(voxels, sigma)
        where = is_rugged(range_m, noise, raster)
        moved = np.zeros(range_m.shape)
        if not prefix:
            signal = np.where(np.isfinite(range_m), layers["Y"].astype(np.float64), np.nan)
            lever = range_m / scenario.scanner.receiver.baseline
            moved = lever * texture(signal, _signal_noise(voxels, layers), raster, where)
        bent = relief(range_m, noise, moved, raster, where)
        added = np.where(np.isfinite(range_m), np.hypot(moved, bent), np.nan)
    theta, phi = scenario.raster.angles()
    # ∂X/∂R of eq 3.
    beam = coordinates(1.0, theta[columns][None, :], phi[rows][:, None], 0.0)
    layers[f"{prefix}sigma_texture_m"] = added.astype(np.float32)
    layers[f"{prefix}sigma_range_m"] = np.hypot(sigma, added).astype(np.float32)
    for axis, along in zip("xyz", beam, strict=True):
        name = f"{prefix}sigma_{axis}_m"
        layers[name] = np.hypot(layers[name].astype(np.float64), along * added).astype(np.float32)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        name = f"{prefix}cov_{'xyz'[one]}{'xyz'[other]}_m2"
        shared = beam[one] * beam[other] * added**2
        layers[name] = (layers[name].astype(np.float64) + shared).astype(np.float32)


def _signal_noise(voxels: _Voxels, layers: Layers) -> SharedNoise:
    """Return the variance of the returned signal over its square, by noise and speckle.

    Noise is at most that of the brightest pixel; the speckle is that of the whole spot's energy.
    """
    snr = np.maximum(layers["snr_detection"].astype(np.float64), 1.0)
    return voxels.shared(1.0 / snr**2, _height_variance(voxels), np.zeros(snr.shape))


def _range_noise(voxels: _Voxels, sigma: Array) -> SharedNoise:
    """Return the variance of the ranges: speckle's, which moves the centroid, is shared, and the rest is not."""
    even, moved = voxels.speckle_m2
    least = np.fmin(1.0, sigma**2 / np.fmax(even + moved, 1e-30))
    return voxels.shared(sigma**2 - least * (even + moved), least * even, least * moved)


def _height_variance(voxels: _Voxels) -> Array:
    """Return the relative variance of the spots' light by speckle."""
    packets, (energy, _) = voxels.packets
    return np.asarray(_contrast(voxels.scenario) ** 2 * packets.energy * energy)


def _contrast(scenario: Scenario) -> float:
    return scenario.processing.speckle_contrast if scenario.scanner.laser.speckle else 0.0


def _mixed(voxels: _Voxels, layers: Layers, steepest: float) -> NDArray[np.bool_]:
    scenario, range_m, raster, prefix = voxels.scenario, voxels.range_m, voxels.raster, voxels.prefix
    sigma, uneven = (layers[f"{prefix}sigma_{part}_m"].astype(np.float64) for part in ("range", "texture"))
    noise = np.sqrt(np.maximum(sigma**2 - uneven**2, 0.0))
    faintest = _FAINT_ECHO if prefix else _FAINT * scenario.processing.threshold
    speckle = np.zeros(range_m.shape) if prefix else _height_variance(voxels)
    faint = is_faint(layers[f"{prefix}snr_detection"].astype(np.float64), faintest, speckle, raster)
    status = layers[f"{prefix}status"].astype(np.uint32)
    return is_mixed(range_m, _range_noise(voxels, noise), uneven, status, faint, raster, steepest)


def _travel(scenario: Scenario) -> float:
    """Return the angle by which the beam moves along the row while it is measured [rad]."""
    return scenario.raster.travel * scenario.scanner.exposure / scenario.scanner.dwell


def _pitch(scenario: Scenario) -> tuple[float, float]:
    theta, phi = scenario.raster.angles()
    return pitch_of(theta), pitch_of(phi)


def _spot(scenario: Scenario, range_m: Array) -> Array:
    """Return the standard deviation of the beam's irradiance, half of its 1/e² radius [m]."""
    laser = scenario.scanner.laser
    away = (range_m - laser.waist_distance) / laser.rayleigh_length
    return np.asarray(0.5 * laser.waist_radius * np.hypot(1.0, away))


def _fuse_again(
    scenario: Scenario, layers: Layers, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> None:
    """Combine triangulation and time of flight as the neighbours left them."""
    scanner, scan, shape = scenario.scanner, scenario.raster, layers["status"].shape
    triangulated, echo = _ranges(layers, ""), _ranges(layers, "tof.")
    known = triangulated.status == Status.VALID
    x, y, z = (np.where(known, getattr(triangulated, axis), getattr(echo, axis)) for axis in "xyz")
    geometry = believed_geometry(scenario)
    _, theta, phi = geometry.sight_of(x, y, z)
    shots = (rows[:, None] * scan.columns + columns[None, :]).astype(np.uint32).ravel()
    time, mirrors = raster_aim(scan, shots, scanner.dwell).time, scanner.mirrors
    readings = Deflections(theta, phi, *(mirrors.reading_sigma(angle, time) for angle in (theta, phi)))
    fused, triangulated, echo = fuse_points(triangulated, echo, readings, geometry)
    for ranges, prefix in ((triangulated, ""), (echo, "tof."), (fused, "fused.")):
        for name, values in layers_of(ranges, prefix).items():
            layers[name] = values.reshape(shape).astype(np.float32)
    for status, names in MEASURED_BY.items():
        for name in filter(layers.__contains__, names):
            layers[name][layers[status] != Status.VALID] = np.nan


def _ranges(layers: Layers, prefix: str) -> Ranges:
    """Return layers as ranges, shape (rows · columns,)."""

    def flat(name: str) -> Array:
        return np.asarray(layers[prefix + name].astype(np.float64).ravel())

    xx, yy, zz = (flat(f"sigma_{axis}_m") ** 2 for axis in "xyz")
    xy, xz, yz = (flat(f"cov_{pair}_m2") for pair in ("xy", "xz", "yz"))
    r, sigma, x, y, z = (flat(name) for name in ("range_m", "sigma_range_m", "P.X", "P.Y", "P.Z"))
    status = layers[f"{prefix}status"].ravel().astype(np.uint32)
    return Ranges(r, sigma, x, y, z, PointCovariance(xx, yy, zz, xy, xz, yz), status)
