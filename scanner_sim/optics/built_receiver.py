"""The receiving lens as it was built: its array stands where it was mounted, and not where the design's sums put it."""

from __future__ import annotations

import math
from dataclasses import replace

from scanner_sim.optics.line_image import LineImage
from scanner_sim.optics.receiver import Receiver


def departed_image(design: LineImage, longer: float, tilt: float) -> LineImage:
    """Return the image on an array that stands farther behind the lens [m], and leans further away [rad]."""
    if longer == 0.0 and tilt == 0.0:
        return design
    return replace(design, depth=design.depth + longer, slope=math.tan(math.atan(design.slope) + tilt))


class BuiltReceiver(Receiver):
    """A receiver whose base, image distance and tilt of the array are not those of its design."""

    image: LineImage
    """How the lens images the plane of triangulation onto the array where it is."""

    @classmethod
    def of(cls, design: Receiver, base: float, longer: float, tilt: float) -> BuiltReceiver:
        """Return a receiver with a longer base [m] and image distance [m], and an array that leans further [rad]."""
        values = dict(design) | {"baseline": design.baseline + base}
        return cls.model_construct(**values, image=departed_image(design.line_image, longer, tilt))

    @property
    def line_image(self) -> LineImage:
        """How the lens images the plane of triangulation onto the array."""
        return self.image
