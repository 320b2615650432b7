"""The plan of a self-calibration: the instrument, what is looked for in it, and the field of boards and stations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.config.wording import choice
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parameters import NAMES, PERIODIC
from scanner_sim.foundation.parts import Count, InputFile, Part
from scanner_sim.foundation.units import Angle, Length, Ratio
from scanner_sim.optics.as_built import PerSquareAngle
from scanner_sim.scene.objects import TargetPattern
from scanner_sim.scene.poses import Extent, Name, Position, Turns, placement_matrix
from scanner_sim.scene.surfaces import MaterialChoice

Array = NDArray[np.float64]

ScenarioFile = Annotated[Path, InputFile((".yaml", ".yml")), Field(examples=["scanner.yaml"])]
TableFile = Annotated[Path, InputFile((".csv",)), Field(examples=["board.csv"])]
TargetOfField = Annotated[
    str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*/[A-Za-z0-9_-]+$", max_length=130, examples=["near/1"])
]
"""Board and target: of an array its number, row by row from the top left; else the name in the file of points."""

_LengthTolerance: TypeAlias = Annotated[Length | None, Field(default=None, gt=0.0, le=1.0)]
_AngleTolerance: TypeAlias = Annotated[Angle | None, Field(default=None, gt=0.0, le=0.5)]
_RatioTolerance: TypeAlias = Annotated[Ratio | None, Field(default=None, gt=0.0, le=10.0)]
_CubicTolerance: TypeAlias = Annotated[PerSquareAngle | None, Field(default=None, gt=0.0, le=10.0)]


class Tolerances(Part):
    """What is looked for: the standard deviation to which each parameter was built. All others stay as designed."""

    base: _LengthTolerance = None
    focal_length: _LengthTolerance = None
    axis_separation: _LengthTolerance = None
    axis_offset: _LengthTolerance = None
    axis_skew: _AngleTolerance = None
    theta_zero: _AngleTolerance = None
    phi_zero: _AngleTolerance = None
    theta_scale: _RatioTolerance = None
    phi_scale: _RatioTolerance = None
    theta_cubic: _CubicTolerance = None
    phi_cubic: _CubicTolerance = None
    theta_sine: _AngleTolerance = None
    theta_cosine: _AngleTolerance = None
    phi_sine: _AngleTolerance = None
    phi_cosine: _AngleTolerance = None
    array_offset: _LengthTolerance = None
    array_scale: _RatioTolerance = None
    array_tilt: _AngleTolerance = None
    radial_1: _RatioTolerance = None
    radial_2: _RatioTolerance = None
    tangential: _RatioTolerance = None
    tof_zero: _LengthTolerance = None
    tof_scale: _RatioTolerance = None

    @property
    def given(self) -> dict[str, float]:
        """Tolerances by name, in SI, of what is looked for."""
        return {name: getattr(self, name) for name in NAMES if getattr(self, name) is not None}


class Standing(Part):
    """What stands in the field: a name, a pose, and whether the adjustment sees it."""

    name: Name
    """Name, by which results know it."""
    position: Position = (0.0, 0.0, 0.0)
    """Position of its origin in the field. The adjustment does not know it: it is for simulated sightings."""
    rotation: Turns = ()
    """Turns about its origin, the first one first; likewise."""
    held_out: bool = False
    """Whether it is kept from the adjustment, and tells afterwards how well the calibration holds."""

    def field_from_here(self) -> Array:
        """Return its pose in the field, a 4 × 4 matrix."""
        return np.asarray(placement_matrix(self.position, self.rotation))


class Board(Standing):
    """Targets that are surveyed: along the axes of a board, or of any other body, x right, y down, front along −z."""

    array: TargetPattern | None = None
    """A rectangular array of discs on plates, as in scenes."""
    points: TableFile | None = None
    """Surveyed places of any other targets: a table with the columns ``target, x_m, y_m, z_m``; with a column ``board``
    too the rows of this one are taken."""
    diameter: Extent | None = None
    """Diameter of the targets of ``points``, for simulated sightings."""
    plate: Extent | None = None
    """Edge of the square plate around each of them, which faces along −z; without it they are spheres."""
    disc: MaterialChoice = "target_black"
    """Material of the discs."""
    material: MaterialChoice = "target_white"
    """Material of plates or spheres."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield targets that are told twice or not at all, and discs that overhang their plates."""
        if (self.array is None) == (self.points is None):
            both = "it has both array and points." if self.array else "it has neither array nor points."
            yield Fault("", both, "Write one of them.")
        for key in ("diameter", "plate"):
            if self.array is not None and getattr(self, key) is not None:
                yield Fault(key, "it is that of the array.", f"Write array.{key}.")
        if self.diameter is not None and self.plate is not None and self.diameter >= self.plate:
            problem = f"a disc of {self.diameter:g} m does not fit on a plate of {self.plate:g} m."
            yield Fault("diameter", problem, "Make it smaller than the plate.")


