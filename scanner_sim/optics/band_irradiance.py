"""The Sun's irradiance through the interference filter, in its band and outside of it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.optics.filter import BandpassFilter, FilterChoice, band_shape, centre_at, centre_of
from scanner_sim.scene.light.lighting import Sun
from scanner_sim.scene.light.sun import solar_irradiance

Floats = NDArray[np.float64]

_NODES = 8001
"""Wavelengths of the integral over a response: 0.1 nm apart for InGaAs."""
_BAND_NODES = 1001
"""Wavelengths of the integral over a pass band, densest at its centre."""


def band_irradiance(
    sun: Sun,
    filter: FilterChoice,  # noqa: A002
    response: tuple[float, float],
    wavelength: float,
    incidence: ArrayLike = 0.0,
) -> tuple[Floats, Floats]:
    """Return the Sun's irradiance that the detector counts, in the pass band and outside of it.

    Parameters
    ----------
    sun
        The Sun.
    filter
        The filter, or ``none``: then everything is out of band, and reflectances are those of out of band.
    response
        Shortest and longest wavelength [m] to which the detector responds, with a flat quantum efficiency.
    wavelength
        The laser's nominal wavelength λ₀ [m].
    incidence
        Angle on the filter [rad], any shape.

    Returns
    -------
    in_band, out_of_band
        Shape of ``incidence`` [W/m²], laser-equivalent: a watt stands for as many photons as a watt at λ₀, so energies
        are weighted with λ/λ₀. The filter's peak transmission is left to the caller, who applies it with the lens. In
        band ∫ E s λ/λ₀ dλ and out of band B_s/B_p ∫ E (1 − s) λ/λ₀ dλ over the response, s the
        :func:`~scanner_sim.optics.filter.passband`: the bracket of eq 18, restricted to what the detector sees. (Eq 18
        counts light inside of the band once more with the blocking, 1e-6 of it.)
    """
    angles = np.asarray(incidence, dtype=np.float64)
    if not response[0] < response[1]:
        return np.zeros(angles.shape), np.zeros(angles.shape)
    all_photons = _photon_integral(sun, np.linspace(*response, _NODES), wavelength)
    if filter == "none":
        return np.zeros(angles.shape), np.full(angles.shape, all_photons)
    centres = centre_at(centre_of(filter, wavelength), filter.effective_index, angles)
    inside = np.array([_band_integral(sun, filter, c, response, wavelength) for c in centres.ravel()])
    inside = inside.reshape(angles.shape)
    return inside, np.asarray(filter.blocking * (all_photons - inside))


def _photon_integral(sun: Sun, nodes: Floats, wavelength: float, weights: Floats | float = 1.0) -> float:
    """Return ∫ E w λ/λ₀ dλ [W/m²] over ascending nodes [m] by the trapezoidal rule."""
    return float(np.trapezoid(solar_irradiance(sun, nodes) * weights * nodes / wavelength, nodes))


def _band_integral(
    sun: Sun,
    filter: BandpassFilter,  # noqa: A002
    centre: float,
    response: tuple[float, float],
    wavelength: float,
) -> float:
    """Return the in-band irradiance [W/m²] of a filter centred at ``centre`` [m]."""
    half = 0.5 * filter.bandwidth
    low, high = ((end - centre) / half for end in response)
    if filter.shape == "tophat":
        low, high = max(low, -1.0), min(high, 1.0)
        if low >= high:
            return 0.0
        return _photon_integral(sun, centre + half * np.linspace(low, high, _BAND_NODES), wavelength)
    x = np.sinh(np.linspace(math.asinh(low), math.asinh(high), _BAND_NODES))
    return _photon_integral(sun, centre + half * x, wavelength, band_shape(filter, x))
