"""Closed triangle solids with outward normals, and how they are moved and joined.

Frame of every part: x right, y down, z away from the viewer; right-handed, metres.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class Solid(NamedTuple):
    """Vertices (n, 3) in metres and faces (m, 3), counter-clockwise seen from outside."""

    vertices: Array
    faces: NDArray[np.int64]


def volume(solid: Solid) -> float:
    """Signed volume by the divergence theorem; positive where normals point outwards."""
    a, b, c = (solid.vertices[solid.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def outward(vertices: Array, faces: ArrayLike) -> Solid:
    """Return a closed mesh, turned so that its normals point outwards, without empty triangles."""
    triangles = np.asarray(faces, dtype=np.int64)
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    solid = Solid(vertices, triangles[distinct])
    return solid if volume(solid) > 0.0 else Solid(vertices, solid.faces[:, ::-1])


def joined(solids: Iterable[Solid]) -> Solid:
    """Several solids as one mesh; they may interpenetrate but must not share faces."""
    parts = list(solids)
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Solid(
        np.vstack([part.vertices for part in parts]),
        np.vstack([part.faces + start for part, start in zip(parts, starts, strict=True)]),
    )


def moved(solid: Solid, offset: Sequence[float]) -> Solid:
    return Solid(solid.vertices + np.asarray(offset, dtype=np.float64), solid.faces)


def frame(origin: ArrayLike, outward_normal: ArrayLike, right: ArrayLike) -> Array:
    """Pose (4, 4) of a part that stands on a surface: its −z along the surface's outward normal.

    ``right`` is the direction of the part's x axis; what of it is along the normal is taken off.
    """
    ez = -np.asarray(outward_normal, dtype=np.float64)
    ez = ez / np.linalg.norm(ez)
    ex = np.asarray(right, dtype=np.float64)
    ex = ex - ez * (ex @ ez)
    ex = ex / np.linalg.norm(ex)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = ex, np.cross(ez, ex), ez
    pose[:3, 3] = np.asarray(origin, dtype=np.float64)
    return pose


def placed(solid: Solid, pose: Array) -> Solid:
    return Solid(solid.vertices @ pose[:3, :3].T + pose[:3, 3], solid.faces)


def turned(solid: Solid, angle: float) -> Solid:
    """Turn about the z axis, from x towards y, radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    pose = np.eye(4)
    pose[:2, :2] = [[cos, -sin], [sin, cos]]
    return placed(solid, pose)


def loft(rings: ArrayLike) -> Solid:
    """Skin over rings of equal size, shape (k, n, 3), closed with fans at both ends.

    The first and last ring must be star-shaped about their mean.
    """
    points = np.asarray(rings, dtype=np.float64)
    count, size, _ = points.shape
    index = np.arange(size)
    after = (index + 1) % size
    faces = []
    for ring in range(count - 1):
        low, high = ring * size, (ring + 1) * size
        faces.append(np.stack([low + index, low + after, high + after], axis=1))
        faces.append(np.stack([low + index, high + after, high + index], axis=1))
    first, last = count * size, count * size + 1
    faces.append(np.stack([np.full(size, first), after, index], axis=1))
    end = (count - 1) * size
    faces.append(np.stack([np.full(size, last), end + index, end + after], axis=1))
    centres = np.stack([points[0].mean(axis=0), points[-1].mean(axis=0)])
    return outward(np.vstack([points.reshape(-1, 3), centres]), np.vstack(faces))


def _rectangle(width: float, height: float, z: float) -> Array:
    x, y = 0.5 * width, 0.5 * height
    return np.array([[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]])


def box(width: float, height: float, front: float, back: float, bevel: float = 0.0) -> Solid:
    """Box about the z axis between z = front and z = back; the front edges may be bevelled."""
    rings = [_rectangle(width, height, front)]
    if bevel > 0.0:
        rings = [_rectangle(width - 2 * bevel, height - 2 * bevel, front)]
        rings.append(_rectangle(width, height, front + bevel))
    return loft([*rings, _rectangle(width, height, back)])


def rounded_plate(
    width: float, height: float, radius: float, front: float, back: float, bevel: float
) -> Solid:
    """Plate with rounded corners and a bevelled front edge."""
    angle = np.linspace(0.0, 0.5 * np.pi, 9)
    rings = []
    for z, inset in ((front, bevel), (front + bevel, 0.0), (back, 0.0)):
        corners = []
        for quarter, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
            turn = angle + quarter * 0.5 * np.pi
            centre = np.array([sx * (0.5 * width - radius), sy * (0.5 * height - radius)])
            edge = centre + (radius - inset) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            corners.append(np.column_stack([edge, np.full(len(edge), z)]))
        rings.append(np.vstack(corners))
    return loft(rings)


def circle(radius: float, z: float, segments: int, squeeze: float = 1.0) -> Array:
    angle = 2.0 * np.pi * np.arange(segments) / segments
    return np.stack([radius * np.cos(angle), squeeze * radius * np.sin(angle), np.full(segments, z)], axis=1)


def turned_part(profile: Sequence[tuple[float, float]], segments: int) -> Solid:
    """Stack of discs about the z axis: profile of (radius, z) from the front to the back, radii above 0."""
    return loft([circle(radius, z, segments) for radius, z in profile])


