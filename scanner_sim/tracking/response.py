"""Which voxels of a pattern hit the target: by intensity and range together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.status import BELOW_THRESHOLD, Status
from scanner_sim.tracking.samples import PatternSamples

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = TypeVar("Kind", bound=np.generic)

FEWEST_VOXELS = 4
"""Fewest voxels on the target and off it that make a target; a glint is fewer."""
CLEAR_DIFFERENCE = 5.0
"""Distance of the two levels, over the scatter within them, from which they are two: halves of noise have 2.8."""

_BEYOND = 0.75
"""How far light that is clipped counts as brighter than all that was measured, over the range of what was: beyond noise
where the rest is ground alone, and not so far that a disc of which the rest is just not clipped counts as dark."""
_MEAN_OF_EVEN = math.sqrt(3.0)
"""Mean of an even distribution that begins at 0, over its standard deviation."""
GLINT_DISTANCE = 3.0
"""Distance from the threshold, over that of the levels, from which a value is neither: a glint."""


class TargetKind(StrEnum):
    """What makes a target differ from what surrounds it."""

    BLACK = "black"
    """A dark disc on a bright ground."""
    WHITE = "white"
    """A bright disc on a dark ground, or on none."""
    RETRO = "retro"
    """A retro-reflector: bright, and possibly saturated."""
    RAISED = "raised"
    """A feature nearer than what is behind it: a disc's edge in range, a sphere."""
    HOLE = "hole"
    """A feature farther than what surrounds it, or without any return."""

    @property
    def by_range(self) -> bool:
        """Whether the range tells it, and not the intensity."""
        return self in (TargetKind.RAISED, TargetKind.HOLE)


@dataclass(frozen=True)
class Response:
    """What patterns say of a target; shapes (patterns, points) and (patterns,).

    Attributes
    ----------
    value, sigma
        Intensity or range that was looked at, and its standard deviation, (patterns, points).
    used
        Voxels that count, (patterns, points).
    hit
        Voxels on the target, (patterns, points).
    threshold
        Level between target and ground, (patterns,).
    target, ground
        Both levels, (patterns,).
    fraction
        Share of the voxels that count which hit, (patterns,).
    clear
        Whether there are two levels that noise does not explain, (patterns,).
    clipped
        Voxels brighter than can be measured, (patterns, points).
    """

    value: Array
    sigma: Array
    used: Mask
    hit: Mask
    threshold: Array
    target: Array
    ground: Array
    fraction: Array
    clear: Mask
    clipped: Mask

    def of(self, rows: NDArray[np.intp]) -> Response:
        """Return some of the patterns, also more than once."""
        return Response(**{name: part[rows] for name, part in vars(self).items()})

    def repeated(self, rows: int) -> Response:
        """Return so many rows: the patterns again and again."""
        if rows == len(self.clear):
            return self
        return Response(**{name: repeated(part, rows) for name, part in vars(self).items()})


