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
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scanner_sim.optics.jump import attainable_amplitude
from scanner_sim.ranging.triangulation import position_from_range, range_from_position
from scanner_sim.render.device import DeviceChoice
from scanner_sim.scan.lissajous import LissajousPattern, frequencies
from scanner_sim.scan.raster import Aim
from scanner_sim.scan.schedule import PatternMotion, Visiting, mirrors_at, run_visit
from scanner_sim.scenario import Scenario
from scanner_sim.scene.lighting import Lighting
from scanner_sim.scene.objects import MaterialChoice, Scene, TargetArray, TargetPattern
from scanner_sim.tracking.measurement import Measurement, TargetLooks, measure_target
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.scan import TrackScan
from scanner_sim.tracking.state import TrackerSettings
from scanner_sim.workbench import Workbench

Array = NDArray[np.float64]
Ranging = Literal["triangulation", "tof"]

RANGINGS: tuple[Ranging, ...] = ("triangulation", "tof")
_ACROSS = 6
"""Targets along each side of the grid."""
_RIM = 4.0
"""Spot radii of white plate around a pattern."""
_DIAMETER = 0.1
"""Diameter of the targets [m] where the scenario has none."""
_FREE = 0.8
"""Share of the attainable amplitude up to which patterns are run: at its limit a servo does not keep to the figure."""


