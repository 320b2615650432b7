"""The radiance that arrives in a window of a frame, which somebody looks at, and roughly in the rest of it.

Beyond the window one pixel of each block is followed and stands for the block: enough for the light that the lens
strews from there into the window, for what blooms, and for the level of the frame.

Within it the light of the Sun upon the first surface is that of :mod:`scanner_sim.render.frame.light`. The rest, what
comes from the Earth or met more surfaces, varies slowly over a flat face but is found by rare paths. There it is a mean
over the pixels about: with f the share of a face in a pixel, the pixel has f times the mean over all paths nearby that
met the same face. This is the scanner's own division of its background (:mod:`scanner_sim.render.background.paths`). A
shadow of the Earth's light, or a patch of reflected sunlight, is thus blurred by :data:`REACH` pixels on each side.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from scanner_sim.optics.pixel_window import PixelWindow
from scanner_sim.render.frame.light import FrameLight, FrameTracer, edges

Array = NDArray[np.float64]

COARSE = 4
"""Rows and columns of the pixels that one stands for beyond the window."""
COARSE_SAMPLES = 4
"""Paths of each of these."""
REACH = 24
"""Pixels to each side over which the slow light of a face is a mean."""
_LARGE = 200
"""Pixels of a face from which on its light is."""


def window_light(tracer: FrameTracer, samples: tuple[int, int], window: PixelWindow) -> FrameLight:
    """Return the light on the pixels of one frame.

    Parameters
    ----------
    tracer
        Who follows paths to its pixels.
    samples
        Paths of a pixel in the window, and of one with an edge, each a power of four.
    window
        The window. Where it is empty, all is rough.

    Returns
    -------
    FrameLight
        The variance is that of single pixels, infinite beyond the window. Errors of the slow light are common to the
        pixels of a face within :data:`REACH`.
    """
    shape = tracer.shape
    number = np.arange(shape[0] * shape[1], dtype=np.uint32).reshape(shape)
    rough = _coarse(tracer, number)
    rough[1][:] = np.inf
    inside = number[window.where]
    if not inside.size:
        return FrameLight(rough[0][None], rough[1][None])
    traced = tracer.trace(inside.ravel(), samples[0], apart=True)
    faces = _Faces(_Paths(*traced[6:]), inside.shape)
    everywhere = np.arange(inside.size)
    radiance, variance = _whole(traced, faces, everywhere)
    ends = [part.reshape(1, *inside.shape) for part in (radiance, *traced[2:6])]
    finer = np.flatnonzero(edges(*ends)) if samples[1] > samples[0] else everywhere[:0]
    if finer.size:
        again = tracer.trace(inside.ravel()[finer], samples[1], apart=True)
        radiance[finer], variance[finer] = _whole(again, faces, finer)
    for values, own in zip(rough, (radiance, variance), strict=False):
        values[window.where] = own.reshape(inside.shape)
    return FrameLight(rough[0][None], rough[1][None])


def _coarse(tracer: FrameTracer, number: NDArray[np.uint32]) -> list[NDArray[np.float32]]:
    """Return radiance and its variance of pixels (rows, columns), each that of the pixel in the middle of its block."""
    middles = number[COARSE // 2 :: COARSE, COARSE // 2 :: COARSE]
    rows, columns = (
        np.minimum(np.arange(size) // COARSE, count - 1)
        for size, count in zip(number.shape, middles.shape, strict=True)
    )
    parts = tracer.trace(middles.ravel(), COARSE_SAMPLES)[:2]
    return [part.reshape(middles.shape)[np.ix_(rows, columns)] for part in parts]


def _whole(
    traced: tuple[NDArray[Any], ...], faces: _Faces, pixels: NDArray[np.intp]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return radiance and variance of pixels of the window, (n,), from what was traced of them.

    At the edge of a face the same paths say what share of it a pixel has in the Sun's light and in the slow light:
    their standard deviations add up.
    """
    slow, by_share, doubt = faces.light(_Paths(*traced[6:]), pixels)
    variance = (np.sqrt(traced[1]) + np.sqrt(by_share)) ** 2 + doubt
    return traced[0] + slow.astype(np.float32), variance.astype(np.float32)


class _Paths(NamedTuple):
    """Slow light of each path and the face that it met, pixel after pixel, shape (n · samples,)."""

    slow: NDArray[np.float32]
    face: NDArray[np.uint32]


class _Faces:
    """The slow light of the large faces of a window, as a mean about each of its pixels."""

    def __init__(self, paths: _Paths, shape: tuple[int, ...]) -> None:
        samples = len(paths.face) // (shape[0] * shape[1])
        known, counts = np.unique(paths.face[::samples], return_counts=True)
        self._large = known[counts >= _LARGE]
        self._mean, self._doubt = np.empty((2, len(self._large), shape[0] * shape[1]))
        for number, face in enumerate(self._large):
            there = paths.face == face
            light = np.where(there, paths.slow, 0.0)
            count, first, second = (
                uniform_filter(
                    values.reshape(*shape, samples).sum(axis=2), 2 * REACH + 1, mode="constant"
                ).ravel()
                * (2 * REACH + 1) ** 2
                for values in (there.astype(np.float64), light, light * light)
            )
            count = np.maximum(count, 1.0)
            self._mean[number] = first / count
            self._doubt[number] = np.maximum(second / count - (first / count) ** 2, 0.0) / count

    def light(self, paths: _Paths, pixels: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Return the slow light of pixels of the window by their place in it, (n,), and its variance in two parts.

        The first is that of the shares that faces have in a pixel, found by its paths, and of faces that are not large;
        the second that of the means.
        """
        samples = len(paths.face) // len(pixels)
        own_face = paths.face.reshape(-1, samples)
        value: Array = paths.slow.astype(np.float64).reshape(-1, samples)
        variance = np.zeros(len(pixels))
        for face, mean, doubt in zip(self._large, self._mean, self._doubt, strict=True):
            there = own_face == face
            value = np.where(there, mean[pixels, None], value)
            variance += there.mean(axis=1) ** 2 * doubt[pixels]
        return value.mean(axis=1), _variance_of_mean(value), variance


def _variance_of_mean(values: Array) -> Array:
    """Return the variance (n,) of the means of values (n, samples) in strata of place, by the twist of 2 × 2 of them.

    As for all light, see :mod:`scanner_sim.render.frame.light`.
    """
    count = values.shape[1]
    half = round(count**0.5) // 2
    (a, b), (c, d) = np.moveaxis(values.reshape(-1, half, 2, half, 2), (2, 4), (0, 1))
    return np.asarray(np.sum((a - b - c + d) ** 2, axis=(1, 2)) / count**2)
