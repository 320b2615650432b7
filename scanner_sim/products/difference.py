"""Two results of one scan, voxel by voxel: ranges less ranges, over the σ of both together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.products.image import RangeImage
from scanner_sim.products.json_text import json_text
from scanner_sim.products.shots import ShotTable

Array = NDArray[np.float64]

BEYOND = (2.0, 3.0, 5.0)
"""Numbers of σ, the share of differences beyond which is told."""
WAYS = {"": "range", "tof.": "range by time of flight", "fused.": "range by both"}
"""Prefixes of the layers of each range, and its name."""
_SAME_AIM = 1e-9
"""Angle within which two deflections are one [rad]."""


@dataclass(frozen=True, eq=False)
class RangeDifference:
    """Differences of the ranges of two scans.

    Attributes
    ----------
    name
        Which ranges.
    difference
        The second less the first [m], of the shape of the scan; NaN where either has none.
    sigma
        σ of both together, the root of the sum of their squares [m]: that of the difference of independent errors.
    only_first, only_second
        Where only one has a range.
    """

    name: str
    difference: Array
    sigma: Array
    only_first: NDArray[np.bool_]
    only_second: NDArray[np.bool_]

    @property
    def over_sigma(self) -> Array:
        """Differences over their σ; NaN where there is none, or σ is 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            found = self.difference / self.sigma
        return np.where(np.isfinite(found), found, np.nan)

    def numbers(self) -> dict[str, Any]:
        """Return the numbers of ``difference.json``; None where nothing can be compared."""
        both = self.difference[np.isfinite(self.difference)]
        pull = self.over_sigma[np.isfinite(self.over_sigma)]
        return {
            "both": int(both.size),
            "only_first": int(self.only_first.sum()),
            "only_second": int(self.only_second.sum()),
            "difference_m": {"mean": _mean(both), "median": _median(both), "rms": _rms(both)},
            "over_sigma": {"mean": _mean(pull), "median": _median(pull), "rms": _rms(pull)},
            "share_beyond": {
                f"{sigmas:g} sigma": {
                    "found": _mean((np.abs(pull) > sigmas).astype(np.float64)),
                    "normal": normal_beyond(sigmas),
                }
                for sigmas in BEYOND
            },
        }


@dataclass(frozen=True, eq=False)
class Difference:
    """Two results of one scan, compared.

    Attributes
    ----------
    ranges
        Of each range that both have; the first is ``range_m``.
    statuses
        How many voxels or shots went from which status to which: (before, after) and their number.
    theta, phi
        Deflections [rad]: of columns and rows of an image, of each shot of a table.
    seeds
        Of the first and of the second.
    """

    ranges: tuple[RangeDifference, ...]
    statuses: Mapping[tuple[Status, Status], int]
    theta: Array
    phi: Array
    seeds: tuple[int, int]

    @property
    def same_seed(self) -> bool:
        """Whether both were drawn with the same random numbers: then errors that they share cancel."""
        return self.seeds[0] == self.seeds[1]


def difference_of(first: RangeImage | ShotTable, second: RangeImage | ShotTable) -> Difference:
    """Return how two results of one scan differ.

    Raises
    ------
    InputError
        If they are of different scans.
    """
    _check_same_scan(first, second)
    ranges = [
        _range_difference(first, second, prefix)
        for prefix in WAYS
        if all(f"{prefix}{name}" in one for one in (first, second) for name in ("range_m", "sigma_range_m"))
    ]
    if not ranges:
        raise InputError(
            "the results have no range_m with its σ in common.",
            remedy="Run their scenarios again: layers were taken out.",
        )
    before, after = (one["status"].astype(np.int64) for one in (first, second))
    count = len(Status)
    pairs = np.bincount((before * count + after).ravel(), minlength=count**2).reshape(count, count)
    statuses = {(Status(int(i)), Status(int(j))): int(pairs[i, j]) for i, j in np.argwhere(pairs) if i != j}
    return Difference(tuple(ranges), statuses, first.theta, first.phi, (first.seed, second.seed))


def difference_json(found: Difference, about: Mapping[str, Any]) -> str:
    """Return a comparison as the text of ``difference.json``, with what is said of it besides."""
    statuses = [
        {"from": before.name, "to": after.name, "count": number}
        for (before, after), number in sorted(found.statuses.items(), key=lambda pair: -pair[1])
    ]
    ranges = {one.name: one.numbers() for one in found.ranges}
    return json_text({**about, "seeds": list(found.seeds), "ranges": ranges, "status_changes": statuses})


def normal_beyond(sigmas: float) -> float:
    """Return the share of a normal distribution that lies farther than so many σ from its mean, on either side."""
    return float(2.0 * ndtr(-sigmas))


def _check_same_scan(first: RangeImage | ShotTable, second: RangeImage | ShotTable) -> None:
    remedy = "Compare results of one scan: run the same scan block with another seed, instrument or scene."
    if isinstance(first, RangeImage) != isinstance(second, RangeImage):
        raise InputError("one result is a raster, and the other is a table of shots.", remedy=remedy)
    if first.shape != second.shape:
        one, other = (" × ".join(map(str, result.shape)) for result in (first, second))
        raise InputError(f"the results are of different scans: {one} and {other}.", remedy=remedy)
    for name, word in (("theta", "Θ"), ("phi", "φ")):
        away = np.abs(getattr(first, name) - getattr(second, name)).max()
        if away > _SAME_AIM:
            raise InputError(
                f"the results are of different scans: {word} differs by up to {math.degrees(away):.3g}°.",
                remedy=remedy,
            )


def _range_difference(
    first: RangeImage | ShotTable, second: RangeImage | ShotTable, prefix: str
) -> RangeDifference:
    (r1, r2), (s1, s2) = (
        [one[f"{prefix}{name}"].astype(np.float64) for one in (first, second)]
        for name in ("range_m", "sigma_range_m")
    )
    there1, there2 = np.isfinite(r1), np.isfinite(r2)
    return RangeDifference(WAYS[prefix], r2 - r1, np.hypot(s1, s2), there1 & ~there2, there2 & ~there1)


def _mean(values: Array) -> float | None:
    return float(values.mean()) if values.size else None


def _median(values: Array) -> float | None:
    return float(np.median(values)) if values.size else None


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None
