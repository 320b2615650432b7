"""The judge of dots in a camera's frames: images by area, bounds by differences, a circle's centre by its cone.

Images are made of areas: points of the disc, each a Gaussian spread integrated over pixels, added up by Gauss and
Legendre's rule along the radius and equal steps round it. The bound is that of Cramér and Rao for pixels with Poisson
and read noise (Kay, *Fundamentals of Statistical Signal Processing*, 1993, eq 3.31), with derivatives by differences.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erf

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DotScene:
    """A dark ellipse on lit white, as a sensor sees it.

    ``u``, ``v`` of its centre from that of the middle pixel, half axes ``a``, ``b`` and ``angle`` of the first from u
    towards v, standard deviation ``blur`` [pixel]; ``light`` of white [electron] with its slopes ``rise_u``, ``rise_v``
    [electron/pixel]; ``contrast``; ``noise`` of a dark pixel [electron].
    """

    u: float
    v: float
    a: float
    b: float
    angle: float
    blur: float
    light: float
    rise_u: float
    rise_v: float
    contrast: float
    noise: float


def dot_image(scene: DotScene, half: int) -> Array:
    """Return the mean electrons of (2 half + 1)² pixels, rows along v."""
    finest = min(scene.blur, 1.0)
    nodes, sums = np.polynomial.legendre.leggauss(max(12, int(2.0 * scene.a / finest)))
    radii, weights = 0.5 * (nodes + 1.0), 0.5 * sums
    turns = max(48, int(9.0 * scene.a / finest))
    angle = 2.0 * np.pi * (np.arange(turns) + 0.5) / turns
    x, y = scene.a * radii[:, None] * np.cos(angle), scene.b * radii[:, None] * np.sin(angle)
    area = np.broadcast_to((weights * radii)[:, None], x.shape) * scene.a * scene.b * 2.0 * np.pi / turns
    cos, sin = np.cos(scene.angle), np.sin(scene.angle)
    pixels: Array = np.arange(-half, half + 1.0)
    across = _into_pixels(pixels, (scene.u + x * cos - y * sin).ravel(), scene.blur)
    down = _into_pixels(pixels, (scene.v + x * sin + y * cos).ravel(), scene.blur)
    share = (down * area.ravel()) @ across.T
    light: Array = scene.light + scene.rise_u * pixels + scene.rise_v * pixels[:, None]
    return light * (1.0 - scene.contrast * share)


def centre_bound(scene: DotScene, half: int) -> Array:
    """Return the least covariance of (u, v) [pixel²] of an unbiased estimator, shape (2, 2).

    Light, its slopes, contrast, half axes and angle are unknown, too; the pixels are a square of 2 half + 1.
    """
    steps = {"u": 1e-4, "v": 1e-4, "a": 1e-4, "b": 1e-4, "light": 1e-3 * scene.light, "contrast": 1e-4}
    steps |= {"rise_u": 1e-6 * scene.light, "rise_v": 1e-6 * scene.light}
    if scene.a / scene.b > 1.01:
        steps["angle"] = 1e-4
    mean = dot_image(scene, half)
    rows = []
    for name, step in steps.items():
        ends = [
            dot_image(replace(scene, **{name: getattr(scene, name) + way * step}), half) for way in (1, -1)
        ]
        rows.append(((ends[0] - ends[1]) / (2.0 * step)).ravel())
    slopes = np.array(rows)
    information = (slopes / (mean + scene.noise**2).ravel()) @ slopes.T
    bound: Array = np.asarray(np.linalg.inv(information)[:2, :2], dtype=np.float64)
    return bound


def circle_image_centre(centre: ArrayLike, normal: ArrayLike, radius: float) -> Array:
    """Return (x/z, y/z) of the middle of a circle's image by a pinhole.

    The circle is x = c + r (e₁ cos s + e₂ sin s); with H = (r e₁, r e₂, c) its image is the conic
    H⁻ᵀ diag(1, 1, −1) H⁻¹, and the middle of a conic is the pole of the line at infinity, its inverse times (0, 0, 1)
    (Hartley and Zisserman, *Multiple View Geometry*, 2004, section 8.3).
    """
    n = np.asarray(normal, dtype=np.float64)
    first = np.cross(n, [0.3, -0.5, 0.8])
    first /= np.linalg.norm(first)
    H = np.column_stack([radius * first, radius * np.cross(n / np.linalg.norm(n), first), centre])
    pole = H @ np.diag([1.0, 1.0, -1.0]) @ H.T @ np.array([0.0, 0.0, 1.0])
    return np.asarray(pole[:2] / pole[2])


def _into_pixels(pixels: Array, at: Array, blur: float) -> Array:
    """Return the shares of points at ``at`` that fall into pixels, shape (pixels, points)."""
    ends = (pixels[:, None] - at) / (np.sqrt(2.0) * blur)
    edge = 0.5 / (np.sqrt(2.0) * blur)
    return np.asarray(0.5 * (erf(ends + edge) - erf(ends - edge)))
