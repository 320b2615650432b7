"""How rigid objects move: a pose at any time.

By a twist, waypoints, a file of poses, those of flight dynamics, or a relative orbit.

A motion replaces an object's pose where it names one; a twist starts from the object's own. All give
``scanner_from_object`` as 4 × 4 matrices, for arrays of times.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Discriminator, Field, Tag
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation as Turning
from scipy.spatial.transform import RotationSpline, Slerp

from scanner_sim.foundation.errors import Fault, InputError
from scanner_sim.foundation.named_files import read_text_file
from scanner_sim.foundation.parts import InputFile, Part
from scanner_sim.foundation.units import Dimension, Time
from scanner_sim.scene.ephemeris import EphemerisMotion
from scanner_sim.scene.poses import FARTHEST, Position, Turns, placement_matrix
from scanner_sim.scene.relative_orbit import RelativeOrbit

Array = NDArray[np.float64]

FASTEST = 1e5
"""Largest speed along an axis [m/s], and rate of turn about it [rad/s]."""
LEAST_STEP = 1e-9
"""Shortest time from one pose to the next [s]."""
LATEST = 1e9
"""Latest time of a pose [s], and of the earliest in a file the negative."""

_Bounds = Field(ge=-FASTEST, le=FASTEST)
Speed = Annotated[float, Dimension("m/s", ("10 mm/s",), ("m/s", "mm/s")), _Bounds]
TurnRate = Annotated[float, Dimension("rad/s", ("1 deg/s",), ("deg/s", "rad/s")), _Bounds]
PoseTable = Annotated[Path, InputFile((".csv",)), Field(examples=["motions/node.csv"])]

COLUMNS = ("time_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
"""Columns of a file of poses."""
MOST_ROWS = 1_000_000
"""Longest file of poses."""
_LARGEST = 1 << 28
"""Bytes of a file of poses."""
LONGEST = 1e9
"""Length of a quaternion whose square is a number still, and the shortest one's reciprocal."""


class Poses(NamedTuple):
    """Poses at ascending times: ``time`` [s] (n,), ``position`` [m] (n, 3), ``quaternion`` (w, x, y, z) (n, 4)."""

    time: Array
    position: Array
    quaternion: Array


class ConstantTwist(Part):
    """An object that moves evenly and turns evenly about its own origin."""

    type: Literal["twist"]
    """Kind of motion."""
    velocity: tuple[Speed, Speed, Speed] = Field(
        default=(0.0, 0.0, 0.0), examples=[["10 mm/s", "0 m/s", "0 m/s"]]
    )
    """Velocity of the object's origin along the scanner's axes."""
    turn_rate: tuple[TurnRate, TurnRate, TurnRate] = Field(
        default=(0.0, 0.0, 0.0), examples=[["0 deg/s", "1 deg/s", "0 deg/s"]]
    )
    """Rates of turn about the scanner's axes, through the object's origin."""

    def scanner_from_object(self, time: ArrayLike, start: Array) -> Array:
        """Return the poses at times [s], shape (n, 4, 4): x₀ + v t, exp([ω t]×) R₀, from ``start`` (4, 4) at time 0."""
        return twisted(time, start, self.velocity, self.turn_rate)


class Waypoint(Part):
    """A pose at a time."""

    time: Time = Field(ge=0.0, le=LATEST)
    """When, since the start."""
    position: Position
    """Position of the object's origin in the scanner frame."""
    rotation: Turns = ()
    """Turns about the object's origin, the first one first."""


class Waypoints(Part):
    """An object that passes poses at given times; before the first and after the last it rests."""

    type: Literal["waypoints"]
    """Kind of motion."""
    points: tuple[Waypoint, ...] = Field(min_length=2, max_length=10_000)
    """Poses in the order of their times."""
    interpolation: Literal["linear", "smooth"] = "smooth"
    """``linear``: straight and even between poses; ``smooth``: twice differentiable, positions from rest to rest."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield times that do not ascend."""
        for index, (first, second) in enumerate(zip(self.points[:-1], self.points[1:], strict=True)):
            if second.time - first.time < LEAST_STEP:
                yield Fault(
                    f"points[{index + 1}].time",
                    f"{second.time:g} s is not after the {first.time:g} s of the waypoint before, not by a nanosecond.",
                    "Write the waypoints in the order of their times.",
                )

    def scanner_from_object(self, time: ArrayLike, start: Array) -> Array:
        """Return the poses at times [s], shape (n, 4, 4); the waypoints say all, and ``start`` nothing."""
        del start
        return _path_of(self.points, self.interpolation)(time)


