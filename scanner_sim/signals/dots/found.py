"""Dark blobs of a frame that may be dots: where, how large, and whether the frame ends there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from scanner_sim.signals.dots.settings import FrameCalibration

Array = NDArray[np.float64]

LARGEST = 81
"""Longest diameter of a dot that is looked for [pixel]: dark areas beyond are background."""
_SQUARES = (LARGEST, 41, 21, 11)
"""Sides of the squares that fill dark areas, from the largest [pixel]."""
_LEAST_AREA = 5
"""Pixels below half of the depth that a blob has at least."""
_OUTSTANDING = 6.0
"""Standard deviations by which a blob is darker than its surroundings."""
_DARKER = 0.25
"""Share of the surrounding light that a blob lacks at least."""
_UNEVEN_AREA = 0.35
"""Departure of a blob's area from that of the ellipse with its moments at which it is no dot."""
_RIM, _LIGHTER = 2, 0.8
"""Width of the rim about a blob [pixel], and the share of it that is lighter than half of the blob's depth."""
_ALIKE = 1.5
"""Ratio of mean half axes up to which what two closings find at one place is the same."""


@dataclass(frozen=True)
class Blobs:
    """Blobs of a frame.

    Attributes
    ----------
    centre
        (u, v) [pixel], shape (b, 2).
    shape
        (L_uu, L_uv, L_vv) of the ellipse of equal moments [pixel], shape (b, 3).
    light, contrast
        Number of the surrounding white above black [DN], and the share of it that the blob lacks, shape (b,).
    clipped
        Which of them reach the edge of the frame, shape (b,).
    """

    centre: Array
    shape: Array
    light: Array
    contrast: Array
    clipped: NDArray[np.bool_]


def find_blobs(frame: NDArray[np.generic], calibration: FrameCalibration) -> Blobs:
    """Return the dark blobs on a brighter ground of a frame, from top left to bottom right.

    Parameters
    ----------
    frame
        Digital numbers, shape (rows, columns).
    calibration
        What is believed of the sensor.

    Notes
    -----
    A grey closing (Serra, *Image Analysis and Mathematical Morphology*, 1982) fills what is darker than its
    surroundings and narrower than its square; what it adds, above noise and above a quarter of the light, is
    divided into connected areas. One square of :data:`LARGEST` would fill a plate before brighter ground together with
    its dots, so smaller ones follow. Areas that are far from filling the ellipse of their moments are left out: gaps,
    lines, corners. So are those of the smaller squares without light all round: they leave rims of a large dot.
    """
    numbers = np.asarray(frame, dtype=np.float64) - calibration.black
    smooth = ndimage.gaussian_filter(numbers, 0.7, mode="nearest")
    found: list[tuple[int, tuple[float, ...]]] = []
    for size in _SQUARES:
        white = ndimage.grey_closing(smooth, size=(size, size), mode="nearest")
        lacking = white - smooth
        noise = np.sqrt(calibration.variance(white))
        dark = lacking > np.maximum(_DARKER * white, _OUTSTANDING * noise)
        labels, count = ndimage.label(dark, structure=np.ones((3, 3)))
        before = np.array([blob for _, blob in found]).reshape(-1, 8)
        for number, box in enumerate(ndimage.find_objects(labels, count), start=1):
            mine = labels[box] == number
            if mine.sum() < _LEAST_AREA:
                continue
            blob = _blob(mine, box, lacking[box], white[box], smooth.shape)
            if blob is None or _is_among(blob, before):
                continue
            if size == LARGEST or _is_lighter_all_round(mine, box, smooth, blob):
                first = box[0].start * smooth.shape[1] + box[1].start + int(np.argmax(mine[0]))
                found.append((first, blob))
    values = np.array([blob for _, blob in sorted(found)], dtype=np.float64).reshape(-1, 8)
    return Blobs(values[:, :2], values[:, 2:5], values[:, 5], values[:, 6], values[:, 7] > 0.0)


def _is_among(blob: tuple[float, ...], others: Array) -> bool:
    """Tell whether a blob is the same dark area as one of those of larger squares, shape (b, 8)."""
    return bool(is_same(np.array([blob])[:, :5], others[:, :5]).any())


def is_same(some: Array, others: Array) -> NDArray[np.bool_]:
    """Tell which ellipses are as large as others and at their place, shape (a, b).

    ``some`` and ``others`` are (u, v, L_uu, L_uv, L_vv) [pixel], shapes (a, 5) and (b, 5).
    """
    own, other = (np.sqrt(np.maximum(one[:, 2] * one[:, 4] - one[:, 3] ** 2, 0.0)) for one in (some, others))
    away, ratio = np.linalg.norm(others[:, :2] - some[:, None, :2], axis=2), own[:, None] / other
    return np.asarray((away < 0.5 * other) & (ratio > 1.0 / _ALIKE) & (ratio < _ALIKE))


def _is_lighter_all_round(
    mine: NDArray[np.bool_], box: tuple[slice, slice], smooth: Array, blob: tuple[float, ...]
) -> bool:
    """Tell whether the pixels about an area are lighter than half of its depth."""
    rows, columns = box
    wide = (
        slice(max(rows.start - _RIM, 0), rows.stop + _RIM),
        slice(max(columns.start - _RIM, 0), columns.stop + _RIM),
    )
    about = smooth[wide]
    inside = np.zeros(about.shape, dtype=bool)
    inside[rows.start - wide[0].start :, columns.start - wide[1].start :][
        : mine.shape[0], : mine.shape[1]
    ] = mine
    rim = ndimage.binary_dilation(inside, np.ones((3, 3)), iterations=_RIM) & ~inside
    return bool(np.mean(about[rim] > blob[5] * (1.0 - 0.5 * blob[6])) > _LIGHTER) if rim.any() else False


def _blob(
    mine: NDArray[np.bool_], box: tuple[slice, slice], lacking: Array, white: Array, frame: tuple[int, ...]
) -> tuple[float, ...] | None:
    """Return (u, v, L_uu, L_uv, L_vv, light, contrast, clipped), or None for what is no ellipse."""
    half = mine & (lacking > 0.5 * np.max(lacking, where=mine, initial=0.0))
    area = float(half.sum())
    v, u = np.nonzero(half)
    middle = np.array([u.mean(), v.mean()])
    # The moments of the pixels' own squares keep a row of pixels from having no width.
    spread = np.cov(np.stack([u, v]).astype(np.float64), bias=True).reshape(2, 2) + np.eye(2) / 12.0
    root = np.sqrt(max(float(spread[0, 0] * spread[1, 1] - spread[0, 1] ** 2), 0.0))
    if area < _LEAST_AREA or abs(area / (4.0 * np.pi * root) - 1.0) > _UNEVEN_AREA:
        return None
    # √ of a symmetric 2 × 2 matrix: (M + √det 1)/√(trace + 2√det).
    shape = 2.0 * (spread + root * np.eye(2)) / np.sqrt(np.trace(spread) + 2.0 * root)
    rows, columns = box
    outside = rows.start == 0 or columns.start == 0 or rows.stop == frame[0] or columns.stop == frame[1]
    light = float(np.median(white[mine]))
    depth = float(np.max(lacking[mine])) / max(light, 1e-300)
    return (
        float(middle[0] + columns.start), float(middle[1] + rows.start),
        float(shape[0, 0]), float(shape[0, 1]), float(shape[1, 1]), light, min(depth, 1.0), float(outside),
    )  # fmt: skip
