"""Which shots of patterns are traced again, in how many lanes."""

from __future__ import annotations

import numpy as np
import pytest

from scanner_sim.render.beam.pattern import lanes_again
from scanner_sim.render.device import Device


@pytest.mark.parametrize("count", [0, 1, 16, 17, 20, 31, 32, 33, 100, 127, 128, 129, 2049, 8192])
def test_every_uneven_shot_has_a_lane(device: Device, count: int) -> None:
    """Claim: the shots whose footprint is not smooth, each once; 16 lanes at least, and a quarter too many at most."""
    footprint = np.zeros(9000, dtype=np.uint32)
    wanted = np.sort(np.random.default_rng(count).permutation(len(footprint))[:count])
    footprint[wanted] = 1 + np.arange(count) % 2
    index, real = (array.numpy() for array in lanes_again(footprint))
    np.testing.assert_array_equal(index[real], wanted)
    assert max(count, 16) <= len(index) <= max(1.25 * count, 16)


def test_few_numbers_of_lanes_make_few_recordings(device: Device) -> None:
    """Claim: patterns of 128 shots have thirteen numbers of lanes: 16, and four for each doubling."""
    lanes = {len(lanes_again(np.arange(128) < count)[0].numpy()) for count in range(129)}
    assert lanes == {16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128}
