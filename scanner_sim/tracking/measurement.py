"""From a pattern's voxels to the position of a target, with its covariance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.foundation.arithmetic import applied, cholesky, inverse, product, solve_linear
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Length
from scanner_sim.tracking.centroid import Centroid, better_of, circle_fit, hit_centroid
from scanner_sim.tracking.disc_fit import disc_fit
from scanner_sim.tracking.plane import TargetPlane, target_plane
from scanner_sim.tracking.response import Response, TargetKind, target_response
from scanner_sim.tracking.samples import PatternSamples, rise_per_point

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PARTIAL_LEVEL = 0.45
"""Distance from the middle of both levels, over theirs, below which a voxel is partly on the target."""
_FEWEST_PARTIAL = 6
"""Voxels partly on the target that tell a disc's position and size, with some to spare."""
_FEWEST_WHOLE = 12
"""Voxels away from the rim by which a range is found without those at it."""
_CAP_SHARE = 0.8
"""Part of a sphere's radius within which its range is looked at."""


class TargetAppearance(Part):
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
    """Positions of a target by pattern; NaN where it was not found.

    Attributes
    ----------
    time
        When [s], shape (patterns,): the mean over the hits.
    position, covariance
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
    position: Array
    covariance: Array
    radius: Array
    sigma_radius: Array
    misfit: Array
    fraction: Array
    found: Mask


def measure_target(
    samples: PatternSamples,
    appearance: TargetAppearance,
    expected_range: ArrayLike,
    *,
    spot: ArrayLike,
    duty_cycle: float = 1.0,
    pointing: ArrayLike = 0.0,
    axis_separation: float | None = None,
) -> Measurement:
    """Return where patterns see a target.

    Parameters
    ----------
    samples
        The patterns.
    appearance
        Kind, diameter and range gate.
    expected_range
        Range in whose neighbourhood it is looked for [m], () or (patterns,).
    spot, duty_cycle, pointing
        Spot as an angle, share of the dwell with light and error of the angles: see
        :func:`~scanner_sim.tracking.disc_fit.disc_fit`.
    axis_separation
        D_g [m], by which the angles become points; None takes targets to be round in the angles.

    Returns
    -------
    Measurement
        Flat targets are looked at in their own plane (:mod:`~scanner_sim.tracking.plane`), whose tilt the ranges tell:
        under 15° a disc looks narrower by 3 %, ten σ of its radius, and the pattern's few crossings of the rim would
        take that for a position. Centre of the disc fit with a free radius, or the mean of hits where that fails. It is
        that of the circle for targets whose values at the edge do not say how much of the spot is on them: those that
        their range tells, and retro-reflectors, whose light is clipped; also for light with gaps (``duty_cycle`` below
        1) of which too few voxels are partly on the target. The range is that of the plane R cos δ = R₀ + g·δ, δ =
        angles − centre, through the voxels on the target (for holes: around it; for black and retro-reflective discs
        both) at the centre, weighed by 1/σ_R²: a flat target in space, to the second order in δ but for its tilt's. A
        sphere's voxels are carried to its middle first.
    """
    middle = np.zeros(len(samples.theta)) + np.asarray(expected_range, dtype=np.float64)
    response = target_response(
        samples, appearance.kind, np.stack([middle - appearance.depth, middle + appearance.depth], axis=1)
    )
    hits = hit_centroid(samples, response)
    stamp = _stamp(samples, response)
    see = _Seeing(samples, response, appearance, hits, spot, duty_cycle, pointing)
    plane: TargetPlane | None = None
    if axis_separation is None or appearance.surface != "flat":
        centre, ranged = see.directly()
    else:
        first, _ = _plane_of(samples, response, appearance, hits, middle, stamp, axis_separation)
        centre, ranged = see.on(first)
        # Voxels at the rim would tilt the plane: the light's middle is not the spot's. Those away from it tell better.
        plane, slope = _plane_of(samples, ranged, appearance, centre, middle, stamp, axis_separation, first)
        centre, ranged = see.on(plane, centre)
        if see.fits:
            centre = centre.worse_by(see.by_slope(plane, slope, centre))
    ranges, spread, enough = _ranges(samples, ranged, appearance, centre, stamp, plane)
    distance = np.where(enough, ranges[:, 0], np.nan)
    position = np.concatenate([centre.centre, distance[:, None]], axis=1)
    covariance = _covariance(centre, ranges, np.where(enough, spread[:, 0, 0], np.nan), plane)
    return Measurement(
        time=stamp + np.where(centre.found, 0.0, np.nan),
        position=position,
        covariance=covariance,
        radius=centre.radius,
        sigma_radius=centre.sigma_radius,
        misfit=centre.misfit,
        fraction=response.fraction,
        # What is as uncertain as it is large has not been measured.
        found=centre.found & (covariance[:, 2, 2] < distance**2),
    )


@dataclass(frozen=True)
class _Seeing:
    """What a centre is found from: see :func:`measure_target`; ``hits`` is where the search begins."""

    samples: PatternSamples
    response: Response
    appearance: TargetAppearance
    hits: Centroid
    spot: ArrayLike
    duty_cycle: float
    pointing: ArrayLike

    @property
    def is_graded(self) -> bool:
        """Whether values at the edge say how much of the spot is on the target."""
        return not self.appearance.kind.by_range and self.appearance.kind is not TargetKind.RETRO

    @property
    def fits(self) -> bool:
        """Whether a disc is fitted, and light has no gaps."""
        return self.is_graded and self.duty_cycle == 1.0

    def directly(self) -> tuple[Centroid, Response]:
        """Return centres of targets that are round in the angles, and what of the response tells their range."""
        start = circle_fit(self.samples, self.response, blurred=self.fits, rounds=1 if self.fits else None)
        return self._fit(self.samples, self.response, start, self.hits, None)

    def on(self, plane: TargetPlane, known: Centroid | None = None) -> tuple[Centroid, Response]:
        """Return centres (Θ, φ) of targets on planes; ``known`` is the centre about which these stand, from before."""
        shown, response = self._lay_onto(plane)
        if known is None or not self.fits:
            # Where the disc is fitted, its fit only begins at the circle.
            start = circle_fit(shown, response, blurred=self.fits, rounds=1 if self.fits else None)
        else:
            start = replace(known, centre=0.0 * known.centre)
        hits = self.hits if start.found.all() else hit_centroid(shown, response)
        centre, ranged = self._fit(shown, response, start, hits, plane)
        return plane.seen(centre), ranged

    def by_slope(self, plane: TargetPlane, slope: Array, known: Centroid) -> Array:
        """Return the covariance of centres (patterns, 2, 2) that comes with that of the planes' slopes.

        ``slope`` is that covariance, of ∂R/∂(Θ, φ) [m²/rad²], shape (patterns, 2, 2). The disc is fitted on planes that
        are wrong by each column of its root.
        """
        root = cholesky(slope)
        spread = np.zeros((len(slope), 2, 2))
        for column in (0, 1):
            other = plane.steeper(root[:, :, column])
            shown, response = self._lay_onto(other)
            start = replace(known, centre=0.0 * known.centre)
            moved = other.seen(self._disc(shown, response, start, other)).centre - known.centre
            moved = np.where(np.isfinite(moved), moved, 0.0)
            spread += moved[:, :, None] * moved[:, None]
        return spread

    def _lay_onto(self, plane: TargetPlane) -> tuple[PatternSamples, Response]:
        """Return samples and response on planes, their light divided by that of the plane's tilt and range."""
        shown, light = plane.flatten(self.samples)
        if self.appearance.kind.by_range:
            return shown, self.response
        return shown, replace(self.response, value=self.response.value / light)

    def _disc(
        self, shown: PatternSamples, response: Response, start: Centroid, plane: TargetPlane | None
    ) -> Centroid:
        spot, error = np.asarray(self.spot, dtype=np.float64), np.asarray(self.pointing, dtype=np.float64)
        if plane is not None:
            spot = plane.spot(spot, shown, np.where(start.found[:, None], start.centre, 0.0))
            error = error * plane.stretch[:, None]
        return disc_fit(shown, response, start, spot=spot, duty_cycle=self.duty_cycle, pointing=error)

    def _fit(
        self,
        shown: PatternSamples,
        response: Response,
        start: Centroid,
        hits: Centroid,
        plane: TargetPlane | None,
    ) -> tuple[Centroid, Response]:
        """Return the best centres that the samples tell, and what of the response tells the range."""
        centre = better_of(start, hits)
        if not self.is_graded:
            return centre, self.response
        fitted = better_of(self._disc(shown, response, centre, plane), hits)
        if self.duty_cycle < 1.0:
            # The light leaves gaps. Where they hold the rim, nothing but the circle tells where it is.
            away = np.abs(response.value - response.threshold[:, None])
            partly = away < _PARTIAL_LEVEL * np.abs(response.target - response.ground)[:, None]
            enough = (partly & response.used).sum(axis=1) >= _FEWEST_PARTIAL
            fitted = better_of(replace(fitted, found=fitted.found & enough), centre)
        whole = _away_from_rim(shown, fitted, 3.0 * np.reshape(self.spot, (-1, 1)), self.duty_cycle)
        inside = response.used & whole
        if (inside.sum(axis=1) >= _FEWEST_WHOLE).all():
            return fitted, replace(self.response, used=inside, hit=response.hit & whole)
        return fitted, self.response


