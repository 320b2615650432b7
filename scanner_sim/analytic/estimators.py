"""Peak estimators written for one line at a time: the judge's own spelling.

All take a line of at least 20 numbers with the light of one spot well inside it and the background taken
off, and return the position of the peak in pixels (pixel i has its centre at i), starting from the largest
pixel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from scipy.optimize import minimize

from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.foundation.errors import InputError

Estimator = Callable[[Sequence[float]], float]


def _largest(line: Sequence[float]) -> int:
    return max(range(len(line)), key=line.__getitem__)


def centre_of_mass(line: Sequence[float]) -> float:
    """Return Σ i f(i) / Σ f(i) over the seven pixels about the largest."""
    i = _largest(line)
    window = range(i - 3, i + 4)
    return sum(k * line[k] for k in window) / sum(line[k] for k in window)


def parabola(line: Sequence[float]) -> float:
    """Return the vertex of the parabola through the largest pixel and its neighbours."""
    i = _largest(line)
    left, middle, right = line[i - 1], line[i], line[i + 1]
    return i + 0.5 * (left - right) / (left - 2.0 * middle + right)


def gaussian(line: Sequence[float]) -> float:
    """Return the vertex of the parabola through three logarithms: exact for a sampled Gaussian."""
    i = _largest(line)
    left, middle, right = (float(np.log(line[k])) for k in (i - 1, i, i + 1))
    return i + 0.5 * (left - right) / (left - 2.0 * middle + right)


def blais_rioux(line: Sequence[float], half: int) -> float:
    """Return where g(i) = Σ_{k=1..half} f(i − k) − f(i + k) crosses zero next to the largest pixel.

    g is the difference of the light on the left and on the right; it rises through zero at the peak. Linear
    between pixels. Blais and Rioux, *Real-time numerical peak detector*, Signal Processing 11 (1986) 145–155.

    Raises
    ------
    InputError
        Where g does not change sign between the largest pixel and its neighbours.
    """

    def g(i: int) -> float:
        return sum(line[i - k] - line[i + k] for k in range(1, half + 1))

    i = _largest(line)
    first = i - 1 if g(i) > 0.0 else i
    before, after = g(first), g(first + 1)
    if before > 0.0 or after < 0.0 or before == after:
        raise InputError("the Blais-Rioux filter has no rising zero crossing at the largest pixel")
    return first + before / (before - after)


ESTIMATORS: Final[dict[str, Estimator]] = {
    "parabola": parabola,
    "gaussian": gaussian,
    "centre_of_mass": centre_of_mass,
    "blais_rioux_2": lambda line: blais_rioux(line, 1),
    "blais_rioux_4": lambda line: blais_rioux(line, 2),
    "blais_rioux_8": lambda line: blais_rioux(line, 4),
}
"""The estimators by their names in scenarios."""


def maximum_likelihood(line: Sequence[float], sigma_px: float, read: float, spread: float) -> float:
    """Return the position of the most probable spot, found by a general minimiser.

    Parameters
    ----------
    line
        Charges [electron], shape (n,), the light of one spot and nothing else.
    sigma_px
        Expected standard deviation s of the spot [pixel].
    read
        Standard deviation of the read noise [electron].
    spread
        Standard deviation of ln s² about its expectation.

    Notes
    -----
    Poisson charges with a normal read noise are taken for Poisson numbers of mean m_i + σ_r² at f_i + σ_r²: Huang et
    al., *Nature Methods* 10 (2013) 653. What is minimised over (ln N, µ, ln s²) is

    Σ (m_i + σ_r²) − (f_i + σ_r²) ln(m_i + σ_r²) + (ln s² − ln s₀²)²/(2 spread²).
    """
    charges = np.asarray(line, dtype=np.float64)
    start = _largest(line)
    total = max(float(charges[max(start - 6, 0) : start + 7].sum()), 1.0)

    def improbable(parameters: np.ndarray) -> float:
        logarithm, place, width = parameters
        shares = pixel_shares(start + place, float(np.exp(0.5 * width)), charges.size)
        mean = total * np.exp(logarithm) * shares + read**2
        known = 0.5 * ((width - 2.0 * np.log(sigma_px)) / spread) ** 2
        return float(np.sum(mean - (charges + read**2) * np.log(mean)) + known)

    first = np.array([0.0, 0.0, 2.0 * np.log(sigma_px)])
    steps = {"xatol": 1e-5, "fatol": 1e-9, "maxiter": 2000, "initial_simplex": None}
    found = minimize(improbable, first, method="Nelder-Mead", options=steps)
    return start + float(found.x[1])
