"""Background light on the line sensor: one panorama for each row of a raster.

With φ fixed, laser and receiver turn in one plane about one lens position: a pixel at p looks along the angle Θ −
atan(p/f) of that plane, whichever voxel is measured. So one panorama over this angle serves all voxels of a row. It is
path-traced (:mod:`scanner_sim.render.background.paths`) from the lens node, blurred by the point spread, over the
height of the pixels, in two parts. Sharp light (:mod:`scanner_sim.render.background.sharp`) is followed finely where it
is uneven. What is smooth (the Earth's light and what other surfaces reflect) is followed by few long paths, up to three
from the first surface of one *look*, a ray out of the lens. Their directions a few neighbouring pixels share out evenly
among them, and they are averaged over neighbours that lie on the same surface
(:mod:`scanner_sim.render.background.filtering`).

Both parts have two independent halves. Half their difference, summed over the window of 200 µm in which the background
is counted, has the variance of the mean of both: an unbiased estimate with one degree of freedom, which is steadied
by averaging it over a few neighbours.

Moving objects stand where they are in the middle of a row's time. Not modelled: what they move during the row, the
receiver's finite aperture for the background (it is seen from the lens node), and the mirrors' jitter, a sixtieth of a
pixel. The stated error leaves out what the filter's reach makes of smooth light.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace
from typing import cast

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Float, Mask, UInt32, Vector4f
from scanner_sim.foundation.streams import Stream
from scanner_sim.render.background.filtering import Features, convolve_rows, smooth
from scanner_sim.render.background.paths import FirstHit, Look, PathSums, sum_paths
from scanner_sim.render.background.sharp import contrast, evenly_sharp_light, sharp_light
from scanner_sim.render.background.sky import SkyLight, light_of
from scanner_sim.render.background.view import (
    WINDOW,
    PanoramaView,
    Window,
    WindowsBeside,
    counted,
    height_on_pixel,
    rays_through,
)
from scanner_sim.render.garbage import garbage_waits
from scanner_sim.render.rays import at_time, for_rows
from scanner_sim.render.settings import Transport, times_finer
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.scene.light.lighting import Sky

_BINS_TOGETHER = 1 << 20
_LEAST_RADIANCE = 1e-12
"""Radiance per unit of the Sun's irradiance [1/sr] that counts as none: far smaller numbers come from the filter's
tails, and threads may round their products, below 1e-38 W, to 0 or not."""
_ERROR_BINS = 8
"""Bins to either side over which the squared error is averaged."""
_PATHS_OF_A_LOOK = 3
"""Long paths that go on from one first surface, where there are as many."""
_SHELF = "panorama"
_MOST_KEPT = 1 << 22
"""Bins of the largest panoramas that are kept: 64 MB."""
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_PATTERN = 16
"""Bins of a row over which directions are spread."""
_EIGHT = tuple(round(2**32 * 1.085070245491451**-power) for power in range(1, 9))
_TWO = tuple(round(2**32 * 1.324717957244746**-power) for power in (1, 2))
"""Steps of the sequences: powers of the reciprocal of the real roots of x⁹ = x + 1 and x³ = x + 1."""


@dataclass
class Panorama:
    """Radiance per unit of the Sun's irradiance [1/sr], Dr.Jit arrays: entry row · bins + bin behind a view's start.

    ``in_band`` and ``out_of_band``; ``error`` and ``error_out`` are the standard errors of their means over a window
    of 200 µm about the bin.
    """

    view: PanoramaView | Window
    in_band: Float
    out_of_band: Float
    error: Float
    error_out: Float

    def seen_by(self, index: UInt32) -> Panorama:
        """Return what shots see of it, by their indices: of windows of several patterns, each its own."""
        return replace(self, view=self.view.at(index)) if isinstance(self.view, WindowsBeside) else self

    def look(self, layer: Float, row: UInt32, angle: Float) -> Float:
        """Return a layer around angles [rad] of some rows, interpolated between bins, and between rows if need be."""
        if dr.is_float_v(row):
            low = dr.floor(row)
            last_row = mi.Float(counted(self.view.rows)) - 1.0
            upper, lower = (
                self.look(layer, mi.UInt32(dr.minimum(low + step, last_row)), angle) for step in (0.0, 1.0)
            )
            return dr.lerp(upper, lower, row - low)
        first, step, last = self.view.lattice()
        at = (angle - first) / step
        low = dr.floor(at)
        start = row * counted(self.view.bins)
        if self.view.start is not None:
            start += self.view.start
        left, right = (start + mi.UInt32(dr.clip(low + side, 0.0, last)) for side in (0.0, 1.0))
        return dr.lerp(dr.gather(mi.Float, layer, left), dr.gather(mi.Float, layer, right), at - low)


@garbage_waits()
def render_panorama(
    loaded: LoadedScene,
    layout: OpticalLayout,
    sky: SkyLight,
    view: PanoramaView | Window,
    *,
    bounces: int,
    samples: int,
    seed: int,
    sharp_samples: int | None = None,
) -> Panorama:
    """Path-trace the panoramas of a raster.

    Parameters
    ----------
    loaded, layout, sky
        Scene, optics, Sun and Earth.
    view
        Angles of the panoramas.
    bounces, samples
        Surfaces on a path; long paths of each bin, an even number, or a few more: all looks have as many. Where rows
        lie three bins apart or more, each gets as many more, up to a limit.
    seed
        Seed of the paths.
    sharp_samples
        Samples of the sharp light of each bin, in each half; None lets a pilot say. With a number no array's size
        depends on the light.
    """
    posed = at_time(loaded, view.time)
    finer = times_finer(view.row_step, view.step)
    half, size = samples // 2 * finer, view.rows * view.bins
    looks = -(-half // _PATHS_OF_A_LOOK)
    counts = looks, -(-half // looks)
    sums = [[dr.empty(mi.Float, size) for _ in range(4)] for _ in range(2)]
    features = [Features.empty(size) for _ in range(2)]
    together = max(1, _BINS_TOGETHER // view.bins)
    for start in range(0, view.rows, together):
        some = np.arange(start, min(start + together, view.rows))
        for part in range(2):
            found, first, at, inside = _trace_rows(
                posed, layout, sky, view, some, part, counts, bounces, seed
            )
            share = dr.opaque(mi.Float, 1.0 / math.prod(counts))
            values = [found.least, found.most, found.indirect * share, found.indirect_out * share]
            for target, value in zip(sums[part], values, strict=True):
                dr.scatter(target, value, at, inside)
            features[part].put(first, at, inside)
            dr.eval(sums, features)
    if sharp_samples is None:
        raster = cast("PanoramaView", view)  # windows come with a number of samples
        sharp = _sharp_by_contrast(loaded, layout, sky, raster, sums, min(finer, 4), seed)
    else:
        sharp = evenly_sharp_light(posed, layout, sky, view, sharp_samples, seed)
    halves = [
        one + other
        for part in range(2)
        for one, other in zip(
            sharp[part],
            smooth(sums[part][2:], features[part], view.rows, view.bins, view.step / view.row_step),
            strict=True,
        )
    ]
    return _assemble(view, layout, halves)


def known_panorama(
    loaded: LoadedScene,
    layout: OpticalLayout,
    sky: Sky,
    view: PanoramaView,
    settings: Transport,
    seed: int,
) -> Panorama:
    """Return the panoramas of a scan: those that were rendered last of this scene, if they are the same.

    The two used last are kept with a scene in which nothing moves, one for each rangefinder, unless they are large.
    They are the same where sky, view, settings of the light, seed and what of the optics forms the picture are.

    Parameters
    ----------
    loaded, layout, sky, view
        As for :func:`render_panorama`; the sky as a scenario has it.
    settings
        Bounces and samples.
    seed
        Seed of the paths.
    """
    optics = (layout.axis_separation, layout.axes, layout.receiver.baseline, layout.receiver.focal_length)
    sensor = (layout.pitch, layout.height, layout.point_spread)
    numbers = (settings.background_bounces, settings.background_samples, seed)
    bins = (view.first, view.step, view.bins, view.between, view.phi.tobytes())
    tables = (loaded.out_of_band_ratio.numpy().tobytes(), loaded.dark_in_band.numpy().tobytes())
    heaven = tuple(None if part is None else np.asarray(part).tobytes() for part in astuple(sky))
    name = (_SHELF, *optics, *sensor, *numbers, *bins, *tables, *heaven)
    if name in loaded.kept:
        known: Panorama = loaded.kept.pop(name)
        loaded.kept[name] = known
        return known
    bounces, samples = settings.background_bounces, settings.background_samples
    made = render_panorama(loaded, layout, light_of(sky), view, bounces=bounces, samples=samples, seed=seed)
    if not loaded.bodies and view.rows * view.bins <= _MOST_KEPT:
        for older in [other for other in loaded.kept if other[0] == _SHELF][:-1]:
            del loaded.kept[older]
        loaded.kept[name] = made
    return made


def _sharp_by_contrast(
    loaded: LoadedScene,
    layout: OpticalLayout,
    sky: SkyLight,
    view: PanoramaView,
    sums: list[list[Float]],
    finer: int,
    seed: int,
) -> list[list[Float]]:
    """Return both halves of the sharp light, sampled the more the more the least and largest samples differ."""
    low, high = dr.minimum(sums[0][0], sums[1][0]), dr.maximum(sums[0][1], sums[1][1])
    seen = layout.height / layout.receiver.focal_length
    # An edge between rows, at the end of the pixels' height, may escape all samples of one row.
    uneven = contrast(low, high, view, 1 if view.row_step < 2.0 * seen else 0)
    dr.eval(uneven)
    return sharp_light(loaded, layout, sky, view, uneven, finer=finer, seed=seed)


def _assemble(view: PanoramaView | Window, layout: OpticalLayout, halves: list[Float]) -> Panorama:
    """Blur both halves, and take the error of a window from their difference."""
    # A bin's own width, and the interpolation between bins, blur as well.
    spread = math.sqrt(max((layout.point_spread / layout.pitch) ** 2 - 1.0 / 6.0, 0.0))
    steps = np.arange(-math.ceil(3.5 * spread), math.ceil(3.5 * spread) + 1)
    blur = np.exp(-0.5 * (steps / spread) ** 2) if spread > 0.0 else np.ones(1)
    halves = convolve_rows(halves, view.bins, blur / blur.sum())
    in_band, out_of_band = 0.5 * (halves[0] + halves[2]), 0.5 * (halves[1] + halves[3])

    width = WINDOW / layout.pitch
    reach = max(0, math.ceil(0.5 * width - 0.5))
    window = np.clip(0.5 * width + 0.5 - np.abs(np.arange(-reach, reach + 1)), 0.0, 1.0)
    apart = [0.5 * (halves[0] - halves[2]), 0.5 * (halves[1] - halves[3])]
    squares = [dr.square(layer) for layer in convolve_rows(apart, view.bins, window / window.sum())]
    near = np.full(2 * _ERROR_BINS + 1, 1.0 / (2 * _ERROR_BINS + 1))
    errors = [dr.sqrt(_over_rows(layer, view)) for layer in convolve_rows(squares, view.bins, near)]
    layers = [dr.select(layer > _LEAST_RADIANCE, layer, 0.0) for layer in (in_band, out_of_band, *errors)]
    dr.eval(layers)
    return Panorama(view, *layers)


def _over_rows(layer: Float, view: PanoramaView | Window) -> Float:
    """Return the mean of each row with the next to either side; the first and last are repeated."""
    lane = dr.arange(mi.UInt32, view.rows * view.bins)
    bins, size = counted(view.bins), counted(view.rows * view.bins)
    up = dr.select(lane >= bins, lane - bins, lane)
    down = dr.select(lane + bins < size, lane + bins, lane)
    return (layer + dr.gather(mi.Float, layer, up) + dr.gather(mi.Float, layer, down)) / 3.0


def _trace_rows(
    loaded: LoadedScene,
    layout: OpticalLayout,
    sky: SkyLight,
    view: PanoramaView | Window,
    rows: NDArray[np.intp],
    part: int,
    counts: tuple[int, int],
    bounces: int,
    seed: int,
) -> tuple[PathSums, FirstHit, UInt32, Mask]:
    """Trace one half of some rows, a lane for each bin; return also the lanes' entries, and which are bins.

    Bins of a row that lie :data:`_PATTERN` apart follow like directions at a time, and stand together, so that their
    rays run alike. The bins between them take the other directions of a pattern.
    """
    across = dr.opaque(mi.UInt32, -(-view.bins // _PATTERN))
    lane = dr.arange(mi.UInt32, len(rows) * -(-view.bins // _PATTERN) * _PATTERN)
    member, place = lane // across, lane % across
    row, column = member // _PATTERN, member % _PATTERN + _PATTERN * place
    bins = counted(view.bins)
    inside = column < bins
    # Addresses count over the whole panorama: a row's numbers do not depend on the batch.
    row += dr.opaque(mi.UInt32, int(rows[0]))
    address = row * bins + column
    looks, onward = dr.opaque(mi.UInt32, counts[0]), dr.opaque(mi.UInt32, counts[1])
    together, half = looks * onward, dr.opaque(mi.UInt32, part)
    pattern = _Pattern(seed, row, half, member % _PATTERN)
    # Each half of the samples covers the bin on its own, as a lattice with a random start.
    start = generator(seed, Stream.BACKGROUND, address, half * together * 64 + 61).next_float32x4()[0]

    def look(number: UInt32) -> Look:
        def free(path: UInt32, draw: UInt32) -> Vector4f:
            drawn = (half * together + number * onward + path) * 64
            return generator(seed, Stream.BACKGROUND, address, drawn + draw).next_float32x4()

        def scatter(path: UInt32) -> Vector4f:
            shift, draws = free(path, mi.UInt32(63)), free(path, mi.UInt32(62))
            return pattern.scatter(number * onward + path, together, shift, draws)

        own = mi.UInt32(0)
        light = pattern.light(number, looks, free(own, mi.UInt32(60)))
        along = (mi.Float(number) + free(own, mi.UInt32(59))[0]) / mi.Float(looks) - 0.5
        across = mi.Float(number) * _GOLDEN + start
        height = height_on_pixel(layout, view, across - dr.floor(across))
        origin, direction = rays_through(layout, view, row, column, along, height)
        return Look(origin, direction, light, scatter, free)

    found, first = sum_paths(for_rows(loaded, row), sky, bounces, look, inside, *counts)
    return found, first, address, inside


@dataclass
class _Pattern:
    """Directions of a row's first surfaces: an even sequence over :data:`_PATTERN` neighbouring bins.

    Kronecker sequences of the generalised golden ratio, in two dimensions for the directions of scattering and in
    eight for the rest (Roberts, *The unreasonable effectiveness of quasirandom sequences*, 2018), with a random
    start for each row and half; each number is moved at random by about as much as two of the sequence lie apart.

    Attributes
    ----------
    seed, row, half
        Address of the starts.
    place
        Number of each lane's bin within the pattern.
    """

    seed: int
    row: UInt32
    half: UInt32
    place: UInt32

    def __post_init__(self) -> None:
        draws = generator(self.seed, Stream.BACKGROUND, mi.UInt32(0xFFFFFFFF), self.row * 2 + self.half)
        self._starts = (draws.next_float32x4(), draws.next_float32x4())

    def light(self, number: UInt32, count: UInt32, shift: Vector4f) -> Vector4f:
        """Return numbers for the Sun's disc and for the Earth, of the ``number``-th of ``count`` looks of a bin."""
        at, share = self._among(number, count)
        width = dr.sqrt(share)
        return mi.Point4f(
            *(_at(at, _EIGHT[axis], self._starts[0][axis], shift[axis] * width) for axis in range(4))
        )

    def scatter(self, number: UInt32, count: UInt32, shift: Vector4f, draws: Vector4f) -> Vector4f:
        """Return numbers for the choice of a lobe, for the direction, and a free one, of a bin's ``count`` paths."""
        at, share = self._among(number, count)
        width, starts = dr.sqrt(share), self._starts[1]
        lobe = _at(at, _EIGHT[4], starts[0], draws[1] * share)
        x, y = (_at(at, _TWO[axis], starts[1 + axis], shift[axis] * width) for axis in range(2))
        return mi.Point4f(lobe, x, y, draws[2])

    def _among(self, number: UInt32, count: UInt32) -> tuple[UInt32, Float]:
        """Return which of all bins' sequence a bin's ``number``-th of ``count`` is, and 1 over its length."""
        return self.place * count + number, 1.0 / mi.Float(_PATTERN * count)


def _at(number: UInt32, step: int, start: Float, shift: Float) -> Float:
    """Return one coordinate of a member of the sequence, below 1."""
    at = mi.Float(number * mi.UInt32(step)) * 2.0**-32 + start + shift
    return dr.minimum(at - dr.floor(at), 1.0 - 2.0**-23)
