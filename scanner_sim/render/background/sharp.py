"""The sharp light of panoramas: what is seen of Sun and Earth themselves, and the Sun's light from the first surface.

It needs two rays for a sample and neighbouring rays run alike, so it is followed apart from the rest and far more
finely. How finely, a pilot says: bins about which its samples differ get many, the others few. The pilot's
samples do not enter the result. Rows that lie close share samples (:mod:`scanner_sim.render.background.strips`).
Samples of a row, or of such a strip, lie on one lattice
(Kronecker sequences, Niederreiter, *Random number generation and quasi-Monte Carlo methods*, 1992, ch. 3) with a
random start: over the pixels of a window the error falls faster than with a start for each bin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.foundation.streams import Stream
from scanner_sim.render.background.paths import trace_sharp
from scanner_sim.render.background.sky import SkyLight
from scanner_sim.render.background.strips import Strips
from scanner_sim.render.background.view import PanoramaView, Window, counted, height_on_pixel, rays_through
from scanner_sim.render.rays import at_time, for_rows
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import LoadedScene

_SAMPLES_BY_CONTRAST = ((0.0, 2), (0.02, 6), (0.2, 24))
"""From which contrast on how many samples are taken within a pixel's height, in each half."""
_RAYS_TOGETHER = 1 << 21
_DARK_RADIANCE = 0.003
"""Radiance that counts as dark [1/sr]: a hundredth of a white wall's in the Sun."""
_CONTRAST_BINS = 1
"""Bins to either side, among which the pilot's samples are compared."""
_STREAM_ADDRESS = 0xFFFFFF00
"""Addresses of the lattices' random starts, none of which a path has."""
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_DISC_STEPS = (0.8191725134, 0.6710436067)
"""Powers of the reciprocal of the real root of x⁴ = x + 1: steps of a sequence even in two further dimensions."""


