"""Objects of a scene: shapes, meshes, target arrays and Mitsuba files, each with a pose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from scanner_sim.frames import pose_matrix, rotation_about
from scanner_sim.parts import Part
from scanner_sim.units import Angle, Length, Ratio

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]
Position = tuple[Length, Length, Length]
Extent = Annotated[Length, Field(gt=0.0)]
Axis = Literal["x", "y", "z"] | tuple[float, float, float]


class Rotation(Part):
    """A turn about an axis through the object's origin (right-handed)."""

    axis: Axis
    """``x``, ``y``, ``z`` or a vector."""
    angle: Angle
    """Angle of the turn."""

    @model_validator(mode="after")
    def _axis_has_a_direction(self) -> Self:
        if not isinstance(self.axis, str) and not np.linalg.norm(self.axis) > 0.0:
            raise PydanticCustomError("rotation_axis", "the axis (0, 0, 0) has no direction")
        return self

    def matrix(self) -> NDArray[np.float64]:
        """Return the rotation matrix, shape (3, 3)."""
        axis = np.eye(3)["xyz".index(self.axis)] if isinstance(self.axis, str) else self.axis
        return rotation_about(axis, self.angle)


class Surface(Part):
    """A Lambertian surface of given reflectance at the laser's wavelength."""

    reflectance: Ratio = Field(ge=0.0, le=1.0)
    """Hemispherical reflectance."""


MaterialChoice = str | Surface
"""Name of a material of the library, or a reflectance."""


class Posed(Part):
    """What every object has: a name and a pose."""

    name: Name
    """Name, unique in the scene; it appears in the truth layer."""
    position: Position = (0.0, 0.0, 0.0)
    """Place of the object's origin in the scanner frame."""
    rotation: Rotation | tuple[Rotation, ...] = ()
    """Turns about the object's origin, the first one first."""

    def scanner_from_object(self) -> NDArray[np.float64]:
        """Return the pose as a 4 × 4 matrix."""
        turns = (self.rotation,) if isinstance(self.rotation, Rotation) else self.rotation
        total = np.eye(3)
        for turn in turns:
            total = turn.matrix() @ total
        return pose_matrix(total, self.position)


class Rectangle(Posed):
    """A flat rectangle that faces the scanner."""

    shape: Literal["rectangle"]
    size: tuple[Extent, Extent]
    """Width and height."""
    material: MaterialChoice
    """Material of both sides."""


class Disc(Posed):
    """A flat disc that faces the scanner."""

    shape: Literal["disc"]
    diameter: Length = Field(gt=0.0)
    """Diameter."""
    material: MaterialChoice
    """Material of both sides."""


class Sphere(Posed):
    """A sphere about the origin."""

    shape: Literal["sphere"]
    diameter: Length = Field(gt=0.0)
    """Diameter."""
    material: MaterialChoice
    """Material."""


class Box(Posed):
    """A box about the origin."""

    shape: Literal["box"]
    size: tuple[Extent, Extent, Extent]
    """Extent in x, y and z."""
    material: MaterialChoice
    """Material."""


class Cylinder(Posed):
    """A closed cylinder about the origin, its axis along y."""

    shape: Literal["cylinder"]
    diameter: Length = Field(gt=0.0)
    """Diameter."""
    length: Length = Field(gt=0.0)
    """Length along the axis."""
    material: MaterialChoice
    """Material."""


class Mesh(Posed):
    """A mesh from a PLY, OBJ or STL file."""

    mesh: Path
    """File, relative to the scenario's folder."""
    length_unit: Length = Field(default=1.0, gt=0.0)
    """Length of one unit of the file: ``1 mm`` for a mesh drawn in millimetres."""
    material: MaterialChoice
    """Material."""


class MitsubaFile(Posed):
    """The shapes of a Mitsuba XML scene, moved as one body; its own materials stay."""

    file: Path
    """XML file, relative to the scenario's folder."""


class TargetPattern(Part):
    """An array of circular targets in the plane z = 0, centred on the origin."""

    diameter: Length = Field(gt=0.0)
    """Diameter of each disc."""
    rows: int = Field(default=1, ge=1, le=1000)
    """Targets from top to bottom."""
    columns: int = Field(default=1, ge=1, le=1000)
    """Targets from left to right."""
    spacing: tuple[Extent, Extent] = (1.0, 1.0)
    """Distance of the centres, horizontally and vertically."""
    plate: Length = Field(gt=0.0)
    """Edge of the square plate around each disc."""


class TargetArray(Posed):
    """An array of circular targets, each a disc in a square plate."""

    array: TargetPattern
    """Size and layout."""
    disc: MaterialChoice = "target_black"
    """Material of the discs."""
    material: MaterialChoice = "target_white"
    """Material of the plates."""


_KINDS = ("shape", "mesh", "array", "file")


def _kind(value: Any) -> str | None:
    """Return the tag of an object: which of the four keys it has, and for shapes which shape."""
    get = value.get if isinstance(value, dict) else lambda key: getattr(value, key, None)
    found = [key for key in _KINDS if get(key) is not None]
    if len(found) != 1:
        return None
    return str(get("shape")) if found == ["shape"] else found[0]


SceneObject = Annotated[
    Annotated[Rectangle, Tag("rectangle")]
    | Annotated[Disc, Tag("disc")]
    | Annotated[Sphere, Tag("sphere")]
    | Annotated[Box, Tag("box")]
    | Annotated[Cylinder, Tag("cylinder")]
    | Annotated[Mesh, Tag("mesh")]
    | Annotated[MitsubaFile, Tag("file")]
    | Annotated[TargetArray, Tag("array")],
    Discriminator(
        _kind,
        custom_error_type="object_kind",
        custom_error_message=(
            "an object has exactly one of the keys shape (rectangle, disc, sphere, box, cylinder), mesh, "
            "array and file"
        ),
    ),
]
"""Any object of a scene."""


class Scene(Part):
    """What stands before the scanner."""

    file: Path | None = None
    """Mitsuba XML scene in the scanner's frame, relative to the scenario's folder."""
    objects: tuple[SceneObject, ...] = ()
    """Objects, each with its pose."""

    @model_validator(mode="after")
    def _names_are_unique(self) -> Self:
        names = [item.name for item in self.objects]
        for name in names:
            if names.count(name) > 1:
                raise PydanticCustomError(
                    "object_name", "two objects are called '{name}'; give each a name of its own",
                    {"name": name},
                )
        return self
