"""Loops of kernels over numbers: what is written out for each number is compiled for each, a loop is compiled once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.foundation.device_types import UInt32


def for_each(
    count: int, add: Callable[..., tuple[Any, ...]], *state: Any, one_kernel: bool = True
) -> tuple[Any, ...]:
    """Return a state after a loop over the numbers 0 to ``count`` − 1.

    Parameters
    ----------
    count
        How many turns; no kernel of its own is compiled for it.
    add
        Takes the number and the state, and returns the state.
    state
        Dr.Jit arrays, lists of them and rows, all that changes and every row that is read.
    one_kernel
        Whether the loop is one kernel; else each turn is evaluated by itself.
    """
    last = dr.opaque(auto.UInt32, count)

    def turn(number: UInt32, *state: Any) -> tuple[Any, ...]:
        return number + 1, *add(number, *state)

    start: Any = (auto.UInt32(0), *state)
    loop: Any = dr.while_loop
    ended = loop(start, lambda number, *state: number < last, turn, mode=None if one_kernel else "evaluated")
    return tuple(ended[1:])
