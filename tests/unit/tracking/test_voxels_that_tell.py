"""Which voxels tell what of a target: the range beside a retro-reflector, the disc where light has gaps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.tracking.centroid import Centroid
from scanner_sim.tracking.measurement import TargetAppearance, _Seeing, _turned_plane
from scanner_sim.tracking.plane import target_plane
from scanner_sim.tracking.response import Response, TargetKind
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.target_ranges import Ranges, _plain, target_ranges

Array = NDArray[np.float64]


def response_of(value: Array, used: NDArray[np.bool_], hit: NDArray[np.bool_], ground: Array) -> Response:
    """Return what patterns say, with targets of 0.1 and thresholds midway."""
    target = np.full(len(value), 0.1)
    half = 0.5 * (target + ground)
    none = np.zeros(value.shape, dtype=bool)
    return Response(
        value, 0.01 * np.ones_like(value), used, hit, half, target, ground, half, half > 0.0, none
    )


def test_beside_a_retro_reflector_the_range_is_that_of_voxels_without_its_light() -> None:
    """Claim: voxels tell the range that count, do not hit and have the ground's light within its half; where fewer
    than six of them are left, all that count do. Each pattern by its own ground."""
    value = np.array(
        [
            [1.01, 2.99, 2.0, 2.1, 1.9, 2.2, 2.8, 0.99, 3.01, 2.0, 2.0, 9.0],
            [2.01, 5.99, 4.0, 4.1, 3.9, 1.99, 6.01, 4.0, 4.0, 4.0, 20.0, 4.0],
        ]
    )
    used, hit = np.ones((2, 12), dtype=bool), np.zeros((2, 12), dtype=bool)
    used[0, 9], used[1, 9] = False, False
    hit[0, 10:], hit[1, 10:] = True, True
    ground = np.array([2.0, 4.0])
    plain = np.arange(12) < np.array([[7], [5]])
    plain[1, 7:9] = True
    np.testing.assert_array_equal(_plain(response_of(value, used, hit, ground)), plain)
    # Five in the second pattern: too few.
    used[1, 7:9] = False
    plain[1] = used[1]
    np.testing.assert_array_equal(_plain(response_of(value, used, hit, ground)), plain)


@pytest.mark.parametrize("shining", [0.0, 0.5, 1.0])
def test_where_light_has_gaps_the_disc_is_that_of_voxels_partly_on_it(
    shining: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: with gaps in the light a disc is fitted where six voxels that count have its rim within 1.645 of the
    spot's σ and half of their way in the light, 5 to 95 % of them on it; elsewhere the circle stands. Without gaps the
    fit stands in any case, and what the light itself is never matters."""
    rows, count, rng = 40, 12, np.random.default_rng(8)
    wide = np.linspace(0.02, 0.06, rows)
    away = 2.0 + rng.normal(0.0, 0.1, (rows, count))
    turn = 0.01 * np.arange(count) + 3.0 * rng.random((rows, 1))
    place = 1.0 + away * np.cos(turn), 1.0 + away * np.sin(turn)
    none = np.zeros((rows, count))
    samples = PatternSamples(none, *place, none, none, none, none, np.zeros((rows, count), np.uint8))
    way = np.hypot(*(np.gradient(part, axis=1, edge_order=2) for part in place))
    used = rng.random((rows, count)) < 0.9
    near = np.abs(away - 2.0) <= 1.645 * wide[:, None] + 0.5 * shining * way
    expected = ((near & used).sum(axis=1) >= 6) | (shining == 1.0)
    assert 5 < expected.sum() < 35 or shining == 1.0
    response = response_of(rng.random((rows, count)), used, used, np.ones(rows))
    ones = np.ones(rows)
    circle = Centroid(
        np.zeros((rows, 2)), np.zeros((rows, 2, 2)), ones, 0.1 * ones, ones, ones > 0.0, gains=None
    )
    fitted = replace(circle, centre=np.ones((rows, 2)), radius=2.0 * ones, gains=np.ones((rows, 2, count)))
    monkeypatch.setattr(_Seeing, "_disc", lambda *_: fitted)
    appearance = TargetAppearance(kind=TargetKind.BLACK, diameter=0.1)
    best = _Seeing(samples, response, appearance, wide, shining, 0.0, None)._best(samples, response, circle)
    np.testing.assert_array_equal(best.centre[:, 0] == 1.0, expected)
    np.testing.assert_array_equal(best.radius, np.where(expected, 2.0, 1.0))


