"""Where objects stand and how they are turned: the pose of anything in a scene."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.frames import pose_matrix, rotation_about
from scanner_sim.foundation.parts import Number, Part
from scanner_sim.foundation.units import Angle, Length

FARTHEST = 1e5
"""Largest coordinate [m]: beyond it float32 no longer resolves a centimetre."""
SMALLEST = 1e-6
"""Smallest extent [m]."""

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64, examples=["wall"])]
Coordinate = Annotated[Length, Field(ge=-FARTHEST, le=FARTHEST)]
Position = tuple[Coordinate, Coordinate, Coordinate]
Extent = Annotated[Length, Field(ge=SMALLEST, le=FARTHEST)]


def _spelling(word: str, otherwise: str) -> Discriminator:
    """Distinguish a value that is one word, or else a list, from the longer spelling of the same thing.

    Tags in parentheses cannot be keys: messages leave them out of the path.
    """
    kinds = str if word == "(word)" else (list, tuple)
    return Discriminator(lambda value: word if isinstance(value, kinds) else otherwise)


Axis = Annotated[
    Annotated[Literal["x", "y", "z"], Tag("(word)")]
    | Annotated[tuple[Number, Number, Number], Tag("(vector)")],
    _spelling("(word)", "(vector)"),
]


class Rotation(Part):
    """A turn about an axis through the object's origin (right-handed)."""

    axis: Axis = Field(examples=["y"])
    """``x``, ``y``, ``z`` or a vector."""
    angle: Angle
    """Angle of the turn."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield an axis without direction."""
        if not isinstance(self.axis, str) and not 1e-100 < np.linalg.norm(self.axis) < 1e100:
            yield Fault(
                "axis", f"{self.axis} has no direction.", "Write x, y, z or a vector such as [0, 1, 1]."
            )

    def matrix(self) -> NDArray[np.float64]:
        """Return the rotation matrix, shape (3, 3)."""
        axis = np.eye(3)["xyz".index(self.axis)] if isinstance(self.axis, str) else self.axis
        return rotation_about(axis, self.angle)


Turns = Annotated[
    Annotated[Rotation, Tag("(turn)")] | Annotated[tuple[Rotation, ...], Tag("(turns)")],
    _spelling("(turns)", "(turn)"),
    Field(examples=[{"axis": "y", "angle": "20 deg"}]),
]
"""A turn, or several one after the other."""


def placement_matrix(position: Position, rotation: Turns) -> NDArray[np.float64]:
    """Return ``scanner_from_object`` of a position and turns about it, the first one first, as a 4 × 4 matrix."""
    return _placement(position, rotation).copy()


@lru_cache(maxsize=64)
def _placement(position: Position, rotation: Turns) -> NDArray[np.float64]:
    """Work out :func:`placement_matrix`: a visit asks for the same one several times."""
    turns = (rotation,) if isinstance(rotation, Rotation) else rotation
    total = np.eye(3)
    for turn in turns:
        total = turn.matrix() @ total
    return pose_matrix(total, position)
