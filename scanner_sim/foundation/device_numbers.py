"""Numbers as kernels take them: values that no kernel is compiled for."""

from __future__ import annotations

from typing import Any

import drjit as dr

from scanner_sim.foundation.device_types import FloatLike


def beside(array: FloatLike, *numbers: float) -> tuple[Any, ...]:
    """Return numbers for a law that is written for numbers, NumPy and Dr.Jit arrays alike.

    Parameters
    ----------
    array
        What the law is asked for.
    numbers
        Its parameters, each in double precision.

    Returns
    -------
    tuple
        The numbers themselves; beside a Dr.Jit array in single precision and on the device. There a literal would be
        part of the kernel, so that each number would have a kernel of its own.
    """
    if not dr.is_jit_v(array):
        return numbers
    return tuple(dr.opaque(type(array), number) for number in numbers)


def over(dividend: FloatLike, divisor: float) -> FloatLike:
    """Return quotients by a number as :func:`beside` takes it; on the device times its reciprocal, as by a literal."""
    return dividend * dr.rcp(*beside(dividend, divisor)) if dr.is_jit_v(dividend) else dividend / divisor
