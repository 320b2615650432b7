"""The colour of the receiver's noise: white noise that the electronics have filtered, as the converter samples it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SPECTRUM = 1 << 14
_LEAST_TAP = 1e-5
"""Taps below this share of the largest are cut off at the ends."""


def correlation(lag: Array, sigma: float) -> Array:
    """Return the autocorrelation e^(−k²/4s²) of white noise behind a Gaussian response.

    h ⋆ h of a Gaussian h of standard deviation s is a Gaussian of variance 2 s² (the rule: Papoulis, *Probability,
    random variables, and stochastic processes*, 3rd ed., 1991, sec. 10.2).

    Parameters
    ----------
    lag
        Lags k [sample], any shape.
    sigma
        Standard deviation s of the response [sample].
    """
    return np.exp(-0.25 * (np.asarray(lag, dtype=np.float64) / max(sigma, 1e-9)) ** 2)


def colouring_taps(sigma: float) -> Array:
    """Return the symmetric filter that gives white samples the autocorrelation of :func:`correlation`.

    Its transfer function is the root of the sampled noise's spectrum (the spectral method of Shinozuka and Deodatis,
    *Applied Mechanics Reviews* 44, 1991): the covariance at the samples is exact, aliasing included.

    Parameters
    ----------
    sigma
        Standard deviation of the response [sample].

    Returns
    -------
    ndarray
        2h + 1 taps with h even, whose squares add up to 1.
    """
    lag = np.minimum(np.arange(_SPECTRUM), _SPECTRUM - np.arange(_SPECTRUM))
    spectrum = np.fft.rfft(correlation(lag, sigma)).real
    taps = np.fft.irfft(np.sqrt(np.maximum(spectrum, 0.0)), _SPECTRUM)
    heard = np.flatnonzero(np.abs(taps[: _SPECTRUM // 2]) > _LEAST_TAP * taps[0])
    half = int(heard[-1] + heard[-1] % 2)
    both = np.concatenate([taps[half:0:-1], taps[: half + 1]])
    return np.asarray(both / np.sqrt(np.sum(both**2)))


def light_noise_variance(sigma: float) -> float:
    """Return the variance [sample²] to add to the light's course where it scales white noise before the taps.

    Shot noise at the output follows the light smoothed by h², a Gaussian of variance s²/2; the taps smooth it by their
    squares already, and the rest is added here, 0 or more.
    """
    taps = colouring_taps(sigma)
    away = np.arange(taps.size) - taps.size // 2
    return max(0.5 * sigma**2 - float(np.sum(away**2 * taps**2)), 0.0)


def shot_covariance(lag: int, middle: Array, sigma: float, light: Callable[[Array], Array]) -> Array:
    """Return the covariance of two samples by white noise that follows the light and that the electronics filter.

    The noise at the samples is that of :func:`colouring_taps` c behind white noise of the variance L at the samples'
    times: Σ_k c_k c_{k+lag} L(t − k) for the earlier one at t. For electronics that are slow against the samples it is
    ∫ h(t − u) h(t + lag − u) L(u) du; at a standard deviation of 0.66 samples it is within 10 % of that about a pulse,
    and far out on its skirts, where neighbours share less, by a quarter below.

    Parameters
    ----------
    lag
        Samples between the two.
    middle
        Time of their middle [sample].
    sigma
        Standard deviation of the response [sample].
    light
        L at times [sample], smoothed by :func:`light_noise_variance`.
    """
    taps = colouring_taps(sigma)
    both = taps[: taps.size - lag] * taps[lag:]
    away = np.arange(both.size) - taps.size // 2
    found = np.zeros(middle.shape)
    for share, step in zip(both, away, strict=True):
        found += share * light(middle - 0.5 * lag - step)
    return found
