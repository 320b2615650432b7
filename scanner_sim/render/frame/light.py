"""The radiance that arrives in the pixels of frames, by path tracing, pixel by pixel and with its own error.

The paths are those of :mod:`scanner_sim.render.background.paths`, which the scanner's background is made of. A pixel's
samples are stratified in four things, each in strata of its own order: the place in the pixel's footprint, the
point of the Sun's disc, that of the Earth, and the moment of the exposure (Pharr, Jakob and Humphreys, *Physically
based rendering*, 3rd ed., ch. 7). Pixels are added up in a fixed order: a Mitsuba film adds with atomic operations, in
an order that no run repeats. Where brightness or material changes among the samples of a pixel or of its
neighbours, the pixel is sampled again, finer. Light of less than one sample of a pixel and of its neighbours is
missed: feet of a blurred edge, 0.5 % of its contrast at 16 samples and a point spread of a pixel, nothing at a third.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Float, UInt32, Vector3f, Vector4f
from scanner_sim.foundation.streams import Stream
from scanner_sim.render.background.paths import FirstHit, trace_paths
from scanner_sim.render.background.sky import SkyLight
from scanner_sim.render.frame.lens_table import LensTable
from scanner_sim.render.garbage import garbage_waits
from scanner_sim.render.rays import pose_scene, take_poses
from scanner_sim.scene.files.loader import LoadedScene, Pose

_PATHS_AT_ONCE = 2**20
_DRAWS = 64
"""Addresses of a path: two for each of up to sixteen surfaces, and those of its strata."""
_PLACES, _MOMENTS = _DRAWS - 1, _DRAWS - 2
_NORMALS = 16
"""Steps of a normal's components from 0 to 1 by which faces are told apart."""
_SUN, _EARTH, _TIME = range(3)
"""Orders of the strata beside that of the places: each pixel has three permutations of its own."""
_CONTRAST = 0.1
"""Range of a pixel's samples, over its own mean and that of its frame together, beyond which there is an edge in it."""


@dataclass(frozen=True)
class FrameView:
    """What is seen by frames, on the device.

    Attributes
    ----------
    lens
        Where pixels look, in the camera's frame.
    footprint
        Quantiles of a pixel's footprint, :func:`~scanner_sim.render.frame.footprint.footprint_quantiles`.
    shape
        Rows and columns.
    camera
        Poses of the camera in the scanner's frame, one for each frame.
    bodies
        Poses of the scene's moving objects, ``moments`` for each frame, evenly through its exposure.
    moments
        How many these are.
    """

    lens: LensTable
    footprint: Float
    shape: tuple[int, int]
    camera: Pose
    bodies: tuple[Pose, ...]
    moments: int


@dataclass(frozen=True)
class FrameLight:
    """Light of frames, per unit of the Sun's irradiance.

    Attributes
    ----------
    radiance
        Mean over the footprint and the exposure [1/sr], shape (frames, rows, columns), float32.
    variance
        Of that by the finite number of samples [1/sr²], an estimate from neighbouring strata, rather too large than too
        small.
    """

    radiance: NDArray[np.float32]
    variance: NDArray[np.float32]


def frame_light(tracer: FrameTracer, samples: tuple[int, int]) -> FrameLight:
    """Return the light on all pixels of frames.

    Parameters
    ----------
    tracer
        Who follows paths to their pixels.
    samples
        Paths of a pixel, and of one with an edge, each a power of four.
    """
    shape = (tracer.frames, *tracer.shape)
    plain = np.arange(shape[0] * shape[1] * shape[2], dtype=np.uint32)
    found = tracer.trace(plain, samples[0])
    radiance, variance, *ends = (part.reshape(shape) for part in found)
    if samples[1] > samples[0]:
        near = edges(radiance, *ends)
        finer = np.flatnonzero(near).astype(np.uint32)
        for values, better in zip((radiance, variance), tracer.trace(finer, samples[1]), strict=False):
            values.reshape(-1)[finer] = better
    return FrameLight(radiance, variance)


def edges(
    radiance: NDArray[np.float32],
    dark: NDArray[np.float32],
    bright: NDArray[np.float32],
    one: NDArray[np.float32],
    other: NDArray[np.float32],
) -> NDArray[np.bool_]:
    """Return which pixels have an edge in them or beside them: by least and largest radiance and material of each."""

    def step(low: NDArray[np.float32], high: NDArray[np.float32]) -> NDArray[np.float32]:
        size = (1, 3, 3)
        return np.asarray(
            maximum_filter(high, size, mode="nearest") - minimum_filter(low, size, mode="nearest")
        )

    level = radiance + radiance.mean(axis=(1, 2), keepdims=True)
    return np.asarray((step(dark, bright) > _CONTRAST * level) | (step(one, other) > 0.0))


