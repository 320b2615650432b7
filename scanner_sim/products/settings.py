"""Which files a run writes."""

from __future__ import annotations

from typing import Literal

from scanner_sim.parts import Part, Switch


class Output(Part):
    """The files of the output folder."""

    pictures: Switch = True
    """Write range.png, shaded.png and signal.png, and under the Sun background.png and camera.png."""
    points: Switch = True
    """Write points.ply."""
    compression: Literal["none", "rle", "zips", "zip", "piz"] = "zip"
    """Lossless compression of range.exr."""
