"""Speckle on the sensor: the published limits, and the covariance of pixels by integration in space.

The intensity on the sensor is the mean image times a speckle of mean 1 whose covariance behind a circular pupil is
C² |μ|²(Δ), |μ|² = (2 J₁(v)/v)², v = πΔ/(λN) (Goodman, *Speckle phenomena in optics*, 2007, eq 4-63). ∬|μ|² = S_c =
(4/π)(λN)². For cells small against the spot a weighted integral X = ∬ g I has the variance C² S_c ∬ g² I², from which
the limits of a spot of Gaussian profile exp(−x²/2σ_x² − y²/2σ_y²) follow:

* centroid, g = x/∬I:  C² S_c ∬x²I²/(∬I)² = C² S_c/(8π) for round spots: σ_p = C λN/(π√2) = 0.225 C λN;
* the place that halves the light, g = sign(x)/(2 I_p(0)) with I_p the profile along the line:
  C² S_c/8, σ_p = C λN/√(2π) = 0.40 C λN, the figure of Baribeau and Rioux (*Appl. Opt.* 30, 1991);

both whatever the size of the spot. Dorsch, Häusler and Herrmann (*Appl. Opt.* 33, 1994) have C λN/π = 0.318 C λN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf, j1

Floats = NDArray[np.float64]


def cell_area(wavelength: float, f_number: float) -> float:
    """Return S_c = (4/π)(λN)² [m²]."""
    return 4.0 * (wavelength * f_number) ** 2 / math.pi


def centroid_limit(contrast: float, wavelength: float, f_number: float) -> float:
    """Return the standard deviation of the centroid of a round Gaussian spot, C λN/(π√2) [m]."""
    return contrast * math.sqrt(cell_area(wavelength, f_number) / (8.0 * math.pi))


def halving_limit(contrast: float, wavelength: float, f_number: float) -> float:
    """Return the standard deviation of the place that halves a round Gaussian spot, C λN/√(2π) [m]."""
    return contrast * math.sqrt(cell_area(wavelength, f_number) / 8.0)


def published_limit(contrast: float, wavelength: float, f_number: float) -> float:
    """Return the limit of Dorsch, Häusler, Herrmann (1994), C λN/π [m]."""
    return contrast * wavelength * f_number / math.pi


def published_range_limit(
    contrast: float, wavelength: float, distance: float, aperture: float, baseline: float
) -> float:
    """Return the same as a range, C λ R²/(π D_ap d) [m]: 9.5 mm at 10 m for C = 1, 1.5 µm, 25 mm and 0.2 m."""
    return contrast * wavelength * distance**2 / (math.pi * aperture * baseline)


def coherence(distance: Floats, wavelength: float, f_number: float) -> Floats:
    """Return |μ|² at a distance [m] on the sensor."""
    v = np.maximum(np.pi * distance / (wavelength * f_number), 1e-9)
    return np.asarray((2.0 * j1(v) / v) ** 2)


def pixel_covariance(
    wavelength: float, f_number: float, pitch: float, centre: float, spot: tuple[float, float], pixels: int
) -> Floats:
    """Return the covariance of the pixels' shares of a Gaussian spot, shape (pixels, pixels), for C = 1.

    Parameters
    ----------
    wavelength, f_number
        Of the light and of the lens.
    pitch
        Of the pixels [m]; pixel i covers (i − 1/2, i + 1/2) pitch.
    centre
        Middle of the spot [m].
    spot
        Standard deviations along and across the line [m].
    pixels
        Number of pixels, at most a few thousand grain lengths long in all.

    Notes
    -----
    ∫∫ e(x) e(x') ∫ |μ|²(x − x', η) G_{√2σ_y}(η) dη dx dx' as a sum over points eight to a λN; the inner integral is
    that of the profile across the line with itself.
    """
    along, across = spot
    cell = wavelength * f_number
    each = max(4, math.ceil(8.0 * pitch / cell))
    step = pitch / each
    x = (np.arange(pixels * each) + 0.5) * step - 0.5 * pitch
    envelope = np.exp(-0.5 * ((x - centre) / along) ** 2) / (math.sqrt(2.0 * math.pi) * along)
    overlap = math.sqrt(2.0) * across
    eta = (np.arange(2000) + 0.5) / 2000 * 6.0 * overlap
    weight = (
        2.0 * np.exp(-0.5 * (eta / overlap) ** 2) / (math.sqrt(2.0 * math.pi) * overlap) * (eta[1] - eta[0])
    )
    lags = np.arange(len(x)) * step
    line = np.array([np.sum(weight * coherence(np.hypot(lag, eta), wavelength, f_number)) for lag in lags])
    index = np.arange(len(x))
    joint = envelope[:, None] * envelope[None, :] * line[np.abs(index[:, None] - index[None, :])] * step**2
    return np.asarray(joint.reshape(pixels, each, pixels, each).sum(axis=(1, 3)))


def pixel_shares(pitch: float, centre: float, along: float, pixels: int) -> Floats:
    """Return the mean shares of the spot on the pixels, shape (pixels,)."""
    edges = (np.arange(pixels + 1) - 0.5) * pitch
    return np.asarray(np.diff(0.5 * (1.0 + erf((edges - centre) / (math.sqrt(2.0) * along)))))


def position_sigma(
    estimator: Callable[[Sequence[float]], float], shares: Floats, covariance: Floats
) -> float:
    """Return the standard deviation of an estimate [pixel] by first-order propagation.

    Parameters
    ----------
    estimator
        Position of a line of numbers.
    shares
        The mean line, shape (pixels,).
    covariance
        Of the pixels, shape (pixels, pixels).
    """
    slopes = np.zeros(len(shares))
    step = 1e-5 * float(shares.max())
    for pixel in range(len(shares)):
        moved = [shares.copy() for _ in range(2)]
        moved[0][pixel] += step
        moved[1][pixel] -= step
        ahead, behind = (estimator(line.tolist()) for line in moved)
        slopes[pixel] = (ahead - behind) / (2.0 * step)
    return float(np.sqrt(slopes @ covariance @ slopes))
