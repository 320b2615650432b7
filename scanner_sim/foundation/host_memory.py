"""Memory that the process keeps for its next arrays.

An image asks for arrays of a few megabytes hundreds of times, and frees each soon after. The C library of GNU systems
hands such memory back and asks for it anew, and the system clears every page of it: 45 000 pages for an image of
512 × 512, a third of the time that judging neighbours takes (mallopt(3)).
"""

from __future__ import annotations

import ctypes
from functools import cache

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""Names of the limits in ``malloc.h``."""
_KEPT = 256 << 20
"""Bytes that are kept at most."""
_LARGE = 32 << 20
"""Bytes from which on an array has memory of its own, which is handed back: the largest that the library takes."""


@cache
def keep_freed_memory() -> None:
    """Let the C library keep what is freed, up to 256 MiB, where it is one that can be told to."""
    try:
        limit = ctypes.CDLL(None).mallopt
    except (AttributeError, TypeError):  # other systems' libraries
        return
    limit(_TRIM_THRESHOLD, _KEPT)
    limit(_MMAP_THRESHOLD, _LARGE)
