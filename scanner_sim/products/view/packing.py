"""Arrays as text of a page: what the browser turns back into typed arrays."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

TYPES = ("u1", "u2", "i2", "i4", "f4")
"""Types of numbers in a page, all with their lowest byte first."""

WHOLE_MANTISSA = 23
"""Bits of the fraction of a number in single precision."""


def packed(values: NDArray[Any], bits: int = WHOLE_MANTISSA) -> dict[str, Any]:
    """Return an array as its type, its shape and its bytes in base64.

    First stand the lowest bytes of all numbers, then the next ones, all compressed (zlib, RFC 1950): bytes of one place
    are alike. There is one NaN.

    Parameters
    ----------
    values
        Any shape; of :data:`TYPES`, or floats, which become single precision.
    bits
        Bits of the fraction that are kept of a float, 1 to 23: the relative error is 2^−(bits + 1) at most.

    Raises
    ------
    ValueError
        If the numbers are of another type.
    """
    if values.dtype.kind == "f":
        values = rounded(values.astype(np.float32), bits)
    kind = values.dtype.str[1:]
    if kind not in TYPES:
        raise ValueError(f"a page has no numbers of type {values.dtype}")
    low_first = np.ascontiguousarray(values.astype(f"<{kind}")).reshape(-1)
    planes = low_first.view(np.uint8).reshape(low_first.size, values.dtype.itemsize).T
    data = zlib.compress(np.ascontiguousarray(planes).tobytes(), 6)
    return {"type": kind, "shape": list(values.shape), "data": base64.b64encode(data).decode("ascii")}


def rounded(values: NDArray[np.float32], bits: int) -> NDArray[np.float32]:
    """Return numbers with so many bits of their fractions, rounded to the nearest; NaN and infinity stay."""
    finite = np.isfinite(values)
    away = WHOLE_MANTISSA - bits
    as_bits = np.where(finite, values, np.float32(0.0)).view(np.uint32)
    half = np.uint32((1 << away) >> 1)
    kept = ((as_bits + half) >> np.uint32(away)) << np.uint32(away)
    whole = np.where(np.isnan(values), np.float32(np.nan), values)
    return np.where(finite, kept.view(np.float32), whole)


def unpacked(said: dict[str, Any]) -> NDArray[Any]:
    """Return what :func:`packed` was given, as the browser reads it."""
    kind = np.dtype(f"<{said['type']}")
    planes = np.frombuffer(zlib.decompress(base64.b64decode(said["data"])), dtype=np.uint8)
    bytes_of = np.ascontiguousarray(planes.reshape(kind.itemsize, -1).T)
    return bytes_of.reshape(-1).view(kind).reshape(said["shape"])
