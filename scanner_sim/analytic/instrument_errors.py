"""What each departure of an instrument from its design does to the measured point: closed forms to first order.

Each is derived from the geometry of its own cause, not from the simulator's equations: a length that is wrong stretches
similar triangles, an angle turns the point about an axis. The instrument as built departs by a small value; the one
that measures does not know of it. What is given is measured less true. Second order: the value times the effect, so
1 % of it for a base wrong by 1 %.

Blais, Beraldin, El-Hakim (2000), section 2.2, for the ideal geometry; Beraldin et al., *Proc. 3DIM*, 1997, for base,
focal length and array in triangulation; Lichti, *ISPRS J. Photogramm. Remote Sens.* 61 (2007) for angles, axes and the
zero of the range; Brown, *Photogramm. Eng.* 37 (1971) for distortion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sighted:
    """True points before an ideal instrument, arrays of shape (n,): R [m], Θ and φ [rad]; and its lengths [m].

    ``f`` focal length, ``d`` base, ``D`` distance of the axes, ``period`` of the encoders' lines [rad].
    """

    r: Array
    theta: Array
    phi: Array
    f: float
    d: float
    D: float
    period: float = math.tau

    @property
    def depth(self) -> Array:
        """Depth of the point before the lens, along the beam [m]: the long side of the similar triangles."""
        return np.asarray(self.r - self.d * np.sin(self.theta))

    @property
    def tangent(self) -> Array:
        """Tangent of the angle at which the lens sees the point: the lens's distance from the beam over the depth."""
        return np.asarray(self.d * np.cos(self.theta) / self.depth)

    @property
    def turned(self) -> Array:
        """Second mirror, a turn about −x by φ, shape (n, 3, 3)."""
        zero, one = np.zeros_like(self.phi), np.ones_like(self.phi)
        c, s = np.cos(self.phi), np.sin(self.phi)
        rows = [[one, zero, zero], [zero, c, s], [zero, -s, c]]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    @property
    def beyond(self) -> Array:
        """Point before the second mirror turns it, from that mirror's axis, shape (n, 3)."""
        sine, cosine = np.sin(self.theta), np.cos(self.theta)
        return np.stack([self.r * sine, 0.0 * sine, self.r * cosine - self.D], axis=1)

    @property
    def along(self) -> Array:
        """Direction of the beam, shape (n, 3)."""
        plane = np.stack([np.sin(self.theta), 0.0 * self.theta, np.cos(self.theta)], axis=1)
        return np.asarray(np.einsum("nij,nj->ni", self.turned, plane))


def _along_beam(range_error: Callable[[Sighted], Array]) -> Callable[[Sighted], Array]:
    """Return the point's error of an error of the range alone."""
    return lambda seen: np.asarray(range_error(seen)[:, None] * seen.along)


def _lateral(seen: Sighted) -> Array:
    """Return by how much the range falls where the image moves by a unit of p/f: depth²/(base across the beam)."""
    return np.asarray(seen.depth**2 / (seen.d * np.cos(seen.theta)))


def _first_mirror(shape: Callable[[Array, Sighted], Array]) -> Callable[[Sighted], Array]:
    """Return the error of a first mirror that points ε(Θ) beyond its reading.

    The reading lacks ε: the point is put back by R ε across the beam. The image stays, and so does the angle of the two
    sights at the point; the base that is believed across the beam, d cosΘ, and its part along it, d sinΘ, are those of
    Θ − ε, so that the range errs as well.
    """

    def effect(seen: Sighted) -> Array:
        error = shape(seen.theta, seen)
        sine, cosine = np.sin(seen.theta), np.cos(seen.theta)
        across = np.stack([cosine, 0.0 * cosine, -sine], axis=1)
        range_error = (seen.depth * sine / cosine - seen.d * cosine) * error
        turned = np.einsum("nij,nj->ni", seen.turned, across)
        return np.asarray(range_error[:, None] * seen.along - (seen.r * error)[:, None] * turned)

    return effect


