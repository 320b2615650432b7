"""What the instrument errs about the places of single targets, from simulated pixels.

A grid of equal discs on plates faces the scanner in the dark. Over each disc the mirrors run the tracker's patterns;
their voxels go through light, sensors, peaks, ranges and the fit of the disc. The errors are those of the measured
places against the centres of the discs: angles from the line sensor's intensities, ranges from triangulation and from
time of flight.

Not in the errors: Sun and Earth, the tracker's own pointing, and what is common to all patterns: the mirrors' scale and
zero, a distortion of the scanner, the survey of the targets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scanner_sim.render.device import DeviceChoice
from scanner_sim.scan.schedule import PatternMotion
from scanner_sim.scenario import Scenario
from scanner_sim.target_grid import StudyTarget, grid_motion, spread_distances, target_grid
from scanner_sim.track_voxels import SignalNoise, aim_of, samples_of
from scanner_sim.tracking.measurement import Measurement, measure_target
from scanner_sim.tracking.samples import PatternSamples

Array = NDArray[np.float64]
Ranging = Literal["triangulation", "tof"]

RANGINGS: tuple[Ranging, ...] = ("triangulation", "tof")


@dataclass(frozen=True, eq=False)
class TargetErrors:
    """Measured less true places of targets at one range.

    Attributes
    ----------
    distance
        Of the grid's plane [m].
    error
        Θ, φ [rad], R by triangulation, R by time of flight [m], shape (places, sightings, 4); NaN where the target was
        not found. A place is one of the spot in its pixel: what the peak's estimator errs there is common to all
        targets at that range.
    sigma
        The standard deviations that were stated, shape (places, sightings, 4).
    voxel
        Median of the stated σ of single voxels' angles and ranges, shape (4,).
    """

    distance: float
    error: Array
    sigma: Array
    voxel: Array

    def of(self, ranging: Ranging) -> tuple[Array, Array]:
        """Return errors and stated σ of (Θ, φ, R) with one way of ranging, each (places, sightings, 3)."""
        chosen = [0, 1, 2 + RANGINGS.index(ranging)]
        return self.error[..., chosen], self.sigma[..., chosen]

    @property
    def found(self) -> Array:
        """Shares of the sightings with each of the four quantities, shape (4,)."""
        return np.asarray(np.isfinite(self.error).mean(axis=(0, 1)))

    @property
    def scatter(self) -> Array:
        """Root mean squares of the errors, shape (4,)."""
        return _root_mean_square(self.error)

    @property
    def common(self) -> Array:
        """Root mean squares over the places of the mean errors, shape (4,): what all targets of a visit share."""
        known = np.isfinite(self.error)
        with np.errstate(invalid="ignore"):
            means = np.where(known, self.error, 0.0).sum(axis=1) / known.sum(axis=1)
        return _root_mean_square(means[:, None])

    @property
    def stated(self) -> Array:
        """Root mean squares of the stated standard deviations, shape (4,)."""
        return _root_mean_square(self.sigma)


def _root_mean_square(values: Array) -> Array:
    known = np.isfinite(values)
    squares = np.where(known, values, 0.0) ** 2
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(squares.sum(axis=(0, 1)) / known.sum(axis=(0, 1))))


def measure_targets(
    scenario: Scenario,
    target: StudyTarget,
    distance: float,
    *,
    places: int = 4,
    patterns: int = 4,
    device: DeviceChoice = "auto",
) -> TargetErrors:
    """Measure a grid of targets many times.

    Parameters
    ----------
    scenario
        Instrument and processing; its scene, lighting and scan are left out.
    target
        What is measured.
    distance
        Of the grid [m].
    places
        Distances about this one at which the spot lies at evenly spaced places in its pixel.
    patterns
        Patterns over each of the 36 targets at each place.
    device
        Where to compute.

    Returns
    -------
    TargetErrors
        Of places × 36 · patterns sightings. Each pattern is measured by itself.
    """
    scanner = scenario.scanner
    errors, sigmas, voxels = [], [], []
    for place, where in enumerate(spread_distances(scenario, distance, places)):
        seed = (scenario.seed + 7919 * place + round(1e6 * distance)) % 2**63
        bench, centres = target_grid(scenario, target, where, seed, device)
        motion, common = grid_motion(bench.scenario, target, centres, patterns)
        layers = bench.measure(aim_of(motion, 0))
        truth = np.repeat(centres, patterns, axis=0)
        seen = []
        for prefix in ("", "tof."):
            samples = _samples(bench.scenario, layers, motion, prefix, where)
            seen.append(
                measure_target(
                    samples,
                    bench.scenario.targets[0].looks,
                    truth[:, 2],
                    spot=scanner.laser.radius(where) / (2.0 * where),
                    shining=scanner.exposure / scanner.dwell,
                )
            )
        taken = _taken(seen[0], target)
        found = np.stack([taken] * 3 + [taken & seen[1].found], axis=1)
        measured = np.concatenate([seen[0].place, seen[1].place[:, 2:]], axis=1)
        covariances = [item.covariance + common for item in seen]
        variance = np.concatenate(
            [np.diagonal(covariances[0], axis1=1, axis2=2), covariances[1][:, 2, 2:]], axis=1
        )
        errors.append(np.where(found, measured - truth[:, [0, 1, 2, 2]], np.nan))
        sigmas.append(np.where(found, np.sqrt(variance), np.nan))
        voxels.append(_voxel_sigma(scenario, layers))
    return TargetErrors(distance, np.stack(errors), np.stack(sigmas), np.mean(voxels, axis=0))


def _voxel_sigma(scenario: Scenario, layers: dict[str, NDArray[Any]]) -> Array:
    """Return the medians of the stated σ of single voxels: Θ, φ, R by triangulation, R by time of flight."""
    angle = float(scenario.scanner.mirrors.reading_sigma(np.zeros(1), np.zeros(1))[0])
    ranges = []
    for prefix in ("", "tof."):
        sigma = np.asarray(layers[f"{prefix}sigma_range_m"], dtype=np.float64)
        known = sigma[np.isfinite(sigma)]
        ranges.append(float(np.median(known)) if known.size else math.nan)
    return np.array([angle, angle, *ranges])


def _taken(seen: Measurement, target: StudyTarget) -> NDArray[np.bool_]:
    """Return which measurements a tracker on its target would take: firm fits of a disc of the right size.

    The rules of :func:`scanner_sim.tracking.state.step`, but for the prediction, which has no part here.
    """
    expected = 0.5 * target.diameter / seen.place[:, 2]
    with np.errstate(invalid="ignore"):
        allowed = target.tracker.size_tolerance * expected + 3.0 * seen.sigma_radius
        right = np.abs(seen.radius - expected) <= np.minimum(allowed, 0.5 * expected)
        close = np.trace(seen.covariance[:, :2, :2], axis1=1, axis2=2) <= (0.5 * expected) ** 2
    return np.asarray(seen.found & right & close & np.isfinite(seen.misfit))


def _samples(
    scenario: Scenario, layers: dict[str, NDArray[Any]], motion: PatternMotion, prefix: str, distance: float
) -> PatternSamples:
    """Return the voxels, (patterns, points): the line sensor's light, and ranges by one of both ways.

    The photodiode's light is left aside: its pulses last no dwell, and near targets saturate it.
    """
    from scanner_sim.detector.encoders import reading_noise

    mirrors, servo = scenario.scanner.mirrors, scenario.scanner.galvanometers
    noise = np.stack(reading_noise(np.arange(motion.time.size, dtype=np.uint32), mirrors, scenario.seed))
    angles = np.stack([motion.latched_theta, motion.latched_phi]) + noise
    if mirrors.readout_step > 0.0:
        angles = np.rint(angles / mirrors.readout_step) * mirrors.readout_step
    own = {name: layers[f"{prefix}{name}"] for name in ("range_m", "sigma_range_m", "status")}
    sigma = SignalNoise(scenario).sigma(layers, motion, distance)
    flat = samples_of(own | {"Y": layers["Y"]}, motion, angles, sigma, 0.0)
    points = scenario.following.pattern.points
    shaped = {field.name: getattr(flat, field.name).reshape(-1, points) for field in fields(PatternSamples)}
    return PatternSamples(**shaped).later(servo.readout_delay)
