"""The centre of a disc from made-up crossings and exact responses: closed forms of circle, hits and fit."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import claims
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from scanner_sim.analytic import tracking as judge
from scanner_sim.foundation.status import Status
from scanner_sim.scan.lissajous import LissajousPattern, figure_angles, figures
from scanner_sim.tracking.centroid import Centroid, centroid_of, circle_fit, hit_centroid
from scanner_sim.tracking.disc_fit import disc_fit, share_on_disc
from scanner_sim.tracking.response import Response, TargetKind, target_response
from scanner_sim.tracking.samples import PatternSamples, rise_per_point

Array = NDArray[np.float64]

GATE = (5.0, 15.0)
CENTRE, RADIUS = np.array([0.02, -0.01]), 5e-3


def samples_of(place: Array, value: Array, sigma: float | Array = 1e-3) -> PatternSamples:
    """Return one pattern of given places (points, 2) and signals (points,)."""
    one = np.ones((1, len(place)))
    return PatternSamples(
        time=50e-6 * np.arange(len(place))[None],
        theta=place[None, :, 0],
        phi=place[None, :, 1],
        signal=value[None],
        sigma_signal=sigma * one,
        range=10.0 * one,
        sigma_range=0.01 * one,
        status=np.zeros(one.shape, np.uint8),
    )


def spokes(radii: Array, half: float) -> tuple[PatternSamples, Any]:
    """Return a black disc whose rim is crossed at even angles and these radii, by pairs of points ``half`` off it."""
    count = len(radii)
    turn = 2.0 * np.pi * np.arange(count) / count
    places, values = [], []
    for number in range(count):
        away = np.array([np.cos(turn[number]), np.sin(turn[number])])
        pair = [(radii[number] - half, 0.1), (radii[number] + half, 1.0)]
        # In and out, then out and in: nothing else crosses.
        for distance, value in pair if number % 2 == 0 else pair[::-1]:
            places.append(CENTRE + distance * away)
            values.append(value)
    samples = samples_of(np.array(places), np.array(values))
    return samples, target_response(samples, TargetKind.BLACK, GATE)


def test_a_circle_through_an_edge_that_hardly_bends_does_not_run_away() -> None:
    """Claim: a step of the adjustment moves centre and radius by half a radius of the crossings about their middle at
    most, on each axis, and by that where the points would have more.

    Set-up: twelve crossings of a nearly straight edge, 10 mrad long, that scatter by 0.03 mrad; the steps are the
    differences of what more and more rounds find.
    """
    random = np.random.default_rng(2)
    along = np.linspace(-5e-3, 5e-3, 12)
    edge = 3e-5 * random.standard_normal(12)
    places = np.concatenate(
        [
            CENTRE + [[x, y + side * turn * 1e-4] for side in (-1.0, 1.0)]
            for x, y, turn in zip(along, edge, np.resize([1.0, -1.0], 12), strict=True)
        ]
    )
    values = np.resize([0.1, 1.0, 1.0, 0.1], 24)
    samples = samples_of(places, values)
    response = target_response(samples, TargetKind.BLACK, GATE)
    size = np.sqrt(np.mean(along**2 + (edge - edge.mean()) ** 2))
    found = [circle_fit(samples, response, rounds=rounds) for rounds in range(5)]
    steps = np.array(
        [
            [*np.abs(later.centre[0] - first.centre[0]), abs(later.radius[0] - first.radius[0])]
            for first, later in pairwise(found)
        ]
    )
    assert steps.max() == pytest.approx(0.5 * size, rel=1e-6)


@pytest.mark.parametrize(("blurred", "share"), [(True, 0.1), (False, 12.0**-0.5)])
def test_a_clean_circle_is_as_good_as_its_points_are_close(blurred: bool, share: float) -> None:
    """Claim: n even crossings tell the centre to √(2/n) and the radius to √(1/n) of an edge's error between points."""
    half, count = 2e-4, 12
    found = circle_fit(*spokes(RADIUS * (1.0 + 1e-7 * (-1.0) ** np.arange(count)), half), blurred=blurred)
    edge = share * np.sqrt(np.mean([(2.0 * half) ** 2] * count))
    np.testing.assert_allclose(found.centre[0], CENTRE, atol=1e-9)
    assert found.radius[0] == pytest.approx(RADIUS, rel=1e-6)
    np.testing.assert_allclose(found.covariance[0], 2.0 / count * edge**2 * np.eye(2), rtol=1e-4, atol=1e-18)
    assert found.sigma_radius[0] == pytest.approx(edge / np.sqrt(count), rel=1e-4)


