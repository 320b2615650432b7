"""One clean-up of meshes on their way in: faces without area, vertices that stand twice, faces turned round."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from scanner_sim.scene.files.file_meshes import FileMesh, counted
from scanner_sim.scene.files.triangles import Triangles

MOST_EXAMINED = 3_000_000
"""Faces of the largest mesh whose vertices and winding are looked at: some ten seconds."""

Index = NDArray[np.int64]


def cleaned(mesh: FileMesh) -> FileMesh:
    """Return a mesh without faces that have no area, without vertices that stand twice, faces of one surface alike.

    No surface changes its place: what is hit, and how bright it is, stays. Vertices are the same where position, normal
    and texture coordinates are; in a file without normals they stay apart, because an edge where they do is sharp.
    Holes stay. ``notes`` says what was done.
    """
    notes: list[str] = []
    mesh = _without_slivers(mesh, notes)
    if len(mesh.triangles.faces) <= MOST_EXAMINED:
        mesh = _merged(mesh, notes)
        mesh = _wound_alike(mesh, notes)
    return mesh._replace(notes=(*mesh.notes, *notes))


def _without_slivers(mesh: FileMesh, notes: list[str]) -> FileMesh:
    """Leave out faces whose area is none."""
    kept: NDArray[np.bool_] = np.concatenate(
        [_areas(mesh.triangles, block) for block in _blocks(len(mesh.triangles.faces))]
    )
    if bool(kept.all()):
        return mesh
    notes.append(f"{counted(int((~kept).sum()), 'face')} without area left out")
    return mesh._replace(
        triangles=mesh.triangles._replace(faces=mesh.triangles.faces[kept]), part_of=mesh.part_of[kept]
    )


def _blocks(count: int, size: int = 1 << 20) -> Iterator[slice]:
    yield from (slice(start, start + size) for start in range(0, count, size))


def _areas(mesh: Triangles, which: slice) -> NDArray[np.bool_]:
    """Return which of some faces have an area."""
    corners = mesh.faces[which]
    a, b, c = (mesh.vertices[corners[:, corner]].astype(np.float64) for corner in range(3))
    return np.asarray(np.cross(b - a, c - a).any(axis=1), dtype=np.bool_)


def _merged(mesh: FileMesh, notes: list[str]) -> FileMesh:
    """Let faces share the vertices that are the same in all respects."""
    own = mesh.triangles
    if own.normals is None and not mesh.flat:
        return mesh
    columns = [column for column in (own.vertices, own.normals, own.texture) if column is not None]
    first, same = _alike(np.hstack(columns))
    double = len(own.vertices) - len(first)
    if not double:
        return mesh
    if not mesh.split:
        notes.append(f"{counted(double, 'vertex', 'vertices')} that stood twice merged")
    merged = Triangles(
        own.vertices[first],
        same[own.faces].astype(np.uint32),
        None if own.normals is None else own.normals[first],
        None if own.texture is None else own.texture[first],
    )
    return mesh._replace(triangles=merged)


def _alike(rows: NDArray[np.float32]) -> tuple[Index, Index]:
    """Return the first of each group of equal rows, in the order of the file, and the group of each row."""
    # Zero has two signs, which compare equal and are different bytes.
    solid = np.ascontiguousarray(rows + np.float32(0.0))
    keys = solid.view(np.dtype((np.void, solid.dtype.itemsize * solid.shape[1]))).ravel()
    _, first, same = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[same.ravel()]


def _wound_alike(mesh: FileMesh, notes: list[str]) -> FileMesh:
    """Turn faces that run along an edge in the same sense as their neighbour; of a surface the fewer are turned.

    Each face is taken twice, as it is and turned. Faces that share an edge are joined as they fit together; a surface
    then falls into two halves, one the mirror image of the other, unless it has one side only, as Möbius's strip.
    """
    faces = mesh.triangles.faces
    _, place = _alike(mesh.triangles.vertices)
    start, end = (place[faces[:, corners]].ravel() for corners in ([0, 1, 2], [1, 2, 0]))
    low, high, forward = np.minimum(start, end), np.maximum(start, end), start < end
    edge = low * (int(place.max()) + 1) + high
    order = np.argsort(edge, kind="stable")
    _, first, count = np.unique(edge[order], return_index=True, return_counts=True)
    pairs = first[count == 2]
    one, other = order[pairs], order[pairs + 1]
    at_odds = forward[one] == forward[other]
    if not at_odds.any():
        return mesh
    a, b, total = one // 3, other // 3, len(faces)
    rows, columns = np.concatenate([a, a + total]), np.concatenate([b, b + total])
    columns = np.where(np.tile(at_odds, 2), (columns + total) % (2 * total), columns)
    joined = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(2 * total, 2 * total))
    half = connected_components(joined, directed=False)[1]
    as_it_is, turned = half[:total], half[total:]
    two_sided = as_it_is != turned
    # Of two halves the one counts that holds more of the faces as they are.
    upright = np.bincount(as_it_is, minlength=int(half.max()) + 1)
    flip = two_sided & (upright[turned] > upright[as_it_is])
    even = two_sided & (upright[turned] == upright[as_it_is])
    flip |= even & (turned < as_it_is)
    if not flip.any():
        return mesh
    notes.append(f"{counted(int(flip.sum()), 'face')} turned to look the way of their neighbours")
    mended = faces.copy()
    mended[flip] = mended[flip][:, [0, 2, 1]]
    return mesh._replace(triangles=mesh.triangles._replace(faces=mended))
