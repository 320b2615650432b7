"""Uneven spots: what signals and ranges of neighbours say of the light within one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from scanner_sim.ranging.uneven import Raster, mixed, relief, texture, window
from scanner_sim.status import Status

Array = NDArray[np.float64]

SPOT, R = 1e-3, 4.0
ROWS, COLUMNS = 9, 41


def raster(pitch: float, *, travel: bool = False, shape: tuple[int, int] = (ROWS, COLUMNS)) -> Raster:
    """Return a raster of a pitch in standard deviations of the spot."""
    step = pitch * SPOT / R
    return Raster.of(np.full(shape, R), (step, step), np.full(shape, SPOT), step if travel else 0.0)


def places(pitch: float) -> Array:
    """Return the columns' places across an edge that lies off the middle [s], shape (rows, columns)."""
    return np.tile((np.arange(COLUMNS) - COLUMNS // 2 + 0.3) * pitch, (ROWS, 1))


@pytest.mark.parametrize("pitch", [0.3, 0.6, 1.0, 3.0, 6.0])
def test_texture_is_the_shift_of_the_light(pitch: float) -> None:
    """Claim: the shift of a Gaussian spot's centroid at an edge of reflectance is found from the signals alone.

    Set-up: an edge from 0.2 to 0.8, mirrors at rest. Expected: s² ∂ln Y/∂x with Y the reflectance smoothed by the spot.
    Tolerance: the finite difference's: 12 % of the largest up to a pitch of s. On a coarse one the edge is taken to lie
    sharp between plateaus, as it does: no less than the shift, and no more than 1.6 of it, for the least value, half
    the central difference, lifts the neighbours.
    """
    at = places(pitch)
    signal = 0.2 + 0.6 * norm.cdf(at)
    shift = SPOT * 0.6 * norm.pdf(at) / signal
    found = texture(1e6 * signal, np.zeros_like(signal), raster(pitch))
    inner = np.s_[:, 2:-2]
    if pitch <= 1.0:
        np.testing.assert_allclose(found[inner], shift[inner], rtol=0.1, atol=0.12 * shift.max())
    else:
        assert (found[inner] >= 0.95 * shift[inner] - 1e-2 * SPOT).all()
        assert found[inner].max() < 1.6 * max(shift.max(), 0.3 * SPOT)


def test_noise_is_no_texture() -> None:
    random = np.random.default_rng(1)
    signal = 1e6 * (1.0 + 0.05 * random.normal(size=(200, 200)))
    moved = texture(signal, np.full(signal.shape, 0.05**2), raster(2.0, shape=signal.shape))
    # The same speckle moves the spot's own centroid by about its contrast of s.
    assert np.sqrt(np.mean(moved**2)) < 0.4 * SPOT * 0.05
    assert texture(np.full((5, 5), 3.0), np.zeros((5, 5)), raster(2.0, shape=(5, 5))).max() == 0.0


def test_the_light_shifts_by_no_more_than_half_a_spot() -> None:
    signal = np.where(places(1.0) > 0.0, 1.0, 1e-6)
    assert texture(signal, np.zeros_like(signal), raster(1.0)).max() == pytest.approx(0.8 * SPOT)


@pytest.mark.parametrize("pitch", [0.5, 2.0, 4.0])
def test_a_crease_and_a_step_are_relief_and_a_plane_is_not(pitch: float) -> None:
    at, noise = SPOT * places(pitch), np.full((ROWS, COLUMNS), 1e-6)
    none = np.zeros_like(noise)
    plane = R + 1.5 * at
    assert relief(plane, noise, none, raster(pitch)).max() == 0.0
    crease = R + np.abs(at)
    assert relief(crease, noise, none, raster(pitch)).max() > 0.2 * SPOT
    step = R + 10.0 * SPOT * norm.cdf(at / SPOT)
    found = relief(step, noise, none, raster(pitch))
    true = np.abs(10.0 * SPOT * (norm.cdf(at / SPOT) - (at > 0.0)))
    assert found[:, 4:-4].max() > 0.5 * true.max()
    assert found[:, 4] == pytest.approx(0.0, abs=1e-3 * SPOT)


def test_what_noise_explains_is_no_relief() -> None:
    random = np.random.default_rng(2)
    noise = np.full((200, 200), 5e-4)
    ranges = R + 5e-4 * random.normal(size=noise.shape)
    found = relief(ranges, noise, np.zeros_like(noise), raster(2.0, shape=noise.shape))
    assert np.sqrt(np.mean(found**2)) < 0.35 * 5e-4


class TestMixed:
    @staticmethod
    def found(
        ranges: Array, status: Array | None = None, *, faint: bool = False, pitch: float = 3.0
    ) -> NDArray[np.bool_]:
        codes = np.where(np.isfinite(ranges), 0, 1) if status is None else status
        small, none = np.full(ranges.shape, 1e-4), np.zeros(ranges.shape)
        faints = np.full(ranges.shape, faint)
        about = raster(pitch, shape=(ranges.shape[0], ranges.shape[1]))
        return mixed(ranges, small, none, codes.astype(np.uint32), faints, about, np.deg2rad(70.0))

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
        alone = mixed(flat, np.full(flat.shape, noise), np.zeros(flat.shape), code, calm, about, 1.2)
        # 120 neighbours and a normal quantile of 4.5: 8·10⁻⁴ at most, of 40 000 voxels.
        assert alone.mean() < 2e-3

    def test_a_single_column_or_voxel_has_nothing_to_say(self) -> None:
        for shape in ((1, 1), (5, 1), (1, 5)):
            assert not self.found(np.full(shape, R)).any()


@pytest.mark.parametrize("pitch", [0.4, 1.0, 5.0])
def test_a_voxel_depends_on_its_window_alone(pitch: float) -> None:
    """What is far away changes nothing, so that one voxel can be explained without its image."""
    random = np.random.default_rng(4)
    side, step = 61, pitch * SPOT / R
    ranges, signal = R + 5e-3 * random.normal(size=(side, side)), random.uniform(1e5, 1e6, (side, side))
    reach = window(SPOT / R, (step, step))
    near = np.zeros((side, side), dtype=np.bool_)
    near[30 - reach : 31 + reach, 30 - reach : 31 + reach] = True
    numbers = []
    for other in (ranges, np.where(near, ranges, np.nan)):
        about = Raster.of(other, (step, step), np.full(other.shape, SPOT), 0.0)
        moved = 20.0 * texture(np.where(np.isfinite(other), signal, np.nan), np.zeros(other.shape), about)
        bent = relief(other, np.full(other.shape, 1e-4), moved, about)
        edge = mixed(
            other,
            np.full(other.shape, 1e-4),
            np.hypot(moved, bent),
            np.zeros(other.shape, dtype=np.uint32),
            np.zeros(other.shape, dtype=np.bool_),
            about,
            1.3,
        )
        numbers.append((moved[30, 30], bent[30, 30], edge[30, 30]))
    assert numbers[0] == numbers[1]
