"""Objects of a scene: shapes, meshes, target arrays and Mitsuba files, each with a pose."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Discriminator, Field, PrivateAttr, Tag, field_validator
from scipy.spatial.transform import Rotation as Turning

from scanner_sim.foundation.arithmetic import product
from scanner_sim.foundation.errors import Fault, printable
from scanner_sim.foundation.parts import Count, MeshFile, Part, Switch, XmlFile
from scanner_sim.foundation.units import Length
from scanner_sim.scene.labels import Labels
from scanner_sim.scene.moves import RigidMotion
from scanner_sim.scene.poses import FARTHEST, Extent, Name, Position, Rotation, Turns, placement_matrix
from scanner_sim.scene.surfaces import FileColours, MaterialChoice, MeshMaterial, Pattern


class Posed(Part):
    """What every object has: a name, a pose and perhaps a motion, before the scanner or on another object."""

    name: Name
    """Name, unique in the scene; it appears in the truth layer."""
    parent: Name | None = Field(default=None, examples=["satellite"])
    """Name of the object that it is fixed to: pose and motion are then given in that object's frame, and it moves
    along. By default they are in the scanner frame."""
    position: Position = (0.0, 0.0, 0.0)
    """Position of the object's origin in the scanner frame, or in its parent's."""
    rotation: Turns = ()
    """Turns about the object's origin, the first one first."""
    motion: RigidMotion | None = None
    """How the object moves; by default it rests. Waypoints and files of poses replace position and rotation,
    which are a twist's pose at time 0."""
    _carrier: Posed | None = PrivateAttr(default=None)

    def carried_by(self, carrier: Posed) -> Self:
        """Return the object as it is fixed to another one, which is its ``parent``."""
        carried = self.model_copy()
        carried._carrier = carrier
        return carried

    @property
    def moves(self) -> bool:
        """Whether it does not rest before the scanner: by a motion of its own, or of what it is fixed to."""
        return self.motion is not None or (self._carrier is not None and self._carrier.moves)

    def scanner_from_object(self) -> NDArray[np.float64]:
        """Return the pose that position and rotation describe, as a 4 × 4 matrix; a motion may differ from it."""
        own = placement_matrix(self.position, self.rotation)
        return own if self._carrier is None else product(self._carrier.scanner_from_object(), own)

    def pose_at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return ``scanner_from_object`` at times [s] since the start of the scan, shape (n, 4, 4)."""
        start = placement_matrix(self.position, self.rotation)
        if self.motion is None:
            own = np.tile(start, (np.size(time), 1, 1))
        else:
            own = self.motion.scanner_from_object(time, start)
        return own if self._carrier is None else product(self._carrier.pose_at(time), own)

    def resting_at(self, time: float) -> Self:
        """Return the object without motion and parent, where it is at a time [s]."""
        if not self.moves and self._carrier is None:
            return self
        (pose,) = self.pose_at(time)
        turn = Turning.from_matrix(pose[:3, :3]).as_rotvec()
        angle = float(np.linalg.norm(turn))
        x, y, z = (turn / angle).tolist() if angle else (0.0, 0.0, 1.0)
        rested = self.model_copy(
            update={
                "parent": None,
                "position": tuple(pose[:3, 3].tolist()),
                "rotation": (Rotation(axis=(x, y, z), angle=angle),),
                "motion": None,
            }
        )
        rested._carrier = None
        return rested

    def in_own_frame(self) -> Self:
        """Return the object with its origin at the scanner's, at rest and on nothing else: what no motion changes."""
        still = {"position": (0.0, 0.0, 0.0), "rotation": (), "motion": None, "parent": None}
        alone = self.model_copy(update=still)
        alone._carrier = None
        return alone


class Rectangle(Posed):
    """A flat rectangle that faces the scanner."""

    shape: Literal["rectangle"]
    size: tuple[Extent, Extent] = Field(examples=[["4 m", "4 m"]])
    """Width and height."""
    material: MaterialChoice
    """Material of both sides."""


class Disc(Posed):
    """A flat disc that faces the scanner."""

    shape: Literal["disc"]
    diameter: Extent
    """Diameter."""
    material: MaterialChoice
    """Material of both sides."""


class Sphere(Posed):
    """A sphere about the origin."""

    shape: Literal["sphere"]
    diameter: Extent
    """Diameter."""
    material: MaterialChoice
    """Material."""


class Box(Posed):
    """A box about the origin."""

    shape: Literal["box"]
    size: tuple[Extent, Extent, Extent] = Field(examples=[["1 m", "1 m", "1 m"]])
    """Extent in x, y and z."""
    material: MaterialChoice
    """Material."""


class Cylinder(Posed):
    """A closed cylinder about the origin, its axis along y."""

    shape: Literal["cylinder"]
    diameter: Extent
    """Diameter."""
    length: Extent
    """Length along the axis."""
    material: MaterialChoice
    """Material."""


