"""Random numbers depend on their address alone."""

from __future__ import annotations

import drjit as dr
import numpy as np
import pytest
from scipy import stats

from scanner_sim.render.device import Device
from scanner_sim.streams import Stream, generator


def normals(seed: int, stream: Stream, shots: list[int], samples: list[int]) -> np.ndarray:
    import drjit.auto.ad as auto

    numbers = generator(seed, stream, auto.UInt32(shots), auto.UInt32(samples)).next_float32x4_normal()
    return np.asarray(numbers.numpy())


def test_a_number_is_the_same_in_any_company(device: Device) -> None:
    together = normals(7, Stream.DETECTOR, [1, 2, 3], [9, 9, 9])
    alone = normals(7, Stream.DETECTOR, [2], [9])
    np.testing.assert_array_equal(together[:, 1], alone[:, 0])


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
