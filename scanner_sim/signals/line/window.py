"""The pixels of a dark line that can matter: beyond them no noise can change what is measured.

Where nothing but the laser shines, a pixel without its light holds noise, and that has an end: the normal numbers of a
generator of finite words do (:func:`~scanner_sim.detector.line.exposure.unlit_numbers`). Hence no pixel's charge leaves
[c_least, c_most], and of a peak on such pixels, with the mean of three less the brighter of two sides, each a mean of
three,

    contrast ≤ B = c_most − c_least,   level ≤ V = B/σ_floor.

The search leaves a peak out whose contrast is below d (i + o)², that of the faintest surface on pixel i, and notes one
that exceeds b (i + o)², that of the brightest. From i = √(B/min(d, b)) − o on noise makes neither. Before that it makes
none that matters where the peak that was found ranks above V, so that its contrast is above B and above all that noise
lets be left out, and where noise cannot be its rival: because a stronger one is known, or because none above the
threshold is, and one of contrast B would still be too low to count.

So a line is exposed about its light alone, or, where there is little or none, from pixel 0 to where noise makes no
peak. Where that does not settle what was found (:meth:`NoisePeak.settles`) it is exposed from pixel 0 to beyond both.
What is measured is that of the whole line to the last bit: only pixels that provably cannot matter are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.detector.line.exposure import Window
from scanner_sim.foundation.device_types import Float, Int32, Mask
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.signals.line.digital_line import SIDE, Line
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.limits import Limits, farthest_side, limits_of
from scanner_sim.signals.line.search import StrongestPeak
from scanner_sim.signals.line.validation import MOST_PIXELS
from scanner_sim.signals.processing import MARGIN, Processing

_ROUNDING = 1.001
"""More than the rounding of single precision makes of a contrast."""
_LEAST_LEVEL = 0.05
"""Added to the level: what rounding makes of levels with the bonus of a range gate."""
_MOST_READ = MOST_PIXELS + SIDE + max(MARGIN.values()) + 2
"""Pixels to each side of where a peak is found that are read of it at most: the spot and its baseline, with the margin
by which the fit keeps away from the array's end, and the steps from there to the brightest pixel."""
_STRONG = 10.0
"""Charge of a spot, over the highest contrast of noise, from which its peak is likely to settle the line. It decides on
the way alone."""


@dataclass(frozen=True)
class NoisePeak:
    """The highest peak that noise can make of pixels without light: contrast B [electron] and level V."""

    contrast: float
    level: float

    @classmethod
    def of(cls, numbers: tuple[float, float], calibration: SensorCalibration) -> NoisePeak:
        """Return that of pixels whose digital numbers do not leave a range."""
        contrast = _ROUNDING * (numbers[1] - numbers[0]) * calibration.gain
        return cls(contrast, _ROUNDING * contrast / max(calibration.floor_sigma, 1e-6) + _LEAST_LEVEL)

    def end(self, limits: Limits, pixels: int) -> Float:
        """Return the first pixel on and beyond which noise makes no peak, at most ``pixels``."""
        contrast = dr.opaque(auto.Float, self.contrast)
        brightest = dr.select(limits.charge[0] < contrast, limits.charge[1], dr.inf)
        faintest = dr.maximum(dr.minimum(limits.dimmest, brightest), 1e-12)
        end = dr.sqrt(contrast / faintest) - limits.origin + 1.0
        return dr.clip(dr.ceil(end), 0.0, float(pixels))

    def windows(
        self,
        light: tuple[Float, Float, Float],
        spot: ExpectedSpot,
        processing: Processing,
        calibration: SensorCalibration,
        theta: Float,
    ) -> tuple[Window, Window]:
        """Return the pixels of lines that are likely to settle their peaks, and those that do in any case.

        Parameters
        ----------
        light
            The pixels between which the light of each shot lies, of which there is none where they descend, and its
            charge [electron], shape (m,).
        spot, processing, calibration
            By which its peak will be searched for.
        theta
            Deflections Θ [rad], shape (m,).
        """
        floor_sigma = dr.opaque(auto.Float, calibration.floor_sigma)
        limits, away = limits_of(spot, processing, floor_sigma, dr.cos(auto.Float(theta)))
        low, high, charge = light
        lit, half, last = low < high, farthest_side(away), spot.pixels - 1.0
        strong = lit & (charge > dr.opaque(auto.Float, _STRONG * self.contrast))
        end, after = self.end(limits, spot.pixels), dr.select(lit, dr.ceil(high) + 1.0, 0.0)
        first = dr.select(strong, dr.clip(dr.floor(low) - (half + 1), 0.0, last), 0.0)
        reach = dr.select(strong, after + half, dr.maximum(dr.maximum(after, end) + half, _MOST_READ))
        # Light that lies wholly before the first pixel leaves a negative reach.
        likely = Window(auto.UInt32(first) // 2 * 2, auto.UInt32(dr.clip(reach, 0.0, last)))
        enough = dr.maximum(after, end) + max(half, _MOST_READ)
        every = Window(dr.zeros(auto.UInt32, dr.width(low)), auto.UInt32(dr.minimum(enough, last)))
        dr.eval(likely, every)
        return likely, every

    def settles(
        self,
        line: Line,
        found: StrongestPeak,
        limits: Limits,
        away: int,
        read: tuple[Int32, Int32],
        rivals: tuple[Float, Float],
        doubted: Mask,
    ) -> Mask:
        """Return whether the pixels beyond the window of a line cannot change what is made of the peak found in it.

        Parameters
        ----------
        line, found, limits, away
            The lines, the peaks found in their windows, and how they were searched for.
        read
            First and last pixel that are read about each peak; they may lie beyond the array.
        rivals
            Level above which a rival counts, and its least share of the peak's contrast.
        doubted
            Where any rival above that level counts.
        """
        first, last = auto.Int32(line.window.first), auto.Int32(line.window.last)
        to_end = last == line.pixels - 1
        inside = ((first == 0) | (read[0] >= first)) & (to_end | (read[1] <= last))
        end = auto.Int32(self.end(limits, line.pixels)) + farthest_side(away)
        searched = (first == 0) & (to_end | (last >= end))
        contrast, level = dr.opaque(auto.Float, self.contrast), dr.opaque(auto.Float, self.level)
        harmless = ~doubted & (found.rival_level <= rivals[0]) & (rivals[1] * found.height >= contrast)
        stands = (found.rank > level) & (harmless | (found.rival_level > level))
        return inside & (searched | stands)
