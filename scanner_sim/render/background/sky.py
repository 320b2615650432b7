"""The sky over a scene in orbit: the Sun's disc and the sunlit Earth, as laws and as samplers.

All is for a Sun of unit irradiance (1 W/m² on a plate that faces it) and an Earth of albedo 1; light is linear, so that
the spectral band, the Earth's albedo in it and the power are factors of the caller. Directions point away from the
scene and have unit length. The Earth is a Lambertian ball, its radiance cosζ/π times the albedo, where ζ is the Sun's
zenith angle at the point that is seen (Pedrotti, *Introduction to optics*, 3rd ed., ch. 5); its night side is black.
The Sun is a uniform disc. Where the two overlap the Earth is in front: eclipse and penumbra need no factor of their
own.

An angle γ from an axis is carried as 1 − cosγ = |d − axis|²/2. In single precision the cosine itself would leave
half a per cent of error in the solid angle of the Sun.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.device_types import Float, Vector2f, Vector3f
from scanner_sim.scene.light.lighting import Sky

Array = NDArray[np.float64]

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_TINY = 1e-12


@dataclass
class SkyLight:
    """Where Sun and Earth stand, as opaque Dr.Jit numbers: other positions use the same kernel.

    Attributes
    ----------
    sun, sun_cap
        Direction to the Sun; 1 − cos of its angular radius, negative without a Sun.
    sun_level, sun_density
        Radiance of the disc [1/sr], and the density of directions sampled on it [1/sr]; 0 without a Sun.
    earth, earth_cap
        Direction to the Earth's centre; 1 − cos of its angular radius, negative without an Earth.
    towards_sun, beside
        Axes across ``earth``: the first on the Sun's side, the second completes a right-handed frame.
    reach
        Distance of the Earth's centre in Earth radii.
    noon, slant
        Cosine and sine of the Sun's zenith angle at the point under the scene.
    lit_from, lit_to
        The ring of 1 − cosγ around ``earth`` in which anything is lit; both 0 where nothing is.
    albedo, albedo_out
        The Earth's reflectance, in the filter's band and out of it.
    """

    sun: Vector3f
    sun_cap: Float
    sun_level: Float
    sun_density: Float
    earth: Vector3f
    earth_cap: Float
    towards_sun: Vector3f
    beside: Vector3f
    reach: Float
    noon: Float
    slant: Float
    lit_from: Float
    lit_to: Float
    albedo: Float
    albedo_out: Float


def sky_light(
    sun_direction: ArrayLike | None,
    sun_angular_radius: float,
    earth_direction: ArrayLike | None,
    earth_altitude: float = 400e3,
    earth_radius: float = 6371e3,
    albedo: tuple[float, float] = (0.0, 0.0),
    sun_dimming: float = 1.0,
) -> SkyLight:
    """Return the sky of a scene.

    Parameters
    ----------
    sun_direction
        From the scene to the Sun, shape (3,), of any length; None without a Sun, which leaves the Earth dark.
    sun_angular_radius
        Half the angle that the disc subtends [rad].
    earth_direction
        From the scene to the Earth's centre, shape (3,), of any length; None without an Earth.
    earth_altitude, earth_radius
        Height of the scene above the ground, and radius of the Earth [m].
    albedo
        The Earth's reflectance, in band and out of band.
    sun_dimming
        Factor of the Sun's own light; the Earth's stays.

    Raises
    ------
    ValueError
        If a direction is zero, the Sun's radius is not between 0 and 90°, or altitude or radius are not positive;
        what belongs to a missing Sun or Earth is not looked at.
    """
    sun = None if sun_direction is None else _unit(sun_direction)
    earth = None if earth_direction is None else _unit(earth_direction)
    if sun is not None and not 0.0 < sun_angular_radius < 0.5 * math.pi:
        raise ValueError(f"an angular radius of {sun_angular_radius} rad is none of a Sun")
    if earth is not None and not (earth_altitude > 0.0 and earth_radius > 0.0):
        raise ValueError(f"no scene is {earth_altitude} m above an Earth of radius {earth_radius} m")

    disc = (-1.0, 0.0, 0.0)
    if sun is not None:
        cap = 2.0 * math.sin(0.5 * sun_angular_radius) ** 2
        disc = (cap, 1.0 / (math.pi * math.sin(sun_angular_radius) ** 2), 1.0 / (2.0 * math.pi * cap))
    reach = 2.0 if earth is None else 1.0 + earth_altitude / earth_radius
    down = np.array([0.0, 1.0, 0.0]) if earth is None else earth
    noon = -1.0 if sun is None else float(-down @ sun)
    ring = (0.0, 0.0) if earth is None or sun is None else _lit_ring(reach, math.acos(np.clip(noon, -1, 1)))
    side = _across(down, sun)
    return SkyLight(
        sun=_vector(np.array([0.0, 0.0, 1.0]) if sun is None else sun),
        sun_cap=_opaque(disc[0]),
        sun_level=_opaque(sun_dimming * disc[1]),
        sun_density=_opaque(disc[2]),
        earth=_vector(down),
        earth_cap=_opaque(-1.0 if earth is None else _versine(reach, math.acos(1.0 / reach))),
        towards_sun=_vector(side),
        beside=_vector(np.cross(down, side)),
        reach=_opaque(reach),
        noon=_opaque(noon),
        slant=_opaque(0.0 if sun is None else float(side @ sun)),
        lit_from=_opaque(ring[0]),
        lit_to=_opaque(ring[1]),
        albedo=_opaque(albedo[0]),
        albedo_out=_opaque(albedo[1]),
    )


def light_of(sky: Sky, *, visible: bool = False) -> SkyLight:
    """Return the light of a scenario's sky in the filter's band and out of it, or all of it in visible light."""
    albedo = (sky.albedo, sky.albedo_out_of_band)
    return sky_light(
        sky.sun_direction,
        sky.sun_angular_radius,
        sky.earth_direction,
        sky.earth_altitude,
        sky.earth_radius,
        (sky.albedo_visible,) * 2 if visible else albedo,
        sky.sun_dimming,
    )


def sun_radiance(light: SkyLight, direction: Vector3f) -> Float:
    """Return the radiance [1/sr] of the Sun that is seen in a direction, for unit irradiance.

    1/(π sin²α) inside the angular radius α, which makes the irradiance exactly 1, and 0 where the Earth is in
    front of it.
    """
    inside = _from_axis(direction, light.sun) <= light.sun_cap
    hidden = _from_axis(direction, light.earth) <= light.earth_cap
    return dr.select(inside & ~hidden, light.sun_level, 0.0)


def earth_radiance(light: SkyLight, direction: Vector3f) -> Float:
    """Return the radiance [1/sr] of the Earth that is seen in a direction, for unit irradiance and albedo 1.

    max(0, cosζ)/π; 0 beside the Earth.
    """
    away = _from_axis(direction, light.earth)
    cos_centre, sin_centre = _ground(light, away)
    # cosψ sinγ of the azimuth ψ from the Sun's side; both sines vanish together under the scene.
    sine = dr.sqrt(dr.maximum(away * (2.0 - away), _TINY))
    cosine = dr.clip(dr.dot(direction, light.towards_sun) / sine, -1.0, 1.0)
    height = cos_centre * light.noon + sin_centre * light.slant * cosine
    return dr.select(away <= light.earth_cap, dr.maximum(height, 0.0) / math.pi, 0.0)


def sample_sun(light: SkyLight, u: Vector2f) -> tuple[Vector3f, Float]:
    """Return directions uniform on the Sun's disc, and their density [1/sr].

    Parameters
    ----------
    light
        The sky.
    u
        Uniform numbers in the unit square (``mi.Point2f``).

    Returns
    -------
    tuple
        Unit vectors, and the density; it is 0, and the direction without meaning, where there is no Sun.
    """
    across, beside = mi.coordinate_system(light.sun)
    away = u.x * dr.maximum(light.sun_cap, 0.0)
    return _around(light.sun, across, beside, away, dr.two_pi * u.y), light.sun_density + dr.zeros(
        mi.Float, dr.width(away)
    )


def pdf_sun(light: SkyLight, direction: Vector3f) -> Float:
    """Return the density [1/sr] with which :func:`sample_sun` chooses a direction."""
    return dr.select(_from_axis(direction, light.sun) <= light.sun_cap, light.sun_density, 0.0)


def sample_earth(light: SkyLight, u: Vector2f) -> tuple[Vector3f, Float]:
    """Return directions on the lit part of the Earth that is seen, and their density [1/sr].

    In solid angle uniform over the ring in which anything is lit, then uniform in azimuth between the two
    crossings of the terminator: 1/((v₁ − v₀) 2ψ) with v = 1 − cosγ and cosψ = −cosη cosζ₀/(sinη sinζ₀), η the
    angle at the Earth's centre and ζ₀ the Sun's zenith angle under the scene. So no sample falls into the
    night, however thin the crescent is.

    Parameters
    ----------
    light
        The sky.
    u
        Uniform numbers in the unit square (``mi.Point2f``).

    Returns
    -------
    tuple
        Unit vectors, and the density; it is 0, and the direction without meaning, where nothing is lit.
    """
    away = dr.lerp(light.lit_from, light.lit_to, u.x)
    width = _lit_azimuth(light, away)
    azimuth = (2.0 * u.y - 1.0) * width
    direction = _around(light.earth, light.towards_sun, light.beside, away, azimuth)
    return direction, _ring_density(light, width)


def pdf_earth(light: SkyLight, direction: Vector3f) -> Float:
    """Return the density [1/sr] with which :func:`sample_earth` chooses a direction."""
    width = _lit_azimuth(light, _from_axis(direction, light.earth))
    return dr.select(earth_radiance(light, direction) > 0.0, _ring_density(light, width), 0.0)


def earth_directions(light: SkyLight, count: int) -> tuple[Array, Array]:
    """Return a fixed, well-spread set of directions on the lit Earth, for irradiance without noise.

    The sampler's own map of a spiral with the golden angle (Vogel, *Mathematical Biosciences* 44, 1979).

    Parameters
    ----------
    light
        The sky.
    count
        Number of directions.

    Returns
    -------
    tuple
        Unit vectors, shape (count, 3), and weights, shape (count,): radiance times solid angle for albedo 1. The
        irradiance of a plate is the albedo times Σ weight · max(0, cosine) over what is not hidden.
    """
    index = np.arange(count)
    u = mi.Point2f(mi.Float((index + 0.5) / count), mi.Float((0.5 + index * _GOLDEN) % 1.0))
    direction, density = sample_earth(light, u)
    weight = dr.select(density > 0.0, earth_radiance(light, direction) / (count * density), 0.0)
    return direction.numpy().T.astype(np.float64), weight.numpy().astype(np.float64)


def _unit(direction: ArrayLike) -> Array:
    vector = np.asarray(direction, dtype=np.float64)
    length = np.linalg.norm(vector)
    if vector.shape != (3,) or not (np.isfinite(length) and length > 0.0):
        raise ValueError(f"{direction!r} is no direction")
    return vector / length


def _across(axis: Array, sun: Array | None) -> Array:
    """Return the unit vector across an axis on the Sun's side, or any where the Sun stands on the axis."""
    side = np.zeros(3) if sun is None else sun - axis * (axis @ sun)
    if np.linalg.norm(side) < 1e-9:
        side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return side / np.linalg.norm(side)