def contrast(low: Float, high: Float, view: PanoramaView | Window, reach_rows: int) -> Float:
    """Return the contrast of the pilot's samples around each bin, (high − low)/(high + faint).

    Parameters
    ----------
    low, high
        Least and largest sample of each bin [1/sr], Dr.Jit, shape (rows · bins,).
    view
        The bins.
    reach_rows
        Rows above and below that are compared as well.
    """
    lane = dr.arange(mi.UInt32, dr.width(low))
    bins = counted(view.bins)
    row, column, width = mi.Int32(lane // bins), mi.Int32(lane % bins), mi.Int32(bins)
    lowest, last = counted(view.rows - 1, mi.Int32), counted(view.bins - 1, mi.Int32)
    least, most = mi.Float(low), mi.Float(high)
    for down in range(-reach_rows, reach_rows + 1):
        for right in range(-_CONTRAST_BINS, _CONTRAST_BINS + 1):
            y, x = dr.clip(row + down, 0, lowest), dr.clip(column + right, 0, last)
            at = mi.UInt32(y * width + x)
            least = dr.minimum(least, dr.gather(mi.Float, low, at))
            most = dr.maximum(most, dr.gather(mi.Float, high, at))
    return (most - least) / (most + _DARK_RADIANCE)


def sharp_light(
    loaded: LoadedScene,
    layout: OpticalLayout,
    sky: SkyLight,
    view: PanoramaView,
    uneven: Float,
    *,
    finer: int,
    seed: int,
) -> list[list[Float]]:
    """Return the sharp light of each bin.

    Parameters
    ----------
    loaded, layout, sky, view
        Scene as it was loaded, optics, Sun and Earth, angles.
    uneven
        Contrast about each bin, Dr.Jit, shape (rows · bins,).
    finer
        Factor of all numbers of samples.
    seed
        Seed of the lattices' starts.

    Returns
    -------
    list
        Two halves on their own lattices, each radiance in band and out of band per unit of the Sun's irradiance
        [1/sr], shape (rows · bins,).
    """
    strips = Strips.of(view, layout)
    loaded = at_time(loaded, strips.view.time)
    groups = _by_contrast(strips.uneven(uneven), finer * strips.share)
    total, shared = sum(dr.width(index) * samples for index, samples in groups), strips.reach > 0
    halves = []
    for part in range(2):
        # Samples of strips are kept; those of a row alone are averaged at once.
        layers = [dr.zeros(mi.Float, total if shared else view.rows * view.bins) for _ in range(2 + shared)]
        begin = 0
        for some, samples in _together(groups):
            values = _trace(loaded, layout, sky, strips.view, some, samples, part, seed, strips.place)
            at = dr.arange(mi.UInt32, dr.width(some) * samples) + counted(begin)
            if not shared:
                at, values = some, _means(values[1:], samples)
            for layer, value in zip(layers, values, strict=True):
                dr.scatter(layer, value, at, mode=dr.ReduceMode.Permute)
            dr.eval(layers)
            begin += dr.width(some) * samples
        halves.append(strips.seen(layers, groups) if shared else layers)
    return halves


def _by_contrast(uneven: Float, finer: float) -> list[tuple[UInt32, int]]:
    """Return which bins get how many samples in each half, those that have as many together."""
    groups = []
    for level, (least, samples) in enumerate(_SAMPLES_BY_CONTRAST):
        members = uneven >= least
        if level + 1 < len(_SAMPLES_BY_CONTRAST):
            members &= uneven < _SAMPLES_BY_CONTRAST[level + 1][0]
        groups.append((dr.compress(members), math.ceil(samples * finer)))
    return [(index, samples) for index, samples in groups if dr.width(index)]


def _together(groups: list[tuple[UInt32, int]]) -> Iterator[tuple[UInt32, int]]:
    """Yield bins and their samples by as many as are traced together."""
    for index, samples in groups:
        together = max(1, _RAYS_TOGETHER // samples)
        for start in range(0, dr.width(index), together):
            count = min(together, dr.width(index) - start)
            yield dr.gather(mi.UInt32, index, dr.arange(mi.UInt32, count) + counted(start)), samples


def _means(light: list[Float], samples: int) -> list[Float]:
    """Return the means of as many samples that lie side by side."""
    share = dr.opaque(mi.Float, 1.0 / samples)
    return [dr.block_sum(value, samples) * share for value in light]


def evenly_sharp_light(
    loaded: LoadedScene,
    layout: OpticalLayout,
    sky: SkyLight,
    view: PanoramaView | Window,
    samples: int,
    seed: int,
) -> list[list[Float]]:
    """Return what :func:`sharp_light` does, with as many samples of every bin in each half."""
    bins = dr.arange(mi.UInt32, view.rows * view.bins)

    def place(_column: UInt32, _along: Float, across: Float) -> Float:
        return height_on_pixel(layout, view, across)

    halves = []
    for part in range(2):
        _, *light = _trace(loaded, layout, sky, view, bins, samples, part, seed, place)
        halves.append(_means(light, samples))
    dr.eval(halves)
    return halves


def _trace(
    loaded: LoadedScene,
    layout: OpticalLayout,
    sky: SkyLight,
    view: PanoramaView | Window,
    bins: UInt32,
    samples: int,
    part: int,
    seed: int,
    place: Callable[[UInt32, Float, Float], Float],
) -> list[Float]:
    """Return samples of some bins, those of one together: place across [m], radiance in band and out of band.

    ``place`` tells it from the column, the position along the row and a uniform number.
    """
    lane = dr.arange(mi.UInt32, dr.width(bins) * samples)
    together, width = counted(samples), counted(view.bins)
    index = dr.gather(mi.UInt32, bins, lane // together)
    row, column = index // width, index % width
    number = column * together + lane % together
    starts = generator(
        seed, Stream.BACKGROUND, mi.UInt32(_STREAM_ADDRESS), row * 4 + dr.opaque(mi.UInt32, 2 * part)
    )
    first, second = starts.next_float32x4(), starts.next_float32x4()

    def lattice(step: float, start: Float) -> Float:
        return mi.Float(number * mi.UInt32(round(2**32 * step))) * 2.0**-32 + start

    def within(value: Float) -> Float:
        return dr.minimum(value - dr.floor(value), 1.0 - 2.0**-23)

    along = (mi.Float(lane % together) + first[0]) * dr.opaque(mi.Float, 1.0 / samples) - 0.5
    across = within(lattice(_GOLDEN, first[1]))
    disc = mi.Point2f(within(lattice(_DISC_STEPS[0], first[2])), within(lattice(_DISC_STEPS[1], first[3])))
    height = place(column, along, across)
    origin, direction = rays_through(layout, view, row, column, along, height)
    return [height, *trace_sharp(for_rows(loaded, row), sky, origin, direction, disc, second)]
