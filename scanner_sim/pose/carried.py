"""Sightings of targets, made one after another, at a common time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FARTHEST = 3
"""Rounds within which a target must be seen a second time, so that its motion is known."""


def rounds_of(targets: Sequence[str]) -> NDArray[np.int64]:
    """Return the number of the round of each visit, shape (visits,).

    A round ends before the first target that it has visited already, so that it holds every target once, also where
    the user's commands have changed which targets there are.

    Parameters
    ----------
    targets
        Name of the target of each visit, in the order of time.
    """
    numbers = np.zeros(len(targets), dtype=np.int64)
    current: set[str] = set()
    number = 0
    for visit, target in enumerate(targets):
        if target in current:
            number += 1
            current.clear()
        current.add(target)
        numbers[visit] = number
    return numbers


def carried(
    time: Array, place: Array, covariance: Array, at: Array, lasting: Array | None = None
) -> tuple[Array, Array]:
    """Return where targets were at the time of each round, from the sightings before and after it.

    Parameters
    ----------
    time
        When each target was measured in each round [s], shape (rounds, targets); NaN where it was not.
    place, covariance
        (Θ, φ, R), shape (rounds, targets, 3), and its covariance (rounds, targets, 3, 3).
    at
        Common times [s], ascending, shape (rounds,).
    lasting
        Part of the range's variance that successive sightings of a target share [m²], shape (rounds, targets); it stays
        as it is. None: their errors are independent.

    Returns
    -------
    place, covariance
        Of the same shapes; NaN where the target was not measured in the round, or not a second time within
        ``FARTHEST`` rounds. On the straight line through the sighting of the round and the nearest one on the other
        side of the common time, m = (1 − s) m₁ + s m₂ with s = (t − t₁)/(t₂ − t₁), and C = (1 − s)² C₁ + s² C₂ of
        independent errors. Where there is none on that side the line is that of the side that has one, and C grows.

    Notes
    -----
    Steady rates between two sightings: an acceleration a is wrong by a (t₂ − t₁)²/8 at most, 2e-5 m of 0.1 m/s² and
    40 ms. Neighbouring rounds share sightings, so that their errors are correlated.
    """
    rounds, targets = time.shape
    seen = np.isfinite(time) & np.isfinite(place).all(axis=2)
    second = np.full((rounds, targets), -1, dtype=np.int64)
    after = seen & (time <= at[:, None])
    for towards in (True, False):
        for step in range(1, FARTHEST + 1):
            for forward in (True, False):
                wanted = after if forward == towards else seen & ~after
                row = np.arange(rounds) + (step if forward else -step)
                inside = (row >= 0) & (row < rounds)
                there = np.zeros((rounds, targets), dtype=bool)
                there[inside] = seen[row[inside]]
                second = np.where((second < 0) & wanted & there, row[:, None], second)
    known = second >= 0
    other = np.where(known, second, 0)
    column = np.arange(targets)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (at[:, None] - time) / (time[other, column] - time)
    share = np.where(known, share, np.nan)[..., None]
    moved = (1.0 - share) * place + share * place[other, column]
    own = covariance if lasting is None else covariance - _of_range(lasting)
    spread = (1.0 - share[..., None]) ** 2 * own + share[..., None] ** 2 * own[other, column]
    return moved, spread if lasting is None else spread + _of_range(lasting)


def _of_range(variance: Array) -> Array:
    """Return covariances of (Θ, φ, R), shape (..., 3, 3), that have a variance of R alone."""
    result = np.zeros((*variance.shape, 3, 3))
    result[..., 2, 2] = variance
    return result
