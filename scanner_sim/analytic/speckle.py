"""Speckle on the sensor in closed form: the published limits, and sums over the packets of a spot's light.

A lens of the area A passes M = A/((λf)² ∫e²) independent packets of light that comes from a beam of the geometric image
e (Goodman, *Speckle phenomena in optics*, 2007, ch. 4, for the integrated speckle). For a round Gaussian image the
energy has the contrast C/√M, M = π²σ²/(λN)², and the places have these limits without aberration:

* centroid: σ/√(2M) = C λN/(π√2) = 0.225 C λN;
* the place that halves the light: C λN/√(2π) = 0.40 C λN, the figure of Baribeau and Rioux (*Appl. Opt.* 30, 1991);

both whatever the size of the spot. Dorsch, Häusler and Herrmann (*Appl. Opt.* 33, 1994) have C λN/π = 0.318 C λN.
What assumes less is in :mod:`scanner_sim.analytic.wave_optics`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

Floats = NDArray[np.float64]

_GRID = 512
"""Points to each side of the pupil's plane, four of whose radii they cover."""


def centroid_limit(contrast: float, wavelength: float, f_number: float) -> float:
    """Return the standard deviation of the centroid of a round Gaussian spot without aberration, C λN/(π√2) [m]."""
    return contrast * wavelength * f_number / (math.pi * math.sqrt(2.0))


def halving_limit(contrast: float, wavelength: float, f_number: float) -> float:
    """Return the standard deviation of the place that halves a round Gaussian spot, C λN/√(2π) [m]."""
    return contrast * wavelength * f_number / math.sqrt(2.0 * math.pi)


def published_limit(contrast: float, wavelength: float, f_number: float) -> float:
    """Return the limit of Dorsch, Häusler, Herrmann (1994), C λN/π [m]."""
    return contrast * wavelength * f_number / math.pi


def published_range_limit(
    contrast: float, wavelength: float, distance: float, aperture: float, baseline: float
) -> float:
    """Return the same as a range, C λ R²/(π D_ap d) [m]: 9.5 mm at 10 m for C = 1, 1.5 µm, 25 mm and 0.2 m."""
    return contrast * wavelength * distance**2 / (math.pi * aperture * baseline)


