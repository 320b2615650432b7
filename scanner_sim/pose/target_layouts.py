"""Arrays of targets on an object: layouts to compare.

Their planes are z = 0 of the object, whose z axis points away from the scanner, and the means of the targets there are
its origin; ``size`` is the side of the square into which a layout fits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Layout:
    """An array of targets.

    ``name`` of the layout, its ``size`` [m] and the ``points`` along the object's axes [m], shape (n, 3).
    """

    name: str
    size: float
    points: Array


def square(size: float, across: int = 2) -> Layout:
    """Return across × across targets in a square grid: four in its corners, as in Figure 15, or more."""
    steps = np.linspace(-0.5, 0.5, across) * size
    y, x = np.meshgrid(steps, steps, indexing="ij")
    return Layout(
        "square" if across == 2 else f"grid {across} × {across}", size, _plane(x.ravel(), y.ravel())
    )


def circle(size: float, count: int) -> Layout:
    """Return targets evenly on a circle of the diameter ``size``."""
    angle = 2.0 * np.pi * (np.arange(count) + 0.5) / count
    return Layout(f"circle of {count}", size, _plane(0.5 * size * np.cos(angle), 0.5 * size * np.sin(angle)))


def line_and_one(size: float, count: int = 4) -> Layout:
    """Return count − 1 targets on a line, and one above its middle."""
    x, y = np.linspace(-0.5, 0.5, count - 1) * size, np.full(count - 1, 0.5 * size)
    points = _plane(np.append(x, 0.0), np.append(y, -0.5 * size))
    return Layout(f"line of {count - 1} + 1", size, points - points.mean(axis=0))


def pyramid(size: float) -> Layout:
    """Return a square with a fifth target half a side in front of its middle: an array that is not planar."""
    return Layout("square + 1 in front", size, np.vstack([square(size).points, [[0.0, 0.0, -0.5 * size]]]))


def _plane(x: Array, y: Array) -> Array:
    return np.stack([x, y, np.zeros_like(x)], axis=1)
