"""The pulse as the receiver sees it: its shape widened by the surface and by the electronics, at any time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.optics.pulse import Pulse

Array = NDArray[np.float64]

_REACH = 7.0
"""Standard deviations at which a Gaussian ends."""
_ROWS, _GROWTH = 128, 1.05
"""Rows of the table and the ratio of their variances; the last is 22 times as wide as the first."""
_NODES = 2048
_GRID = 1 << 16


@dataclass(frozen=True, eq=False)
class PulseResponse:
    """A pulse of area 1 convolved with a Gaussian, as a function of time and of the Gaussian's variance.

    Times are in samples, counted from the pulse's centroid. A Gaussian pulse stays one, in closed form. Any other is
    tabulated over time and variance; between rows it is linear in the variance (the heat equation makes the slope the
    curvature), which departs by less than 1e-3 of the peak.

    Attributes
    ----------
    variance
        Variance of the pulse itself [sample²].
    ends
        Where a pulse that is no Gaussian begins and ends [sample].
    times, powers
        Samples of a pulse that is no Gaussian, or None.
    """

    variance: float
    ends: tuple[float, float] = (0.0, 0.0)
    times: Array | None = None
    powers: Array | None = None

    @staticmethod
    def of(pulse: Pulse, rate: float) -> PulseResponse:
        """Return the response to a pulse for ``rate`` samples per second."""
        return _response(pulse, pulse.text, rate)

    @property
    def gaussian(self) -> bool:
        """Whether the pulse is a Gaussian."""
        return self.times is None

    def span(self, variance: float) -> tuple[float, float]:
        """Return the times [sample] outside of which nothing arrives, for a Gaussian of a variance [sample²]."""
        if self.gaussian:
            reach = _REACH * math.sqrt(self.variance + variance)
            return -reach, reach
        reach = _REACH * math.sqrt(variance)
        return self.ends[0] - reach, self.ends[1] + reach

    def values(self, time: Array, variance: float) -> Array:
        """Return the response at times [sample] of any shape, for one variance [sample²]; in double precision."""
        if self.gaussian:
            whole = self.variance + variance
            return np.asarray(np.exp(-0.5 * np.square(time) / whole) / math.sqrt(2.0 * math.pi * whole))
        grid, row = _row(self, variance)
        return np.asarray(np.interp(time, grid, row, left=0.0, right=0.0))

    def smoothed(self, variances: Array) -> tuple[Array, Array]:
        """Return a fine grid [sample] and the pulse on it, smoothed by Gaussians of some variances."""
        assert self.times is not None
        low, high = self.span(float(variances.max()))
        # Twice the span: what leaves one end of the periodic grid does not come back at the other.
        grid = np.linspace(low - 0.5 * (high - low), high + 0.5 * (high - low), _GRID, endpoint=False)
        sampled = np.interp(grid, self.times, self.powers, left=0.0, right=0.0)  # type: ignore[arg-type]
        step = grid[1] - grid[0]
        sampled /= sampled.sum() * step
        # Sampling a coarse polygon moves its centroid a little; a shift puts it back to 0.
        grid = grid - np.sum(grid * sampled) * step
        frequency = 2.0 * np.pi * np.fft.rfftfreq(_GRID, step)
        smooth = np.exp(-0.5 * np.multiply.outer(variances, frequency**2))
        return grid, np.fft.irfft(np.fft.rfft(sampled) * smooth, _GRID)

    def on_device(self, least: float) -> DeviceResponse:
        """Return the response for kernels, for Gaussians of at least some variance [sample²]."""
        if self.gaussian:
            return DeviceResponse(dr.opaque(auto.Float, self.variance))
        values, low, high = _table(self, least)
        return DeviceResponse(
            dr.opaque(auto.Float, self.variance + least),
            Table(
                auto.Float(values),
                dr.opaque(auto.Float, least),
                dr.opaque(auto.Float, low),
                dr.opaque(auto.Float, (_NODES - 1) / (high - low)),
            ),
        )


@lru_cache(maxsize=8)
def _response(pulse: Pulse, text: str, rate: float) -> PulseResponse:  # noqa: ARG001 (the file may be another one)
    variance = (pulse.sigma * rate) ** 2
    if pulse.shape == "gaussian":
        return PulseResponse(variance)
    times, powers = pulse.samples()
    scaled = times * rate
    return PulseResponse(variance, (float(scaled[0]), float(scaled[-1])), scaled, powers / rate)


@lru_cache(maxsize=8)
def _row(response: PulseResponse, variance: float) -> tuple[Array, Array]:
    grid, (row,) = response.smoothed(np.array([variance]))
    return grid, row


@lru_cache(maxsize=8)
def _table(response: PulseResponse, least: float) -> tuple[NDArray[np.float32], float, float]:
    """Return the rows of a response, one behind the other, and the first and the last node in widths.

    It takes a second and serves every batch of a run, hence the memory.
    """
    whole = response.variance + least
    extra: Array = whole * (_GROWTH ** np.arange(_ROWS, dtype=np.float64) - 1.0)
    width = np.sqrt(whole + extra)
    spans = np.array([response.span(least + more) for more in extra]) / width[:, None]
    low, high = float(spans[:, 0].min()), float(spans[:, 1].max())
    node = np.linspace(low, high, _NODES)
    # Narrow rows want a finer grid than the widest needs: four groups of rows have one each.
    rows = []
    for group in np.split(np.arange(_ROWS), 4):
        grid, smooth = response.smoothed(least + extra[group])
        rows += [
            np.interp(node * width[row], grid, values) * width[row]
            for row, values in zip(group, smooth, strict=True)
        ]
    table = np.array(rows)
    table[:, [0, -1]] = 0.0
    return table.astype(np.float32).ravel(), low, high


@dataclass(frozen=True, eq=False)
class Table:
    """Rows of responses over scaled time: values, the least variance, the first node and the nodes per width."""

    values: Float
    least: Float
    first: Float
    density: Float


@dataclass(frozen=True, eq=False)
class DeviceResponse:
    """A response for kernels: variance of the pulse (for a table, with the least variance) and the table."""

    whole: Float
    table: Table | None = None

    def values(self, time: Float, variance: Float) -> Float:
        """Return the response at times [sample] for Gaussians of some variances [sample²]; Dr.Jit arrays."""
        if self.table is None:
            inverse = dr.rcp(self.whole + variance)
            return dr.exp(-0.5 * dr.square(time) * inverse) * dr.sqrt(inverse * (0.5 / math.pi))
        grown = dr.maximum((variance - self.table.least) / self.whole, 0.0)
        row = dr.clip(dr.log(1.0 + grown) / math.log(_GROWTH), 0.0, _ROWS - 1.001)
        first = dr.floor(row)
        below = dr.exp(first * math.log(_GROWTH))
        share = dr.clip((1.0 + grown - below) / (below * (_GROWTH - 1.0)), 0.0, 1.0)
        low = self._row(first, dr.sqrt(self.whole * below), time)
        high = self._row(first + 1.0, dr.sqrt(self.whole * below * _GROWTH), time)
        return dr.fma(share, high - low, low)

    def four(self, time: Float, variance: Float) -> list[Float]:
        """Return the response at a time [sample] and at the three samples after it."""
        if self.table is not None:
            return [self.values(time + step, variance) for step in range(4)]
        inverse = dr.rcp(self.whole + variance)
        height, half = dr.sqrt(inverse * (0.5 / math.pi)), -0.5 * inverse
        return [height * dr.exp(dr.square(time + step) * half) for step in range(4)]

    def _row(self, row: UInt32, width: Float, time: Float) -> Float:
        assert self.table is not None
        node_position = dr.clip((time / width - self.table.first) * self.table.density, 0.0, _NODES - 1.001)
        node = dr.floor(node_position)
        at = auto.UInt32(row) * _NODES + auto.UInt32(node)
        left = dr.gather(auto.Float, self.table.values, at)
        right = dr.gather(auto.Float, self.table.values, at + 1)
        return dr.fma(node_position - node, right - left, left) / width