@pytest.mark.parametrize("line", [True, False])
@pytest.mark.parametrize("kind", [TargetKind.RETRO, TargetKind.WHITE])
def test_a_disc_of_a_retro_reflector_is_believed_where_it_explains_the_light(
    kind: TargetKind, line: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the circle stands where light of the pattern is clipped, where χ² is above five for each degree of
    freedom, where hits alone say where the disc is, and of pulses: no value then moves the centre. A white disc is
    believed in any case."""
    misfit = np.array([1.0, 5.0, 5.01, np.nan, 1.0])
    rows, none = len(misfit), np.zeros((len(misfit), 12))
    samples = PatternSamples(*[none] * 7, np.zeros(none.shape, np.uint8))
    used = none == 0.0
    response = response_of(none, used, used, np.ones(rows))
    response.clipped[4, 3] = True
    ones = np.ones(rows)
    circle = Centroid(np.zeros((rows, 2)), np.zeros((rows, 2, 2)), ones, 0.1 * ones, ones, ones > 0.0)
    fitted = replace(circle, centre=np.ones((rows, 2)), misfit=misfit, gains=np.ones((rows, 2, 12)))
    monkeypatch.setattr(_Seeing, "_disc", lambda *_: fitted)
    by_line = 0.0 * ones if line else None
    seen = _Seeing(samples, response, TargetAppearance(kind=kind, diameter=0.1), ones, 1.0, 0.0, by_line)
    best = seen._best(samples, response, circle)
    expected = line * np.array([1.0, 1.0, 0.0, 0.0, 0.0]) if kind is TargetKind.RETRO else ones
    np.testing.assert_array_equal(best.centre[:, 0], expected)
    assert best.gains is not None
    np.testing.assert_array_equal(best.gains[:, 1, 5], expected)


def test_a_mean_of_hits_takes_the_rim_to_be_where_the_size_says() -> None:
    """Claim: voxels at the rim do not tell the range where hits alone, of too small a radius, say where the target is:
    with the known radius those count that lie 3 σ of the spot, a σ of the mean and half of their way off."""
    away = np.linspace(0.0, 2.6e-3, 27)[None]
    spot, sigma, known, none = 0.1e-3, 0.2e-3, 1.6e-3, np.zeros((1, 27))
    still = np.tile([0.0, 1e-9], 14)[None, :27]
    samples = PatternSamples(none, away, still, none, none, none, none, np.zeros((1, 27), np.uint8))
    every = none == 0.0
    response = response_of(none + 0.5, every, every, np.ones(1))
    appearance = TargetAppearance(kind=TargetKind.BLACK, diameter=0.1)
    see = _Seeing(samples, response, appearance, np.array([spot]), 1.0, 0.0, None)
    one = np.ones(1)
    hits = Centroid(
        np.zeros((1, 2)), sigma**2 * np.eye(2)[None], 1e-3 * one, sigma * one, np.nan * one, one > 0.0
    )
    way = 0.1e-3
    for misfit, radius, blur in ((np.nan, known, 3.0 * spot + sigma), (1.0, 1e-3, 3.0 * spot)):
        told = see._ranged(samples, replace(hits, misfit=np.array([misfit])), np.array([known]))
        expected = np.abs(away - radius) > blur + 0.5 * way
        assert 12 <= expected.sum() < 27
        np.testing.assert_array_equal(told.used, expected)
    # Hits beyond the known size are of something larger.
    large = replace(hits, radius=2.0 * one * known)
    np.testing.assert_array_equal(
        see._ranged(samples, large, np.array([known])).used,
        np.abs(away - 2.0 * known) > 3.0 * spot + sigma + 0.5 * way,
    )


def test_planes_that_turned_are_found_anew_and_others_stay() -> None:
    about, rng = np.array([[0.1, -0.05], [0.0, 0.2]]), np.random.default_rng(4)
    slope = rng.normal(0.0, 2.0, (2, 2))
    plane = target_plane(about, np.array([29.0, 31.0]), slope, 0.05, 0.2)
    told = Ranges(
        about, np.array([29.5, 30.0]), rng.normal(0.0, 2.0, (2, 2)), np.zeros((2, 3, 3)),
        np.zeros((2, 3, 5)), np.ones(2, dtype=bool),
    )  # fmt: skip
    after = _turned_plane(plane, told, np.array([False, True]))
    np.testing.assert_array_equal(after.distance, [29.0, 30.0])
    np.testing.assert_array_equal(after.slope, [slope[0], told.slope[1]])
    np.testing.assert_array_equal(after.point[0], plane.point[0])
    np.testing.assert_array_equal(after.centre, about)
    assert (after.axis_separation, after.baseline) == (0.05, 0.2)


def test_a_spheres_cap_tells_its_range() -> None:
    """Claim: of voxels on a sphere of 0.5 m those within 0.8 of its radius count, ρ = R δ, each by its own range; what
    they tell is the middle's range, √(r² − ρ²) behind them."""
    away = np.array([0.0, 0.79, 0.81, 0.5, 0.7, 0.4, 0.79, 0.81, 0.95, 0.6, 0.3])
    turn = np.array([0.0, 0.3, 0.5, 2.0, 3.5, 5.0, 4.0, 1.0, 2.0, 1.2, 2.9])
    middle, radius, about = 9.0, 0.5, np.array([[0.02, -0.03]])
    reach = middle - radius * np.sqrt(1.0 - away**2)
    off = radius * away / reach
    one = np.ones((1, len(away)))
    angles = about[0, 0] + off * np.cos(turn), about[0, 1] + off * np.sin(turn)
    samples = PatternSamples(
        np.linspace(0.0, 1e-3, len(away))[None], angles[0][None], angles[1][None], one, one,
        (reach / np.cos(off))[None], 1e-3 * one, np.zeros(one.shape, np.uint8),
    )  # fmt: skip
    hit = one > 0.0
    known = np.array([radius / middle])
    centre = Centroid(about, np.zeros((1, 2, 2)), known, known, known, np.ones(1, dtype=bool))
    found = target_ranges(
        samples,
        response_of(one, hit, hit, np.ones(1)),
        TargetKind.RAISED,
        centre,
        about,
        np.array([5e-4]),
        sphere=radius,
    )
    np.testing.assert_array_equal(found.gains[0].any(axis=0), away < 0.8)
    # ρ = R δ is R sin δ to a thousandth, of which the depth is 0.75 r at most.
    assert found.at[0] == pytest.approx(middle, abs=2e-3)
    np.testing.assert_allclose(found.slope, 0.0, atol=0.05)