@pytest.mark.parametrize("count", [6, 12])
def test_a_rough_circle_has_the_variance_of_its_residuals(count: int) -> None:
    """Claim: the residuals' variance is their sum of squares over n − 3, here of ±ε by turns."""
    error, half = 5e-5, 2e-5
    radii = RADIUS + error * (-1.0) ** np.arange(count)
    found = circle_fit(*spokes(radii, half))
    variance = count * error**2 / (count - 3)
    np.testing.assert_allclose(found.centre[0], CENTRE, atol=1e-8)
    np.testing.assert_allclose(np.diag(found.covariance[0]), 2.0 / count * variance, rtol=1e-2)
    assert found.misfit[0] == pytest.approx(variance / RADIUS**2, rel=1e-2)


def test_a_false_edge_counts_as_huber_has_it() -> None:
    """Claim: the circle is that of the weights min(1, 2 s/|e|), s the residuals' deviation with n − 3."""
    count = 16
    radii = np.full(count, RADIUS)
    radii[3] *= 1.5
    found = circle_fit(*spokes(radii, 1e-5))
    turn = 2.0 * np.pi * np.arange(count) / count
    x, y = radii * np.cos(turn), radii * np.sin(turn)
    place = np.array([0.0, 0.0, RADIUS])
    for _ in range(100):
        away = x - place[0], y - place[1]
        distance = np.hypot(*away)
        residual = distance - place[2]
        spread = np.sqrt(np.sum(residual**2) / (count - 3))
        weight = np.minimum(1.0, 2.0 * spread / np.maximum(np.abs(residual), 1e-30))
        rows = np.stack([-away[0] / distance, -away[1] / distance, -np.ones(count)], axis=1)
        change = np.linalg.solve(rows.T * weight @ rows, rows.T @ (weight * -residual))
        place = place + change
    np.testing.assert_allclose(found.centre[0] - CENTRE, place[:2], atol=2e-7)
    assert found.radius[0] == pytest.approx(place[2], rel=1e-4)


def test_three_edges_are_no_circle() -> None:
    samples, response = spokes(np.full(4, RADIUS), 1e-4)
    assert circle_fit(samples, response).found[0]
    hidden = replace(response, used=response.used & (np.arange(8) != 7))
    assert not circle_fit(samples, hidden).found[0]


def test_an_edge_lies_where_the_line_between_both_values_reaches_the_threshold() -> None:
    """Claim: values between the levels move the crossing in proportion, from the first point to the second."""
    count, half = 12, 2e-4
    samples, _ = spokes(np.full(count, RADIUS), half)
    value = samples.signal.copy()
    outside = value > 0.5
    # The outer points of some spokes are partly on the disc: 0.775 is as far again from the threshold as half of 1.
    partly = np.zeros_like(outside)
    partly[0, :6] = outside[0, :6]
    value[partly] = 0.775
    samples = replace(samples, signal=value)
    response = target_response(samples, TargetKind.BLACK, GATE)
    assert response.threshold[0] == pytest.approx(0.55)
    found = circle_fit(samples, response)
    # (0.55 − 0.1)/(0.775 − 0.1) = 2/3 of the way out instead of half.
    turn = 2.0 * np.pi * np.arange(count) / count
    radii = np.where(np.arange(count) < 3, RADIUS + half / 3.0, RADIUS)
    rows = np.stack([np.cos(turn), np.sin(turn), np.ones(count)], axis=1)
    wanted = np.linalg.lstsq(rows, radii - RADIUS, rcond=None)[0]
    np.testing.assert_allclose(found.centre[0] - CENTRE, wanted[:2], atol=0.02 * half)