class Station(Standing):
    """A place from which the scanner looks at the field: the origin of the scanner frame, its axes."""


class ScaleBar(Part):
    """A distance between two targets that is known from elsewhere."""

    between: tuple[TargetOfField, TargetOfField] = Field(examples=[["near/1", "far/16"]])
    """The two targets."""
    length: Length | None = Field(default=None, gt=0.0, le=1e4)
    """Its length. Of simulated sightings it may be left out: it is then that of the field, with an error of σ."""
    sigma: Length = Field(gt=0.0, le=1.0)
    """Standard deviation of the length."""


class SelfCalibration(Part):
    """A self-calibration."""

    schema_version: Literal[1] = Field(alias="schema", examples=[1])
    """Version of the plan's form."""
    base: ScenarioFile
    """The scenario whose ``scanner``, ``ranging`` and ``processing`` are the instrument. Sightings are simulated with
    its ``as_built``, which the adjustment does not know; it believes in the design."""
    ranging: Literal["triangulation", "tof"] | None = Field(default=None, examples=["triangulation"])
    """What measures the sightings; by default what the scenario has."""
    seed: Count = Field(default=0, ge=0, lt=2**63)
    """Seed of the noise of simulated sightings, and of the survey's errors."""
    parameters: Tolerances
    """What is looked for."""
    encoder_period: Angle | None = Field(default=None, gt=1e-6, le=7.0, examples=["30 mrad"])
    """Period of the encoders' periodic errors, which need it."""
    survey: Length = Field(default=0.0, ge=0.0, le=1.0)
    """Standard deviation to which the targets of a board are surveyed, each axis; 0 takes them to be exact."""
    boards: tuple[Board, ...] = Field(max_length=1000, examples=[[{"name": "near", "points": "near.csv"}]])
    """The boards; the axes of the first one that is not held out are those of the field that results know."""
    stations: tuple[Station, ...] = Field(default=(), max_length=1000, examples=[[{"name": "s1"}]])
    """The stations. With sightings of your own only those that are held out need to be named."""
    scale_bars: tuple[ScaleBar, ...] = Field(default=(), max_length=1000)
    """Known distances."""
    sightings: TableFile | None = None
    """Sightings of your own, as ``calib_sightings.csv`` has them; without them they are simulated."""
    visits: Count = Field(default=3, ge=1, le=1000)
    """Patterns over each target that count for a simulated sighting: their mean is taken."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield names that are there twice or not at all, nothing to be looked for, and nothing to go by."""
        for kind, listed in (("boards", self.boards), ("stations", self.stations)):
            names = [one.name for one in listed]
            for number, name in enumerate(names):
                if name in names[:number]:
                    yield Fault(
                        f"{kind}.{number}.name", f"'{name}' is there already.", "Give each another name."
                    )
            if (
                listed
                and all(one.held_out for one in listed)
                and (kind == "boards" or self.sightings is None)
            ):
                problem = f"all {kind} are held out, and none is left to calibrate with."
                yield Fault(kind, problem, "Write held_out for some of them only.")
        if not self.boards:
            yield Fault("boards", "it is empty.", "Write for example [{name: near, points: near.csv}].")
        if not self.parameters.given:
            yield Fault("parameters", "nothing is looked for.", "Write for example base: 0.1 mm.")
        if self.encoder_period is None and any(name in PERIODIC for name in self.parameters.given):
            problem = "the encoders' periodic errors need their period."
            yield Fault("encoder_period", problem, "Write for example 30 mrad.")
        yield from self._bars(tuple(board.name for board in self.boards))
        if self.sightings is None:
            yield from self._unsimulated()

    def _bars(self, boards: Sequence[str]) -> Iterator[Fault]:
        for number, bar in enumerate(self.scale_bars):
            for end, target in enumerate(bar.between):
                board = target.partition("/")[0]
                if board not in boards:
                    yield Fault(
                        f"scale_bars.{number}.between.{end}",
                        f"there is no board '{board}'.",
                        choice(board, boards),
                    )
            if bar.between[0] == bar.between[1]:
                yield Fault(f"scale_bars.{number}.between", "both ends are one target.", "Name two.")
            if self.sightings is not None and bar.length is None:
                problem = "this key is missing: the sightings are measured, and so is the bar."
                yield Fault(f"scale_bars.{number}.length", problem, "Write for example length: 1.2 m.")

    def _unsimulated(self) -> Iterator[Fault]:
        if not self.stations:
            problem = "there are none, and the sightings are to be simulated."
            yield Fault("stations", problem, "Write stations with their poses, or sightings: FILE.csv.")
        for number, board in enumerate(self.boards):
            if board.points is not None and board.diameter is None:
                problem = "this key is missing: the targets are to be simulated."
                yield Fault(f"boards.{number}.diameter", problem, "Write for example diameter: 60 mm.")
