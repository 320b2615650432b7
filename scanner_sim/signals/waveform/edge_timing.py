"""Timing by edges: the crossing of a fixed level, or of a fraction of the peak, with its variance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import drjit as dr
import drjit.auto.ad as auto
import numpy as np

from scanner_sim.detector.photodiode.noise_colour import correlation
from scanner_sim.detector.photodiode.photodiode import Digitiser, Photodiode
from scanner_sim.detector.photodiode.waveform import Waveforms
from scanner_sim.foundation.device_numbers import beside, over
from scanner_sim.foundation.device_types import Float, Mask, UInt32
from scanner_sim.optics.pulse import Pulse
from scanner_sim.signals.waveform.calibration import send_all_phases
from scanner_sim.signals.waveform.edges import Edges, EdgeTable, cross, edge_table
from scanner_sim.signals.waveform.filter import Noise

_FRACTION_NODES = 64
_PHASES = 256
_LEAST_SLOPE = 1e-6


def vertex(before: Float, top: Float, behind: Float) -> tuple[Float, Float]:
    """Return position [sample] and height of the Gaussian through three samples: a parabola of their logarithms."""
    least = dr.maximum(1e-3 * top, 1e-30)
    left, middle, right = (dr.log(dr.maximum(value, least)) for value in (before, top, behind))
    curvature = dr.maximum(2.0 * middle - left - right, 1e-6)
    position = dr.clip(0.5 * (right - left) / curvature, -1.0, 1.0)
    return position, dr.exp(middle + 0.25 * (right - left) * position)


def three_samples(waveforms: Waveforms, peak: UInt32, active: Mask) -> tuple[Float, Float, Float]:
    """Return the samples before, at and behind the peak of each record, shape (m,)."""
    shot = dr.arange(auto.UInt32, waveforms.shots)
    before, top, behind = (
        dr.gather(auto.Float, waveforms.number, waveforms.address(peak + step - 1, shot), active)
        for step in range(3)
    )
    return before, top, behind


@dataclass(frozen=True, eq=False)
class EdgeTiming:
    """Timing by edges for one instrument.

    Attributes
    ----------
    pulse, photodiode, digitiser
        The instrument.
    noise
        Its noise [A²].
    fraction
        Fraction of the peak for :meth:`fraction_of`.
    """

    pulse: Pulse
    photodiode: Photodiode
    digitiser: Digitiser
    noise: Noise
    fraction: float

    @cached_property
    def step(self) -> float:
        """Current of a digital number [A]."""
        return self.digitiser.step(self.photodiode.saturation)

    @cached_property
    def full(self) -> float:
        """Digital number at which the amplifier saturates; infinite where it does not."""
        return self.photodiode.saturation / self.step if self.photodiode.noise.saturation else math.inf

    def table(self, level: float) -> EdgeTable:
        """Return the walk at a level [digital number]; it takes a second to compute."""
        return edge_table(self.pulse, self.photodiode, self.digitiser, level)

    def leading(
        self, edges: Edges, table: EdgeTable | None, coloured: Float, level: float
    ) -> tuple[Float, Float]:
        """Return the pulse's shift from the rising crossing's sample [sample] and its variance [sample²].

        Parameters
        ----------
        edges
            Crossings of the level.
        table
            The walk, or None to leave it in.
        coloured
            Variance of the coloured noise without signal [A²], shape (m,).
        level
            The level [digital number].
        """
        lead = self._crossing(edges.lead, edges.rise, coloured, level, edges.high)
        if table is None:
            return edges.lead, lead
        tail = self._crossing(1.0 - edges.tail, edges.fall, coloured, level, edges.above)
        walk = table.correction(edges)
        variance = lead * dr.square(1.0 + walk.by_lead) + tail * dr.square(walk.by_tail)
        return edges.lead + walk.delay, variance + dr.square(walk.residual)

    def fraction_of(
        self, waveforms: Waveforms, peak: UInt32, coloured: Float, active: Mask
    ) -> tuple[UInt32, Float, Float, Float, Mask]:
        """Time the crossing of a fraction of the peak.

        Returns
        -------
        tuple
            Sample, shift [sample] and its variance [sample²], height [digital number], and whether all went well.
        """
        position, height = vertex(*three_samples(waveforms, peak, active))
        level = height * dr.opaque(auto.Float, self.fraction)
        edges = cross(waveforms, peak, level, active)
        at = dr.clip(edges.lead, 0.0, 1.0) * (_FRACTION_NODES - 1.001)
        first = auto.UInt32(at)
        left, right = (dr.gather(auto.Float, self._fraction_table, first + step) for step in (0, 1))
        shift = edges.lead + dr.fma(at - auto.Float(first), right - left, left)
        # Noise of the crossing and of the height; near to one another they move together and partly cancel.
        per_number, white = beside(height, self.noise.per_current * self.step, self.noise.white)
        share, squared, double = beside(height, self.fraction, self.fraction**2, 2.0 * self.fraction)
        shot = per_number * height
        crossing = self._variance(edges.lead, coloured, level, edges.high)
        top = coloured + shot + white
        apart = auto.Float(auto.Int32(peak) - auto.Int32(edges.sample)) + position - edges.lead
        alike = dr.exp(-0.25 * dr.square(over(apart, max(self.noise.sigma, 1e-9))))
        together = alike * dr.sqrt((coloured + shot) * (coloured + shot * share))
        variance = crossing + squared * top - double * together
        variance = variance / dr.square(
            dr.maximum(edges.rise, _LEAST_SLOPE) * dr.opaque(auto.Float, self.step)
        )
        stretch = 1.0 + (right - left) * (_FRACTION_NODES - 1)
        return edges.sample, shift, dr.maximum(variance, 0.0) * dr.square(stretch), height, edges.whole

    @cached_property
    def _fraction_table(self) -> Float:
        """Delay of the pulse behind its crossing of the fraction [sample], over the position between samples."""
        waveforms, truth, top = send_all_phases(self.pulse, self.photodiode, self.digitiser, _PHASES)
        _, height = vertex(*three_samples(waveforms, top, top >= 0))
        edges = cross(waveforms, top, height * self.fraction, top >= 0)
        dr.eval(edges)
        lead = edges.lead.numpy().astype(np.float64)
        delay = truth - edges.sample.numpy() - lead
        order = np.argsort(lead)
        nodes = np.linspace(0.0, 1.0, _FRACTION_NODES)
        return auto.Float(np.interp(nodes, lead[order], delay[order], period=1.0).astype(np.float32))

    def _variance(self, share: Float, coloured: Float, level: Float, upper: Float) -> Float:
        """Return the variance [A²] of the line between two samples, to which the upper one contributes a share.

        What the amplifier clips has no noise.
        """
        per_number = self.noise.per_current * self.step
        if isinstance(level, float):
            (added,) = beside(coloured, per_number * level)
        else:
            added = beside(coloured, per_number)[0] * level
        shot = coloured + added
        together, white = beside(
            coloured, 2.0 * float(correlation(np.ones(1), self.noise.sigma)[0]), self.noise.white
        )
        rest = 1.0 - share
        share = dr.select(upper >= dr.opaque(auto.Float, self.full - 0.5), 0.0, share)
        both = dr.square(share) + dr.square(rest)
        return shot * (both + together * share * rest) + white * both

    def _crossing(self, share: Float, slope: Float, coloured: Float, level: Float, upper: Float) -> Float:
        """Return the variance [sample²] of a level's crossing between two samples."""
        slope = dr.maximum(slope, _LEAST_SLOPE) * dr.opaque(auto.Float, self.step)
        return self._variance(share, coloured, level, upper) / dr.square(slope)