def test_the_mean_of_hits_states_its_edges_and_its_uneven_cover() -> None:
    """Claim: radius √2 times the rms distance, variance Σ(x − c)²/(12 n²) over the crossings and (0.1 r)²."""
    samples, _ = spokes(np.linspace(0.8, 1.2, 14) * RADIUS, 1e-4)
    response = target_response(samples, TargetKind.BLACK, GATE)
    found = hit_centroid(samples, response)
    places = np.stack([samples.theta[0], samples.phi[0]], axis=1)
    hit = response.hit[0]
    centre, n = places[hit].mean(axis=0), int(hit.sum())
    radius = np.sqrt(2.0 * np.mean(np.sum((places[hit] - centre) ** 2, axis=1)))
    crossing = np.flatnonzero(hit[1:] != hit[:-1])
    edges = 0.5 * (places[crossing] + places[crossing + 1]) - centre
    variance = edges.T @ edges / (12.0 * n**2) + (0.1 * radius) ** 2 * np.eye(2)
    np.testing.assert_allclose(found.centre[0], centre, rtol=1e-12)
    assert found.radius[0] == pytest.approx(radius)
    np.testing.assert_allclose(found.covariance[0], variance, rtol=1e-10, atol=1e-20)
    # The part of the edges alone is small: it shows by itself.
    alone = found.covariance[0] - (0.1 * found.radius[0]) ** 2 * np.eye(2)
    np.testing.assert_allclose(alone, edges.T @ edges / (12.0 * n**2), rtol=1e-6, atol=1e-20)


def figure(number: int = 3, amplitude: float = 8e-3) -> tuple[Array, Array]:
    """Return places and travels of a pattern about the disc, shape (points, 2)."""
    pattern = LissajousPattern(amplitude=amplitude)
    shape, half = figures(pattern, number, CENTRE), 0.5 / pattern.points
    middle = (np.arange(pattern.points) + 0.5) / pattern.points
    start, place, end = (
        np.stack(figure_angles(shape, pattern.cycles, middle + shift), axis=-1)[0]
        for shift in (-half, 0.0, half)
    )
    return place, end - start


def start_at(centre: Array, radius: float) -> Centroid:
    """Return where a search begins."""
    one, yes = np.ones(1), np.ones(1, dtype=bool)
    return Centroid(centre[None], 1e-8 * np.eye(2)[None], radius * one, 1e-4 * one, one, yes)


def exact(
    spot: float, *, noise: float = 0.01, duty_cycle: float = 1.0
) -> tuple[PatternSamples, Any, Array, Array]:
    """Return a pattern over a disc with the judge's response and no noise, but a stated one."""
    place, travel = figure()
    value = judge.disc_signal(place, duty_cycle * travel, CENTRE, RADIUS, spot, (0.1, 1.0))
    samples = samples_of(place, value, noise)
    return samples, target_response(samples, TargetKind.BLACK, GATE), place, travel


@pytest.mark.parametrize("spot", [4e-4, 8e-4])
@pytest.mark.parametrize("duty_cycle", [1.0, 0.5])
def test_a_clean_disc_is_found_with_its_size(spot: float, duty_cycle: float) -> None:
    """Claim: centre and radius to 2e-3 of the spot, the rim's bend s²/2r and the travel along it taken in.

    Without the bend the radius would be off by s²/2r, 64 µrad of the wide spot.
    """
    samples, response, _, _ = exact(spot, duty_cycle=duty_cycle)
    start = start_at(CENTRE + np.array([1e-3, -8e-4]), 0.8 * RADIUS)
    found = disc_fit(samples, response, start, spot=spot, duty_cycle=duty_cycle)
    assert found.found[0]
    bend = 0.5 * spot**2 / RADIUS
    np.testing.assert_allclose(found.centre[0], CENTRE, atol=2e-3 * spot)
    assert found.radius[0] == pytest.approx(RADIUS, abs=2e-3 * spot + 0.1 * bend)