def repeated(values: NDArray[Kind], rows: int) -> NDArray[Kind]:
    """Return so many rows of an array: its own again and again."""
    return values if rows == len(values) else np.concatenate([values] * (rows // len(values)))


def target_response(samples: PatternSamples, kind: TargetKind, gate: ArrayLike) -> Response:
    """Return which voxels hit a target of a kind.

    Parameters
    ----------
    samples
        The patterns.
    kind
        What the target is.
    gate
        Nearest and farthest range [m] of target and ground, shape (2,) or (patterns, 2).

    Returns
    -------
    Response
        Intensity: voxels outside of the gate do not count, whatever their light; of retro-reflectors one that is
        saturated, or so bright that its light was not measured, counts as brighter than all others. A voxel without a
        peak has any light from none to the faintest that is found, an even distribution of the mean √3 σ; what is left
        open of a dark surface is so of all its voxels alike, so that n of them tell no more than one: each has σ √n,
        and no less than any voxel with a peak, for light beneath it that is not known may hide one, too. Range: what
        has no return, or one from behind the gate, counts as lying at the gate's far end.
        The level between target and ground is :func:`two_levels` of the pattern's own voxels; what is three times
        their distance away from it counts no longer.
    """
    ends = np.asarray(gate, dtype=np.float64)
    clipped = np.zeros(samples.status.shape, dtype=np.bool_)
    near, far = ends[..., :1], ends[..., 1:]
    measured = samples.valid
    inside = measured & (samples.range >= near) & (samples.range <= far)
    nothing = samples.status == BELOW_THRESHOLD
    used = inside | nothing
    if kind.by_range:
        # What is seen behind the gate is behind the target, or through the hole.
        used |= measured & (samples.range > far)
        value = np.where(inside, samples.range, far)
        known = np.where(inside, samples.sigma_range, np.nan)
    else:
        faint = used & ~(samples.signal > 0.0)
        known = np.where(used, samples.sigma_signal, np.nan)
        value = np.where(faint, _MEAN_OF_EVEN * np.where(known > 0.0, known, 0.0), samples.signal)
        value = np.where(np.isfinite(value), value, 0.0)
        least_sure = np.nanmax(np.where(inside & ~faint, known, 0.0), axis=1, keepdims=True)
        alone = np.maximum(known * np.sqrt(faint.sum(axis=1, keepdims=True)), least_sure)
        known = np.where(faint, alone, known)
        if kind is TargetKind.RETRO:
            # So bright that it is refused elsewhere, or beyond what the sensor holds.
            bright = samples.status == Status.BAD_AMPLITUDE
            clipped = (samples.status == Status.SATURATED) | (bright & ~(samples.signal > 0.0))
            used |= bright | clipped
            value = np.where(clipped, _beyond(value, used & ~clipped), value)
    # What was not measured is as uncertain as the rest of its pattern is at most.
    count = np.isfinite(known)
    most = np.max(np.where(count, known, 0.0), axis=1, keepdims=True)
    sigma = np.where(count & (known > 0.0), known, np.where(most > 0.0, most, 1.0))
    threshold, low, high, clear = two_levels(value, used)
    far_off = np.abs(value - threshold[:, None]) > GLINT_DISTANCE * (high - low)[:, None]
    used &= ~(far_off & clear[:, None])
    below = kind in (TargetKind.BLACK, TargetKind.RAISED)
    hit = used & ((value < threshold[:, None]) if below else (value > threshold[:, None]))
    hits, counted = hit.sum(axis=1), used.sum(axis=1)
    return Response(
        value=value,
        sigma=sigma,
        used=used,
        hit=hit & clear[:, None],
        threshold=threshold,
        target=low if below else high,
        ground=high if below else low,
        fraction=np.where(clear, hits / np.maximum(counted, 1), 0.0),
        clear=clear,
        clipped=clipped,
    )


def _beyond(value: Array, measured: Mask) -> Array:
    """Return a value above all that were measured, shape (patterns, 1): see :data:`_BEYOND`."""
    most = np.max(np.where(measured, value, -np.inf), axis=1, keepdims=True)
    least = np.min(np.where(measured, value, np.inf), axis=1, keepdims=True)
    return np.asarray(np.where(measured.any(axis=1, keepdims=True), most + _BEYOND * (most - least), 0.0))


def two_levels(value: Array, used: Mask) -> tuple[Array, Array, Array, Mask]:
    """Return the level that parts each pattern's values in two, both means, and whether they are two.

    Parameters
    ----------
    value, used
        Values and which of them count, shape (patterns, points).

    Returns
    -------
    threshold, low, high, clear
        Each of shape (patterns,). The split is that of the least scatter within both parts (Otsu, *IEEE Transactions on
        Systems, Man, and Cybernetics* 9, 1979), among those that leave four values in each. Before, the three largest
        and the three smallest values are set to the fourth: a few glints cannot make a level of their own. The
        threshold is midway between the parts' medians, which values on the edge hardly move. ``clear`` where these lie
        apart by five median deviations (times 1.48) within the part that holds more values: the other one, where a
        pattern runs along a rim, is partly what lies between the levels.
    """
    order = np.sort(np.where(used, value, np.inf), axis=1)
    count, points = used.sum(axis=1), value.shape[1]
    possible, position = count >= 2 * FEWEST_VOXELS, np.arange(1, points + 1)
    inside = position <= count[:, None]
    rows = np.arange(len(order))
    # Where too few count, the ends are beyond all values: nothing is clipped, and nothing comes of it.
    low = np.where(possible, order[:, FEWEST_VOXELS - 1], -np.inf)
    high = np.where(possible, order[rows, np.maximum(count - FEWEST_VOXELS, 0)], np.inf)
    clipped = np.minimum(np.maximum(order, low[:, None]), np.maximum(low, high)[:, None])
    order = np.where(inside, clipped, 0.0)
    below = np.cumsum(order, axis=1)
    # The scatter between two parts of k and n − k values is (n Σ_k − k Σ)²/(n k (n − k)).
    between = (count[:, None] * below - position * below[:, -1:]) ** 2 / (
        position * np.maximum(count[:, None] - position, 1)
    )
    allowed = (position >= FEWEST_VOXELS) & (position <= count[:, None] - FEWEST_VOXELS)
    split = np.where(possible, 1 + np.argmax(np.where(allowed, between, -1.0), axis=1), FEWEST_VOXELS)
    first, second = _median(
        order, np.array([0 * split, split]), np.array([split, np.maximum(count, split + 1)])
    )
    part = position <= split[:, None]
    away = np.abs(order - np.where(part, first[:, None], second[:, None]))
    # The smaller part is mostly rim where a pattern runs along it, and few values may be alike by chance.
    larger = 2 * split >= count
    some = np.where(larger[:, None], part & inside, inside & ~part)
    size = np.where(larger, split, np.maximum(count - split, 1))
    scatter = _median(np.sort(np.where(some, away, np.inf), axis=1), 0 * split, size)
    clear = possible & (second - first > CLEAR_DIFFERENCE * 1.4826 * scatter) & (second > first)
    return 0.5 * (first + second), first, second, clear


def _median(order: Array, start: NDArray[np.int64], stop: NDArray[np.int64]) -> Array:
    """Return the medians of sorted rows between positions, shape (..., rows)."""
    rows, last, middle = np.arange(len(order)), order.shape[1] - 1, start + stop
    low, high = order[rows, np.minimum((middle - 1) // 2, last)], order[rows, np.minimum(middle // 2, last)]
    found = 0.5 * (low + high)
    return np.where(np.isfinite(found), found, 0.0)
