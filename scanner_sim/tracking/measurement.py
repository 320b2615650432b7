"""From a pattern's voxels to the place of a target, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.arithmetic import inverse, product, solve_linear
from scanner_sim.parts import Part
from scanner_sim.tracking.centroid import Centroid, better_of, circle_fit, hit_centroid
from scanner_sim.tracking.disc_fit import disc_fit
from scanner_sim.tracking.plane import TargetPlane, target_plane
from scanner_sim.tracking.response import Response, TargetKind, target_response
from scanner_sim.tracking.samples import PatternSamples, rise_per_point
from scanner_sim.units import Length

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PARTLY = 0.45
"""Distance from the middle of both levels, over theirs, below which a voxel is partly on the target."""
_FEWEST_PARTLY = 6
"""Voxels partly on the target that tell a disc's place and size, with some to spare."""
_FEWEST_WHOLE = 12
"""Voxels away from the rim by which a range is found without those at it."""
_CAP = 0.8
"""Part of a sphere's radius within which its range is looked at."""


class TargetLooks(Part):
    """What the tracker knows of a target's looks."""

    kind: TargetKind
    """What makes it differ from what surrounds it."""
    diameter: Length = Field(gt=0.0, le=100.0)
    """Diameter."""
    depth: Length = Field(default=0.3, gt=0.0, le=1e4)
    """How far in front of and behind the expected range target and ground may lie: the range gate."""
    surface: Literal["flat", "sphere"] = "flat"
    """Its form: the range of a sphere is that of its middle."""


@dataclass(frozen=True)
class Measurement:
    """Places of a target by pattern; NaN where it was not found.

    Attributes
    ----------
    time
        When [s], shape (patterns,): the mean over the hits.
    place, covariance
        (Θ, φ, R), shape (patterns, 3), and its covariance (patterns, 3, 3).
    radius, sigma_radius
        Its radius as an angle [rad], shape (patterns,).
    misfit
        χ² over degrees of freedom, shape (patterns,).
    fraction
        Share of the voxels that hit it, shape (patterns,).
    found
        Whether there is a target, shape (patterns,).
    """

    time: Array
    place: Array
    covariance: Array
    radius: Array
    sigma_radius: Array
    misfit: Array
    fraction: Array
    found: Mask


def measure_target(
    samples: PatternSamples,
    looks: TargetLooks,
    expected_range: ArrayLike,
    *,
    spot: ArrayLike,
    shining: float = 1.0,
    pointing: ArrayLike = 0.0,
    axis_separation: float | None = None,
) -> Measurement:
    """Return where patterns see a target.

    Parameters
    ----------
    samples
        The patterns.
    looks
        Kind, diameter and range gate.
    expected_range
        Range in whose neighbourhood it is looked for [m], () or (patterns,).
    spot, shining, pointing
        Spot as an angle, share of the dwell with light and error of the angles: see
        :func:`~scanner_sim.tracking.disc_fit.disc_fit`.
    axis_separation
        D_g [m], by which the angles become points; None takes targets to be round in the angles.

    Returns
    -------
    Measurement
        Flat targets are looked at in their own plane (:mod:`~scanner_sim.tracking.plane`), whose tilt the ranges tell:
        under 15° a disc looks narrower by 3 %, ten σ of its radius, and the pattern's few crossings of the rim would
        take that for a place. Centre of the disc fit with a free radius, or the mean of hits where that fails. It is
        that of the circle for targets whose values at the edge do not say how much of the spot is on them: those that
        their range tells, and retro-reflectors, whose light is clipped; also for light with gaps (``shining`` below 1)
        of which too few voxels are partly on the target. The range is that of the plane R cos δ = R₀ + g·δ, δ = angles
        − centre, through the voxels on the target (for holes: around it; for black and retro-reflective discs both) at
        the centre, weighed by 1/σ_R²: a flat target in space, to the second order in δ but for its tilt's. A sphere's
        voxels are carried to its middle first.
    """
    middle = np.zeros(len(samples.theta)) + np.asarray(expected_range, dtype=np.float64)
    response = target_response(
        samples, looks.kind, np.stack([middle - looks.depth, middle + looks.depth], axis=1)
    )
    hits = hit_centroid(samples, response)
    plane, shown, ranged = None, samples, response
    if axis_separation is not None and looks.surface == "flat":
        plane = _plane_of(samples, response, looks, hits, middle, axis_separation)
        shown, light = plane.flattened(samples)
        if not looks.kind.by_range:
            response = replace(response, value=response.value / light)
    graded = not looks.kind.by_range and looks.kind is not TargetKind.RETRO
    fits = graded and shining == 1.0
    # Where the disc is fitted, its fit only begins at the circle.
    centre = circle_fit(shown, response, blurred=fits, rounds=1 if fits else None)
    if not centre.found.all():
        hits = hits if plane is None else hit_centroid(shown, response)
        centre = better_of(centre, hits)
    if graded:
        wider = 1.0 if plane is None else plane.stretch
        error = np.asarray(pointing) * np.reshape(wider, (-1, 1))
        fitted = disc_fit(
            shown, response, centre, spot=np.asarray(spot) * wider, shining=shining, pointing=error
        )
        if not fitted.found.all():
            fitted = better_of(fitted, hits if plane is None else hit_centroid(shown, response))
        if shining < 1.0:
            # The light leaves gaps. Where they hold the rim, nothing but the circle tells where it is.
            away = np.abs(response.value - response.threshold[:, None])
            partly = away < _PARTLY * np.abs(response.target - response.ground)[:, None]
            told = (partly & response.used).sum(axis=1) >= _FEWEST_PARTLY
            fitted = better_of(replace(fitted, found=fitted.found & told), centre)
        centre = fitted
        whole = _away_from_rim(shown, centre, 3.0 * np.reshape(spot, (-1, 1)), shining)
        inside = response.used & whole
        if (inside.sum(axis=1) >= _FEWEST_WHOLE).all():
            ranged = replace(response, used=inside, hit=response.hit & whole)
    if plane is not None:
        centre = plane.seen(centre)
    distance, variance = _range_at(samples, ranged, looks, centre)
    place = np.concatenate([centre.centre, distance[:, None]], axis=1)
    covariance = np.zeros((len(place), 3, 3))
    covariance[:, :2, :2], covariance[:, 2, 2] = centre.covariance, variance
    count = np.maximum(response.hit.sum(axis=1), 1)
    return Measurement(
        time=np.where(response.hit, samples.time, 0.0).sum(axis=1) / count
        + np.where(centre.found, 0.0, np.nan),
        place=place,
        covariance=covariance,
        radius=centre.radius,
        sigma_radius=centre.sigma_radius,
        misfit=centre.misfit,
        fraction=response.fraction,
        found=centre.found & np.isfinite(distance),
    )


