"""What of a scene takes time: its meshes read, its triangles sorted for rays. Built once, and kept for the next run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.foundation.device_types import Float, Mask, MitsubaScene, Shape, UInt32
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.foundation.named_files import LARGEST_MESH, are_as_noted, noted_files
from scanner_sim.scene.files.file_meshes import MeshExtent
from scanner_sim.scene.files.plugins import installed_plugins_only
from scanner_sim.scene.files.shapes import Surfaces, shapes_of
from scanner_sim.scene.objects import Mesh, Posed
from scanner_sim.scene.visible import Band

MOST_KEPT = 10_000_000
"""Triangles of the largest scene that is kept: about 1 GB."""


class Named(NamedTuple):
    """An object of a scene, its name in the result, and where it stands in the scenario."""

    item: Posed
    name: str
    key: str

    @property
    def built(self) -> Posed:
        """The object as it is built: what moves in its own frame, which no motion changes."""
        return self.item.in_own_frame() if self.item.moves else self.item


@dataclass(frozen=True)
class BuiltScene:
    """The Mitsuba scenes of some objects: all that does not depend on where moving objects are.

    ``resting`` holds what does not move, ``bodies`` each object that does; ``known_as`` has the names by which results
    know the materials, several of which may be equal; ``notes`` says what was left out of files, and mended;
    ``unknown_visible`` names materials of which nobody said what they reflect in visible light;
    ``owners`` are the scenario's objects to which ``objects`` belong, which may be parts of one; ``extents`` are
    of meshes in their files by the objects' names; ``kept`` is a shelf for what others computed of the scene, which
    goes with it; the rest is as in :class:`~scanner_sim.scene.files.loader.LoadedScene`.
    """

    resting: MitsubaScene
    bodies: tuple[MitsubaScene, ...]
    objects: tuple[str, ...]
    materials: tuple[str, ...]
    known_as: tuple[str, ...]
    object_of: UInt32
    material_of: UInt32
    out_of_band_ratio: Float
    coherence: Float
    notes: tuple[str, ...]
    owners: tuple[str, ...]
    extents: Mapping[str, MeshExtent]
    unknown_visible: tuple[str, ...]
    narrow: Mask
    has_narrow: bool
    dark_in_band: Mask
    kept: dict[Any, Any] = field(default_factory=dict)

    @property
    def triangles(self) -> int:
        """Number of triangles of all meshes."""
        scenes = (self.resting, *self.bodies)
        return sum(shape.face_count() for scene in scenes for shape in scene.shapes() if shape.is_mesh())

    def parameters(self) -> list[Any]:
        """Return copies of all that can be changed in the scenes: Dr.Jit arrays and numbers."""
        values = [value for scene in (self.resting, *self.bodies) for _, value in mi.traverse(scene)]
        values = [getattr(value, "matrix", value) for value in values]
        return [type(value)(value) for value in values]


class _Kept(NamedTuple):
    """A scene, what it was built from, and copies of what it was made of then.

    As long as the copies are there, an array of the same index is the same.
    """

    description: str
    files: Mapping[Path, bytes]
    built: BuiltScene
    parameters: list[Any]


class SceneKeeper:
    """Builds scenes, and keeps the last one of them for whoever asks for the same.

    It is the same where objects, materials, names and Mitsuba's variant are, where every file that was read still holds
    the same bytes, and nobody has changed the kept scene itself. What moves counts without its motion. One scene is
    kept, and none of more than :data:`MOST_KEPT` triangles. The last one goes before the next is built: memory never
    holds two, and Dr.Jit, which compiles the materials of all scenes that exist into its kernels, finds those of one.
    """

    def __init__(self) -> None:
        self._kept: _Kept | None = None

    def built(self, objects: Sequence[Named], band: Band = "laser") -> BuiltScene:
        """Return the scenes of objects, whose surfaces are as they are in the light of a band.

        Raises
        ------
        ScenarioError
            With one fault per object that cannot be loaded.
        """
        description = repr(
            (
                mi.variant(),
                band,
                [
                    # An object's words do not say where that stands which it is fixed to.
                    (item.name, item.built, item.item.moves, item.built.scanner_from_object().tolist())
                    for item in objects
                ],
            )
        )
        kept = self._kept
        if (
            kept is not None
            and kept.description == description
            and are_as_noted(kept.files, LARGEST_MESH)
            and _identities(kept.built.parameters()) == _identities(kept.parameters)
        ):
            return kept.built
        self._kept = kept = None
        with installed_plugins_only(), noted_files() as files:
            built = _build(objects, band)
        if built.triangles <= MOST_KEPT:
            self._kept = _Kept(description, files, built, built.parameters())
        return built


def _identities(values: Iterable[Any]) -> list[Any]:
    """Return what is equal for the same arrays and numbers, without a look at what the arrays hold."""
    return [_identity(value) for value in values]


def _identity(value: Any) -> Any:
    if not dr.is_array_v(value):
        return value
    return value.index if dr.depth_v(value) == 1 else _identities(value)


def _build(objects: Sequence[Named], band: Band) -> BuiltScene:
    """Build the scenes and the tables from a shape's registry index to its object and material."""
    surfaces, faults = Surfaces(band), []
    parts: list[tuple[Named, list[Shape]]] = []
    for one in objects:
        try:
            parts.append((one, shapes_of(one.built, surfaces)))
        except InputError as error:
            faults.append(Fault(f"{one.key} ({one.name})", error.message, error.remedy))
    if faults:
        raise ScenarioError(faults, source="scene")
    # Before the shapes go into scenes, which give them other names.
    rows = [(_label(one, shape), shape, shape.bsdf().id()) for one, shapes in parts for shape in shapes]
    resting = _scene([shape for one, shapes in parts if not one.item.moves for shape in shapes])
    bodies = tuple(_scene(shapes) for one, shapes in parts if one.item.moves)
    owners = [one.name for one, shapes in parts for _ in shapes]
    names = tuple(dict.fromkeys(name for name, _, _ in rows))
    materials = tuple(dict.fromkeys(material for _, _, material in rows))
    registry = [_registry_index(shape) for _, shape, _ in rows]
    of_material = {material: shape for _, shape, material in rows}
    narrow = [surfaces.is_narrow(name, of_material[name]) for name in materials]
    object_of = np.zeros(max(registry, default=0) + 1, dtype=np.uint32)
    material_of = object_of.copy()
    number_of = {name: number for number, name in enumerate(names, 1)}
    object_of[registry] = [number_of[name] for name, _, _ in rows]
    material_of[registry] = [materials.index(material) + 1 for _, _, material in rows]
    return BuiltScene(
        resting,
        bodies,
        names,
        materials,
        tuple(map(surfaces.known_as, materials)),
        mi.UInt32(object_of),
        mi.UInt32(material_of),
        mi.Float([1.0, *(surfaces.out_of_band_ratio(name) for name in materials)]),
        mi.Float([0.5, *(surfaces.coherence(name) for name in materials)]),
        surfaces.notes,
        tuple(dict(zip((name for name, _, _ in rows), owners, strict=True))[name] for name in names),
        surfaces.extents,
        surfaces.unknown_visible,
        mi.Bool([False, *narrow]),
        any(narrow),
        mi.Bool([False, *map(surfaces.is_dark_in_band, materials)]),
    )


def _label(one: Named, shape: Shape) -> str:
    """Return the name by which results know what a shape belongs to: the object's, or that of a part of a mesh."""
    return shape.id() if isinstance(one.item, Mesh) and one.item.label_parts else one.name


def _scene(shapes: list[Shape]) -> MitsubaScene:
    return mi.load_dict(
        {"type": "scene", **{f"shape_{number}": shape for number, shape in enumerate(shapes)}},
        optimize=False,
    )


def _registry_index(shape: Shape) -> int:
    index: UInt32 = dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))
    return int(index[0])
