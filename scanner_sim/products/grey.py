"""Ranges in grey levels, dot by dot."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def range_levels(r: NDArray[np.float64], nearest: float, farthest: float) -> NDArray[np.uint8]:
    """Return ranges as grey levels: 255 at ``nearest``, 40 at ``farthest``, 0 where there is none.

    Parameters
    ----------
    r
        Ranges [m], shape (rows, columns), NaN without one.
    nearest, farthest
        Ends of the scale [m], nearest below farthest; what lies beyond is cut off.
    """
    share = np.clip((farthest - r) / (farthest - nearest), 0.0, 1.0)
    return np.where(np.isfinite(r), np.rint(40.0 + 215.0 * np.nan_to_num(share)), 0.0).astype(np.uint8)


def grey_levels(values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return values as :func:`range_levels`, on a scale that leaves out the outermost half per cent at either end."""
    known = values[np.isfinite(values)].astype(np.float64)
    nearest, farthest = np.percentile(known, (0.5, 99.5)) if known.size else (0.0, 1.0)
    return range_levels(values.astype(np.float64), nearest, max(farthest, nearest + 1e-3))


def thumbnail(values: NDArray[np.float32], most: int) -> bytes:
    """Return values in grey levels as PNG, with voxels left out evenly so that no side has more than ``most`` dots."""
    every = -(-max(values.shape) // most)
    stream = io.BytesIO()
    Image.fromarray(grey_levels(values[::every, ::every])).save(stream, format="png")
    return stream.getvalue()
