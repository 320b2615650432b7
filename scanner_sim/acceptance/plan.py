"""The plan of an acceptance test: the instrument, artefacts over its working volume, and the maker's limits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.calibration.plan import ScenarioFile
from scanner_sim.config.scanner import RangefinderName
from scanner_sim.foundation.errors import Fault, at_most
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.units import Length, Ratio
from scanner_sim.scene.poses import Axis, Extent, Name, Position, Turns
from scanner_sim.scene.surfaces import MaterialChoice

Array = NDArray[np.float64]

Limit = Annotated[Length, Field(gt=0.0, le=10.0)]
Certified = Annotated[Length, Field(ge=0.0, le=1.0)]

_SURE = 10.0
"""Standard uncertainties that a certified size must have at least: a draw never comes near to none."""


class Zone(Part):
    """The limits (MPE) that the maker states up to a distance from the scanner."""

    up_to: Length = Field(gt=0.0, le=1e5, examples=["4 m"])
    """Distance of an artefact's farthest point to which these limits hold."""
    length: Limit | None = None
    """Of the error of a length: the part that each length has."""
    length_ratio: Ratio = Field(default=0.0, ge=0.0, le=0.1, examples=["100 ppm"])
    """The part that grows with the length, added to it."""
    size: Limit | None = None
    """Of the error of a sphere's diameter."""
    form: Limit | None = None
    """Of a sphere's form: the spread of its points' distances from the fitted centre."""
    flatness: Limit | None = None
    """Of a plate's flatness: the spread of its points' distances from the fitted plane."""


class Artefact(Part):
    """A body with a certificate, at a place in the scanner frame."""

    name: Name
    """Name, by which results know it."""
    position: Position
    """Place of its middle in the scanner frame."""
    material: MaterialChoice = "target_white"
    """Material of its surface."""


class LengthBar(Artefact):
    """Two spheres at a certified distance."""

    length: Length = Field(gt=0.0, le=1e4, examples=["1 m"])
    """Certified distance of the centres."""
    sigma: Certified = 0.0
    """Standard uncertainty of the certified length."""
    direction: Axis = Field(examples=["x"])
    """Direction from the first sphere to the second one: an axis of the scanner, or a vector."""
    diameter: Extent = Field(examples=["150 mm"])
    """Diameter of both spheres; it is not judged."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a direction without length, and spheres that touch."""
        if not isinstance(self.direction, str) and not 1e-100 < np.linalg.norm(self.direction) < 1e100:
            yield Fault("direction", f"{self.direction} has no direction.", "Write x, y, z or a vector.")
        if self.length <= self.diameter:
            problem = f"spheres of {self.diameter:g} m whose centres are {self.length:g} m apart touch."
            yield Fault("length", problem, "Make it longer than the diameter.")
            return
        yield from _unsure("the gap between the spheres", self.length - self.diameter, self.sigma)

    def ends(self, length: float) -> Array:
        """Return the centres of both spheres [m] of a bar that is so long, shape (2, 3)."""
        axis = np.eye(3)["xyz".index(self.direction)] if isinstance(self.direction, str) else self.direction
        half = 0.5 * length * np.asarray(axis) / np.linalg.norm(axis)
        return np.asarray(np.asarray(self.position) + np.stack([-half, half]))


class Ball(Artefact):
    """A sphere with a certified diameter."""

    diameter: Extent = Field(examples=["200 mm"])
    """Certified diameter."""
    sigma: Certified = 0.0
    """Standard uncertainty of the certified diameter."""
    sigma_form: Certified = 0.0
    """Standard uncertainty of its form, which is taken to be perfect."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a diameter that its certificate does not tell."""
        yield from _unsure("the diameter", self.diameter, self.sigma)


class Plate(Artefact):
    """A flat plate that faces the scanner until it is turned."""

    size: tuple[Extent, Extent] = Field(examples=[["500 mm", "400 mm"]])
    """Width and height."""
    rotation: Turns = ()
    """Turns about its middle, the first one first."""
    sigma: Certified = 0.0
    """Standard uncertainty of its flatness, which is taken to be perfect."""


def _unsure(what: str, size: float, sigma: float) -> Iterator[Fault]:
    """Yield that an uncertainty is so large that the artefact as it is made may have no such size."""
    if _SURE * sigma > size:
        problem = f"{1e3 * sigma:.4g} mm is more than a tenth of {what}, {1e3 * size:.4g} mm."
        yield Fault("sigma", problem, f"Write at most {at_most(1e3 * size / _SURE)} mm.")


class AcceptancePlan(Part):
    """An acceptance test."""

    schema_version: Literal[1] = Field(alias="schema", examples=[1])
    """Version of the plan's form."""
    base: ScenarioFile
    """The scenario whose ``scanner``, ``ranging`` and ``processing`` are the instrument, with its departures
    ``as_built`` and its ``processing.calibration``. The test is made in the dark."""
    ranging: RangefinderName | None = Field(default=None, examples=["triangulation"])
    """What measures the ranges; by default what the scenario has."""
    seed: Count = Field(default=0, ge=0, lt=2**62)
    """Seed of the noise, and of what the artefacts differ from their certificates by."""
    repetitions: Count = Field(default=3, ge=1, le=1000)
    """Times that each artefact is measured; every result is judged."""
    across: Count = Field(default=32, ge=12, le=256)
    """Voxels across an artefact, in each direction; fewer are taken where spots would overlap."""
    discarded: Ratio = Field(default=0.003, ge=0.0, le=0.1, examples=["0.3 %"])
    """Largest share of the points of a sphere or plate that are left out of its form, those farthest from the fit."""
    rule: Literal["guarded", "simple"] = "guarded"
    """``guarded``: the test's own uncertainty counts against who wants to prove something, as in ISO 14253-1;
    ``simple``: a result within its limit passes."""
    limits: tuple[Zone, ...] = Field(
        min_length=1, max_length=100, examples=[[{"up_to": "4 m", "length": "1 mm"}]]
    )
    """The maker's limits by distance, the nearest first."""
    lengths: tuple[LengthBar, ...] = Field(default=(), max_length=1000)
    """Bars."""
    spheres: tuple[Ball, ...] = Field(default=(), max_length=1000)
    """Spheres."""
    plates: tuple[Plate, ...] = Field(default=(), max_length=1000)
    """Plates."""

    @property
    def artefacts(self) -> dict[tuple[str, int], LengthBar | Ball | Plate]:
        """All artefacts, by the list that they stand in and the number there."""
        lists: dict[str, tuple[LengthBar | Ball | Plate, ...]]
        lists = {"lengths": self.lengths, "spheres": self.spheres, "plates": self.plates}
        return {(kind, number): one for kind, found in lists.items() for number, one in enumerate(found)}

    def cross_checks(self) -> Iterator[Fault]:
        """Yield nothing to be tested, names that are there twice, and zones out of order."""
        if not self.artefacts:
            yield Fault("", "it names no artefact.", "Write lengths, spheres or plates.")
        names: list[str] = []
        for (kind, number), one in self.artefacts.items():
            if one.name in names:
                problem = f"'{one.name}' is there already."
                yield Fault(f"{kind}.{number}.name", problem, "Give each artefact another name.")
            names.append(one.name)
        for number, (near, far) in enumerate(zip(self.limits, self.limits[1:], strict=False), start=1):
            if far.up_to <= near.up_to:
                yield Fault(f"limits.{number}.up_to", "it must be farther than the one before.", "Sort them.")
