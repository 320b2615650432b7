"""The middle of a sphere of known radius, by the ranges of its near side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import applied, columns, inverse, product
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.ranging.spot_light import spot_shift
from scanner_sim.tracking.disc_fit import by_voxel
from scanner_sim.tracking.samples import PatternSamples, rise_per_point

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CAP = 0.8
"""Part of the radius about the sight of the middle within which ranges count: beyond, slopes are above 53°."""
_FEWEST = 8
"""Fewest ranges that tell a middle, how it comes nearer, and something to check them by."""
_STEPS, _CHOOSING = 7, 4
"""Gauss–Newton steps, and in how many of them the voxels that count are chosen anew: from a tenth of the radius off
three do, and a voxel at the border of the cap would come and go for ever."""
_SETTLED = 1e-3
"""Last step, over the radius, of a fit that has come to rest."""
_NODES, _WEIGHTS = (-np.sqrt(0.15), 0.0, np.sqrt(0.15)), (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)
"""Gauss and Legendre's rule over a dwell's way."""
_FOUR = np.eye(4)


@dataclass(frozen=True)
class SphereFit:
    """Middles of spheres by pattern.

    Attributes
    ----------
    position, covariance
        (Θ, φ, R) [rad, m], shape (patterns, 3), and its covariance (patterns, 3, 3).
    misfit
        χ² over degrees of freedom, shape (patterns,).
    found
        Whether there are ranges enough, shape (patterns,).
    """

    position: Array
    covariance: Array
    misfit: Array
    found: Mask


@dataclass(frozen=True)
class _Beams:
    """Beams of voxels: where they begin (eq 3), and unit vectors along and across them, each (patterns, 3, points)."""

    origin: Array
    along: Array
    right: Array
    up: Array

    @classmethod
    def of(cls, angles: Array, axis_separation: float) -> _Beams:
        """Return those of deflections (patterns, 2, points)."""
        theta, phi = angles[:, 0], angles[:, 1]
        sine, cosine, turned, ahead = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
        none = np.zeros(theta.shape)
        return cls(
            columns(none, -axis_separation * sine, axis_separation * (1.0 - cosine)),
            columns(turned, ahead * sine, ahead * cosine),
            columns(ahead, -turned * sine, -turned * cosine),
            columns(none, cosine, -sine),
        )

    def meet(self, middle: Array, radius: float) -> tuple[Array, Array, Array]:
        """Return the range at which beams meet spheres, the normals there, and how far they pass from the middles.

        Shapes (patterns, points), (patterns, 3, points) and (patterns, points). Beams that miss meet the sphere where
        they pass nearest.
        """
        apart = middle - self.origin
        ahead = (apart * self.along).sum(axis=1)
        off = (apart * apart).sum(axis=1) - ahead * ahead
        reach = ahead - np.sqrt(np.maximum(radius * radius - off, 0.0))
        normal = (reach[:, None] * self.along - apart) / radius
        return reach, normal, np.sqrt(np.maximum(off, 0.0))

    def lit(self, middle: Array, radius: float, baseline: float) -> tuple[Array, Array]:
        """Return the ranges of matt spheres, and the light that a lens a baseline aside has of them but for a factor.

        The lens stands beside the beam's beginning, along the scanner's x axis.
        """
        reach, normal, _ = self.meet(middle, radius)
        way = -reach[:, None] * self.along
        way[:, 0] += baseline
        square = (way * way).sum(axis=1)
        return reach, np.maximum((normal * way).sum(axis=1), 0.0) / (square * np.sqrt(square))


def sphere_fit(
    samples: PatternSamples,
    hit: Mask,
    start: Array,
    outline: Array,
    radius: float,
    *,
    stamp: Array,
    layout: tuple[float, float],
    by_line: Array | None,
    spot: ArrayLike,
    duty_cycle: float = 1.0,
    pointing: ArrayLike = 0.0,
) -> SphereFit:
    """Return the spheres that explain the ranges of patterns best.

    Parameters
    ----------
    samples, hit
        The patterns, and which of their voxels lie on the sphere, shape (patterns, points).
    start
        (Θ, φ, R) of the middles by the spheres' outlines, from which the search begins, shape (patterns, 3); NaN where
        there is none.
    outline
        Covariance of its angles [rad²], shape (patterns, 2, 2).
    radius
        Their radius [m].
    stamp
        Time to which the middles belong [s], shape (patterns,).
    layout
        D_g [m], by which deflections and ranges become points (eq 3), and the distance d from the laser to the lens
        that sees its light [m].
    by_line
        Triangulation's share of the ranges where the line sensor sees the light, shape (patterns,): that share of
        what the sphere's slopes and its bend do to the middle of a spot's light is taken off
        (:func:`~scanner_sim.ranging.spot_light.spot_shift`). None where pulses alone tell.
    spot, duty_cycle, pointing
        Spot as an angle, share of the dwell with light and error of the angles: see
        :func:`~scanner_sim.tracking.disc_fit.disc_fit`.

    Returns
    -------
    SphereFit
        Minimises Σ (R − R(C))²/σ² over the middle C in (Θ, φ, R) and its rate of R, by the voxels that lie within 0.8
        of the radius; σ² is σ_R² and what the angles' errors make on the slope i, (R σ_θ tan i)². The range R(C) of a
        voxel is the mean over the way of its dwell, weighed by the light that a matt sphere returns from there. The
        outline is one more observation; by the line sensor its φ alone, for one side of a sphere is seen beside the
        ground there, in two peaks, and the other beside its own shadow: Θ lies 3 mm aside on spheres of 200 mm.
        Covariance (JᵀWJ)⁻¹, times the misfit where that is above 1.
    """
    separation, baseline = layout
    known = np.asarray(np.isfinite(start).all(axis=1))
    valid = hit & samples.valid & known[:, None]
    measured, sigma = (np.where(valid, part, 1.0) for part in (samples.range, samples.sigma_range))
    error, width = (by_voxel(part, len(start)) for part in (pointing, spot))
    later = (samples.time - stamp[:, None]) / np.ptp(samples.time, axis=1)[:, None]
    way = duty_cycle * rise_per_point(samples.angles)
    swept = [_Beams.of(samples.angles + share * way, separation) for share in _NODES]
    own = swept[1]
    state = np.zeros((len(start), 4))
    state[:, :3] = np.where(known[:, None], start, [0.0, 0.0, 2.0 * radius])
    seen, spread = state[:, :2].copy(), np.where(known[:, None, None], outline, _FOUR[:2, :2])
    sure = inverse(spread)
    if by_line is not None:
        sure = np.zeros(spread.shape)
        sure[:, 1, 1] = 1.0 / spread[:, 1, 1]
    design = np.empty((len(start), 4, measured.shape[1]))
    chosen = valid
    for number in range(_STEPS):
        middle, change = _middle(state, separation)
        size, sight = state[:, 2, None], change[:, 2, :, None]
        place = middle[:, :, None] + sight * (state[:, 3:] * later)[:, None]
        reach, normal, off = own.meet(place, radius)
        facing = np.minimum((normal * own.along).sum(axis=1), -np.sqrt(1.0 - _CAP**2))
        expected = _mean_range(swept, place, radius, baseline)
        if by_line is not None:
            slope = tuple(-(normal * across).sum(axis=1) / facing for across in (own.right, own.up))
            expected += by_line[:, None] * spot_shift(
                reach, samples.theta, baseline, (slope[0], slope[1]), width * reach, 1.0 / radius
            )
        chosen = valid & (off < _CAP * radius) if number < _CHOOSING else chosen
        steep = (1.0 - facing * facing) / (facing * facing)
        weight = np.where(chosen, 1.0 / (sigma**2 + steep * (reach * error) ** 2), 0.0)
        design[:, :3] = product(change, normal) / facing[:, None]
        design[:, :2] /= size[:, None]
        design[:, 3] = design[:, 2] * later
        left = np.where(chosen, measured - expected, 0.0)
        weighted = design * weight[:, None]
        matrix, right = product(weighted, design.transpose(0, 2, 1)), applied(weighted, left)
        matrix[:, :2, :2] += sure / size[:, None] ** 2
        right[:, :2] += applied(sure, seen - state[:, :2]) / size
        enough = chosen.sum(axis=1) >= _FEWEST
        matrix = np.where(enough[:, None, None], matrix, _FOUR)
        diagonal = matrix.reshape(-1, 16)[:, ::5]
        diagonal += 1e-9 * diagonal.sum(axis=1)[:, None]
        spread = inverse(matrix)
        step = np.where(enough[:, None], np.clip(applied(spread, right), -0.5 * radius, 0.5 * radius), 0.0)
        state[:, :2] += step[:, :2] / size
        state[:, 2:] += step[:, 2:]
    misfit = (weight * left**2).sum(axis=1) / np.maximum(chosen.sum(axis=1) - 4, 1)
    scale = columns(1.0 / size[:, 0], 1.0 / size[:, 0], np.ones(len(start)))
    covariance = spread[:, :3, :3] * (scale[:, :, None] * scale[:, None])
    return SphereFit(
        state[:, :3],
        covariance * np.maximum(misfit, 1.0)[:, None, None],
        misfit,
        known & enough & (np.abs(step[:, :3]).max(axis=1) < _SETTLED * radius),
    )


def _mean_range(swept: list[_Beams], place: Array, radius: float, baseline: float) -> Array:
    """Return the mean ranges over the ways of dwells, weighed by their light, shape (patterns, points)."""
    parts = [beams.lit(place, radius, baseline) for beams in swept]
    light = [share * bright for share, (_, bright) in zip(_WEIGHTS, parts, strict=True)]
    total = light[0] + light[1] + light[2]
    mean = light[0] * parts[0][0] + light[1] * parts[1][0] + light[2] * parts[2][0]
    return np.where(total > 0.0, mean / np.where(total > 0.0, total, 1.0), parts[1][0])


def _middle(state: Array, axis_separation: float) -> tuple[Array, Array]:
    """Return middles by eq 3, shape (patterns, 3), and their derivatives by (Θ, φ, R), (patterns, 3, 3)."""
    theta, phi, reach = state[:, 0], state[:, 1], state[:, 2]
    beams = _Beams.of(state[:, :2, None], axis_separation)
    change = columns(beams.right[..., 0], beams.up[..., 0], beams.along[..., 0])
    change[:, 0] *= reach[:, None]
    change[:, 1] *= (reach * np.cos(theta) - axis_separation)[:, None]
    return columns(*coordinates(reach, theta, phi, axis_separation)), change