def _stamp(samples: PatternSamples, response: Response) -> Array:
    """Return the time to which positions belong [s], shape (patterns,): the mean over the hits."""
    count = np.maximum(response.hit.sum(axis=1), 1)
    return np.asarray(np.where(response.hit, samples.time, 0.0).sum(axis=1) / count)


def _covariance(centre: Centroid, ranges: Array, variance: Array, plane: TargetPlane | None) -> Array:
    """Return the covariance of positions, shape (patterns, 3, 3).

    The range is that of the plane at the centre that was found, so that an error δ of the centre on a target with the
    slope g = ∂R/∂(Θ, φ) moves it by g·δ; ``variance`` [m²] is that of the plane's range where it was asked for.
    """
    whole = np.zeros((len(ranges), 3, 3))
    whole[:, :2, :2], whole[:, 2, 2] = centre.covariance, variance
    if plane is not None:
        shared = applied(centre.covariance, plane.slope)
        whole[:, :2, 2] = whole[:, 2, :2] = shared
        whole[:, 2, 2] += (shared * plane.slope).sum(axis=1)
    return whole


def _plane_of(
    samples: PatternSamples,
    response: Response,
    appearance: TargetAppearance,
    centre: Centroid,
    middle: Array,
    stamp: Array,
    axis_separation: float,
    before: TargetPlane | None = None,
) -> tuple[TargetPlane, Array]:
    """Return the planes on which targets lie, about their centres, and the covariance of their slopes [m²/rad²].

    Where nothing was hit they face the scanner. ``before`` are planes that are known roughly.
    """
    ranges, covariance, enough = _ranges(samples, response, appearance, centre, stamp, before)
    known = enough & centre.found
    about = np.stack([samples.theta.mean(axis=1), samples.phi.mean(axis=1)], axis=1)
    radius = np.where(centre.found & (centre.radius > 0.0), centre.radius, 1.0)
    plane = target_plane(
        np.where(known[:, None], centre.centre, about),
        np.where(known & (ranges[:, 0] > axis_separation), ranges[:, 0], middle),
        np.where(known[:, None], ranges[:, 1:3] / radius[:, None], 0.0),
        axis_separation,
    )
    spread = covariance[:, 1:3, 1:3] / (radius**2)[:, None, None]
    return plane, np.where(known[:, None, None], spread, 1e-12 * np.eye(2))


