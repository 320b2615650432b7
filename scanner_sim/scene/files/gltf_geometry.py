"""Pieces of a glTF scene: faces from indices, moved to their places, with normals, and joined into one mesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.scene.files.triangles import Triangles, check_triangles

Floats = NDArray[np.float64]
Index = NDArray[np.int64]


class Geometry(NamedTuple):
    """Triangles of one piece: ``vertices`` (n, 3), ``faces`` (m, 3), ``normals`` (n, 3), ``texture`` (n, 2) or None."""

    vertices: Floats
    faces: Index
    normals: Floats | None
    texture: Floats | None

    def moved(self, matrix: Floats) -> Geometry:
        """Return the piece where a matrix puts it; mirrored it keeps its outside, without normals it is flat."""
        linear = matrix[:3, :3]
        with np.errstate(invalid="ignore", over="ignore"):  # found afterwards, when the pieces are joined
            vertices = self.vertices @ linear.T + matrix[:3, 3]
        mirrored = bool(np.linalg.det(linear) < 0.0)
        outwards = -_cofactors(linear) if mirrored else _cofactors(linear)
        normals = None if self.normals is None else _unit(self.normals @ outwards.T)
        faces = self.faces[:, [0, 2, 1]] if mirrored else self.faces
        if normals is not None:
            return Geometry(vertices, faces, normals, self.texture)
        # Without normals faces are flat (specification, section 3.7.2.1): each gets corners of its own.
        corners = vertices[faces]
        with np.errstate(invalid="ignore", over="ignore"):
            facing = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
        texture = None if self.texture is None else self.texture[faces].reshape(-1, 2)
        own = np.arange(3 * len(faces), dtype=np.int64).reshape(-1, 3)
        return Geometry(corners.reshape(-1, 3), own, np.repeat(facing, 3, axis=0), texture)


def triangles_of(index: Index, kind: str) -> Index:
    """Return the faces of a list of corners: ``triangles``, a ``strip`` or a ``fan``; an unfinished one is dropped."""
    if kind == "triangles":
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    count = max(len(index) - 2, 0)
    number = np.arange(count)
    if kind == "fan":
        return np.stack(
            [np.full(count, index[0] if count else 0), index[1:][:count], index[2:][:count]], axis=1
        )
    odd = number % 2
    return np.stack([index[number], index[number + 1 + odd], index[number + 2 - odd]], axis=1)


def joined(pieces: list[Geometry]) -> Triangles:
    """Return pieces as one mesh; where any has texture coordinates, those of the others are 0."""
    starts = np.cumsum([0, *(len(piece.vertices) for piece in pieces[:-1])])
    faces = np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=True)])
    texture = None
    if any(piece.texture is not None for piece in pieces):
        texture = np.concatenate(
            [np.zeros((len(one.vertices), 2)) if one.texture is None else one.texture for one in pieces]
        )
    normals = [piece.normals for piece in pieces if piece.normals is not None]
    return check_triangles(
        np.concatenate([piece.vertices for piece in pieces]), faces, np.concatenate(normals), texture
    )


def _unit(vectors: Floats) -> Floats:
    """Return vectors of length one; z where there is none, as for slivers."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        length = np.linalg.norm(vectors, axis=1, keepdims=True)
        unit = vectors / length
    return np.where(np.isfinite(unit).all(axis=1, keepdims=True), unit, [0.0, 0.0, 1.0])


def _cofactors(linear: Floats) -> Floats:
    """Return what turns normals: the inverse transposed but for a factor, also of a matrix that flattens."""
    a, b, c = linear
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
