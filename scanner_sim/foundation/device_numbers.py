"""Numbers as kernels take them: values that no kernel is compiled for."""

from __future__ import annotations

import sys
from typing import Any

from scanner_sim.foundation.device_types import FloatLike


def beside(array: FloatLike, *numbers: FloatLike) -> tuple[Any, ...]:
    """Return numbers for a law that is written for numbers, NumPy and Dr.Jit arrays alike.

    Parameters
    ----------
    array
        What the law is asked for.
    numbers
        Its parameters, each in double precision, or on the device already.

    Returns
    -------
    tuple
        The numbers themselves; beside a Dr.Jit array in single precision and on the device. There a literal would be
        part of the kernel, so that each number would have a kernel of its own.
    """
    dr = _library_of(array)
    return (
        numbers
        if dr is None
        else tuple(number if dr.is_array_v(number) else dr.opaque(type(array), number) for number in numbers)
    )


def over(dividend: FloatLike, divisor: float) -> FloatLike:
    """Return quotients by a number as :func:`beside` takes it; on the device times its reciprocal, as by a literal."""
    dr = _library_of(dividend)
    return dividend / divisor if dr is None else dividend * dr.rcp(*beside(dividend, divisor))


def _library_of(array: FloatLike) -> Any:
    """Return Dr.Jit for one of its arrays, else None; laws of numbers alone do not load it."""
    dr = sys.modules.get("drjit")
    return dr if dr is not None and dr.is_jit_v(array) else None
