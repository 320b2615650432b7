"""Pose from points: the closed form of eq 11 by quaternions.

Horn, *J. Opt. Soc. Am. A* 4 (1987) 629: a quaternion cannot be a reflection, so that flat arrays need no
case of their own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import eigen
from scanner_sim.pose.observations import Flags
from scanner_sim.pose.transforms import rotation_from_quaternion

Array = NDArray[np.float64]


def point_fit(points: Array, measured: Array, used: Flags) -> tuple[Array, Array]:
    """Return the rigid motion that brings points nearest to the measured ones: min Σ |X − (R r + c)|² (eq 11).

    Parameters
    ----------
    points
        Targets along the object's axes [m], shape (3, n, B or 1).
    measured
        The same in the scanner frame [m], shape (3, n, B).
    used
        Which of them count, shape (n, B); at least three that are not on a line.

    Returns
    -------
    tuple
        R (3, 3, B), of the quaternion that is the eigenvector of the largest eigenvalue of Horn's matrix of
        S = Σ (X − X̄)(r − r̄)ᵀ, and c = X̄ − R r̄ (3, B).
    """
    share = used / np.maximum(used.sum(axis=0), 1)
    middle = np.einsum("inb,nb->ib", points, share)
    mean = np.einsum("inb,nb->ib", measured, share)
    spread = np.einsum("inb,jnb->bij", (measured - mean[:, None]) * share, points - middle[:, None])
    _, quaternions = eigen(_horn(spread))
    turned = rotation_from_quaternion(quaternions[:, :, 3])
    rotation = np.ascontiguousarray(np.moveaxis(turned, 0, -1))
    return rotation, mean - np.einsum("ijb,jb->ib", rotation, middle)


def _horn(spread: Array) -> Array:
    """Return the symmetric matrices (B, 4, 4) whose form qᵀNq is the agreement of points turned by a quaternion."""
    s = spread
    matrix = np.empty((len(s), 4, 4))
    matrix[:, 0, 0] = s[:, 0, 0] + s[:, 1, 1] + s[:, 2, 2]
    matrix[:, 1, 1] = s[:, 0, 0] - s[:, 1, 1] - s[:, 2, 2]
    matrix[:, 2, 2] = s[:, 1, 1] - s[:, 0, 0] - s[:, 2, 2]
    matrix[:, 3, 3] = s[:, 2, 2] - s[:, 0, 0] - s[:, 1, 1]
    matrix[:, 0, 1] = matrix[:, 1, 0] = s[:, 2, 1] - s[:, 1, 2]
    matrix[:, 0, 2] = matrix[:, 2, 0] = s[:, 0, 2] - s[:, 2, 0]
    matrix[:, 0, 3] = matrix[:, 3, 0] = s[:, 1, 0] - s[:, 0, 1]
    matrix[:, 1, 2] = matrix[:, 2, 1] = s[:, 0, 1] + s[:, 1, 0]
    matrix[:, 1, 3] = matrix[:, 3, 1] = s[:, 0, 2] + s[:, 2, 0]
    matrix[:, 2, 3] = matrix[:, 3, 2] = s[:, 1, 2] + s[:, 2, 1]
    return matrix
