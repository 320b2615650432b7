"""Reading mesh files into triangles that are safe to trace.

The renderer's own readers trust a file: a face that names a missing vertex ends the process. So files are read and
checked here, and the renderer only sees what :func:`scanner_sim.scene.files.triangles.canonical_ply` writes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import LARGEST_MESH, read_ordinary
from scanner_sim.scene.files.file_meshes import FileMesh
from scanner_sim.scene.files.foreign_files import foreign_mesh
from scanner_sim.scene.files.gltf_files import files_of_gltf, gltf_mesh
from scanner_sim.scene.files.mesh_cleaning import cleaned
from scanner_sim.scene.files.obj_files import files_of_obj, obj_mesh
from scanner_sim.scene.files.ply_files import ply_mesh
from scanner_sim.scene.files.stl_files import stl_mesh
from scanner_sim.scene.files.triangles import MeshError, Triangles


def read_mesh_file(path: Path) -> FileMesh:
    """Return what a mesh file holds, cleaned up; polygons are cut into triangles.

    Raises
    ------
    InputError
        If the file, or one that it names, cannot be read, contradicts itself, holds no face, or a number that is not
        finite.
    """
    kind = path.suffix.lower()[1:]
    if kind not in _READERS:
        raise InputError(
            f"{path.name!r} is none of the kinds that are read: {', '.join(_READERS)}.",
            remedy="Convert the mesh.",
        )
    content = read_ordinary(path, LARGEST_MESH)
    try:
        if not content:
            raise MeshError("it is empty")
        return cleaned(_READERS[kind](content, path))
    except MeshError as fault:
        raise InputError(
            f"the mesh {str(path)!r} cannot be used: {fault}.",
            remedy=fault.remedy,
        ) from None
    except InputError as error:
        raise InputError(
            f"the mesh {str(path)!r} cannot be used: {error.message}", remedy=error.remedy
        ) from None
    except MemoryError:
        raise InputError(f"the mesh {str(path)!r} does not fit into memory.", remedy="Simplify it.") from None


def read_mesh(path: Path) -> Triangles:
    """Return the triangles of a mesh file; faults as :func:`read_mesh_file`."""
    return read_mesh_file(path).triangles


def files_of_mesh(path: Path) -> set[Path]:
    """Return the other files that a mesh file names and that are there: buffers, libraries of materials, textures."""
    finders = {".gltf": files_of_gltf, ".glb": files_of_gltf, ".obj": files_of_obj}
    finder = finders.get(path.suffix.lower())
    if finder is None:
        return set()
    try:
        return {file for file in finder(read_ordinary(path, LARGEST_MESH), path) if file.is_file()}
    except (MeshError, InputError):
        return set()


_READERS: dict[str, Callable[[bytes, Path], FileMesh]] = {
    "ply": lambda content, _: ply_mesh(content),
    "obj": obj_mesh,
    "stl": lambda content, _: stl_mesh(content),
    "glb": gltf_mesh,
    "gltf": gltf_mesh,
    "off": lambda content, _: foreign_mesh(content, "off"),
    "3mf": lambda content, _: foreign_mesh(content, "3mf"),
    "dae": lambda content, _: foreign_mesh(content, "dae"),
}
"""What reads a file, by the ending of its name."""
KINDS = tuple(_READERS)
