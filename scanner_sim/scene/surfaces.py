"""What surfaces are of, as scenarios say it: a material of the library, a reflectance, a lobe, a file's colours."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, WithJsonSchema
from pydantic_core import PydanticCustomError

from scanner_sim.foundation.errors import printable
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Ratio
from scanner_sim.scene.materials import MATERIALS, UnknownMaterialError, material
from scanner_sim.scene.poses import Name
from scanner_sim.scene.retroreflectors import RetroLobe


class Surface(Part):
    """A Lambertian surface of given reflectance at the laser's wavelength."""

    reflectance: Ratio = Field(ge=0.0, le=1.0)
    """Hemispherical reflectance."""
    reflectance_out_of_band: Ratio | None = Field(default=None, ge=0.0, le=1.0)
    """The same in the rest of the detector's response; by default equal. It counts for sunlight only."""
    reflectance_visible: Ratio | None = Field(default=None, ge=0.0, le=1.0)
    """The same in visible light, for the video camera; by default that of 1.5 um, and ``check`` and ``run`` say so."""
    depolarisation: Ratio = Field(default=1.0, ge=0.0, le=1.0)
    """Share of the reflected laser light that has lost its polarisation: 0 makes the strongest speckle, of contrast 1,
    1 the weakest, of contrast 0.71."""
    name: Name | None = Field(default=None, examples=["paint"])
    """Name by which results know it; by default it is made of the numbers."""

    @property
    def known_as(self) -> str:
        """Name by which results know it."""
        unlike = None if self.depolarisation == 1.0 else f"depolarising_{self.depolarisation}"
        return self.name or _spelt("reflectance", self.reflectance, self.reflectance_out_of_band, unlike)


class Retroreflector(RetroLobe):
    """A surface that sends part of its light back the way it came."""

    type: Literal["retroreflector"]
    """``retroreflector``."""
    reflectance: Ratio = Field(ge=0.0, le=1.0)
    """Hemispherical reflectance, lobe and diffuse base together."""
    reflectance_out_of_band: Ratio | None = Field(default=None, ge=0.0, le=1.0)
    """The same in the rest of the detector's response; by default equal. It counts for sunlight only."""
    reflectance_visible: Ratio | None = Field(default=None, ge=0.0, le=1.0)
    """The same in visible light, for the video camera; by default that of 1.5 um, and ``check`` and ``run`` say so."""
    name: Name | None = Field(default=None, examples=["tape"])
    """Name by which results know it; by default it is made of the numbers."""

    @property
    def lobe(self) -> RetroLobe:
        """The lobe by itself."""
        return RetroLobe(**{name: getattr(self, name) for name in RetroLobe.model_fields})

    @property
    def known_as(self) -> str:
        """Name by which results know it."""
        numbers = (self.reflectance, self.reflectance_out_of_band, self.retro_share, self.half_width)
        return self.name or _spelt("retroreflector", self.kind, *numbers, self.entrance[1])


class FileColours(Part):
    """A Lambertian surface as bright as the colours in the mesh's file: its textures, and its plain colours.

    Reflectance = scale · Y, with Y the luminance of linear red, green and blue, 0.2126 R + 0.7152 G + 0.0722 B (ITU-R
    BT.709-6, item 3.2); textures are decoded from sRGB first (IEC 61966-2-1). That a surface is at 1.5 µm what it is to
    the eye is an assumption, and a poor one for paints and dyes. In visible light, for the video camera, it is Y.
    """

    type: Literal["file_colours"]
    """``file_colours``."""
    scale: Ratio = Field(default=1.0, ge=0.0, le=1.0)
    """Reflectance at the laser's wavelength of what is white in the file."""
    name: Name | None = Field(default=None, examples=["painted"])
    """Name by which results know it; by default ``file_colours``."""

    @property
    def known_as(self) -> str:
        """Name by which results know it."""
        return self.name or "file_colours"


def _spelt(*parts: object) -> str:
    return "_".join(str(part) for part in parts if part is not None)


_LIBRARY = WithJsonSchema({"type": "string", "enum": list(MATERIALS)})


def _check_material(name: str) -> str:
    try:
        return material(name).name
    except UnknownMaterialError as error:
        raise PydanticCustomError(
            "material", "{problem} {remedy}", {"problem": printable(error.message), "remedy": error.remedy}
        ) from None


def _spelling_of_material(value: Any) -> str:
    if isinstance(value, str):
        return "(word)"
    typed = value.get("type") if isinstance(value, dict) else getattr(value, "type", None)
    if typed is None:
        return "(surface)"
    return "(file_colours)" if typed == "file_colours" else "(retroreflector)"


MaterialChoice = Annotated[
    Annotated[str, AfterValidator(_check_material), _LIBRARY, Tag("(word)")]
    | Annotated[Surface, Tag("(surface)")]
    | Annotated[Retroreflector, Tag("(retroreflector)")],
    Discriminator(_spelling_of_material),
    Field(examples=["z93_white", {"reflectance": 0.5}]),
]
"""Name of a material of the library, a reflectance, or a retro-reflector."""

MeshMaterial = Annotated[
    Annotated[str, AfterValidator(_check_material), _LIBRARY, Tag("(word)")]
    | Annotated[Surface, Tag("(surface)")]
    | Annotated[Retroreflector, Tag("(retroreflector)")]
    | Annotated[FileColours, Tag("(file_colours)")],
    Discriminator(_spelling_of_material),
    Field(examples=["z93_white", {"reflectance": 0.5}]),
]
"""What a mesh may be of: a material as of any object, or the colours in its file."""
Pattern = Annotated[str, Field(min_length=1, max_length=200)]