class Mesh(Posed):
    """A mesh from a file: PLY, OBJ, STL, glTF or GLB; OFF, 3MF and COLLADA through trimesh."""

    mesh: MeshFile
    """File, relative to the scenario's folder."""
    length_unit: Length | None = Field(default=None, ge=1e-9, le=FARTHEST)
    """Length of one unit of the file: ``1 mm`` for a mesh drawn in millimetres. By default the unit that the file tells
    (glTF, 3MF, COLLADA), or 1 m."""
    material: MeshMaterial | None = None
    """Material of all of it."""
    materials: dict[Pattern, MeshMaterial] | None = Field(
        default=None, examples=[{"*alu*": "weathered_aluminium", "default": {"reflectance": 0.5}}]
    )
    """Materials of its parts, in the place of ``material``: patterns of the names that parts, groups and materials have
    in the file, with * and ?, capitals or not; of several that fit the first counts. ``default`` is for all others."""
    label_parts: Switch = False
    """Whether the parts are objects of their own in ``truth.object``: ``NAME.PART``."""

    def __hash__(self) -> int:
        """Return the same for equal meshes: scenarios are keys of caches."""
        return hash((self.name, self.parent, self.mesh, self.position))

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a mesh of no material, or of two."""
        if self.material is None and not self.materials:
            yield Fault(
                "material",
                "this key is missing.",
                "Write 'material: z93_white', or materials by the names of parts: "
                "'materials: {\"*alu*\": weathered_aluminium, default: {reflectance: 0.5}}'.",
            )
        if self.material is not None and self.materials is not None:
            yield Fault("materials", "there is a material for the whole mesh, too.", "Leave one of them out.")


class MitsubaFile(Posed):
    """The shapes of a Mitsuba XML scene, moved as one body; its own materials stay."""

    file: XmlFile
    """XML file, relative to the scenario's folder."""


DEEPEST = 50
"""Objects that are fixed to one another in a chain."""
MOST_TARGETS = 10_000
"""Targets of all arrays of a scene: five million triangles, half a gigabyte."""


class TargetPattern(Part):
    """An array of circular targets in the plane z = 0, centred on the origin."""

    diameter: Extent
    """Diameter of each disc."""
    rows: Count = Field(default=1, ge=1, le=1000)
    """Targets from top to bottom."""
    columns: Count = Field(default=1, ge=1, le=1000)
    """Targets from left to right."""
    spacing: tuple[Extent, Extent] = (1.0, 1.0)
    """Distance of the centres, horizontally and vertically."""
    plate: Extent
    """Edge of the square plate around each disc."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield discs that overhang their plates, plates that overlap, and more of them than memory holds."""
        if self.diameter >= self.plate:
            yield Fault(
                "diameter",
                f"a disc of {self.diameter:g} m does not fit on a plate of {self.plate:g} m.",
                "Make it smaller than the plate.",
            )
        if self.rows * self.columns > MOST_TARGETS:
            yield Fault(
                "rows",
                f"{self.rows} × {self.columns} are {self.rows * self.columns} targets; {MOST_TARGETS} are possible.",
                "Reduce rows or columns.",
            )
        for count, spacing, name in zip(
            (self.columns, self.rows), self.spacing, ("horizontal", "vertical"), strict=True
        ):
            if count > 1 and spacing < self.plate:
                yield Fault(
                    "spacing",
                    f"the {name} spacing of {spacing:g} m is smaller than the plates of {self.plate:g} m, "
                    "which would overlap.",
                    "Enlarge it, or make the plates smaller.",
                )


class TargetArray(Posed):
    """An array of circular targets, each a disc in a square plate."""

    array: TargetPattern
    """Size and layout."""
    disc: MaterialChoice = "target_black"
    """Material of the discs."""
    material: MaterialChoice = "target_white"
    """Material of the plates."""


KINDS = ("shape", "mesh", "array", "file")
"""The keys that say what an object is; it has exactly one of them."""
SHAPES = ("rectangle", "disc", "sphere", "box", "cylinder")
"""Values of the key ``shape``."""


def _kind(value: Any) -> str | None:
    """Return the tag of an object: which of the four keys it has, and for shapes which shape."""
    kinds = {key: value.get(key) if isinstance(value, dict) else getattr(value, key, None) for key in KINDS}
    found = [key for key in KINDS if kinds[key] is not None]
    if len(found) != 1:
        return None
    return f"({kinds['shape'] if found == ['shape'] else found[0]})"


