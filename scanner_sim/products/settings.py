"""Which files a run writes."""

from __future__ import annotations

from typing import Literal

from scanner_sim.parts import Part


class Output(Part):
    """The files of the output folder."""

    pictures: bool = True
    """Write range.png, shaded.png and signal.png."""
    points: bool = True
    """Write points.ply."""
    compression: Literal["none", "rle", "zips", "zip", "piz"] = "zip"
    """Lossless compression of range.exr."""
