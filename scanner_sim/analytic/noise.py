"""How well the position of a spot can be known, and how well each estimator knows it.

A spot of N electrons and standard deviation s (in pixels), centred at µ, on pixels with a background of b
electrons and read noise σ_r. Sources: Winick, *Cramér–Rao lower bounds on the performance of charge-coupled-
device optical position estimators*, J. Opt. Soc. Am. A 3 (1986) 1809–1815, for the bound; first-order error
propagation for the estimators.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

from scanner_sim.analytic.estimators import ESTIMATORS, Estimator
from scanner_sim.analytic.spot import pixel_shares

Floats = NDArray[np.float64]

_LINE = 41
"""Pixels of the judge's line: a spot of 2 pixels in its middle loses less than 1e-20."""


def cramer_rao(centre_px: float, sigma_px: float, N: float, background: float, read: float) -> float:
    """Return the exact bound on the standard deviation of an unbiased position estimate [px].

    1 / √Σ_i (∂m_i/∂µ)² / (m_i + b + σ_r²) with m_i = N × pixel integral; N, s and b are known, and so is the
    variance of the noise. ``centre_px`` counts from the middle pixel of a long line.
    """
    centre = _LINE // 2 + centre_px
    m = N * pixel_shares(centre, sigma_px, _LINE)
    edges = np.arange(_LINE + 1) - 0.5
    slope = -N * np.diff(norm.pdf(edges, centre, sigma_px))
    variance = m + background + read**2
    lit = variance > 0.0
    return float(1.0 / np.sqrt(np.sum(slope[lit] ** 2 / variance[lit])))


def cramer_rao_closed(sigma_px: float, N: float, background: float, read: float) -> float:
    """Return √(s_eff²/N + 4√π s_eff³ (σ_r² + b)/N²) [px], s_eff² = s² + 1/12: the sum of both limits.

    The limits are shot noise alone and white noise alone: the known results for a finely sampled Gaussian,
    with the pixel's variance added to the spot's. Between the limits the sum is a lower bound. Good for
    s ≥ 0.7 px.
    """
    s2 = sigma_px**2 + 1.0 / 12.0
    return float(np.sqrt(s2 / N + 4.0 * np.sqrt(np.pi) * s2**1.5 * (read**2 + background) / N**2))


CALIBRATED_WIDTH = 0.005
"""Relative standard deviation of s² that a calibration of the focus leaves; assumed, as the simulator does."""


def width_spread(limits: tuple[float, float], beam: float) -> float:
    """Return the standard deviation of ln s² that is granted to a spot before it is fitted.

    Parameters
    ----------
    limits
        Least and largest image of the beam, relative to that on a facing surface: a quarter of what lies between is the
        standard deviation of the beam's part of s², which tilts change.
    beam
        That part's share of s².
    """
    return float(np.hypot(0.25 * (limits[1] ** 2 - limits[0] ** 2) * beam, CALIBRATED_WIDTH))


def fit_gradient(centre_px: float, sigma_px: float, N: float, variance: ArrayLike, spread: float) -> Floats:
    """Return the derivatives of a fitted position by the charges [px/electron], shape (pixels,).

    The fit of θ = (ln N, µ, ln s²) by its likelihood and by what is known of the width is to first order

    δθ = (F + P)⁻¹ Σ_i ∂m_i/∂θ δf_i/v_i,   F = Σ_i ∂m_i/∂θ (∂m_i/∂θ)ᵀ/v_i,   P_ww = 1/spread²

    (Kay, *Fundamentals of statistical signal processing* I, 1993, sec 3.7 for parameters that are not asked for, and
    Van Trees, *Detection, estimation and modulation theory* I, 1968, sec 2.4, for what is known beforehand). Its
    standard deviation is √Σ g_i² v_i on spots of the width that is expected: from the bound of a known width, where the
    spread is small, to that of an unknown one, [F⁻¹]_µµ. Charge and width are even about the spot, so both are the same
    where pixels are fine or the spot lies in the middle of one or between two. Averaged over spots whose widths are
    spread so, it is [(F + P)⁻¹]_µµ.

    Parameters
    ----------
    centre_px, sigma_px, N
        The spot: its centre on the line [px], its standard deviation [px] and its charge [electron].
    variance
        Of each pixel [electron²], by which the fit weighs, shape (pixels,).
    spread
        Standard deviation of ln s², as of :func:`width_spread`.
    """
    v = np.asarray(variance, dtype=np.float64)
    places = np.arange(v.size + 1) - 0.5
    pulls = (places - centre_px) / sigma_px
    heights = norm.pdf(pulls)
    m = N * np.diff(norm.cdf(pulls))
    moved, widened = -N * np.diff(heights) / sigma_px, -0.5 * N * np.diff(pulls * heights)
    slopes = np.stack([m, moved, widened])
    weights = np.divide(1.0, v, out=np.zeros_like(v), where=v > 0.0)
    information = (slopes * weights) @ slopes.T
    information[2, 2] += spread**-2
    size = np.sqrt(np.diag(information))
    inverse = np.linalg.inv(information / np.outer(size, size)) / np.outer(size, size)
    return np.asarray(inverse[1] @ (slopes * weights))


