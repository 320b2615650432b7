"""Background light on the line sensor: one panorama for each row of a raster.

With φ fixed, laser and receiver turn in one plane about one lens position: a pixel at p looks along the angle
Θ − atan(p/f) of that plane, whichever voxel is measured. So one panorama over this angle serves all voxels of a row.
It is path-traced (:mod:`scanner_sim.render.paths`) from the lens node, blurred by the point spread, over the height of
the pixels; its smooth part (the Earth's light and what other surfaces reflect) is averaged over neighbours that lie on
the same surface, by an edge-avoiding à-trous filter (Dammertz, Sewtz, Hanika, Lensch, *High Performance Graphics*
2010) whose weights know geometry and material only.

Not modelled: the receiver's finite aperture for the background (it is seen from the lens node), and the mirrors'
jitter, a sixtieth of a pixel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.render.filtering import Features, blurred, smooth
from scanner_sim.render.paths import Albedo, FirstHit, Radiance, trace_paths
from scanner_sim.render.sky import SkyLight
from scanner_sim.render.transport import Bench, device_frame
from scanner_sim.scene.loader import LoadedScene
from scanner_sim.streams import Stream, generator

_PATHS_TOGETHER = 1 << 21
_MOST_SAMPLES = 64
"""Largest factor of the samples where rows are sparse."""
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_GENERALISED_GOLDEN = 1.085070245491451
"""The real root of x⁹ = x + 1."""


@dataclass(frozen=True)
class View:
    """The angles of a raster's panoramas.

    Attributes
    ----------
    phi
        φ of each row [rad], shape (rows,).
    first, step
        Angle of the first bin's centre, and of a bin [rad].
    bins
        Number of bins of a row.
    """

    phi: NDArray[np.float64]
    first: float
    step: float
    bins: int

    @property
    def row_step(self) -> float:
        """Angle between rows [rad]; infinite where there is one row only."""
        return float(self.phi[1] - self.phi[0]) if len(self.phi) > 1 else math.inf


@dataclass
class Panorama:
    """Radiance per unit of the Sun's irradiance [1/sr], Dr.Jit arrays: entry row · bins + bin.

    ``in_band`` and ``out_of_band``; ``error`` the standard error of the first.
    """

    view: View
    in_band: Any
    out_of_band: Any
    error: Any

    def look(self, layer: Any, row: Any, angle: Any) -> Any:
        """Return a layer around angles [rad] of some rows, interpolated between bins."""
        at = (angle - dr.opaque(mi.Float, self.view.first)) / dr.opaque(mi.Float, self.view.step)
        low = dr.floor(at)
        last = dr.opaque(mi.Float, self.view.bins - 1)
        left = row * self.view.bins + mi.UInt32(dr.clip(low, 0.0, last))
        right = row * self.view.bins + mi.UInt32(dr.clip(low + 1.0, 0.0, last))
        return dr.lerp(dr.gather(mi.Float, layer, left), dr.gather(mi.Float, layer, right), at - low)


def panorama_view(theta: tuple[float, float], phi: NDArray[np.float64], bench: Bench, pixels: int) -> View:
    """Return the angles that the pixels of all voxels of a raster see: Θ from ``theta``, rows at ``phi`` [rad]."""
    f, step = bench.receiver.focal_length, bench.pitch / bench.receiver.focal_length
    first = theta[0] - math.atan((bench.offset + pixels * bench.pitch) / f) - step
    last = theta[1] - math.atan(bench.offset / f) + step
    bins = math.ceil((last - first) / step) + 1
    return View(np.asarray(phi, dtype=np.float64), first, step, bins)


def render_panorama(
    loaded: LoadedScene,
    bench: Bench,
    sky: SkyLight,
    albedo: Albedo,
    view: View,
    *,
    bounces: int,
    samples: int,
    seed: int,
) -> Panorama:
    """Path-trace the panoramas of a raster.

    Parameters
    ----------
    loaded, bench, sky, albedo
        Scene, optics, Sun and Earth.
    view
        Angles of the panoramas.
    bounces, samples
        Surfaces on a path; paths of each bin, an even number. Where rows lie more than two bins apart, each gets
        as many more, up to a limit.
    seed
        Seed of the paths.
    """
    rows = len(view.phi)
    size = rows * view.bins
    half = samples // 2 * max(1, round(min(view.row_step / (2.0 * view.step), _MOST_SAMPLES)))
    sums = [[dr.empty(mi.Float, size) for _ in range(4)] for _ in range(2)]
    features = Features(
        dr.empty(mi.UInt32, size), *([dr.empty(mi.Float, size) for _ in range(3)] for _ in range(2))
    )
    together = max(1, _PATHS_TOGETHER // (view.bins * half))
    for start in range(0, rows, together):
        some = np.arange(start, min(start + together, rows))
        for part in range(2):
            radiance, first = _trace_rows(
                loaded, bench, sky, albedo, view, some, part * half, half, bounces, seed
            )
            at = dr.arange(mi.UInt32, len(some) * view.bins) + start * view.bins
            values = [
                dr.block_sum(value, half) / half
                for value in (
                    radiance.direct,
                    radiance.direct_out,
                    radiance.indirect,
                    radiance.indirect_out,
                )
            ]
            dr.eval(values, first)
            for target, value in zip(sums[part], values, strict=True):
                dr.scatter(target, value, at)
            if part == 0:
                features.put(first, half, at)
            dr.eval(sums, features)
    # A bin's own width, and the interpolation between bins, blur as well.
    spread = math.sqrt(max((bench.receiver.point_spread / bench.pitch) ** 2 - 1.0 / 6.0, 0.0))
    return _assembled(view, sums, features, spread)


def _assembled(view: View, sums: Any, features: Features, spread: float) -> Panorama:
    """Filter the smooth part of both halves alike, blur all, and take the error from the halves' difference."""
    rows = len(view.phi)
    smoothed = smooth(
        [layer for part in sums for layer in part[2:]], features, rows, view.bins, view.step / view.row_step
    )
    sharp = [layer for part in sums for layer in part[:2]]
    halves = blurred([one + other for one, other in zip(sharp, smoothed, strict=True)], view.bins, spread)
    in_band, out_of_band = 0.5 * (halves[0] + halves[2]), 0.5 * (halves[1] + halves[3])
    error = 0.5 * dr.abs(halves[0] - halves[2])
    dr.eval(in_band, out_of_band, error)
    return Panorama(view, in_band, out_of_band, error)


