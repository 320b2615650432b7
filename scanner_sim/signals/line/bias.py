"""The systematic error of the estimators: computed from the estimators themselves, and taken away on the device.

An estimator that is exact for no spot that pixels have integrated errs by an amount that depends on where in the pixel
the spot lies. The estimators run over noise-free lines of the expected spot, at many positions and widths; the table of
estimate − truth is turned round to one by the estimate (:mod:`~scanner_sim.signals.line.bias_table`). A position is
then corrected by

    p = p̂ − b(p̂ − i, s),   σ_p = σ_p̂ (1 − ∂b/∂p̂),

with i the brightest pixel and s the width that the spot has at its position on a surface that faces the scanner. On
tilted surfaces the width differs: what is left there is ∂b/∂s times the difference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import drjit as dr
import drjit.auto.ad as auto
import numpy as np

from scanner_sim.foundation.device_types import Float, Int32, Mask
from scanner_sim.signals.line.bias_table import BiasTable, invert
from scanner_sim.signals.line.digital_line import Baseline, no_baseline
from scanner_sim.signals.line.estimators import PeakEstimate, estimate
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.likelihood import Width
from scanner_sim.signals.processing import PeakMethod

_WIDTHS, _SHIFTS = 33, 97
"""Nodes of the table on the device: linear between them, it is good to 2e-4 pixel from a width of 0.5 pixel."""
_LARGEST_SHIFT = 1.0
"""Largest shift in the table [pixel]: noise makes a pixel the brightest that the spot is not centred on."""
_POSITIONS = 241
"""Positions of the spot that the estimators are run at, over ± the same."""
_WIDEST_FACTOR = 1.2
"""How much wider than on the axis a spot is at the largest deflection, 1/cosΘ, and a little more."""


class Bias:
    """A table on the device.

    Parameters
    ----------
    table
        The table.

    Attributes
    ----------
    values
        What it holds, a Dr.Jit array.
    """

    def __init__(self, table: BiasTable) -> None:
        self.estimator = table.estimator
        self._first, last = float(table.widths[0]), float(table.widths[-1])
        self._step = max(last - self._first, 1e-6) / (_WIDTHS - 1)
        widths = self._first + self._step * np.arange(_WIDTHS, dtype=np.float64)
        values = table.at(widths, np.linspace(-_LARGEST_SHIFT, _LARGEST_SHIFT, _SHIFTS, dtype=np.float64))
        self.values = auto.Float(values.astype(np.float32).ravel())

    def __call__(self, shift: Float, sigma: Float) -> tuple[Float, Float]:
        """Return the systematic error [pixel] and its derivative by the estimate.

        Parameters
        ----------
        shift
            Estimates, from the centre of the brightest pixel [pixel], Dr.Jit, shape (m,).
        sigma
            Standard deviation of the spot [pixel], shape (m,).
        """
        pitch = 2.0 * _LARGEST_SHIFT / (_SHIFTS - 1)
        across = dr.clip((shift + _LARGEST_SHIFT) / pitch, 0.0, _SHIFTS - 1.0)
        down = dr.clip(
            (sigma - dr.opaque(auto.Float, self._first)) / dr.opaque(auto.Float, self._step),
            0.0,
            _WIDTHS - 1.0,
        )
        column, row = dr.minimum(auto.UInt32(across), _SHIFTS - 2), dr.minimum(auto.UInt32(down), _WIDTHS - 2)
        right, low = across - auto.Float(column), down - auto.Float(row)
        index = row * _SHIFTS + column
        left_top, right_top, left_low, right_low = (
            dr.gather(auto.Float, self.values, index + step) for step in (0, 1, _SHIFTS, _SHIFTS + 1)
        )
        left, end = dr.lerp(left_top, left_low, low), dr.lerp(right_top, right_low, low)
        away: Float = dr.abs(shift)
        inside = away < _LARGEST_SHIFT
        return dr.lerp(left, end, right), dr.select(inside, (end - left) / pitch, 0.0)


@dataclass
class SpotTemplate:
    """Noise-free lines of spots about a pixel, instead of a sensor's.

    ``position`` from that pixel's centre and ``sigma``, the standard deviation without the pixel's width [pixel], of
    shape (m,); ``charge`` of a spot [electron].
    """

    position: Float
    sigma: Float
    baseline: Baseline
    floor_sigma: float = 0.0
    charge: float = 1e6

    @property
    def line(self) -> SpotTemplate:
        """Itself: it knows the variances too."""
        return self

    def variance(self, pixel: Int32, charge: Float) -> Float:  # noqa: ARG002 (a line's name for it)
        """Return the variance of a pixel [electron²]: all are alike."""
        return auto.Float(1.0)

    def pixel(self, step: Int32) -> Int32:
        """Return the pixel at a step."""
        return auto.Int32(step)

    def inside(self, step: Int32) -> Mask:  # noqa: ARG002 (as above)
        """Return that every pixel lies on the array."""
        return auto.Bool(True)

    def __call__(self, step: Int32) -> tuple[Float, Float]:
        """Return the charge at a step [electron] and its variance."""
        scale = math.sqrt(0.5) / self.sigma
        ends = [dr.erf((step + side - self.position) * scale) for side in (-0.5, 0.5)]
        return 0.5 * self.charge * (ends[1] - ends[0]), auto.Float(1.0)


@lru_cache(maxsize=16)
def computed_bias(method: PeakMethod, narrowest: float, widest: float) -> BiasTable:
    """Return the table of an estimator for Gaussian spots between two widths [pixel].

    Needs an active device: the estimator runs on it.
    """
    widths = np.linspace(narrowest, widest, _WIDTHS)
    truth = np.linspace(-_LARGEST_SHIFT, _LARGEST_SHIFT, _POSITIONS)
    shifts = np.linspace(-_LARGEST_SHIFT, _LARGEST_SHIFT, _SHIFTS)
    position = auto.Float(np.tile(truth, _WIDTHS).astype(np.float32))
    sigma = auto.Float(np.repeat(widths, _POSITIONS).astype(np.float32))
    result: PeakEstimate = estimate(
        method, SpotTemplate(position, sigma, no_baseline()), Width.certain(sigma, widest)
    )
    found = result.shift.numpy().astype(np.float64).reshape(_WIDTHS, _POSITIONS)
    return BiasTable(method, widths, shifts, np.stack([invert(row, truth, shifts) for row in found]))


def widths_of(spot: ExpectedSpot) -> tuple[float, float]:
    """Return the least and the largest standard deviation of a spot on facing surfaces [pixel], at any deflection."""
    beam, spread = spot.variances(np.arange(spot.pixels, dtype=np.float64), 0.0, 1.0)
    whole = beam + spread
    return math.sqrt(float(whole.min())), _WIDEST_FACTOR * math.sqrt(float(whole.max()))
