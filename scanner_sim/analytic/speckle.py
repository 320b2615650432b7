"""Speckle on the sensor in closed form: the published limits, and sums over the packets of a spot's light.

Of light that a beam with the geometric image e scatters, a lens of the area A passes M = A/((λf)² ∫e²) statistically
independent packets (Goodman, *Speckle phenomena in optics*, 2007, ch. 4, on integrated speckle). For a round Gaussian
image, M = π²σ²/(λN)²: the energy varies by C/√M, and the position on the sensor, without aberration, by

* σ/√(2M) = C λN/(π√2) = 0.225 C λN, if it is taken as the centroid;
* C λN/√(2π) = 0.40 C λN, if it is taken where half of the light lies to each side, as Baribeau and Rioux have it
  (*Appl. Opt.* 30, 1991).

Neither depends on the size of the spot. Dorsch, Häusler and Herrmann (*Appl. Opt.* 33, 1994) have C λN/π = 0.318 C λN.
:mod:`scanner_sim.analytic.wave_optics` gets along with fewer assumptions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive, ndtr

Floats = NDArray[np.float64]


def centroid_limit(contrast: float, wavelength: float, f_number: float) -> float:
    """Return the standard deviation of the centroid of a round Gaussian spot without aberration, C λN/(π√2) [m]."""
    return contrast * wavelength * f_number / (math.pi * math.sqrt(2.0))


def halving_limit(contrast: float, wavelength: float, f_number: float) -> float:
    """Return the standard deviation of the point that halves the light of a round Gaussian spot, C λN/√(2π) [m]."""
    return contrast * wavelength * f_number / math.sqrt(2.0 * math.pi)


def published_limit(contrast: float, wavelength: float, f_number: float) -> float:
    """Return the limit of Dorsch, Häusler, Herrmann (1994), C λN/π [m]."""
    return contrast * wavelength * f_number / math.pi


def published_range_limit(
    contrast: float, wavelength: float, distance: float, aperture: float, baseline: float
) -> float:
    """Return the same as a range, C λ R²/(π D_ap d) [m]: 9.5 mm at 10 m for C = 1, 1.5 µm, 25 mm and 0.2 m."""
    return contrast * wavelength * distance**2 / (math.pi * aperture * baseline)


def pupil_averages(ratio: float) -> tuple[float, float]:
    """Return the relative variance of the light through a round pupil, and that of its mean slope.

    Parameters
    ----------
    ratio
        σ_b/(λN), the beam's geometric image over λN.

    Notes
    -----
    ∬|γ(u − u')|² g(u) g(u') du du' over the pupil, divided by the square of its area; u is in radii of the pupil, and
    |γ|² = exp(−(π ratio Δu)²) is the coherence of the light there. For the energy g = 1; for the slope g = 2u, that of
    a lens out of focus, scaled to a variance of 1. Over spatial frequencies (Parseval) these are (2/a) ∫ J₁²(k)
    exp(−k²/4a)/k dk and (4/a) ∫ J₂²(k) exp(−k²/4a)/k dk with a = (π ratio)², and, by Weber's second exponential
    integral (Watson, *Theory of Bessel functions*, 1944, 13.31), (1 − e^(−2a) (I₀ + I₁))/a and
    (1 − e^(−2a) (I₀ + 2I₁ + I₂))/a of the argument 2a.
    """
    a = (math.pi * ratio) ** 2
    zeroth, first, second = (float(ive(order, 2.0 * a)) for order in range(3))
    energy = (1.0 - zeroth - first) / a
    if a < 1e-3:  # the difference below drowns in rounding
        return energy, 0.5 * a * (1.0 - a * (4.0 / 3.0 - 7.0 / 6.0 * a))
    return energy, (1.0 - zeroth - 2.0 * first - second) / a


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
    Patterns whose correlation over a displacement δ is ρ(δ), averaged along a straight path of length L, keep the share
    2 ∫₀¹ (1 − x) ρ(x L) dx of their variance. For the energy ρ = exp(−δ²/w²); for the centroid, that function's second
    derivative along the line, scaled to 1 at δ = 0.
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
        """Variances [m²] of the packets' positions, by the surface and by aberration, and of the blur of each."""
        energy, slope = pupil_averages(self.image / self.cell)
        own = (self.cell / math.pi) ** 2 * (1.0 + (self.aberration / self.image) ** 2)
        return 0.5 * self.image**2, self.aberration**2 * slope / energy, self.diffusion**2 + own

    def single_variance(self, left: tuple[float, float]) -> float:
        """Return the relative variance for C = 1 that the maximum-likelihood fit counts as noise of single pixels.

        The fit's weights leave out what the pixels have in common. What remains is the variance of the energy times the
        square of the packets' share of the spot's variance: the rest of it is the blur of each packet.
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
    E[K_i(p) K_j(p)]/M, summed over the positions p of packets. K_i(p) is the share of a packet at p that falls on pixel
    i: the pixel blurred by diffusion and by the packet's own size, (λN/π) √(1 + σ_a²/σ²). The positions are Gaussian,
    with the variances of the surface and of aberration that :attr:`SpeckledSpot.packets` gives. During a dwell, what
    all pixels have in common averages as the energy does, and the rest as the positions do.
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
    """Return the positions [pixel] of spots of a known width, by maximum likelihood.

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
    As if each packet fell on one pixel: the variances are then in proportion to the mean charges, as for Poisson's law
    (Winick, *J. Opt. Soc. Am. A* 3, 1986). Found by Fisher's method of scoring.
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
