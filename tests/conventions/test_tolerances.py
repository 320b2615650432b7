"""Tolerances are relative, unless a test states an absolute one."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.mark.parametrize("size", [1.0, 1e-9, 1e-13, 1e-23])
def test_a_small_number_is_as_near_as_a_large_one(size: float) -> None:
    """Claim: two parts in a million off is not near, and half of one is; alone, in a list, in an array, by a name."""
    for off, near in ((2e-6, False), (-2e-6, False), (0.5e-6, True), (-1.0, False)):
        found = size * (1.0 + off)
        assert (found == pytest.approx(size)) is near
        assert ([1.0, found] == pytest.approx([1.0, size])) is near
        assert (np.array([found, 1.0]) == pytest.approx(np.array([size, 1.0]))) is near
        assert ({"x": found} == pytest.approx({"x": size})) is near
    assert size == pytest.approx(0.0, abs=1.1 * size)
