"""Which target of a known array a measured one is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

from scanner_sim.foundation.arithmetic import solve_linear

Array = NDArray[np.float64]


class Identity(NamedTuple):
    """Identities of k measured targets, each (k,): ``target`` index or −1, ``surprise`` squared, ``unique``.

    ``unique`` tells that no other target lies within the gate of the measured one.
    """

    target: NDArray[np.int64]
    surprise: Array
    unique: NDArray[np.bool_]


def identify(
    measured: ArrayLike,
    covariance: ArrayLike,
    expected: ArrayLike,
    expected_covariance: ArrayLike,
    *,
    chance: float = 1e-4,
) -> Identity:
    """Return which of n expected targets each of k measured ones is.

    Parameters
    ----------
    measured, covariance
        (Θ, φ, R) of measured targets, shape (k, 3), and covariances (k, 3, 3).
    expected, expected_covariance
        The same of the targets of an object with a predicted pose, (n, 3) and (n, 3, 3) or (3, 3).
    chance
        Share of right pairs that the gate may refuse.

    Returns
    -------
    Identity
        The pairing of least total d² (the Hungarian method, Kuhn 1955), d² = (m − e)ᵀ (C_m + C_e)⁻¹ (m − e), in which
        no target serves twice and pairs beyond the χ² gate of three dimensions count as none.
    """
    positions, targets = np.atleast_2d(measured), np.atleast_2d(expected)
    away = positions[:, None] - targets[None]
    spread = (
        np.asarray(covariance)[:, None] + np.broadcast_to(expected_covariance, (len(targets), 3, 3))[None]
    )
    distance = np.einsum("kni,kni->kn", away, solve_linear(spread, away[..., None])[..., 0])
    distance = np.where(np.isfinite(distance), distance, np.inf)
    gate = float(chdtri(3, chance))
    # A column of its own for each measured target: to be none of them costs as much as the gate.
    cost = np.concatenate([np.minimum(distance, 2.0 * gate), np.full((len(positions),) * 2, gate)], axis=1)
    rows, columns = linear_sum_assignment(cost)
    target = np.full(len(positions), -1, dtype=np.int64)
    known = columns < len(targets)
    target[rows[known]] = columns[known]
    own = np.where(target >= 0, distance[np.arange(len(positions)), target], np.nan)
    return Identity(target, own, (target >= 0) & ((distance <= gate).sum(axis=1) == 1))
