"""Edges of pulses: where a waveform crosses a level before and behind its peak, and the delay that follows.

The crossing of a fixed level walks with the amplitude, and a straight line between samples is not the pulse. Both
errors are functions of what is measured: the time above the level, and the position of the crossing between its
samples. They are tabulated by sending noise-free pulses of all amplitudes and phases through the same receiver and the
same crossing. The time above the level stays good where the amplifier saturates and the amplitude is lost (Amann et
al.,
*Opt. Eng.* 40, 2001, on walk; Kilpelä, Pennala, Kostamovaara, *Rev. Sci. Instrum.* 72, 2001, on the pulse's length).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.photodiode.photodiode import Digitiser, Photodiode
from scanner_sim.detector.photodiode.waveform import Waveforms
from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, Mask, UInt32
from scanner_sim.optics.pulse import Pulse
from scanner_sim.signals.waveform.calibration import noise_free_receiver, peak_of, send

Array = NDArray[np.float64]

_LARGEST = 1e6
"""Largest amplitude over the level in the table."""
_AMPLITUDES, _PHASES, _FRACTIONS = 800, 384, 384
_ROWS_PER_SAMPLE, _MOST_ROWS = 512, 8192
_MAX_STEPS = 4096


@dataclass
class Edges:
    """Crossings of a level about a peak, Dr.Jit arrays.

    ``sample`` before the rising crossing and ``lead`` fraction behind it; ``width`` from there to the falling crossing
    [sample]; ``rise`` and ``fall`` slopes [per sample]; ``tail`` fraction of the falling crossing; ``high`` and
    ``above`` the samples over the level beside the crossings; ``whole`` whether both were found.
    """

    sample: UInt32
    lead: Float
    width: Float
    rise: Float
    fall: Float
    tail: Float
    high: Float
    above: Float
    whole: Mask


def cross(waveforms: Waveforms, peak: UInt32, level: Float, active: Mask) -> Edges:
    """Walk from the peak of each record to where it crosses a level.

    Parameters
    ----------
    waveforms
        The records.
    peak
        Sample of the peak of each, shape (m,).
    level
        Level [digital number], shape (m,).
    active
        Records that are wanted.
    """
    shot = dr.arange(auto.UInt32, waveforms.shots)
    last = waveforms.samples - 1

    def at(sample: UInt32) -> Float:
        return dr.gather(auto.Float, waveforms.number, waveforms.address(sample, shot), active)

    def walk(direction: int) -> tuple[UInt32, Float, Float]:
        end = 0 if direction < 0 else last

        def beyond(sample: UInt32, value: Float, _: Float, steps: UInt32) -> Mask:
            return active & (value >= level) & (sample != end) & (steps < _MAX_STEPS)

        def step(
            sample: UInt32, value: Float, _: Float, steps: UInt32
        ) -> tuple[UInt32, Float, Float, UInt32]:
            moved = auto.UInt32(auto.Int32(sample) + direction)
            return moved, at(moved), value, steps + 1

        value = at(peak)
        sample, value, before, _ = dr.while_loop((peak, value, value, auto.UInt32(0)), beyond, step)
        return sample, value, before

    before, low, high = walk(-1)
    after, below, above = walk(1)
    rise, fall = high - low, above - below
    lead = (level - low) / dr.maximum(rise, 1e-20)
    tail = (above - level) / dr.maximum(fall, 1e-20)
    width = auto.Float(auto.Int32(after) - auto.Int32(before)) - 1.0 + tail - lead
    whole = active & (low < level) & (below < level) & (high >= level) & (above >= level)
    return Edges(before, lead, width, rise, fall, tail, high, above, whole)


@dataclass
class OfEdges:
    """What the crossings tell, and its derivatives by them [1/sample].

    ``by_lead`` is taken with the falling crossing held, ``by_tail`` with the rising one held.
    """

    value: Float
    by_lead: Float
    by_tail: Float


@dataclass
class Correction:
    """Delay of the centroid behind the rising crossing, and what the table leaves of it [sample].

    ``log_height`` is the logarithm of the pulse's height over the level, clipped or not, and ``height_residual`` what
    the table leaves of it; ``known`` whether the table reaches as high.
    """

    delay: OfEdges
    residual: Float
    log_height: OfEdges
    height_residual: Float
    known: Mask


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """Delay of a pulse's centroid behind its rising crossing [sample], and its height.

    The rows go by the falling crossing, counted from the sample before the rising one: where it passes from one
    sample to the next the delay has a bend, which so falls on a row. The columns go by the rising crossing's fraction.

    Attributes
    ----------
    level
        The level [digital number].
    density
        Rows per sample, a whole number.
    rows
        Their number.
    device
        One behind the other: delay, shape (rows, columns), fractions from 0 to 1; what the table leaves, root mean
        square [sample], shape (rows,); the same two of the logarithm of the height over the level.
    """

    level: float
    density: int
    rows: int
    device: Float

    def correction(self, edges: Edges) -> Correction:
        """Return the delay behind the rising crossing, the height, and how they change."""
        rows = self.rows
        row = dr.clip(
            (edges.width + edges.lead) * dr.opaque(auto.Float, self.density), 0.0, float(rows) - 1.001
        )
        column = dr.clip(edges.lead, 0.0, 1.0) * (_FRACTIONS - 1.001)
        first, left = auto.UInt32(row), auto.UInt32(column)
        down, across = row - auto.Float(first), column - auto.Float(left)
        start = first * _FRACTIONS + left

        def corners(table: UInt32) -> tuple[Float, ...]:
            return tuple(
                dr.gather(auto.Float, self.device, table + start + step)
                for step in (0, 1, _FRACTIONS, _FRACTIONS + 1)
            )

        def between(a: Float, b: Float, c: Float, d: Float) -> OfEdges:
            upper, lower = dr.fma(across, b - a, a), dr.fma(across, d - c, c)
            return OfEdges(
                value=dr.fma(down, lower - upper, upper),
                by_lead=dr.fma(down, (d - c) - (b - a), b - a) * (_FRACTIONS - 1),
                by_tail=(lower - upper) * dr.opaque(auto.Float, self.density),
            )

        def left_at(table: UInt32) -> Float:
            return dr.gather(auto.Float, self.device, table + first + rows * _FRACTIONS)

        of_height = auto.UInt32(rows * (_FRACTIONS + 1))
        log_height = between(*corners(of_height))
        return Correction(
            delay=between(*corners(auto.UInt32(0))),
            residual=left_at(auto.UInt32(0)),
            log_height=log_height,
            height_residual=left_at(of_height),
            known=log_height.value < math.log(0.98 * _LARGEST),
        )


def edge_table(pulse: Pulse, photodiode: Photodiode, digitiser: Digitiser, level: float) -> EdgeTable:
    """Return the table for a level [digital number]; receivers that differ in noise or gate alone share it."""
    silent, clock, _ = noise_free_receiver(pulse, photodiode, digitiser)
    return _computed(auto.Float, pulse.text, pulse, silent, clock, level)


@lru_cache(maxsize=2)
def _computed(
    kind: Any,  # noqa: ARG001 (arrays of another device are of no use)
    text: str,  # noqa: ARG001 (nor are those of another file)
    pulse: Pulse,
    photodiode: Photodiode,
    digitiser: Digitiser,
    level: float,
) -> EdgeTable:
    # Even steps of the width, for a Gaussian: it is 2σ√(2 ln(A/V)).
    ratios = np.exp(np.linspace(0.01, np.log(_LARGEST) ** 0.5, _AMPLITUDES) ** 2)
    width, lead, delay = _send_pulses(pulse, photodiode, digitiser, level, ratios, _PHASES, 0.0)
    columns = np.linspace(0.0, 1.0, _FRACTIONS)
    order = np.argsort(lead, axis=1)
    width, lead, delay = (np.take_along_axis(values, order, axis=1) for values in (width, lead, delay))
    # A crossing just before a sample and one just behind the sample before are the same: fractions wrap.
    widths, delays = (
        np.array(
            [
                np.interp(columns, fractions, values, period=1.0)
                for fractions, values in zip(lead, table, strict=True)
            ]
        )
        for table in (width, delay)
    )
    heights = np.log(ratios[ratios.size - len(width) :])
    widest = float(width.max()) + 1.0
    density = int(np.clip(_MOST_ROWS / widest, 2, _ROWS_PER_SAMPLE))
    rows = np.arange(int(widest * density) + 2) / density
    # Louder pulses are wider: at each fraction the delay is a function of the width.
    falls = np.maximum.accumulate(widths, axis=0) + columns
    table, height = (
        np.stack([np.interp(rows, falls[:, c], values[:, c]) for c in range(_FRACTIONS)], axis=1)
        for values in (delays, np.broadcast_to(heights[:, None], delays.shape))
    )
    nothing = np.zeros(rows.size)
    perfect = _make_table(level, density, (table, nothing), (height, nothing))
    tried = np.geomspace(1.013, _LARGEST / 1.1, 301)
    width, lead, delay = _send_pulses(pulse, photodiode, digitiser, level, tried, 37, 0.5)
    height_tried = np.broadcast_to(np.log(tried[tried.size - len(width) :])[:, None], delay.shape)
    left = _residuals(perfect, *(values.ravel() for values in (width, lead, delay, height_tried)))
    return _make_table(level, density, (table, left[0]), (height, left[1]))


def _make_table(
    level: float, density: int, delay: tuple[Array, Array], log_height: tuple[Array, Array]
) -> EdgeTable:
    every = np.concatenate([values.ravel() for values in (*delay, *log_height)]).astype(np.float32)
    return EdgeTable(level, density, delay[1].size, auto.Float(every))


def _residuals(
    table: EdgeTable, width: Array, lead: Array, delay: Array, log_height: Array
) -> tuple[Array, Array]:
    """Return the root mean square errors of a table on other pulses, by row: of the delay and of the height."""
    edges = Edges(
        sample=None,
        lead=auto.Float(for_device(lead)),
        width=auto.Float(for_device(width)),
        **dict.fromkeys(("rise", "fall", "tail", "high", "above", "whole")),
    )
    found = table.correction(edges)
    count = table.rows
    row = np.clip(((width + lead) * table.density).astype(int), 0, count - 1)
    # Over a quarter of a sample: one row alone is hit by few test pulses.
    near = np.ones(max(1, table.density // 4))
    hits = np.convolve(np.bincount(row, minlength=count), near, "same")
    seen = np.flatnonzero(hits > 0.5)

    def spread(error: Array) -> Array:
        square = np.convolve(np.bincount(row, error**2, minlength=count), near, "same")
        return np.asarray(np.interp(np.arange(count), seen, np.sqrt(square[seen] / hits[seen])))

    return spread(delay - found.delay.value.numpy()), spread(log_height - found.log_height.value.numpy())


def _send_pulses(
    pulse: Pulse,
    photodiode: Photodiode,
    digitiser: Digitiser,
    level: float,
    ratios: Array,
    phases: int,
    offset: float,
) -> tuple[Array, Array, Array]:
    """Return width, fraction and delay behind the crossing [sample] of noise-free pulses, (ratios, phases)."""
    amplitude, phase = (
        values.ravel() for values in np.meshgrid(ratios, (np.arange(phases) + offset) / phases)
    )
    silent, clock, middle = noise_free_receiver(pulse, photodiode, digitiser)
    truth = middle + phase
    peak = peak_of(pulse, photodiode, digitiser) * pulse.pulse_energy * digitiser.rate
    share = amplitude * level * clock.step(silent.saturation) / (peak * silent.amperes_per_watt)
    waveforms = send(share, truth, pulse, silent, clock)
    records = waveforms.records()
    shot = dr.arange(auto.UInt32, amplitude.size)
    top = auto.UInt32(for_device(records.argmax(axis=1), np.uint32))
    edges = cross(waveforms, top, dr.full(auto.Float, level, amplitude.size), shot >= 0)
    dr.eval(edges)
    width, lead = (values.numpy().astype(np.float64) for values in (edges.width, edges.lead))
    delay = truth - edges.sample.numpy() - lead
    # Amplitudes that stay below the level at some phase are left out.
    whole = edges.whole.numpy().reshape(phases, -1).all(axis=0)
    width, lead, delay = (values.reshape(phases, -1)[:, whole].T for values in (width, lead, delay))
    return width, lead, delay