class FrameTracer:
    """Follows light to pixels, which are numbered through all frames.

    Parameters
    ----------
    loaded
        The scene in visible light.
    sky
        Sun and Earth.
    view
        What the frames see.
    first
        Number of the first frame: random numbers are addressed by it.
    bounces
        Largest number of surfaces on a path.
    seed
        Seed of the paths.
    """

    def __init__(
        self, loaded: LoadedScene, sky: SkyLight, view: FrameView, first: int, bounces: int, seed: int
    ) -> None:
        self._loaded, self._sky, self._view = loaded, sky, view
        self.frames, self.shape = dr.width(view.camera.position), view.shape
        self._bounces, self._seed = bounces, seed
        self._before = dr.opaque(mi.UInt32, (first * view.shape[0] * view.shape[1]) & 0xFFFFFFFF)
        self._columns = dr.opaque(mi.UInt32, view.shape[1])
        self._pixels = dr.opaque(mi.UInt32, view.shape[0] * view.shape[1])
        self._nodes = dr.opaque(mi.Float, dr.width(view.footprint) - 1.0)

    def trace(
        self, pixels: NDArray[np.uint32], samples: int, *, apart: bool = False
    ) -> tuple[NDArray[Any], ...]:
        """Return radiance, its variance, and the ends of radiance and material, of pixels by their numbers, (n,).

        Parameters
        ----------
        pixels, samples
            Which, and how many paths of each.
        apart
            Whether the slow part of the light, :attr:`~scanner_sim.render.background.paths.Radiance.indirect`, is left
            out of the radiance and stands after the rest for each path on its own, with the number of the face that
            the path meets first: shapes (n · samples,).
        """
        batch = max(1, _PATHS_AT_ONCE // samples)
        parts = [
            self._traced(mi.UInt32(for_device(pixels[start : start + batch], np.uint32)), samples, apart)
            for start in range(0, len(pixels), batch)
        ]
        empty = (np.empty(0, np.float32),) * (8 if apart else 6)
        return tuple(np.concatenate(part) for part in zip(empty, *parts, strict=True))

    @garbage_waits()
    def _traced(self, pixels: UInt32, samples: int, apart: bool) -> tuple[NDArray[Any], ...]:
        lane = dr.arange(mi.UInt32, dr.width(pixels) * samples)
        which = lane // dr.opaque(mi.UInt32, samples)
        number, sample = dr.gather(mi.UInt32, pixels, which), lane - which * dr.opaque(mi.UInt32, samples)
        frame = number // self._pixels
        strata = _Strata(self._seed, number + self._before, sample, samples)
        scene, origin, direction = self._rays(number, frame, strata)
        found, met = trace_paths(scene, self._sky, self._bounces, origin, direction, strata.draw)
        if not apart:
            return _summed(found.direct + found.indirect, found.direct, met, samples)
        slow, face = found.indirect, _face_of(met)
        dr.schedule(slow, face)
        return (*_summed(found.direct, found.direct, met, samples), slow.numpy(), face.numpy())

    def _rays(self, number: UInt32, frame: UInt32, strata: _Strata) -> tuple[LoadedScene, Vector3f, Vector3f]:
        """Return the scene at the moments of rays, their origins and directions."""
        view = self._view
        within = number - frame * self._pixels
        row = within // self._columns
        place = strata.place()
        u, v = (_quantile(view.footprint, self._nodes, share) for share in (place.x, place.y))
        seen = view.lens.directions(mi.Int32(within - row * self._columns), mi.Int32(row), u, v)
        camera = view.camera.take(frame)
        scene = self._loaded
        if view.bodies:
            moment = dr.opaque(mi.UInt32, view.moments) * frame + strata.moment(view.moments)
            scene = pose_scene(scene, take_poses(view.bodies, moment))
        return scene, mi.Point3f(camera.position), dr.normalize(camera.rotation @ seen)


class _Strata:
    """Random numbers of samples, in strata of their pixel."""

    def __init__(self, seed: int, number: UInt32, sample: UInt32, samples: int) -> None:
        self._seed, self._number, self._sample = seed, number, sample
        # Those of a pixel that is sampled again are others than those that said so.
        self._address = (sample + samples) * _DRAWS
        self._count, self._side = samples, dr.opaque(mi.UInt32, round(samples**0.5))
        self._orders = generator(seed, Stream.FRAME_STRATA, number, mi.UInt32(samples)).next_uint32x4()

    def draw(self, number: UInt32) -> Vector4f:
        """Return four random numbers of a draw; those of the first choose points of Sun and Earth, in strata."""
        drawn = self._drawn(number)
        first = number == 0
        sun, earth = (self._in_cell(self._ordered(axis), drawn, 2 * axis) for axis in (_SUN, _EARTH))
        return mi.Vector4f(
            dr.select(first, sun.x, drawn[0]),
            dr.select(first, sun.y, drawn[1]),
            dr.select(first, earth.x, drawn[2]),
            dr.select(first, earth.y, drawn[3]),
        )

    def place(self) -> mi.Point2f:
        """Return places in the unit square, one in each cell of a grid."""
        return self._in_cell(self._sample, self._drawn(mi.UInt32(_PLACES)), 0)

    def moment(self, moments: int) -> UInt32:
        """Return which of the moments of an exposure each sample has, one in each stratum of them."""
        jitter = self._drawn(mi.UInt32(_MOMENTS))[0]
        share = (mi.Float(self._ordered(_TIME)) + jitter) / self._count
        last = dr.opaque(mi.UInt32, moments - 1)
        return dr.minimum(mi.UInt32(share * (mi.Float(last) + 1.0)), last)

    def _drawn(self, number: UInt32) -> Vector4f:
        return generator(
            self._seed, Stream.FRAME_LIGHT, self._number, self._address + number
        ).next_float32x4()

    def _ordered(self, axis: int) -> UInt32:
        return mi.permute(self._sample, self._count, self._orders[axis])

    def _in_cell(self, cell: UInt32, drawn: Vector4f, start: int) -> mi.Point2f:
        row = cell // self._side
        over = dr.rcp(mi.Float(self._side))
        return mi.Point2f(
            (mi.Float(cell - row * self._side) + drawn[start]) * over,
            (mi.Float(row) + drawn[start + 1]) * over,
        )


def _quantile(table: Float, nodes: Float, share: Float) -> Float:
    """Return the place at a share of the footprint's light."""
    at = share * nodes
    below = mi.UInt32(dr.minimum(at, nodes - 1.0))
    low, high = dr.gather(mi.Float, table, below), dr.gather(mi.Float, table, below + 1)
    return dr.lerp(low, high, at - mi.Float(below))


def _face_of(met: FirstHit) -> UInt32:
    """Return a number for material and direction of surfaces; those of one flat face have one, and few others do."""
    number = met.material
    for part in (met.normal.x, met.normal.y, met.normal.z):
        number = number * dr.opaque(mi.UInt32, 2 * _NORMALS + 1) + mi.UInt32(
            dr.round(_NORMALS * part) + _NORMALS
        )
    return number


def _summed(radiance: Float, sharp: Float, met: FirstHit, samples: int) -> tuple[NDArray[Any], ...]:
    """Return mean, its variance, least and largest sharp radiance, least and largest material, of blocks of samples."""
    mean = dr.block_sum(radiance, samples) / samples
    # Of two by two cells the twist: its square is on average the sum of their variances, and more where their means
    # are twisted. A slope, and an edge along rows or columns, is not.
    side = dr.opaque(mi.UInt32, round(samples**0.5))
    block = dr.arange(mi.UInt32, dr.width(radiance) // 4)
    half = side // 2
    first = 2 * (block // half * side + block % half)
    upper, lower = (
        dr.gather(mi.Float, radiance, at) - dr.gather(mi.Float, radiance, at + 1)
        for at in (first, first + side)
    )
    variance = dr.block_sum(dr.square(upper - lower), samples // 4) / float(samples) ** 2

    def extremes(values: Float) -> tuple[Float, Float]:
        least = dr.block_reduce(dr.ReduceOp.Min, values, samples)
        return least, dr.block_reduce(dr.ReduceOp.Max, values, samples)

    parts = (mean, variance, *extremes(sharp), *extremes(mi.Float(met.material)))
    dr.eval(parts)
    return tuple(part.numpy() for part in parts)
