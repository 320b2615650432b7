"""The centre of a target: mean of the hits, or a circle through its edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import product, solve_linear
from scanner_sim.tracking.response import Response, repeated
from scanner_sim.tracking.samples import PatternSamples, rise_per_point

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_IDENTITY = np.eye(3)
_REGULARISATION = 1e-12 * _IDENTITY
"""Makes the normal matrix of a circle without edges a regular one."""
_COVERAGE_ERROR = 0.1
"""Error of the mean of hits, over the radius, because a pattern does not cover its area evenly: measured on discs of
0.6 to 0.7 of the amplitude within 0.3 of it from the centre; smaller discs there are worse."""
_FEWEST_EDGES = 4
"""Fewest crossings of an edge that make a circle with something to check it by."""
_EDGE_ERROR = 0.1
"""Error of an edge between two points, over their distance: the edge is blurred, and not straight between them."""
ALL_ANGLES = float(np.pi)
"""Standard deviation [rad] of a centre of which nothing is known: beyond it lie all directions."""
_SHARP_EDGE_ERROR = 12.0**-0.5
"""The same where the values on both sides do not tell how near it is: anywhere between the points."""
_CONVERGED_STEP = 1e-4
"""Step, over the circle's size, with which it comes to rest: the next would be far smaller."""
_MOST_STEPS = 8
"""Gauss–Newton steps of a circle: they double the digits each, and three do."""


