"""What neighbours tell of unevenness, by the sums themselves: ramps, parabolas, steps and thresholds without chance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.ranging.mixed_voxels import is_faint, is_mixed
from scanner_sim.ranging.neighbours import neighbour_values, weighted_sum
from scanner_sim.ranging.shared_noise import Overlap, SharedNoise
from scanner_sim.ranging.uneven import Raster, is_rugged, relief, texture

Array = NDArray[np.float64]

SHAPE = (9, 21)
SPOT = 2e-3
NOWHERE = np.zeros(SHAPE, dtype=np.bool_)
NONE = np.zeros(SHAPE)


def noise(own: float = 0.0, energy: float = 0.0, place: float = 0.0, across: float = 9.0) -> SharedNoise:
    return SharedNoise(NONE + own, NONE + energy, NONE + place, Overlap(NONE + across, NONE + 0.4))


def raster(pitch: float, swept: bool = True) -> Raster:
    """Return a raster whose pitch is in standard deviations of the spot."""
    step = NONE + pitch * SPOT
    return Raster(step, step, NONE + SPOT, step if swept else NONE)


def test_the_noise_of_a_sum_is_that_of_its_covariances() -> None:
    """Claim: Σ w w' C of every pair, C = own on the diagonal, and exp(−δ²)(energy + (1 − 2 x²) place) of all."""
    stencil = {(0, -1): 0.7, (1, 0): -2.0, (0, 2): 1.4, (0, 0): 0.3}
    found = noise(0.3, 0.2, 0.5, 0.7).of(stencil)
    wanted = 0.0
    for one, weight in stencil.items():
        for other, more in stencil.items():
            x, y = 0.7 * (one[1] - other[1]), 0.4 * (one[0] - other[0])
            shared = math.exp(-(x**2) - y**2) * (0.2 + (1.0 - 2.0 * x**2) * 0.5)
            wanted += weight * more * (shared + 0.3 * (one == other))
    assert found[4, 10] == pytest.approx(wanted)
    assert np.isnan(found[-1, 10])


@pytest.mark.parametrize("pitch", [0.5, 2.0])
def test_an_exponential_of_light_shifts_by_its_rate(pitch: float) -> None:
    """Claim: light e^(g x) moves by s² g, which a sweep of δ widens by √(1 + δ²/(δ² + 5 s²)); by 0.8 s at most."""
    at = np.arange(21.0) * pitch * SPOT
    wide = math.sqrt(1.0 + pitch**2 / (pitch**2 + 5.0))
    for rate, wanted in ((0.2 / SPOT, 0.2 * SPOT * wide), (5.0 / SPOT, 0.8 * SPOT)):
        signal = np.tile(np.exp(rate * at), (9, 1))
        found = texture(signal, noise(), raster(pitch), NOWHERE)
        np.testing.assert_allclose(found[2:-2, 4:-4], wanted, rtol=1e-9)


@pytest.mark.parametrize("swept", [False, True])
def test_a_parabola_bends_by_its_second_difference(swept: bool) -> None:
    """Claim: of R = 5 + c x²/2 the second difference is c δ², and the shift 0.3 s c δ, s with a sweep's δ/√12."""
    pitch, curvature = 3.0, 4.0
    at = np.arange(21.0) * pitch * SPOT
    ranges = np.tile(5.0 + 0.5 * curvature * at**2, (9, 1))
    found = relief(ranges, noise(), NONE, raster(pitch, swept), NOWHERE)
    spot = SPOT * math.sqrt(1.0 + pitch**2 / 12.0) if swept else SPOT
    np.testing.assert_allclose(found[2:-2, 4:-4], 0.3 * spot * curvature * pitch * SPOT, rtol=1e-6)


def test_bends_are_certain_only_over_two_spots() -> None:
    """Claim: second differences 2e-4 k² over k voxels reach 5 √6 σ = 1.2e-3 at k = 3, which is looked at where voxels
    are half a spot apart, and not where they are three apart."""
    at = np.arange(21.0)
    ranges = np.tile(5.0 + 0.5 * 2e-4 * at**2, (9, 1))
    step = (NONE + np.where(at < 10.0, 0.5, 3.0)) * SPOT
    found = is_rugged(ranges, noise(1e-8), Raster(step, step, NONE + SPOT, NONE))
    assert found[:, 4:9].all()
    assert not found[:, 12:].any()


