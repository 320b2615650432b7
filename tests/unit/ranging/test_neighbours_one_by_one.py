"""What neighbours say of a voxel, against one loop over all voxels and all of their neighbours.

The program leaves out what cannot change the answer; the loop leaves out nothing. Images are random, with surfaces that
step, holes, noise of every share in common, and pitches that differ along and across and from voxel to voxel.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status
from scanner_sim.ranging.mixed_voxels import is_faint, is_mixed
from scanner_sim.ranging.neighbours import Chosen, grown, neighbour_values
from scanner_sim.ranging.shared_noise import Overlap, SharedNoise
from scanner_sim.ranging.uneven import Raster, is_rugged

Array = NDArray[np.float64]

SHAPE = (11, 14)
STEEPEST = math.radians(70.0)
SPOT = 1e-3
# Pitches in standard deviations of the spot, from where eight rings count to where one does, and the noise [m].
PITCHES = [(0.2, 0.3, 2e-4), (0.3, 0.3, 3e-3), (0.9, 0.5, 5e-4), (1.4, 2.1, 2e-3), (4.0, 3.0, 1e-3)]


class Image:
    """A random image, its noise and its geometry."""

    def __init__(self, pitch: tuple[float, float, float], seed: int) -> None:
        (across, down, sigma), random = pitch, np.random.default_rng(seed)
        rows, columns = np.indices(SHAPE)
        self.range_m = 5.0 + 3e-4 * rows - 5e-4 * columns + sigma * random.normal(size=SHAPE)
        self.range_m[columns > 8] += 0.02
        self.range_m[3, 2] += 0.01
        kinds = [Status.VALID, Status.BELOW_THRESHOLD, Status.SATURATED]
        self.status = random.choice(kinds, p=[0.94, 0.04, 0.02], size=SHAPE).astype(np.uint32)
        self.range_m[self.status != Status.VALID] = np.nan
        self.own, self.energy, self.position = (sigma**2 * random.uniform(0.1, 1.0, SHAPE) for _ in range(3))
        self.uneven = sigma * random.choice([0.0, 1.0], size=SHAPE)
        self.faint = random.random(SHAPE) < 0.5
        self.height, self.speckle = random.lognormal(2.0, 0.3, SHAPE), random.uniform(0.0, 0.02, SHAPE)
        self.across, self.down, self.spot = (
            SPOT * length * random.uniform(0.9, 1.1, SHAPE) for length in (across, down, 1.0)
        )
        self.raster = Raster(self.across, self.down, self.spot, self.across)
        overlap = Overlap(self.across / (2.0 * self.spot), self.down / (2.0 * self.spot))
        self.noise = SharedNoise(self.own, self.energy, self.position, overlap)

    def around(self, at: tuple[int, ...], reach: float) -> list[tuple[int, int, int, int]]:
        """Return row, column and steps of all neighbours that a reach [standard deviations] can let count."""
        finest = np.fmin(self.across, self.down)
        most, (row, column) = min(8, max(1, math.ceil(reach * (self.spot / finest).max()))), at
        return [
            (row + down, column + right, down, right)
            for down in range(-most, most + 1)
            for right in range(-most, most + 1)
            if (down, right) != (0, 0) and 0 <= row + down < SHAPE[0] and 0 <= column + right < SHAPE[1]
        ]

    def is_near(self, at: tuple[int, ...], down: int, right: int) -> bool:
        """Tell whether a neighbour is one of eight, or its spot begins within 2.5 standard deviations."""
        if max(abs(down), abs(right)) == 1:
            return True
        begins = math.hypot(max(abs(right) - 1, 0) * self.across[at], max(abs(down) - 1, 0) * self.down[at])
        return bool(begins < 2.5 * self.spot[at])


@pytest.fixture(params=[(pitch, seed) for pitch in PITCHES for seed in (1, 2)], ids=str)
def image(request: pytest.FixtureRequest) -> Image:
    pitch, seed = request.param
    return Image(pitch, seed)


def test_mixed_voxels_differ_from_a_neighbour_beyond_what_explains_it(image: Image) -> None:
    """Claim: |ΔR| > δ tan70° min(1, R'/R) + √(4.5² Var(ΔR) + (2 u)² + (2 u')²), or no range beside it.

    Var(ΔR) = v + v' + 2 (e + p) − 2 exp(−δ²/w²) (e + (1 − 2 x²/w²) p). Voxels without a peak do not count beside faint
    ones.
    """
    found = is_mixed(
        image.range_m, image.noise, image.uneven, image.status, image.faint, image.raster, STEEPEST
    )

    def differs(at: tuple[int, ...], there: tuple[int, ...], down: int, right: int) -> bool:
        if image.status[there] != Status.VALID:
            return not (image.faint[at] and image.status[there] == Status.BELOW_THRESHOLD)
        x, y = right * image.across[at], down * image.down[at]
        w = 2.0 * image.spot[at]
        shared = math.exp(-(x**2 + y**2) / w**2)
        energy, position = image.energy[at], image.position[at]
        chance = image.own[at] + image.own[there] + 2.0 * (energy + position)
        chance -= 2.0 * shared * (energy + (1.0 - 2.0 * x**2 / w**2) * position)
        ratio = min(1.0, image.range_m[there] / image.range_m[at])
        unevenness = 4.0 * (image.uneven[at] ** 2 + image.uneven[there] ** 2)
        limit = math.tan(STEEPEST) * math.hypot(x, y) * ratio + math.sqrt(4.5**2 * chance + unevenness)
        return bool(abs(image.range_m[there] - image.range_m[at]) > limit)

    wanted = np.zeros(SHAPE, dtype=np.bool_)
    for at in np.ndindex(SHAPE):
        wanted[at] = image.status[at] == Status.VALID and any(
            differs(at, (row, column), down, right)
            for row, column, down, right in image.around(at, 2.5)
            if image.is_near(at, down, right)
        )
    np.testing.assert_array_equal(found, wanted)
    assert 0 < wanted.sum() < wanted.size


@pytest.mark.parametrize("ring", [1, 2, 3])
@pytest.mark.parametrize("excess", [-2e-4, 2e-4])
def test_one_range_differs_from_where_its_limit_ends(ring: int, excess: float) -> None:
    """Claim: a lone range, nearer or farther by a little more than the limit is mixed, and by a little less is not.

    Nothing but speckle, unevenness and the slope decide, and of all on its ring the nearest neighbour.
    """
    shape, none = (9, 9), np.zeros((9, 9))
    across, down, energy, position, uneven = 0.5 * SPOT, 0.4 * SPOT, 4e-8, 1e-8, 2e-4
    raster = Raster(none + across, none + down, none + SPOT, none)
    overlap = Overlap(none + across / (2.0 * SPOT), none + down / (2.0 * SPOT))
    noise = SharedNoise(none, none + energy, none + position, overlap)
    shared = math.exp(-((ring * down / (2.0 * SPOT)) ** 2))
    explained = 4.5**2 * 2.0 * (energy + position) * (1.0 - shared) + 4.0 * uneven**2
    rise = math.tan(STEEPEST) * ring * down
    ranges, doubts = np.full(shape, 5e-3), none.copy()
    ranges[4, 4] = 5e-3 + (1.0 + excess) * (rise + math.sqrt(explained))
    doubts[4 + ring, 4] = uneven
    farther = ranges.copy()
    ranges[4, 4] = 5e-3 - (1.0 + excess) * (rise + math.sqrt(explained)) / (1.0 + rise / 5e-3)
    for image in (farther, ranges):
        found = is_mixed(image, noise, doubts, none.astype(np.uint32), none > 0.0, raster, STEEPEST)
        assert found[4 + ring, 4] == (excess > 0.0)


@pytest.mark.parametrize("faintest", [6.0, 9.0])
def test_faint_voxels_are_as_high_as_all_about_them(image: Image, faintest: float) -> None:
    """Claim: lower than the faintest, and no neighbour departs by 4.5 √(2 (1 + s h²)) or lies beyond the raster."""
    image.height[2:9, 1:8] = 5.0 + 0.1 * image.height[2:9, 1:8]
    found = is_faint(image.height, faintest, image.speckle, image.raster)
    wanted = np.zeros(SHAPE, dtype=np.bool_)
    finest = np.fmin(image.across, image.down)
    most = min(8, max(1, math.ceil(2.5 * (image.spot / finest).max())))
    for at in np.ndindex(SHAPE):
        height = image.height[at]
        limit = 4.5 * math.sqrt(2.0 * (1.0 + image.speckle[at] * height**2))
        alike = height < faintest
        for down in range(-most, most + 1):
            for right in range(-most, most + 1):
                there = at[0] + down, at[1] + right
                if (down, right) == (0, 0) or not image.is_near(at, down, right):
                    continue
                inside = 0 <= there[0] < SHAPE[0] and 0 <= there[1] < SHAPE[1]
                alike &= inside and abs(image.height[there] - height) <= limit
        wanted[at] = alike
    np.testing.assert_array_equal(found, wanted)


def test_surfaces_are_rugged_within_three_spots_of_where_they_end(image: Image) -> None:
    """Claim: on a plane with holes those voxels are rugged that lie within 3 s of one beside a hole."""
    holes = image.status != Status.VALID
    ends = np.zeros(SHAPE, dtype=np.bool_)
    for row, column in np.argwhere(holes):
        for there in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            if 0 <= there[0] < SHAPE[0] and 0 <= there[1] < SHAPE[1]:
                ends[there] = True
    found = is_rugged(np.where(holes, np.nan, 5.0), image.noise, image.raster)
    for at in np.ndindex(SHAPE):
        near = [
            (row, column)
            for row, column, down, right in image.around(at, 3.0)
            if math.hypot(right * image.across[at], down * image.down[at]) <= 3.0 * image.spot[at]
        ]
        assert found[at] == any(ends[there] for there in (at, *near))


@pytest.mark.parametrize("order", ["C", "F"])
def test_chosen_voxels_see_what_all_do(order: Any) -> None:
    """Claim: values here, and there up to the reach, are those that the whole image holds, and are written in place."""
    random = np.random.default_rng(5)
    values, where = np.asarray(random.normal(size=SHAPE), order=order), random.random(SHAPE) < 0.3
    chosen = Chosen(where, 3)
    bordered = np.pad(values, 3, constant_values=np.nan)
    np.testing.assert_array_equal(chosen.here(values), values[where])
    for down in range(-3, 4):
        for right in range(-3, 4):
            seen = neighbour_values(values, down, right)[where]
            np.testing.assert_array_equal(chosen.there(bordered, down, right), seen)
    image = np.zeros(SHAPE, order=order)
    chosen.put(image, chosen.here(values))
    np.testing.assert_array_equal(image, np.where(where, values, 0.0))


@pytest.mark.parametrize("shape", [SHAPE, (1, 5), (5, 1), (1, 1)])
def test_extremes_of_squares_are_those_of_their_voxels(shape: tuple[int, int]) -> None:
    """Claim: grown n times, an image holds the extreme of the square of 2 n + 1 voxels about each."""
    values = np.random.default_rng(6).normal(size=shape)
    for extreme in (np.minimum, np.maximum):
        image = values
        for steps in (1, 2, 3):
            image = grown(image, extreme)
            for row, column in np.ndindex(shape):
                square = values[
                    max(row - steps, 0) : row + steps + 1, max(column - steps, 0) : column + steps + 1
                ]
                assert image[row, column] == extreme.reduce(square, axis=None)


def test_what_beams_share_falls_as_the_square_of_their_distance() -> None:
    """Claim: exp(−δ²/w²) at any distance, by products of that of one step; relative error of 1e-12 down to 1e-300."""
    across, down = np.array([[0.05, 0.4, np.nan]]), np.array([[0.07, 0.3, 0.1]])
    overlap = Overlap(across, down)
    for rows, columns in ((0, 0), (1, 0), (0, 1), (2, -3), (-5, 4), (8, 32), (31, 7)):
        wanted = np.exp(-((rows * down) ** 2) - (columns * across) ** 2)
        np.testing.assert_allclose(overlap.decay(rows, columns), wanted, rtol=1e-12)


def test_no_neighbour_on_a_ring_shares_more_than_the_nearest() -> None:
    """Claim: what speckle adds to the variance of a difference is at least that of the nearest on the ring."""
    image = Image((0.7, 0.4, 1e-3), 3)
    for ring in (1, 2, 5):
        least = image.noise.least_apart(ring)
        side = range(-ring, ring + 1)
        added = [
            image.noise.apart(down, right)
            for down in side
            for right in side
            if max(abs(down), abs(right)) == ring
        ]
        assert (np.min(added, axis=0) >= least * (1.0 - 1e-12)).all()
        np.testing.assert_allclose(image.noise.apart(ring, 0), np.min(added, axis=0), rtol=1e-12)
