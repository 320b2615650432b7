"""How much each key changes each measure, and which change nothing that can be seen.

The change is that between the lowest and the highest of the means over the values of a key. Where a key has a few
values of its own, all crossed with the rest, runs that differ in nothing else are compared: complete blocks. Elsewhere
the points of a group are sorted by the key's value and taken together in bins, and what the other keys of the group do
is taken out by a cubic of each of their ranks, a straight line where there are few runs, fitted together with the means
of the bins: an analysis of covariance. What the values of other groups do is taken out before.
The change that chance alone makes in 95 of 100 such tables is Tukey's studentised range times the standard error of a
mean; a key whose change is not larger is *dead* for that measure. Errors of different runs are taken as independent and
roughly normal. (Montgomery, Design and Analysis of Experiments, 8th ed., sections 3.5.7, 4.1 and 15.3.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import studentized_range
from scipy.stats import t as student

Array = NDArray[np.float64]

LEVEL = 0.95
"""Share of tables of pure chance whose largest change stays within the interval."""
BINS = 6
"""Bins of a key whose values are drawn."""
_DEGREES = (3, 1)
"""Degrees of the polynomial by which the other keys of a group are taken out; the second where points are few."""
FEWEST_BINS = 3
"""Bins that tell something: the two halves of a key may be alike where its middle is not."""
_PER_BIN = 3
"""Points to a bin at least, beside those of the polynomials: fewer tell no spread."""
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
    freedom
        Degrees of freedom of the errors.
    points
        The key's value and the measure of each drawn point, shape (2, points); none where values are not drawn.
    beside
        Keys that have no values of their own: they go with this one, and the change is that of all.
    """

    key: str
    measure: str
    at: Array
    mean: Array
    error: Array
    change: float
    interval: float
    freedom: int
    points: Array = field(default_factory=lambda: np.zeros((2, 0)))
    beside: tuple[str, ...] = ()

    @property
    def dead(self) -> bool:
        """Whether the key changes the measure by less than chance does."""
        return self.change <= self.interval

    @property
    def seen(self) -> float:
        """Change of one mean from another that passes the interval in 95 of 100 campaigns, by Student's law."""
        return self.interval + float(student.ppf(LEVEL, self.freedom)) * math.sqrt(2.0) * _scale(self.error)


def by_level(key: str, measure: str, at: Array, values: Array, beside: tuple[str, ...] = ()) -> Dependence:
    """Return what a key does whose values are crossed with all else.

    Parameters
    ----------
    at
        The key's values, shape (levels,).
    values
        The measure, shape (levels, blocks): runs of a column differ in the key and their seed alone. Columns with a gap
        are left out.
    beside
        Keys whose values go with this one's.
    """
    whole = values[:, np.isfinite(values).all(axis=0)]
    levels, blocks = whole.shape
    if blocks == 0 or levels < 2:
        nothing = np.full(levels, np.nan)
        return Dependence(key, measure, at, nothing, nothing, math.nan, math.nan, 0, beside=beside)
    mean = whole.mean(axis=1)
    left = whole - whole.mean(axis=0) - mean[:, None] + mean.mean()
    freedom = (levels - 1) * (blocks - 1)
    error = math.sqrt(float(np.sum(left**2)) / freedom / blocks) if freedom else math.nan
    found = _dependence(key, measure, at, mean, np.full(levels, error), freedom)
    return replace(found, beside=beside)


def by_bin(key: str, measure: str, at: Array, values: Array, others: Array) -> Dependence:
    """Return what a key does whose values are drawn.

    Parameters
    ----------
    at
        The key's value at each point, shape (points,).
    values
        The measure, shape (points, blocks), as of :func:`by_level`; points without any are left out.
    others
        Values of the other keys of the group, shape (points, keys).
    """
    values = _without_blocks(values)
    good = np.isfinite(at) & np.isfinite(values)
    at, values, others = at[good], values[good], others[good]
    points = np.stack([at, values])
    counts = {degree: min(BINS, (len(values) - degree * others.shape[1]) // _PER_BIN) for degree in _DEGREES}
    degree = next((degree for degree, bins in counts.items() if bins >= FEWEST_BINS), 0)
    if not degree:
        nothing = np.full(0, np.nan)
        return Dependence(key, measure, nothing, nothing, nothing, math.nan, math.nan, 0, points)
    bins = counts[degree]
    parts = np.array_split(np.argsort(at, kind="stable"), bins)
    member = np.zeros((len(values), bins))
    for number, part in enumerate(parts):
        member[part, number] = 1.0
    design = np.concatenate([member, _covariates(others, degree)], axis=1)
    fitted, _, rank, _ = np.linalg.lstsq(design, values, rcond=None)
    freedom = len(values) - int(rank)
    variance = float(np.sum((values - design @ fitted) ** 2)) / max(freedom, 1)
    error = np.sqrt(variance * np.diagonal(np.linalg.pinv(design.T @ design))[:bins])
    middle = np.array([np.median(at[part]) for part in parts])
    return replace(_dependence(key, measure, middle, fitted[:bins], error, freedom), points=points)


def _without_blocks(values: Array) -> Array:
    """Return the mean of each row over its finite numbers, shape (rows,), less what the columns differ by."""
    finite = np.isfinite(values)
    level = _means(values, finite, axis=0)
    known = np.isfinite(level)
    offset = level - level[known].mean() if known.any() else level
    return _means(values - offset, finite, axis=1)


def _means(values: Array, finite: NDArray[np.bool_], axis: int) -> Array:
    """Return means over an axis of what is finite; NaN where there is nothing."""
    count = finite.sum(axis=axis)
    total = np.where(finite, values, 0.0).sum(axis=axis)
    means: Array = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return means


def _covariates(others: Array, degree: int) -> Array:
    """Return powers of the ranks of each column, each of mean 0, shape (points, degree × columns)."""
    ranks = np.argsort(np.argsort(others, axis=0, kind="stable"), axis=0, kind="stable")
    scaled = 2.0 * (ranks + 0.5) / max(len(others), 1) - 1.0
    powers = np.concatenate([scaled**power for power in range(1, degree + 1)], axis=1)
    centred: Array = powers - powers.mean(axis=0)
    return centred


def _dependence(key: str, measure: str, at: Array, mean: Array, error: Array, freedom: int) -> Dependence:
    change = float(mean.max() - mean.min())
    interval = math.nan
    if freedom > 0:
        # Bins differ by one point at most: the mean of their variances stands for each (Kramer).
        interval = _quantile(len(mean), freedom) * _scale(error)
    return Dependence(key, measure, at, mean, error, change, interval, freedom)


def _scale(error: Array) -> float:
    return math.sqrt(float(np.mean(error**2)))


@lru_cache
def _quantile(means: int, freedom: int) -> float:
    """Return Tukey's studentised range at the level; SciPy integrates for seconds, and a page asks many times."""
    return float(studentized_range.ppf(LEVEL, means, freedom))
