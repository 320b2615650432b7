"""Memory of NumPy as the device's kernels read it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

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
