"""Light that a lens strews over the frame: a veil about every bright point, and a ghost of it.

The kernel is stated, not derived: of the light of a point, the share ``veil`` goes into
K(r) = (1 + (r/w)²)^(−3/2) / (2π w²), whose integral over the plane is 1, and which falls off with the cube of the
distance as the scatter of polished and dusty lenses does (Harvey, *Understanding surface scatter*, SPIE Press 2019, ch.
4); the share ``ghost`` into an image of the point mirrored in the lens's axis, as pairs of surfaces reflect it. The Sun
beside the frame strews light into it by the same law; other light from beside the frame does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import map_coordinates

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Number, Part
from scanner_sim.foundation.units import Ratio

Array = NDArray[np.float64]


class Glare(Part):
    """Strewn light of a lens; all assumed."""

    veil: Ratio = Field(default=0.01, ge=0.0, le=0.5)
    """Share of the light that is strewn about its image."""
    width: Number = Field(default=2.0, ge=1.0, le=100.0)
    """Width w of the core of the strewn light, in pixels."""
    ghost: Ratio = Field(default=1e-4, ge=0.0, le=0.1)
    """Share of the light that makes a second image, mirrored in the lens's axis."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield shares that leave no image."""
        if self.veil + self.ghost >= 0.5:
            yield Fault("ghost", "veil and ghost together take half of the light.", "Reduce one of them.")


class PointLight(NamedTuple):
    """Light of a point beside the frame: where its image (u, v) would be [pixel], and how much it is."""

    pixel: tuple[float, float]
    rate: float


def strewn(glare: Glare, rate: Array, centre: tuple[float, float], beside: PointLight | None = None) -> Array:
    """Return what the lens makes of an ideal image, both in any unit of light.

    Parameters
    ----------
    glare
        The lens.
    rate
        Light of pixels, shape (rows, columns).
    centre
        Pixel (u, v) of the lens's axis.
    beside
        The Sun, where it shines onto the lens from beside the frame.
    """
    found = (1.0 - glare.veil - glare.ghost) * rate
    rows, columns = rate.shape
    if glare.veil > 0.0:
        found += glare.veil * np.maximum(_veiled(rate, glare), 0.0)
    if glare.ghost > 0.0:
        v, u = np.meshgrid(
            2.0 * centre[1] - np.arange(rows), 2.0 * centre[0] - np.arange(columns), indexing="ij"
        )
        found += glare.ghost * map_coordinates(rate, [v, u], order=1, mode="constant")
    if beside is not None:
        v, u = np.ogrid[:rows, :columns]
        found += glare.veil * beside.rate * veil_at(glare, np.hypot(u - beside.pixel[0], v - beside.pixel[1]))
    return found


def veil_at(glare: Glare, distance: Array) -> Array:
    """Return the share of strewn light that falls onto a pixel at a distance [pixel], K of the module."""
    return np.asarray((1.0 + np.square(distance / glare.width)) ** -1.5 / (2.0 * np.pi * glare.width**2))


def _veiled(image: Array, glare: Glare) -> Array:
    """Return the convolution of an image with K, in its shape."""
    rows, columns = image.shape
    shape, kernel = _transform(glare, rows, columns)
    whole = scipy.fft.irfft2(scipy.fft.rfft2(image, shape) * kernel, shape)
    return np.asarray(whole[rows - 1 : 2 * rows - 1, columns - 1 : 2 * columns - 1])


@lru_cache(maxsize=2)
def _transform(glare: Glare, rows: int, columns: int) -> tuple[tuple[int, int], NDArray[np.complex128]]:
    """Return the size in which images of so many pixels are transformed, and the transform of K in it.

    What goes round an end lands in pixels that are cut off: an image and K reach over 3n − 2 pixels, and of these the
    middle n are wanted.
    """
    y, x = np.ogrid[-(rows - 1) : rows, -(columns - 1) : columns]
    shape = tuple(scipy.fft.next_fast_len(2 * size - 1, real=True) for size in (rows, columns))
    return (shape[0], shape[1]), scipy.fft.rfft2(veil_at(glare, np.hypot(x, y)), shape)
