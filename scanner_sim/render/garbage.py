"""Python's search for garbage, held off while kernels are traced."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")


@contextmanager
def garbage_waits() -> Iterator[None]:
    """Let Python collect no garbage meanwhile; may decorate a function that traces rays and launches them.

    A call of a surface's method goes into a kernel as calls of those surfaces that exist. Where a scene that is
    garbage, anybody's, is collected between two calls of one kernel, the second knows fewer, and Dr.Jit may write a
    function of theirs twice ("invalid redefinition of function"). Where it frees memory that an array shares with
    NumPy while kernels are recorded, it is as lost. In either case it aborts the process.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()


def each_whole(items: Iterator[T]) -> Iterator[T]:
    """Yield items that trace rays when they are asked for, while garbage waits; between them it is collected."""
    while True:
        with garbage_waits():
            try:
                item = next(items)
            except StopIteration:
                return
        yield item
