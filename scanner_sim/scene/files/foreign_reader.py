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

MEMORY = 6 << 30
"""Bytes of address space."""
SECONDS = 120
"""Processor time [s]."""
MISSING, UNREADABLE = 3, 4
"""Exit statuses: a package is not installed; the file cannot be read."""


class _NoTriangles(Exception):
    """A file that is read and holds none."""


def main() -> int:
    """Read a mesh from the standard input, and write it to the standard output as NumPy's archive."""
    _limit()
    content = sys.stdin.buffer.read()
    try:
        found = _arrays(content, sys.argv[1])
    except ImportError as error:
        sys.stderr.write(str(error.name or "trimesh"))
        return MISSING
    except MemoryError:
        sys.stderr.write("it takes too much memory")
        return UNREADABLE
    except _NoTriangles:
        sys.stderr.write("its reader, trimesh, finds no triangles in it")
        return UNREADABLE
    except Exception as error:  # whatever a reader of foreign files may raise
        sys.stderr.write(f"its reader, trimesh, stopped with {type(error).__name__}")
        return UNREADABLE
    archive = io.BytesIO()
    np.savez(archive, **found)
    sys.stdout.buffer.write(archive.getvalue())
    return 0


def _limit() -> None:
    """Keep memory and time within bounds, where the system can."""
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))


def _arrays(content: bytes, kind: str) -> dict[str, Any]:
    import trimesh

    needed = {"3mf": ("lxml", "networkx"), "dae": ("collada",), "off": ()}[kind]
    for package in needed:
        __import__(package)
    scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, process=False)
    vertices, faces, part_of, names, start = [], [], [], [], 0
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
        raise _NoTriangles
    try:
        unit = trimesh.units.unit_conversion(scene.units, "meters") if scene.units else 0.0
    except Exception:  # a unit that trimesh does not know
        unit = 0.0
    return {
        "vertices": np.concatenate(vertices),
        "faces": np.concatenate(faces),
        "part_of": np.concatenate(part_of),
        "names": np.frombuffer(json.dumps(names).encode(), np.uint8),
        "unit": np.float64(unit),
    }


if __name__ == "__main__":
    sys.exit(main())
