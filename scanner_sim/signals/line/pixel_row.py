"""Values of the pixels about a peak, which a loop of a kernel reads by number.

With the modes of speckle, a pixel is some hundreds of operations, and up to 49 of them count.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.foundation.device_loops import for_each
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
