"""Memory that NumPy and the device's kernels share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from scanner_sim.foundation.device_types import Float, UInt32

_ALIGNMENT = 64
"""Bytes of the widest load of a processor."""


def for_device(values: ArrayLike, kind: DTypeLike = np.float32) -> NDArray[Any]:
    """Return a copy of values, flat, for an array of Dr.Jit.

    Dr.Jit takes NumPy's memory as it lies, and compiles a kernel for each alignment of what it reads. This memory
    always lies alike, and goes on for the length of a load beyond its end.
    """
    given = np.asarray(values)
    kind = np.dtype(kind)
    memory = np.empty(given.size * kind.itemsize + 2 * _ALIGNMENT, dtype=np.uint8)
    start = -memory.ctypes.data % _ALIGNMENT
    found = memory[start : start + given.size * kind.itemsize].view(kind)
    found[:] = given.ravel()
    return found


def side_by_side(columns: Sequence[Float | UInt32]) -> Float:
    """Return columns of n numbers each, one after the other, whole ones as floats, shape (columns · n,), Dr.Jit.

    To fetch an array costs more than to fetch its numbers.
    """
    count = dr.width(columns[0])
    lane, every = dr.arange(auto.UInt32, count), dr.empty(auto.Float, len(columns) * count)
    for place, column in enumerate(columns):
        at = lane + dr.opaque(auto.UInt32, place * count)
        dr.scatter(every, auto.Float(column), at, mode=dr.ReduceMode.Permute)
    dr.eval(every)
    return every
