"""Functions whose kernels are recorded once, and launched from then on without being traced again."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.render.garbage import garbage_waits


class Frozen:
    """A function of Dr.Jit arrays, frozen (``drjit.freeze``).

    Parameters
    ----------
    function
        Function whose kernels depend on nothing but the kinds of its arguments. Every array that it reads must be among
        them, and no array's size may depend on a value.
    enabled
        Whether to freeze it: what Dr.Jit cannot record is called as it is.

    Notes
    -----
    Python's garbage collector is off during a call: see :func:`~scanner_sim.render.garbage.garbage_waits`.
    """

    def __init__(self, function: Callable[..., Any], *, enabled: bool = True) -> None:
        self._function: Any = dr.freeze(function, enabled=enabled)

    def __call__(self, *arguments: Any) -> Any:
        """Call the function: trace it for arguments of a new kind, or launch what was recorded."""
        with garbage_waits():
            return self._function(*arguments)

    @property
    def recordings(self) -> int:
        """How often kernels were recorded."""
        return int(self._function.n_recordings)


def taken_apart(tree: Any) -> tuple[list[Any], Callable[[list[Any]], Any]]:
    """Return the arrays of a tree of dataclasses, lists and tuples, and what makes such a tree of others.

    Each time that a frozen function is called, Dr.Jit looks into the dataclasses that it takes and returns, field by
    field: into a list of arrays it looks faster.
    """
    arrays: list[Any] = []

    def part(item: Any) -> Callable[[list[Any]], Any]:
        if dr.is_array_v(item):
            arrays.append(item)
            place = len(arrays) - 1
            return lambda given: given[place]
        kind: Any = type(item)
        if dataclasses.is_dataclass(item):
            made = {field.name: part(getattr(item, field.name)) for field in dataclasses.fields(item)}
            return lambda given: kind(**{name: make(given) for name, make in made.items()})
        if isinstance(item, list | tuple):
            makers = [part(one) for one in item]
            return lambda given: kind(make(given) for make in makers)
        return lambda given: item

    rebuilt = part(tree)
    return arrays, rebuilt


def side_by_side(columns: Sequence[Float | UInt32]) -> Float:
    """Return columns of n numbers each, one after the other, whole ones as floats, shape (columns · n,), Dr.Jit.

    To fetch an array costs more than to fetch its numbers.
    """
    count = dr.width(columns[0])
    lane, every = dr.arange(mi.UInt32, count), dr.empty(mi.Float, len(columns) * count)
    for place, column in enumerate(columns):
        at = lane + dr.opaque(mi.UInt32, place * count)
        dr.scatter(every, mi.Float(column), at, mode=dr.ReduceMode.Permute)
    dr.eval(every)
    return every
