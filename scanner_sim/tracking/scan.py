"""A tracking scan: patterns over targets, one after the other, for a time."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.arithmetic import applied
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Part, Switch
from scanner_sim.foundation.units import Angle, Length, Time
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.scan.lissajous import LissajousPattern
from scanner_sim.scan.protocol import ScanSetup
from scanner_sim.scan.schedule import MOST_VISITS, Visiting
from scanner_sim.scan.ways import MOST_UPDATES
from scanner_sim.scene.materials import MATERIALS
from scanner_sim.scene.objects import Disc, Scene, SceneObject, Sphere, TargetArray
from scanner_sim.scene.surfaces import MaterialChoice, Retroreflector, Surface
from scanner_sim.scene.targets import target_positions
from scanner_sim.tracking.measurement import TargetAppearance
from scanner_sim.tracking.record import TrackTarget, is_place
from scanner_sim.tracking.response import TargetKind
from scanner_sim.tracking.state import TrackerSettings

Array = NDArray[np.float64]

MOST_TARGETS = 1000
"""Targets that are followed, arrays taken apart."""

TargetName = Annotated[
    str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*(/[1-9][0-9]*)?$", max_length=80, examples=["node/1"])
]
"""``node/1`` is the first target of the array ``node``, row by row from the top left; ``node`` all of them."""


class FollowedTarget(Part):
    """A target, and what the tracker is told of it. What is left out is taken from the scene."""

    target: TargetName
    """Its name, or an array's for all of its targets."""
    kind: TargetKind | None = None
    """What makes it differ from what surrounds it. By default what the scene's object is: black or white as the discs
    of an array, retro-reflective, or ``raised`` for discs and spheres that stand alone."""
    diameter: Length | None = Field(default=None, gt=0.0, le=100.0)
    """Diameter; by default that of the scene's object."""
    depth: Length = Field(default=0.3, gt=0.0, le=1e4)
    """How far in front of and behind the expected range target and ground may lie: the range gate."""
    expected: tuple[Angle, Angle, Length] | None = Field(default=None, examples=[["1 deg", "-2 deg", "8 m"]])
    """Θ, φ and range where it is looked for first; by default its true place at the start."""
    offset: tuple[Angle, Angle, Length] = Field(
        default=(0.0, 0.0, 0.0), examples=[["5 mrad", "0 mrad", "0 m"]]
    )
    """By how much the expected place is wrong: it is added to it, so that the search has work."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield expected ranges that are none, and one place for several targets."""
        if self.expected is not None and self.expected[2] <= 0.0:
            yield Fault(
                "expected[2]", f"a range of {self.expected[2]:g} m is none.", "Write for example 8 m."
            )


def _spelling(value: object) -> str:
    return "(word)" if isinstance(value, str) else "(target)"


TargetChoice = Annotated[
    Annotated[TargetName, Tag("(word)")] | Annotated[FollowedTarget, Tag("(target)")],
    Discriminator(_spelling),
    Field(examples=["node/1"]),
]


