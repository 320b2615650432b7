"""What a mesh of a scene is made of: its parts by the materials that a scenario gives them by name."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError, printable
from scanner_sim.scene.files.file_meshes import Colour, FileMesh, FilePart
from scanner_sim.scene.files.reflectance_maps import mean_reflectance, reflectance_map
from scanner_sim.scene.files.triangles import MeshError, Triangles
from scanner_sim.scene.objects import Mesh
from scanner_sim.scene.surfaces import FileColours, MaterialChoice, Surface
from scanner_sim.scene.visible import Band

DEFAULT = "default"
"""Pattern of the parts that no other one fits."""
_MOST_NAMES = 12
"""Names that a message lists."""

Choice = MaterialChoice | FileColours


class Piece(NamedTuple):
    """Triangles of one material: the part that they belong to, and what is laid over them as a map, if anything."""

    triangles: Triangles
    material: MaterialChoice
    part: str
    map: NDArray[np.float32] | None = None


def unit_of(item: Mesh, mesh: FileMesh) -> float:
    """Return the length of a unit of a mesh's file [m]: as the scenario says, or else the file, or else 1 m."""
    return item.length_unit if item.length_unit is not None else (mesh.unit or 1.0)


def pieces_of(item: Mesh, mesh: FileMesh, band: Band) -> tuple[list[Piece], tuple[str, ...]]:
    """Return the pieces of a mesh, each of one material, and sentences on what of its file does not count.

    Colours of the file are for the eye: the scale of :class:`~scanner_sim.scene.surfaces.FileColours` holds at the
    laser's wavelength alone. Materials know both bands, maps are of the one that is asked for.

    Raises
    ------
    InputError
        If a part is left without a material, or a colour or a texture cannot be used.
    """
    choices, notes = _choices(item, mesh.parts)
    if len(set(map(repr, choices))) == 1 and not isinstance(choices[0], FileColours) and not item.label_parts:
        return [Piece(mesh.triangles, choices[0], item.name)], (*mesh.notes, *notes)
    pieces: list[Piece] = []
    whole = _with_normals(mesh)
    colours = _colours(item, mesh, choices)
    for number, (part, choice) in enumerate(zip(mesh.parts, choices, strict=True)):
        own = _faces_of(whole, mesh.part_of == number)
        if own is None:
            continue
        if not isinstance(choice, FileColours):
            pieces.append(Piece(own, choice, printable(part.shown)))
            continue
        colour = colours[number]
        if colour is None:
            raise InputError(
                f"the mesh {str(item.mesh)!r} tells no colour of its part {part.shown[:80]!r}.",
                remedy="Give the part a material by its name, or a default.",
            )
        plain = Surface(
            reflectance=mean_reflectance(colour, choice.scale),
            reflectance_visible=mean_reflectance(colour, 1.0),
            name=choice.known_as,
        )
        chart = None
        if colour.image is not None:
            if own.texture is None:
                raise InputError(
                    f"the mesh {str(item.mesh)!r} has a texture, and no coordinates of it on {part.shown[:80]!r}.",
                    remedy="Export it with texture coordinates.",
                )
            chart = reflectance_map(colour, choice.scale if band == "laser" else 1.0, item.mesh)
        pieces.append(Piece(own, plain, printable(part.shown), chart))
    return pieces, (*mesh.notes, *notes, *_assumption(choices))


def _assumption(choices: Sequence[Choice]) -> tuple[str, ...]:
    scales = {choice.scale for choice in choices if isinstance(choice, FileColours)}
    return tuple(
        f"reflectance at the laser's wavelength is assumed to be {scale:g} × the luminance of the colours in the file"
        for scale in sorted(scales)
    )


