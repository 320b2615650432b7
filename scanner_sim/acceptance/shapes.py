"""Spheres and planes through measured points, by least squares of orthogonal distances, and what their σ are.

All points count alike, whatever their σ; what these make of the result is propagated. A plane's normal and a sphere's
centre follow from deviations along the surface's normal alone (Forbes, *Least-squares best-fit geometric elements*, NPL
report DITC 140/89, 1989).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from scanner_sim.ranging.spot_light import spot_shift

Array = NDArray[np.float64]

CONE = math.cos(math.radians(60.0))
"""Cosine of half the cone of 120° about the line of sight from which a sphere's points are taken: beyond it the surface
is steep and its light uneven."""
FEWEST = 30
"""Points of a sphere or plate, fewer of which are no result."""
_DRAWS = 400
"""Draws that tell what noise makes of a form."""


@dataclass(frozen=True)
class Sight:
    """How triangulation saw the points of a cloud.

    Attributes
    ----------
    range, theta
        R [m] and Θ [rad], shape (n,).
    axes
        Directions across the beam in the plane of triangulation, normal to that, and along the beam, shape (n, 3, 3).
    spot
        Standard deviation of the beam's irradiance at each point [m], shape (n,).
    baseline
        d [m].
    """

    range: Array
    theta: Array
    axes: Array
    spot: Array
    baseline: float

    def chosen(self, where: NDArray[np.bool_]) -> Sight:
        """Return some of the points."""
        return Sight(self.range[where], self.theta[where], self.axes[where], self.spot[where], self.baseline)

    def moved_by_sphere(self, outward: Array, radius: float) -> Array:
        """Return what the light of a matt sphere with given normals moves its points by [m], shape (n, 3)."""
        across, normal, along = np.einsum("nij,nj->in", self.axes, outward)
        facing = np.minimum(along, -CONE)
        slope = -across / facing, -normal / facing
        shift = spot_shift(self.range, self.theta, self.baseline, slope, self.spot, 1.0 / radius)
        return np.asarray(shift[:, None] * self.axes[:, 2])


@dataclass(frozen=True)
class Cloud:
    """Measured points of one artefact.

    Attributes
    ----------
    points
        Places [m], shape (n, 3).
    covariance
        Of each, of what it has alone [m²], shape (n, 3, 3).
    shared
        What k independent numbers of unit variance move all of them by [m], shape (n, 3, k): unlike pixels, wobble.
    common
        The same of the calibration's errors, which are one and the same for all artefacts, shape (n, 3, c).
    uneven
        Variance by uneven light, which is part of ``covariance`` and no noise, along the beam [m²], shape (n,).
    sight
        How triangulation saw them; None where pulses told the ranges.
    """

    points: Array
    covariance: Array
    shared: Array
    common: Array
    uneven: Array
    sight: Sight | None = None

    def chosen(self, where: NDArray[np.bool_]) -> Cloud:
        """Return some of the points."""
        return Cloud(
            self.points[where],
            self.covariance[where],
            self.shared[where],
            self.common[where],
            self.uneven[where],
            None if self.sight is None else self.sight.chosen(where),
        )


@dataclass(frozen=True)
class Fit:
    """A sphere or a plane through points.

    Attributes
    ----------
    parameters
        Centre and diameter [m], shape (4,); of a plane slopes and offset in axes of its own, shape (3,).
    covariance
        Theirs as the points state it, without the calibration's errors.
    noise
        Theirs by noise alone: the scatter of repeated measurements.
    common
        What the calibration's errors, of unit variance, make of the parameters, shape (4 or 3, c).
    points
        All points, shape (n, 3).
    deviations
        Of all points from the surface, outwards or away from the scanner [m], shape (n,).
    used
        Which points the fit is of, and its form.
    form
        Spread of the deviations of the points that are used [m].
    expected_form, sigma_form
        Mean and standard deviation of the form that a perfect surface has by its points' noise alone [m].
    """

    parameters: Array
    covariance: Array
    noise: Array
    common: Array
    points: Array
    deviations: Array
    used: NDArray[np.bool_]
    form: float
    expected_form: float
    sigma_form: float


def fit_sphere(cloud: Cloud, discarded: float, generator: np.random.Generator) -> Fit | None:
    """Fit centre and diameter of a matt sphere to the points within 60° of the line of sight.

    Its light is that of its form (:func:`~scanner_sim.ranging.spot_light.spot_shift`), and what that does to
    triangulated ranges is taken off: left alone it moves a centre by 0.3 mm at 3 m. σ holds no uneven light then.

    Parameters
    ----------
    cloud
        Points before a scanner at the origin.
    discarded
        Largest share of the points that may be left out.
    generator
        Of the draws that tell what noise makes of the form.

    Returns
    -------
    Fit
        Or None where too few points are left.
    """
    if len(cloud.points) < FEWEST:
        return None
    measured = cloud
    found = _algebraic(cloud.points)
    kept = np.ones(len(cloud.points), np.bool_)
    for round_ in range(8):
        before, cloud = kept, _in_its_light(measured, found)
        away = cloud.points - found[:3]
        kept = -(away @ found[:3]) > CONE * np.linalg.norm(found[:3]) * np.linalg.norm(away, axis=1)
        if kept.sum() < FEWEST:
            return None
        found = _orthogonal(cloud.points[kept], found)
        # The first sphere is that of points as they were measured.
        if round_ and (kept == before).all():
            break
    left = kept.copy()
    left[kept] = _kept(_radial(cloud.points[kept], found), discarded)
    found = _orthogonal(cloud.points[left], found)
    away = cloud.points - found[:3]
    normal = away / np.linalg.norm(away, axis=1)[:, None]
    design = np.concatenate([normal, np.full((len(normal), 1), 0.5)], axis=1)
    parameters = np.append(found[:3], 2.0 * found[3])
    return _fit(
        cloud, parameters, design, normal, _radial(cloud.points, found), kept, left, discarded, generator
    )


def fit_plane(cloud: Cloud, discarded: float, generator: np.random.Generator) -> Fit | None:
    """Fit a plane to points; parameters, faults and results as of :func:`fit_sphere`."""
    if len(cloud.points) < FEWEST:
        return None
    everything = np.ones(len(cloud.points), np.bool_)
    middle, axes = _principal(cloud.points)
    left = _kept((cloud.points - middle) @ axes[2], discarded)
    middle, axes = _principal(cloud.points[left])
    across = (cloud.points - middle) @ axes.T
    design = np.column_stack([across[:, :2], np.ones(len(across))])
    normal = np.tile(axes[2], (len(across), 1))
    return _fit(cloud, np.zeros(3), design, normal, across[:, 2], everything, left, discarded, generator)


def _in_its_light(cloud: Cloud, found: Array) -> Cloud:
    """Return a cloud without what the light of the sphere that was found does to its points."""
    if cloud.sight is None:
        return cloud
    along, points = cloud.sight.axes[:, 2], cloud.points
    for _ in range(2):  # The normal is that of where the beam meets the sphere.
        away = points - found[:3]
        outward = away / np.linalg.norm(away, axis=1)[:, None]
        points = cloud.points - cloud.sight.moved_by_sphere(outward, float(found[3]))
    own = cloud.covariance - cloud.uneven[:, None, None] * along[:, :, None] * along[:, None]
    return replace(cloud, points=points, covariance=own, uneven=0.0 * cloud.uneven)


def _fit(
    cloud: Cloud,
    parameters: Array,
    design: Array,
    normal: Array,
    deviations: Array,
    kept: NDArray[np.bool_],
    used: NDArray[np.bool_],
    discarded: float,
    generator: np.random.Generator,
) -> Fit:
    """Return a fit with what the points' errors along the normals make of it."""
    gain = np.linalg.pinv(design[used])
    own = np.einsum("ni,nij,nj->n", normal, cloud.covariance, normal)
    beam = cloud.points / np.linalg.norm(cloud.points, axis=1)[:, None]
    noise = np.maximum(own - cloud.uneven * (normal * beam).sum(axis=1) ** 2, 0.0)
    shared = np.einsum("ni,nik->nk", normal, cloud.shared)
    common = np.einsum("ni,nik->nk", normal, cloud.common)
    moved = gain @ shared[used]
    mean, spread = _expected_form(design[kept], noise[kept], shared[kept], discarded, generator)
    return Fit(
        parameters,
        (gain * own[used]) @ gain.T + moved @ moved.T,
        (gain * noise[used]) @ gain.T + moved @ moved.T,
        gain @ common[used],
        cloud.points,
        deviations,
        used,
        float(np.ptp(deviations[used])),
        mean,
        spread,
    )


