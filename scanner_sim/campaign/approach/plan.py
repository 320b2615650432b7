"""The file of an approach: whose path, where it is looked at, what is tracked, and by which methods."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from scanner_sim.campaign.approach.methods import METHODS, MethodName
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, InputFile, Part
from scanner_sim.foundation.units import Angle, Length, Time
from scanner_sim.scene.motion import PlannedMotion
from scanner_sim.scene.poses import Name

MOST_EPOCHS = 10_000
"""Epochs along a path."""

ScenarioFile = Annotated[Path, InputFile((".yaml", ".yml")), Field(examples=["vehicle.yaml"])]


class Epochs(Part):
    """The moments of a path at which poses are tried: so many, or one for each change of the range."""

    count: Count | None = Field(default=None, ge=1, le=MOST_EPOCHS, examples=[8])
    """Number of epochs, even in time."""
    spacing: Length | None = Field(default=None, gt=0.0, examples=["2 m"])
    """Change of the range from one epoch to the next, towards or away."""
    start: Time = Field(default=0.0, ge=0.0, le=1e9)
    """When the first one is, since the path's start."""
    end: Time | None = Field(default=None, gt=0.0, le=1e9)
    """When the last one is; by default where waypoints, files or a glideslope end."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield both ways or none, and an end before the start."""
        if (self.count is None) == (self.spacing is None):
            problem = (
                "it has neither count nor spacing." if self.count is None else "it has count and spacing."
            )
            yield Fault("", problem, "Write one of them, as count: 8.")
        if self.end is not None and self.end <= self.start:
            yield Fault(
                "end",
                f"{self.end:g} s is not after the start, {self.start:g} s.",
                "Times run forwards: write a later one.",
            )


class FollowedArray(Part):
    """An array whose targets are followed, and up to which range."""

    array: Name = Field(examples=["far"])
    """Name of the target array in the scene."""
    below: Length | None = Field(default=None, gt=0.0, examples=["5 m"])
    """Range of the object below which it is followed; without it at all that are left."""


class OrbitPlace(Part):
    """Another light for the same path: where the Sun stands, and where on the orbit the path starts."""

    beta: Angle = Field(examples=["15 deg"])
    """Angle from the orbit's plane to the Sun."""
    anomaly: Angle = Field(examples=["-60 deg"])
    """Position on the orbit when the path starts, counted from orbital noon."""


class Approach(Part):
    """An approach."""

    schema_version: Literal[1] = Field(alias="schema", examples=[1])
    """Version of the file's form."""
    base: ScenarioFile
    """The scenario with the instrument, the objects, the light at the path's start, and a scan of type ``track``."""
    seed: Count = Field(default=0, ge=0, lt=2**63)
    """Seed of the seeds of all tries."""
    object: Name = Field(examples=["vehicle"])
    """The object whose path it is. The arrays are fixed to it."""
    trajectory: PlannedMotion
    """Its path before the scanner, in the place of the scenario's ``motion``."""
    epochs: Epochs
    """Where on the path poses are tried."""
    arrays: tuple[FollowedArray, ...] = Field(min_length=1, max_length=20, examples=[[{"array": "far"}]])
    """Arrays by range: at each epoch the first whose ``below`` is beyond the range."""
    offset: tuple[Angle, Angle, Length] = Field(
        default=(0.0, 0.0, 0.0), examples=[["3 mrad", "-2 mrad", "50 mm"]]
    )
    """By how much Θ, φ and range at which each target is first looked for are wrong."""
    methods: tuple[MethodName, ...] = Field(default=tuple(METHODS), min_length=1, examples=[["joint"]])
    """Methods that are compared."""
    tries: Count = Field(default=8, ge=1, le=100_000)
    """Tries at each epoch, each with a seed of its own."""
    duration: Time = Field(default=0.4, gt=0.0, le=100.0)
    """Time of a try: the targets are searched for and followed so long, and its last pose counts."""
    orbits: tuple[OrbitPlace, ...] = Field(default=(), max_length=10_000, examples=[[]])
    """The same path under other light; without any under the scenario's own."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield methods that are named twice, and arrays that no range is left for."""
        for number, name in enumerate(self.methods):
            if name in self.methods[:number]:
                yield Fault(f"methods.{number}", f"{name} is named twice.", "Name each method once.")
        reached = 0.0
        for number, one in enumerate(self.arrays):
            if one.below is not None and one.below <= reached:
                yield Fault(
                    f"arrays.{number}.below",
                    f"{one.below:g} m is no more than that of the array before, {reached:g} m.",
                    "Write the arrays from near to far.",
                )
            if one.below is None and number < len(self.arrays) - 1:
                yield Fault(
                    f"arrays.{number}",
                    "no range is left for the arrays after it.",
                    "Give it a range: below: 5 m.",
                )
            reached = one.below or reached

    def array_at(self, distance: float) -> str | None:
        """Return the array that is followed at a range [m]; None beyond the last one's."""
        return next((one.array for one in self.arrays if one.below is None or distance < one.below), None)
