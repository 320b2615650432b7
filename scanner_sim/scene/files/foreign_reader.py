"""A program of its own that reads a mesh with trimesh: the file's bytes come in, plain arrays go out.

``python -m scanner_sim.scene.files.foreign_reader KIND``. It runs with little memory and time, so that no file can take
more, and nothing that happens here can end or change the process that asked.
"""

from __future__ import annotations

import io
import json
import sys
from typing import Any

import numpy as np
import trimesh

from scanner_sim.scene.files.foreign_files import MEMORY, SECONDS, UNREADABLE

try:
    import resource
except ImportError:  # Windows has no such limits
    resource = None  # type: ignore[assignment]


class _NoTrianglesError(Exception):
    """A file that is read and holds none."""


def main() -> int:
    """Read a mesh from the standard input, and write it to the standard output as NumPy's archive."""
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    try:
        found = _arrays(sys.stdin.buffer.read(), sys.argv[1])
    except MemoryError:
        sys.stderr.write("it takes too much memory")
        return UNREADABLE
    except _NoTrianglesError:
        sys.stderr.write("its reader, trimesh, finds no triangles in it")
        return UNREADABLE
    except Exception as error:  # whatever a reader of foreign files may raise
        sys.stderr.write(f"its reader, trimesh, stopped with {type(error).__name__}")
        return UNREADABLE
    archive = io.BytesIO()
    np.savez(archive, **found)
    sys.stdout.buffer.write(archive.getvalue())
    return 0


def _arrays(content: bytes, kind: str) -> dict[str, Any]:
    """Return vertices, faces, the part of each face, the names of the parts, and the unit [m], 0 for none."""
    scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, process=False)
    vertices, faces, part_of = [], [], []
    names: list[list[str]] = []
    start = 0
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        own = np.asarray(mesh.faces)
        own = own[:, [0, 2, 1]] if np.linalg.det(matrix[:3, :3]) < 0.0 else own
        vertices.append(np.asarray(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3])
        faces.append(own + start)
        part_of.append(np.full(len(own), len(names)))
        material = getattr(getattr(mesh.visual, "material", None), "name", None)
        names.append([str(material or ""), str(geometry), str(node)])
        start += len(vertices[-1])
    if not faces:
        raise _NoTrianglesError
    return {
        "vertices": np.concatenate(vertices),
        "faces": np.concatenate(faces),
        "part_of": np.concatenate(part_of),
        "names": np.frombuffer(json.dumps(names).encode(), np.uint8),
        "unit": np.float64(_unit(scene.units)),
    }


def _unit(name: str | None) -> float:
    """Return the length of a unit by its name in trimesh [m]; 0 for none, and for one that is not known."""
    if not name:
        return 0.0
    try:
        return float(trimesh.units.unit_conversion(name, "meters"))
    except (KeyError, ValueError, TypeError):
        return 0.0


if __name__ == "__main__":
    sys.exit(main())
