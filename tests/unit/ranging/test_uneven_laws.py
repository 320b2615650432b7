"""Uneven spots, number by number: what textures, creases and steps of a known form make of a voxel, and their noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from scanner_sim.foundation.status import Status
from scanner_sim.ranging.mixed_voxels import is_faint, is_mixed
from scanner_sim.ranging.shared_noise import Overlap, SharedNoise
from scanner_sim.ranging.uneven import Raster, _sharp_edge, is_rugged, relief, texture, window

Array = NDArray[np.float64]

S = 1e-3
"""Standard deviation of the spot [m]."""
SHAPE = (9, 21)
MIDDLE = (4, 10)


def raster(across: float, down: float = 0.0, travel: float = 0.0) -> Raster:
    """Return a raster with pitches and a way of the beam in standard deviations of the spot."""
    lengths = (across, down or across, 1.0, travel)
    return Raster(*(np.full(SHAPE, S * length) for length in lengths))


def noise(variance: Array | float) -> SharedNoise:
    """Return noise that each voxel has of its own."""
    none = np.zeros(SHAPE)
    return SharedNoise(none + variance, none, none, Overlap(none + 1.0, none + 1.0))


def everywhere(answer: bool) -> NDArray[np.bool_]:
    return np.full(SHAPE, answer)


@pytest.mark.parametrize("rugged", [False, True])
@pytest.mark.parametrize("pitch", [0.4, 1.2, 3.0])
def test_a_brightness_that_rises_evenly_shifts_the_light_everywhere_alike(pitch: float, rugged: bool) -> None:
    """Claim: ln Y = g x gives s² g, more by √(1 + δ²/(δ² + 5 s²)), less the noise of half the outer difference.

    Expected: of that noise, ½ of a voxel's variance, six times where surfaces are even and once where they are rugged;
    the rim as all others.
    """
    rise, own = 0.1, 4e-4
    signal = np.exp(rise * np.arange(SHAPE[1])) * np.ones((SHAPE[0], 1))
    found = texture(signal, noise(own), raster(pitch, travel=pitch), everywhere(rugged))
    beyond = rise**2 - (1.0 if rugged else 6.0) * 0.5 * own
    wanted = S / pitch * math.sqrt(beyond * (1.0 + pitch**2 / (pitch**2 + 5.0)))
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_a_line_within_a_voxel_is_seen_by_its_contrast_to_both_neighbours() -> None:
    """Claim: a column brighter than both neighbours by D in ln Y counts with 0.6 D, less four times its noise 2 v."""
    contrast, own, pitch = 0.3, 1e-3, 1.2
    signal = np.ones(SHAPE)
    signal[:, MIDDLE[1]] = math.exp(contrast)
    found = texture(signal, noise(own), raster(pitch, travel=pitch), everywhere(False))[4]
    wider = 1.0 + pitch**2 / (pitch**2 + 5.0)
    beside = S / pitch * math.sqrt(((0.5 * contrast) ** 2 - 3.0 * own) * wider)
    assert found[10] == pytest.approx(S / pitch * 0.6 * math.sqrt(contrast**2 - 8.0 * own), rel=1e-9)
    np.testing.assert_allclose(found[[9, 11]], beside, rtol=1e-9)
    assert (found[:9] == 0.0).all()
    assert (found[12:] == 0.0).all()


@pytest.mark.parametrize("share", [0.3, 0.5, 0.85])
def test_a_sharp_edge_between_voxels_at_rest_is_found_from_the_share_of_light(share: float) -> None:
    """Claim: at rest on a coarse raster a spot with the share t of a step D has s D φ(Φ⁻¹(t))/Y, less its noise."""
    own, low, high = 1e-3, 1.0, 1.5
    signal = np.full(SHAPE, low)
    signal[:, 11:] = high
    signal[:, 10] = low + share * (high - low)
    found = texture(signal, noise(own), raster(3.0), everywhere(False))[4, 10]
    slope = (high - low) * norm.pdf(norm.ppf(share)) / signal[4, 10]
    assert found == pytest.approx(S * math.sqrt(slope**2 - 2.0 * own), rel=1e-9)
    mirrored = texture(signal[:, ::-1], noise(own), raster(3.0), everywhere(False))[4, 10]
    assert mirrored == pytest.approx(found, rel=1e-12)


def test_half_the_outer_difference_counts_where_the_share_says_nothing() -> None:
    """Claim: a voxel as bright as its left neighbour holds half the gradient that its neighbours show."""
    signal = np.ones(SHAPE)
    signal[:, 11:] = 1.2
    found = texture(signal, noise(0.0), raster(3.0), everywhere(False))[4]
    half = S / 3.0 * 0.5 * 0.5 * math.log(1.2) * math.sqrt(1.0 + 9.0 / 14.0)
    np.testing.assert_allclose(found[[10, 11]], half, rtol=1e-2)


@pytest.mark.parametrize("rugged", [False, True])
def test_a_bent_surface_has_the_relief_of_its_second_differences(rugged: bool) -> None:
    """Claim: R = a x² + b y² gives 0.3 of the spot over the pitch times Δ², less 6 v by trust, both axes in squares.

    Expected: along the row the spot is as wide as its way makes it, √(s² + (v t)²/12).
    """
    own, across, down, travel = 1e-9, 2.0, 2.5, 1.5
    y, x = (S * at for at in np.ogrid[-4:5, -10:11])
    a, b = 60.0, 45.0
    ranges = a * (across * x) ** 2 + b * (down * y) ** 2
    about = raster(across, down, travel)
    found = relief(ranges, noise(own), np.full(SHAPE, 1e-5), about, everywhere(rugged))
    explained = (1.0 if rugged else 4.0) * 6.0 * own
    parts = [
        0.3 * wide / pitch * math.sqrt((2.0 * bend * (pitch * S) ** 2) ** 2 - explained)
        for bend, pitch, wide in (
            (a, across, math.sqrt(1.0 + travel**2 / 12.0)),
            (b, down, 1.0),
        )
    ]
    # What noise and textures explain of steps is more than there are: only the bends are left. The rim takes the
    # differences beside it.
    np.testing.assert_allclose(found, math.hypot(*parts), rtol=1e-9)


@pytest.mark.parametrize("rugged", [False, True])
@pytest.mark.parametrize("along", [0, 1])
def test_a_step_is_the_difference_of_two_bends(along: int, rugged: bool) -> None:
    """Claim: R = k x³, which is not bent at 0, gives 0.4 of 12 k δ³, less 10 (v + σ²) by trust."""
    own, textured, pitch, k = 1e-10, 2e-5, 2.0, 2e4
    at = pitch * S * (np.indices(SHAPE)[along] - MIDDLE[along])
    found = relief(k * at**3, noise(own), np.full(SHAPE, textured), raster(pitch), everywhere(rugged))
    rise = 12.0 * k * (pitch * S) ** 3
    explained = (2.0 if rugged else 8.0) * 10.0 * (own + textured**2)
    assert found[MIDDLE] == pytest.approx(0.4 * math.sqrt(rise**2 - explained), rel=1e-9)


@pytest.mark.parametrize(("pitch", "farthest"), [(0.5, 4), (0.8, 3), (1.9, 2), (2.0, 1)])
def test_bends_are_looked_for_as_far_as_two_standard_deviations(pitch: float, farthest: int) -> None:
    """Claim: the largest step n has (n − 1) δ < 2 s: R = k x² gives 0.3 s/(n δ) 2 k (n δ)², the more the larger n."""
    k = 0.1
    x = pitch * S * (np.arange(SHAPE[1]) - MIDDLE[1]) * np.ones((SHAPE[0], 1))
    found = relief(k * x**2, noise(0.0), np.zeros(SHAPE), raster(pitch), everywhere(False))
    assert found[MIDDLE] == pytest.approx(0.6 * k * S * farthest * pitch * S, rel=1e-6)


@pytest.mark.parametrize(("share", "wanted"), [(0.999, 0), (1.001, 13)])
def test_a_bend_is_certain_beyond_five_standard_deviations(share: float, wanted: int) -> None:
    """Claim: a voxel stands out where 2 h exceeds 5 √(6 v); then 3 s about it are rugged, 13 voxels at 1.5 s."""
    own = 1e-8
    ranges = np.full(SHAPE, 4.0)
    ranges[MIDDLE] += share * 0.5 * 5.0 * math.sqrt(6.0 * own)
    found = is_rugged(ranges, noise(own), raster(1.5))
    assert found.sum() == wanted
    assert found[MIDDLE] == bool(wanted)


@pytest.mark.parametrize(("share", "mixed"), [(0.999, False), (1.001, True)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_voxel_is_mixed_beyond_slope_noise_and_unevenness(sign: float, share: float, mixed: bool) -> None:
    """Claim: neighbours differ by no more than tan(steepest) δ min(1, R'/R) and √(4.5² (v + v') + 2² (u² + u'²))."""
    r, steepest, variances, uneven = 4.0, math.radians(50.0), (2e-6, 1e-6), (3e-3, 2e-3)
    own, doubt = np.full(SHAPE, variances[1]), np.full(SHAPE, uneven[1])
    own[MIDDLE], doubt[MIDDLE] = variances[0], uneven[0]
    spread = math.sqrt(4.5**2 * sum(variances) + 2.0**2 * (uneven[0] ** 2 + uneven[1] ** 2))
    rise, about = math.tan(steepest) * 300.0 * S, raster(300.0, 400.0)
    # The middle lies at r + sign h: the farther of two voxels has the less to rise, R'/R of it.
    h = share * (rise + spread)
    for _ in range(50):
        h = share * (rise * r / (r + h) + spread)
    if sign < 0.0:
        h = share * (rise * (r - h) / r + spread)
        for _ in range(50):
            h = share * (rise * (r - h) / r + spread)
    ranges = np.full(SHAPE, r)
    ranges[MIDDLE] += sign * h
    status = np.full(SHAPE, Status.VALID, dtype=np.uint32)
    found = is_mixed(ranges, noise(own), doubt, status, everywhere(False), about, steepest)
    seen = found[MIDDLE] if sign > 0.0 else found[4, 9]
    assert seen == mixed


@pytest.mark.parametrize(("share", "alike"), [(0.999, True), (1.001, False)])
def test_heights_are_alike_within_noise_and_speckle(share: float, alike: bool) -> None:
    """Claim: two heights are of one light within 4.5 √(2 (1 + C² h²)); fainter than the limit they may be hidden."""
    height, speckle = 8.0, 0.02
    heights = np.full(SHAPE, height)
    heights[MIDDLE] += share * 4.5 * math.sqrt(2.0 * (1.0 + speckle * height**2))
    found = is_faint(heights, 9.0, np.full(SHAPE, speckle), raster(3.0))
    inside = np.s_[1:-1, 1:-1]
    # The rim has no neighbours on one side, which no height can be alike.
    assert found[3, 9] == alike
    assert found[2, 5]
    assert found[MIDDLE] == False  # noqa: E712
    assert not is_faint(heights, 7.9, np.full(SHAPE, speckle), raster(3.0))[inside].any()


def test_shared_noise_is_the_quadratic_form_of_its_correlations() -> None:
    """Claim: Σ wᵢ wⱼ C(i − j) with C = v δᵢⱼ + e exp(−δ²/w²) + p (1 − 2 x²/w²) exp(−δ²/w²), x along the row."""
    across, down, own, energy, position = 0.45, 0.7, 0.3, 1.1, 0.8
    stencil = {(0, 0): 1.0, (1, 2): -2.5, (-1, 1): 0.7, (2, 0): 1.2}
    ones = np.ones(SHAPE)
    shared = SharedNoise(own * ones, energy * ones, position * ones, Overlap(across * ones, down * ones))
    wanted = 0.0
    for one, weight in stencil.items():
        for other, more in stencil.items():
            y, x = (one[0] - other[0]) * down, (one[1] - other[1]) * across
            correlation = (energy + position * (1.0 - 2.0 * x * x)) * math.exp(-x * x - y * y)
            wanted += weight * more * (correlation + (own if one == other else 0.0))
    found = shared.of(stencil)
    assert found[MIDDLE] == pytest.approx(wanted, rel=1e-12)
    assert np.isnan(found[0]).all()
    assert np.isnan(found[:, -1]).all()


@pytest.mark.parametrize("place", [-1.3, -0.4, 0.0, 0.9])
def test_a_sharp_edge_has_the_slope_of_a_spot_that_it_cuts(place: float) -> None:
    """Claim: a spot's light beyond an edge is a + b Φ(x/s); s d ln Y/dx is b φ(x/s)/Y, by differences."""
    dark, step = 40.0, 300.0

    def light(x: float) -> float:
        return float(dark + step * norm.cdf(x))

    signal = np.array([[dark, light(place), dark + step]])
    wanted = (math.log(light(place + 1e-5)) - math.log(light(place - 1e-5))) / 2e-5
    assert _sharp_edge(signal)[0, 1] == pytest.approx(wanted, rel=1e-6)
    assert _sharp_edge(signal[:, ::-1])[0, 1] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize(
    ("across", "down", "wanted"),
    [(0.8, 1.9, 4 + 2 + 4 + 3 + 3), (5.0, 1.3, 2 + 1 + 3 + 2 + 2), (9.0, 4.0, 5)],
)
def test_a_voxel_is_judged_by_those_within_all_reaches_of_its_spot(
    across: float, down: float, wanted: int
) -> None:
    """Claim: in steps of the finer pitch, one each at least: 2.5 spots to edges, one beside what is found, 3 about
    what is rugged, and twice 2 for differences; two for the rim and one more. Pitches are given in spots."""
    assert window(7e-4, (7e-4 * across, 7e-4 * down)) == wanted + 3


def test_a_voxel_without_light_is_no_sharp_edge() -> None:
    """Claim: beside light it has no slope of its own, and neither it nor its neighbours are uneven without end."""
    signal = np.array([[2.0, 0.0, 5.0, 5.0, 5.0]])
    assert np.isnan(_sharp_edge(signal)[0, 1])
    whole = np.ones(SHAPE)
    whole[4, 10] = 0.0
    found = texture(whole, noise(0.0), raster(1.5), everywhere(False))
    assert np.isfinite(found).all()