def ring_part(profile: Sequence[tuple[float, float]], segments: int) -> Solid:
    """Ring about the z axis: a closed profile of (radius, z), radii above 0."""
    loop = np.asarray(profile, dtype=np.float64)
    size = len(loop)
    angle = 2.0 * np.pi * np.arange(segments) / segments
    vertices = np.stack(
        [
            np.outer(np.cos(angle), loop[:, 0]),
            np.outer(np.sin(angle), loop[:, 0]),
            np.broadcast_to(loop[:, 1], (segments, size)),
        ],
        axis=-1,
    ).reshape(-1, 3)
    around, along = np.meshgrid(np.arange(segments), np.arange(size), indexing="ij")
    here = (around * size + along).ravel()
    up = (around * size + (along + 1) % size).ravel()
    side = ((around + 1) % segments * size + along).ravel()
    diagonal = ((around + 1) % segments * size + (along + 1) % size).ravel()
    return outward(
        vertices,
        np.vstack([np.stack([here, up, diagonal], axis=1), np.stack([here, diagonal, side], axis=1)]),
    )


def tube(path: ArrayLike, radius: float, sides: int = 10, squeeze: float = 1.0) -> Solid:
    """Round bar along a polyline, mitred at its corners; ``squeeze`` flattens it across its bend.

    The ring is carried along without twist (parallel transport).
    """
    points = np.asarray(path, dtype=np.float64)
    leg = np.diff(points, axis=0)
    leg = leg / np.linalg.norm(leg, axis=1, keepdims=True)
    tangent = np.vstack([leg[:1], leg[:-1] + leg[1:], leg[-1:]])
    tangent = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.eye(3)[np.argmin(np.abs(leg[0]))]
    rings = []
    flat = circle(radius, 0.0, sides, squeeze)
    for number, (point, along) in enumerate(zip(points, tangent, strict=True)):
        side = side - along * (side @ along)
        side = side / np.linalg.norm(side)
        before = leg[max(number - 1, 0)]
        widening = 1.0 / max(float(along @ before), 0.6)
        ring = np.outer(flat[:, 0], side) + np.outer(flat[:, 1], np.cross(along, side))
        # Widen in the plane of the bend so that a mitre keeps the bar's thickness.
        bend = leg[min(number, len(leg) - 1)] - before
        if np.linalg.norm(bend) > 1e-9:
            bend = bend / np.linalg.norm(bend)
            ring = ring + (widening - 1.0) * np.outer(ring @ bend, bend)
        rings.append(point + ring)
    return loft(rings)


def bar(start: ArrayLike, end: ArrayLike, width: float, depth: float, up: ArrayLike) -> Solid:
    """Rectangular bar between two points; ``depth`` is measured along ``up``."""
    begin, finish = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(finish - begin))
    pose = frame(begin, begin - finish, np.cross(np.asarray(up, dtype=np.float64), finish - begin))
    return placed(box(width, depth, 0.0, length), pose)


def i_beam(start: ArrayLike, end: ArrayLike, width: float, depth: float, up: ArrayLike) -> Solid:
    """I-beam between two points: two flanges across ``up`` and a web that ends inside them."""
    begin, finish = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(finish - begin))
    pose = frame(begin, begin - finish, np.cross(np.asarray(up, dtype=np.float64), finish - begin))
    thick = 0.14 * depth
    flange = box(width, thick, 0.0, length)
    shift = 0.5 * (depth - thick)
    web = box(0.16 * width, depth - 1.2 * thick, 0.002, length - 0.002)
    return placed(joined([moved(flange, (0, -shift, 0)), moved(flange, (0, shift, 0)), web]), pose)


Surface = Callable[[Array, Array], tuple[Array, Array]]
"""Maps parameters (u, v) in 0…1 to points (…, 3) and outward unit normals (…, 3)."""


def draped(surface: Surface, height: Array, skirt: float) -> Solid:
    """Sheet on a surface: ``height`` (nv, nu) above it, its edges turned down by ``skirt`` below it.

    The sheet is open underneath: its edge must end inside something solid.
    """
    rows, columns = height.shape
    padded = np.full((rows + 2, columns + 2), -skirt)
    padded[1:-1, 1:-1] = height
    u = np.concatenate([[0.0], np.linspace(0.0, 1.0, columns), [1.0]])
    v = np.concatenate([[0.0], np.linspace(0.0, 1.0, rows), [1.0]])
    grid_v, grid_u = np.meshgrid(v, u, indexing="ij")
    points, normals = surface(grid_u, grid_v)
    vertices = (points + padded[..., None] * normals).reshape(-1, 3)
    number = np.arange((rows + 2) * (columns + 2)).reshape(rows + 2, columns + 2)
    here, right = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    below, across = number[1:, :-1].ravel(), number[1:, 1:].ravel()
    faces = np.vstack([np.stack([here, right, across], axis=1), np.stack([here, across, below], axis=1)])
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    outside = normals.reshape(-1, 3)[faces[:, 0]]
    if np.einsum("ij,ij->", cross, outside) < 0.0:
        faces = faces[:, ::-1]
    # The four corner cells of the turned-down edge have no area.
    return Solid(vertices, faces[np.linalg.norm(cross, axis=1) > 1e-12])
