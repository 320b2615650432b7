"""A flat target seen under its tilt: voxels on its plane, where a disc is a circle whatever its attitude."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import inverse, product
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.tracking.centroid import Centroid, centroid_of
from scanner_sim.tracking.samples import PatternSamples

Array = NDArray[np.float64]

_STEEPEST = 3.7
"""Rise of the range over the range, per angle, beyond which a plane is taken for none: a tilt of 75°."""


@dataclass(frozen=True)
class TargetPlane:
    """Planes of targets, one for each pattern; in the scanner's frame.

    Attributes
    ----------
    point
        Its foot, a point near the target's centre [m], shape (patterns, 3).
    across, down
        Unit vectors in the plane, along growing Θ and, at right angles to it, growing φ, shape (patterns, 3).
    distance
        R of the foot [m], shape (patterns,): lengths on the plane are divided by it.
    change
        ∂(u, v)/∂(Θ, φ) at the foot, shape (patterns, 2, 2).
    stretch
        1/√cos of the tilt: what it adds to a spot's width in the geometric mean of both directions, (patterns,).
    lean
        Tangent of the tilt times its direction on the plane, along which a round beam's spot is longer, (patterns, 2).
    centre, slope
        (Θ, φ) of the foot [rad], and ∂R/∂(Θ, φ) there [m/rad], shape (patterns, 2).
    axis_separation
        D_g [m].
    """

    point: Array
    across: Array
    down: Array
    distance: Array
    change: Array
    stretch: Array
    lean: Array
    centre: Array
    slope: Array
    axis_separation: float

    def flatten(self, samples: PatternSamples) -> tuple[PatternSamples, Array]:
        """Return samples with the plane's coordinates (u, v) about the foot, over its range, in place of the angles.

        They are where the beam along the measured deflections (eq 3) meets the plane: a disc's rim is a circle of the
        radius D/2R, and its middle is the middle, which an ellipse's in the angles is not. Beside them the laser light
        that a matt plane sends back from there over that from the foot, cos θ/R² by Lambert's law and the solid angle
        of the aperture, shape (patterns, points): it changes by a per cent over a disc of 100 mm at 8 m under 15°,
        which moves the middle of its edges by some microradians.
        """
        apart, along, rise, reach = self._met(samples.theta, samples.phi)
        met = [reach * along[axis] - apart[axis] for axis in range(3)]
        u, v = (_dot(axis / self.distance[:, None], met) for axis in (self.across, self.down))
        light = np.abs(rise) * (self.stretch * self.distance)[:, None] ** 2 / reach**2
        return replace(samples, theta=u, phi=v), light

    def reach(self, theta: Array, phi: Array) -> Array:
        """Return the ranges R [m] at which beams along deflections meet the planes, exactly, (patterns, points)."""
        return self._met(theta, phi)[3]

    def _met(self, theta: Array, phi: Array) -> tuple[list[Array], list[Array], Array, Array]:
        """Return way from beams' origins to the feet, directions, their share along the normal, and R of the plane."""
        origin, along = _beam(theta, phi, self.axis_separation)
        normal = _cross(self.across, self.down)
        apart = [self.point[:, axis : axis + 1] - origin[axis] for axis in range(3)]
        rise = _dot(normal, along)
        return apart, along, rise, _dot(normal, apart) / rise

    def steeper(self, change: Array) -> TargetPlane:
        """Return the planes through the same feet with other slopes, by ``change`` [m/rad], shape (patterns, 2)."""
        return target_plane(self.centre, self.distance, self.slope + change, self.axis_separation)

    def spot(self, beam: ArrayLike, shown: PatternSamples, centre: Array) -> Array:
        """Return the standard deviation of a spot on the plane away from a centre, shape (patterns, points).

        s √(1 + (n·l)²) of a round beam s, () or (patterns,), with n the direction from ``centre`` (patterns, 2) to a
        voxel and l the plane's ``lean``: across a tilted disc's rim the spot is longer where this faces the tilt.
        """
        u, v = shown.theta - centre[:, :1], shown.phi - centre[:, 1:]
        along = (u * self.lean[:, :1] + v * self.lean[:, 1:]) ** 2 / np.maximum(u**2 + v**2, 1e-300)
        spot: Array = np.reshape(np.asarray(beam, dtype=np.float64), (-1, 1)) * np.sqrt(1.0 + along)
        return spot

    def seen(self, centroid: Centroid) -> Centroid:
        """Return centres on the plane as (Θ, φ) [rad]; the radius stays, an angle at the range of the foot."""
        moved = centroid.centre[:, :1] * self.across + centroid.centre[:, 1:] * self.down
        x, y, z = (self.point + self.distance[:, None] * moved).T
        _, theta, phi = angles_and_range(x, y, z, self.axis_separation)
        back = inverse(self.change)
        return centroid_of(
            np.stack([theta, phi], axis=1),
            product(back, centroid.covariance, back.transpose(0, 2, 1)),
            centroid.radius,
            centroid.sigma_radius,
            centroid.misfit,
            centroid.found,
        )