class PoseFile(Part):
    """An object whose poses a file holds: CSV with the columns time_s, x_m, y_m, z_m, qw, qx, qy, qz."""

    type: Literal["file"]
    """Kind of motion."""
    file: PoseTable
    """The file. Quaternions need not be of length one."""
    interpolation: Literal["linear", "smooth"] = "linear"
    """``linear``: straight and even between rows; ``smooth``: twice differentiable, positions from rest to rest."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield what is wrong with the file."""
        try:
            self.poses()
        except InputError as error:
            yield Fault("file", error.message, error.remedy)

    def poses(self) -> Poses:
        """Return the rows of the file (see :func:`read_poses`)."""
        changed = self.file.stat()
        return _cached_poses(self.file, changed.st_mtime_ns, changed.st_size)

    def scanner_from_object(self, time: ArrayLike, start: Array) -> Array:
        """Return the poses at times [s], shape (n, 4, 4); the file says all, and ``start`` nothing."""
        del start
        changed = self.file.stat()
        return _path_in(self.file, changed.st_mtime_ns, changed.st_size, self.interpolation)(time)


def kind_of(value: object) -> str:
    """Return the tag of a motion."""
    return f"({value.get('type') if isinstance(value, dict) else getattr(value, 'type', None)})"


KnownMotion = (
    Annotated[ConstantTwist, Tag("(twist)")]
    | Annotated[Waypoints, Tag("(waypoints)")]
    | Annotated[PoseFile, Tag("(file)")]
    | Annotated[EphemerisMotion, Tag("(ccsds)")]
    | Annotated[RelativeOrbit, Tag("(clohessy_wiltshire)")]
)
PlannedMotion = Annotated[KnownMotion, Discriminator(kind_of)]
"""A motion that is known beforehand."""


class PosePath:
    """A path through given poses.

    Parameters
    ----------
    poses
        At least two, at ascending times.
    interpolation
        ``linear``: straight lines, and turns about a fixed axis at an even rate (Shoemake's slerp, SIGGRAPH 1985).
        ``smooth``: cubic splines at rest at both ends, and the spline of rotations that SciPy has (its angular
        acceleration is continuous, its ends are free).
    """

    def __init__(self, poses: Poses, interpolation: Literal["linear", "smooth"]) -> None:
        self._poses = poses
        turns = Turning.from_quat(poses.quaternion[:, [1, 2, 3, 0]])
        smooth = interpolation == "smooth"
        self._turn = RotationSpline(poses.time, turns) if smooth else Slerp(poses.time, turns)
        self._place = CubicSpline(poses.time, poses.position, bc_type="clamped") if smooth else self._straight

    def __call__(self, time: ArrayLike) -> Array:
        """Return the poses at times [s], shape (n, 4, 4); before the first and after the last they are held."""
        first, last = self._poses.time[[0, -1]]
        t = np.clip(np.atleast_1d(np.asarray(time, dtype=np.float64)), first, last)
        return _matrices(self._turn(t).as_matrix(), self._place(t))

    def _straight(self, time: Array) -> Array:
        return np.stack([np.interp(time, self._poses.time, axis) for axis in self._poses.position.T], axis=1)


