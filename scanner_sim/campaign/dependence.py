"""How much each key changes each measure, and which change nothing that can be seen.

The change is that between the lowest and the highest of the means over the values of a key. Where a key has a few
values of its own, all crossed with the rest, runs that differ in nothing else are compared: complete blocks. Elsewhere
the points of a group are sorted by the key's value and taken together in bins, and what the other keys of the group do
is taken out by a cubic of each of their ranks, fitted together with the means of the bins: an analysis of covariance.
The change that chance alone makes in 95 of 100 such tables is Tukey's studentised range times the standard error of a
mean; a key whose change is not larger is *dead* for that measure. Errors of different runs are taken as independent and
roughly normal. (Montgomery, Design and Analysis of Experiments, 8th ed., sections 3.5.7, 4.1 and 15.3.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import studentized_range

Array = NDArray[np.float64]

LEVEL = 0.95
"""Share of tables of pure chance whose largest change stays within the interval."""
BINS = 6
"""Bins of a key whose values are drawn."""
_DEGREE = 3
"""Degree of the polynomial by which the other keys of a group are taken out."""
MOST_LEVELS = 30
"""Values of a key that are compared one by one."""


@dataclass(frozen=True)
class Dependence:
    """What a key does to a measure.

    Attributes
    ----------
    key, measure
        Their names.
    at
        Value of the key at each mean, the middle of a bin, shape (levels,); numbered where values are words.
    mean, error
        Means of the measure, and their standard error, shape (levels,).
    change
        Highest mean less lowest.
    interval
        Change that chance alone makes in 95 of 100 tables; NaN where too few runs say nothing.
    """

    key: str
    measure: str
    at: Array
    mean: Array
    error: Array
    change: float
    interval: float

    @property
    def dead(self) -> bool:
        """Whether the key changes the measure by less than chance does."""
        return self.change <= self.interval


def by_level(key: str, measure: str, at: Array, values: Array) -> Dependence:
    """Return what a key does whose values are crossed with all else.

    Parameters
    ----------
    at
        The key's values, shape (levels,).
    values
        The measure, shape (levels, blocks): runs of a column differ in the key and their seed alone. Columns with a gap
        are left out.
    """
    whole = values[:, np.isfinite(values).all(axis=0)]
    levels, blocks = whole.shape
    if blocks == 0 or levels < 2:
        nothing = np.full(levels, np.nan)
        return Dependence(key, measure, at, nothing, nothing, math.nan, math.nan)
    mean = whole.mean(axis=1)
    left = whole - whole.mean(axis=0) - mean[:, None] + mean.mean()
    freedom = (levels - 1) * (blocks - 1)
    error = math.sqrt(float(np.sum(left**2)) / freedom / blocks) if freedom else math.nan
    return _dependence(key, measure, at, mean, np.full(levels, error), freedom)


def by_bin(key: str, measure: str, at: Array, values: Array, others: Array) -> Dependence:
    """Return what a key does whose values are drawn.

    Parameters
    ----------
    at, values
        The key's value at each point and the measure there, shapes (points,). Points with a gap are left out.
    others
        Values of the other keys of the group, shape (points, keys).
    """
    good = np.isfinite(at) & np.isfinite(values)
    at, values, others = at[good], values[good], others[good]
    # Beside what the others do, three points to a bin at least: fewer tell no spread.
    bins = min(BINS, (len(values) - _DEGREE * others.shape[1]) // 3)
    if bins < 2:
        nothing = np.full(0, np.nan)
        return Dependence(key, measure, nothing, nothing, nothing, math.nan, math.nan)
    parts = np.array_split(np.argsort(at, kind="stable"), bins)
    member = np.zeros((len(values), bins))
    for number, part in enumerate(parts):
        member[part, number] = 1.0
    design = np.concatenate([member, _covariates(others)], axis=1)
    fitted, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
    freedom = len(values) - int(rank)
    variance = float(np.sum((values - design @ fitted) ** 2)) / max(freedom, 1)
    error = np.sqrt(variance * np.diagonal(np.linalg.pinv(design.T @ design))[:bins])
    middle = np.array([np.median(at[part]) for part in parts])
    return _dependence(key, measure, middle, fitted[:bins], error, freedom)


def _covariates(others: Array) -> Array:
    """Return powers of the ranks of each column, each of mean 0, shape (points, 3 × columns)."""
    ranks = np.argsort(np.argsort(others, axis=0, kind="stable"), axis=0, kind="stable")
    scaled = 2.0 * (ranks + 0.5) / max(len(others), 1) - 1.0
    powers = np.concatenate([scaled**power for power in range(1, _DEGREE + 1)], axis=1)
    centred: Array = powers - powers.mean(axis=0)
    return centred


def _dependence(key: str, measure: str, at: Array, mean: Array, error: Array, freedom: int) -> Dependence:
    change = float(mean.max() - mean.min())
    interval = math.nan
    if freedom > 0:
        # Bins differ by one point at most: the mean of their variances stands for each (Kramer).
        scale = math.sqrt(float(np.mean(error**2)))
        interval = _quantile(len(mean), freedom) * scale
    return Dependence(key, measure, at, mean, error, change, interval)


@lru_cache
def _quantile(means: int, freedom: int) -> float:
    """Return Tukey's studentised range at the level; SciPy integrates for seconds, and a page asks many times."""
    return float(studentized_range.ppf(LEVEL, means, freedom))
