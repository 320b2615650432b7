"""Observations of targets, made one after another, at a common time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.tracking.errors import ErrorParts, common_covariance

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


@dataclass(frozen=True)
class Interpolated:
    """Observations at common times; NaN where a target was not measured in the round, or not a second time near it.

    Attributes
    ----------
    position
        (Θ, φ, R) [rad, m], shape (rounds, targets, 3).
    covariance
        Between the observations of a round, shape (rounds, targets, targets, 3, 3).
    lasting
        Its part that neighbouring rounds have, too: surfaces, pixels, drift and calibration.
    common
        What k errors of the calibration, of unit variance each, make of them, shape (rounds, targets, 3, k): C Cᵀ is a
        part of ``lasting``.
    """

    position: Array
    covariance: Array
    lasting: Array
    common: Array

    def of(self, targets: Sequence[int]) -> Interpolated:
        """Return the observations of some of the targets."""
        chosen = np.asarray(targets)
        rows, columns = chosen[:, None], chosen
        return Interpolated(
            self.position[:, chosen],
            self.covariance[:, rows, columns],
            self.lasting[:, rows, columns],
            self.common[:, chosen],
        )


def interpolate(time: Array, position: Array, errors: ErrorParts, at: Array) -> Interpolated:
    """Return where targets were at the time of each round, from the observations before and after it.

    Parameters
    ----------
    time
        When each target was measured in each round [s], shape (rounds, targets); NaN where it was not.
    position
        (Θ, φ, R), shape (rounds, targets, 3).
    errors
        What their errors are made of, leading axes (rounds, targets).
    at
        Common times [s], ascending, shape (rounds,).

    Returns
    -------
    Interpolated
        On the straight line through the observation of the round and the nearest one within ``FARTHEST`` rounds on the
        other side of the common time, m = (1 − s) m₁ + s m₂ with s = (t − t₁)/(t₂ − t₁). Where there is none on that
        side the line is that of the side that has one. White parts C add up to (1 − s)² C₁ + s² C₂; of what
        observations have in common (:func:`~scanner_sim.tracking.errors.common_covariance`) each pair counts with both
        its shares.

    Notes
    -----
    Steady rates between two observations: an acceleration a is wrong by a (t₂ − t₁)²/8 at most, 2e-5 m of 0.1 m/s² and
    40 ms. Neighbouring rounds share observations, so that their errors are correlated by more than what lasts.
    """
    rounds, targets = time.shape
    second = _second(time, np.isfinite(time) & np.isfinite(position).all(axis=2), at)
    known = second >= 0
    other = np.where(known, second, 0)
    own, column = np.arange(rounds)[:, None] + 0 * other, np.arange(targets)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (at[:, None] - time) / (time[other, column] - time)
    share = np.where(known, share, np.nan)
    # Both observations of every target side by side: first all of the round, then all of the others.
    row = np.concatenate([own, other], axis=1)
    target = np.concatenate([column, column])
    weight = np.concatenate([1.0 - share, share], axis=1)
    pair = errors.at((row, target))
    own_errors = weight[..., None, None] ** 2 * pair.white
    white = np.zeros((rounds, targets, targets, 3, 3))
    white[:, column, column] = own_errors[:, :targets] + own_errors[:, targets:]

    def summed(lasting: bool) -> Array:
        common = common_covariance(pair, position[row, target], time[row, target], target, lasting=lasting)
        shares = common * (weight[:, :, None] * weight[:, None, :])[..., None, None]
        return np.asarray(shares.reshape(rounds, 2, targets, 2, targets, 3, 3).sum(axis=(1, 3)))

    moved = (1.0 - share[..., None]) * position + share[..., None] * position[other, column]
    common = (weight[..., None, None] * pair.common).reshape(rounds, 2, targets, 3, -1).sum(axis=1)
    return Interpolated(moved, white + summed(False), summed(True), common)


def _second(time: Array, seen: NDArray[np.bool_], at: Array) -> NDArray[np.int64]:
    """Return the round of each observation's partner, the nearest on the other side of the common time; −1 for none."""
    rounds, targets = time.shape
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
    return second
