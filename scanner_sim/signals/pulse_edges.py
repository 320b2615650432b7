"""Edges of pulses: where a waveform crosses a level before and behind its peak, and what that tells of the delay.

The crossing of a fixed level walks with the amplitude, and a straight line between samples is not the pulse. Both
errors are functions of what is measured: the time above the level, and the place of the crossing between its samples.
They are tabulated by sending noise-free pulses of all amplitudes and phases through the same receiver and the same
crossing. The time above the level stays good where the amplifier saturates and the amplitude is lost (Amann et al.,
*Opt. Eng.* 40, 2001, on walk; Kilpelä, Pennala, Kostamovaara, *Rev. Sci. Instrum.* 72, 2001, on the pulse's length).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.photodiode import Digitiser, Photodiode
from scanner_sim.detector.waveform import Waveforms
from scanner_sim.optics.pulse import Pulse
from scanner_sim.signals.pulse_calibration import bench_of, peak_of, send

Array = NDArray[np.float64]

_LARGEST = 1e6
"""Largest amplitude over the level in the table."""
_AMPLITUDES, _PHASES = 192, 48
_WIDTHS, _FRACTIONS = 128, 32
_MAX_STEPS = 4096


@dataclass
class Edges:
    """Crossings of a level about a peak, Dr.Jit arrays.

    ``sample`` before the rising crossing and ``lead`` fraction behind it; ``width`` from there to the falling crossing
    [sample]; ``rise`` and ``fall`` slopes [per sample]; ``tail`` fraction of the falling crossing; ``whole`` whether
    both were found.
    """

    sample: Any
    lead: Any
    width: Any
    rise: Any
    fall: Any
    tail: Any
    whole: Any


def cross(waveforms: Waveforms, peak: Any, level: Any, active: Any) -> Edges:
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
    place = dr.arange(auto.UInt32, waveforms.shots)
    last = waveforms.samples - 1

    def at(sample: Any) -> Any:
        return dr.gather(auto.Float, waveforms.number, waveforms.address(sample, place), active)

    def walk(direction: int) -> tuple[Any, Any, Any]:
        end = 0 if direction < 0 else last

        def beyond(sample: Any, value: Any, _: Any, steps: Any) -> Any:
            return active & (value >= level) & (sample != end) & (steps < _MAX_STEPS)

        def step(sample: Any, value: Any, _: Any, steps: Any) -> Any:
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
    return Edges(before, lead, width, rise, fall, tail, whole)


@dataclass
class Correction:
    """Delay of the centroid behind the rising crossing, its derivatives, and what the table leaves [sample]."""

    delay: Any
    by_width: Any
    by_lead: Any
    residual: Any


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """Delay of a pulse's centroid behind its rising crossing [sample], over width and fraction.

    Attributes
    ----------
    level
        The level [digital number].
    widest
        Width [sample] of the last row.
    delay
        Shape (widths, fractions), fractions from 0 to 1.
    slope
        Derivative of the delay by the width, the same shape.
    residual
        What the table leaves, root mean square [sample], shape (widths,).
    device
        The three on the device, one behind the other.
    """

    level: float
    widest: float
    delay: Array
    slope: Array
    residual: Array
    device: Any

    def correction(self, edges: Edges) -> Correction:
        """Return the delay behind the rising crossing and how it changes."""
        row = dr.clip(edges.width * dr.opaque(auto.Float, (_WIDTHS - 1) / self.widest), 0.0, _WIDTHS - 1.001)
        column = dr.clip(edges.lead, 0.0, 1.0) * (_FRACTIONS - 1.001)
        first, left = auto.UInt32(row), auto.UInt32(column)
        down, across = row - auto.Float(first), column - auto.Float(left)

        def corners(number: int) -> list[Any]:
            start = number * _WIDTHS * _FRACTIONS + first * _FRACTIONS + left
            steps = (0, 1, _FRACTIONS, _FRACTIONS + 1)
            return [dr.gather(auto.Float, self.device, start + step) for step in steps]

        def between(corner: list[Any]) -> Any:
            upper = dr.fma(across, corner[1] - corner[0], corner[0])
            lower = dr.fma(across, corner[3] - corner[2], corner[2])
            return dr.fma(down, lower - upper, upper)

        delays = corners(0)
        by_lead = (delays[1] - delays[0]) * (_FRACTIONS - 1)
        return Correction(between(delays), between(corners(1)), by_lead, between(corners(2)))


def edge_table(pulse: Pulse, photodiode: Photodiode, digitiser: Digitiser, level: float) -> EdgeTable:
    """Compute the table for a level [digital number]."""
    ratios = np.geomspace(1.01, _LARGEST, _AMPLITUDES)
    width, lead, delay = _sent(pulse, photodiode, digitiser, level, ratios, _PHASES, 0.0)
    widest = float(width.max())
    # A crossing just before a sample and one just behind the sample before are the same: fractions wrap.
    columns = np.linspace(0.0, 1.0, _FRACTIONS)
    order = np.argsort(lead, axis=1)
    width, lead, delay = (np.take_along_axis(values, order, axis=1) for values in (width, lead, delay))
    rows = [
        [
            np.interp(columns, fractions, values, period=1.0)
            for fractions, values in zip(lead, table, strict=True)
        ]
        for table in (width, delay)
    ]
    # Louder pulses are wider: at each fraction the delay is a function of the width.
    widths, delays = (np.maximum.accumulate(rows[0], axis=0), np.array(rows[1]))
    nodes = np.linspace(0.0, widest, _WIDTHS)
    table = np.stack(
        [np.interp(nodes, widths[:, column], delays[:, column]) for column in range(_FRACTIONS)], axis=1
    )
    slope = np.gradient(table, widest / (_WIDTHS - 1), axis=0)
    residual = np.zeros(_WIDTHS)
    device = _on_device(table, slope, residual)
    first = EdgeTable(level, widest, table, slope, residual, device)
    test = _sent(pulse, photodiode, digitiser, level, np.geomspace(1.013, _LARGEST / 1.1, 301), 37, 0.5)
    left = _residual(first, *(values.ravel() for values in test))
    return EdgeTable(level, widest, table, slope, left, _on_device(table, slope, left))


def _on_device(table: Array, slope: Array, residual: Array) -> Any:
    spread = np.repeat(residual[:, None], _FRACTIONS, axis=1)
    return auto.Float(np.stack([table, slope, spread]).astype(np.float32).ravel())


def _residual(table: EdgeTable, width: Array, lead: Array, delay: Array) -> Array:
    """Return the root mean square error of a table on other pulses, by width."""
    edges = Edges(
        None,
        auto.Float(lead.astype(np.float32)),
        auto.Float(width.astype(np.float32)),
        None,
        None,
        None,
        None,
    )
    error = delay - table.correction(edges).delay.numpy()
    row = np.rint(np.clip(width / table.widest, 0.0, 1.0) * (_WIDTHS - 1)).astype(int)
    count = np.bincount(row, minlength=_WIDTHS)
    square = np.bincount(row, error**2, minlength=_WIDTHS)
    seen = np.flatnonzero(count)
    root = np.sqrt(square[seen] / count[seen])
    return np.asarray(np.interp(np.arange(_WIDTHS), seen, root))


def _sent(
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
    silent, clock, middle = bench_of(pulse, photodiode, digitiser)
    truth = middle + phase
    peak = peak_of(pulse, photodiode, digitiser) * pulse.pulse_energy * digitiser.rate
    share = amplitude * level * clock.step(silent.saturation) / (peak * silent.amperes_per_watt)
    waveforms = send(share, truth, pulse, silent, clock)
    records = waveforms.records()
    place = dr.arange(auto.UInt32, amplitude.size)
    top = auto.UInt32(records.argmax(axis=1).astype(np.uint32))
    edges = cross(waveforms, top, dr.full(auto.Float, level, amplitude.size), place >= 0)
    dr.eval(edges)
    width, lead = (values.numpy().astype(np.float64) for values in (edges.width, edges.lead))
    delay = truth - edges.sample.numpy() - lead
    # Amplitudes that stay below the level at some phase are left out.
    whole = edges.whole.numpy().reshape(phases, -1).all(axis=0)
    width, lead, delay = (values.reshape(phases, -1)[:, whole].T for values in (width, lead, delay))
    return width, lead, delay