def _colours(item: Mesh, mesh: FileMesh, choices: Sequence[Choice]) -> tuple[Colour | None, ...]:
    if not any(isinstance(choice, FileColours) for choice in choices):
        return ()
    if mesh.colours is None:
        raise InputError(
            f"the mesh {str(item.mesh)!r} holds no colours that are read.",
            remedy="Name a material, or export OBJ with its MTL file, or GLB.",
        )
    try:
        return mesh.colours()
    except MeshError as fault:
        raise InputError(f"the colours of the mesh {str(item.mesh)!r} cannot be used: {fault}.") from None


def _choices(item: Mesh, parts: Sequence[FilePart]) -> tuple[list[Choice], list[str]]:
    """Return the material of each part, and warnings of patterns that fit none."""
    if item.materials is None:
        assert item.material is not None  # the cross-checks
        return [item.material] * len(parts), []
    patterns = {pattern.lower(): choice for pattern, choice in item.materials.items() if pattern != DEFAULT}
    default, used = item.materials.get(DEFAULT), set()
    choices: list[Choice] = []
    left: dict[str, None] = {}
    for part in parts:
        names = [name.lower() for name in part.names if name]
        fit = next((one for one in patterns if any(fnmatchcase(name, one) for name in names)), None)
        if fit is not None:
            used.add(fit)
        elif default is None:
            left[part.shown] = None
        chosen = default if fit is None else patterns[fit]
        if chosen is not None:
            choices.append(chosen)
    known = list(dict.fromkeys(name for part in parts for name in part.names if name))
    if left:
        raise InputError(
            f"{len(left)} parts of the mesh {str(item.mesh)!r} have no material: {_listed(list(left))}.",
            remedy=f"Add patterns that fit them, or 'default'; {_nearest(set(patterns) - used, known)}",
        )
    return choices, [
        f"the pattern {printable(one)!r} fits no part; {_nearest({one}, known)}"
        for one in patterns
        if one not in used
    ]


def _nearest(patterns: set[str], known: list[str]) -> str:
    """Return in words which names come near to patterns that fit none."""
    by_lower = {name.lower(): name for name in known}
    found = [
        by_lower[near]
        for pattern in sorted(patterns)
        for near in difflib.get_close_matches(pattern.replace("*", ""), by_lower, n=2, cutoff=0.5)
    ]
    if found:
        return f"did you mean {_listed(list(dict.fromkeys(found)))}?"
    return f"the names in the file: {_listed(known)}." if known else "the parts of the file have no names."


def _listed(names: list[str]) -> str:
    shown = ", ".join(repr(printable(name[:60])) for name in names[:_MOST_NAMES])
    return shown + (f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else "")


def _with_normals(mesh: FileMesh) -> Triangles:
    """Return the mesh with normals where they are interpolated: cut into parts, its faces no longer tell them.

    They are the mean of the faces' around a vertex, weighted by their angles there, as the renderer makes them (Thürmer
    and Wüthrich 1998, J. Graphics Tools 3, 43).
    """
    own = mesh.triangles
    if own.normals is not None or mesh.flat:
        return own
    corners = own.vertices.astype(np.float64)[own.faces]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-300)
    total = np.zeros((len(own.vertices), 3))
    for corner in range(3):
        one = corners[:, (corner + 1) % 3] - corners[:, corner]
        other = corners[:, (corner + 2) % 3] - corners[:, corner]
        lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
        cosine = np.einsum("ij,ij->i", one, other) / np.maximum(lengths, 1e-300)
        np.add.at(total, own.faces[:, corner], np.arccos(np.clip(cosine, -1.0, 1.0))[:, None] * facing)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    normals = np.where(length > 0.0, total / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])
    return own._replace(normals=normals.astype(np.float32))


def _faces_of(mesh: Triangles, which: NDArray[np.bool_]) -> Triangles | None:
    """Return some faces of a mesh with the vertices that they name, or None if there are none with an area."""
    if not which.any():
        return None
    used, again = np.unique(mesh.faces[which], return_inverse=True)
    return Triangles(
        mesh.vertices[used],
        again.reshape(-1, 3).astype(np.uint32),
        None if mesh.normals is None else mesh.normals[used],
        None if mesh.texture is None else mesh.texture[used],
    )
