"""The step in which a format of whole numbers holds coordinates, from what the instrument states of their σ."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.products.formats.cloud import Cloud

LARGEST_COUNT = 2**31 - 1
"""Steps from the offset to a coordinate."""
STEPS_OF_SIGMA = 10.0
"""Steps of a coordinate in its least σ: their rounding adds less than one part in a thousand to it."""
UNSTATED = 1e-6
"""Step [m] where no σ is stated."""
FINEST, COARSEST = 1e-9, 1.0
"""Scales between which one is chosen [m]."""


def scale_of(cloud: Cloud) -> tuple[float, NDArray[np.float64], float]:
    """Return the step of the coordinates [m], their offset, shape (3,) [m], and the least σ [m], which may be NaN."""
    points = cloud.points[cloud.valid].astype(np.float64)
    stated = cloud.sigma[cloud.valid]
    stated = stated[np.isfinite(stated) & (stated > 0.0)]
    least = float(stated.min()) if stated.size else math.nan
    if not len(points):
        return UNSTATED, np.zeros(3), least
    low, high = points.min(axis=0), points.max(axis=0)
    offset = np.rint((low + high) / 2.0) + 0.0  # no negative zero
    span = float(np.abs(np.stack([low, high]) - offset).max())
    wanted = UNSTATED if math.isnan(least) else min(max(least / STEPS_OF_SIGMA, FINEST), COARSEST)
    exponent = math.floor(math.log10(wanted) + 1e-9)
    while span / float(f"1e{exponent}") > LARGEST_COUNT:
        exponent += 1
    return float(f"1e{exponent}"), offset, least


def check_scale(cloud: Cloud) -> None:
    """Refuse coordinates whose steps would be coarser than the least σ.

    Raises
    ------
    InputError
        If they reach that far.
    """
    scale, _, least = scale_of(cloud)
    if scale > least:
        reach = float(np.abs(cloud.points[cloud.valid]).max())
        raise InputError(
            f"points as far as {reach:.3g} m do not fit into the 32 bits of LAS in steps finer than their least σ, "
            f"{least:.2g} m: these would be of {scale:g} m.",
            remedy="Write e57 or pcd, which hold floating-point numbers, or scan near and far apart.",
        )