def _away_from_rim(samples: PatternSamples, centre: Centroid, blur: Array, duty_cycle: float) -> Mask:
    """Return the voxels whose whole spot lies on one side of the rim, but for ``blur`` [rad] and the way in a dwell.

    Where one side is darker, the light's middle is not the spot's: at 4 m that moves single ranges by 10 mm.
    """
    off_theta, off_phi = samples.theta - centre.centre[:, :1], samples.phi - centre.centre[:, 1:]
    way = np.hypot(rise_per_point(samples.theta), rise_per_point(samples.phi))
    off = np.abs(np.hypot(off_theta, off_phi) - centre.radius[:, None])
    return np.asarray(off > blur + 0.5 * duty_cycle * way)


def _plain(response: Response) -> Mask:
    """Return the voxels beside a retro-reflector that none of its light reaches, or all where there are too few.

    A little of it on a dull ground outshines that, and its position in the spot moves the range.
    """
    level = response.ground[:, None]
    plain = response.used & ~response.hit & (np.abs(response.value - level) < 0.5 * np.abs(level))
    return np.where(plain.sum(axis=1, keepdims=True) >= _FEWEST_PARTIAL, plain, response.used)


def _ranges(
    samples: PatternSamples,
    response: Response,
    appearance: TargetAppearance,
    centre: Centroid,
    stamp: Array,
    plane: TargetPlane | None = None,
) -> tuple[Array, Array, Mask]:
    """Return range [m] at the centres with its rises, their covariance, and whether there are voxels enough.

    Shapes (patterns, 4), of which the second and third are per radius along Θ and φ and the fourth per pattern's length
    in time, (patterns, 4, 4) and (patterns,). The rise in time lets the range belong to the ``stamp`` [s], whenever the
    voxels that tell it were measured.
    """
    part = {TargetKind.BLACK: response.used, TargetKind.HOLE: response.used & ~response.hit}
    if appearance.kind is TargetKind.RETRO:
        part[TargetKind.RETRO] = _plain(response)
    chosen = part.get(appearance.kind, response.hit) & samples.valid & centre.found[:, None]
    about = np.where(centre.found[:, None], centre.centre, 0.0)
    angles = samples.theta - about[:, :1], samples.phi - about[:, 1:]
    square = angles[0] ** 2 + angles[1] ** 2
    if plane is None:
        # Off the centre a flat target is farther away by 1/cos: 0.3 mm at 10 m, many σ when it is near.
        value = samples.range * np.cos(np.sqrt(square))
    else:
        value = samples.range - plane.reach(samples.theta, samples.phi)
    if appearance.surface == "sphere":
        # The middle lies behind a point of the surface by √(r² − ρ²), which is steep near the limb.
        radius, off = 0.5 * appearance.diameter, square * samples.range**2
        chosen &= off < (_CAP_SHARE * radius) ** 2
        value = value + np.sqrt(np.maximum(radius**2 - off, 0.0))
    sigma = np.where(chosen & (samples.sigma_range > 0.0), samples.sigma_range, 1.0)
    weight = np.where(chosen, 1.0 / sigma**2, 0.0)
    # In radii, so that the plane's columns are of like size.
    size = np.where(centre.found, centre.radius, 1.0)[:, None]
    design = np.ones((len(size), 4, square.shape[1]))
    design[:, 1], design[:, 2] = angles[0] / size, angles[1] / size
    design[:, 3] = (samples.time - stamp[:, None]) / np.ptp(samples.time, axis=1)[:, None]
    weighted = design * weight[:, None]
    normal = product(weighted, design.transpose(0, 2, 1))
    enough: Mask = np.asarray(chosen.sum(axis=1) >= 5)
    normal = np.where(enough[:, None, None], normal, np.eye(4))
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(4)
    value = np.where(chosen, value, 0.0)
    found = solve_linear(normal, product(weighted, value[..., None]))[..., 0]
    if plane is not None:
        found[:, 0] += plane.reach(about[:, :1], about[:, 1:])[:, 0]
        found[:, 1:3] += plane.slope * size
    return np.asarray(found), np.asarray(inverse(normal)), enough
