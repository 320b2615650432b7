"""What a mesh file holds once it is read: triangles, the parts that it names, their colours, and what was left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.scene.files.triangles import Triangles

MOST_PARTS = 10_000
"""Parts of a mesh: each is a shape of its own where materials go by names."""


class Colour(NamedTuple):
    """The colour of a part in visible light.

    ``factor`` is linear red, green and blue, ``image`` a PNG or JPEG file of sRGB that multiplies it, or None.
    """

    factor: tuple[float, float, float]
    image: bytes | None = None


class FilePart(NamedTuple):
    """A part of a mesh by its names in the file: that of its material first, then group, object, mesh or node."""

    names: tuple[str, ...]

    @property
    def shown(self) -> str:
        """Its first name, or a word for a part that has none."""
        return next((name for name in self.names if name), "unnamed")


class FileMesh(NamedTuple):
    """What a file holds.

    Attributes
    ----------
    triangles
        All of it, in units of the file.
    part_of
        Number of each face's part, shape (m,).
    parts
        The parts that have faces.
    notes
        Sentences about what was left out or mended, for whoever gave the file.
    unit
        Length of a unit of the file [m], or None where it tells none.
    flat
        Whether its faces are flat: normals are not interpolated between their corners.
    split
        Whether the reader gave faces corners of their own, so that equal ones are nothing of the file's.
    rows_from_below
        Whether textures are counted from their lowest row.
    colours
        What opens the colours of the parts, one for each; None where a part has none.
    """

    triangles: Triangles
    part_of: NDArray[np.intp]
    parts: tuple[FilePart, ...]
    notes: tuple[str, ...] = ()
    unit: float | None = None
    flat: bool = False
    split: bool = False
    rows_from_below: bool = False
    colours: Callable[[], tuple[Colour | None, ...]] | None = None

    @classmethod
    def whole(cls, triangles: Triangles, name: str = "", **settings: object) -> FileMesh:
        """Return a file of one part."""
        part_of = np.zeros(len(triangles.faces), dtype=np.intp)
        return cls(triangles, part_of, (FilePart((name,)),), **settings)  # type: ignore[arg-type]


class MeshExtent(NamedTuple):
    """How large a mesh is: ``unit`` of its file [m], ``diagonal`` and ``middle`` (3,) of its box in that unit."""

    unit: float
    diagonal: float
    middle: NDArray[np.float64]

    @classmethod
    def of(cls, triangles: Triangles, unit: float) -> MeshExtent:
        """Return the extent of the vertices that have faces."""
        own = triangles.vertices[np.unique(triangles.faces)].astype(np.float64)
        low, high = own.min(axis=0), own.max(axis=0)
        return cls(unit, float(np.linalg.norm(high - low)), 0.5 * (low + high))


def counted(number: int, thing: str, things: str = "") -> str:
    """Return a number with its noun, ``1 face`` or ``12 faces``."""
    return f"{number:,} {thing if number == 1 else things or thing + 's'}"
