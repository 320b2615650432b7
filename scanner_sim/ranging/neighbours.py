"""Neighbours in the raster: a range that agrees with none of them is no surface."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status

_FEWEST_NEIGHBOURS = 3
"""Neighbours with a range that it takes to call a voxel isolated: fewer may all be another surface's."""


def is_isolated(
    range_m: NDArray[np.floating],
    sigma_m: NDArray[np.floating],
    status: NDArray[np.unsignedinteger],
    theta: NDArray[np.float64],
    phi: NDArray[np.float64],
    sigmas: float,
    steepest: float,
) -> NDArray[np.bool_]:
    """Tell which voxels of a raster image have a range that none of their eight neighbours shares.

    Two ranges agree if they differ by no more than ``sigmas`` standard deviations of their difference and what
    a surface inclined by ``steepest`` rises between them, R · δ · tan(steepest), δ being the angle between the
    two beams. One neighbour that agrees is enough, so that a rail one voxel wide stays; neighbours without a
    range say nothing.

    Parameters
    ----------
    range_m, sigma_m
        Ranges and their standard deviations [m], NaN where there is none, shape (rows, columns).
    status
        Status codes, same shape.
    theta, phi
        Deflections of the columns and of the rows [rad], shapes (columns,) and (rows,).
    sigmas
        Number of standard deviations.
    steepest
        Inclination [rad], below π/2.

    Returns
    -------
    array of bool, shape (rows, columns)
        Only voxels with a range are ever isolated.
    """
    valid = np.asarray(status) == Status.VALID
    r = np.where(valid, range_m, np.nan).astype(np.float64)
    variance = np.where(valid, sigma_m, np.nan).astype(np.float64) ** 2
    rise = math.tan(steepest)
    others = np.zeros(r.shape, dtype=np.int64)
    agree = np.zeros(r.shape, dtype=np.bool_)
    # Each pair of neighbours is looked at once, and counts for both.
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here, there = _pair(r.shape, down, right)
        apart = np.hypot(*np.ix_(_steps(phi, down), _steps(theta, right)))
        limit = rise * apart * np.fmin(r[here], r[there])
        limit += sigmas * np.sqrt(variance[here] + variance[there])
        close = np.abs(r[here] - r[there]) <= limit
        both = valid[here] & valid[there]
        for one in (here, there):
            others[one] += both
            agree[one] |= close
    alone: NDArray[np.bool_] = valid & (others >= _FEWEST_NEIGHBOURS) & ~agree
    return alone


def neighbour_values(values: NDArray[np.float64], down: int, right: int) -> NDArray[np.float64]:
    """Return the values some rows further down and columns further right, NaN beyond the image; same shape."""
    rows, columns = values.shape
    shifted = np.full(values.shape, np.nan)
    if abs(down) < rows and abs(right) < columns:
        to = (slice(max(0, -down), rows - max(0, down)), slice(max(0, -right), columns - max(0, right)))
        at = (slice(max(0, down), rows - max(0, -down)), slice(max(0, right), columns - max(0, -right)))
        shifted[to] = values[at]
    return shifted


def _pair(shape: tuple[int, ...], down: int, right: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the slices of an image and of its neighbours some rows further down and columns further right."""
    rows, columns = shape
    left = max(0, -right)
    here = (slice(0, rows - down), slice(left, columns - max(0, right)))
    there = (slice(down, rows), slice(left + right, columns - max(0, right) + right))
    return here, there


def _steps(angles: NDArray[np.float64], distance: int) -> NDArray[np.float64]:
    """Return the angle from each position to the one some positions further on, shape (n − |distance|,)."""
    if distance == 0:
        return np.zeros(len(angles))
    return angles[abs(distance) :] - angles[: -abs(distance)]
