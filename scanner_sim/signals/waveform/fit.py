"""Fits of a pulse to the samples about a peak: of its known shape, or of a Gaussian of free width."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.signals.waveform.filter import PHASES, MatchedFilter

Array = NDArray[np.float64]

_NEWTON_STEPS = 3
_GAUSS_NEWTON_STEPS = 8
_NONZERO = 1e-20


@dataclass
class PulseFit:
    """A pulse fitted to each record, Dr.Jit arrays.

    ``shift`` of its centroid from the peak's sample [sample], ``amplitude`` in the records' unit, ``phase`` the row of
    the filter that it was found with.
    """

    shift: Float
    amplitude: Float
    phase: UInt32


@dataclass(frozen=True, eq=False)
class TimingFilter:
    """A matched filter on the device."""

    shift: Float
    amplitude: Float
    variance: tuple[Float, Float, Float]
    height_variance: tuple[Float, Float, Float]
    taps: int

    @classmethod
    def of(cls, matched: MatchedFilter) -> TimingFilter:
        """Return a filter for kernels."""
        shift, amplitude = (
            auto.Float(values.astype(np.float32).ravel()) for values in (matched.shift, matched.amplitude)
        )
        moments = matched.moments.on_device(), matched.height_moments.on_device()
        return cls(shift, amplitude, *moments, matched.shift.shape[1])

    def fit(self, samples: list[Float], start: Float) -> PulseFit:
        """Maximise the likelihood of delay and amplitude by Newton's steps from ``start`` [sample].

        Parameters
        ----------
        samples
            The samples about each peak, 2K + 1 arrays of shape (m,).
        start
            First guess of the shift, shape (m,).
        """
        shift, amplitude, row = start, auto.Float(1.0), auto.UInt32(PHASES)
        for _ in range(_NEWTON_STEPS):
            row = auto.UInt32(dr.round(dr.clip(shift, -1.0, 1.0) * PHASES) + PHASES)
            beyond, amplitude = auto.Float(0.0), auto.Float(0.0)
            for tap, sample in enumerate(samples):
                at = row * self.taps + tap
                beyond = dr.fma(dr.gather(auto.Float, self.shift, at), sample, beyond)
                amplitude = dr.fma(dr.gather(auto.Float, self.amplitude, at), sample, amplitude)
            step = beyond / dr.maximum(amplitude, _NONZERO)
            shift = (auto.Float(row) - PHASES) / PHASES + dr.clip(step, -0.5, 0.5)
        return PulseFit(shift, amplitude, row)

    def variances(self, row: UInt32) -> tuple[list[Float], list[Float]]:
        """Return variances per coloured, white and shot variance: of shift times amplitude, and of the amplitude."""
        of_shift, of_height = (
            [dr.gather(auto.Float, values, row) for values in moments]
            for moments in (self.variance, self.height_variance)
        )
        return of_shift, of_height


def fit_gaussian(samples: list[Float], start: PulseFit, width: float) -> tuple[PulseFit, Float]:
    """Fit a Gaussian of free height, position and width to the samples about each peak (Gauss–Newton least squares).

    (Wagner et al., *ISPRS J. Photogramm.* 60, 2006, on the Gaussian decomposition of waveforms.)

    Parameters
    ----------
    samples
        2K + 1 arrays of shape (m,).
    start
        First guess.
    width
        First guess of the standard deviation [sample].

    Returns
    -------
    tuple
        The fit, and the standard deviation of the Gaussian [sample], shape (m,).
    """
    half = len(samples) // 2

    def improve(
        number: UInt32, height: Float, position: Float, sigma: Float
    ) -> tuple[UInt32, Float, Float, Float]:
        sums: list[Float] = [auto.Float(0.0) for _ in range(9)]
        for tap, sample in enumerate(samples):
            away = (tap - half - position) / sigma
            bell = dr.exp(-0.5 * dr.square(away))
            basis = (bell, bell * away, bell * dr.square(away))
            left = sample - height * bell
            products = [basis[i] * basis[j] for i in range(3) for j in range(i, 3)]
            products += [part * left for part in basis]
            sums = [total + product for total, product in zip(sums, products, strict=True)]
        up, along, wider = _solve(sums)
        safe = dr.maximum(height, _NONZERO)
        return (
            number + 1,
            dr.maximum(height + up, 0.1 * height),
            position + dr.clip(along / safe, -0.5, 0.5) * sigma,
            sigma * (1.0 + dr.clip(wider / safe, -0.3, 0.3)),
        )

    initial = (
        auto.UInt32(0),
        start.amplitude,
        start.shift,
        beside(start.shift, width)[0] + 0.0 * start.shift,
    )
    _, height, position, sigma = dr.while_loop(
        initial, lambda number, *rest: number < _GAUSS_NEWTON_STEPS, improve
    )
    return PulseFit(position, height, start.phase), sigma


def _solve(sums: list[Float]) -> tuple[Float, Float, Float]:
    """Solve the symmetric 3 × 3 system of its six and three sums (Cramer's rule)."""
    a, b, c, d, e, f, x, y, z = sums
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    whole = a * first + b * second + c * third
    whole = dr.select(dr.abs(whole) < _NONZERO, _NONZERO, whole)
    middle, corner, last = a * f - c * c, b * c - a * e, a * d - b * b
    return (
        (first * x + second * y + third * z) / whole,
        (second * x + middle * y + corner * z) / whole,
        (third * x + corner * y + last * z) / whole,
    )


def fit_weights(half: int, width: float) -> Array:
    """Return the taps whose sums are height and, to first order and times it, shift of the Gaussian, (2, 2K + 1)."""
    away = np.arange(-half, half + 1) / width
    bell = np.exp(-0.5 * away**2)
    basis = np.stack([bell, bell * away / width, bell * away**2 / width], axis=1)
    return np.asarray(np.linalg.pinv(basis)[:2])
