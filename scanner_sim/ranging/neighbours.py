"""Neighbours in the raster: a range that agrees with none of them is no surface."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status

Stencil = Mapping[tuple[int, int], float]
"""Weights of the voxels some rows further down and columns further right."""
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
    here, there = _pair(values.shape, down, right)
    shifted = np.full(values.shape, np.nan)
    shifted[here] = values[there]
    return shifted


def weighted_sum(values: NDArray[np.float64], stencil: Stencil) -> NDArray[np.float64]:
    """Return a weighted sum of voxels about each; NaN where one is missing or beyond the image; same shape."""
    rows, columns = (
        range(max(0, -min(steps)), size - max(0, *steps))
        for size, steps in zip(values.shape, zip(*stencil, strict=True), strict=True)
    )
    within = np.zeros((len(rows), len(columns)))
    for (down, right), weight in stencil.items():
        row, column = rows.start + down, columns.start + right
        within += weight * values[row : row + len(rows), column : column + len(columns)]
    total = np.full(values.shape, np.nan)
    total[rows.start : rows.start + len(rows), columns.start : columns.start + len(columns)] = within
    return total


class Chosen:
    """Some voxels of an image, and their neighbours, looked up without going through the whole image.

    Parameters
    ----------
    where
        Which, shape (rows, columns).
    reach
        How many rows and columns away neighbours are looked up, at most.
    """

    def __init__(self, where: NDArray[np.bool_], reach: int) -> None:
        columns = where.shape[1]
        self._at = np.flatnonzero(where)
        self._reach, self._width = reach, columns + 2 * reach
        self._corner = self._at + self._at // max(columns, 1) * (2 * reach)

    def here(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return their own values, shape (n,)."""
        return np.asarray(np.take(image, self._at))

    def put(self, image: NDArray[Any], values: NDArray[Any]) -> None:
        """Write values of shape (n,) into their own places."""
        np.put(image, self._at, values)

    def there(self, bordered: NDArray[Any], down: int, right: int) -> NDArray[Any]:
        """Return values some rows further down and columns further right, shape (n,).

        ``bordered`` is an image with as many more voxels on each side as the reach is.
        """
        shift = (self._reach + down) * self._width + self._reach + right
        return np.asarray(np.take(bordered.ravel()[shift:], self._corner))


def grown(image: NDArray[Any], extreme: np.ufunc) -> NDArray[Any]:
    """Return the least or the largest (``extreme``) of each voxel and its eight neighbours in the image."""
    tall = image.copy()
    extreme(tall[1:], image[:-1], out=tall[1:])
    extreme(tall[:-1], image[1:], out=tall[:-1])
    wide = tall.copy()
    extreme(wide[:, 1:], tall[:, :-1], out=wide[:, 1:])
    extreme(wide[:, :-1], tall[:, 1:], out=wide[:, :-1])
    return wide


def _pair(shape: tuple[int, ...], down: int, right: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return the slices of the voxels that have a neighbour so far away in the image, and of these neighbours."""
    (row, row_there), (column, column_there) = _overlapping(shape[0], down), _overlapping(shape[1], right)
    return (row, column), (row_there, column_there)


def _overlapping(size: int, step: int) -> tuple[slice, slice]:
    """Return the slices of the places that have one some steps further on, and of these."""
    if abs(step) >= size:
        return slice(0, 0), slice(0, 0)
    return slice(max(0, -step), size - max(0, step)), slice(max(0, step), size - max(0, -step))


def _steps(angles: NDArray[np.float64], distance: int) -> NDArray[np.float64]:
    """Return the angle from each position to the one some positions further on, shape (n − |distance|,)."""
    if distance == 0:
        return np.zeros(len(angles))
    return angles[abs(distance) :] - angles[: -abs(distance)]
