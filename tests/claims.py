"""Statistical claims, with the chance that they fail by accident and what they would have found.

A test says what a figure must be and how it scatters; the bounds follow from the size of the sample and the level.
Each function returns a :class:`Claim`, which ``assert claim`` holds or breaks with its whole reasoning in the message;
a test that must be able to see a fault of a certain size asserts ``claim.finds`` besides.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

LEVEL = 1e-4
"""Chance that a right program breaks a claim, both sides together."""
POWER = 0.9
"""Chance with which a claim finds a fault of the size that ``finds`` states."""


@dataclass(frozen=True)
class Claim:
    """A figure, the bounds that it keeps, and the departure from what is expected that would be found."""

    what: str
    figure: float
    low: float
    high: float
    finds: float
    level: float

    def __bool__(self) -> bool:
        return bool(self.low <= self.figure <= self.high)

    def __repr__(self) -> str:
        return (
            f"{self.what} of {self.figure:.6g}; from {self.low:.6g} to {self.high:.6g} at a level of {self.level:g}; "
            f"a departure of {self.finds:.3g} is found with {POWER:.0%}"
        )


@cache
def _quantile(law: str, which: str, share: float, *shape: float) -> float:
    """Return a quantile of a distribution of SciPy, by ``ppf`` or ``isf``; looking for it takes long."""
    return float(getattr(getattr(stats, law), which)(share, *shape))


def mean_square(
    z: ArrayLike, *, freedom: float | None = None, slack: float = 0.0, level: float = LEVEL
) -> Claim:
    """Claim that the mean square of errors over their σ is 1.

    Parameters
    ----------
    z
        Errors over their σ, normal if the program is right.
    freedom
        How many of them are independent, all by default.
    slack
        Known share by which the mean square may differ from 1, of the model or the reference.
    level
        Chance that a right program breaks the claim.

    Returns
    -------
    Claim
        ``finds`` is the relative change of the variance: bounds are those of χ² with ``freedom`` degrees of freedom.
    """
    squares = np.square(np.asarray(z, dtype=np.float64).ravel())
    n = float(squares.size if freedom is None else freedom)
    low, high = (_quantile("chi2", "ppf", end, n) / n for end in (0.5 * level, 1.0 - 0.5 * level))
    finds = high * (1.0 + slack) * n / _quantile("chi2", "ppf", 1.0 - POWER, n) - 1.0
    return Claim(
        "mean square", float(squares.mean()), low * (1.0 - slack), high * (1.0 + slack), finds, level
    )


def scatter_ratio(
    first: float, second: float, freedom: tuple[float, float], *, slack: float = 0.0, level: float = LEVEL
) -> Claim:
    """Claim that two scatters are equal: their ratio, with bounds of the F distribution.

    Parameters
    ----------
    first, second
        Standard deviations.
    freedom
        Degrees of freedom of either, infinite for one that is known.
    slack
        Known share by which they may differ.
    level
        Chance that a right program breaks the claim.
    """
    many = [min(float(n), 1e9) for n in freedom]
    low, high, least = (
        float(np.sqrt(_quantile("f", "ppf", end, *many)))
        for end in (0.5 * level, 1.0 - 0.5 * level, 1.0 - POWER)
    )
    finds = high * (1.0 + slack) / least - 1.0
    return Claim("ratio of scatters", first / second, low * (1.0 - slack), high * (1.0 + slack), finds, level)


def mean(values: ArrayLike, expected: float = 0.0, *, slack: float = 0.0, level: float = LEVEL) -> Claim:
    """Claim that independent values have an expected mean, with bounds of Student's t and their own scatter."""
    given = np.asarray(values, dtype=np.float64).ravel()
    error = float(given.std(ddof=1)) / np.sqrt(given.size)
    far = _quantile("t", "isf", 0.5 * level, given.size - 1) * error + slack
    finds = far + _quantile("norm", "ppf", POWER) * error
    return Claim("mean", float(given.mean()), expected - far, expected + far, finds, level)


def share(count: int, total: int, expected: float, *, slack: float = 0.0, level: float = LEVEL) -> Claim:
    """Claim that of ``total`` independent cases an expected share is hit, with bounds of the binomial distribution."""
    low = _quantile("binom", "ppf", 0.5 * level, total, max(expected - slack, 0.0)) / total
    high = _quantile("binom", "isf", 0.5 * level, total, min(expected + slack, 1.0)) / total
    spread = float(np.sqrt(max(high * (1.0 - high), 1.0 / total) / total))
    finds = high - expected + _quantile("norm", "ppf", POWER) * spread
    return Claim("share", count / total, low, high, finds, level)


def at_most(count: int, total: int, limit: float, *, level: float = LEVEL) -> Claim:
    """Claim that independent cases are hit with a probability of ``limit`` or less."""
    high = _quantile("binom", "isf", level, total, limit) / total
    spread = float(np.sqrt(max(high * (1.0 - high), 1.0 / total) / total))
    return Claim(
        "share", count / total, 0.0, high, high - limit + _quantile("norm", "ppf", POWER) * spread, level
    )