@pytest.mark.parametrize(
    ("away", "seen"), [((1.95, 0.0), True), ((2.05, 0.0), False), ((0.0, 2.05), False), ((1.0, -1.95), True)]
)
def test_a_disc_that_is_told_lies_within_two_radii_of_the_pattern(
    away: tuple[float, float], seen: bool
) -> None:
    """Claim: a fit is believed whose centre lies within two radii of some voxel's Θ and of some voxel's φ.

    Set-up: no voxel is on the disc; a broad spot at rest brings its light to them, without
    noise: Φ((r − s²/2r − ρ)/s) of it at the distance ρ.
    """
    spot, side = 0.5 * RADIUS, np.linspace(0.0, 1.0, 8)
    corner = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    way = np.sign(away)
    beside = way * (np.abs(away) + corner) + (way == 0.0) * (corner - 0.5)
    distance = RADIUS * np.hypot(*beside.T)
    light = ndtr((RADIUS - 0.5 * spot**2 / RADIUS - distance) / spot)
    samples = samples_of(CENTRE + RADIUS * beside, 1.0 - 0.9 * light, 1e-5)
    one, yes = np.ones(1), np.ones((1, 64), dtype=bool)
    levels = {"threshold": 0.55 * one, "target": 0.1 * one, "ground": one, "fraction": 0.5 * one}
    response = Response(
        samples.signal, samples.sigma_signal, yes, ~yes, **levels, clear=one > 0.0, clipped=~yes
    )
    start = start_at(CENTRE, RADIUS)
    found = disc_fit(samples, response, start, spot=spot, duty_cycle=1e-9)
    np.testing.assert_allclose(found.centre[0], CENTRE if seen else np.nan, atol=0.01 * RADIUS)
    assert found.found[0] == seen


def test_a_small_disc_in_a_wide_pattern_is_found() -> None:
    """Claim: where the pattern reaches three radii to each side the disc is found as any other."""
    place, travel = figure(amplitude=3.0 * RADIUS)
    value = judge.disc_signal(place, travel, CENTRE, RADIUS, 8e-4, (0.1, 1.0))
    samples = samples_of(place, value, 0.01)
    response = target_response(samples, TargetKind.BLACK, GATE)
    found = disc_fit(samples, response, start_at(CENTRE + 3e-4, 0.9 * RADIUS), spot=8e-4)
    assert found.found[0]
    np.testing.assert_allclose(found.centre[0], CENTRE, atol=1e-2 * 8e-4)


