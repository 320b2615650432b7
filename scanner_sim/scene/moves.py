"""Motion that is told from time to time: by a controller whose commands move what the scanner looks at.

Between two moves an object goes on evenly, with the velocity and the turn rate that it was told.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Number, Part
from scanner_sim.foundation.units import Time
from scanner_sim.scene.motion import (
    LATEST,
    LONGEST,
    KnownMotion,
    PlannedMotion,
    Speed,
    TurnRate,
    kind_of,
    twisted,
)
from scanner_sim.scene.poses import Position

Array = NDArray[np.float64]


class Move(Part):
    """The state of an object from a time on: it moves and turns evenly until the next one."""

    time: Time = Field(ge=0.0, le=LATEST)
    """From when on, since the start."""
    position: Position
    """Position of the object's origin then."""
    quaternion: tuple[Number, Number, Number, Number] = (1.0, 0.0, 0.0, 0.0)
    """Attitude then, (w, x, y, z); its length need not be one."""
    velocity: tuple[Speed, Speed, Speed] = (0.0, 0.0, 0.0)
    """Velocity of the object's origin."""
    turn_rate: tuple[TurnRate, TurnRate, TurnRate] = (0.0, 0.0, 0.0)
    """Rates of turn through the object's origin."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a quaternion that is none."""
        if not 1.0 / LONGEST <= math.hypot(*self.quaternion) <= LONGEST:
            yield Fault(
                "quaternion", f"{list(self.quaternion)} is no attitude.", "Not turned is [1, 0, 0, 0]."
            )

    def pose_at(self, time: ArrayLike) -> Array:
        """Return the poses at times [s], before and after its own, shape (n, 4, 4)."""
        start = np.eye(4)
        start[:3, :3], start[:3, 3] = attitude(self.quaternion), self.position
        return twisted(np.asarray(time, dtype=np.float64) - self.time, start, self.velocity, self.turn_rate)


@lru_cache(maxsize=16)
def attitude(quaternion: tuple[float, float, float, float]) -> Array:
    """Return the rotation of a quaternion (w, x, y, z) of any length, shape (3, 3): asked for several times in a visit.

    One after the other, which takes a fifth of SciPy's time for a single one; the bytes are SciPy's.
    """
    w, x, y, z = quaternion
    length = math.sqrt(x * x + y * y + z * z + w * w)
    w, x, y, z = w / length, x / length, y / length, z / length
    matrix: Array = np.array(
        [
            [x * x - y * y - z * z + w * w, 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), -x * x - y * y + z * z + w * w],
        ]
    )
    matrix.flags.writeable = False
    return matrix


class Moves(Part):
    """An object whose state is told from time to time, by a controller above all."""

    type: Literal["moves"]
    """Kind of motion."""
    moves: tuple[Move, ...] = Field(min_length=1)
    """States in the order of their times."""
    before: PlannedMotion | None = None
    """Motion until the first of them; left out, the first one holds from the start."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield times that do not ascend."""
        for index, (first, second) in enumerate(zip(self.moves[:-1], self.moves[1:], strict=True)):
            if not second.time > first.time:
                yield Fault(
                    f"moves[{index + 1}].time",
                    f"{second.time:g} s is not after the {first.time:g} s before.",
                    "Write the moves in the order of their times.",
                )

    def in_force(self, time: float) -> Move | None:
        """Return the move that tells the pose at a time [s]; None before the first where another motion does."""
        for move in reversed(self.moves):
            if time >= move.time:
                return move
        return None if self.before is not None else self.moves[0]

    def scanner_from_object(self, time: ArrayLike, start: Array) -> Array:
        """Return the poses at times [s], shape (n, 4, 4); ``start`` is where the motion before begins."""
        t = np.atleast_1d(np.asarray(time, dtype=np.float64))
        poses, left = np.empty((len(t), 4, 4)), np.ones(len(t), dtype=np.bool_)
        for move in reversed(self.moves):
            own = left & (t >= move.time)
            if own.all():
                return move.pose_at(t)
            if own.any():
                poses[own] = move.pose_at(t[own])
                left &= ~own
            if not left.any():
                return poses
        if self.before is None:
            poses[left] = self.moves[0].pose_at(t[left])
        else:
            poses[left] = self.before.scanner_from_object(t[left], start)
        return poses


RigidMotion = Annotated[
    KnownMotion | Annotated[Moves, Tag("(moves)")],
    Discriminator(kind_of),
    Field(examples=[{"type": "twist", "velocity": ["10 mm/s", "0 m/s", "0 m/s"]}]),
]
"""Any motion of a rigid object."""
