"""Random numbers depend on their address alone."""

from __future__ import annotations

import re
from pathlib import Path

import drjit as dr
import numpy as np
import pytest
from scipy import stats

import scanner_sim
from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.streams import Seed, Stream, host_generator
from scanner_sim.render.device import Device

PINNED = {
    "MIRRORS": 1,
    "DETECTOR": 2,
    "RESPONSE": 3,
    "BOUNCES": 4,
    "REFERENCE": 5,
    "BACKGROUND": 6,
    "SPECKLE": 7,
    "SYNCHRONISATION": 8,
    "AMBIENT": 9,
    "PHOTODIODE": 10,
    "CLOCK": 11,
    "READOUT": 13,
    "WOBBLE": 14,
    "BUILT": 20,
    "VIBRATION": 21,
    "POWER": 22,
    "POSES": 40,
    "SURVEY": 41,
    "ACCEPTANCE": 42,
    "FRAME_LIGHT": 50,
    "FRAME_STRATA": 51,
    "FRAME_NOISE": 52,
    "FRAME_PATTERN": 53,
}
"""The numbers of the streams, once more: a change here is a change of all results."""


def normals(seed: Seed, stream: Stream, shots: list[int], samples: list[int]) -> np.ndarray:
    import drjit.auto.ad as auto

    numbers = generator(seed, stream, auto.UInt32(shots), auto.UInt32(samples)).next_float32x4_normal()
    return np.asarray(numbers.numpy())


def test_a_number_is_the_same_in_any_company(device: Device) -> None:
    together = normals(7, Stream.DETECTOR, [1, 2, 3], [9, 9, 9])
    alone = normals(7, Stream.DETECTOR, [2], [9])
    np.testing.assert_array_equal(together[:, 1], alone[:, 0])


def test_a_lane_s_numbers_are_those_of_its_own_seed(device: Device) -> None:
    """Claim: with a seed for each lane, each has the very numbers that its seed gives alone, long seeds too."""
    import drjit.auto.ad as auto

    seeds, shots, samples = [7, 2**64 - 1, 7, 0], [1, 2, 2, 4_000_000_000], [9, 9, 8, 0]
    together = normals(auto.UInt64(seeds), Stream.DETECTOR, shots, samples)
    for lane, address in enumerate(zip(seeds, shots, samples, strict=True)):
        alone = normals(address[0], Stream.DETECTOR, [address[1]], [address[2]])
        np.testing.assert_array_equal(together[:, lane], alone[:, 0])
    # Several seeds at one address: the numbers that a table of runs wants.
    spread = normals(auto.UInt64(seeds), Stream.DETECTOR, [2], [9])
    np.testing.assert_array_equal(spread[:, 1], together[:, 1])
    assert (spread[:, 0] == spread[:, 2]).all()
    assert (spread[:, 0] != spread[:, 3]).all()


@pytest.mark.parametrize(
    ("seed", "stream", "shot", "sample"),
    [
        (8, Stream.DETECTOR, 2, 9),
        (7 + 2**40, Stream.DETECTOR, 2, 9),
        (7, Stream.MIRRORS, 2, 9),
        (7, Stream.DETECTOR, 3, 9),
        (7, Stream.DETECTOR, 2, 10),
    ],
)
def test_every_part_of_the_address_counts(
    device: Device, seed: int, stream: Stream, shot: int, sample: int
) -> None:
    assert (normals(7, Stream.DETECTOR, [2], [9]) != normals(seed, stream, [shot], [sample])).all()


@pytest.mark.pinned
def test_an_address_has_the_numbers_that_it_always_had(device: Device) -> None:
    """Claim: results of a seed are those of earlier versions: the order of an address never changes."""
    import drjit.auto.ad as auto

    drawn = generator(7, Stream.DETECTOR, auto.UInt32([3]), auto.UInt32([5])).next_uint32x4()
    assert [int(values.numpy()[0]) for values in drawn] == [1656781633, 4076104689, 2594302719, 514634115]


def test_streams_keep_their_numbers_and_have_one_consumer_each() -> None:
    """Claim: the value of a stream never changes, as it is part of every result, and no two streams are one.

    The consumers are the calls of both generators in the package: each stream is drawn from within one room.
    """
    assert {stream.name: int(stream) for stream in Stream.__members__.values()} == PINNED
    assert len(set(PINNED.values())) == len(PINNED) == len(Stream.__members__)
    package = Path(scanner_sim.__file__).parent
    rooms: dict[str, set[str]] = {}
    for path in package.rglob("*.py"):
        for name in re.findall(r"Stream\.([A-Z_]+)\b", path.read_text(encoding="utf-8")):
            rooms.setdefault(name, set()).add(path.relative_to(package).parts[0])
    assert set(rooms) == set(PINNED)
    assert {name: found for name, found in rooms.items() if len(found) > 1} == {}


def test_all_pairs_of_streams_are_independent(device: Device) -> None:
    """Claim: normal numbers of any two streams at equal addresses are independent, those of the host too.

    Set-up: 20 000 addresses of every stream; four draws of the host's generator per stream, 20 000 numbers each.
    Expected: correlations of independence. Tolerance: level 10⁻⁵ for each pair, so 2.6·10⁻³ for all 253, and 4·10⁻²
    for the 4186 of the host.
    """
    count = 20_000
    limit = stats.norm.isf(0.5e-5) / np.sqrt(count)
    drawn = np.stack([normals(11, stream, list(range(count)), [3] * count)[0] for stream in Stream])
    assert np.abs(np.corrcoef(drawn)[~np.eye(len(drawn), dtype=bool)]).max() < limit
    host = np.stack(
        [
            host_generator(11, stream, number).standard_normal(count)
            for stream in Stream
            for number in range(4)
        ]
    )
    assert np.abs(np.corrcoef(host)[~np.eye(len(host), dtype=bool)]).max() < limit
    assert not set(host[0]) & set(host[1])


def test_neighbouring_addresses_are_independent_standard_normal_numbers(device: Device) -> None:
    """Claim: numbers at consecutive addresses are independent standard normal numbers.

    Set-up: 4 × 250 000 numbers at consecutive samples of one shot. Expected: Kolmogorov-Smirnov p-value and
    correlations of lag 1, along samples and between the four, as for independence. Tolerance: level 1e-5 each.
    """
    import drjit.auto.ad as auto

    count = 250_000
    drawn = generator(3, Stream.REFERENCE, auto.UInt32(0), dr.arange(auto.UInt32, count))
    values = np.asarray(drawn.next_float32x4_normal().numpy(), dtype=np.float64)
    assert stats.kstest(values.ravel(), "norm").pvalue > 1e-5
    limit = stats.norm.isf(0.5e-5) / np.sqrt(count)
    for row in values:
        assert abs(np.mean(row[1:] * row[:-1])) < limit
    cross = values @ values.T / count
    assert np.abs(cross[~np.eye(4, dtype=bool)]).max() < limit
