"""The range of a target: that of a plane through the voxels on it or around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import applied, inverse, product
from scanner_sim.tracking.centroid import Centroid
from scanner_sim.tracking.plane import TargetPlane
from scanner_sim.tracking.response import Response, TargetKind
from scanner_sim.tracking.samples import PatternSamples

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CAP_SHARE = 0.8
"""Part of a sphere's radius within which its range is looked at."""
_FEWEST = 5
"""Voxels that tell a range, its slopes and its rise in time."""
_FEWEST_PLAIN = 6
"""Voxels beside a retro-reflector that tell its range, with some to spare."""
_FOUR = np.eye(4)


@dataclass(frozen=True)
class Ranges:
    """Ranges of planes through voxels.

    Attributes
    ----------
    about
        (Θ, φ) at which they are told [rad], shape (patterns, 2).
    at, slope
        R there [m], shape (patterns,), and ∂R/∂(Θ, φ) [m/rad], shape (patterns, 2).
    covariance
        Of all three, shape (patterns, 3, 3).
    gains
        Their derivatives by the range of each voxel, shape (patterns, 3, points).
    known
        Whether there are voxels enough, shape (patterns,).
    """

    about: Array
    at: Array
    slope: Array
    covariance: Array
    gains: Array
    known: Mask

    def off(self, centre: Centroid) -> Array:
        """Return the derivatives of the range at other centres by range and slopes, shape (patterns, 3)."""
        return np.concatenate([np.ones((len(self.at), 1)), centre.centre - self.about], axis=1)


def target_ranges(
    samples: PatternSamples,
    response: Response,
    kind: TargetKind,
    centre: Centroid,
    about: Array,
    stamp: Array,
    *,
    sphere: float | None = None,
    plane: TargetPlane | None = None,
    reach: Array | None = None,
) -> Ranges:
    """Return ranges and slopes of planes through voxels.

    Parameters
    ----------
    samples, response
        The patterns, and the voxels that may tell the range.
    kind
        What the target is. Holes have the range of what is around them, black and retro-reflective discs that of both.
    centre
        Roughly where the target is: whether it is there, and its size.
    about, stamp
        (Θ, φ) [rad] and time [s] to which the range belongs, shape (patterns, 2) and (patterns,).
    sphere
        Radius of a sphere [m], whose voxels are carried to its middle; None for flat targets.
    plane, reach
        A plane that is known roughly, whose foot is there, and its range at each voxel [m].

    Returns
    -------
    Ranges
        Least squares of R cos δ = R₀ + g·δ + h t, δ = angles − centre, weighed by 1/σ_R²: a flat target in space, to
        the second order in δ but for its tilt's; or of what is left beside the plane that is known. The rise h in time
        lets the range belong to the stamp, whenever the voxels that tell it were measured.
    """
    part = {TargetKind.BLACK: response.used, TargetKind.HOLE: response.used & ~response.hit}
    if kind is TargetKind.RETRO:
        part[TargetKind.RETRO] = _plain(response)
    chosen = part.get(kind, response.hit) & samples.valid & centre.found[:, None]
    angles = samples.theta - about[:, :1], samples.phi - about[:, 1:]
    square = angles[0] ** 2 + angles[1] ** 2
    # Off the centre a flat target is farther away by 1/cos: 0.3 mm at 10 m, many σ when it is near.
    value = samples.range * np.cos(np.sqrt(square)) if reach is None else samples.range - reach
    if sphere is not None:
        # The middle lies behind a point of the surface by √(r² − ρ²), which is steep near the limb.
        off = square * samples.range**2
        chosen &= off < (_CAP_SHARE * sphere) ** 2
        value = value + np.sqrt(np.maximum(sphere**2 - off, 0.0))
    sigma = np.where(chosen & (samples.sigma_range > 0.0), samples.sigma_range, 1.0)
    weight = np.where(chosen, 1.0 / sigma**2, 0.0)
    # In radii, so that the plane's columns are of like size.
    size = np.where(centre.found & (centre.radius > 0.0), centre.radius, 1.0)
    design = np.ones((len(size), 4, square.shape[1]))
    design[:, 1], design[:, 2] = angles[0] / size[:, None], angles[1] / size[:, None]
    design[:, 3] = (samples.time - stamp[:, None]) / np.ptp(samples.time, axis=1)[:, None]
    weighted = design * weight[:, None]
    normal = product(weighted, design.transpose(0, 2, 1))
    enough = chosen.sum(axis=1) >= _FEWEST
    normal = np.where(enough[:, None, None], normal, _FOUR)
    diagonal = normal.reshape(-1, 16)[:, ::5]
    diagonal += 1e-9 * diagonal.sum(axis=1)[:, None]
    spread = inverse(normal)
    gains = product(spread[:, :3], weighted)
    scale = np.ones((len(size), 3))
    scale[:, 1:] /= size[:, None]
    gains *= scale[:, :, None]
    found = applied(gains, np.where(chosen, value, 0.0))
    if plane is not None:
        found[:, 0] += plane.distance
        found[:, 1:] += plane.slope
    return Ranges(
        about,
        found[:, 0],
        found[:, 1:],
        spread[:, :3, :3] * (scale[:, :, None] * scale[:, None]),
        gains,
        enough & centre.found,
    )


def _plain(response: Response) -> Mask:
    """Return the voxels beside a retro-reflector that none of its light reaches, or all where there are too few.

    A little of it on a dull ground outshines that, and its position in the spot moves the range.
    """
    level = response.ground[:, None]
    plain = response.used & ~response.hit & (np.abs(response.value - level) < 0.5 * np.abs(level))
    return np.where(plain.sum(axis=1, keepdims=True) >= _FEWEST_PLAIN, plain, response.used)
