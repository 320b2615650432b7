"""Which runs are made together, and by whom: those of the same scene and light next to one another, on one worker."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import NDArray

from scanner_sim.campaign.plan import Group, Values
from scanner_sim.campaign.runs import Campaign
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import inline_yaml

Numbers = NDArray[np.int64]

LASTING = (("scene",), ("scene", "lighting", "transport", "scan"))
"""Blocks of a scenario whose change costs most: first those by which a scene is built, then those of its background."""
MOST_RUNS = 64
"""Runs of a batch, where they are small: more save little, and a batch is what a killed worker loses."""
_MOST_VOXELS = 65536
"""Voxels of a batch of images: more are no cheaper."""
MOST_TRACKS = 32
"""Tracking runs of a batch."""
FEWEST_RUNS = 4
"""Runs below which batches are not cut to leave something for every worker at the end."""


def most_together(scenario: Scenario) -> int:
    """Return how many runs like a scenario make a batch."""
    if scenario.scan.layout == "visits":
        return MOST_TRACKS
    return max(1, min(MOST_RUNS, _MOST_VOXELS // scenario.open_scan.shots))


class Batches:
    """Runs that are left, given out in batches.

    Each worker goes through a set of runs that share scene and light, then takes the next set; who finds none left
    takes half of what another has before him. No row depends on any of it.

    Parameters
    ----------
    campaign
        What the runs are of.
    left
        Their numbers, shape (n,).
    """

    def __init__(self, campaign: Campaign, left: Numbers) -> None:
        self._runs, self._sets = _in_order(campaign, left)
        self._most = most_together(campaign.base)
        self._left = len(self._runs)
        self._next = 0
        self._own: dict[Hashable, tuple[int, int]] = {}

    def __len__(self) -> int:
        """Return the number of runs that nobody has taken."""
        return self._left

    def take(self, worker: Hashable, workers: int = 1) -> list[int]:
        """Return the next runs for a worker, one of so many; none where none are left."""
        found: list[int] = []
        size = self._size(workers)
        while self._left and len(found) < size:
            first, end = self._own.pop(worker, (0, 0))
            if first == end:
                first, end = self._another(bool(found))
            if first == end:
                break
            taken = min(end, first + size - len(found))
            found += self._runs[first:taken].tolist()
            self._left -= taken - first
            if taken < end:
                self._own[worker] = (taken, end)
        return found

    def _size(self, workers: int) -> int:
        """Return the runs of the next batch: fewer towards the end, so that no worker waits long for another."""
        share = self._left / max(workers, 1)
        return min(self._most, max(math.ceil(share / 2.0), min(FEWEST_RUNS, math.ceil(share))))

    def _another(self, enough: bool) -> tuple[int, int]:
        """Return a set that nobody has begun or, unless there is enough already, half of the longest that is left."""
        if self._next < len(self._sets) - 1:
            self._next += 1
            return int(self._sets[self._next - 1]), int(self._sets[self._next])
        if enough or not self._own:
            return 0, 0
        other = max(self._own, key=lambda one: self._own[one][1] - self._own[one][0])
        first, end = self._own.pop(other)
        middle = (first + end) // 2
        if first < middle:
            self._own[other] = (first, middle)
        return middle, end


def _in_order(campaign: Campaign, left: Numbers) -> tuple[Numbers, Numbers]:
    """Return runs in the order in which they are made, and where in it sets of one scene and light begin and end."""
    shape = campaign.plan.shape
    axes = np.unravel_index(left, shape)
    lasting = [
        ranks[axis]
        for blocks in LASTING
        for group, axis in zip(campaign.plan.vary, axes, strict=False)
        if (ranks := _ranks(group, blocks)) is not None
    ]
    order = np.lexsort((left, *reversed(lasting)))
    changes = np.zeros(max(len(left) - 1, 0), dtype=np.bool_)
    for one in lasting:
        changes |= np.diff(one[order]) != 0
    starts = np.flatnonzero(changes) + 1
    return left[order], np.array([0, *starts, len(left)], dtype=np.int64)


def _ranks(group: Group, blocks: Sequence[str]) -> Numbers | None:
    """Return a number for each point of a group, equal where its keys in some blocks are; None where it has none."""
    keys = [values for key, values in group.keys.items() if key.partition(".")[0] in blocks]
    if not keys:
        return None
    known: dict[tuple[str, ...], int] = {}
    return np.array(
        [
            known.setdefault(tuple(_word(values, point) for values in keys), point)
            for point in range(group.length)
        ],
        dtype=np.int64,
    )


def _word(values: Values, point: int) -> str:
    """Return what is equal for equal values of a key; those that are drawn or spaced all differ."""
    return str(point) if values.list is None else inline_yaml(values.list[point])
