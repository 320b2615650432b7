"""From a pattern's voxels to the position of a target, with its covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.foundation.arithmetic import applied, cholesky, columns
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Length
from scanner_sim.ranging.spot_light import spot_shift
from scanner_sim.tracking.centroid import Centroid, better_of, circle_fit, hit_centroid
from scanner_sim.tracking.disc_average import averaged_disc
from scanner_sim.tracking.disc_fit import disc_fit
from scanner_sim.tracking.plane import TargetPlane, target_plane
from scanner_sim.tracking.response import Response, TargetKind, repeated, target_response
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.sphere_fit import SphereFit, sphere_fit
from scanner_sim.tracking.target_ranges import Ranges, target_ranges

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_PARTIAL_SPOTS = 1.645
"""Distance from the rim, in standard deviations of the spot, within which 5 to 95 % of a voxel are on the target."""
_FEWEST_PARTIAL = 6
"""Voxels partly on the target that tell a disc's position and size, with some to spare."""
_SIGMA_POINTS = math.sqrt(2.0) * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
"""Points with the first three moments of two standard normal numbers (Arasaratnam, Haykin, *IEEE Transactions on
Automatic Control* 54, 2009). What a wrong slope moves goes with the square of the slope: errors to one side alone say
too much of targets that lean so, and too little of those that lean the other way."""
_EXPLAINED = 5.0
"""χ² over degrees of freedom up to which a disc explains the light of a retro-reflector and what is about it. Beyond,
where the pattern leaves a plate for one, its edge against all that is darker still makes a circle."""
_FEWEST_WHOLE = 12
"""Voxels away from the rim by which a range is found without those at it."""
_LARGEST_TURN = 0.1
"""Change of a plane's slope, in metres across over metres away, after which voxels at the rim are told anew."""
_MOST_PLANES = 3
"""Planes that are found one after the other: one does nearer than 20 m, three at 30 m."""


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
class Sight:
    """What flat targets were seen on.

    Attributes
    ----------
    plane
        Their planes.
    place
        (u, v) of the voxels on them (:meth:`~scanner_sim.tracking.plane.TargetPlane.flatten`), (patterns, 2, points).
    light_gains
        By how much relative changes of the voxels' light move the centre there, shape (patterns, 2, points); None where
        it is not their light that tells the centre.
    range_gains
        By how much the range of each voxel moves that of the target, shape (patterns, points).
    """

    plane: TargetPlane
    place: Array
    light_gains: Array | None
    range_gains: Array


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
    sight
        What a flat target was seen on; None for others.
    """

    time: Array
    position: Array
    covariance: Array
    radius: Array
    sigma_radius: Array
    misfit: Array
    fraction: Array
    found: Mask
    sight: Sight | None = None

    def of(self, row: int) -> Measurement:
        """Return one of the patterns, without what it was seen on."""
        if len(self.found) == 1:
            return self
        names = (field.name for field in fields(self) if field.name != "sight")
        return Measurement(**{name: getattr(self, name)[row : row + 1] for name in names})


def measure_target(
    samples: PatternSamples,
    appearance: TargetAppearance,
    expected_range: ArrayLike,
    *,
    spot: ArrayLike,
    duty_cycle: float = 1.0,
    pointing: ArrayLike = 0.0,
    axis_separation: float | None = None,
    baseline: float = 0.0,
    by_line: Array | None = None,
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
    baseline
        Distance d from the laser to the lens that sees its light [m]: the side towards the lens is brighter.
    by_line
        Triangulation's share of ranges where the line sensor sees the light, shape (patterns,): that share of what the
        target's form does to it is taken off (:func:`~scanner_sim.ranging.spot_light.spot_shift`); None by pulses.

    Returns
    -------
    Measurement
        Flat targets are looked at in their own plane (:mod:`~scanner_sim.tracking.plane`), whose tilt the ranges tell:
        under 15° a disc looks narrower by 3 %, ten σ of its radius, and the pattern's few crossings of the rim would
        take that for a position. Centre of the disc fit with a free radius, or the mean of hits where that fails. It is
        that of the circle for targets whose values at the edge do not say how much of the spot is on them: those that
        their range tells, and retro-reflectors whose light is clipped or told by pulses; also for light with gaps
        (``duty_cycle`` below 1) of which too few voxels are partly on the target. The range is that of the plane there
        (:func:`~scanner_sim.tracking.target_ranges.target_ranges`), and spheres are fitted to theirs
        (:func:`~scanner_sim.tracking.sphere_fit.sphere_fit`).
    """
    middle = np.zeros(len(samples.theta)) + np.asarray(expected_range, dtype=np.float64)
    gate = columns(middle - appearance.depth, middle + appearance.depth)
    response = target_response(samples, appearance.kind, gate)
    see = _Seeing(
        samples,
        response,
        appearance,
        np.asarray(spot, dtype=np.float64),
        duty_cycle,
        pointing,
        by_line,
    )
    if axis_separation is None or appearance.surface != "flat":
        centre, ranges, sight = see.directly()
        distance = ranges.at
    else:
        centre, distance, ranges, sight = see.on_its_plane(middle, (axis_separation, baseline))
    distance = np.where(ranges.known, distance, np.nan)
    position = np.concatenate([centre.centre, distance[:, None]], axis=1)
    covariance, misfit = _covariance(centre, ranges, sight), centre.misfit
    if axis_separation is not None and appearance.surface == "sphere":
        sphere = see.sphere(position, centre.covariance, (axis_separation, baseline))
        position = np.where(sphere.found[:, None], sphere.position, position)
        covariance = np.where(sphere.found[:, None, None], sphere.covariance, covariance)
        misfit = np.where(sphere.found, sphere.misfit, misfit)
    return Measurement(
        time=see.stamp + np.where(centre.found, 0.0, np.nan),
        position=position,
        covariance=covariance,
        radius=centre.radius,
        sigma_radius=centre.sigma_radius,
        misfit=misfit,
        fraction=response.fraction,
        # What is as uncertain as it is large has not been measured.
        found=centre.found & (covariance[:, 2, 2] < position[:, 2] ** 2),
        sight=sight,
    )


