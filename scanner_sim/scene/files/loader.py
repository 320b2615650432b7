"""From the description of a scene to Mitsuba scenes, with the names of its objects and materials.

What does not move is one Mitsuba scene. Every object that moves is one of its own, in the frame of the object, which
never changes: a motion is a pose for each ray, and nothing is built or compiled anew. Every fault of every object is
reported together. Whoever asks for the same scene again gets the same Mitsuba scenes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, Mask, Matrix3f, MitsubaScene, Shape, UInt32, Vector3f
from scanner_sim.foundation.errors import printable
from scanner_sim.scene.files.built_scene import Named, SceneKeeper
from scanner_sim.scene.files.file_meshes import MeshExtent
from scanner_sim.scene.labels import LabelTable
from scanner_sim.scene.objects import MitsubaFile, Posed, Scene
from scanner_sim.scene.visible import Band


@dataclass
class Pose:
    """Poses ``scanner_from_object`` for n rays, or one for all.

    ``rotation`` is a ``mi.Matrix3f``, ``position`` of the object's origin a ``mi.Vector3f`` [m].
    """

    rotation: Matrix3f
    position: Vector3f

    def take(self, index: UInt32) -> Pose:
        """Return poses by their indices."""
        return Pose(
            dr.gather(mi.Matrix3f, self.rotation, index), dr.gather(mi.Vector3f, self.position, index)
        )


@dataclass(frozen=True)
class Body:
    """An object that moves: its description, and its ``mitsuba.Scene`` in its own frame."""

    item: Posed
    mitsuba: MitsubaScene


@dataclass(frozen=True)
class LoadedScene:
    """A scene ready to be traced.

    Attributes
    ----------
    mitsuba
        The ``mitsuba.Scene`` of what does not move.
    objects, materials
        Names; object and material number k (from 1) is entry k − 1. Number 0 is "nothing". These numbers are the
        renderer's, which address its tables and random numbers.
    object_labels, material_labels
        The numbers and names of the same in results.
    object_of, material_of
        Dr.Jit tables from a shape's registry index to these numbers.
    out_of_band_ratio
        Dr.Jit table from a material's number to its reflectance out of the filter's band over that in it, or by itself
        where that in it is 0; 1 for materials of other people's files.
    coherence
        Dr.Jit table from a material's number to the squared contrast of its speckle: 1 where the surface keeps the
        laser's polarisation, 1/2 where it does not and for other people's materials.
    frames
        Dr.Jit table from an object's number to its pose at time 0: 12 numbers each, the upper rows of a matrix.
    bodies
        The objects that move.
    poses
        Where each of them is: for all rays alike, or for each ray on its own. As loaded, at time 0.
    kept
        A shelf for what is computed of the scene alone, by whoever puts it there; whoever loads the same scene again
        finds it.
    notes
        Sentences on the files of its objects: what was left out, mended and assumed.
    owners
        For each of ``objects`` the object of the scenario to which it belongs: itself, or the mesh whose part it is.
    extents
        How large meshes are in their files, by the names of objects.
    unknown_visible
        Names of materials of which nobody said what they reflect in visible light.
    narrow
        Dr.Jit table from a material's number to whether it has a lobe so narrow that what it returns changes across the
        beam: retro-reflectors, and roughnesses up to 0.1.
    has_narrow
        Whether one of them has.
    dark_in_band
        Dr.Jit table from a material's number to whether it reflects nothing in the filter's band, but something out
        of it.
    """

    mitsuba: MitsubaScene
    objects: tuple[str, ...]
    materials: tuple[str, ...]
    object_labels: LabelTable
    material_labels: LabelTable
    object_of: UInt32
    material_of: UInt32
    out_of_band_ratio: Float
    coherence: Float
    frames: Float
    bodies: tuple[Body, ...] = ()
    poses: tuple[Pose, ...] = ()
    kept: dict[Any, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    owners: tuple[str, ...] = ()
    extents: Mapping[str, MeshExtent] = field(default_factory=dict)
    unknown_visible: tuple[str, ...] = ()
    narrow: Mask = None
    has_narrow: bool = False
    dark_in_band: Mask = None

    def numbers_of(self, name: str) -> tuple[int, int]:
        """Return the first and the last number of an object of the scenario, whose parts may be labelled apart."""
        own = [number for number, owner in enumerate(self.owners, 1) if owner == name]
        return (own[0], own[-1]) if own else (0, 0)

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """The Mitsuba shapes of all objects; those that move are in the frames of their objects."""
        return tuple(
            shape
            for scene in (self.mitsuba, *(body.mitsuba for body in self.bodies))
            for shape in scene.shapes()
        )

    @property
    def triangles(self) -> int:
        """Number of triangles of all meshes."""
        return sum(shape.face_count() for shape in self.shapes if shape.is_mesh())

    def frames_of(self, number: UInt32) -> Pose:
        """Return the poses at time 0 of the objects of some numbers, one for each."""
        entries = [dr.gather(mi.Float, self.frames, 12 * number + entry_index) for entry_index in range(12)]
        rotation = mi.Matrix3f(*(entry for row in range(3) for entry in entries[4 * row : 4 * row + 3]))
        return Pose(rotation, mi.Vector3f(*entries[3::4]))

    def poses_at(self, time: ArrayLike) -> tuple[Pose, ...]:
        """Return the poses of the moving objects at times [s], shape (n,), computed in float64."""
        return device_poses([body.item.pose_at(time) for body in self.bodies])


def device_poses(matrices: list[NDArray[np.float64]]) -> tuple[Pose, ...]:
    """Return poses of several objects, each of shape (n, 4, 4), as float32 on the device; all in one transfer."""
    return poses_from(packed_poses(matrices), len(matrices)) if matrices else ()


def poses_from(packed: NDArray[np.float32], objects: int) -> tuple[Pose, ...]:
    """Return the poses of several objects that :func:`packed_poses` made, on the device."""
    if not objects:
        return ()
    poses = unpacked_poses(mi.Float(for_device(packed)), objects, len(packed) // (12 * objects))
    dr.eval(poses)
    return poses


def packed_poses(matrices: list[NDArray[np.float64]]) -> NDArray[np.float32]:
    """Return the upper three rows of poses, each of shape (n, 4, 4), as one array, shape (12 · objects · n,)."""
    rows = np.stack(matrices, axis=1)[:, :, :3, :]
    return np.ascontiguousarray(rows.reshape(len(rows), -1).T, dtype=np.float32).ravel()


def unpacked_poses(numbers: Float, objects: int, count: int, first: int = 0) -> tuple[Pose, ...]:
    """Return the poses of ``count`` rays that :func:`packed_poses` made, out of an array from an index on."""
    at, step = dr.arange(mi.UInt32, count) + dr.opaque(mi.UInt32, first), dr.opaque(mi.UInt32, count)
    entries = [dr.gather(mi.Float, numbers, at + number * step) for number in range(12 * objects)]
    poses = []
    for start in range(0, len(entries), 12):
        grid = [entries[start + 4 * row : start + 4 * row + 4] for row in range(3)]
        rotation = mi.Matrix3f(*(entry for row in grid for entry in row[:3]))
        poses.append(Pose(rotation, mi.Vector3f(*(row[3] for row in grid))))
    return tuple(poses)


def load_scene(scene: Scene, band: Band = "laser") -> LoadedScene:
    """Load a scene; :func:`scanner_sim.render.device.activate` must have been called.

    With ``band="visible"`` its surfaces reflect as the video camera sees them. Those of Mitsuba files are then the
    library's materials that their ids name; others are as their files say in either.

    A scene that is the same as the last one is not built again: see
    :class:`~scanner_sim.scene.files.built_scene.SceneKeeper`.

    Raises
    ------
    ScenarioError
        With one fault per object that cannot be loaded: missing, broken or empty meshes and XML files,
        unknown materials.
    """
    objects = [Named(item, item.name, f"scene.objects[{index}]") for index, item in enumerate(scene.objects)]
    if scene.file is not None:
        # Its objects have the name of the file, which may hold anything.
        whole = MitsubaFile(name="file", file=scene.file)
        objects.insert(0, Named(whole, printable(scene.file.stem), "scene.file"))
    built = _SCENES.built(objects, band)
    moving = [one.item for one in objects if one.item.moves]
    return LoadedScene(
        built.resting,
        built.objects,
        built.materials,
        LabelTable.of(built.objects, scene.labels.objects),
        LabelTable.of(built.known_as, scene.labels.materials),
        # Copies: a table that somebody changes is his own.
        mi.UInt32(built.object_of),
        mi.UInt32(built.material_of),
        mi.Float(built.out_of_band_ratio),
        mi.Float(built.coherence),
        _frames(objects, built.owners),
        tuple(Body(item, body) for item, body in zip(moving, built.bodies, strict=True)),
        device_poses([item.pose_at(0.0) for item in moving]),
        built.kept,
        built.notes,
        built.owners,
        built.extents,
        built.unknown_visible,
        mi.Bool(built.narrow),
        built.has_narrow,
        mi.Bool(built.dark_in_band),
    )


_SCENES = SceneKeeper()


def _frames(objects: list[Named], owners: tuple[str, ...]) -> Float:
    """Return the table of the objects' poses at time 0."""
    poses = np.broadcast_to(np.eye(4)[:3], (len(owners) + 1, 3, 4)).copy()
    item_of = {one.name: one.item for one in objects}
    for number, name in enumerate(owners, 1):
        poses[number] = item_of[name].pose_at(0.0)[0, :3]
    return mi.Float(for_device(poses))
