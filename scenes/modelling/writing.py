"""From solids to files: vertex normals, PLY meshes and the Mitsuba XML that names them."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from modelling.solids import Array, Solid, joined
from scanner_sim.scene.materials import MATERIALS, mitsuba_bsdf
from scanner_sim.scene.targets import write_ply

CREASE_COS = float(np.cos(np.radians(37.0)))
"""Faces that meet at less than 37 degrees are shaded as one: a ten-sided tube is round, a bevel is not."""


class Model:
    """Solids collected by part and material; each pair becomes one shape."""

    def __init__(self) -> None:
        self.groups: dict[tuple[str, str], list[Solid]] = {}

    def add(self, part: str, material: str, *solids: Solid) -> None:
        self.groups.setdefault((part, material), []).extend(solids)

    @property
    def triangles(self) -> int:
        return sum(len(solid.faces) for group in self.groups.values() for solid in group)


def tidied(values: Array) -> Array:
    """Round to the nanometre, so that the last bit of a platform's sine does not reach the file."""
    return np.round(values, 9) + 0.0


def with_normals(solid: Solid) -> tuple[Array, np.ndarray, Array | None]:
    """Vertices, faces and vertex normals of a mesh, split along creases; no normals if all is flat.

    The normal of a corner is the mean of the unit normals of the faces around the vertex that meet its
    own face at less than the crease angle, weighted by their angles at the vertex.
    """
    corners = solid.vertices[solid.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    faces, corners = solid.faces[length > 1e-14], corners[length > 1e-14]
    face_normal = (cross / np.maximum(length, 1e-30)[:, None])[length > 1e-14]
    ahead = np.roll(corners, -1, axis=1) - corners
    behind = np.roll(corners, 1, axis=1) - corners
    angle = np.arctan2(np.linalg.norm(np.cross(ahead, behind), axis=2), (ahead * behind).sum(axis=2))

    vertex = faces.ravel()
    order = np.argsort(vertex, kind="stable")
    _, first, valence = np.unique(vertex[order], return_index=True, return_counts=True)
    owner = np.repeat(np.arange(len(faces)), 3)
    normal = np.zeros((len(vertex), 3))
    for degree in np.unique(valence):
        group = order[first[valence == degree][:, None] + np.arange(degree)]
        around = face_normal[owner[group]]
        weight = angle.ravel()[group]
        smooth = np.einsum("kic,kjc->kij", around, around) > CREASE_COS
        normal[group] = np.einsum("kij,kj,kjc->kic", smooth.astype(float), weight, around)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    if np.abs(normal - face_normal[owner]).max() < 1e-6:
        return solid.vertices, faces, None
    key = np.column_stack([vertex, np.round(normal * 1e4).astype(np.int64)])
    _, chosen, number = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return solid.vertices[vertex[chosen]], number.reshape(-1, 3), normal[chosen]


def _element(parent: ElementTree.Element, name: str, value: Any) -> None:
    """Append one entry of a plugin's dictionary."""
    if isinstance(value, dict) and value["type"] == "uniform":
        ElementTree.SubElement(parent, "spectrum", name=name, value=f"{value['value']:.9g}")
    elif isinstance(value, dict):
        child = ElementTree.SubElement(parent, "bsdf", type=value["type"], name=name)
        _entries(child, value)
    elif isinstance(value, str):
        ElementTree.SubElement(parent, "string", name=name, value=value)
    else:
        ElementTree.SubElement(parent, "float", name=name, value=f"{value:.9g}")


def _entries(parent: ElementTree.Element, plugin: dict[str, Any]) -> None:
    for name, value in plugin.items():
        if name != "type":
            _element(parent, name, value)


def write_scene(folder: Path, name: str, model: Model, remark: str) -> None:
    """Write ``name.xml`` and its meshes under ``meshes/name``."""
    meshes = folder / "meshes" / name
    meshes.mkdir(parents=True, exist_ok=True)
    for old in meshes.glob("*.ply"):
        old.unlink()
    root = ElementTree.Element("scene", version="3.0.0")
    root.append(ElementTree.Comment(f" {remark} Made by generate.py. "))
    for material in dict.fromkeys(material for _, material in model.groups):
        bsdf = mitsuba_bsdf(MATERIALS[material])
        _entries(ElementTree.SubElement(root, "bsdf", type=bsdf["type"], id=material), bsdf)
    for (part, material), solids in model.groups.items():
        identity = f"{part}_{material}"
        vertices, faces, normals = with_normals(joined(solids))
        write_ply(
            meshes / f"{identity}.ply", tidied(vertices), faces, None if normals is None else tidied(normals)
        )
        shape = ElementTree.SubElement(root, "shape", type="ply", id=identity)
        ElementTree.SubElement(shape, "string", name="filename", value=f"meshes/{name}/{identity}.ply")
        if normals is None:
            ElementTree.SubElement(shape, "boolean", name="face_normals", value="true")
        ElementTree.SubElement(shape, "ref", id=material)
    ElementTree.indent(root)
    (folder / f"{name}.xml").write_bytes(ElementTree.tostring(root, encoding="utf-8") + b"\n")
