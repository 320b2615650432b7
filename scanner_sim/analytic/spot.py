"""The image of a Gaussian laser spot on the line sensor in closed form, and its light budget.

The model: a Gaussian beam of standard deviation σ_b = w/2 meets a Lambertian plane; an ideal lens, in focus
everywhere, images the lit patch through its node into its focal plane (:mod:`scanner_sim.analytic.array` has others);
a Gaussian point spread blurs the image; rectangular pixels
of unit fill factor collect it. All of it at one pointing; the dwell is short.

Moments are expansions in the size of the spot: terms beyond the second order in σ_b over the range are left
out. They are good to (σ_b tanι / L)², about 1e-6 for a spot of 1 mm at 1.5 m seen 45° askew, where ι is the
angle between the beam and the plane's normal and L the distance. :mod:`scanner_sim.analytic.quadrature`
integrates the same model without expanding it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erf, ndtr

from scanner_sim.analytic import geometry
from scanner_sim.foundation.constants import PLANCK, SPEED_OF_LIGHT

Floats = NDArray[np.float64]


class SpotImage(NamedTuple):
    """First moments of the image, before the pixels cut it.

    Attributes
    ----------
    chief
        Image of the beam's axis on the sensor [m].
    centroid
        Centroid of the light along the sensor [m].
    sigma
        Standard deviation along the sensor, point spread included [m].
    sigma_height
        Standard deviation across the sensor, point spread included [m].
    """

    chief: float
    centroid: float
    sigma: float
    sigma_height: float


def spot_image(
    theta: float,
    phi: float,
    f: float,
    d: float,
    D: float,
    point: ArrayLike,
    normal: ArrayLike,
    sigma_beam: float,
    spread: float,
    psf: float,
) -> SpotImage:
    """Return the moments of the spot's image on a plane.

    Parameters
    ----------
    theta, phi
        Deflections [rad].
    f, d, D
        Focal length, base and axis separation [m].
    point, normal
        A point of the plane (3,) [m] and its normal (3,) of any length and either sign.
    sigma_beam
        Standard deviation of the irradiance along an axis at the plane, w/2 [m].
    spread
        w'/w at the plane [1/m]; see :func:`scanner_sim.analytic.beam.spread_rate`.
    psf
        Standard deviation of the point spread on the sensor [m].

    Notes
    -----
    Let (s, t) be where in the beam's cross section at the chief range a ray passes, along n and m, and
    ζ = a s + b t the depth of the plane behind the cross section, a = −N·n/N·u, b = −N·m/N·u. With
    L = R − d sinΘ and c = d cosΘ the ray images at p = f (c − s(1 + ζ w'/w)) / (L + ζ). To second order

    centroid = p₀ + σ_b² [ (p_ss + p_tt)/2 + p_s g_s + p_t g_t + (a p_s + b p_t) w'/w ]
    sigma² = σ_b² (p_s² + p_t²) + psf²

    with p_s = −(f + p₀ a)/L, p_t = −p₀ b/L, p_ss = 2 a (f + p₀ a)/L², p_tt = 2 p₀ b²/L², and g the gradient
    of the logarithm of the collected share, which goes as (v·u)/|v|⁴ with v from the node to the point
    (Lambert's and the aperture's cosine and the square of the distance; N·v is constant on a plane):
    g_s = a/L + 4 (c − a L)/(L² + c²), g_t = b/L − 4 b L/(L² + c²). Derived here.

    The centroid is that of all light of the line; clipping by the pixels' height leaves it unchanged to this
    order, as the clipped direction t enters p only through b.
    """
    u, n, m = geometry.scanner_axes(theta, phi)
    normal = np.asarray(normal, dtype=np.float64)
    R = float(geometry.range_to_plane(theta, phi, D, point, normal))
    a, b = float(-(normal @ n) / (normal @ u)), float(-(normal @ m) / (normal @ u))
    L, c = R - d * np.sin(theta), d * np.cos(theta)
    chief = float(f * c / L)
    p_s, p_t = -(f + chief * a) / L, -chief * b / L
    p_ss, p_tt = 2.0 * a * (f + chief * a) / L**2, 2.0 * chief * b**2 / L**2
    g_s = a / L + 4.0 * (c - a * L) / (L**2 + c**2)
    g_t = b / L - 4.0 * b * L / (L**2 + c**2)
    shift = 0.5 * (p_ss + p_tt) + p_s * g_s + p_t * g_t + (a * p_s + b * p_t) * spread
    return SpotImage(
        chief=chief,
        centroid=float(chief + sigma_beam**2 * shift),
        sigma=float(np.sqrt(sigma_beam**2 * (p_s**2 + p_t**2) + psf**2)),
        sigma_height=float(np.hypot(sigma_beam * f / L, psf)),
    )


def share_within_height(sigma_height: ArrayLike, height: float) -> Floats:
    """Return the share of the light inside the pixels' height, erf(h / (2 √2 σ)): shape of the first.

    ``sigma_height`` and ``height`` in metres; the image is centred, as synchronisation keeps it.
    """
    return np.asarray(erf(height / (2.0 * np.sqrt(2.0) * np.asarray(sigma_height, dtype=np.float64))))


def pixel_shares(centre_px: ArrayLike, sigma_px: ArrayLike, pixels: int) -> Floats:
    """Return the share of a Gaussian spot on each pixel, shape (..., pixels).

    Pixel i reaches from i − ½ to i + ½ in units of the pitch: Φ((i + ½ − µ)/s) − Φ((i − ½ − µ)/s).
    ``centre_px`` and ``sigma_px`` broadcast to the shape (...).
    """
    edges = np.arange(pixels + 1) - 0.5
    centre, sigma = np.asarray(centre_px, dtype=np.float64), np.asarray(sigma_px, dtype=np.float64)
    return np.asarray(np.diff(ndtr((edges - centre[..., None]) / sigma[..., None]), axis=-1))


def collected_power(
    P: ArrayLike,
    rho: ArrayLike,
    aperture: float,
    transmission: float,
    v: ArrayLike,
    axis: ArrayLike,
    normal: ArrayLike,
) -> Floats:
    """Return the power through the receiver from a Lambertian spot [W].

    Parameters
    ----------
    P, rho
        Power on the surface [W] and its hemispherical reflectance.
    aperture, transmission
        Diameter of the aperture [m]; transmission of mirrors, lens and filter together.
    v
        From the node to the spot, shape (..., 3) [m].
    axis, normal
        Unit vectors (..., 3) of the lens axis and of the surface (either sign).

    Notes
    -----
    P ρ/π · cosι' · A cosα / |v|² · T with cosι' = |N·v|/|v| at the surface and cosα = u·v/|v| at the aperture
    (it is a flat stop square to the axis). For a spot on the axis facing the lens this is eq 19 with
    B_p = A T: the paper's B_p must contain the aperture's area. Aperture small against |v|.
    """
    v = np.asarray(v, dtype=np.float64)
    distance = np.linalg.norm(v, axis=-1)
    at_surface = np.abs(np.sum(v * np.asarray(normal), axis=-1)) / distance
    at_aperture = np.sum(v * np.asarray(axis), axis=-1) / distance
    area = np.pi / 4.0 * aperture**2
    radiance_factor = np.asarray(P) * np.asarray(rho) / np.pi
    return np.asarray(radiance_factor * at_surface * area * at_aperture / distance**2 * transmission)


def laser_power_printed(R: ArrayLike, P: float, T_r: float, B_p: float) -> Floats:
    """Return I_laser = T_r B_p P / (π R²) [W]: eq 19. B_p [m²] is aperture area times transmission."""
    return np.asarray(T_r * B_p * P / (np.pi * np.asarray(R, dtype=np.float64) ** 2))


def electrons(power: ArrayLike, dwell: float, wavelength: float, efficiency: float) -> Floats:
    """Return the mean number of electrons, P t η λ / (h c), for a power [W] during the dwell [s]."""
    photon = PLANCK * SPEED_OF_LIGHT / wavelength
    return np.asarray(np.asarray(power, dtype=np.float64) * dwell * efficiency / photon)
