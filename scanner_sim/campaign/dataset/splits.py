"""Which views train, validate and test, so that none of what may be learnt by heart stands in two of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from scanner_sim.campaign.dataset.views import View, ViewedObject, backdrop_of
from scanner_sim.foundation.errors import InputError

SPLITS = ("train", "validation", "test")
"""The splits, in the order in which their shares are given."""
APART = ("object", "pose")
"""What may not stand in two splits."""


@dataclass(frozen=True)
class Splits:
    """The split of each view.

    Attributes
    ----------
    of_view
        Of each view, in their order; empty for those that are left out, since they would tie two splits together.
    apart
        What no two splits share.
    backdrop
        Names of objects that stand in every view alike, and count for nothing.
    """

    of_view: tuple[str, ...]
    apart: tuple[str, ...]
    backdrop: frozenset[str]

    def count(self, split: str) -> int:
        """Return the number of views of a split; of those that are left out for an empty word."""
        return self.of_view.count(split)


def split_views(views: Sequence[View], shares: Sequence[float], apart: Sequence[str], seed: int) -> Splits:
    """Divide views among the splits.

    Shapes are divided first: those that are seen together stay together. Then poses are: one that only shapes of one
    split have goes with them. A view all of whose shapes and poses are of one split belongs to it; another is left out.
    A split that is alone has all views.

    Parameters
    ----------
    views
        The views.
    shares
        Of train, validation and test, in any measure.
    apart
        Words of :data:`APART`.
    seed
        Of the order in which shapes and poses are taken.

    Raises
    ------
    InputError
        If there are fewer shapes or poses than splits, or a split would be empty.
    """
    wanted = {name: share / sum(shares) for name, share in zip(SPLITS, shares, strict=True) if share > 0.0}
    backdrop, rng = backdrop_of(views), np.random.default_rng(np.random.SeedSequence([seed, 2]))
    if len(wanted) == 1:
        # There is no other split with which a view could share anything.
        return Splits(tuple(wanted) * len(views), tuple(apart), backdrop)
    seen = [[one for one in view.objects if one.name not in backdrop] for view in views]
    shapes = [_keys(one, "object", apart) for one in seen]
    of_shape = _divided(_together(shapes), shapes, wanted, rng, "object") if "object" in apart else {}
    poses = [_keys(one, "pose", apart) for one in seen]
    of_pose: dict[str, str] = {}
    if "pose" in apart:
        of_pose = _of_their_shapes(poses, shapes, of_shape)
        free = [[pose for pose in own if pose not in of_pose] for own in poses]
        groups = _together(free)
        of_pose |= _divided(groups, free, wanted, rng, "pose", already=len(set(of_pose.values())))
    found = tuple(
        _only({of_shape[key] for key in of} | {of_pose[key] for key in at})
        for of, at in zip(shapes, poses, strict=True)
    )
    for name in wanted:
        if name not in found:
            raise InputError(
                f"no view is left for {name}: each shares an object or a pose with another split.",
                remedy="Vary more objects and poses in the plan, or divide by one of them: --apart object.",
            )
    return Splits(found, tuple(apart), backdrop)


def _keys(objects: Iterable[ViewedObject], kind: str, apart: Sequence[str]) -> list[str]:
    if kind not in apart:
        return []
    return sorted({one.shape if kind == "object" else one.pose for one in objects})


def _only(splits: set[str]) -> str:
    return next(iter(splits)) if len(splits) == 1 else ""


def _of_their_shapes(
    poses: Sequence[Sequence[str]], shapes: Sequence[Sequence[str]], of_shape: Mapping[str, str]
) -> dict[str, str]:
    """Return the split of each pose that only shapes of one split have."""
    asked: dict[str, set[str]] = {}
    for own, of in zip(poses, shapes, strict=True):
        for pose in own:
            asked.setdefault(pose, set()).update(of_shape[key] for key in of)
    return {pose: _only(splits) for pose, splits in asked.items() if len(splits) == 1}


def _together(keys: Sequence[Sequence[str]]) -> list[set[str]]:
    """Return sets of keys of which any two that a view has together are in one."""
    group: dict[str, set[str]] = {}
    for own in keys:
        joined = set().union(*(group.get(key, {key}) for key in own))
        group |= dict.fromkeys(joined, joined)
    return [group[key] for key in sorted(group) if key == min(group[key])]


def _divided(
    groups: Sequence[set[str]],
    keys: Sequence[Sequence[str]],
    wanted: Mapping[str, float],
    rng: np.random.Generator,
    kind: str,
    already: int = 0,
) -> dict[str, str]:
    """Return a split for each key: group by group to where most views are missing."""
    if max(len(groups), already) < len(wanted):
        plural = f"{kind}s"
        problem = (
            f"the views show {len(groups)} {plural if len(groups) != 1 else kind} that are not always together"
            if groups
            else f"no {kind} varies"
        )
        other = next(word for word in APART if word != kind)
        raise InputError(
            f"{problem}, and {len(wanted)} splits without a common {kind} need as many.",
            remedy=f"Vary more {plural} in the plan, or divide the views by the other alone: --apart {other}.",
        )
    views = Counter(key for own in keys for key in own)
    size = [max(views[key] for key in group) for group in groups]
    missing = {name: share * sum(size) for name, share in wanted.items()}
    found: dict[str, str] = {}
    order = rng.permutation(len(groups))
    for count, place in enumerate(order):
        empty = [name for name in wanted if name not in found.values()]
        # The last groups go to splits that have none yet, so that a small share gets one.
        choice = empty if len(empty) >= len(order) - count else list(wanted)
        split = max(choice, key=lambda name: missing[name])
        missing[split] -= size[place]
        found |= dict.fromkeys(groups[place], split)
    return found