def first_order(estimator: Estimator, line: ArrayLike, variance: ArrayLike) -> float:
    """Return the standard deviation of an estimate [px], √Σ (∂p̂/∂f_i)² var_i.

    Parameters
    ----------
    estimator
        One of :data:`scanner_sim.analytic.estimators.ESTIMATORS`.
    line
        Noise-free line, shape (n,), background taken off.
    variance
        Variance of each pixel, shape (n,), independent.

    Notes
    -----
    The derivatives are central differences with steps of 1e-6 of the peak. Valid while the noise is too small
    to change which pixel is the largest, and small against the pixels the estimator uses.
    """
    line = np.asarray(line, dtype=np.float64)
    step = 1e-6 * float(line.max())
    gradient = np.empty_like(line)
    for i in range(line.size):
        up, down = line.copy(), line.copy()
        up[i] += step
        down[i] -= step
        gradient[i] = (estimator(up.tolist()) - estimator(down.tolist())) / (2.0 * step)
    return float(np.sqrt(gradient**2 @ np.asarray(variance, dtype=np.float64)))


class Performance(NamedTuple):
    """Largest systematic error over all positions in a pixel, and random standard deviation [px]."""

    bias: float
    sd: float


def white_noise_performance(name: str, sigma_px: float, snr: float, phases: int = 40) -> Performance:
    """Return the performance of an estimator under white noise, to first order.

    Parameters
    ----------
    name
        Key of :data:`scanner_sim.analytic.estimators.ESTIMATORS`.
    sigma_px
        Standard deviation of the spot.
    snr
        Height of the largest pixel of each line over the noise's standard deviation.
    phases
        Positions of the spot within a pixel, evenly spaced; those half-way between two pixels are left out.

    Notes
    -----
    The bias is that of noise-free lines; the standard deviation is the root mean square over the positions.
    Noise that changes which pixel is the largest is not in it: it matters for the centre of mass of wide
    spots, whose window jumps by a pixel (see :data:`ESTIMATOR_TABLE` for what is measured then).
    """
    variances = []
    for phase in _phases(phases):
        line = pixel_shares(_LINE // 2 + phase, sigma_px, _LINE)
        variances.append(first_order(ESTIMATORS[name], line, np.full(_LINE, (line.max() / snr) ** 2)) ** 2)
    return Performance(systematic_error(name, sigma_px, phases), float(np.sqrt(np.mean(variances))))


def systematic_error(name: str, sigma_px: float, phases: int) -> float:
    """Return the largest error [px] of an estimator on noise-free lines, as of :func:`white_noise_performance`."""
    lines = {phase: pixel_shares(_LINE // 2 + phase, sigma_px, _LINE) for phase in _phases(phases)}
    return max(abs(ESTIMATORS[name](line.tolist()) - _LINE // 2 - phase) for phase, line in lines.items())


def _phases(count: int) -> list[float]:
    return [(number + 0.5) / count - 0.5 for number in range(count)]


def false_alarms(threshold: float, pixels: int) -> float:
    """Return the probability that a line of normal noise has a pixel above ``threshold`` σ: 1 − Φ(k)^n."""
    return float(-np.expm1(pixels * norm.logcdf(threshold)))


def quantisation_sd(step: float) -> float:
    """Return the standard deviation of rounding to multiples of ``step``: step/√12, noise ≥ step/2 wide."""
    return step / float(np.sqrt(12.0))


TABLE_SNR: Final = 50.0
"""Peak signal-to-noise ratio of :data:`ESTIMATOR_TABLE`: largest pixel over white noise."""

_BIAS: Final = {
    0.7: (0.080, 0.001, 0.000, 0.041, 0.018, 0.017),
    1.0: (0.044, 0.000, 0.005, 0.033, 0.018, 0.012),
    1.5: (0.021, 0.000, 0.068, 0.018, 0.014, 0.007),
    2.0: (0.012, 0.000, 0.169, 0.011, 0.009, 0.006),
}
_SD: Final = {
    0.7: (0.021, 0.018, 0.051, 0.017, 0.021, 0.033),
    1.0: (0.030, 0.027, 0.040, 0.021, 0.021, 0.029),
    1.5: (0.052, 0.051, 0.043, 0.034, 0.026, 0.028),
    2.0: (0.091, 0.086, 0.089, 0.054, 0.036, 0.031),
}

BOUND_TABLE: Final[dict[float, float]] = {0.7: 0.018, 1.0: 0.021, 1.5: 0.026, 2.0: 0.030}
"""Cramér–Rao bound [px] by spot width [px], at :data:`TABLE_SNR`; same source as the next table."""

ESTIMATOR_TABLE: Final[dict[tuple[str, float], Performance]] = {
    (name, sigma): Performance(_BIAS[sigma][column], _SD[sigma][column])
    for sigma in _BIAS
    for column, name in enumerate(ESTIMATORS)
}
"""Performance by (estimator, spot width [px]) for a pixel-integrated Gaussian at :data:`TABLE_SNR`.

Computed for the project's physics notes (section 4) before the simulator existed: largest bias of noise-free
lines, standard deviation by Monte Carlo, both rounded to a thousandth of a pixel.
"""
