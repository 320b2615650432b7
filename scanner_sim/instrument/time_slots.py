"""Time slots: how long a background holds that was rendered of moving objects at one moment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import product
from scanner_sim.render.settings import LONGEST_SLOT, slot_halvings
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.scene.objects import Posed

_SPEED_INSTANTS = np.linspace(0.0, 1.0, 5)
"""Moments of a block at which speeds are looked at."""
_NEAREST_PART = 0.1
"""Distance [m] below which a part of a moving object counts as being there: it may lie around the scanner."""

Array = NDArray[np.float64]
Slot = tuple[int, int]
"""Number of a slot, counted from time 0, and how often the longest one was halved for it."""


class TimeSlots:
    """The time slots of a scene: powers of two of a second in which its fastest object moves by one bin at most.

    Parameters
    ----------
    loaded
        The scene.
    step
        Angle of a bin [rad].
    items
        The moving objects, where they are not those that were loaded.
    """

    def __init__(self, loaded: LoadedScene, step: float, items: Sequence[Posed] | None = None) -> None:
        self.items = tuple(body.item for body in loaded.bodies) if items is None else items
        self._loaded, self._step = loaded, step
        self._halvings: dict[int, int] = {}

    def at(self, time: float) -> Slot:
        """Return the slot of a moment [s]; where nothing moves there is one only."""
        if not self._loaded.bodies:
            return 0, 0
        block = math.floor(time / LONGEST_SLOT)
        if block not in self._halvings:
            speed = self._speed(LONGEST_SLOT * (block + _SPEED_INSTANTS))
            self._halvings[block] = slot_halvings(speed, self._step)
        halvings = self._halvings[block]
        return math.floor(time / LONGEST_SLOT * 2**halvings), halvings

    def _speed(self, time: NDArray[np.float64]) -> float:
        """Return the largest speed of corners of moving objects' boxes [rad/s], as the scanner sees it."""
        fastest, apart = 0.0, 1e-3
        for corners, item in zip(corners_of(self._loaded), self.items, strict=True):
            moved = angles_moved(corners, item.pose_at(time - apart), item.pose_at(time + apart))
            fastest = max(fastest, float(moved.max()) / (2.0 * apart))
        return fastest


def by_slot(aim: Aim, slots: TimeSlots) -> Iterator[tuple[NDArray[np.intp], float]]:
    """Yield the shots of an aim slot by slot, each as indices of shape (n,) and the slot's middle [s]."""
    found: dict[Slot, list[int]] = {}
    for index, time in enumerate(aim.time.tolist()):
        found.setdefault(slots.at(time), []).append(index)
    for slot, shots in found.items():
        yield np.array(shots, dtype=np.intp), middle(slot)


def corners_of(loaded: LoadedScene) -> list[Array]:
    """Return the corners of the boxes about moving objects, each of shape (3, 8) [m], in the objects' frames."""
    boxes = [body.mitsuba.bbox() for body in loaded.bodies]
    return [np.array([np.asarray(box.corner(number)).ravel() for number in range(8)]).T for box in boxes]


def angles_moved(corners: Array, before: Array, after: Array) -> Array:
    """Return by how much corners move from pose to pose as the scanner sees them [rad], shape (n, 8).

    ``corners`` of shape (3, 8) and poses of shape (n, 4, 4).
    """
    first, then = (product(pose[:, :3, :3], corners) + pose[:, :3, 3:] for pose in (before, after))
    distance = np.maximum(np.linalg.norm(then, axis=1), _NEAREST_PART)
    return np.asarray(np.linalg.norm(then - first, axis=1) / distance)


def middle(slot: Slot) -> float:
    """Return the moment in the middle of a slot [s]."""
    number, halvings = slot
    return (number + 0.5) * LONGEST_SLOT * 0.5**halvings