def _expected_form(
    design: Array, noise: Array, shared: Array, discarded: float, generator: np.random.Generator
) -> tuple[float, float]:
    """Return mean and standard deviation of the form of a perfect surface, by draws of the points' noise."""
    errors = np.sqrt(noise)[:, None] * generator.standard_normal((len(noise), _DRAWS))
    errors += shared @ generator.standard_normal((shared.shape[1], _DRAWS))
    basis, _ = np.linalg.qr(design)
    errors -= basis @ (basis.T @ errors)
    stay = len(errors) - math.floor(discarded * len(errors))
    nearest, farthest = np.split(np.argpartition(np.abs(errors), stay - 1, axis=0), [stay])
    # Fitted again to those that stay: where others leave, BᵀB is no longer 1, nor Bᵀe 0.
    gone = basis[farthest]
    squares = np.eye(basis.shape[1]) - np.einsum("gdp,gdq->dpq", gone, gone)
    moved = -np.einsum("gdp,gd->dp", gone, np.take_along_axis(errors, farthest, axis=0))
    errors -= basis @ np.linalg.solve(squares, moved[:, :, None])[:, :, 0].T
    forms = np.ptp(np.take_along_axis(errors, nearest, axis=0), axis=0)
    return float(forms.mean()), float(forms.std(ddof=1))


