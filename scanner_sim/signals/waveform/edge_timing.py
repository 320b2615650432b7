"""Timing by edges: the crossing of a fixed level, or of a fraction of the peak, with its variance."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property

import drjit as dr
import drjit.auto.ad as auto
import numpy as np

from scanner_sim.detector.photodiode.photodiode import Digitiser, Photodiode
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.detector.photodiode.waveform import Waveforms
from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_types import Float, Mask, UInt32
from scanner_sim.optics.pulse import Pulse
from scanner_sim.signals.waveform.calibration import HEIGHT, send_all_phases
from scanner_sim.signals.waveform.edge_noise import ShotCourse, Tap, delay_variance
from scanner_sim.signals.waveform.edges import Edges, EdgeTable, OfEdges, cross, edge_table
from scanner_sim.signals.waveform.filter import Noise, SampledPulse

_CLIPPED_LEVEL = 0.5
"""Level, over the saturation, at which the edges of clipped pulses are timed."""
_FRACTION_NODES = 64
_SUMMIT_NODES = 65
_PHASES = 256
_LEAST_SLOPE = 1e-6


@dataclass
class TimedEcho:
    """What timing finds of the echo of each record, Dr.Jit arrays of shape (m,).

    ``sample`` and ``shift`` from it [sample], with its ``variance`` [sample²]; ``height`` [A], with its
    ``height_variance`` [A²]; ``whole`` whether all went well.
    """

    sample: UInt32
    shift: Float
    variance: Float
    height: Float
    height_variance: Float
    whole: Mask

    def or_where(self, mask: Mask, other: TimedEcho) -> TimedEcho:
        """Return this, and the other one where the mask holds."""
        return TimedEcho(
            *(dr.select(mask, getattr(other, each.name), getattr(self, each.name)) for each in fields(self))
        )


def vertex(before: Float, top: Float, behind: Float) -> tuple[Float, Float]:
    """Return position [sample] and height of the Gaussian through three samples: a parabola of their logarithms."""
    least = dr.maximum(1e-3 * top, 1e-30)
    left, middle, right = (dr.log(dr.maximum(value, least)) for value in (before, top, behind))
    curvature = dr.maximum(2.0 * middle - left - right, 1e-6)
    position = dr.clip(0.5 * (right - left) / curvature, -1.0, 1.0)
    return position, dr.exp(middle + 0.25 * (right - left) * position)


def height_slopes(position: Float, height: Float, three: tuple[Float, Float, Float]) -> list[Float]:
    """Return the derivatives of the height of :func:`vertex` by its three samples, height · L_k(position)/x_k.

    Of the logarithms they are Lagrange's polynomials at the vertex, whose own shift changes nothing to first order.
    """
    weights = (
        0.5 * position * (position - 1.0),
        1.0 - dr.square(position),
        0.5 * position * (position + 1.0),
    )
    least = dr.maximum(1e-3 * three[1], 1e-30)
    return [height * weight / dr.maximum(value, least) for weight, value in zip(weights, three, strict=True)]


def height_taps(top: Float, position: Float, height: Float, three: tuple[Float, Float, Float]) -> list[Tap]:
    """Return the samples that the height of :func:`vertex` is read from, the middle one at ``top`` [sample]."""
    slopes = height_slopes(position, height, three)
    return [Tap(top + (step - 1.0), slope) for step, slope in enumerate(slopes)]


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
        """Return the walk at a level [digital number]; the last two computed are kept."""
        return edge_table(self.pulse, self.photodiode, self.digitiser, level)

    def at_level(
        self,
        waveforms: Waveforms,
        peak: UInt32,
        coloured: Float,
        active: Mask,
        level: float,
        *,
        corrected: bool,
    ) -> TimedEcho:
        """Time the crossing of a level.

        Parameters
        ----------
        waveforms, peak, active
            Records, samples of their peaks, and which are wanted.
        coloured
            Variance of the coloured noise without signal [A²], shape (m,).
        level
            The level [digital number].
        corrected
            Whether the walk is taken off.
        """
        edges = cross(waveforms, peak, dr.opaque(auto.Float, level, waveforms.shots), active)
        timed = self._crossed(edges, coloured, level, corrected=corrected)
        timed.height, timed.height_variance = self._height(waveforms, peak, coloured, active)
        return timed

    def height(
        self, waveforms: Waveforms, peak: UInt32, coloured: Float, active: Mask
    ) -> tuple[Float, Float]:
        """Return the height of pulses [A] and its variance [A²], those of clipped ones as of :meth:`clipped`.

        Arguments as of :meth:`at_level`.
        """
        found = self._height(waveforms, peak, coloured, active)
        if math.isinf(self.full):
            return found
        shot = dr.arange(auto.UInt32, waveforms.shots)
        top = dr.gather(auto.Float, waveforms.number, waveforms.address(peak, shot), active)
        full = active & (top >= dr.opaque(auto.Float, self.full - 0.5))
        long = self.clipped(waveforms, peak, coloured, full)
        return dr.select(full, long.height, found[0]), dr.select(full, long.height_variance, found[1])

    def _height(
        self, waveforms: Waveforms, peak: UInt32, coloured: Float, active: Mask
    ) -> tuple[Float, Float]:
        """Return height [A] and variance [A²] of pulses that are not clipped, by the three samples about the peak."""
        three = three_samples(waveforms, peak, active)
        position, number = self._summit(three)
        summit = height_taps(auto.Float(0.0), position, number, three)
        height = number * dr.opaque(auto.Float, self.step)
        pulse = position - dr.opaque(auto.Float, self._shape.summit), height
        return height, delay_variance(summit, self.noise, self.course, pulse, coloured)

    def clipped(self, waveforms: Waveforms, peak: UInt32, coloured: Float, active: Mask) -> TimedEcho:
        """Time the edges of clipped pulses at half the saturation, and tell their height by the time above it.

        Arguments as of :meth:`at_level`. Pulses whose edges are not in the record, or that are longer than any in the
        table, are at least as high as the saturation; σ is as large.
        """
        level = _CLIPPED_LEVEL * self.full
        edges = cross(waveforms, peak, dr.opaque(auto.Float, level, waveforms.shots), active)
        timed = self._crossed(edges, coloured, level, corrected=True)
        full = dr.opaque(auto.Float, self.photodiode.saturation)
        timed.height = dr.select(timed.whole, timed.height, full)
        timed.height_variance = dr.select(timed.whole, timed.height_variance, dr.square(full))
        return timed

    def _crossed(self, edges: Edges, coloured: Float, level: float, *, corrected: bool) -> TimedEcho:
        """Return what the crossings of a level tell: the time, and by how long pulses are above it their height."""
        walk, (current,) = self.table(level).correction(edges), beside(coloured, level * self.step)
        delay, height = walk.delay, current * dr.exp(walk.log_height.value)
        noise = self.noise, self.course, (edges.lead + delay.value, height), coloured
        relative = delay_variance(self._taps(edges, walk.log_height), *noise)
        relative += dr.square(walk.height_residual)
        if corrected:
            moved = OfEdges(delay.value, 1.0 + delay.by_lead, delay.by_tail)
            shift = edges.lead + delay.value
            variance = delay_variance(self._taps(edges, moved), *noise) + dr.square(walk.residual)
        else:
            shift, variance = edges.lead, delay_variance(self._rising(edges), *noise)
        whole = edges.whole & walk.known
        return TimedEcho(edges.sample, shift, variance, height, dr.square(height) * relative, whole)

    def _taps(self, edges: Edges, by: OfEdges) -> list[Tap]:
        """Return the samples that something is read from by both crossings."""
        return [tap.times(by.by_lead) for tap in self._rising(edges)] + [
            tap.times(by.by_tail) for tap in self._falling(edges)
        ]

    def fraction_of(self, waveforms: Waveforms, peak: UInt32, coloured: Float, active: Mask) -> TimedEcho:
        """Time the crossing of a fraction of the peak."""
        three = three_samples(waveforms, peak, active)
        position, height = self._summit(three)
        level = height * dr.opaque(auto.Float, self.fraction)
        edges = cross(waveforms, peak, level, active)
        at = dr.clip(edges.lead, 0.0, 1.0) * (_FRACTION_NODES - 1.001)
        first = auto.UInt32(at)
        left, right = (dr.gather(auto.Float, self._fraction_table, first + step) for step in (0, 1))
        shift = edges.lead + dr.fma(at - auto.Float(first), right - left, left)
        # The level moves the crossing as the two samples beside it do, and moves with the three about the peak.
        top = auto.Float(auto.Int32(peak) - auto.Int32(edges.sample))
        by_level = dr.opaque(auto.Float, self.fraction) / self._steepness(edges.rise)
        summit = height_taps(top, position, height, three)
        taps = self._rising(edges) + [tap.times(by_level) for tap in summit]
        stretch = 1.0 + (right - left) * (_FRACTION_NODES - 1)
        pulse = shift, height * dr.opaque(auto.Float, self.step)
        variance = delay_variance(
            [tap.times(stretch) for tap in taps], self.noise, self.course, pulse, coloured
        )
        of_height = delay_variance(summit, self.noise, self.course, pulse, coloured)
        return TimedEcho(edges.sample, shift, variance, pulse[1], of_height, edges.whole)

    @cached_property
    def _fraction_table(self) -> Float:
        """Delay of the pulse behind its crossing of the fraction [sample], over the position between samples."""
        waveforms, truth, top = send_all_phases(self.pulse, self.photodiode, self.digitiser, _PHASES)
        _, height = self._summit(three_samples(waveforms, top, top >= 0))
        edges = cross(waveforms, top, height * self.fraction, top >= 0)
        dr.eval(edges)
        lead = edges.lead.numpy().astype(np.float64)
        delay = truth - edges.sample.numpy() - lead
        order = np.argsort(lead)
        nodes = np.linspace(0.0, 1.0, _FRACTION_NODES)
        return auto.Float(np.interp(nodes, lead[order], delay[order], period=1.0).astype(np.float32))

    def _summit(self, three: tuple[Float, Float, Float]) -> tuple[Float, Float]:
        """Return position [sample] and height of the pulse by three samples about its top, whichever is the highest.

        Of a pulse that is no Gaussian :func:`vertex` tells other heights by the samples on one side than by those on
        the other, and noise decides which are taken.
        """
        position, height = vertex(*three)
        at = (position + 1.0) * (0.5 * _SUMMIT_NODES - 0.501)
        first = auto.UInt32(at)
        left, right = (dr.gather(auto.Float, self._summit_table, first + step) for step in (0, 1))
        return position, height / dr.fma(at - auto.Float(first), right - left, left)

    @cached_property
    def _summit_table(self) -> Float:
        """Height by :func:`vertex` over that of the pulse, for positions from −1 to 1 sample."""
        waveforms, _, top = send_all_phases(self.pulse, self.photodiode, self.digitiser, _PHASES)
        found = [
            vertex(*three_samples(waveforms, auto.UInt32(auto.Int32(top) + step), top >= 0))
            for step in (-1, 0, 1)
        ]
        position, height = (np.concatenate([each[part].numpy() for each in found]) for part in (0, 1))
        inside, order = np.abs(position) < 1.0, np.argsort(position)
        order = order[inside[order]]
        share = np.interp(np.linspace(-1.0, 1.0, _SUMMIT_NODES), position[order], height[order])
        return auto.Float((share / (HEIGHT * self.photodiode.saturation / self.step)).astype(np.float32))

    @cached_property
    def course(self) -> ShotCourse:
        """The shot noise of a pulse."""
        return ShotCourse.of(self._shape)

    @cached_property
    def _shape(self) -> SampledPulse:
        return SampledPulse(PulseResponse.of(self.pulse, self.digitiser.rate), self.noise.sigma)

    def _rising(self, edges: Edges) -> list[Tap]:
        """Return by how much the two samples about the rising crossing move it."""
        steep = -dr.rcp(self._steepness(edges.rise))
        return [
            Tap(auto.Float(0.0), steep * (1.0 - edges.lead)),
            Tap(auto.Float(1.0), self._unclipped(edges.high, steep * edges.lead)),
        ]

    def _falling(self, edges: Edges) -> list[Tap]:
        """Return by how much the two samples about the falling crossing move it."""
        steep = dr.rcp(self._steepness(edges.fall))
        before = dr.round(edges.width + edges.lead - edges.tail)
        return [
            Tap(before, self._unclipped(edges.above, steep * (1.0 - edges.tail))),
            Tap(before + 1.0, steep * edges.tail),
        ]

    def _steepness(self, slope: Float) -> Float:
        """Return the slope between two samples [A/sample]."""
        return dr.maximum(slope, _LEAST_SLOPE) * dr.opaque(auto.Float, self.step)

    def _unclipped(self, number: Float, weight: Float) -> Float:
        """Return the weight of a sample; what the amplifier clips has no noise."""
        return dr.select(number >= dr.opaque(auto.Float, self.full - 0.5), 0.0, weight)
