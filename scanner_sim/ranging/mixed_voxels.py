"""Mixed voxels: spots that fall on more than one surface, as the ranges of their neighbours tell."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.ranging.neighbours import Chosen, grown
from scanner_sim.ranging.shared_noise import SharedNoise
from scanner_sim.ranging.uneven import REACH, Raster, ring_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_NOISE_SIGMAS = 4.5
"""Standard deviations of noise by which two ranges may differ beyond the slope: in 200 comparisons once in 700."""
_UNEVEN_SIGMAS = 2.0
"""The same of what unevenness may move them by."""
_SURELY = 0.999
"""Share of a limit below which rounding makes nothing of it."""


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
    steps, alike = raster.steps(REACH), height < faintest
    bordered = np.pad(height, steps, constant_values=np.nan)
    # Few voxels are faint, and fewer after each ring about them.
    for ring in range(1, steps + 1):
        chosen = Chosen(alike, steps)
        place, here = raster.at(chosen), chosen.here(height)
        limit = _NOISE_SIGMAS * np.sqrt(2.0 * (1.0 + chosen.here(speckle) * here**2))
        as_high = np.ones(here.shape, dtype=np.bool_)
        for down, right in ring_of(ring):
            apart = np.abs(chosen.there(bordered, down, right) - here)
            as_high &= (apart <= limit) | ~_is_near(down, right, place)
        chosen.put(alike, as_high)
    return alike


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
    steps, rise = raster.steps(REACH), math.tan(steepest)
    ranges, own, doubts = (np.pad(image, steps, constant_values=np.nan) for image in (r, noise.own, doubt))
    is_hidden = np.asarray(status) == Status.BELOW_THRESHOLD
    missing, hidden = np.pad(~valid, steps), np.pad(is_hidden, steps)
    found = np.zeros(r.shape, dtype=np.bool_)
    for ring, may_differ in enumerate(_may_differ(r, noise, doubt, raster, rise), start=1):
        chosen = Chosen(may_differ & ~found, steps)
        place, shared = raster.at(chosen), noise.at(chosen)
        here, doubted, unsure = (chosen.here(image) for image in (r, doubt, faint))
        differs = np.zeros(here.shape, dtype=np.bool_)
        for down, right in ring_of(ring):
            there = chosen.there(ranges, down, right)
            limit = rise * np.hypot(right * place.across, down * place.down) * np.fmin(1.0, there / here)
            chance = shared.own + chosen.there(own, down, right) + shared.apart(down, right)
            explained = _NOISE_SIGMAS**2 * chance + doubted + chosen.there(doubts, down, right)
            limit += np.sqrt(np.fmax(explained, 0.0))
            nothing = chosen.there(missing, down, right) & ~(unsure & chosen.there(hidden, down, right))
            differs |= _is_near(down, right, place) & ((np.abs(there - here) > limit) | nothing)
        chosen.put(found, differs)
    return found


def _may_differ(r: Array, noise: SharedNoise, doubt: Array, raster: Raster, rise: float) -> Iterator[Mask]:
    """Yield, for each ring of neighbours, which voxels differ from one in it for all that can be told quickly.

    They do not where the ranges of all about differ by less than the least of the limits: what the surface rises up to
    the nearest of the ring, its own noise, the least that speckle adds, and its own unevenness.
    """
    # A range that is missing counts for one beyond all.
    least = largest = np.where(np.isfinite(r), r, np.inf)
    pitch = np.fmin(raster.across, raster.down)
    for ring in range(1, raster.steps(REACH) + 1):
        least, largest = grown(least, np.minimum), grown(largest, np.maximum)
        chance = np.fmax(noise.own + noise.least_apart(ring), 0.0)
        limit = rise * ring * pitch * np.fmin(1.0, least / r) + np.sqrt(_NOISE_SIGMAS**2 * chance + doubt)
        may = np.fmax(largest - r, r - least) > _SURELY * limit
        yield may if ring == 1 else may & ((ring - 1) * pitch < REACH * raster.spot)