@lru_cache(maxsize=256)
def pupil_averages(ratio: float) -> tuple[float, float]:
    """Return the variances of the light through a round pupil, and of the mean of a slope 2u over it.

    Parameters
    ----------
    ratio
        σ_b/(λN), the beam's geometric image over λN.

    Notes
    -----
    ∬|γ(u − u')|² g g' over the pupil, in radii of it, over its area squared: |γ|² = exp(−(π ratio Δu)²), g = 1 and the
    slope 2u of unit variance that a lens out of focus has. By Parseval as a sum over frequencies.
    """
    u = (np.arange(_GRID) - _GRID // 2) * (4.0 / _GRID)
    k = 2.0 * math.pi * np.fft.fftfreq(_GRID, u[1] - u[0])
    inside = (u[:, None] ** 2 + u[None, :] ** 2 <= 1.0).astype(np.float64)
    width = (math.pi * ratio) ** 2
    spectrum = math.pi / width * np.exp(-(k[:, None] ** 2 + k[None, :] ** 2) / (4.0 * width))
    scale = (float(inside.sum()) * _GRID * (u[1] - u[0])) ** 2
    found = [
        float((np.abs(np.fft.fft2(weight * inside)) ** 2 * spectrum).sum()) / scale
        for weight in (1.0, 2.0 * u[:, None])
    ]
    return found[0], found[1]


def averaged(travel: tuple[float, float], radius: float) -> tuple[float, float]:
    """Return what a dwell leaves of the variances of energy and centroid.

    Parameters
    ----------
    travel
        Of the beam over the surface, along the line and across it [m].
    radius
        1/e² radius of the beam there [m].

    Notes
    -----
    The mean over a straight path of length L of patterns with the correlation ρ(δ) has the variance
    2 ∫₀¹ (1 − x) ρ(x L) dx; ρ = exp(−δ²/w²), and its second derivative along the line for the centroid.
    """
    place = (np.arange(4000) + 0.5) / 4000
    along, across = (place * way / radius for way in travel)
    keeps = 2.0 * (1.0 - place) * np.exp(-(along**2) - across**2) / 4000
    return float(keeps.sum()), float((keeps * (1.0 - 2.0 * along**2)).sum())


@dataclass(frozen=True)
class SpeckledSpot:
    """A spot on the line [m]: its geometric image's standard deviation, λN, aberration, diffusion and the pitch."""

    image: float
    cell: float
    aberration: float
    diffusion: float
    pitch: float

    @property
    def sigma(self) -> float:
        """Standard deviation of the whole spot [m]."""
        return math.sqrt(self.image**2 + self.aberration**2 + self.diffusion**2)

    @property
    def energy_variance(self) -> float:
        """Relative variance of the charge for C = 1."""
        return pupil_averages(self.image / self.cell)[0]

    @property
    def packets(self) -> tuple[float, float, float]:
        """Variances [m²] of the packets' places from the surface and from aberration, and of what blurs each."""
        energy, slope = pupil_averages(self.image / self.cell)
        own = (self.cell / math.pi) ** 2 * (1.0 + (self.aberration / self.image) ** 2)
        return 0.5 * self.image**2, self.aberration**2 * slope / energy, self.diffusion**2 + own

    def single_variance(self, left: tuple[float, float]) -> float:
        """Return the relative variance for C = 1 that the program's fit takes as one of single pixels.

        Places to the fourth power over the whole spread: its weights leave out what pixels have in common.
        """
        surface, aberrant, blur = self.packets
        places = (surface * left[1] + aberrant * left[0]) / (surface + aberrant)
        return self.energy_variance * places * ((surface + aberrant) / (surface + aberrant + blur)) ** 2

    @property
    def centroid_sigma(self) -> float:
        """Standard deviation of the centroid for C = 1 [m]."""
        energy, slope = pupil_averages(self.image / self.cell)
        return math.sqrt(0.5 * self.image**2 * energy + self.aberration**2 * slope)


def pixel_covariance(
    spot: SpeckledSpot, centre: float, pixels: int, left: tuple[float, float] = (1.0, 1.0)
) -> Floats:
    """Return the covariance of the pixels' shares of a round Gaussian spot, shape (pixels, pixels), for C = 1.

    Parameters
    ----------
    spot
        The spot.
    centre
        Its middle [pixel]; pixel i covers (i − 1/2, i + 1/2).
    pixels
        Number of pixels.
    left
        What the dwell leaves of the variances of energy and centroid (:func:`averaged`).

    Notes
    -----
    E[K_i(p) K_j(p)]/M as a sum over places p of packets, Gaussian of the variance σ²/2 + σ_a² of which both parts count
    as their own averages over the pupil have it; K is the pixel blurred by diffusion and by the packets' own size,
    (λN/π) √(1 + σ_a²/σ²). What all pixels have in common averages as the energy does, the rest as the places do.
    """
    energy = spot.energy_variance
    surface, aberrant, blur = spot.packets
    place = (np.arange(800) + 0.5) / 100.0 - 4.0
    weight = np.exp(-0.5 * place**2)
    weight /= weight.sum()
    at = centre * spot.pitch + math.sqrt(surface + aberrant) * place
    edges = (np.arange(pixels + 1) - 0.5) * spot.pitch
    seen = np.diff(ndtr((edges - at[:, None]) / math.sqrt(blur)), axis=1)
    mean = weight @ seen
    share = surface / (surface + aberrant)
    places = share * left[1] + (1.0 - share) * left[0]
    apart = (seen * weight[:, None]).T @ seen - np.outer(mean, mean)
    return np.asarray(energy * (left[0] * np.outer(mean, mean) + places * apart))


def pixel_shares(pitch: float, centre: float, along: float, pixels: int) -> Floats:
    """Return the mean shares of the spot on the pixels, shape (pixels,)."""
    edges = (np.arange(pixels + 1) - 0.5) * pitch
    return np.asarray(np.diff(ndtr((edges - centre) / along)))


def fitted_place(lines: Floats, centre: float, sigma: float, guard: int) -> Floats:
    """Return the places [pixel] of spots of a known width, by the likelihood of packets that each fall on one pixel.

    Parameters
    ----------
    lines
        Charges, shape (n, pixels).
    centre, sigma
        A first guess of the place, and the spot's standard deviation [pixel].
    guard
        Pixels to each side of the first guess that count.

    Notes
    -----
    Variances in proportion to the mean charges, as Poisson's (Winick, *J. Opt. Soc. Am. A* 3, 1986), by scoring.
    """
    first = round(centre) - guard
    few, place = lines[:, first : first + 2 * guard + 1], np.full(len(lines), float(centre))
    edges = np.arange(first, first + 2 * guard + 2) - 0.5
    for _ in range(8):
        x = (edges - place[:, None]) / sigma
        share = np.diff(ndtr(x), axis=1)
        slope = -np.diff(np.exp(-0.5 * x**2), axis=1) / (sigma * math.sqrt(2.0 * math.pi))
        charge = few.sum(axis=1) / share.sum(axis=1)
        score = (few * slope / share).sum(axis=1) / charge - slope.sum(axis=1)
        place += score / (slope**2 / share).sum(axis=1)
    return place


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
