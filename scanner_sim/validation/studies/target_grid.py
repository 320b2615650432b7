"""A grid of equal targets before the scanner, and the patterns that the mirrors run over them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.optics.jump import attainable_amplitude
from scanner_sim.ranging.triangulation import position_from_range, range_from_position
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.lissajous import LissajousPattern, frequencies
from scanner_sim.scan.schedule import Course, PatternMotion, Visiting, run_visits
from scanner_sim.scan.ways import mirrors_at
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.objects import Scene, TargetArray, TargetPattern
from scanner_sim.scene.surfaces import MaterialChoice
from scanner_sim.tracking.scan import TrackScan
from scanner_sim.tracking.state import TrackerSettings

Array = NDArray[np.float64]

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
        scan = scenario.following if scenario.scan.layout == "visits" else None
        return cls(
            diameter=diameter or (own.array.diameter if own else _DIAMETER),
            disc=own.disc if own else "target_black",
            plate=own.material if own else "target_white",
            pattern=scan.pattern if scan else LissajousPattern(),
            tracker=scan.tracker if scan else TrackerSettings(),
            visiting=scan.visiting if scan else Visiting(),
        )


def nearest_distance(scenario: Scenario, target: StudyTarget) -> float:
    """Return the least distance [m] at which the line sees the target and the mirrors can follow its pattern."""
    rates = frequencies(target.pattern, scenario.scanner.dwell)
    sizes = (1.0, target.pattern.aspect)
    servo = scenario.scanner.galvanometers
    largest = min(float(attainable_amplitude(servo, f)) / size for f, size in zip(rates, sizes, strict=True))
    radius = 0.5 * target.diameter * target.tracker.track_amplitude
    return max(1.1 * scenario.scanner.nearest_range, radius / (_FREE * largest))


def spread_distances(scenario: Scenario, distance: float, count: int) -> Array:
    """Return distances about one at which the spot lies at evenly spaced positions in its pixel [m]."""
    image, d = scenario.scanner.receiver.line_image, scenario.scanner.receiver.baseline
    steps = ((np.arange(count) + 0.5) / count - 0.5) * scenario.scanner.position_sensor.pitch
    middle = position_from_range(distance, 0.0, image.scale, d, image.slope)
    return np.asarray(range_from_position(middle + steps, np.zeros(count), image.scale, d, image.slope))


def target_grid(
    scenario: Scenario, target: StudyTarget, distance: float, seed: int, device: DeviceChoice
) -> tuple[Instrument, Array]:
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
            "ranging": "both" if len(scanner.rangefinders) > 1 else scanner.rangefinders[0],
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
    return Instrument(changed, device=device), np.stack([item.expected for item in changed.targets])


def grid_motions(scenario: Scenario, target: StudyTarget, centres: Array, patterns: int) -> PatternMotion:
    """Return the visits to each of the centres, ``patterns`` after one another.

    Each visit has a number and so a dither of its own: where voxels are farther apart than the spot is wide, the fit's
    error hangs on how they lie on the disc's edge. The servos are linear but for their limits, so that a pattern is the
    same wherever it goes.
    """
    scanner, pattern = scenario.scanner, target.pattern
    radius = 0.5 * target.diameter / float(np.mean(centres[:, 2]))
    figure = pattern.model_copy(update={"amplitude": target.tracker.track_amplitude * radius})
    servo = scanner.galvanometers
    period = target.visiting.period(pattern.points, scanner.dwell, 2, servo)
    visits = np.arange(len(centres) * patterns)
    none = np.zeros(len(visits))
    course = Course(
        visits,
        np.zeros((len(visits), 2)),
        none + figure.amplitude,
        none + period - pattern.points * scanner.dwell,
    )
    rest = [mirrors_at(0.0, 0.0)] * len(visits)
    motion, _ = run_visits(servo, rest, figure, course, dwell=scanner.dwell, visiting=target.visiting)
    theta, phi = (angle[visits // patterns, None] for angle in centres[:, :2].T)
    return PatternMotion(
        time=motion.time + 2.0 * visits[:, None] * period,
        commanded_theta=motion.commanded_theta + theta,
        commanded_phi=motion.commanded_phi + phi,
        true_theta=motion.true_theta + theta,
        true_phi=motion.true_phi + phi,
        latched_theta=motion.latched_theta + theta,
        latched_phi=motion.latched_phi + phi,
        travel_theta=motion.travel_theta,
        travel_phi=motion.travel_phi,
        limited=motion.limited,
    )