def test_the_way_along_the_rim_carries_the_spot_outwards() -> None:
    """Claim: a dwell's travel t along the rim counts as t²/(24 r) of distance."""
    turn = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    travel_length, spot = 1.5e-3, 2e-4
    off = RADIUS + np.tile([-1.0, -0.4, 0.0, 0.4, 1.0, 3.0, -8.0, 5.0], 8) * spot
    place = CENTRE + off[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    travel = np.stack([rise_per_point(place[None, :, axis])[0] for axis in (0, 1)], axis=1)
    duty_cycle = travel_length / float(np.median(np.hypot(*travel.T)))
    value = judge.disc_signal(place, duty_cycle * travel, CENTRE, RADIUS, spot, (0.1, 1.0))
    samples = samples_of(place, value, 0.01)
    one, yes = np.ones(1), np.ones(value.shape, dtype=bool)[None]
    levels = {"threshold": 0.55 * one, "target": 0.1 * one, "ground": one, "fraction": 0.5 * one}
    response = Response(
        samples.signal,
        samples.sigma_signal,
        yes,
        yes & (samples.signal < 0.55),
        **levels,
        clear=one > 0.0,
        clipped=~yes,
    )
    found = disc_fit(samples, response, start_at(CENTRE, RADIUS), spot=spot, duty_cycle=duty_cycle)
    shift = travel_length**2 / (24.0 * RADIUS)
    assert found.radius[0] == pytest.approx(RADIUS, abs=0.35 * shift)


def test_a_short_way_along_the_rim_counts_by_its_square_over_the_distance() -> None:
    """Claim: a travel t across the sight from the centre moves the response of a spot by t²/(24 ρ) of distance, by the
    mean of Φ((r − s²/2r − |x + u t|)/s) over it: 1 % for t of half a spot, whose next order is (t/ρ)²/40."""
    spot, reach = 4e-4, RADIUS + np.array([-3e-4, 0.0, 2e-4])
    travel = 0.5 * spot
    way = travel * (np.linspace(-0.5, 0.5, 2001)[:, None])
    edge = RADIUS - 0.5 * spot**2 / RADIUS
    mean = ndtr((edge - np.hypot(reach, way)) / spot).mean(axis=0)
    away = np.stack([reach, 0.0 * reach])[None]
    along = np.stack([0.0 * reach, travel + 0.0 * reach])[None]
    square, size, blur = (along**2).sum(axis=1), np.full((1, 1), RADIUS), np.full((1, 1), spot)
    found, rest = (
        share_on_disc(away, share * along, share * square, size, blur)[0][0] for share in (1.0, 0.0)
    )
    np.testing.assert_allclose(found - rest, mean - ndtr((edge - reach) / spot), rtol=0.01)


def test_the_stated_covariance_is_the_bound() -> None:
    """Claim: of a fit without misfit the covariance is that of the judge's information: 3 %."""
    samples, response, place, travel = exact(2e-4)
    found = disc_fit(samples, response, start_at(CENTRE, RADIUS), spot=2e-4)
    bound = judge.centre_bound(place - CENTRE, travel, RADIUS, 2e-4, (0.1, 1.0), 0.01)
    np.testing.assert_allclose(found.covariance[0], bound, rtol=0.03, atol=0.03 * bound[0, 0])


def test_noise_beyond_what_is_stated_widens_the_covariance() -> None:
    """Claim: where χ²/dof is above 1 it multiplies the covariance, which then does not depend on the σ told."""
    samples, _, _, _ = exact(2e-4)
    rough = replace(
        samples, signal=samples.signal + 0.02 * np.random.default_rng(4).normal(size=samples.signal.shape)
    )
    found = []
    for told in (2e-3, 5e-3):
        given = replace(rough, sigma_signal=np.full_like(rough.signal, told))
        response = target_response(given, TargetKind.BLACK, GATE)
        found.append(disc_fit(given, response, start_at(CENTRE, RADIUS), spot=2e-4))
    np.testing.assert_allclose(found[0].covariance, found[1].covariance, rtol=1e-6)
    assert found[0].misfit[0] == pytest.approx(6.25 * found[1].misfit[0])


def test_the_misfit_is_one_for_noise_as_stated() -> None:
    """Claim: χ² over points less five is 1 in the mean: 300 patterns, to four standard errors √(2/123/300)."""
    samples, _, _, _ = exact(2e-4)
    noise = np.random.default_rng(6).normal(size=(300, samples.signal.shape[1]))
    many = PatternSamples(
        *(np.repeat(getattr(samples, name), 300, axis=0) for name in samples.__dataclass_fields__)
    )
    many = replace(many, signal=many.signal + 0.01 * noise)
    response = target_response(many, TargetKind.BLACK, GATE)
    one, yes = np.ones(300), np.ones(300, dtype=bool)
    start = Centroid(np.tile(CENTRE, (300, 1)), np.zeros((300, 2, 2)), RADIUS * one, 1e-4 * one, one, yes)
    misfit = disc_fit(many, response, start, spot=2e-4).misfit
    assert abs(misfit.mean() - 1.0) < 4.0 * np.sqrt(2.0 / 123.0 / 300.0) + 1e-3


def test_voxels_count_by_the_inverse_of_their_variance() -> None:
    """Claim: voxels with a thousandfold σ and wrong values change nothing."""
    samples, response, _, _ = exact(2e-4)
    loose = np.arange(samples.signal.shape[1]) % 3 == 0
    wrong = replace(
        response,
        value=np.where(loose, response.value + 0.3, response.value),
        sigma=np.where(loose, 1e3 * response.sigma, response.sigma),
    )
    found = disc_fit(samples, wrong, start_at(CENTRE, RADIUS), spot=2e-4)
    alone = disc_fit(
        samples, replace(response, used=response.used & ~loose), start_at(CENTRE, RADIUS), spot=2e-4
    )
    np.testing.assert_allclose(found.centre, alone.centre, atol=5e-8)
    np.testing.assert_allclose(found.covariance, alone.covariance, rtol=1e-3)


def test_errors_of_the_angles_add_by_the_slope_of_the_response() -> None:
    """Claim: what the pointing adds is the variance of the centre when each voxel stands where it was not told.

    2000 patterns whose voxels are moved; signals without noise. The scatter is the stated one within 12 % in variance,
    four standard errors of 2000 numbers.
    """
    error = 3e-5
    samples, response, place, travel = exact(2e-4, noise=1e-5)
    rng = np.random.default_rng(7)
    moved = place + error * rng.normal(size=(2000, *place.shape))
    value = judge.disc_signal(moved, np.tile(travel, (2000, 1, 1)), CENTRE, RADIUS, 2e-4, (0.1, 1.0))
    many = PatternSamples(
        *(np.repeat(getattr(samples, name), 2000, axis=0) for name in samples.__dataclass_fields__)
    )
    many = replace(many, signal=value, sigma_signal=np.full_like(value, 0.02))
    seen = target_response(many, TargetKind.BLACK, GATE)
    one, yes = np.ones(2000), np.ones(2000, dtype=bool)
    start = Centroid(np.tile(CENTRE, (2000, 1)), np.zeros((2000, 2, 2)), RADIUS * one, 1e-4 * one, one, yes)
    scatter = disc_fit(many, seen, start, spot=2e-4).centre.var(axis=0)
    told = replace(response, sigma=np.full_like(response.sigma, 0.02))
    with_it = disc_fit(samples, told, start_at(CENTRE, RADIUS), spot=2e-4, pointing=error)
    without = disc_fit(samples, told, start_at(CENTRE, RADIUS), spot=2e-4)
    added = np.diag(with_it.covariance[0] - without.covariance[0])
    np.testing.assert_allclose(scatter / added, 1.0, atol=0.14)


def test_an_arc_of_a_clean_circle_has_its_centre() -> None:
    """Claim: the algebraic circle, at which the adjustment begins, is exact for crossings without errors."""
    samples, response = spokes(np.full(16, RADIUS), 1e-5)
    arc = replace(response, used=response.used & (np.arange(32) < 18))
    found = circle_fit(samples, arc, rounds=0)
    np.testing.assert_allclose(found.centre[0], CENTRE, rtol=0.0, atol=1e-8)
    assert found.radius[0] == pytest.approx(RADIUS, abs=1e-8)


def test_a_fit_that_knows_little_of_the_rim_comes_to_rest_at_the_least_misfit() -> None:
    """Claim: of discs whose rim has a σ thirty times as large the fits lie at a minimum of χ².

    200 patterns of 128 voxels. A fit that begins at its own result moves by less than three of the steps, 1e-3 of the
    radius, at which it comes to rest; 3 % may not have got there. With steps that are always whole a fifth has not.
    """
    samples, _, _, _ = exact(2e-4)
    rows = 200
    noise = np.random.default_rng(8).normal(size=(rows, samples.signal.shape[1]))
    partly = np.abs(samples.signal - 0.55) < 0.44
    sigma = np.where(partly, 0.3, 0.01)
    many = PatternSamples(
        *(np.repeat(getattr(samples, name), rows, axis=0) for name in samples.__dataclass_fields__)
    )
    many = replace(many, signal=many.signal + sigma * noise, sigma_signal=np.repeat(sigma, rows, axis=0))
    response = target_response(many, TargetKind.BLACK, GATE)
    one, yes = np.ones(rows), np.ones(rows, dtype=bool)
    away = CENTRE + 0.1 * RADIUS * np.array([1.0, -1.0])
    start = Centroid(np.tile(away, (rows, 1)), np.zeros((rows, 2, 2)), RADIUS * one, 1e-4 * one, one, yes)
    first = disc_fit(many, response, start, spot=2e-4)
    again = disc_fit(many, response, first, spot=2e-4)
    known = first.found & (np.sqrt(np.trace(first.covariance, axis1=1, axis2=2)) < 0.25 * RADIUS)
    moved = np.abs(again.centre - first.centre).max(axis=1)[known] / RADIUS
    assert known.mean() > 0.9
    assert (moved > 3e-3).mean() < 0.03


def test_discs_too_dark_to_be_found_are_measured_as_well_as_is_stated() -> None:
    """Claim: where the light of a disc is mostly too little for a peak, errors of the centre are those of its
    covariance, also beside the disc, where the few voxels at the rim are not opposite each other.

    Set-up: 500 patterns, their middle 0.15 of the radius off; light of the disc even from none to the least that is
    found, 4 % of the ground's and four times the noise. Expected: mean z² of 1, with bounds of χ² (1000 numbers). Dark
    voxels that are taken to have no light at all, each with the noise of the others, make it 1.41.
    """
    rows, noise, least = 500, 0.01, 0.04
    rng = np.random.default_rng(12)
    shape = LissajousPattern(points=128, amplitude=1.22 * RADIUS)
    figure, cycles = figures(shape, 0, CENTRE + 0.15 * RADIUS * np.array([0.8, 0.6])), shape.cycles
    middle, half = (np.arange(128) + 0.5) / 128, 0.25 / 128
    start, place, end = (
        np.stack(figure_angles(figure, cycles, middle + shift), axis=-1)[0] for shift in (-half, 0.0, half)
    )
    dark = judge.disc_signal(place, end - start, CENTRE, RADIUS, 1.26e-4, (1.0, 0.0))
    light = 1.0 - dark * (1.0 - rng.uniform(0.0, least, (rows, 1))) + noise * rng.standard_normal((rows, 128))
    one, peak = np.ones((rows, 1)), light > least
    many = samples_of(place, light[0])
    many = PatternSamples(*(one * getattr(many, part.name) for part in fields(many)))
    many = replace(
        many,
        signal=np.where(peak, light, 0.0),
        sigma_signal=np.where(peak, noise, least / np.sqrt(12.0)),
        status=np.where(peak, Status.VALID, Status.BELOW_THRESHOLD).astype(np.uint8),
    )
    assert 0.1 < 1.0 - peak.mean() < 0.3
    response = target_response(many, TargetKind.BLACK, GATE)
    found = disc_fit(many, response, hit_centroid(many, response), spot=1.26e-4, duty_cycle=0.5)
    assert found.found.all()
    z = np.linalg.solve(np.linalg.cholesky(found.covariance), (found.centre - CENTRE)[:, :, None])
    claim = claims.mean_square(z)
    assert claim.finds < 0.3
    assert claim


def test_a_centre_that_was_not_found_is_no_number() -> None:
    """Claim: beside one that was, which is told as it would be alone."""
    samples, _ = spokes(np.linspace(0.8, 1.2, 14) * RADIUS, 1e-4)
    both = {part.name: np.repeat(getattr(samples, part.name), 2, axis=0) for part in fields(samples)}
    dark = PatternSamples(**both)
    dark.signal[1] = dark.signal[1].min()
    response = target_response(dark, TargetKind.BLACK, GATE)
    found, alone = (
        circle_fit(dark, response),
        circle_fit(samples, target_response(samples, TargetKind.BLACK, GATE)),
    )
    assert found.found.tolist() == [True, False]
    for name in ("centre", "covariance", "radius", "sigma_radius"):
        np.testing.assert_array_equal(getattr(found, name)[0], getattr(alone, name)[0])
        assert np.isnan(getattr(found, name)[1]).all()


def test_a_centre_that_was_found_keeps_its_gains_beside_one_that_was_not() -> None:
    """Claim: the gains of a pattern without a centre are none, those of the other stay."""
    gains = np.random.default_rng(2).normal(size=(2, 2, 7))
    one, covariance = np.ones(2), np.tile(1e-8 * np.eye(2), (2, 1, 1))
    made = centroid_of(np.zeros((2, 2)), covariance, one, one, one, np.array([True, False]), gains)
    np.testing.assert_array_equal(made.gains, [gains[0], np.zeros((2, 7))])
