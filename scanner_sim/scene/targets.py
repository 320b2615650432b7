"""Geometry of circular targets: a disc of one material set into a plate of another.

Object frame: x right, y down, the front faces −z, the centre of the target at the origin. Disc and
surround lie in the plane z = 0 and share the boundary's vertices, so no ray slips between them and
neither hides the other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from scanner_sim.foundation.errors import InputError

Vertices = npt.NDArray[np.float64]
Faces = npt.NDArray[np.int32]
MeshParts = dict[str, tuple[Vertices, Faces]]

MIN_SEGMENTS = 64
"""Fewest sides of a disc: its corners then lie within 0.09 % of the radius from the circle."""


def polygon_radius(diameter: float, segments: int) -> float:
    """Circumscribed radius of the regular polygon that has a circle's area.

    Parameters
    ----------
    diameter
        Diameter of the circle, metres.
    segments
        Number of sides n.

    Returns
    -------
    float
        r √(2π / (n sin(2π/n))), metres: from n r_p² sin(2π/n) / 2 = π r².
    """
    turn = 2.0 * math.pi / segments
    return 0.5 * diameter * math.sqrt(turn / math.sin(turn))


def _check(diameter: float, plate_size: float, segments: int) -> None:
    if segments < MIN_SEGMENTS or segments % 8:
        raise InputError(
            f"A target's disc needs at least {MIN_SEGMENTS} segments, a multiple of eight; got {segments}."
        )
    if not (diameter > 0.0 and math.isfinite(diameter) and math.isfinite(plate_size)):
        raise InputError(
            f"A target's diameter and plate size must be positive and finite; got {diameter:g} m "
            f"and {plate_size:g} m."
        )
    if plate_size <= 2.0 * polygon_radius(diameter, segments):
        raise InputError(
            f"A target of diameter {diameter:g} m does not fit on a plate of {plate_size:g} m.",
            remedy="Make the plate larger than the disc.",
        )


def circular_target(diameter: float, plate_size: float, segments: int = 96) -> MeshParts:
    """Triangulate a black disc on a square white plate.

    The polygon's area is the circle's to rounding (see :func:`polygon_radius`), so the light a
    target takes away is right whatever the number of segments.

    Parameters
    ----------
    diameter
        Diameter of the disc, metres.
    plate_size
        Side of the square plate, metres.
    segments
        Sides of the disc, a multiple of eight, at least 64.

    Returns
    -------
    dict
        ``"black"`` and ``"white"`` → (vertices (n, 3) float64 in metres, faces (m, 3) int32). Both parts
        hold the same boundary vertices. Normals point towards −z.

    Raises
    ------
    InputError
        If the disc does not fit on the plate, or there are too few segments.
    """
    _check(diameter, plate_size, segments)
    angle = 2.0 * np.pi * np.arange(segments) / segments
    ring = np.zeros((segments, 3))
    ring[:, 0] = np.cos(angle)
    ring[:, 1] = np.sin(angle)
    # The plate's edge is the same fan of directions pushed out to the square: with a multiple of
    # eight its corners are among them.
    edge = ring / np.abs(ring[:, :2]).max(axis=1, keepdims=True) * (0.5 * plate_size)
    ring = ring * polygon_radius(diameter, segments)

    # y points down, so a triangle facing −z runs through its corners by decreasing angle.
    index = np.arange(segments)
    following = (index + 1) % segments
    fan = np.stack([np.full(segments, segments), following, index], axis=1)
    inner = np.stack([index, following, following + segments], axis=1)
    outer = np.stack([index, following + segments, index + segments], axis=1)
    return {
        "black": (np.vstack([ring, np.zeros((1, 3))]), fan.astype(np.int32)),
        "white": (np.vstack([ring, edge]), np.vstack([inner, outer]).astype(np.int32)),
    }


def target_positions(rows: int, columns: int, spacing_x: float, spacing_y: float) -> Vertices:
    """Centres of a rectangular array of targets about the origin, in the plane z = 0.

    Parameters
    ----------
    rows, columns
        Number of targets down and across.
    spacing_x, spacing_y
        Distance between neighbours across and down, metres.

    Returns
    -------
    ndarray, shape (rows · columns, 3)
        Positions in metres, row by row from the top left.

    Raises
    ------
    InputError
        If there are no targets, or neighbours would coincide.
    """
    if rows < 1 or columns < 1:
        raise InputError(f"An array of targets needs a row and a column at least; got {rows} × {columns}.")
    if (columns > 1 and not spacing_x > 0.0) or (rows > 1 and not spacing_y > 0.0):
        raise InputError(
            f"Targets side by side need a positive spacing; got {spacing_x:g} m and {spacing_y:g} m."
        )
    x = (np.arange(columns) - 0.5 * (columns - 1)) * spacing_x
    y = (np.arange(rows) - 0.5 * (rows - 1)) * spacing_y
    grid_y, grid_x = np.meshgrid(y, x, indexing="ij")
    return np.stack([grid_x.ravel(), grid_y.ravel(), np.zeros(rows * columns)], axis=1)


def target_array(
    positions: npt.ArrayLike, diameter: float, plate_size: float, segments: int = 96
) -> MeshParts:
    """Merge equal targets at given positions, one mesh per material.

    Parameters
    ----------
    positions
        Centres of the targets, shape (n, 3), metres.
    diameter, plate_size, segments
        As for :func:`circular_target`.

    Returns
    -------
    dict
        ``"black"`` and ``"white"`` → (vertices, faces), the triangles in the order of ``positions``.

    Raises
    ------
    InputError
        If ``positions`` is not (n, 3) and finite, or two plates overlap.
    """
    centres = np.asarray(positions, dtype=np.float64)
    if centres.ndim != 2 or centres.shape[1] != 3 or not len(centres) or not np.isfinite(centres).all():
        raise InputError(f"Target positions must be finite and of shape (n, 3); got shape {centres.shape}.")
    if (overlap := _overlapping(centres, plate_size)) is not None:
        first, second = overlap
        raise InputError(
            f"The plates of targets {first} and {second} overlap.",
            remedy=f"Space them by the plate's size of {plate_size:g} m or more.",
        )
    merged: MeshParts = {}
    for part, (vertices, faces) in circular_target(diameter, plate_size, segments).items():
        all_vertices = (centres[:, None, :] + vertices[None, :, :]).reshape(-1, 3)
        offset = np.arange(len(centres), dtype=np.int32)[:, None, None] * np.int32(len(vertices))
        merged[part] = (all_vertices, (faces[None, :, :] + offset).reshape(-1, 3))
    return merged


def _overlapping(centres: Vertices, plate_size: float) -> tuple[int, int] | None:
    """Return the first two of equal plates about centres (n, 3) that overlap in one plane; None where none do."""
    # Within a plane: plates one behind the other may hide each other.
    for depth in np.unique(centres[:, 2]):
        (level,) = np.nonzero(centres[:, 2] == depth)
        pairs = (
            cKDTree(centres[level, :2])
            .query(
                centres[level, :2],
                k=min(2, len(level)),
                p=np.inf,
                distance_upper_bound=plate_size * (1.0 - 1e-9),
            )[1]
            .reshape(len(level), -1)
        )
        for one, near in zip(level, pairs, strict=True):
            for other in near:
                if other < len(level) and level[other] != one:
                    return tuple(sorted((int(one), int(level[other]))))  # type: ignore[return-value]
    return None


def write_ply(
    path: Path,
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    normals: npt.ArrayLike | None = None,
) -> None:
    """Write a triangle mesh as binary little-endian PLY; the same mesh gives the same bytes.

    Parameters
    ----------
    path
        File to write.
    vertices
        Positions, shape (n, 3), metres; stored as float32.
    faces
        Indices of corners, shape (m, 3).
    normals
        Unit vertex normals, shape (n, 3); left out when None.

    Raises
    ------
    ValueError
        If the arrays do not fit one another.
    """
    points = np.asarray(vertices, dtype=np.float64)
    triangles = np.asarray(faces, dtype=np.int64)
    columns: Mapping[str, npt.NDArray[np.float64]] = {"xyz": points}
    if normals is not None:
        columns = {"xyz": points, "n": np.asarray(normals, dtype=np.float64)}
    if any(block.shape != (len(points), 3) for block in columns.values()) or triangles.shape[1:] != (3,):
        raise ValueError("vertices and normals must be (n, 3) alike, faces (m, 3)")
    if triangles.size and not (triangles.min() >= 0 and triangles.max() < len(points)):
        raise ValueError(f"a face names a vertex outside 0 to {len(points) - 1}")
    names = ["x", "y", "z"] + (["nx", "ny", "nz"] if normals is not None else [])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    table = np.zeros(len(triangles), dtype=[("count", "u1"), ("corner", "<i4", 3)])
    table["count"] = 3
    table["corner"] = triangles
    body = np.hstack(list(columns.values())).astype("<f4")
    path.write_bytes("\n".join(header).encode("ascii") + body.tobytes() + table.tobytes())