@dataclass(frozen=True)
class _Seeing:
    """What a centre is found from: see :func:`measure_target`."""

    samples: PatternSamples
    response: Response
    appearance: TargetAppearance
    spot: Array
    duty_cycle: float
    pointing: ArrayLike
    by_line: Array | None

    @property
    def is_graded(self) -> bool:
        """Whether values at the edge say how much of the spot is on the target, but where light is clipped."""
        return not self.appearance.kind.by_range

    @property
    def fits(self) -> bool:
        """Whether a disc is believed whatever the pattern: light is not clipped, and has no gaps."""
        return self.is_graded and self.appearance.kind is not TargetKind.RETRO and self.duty_cycle == 1.0

    @cached_property
    def hits(self) -> Centroid:
        """Mean of the hits, where the search begins."""
        return hit_centroid(self.samples, self.response)

    @cached_property
    def stamp(self) -> Array:
        """Time to which positions belong [s], shape (patterns,): the mean over the hits."""
        hit = self.response.hit
        return np.asarray(np.where(hit, self.samples.time, 0.0).sum(axis=1) / np.maximum(hit.sum(axis=1), 1))

    def directly(self) -> tuple[Centroid, Ranges, None]:
        """Return centres of targets that are round in the angles, and their ranges."""
        centre = self._best(self.samples, self.response, self._circle(self.samples, self.response))
        about = np.where(centre.found[:, None], centre.centre, 0.0)
        radius = 0.5 * self.appearance.diameter if self.appearance.surface == "sphere" else None
        told = self._ranged(self.samples, centre, np.zeros(len(centre.radius)))
        kind = self.appearance.kind
        return centre, target_ranges(self.samples, told, kind, centre, about, self.stamp, sphere=radius), None

    def sphere(self, start: Array, outline: Array, layout: tuple[float, float]) -> SphereFit:
        """Return spheres by the ranges on them and their outlines; the layout is (D_g, d)."""
        return sphere_fit(
            self.samples,
            self.response.hit,
            start,
            outline,
            0.5 * self.appearance.diameter,
            stamp=self.stamp,
            layout=layout,
            by_line=self.by_line,
            spot=self.spot,
            duty_cycle=self.duty_cycle,
            pointing=self.pointing,
        )

    def on_its_plane(
        self, middle: Array, layout: tuple[float, float]
    ) -> tuple[Centroid, Array, Ranges, Sight]:
        """Return centres of flat targets, their ranges, the planes' and the planes; the layout is (D_g, d).

        The first plane is that of all voxels of the target. On it a circle tells which of them are away from the rim:
        those at it would tilt the plane, for the light's middle is not the spot's. The second goes through the others,
        as what is left beside the first, whose misfit of some micrometres bends it; what is left beside it moves the
        range once more. Where slopes still change, a third follows.
        """
        samples, kind = self.samples, self.appearance.kind
        about = self.hits.centre
        if not self.hits.found.all():
            mean = samples.angles.sum(axis=2) / samples.theta.shape[1]
            about = np.where(self.hits.found[:, None], about, mean)
        rough = target_ranges(samples, self.response, kind, self.hits, about, self.stamp)
        plane = _plane_of(rough, middle, layout)
        for _ in range(_MOST_PLANES):
            shown, response, reach = self._lay_onto(plane)
            start = self._or_hits(self._circle(shown, response), plane)
            told = self._ranged(shown, start, 0.5 * self.appearance.diameter / plane.distance)
            ranges = target_ranges(samples, told, kind, start, about, self.stamp, plane=plane, reach=reach)
            turned = np.abs(ranges.slope - plane.slope).max(axis=1) > _LARGEST_TURN * plane.distance
            turned &= ranges.known
            if not turned.any():
                break
            plane = _turned_plane(plane, ranges, turned)
        planes = _plane_of(ranges, middle, layout, with_errors=self.is_graded)
        shown, response, reach = self._lay_onto(planes)
        if not self.fits:
            # Where the disc is fitted, its fit only begins at the circle.
            start = self._circle(shown, response)
        best = self._best(shown, response, start.repeated(len(shown.theta)), planes)
        found, distance = planes.seen(best)
        rows = slice(len(middle))
        centre = found.of(rows)
        if self.is_graded:
            moved = found.centre.reshape(1 + len(_SIGMA_POINTS), -1, 2)[1:] - centre.centre
            moved = np.where(np.isfinite(moved), moved, 0.0)
            centre = centre.worse_by((moved[..., :, None] * moved[..., None, :]).mean(axis=0))
        place = shown.angles[rows]
        by_light = None if best.gains is None else best.gains[rows] * response.value[rows, None]
        of_range = (ranges.off(centre)[:, :, None] * ranges.gains).sum(axis=1)
        left = np.where(of_range != 0.0, samples.range - reach[rows], 0.0)
        distance = distance[rows] + (of_range * left).sum(axis=1) - self._spot_shift(ranges, layout)
        sight = Sight(planes.of(rows), place, by_light, of_range)
        return centre, distance, ranges, sight

    def _spot_shift(self, ranges: Ranges, layout: tuple[float, float]) -> Array:
        """Return what the light of spots does to ranges on planes that lean so [m], shape (patterns,)."""
        if self.by_line is None:
            return np.zeros(len(ranges.at))
        theta, reach = ranges.about[:, 0], np.where(ranges.known, ranges.at, 1.0)
        slope = ranges.slope[:, 0] / reach, ranges.slope[:, 1] / (reach * np.cos(theta) - layout[0])
        shift = self.by_line * spot_shift(reach, theta, layout[1], slope, self.spot * reach)
        return np.where(ranges.known, shift, 0.0)

    def _circle(self, shown: PatternSamples, response: Response) -> Centroid:
        return circle_fit(shown, response, blurred=self.fits, rounds=0 if self.fits else None)

    def _or_hits(self, centroid: Centroid, plane: TargetPlane | None) -> Centroid:
        """Return the mean of the hits where there is no other centre."""
        if centroid.found.all():
            return centroid
        return better_of(centroid, self.hits if plane is None else plane.laid(self.hits))

    def _lay_onto(self, planes: TargetPlane) -> tuple[PatternSamples, Response, Array]:
        """Return samples, response and ranges on planes, light divided by that of the plane's tilt and range."""
        shown, light, reach = planes.flatten(self.samples)
        if self.appearance.kind.by_range:
            return shown, self.response, reach
        own = self.response.repeated(len(light))
        return shown, replace(own, value=own.value / light), reach

    def _disc(
        self, shown: PatternSamples, response: Response, start: Centroid, plane: TargetPlane | None
    ) -> Centroid:
        spot, error = self.spot, np.asarray(self.pointing, dtype=np.float64)
        if plane is not None:
            rows = len(shown.theta)
            spot = plane.spot(
                repeated(np.zeros(len(self.response.clear)) + spot, rows),
                shown,
                np.where(start.found[:, None], start.centre, 0.0),
            )
            error = repeated(error[:, None] if error.ndim == 1 else np.atleast_2d(error), rows)
            error = error * plane.stretch[:, None]
        fit = disc_fit(shown, response, start, spot=spot, duty_cycle=self.duty_cycle, pointing=error)
        patterns = len(self.response.clear)
        return averaged_disc(
            shown, response, fit, patterns, spot=spot, duty_cycle=self.duty_cycle, pointing=error
        )

    def _best(
        self,
        shown: PatternSamples,
        response: Response,
        start: Centroid,
        plane: TargetPlane | None = None,
    ) -> Centroid:
        """Return the best centres that the samples tell."""
        centre = self._or_hits(start, plane)
        if not self.is_graded:
            return centre
        fitted = self._or_hits(self._disc(shown, response, centre, plane), plane)
        if self.fits:
            return fitted
        believed = fitted.found
        if self.appearance.kind is TargetKind.RETRO:
            # A pulse beyond the amplifier's limit is taken to be as high as it is long, which tells no share of a spot.
            believed = believed & (self.by_line is not None) & ~response.clipped.any(axis=1)
            believed &= fitted.misfit <= _EXPLAINED
        if self.duty_cycle < 1.0:
            # The light leaves gaps. Where they hold the rim, nothing but the circle tells where it is. Which voxels are
            # at the rim their place says: by their light many would be that speckle alone makes darker.
            spot = repeated(np.zeros(len(self.response.clear)) + self.spot, len(shown.theta))[:, None]
            partly = ~fitted.away_from_rim(shown, _PARTIAL_SPOTS * spot, self.duty_cycle)
            believed = believed & ((partly & response.used).sum(axis=1) >= _FEWEST_PARTIAL)
        return better_of(replace(fitted, found=believed), centre)

    def _ranged(self, shown: PatternSamples, centre: Centroid, known: Array) -> Response:
        """Return what of the response tells the range.

        A mean of hits, which has no misfit, does not tell the rim, but with the radius that is ``known``, (patterns,).
        """
        blur = np.zeros((len(known), 1)) + 3.0 * np.reshape(self.spot, (-1, 1))
        crude = np.isnan(centre.misfit)
        if crude.any():
            centre = replace(centre, radius=np.where(crude, np.maximum(centre.radius, known), centre.radius))
            blur = blur + np.where(crude, centre.sigma.max(axis=1), 0.0)[:, None]
        whole = centre.away_from_rim(shown, blur, self.duty_cycle)
        inside = self.response.used & whole
        enough = inside.sum(axis=1, keepdims=True) >= _FEWEST_WHOLE
        return replace(
            self.response,
            used=np.where(enough, inside, self.response.used),
            hit=self.response.hit & (whole | ~enough),
        )


