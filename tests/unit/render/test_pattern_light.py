"""Which shots of patterns are traced again, in how many lanes, and batches that fit the memory."""

from __future__ import annotations

import drjit.auto.ad as auto
import numpy as np
import pytest

from scanner_sim.render.beam import splitter
from scanner_sim.render.beam.pattern import lanes_again
from scanner_sim.render.beam.splitter import PARTED
from scanner_sim.render.device import Device


@pytest.mark.parametrize("count", [1, 4, 5, 16, 17, 20, 31, 32, 33, 100, 127, 128, 129, 2049, 8192])
@pytest.mark.parametrize("parted", [True, False])
def test_every_uneven_shot_has_a_lane(device: Device, count: int, parted: bool) -> None:
    """Claim: the shots whose footprint is not smooth, each once, those of one edge apart from the others; 16 lanes at
    least, or 4, and a quarter too many at most."""
    footprint = np.zeros(9000, dtype=np.uint32)
    wanted = np.sort(np.random.default_rng(count).permutation(len(footprint))[:count])
    footprint[wanted] = PARTED if parted else 1 + np.arange(count) % 2
    least = 16 if parted else 4
    some, none = lanes_again(footprint)[:: 1 if parted else -1]
    assert some is not None
    assert none is None
    index, real = (array.numpy() for array in some)
    np.testing.assert_array_equal(index[real], wanted)
    assert max(count, least) <= len(index) <= max(1.25 * count, least)


def test_no_uneven_shot_has_no_lane(device: Device) -> None:
    """Claim: of smooth ground alone nothing is traced again."""
    assert lanes_again(np.zeros(128, dtype=np.uint32)) == (None, None)


def test_few_numbers_of_lanes_make_few_recordings(device: Device) -> None:
    """Claim: 128 shots of one edge each have thirteen numbers of lanes, 16 and four for each doubling; of other shots
    there are eight more, from 4 on."""
    from_16 = {16, 20, 24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128}
    for kind, numbers in ((PARTED, from_16), (1, from_16 | {4, 5, 6, 7, 8, 10, 12, 14})):
        lanes = set()
        for count in range(1, 129):
            footprint = np.where(np.arange(128) < count, kind, 0).astype(np.uint32)
            (some,) = (one for one in lanes_again(footprint) if one is not None)
            lanes.add(len(some[0].numpy()))
        assert lanes == numbers


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize(("lanes", "each"), [(7, 14), (100, 1), (240, 1), (1, 100)])
def test_batches_hold_every_shot_once(monkeypatch: pytest.MonkeyPatch, lanes: int, each: int) -> None:
    """Claim: in their order, as many as have a hundred lanes together, one at least; the last ones may be fewer."""
    monkeypatch.setattr(splitter, "_BATCH", 100)
    shots = np.random.default_rng(1).permutation(500)[:129].astype(np.uint32)
    found = [np.array(batch) for batch in splitter._batches(auto.UInt32(shots), lanes)]
    np.testing.assert_array_equal(np.concatenate(found), shots)
    assert {len(batch) for batch in found[:-1]} <= {each}
    assert 1 <= len(found[-1]) <= each