def _first_mirror_alone(shape: Callable[[Array, Sighted], Array]) -> Callable[[Sighted], Array]:
    """Return the same where the range does not go by Θ: a pulse on the laser's own axis."""

    def effect(seen: Sighted) -> Array:
        across = np.stack([np.cos(seen.theta), 0.0 * seen.theta, -np.sin(seen.theta)], axis=1)
        turned = np.einsum("nij,nj->ni", seen.turned, across)
        return np.asarray(-(seen.r * shape(seen.theta, seen))[:, None] * turned)

    return effect


def _second_mirror(shape: Callable[[Array, Sighted], Array]) -> Callable[[Sighted], Array]:
    """Return the error of a second mirror that points ε(φ) beyond its reading: a turn back about its axis."""

    def effect(seen: Sighted) -> Array:
        arm = np.einsum("nij,nj->ni", seen.turned, seen.beyond)
        backwards = np.cross(np.array([1.0, 0.0, 0.0]), arm)
        return np.asarray(shape(seen.phi, seen)[:, None] * backwards)

    return effect


def _separation(seen: Sighted) -> Array:
    """Return the error of a second axis that is farther off: the turn about the nearer one displaces the point."""
    shift = np.array([0.0, 0.0, 1.0]) - seen.turned @ np.array([0.0, 0.0, 1.0])
    return np.asarray(-shift)


def _passes_by(seen: Sighted) -> Array:
    """Return the error of a second axis that passes below the beam."""
    return np.asarray(-(np.array([0.0, 1.0, 0.0]) - seen.turned @ np.array([0.0, 1.0, 0.0])))


def _skew(seen: Sighted) -> Array:
    """Return the error of a second axis turned about z: the mirror acts between a turn to the axis and one back."""
    z = np.array([0.0, 0.0, 1.0])
    arm = np.einsum("nij,nj->ni", seen.turned, seen.beyond)
    before = np.einsum("nij,nj->ni", seen.turned, np.cross(z, seen.beyond))
    return np.asarray(before - np.cross(z, arm))


_SHAPES: Mapping[str, Callable[[Array, Sighted], Array]] = MappingProxyType(
    {
        "zero": lambda angle, _: np.ones_like(angle),
        "scale": lambda angle, _: angle,
        "cubic": lambda angle, _: angle**3,
        "sine": lambda angle, seen: np.sin(math.tau * angle / seen.period),
        "cosine": lambda angle, seen: np.cos(math.tau * angle / seen.period),
    }
)
_AXES: Mapping[str, Callable[[Sighted], Array]] = MappingProxyType(
    {"axis_separation": _separation, "axis_offset": _passes_by, "axis_skew": _skew}
    | {f"phi_{name}": _second_mirror(shape) for name, shape in _SHAPES.items()}
)
EFFECTS: Mapping[str, Mapping[str, Callable[[Sighted], Array]]] = MappingProxyType(
    {
        "triangulation": {
            "base": _along_beam(lambda seen: -seen.r / seen.d),
            "focal_length": _along_beam(lambda seen: -seen.depth / seen.f),
            "array_offset": _along_beam(lambda seen: _lateral(seen) / seen.f),
            "array_scale": _along_beam(lambda seen: seen.depth),
            "array_tilt": _along_beam(lambda seen: -_lateral(seen) * seen.tangent**2),
            "radial_1": _along_beam(lambda seen: -_lateral(seen) * seen.tangent**3),
            "radial_2": _along_beam(lambda seen: -_lateral(seen) * seen.tangent**5),
            "tangential": _along_beam(lambda seen: -3.0 * _lateral(seen) * seen.tangent**2),
            **_AXES,
            **{f"theta_{name}": _first_mirror(shape) for name, shape in _SHAPES.items()},
        },
        "tof": {
            "tof_zero": _along_beam(lambda seen: np.ones_like(seen.r)),
            "tof_scale": _along_beam(lambda seen: seen.r),
            **_AXES,
            **{f"theta_{name}": _first_mirror_alone(shape) for name, shape in _SHAPES.items()},
        },
    }
)
"""Error of the measured point per value of a parameter, [m/m], [m/rad] or [m], shape (n, 3), by way of ranging and
parameter; of time of flight with a coaxial photodiode. A parameter that is not there moves no point."""
