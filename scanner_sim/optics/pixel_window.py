"""A window of a frame: the pixels that somebody looks at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class PixelWindow(NamedTuple):
    """Rows from ``top`` and columns from ``left`` up to, and without, ``bottom`` and ``right``."""

    top: int
    bottom: int
    left: int
    right: int

    @classmethod
    def about(cls, pixels: NDArray[np.float64], margin: float, shape: tuple[int, int]) -> PixelWindow | None:
        """Return the window about pixels (u, v), shape (n, 2), with a margin, in a frame of rows and columns.

        None where it holds no pixel of the frame, or where one of them is NaN.
        """
        if not np.isfinite(pixels).all():
            return None
        size = np.array(shape[::-1])
        first = np.clip(np.floor(pixels.min(axis=0) - margin), 0, size).astype(np.int64)
        last = np.clip(np.ceil(pixels.max(axis=0) + margin) + 1, 0, size).astype(np.int64)
        if (first >= last).any():
            return None
        return cls(int(first[1]), int(last[1]), int(first[0]), int(last[0]))

    @property
    def where(self) -> tuple[slice, slice]:
        """Its rows and columns, as an index of the frame."""
        return slice(self.top, self.bottom), slice(self.left, self.right)


NOWHERE = PixelWindow(0, 0, 0, 0)
"""A window without pixels."""
