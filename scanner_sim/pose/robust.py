"""Which targets agree on one pose, where some are not what they are taken for.

Fischler and Bolles, *Comm. ACM* 24 (1981) 381 (RANSAC), with the truncated squares of Torr and Zisserman (2000). With
the few targets of an object all threes can be tried, so nothing is drawn at random; of more than 120 threes every so
many-th is.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from scanner_sim.pose.adjustment import COARSE, adjust, begin
from scanner_sim.pose.points import point_fit
from scanner_sim.pose.resection import three_point_starts
from scanner_sim.pose.sightings import Flags, Sightings
from scanner_sim.pose.solution import squared_lengths
from scanner_sim.pose.weights import Method, measured_points, problem_of

Array = NDArray[np.float64]

MOST_THREES = 120
_WIDE = 36.0
"""Squared standard deviations within which a target agrees with a pose of three: that pose has errors too."""
_CHANCE = 1e-3
"""Probability with which a good target is left out in the end."""
_ROUNDS = 3


def agreeing(sightings: Sightings, method: Method) -> tuple[Flags, Flags]:
    """Return the targets that agree on one pose.

    Parameters
    ----------
    sightings
        B poses of n targets.
    method
        What the pose will be estimated from.

    Returns
    -------
    tuple
        Which targets agree (n, B), and whether they are enough (B,): four for ``uv``, since three angles' pairs always
        have a pose, three otherwise.
    """
    poses = np.arange(sightings.count)
    least = np.full(sightings.count, np.inf)
    rotation = np.full((3, 3, sightings.count), np.nan)
    position = np.full((3, sightings.count), np.nan)
    threes = list(combinations(range(len(sightings.seen)), 3))
    threes = threes[:: -(-len(threes) // MOST_THREES)]
    for three in threes:
        for turned, placed in _poses_of(sightings, three, method):
            squares = squared_lengths(sightings, method, turned, placed)
            score = np.minimum(np.nan_to_num(squares, nan=_WIDE), _WIDE).sum(axis=0)
            score = np.where(np.isfinite(placed).all(axis=0), score, np.inf)
            better = score < least
            least[better] = score[better]
            rotation[..., better], position[..., better] = turned[..., better], placed[..., better]
    found = np.isfinite(least)
    rotation[..., ~found], position[..., ~found] = np.eye(3)[:, :, None], np.ones((3, 1))
    needed = 4 if method == "uv" else 3
    channels = 2 if method == "uv" else 3
    kept = squared_lengths(sightings, method, rotation, position) < _WIDE
    kept &= sightings.seen
    enough = found & (kept.sum(axis=0) >= needed)
    for _ in range(_ROUNDS):
        index = poses[enough]
        if not index.size:
            break
        chosen = sightings.some(index)
        problem = problem_of(chosen.only(kept[:, index]), method, "covariance")
        fit = adjust(problem, begin(problem, rotation[..., index], position[..., index]), until=COARSE)
        rotation[..., index], position[..., index] = fit.rotation, fit.position
        limit = float(chdtri(channels, _CHANCE))
        kept[:, index] = (squared_lengths(chosen, method, fit.rotation, fit.position) < limit) & chosen.seen
        enough = enough & (kept.sum(axis=0) >= needed)
    return kept, enough


def _poses_of(sightings: Sightings, three: tuple[int, ...], method: Method) -> list[tuple[Array, Array]]:
    """Return the poses R (3, 3, B), c (3, B) of three targets, NaN where they were not all measured."""
    chosen = np.zeros_like(sightings.seen)
    chosen[list(three)] = True
    seen = sightings.seen[list(three)].all(axis=0)
    ranged = seen & sightings.ranged[list(three)].all(axis=0)
    found = []
    if method != "uv" and ranged.any():
        rotation, position = point_fit(sightings.points, measured_points(sightings), chosen)
        found.append((rotation, np.where(ranged, position, np.nan)))
    if method == "uv" or (method == "joint" and not ranged.all()):
        index = np.tile(np.array(three)[:, None], sightings.count)
        rotations, positions = three_point_starts(sightings, index)
        positions = np.where(seen, positions, np.nan)
        found += [(rotations[:, :, s], positions[:, s]) for s in range(rotations.shape[2])]
    return found
