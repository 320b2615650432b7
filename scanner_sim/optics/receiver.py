"""The receiver: a lens that is kept parallel to the beam by the shared mirror."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Angle, Length, Ratio
from scanner_sim.optics.line_image import LineImage, line_image, sharp_everywhere

_WORD_OR_QUANTITY = Discriminator(
    lambda value: "(word)" if isinstance(value, str) and value.isalpha() else "(quantity)"
)

FocusChoice = Annotated[
    Annotated[Literal["infinity"], Tag("(word)")]
    | Annotated[Length, Field(gt=0.0, le=1e5), Tag("(quantity)")],
    _WORD_OR_QUANTITY,
    Field(examples=["500 mm", "infinity"]),
]
"""The range at which the image is sharp."""

TiltChoice = Annotated[
    Annotated[Literal["ideal", "scheimpflug"], Tag("(word)")]
    | Annotated[Angle, Field(ge=-1.4, le=1.4), Tag("(quantity)")],
    _WORD_OR_QUANTITY,
    Field(examples=["30 deg", "scheimpflug"]),
]
"""How the array is tilted."""


class Receiver(Part):
    """The receiving lens beside the laser.

    A thin lens without distortion or vignetting, ideal but for its aberration, a Gaussian spread of its rays. What the
    array sees sharply, and at which scale, follows from ``array_tilt`` and ``focus_distance``
    (:mod:`scanner_sim.optics.line_image`). Aberration and defocus are phases in the pupil: they widen the image of the
    beam, and move each grain of its speckle by as much.
    """

    baseline: Length = Field(gt=0.0, le=100.0)
    """Triangulation base d: from the laser's axis to the lens node."""
    focal_length: Length = Field(ge=1e-4, le=10.0)
    """Focal length f."""
    aperture: Length = Field(ge=1e-6)
    """Diameter of the aperture stop."""
    transmission: Ratio = Field(gt=0.0, le=1.0)
    """Transmission of lens and mirrors at the laser's wavelength, filter apart."""
    aberration: Length = Field(ge=0.0, le=1e-2)
    """Standard deviation per axis of the lens's rays, square to its axis, on the sensor: errors of the wavefront."""
    array_tilt: TiltChoice
    """Angle of the array against the plane of the lens, in the plane of triangulation: 0 is upright, and with a
    positive one near ranges have their image farther behind the lens. ``scheimpflug``: the one at which the whole beam
    is sharp while it is not deflected. ``ideal``: sharp at every range, on the scale of an upright array in the focal
    plane."""
    focus_distance: FocusChoice
    """Range at which the spot of the beam, not deflected, is sharp on the array. Without meaning for the tilts
    ``scheimpflug`` and ``ideal``."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield an aperture that is larger than the focal length, and what has no image on the array."""
        if self.aperture > self.focal_length:
            yield Fault(
                "aperture",
                f"{self.aperture:g} m is larger than the focal length of {self.focal_length:g} m, and "
                "no lens here is faster than f/1.",
                "Reduce the aperture, or raise focal_length.",
            )
        if isinstance(self.array_tilt, str):
            return
        if self.focus_distance != "infinity" and self.focus_distance <= self.focal_length:
            yield Fault(
                "focus_distance",
                f"{self.focus_distance:g} m is not beyond the focal length of {self.focal_length:g} m: "
                "the lens has no image of it.",
                "Write a longer distance, or infinity.",
            )
        elif self.line_image.depth < 0.1 * self.focal_length:
            yield Fault(
                "array_tilt",
                f"an array tilted by {math.degrees(self.array_tilt):.4g} deg that sees {self._focus} sharply would "
                "meet the lens where it should see infinity.",
                "Reduce the tilt, write scheimpflug, or raise focus_distance.",
            )

    @property
    def _focus(self) -> str:
        return "infinity" if self.focus_distance == "infinity" else f"{self.focus_distance:g} m"

    @property
    def line_image(self) -> LineImage:
        """How the lens images the plane of triangulation onto the array."""
        if self.array_tilt == "ideal":
            return sharp_everywhere(self.focal_length)
        tilt = None if self.array_tilt == "scheimpflug" else self.array_tilt
        focus = math.inf if self.focus_distance == "infinity" else self.focus_distance
        return line_image(self.focal_length, self.baseline, self.aperture, focus, tilt)

    @property
    def aperture_area(self) -> float:
        """Area of the aperture [m²]."""
        return math.pi / 4.0 * self.aperture**2
