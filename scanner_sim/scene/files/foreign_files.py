"""Meshes that trimesh reads: OFF, 3MF and COLLADA.

trimesh is a well-kept library of many readers, which trust their files more than this program does. It runs in a
process of its own (:mod:`scanner_sim.scene.files.foreign_reader`) with bounded memory and time, and gets the bytes of
the file alone: no name of it, no folder, no way to other files.
"""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
import zipfile
from importlib.util import find_spec

import numpy as np

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import LARGEST_MESH
from scanner_sim.scene.files.file_meshes import MOST_PARTS, FileMesh, FilePart
from scanner_sim.scene.files.triangles import MeshError, check_triangles

MEMORY = 6 << 30
"""Bytes of address space of the process that reads."""
SECONDS = 120
"""Its processor time [s]."""
UNREADABLE = 4
"""Its exit status where a file cannot be read."""
_NEEDED = {"off": ("trimesh",), "3mf": ("trimesh", "lxml", "networkx"), "dae": ("trimesh", "collada")}
"""Packages for each kind."""
_DECLARED = re.compile(rb"<!(DOCTYPE|ENTITY)", re.IGNORECASE)
_SURER = "Convert it to GLB, PLY or OBJ, which this program reads itself."
_PACKAGES = {"collada": "pycollada"}


def foreign_mesh(content: bytes, kind: str) -> FileMesh:
    """Return the mesh of a file of a ``kind``: ``off``, ``3mf`` or ``dae``.

    Raises
    ------
    MeshError
        If it cannot be read, or is larger unpacked than a mesh may be.
    InputError
        If trimesh, or the package that it needs for the kind, is not installed.
    """
    missing = [package for package in _NEEDED[kind] if find_spec(package) is None]
    if missing:
        names = ", ".join(_PACKAGES.get(package, package) for package in missing)
        raise InputError(
            f"meshes of the kind .{kind} are read with {names}, which is not installed.",
            remedy="Install it with: pip install 'scanner-sim[meshes]'; or convert the mesh to GLB, PLY or OBJ.",
        )
    if kind == "3mf":
        _check_archive(content)
    elif kind == "dae":
        _check_xml(content)
    command = [sys.executable, "-P", "-m", "scanner_sim.scene.files.foreign_reader", kind]
    try:
        done = subprocess.run(command, input=content, capture_output=True, timeout=5 * SECONDS, check=False)
    except subprocess.TimeoutExpired:
        raise MeshError("reading it takes too long") from None
    said = done.stderr.decode("utf-8", "replace").strip()
    if done.returncode == UNREADABLE:
        raise MeshError(said[:200], _SURER)
    if done.returncode != 0:
        raise MeshError("it takes too much memory or time to read", _SURER)
    return _mesh(done.stdout)


def _mesh(archive: bytes) -> FileMesh:
    with np.load(io.BytesIO(archive), allow_pickle=False) as found:
        names = json.loads(found["names"].tobytes())
        if len(names) > MOST_PARTS:
            raise MeshError(f"it has more than {MOST_PARTS} parts")
        unit = float(found["unit"])
        return FileMesh(
            check_triangles(found["vertices"], found["faces"]),
            found["part_of"].astype(np.intp),
            tuple(FilePart(tuple(one)) for one in names),
            ("normals and colours are not read of this format",),
            unit=unit or None,
            flat=True,
        )


def _check_archive(content: bytes) -> None:
    """Refuse an archive that unpacks to more than a mesh may have, and XML in it that declares entities."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            if sum(entry.file_size for entry in entries) > LARGEST_MESH or len(entries) > MOST_PARTS:
                raise MeshError(f"it unpacks to more than {LARGEST_MESH >> 20} MiB or {MOST_PARTS} files")
            for entry in entries:
                if entry.filename.lower().endswith((".model", ".rels", ".xml")):
                    # Unpacked no further than it says to be long.
                    _check_xml(archive.read(entry))
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError, ValueError):
        raise MeshError("it is no archive that can be unpacked") from None
    except Exception as error:
        if isinstance(error, MeshError | MemoryError):
            raise
        raise MeshError("it is no archive that can be unpacked") from None  # zlib has errors of its own


def _check_xml(content: bytes) -> None:
    """Refuse XML that declares a document type or entities, or is in an encoding in which they could hide."""
    if (
        b"\0" in content[:1000]
        or content[:2] in (b"\xff\xfe", b"\xfe\xff")
        or (
            b"encoding" in content[:200]
            and not (
                re.search(
                    rb"encoding\s*=\s*[\"'](utf-8|us-ascii|ascii|iso-8859-1|windows-1252)[\"']",
                    content[:200],
                    re.I,
                )
            )
        )
    ):
        raise MeshError("its XML is not in UTF-8")
    if _DECLARED.search(content):
        raise MeshError("its XML declares a document type; remove the line <!DOCTYPE …>")
