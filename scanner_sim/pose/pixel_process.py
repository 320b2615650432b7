"""What unlike pixels do to a range while its image moves over them, as a shaping filter of white noise.

Images Δ of their widths apart share (1 − Δ²/2) exp(−Δ²/4) of it
(:func:`~scanner_sim.tracking.errors.pixel_correlation`): nearly all at first, less than nothing from √2 on, and in the
integral nothing. A Gauss-Markov process of first order has a cusp and a tail in place of that. One of third order does
better, white noise through s/((s² + 2αs + α² + ω²)(s + β)), whose zero at s = 0 makes the integral vanish. In its
modes x

    x(Δ) = (e^{−αΔ} (rotation by ωΔ) ⊕ e^{−βΔ}) x(0) + noise,

and the range errs by c·x. α, ω and β are those of least squares over six widths: c·x has the correlation to 0.03 rms
and 0.05 at most, where exp(−Δ) errs by 0.28 and 0.54.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DECAY, _TURN, _SLOW = 0.566, 1.151, 0.4425
"""α, ω and β [1/width]."""


def _stationary() -> tuple[Array, Array]:
    """Return the covariance of x, ∫ f fᵀ of the modes' impulse response f, and c for a variance of c·x of 1."""
    a, w, b = _DECAY, _TURN, _SLOW
    both, square = a + b, a * a + w * w
    sine, cosine = w / (both * both + w * w), both / (both * both + w * w)
    mixed = 0.25 * w / square
    spread = np.array(
        [
            [0.25 / a - 0.25 * a / square, mixed, sine],
            [mixed, 0.25 / a + 0.25 * a / square, cosine],
            [sine, cosine, 0.5 / b],
        ]
    )
    slow = -b / ((a - b) ** 2 + w * w)
    shares = [(1.0 + (b - a) * slow) / w, -slow, slow]
    variance = sum(
        one * other * spread[i, j] for i, one in enumerate(shares) for j, other in enumerate(shares)
    )
    return spread, np.array(shares) / math.sqrt(variance)


SPREAD, SHARES = _stationary()
"""Stationary covariance (3, 3) of x, and c (3,), by which it moves the range in its standard deviations."""


def moved_on(way: float) -> Array:
    """Return the transition of x, (3, 3), while the image moves by a way [width]."""
    fade, turn = math.exp(-_DECAY * way), _TURN * way
    cosine, sine = fade * math.cos(turn), fade * math.sin(turn)
    return np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, math.exp(-_SLOW * way)]])
