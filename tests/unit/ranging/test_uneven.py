"""Uneven spots: what signals and ranges of neighbours say of the light within one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.stats import norm

from scanner_sim.foundation.status import Status
from scanner_sim.ranging.mixed_voxels import is_mixed
from scanner_sim.ranging.shared_noise import Overlap, SharedNoise
from scanner_sim.ranging.uneven import Raster, is_rugged, relief, texture, window

Array = NDArray[np.float64]

SPOT, R = 1e-3, 4.0
ROWS, COLUMNS = 9, 41


def raster(pitch: float, *, travel: bool = False, shape: tuple[int, int] = (ROWS, COLUMNS)) -> Raster:
    """Return a raster of a pitch in standard deviations of the spot."""
    step = pitch * SPOT / R
    return Raster.of(np.full(shape, R), (step, step), np.full(shape, SPOT), step if travel else 0.0)


def alone(variance: Array) -> SharedNoise:
    """Return noise that every voxel has of its own."""
    none, apart = np.zeros(variance.shape), np.ones(variance.shape)
    return SharedNoise(variance, none, none, Overlap(apart, apart))


def nowhere(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    return np.zeros(shape, dtype=np.bool_)


def places(pitch: float) -> Array:
    """Return the columns' places across an edge that lies off the middle [s], shape (rows, columns)."""
    return np.tile((np.arange(COLUMNS) - COLUMNS // 2 + 0.3) * pitch, (ROWS, 1))


@pytest.mark.parametrize("pitch", [0.3, 0.6, 1.0, 3.0, 6.0])
def test_texture_is_the_shift_of_the_light(pitch: float) -> None:
    """Claim: the shift of a Gaussian spot's centroid at an edge of reflectance is found from the signals alone.

    Set-up: an edge from 0.2 to 0.8, mirrors at rest. Expected: s² ∂ln Y/∂x with Y the reflectance smoothed by the
    spot, the largest within s.
    Tolerance: the finite difference's: 12 % of the largest up to a pitch of s. On a coarse one the edge is taken to lie
    sharp between plateaus, as it does: no less than the shift, and no more than 1.6 of it, for the least value, half
    the central difference, lifts the neighbours.
    """
    at = places(pitch)
    signal = 0.2 + 0.6 * norm.cdf(at)
    shift = SPOT * 0.6 * norm.pdf(at) / signal
    shift = maximum_filter1d(shift, 2 * int(1.0 / pitch) + 1, axis=1)
    found = texture(1e6 * signal, alone(np.zeros_like(signal)), raster(pitch), nowhere(signal.shape))
    inner = np.s_[:, 2:-2]
    if pitch <= 1.0:
        np.testing.assert_allclose(found[inner], shift[inner], rtol=0.1, atol=0.12 * shift.max())
    else:
        assert (found[inner] >= 0.95 * shift[inner] - 1e-2 * SPOT).all()
        assert found[inner].max() < 1.6 * max(shift.max(), 0.3 * SPOT)


def test_noise_is_no_texture() -> None:
    random = np.random.default_rng(1)
    signal = 1e6 * (1.0 + 0.05 * random.normal(size=(200, 200)))
    about = raster(2.0, shape=signal.shape)
    moved = texture(signal, alone(np.full(signal.shape, 0.05**2)), about, nowhere(signal.shape))
    # The same speckle moves the spot's own centroid by about its contrast of s.
    assert np.sqrt(np.mean(moved**2)) < 0.4 * SPOT * 0.05
    even, about = np.full((5, 5), 3.0), raster(2.0, shape=(5, 5))
    assert texture(even, alone(np.zeros((5, 5))), about, nowhere((5, 5))).max() == 0.0


def test_the_light_shifts_by_no_more_than_half_a_spot() -> None:
    signal = np.where(places(1.0) > 0.0, 1.0, 1e-6)
    found = texture(signal, alone(np.zeros_like(signal)), raster(1.0), nowhere(signal.shape))
    assert found.max() == pytest.approx(0.8 * SPOT)


@pytest.mark.parametrize("pitch", [0.5, 2.0, 4.0])
def test_a_crease_and_a_step_are_relief_and_a_plane_is_not(pitch: float) -> None:
    at, about = SPOT * places(pitch), raster(pitch)

    def bent(ranges: Array) -> Array:
        noise, none = alone(np.full(ranges.shape, 1e-12)), np.zeros(ranges.shape)
        return relief(ranges, noise, none, about, is_rugged(ranges, noise, about))

    assert bent(R + 1.5 * at).max() == 0.0
    assert bent(R + np.abs(at)).max() > 0.2 * SPOT
    found = bent(R + 10.0 * SPOT * norm.cdf(at / SPOT))
    true = np.abs(10.0 * SPOT * (norm.cdf(at / SPOT) - (at > 0.0)))
    assert found[:, 4:-4].max() > 0.5 * true.max()
    assert found[:, 4] == pytest.approx(0.0, abs=1e-3 * SPOT)


def test_the_rim_takes_the_differences_of_its_neighbours() -> None:
    at = SPOT * places(4.0)
    ranges, about = R + at**2 / SPOT, raster(4.0)
    noise, none = alone(np.full(ranges.shape, 1e-12)), np.zeros(ranges.shape)
    found = relief(ranges, noise, none, about, is_rugged(ranges, noise, about))
    np.testing.assert_allclose(found[:, 0], found[:, 4], rtol=1e-3)


def test_what_noise_explains_is_no_relief() -> None:
    random = np.random.default_rng(2)
    own, none = np.full((200, 200), 5e-4**2), np.zeros((200, 200))
    ranges = R + 5e-4 * random.normal(size=own.shape)
    about = raster(2.0, shape=own.shape)
    where = is_rugged(ranges, alone(own), about)
    # Six differences beyond 5 σ: 6 · 6·10⁻⁷, times the 13 voxels about each.
    assert where.mean() < 1e-3
    found = relief(ranges, alone(own), none, about, where)
    assert np.sqrt(np.mean(found**2)) < 0.35 * 5e-4


@pytest.mark.parametrize("pitch", [0.4, 0.7, 1.1, 2.5])
def test_an_even_surface_looks_bent_as_rarely_on_fine_rasters(pitch: float) -> None:
    """Claim: where noise alone makes differences, no more voxels have relief than one second difference and one of two
    exceed twice and √8 times their σ along either axis, however many of them a fine raster looks at.

    Tolerance: four standard errors, from the scatter of sixteen images. Power: with the same limits for all it is
    14 % of the voxels at 1.1 s, 57 % at 0.7 s and 85 % at 0.4 s.
    """
    random, shape = np.random.default_rng(5), (90, 90)
    own, none, about = np.full(shape, 1e-6), np.zeros(shape), raster(pitch, shape=shape)
    shares = []
    for _ in range(16):
        ranges = R + 1e-3 * random.normal(size=shape)
        shares.append(np.mean(relief(ranges, alone(own), none, about, nowhere(shape)) > 0.0))
    most = 4.0 * (norm.sf(2.0) + norm.sf(np.sqrt(8.0)))
    assert np.mean(shares) < most + 4.0 * np.std(shares, ddof=1) / 4.0
    assert np.mean(shares) > 0.3 * most


def test_surfaces_are_rugged_about_an_edge() -> None:
    ranges = np.full((9, 41), R)
    ranges[:, 20:] += 0.1
    noise = alone(np.full(ranges.shape, 1e-6))
    where = is_rugged(ranges, noise, raster(1.0))
    # The edge shows two voxels away at a pitch of s and four at two, and counts within 3 s.
    assert np.flatnonzero(where[4]).tolist() == list(range(20 - 7, 20 + 7))
    assert not is_rugged(np.full((9, 41), R), noise, raster(1.0)).any()


@pytest.mark.parametrize("pitch", [0.35, 1.0, 3.0])
def test_noise_that_neighbours_share(pitch: float) -> None:
    """Claim: the variance of differences of neighbours under one speckle pattern is that of the pattern's correlation.

    Set-up: white noise on a fine lattice, summed under exp(−2δ²/w²) for the energy and under its derivative along the
    row for the place, at a pitch in w. Expected: :meth:`SharedNoise.of`. Tolerance: 4.5 standard errors of a variance
    from patterns of the size of w: the field has 60 × 60 pitch², at least 80 here, and no more differences that are
    independent than half of its 3600.
    """
    random = np.random.default_rng(6)
    fine, reach, side = 0.125, 20, 60
    stride = max(1, round(pitch / fine))
    white = random.normal(size=(side * stride + 2 * reach, side * stride + 2 * reach))
    x = fine * np.arange(-reach, reach + 1)
    weight = np.exp(-2.0 * x**2)
    down = np.apply_along_axis(lambda line: np.convolve(line, weight, "valid"), 0, white)
    step = {(0, -1): 1.0, (0, 0): -2.0, (0, 1): 1.0}
    ones, none, apart = np.ones((side, side)), np.zeros((side, side)), np.full((side, side), stride * fine)
    for kernel, noise in (
        (weight, SharedNoise(none, ones, none, Overlap(apart, apart))),
        (x * weight, SharedNoise(none, none, ones, Overlap(apart, apart))),
    ):
        sums = np.apply_along_axis(lambda line, k=kernel: np.convolve(line, k, "valid"), 1, down)
        values = sums[::stride, ::stride][:side, :side] / sums.std()
        found = np.var(values[:, 2:] - 2.0 * values[:, 1:-1] + values[:, :-2])
        assert found == pytest.approx(
            noise.of(step)[30, 30], rel=4.5 * np.sqrt(2.0 / np.clip((side * pitch) ** 2, 80.0, 1800.0))
        )


class TestMixed:
    @staticmethod
    def found(
        ranges: Array, status: Array | None = None, *, faint: bool = False, pitch: float = 3.0
    ) -> NDArray[np.bool_]:
        codes = np.where(np.isfinite(ranges), 0, 1) if status is None else status
        small, none = np.full(ranges.shape, 1e-4), np.zeros(ranges.shape)
        faints = np.full(ranges.shape, faint)
        about = raster(pitch, shape=(ranges.shape[0], ranges.shape[1]))
        return is_mixed(
            ranges, alone(small**2), none, codes.astype(np.uint32), faints, about, np.deg2rad(70.0)
        )

    def test_both_sides_of_a_step(self) -> None:
        ranges = np.full((9, 20), R)
        ranges[:, 10:] += 0.5
        assert np.flatnonzero(self.found(ranges).all(axis=0)).tolist() == [9, 10]
        assert not self.found(np.full((9, 20), R)).any()

    def test_as_far_as_the_spot_reaches(self) -> None:
        ranges = np.full((9, 40), R)
        ranges[:, 20:] += 0.5
        # An edge within 2.5 s: on a pitch of s three voxels to each side, on one of s/2 five.
        for pitch, wide in ((1.0, 3), (0.5, 5)):
            assert np.count_nonzero(self.found(ranges, pitch=pitch)[4]) == 2 * wide

    def test_beside_nothing_unless_noise_may_hide_it(self) -> None:
        ranges = np.full((9, 20), R)
        ranges[:, 10:] = np.nan
        assert np.flatnonzero(self.found(ranges).all(axis=0)).tolist() == [9]
        assert not self.found(ranges, faint=True).any()
        glare = np.where(np.isfinite(ranges), Status.VALID, Status.SATURATED)
        assert self.found(ranges, glare, faint=True).any()

    def test_a_steep_plane_is_one_surface_and_noise_is_no_step(self) -> None:
        step = 3.0 * SPOT
        ranges = np.tile(R + np.tan(np.deg2rad(65.0)) * step * np.arange(20), (9, 1))
        assert not self.found(ranges).any()
        noise = 0.02
        random = np.random.default_rng(3)
        flat = R + noise * random.normal(size=(200, 200))
        about = raster(0.5, shape=flat.shape)
        code, calm = np.zeros(flat.shape, dtype=np.uint32), np.zeros(flat.shape, dtype=np.bool_)
        own, none = alone(np.full(flat.shape, noise**2)), np.zeros(flat.shape)
        found = is_mixed(flat, own, none, code, calm, about, 1.2)
        # 120 neighbours and a normal quantile of 4.5: 8·10⁻⁴ at most, of 40 000 voxels.
        assert found.mean() < 2e-3

    def test_a_single_column_or_voxel_has_nothing_to_say(self) -> None:
        for shape in ((1, 1), (5, 1), (1, 5)):
            assert not self.found(np.full(shape, R)).any()


@pytest.mark.slow
@pytest.mark.parametrize("pitch", [0.4, 1.0, 5.0])
def test_a_voxel_depends_on_its_window_alone(pitch: float) -> None:
    """What is far away changes nothing, so that one voxel can be explained without its image."""
    random = np.random.default_rng(4)
    side, step = 121, pitch * SPOT / R
    middle = side // 2
    ranges, signal = R + 5e-3 * random.normal(size=(side, side)), random.uniform(1e5, 1e6, (side, side))
    reach = window(SPOT / R, (step, step))
    inside = slice(middle - reach, middle + reach + 1)
    near = nowhere((side, side))
    near[inside, inside] = True
    numbers = []
    for other in (ranges, np.where(near, ranges, np.nan)):
        about = Raster.of(other, (step, step), np.full(other.shape, SPOT), 0.0)
        noise = alone(np.full(other.shape, 1e-8))
        where = is_rugged(other, noise, about)
        light = np.where(np.isfinite(other), signal, np.nan)
        moved = 20.0 * texture(light, alone(np.zeros(other.shape)), about, where)
        bent = relief(other, noise, moved, about, where)
        code = np.zeros(other.shape, dtype=np.uint32)
        edge = is_mixed(other, noise, np.hypot(moved, bent), code, nowhere(other.shape), about, 1.3)
        numbers.append((moved[middle, middle], bent[middle, middle], edge[middle, middle]))
    assert numbers[0] == numbers[1]