@dataclass(frozen=True)
class Centroid:
    """Centres of a target by pattern.

    Attributes
    ----------
    centre
        (Θ, φ) [rad], shape (patterns, 2); NaN where there is none.
    covariance
        Its covariance [rad²], shape (patterns, 2, 2).
    radius, sigma_radius
        Radius of the target [rad], shape (patterns,).
    misfit
        χ² of the fit over its degrees of freedom, shape (patterns,); NaN for the mean of hits.
    found
        Whether there is a centre, shape (patterns,).
    gains
        ∂centre/∂(value of each voxel), shape (patterns, 2, points), 0 where there is no centre; None where it was not
        found by values.
    """

    centre: Array
    covariance: Array
    radius: Array
    sigma_radius: Array
    misfit: Array
    found: Mask
    gains: Array | None = None

    def worse_by(self, covariance: Array) -> Centroid:
        """Return the centres with a covariance [rad²] more, shape (patterns, 2, 2); not found where it is absurd."""
        return centroid_of(
            self.centre,
            self.covariance + covariance,
            self.radius,
            self.sigma_radius,
            self.misfit,
            self.found,
        )

    def of(self, rows: slice | NDArray[np.intp]) -> Centroid:
        """Return some of the patterns."""
        return Centroid(**{name: part[rows] for name, part in vars(self).items() if part is not None})

    def repeated(self, rows: int) -> Centroid:
        """Return so many rows: the patterns again and again."""
        if rows == len(self.found):
            return self
        return Centroid(
            **{name: repeated(part, rows) for name, part in vars(self).items() if part is not None}
        )

    def away_from_rim(self, samples: PatternSamples, blur: Array, duty_cycle: float) -> Mask:
        """Return the voxels whose whole spot lies on one side of the rim, but for ``blur`` [rad] and a dwell's way.

        Where one side is darker, the light's middle is not the spot's: at 4 m that moves single ranges by 10 mm.
        """
        off_theta, off_phi = samples.theta - self.centre[:, :1], samples.phi - self.centre[:, 1:]
        rise = rise_per_point(samples.angles)
        way = np.hypot(rise[:, 0], rise[:, 1])
        off = np.abs(np.hypot(off_theta, off_phi) - self.radius[:, None])
        return np.asarray(off > blur + 0.5 * duty_cycle * way)

    @property
    def sigma(self) -> Array:
        """Standard deviations of Θ and φ [rad], shape (patterns, 2)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)))


def centroid_of(
    centre: Array,
    covariance: Array,
    radius: Array,
    sigma_radius: Array,
    misfit: Array,
    found: Mask,
    gains: Array | None = None,
) -> Centroid:
    """Return a centroid that is NaN wherever it was not found. Arguments as the attributes.

    A centre whose σ is beyond all angles was not found either: the pattern showed nothing of it.
    """
    found = found & (np.maximum(covariance[:, 0, 0], covariance[:, 1, 1]) < ALL_ANGLES**2)
    if found.all():
        return Centroid(centre, covariance, radius, sigma_radius, misfit, found, gains)
    blank = np.where(found, 0.0, np.nan)
    return Centroid(
        centre + blank[:, None],
        covariance + blank[:, None, None],
        radius + blank,
        sigma_radius + blank,
        misfit + blank,
        found,
        None if gains is None else np.where(found[:, None, None], gains, 0.0),
    )


def hit_centroid(samples: PatternSamples, response: Response) -> Centroid:
    """Return the mean of the angles of all hits.

    Simple, and never far off; but drawn towards the pattern's centre, and as rough as its points. The radius is √2
    times the rms distance of the hits from their mean (that of an evenly covered disc). The variance is that of the
    edge's crossings, each of which lies somewhere between two points: Σ (x_k − c)²/(12 n²), plus (0.1 r)² for the
    uneven cover.
    """
    hit = response.hit.astype(np.float64)
    count = hit.sum(axis=1)
    n = np.maximum(count, 1.0)
    centre = (hit[:, None] * samples.angles).sum(axis=2) / n[:, None]
    away = samples.angles - centre[..., None]
    radius = np.sqrt(2.0 * (hit * (away[:, 0] ** 2 + away[:, 1] ** 2)).sum(axis=1) / n)
    crossing = response.hit[:, 1:] != response.hit[:, :-1]
    edge = 0.5 * (away[..., 1:] + away[..., :-1]) * crossing[:, None]
    spread = product(edge, edge.transpose(0, 2, 1)) / (12.0 * n**2)[:, None, None]
    covariance = spread + (_COVERAGE_ERROR * radius)[:, None, None] ** 2 * _IDENTITY[:2, :2]
    nothing = np.full(len(n), np.nan)
    return centroid_of(centre, covariance, radius, 0.1 * radius, nothing, response.clear & (count > 0))


def edge_points(samples: PatternSamples, response: Response) -> tuple[Array, Mask]:
    """Return where the pattern crosses the target's edge, and which of the gaps between points do.

    Between two points, one on the target and one off it, the edge is where the straight line through their values
    reaches the threshold: (patterns, points − 1, 2) [rad] and (patterns, points − 1).
    """
    v = response.value
    crossing = (response.hit[:, 1:] != response.hit[:, :-1]) & response.used[:, 1:] & response.used[:, :-1]
    step = np.where(crossing, v[:, 1:] - v[:, :-1], 1.0)
    share = (response.threshold[:, None] - v[:, :-1]) / np.where(step == 0.0, 1.0, step)
    share = np.minimum(np.maximum(share, 0.0), 1.0)
    angles = np.concatenate([samples.theta[..., None], samples.phi[..., None]], axis=-1)
    points = angles[:, :-1] + share[..., None] * (angles[:, 1:] - angles[:, :-1])
    return points, crossing


def circle_fit(
    samples: PatternSamples, response: Response, *, blurred: bool = True, rounds: int | None = None
) -> Centroid:
    """Return the circle through the crossings of the target's edge (:func:`edge_points`).

    Least squares of the distance from the circle, Σ(|x_k − c| − r)², started at the algebraic circle (Kåsa, *IEEE
    Transactions on Instrumentation and Measurement* 25, 1976) and weighed by Huber's function at 2 of the residuals'
    scale, so that a few false edges do not draw it. The covariance is (JᵀWJ)⁻¹ times the residuals' variance, or
    times (0.1 of the points' distance)² where that is more, or (0.29 of it)² for an edge that is not ``blurred``; the
    misfit is their rms over the radius, squared. Fewer ``rounds`` of the adjustment do for what only begins there.
    """
    points, crossing = edge_points(samples, response)
    weight = crossing.astype(np.float64)
    count = weight.sum(axis=1)
    enough = response.clear & (count >= _FEWEST_EDGES)
    n = np.maximum(count, 1.0)
    middle = product(weight[:, None], points)[:, 0] / n[:, None]
    x = points - middle[:, None]
    square = x[..., 0] ** 2 + x[..., 1] ** 2
    size = np.sqrt((weight * square).sum(axis=1) / n)
    size = np.where(size > 0.0, size, 1.0)
    across, down = x[..., 0] / size[:, None], x[..., 1] / size[:, None]
    columns = np.ones((len(x), 3, x.shape[1]))
    columns[:, 0], columns[:, 1] = across, down
    weighted = columns * weight[:, None]
    # The solution stands first, the inverse of the matrix behind it.
    right = np.zeros((len(x), 3, 4))
    right[:, :, 1:] = _IDENTITY
    right[:, :, :1] = product(weighted, (square / size[:, None] ** 2)[..., None])
    solved = solve_linear(product(weighted, columns.transpose(0, 2, 1)) + _REGULARISATION, right)
    centre, inverse = 0.5 * solved[:, :2, 0], solved[..., 1:]
    radius = np.sqrt(np.maximum(solved[:, 2, 0] + (centre**2).sum(axis=1), 1e-12))
    # A row that has come to rest stays as it is: no result depends on the batch.
    moving = enough
    scale, columns[:, 2] = np.zeros(len(x)), -1.0
    for _ in range(_MOST_STEPS if rounds is None else rounds):
        away = across - centre[:, :1], down - centre[:, 1:]
        distance = np.maximum(np.sqrt(away[0] ** 2 + away[1] ** 2), 1e-9)
        residual = distance - radius[:, None]
        spread = np.sqrt((weight * residual**2).sum(axis=1) / np.maximum(n - 3.0, 1.0))
        tame = weight * np.minimum(1.0, 2.0 * spread[:, None] / np.maximum(np.abs(residual), 1e-12))
        columns[:, 0], columns[:, 1] = -away[0] / distance, -away[1] / distance
        weighted = columns * tame[:, None]
        right[:, :, :1] = product(weighted, -residual[..., None])
        solved = solve_linear(product(weighted, columns.transpose(0, 2, 1)) + _REGULARISATION, right)
        if moving.all():
            inverse, scale = solved[..., 1:], spread
        else:
            inverse = np.where(moving[:, None, None], solved[..., 1:], inverse)
            scale = np.where(moving, spread, scale)
        # A circle through an arc that hardly bends may run away; half its radius a step is enough for any other.
        change = np.where(moving[:, None], np.clip(solved[..., 0], -0.5, 0.5), 0.0)
        moving = moving & (np.abs(change).max(axis=1) > _CONVERGED_STEP)
        centre, radius = centre + change[:, :2], np.abs(radius + change[:, 2])
        if not moving.any():
            break
    # Four edges leave one residual, which may be small by chance: no edge is better than the interpolation.
    apart = ((samples.angles[..., 1:] - samples.angles[..., :-1]) ** 2).sum(axis=1)
    least = (_EDGE_ERROR if blurred else _SHARP_EDGE_ERROR) * np.sqrt((weight * apart).sum(axis=1) / n)
    covariance = inverse * np.maximum(scale * size, least)[:, None, None] ** 2
    return centroid_of(
        middle + centre * size[:, None],
        covariance[:, :2, :2],
        radius * size,
        np.sqrt(covariance[:, 2, 2]),
        (scale / np.maximum(radius, 1e-9)) ** 2,
        enough,
    )


def better_of(first: Centroid, second: Centroid) -> Centroid:
    """Return the first centroid of each pattern or, where there is none, the second, which no value moves."""
    if first.found.all():
        return first
    chosen = {
        name: np.where(
            first.found.reshape(-1, *[1] * (getattr(first, name).ndim - 1)),
            getattr(first, name),
            getattr(second, name),
        )
        for name in ("centre", "covariance", "radius", "sigma_radius", "misfit", "found")
    }
    gains = None if first.gains is None else np.where(first.found[:, None, None], first.gains, 0.0)
    return Centroid(**chosen, gains=gains)
