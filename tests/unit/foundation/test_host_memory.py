"""Freed memory stays with the process."""

from __future__ import annotations

import ctypes
import resource
import sys

import numpy as np
import pytest

from scanner_sim.foundation.host_memory import keep_freed_memory

IS_GNU = sys.platform == "linux" and hasattr(ctypes.CDLL(None), "mallopt")


@pytest.mark.skipif(not IS_GNU, reason="only the GNU C library can be told to")
def test_pages_of_freed_arrays_are_not_asked_for_again() -> None:
    """Claim: eight arrays of 7 MB that come and go together cost their pages once, and not each time.

    They have 14 000 pages of 4 KiB; what else the process does meanwhile takes a few.
    """

    def fill() -> None:
        _ = [np.ones(7 << 17) for _ in range(8)]

    keep_freed_memory()
    fill()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    fill()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before < 1400


def test_it_may_be_called_again_and_where_the_library_has_no_such_limit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(ctypes, "CDLL", lambda name: object())
    keep_freed_memory.cache_clear()
    keep_freed_memory()
    keep_freed_memory()
