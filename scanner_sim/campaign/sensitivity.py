"""Sobol's indices: which share of a measure's scatter each drawn key makes, and the runs that tell it.

For d keys a row of the design has d + 3 runs. Two have values drawn independently, A and B; d have those of A but for
one key, whose value is B's; and one has the values of A and the seed of B. All but B and the last have the seed of A.
The seed so is a key among the keys: what it makes is what a run scatters by while all else stays, and no other key is
charged with it (Iooss and Ribatet, *Reliab. Eng. Syst. Saf.* 94, 2009).

Of a measure y, first order is V[E(y | key)] / V(y), the share of the variance that goes where the key alone is known;
total order is E[V(y | all but the key)] / V(y), the share that stays where all but the key is known. What they differ
by the key makes together with others. The estimators are those of Saltelli et al., *Comput. Phys. Commun.* 181 (2010),
table 2, rows b and f, as SciPy has them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap, sobol_indices

Array = NDArray[np.float64]

A, B = 0, 1
"""Places in a row of the runs whose values are drawn independently; the keys follow in their order, then the seed."""
BESIDE_KEYS = 3
"""Runs of a row beside one for each key."""
LEAST_ROWS = 16
"""Rows below which a bootstrap says nothing."""
RESAMPLES = 999
"""Resamples of the rows for the intervals."""
LEVEL = 0.95
"""Share of intervals that hold the index."""


@dataclass(frozen=True)
class Indices:
    """Sobol's indices of a measure; the last of each is the seed's.

    Attributes
    ----------
    first, total
        First and total order, shape (keys + 1,); NaN where the measure is constant or rows are too few.
    first_interval, total_interval
        Ends of their 95 % intervals, shape (keys + 1, 2).
    rows, left_out
        Rows that are whole, and those that are not, because a run of theirs failed or is not done.
    """

    first: Array
    total: Array
    first_interval: Array
    total_interval: Array
    rows: int
    left_out: int


def design_of(first: Array, second: Array) -> Array:
    """Return the points of the design from two samples, shapes (rows, keys): row by row, (rows × (keys + 3), keys)."""
    keys = first.shape[1]
    points = np.repeat(first[:, None, :], keys + BESIDE_KEYS, axis=1)
    points[:, B] = second
    for key in range(keys):
        points[:, B + 1 + key, key] = second[:, key]
    return points.reshape(-1, keys)


def seeded_as(point: int, keys: int) -> int:
    """Return the point, A or B of the same row, whose seed a point of the design has."""
    row, page = divmod(point, keys + BESIDE_KEYS)
    return row * (keys + BESIDE_KEYS) + (B if page in (B, keys + BESIDE_KEYS - 1) else A)


def pages_of(keys: tuple[str, ...]) -> tuple[str, ...]:
    """Return what each run of a row is called: A, B, the key that is B's, the seed."""
    return ("A", "B", *keys, "seed")


def indices_of(values: Array, seed: int) -> Indices:
    """Return Sobol's indices.

    Parameters
    ----------
    values
        The measure, shape (rows, keys + 3), runs of a row in the order of the design; NaN where there is none. The
        number of rows is a power of two.
    seed
        Of the resamples.
    """
    whole = np.asarray(np.isfinite(values).all(axis=1))
    rows, inputs = int(whole.sum()), values.shape[1] - 2
    if rows < LEAST_ROWS or np.ptp(values[whole, A : B + 1]) == 0.0:
        nothing, ends = np.full(inputs, np.nan), np.full((inputs, 2), np.nan)
        return Indices(nothing, nothing, ends, ends, rows, len(values) - rows)
    # A row at the mean adds to no sum of the estimators: it is as if it were not there, and SciPy has its power of two.
    filled = np.where(whole[:, None], values, values[whole, A : B + 1].mean())

    def estimate(drawn: NDArray[np.int64]) -> Array:
        a, b, others = filled[drawn, A], filled[drawn, B], filled[drawn, B + 1 :]
        found = sobol_indices(func={"f_A": a[None], "f_B": b[None], "f_AB": others.T[:, None]}, n=len(drawn))
        return np.stack([found.first_order, found.total_order])

    every = np.arange(len(values))
    first, total = estimate(every)
    ends = bootstrap(
        (every,),
        estimate,
        vectorized=False,
        n_resamples=RESAMPLES,
        confidence_level=LEVEL,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    low, high = np.asarray(ends.low), np.asarray(ends.high)
    return Indices(
        first,
        total,
        np.stack([low[0], high[0]], axis=1),
        np.stack([low[1], high[1]], axis=1),
        rows,
        len(values) - rows,
    )
