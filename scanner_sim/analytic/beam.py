"""The Gaussian beam (Siegman, *Lasers*, 1986, chapter 17; M²: ISO 11146-1:2021)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def rayleigh_length(w0: float, wavelength: float, m2: float = 1.0) -> float:
    """Return the Rayleigh length z_R = π w₀² / (M² λ) [m].

    Parameters
    ----------
    w0
        Radius of the waist at 1/e² of the irradiance [m].
    wavelength
        Wavelength [m].
    m2
        Beam quality M², 1 or more.
    """
    return float(np.pi * w0**2 / (m2 * wavelength))


def beam_radius(z: ArrayLike, w0: float, z0: float, wavelength: float, m2: float = 1.0) -> Floats:
    """Return the radius w(z) = w₀ √(1 + ((z − z₀)/z_R)²) at 1/e² of the irradiance [m], shape of ``z``.

    Parameters
    ----------
    z
        Distances along the beam [m].
    w0, z0
        Radius and place of the waist [m].
    wavelength, m2
        Wavelength [m] and beam quality.

    Notes
    -----
    Paraxial: good while the divergence M² λ / (π w₀) is small against 1 (0.24 mrad for a waist of 2 mm at
    1.5 µm). The standard deviation of the irradiance along an axis is w/2.
    """
    distance = np.asarray(z, dtype=np.float64) - z0
    return np.asarray(w0 * np.sqrt(1.0 + (distance / rayleigh_length(w0, wavelength, m2)) ** 2))


def spread_rate(z: ArrayLike, w0: float, z0: float, wavelength: float, m2: float = 1.0) -> Floats:
    """Return w'(z)/w(z) = (z − z₀) / ((z − z₀)² + z_R²) [1/m], shape of ``z``.

    It is the inverse of the wavefront's radius of curvature: a ray at the distance r from the axis runs away
    from it with the slope r w'/w. Parameters as in :func:`beam_radius`.
    """
    distance = np.asarray(z, dtype=np.float64) - z0
    return np.asarray(distance / (distance**2 + rayleigh_length(w0, wavelength, m2) ** 2))
