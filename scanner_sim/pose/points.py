"""Pose from points: the closed form of eq 11 by singular values.

Kabsch, *Acta Cryst.* A32 (1976) 922; Umeyama, *IEEE PAMI* 13 (1991) 376, for the sign that keeps a reflection out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.pose.sightings import Flags

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
        R (3, 3, B) = U diag(1, 1, det UVᵀ) Vᵀ with U, V those of Σ (X − X̄)(r − r̄)ᵀ, and c = X̄ − R r̄ (3, B).
    """
    share = used / np.maximum(used.sum(axis=0), 1)
    middle = np.einsum("inb,nb->ib", points, share)
    mean = np.einsum("inb,nb->ib", measured, share)
    spread = np.einsum("inb,jnb->bij", (measured - mean[:, None]) * share, points - middle[:, None])
    left, _, right = np.linalg.svd(spread)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    rotation = np.ascontiguousarray(np.moveaxis(left @ right, 0, -1))
    return rotation, mean - np.einsum("ijb,jb->ib", rotation, middle)