SceneObject = Annotated[
    Annotated[Rectangle, Tag("(rectangle)")]
    | Annotated[Disc, Tag("(disc)")]
    | Annotated[Sphere, Tag("(sphere)")]
    | Annotated[Box, Tag("(box)")]
    | Annotated[Cylinder, Tag("(cylinder)")]
    | Annotated[Mesh, Tag("(mesh)")]
    | Annotated[MitsubaFile, Tag("(file)")]
    | Annotated[TargetArray, Tag("(array)")],
    Discriminator(
        _kind,
        custom_error_type="object_kind",
        custom_error_message=(
            f"an object has exactly one of the keys shape ({', '.join(SHAPES)}), mesh, array and file"
        ),
    ),
]
"""Any object of a scene."""


def materials_of(item: Posed) -> tuple[MaterialChoice | FileColours, ...]:
    """Return the materials that an object names; Mitsuba's files have their own."""
    if isinstance(item, Mesh):
        return (*(() if item.material is None else (item.material,)), *(item.materials or {}).values())
    if isinstance(item, TargetArray):
        return item.disc, item.material
    return () if isinstance(item, MitsubaFile) else (item.material,)  # type: ignore[attr-defined]


class Scene(Part):
    """What stands before the scanner."""

    file: XmlFile | None = None
    """Mitsuba XML scene in the scanner's frame, relative to the scenario's folder."""
    objects: tuple[SceneObject, ...] = ()
    """Objects, each with its pose."""
    labels: Labels = Labels()
    """Numbers by which results know objects and materials; by default they count in the order of the scene."""

    @field_validator("objects")
    @classmethod
    def _fix_to_parents(cls, objects: tuple[SceneObject, ...]) -> tuple[SceneObject, ...]:
        """Let each object know what it is fixed to; parents that are not there stay for the cross-checks."""
        by_name = {item.name: item for item in objects}
        if all(item.parent is None for item in objects) or _endless(objects):
            return objects

        def fixed(item: SceneObject) -> SceneObject:
            parent = None if item.parent is None else by_name.get(item.parent)
            return item if parent is None else item.carried_by(fixed(parent))

        return tuple(fixed(item) for item in objects)

    def moved(self, motions: Mapping[str, RigidMotion]) -> Scene:
        """Return the scene with other motions of some objects, by their names, which are not checked."""
        items = tuple(
            item.model_copy(update={"motion": motions[item.name]}) if item.name in motions else item
            for item in self.objects
        )
        return self.model_copy(update={"objects": Scene._fix_to_parents(items)})

    @property
    def names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the objects and of the materials in the order of the scene, but materials of Mitsuba's files."""
        own = () if self.file is None else (printable(self.file.stem),)
        choices = [choice for item in self.objects for choice in materials_of(item)]
        materials = (choice if isinstance(choice, str) else choice.known_as for choice in choices)
        return (*own, *(item.name for item in self.objects)), tuple(dict.fromkeys(materials))

    def resting_at(self, time: float) -> Scene:
        """Return the scene without motion, every object where it is at a time [s] since the start of the scan."""
        return self.model_copy(update={"objects": tuple(item.resting_at(time) for item in self.objects)})

    def cross_checks(self) -> Iterator[Fault]:
        """Yield names that are given twice, and more targets than memory holds."""
        arrays = [item for item in self.objects if isinstance(item, TargetArray)]
        targets = sum(item.array.rows * item.array.columns for item in arrays)
        if targets > MOST_TARGETS:
            yield Fault(
                "objects", f"its arrays have {targets} targets; {MOST_TARGETS} are possible.", "Reduce them."
            )
        first: dict[str, int] = {}
        for index, item in enumerate(self.objects):
            if first.setdefault(item.name, index) != index:
                yield Fault(
                    f"objects.{index}.name",
                    f"'{item.name}' is already the name of objects[{first[item.name]}].",
                    "Give each object a name of its own.",
                )
        endless = _endless(self.objects)
        for index, item in enumerate(self.objects):
            if item.parent is not None and item.parent not in first:
                near = difflib.get_close_matches(item.parent, first, n=1, cutoff=0.5)
                yield Fault(
                    f"objects.{index}.parent",
                    f"there is no object '{item.parent}'.",
                    f"Did you mean '{near[0]}'?" if near else f"The scene's objects: {', '.join(first)}.",
                )
            elif item.name in endless:
                yield Fault(
                    f"objects.{index}.parent",
                    f"'{item.name}' is fixed to itself, by way of '{item.parent}'.",
                    "Let one object of the chain stand before the scanner.",
                )


def _endless(objects: tuple[SceneObject, ...]) -> set[str]:
    """Return the names of objects whose parents lead back to themselves, or go deeper than :data:`DEEPEST`."""
    parent = {item.name: item.parent for item in objects}
    found = set()
    for name in parent:
        at, steps = parent[name], 0
        while at is not None and at != name and steps <= DEEPEST:
            at, steps = parent.get(at), steps + 1
        if at is not None:
            found.add(name)
    return found