def test_a_step_counts_two_fifths() -> None:
    """Claim: a step h is the difference of second differences at both sides, and counts 0.4 h; axes add in squares."""
    pitch = 3.0
    ranges = np.full(SHAPE, 5.0)
    ranges[:, 10:] += 0.01
    found = relief(ranges, noise(), NONE, raster(pitch, swept=False), NOWHERE)
    assert found[4, 9:11] == pytest.approx(0.4 * 0.01)
    ranges[4:] += 0.01
    found = relief(ranges, noise(), NONE, raster(pitch, swept=False), NOWHERE)
    assert found[4, 10] == pytest.approx(0.4 * 0.01 * math.sqrt(2.0))


@pytest.mark.parametrize(("share", "told"), [(0.98, False), (1.02, True)])
@pytest.mark.parametrize("source", ["noise", "uneven", "slope"])
def test_a_step_is_told_from_where_noise_unevenness_and_slope_end(
    source: str, share: float, told: bool
) -> None:
    """Claim: 4.5 standard deviations of the difference of two ranges' noise, twice that of both their unevenness, or
    the rise of a surface of 60° over the pitch."""
    own, uneven = 1e-6 if source == "noise" else 1e-12, 1e-3 if source == "uneven" else 0.0
    steepest = math.pi / 3.0 if source == "slope" else 1e-9
    pitch = 3.0
    limit = {
        "noise": 4.5 * math.sqrt(2e-6),
        "uneven": 2.0 * 1e-3 * math.sqrt(2.0),
        "slope": math.sqrt(3.0) * pitch * SPOT,
    }[source]
    ranges = np.full(SHAPE, 5.0)
    ranges[:, 10:] += share * limit
    status = np.full(SHAPE, int(Status.VALID), dtype=np.uint32)
    found = is_mixed(ranges, noise(own), NONE + uneven, status, NOWHERE, raster(pitch), steepest)
    assert bool(found[4, 9:11].any()) is told
    assert not found[:, :8].any()


@pytest.mark.parametrize(
    ("speckle", "limit"), [(0.0, 4.5 * math.sqrt(2.0)), (0.01, 4.5 * math.sqrt(2.0 * 1.81))]
)
def test_faint_voxels_have_neighbours_of_the_same_light(speckle: float, limit: float) -> None:
    """Claim: a height of 9 is faint where within 2.5 s, three voxels at a pitch of 1 s, all others differ by 4.5 σ of
    two heights at most, √(2 (1 + c² 9²)), and none lies beyond the raster; a bright voxel is not faint at all."""
    inside = np.zeros(SHAPE, dtype=np.bool_)
    inside[3:-3, 3:-3] = True
    for change, alike in ((0.99, True), (1.01, False), (-0.99, True), (-1.01, False)):
        height = NONE + 9.0
        height[4, 10] += change * limit
        found = is_faint(height, 12.0, NONE + speckle, raster(1.0))
        beside = np.abs(np.arange(21) - 10) <= 3
        wanted = inside & (alike | ~beside)
        wanted[4, 10] = found[4, 10]
        np.testing.assert_array_equal(found, wanted)
    assert not is_faint(NONE + 12.1, 12.0, NONE, raster(1.0)).any()


@pytest.mark.parametrize("shape", [(4, 3), (1, 5)])
def test_neighbours_are_those_some_rows_and_columns_away(shape: tuple[int, int]) -> None:
    """Claim: by a plain look, up to beyond the image, where there is nothing."""
    values = np.arange(float(np.prod(shape))).reshape(shape)
    rows, columns = shape
    for down in range(-rows - 1, rows + 2):
        for right in range(-columns - 1, columns + 2):
            found = neighbour_values(values, down, right)
            for row in range(rows):
                for column in range(columns):
                    y, x = row + down, column + right
                    inside = 0 <= y < rows and 0 <= x < columns
                    np.testing.assert_equal(found[row, column], values[y, x] if inside else np.nan)


@pytest.mark.parametrize("shape", [(9, 7), (4, 7), (9, 2), (1, 1)])
def test_a_weighted_sum_is_that_of_each_voxel_by_itself(shape: tuple[int, int]) -> None:
    """Claim: by a plain look, nothing where one of the voxels is missing or beyond the image, also of a small image."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=shape)
    values[rng.random(shape) < 0.1] = np.nan
    stencil = {(-2, 1): 0.7, (0, 0): -1.3, (1, 3): 2.1, (2, -1): 0.4}
    found = weighted_sum(values, stencil)
    assert found.shape == shape
    for row, column in np.ndindex(shape):
        wanted = 0.0
        for (down, right), weight in stencil.items():
            y, x = row + down, column + right
            inside = 0 <= y < shape[0] and 0 <= x < shape[1]
            wanted += weight * values[y, x] if inside else np.nan
        np.testing.assert_allclose(found[row, column], wanted, rtol=1e-12, atol=1e-14)
