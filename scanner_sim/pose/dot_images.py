"""Where a camera images surveyed dots: their ellipses, whose centres are not the images of the discs' centres.

A disc in perspective is an ellipse, and its middle lies off the image of the disc's centre by about f r² sinτ cosτ/z²
with τ the disc's tilt (Heikkilä, *IEEE Trans. PAMI* 22, 2000, 1066, eqs 12 to 15). What distortion adds is in the
outline here: points of the rim are imaged one by one, and an ellipse is fitted to them as to an edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import solve_linear
from scanner_sim.optics.interior_orientation import InteriorOrientation

Array = NDArray[np.float64]

_RIM = 24
"""Points of a rim: its image by a lens has no finer parts."""


@dataclass(frozen=True)
class DotArray:
    """Surveyed dots of an object.

    Attributes
    ----------
    names
        Of the n targets.
    points, normals
        Centres [m] and the unit vectors out of the faces, along the object's axes, shape (n, 3).
    radii
        [m], shape (n,).
    """

    names: tuple[str, ...]
    points: Array
    normals: Array
    radii: Array


@dataclass(frozen=True)
class DotImages:
    """Images of n dots at poses with leading axes (...); NaN where the camera has no image.

    Attributes
    ----------
    centre
        Where the discs' centres are imaged [pixel], shape (..., n, 2).
    ellipse
        Centres of the ellipses that the discs become [pixel], shape (..., n, 2).
    half_axes
        Longer and shorter half axis [pixel], shape (..., n, 2).
    facing
        Cosine of the angle between the line of sight and the normal, positive for a disc that is seen, shape (..., n).
    """

    centre: Array
    ellipse: Array
    half_axes: Array
    facing: Array


def dot_images(camera: InteriorOrientation, dots: DotArray, rotation: Array, position: Array) -> DotImages:
    """Return the images of dots at poses ``camera_from_object`` (..., 3, 3) and (..., 3) [m]."""
    turned = np.einsum("...ij,nj->...ni", rotation, dots.points)
    placed, normals = turned + position[..., None, :], np.einsum("...ij,nj->...ni", rotation, dots.normals)
    distance = np.sqrt(np.sum(placed * placed, axis=-1))
    facing = -np.sum(placed * normals, axis=-1) / distance
    along, across = _plane_axes(dots.normals)
    angle = 2.0 * np.pi / _RIM * np.arange(_RIM)
    rim = dots.radii[:, None, None] * (
        np.cos(angle)[:, None] * along[:, None] + np.sin(angle)[:, None] * across[:, None]
    )
    outline = camera.project(placed[..., None, :] + np.einsum("...ij,nkj->...nki", rotation, rim))
    centre, half_axes = _ellipse(outline)
    return DotImages(camera.project(placed), centre, half_axes, facing)


def _plane_axes(normals: Array) -> tuple[Array, Array]:
    """Return two unit vectors (n, 3) at right angles to unit vectors (n, 3) and to each other."""
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    along = np.cross(normals, least)
    along /= np.sqrt(np.sum(along * along, axis=1, keepdims=True))
    return along, np.cross(normals, along)


def _ellipse(outline: Array) -> tuple[Array, Array]:
    """Return centres (..., 2) and half axes (..., 2) of ellipses nearest to closed outlines (..., k, 2).

    Of the conics a x² + b xy + c y² + d x + e y = 1 that with the least ∮ F²/|∇F|² dl, Sampson's distance (*Computer
    Graphics and Image Processing* 18, 1982, 97), which is the exact one where the outline is a conic. The second fit
    has the weights of the first.
    """
    middle = outline.mean(axis=-2, keepdims=True)
    about = outline - middle
    size = np.sqrt(np.mean(np.sum(about * about, axis=-1), axis=-1))[..., None, None]
    x, y = np.moveaxis(about / size, -1, 0)
    design = np.stack([x * x, x * y, y * y, x, y], axis=-1)
    step = np.roll(about, -1, axis=-2) - np.roll(about, 1, axis=-2)
    length = np.sqrt(np.sum(step * step, axis=-1))
    weight = length
    for _ in range(2):
        weighted = design * weight[..., None]
        normal = np.einsum("...ka,...kb->...ab", weighted, design)
        right = np.sum(weighted, axis=-2)[..., None]
        a, b, c, d, e = np.moveaxis(solve_linear(normal, right)[..., 0], -1, 0)
        slope = (2.0 * a[..., None] * x + b[..., None] * y + d[..., None]) ** 2
        slope = slope + (b[..., None] * x + 2.0 * c[..., None] * y + e[..., None]) ** 2
        weight = length / slope
    determinant = 4.0 * a * c - b * b
    centre = np.stack([b * e - 2.0 * c * d, b * d - 2.0 * a * e], axis=-1) / determinant[..., None]
    value = 1.0 + (c * d * d - b * d * e + a * e * e) / determinant
    mean, apart = 0.5 * (a + c), np.hypot(0.5 * (a - c), 0.5 * b)
    half_axes = np.sqrt(value[..., None] / np.stack([mean - apart, mean + apart], axis=-1))
    return middle[..., 0, :] + size[..., 0] * centre, size[..., 0] * half_axes
