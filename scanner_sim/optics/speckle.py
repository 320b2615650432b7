"""Speckle: how coarse the laser's light is on the sensor, and how strong.

A rough surface in coherent light sends waves of random phases. Behind a lens with a circular pupil of f-number N the
intensity I = Ī s has a mean Ī, the image as it would be in incoherent light, and a speckle s of mean 1 and of the
covariance

    C² |μ|²(Δ),   |μ|² = (2 J₁(v)/v)²,  v = π Δ/(λ N),   ∬|μ|² = S_c = (4/π) (λ N)²

(Goodman, *Speckle phenomena in optics*, 2007, secs 4.4 and 4.5; the image lies at about the focal length). Its Fourier
transform is S_c times the modulation transfer function of the pupil, which ends at 1/(λ N). Aberrations blur Ī but not
the speckle: |μ|² knows the pupil's transmission only.

A pixel collects many cells. On a line of Gaussian profile across it, of standard deviation σ_y, the charges under an
even light have the relative covariance, k pixels of pitch D apart,

    ρ_k = C² ∫∫ S_c MTF exp(−4π² σ_y² f_y²) sinc²(f_x D) cos(2π k f_x D) df_x df_y.

C is that of the surface (:func:`~scanner_sim.scene.polarisation.speckle_contrast`).

Not modelled: lines so broad that they lose coherence over the depth of the surface, speckle that is not fully
developed on polished surfaces, and the motion of the pattern over the pixels as the beam moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.optics.receiver import Receiver

_LEFT_OUT = 1e-4
"""Share of the taps' squares that may be left out."""
_ORDERS = 64
"""Aliases of the pixels' sampling that are summed."""
_ACROSS = 101
"""Points of the integral across the line."""


def cell_area(wavelength: float, f_number: float) -> float:
    """Return S_c = (4/π)(λN)² [m²], the area of a cell behind a circular pupil (Goodman, sec 4.4)."""
    return 4.0 / math.pi * (wavelength * f_number) ** 2


@dataclass(frozen=True)
class Grain:
    """The speckle's grain on a line of pixels, in pixels.

    Attributes
    ----------
    length
        Standard deviation s of the Gaussian exp(−Δ²/2s²) of the same cell area, 2π s² = S_c.
    taps
        Weights of the filter, 2 T + 1 of them, their squares' sum 1, that gives white noise the pixels' covariance.
    variance
        ρ_0 for C = 1 and the profile ``across``.
    across
        Standard deviation σ_y across the line for which ``taps`` and ``variance`` hold.
    loss
        Share of a pixel's variance that goes to its neighbours' covariance, 1 − ρ_0/Σ_k ρ_k over all k.
    """

    length: float
    taps: tuple[float, ...]
    variance: float
    across: float
    loss: float

    @property
    def reach(self) -> int:
        """Number T of neighbours to each side that a filtered pixel takes in."""
        return len(self.taps) // 2

    @property
    def correlations(self) -> tuple[float, ...]:
        """Correlation of pixels 0, 1, … 2T apart."""
        both = np.correlate(self.taps, self.taps, mode="full")
        return tuple(both[len(self.taps) - 1 :].tolist())

    @classmethod
    def of(cls, wavelength: float, receiver: Receiver, pitch: float, height: float) -> Grain:
        """Return the grain behind a receiver on pixels of a pitch and a height [m].

        The profile across the line is that of the point spread, at most the pixels' height, evenly lit: the beam's own
        image widens it by up to a third, which :func:`~scanner_sim.detector.speckle.pixel_variance` allows for.
        """
        f_number = receiver.focal_length / receiver.aperture
        across = min(receiver.point_spread, height / math.sqrt(12.0))
        return _grain(wavelength * f_number / pitch, across / pitch)


@lru_cache(maxsize=64)
def _grain(cell: float, across: float) -> Grain:
    """Return the grain for λN and σ_y in pixels."""
    spectrum = pixel_spectrum(cell, across)
    taps = np.fft.irfft(np.sqrt(np.maximum(spectrum, 0.0)))
    square = taps**2
    total = float(square.sum())
    half = len(taps) // 2
    # What lies beyond k on both sides, for k = 0, 1, ...
    beyond = total - square[0] - 2.0 * np.concatenate([[0.0], np.cumsum(square[1:half])])
    reach = max(1, int(np.argmax(beyond < _LEFT_OUT * total)))
    kept = np.concatenate([taps[reach:0:-1], taps[: reach + 1]])
    kept = kept / math.sqrt(float(np.sum(kept**2)))
    length = math.sqrt(cell_area(cell, 1.0) / (2.0 * math.pi))
    return Grain(length, tuple(kept.tolist()), total, across, 1.0 - total / float(spectrum[0]))


def pixel_spectrum(cell: float, across: float) -> NDArray[np.float64]:
    """Return the spectrum of the pixels' charges, whose cosine transform is ρ_k for C = 1.

    Parameters
    ----------
    cell
        λN [pixel].
    across
        σ_y [pixel].

    Returns
    -------
    numpy.ndarray
        At n/2 + 1 frequencies from 0 to 1/2 per pixel, as ``numpy.fft.irfft`` takes it.
    """
    end = 1.0 / cell
    count = max(256, 2 ** math.ceil(math.log2(64.0 / min(end, 1.0))))
    base = np.arange(count // 2 + 1) / count
    most = min(math.ceil(end + 0.5), _ORDERS)
    along = base[:, None] + np.arange(-most, most + 1)[None, :]
    # The profile's own spectrum ends after five of its standard deviations, or with the pupil's.
    last = min(5.0 / (2.0 * math.sqrt(2.0) * math.pi * across), end)
    height = np.linspace(0.0, last, _ACROSS)
    found = np.zeros_like(along)
    for number, frequency in enumerate(height):
        share = (0.5 if number in (0, _ACROSS - 1) else 1.0) * math.exp(
            -((2.0 * math.pi * across * frequency) ** 2)
        )
        found += share * _transfer(np.hypot(along, frequency) * cell)
    found *= 2.0 * last / (_ACROSS - 1) * cell_area(cell, 1.0)
    return np.asarray(np.sum(found * np.sinc(along) ** 2, axis=1))


def _transfer(frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the modulation transfer function of a circular pupil, of the frequency in units of its end."""
    u = np.minimum(frequency, 1.0)
    return np.asarray(2.0 / math.pi * (np.arccos(u) - u * np.sqrt(1.0 - u * u)))


def patterns(sweep: Any, slimness: Any) -> Any:
    """Return how many independent patterns a dwell averages, M = 1 + travel/(spot's diameter).

    Parameters
    ----------
    sweep
        Angle by which the beam moves in the dwell [rad]; numbers or any arrays.
    slimness
        Range over the beam's 1/e² radius there, R/w.

    Notes
    -----
    The diameter is 2w (Baribeau, Rioux, *Appl. Opt.* 30, 1991). The average over a straight path of length L of
    patterns with the correlation exp(−δ²/w²) has M → L/(√π w) where L is long: 13 % more.
    """
    return 1.0 + 0.5 * sweep * slimness