@dataclass(frozen=True)
class StudyTarget:
    """A kind of target, and how it is tracked.

    Attributes
    ----------
    diameter
        Of the disc [m].
    disc, plate
        Materials of the disc and of what surrounds it.
    pattern
        The figure; its amplitude is left to the tracker.
    tracker, visiting
        The tracker's amplitude, and how the mirrors come to a pattern.
    """

    diameter: float
    disc: MaterialChoice
    plate: MaterialChoice
    pattern: LissajousPattern
    tracker: TrackerSettings
    visiting: Visiting

    @classmethod
    def of(cls, scenario: Scenario, diameter: float | None = None) -> StudyTarget:
        """Return the targets of a scenario's first array, or else black discs of 100 mm on white, tracked as it says.

        ``diameter`` [m] takes the place of the array's.
        """
        own = next((item for item in scenario.scene.objects if isinstance(item, TargetArray)), None)
        scan = scenario.scan if isinstance(scenario.scan, TrackScan) else None
        return cls(
            diameter=diameter or (own.array.diameter if own else _DIAMETER),
            disc=own.disc if own else "target_black",
            plate=own.material if own else "target_white",
            pattern=scan.pattern if scan else LissajousPattern(),
            tracker=scan.tracker if scan else TrackerSettings(),
            visiting=scan.visiting if scan else Visiting(),
        )


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
    """

    distance: float
    error: Array
    sigma: Array

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
    def stated(self) -> Array:
        """Root mean squares of the stated standard deviations, shape (4,)."""
        return _root_mean_square(self.sigma)


def _root_mean_square(values: Array) -> Array:
    known = np.isfinite(values)
    squares = np.where(known, values, 0.0) ** 2
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(squares.sum(axis=(0, 1)) / known.sum(axis=(0, 1))))


def nearest_distance(scenario: Scenario, target: StudyTarget) -> float:
    """Return the least distance [m] at which the line sees the target and the mirrors can follow its pattern."""
    rates = frequencies(target.pattern, scenario.scanner.dwell)
    sizes = (1.0, target.pattern.aspect)
    servo = scenario.scanner.galvanometers
    largest = min(float(attainable_amplitude(servo, f)) / size for f, size in zip(rates, sizes, strict=True))
    radius = 0.5 * target.diameter * target.tracker.track_amplitude
    return max(1.1 * scenario.scanner.nearest_range, radius / (_FREE * largest))


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
    shining = scenario.scanner.exposure / scenario.scanner.dwell
    errors, sigmas = [], []
    for place, where in enumerate(_places(scenario, distance, places)):
        seed = (scenario.seed + 7919 * place + round(1e6 * distance)) % 2**63
        bench, centres = _grid(scenario, target, where, seed, device)
        aim, motions = _aim(bench.scenario, target, centres, patterns)
        layers, angles = bench.measure(aim), _read(bench, aim, motions, len(centres))
        truth = np.repeat(centres, patterns, axis=0)
        spot = scenario.scanner.laser.radius(where) / (2.0 * where)
        seen, looks = [], bench.scenario.targets[0].looks
        for prefix in ("", "tof."):
            samples = _samples(layers, angles, aim.time, prefix, len(truth))
            samples = samples.later(scenario.scanner.galvanometers.readout_delay)
            seen.append(measure_target(samples, looks, truth[:, 2], spot=spot, shining=shining))
        taken = _taken(seen[0], looks, target.tracker)
        found = np.stack([taken] * 3 + [taken & seen[1].found], axis=1)
        ranges = seen[1].place[:, 2:], seen[1].covariance[:, 2, 2:]
        measured = np.concatenate([seen[0].place, ranges[0]], axis=1)
        variance = np.concatenate([np.diagonal(seen[0].covariance, axis1=1, axis2=2), ranges[1]], axis=1)
        errors.append(np.where(found, measured - truth[:, [0, 1, 2, 2]], np.nan))
        sigmas.append(np.where(found, np.sqrt(variance), np.nan))
    return TargetErrors(distance, np.stack(errors), np.stack(sigmas))


def _taken(seen: Measurement, looks: TargetLooks, tracker: TrackerSettings) -> NDArray[np.bool_]:
    """Return which measurements a tracker on its target would take: fits of a disc of the right size."""
    expected = 0.5 * looks.diameter / seen.place[:, 2]
    with np.errstate(invalid="ignore"):
        right = np.abs(seen.radius - expected) <= tracker.size_tolerance * expected + 3.0 * seen.sigma_radius
    return np.asarray(seen.found & right & np.isfinite(seen.misfit))


def _places(scenario: Scenario, distance: float, count: int) -> Array:
    """Return distances about one at which the spot lies at evenly spaced places in its pixel [m]."""
    f, d = scenario.scanner.receiver.focal_length, scenario.scanner.receiver.baseline
    steps = ((np.arange(count) + 0.5) / count - 0.5) * scenario.scanner.position_sensor.pitch
    middle = position_from_range(distance, 0.0, f, d)
    return np.asarray(range_from_position(middle + steps, np.zeros(count), f, d))


def _grid(
    scenario: Scenario, target: StudyTarget, distance: float, seed: int, device: DeviceChoice
) -> tuple[Workbench, Array]:
    """Return an instrument before a facing grid of targets, and the centres (Θ, φ, R) of these, shape (36, 3)."""
    scanner = scenario.scanner
    amplitude = 0.5 * target.diameter * target.tracker.track_amplitude * max(1.0, target.pattern.aspect)
    plate = 2.0 * (amplitude + _RIM * scanner.laser.radius(distance))
    # A lag behind the command widens the figure a little.
    plate *= 1.1
    grid = TargetArray(
        name="targets",
        array=TargetPattern(
            diameter=target.diameter, rows=_ACROSS, columns=_ACROSS, spacing=(plate, plate), plate=plate
        ),
        disc=target.disc,
        material=target.plate,
        position=(0.0, 0.0, distance),
    )
    changed = scenario.model_copy(
        update={
            "seed": seed,
            "ranging": "both",
            "scene": Scene(objects=(grid,)),
            "lighting": Lighting(),
            "scan": TrackScan(
                type="track",
                targets=(grid.name,),
                pattern=target.pattern,
                tracker=target.tracker,
                visiting=target.visiting,
            ),
            "processing": scenario.processing.model_copy(update={"range_gate": None}),
        }
    )
    return Workbench(changed, device=device), np.stack([item.expected for item in changed.targets])


def _aim(
    scenario: Scenario, target: StudyTarget, centres: Array, patterns: int
) -> tuple[Aim, list[PatternMotion]]:
    """Return patterns over each of the centres, (targets · patterns · points) shots, and the motions of the mirrors.

    The servos are linear but for their limits, so that a pattern is the same wherever it goes.
    """
    scanner, pattern = scenario.scanner, target.pattern
    radius = 0.5 * target.diameter / float(np.mean(centres[:, 2]))
    figure = pattern.model_copy(update={"amplitude": target.tracker.track_amplitude * radius})
    mirrors = scenario.scanner.galvanometers
    start = target.visiting.period(pattern.points, scanner.dwell, 2, mirrors) - pattern.points * scanner.dwell
    motions = [
        run_visit(
            mirrors,
            mirrors_at(0.0, 0.0),
            figure,
            number,
            np.zeros(2),
            start=start,
            dwell=scanner.dwell,
            visiting=target.visiting,
        )[0]
        for number in range(patterns)
    ]
    count = len(centres)
    period = math.ceil(motions[0].time[-1] / scanner.dwell + 1.0) * scanner.dwell
    begin = period * np.arange(count * patterns).reshape(count, patterns, 1)
    theta, phi, time, travel_theta, travel_phi = (
        np.stack([getattr(motion, name) for motion in motions])
        for name in ("true_theta", "true_phi", "time", "travel_theta", "travel_phi")
    )
    shape = (count, *theta.shape)
    aim = Aim(
        np.arange(math.prod(shape), dtype=np.uint32),
        (centres[:, 0, None, None] + theta).ravel(),
        (centres[:, 1, None, None] + phi).ravel(),
        (begin + time).ravel(),
        np.broadcast_to(travel_theta, shape).ravel(),
        np.broadcast_to(travel_phi, shape).ravel(),
    )
    return aim, motions


def _read(bench: Workbench, aim: Aim, motions: list[PatternMotion], count: int) -> tuple[Array, Array]:
    """Return what the encoders read of an aim [rad]: the latched angles, with the errors that they see."""
    from scanner_sim.detector.encoders import read_encoders

    _, pointing = bench.fire(aim)
    late = [
        np.tile(np.concatenate([getattr(m, latched) - getattr(m, true) for m in motions]), count)
        for latched, true in (("latched_theta", "true_theta"), ("latched_phi", "true_phi"))
    ]
    mirrors, seed = bench.scenario.scanner.mirrors, bench.scenario.seed
    theta, phi = aim.theta + late[0] + pointing.seen_theta, aim.phi + late[1] + pointing.seen_phi
    return read_encoders(aim.shot, theta, phi, mirrors, seed)


def _samples(
    layers: dict[str, NDArray[Any]], angles: tuple[Array, Array], time: Array, prefix: str, patterns: int
) -> PatternSamples:
    """Return the voxels: the line sensor's light, and ranges by one of both ways.

    The photodiode's light is left aside: its pulses last no dwell and saturate it on near targets.
    """
    signal = np.asarray(layers["Y"], dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = signal / layers["snr_detection"]
    names = (f"{prefix}range_m", f"{prefix}sigma_range_m")
    values = (time, *angles, signal, sigma, *(layers[name] for name in names))
    shaped = [np.asarray(value, dtype=np.float64).reshape(patterns, -1) for value in values]
    status = layers[f"{prefix}status"].astype(np.uint8).reshape(patterns, -1)
    seconds, theta, phi, light, sigma_light, distance, sigma_distance = shaped
    return PatternSamples(seconds, theta, phi, light, sigma_light, distance, sigma_distance, status)