def target_plane(centre: Array, distance: Array, slope: Array, axis_separation: float) -> TargetPlane:
    """Return the planes of targets.

    Parameters
    ----------
    centre
        (Θ, φ) of a point near the target's centre [rad], shape (patterns, 2).
    distance
        R of the plane there [m], shape (patterns,).
    slope
        ∂R/∂(Θ, φ) of the plane there [m/rad], shape (patterns, 2); planes steeper than 75° are taken to face.
    axis_separation
        D_g [m].

    Returns
    -------
    TargetPlane
        Spanned by ∂X/∂Θ + (∂R/∂Θ) ∂X/∂R and the like for φ, with X(Θ, φ, R) of eq 3: in the axes of the deflected
        optics (across the beam, normal to the triangulation, along the beam) these are (R, 0, ∂R/∂Θ) and
        (0, R cosΘ − D_g, ∂R/∂φ).
    """
    g, h = (np.where(np.hypot(*slope.T) < _STEEPEST * distance, rise, 0.0) for rise in slope.T)
    (sine, sine_phi), (cosine, cosine_phi) = np.sin(centre).T, np.cos(centre).T
    reach = distance * cosine - axis_separation
    side, up = (
        np.sqrt(distance**2 + g**2),
        np.sqrt((g * reach) ** 2 + (distance * h) ** 2 + (distance * reach) ** 2),
    )
    right, forth = distance / side, g / side
    normal = -g * reach / up, -distance * h / up, distance * reach / up
    down = normal[1] * forth, normal[2] * right - normal[0] * forth, -normal[1] * right
    axes = np.empty((len(centre), 3, 3))
    axes[:, 0, 0], axes[:, 0, 1], axes[:, 0, 2] = cosine, -sine * sine_phi, -sine * cosine_phi
    axes[:, 1, 0], axes[:, 1, 1], axes[:, 1, 2] = 0.0, cosine_phi, -sine_phi
    axes[:, 2, 0], axes[:, 2, 1], axes[:, 2, 2] = sine, cosine * sine_phi, cosine * cosine_phi
    edges, point = np.zeros((len(centre), 2, 3)), distance[:, None] * axes[:, 2]
    edges[:, 0, 0], edges[:, 0, 2] = right, forth
    edges[:, 1, 0], edges[:, 1, 1], edges[:, 1, 2] = down
    point[:, 1] -= axis_separation * sine_phi
    point[:, 2] += axis_separation * (1.0 - cosine_phi)
    change = np.zeros((len(centre), 2, 2))
    change[:, 0, 0], change[:, 0, 1] = side / distance, g * h / (side * distance)
    change[:, 1, 1] = (reach * down[1] + h * down[2]) / distance
    spanned = product(edges, axes)
    return TargetPlane(
        point=point,
        across=spanned[:, 0],
        down=spanned[:, 1],
        distance=distance,
        change=change,
        stretch=1.0 / np.sqrt(normal[2]),
        lean=np.stack([forth, down[2]], axis=1) / normal[2][:, None],
        centre=centre,
        slope=np.stack([g, h], axis=1),
        axis_separation=axis_separation,
    )


def _beam(theta: Array, phi: Array, axis_separation: float) -> tuple[list[Array], list[Array]]:
    """Return origin [m] and direction of beams by component: X = origin + R direction is eq 3."""
    sine, cosine, forward = np.sin(phi), np.cos(phi), np.cos(theta)
    origin = [np.zeros_like(phi), -axis_separation * sine, axis_separation * (1.0 - cosine)]
    return origin, [np.sin(theta), forward * sine, forward * cosine]


def _dot(vectors: Array, parts: list[Array]) -> Array:
    """Return the products of vectors, shape (patterns, 3), with others given by component, (patterns, points) each."""
    x, y, z = (vectors[:, axis : axis + 1] for axis in range(3))
    return x * parts[0] + y * parts[1] + z * parts[2]


def _cross(first: Array, second: Array) -> Array:
    """Return vector products, shape (patterns, 3): NumPy's own takes three times as long for one pattern."""
    (a, b, c), (d, e, f) = first.T, second.T
    return np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)
