"""A flat target seen under its tilt: voxels on its plane, where a disc is a circle whatever its attitude."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import applied, columns, product
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
    axes
        Unit vectors by row, shape (patterns, 3, 3): in the plane, along growing Θ and, at right angles to it, growing
        φ; and the normal.
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
    baseline
        Distance d from the laser to the node of the lens that sees its light, along x [m]; 0 where both are one.
    """

    point: Array
    axes: Array
    distance: Array
    change: Array
    stretch: Array
    lean: Array
    centre: Array
    slope: Array
    axis_separation: float
    baseline: float = 0.0

    @cached_property
    def back(self) -> Array:
        """∂(Θ, φ)/∂(u, v) at the foot, shape (patterns, 2, 2): that of :attr:`change`, which has no lower corner."""
        back = np.zeros(self.change.shape)
        back[:, 0, 0], back[:, 1, 1] = 1.0 / self.change[:, 0, 0], 1.0 / self.change[:, 1, 1]
        back[:, 0, 1] = -self.change[:, 0, 1] * back[:, 0, 0] * back[:, 1, 1]
        return back

    def flatten(self, samples: PatternSamples) -> tuple[PatternSamples, Array, Array]:
        """Return samples with the plane's coordinates (u, v) about the foot, over its range, in place of the angles.

        They are where the beam along the measured deflections (eq 3) meets the plane: a disc's rim is a circle of the
        radius D/2R, and its middle is the middle, which an ellipse's in the angles is not. Beside them the laser light
        that a matt plane sends back from there over that from the foot (:meth:`_light`), shape (patterns, points): it
        changes by a per cent over a disc of 100 mm at 8 m under 15°, which moves the middle of its edges by some
        microradians. And the ranges R [m] there, shape (patterns, points).
        Of k times as many planes as patterns each k-th part meets all of them; only the angles have their rows.
        """
        along, sine, cosine = samples.beams
        # X = origin + R along is eq 3; from the origin to the foot:
        apart = np.zeros(along.shape)
        apart[:, 1], apart[:, 2] = self.axis_separation * sine, self.axis_separation * (cosine - 1.0)
        of_planes, points = (-1, len(samples.theta)), samples.theta.shape[1]
        apart = apart + self.point.reshape(*of_planes, 3, 1)
        axes = self.axes.reshape(*of_planes, 3, 3)
        rise, drop = (product(axes, way).reshape(-1, 3, points) for way in (along, apart))
        reach = drop[:, 2] / rise[:, 2]
        place = (reach[:, None] * rise[:, :2] - drop[:, :2]) / self.distance[:, None, None]
        aside = np.concatenate([along[:, 0]] * len(axes))
        foot = np.sin(self.centre[:, :1])
        light = self._light(rise[:, 2], aside, reach) / self._light(
            self._facing, foot, self.distance[:, None]
        )
        return samples.at(place), light, reach

    @property
    def _facing(self) -> Array:
        """Cosine of the beam's angle to the normal at the foot, shape (patterns, 1)."""
        return 1.0 / (self.stretch * self.stretch)[:, None]

    def _light(self, rise: Array, sine: Array, reach: Array) -> Array:
        """Return the laser light that the lens gathers from places on the planes, but for a factor.

        cosθ cosψ/r² by Lambert's law and the solid angle of the aperture, with the way r from the place to the node at
        (d, 0), its angle θ to the normal and its angle ψ to the lens's axis, which is along the beam: on a plane that
        faces the beam it grows by 3d/R for each radian of Θ.

        Parameters
        ----------
        rise, sine, reach
            n·u and sinΘ of the beams u, and R [m], shape (patterns, any).
        """
        d = self.baseline
        square = reach * reach + d * (d - 2.0 * reach * sine)
        across = d * self.axes[:, 2, :1]
        return np.asarray(np.abs(reach * rise - across) * (reach - d * sine) / (square * square))

    def laid(self, centroid: Centroid) -> Centroid:
        """Return centres that stand at the feet (Θ, φ) as such on the plane."""
        own = self.change
        if len(own) != len(centroid.found):
            centroid = centroid.repeated(len(own))
        spread = product(own, centroid.covariance, own.transpose(0, 2, 1))
        return replace(centroid, centre=0.0 * centroid.centre, covariance=spread)

    def of(self, rows: slice) -> TargetPlane:
        """Return some of the planes."""
        names = [field.name for field in fields(self)[:-2]]
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def spot(self, beam: ArrayLike, shown: PatternSamples, centre: Array) -> Array:
        """Return the standard deviation of a spot on the plane away from a centre, shape (patterns, points).

        s √(1 + (n·l)²) of a round beam s, () or (patterns,), with n the direction from ``centre`` (patterns, 2) to a
        voxel and l the plane's ``lean``: across a tilted disc's rim the spot is longer where this faces the tilt.
        """
        u, v = shown.theta - centre[:, :1], shown.phi - centre[:, 1:]
        along = (u * self.lean[:, :1] + v * self.lean[:, 1:]) ** 2 / np.maximum(u**2 + v**2, 1e-300)
        spot: Array = np.reshape(np.asarray(beam, dtype=np.float64), (-1, 1)) * np.sqrt(1.0 + along)
        return spot

    def seen(self, centroid: Centroid) -> tuple[Centroid, Array]:
        """Return centres on the plane as (Θ, φ) [rad], and their ranges [m]; radii stay, angles at the foot's range."""
        moved = applied(self.axes[:, :2].transpose(0, 2, 1), centroid.centre)
        x, y, z = (self.point + self.distance[:, None] * moved).T
        distance, theta, phi = angles_and_range(x, y, z, self.axis_separation)
        return centroid_of(
            columns(theta, phi),
            product(self.back, centroid.covariance, self.back.transpose(0, 2, 1)),
            centroid.radius,
            centroid.sigma_radius,
            centroid.misfit,
            centroid.found,
        ), distance


