"""Searching waveforms for echoes: a filter along each record, and the peaks of what it gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.photodiode.waveform import BLOCK, Waveforms, quad_lanes
from scanner_sim.foundation.device_types import Float, Mask, UInt32

_VALLEY = 0.1
"""Share of a peak by which the line must fall behind it before another may rise."""


@dataclass
class FoundEcho:
    """One echo of each record, Dr.Jit arrays of shape (m,).

    ``sample`` of its peak, ``height`` of the line there, ``count`` of echoes in the record: 0 where there is none.
    """

    sample: UInt32
    height: Float
    count: UInt32


def filter_records(waveforms: Waveforms, taps: NDArray[np.float64]) -> Float:
    """Return Σ_j taps_j x_(k + j − K) of every record, in the order of :meth:`Waveforms.address`.

    Parameters
    ----------
    waveforms
        The records x.
    taps
        2K + 1 weights; samples outside of the record count as 0.
    """
    half = taps.size // 2
    reach = -(-half // 4)
    lane, quad, _ = quad_lanes(waveforms.shots, waveforms.samples)
    quads = waveforms.samples // 4
    under = []
    for step in range(-reach, reach + 1):
        near = auto.Int32(quad) + step
        inside = (near >= 0) & (near < quads)
        at = dr.select(inside, auto.UInt32(auto.Int32(lane) + step * BLOCK), 0)
        under += list(dr.gather(auto.Array4f, waveforms.number, at, inside))
    weights = [dr.opaque(auto.Float, float(tap)) for tap in taps]
    sums = []
    for side in range(4):
        total = auto.Float(0.0)
        for tap, weight in enumerate(weights):
            total = dr.fma(weight, under[4 * reach - half + side + tap], total)
        sums.append(total)
    line = dr.empty(auto.Float, 4 * dr.width(lane))
    dr.scatter(line, auto.Array4f(*sums), lane)
    dr.eval(line)
    return line


def find_echoes(
    waveforms: Waveforms,
    line: Float,
    threshold: Float,
    ends: int,
    wanted: Literal["first", "last", "strongest"],
) -> FoundEcho:
    """Find the echoes in each record and return the one that is wanted.

    A peak is an echo if it exceeds the threshold and the line falls behind it, and has risen before it, by the
    threshold or a tenth of the peak, whichever is more: so noise on a strong pulse makes no further echoes.

    Parameters
    ----------
    waveforms
        The records.
    line
        What is searched, in their order.
    threshold
        Height that an echo must exceed, shape (m,).
    ends
        Samples at either end of the record that are left out.
    wanted
        Which echo is returned.
    """
    quads = waveforms.samples // 4
    shot = dr.arange(auto.UInt32, waveforms.shots)
    base = shot // BLOCK * quads * BLOCK + shot % BLOCK
    first, last = ends, waveforms.samples - ends
    choose: Callable[[UInt32, Float, Float], Mask] = {
        "first": lambda count, high, best: count == 0,
        "last": lambda count, high, best: auto.Bool(True),
        "strongest": lambda count, high, best: high > best,
    }[wanted]

    def step(
        quad: UInt32, rising: Mask, extreme: Float, at: UInt32, count: UInt32, sample: UInt32, height: Float
    ) -> tuple[UInt32, Mask, Float, UInt32, UInt32, UInt32, Float]:
        four = dr.gather(auto.Array4f, line, base + quad * BLOCK)
        for side in range(4):
            k = 4 * quad + side
            value = dr.select((k >= first) & (k < last), four[side], 0.0)
            up = rising & (value > extreme)
            down = ~rising & (value < extreme)
            fall = dr.maximum(threshold, _VALLEY * dr.abs(extreme))
            closed = rising & (value <= extreme - fall)
            opened = ~rising & (value > extreme + fall)
            echo = closed & (extreme > threshold)
            take = echo & choose(count, extreme, height)
            sample, height = dr.select(take, at, sample), dr.select(take, extreme, height)
            count = count + dr.select(echo, auto.UInt32(1), 0)
            rising = (rising & ~closed) | opened
            moved = up | down | closed | opened
            extreme = dr.select(moved, value, extreme)
            at = dr.select(moved, k, at)
        return quad + 1, rising, extreme, at, count, sample, height

    m = waveforms.shots
    start = (
        auto.UInt32(0),
        dr.full(auto.Bool, True, m),
        dr.full(auto.Float, -1e30, m),
        dr.zeros(auto.UInt32, m),
        dr.zeros(auto.UInt32, m),
        dr.zeros(auto.UInt32, m),
        dr.zeros(auto.Float, m),
    )
    _, rising, extreme, at, count, sample, height = dr.while_loop(
        start, lambda quad, *rest: quad < quads, step
    )
    # What still stands high at the end of the record is an echo that the end cuts off.
    open_end = rising & (extreme > threshold)
    take = open_end & choose(count, extreme, height)
    found = FoundEcho(
        dr.select(take, at, sample),
        dr.select(take, extreme, height),
        count + dr.select(open_end, auto.UInt32(1), 0),
    )
    dr.eval(found)
    return found
