"""Strips of φ, whose samples all rows share that look into them.

The pixels of a row see a strip as high as they are, blurred by the point spread; rows of a raster lie closer than that,
so that several look at the same place. Where at least two rows lie within a pixel's height, samples are taken in even
strips across φ that leave no gap, from the lens of the strip's middle, and each row weighs those that its pixels reach
into by their place on the pixel. Weights are divided by their sum, so that light that is even comes out even. Other
rows have samples of their own.

Not modelled: the way of the lens between a row and a strip that it reaches into, some 60 µm by the prototype; where
objects move, they stand where they are in the middle of the time of the strip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.render.background.view import PanoramaView, counted, height_on_pixel
from scanner_sim.render.transport import OpticalLayout

_STRIPS_OF_A_PIXEL = 2
"""Strips that lie in the height of a pixel, at least."""
_FARTHEST = 4.0
"""Standard deviations of the point spread beyond a pixel's edge from where light still counts."""
_NARROWEST = 0.2
"""Least width of a strip at the end of the field over that in its middle: beyond 78° each row has its own samples."""
_SHARPEST = 1e-9
"""Least standard deviation of the point spread [m] that is told from none."""


@dataclass(frozen=True)
class Strips:
    """Strips and the rows that look into them.

    Attributes
    ----------
    rows
        The rows of the panorama.
    view
        The strips, as rows of φ.
    among
        Rows that have their middle in one strip.
    reach
        Strips to either side that a row's pixels reach into; 0 where each row has samples of its own.
    tall
        How high the image of a strip is in the middle of the field [m].
    layout
        Optics.
    """

    rows: PanoramaView
    view: PanoramaView
    among: int
    reach: int
    tall: float
    layout: OpticalLayout

    @classmethod
    def of(cls, rows: PanoramaView, layout: OpticalLayout) -> Strips:
        """Return the strips for some rows."""
        height, step = rows.pixel_height(layout), rows.row_step * layout.receiver.focal_length
        among = int(height / (_STRIPS_OF_A_PIXEL * step))
        least = math.cos(max(abs(rows.first), abs(rows.first + rows.bins * rows.step)))
        if not among or least < _NARROWEST:
            return cls(rows, rows, 1, 0, height, layout)
        far = 0.5 * height + _FARTHEST * layout.point_spread
        reach = math.ceil(far / (among * step * least) + 0.5 * (among - 1) / among - 0.5)
        numbers = np.arange(-(-rows.rows // among) + 2 * reach) - reach
        phi = rows.phi[0] + rows.row_step * (among * numbers + 0.5 * (among - 1))
        time = rows.time
        if time is not None and len(time) > 1:
            time = time[np.clip(among * numbers + among // 2, 0, rows.rows - 1)]
        return cls(rows, replace(rows, phi=phi, time=time), among, reach, among * step, layout)

    @property
    def share(self) -> float:
        """Height of a strip over that of a pixel: what a strip needs of the samples of a row."""
        return self.tall / self.rows.pixel_height(self.layout)

    def uneven(self, contrast: Float) -> Float:
        """Return the largest contrast of the rows in each bin of a strip, from that of each row, Dr.Jit."""
        if not self.reach:
            return contrast
        lane = dr.arange(mi.UInt32, self.view.rows * self.view.bins)
        bins, last = counted(self.rows.bins), counted(self.rows.rows - 1, mi.Int32)
        first = (mi.Int32(lane // bins) - dr.opaque(mi.Int32, self.reach)) * dr.opaque(mi.Int32, self.among)

        def largest(number: UInt32, most: Float) -> tuple[Float]:
            row = mi.UInt32(dr.clip(first + mi.Int32(number), 0, last))
            return (dr.maximum(most, dr.gather(mi.Float, contrast, row * bins + lane % bins)),)

        return for_each(self.among, largest, dr.zeros(mi.Float, dr.width(lane)))[0]

    def place(self, column: UInt32, along: Float, across: Float) -> Float:
        """Return places on the pixel across the row [m], from the middle of a strip, by uniform numbers."""
        if not self.reach:
            return height_on_pixel(self.layout, self.rows, across)
        return (across - 0.5) * self._height(mi.Float(column) + along)

    def seen(self, samples: list[Float], groups: list[tuple[UInt32, int]]) -> list[Float]:
        """Return what rows see of the samples of strips, Dr.Jit, shape (rows · bins,).

        Parameters
        ----------
        samples
            Places from the middle of the strip [m], and light in band and out of band.
        groups
            Bins of the strips, and of how many samples each has its own, in the order of the samples.
        """
        start, count = (dr.empty(mi.UInt32, self.view.rows * self.view.bins) for _ in range(2))
        begin = 0
        for index, each in groups:
            own = dr.arange(mi.UInt32, dr.width(index)) * counted(each) + counted(begin)
            dr.scatter(start, own, index, mode=dr.ReduceMode.Permute)
            dr.scatter(count, counted(each), index, mode=dr.ReduceMode.Permute)
            begin += dr.width(index) * each
        lane = dr.arange(mi.UInt32, self.rows.rows * self.rows.bins)
        bins = counted(self.rows.bins)
        row, column = lane // bins, lane % bins
        among = counted(self.among)
        half = dr.opaque(mi.Float, 0.5 * self.rows.pixel_height(self.layout))
        blur = dr.opaque(mi.Float, 1.0 / (math.sqrt(2.0) * max(self.layout.point_spread, _SHARPEST)))
        # Of the row, from the middle of the first strip that its pixels may reach into [strips].
        middle = (mi.Float(row % among) + 0.5) / mi.Float(among) - 0.5 + counted(self.reach, mi.Float)
        tall = self._height(mi.Float(column))

        def strip(number: UInt32, sums: list[Float]) -> tuple[list[Float]]:
            index = (row // among + number) * bins + column
            first, many = dr.gather(mi.UInt32, start, index), dr.gather(mi.UInt32, count, index)
            away = (mi.Float(number) - middle) * tall

            def sample(at: UInt32, *sums: Float) -> tuple[Any, ...]:
                place = dr.gather(mi.Float, samples[0], first + at) + away
                weight = (dr.erf((place + half) * blur) - dr.erf((place - half) * blur)) / mi.Float(many)
                light = (dr.gather(mi.Float, part, first + at) for part in samples[1:])
                found = (total + weight * value for total, value in zip(sums[1:], light, strict=True))
                return at + 1, sums[0] + weight, *found

            loop: Any = dr.while_loop
            _, *sums = loop((mi.UInt32(0), *sums), lambda at, *_: at < many, sample)
            return (sums,)

        none = [dr.zeros(mi.Float, dr.width(lane)) for _ in samples]
        (sums,) = for_each(2 * self.reach + 1, strip, none)
        found = [total / sums[0] for total in sums[1:]]
        dr.eval(found)
        return found

    def _height(self, column: Float) -> Float:
        """Return how high the image of a strip is [m] in some columns, for it turns about the axis of φ."""
        first, step, _ = self.rows.lattice()
        return dr.opaque(mi.Float, self.tall) * dr.cos(column * step + first)
