"""What a surface leaves of the laser's polarisation, and what speckle follows from that."""

from __future__ import annotations

import math


def speckle_contrast(depolarisation: float) -> float:
    """Return the contrast of the speckle in laser light that a surface has depolarised in part.

    Parameters
    ----------
    depolarisation
        Share of the light that has lost its polarisation, 0 to 1.

    Returns
    -------
    float
        C = √((1 + P²)/2) with the degree of polarisation P = 1 − share, dimensionless.

    Notes
    -----
    Goodman, *Speckle phenomena in optics*, 2007, section 3.4.
    """
    return math.sqrt(0.5 * (1.0 + (1.0 - depolarisation) ** 2))
