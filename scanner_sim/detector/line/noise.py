"""Which imperfections of a detector are simulated."""

from __future__ import annotations

from scanner_sim.foundation.parts import Part, Switch


class NoiseSwitches(Part):
    """A switch for every term of the position sensor's noise; all on by default."""

    shot: Switch = True
    """Poisson noise of the light and of the dark charge."""
    read: Switch = True
    """Read noise."""
    dark: Switch = True
    """Dark current: its mean charge (its noise belongs to ``shot``)."""
    prnu: Switch = True
    """Response of each pixel that differs from the mean."""
    saturation: Switch = True
    """Full well and end of the converter."""
    quantisation: Switch = True
    """Whole numbers of the analogue-digital converter."""

    def only(self, *kept: str) -> NoiseSwitches:
        """Return the switches with all terms off but some, which stay as they are."""
        return self.model_copy(update={name: False for name in type(self).model_fields if name not in kept})
