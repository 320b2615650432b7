"""The even sequences by which a panorama's first surfaces send light on."""

from __future__ import annotations

from typing import Any

import drjit.auto.ad as auto
import mitsuba
import numpy as np
import pytest
from claims import mean
from numpy.typing import NDArray
from scipy.optimize import brentq

from scanner_sim.render.background.panorama import _Pattern

Array = NDArray[np.float64]
mi: Any = mitsuba
ROWS = 2000

pytestmark = pytest.mark.usefixtures("device")


def golden(dimensions: int) -> Array:
    """Return the steps of Roberts' sequence: 1/g, 1/g², … with g the root above 1 of g^(d + 1) = g + 1."""
    g = brentq(lambda x: x ** (dimensions + 1) - x - 1.0, 1.0, 2.0)
    return float(g) ** -np.arange(1.0, dimensions + 1.0)


def numbers(
    number: int = 0, shift: float = 0.0, draw: float = 0.0, half: int = 0, count: int = 4, place: int = 3
) -> Array:
    """Return the seven numbers of each of many rows: four for Sun and Earth, three for lobe and direction."""
    rows = auto.UInt32(np.arange(ROWS, dtype=np.uint32))
    even, many = _Pattern(5, rows, auto.UInt32(half), auto.UInt32(place)), auto.UInt32(count)
    moved = mi.Vector4f(*(auto.Float(shift * (axis + 1)) for axis in range(4)))
    drawn = mi.Vector4f(auto.Float(0.9), auto.Float(draw), auto.Float(0.77), auto.Float(0.5))
    light = even.light(auto.UInt32(number), many, moved)
    rest = even.scatter(auto.UInt32(number), many, moved, drawn)
    np.testing.assert_allclose(rest[3].numpy(), 0.77)
    parts = [*(light[axis] for axis in range(4)), *(rest[axis] for axis in range(3))]
    return np.array([np.broadcast_to(part.numpy(), ROWS) for part in parts], dtype=np.float64)


def test_each_number_begins_anywhere_by_itself() -> None:
    """Claim: over rows and halves the seven numbers are even and know nothing of each other: the mean of 12 (u − ½)² is
    1, and those of 12 (u − ½)(u′ − ½) of all pairs are 0."""
    start = np.concatenate([numbers(), numbers(half=1)])
    assert ((start >= 0.0) & (start < 1.0)).all()
    centred = np.sqrt(12.0) * (start - 0.5)
    level = 1e-4 / (14 * 15 / 2)
    for one in range(14):
        for other in range(one + 1):
            assert mean(centred[one] * centred[other], 1.0 if one == other else 0.0, level=level), (
                one,
                other,
            )


def test_numbers_go_on_by_the_golden_ratios() -> None:
    """Claim: from one to the next Sun, Earth and lobe go on by the ratios of eight dimensions and the direction by
    those of two, modulo 1, also from the last of four of a bin to the first of the next; what moves them at random is a
    share of a step of all 16 bins' sequence: its root for two numbers together."""
    steps = np.concatenate([golden(8)[:5], golden(2)])
    first = numbers()
    for number in (1, 7):
        apart = numbers(number) - first
        np.testing.assert_allclose(
            np.abs(np.exp(2j * np.pi * (apart - number * steps[:, None])) - 1.0), 0.0, atol=1e-5
        )
    np.testing.assert_allclose(numbers(number=2, place=4), numbers(number=6), atol=1e-7)
    for count in (2, 9):
        still = numbers(count=count)
        moved, share = numbers(shift=0.1, draw=0.3, count=count) - still, 1.0 / (16 * count)
        width = share**0.5
        wanted = np.array([0.1, 0.2, 0.3, 0.4, 0.0, 0.1, 0.2]) * width
        wanted[4] = 0.3 * share
        np.testing.assert_allclose(
            np.abs(np.exp(2j * np.pi * (moved - wanted[:, None])) - 1.0), 0.0, atol=1e-5
        )