class TrackScan(Part):
    """Patterns over targets in turn: the scanner searches for them, and follows them."""

    layout: ClassVar[Literal["visits"]] = "visits"
    shots_per_row: ClassVar[int] = 1
    even_travel: ClassVar[None] = None

    type: Literal["track"]
    """Kind of scan."""
    targets: tuple[TargetChoice, ...] = Field(
        min_length=1, max_length=MOST_TARGETS, examples=[["node/1", "node/2"]]
    )
    """What is followed: names, or mappings with more."""
    duration: Time = Field(default=2.0, gt=0.0, le=1e6)
    """Time for which it is followed. A pattern that has begun is finished."""
    pattern: LissajousPattern = LissajousPattern()
    """Figure and points. Its amplitude is replaced by what the tracker asks for."""
    tracker: TrackerSettings = TrackerSettings()
    """How targets are searched for and followed."""
    correct_delay: Switch = True
    """Correct the encoders' readings for their delay, which is known (``scanner.galvanometers.readout_delay``)."""
    visiting: Visiting = Visiting()
    """Times between patterns, and the drive's updates."""

    def asked(self) -> tuple[FollowedTarget, ...]:
        """Return the targets in their long spelling, in the order of the list."""
        return tuple(FollowedTarget(target=item) if isinstance(item, str) else item for item in self.targets)

    def scan_time(self, setup: ScanSetup) -> float:  # noqa: ARG002 (other scans need it)
        """Return the time for which targets are followed [s]."""
        return self.duration

    def faults(self, setup: ScanSetup) -> Iterator[Fault]:
        """Yield unknown targets, patterns that the encoders do not see the end of, and visits that no memory holds."""
        targets, faults = resolve_targets(self, setup.scene, setup.mirrors.axis_separation)
        yield from faults
        visiting, points, dwell, servos = self.visiting, self.pattern.points, setup.dwell, setup.galvanometers
        if servos.readout_delay >= points * dwell:
            yield Fault(
                "scanner.galvanometers.readout_delay",
                f"{servos.readout_delay:.4g} s are no less than the {points * dwell:.4g} s of a whole pattern.",
                "Lower it or scanner.rate, or raise scan.pattern.points.",
            )
        updates = visiting.updates_of(points, dwell, 2.0 * setup.mirrors.max_deflection, servos)
        if updates > MOST_UPDATES:
            yield Fault(
                "scan.visiting.updates",
                f"a visit takes up to {updates:.3g} updates of the drive's command; {MOST_UPDATES:.3g} are possible.",
                "Lower it, scanner.rate, scan.pattern.points or scan.visiting.turnaround, or raise the limits of "
                "scanner.galvanometers.",
            )
            return
        visits = self.duration / visiting.period(points, dwell, max(len(targets), 1), servos)
        most = min(MOST_VISITS, 2**32 // points)
        if visits > most:
            yield Fault(
                "scan.duration",
                f"{self.duration:.4g} s hold {visits:.3g} patterns; {most} are possible.",
                "Shorten it, or raise scan.pattern.points or scan.visiting.turnaround.",
            )


def resolve_targets(
    scan: TrackScan, scene: Scene, axis_separation: float
) -> tuple[tuple[TrackTarget, ...], tuple[Fault, ...]]:
    """Return the targets of a scan in a scene, and what is wrong with them.

    Parameters
    ----------
    scan, scene
        What is followed, and what there is.
    axis_separation
        D_g [m], for the angles of the expected positions.

    Returns
    -------
    targets, faults
        Arrays are taken apart into their members. Faults: unknown objects and members, looks that neither the scan nor
        the scene tells, targets named twice, and targets that overlap as the scanner sees them, whose voxels nothing
        can tell apart. Their locations are relative to the scenario.
    """
    found: list[TrackTarget] = []
    locations: list[str] = []
    faults: list[Fault] = []
    for index, asked in enumerate(scan.asked()):
        location = f"scan.targets.{index}"
        if isinstance(scan.targets[index], FollowedTarget):
            location += ".target"
        for target in _members(asked, scene, axis_separation, location):
            if isinstance(target, Fault):
                faults.append(target)
                continue
            if len(found) == MOST_TARGETS:
                faults.append(Fault(location, f"more than {MOST_TARGETS} targets.", "Follow fewer."))
                return tuple(found), tuple(faults)
            clash = _clash(target, found)
            if clash is not None:
                faults.append(Fault(location, *clash))
            found.append(target)
            locations.append(location)
    return tuple(found), tuple(faults)


def _members(
    asked: FollowedTarget, scene: Scene, axis_separation: float, location: str
) -> Iterator[TrackTarget | Fault]:
    """Yield the targets that one entry names, or its faults."""
    name, _, member = asked.target.partition("/")
    item = next((item for item in scene.objects if item.name == name), None)
    if item is None:
        names = [item.name for item in scene.objects]
        near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
        known = f"The scene's objects: {', '.join(names)}." if names else "The scene has no objects."
        yield Fault(
            location, f"there is no object '{name}'.", f"Did you mean '{near[0]}'?" if near else known
        )
        return
    if isinstance(item, TargetArray):
        array = item.array
        centres = target_positions(array.rows, array.columns, *array.spacing)
    else:
        centres = np.zeros((1, 3))
    if member and not isinstance(item, TargetArray):
        yield Fault(location, f"'{name}' is one target, no array of them.", f"Write {name}.")
        return
    if member and int(member) > len(centres):
        yield Fault(
            location, f"'{name}' has {len(centres)} targets.", f"Write {name}/1 to {name}/{len(centres)}."
        )
        return
    appearance = _appearance_of(asked, item)
    if appearance is None:
        missing = "kind" if asked.kind is None else "diameter"
        yield Fault(
            location,
            f"'{name}' is no target of which the scene tells the {missing}.",
            "Write {target: " + f"{name}, kind: raised, diameter: 100 mm" + "}.",
        )
        return
    chosen = [int(member) - 1] if member else list(range(len(centres)))
    if len(chosen) > MOST_TARGETS:
        yield Fault(
            location,
            f"'{name}' has {len(chosen)} targets; {MOST_TARGETS} can be followed.",
            f"Name some of them, as {name}/1.",
        )
        return
    if len(chosen) > 1 and asked.expected is not None:
        yield Fault(
            location, f"one expected place stands for {len(chosen)} targets.", f"Name each, as {name}/1."
        )
        return
    pose = item.pose_at(0.0)[0]
    for number in chosen:
        label = f"{name}/{number + 1}" if isinstance(item, TargetArray) else name
        here = applied(pose[:3, :3], centres[number]) + pose[:3, 3]
        distance, theta, phi = angles_and_range(here[0], here[1], here[2], axis_separation)
        expected = np.array([theta, phi, distance]) if asked.expected is None else np.array(asked.expected)
        expected = expected + np.array(asked.offset)
        if not is_place(expected):
            angles, range_m = np.degrees(expected[:2]), expected[2]
            yield Fault(
                location,
                f"'{label}' is expected at ({angles[0]:g} deg, {angles[1]:g} deg, {range_m:g} m), which is no place.",
                "Correct its offset, the place where it is expected, or the object's position.",
            )
            return
        yield TrackTarget(label, name, appearance, expected, centres[number])


def _appearance_of(asked: FollowedTarget, item: SceneObject) -> TargetAppearance | None:
    """Return the looks of a target, from the scan or from the scene; None where neither tells."""
    kind, diameter = asked.kind, asked.diameter
    if isinstance(item, TargetArray):
        kind, diameter = kind or _contrast(item), diameter or item.array.diameter
    elif isinstance(item, Disc | Sphere):
        kind, diameter = kind or TargetKind.RAISED, diameter or item.diameter
    if kind is None or diameter is None:
        return None
    surface: Literal["flat", "sphere"] = "sphere" if isinstance(item, Sphere) else "flat"
    return TargetAppearance(kind=kind, diameter=diameter, depth=asked.depth, surface=surface)


def _contrast(item: TargetArray) -> TargetKind:
    """Return what the discs of an array are beside their plates."""
    if isinstance(item.disc, Retroreflector) or (
        isinstance(item.disc, str) and MATERIALS[item.disc].retro is not None
    ):
        return TargetKind.RETRO
    darker = _reflectance(item.disc) < _reflectance(item.material)
    return TargetKind.BLACK if darker else TargetKind.WHITE


def _reflectance(choice: MaterialChoice) -> float:
    if isinstance(choice, Surface | Retroreflector):
        return choice.reflectance
    return MATERIALS[choice].reflectance


def _clash(target: TrackTarget, others: list[TrackTarget]) -> tuple[str, str] | None:
    """Return problem and remedy where a target is one of the others, or overlaps one; None where not."""
    theta, phi, distance = target.expected.tolist()
    radius = 0.5 * target.appearance.diameter / distance
    for other in others:
        if other.name == target.name:
            return f"'{target.name}' is named twice.", "Keep one of them."
        there = other.expected.tolist()
        apart = math.hypot(theta - there[0], phi - there[1])
        radii = radius + 0.5 * other.appearance.diameter / there[2]
        along = abs(distance - there[2])
        if apart < radii and along < target.appearance.depth + other.appearance.depth:
            return (
                f"'{target.name}' overlaps '{other.name}': they are expected {1e3 * apart:.3g} mrad apart, and their "
                f"radii together are {1e3 * radii:.3g} mrad.",
                "Follow one of them, or correct diameter or expected place.",
            )
    return None
