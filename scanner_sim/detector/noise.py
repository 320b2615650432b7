"""Which imperfections of a detector are simulated."""

from __future__ import annotations

from scanner_sim.parts import Part


class NoiseSwitches(Part):
    """A switch for every term of the position sensor's noise; all on by default."""

    shot: bool = True
    """Poisson noise of the light and of the dark charge."""
    read: bool = True
    """Read noise."""
    dark: bool = True
    """Dark current: its mean charge (its noise belongs to ``shot``)."""
    prnu: bool = True
    """Response of each pixel that differs from the mean."""
    saturation: bool = True
    """Full well and end of the converter."""
    quantisation: bool = True
    """Whole numbers of the analogue-digital converter."""