def read_poses(file: Path) -> Poses:
    """Return the poses of a CSV file with the columns :data:`COLUMNS` in any order.

    Raises
    ------
    InputError
        Missing columns, fields that are no finite numbers, positions beyond 100 km, quaternions of length zero, times
        that do not ascend, fewer than two rows: with the row's number, which counts the heading as 1.
    """
    text = read_text_file(file, _LARGEST)
    try:
        rows = list(islice(csv.reader(io.StringIO(text, newline="")), MOST_ROWS + 2))
    except csv.Error as error:
        raise InputError(
            f"{file.name} cannot be read as CSV: {error}.", remedy="Save it as UTF-8 text."
        ) from error
    heading = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in COLUMNS if name not in heading]
    if missing:
        raise InputError(
            f"{file.name} has no column {', '.join(missing)}.",
            remedy=f"Its first line is {','.join(COLUMNS)}.",
        )
    if len(rows) - 1 > MOST_ROWS:
        raise InputError(f"{file.name} has more than {MOST_ROWS} rows.", remedy="Keep fewer poses a second.")
    columns = [heading.index(name) for name in COLUMNS]
    table: list[list[float]] = []
    for number, row in enumerate(rows[1:], start=2):
        if not any(field.strip() for field in row):
            continue
        try:
            values = [float(row[column]) for column in columns]
        except (ValueError, IndexError):
            raise InputError(f"Row {number} of {file.name} is not a row of numbers.") from None
        if not all(map(math.isfinite, values)):
            raise InputError(f"Row {number} of {file.name} holds a number that is not finite.")
        if max(map(abs, values[1:4])) > FARTHEST:
            raise InputError(
                f"Row {number} of {file.name} is {max(map(abs, values[1:4])):.3g} m away; it may be {FARTHEST:g} m."
            )
        length = math.hypot(*values[4:])
        if not 1.0 / LONGEST <= length <= LONGEST:
            size = "zero" if length == 0.0 else f"{length:.3g} long"
            raise InputError(
                f"The quaternion in row {number} of {file.name} is {size}.",
                remedy="Not turned is 1, 0, 0, 0.",
            )
        if abs(values[0]) > LATEST:
            raise InputError(f"The time in row {number} of {file.name} is beyond {LATEST:g} s.")
        if table and values[0] - table[-1][0] < LEAST_STEP:
            raise InputError(
                f"The time in row {number} of {file.name} is not after the one before, not by a nanosecond.",
                remedy="Sort the rows by time, each once.",
            )
        table.append(values)
    if len(table) < 2:
        raise InputError(
            f"{file.name} holds fewer than two poses.", remedy="An object at rest needs no motion."
        )
    numbers = np.array(table)
    return Poses(numbers[:, 0], numbers[:, 1:4], numbers[:, 4:])


@lru_cache(maxsize=16)
def _cached_poses(file: Path, changed: int, size: int) -> Poses:
    """Read a file once for each of its versions."""
    del changed, size
    return read_poses(file)


@lru_cache(maxsize=16)
def _path_in(file: Path, changed: int, size: int, interpolation: Literal["linear", "smooth"]) -> PosePath:
    return PosePath(_cached_poses(file, changed, size), interpolation)


@lru_cache(maxsize=64)
def _path_of(points: tuple[Waypoint, ...], interpolation: Literal["linear", "smooth"]) -> PosePath:
    matrices = np.stack([placement_matrix(point.position, point.rotation) for point in points])
    quaternion = Turning.from_matrix(matrices[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
    return PosePath(
        Poses(np.array([point.time for point in points]), matrices[:, :3, 3], quaternion), interpolation
    )


def twisted(time: ArrayLike, start: Array, velocity: ArrayLike, turn_rate: ArrayLike) -> Array:
    """Return poses after times [s] of an even motion, shape (n, 4, 4): x₀ + v t, exp([ω t]×) R₀ from ``start`` (4, 4).

    ``velocity`` v [m/s] and ``turn_rate`` ω [rad/s] of the origin, shape (3,), along the axes of the pose.
    """
    t, rate = np.atleast_1d(np.asarray(time, dtype=np.float64)), np.asarray(turn_rate)
    rotation = start[:3, :3]
    if rate.any():
        rotation = Turning.from_rotvec(t[:, None] * rate).as_matrix() @ rotation
    return _matrices(rotation, start[:3, 3] + t[:, None] * np.asarray(velocity))


def _matrices(rotation: Array, position: Array) -> Array:
    """Return 4 × 4 matrices of rotations (n, 3, 3), or one for all, and positions (n, 3)."""
    matrices = np.zeros((len(position), 4, 4))
    matrices[:, :3, :3], matrices[:, :3, 3], matrices[:, 3, 3] = rotation, position, 1.0
    return matrices
