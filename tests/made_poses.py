"""Poses and targets whose errors are given, for tests of what figures make of them."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from made_benches import Array
from scipy.spatial.transform import Rotation


def series(moved: Array, sigma: Array, method: str = "xyz") -> Any:
    """Return poses of a turned object whose errors (δt, δω) along the scanner's axes and their σ are given."""
    count = len(moved)
    truth = np.broadcast_to(Rotation.from_euler("xyz", (0.3, -0.2, 0.5)).as_matrix(), (count, 3, 3))
    place = np.tile([0.1, -0.2, 10.0], (count, 1))
    turned = np.full((count, 3, 3), math.nan)
    known = np.isfinite(moved).all(axis=1)
    turned[known] = Rotation.from_rotvec(moved[known, 3:]).as_matrix() @ truth[known]
    return SimpleNamespace(
        method=method,
        position=place + moved[:, :3],
        rotation=turned,
        truth_position=place,
        truth_rotation=truth,
        sigma=np.broadcast_to(sigma, (count, 6)),
    )


SIGMA = 1e-3 * np.array([1.0, 2.0, 3.0, 0.4, 0.5, 0.6])


def pool_of(found: float = 1.0, common: float = 0.6) -> Any:
    """Return targets that scatter by (4, 3) µrad, 1 mm and 8 mm at 10 m, of which a share is common to all."""
    scatter = np.array([4e-6, 3e-6, 1e-3, 8e-3])
    return SimpleNamespace(
        distance=10.0, scatter=scatter, common=common * scatter, found=np.array([1.0, 1.0, found, found])
    )