def _kept(deviations: Array, discarded: float) -> NDArray[np.bool_]:
    """Return which points stay when the allowed share of those farthest from the surface is left out."""
    kept = np.ones(len(deviations), np.bool_)
    count = math.floor(discarded * len(deviations))
    if count:
        kept[np.argsort(np.abs(deviations), kind="stable")[-count:]] = False
    return kept


def _algebraic(points: Array) -> Array:
    """Return centre and radius that make |p|² = 2 p·c + (r² − c²) hold best: a start, shape (4,)."""
    shift = points.mean(axis=0)
    local = points - shift
    system = np.column_stack([2.0 * local, np.ones(len(local))])
    found = np.linalg.lstsq(system, (local**2).sum(axis=1), rcond=None)[0]
    radius = math.sqrt(max(float(found[3] + found[:3] @ found[:3]), 1e-12))
    return np.append(found[:3] + shift, radius)


def _radial(points: Array, found: Array) -> Array:
    return np.asarray(np.linalg.norm(points - found[:3], axis=1) - found[3])


def _orthogonal(points: Array, start: Array) -> Array:
    """Return centre and radius with the least sum of squared distances from the sphere, shape (4,)."""

    def slopes(found: Array) -> Array:
        away = points - found[:3]
        radius = np.linalg.norm(away, axis=1)[:, None]
        return np.concatenate([-away / radius, -np.ones((len(points), 1))], axis=1)

    found = least_squares(lambda at: _radial(points, at), start, slopes, method="lm", xtol=1e-12, ftol=1e-14)
    return np.asarray(found.x)


def _principal(points: Array) -> tuple[Array, Array]:
    """Return the mean of points and their principal axes as rows, the last one their plane's normal, away."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2]
    if axes[2] @ middle < 0.0:
        axes = axes * [[1.0], [1.0], [-1.0]]
    return middle, np.asarray(axes)
