"""The array behind the lens, by projective geometry and real rays: where ranges lie on it, and how sharply.

A thin lens maps the plane of triangulation onto itself by a collineation (Born, Wolf, *Principles of optics*, 7th ed.,
1999, sec 4.3): with x square to the axis, z along it and behind the lens, both from the node,

    (x, z, 1) → (f x, f z, z + f)

which maps lines to lines. Points and lines are vectors of three numbers; the line through two points and the point on
two lines are cross products (Hartley, Zisserman, *Multiple view geometry*, 2nd ed., 2004, sec 2.2). The beam is the
line x = −d cosΘ before the lens. The ray through the node tells where light lands; where it is out of focus, rays from
all over the pupil to the image of the point are cut with the array, one by one. No equation for the position is solved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

_NODE = np.array([0.0, 0.0, 1.0])
_STEP = 1e-5
"""Relative step of differences."""


class Blur(NamedTuple):
    """What a pupil makes of a point: mean shift along the array, standard deviations along it and across [m]."""

    shift: float
    along: float
    across: float


@dataclass(frozen=True)
class SensorArray:
    """A thin lens and a straight array behind it.

    Attributes
    ----------
    focal_length, baseline, aperture
        f, d and the pupil's diameter [m].
    tilt
        Angle of the array against the lens [rad]; ``scheimpflug``: the image of the beam that is not deflected;
        ``ideal``: upright in the focal plane, and sharp all the same.
    focus
        Distance [m] of the point of that beam whose image lies on a tilted array; ∞ for infinity.
    """

    focal_length: float
    baseline: float
    aperture: float
    tilt: float | Literal["scheimpflug", "ideal"] = "ideal"
    focus: float = math.inf

    @cached_property
    def line(self) -> Floats:
        """The array's line, shape (3,)."""
        beam = _through((-self.baseline, 0.0), (-self.baseline, -1.0))
        if self.tilt == "scheimpflug":
            return np.cross(
                self._image(_meet(beam, _through((0.0, 0.0), (-1.0, -1.0)))), self._image_of_infinity
            )
        if self.tilt == "ideal":
            return _through((0.0, self.focal_length), (1.0, self.focal_length))
        tilt = float(self.tilt)
        direction = np.array([math.cos(tilt), math.sin(tilt), 0.0])
        far = math.isinf(self.focus)
        sharp = self._image_of_infinity if far else self._image(np.array([-self.baseline, -self.focus, 1.0]))
        return np.cross(sharp, direction)

    @property
    def _image_of_infinity(self) -> Floats:
        return self._image(np.array([0.0, -1.0, 0.0]))

    @cached_property
    def origin(self) -> Floats:
        """Where the axis meets the array (x, z) [m]: the image of infinity, s = 0."""
        return _plain(_meet(self.line, _through((0.0, 0.0), (0.0, 1.0))))

    @cached_property
    def direction(self) -> Floats:
        """Unit vector (x, z) along the array, towards the images of nearer ranges."""
        along = np.array([self.line[1], -self.line[0]])
        along = along / np.linalg.norm(along)
        return np.asarray(along if along[0] > 0.0 else -along)

    def position(self, R: ArrayLike, theta: ArrayLike = 0.0) -> Floats:
        """Return where on the array [m] ranges R [m] of a beam deflected by Θ [rad] lie."""
        R, theta = np.asarray(R, dtype=np.float64), np.asarray(theta, dtype=np.float64)
        return self._seen(-self.baseline * np.cos(theta), -(R - self.baseline * np.sin(theta)))

    def position_at(self, tangent: ArrayLike) -> Floats:
        """Return where on the array [m] lies what is seen at tangents to the axis."""
        tangent = np.asarray(tangent, dtype=np.float64)
        return self._seen(-tangent, -np.ones_like(tangent))

    def tangent(self, position: ArrayLike) -> Floats:
        """Return the tangents to the axis at which positions on the array [m] look."""
        spot = _plain(self._point(position))
        return np.asarray(spot[..., 0] / spot[..., 1])

    def range(self, position: ArrayLike, theta: ArrayLike = 0.0) -> Floats:
        """Return the range [m] that a position on the array [m] sees on a beam deflected by Θ [rad]."""
        theta = np.asarray(theta, dtype=np.float64)
        shift = -self.baseline * np.cos(theta)
        beam = np.stack(np.broadcast_arrays(1.0, 0.0, -shift), axis=-1)
        met = _plain(_meet(np.cross(self._point(position), _NODE), beam))
        return np.asarray(-met[..., 1] + self.baseline * np.sin(theta))

    def range_error(self, R: ArrayLike, theta: ArrayLike = 0.0) -> Floats:
        """Return |∂R/∂s| at fixed Θ [m/m], by central differences of :meth:`range`."""
        s = self.position(R, theta)
        step = _STEP * np.abs(s)
        return np.asarray(np.abs(self.range(s + step, theta) - self.range(s - step, theta)) / (2.0 * step))

    def scale(self, R: ArrayLike, theta: ArrayLike = 0.0) -> tuple[Floats, Floats]:
        """Return how far the image moves along the array and across it [m] by a change of a tangent of 1."""
        tangent = self.tangent(self.position(R, theta))
        ahead, behind = (self.position_at(tangent + side * _STEP) for side in (1.0, -1.0))
        across = _plain(self._point(self.position(R, theta)))[..., 1]
        return np.asarray((ahead - behind) / (2.0 * _STEP)), np.asarray(across)

    def turned(self, R: ArrayLike, theta: ArrayLike = 0.0) -> Floats:
        """Return by how much the image moves on the array [m] where the receiver turns by 1 rad."""
        angle = np.arctan(self.tangent(self.position(R, theta)))
        ahead, behind = (self.position_at(np.tan(angle + side * _STEP)) for side in (1.0, -1.0))
        return np.asarray((ahead - behind) / (2.0 * _STEP))

    def blur(self, R: float, theta: float = 0.0, rings: int = 12, spokes: int = 24) -> Blur:
        """Return what the pupil makes of the point of the beam at a range [m]: rays from an evenly lit disc.

        Gauss–Legendre in the square of the radius, even in angle: exact for what is a polynomial in the pupil.
        """
        if self.tilt == "ideal":
            return Blur(0.0, 0.0, 0.0)
        object_point = np.array(
            [-self.baseline * math.cos(theta), -(R - self.baseline * math.sin(theta)), 1.0]
        )
        image = _plain(self._image(object_point))
        nodes, weights = np.polynomial.legendre.leggauss(rings)
        radius = 0.5 * self.aperture * np.sqrt(0.5 * (1.0 + nodes))
        turn = 2.0 * math.pi * (np.arange(spokes) + 0.5) / spokes
        x, y = np.outer(radius, np.cos(turn)), np.outer(radius, np.sin(turn))
        weight = np.repeat(0.5 * weights[:, None], spokes, axis=1) / spokes
        start = np.stack([x, np.zeros_like(x), np.ones_like(x)], axis=-1)
        met = _plain(_meet(np.cross(start, np.append(image, 1.0)), self.line))
        s = (met - self.origin) @ self.direction
        q = y * (1.0 - met[..., 1] / image[1])
        shift = float((weight * s).sum())
        along = math.sqrt(float((weight * (s - shift) ** 2).sum()))
        return Blur(shift - float(self.position(R, theta)), along, math.sqrt(float((weight * q**2).sum())))

    def _image(self, point: Floats) -> Floats:
        f = self.focal_length
        x, z, w = np.moveaxis(np.asarray(point, dtype=np.float64), -1, 0)
        return np.stack([f * x, f * z, z + f * w], axis=-1)

    def _point(self, position: ArrayLike) -> Floats:
        s = np.asarray(position, dtype=np.float64)[..., None]
        met = self.origin + s * self.direction
        return np.concatenate([met, np.ones_like(s)], axis=-1)

    def _seen(self, x: Floats, z: Floats) -> Floats:
        points = np.stack(np.broadcast_arrays(x, z, 1.0), axis=-1)
        return np.asarray((_plain(_meet(np.cross(points, _NODE), self.line)) - self.origin) @ self.direction)


def _through(one: tuple[float, float], other: tuple[float, float]) -> Floats:
    """Return the line through two points."""
    return np.cross([*one, 1.0], [*other, 1.0])


def _meet(one: Floats, other: Floats) -> Floats:
    """Return the point on two lines."""
    return np.cross(one, other)


def _plain(point: Floats) -> Floats:
    """Return the coordinates (x, z) of points."""
    return np.asarray(point[..., :2] / point[..., 2:])
