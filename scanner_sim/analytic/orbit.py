"""Sun and Earth from a circular orbit in closed form: eclipse, Earthshine, and a low-precision Sun.

The Earth is a sphere without an atmosphere; the Sun is infinitely far away and, unless it is said, a point.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import quad

Floats = NDArray[np.float64]

EARTH_RADIUS: Final = 6371e3
"""Mean radius of the Earth [m]."""


def eclipse_fraction(h: float, beta: ArrayLike) -> Floats:
    """Return the share of an orbit spent in the Earth's shadow, the shape of ``beta`` [rad].

    (1/π) arccos(√(h² + 2 R h) / ((R + h) cosβ)), 0 where the argument passes 1; h the altitude [m]. The shadow
    is a cylinder: the satellite is in it while its distance from the shadow's axis is below R on the night side
    (Gilmore, *Spacecraft Thermal Control Handbook*, 2nd ed., 2002, section 2).
    """
    edge = np.sqrt(h**2 + 2.0 * EARTH_RADIUS * h) / (EARTH_RADIUS + h)
    return np.asarray(np.arccos(np.minimum(edge / np.cos(np.asarray(beta, dtype=np.float64)), 1.0)) / np.pi)


def eclipse_free_beta(h: float) -> float:
    """Return the smallest |β| [rad] without an eclipse: asin(R/(R + h)), the Earth's angular radius too."""
    return float(np.arcsin(EARTH_RADIUS / (EARTH_RADIUS + h)))


def penumbra_duration(h: float, beta: float, sun_radius: float, period: float) -> float:
    """Return how long the Sun takes to set behind the limb [s], to first order in its radius.

    The zenith distance ψ of the Sun obeys cosψ = cosβ cosθ, so at the limb, cosψ = −cosρ' with ρ' the Earth's
    angular radius taken from π, dψ/dθ = cosβ sinθ / sinψ; the disc crosses in 2 α / (dψ/dt).

    Parameters
    ----------
    h, beta
        Altitude [m] and angle from the orbit's plane to the Sun [rad], below :func:`eclipse_free_beta`.
    sun_radius
        Angular radius α of the Sun [rad].
    period
        Of the orbit [s].
    """
    limb = np.pi - eclipse_free_beta(h)
    theta = np.arccos(np.cos(limb) / np.cos(beta))
    rate = np.cos(beta) * np.sin(theta) / np.sin(limb)
    return float(2.0 * sun_radius / rate * period / (2.0 * np.pi))


def earthshine_flat(h: float, zeta: float) -> float:
    """Return (R/(R + h))² cosζ: irradiance of a plate facing nadir over albedo times the Sun's irradiance.

    It takes the whole visible Earth to be lit as the point below is, under the Sun's zenith distance ζ [rad];
    0.885 cosζ at 400 km.
    """
    return float((EARTH_RADIUS / (EARTH_RADIUS + h)) ** 2 * np.cos(zeta))


def earthshine(h: float, zeta: float) -> float:
    """Return the same with every point lit under its own zenith distance: exact while all of the cap is lit.

    A point at the angle γ from the point below receives cosζ cosγ on the mean over its azimuth. With u = cosγ and
    k = (R + h)/R the plate's view factor gives 2 cosζ ∫ u (k − u)(k u − 1)/(1 + k² − 2 k u)² du from 1/k to 1.
    Holds for ζ + arccos(1/k) ≤ π/2, 70.2° at 400 km.
    """
    k = 1.0 + h / EARTH_RADIUS

    def seen(u: float) -> float:
        return float(2.0 * u * (k - u) * (k * u - 1.0) / (1.0 + k * k - 2.0 * k * u) ** 2)

    return float(np.cos(zeta) * quad(seen, 1.0 / k, 1.0, epsrel=1e-12)[0])


def sun_direction(days: float) -> Floats:
    """Return the direction to the Sun, shape (3,), ``days`` after 2000-01-01 12:00, equator and equinox of date.

    *Astronomical Almanac*, "Low-precision formulas for the Sun's coordinates": 0.01° between 1950 and 2050.
    """
    L = np.deg2rad(280.460 + 0.9856474 * days)
    g = np.deg2rad(357.528 + 0.9856003 * days)
    longitude = L + np.deg2rad(1.915 * np.sin(g) + 0.020 * np.sin(2.0 * g))
    tilt = np.deg2rad(23.439 - 0.0000004 * days)
    return np.array([np.cos(longitude), np.cos(tilt) * np.sin(longitude), np.sin(tilt) * np.sin(longitude)])


def beta_angle(days: float, inclination: float, node: float) -> float:
    """Return the angle from an orbit's plane to the Sun [rad], positive towards the orbit's normal.

    ``inclination`` and right ascension of the ascending ``node`` [rad]; the normal is
    (sin i sinΩ, −sin i cosΩ, cos i).
    """
    normal = np.array(
        [np.sin(inclination) * np.sin(node), -np.sin(inclination) * np.cos(node), np.cos(inclination)]
    )
    return float(np.arcsin(normal @ sun_direction(days)))
