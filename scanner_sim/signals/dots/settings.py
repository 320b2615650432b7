"""What a camera's processor knows of its frames, and the outcome of a dot."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_BLUR = 0.05
"""Least standard deviation of a point spread [pixel]; a sharper one does not matter beside the pixel."""


@dataclass(frozen=True)
class FrameCalibration:
    """What is believed of the sensor.

    Attributes
    ----------
    black
        Digital number of a pixel without light.
    electrons_per_number
        Gain [electron/DN].
    read_noise
        Noise of a pixel without light, quantisation apart [electron].
    saturation
        Digital number from which a pixel is not trusted.
    blur
        Standard deviation per axis of the point spread, the pixel apart [pixel].
    uneven
        Standard deviation of the pixels' responses, over their mean.
    """

    black: float
    electrons_per_number: float
    read_noise: float
    saturation: float
    blur: float
    uneven: float = 0.0

    @property
    def floor(self) -> float:
        """Variance of a pixel without light, with that of its steps [DN²]."""
        return (self.read_noise / self.electrons_per_number) ** 2 + 1.0 / 12.0

    def variance(self, numbers: Array) -> Array:
        """Return the variance [DN²] of pixels of mean numbers above black [DN]."""
        lit = np.maximum(numbers, 0.0)
        return self.floor + lit / self.electrons_per_number + (self.uneven * lit) ** 2


class DotStatus(IntEnum):
    """Outcome of one dot. The codes are stable: new ones are added at the end."""

    VALID = 0
    SATURATED = 1
    SHADOWED = 2
    TOO_SMALL = 3
    CLIPPED = 4
    NOT_ELLIPTICAL = 5
    AMBIGUOUS = 6
    NOT_FOUND = 7

    @property
    def sentence(self) -> str:
        """What the code says, in words."""
        return _SENTENCES[self]


_SENTENCES = {
    DotStatus.VALID: "a centre was measured",
    DotStatus.SATURATED: "the white around the dot reaches the end of the converter or the full well",
    DotStatus.SHADOWED: "the dot stands out of its surroundings by too little, or a shadow lies across it",
    DotStatus.TOO_SMALL: "the dot covers too few pixels for its centre to be fitted",
    DotStatus.CLIPPED: "the dot reaches the edge of the frame",
    DotStatus.NOT_ELLIPTICAL: "the outline is not the ellipse of a disc",
    DotStatus.AMBIGUOUS: "it could be more than one target of the array",
    DotStatus.NOT_FOUND: "no dot of the frame is this target",
}


def legend() -> dict[str, str]:
    """Return ``{code: "NAME: sentence"}`` for file headers."""
    return {str(int(member)): f"{member.name}: {member.sentence}" for member in DotStatus}
