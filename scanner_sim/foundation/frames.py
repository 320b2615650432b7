"""Frames and signs.

**Scanner frame**: right-handed, origin on the first deflection axis, x to the right, y down, z forward (away
from the scanner), metres. Positive Θ looks right (+x), positive φ looks down (+y). In pictures the first row is
the smallest φ (top) and the first column the smallest Θ (left).

**Object frame**: where an object is not turned, its axes are the scanner's and its front faces −z, back at
the scanner.

Transforms are 4 × 4 matrices named ``target_from_source``; they multiply column vectors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def rotation_about(axis: ArrayLike, angle: float) -> NDArray[np.float64]:
    """Return the matrix of a right-handed rotation about an axis.

    Parameters
    ----------
    axis
        Shape (3,), any length but zero.
    angle
        Angle [rad].

    Returns
    -------
    ndarray
        Shape (3, 3). Rodrigues' formula, R = I + sin a K + (1 − cos a) K².
    """
    x, y, z = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: NDArray[np.float64] = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return turned


def pose_matrix(rotation: NDArray[np.float64], position: ArrayLike) -> NDArray[np.float64]:
    """Return ``target_from_source`` for a body turned by ``rotation`` (3, 3) and put at ``position`` (3,) [m]."""
    target_from_source = np.eye(4)
    target_from_source[:3, :3] = rotation
    target_from_source[:3, 3] = position
    return target_from_source