def _covariance(centre: Centroid, ranges: Ranges, sight: Sight | None) -> Array:
    """Return the covariance of positions, shape (patterns, 3, 3).

    The range is that of the plane at the centre that was found, so that an error δ of the centre on a target with the
    slope g = ∂R/∂(Θ, φ) moves it by g·δ; to it comes that of the plane's range there.
    """
    whole = np.zeros((len(ranges.at), 3, 3))
    off = ranges.off(centre)
    variance = (off * applied(ranges.covariance, off)).sum(axis=1)
    whole[:, :2, :2], whole[:, 2, 2] = centre.covariance, np.where(ranges.known, variance, np.nan)
    if sight is not None:
        shared = applied(centre.covariance, sight.plane.slope)
        whole[:, :2, 2] = whole[:, 2, :2] = shared
        whole[:, 2, 2] += (shared * sight.plane.slope).sum(axis=1)
    return whole


def _plane_of(
    ranges: Ranges, middle: Array, layout: tuple[float, float], *, with_errors: bool = False
) -> TargetPlane:
    """Return the planes on which targets lie; where nothing is known they face the scanner at the ``middle`` [m].

    ``with_errors`` five times as many: behind them those whose slopes are wrong by each of :data:`_SIGMA_POINTS`.
    """
    known = ranges.known
    distance = np.where(known & (ranges.at > layout[0]), ranges.at, middle)
    slope = np.where(known[:, None], ranges.slope, 0.0)
    if not with_errors:
        return target_plane(ranges.about, distance, slope, *layout)
    root = cholesky(np.where(known[:, None, None], ranges.covariance[:, 1:, 1:], 1e-12 * np.eye(2)))
    rows = (1 + len(_SIGMA_POINTS)) * len(known)
    return target_plane(
        repeated(ranges.about, rows),
        repeated(distance, rows),
        np.concatenate([slope, *(slope + applied(root, point) for point in _SIGMA_POINTS)]),
        *layout,
    )


def _turned_plane(plane: TargetPlane, ranges: Ranges, turned: Mask) -> TargetPlane:
    """Return planes as ranges tell them, where they are turned; the others as they were."""
    distance = np.where(turned, ranges.at, plane.distance)
    slope = np.where(turned[:, None], ranges.slope, plane.slope)
    return target_plane(plane.centre, distance, slope, plane.axis_separation, plane.baseline)
