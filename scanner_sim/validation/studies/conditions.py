"""The conditions of ambient illumination of Table 1 (Blais, Beraldin, El-Hakim 2000), and what counts as which.

The paper names the conditions and says how much of an orbit each takes, but not where one ends and the next begins:
the thresholds here are assumptions, and they are few.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

LIT: Final = 0.95
"""Share of a target's visible surface in sunlight from which it counts as wholly lit."""
SHADED: Final = 0.05
"""Share below which it counts as wholly in shadow."""
ECLIPSED: Final = 0.01
"""Share of the Sun's disc below which it is dark."""


class Condition(IntEnum):
    """The six conditions, in the order of Table 1; the number stands in files: never renumber."""

    NORMAL = 0
    PARTIAL_SHADOW = 1
    FULL_SHADOW = 2
    SATURATION = 3
    NO_LIGHT = 4
    BACK_ILLUMINATION = 5

    @property
    def words(self) -> str:
        """The condition in a few words."""
        return _WORDS[self]

    @property
    def meaning(self) -> str:
        """What counts as the condition, in one sentence."""
        return _MEANING[self]


_WORDS = {
    Condition.NORMAL: "normal",
    Condition.PARTIAL_SHADOW: "partial target shadow",
    Condition.FULL_SHADOW: "full target shadow",
    Condition.SATURATION: "saturation in the field of view",
    Condition.NO_LIGHT: "no light",
    Condition.BACK_ILLUMINATION: "back illumination",
}

_MEANING = {
    Condition.NORMAL: f"the Sun shines on {LIT:.0%} or more of what the scanner sees of the target",
    Condition.PARTIAL_SHADOW: f"the Sun shines on {SHADED:.0%} to {LIT:.0%} of it",
    Condition.FULL_SHADOW: f"the Sun shines on less than {SHADED:.0%} of it: something shades it, or it faces away",
    Condition.SATURATION: "sunlight from a surface in the field of view fills a pixel's well",
    Condition.NO_LIGHT: f"the Earth hides the Sun but for less than {ECLIPSED:.0%} of its disc, or there is none",
    Condition.BACK_ILLUMINATION: "a pixel looks into the Sun somewhere in the scan",
}


class PublishedShare(NamedTuple):
    """What the paper estimates for an orbit: a share in words, and the conditions that it covers."""

    name: str
    share: str
    conditions: tuple[Condition, ...]


ESTIMATES: Final = (
    PublishedShare("normal", "60 %", (Condition.NORMAL,)),
    PublishedShare("shadow", "35 %", (Condition.PARTIAL_SHADOW, Condition.FULL_SHADOW)),
    PublishedShare("saturation and poor illumination", "< 5 %", (Condition.SATURATION, Condition.NO_LIGHT)),
    PublishedShare("back illumination", "< 1 %", (Condition.BACK_ILLUMINATION,)),
)
"""The paper's four figures. It does not say where the eclipse counts, a third of a low orbit: with "no light" as
here it cannot fit below 5 %. The 35 % of "shadow conditions" may well be the Earth's own shadow."""


def classify(
    sun_visible: ArrayLike,
    sun_in_view: ArrayLike,
    brightest: ArrayLike,
    full_well: float,
    lit: ArrayLike,
) -> NDArray[np.uint8]:
    """Return the condition of each moment, as numbers of :class:`Condition`.

    Of several the gravest counts: dark, then back illumination, saturation, and shadow by its share.

    Parameters
    ----------
    sun_visible
        Share of the Sun's disc that the Earth leaves visible, 0 to 1.
    sun_in_view
        Share of it that some pixel sees somewhere in the scan, 0 to 1.
    brightest
        Largest charge of sunlight from a surface in the field of view, in a pixel and dwell [electron].
    full_well
        Charge at which a pixel saturates [electron].
    lit
        Share of the target's visible surface in sunlight, 0 to 1.

    Returns
    -------
    ndarray
        Shape of the arguments broadcast together, uint8.
    """
    visible, in_view, charge, share = np.broadcast_arrays(sun_visible, sun_in_view, brightest, lit)
    tests = [visible < ECLIPSED, in_view > 0.0, charge >= full_well, share < SHADED, share < LIT]
    found = [
        Condition.NO_LIGHT,
        Condition.BACK_ILLUMINATION,
        Condition.SATURATION,
        Condition.FULL_SHADOW,
        Condition.PARTIAL_SHADOW,
    ]
    return np.asarray(np.select(tests, found, default=Condition.NORMAL), dtype=np.uint8)