def _lit_ring(reach: float, zenith: float) -> tuple[float, float]:
    """Return the range of 1 − cosγ in which the Sun is above some horizon: η from ζ₀ − 90° to the limb."""
    first, limb = max(0.0, zenith - 0.5 * math.pi), math.acos(1.0 / reach)
    return (_versine(reach, first), _versine(reach, limb)) if first < limb else (0.0, 0.0)


def _versine(reach: float, centre: float) -> float:
    """Return 1 − cosγ of the ground at an angle from the point under the scene, seen at the Earth's centre."""
    seen = math.atan2(math.sin(centre), reach - math.cos(centre))
    return 2.0 * math.sin(0.5 * seen) ** 2


def _opaque(value: float) -> Float:
    return dr.opaque(mi.Float, value)


def _vector(vector: Array) -> Vector3f:
    return mi.Vector3f(*(_opaque(float(entry)) for entry in vector))


def _from_axis(direction: Vector3f, axis: Vector3f) -> Float:
    return 0.5 * dr.squared_norm(direction - axis)


def _around(axis: Vector3f, across: Vector3f, beside: Vector3f, away: Float, azimuth: Float) -> Vector3f:
    """Return the unit vector at an angle from an axis, given as 1 − cosγ, and an azimuth."""
    sine = dr.sqrt(dr.maximum(away * (2.0 - away), 0.0))
    turned = dr.sincos(azimuth)
    return axis * (1.0 - away) + across * (sine * turned[1]) + beside * (sine * turned[0])