def _range_at(
    samples: PatternSamples, response: Response, looks: TargetLooks, centre: Centroid
) -> tuple[Array, Array]:
    """Return range [m] and variance at the centres, shape (patterns,); NaN where too few voxels tell it."""
    plane, variance, enough = _ranges(samples, response, looks, centre)
    return np.where(enough, plane[:, 0], np.nan), np.where(enough, variance, np.nan)


def _plane_of(
    samples: PatternSamples,
    response: Response,
    looks: TargetLooks,
    hits: Centroid,
    middle: Array,
    axis_separation: float,
) -> TargetPlane:
    """Return the planes on which targets lie, about the means of their hits; where nothing was hit they face."""
    ranges, _, enough = _ranges(samples, response, looks, hits)
    known = enough & hits.found
    about = np.stack([samples.theta.mean(axis=1), samples.phi.mean(axis=1)], axis=1)
    radius = np.where(hits.found & (hits.radius > 0.0), hits.radius, 1.0)
    return target_plane(
        np.where(known[:, None], hits.centre, about),
        np.where(known & (ranges[:, 0] > axis_separation), ranges[:, 0], middle),
        np.where(known[:, None], ranges[:, 1:] / radius[:, None], 0.0),
        axis_separation,
    )


def _away_from_rim(samples: PatternSamples, centre: Centroid, blur: Array, shining: float) -> Mask:
    """Return the voxels whose whole spot lies on one side of the rim, but for ``blur`` [rad] and the way in a dwell.

    Where one side is darker, the light's middle is not the spot's: at 4 m that moves single ranges by 10 mm.
    """
    off_theta, off_phi = samples.theta - centre.centre[:, :1], samples.phi - centre.centre[:, 1:]
    way = np.hypot(rise_per_point(samples.theta), rise_per_point(samples.phi))
    off = np.abs(np.hypot(off_theta, off_phi) - centre.radius[:, None])
    return np.asarray(off > blur + 0.5 * shining * way)


def _plain(response: Response) -> Mask:
    """Return the voxels beside a retro-reflector that none of its light reaches, or all where there are too few.

    A little of it on a dull ground outshines that, and its place in the spot moves the range.
    """
    level = response.ground[:, None]
    plain = response.used & ~response.hit & (np.abs(response.value - level) < 0.5 * np.abs(level))
    return np.where(plain.sum(axis=1, keepdims=True) >= _FEWEST_PARTLY, plain, response.used)


def _ranges(
    samples: PatternSamples, response: Response, looks: TargetLooks, centre: Centroid
) -> tuple[Array, Array, Mask]:
    """Return range [m] at the centres with its rises, its variance, and whether there are voxels enough.

    Shapes (patterns, 3), of which the second and third are per radius along Θ and φ, (patterns,) and (patterns,).
    """
    part = {TargetKind.BLACK: response.used, TargetKind.HOLE: response.used & ~response.hit}
    if looks.kind is TargetKind.RETRO:
        part[TargetKind.RETRO] = _plain(response)
    chosen = part.get(looks.kind, response.hit) & samples.valid & centre.found[:, None]
    about = np.where(centre.found[:, None], centre.centre, 0.0)
    angles = samples.theta - about[:, :1], samples.phi - about[:, 1:]
    square = angles[0] ** 2 + angles[1] ** 2
    # Off the centre a flat target is farther away by 1/cos: a third of a millimetre at 10 m, many σ when it is near.
    value = samples.range * np.cos(np.sqrt(square))
    if looks.surface == "sphere":
        # The middle lies behind a point of the surface by √(r² − ρ²), which is steep near the limb.
        radius, off = 0.5 * looks.diameter, square * samples.range**2
        chosen &= off < (_CAP * radius) ** 2
        value = value + np.sqrt(np.maximum(radius**2 - off, 0.0))
    sigma = np.where(chosen & (samples.sigma_range > 0.0), samples.sigma_range, 1.0)
    weight = np.where(chosen, 1.0 / sigma**2, 0.0)
    # In radii, so that the plane's columns are of like size.
    size = np.where(centre.found, centre.radius, 1.0)[:, None]
    design = np.ones((len(size), 3, square.shape[1]))
    design[:, 1], design[:, 2] = angles[0] / size, angles[1] / size
    weighted = design * weight[:, None]
    normal = product(weighted, design.transpose(0, 2, 1))
    enough: Mask = np.asarray(chosen.sum(axis=1) >= 4)
    normal = np.where(enough[:, None, None], normal, np.eye(3))
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    value = np.where(chosen, value, 0.0)
    plane = solve_linear(normal, product(weighted, value[..., None]))[..., 0]
    return np.asarray(plane), np.asarray(inverse(normal)[:, 0, 0]), enough
