"""Values of the pixels about a peak, which a loop of a kernel reads by number.

What is written out for each pixel is compiled for each: with the modes of speckle, some hundreds of operations times up
to 49 pixels. A loop is compiled once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.foundation.device_types import Float, Int32, Local, UInt32


def row_of(values: Sequence[Float]) -> Local:
    """Return values of m shots, each of shape (m,) or (1,), as an array of each lane's own."""
    row = dr.alloc_local(auto.Float, len(values), auto.Float(0.0))
    for number, value in enumerate(values):
        row.write(auto.Float(value), auto.UInt32(number))
    return row


def read_rows(around: Any, reach: int, guard: Int32) -> list[Local]:
    """Return what is read about each peak at the steps from −``reach`` to ``reach``.

    Returns
    -------
    list
        The charges above the baseline, the variances of the whole charges, and 1 where a pixel counts, else 0: on the
        array and within ``guard`` of the brightest one.
    """

    def read(number: UInt32, rows: list[Local]) -> tuple[list[Local]]:
        step = auto.Int32(number) - reach
        counts = around.inside(step) & (dr.abs(step) <= guard)
        for row, value in zip(rows, (*around(step), dr.select(counts, 1.0, 0.0)), strict=True):
            row.write(value, number)
        return (rows,)

    count = 2 * reach + 1
    (rows,) = for_each(count, read, [dr.alloc_local(auto.Float, count) for _ in range(3)])
    return list(rows)


def for_each(count: int, add: Callable[..., tuple[Any, ...]], *state: Any) -> tuple[Any, ...]:
    """Return a state after a loop over the numbers 0 to ``count`` − 1.

    Parameters
    ----------
    count
        How many turns; no kernel of its own is compiled for it.
    add
        Takes the number and the state, and returns the state.
    state
        Dr.Jit arrays, lists of them and rows, all that changes and every row that is read.
    """
    last = dr.opaque(auto.UInt32, count)

    def turn(number: UInt32, *state: Any) -> tuple[Any, ...]:
        return number + 1, *add(number, *state)

    start: Any = (auto.UInt32(0), *state)
    ended: Any = dr.while_loop(start, lambda number, *state: number < last, turn)
    return tuple(ended[1:])
