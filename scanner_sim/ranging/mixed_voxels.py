"""Mixed voxels: spots that fall on more than one surface, as the ranges of their neighbours tell."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.ranging.neighbours import neighbour_values
from scanner_sim.ranging.shared_noise import SharedNoise
from scanner_sim.ranging.uneven import REACH, Raster, around

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_NOISE_SIGMAS = 4.5
"""Standard deviations of noise by which two ranges may differ beyond the slope: in 200 comparisons once in 700."""
_UNEVEN_SIGMAS = 2.0
"""The same of what unevenness may move them by."""


def is_faint(height: Array, faintest: float, speckle: Array, raster: Raster) -> Mask:
    """Tell which voxels lie on a surface so faint that noise alone may hide their neighbours.

    A spot of which only the edge meets a surface, or of which the lens sees only the edge, is faint too, but light that
    is brighter or much darker stands beside it, or where the raster ends may stand there: what hides the neighbours is
    then where the surface ends, or its shadow begins.

    Parameters
    ----------
    height
        Heights of the peaks over the noise, of all voxels whatever their status, shape (rows, columns).
    faintest
        Height below which noise may hide another of the same light.
    speckle
        Relative variance of the heights by speckle.
    raster
        Geometry.

    Returns
    -------
    array of bool, shape (rows, columns)
        All voxels within 2.5 standard deviations of the spot, and the eight neighbours, are in the raster and as high
        but for noise.
    """
    alike = np.ones(height.shape, dtype=np.bool_)
    limit = _NOISE_SIGMAS * np.sqrt(2.0 * (1.0 + speckle * height**2))
    for down, right in around(raster.steps(REACH)):
        apart = np.abs(neighbour_values(height, down, right) - height)
        alike &= (apart <= limit) | ~_is_near(down, right, raster)
    return np.asarray((height < faintest) & alike)


def _is_near(down: int, right: int, raster: Raster) -> Mask:
    """Tell where a neighbour's spot may meet what one's own does."""
    before = np.hypot(max(abs(right) - 1, 0) * raster.across, max(abs(down) - 1, 0) * raster.down)
    return np.asarray((before < REACH * raster.spot) | (max(abs(down), abs(right)) == 1))


def is_mixed(
    range_m: Array,
    noise: SharedNoise,
    uneven: Array,
    status: NDArray[np.unsignedinteger],
    faint: Mask,
    raster: Raster,
    steepest: float,
) -> Mask:
    """Tell which voxels of a raster image hold light of more than one surface.

    A voxel is mixed if, within 2.5 standard deviations of the spot or among its eight neighbours, there is a voxel
    whose range differs by more than a surface inclined by ``steepest`` rises and noise and unevenness explain, or one
    that has no range, for the surface then ends between them.

    Parameters
    ----------
    range_m
        Ranges [m], shape (rows, columns).
    noise
        Variances of their noise [m²].
    uneven
        Standard deviations by what light that is uneven over the spot may do [m].
    status
        Status codes.
    faint
        Voxels so faint that noise alone may hide their neighbours: of those, neighbours below the threshold say
        nothing.
    raster
        Geometry.
    steepest
        Inclination [rad], below π/2.
    """
    valid = np.asarray(status) == Status.VALID
    r = np.where(valid, range_m, np.nan)
    doubt = np.where(valid, (_UNEVEN_SIGMAS * uneven) ** 2, np.nan)
    missing = (~valid).astype(np.float64)
    hidden = (np.asarray(status) == Status.BELOW_THRESHOLD).astype(np.float64)
    rise = math.tan(steepest)
    found = np.zeros(r.shape, dtype=np.bool_)
    for down, right in around(raster.steps(REACH)):
        there, apart = neighbour_values(r, down, right), np.hypot(right * raster.across, down * raster.down)
        limit = rise * apart * np.fmin(1.0, there / r)
        chance = noise.of({(0, 0): -1.0, (down, right): 1.0})
        limit += np.sqrt(_NOISE_SIGMAS**2 * chance + doubt + neighbour_values(doubt, down, right))
        nothing = (neighbour_values(missing, down, right) == 1.0) & ~(
            faint & (neighbour_values(hidden, down, right) == 1.0)
        )
        found |= _is_near(down, right, raster) & ((np.abs(there - r) > limit) | nothing)
    return np.asarray(valid & found)