def target_plane(
    centre: Array, distance: Array, slope: Array, axis_separation: float, baseline: float = 0.0
) -> TargetPlane:
    """Return the planes of targets.

    Parameters
    ----------
    centre
        (Θ, φ) of a point near the target's centre [rad], shape (patterns, 2).
    distance
        R of the plane there [m], shape (patterns,).
    slope
        ∂R/∂(Θ, φ) of the plane there [m/rad], shape (patterns, 2); planes steeper than 75° are taken to face.
    axis_separation, baseline
        D_g and d [m].

    Returns
    -------
    TargetPlane
        Spanned by ∂X/∂Θ + (∂R/∂Θ) ∂X/∂R and the like for φ, with X(Θ, φ, R) of eq 3: in the axes of the deflected
        optics (across the beam, normal to the triangulation, along the beam) these are (R, 0, ∂R/∂Θ) and
        (0, R cosΘ − D_g, ∂R/∂φ).
    """
    g, h = np.where(np.hypot(slope[:, 0], slope[:, 1]) < _STEEPEST * distance, slope.T, 0.0)
    (sine, sine_phi), (cosine, cosine_phi) = np.sin(centre).T, np.cos(centre).T
    reach = distance * cosine - axis_separation
    side = np.sqrt(distance**2 + g**2)
    up = np.sqrt((g * reach) ** 2 + (distance * h) ** 2 + (distance * reach) ** 2)
    right, forth = distance / side, g / side
    normal = -g * reach / up, -distance * h / up, distance * reach / up
    down = normal[1] * forth, normal[2] * right - normal[0] * forth, -normal[1] * right
    beam, edges = np.zeros((2, len(centre), 3, 3))
    beam[:, 0, 0], beam[:, 0, 1], beam[:, 0, 2] = cosine, -sine * sine_phi, -sine * cosine_phi
    beam[:, 1, 1], beam[:, 1, 2] = cosine_phi, -sine_phi
    beam[:, 2, 0], beam[:, 2, 1], beam[:, 2, 2] = sine, cosine * sine_phi, cosine * cosine_phi
    point = distance[:, None] * beam[:, 2]
    point[:, 1] -= axis_separation * sine_phi
    point[:, 2] += axis_separation * (1.0 - cosine_phi)
    edges[:, 0, 0], edges[:, 0, 2] = right, forth
    edges[:, 1, 0], edges[:, 1, 1], edges[:, 1, 2] = down
    edges[:, 2, 0], edges[:, 2, 1], edges[:, 2, 2] = normal
    change = np.zeros((len(centre), 2, 2))
    change[:, 0, 0], change[:, 0, 1] = side / distance, g * h / (side * distance)
    change[:, 1, 1] = (reach * down[1] + h * down[2]) / distance
    return TargetPlane(
        point=point,
        axes=product(edges, beam),
        distance=distance,
        change=change,
        stretch=1.0 / np.sqrt(normal[2]),
        lean=columns(forth, down[2]) / normal[2][:, None],
        centre=centre,
        slope=columns(g, h),
        axis_separation=axis_separation,
        baseline=baseline,
    )