def _evenly(number: Any, draw: Any, axis: int, seed: int, part: int) -> Any:
    """Return one coordinate of the Kronecker sequence of the generalised golden ratio in eight dimensions.

    Neighbours together then cover the unit cube far more evenly than random numbers, and the filter's mean over
    them is as much better (Roberts, *The unreasonable effectiveness of quasirandom sequences*, 2018). The start
    is random, another one for each half of the samples.
    """
    first, second = (round(2**32 * _GENERALISED_GOLDEN ** -(axis + shift)) for shift in (1, 5))
    step = dr.select(draw == 0, mi.UInt32(first), mi.UInt32(second))
    start = generator(seed, Stream.BACKGROUND, mi.UInt32(0xFFFFFFFF), draw * 4 + (axis + 64 * part))
    return mi.Float(number * step + start.next_uint32x4()[0]) * 2.0**-32 * (1.0 - 2.0**-23)


def _trace_rows(
    loaded: LoadedScene,
    bench: Bench,
    sky: SkyLight,
    albedo: Albedo,
    view: View,
    rows: NDArray[np.intp],
    first_sample: int,
    samples: int,
    bounces: int,
    seed: int,
) -> tuple[Radiance, FirstHit]:
    """Trace some rows: ``samples`` neighbouring lanes per bin."""
    lane = dr.arange(mi.UInt32, len(rows) * view.bins * samples)
    bin_, sample = lane // samples, lane % samples
    row, column = bin_ // view.bins, bin_ % view.bins
    # Addresses count over the whole panorama: a row's numbers do not depend on the batch.
    address = bin_ + dr.opaque(mi.UInt32, int(rows[0]) * view.bins)

    drawn_before = sample + dr.opaque(mi.UInt32, first_sample)
    spread_number = address * samples + sample

    def random(number: Any) -> Any:
        """Return four numbers: of the first surface evenly spread over neighbours, of later ones random."""
        free = generator(seed, Stream.BACKGROUND, address, drawn_before * 64 + number).next_float32x4()
        spread = mi.Point4f(*(_evenly(spread_number, number, axis, seed, first_sample) for axis in range(4)))
        return dr.select(number < 2, spread, free)

    place = generator(seed, Stream.BACKGROUND, address, drawn_before * 64 + 62).next_float32x4()
    blur = generator(seed, Stream.BACKGROUND, address, drawn_before * 64 + 63).next_float32x4_normal()
    receiver = bench.receiver
    # Each half of the samples covers the bin on its own, as a lattice with a random start.
    start = generator(seed, Stream.BACKGROUND, address, dr.opaque(mi.UInt32, first_sample * 64 + 61))
    along = (mi.Float(sample) + place[0]) / dr.opaque(mi.Float, float(samples)) - 0.5
    height = mi.Float(sample) * _GOLDEN + start.next_float32x4()[0]
    height -= dr.floor(height)
    angle = dr.opaque(mi.Float, view.first) + (mi.Float(column) + along) * dr.opaque(mi.Float, view.step)
    across = (height - 0.5) * bench.height + blur[1] * receiver.point_spread
    phi = dr.gather(mi.Float, mi.Float(view.phi[rows].astype(np.float32)), row)
    frame = device_frame(bench, angle, phi)
    direction = dr.normalize(frame.along + frame.normal * (across / receiver.focal_length))
    return trace_paths(loaded, sky, albedo, bounces, mi.Point3f(frame.lens), direction, random)
