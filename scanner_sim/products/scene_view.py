"""What stands before a scanner, as a table and a picture need it: objects, field of view, ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ViewedObject:
    """An object at the beginning of a scan.

    Attributes
    ----------
    name
        As the scenario has it; for a scene in XML that of its file.
    kind
        What it is: ``mesh``, ``box``, ``array`` …
    materials
        Names of its materials.
    triangles
        Of its meshes; 0 for shapes in closed form.
    points
        Points on its surface in the scanner frame [m], shape (n, 3).
    share
        Share of the picture's field of view that it fills, as seen from the scanner, 0 to 1.
    moves
        Whether it moves during the scan.
    """

    name: str
    kind: str
    materials: tuple[str, ...]
    triangles: int
    points: Array
    share: float
    moves: bool

    @property
    def size(self) -> Array:
        """Its extent along the scanner's axes [m], shape (3,)."""
        extent: Array = np.ptp(self.points, axis=0)
        return extent

    @property
    def distance(self) -> float:
        """Distance of its nearest point from the scanner [m]."""
        return float(np.linalg.norm(self.points, axis=1).min())


class Field(NamedTuple):
    """What a scanner can see: ends of Θ and φ [rad], and the nearest and farthest range [m]; that may be infinite."""

    horizontal: tuple[float, float]
    vertical: tuple[float, float]
    near: float
    far: float


@dataclass(frozen=True, eq=False)
class SceneView:
    """A scene from the scanner's place.

    Attributes
    ----------
    objects
        The objects in the order of the scene.
    field
        What the scan covers and the instrument sees.
    window
        Ends of Θ and of φ of the picture [rad], a little more than the field of view.
    number
        Which object is seen in each dot, from 1, 0 for nothing, shape (rows, columns); the top row is the
        first, and the left column.
    shade
        Cosine of the angle between the line of sight and the surface, shape (rows, columns).
    distance
        Distance of what is seen [m], infinite for nothing, shape (rows, columns).
    """

    objects: tuple[ViewedObject, ...]
    field: Field
    window: tuple[tuple[float, float], tuple[float, float]]
    number: NDArray[np.int64]
    shade: Array
    distance: Array

    def seen(self, one: ViewedObject) -> str:
        """Return in words whether an object is in view."""
        if one.share > 0.0:
            return f"in view, {100.0 * one.share:.2g} %"
        points = one.points
        if (points[:, 2] <= 0.0).all():
            return "behind the scanner"
        before = points[points[:, 2] > 0.0]
        inside = np.ones(len(before), dtype=bool)
        for axis, ends in ((0, self.field.horizontal), (1, self.field.vertical)):
            angle = np.arctan2(before[:, axis], before[:, 2])
            inside &= (angle >= ends[0]) & (angle <= ends[1])
        return "hidden, or finer than the picture" if inside.any() else "outside of the field of view"
