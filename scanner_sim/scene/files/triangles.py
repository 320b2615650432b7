"""Triangles of a mesh file that are safe to trace: indices within range, finite numbers, some area."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

NO_FACES = "it has no faces, and points or lines cannot be scanned"
MAKE_FACES = "Make a surface of it first, as MeshLab and Open3D do by Poisson's method."


class MeshError(Exception):
    """What is wrong with the content of a mesh file, in words that end its message; and what helps."""

    def __init__(
        self, problem: str, remedy: str = "Export it again, as triangles with finite coordinates."
    ) -> None:
        super().__init__(problem)
        self.remedy = remedy


class Triangles(NamedTuple):
    """A mesh in units of its file.

    ``vertices`` (n, 3); ``faces`` (m, 3), indices of vertices; ``normals`` (n, 3) or None where the file has none;
    ``texture`` (n, 2) or None.
    """

    vertices: Floats
    faces: NDArray[np.uint32]
    normals: Floats | None = None
    texture: Floats | None = None


def check_triangles(
    vertices: NDArray[np.generic],
    faces: NDArray[np.generic],
    normals: NDArray[np.generic] | None = None,
    texture: NDArray[np.generic] | None = None,
) -> Triangles:
    """Return triangles whose indices and numbers are sound.

    Raises
    ------
    MeshError
        If there is no face or no area, an index is out of range, or a number is not finite in single precision.
    """
    if len(faces) == 0:
        raise MeshError(NO_FACES, MAKE_FACES)
    low, high = faces.min(), faces.max()
    if not low >= 0 or not high < len(vertices):
        wrong = low if not low >= 0 else high
        raise MeshError(f"a face names the vertex {wrong:.0f}, and the {len(vertices)} vertices count from 0")
    index = faces.astype(np.uint32)
    vertices, normals, texture, index = _only_used(vertices, normals, texture, index)
    position = _single(vertices, "coordinate")
    if not _have_area(position, index):
        raise MeshError("none of its faces has an area")
    direction = None if normals is None else _single(normals, "normal")
    if direction is not None and not direction.any(axis=1).all():
        # Exporters write zero for vertices of slivers: the renderer finds better ones from the faces.
        direction = None
    return Triangles(
        position, index, direction, None if texture is None else _single(texture, "texture coordinate")
    )


def _only_used(
    vertices: NDArray[np.generic],
    normals: NDArray[np.generic] | None,
    texture: NDArray[np.generic] | None,
    faces: NDArray[np.uint32],
) -> tuple[NDArray[np.generic], NDArray[np.generic] | None, NDArray[np.generic] | None, NDArray[np.uint32]]:
    """Leave out vertices that no face names where some of them are not finite: scanners write missing points so."""
    if np.isfinite(vertices.astype(np.float64)).all():
        return vertices, normals, texture, faces
    used, again = np.unique(faces, return_inverse=True)
    columns = (None if column is None else column[used] for column in (vertices, normals, texture))
    vertices, normals, texture = columns  # type: ignore[assignment]
    return vertices, normals, texture, again.reshape(faces.shape).astype(np.uint32)


def _single(values: NDArray[np.generic], what: str) -> Floats:
    with np.errstate(over="ignore"):
        single = np.ascontiguousarray(values, dtype=np.float32)
    if not np.isfinite(single).all():
        raise MeshError(f"a {what} is not finite")
    return single


def _have_area(vertices: Floats, faces: NDArray[np.uint32]) -> bool:
    """Return whether any face has an area; looks at some first, since most meshes show it at once."""
    for some in (faces[:50], faces[50:]):
        a, b, c = (vertices[some[:, corner]].astype(np.float64) for corner in range(3))
        if np.cross(b - a, c - a).any():
            return True
    return False


def fans(corners: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return polygons of equal size, (n, k), as triangles about their first corner, (n · (k − 2), 3)."""
    last = corners.shape[1] - 1
    return np.stack([corners[:, [0, k, k + 1]] for k in range(1, last)], axis=1).reshape(-1, 3)


def canonical_ply(mesh: Triangles) -> bytes:
    """Return a mesh as the plainest PLY file: binary, little-endian, triangles; the same numbers."""
    columns = [mesh.vertices, mesh.normals, mesh.texture]
    names = [("x", "y", "z"), ("nx", "ny", "nz"), ("u", "v")]
    held = [(array, name) for array, name in zip(columns, names, strict=True) if array is not None]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.vertices)}"]
    header += [f"property float {name}" for _, group in held for name in group]
    header += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices", "end_header", ""]
    rows = np.hstack([array for array, _ in held]).astype("<f4", copy=False)
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<u4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    return "\n".join(header).encode() + rows.tobytes() + faces.tobytes()