def _ground(light: SkyLight, away: Float) -> tuple[Float, Float]:
    """Return cosine and sine of the angle η at the Earth's centre, from the point under the scene.

    The near crossing t = (D² − 1)/(D cosγ + √(1 − D² sin²γ)) of the ray with the unit ball at D, in the form that
    does not cancel.
    """
    cosine, squared = 1.0 - away, away * (2.0 - away)
    root = dr.sqrt(dr.maximum(1.0 - dr.square(light.reach) * squared, 0.0))
    distance = (light.reach - 1.0) * (light.reach + 1.0) / dr.maximum(light.reach * cosine + root, _TINY)
    return light.reach - distance * cosine, distance * dr.sqrt(dr.maximum(squared, 0.0))


def _lit_azimuth(light: SkyLight, away: Float) -> Float:
    """Return the largest azimuth from the Sun's side at which the ground is lit."""
    cos_centre, sin_centre = _ground(light, away)
    edge = -cos_centre * light.noon / dr.maximum(sin_centre * light.slant, _TINY)
    return dr.acos(dr.clip(edge, -1.0, 1.0))


def _ring_density(light: SkyLight, width: Float) -> Float:
    area = 2.0 * width * (light.lit_to - light.lit_from)
    return dr.select(area > 0.0, 1.0 / dr.maximum(area, _TINY), 0.0)
