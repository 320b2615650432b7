"""The tracker's filter and its states by hand: exact forms of prediction and update, gates, counts and patterns."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim.tracking.measurement import Measurement
from scanner_sim.tracking.prediction import Motion, initiate, predict, update
from scanner_sim.tracking.state import (
    Refusal,
    TrackerSettings,
    TrackMode,
    TrackState,
    advance,
    command,
    init,
    pointed,
)

Array = NDArray[np.float64]

DIAMETER, DISTANCE = 0.1, 8.0
RADIUS = 0.5 * DIAMETER / DISTANCE
EXPECTED = np.array([0.1, -0.05, DISTANCE])
UNREST = np.array([1e-4, 3e-4, 2e-2])
PERIOD = 0.04


def motion() -> Motion:
    """Return a motion whose numbers are all different, at 1.5 s."""
    mixed = np.random.default_rng(1).normal(size=(6, 6))
    scale = np.array([1e-4, 2e-4, 3e-3, 4e-3, 5e-3, 6e-2])
    mean = np.array([0.1, -0.05, 8.0, 0.02, -0.01, 0.3])
    return Motion(mean, (mixed @ mixed.T + np.eye(6)) * np.outer(scale, scale), np.float64(1.5))


def measured(place: Array | None, time: float, **changes: Any) -> Measurement:
    """Return a round target that is seen at a place, or nothing."""
    found = place is not None
    numbers: dict[str, Any] = {
        "time": np.array([time if found else np.nan]),
        "position": np.full((1, 3), np.nan) if place is None else place[None],
        "covariance": np.diag([20e-6, 30e-6, 1e-3])[None] ** 2,
        "radius": np.array([RADIUS]),
        "sigma_radius": np.array([1e-9]),
        "misfit": np.ones(1),
        "fraction": np.full(1, 0.3),
        "found": np.array([found]),
    }
    return Measurement(**numbers | changes)


def visited(state: TrackState, place: Array | None, settings: TrackerSettings, **changes: Any) -> TrackState:
    """Return the state after one more visit, a period after the last."""
    time = PERIOD * (state.patterns + 1)
    return advance(state, measured(place, time, **changes), settings, DIAMETER, time + PERIOD)


def tracked(settings: TrackerSettings) -> TrackState:
    """Return the state of a target that is followed where it was expected."""
    state = init(EXPECTED, settings)
    for _ in range(3):
        state = visited(state, EXPECTED, settings)
    assert state.mode is TrackMode.TRACK
    return state


def test_two_half_steps_are_one() -> None:
    """Claim: mean and covariance ahead do not depend on how many steps lead there: exact for Δ³/3, Δ²/2, Δ alone."""
    whole = predict(motion(), 1.7, UNREST)
    halves = predict(predict(motion(), 1.6, UNREST), 1.7, UNREST)
    np.testing.assert_allclose(halves.mean, whole.mean, rtol=1e-12)
    np.testing.assert_allclose(halves.covariance, whole.covariance, rtol=1e-10)


def test_a_target_without_doubt_scatters_as_white_accelerations_make_it() -> None:
    """Claim: of a target known exactly, place and rate have the covariance q [[Δ³/3, Δ²/2], [Δ²/2, Δ]] after Δ."""
    exact = Motion(motion().mean, np.zeros((6, 6)), motion().time)
    ahead, step = predict(exact, 1.9, UNREST), 0.4
    np.testing.assert_allclose(ahead.mean[:3], exact.mean[:3] + step * exact.mean[3:], rtol=1e-14)
    for axis, q in enumerate(UNREST):
        part = ahead.covariance[np.ix_([axis, axis + 3], [axis, axis + 3])]
        wanted = q * np.array([[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]])
        np.testing.assert_allclose(part, wanted, rtol=1e-12)


def test_an_update_adds_information() -> None:
    """Claim: the update is the inverse of the sum of informations, and the mean that of both weighed by them."""
    before, noise = motion(), np.array([[4.0, 1.0, 0.5], [1.0, 9.0, -2.0], [0.5, -2.0, 5.0]]) * 1e-8
    place = before.mean[:3] + np.array([1e-4, -2e-4, 1e-3])
    after, surprise = update(before, place, noise)
    seen = np.eye(3, 6)
    known, told = np.linalg.inv(before.covariance), seen.T @ np.linalg.inv(noise) @ seen
    whole = np.linalg.inv(known + told)
    np.testing.assert_allclose(after.covariance, whole, rtol=1e-6, atol=1e-16)
    mean = whole @ (known @ before.mean + seen.T @ np.linalg.inv(noise) @ place)
    np.testing.assert_allclose(after.mean, mean, rtol=1e-9)
    away = place - before.mean[:3]
    spread = before.covariance[:3, :3] + noise
    assert surprise == pytest.approx(away @ np.linalg.inv(spread) @ away)


def test_a_motion_begins_with_the_rates_it_is_told() -> None:
    covariance = np.diag([1e-8, 4e-8, 9e-6])
    start = initiate(EXPECTED, covariance, [0.1, 0.2, 0.3], 2.0)
    np.testing.assert_array_equal(start.mean, [*EXPECTED, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(np.diag(start.covariance), [1e-8, 4e-8, 9e-6, 0.01, 0.04, 0.09])


@pytest.mark.parametrize("chance", [1e-4, 1e-2])
def test_the_gate_refuses_right_measurements_with_its_chance(chance: float) -> None:
    """Claim: a place is refused where its squared distance from the prediction passes the χ² of three dimensions."""
    settings = TrackerSettings(chance=chance)
    state = tracked(settings)
    time = PERIOD * (state.patterns + 1)
    acceleration_psd = [settings.acceleration_psd, settings.acceleration_psd, settings.range_acceleration_psd]
    ahead = predict(state.motion, time, acceleration_psd)
    seen = measured(EXPECTED, time)
    spread = ahead.covariance[:3, :3] + seen.covariance[0]
    # One standard deviation of all three axes together.
    way = np.linalg.cholesky(spread) @ np.full(3, 3.0**-0.5)
    for share, refusal in ((0.999, Refusal.NONE), (1.001, Refusal.PLACE)):
        place = ahead.mean[:3] + share * np.sqrt(chi2.isf(chance, 3)) * way
        radius = np.array([0.5 * DIAMETER / place[2]])
        after = advance(state, replace(seen, position=place[None], radius=radius), settings, DIAMETER, time)
        assert after.refusal is refusal
        if refusal is Refusal.NONE:
            wanted, _ = update(ahead, place, seen.covariance[0])
            np.testing.assert_allclose(after.motion.covariance, wanted.covariance, rtol=1e-12)


def test_states_change_after_the_stated_patterns() -> None:
    """Claim: seen thrice a target is tracked, missed four times lost, and five more times searched for anew."""
    settings = TrackerSettings(acquire_patterns=3, patience=4, give_up=5)
    state, modes = init(EXPECTED, settings), []
    for _ in range(3):
        state = visited(state, EXPECTED, settings)
        modes.append(state.mode)
    assert modes == [TrackMode.ACQUIRE, TrackMode.ACQUIRE, TrackMode.TRACK]
    modes = []
    for _ in range(9):
        state = visited(state, None, settings)
        modes.append(state.mode)
    assert modes == [TrackMode.TRACK] * 3 + [TrackMode.LOST] * 5 + [TrackMode.SEARCH]
    assert state.patterns == 12
    assert state.refusal is Refusal.NOT_SEEN
    state = visited(init(EXPECTED, settings), EXPECTED, settings)
    assert visited(state, None, settings).mode is TrackMode.LOST


def test_a_target_given_up_is_searched_where_it_goes_as_long_as_that_is_known() -> None:
    """Claim: the search after a loss begins with the filter's prediction, rates and covariance, and stays where that
    led once its three standard deviations are beyond the largest search pattern.

    Set-up: a target that moved by 5 mrad/s and is given up at once; quiet: its accelerations are small enough for the
    prediction to be good for seconds. Expected: steady motion, and σ² = σ₀² + σ_v² t² + q t³/3 of a plain integration.
    """
    settings = TrackerSettings(patience=1, give_up=1, acceleration_psd=1e-6)
    state = tracked(settings)
    mean, covariance = state.motion.mean.copy(), np.diag([1e-5, 1e-5, 1e-3, 1e-4, 1e-4, 1e-3]) ** 2
    mean[3] = 5e-3
    state = replace(state, motion=Motion(mean, covariance, np.float64(0.0)))
    for time in (0.1, 0.2):
        state = advance(state, measured(None, time), settings, DIAMETER, time)
    assert state.mode is TrackMode.SEARCH

    def doubt(time: float) -> float:
        return 3.0 * float(np.sqrt(1e-10 + 1e-8 * time**2 + 1e-6 * time**3 / 3.0))

    assert doubt(4.0) < settings.search_most < doubt(8.0)
    soon, late = (command(state, settings, DIAMETER, time).position[0] - mean[0] for time in (4.0, 8.0))
    assert soon == pytest.approx(5e-3 * 4.0)
    assert late == pytest.approx(5e-3 * 0.2)


@pytest.mark.parametrize(
    ("off", "sigma", "refusal"),
    [
        (0.14, 0.0, Refusal.NONE),
        (-0.14, 0.0, Refusal.NONE),
        (0.16, 0.0, Refusal.SIZE),
        (-0.16, 0.0, Refusal.SIZE),
        (0.20, 0.02, Refusal.NONE),
        (0.22, 0.02, Refusal.SIZE),
        (0.51, 0.3, Refusal.SIZE),
        (0.49, 0.3, Refusal.NONE),
    ],
)
def test_a_target_has_its_size(off: float, sigma: float, refusal: Refusal) -> None:
    """Claim: the radius may differ by 15 % and three of its own standard deviations, and by half at most."""
    settings = TrackerSettings()
    sizes = {"radius": np.array([(1.0 + off) * RADIUS]), "sigma_radius": np.array([sigma * RADIUS])}
    assert visited(tracked(settings), EXPECTED, settings, **sizes).refusal is refusal


@pytest.mark.parametrize(
    ("misfit", "refusal"), [(29.0, Refusal.NONE), (31.0, Refusal.SHAPE), (np.nan, Refusal.SHAPE)]
)
def test_a_target_has_its_shape(misfit: float, refusal: Refusal) -> None:
    settings = TrackerSettings()
    assert visited(tracked(settings), EXPECTED, settings, misfit=np.array([misfit])).refusal is refusal


@pytest.mark.parametrize(("share", "refusal"), [(0.24, Refusal.NONE), (0.26, Refusal.SHAPE)])
def test_a_sighting_knows_its_place_to_a_quarter_of_the_radius(share: float, refusal: Refusal) -> None:
    covariance = np.diag(np.array([1.0, 1.0, 1e-6]) * 0.5 * (share * RADIUS) ** 2)[None]
    settings = TrackerSettings()
    assert visited(init(EXPECTED, settings), EXPECTED, settings, covariance=covariance).refusal is refusal


def test_a_tracking_pattern_is_a_little_larger_than_its_target() -> None:
    settings = TrackerSettings()
    order = command(tracked(settings), settings, DIAMETER, 1.0)
    assert order.mode is TrackMode.TRACK
    assert order.amplitude == pytest.approx(1.22 * RADIUS, rel=1e-6)
    assert order.number == 3


def test_search_patterns_grow_begin_anew_and_go_to_both_places() -> None:
    """Claim: 1.6 radii, each 1.4 times the last, up to 20 mrad; then anew, in turns where it was last and expected."""
    settings = TrackerSettings()
    first = 1.6 * RADIUS
    sizes = [min(first * 1.4**k, 20e-3) for k in range(4)]
    assert first * 1.4**3 > 20e-3 > first * 1.4**2
    elsewhere = EXPECTED + np.array([0.05, 0.02, 0.0])
    lost = initiate(elsewhere, np.eye(3), np.ones(3), 0.0)
    state = replace(init(EXPECTED, settings), motion=lost)
    orders = [command(replace(state, searched=k), settings, DIAMETER, 1.0) for k in range(12)]
    np.testing.assert_allclose([order.amplitude for order in orders], 3 * sizes, rtol=1e-12)
    places = np.array([order.position for order in orders])
    np.testing.assert_array_equal(places, np.repeat([elsewhere, EXPECTED, elsewhere], 4, axis=0))


def test_a_search_does_not_take_a_followed_target() -> None:
    """Claim: in a search, what lies within a third of a radius of another target (4.6 σ) is that one."""
    settings = TrackerSettings()
    other = tracked(settings).motion
    other = other._replace(covariance=1e-18 * np.eye(6), time=np.float64(PERIOD))
    limit = np.sqrt(chi2.isf(settings.chance, 3)) / 3.0
    for share, refusal in ((0.97, Refusal.OTHER), (1.03, Refusal.NONE)):
        place = EXPECTED + np.array([share * limit * RADIUS, 0.0, 0.0])
        tight = {"covariance": 1e-18 * np.eye(3)[None]}
        settings_at_rest = settings.model_copy(
            update={"acceleration_psd": 0.0, "range_acceleration_psd": 0.0}
        )
        seen = measured(place, PERIOD, **tight)
        after = advance(init(EXPECTED, settings), seen, settings_at_rest, DIAMETER, 1.0, others=[other])
        assert after.refusal is refusal


TOLD = np.array([0.2, -0.1, -0.6])
"""Rates that somebody tells [rad/s, m/s]."""


def told(settings: TrackerSettings, size: int) -> tuple[TrackState, Array]:
    """Return the state of a target that is told with its rates at 0 s, and the covariance that it has then."""
    mixed = np.random.default_rng(7).normal(size=(6, 6))
    scale = np.array([2e-3, 3e-3, 0.05, 2e-3, 1e-3, 0.05])
    whole = (mixed @ mixed.T / 6.0 + np.eye(6)) * np.outer(scale, scale)
    if size == 3:
        whole[:3, 3:] = whole[3:, :3] = 0.0
        whole[3:, 3:] = np.diag([settings.fastest, settings.fastest, settings.fastest_range]) ** 2
    return pointed(EXPECTED, settings, 0.0, TOLD, whole[:size, :size]), whole


def along(time: float) -> Array:
    """Return where a target is that moves as told."""
    return EXPECTED + time * TOLD


def found(state: TrackState, place: Array, time: float, settings: TrackerSettings) -> TrackState:
    """Return the state after a target of the right size was seen at a place."""
    radius = np.array([0.5 * DIAMETER / place[2]])
    return advance(state, measured(place, time, radius=radius), settings, DIAMETER, time + PERIOD)


@pytest.mark.parametrize("size", [3, 6])
def test_told_rates_go_on_once_the_target_is_found(size: int) -> None:
    """Claim: a target that moves as told and is found so is expected exactly where it goes, and what is known of it is
    the sum of what was told, carried to that time, and of the measurement: rates without a covariance are as unsure as
    those of a target that is seen for the first time."""
    settings = TrackerSettings()
    state, whole = told(settings, size)
    unrest = [settings.acceleration_psd, settings.acceleration_psd, settings.range_acceleration_psd]
    state = advance(state, measured(None, 0.1), settings, DIAMETER, 0.2)
    after = found(state, along(0.2), 0.2, settings)
    assert after.mode is TrackMode.ACQUIRE
    np.testing.assert_allclose(after.motion.mean[3:], TOLD, rtol=1e-9)
    np.testing.assert_allclose(command(after, settings, DIAMETER, 0.6).position, along(0.6), rtol=1e-12)
    ahead = predict(Motion(np.concatenate([EXPECTED, TOLD]), whole, np.float64(0.0)), 0.2, unrest)
    seen = np.eye(3, 6)
    noise = np.diag([20e-6, 30e-6, 1e-3]) ** 2
    wanted = np.linalg.inv(np.linalg.inv(ahead.covariance) + seen.T @ np.linalg.inv(noise) @ seen)
    np.testing.assert_allclose(after.motion.covariance, wanted, rtol=1e-6, atol=1e-15)


def test_a_told_motion_counts_where_the_place_agrees_with_it() -> None:
    """Claim: found beyond the gate of what was told, a target begins anew with a rate of zero, and is not refused."""
    settings = TrackerSettings()
    state, whole = told(settings, 6)
    spread = whole[:3, :3] + np.diag([20e-6, 30e-6, 1e-3]) ** 2
    way = np.linalg.cholesky(spread) @ np.full(3, 3.0**-0.5)
    for share, kept in ((0.999, True), (1.001, False)):
        place = EXPECTED + share * np.sqrt(chi2.isf(settings.chance, 3)) * way
        after = found(state, place, 0.0, settings)
        assert after.mode is TrackMode.ACQUIRE
        assert after.refusal is Refusal.NONE
        if kept:
            assert np.linalg.norm(after.motion.mean[3:]) > 0.1
        else:
            np.testing.assert_array_equal(after.motion.mean, [*place, 0.0, 0.0, 0.0])
            np.testing.assert_allclose(np.diag(after.motion.covariance)[3:], [0.0025, 0.0025, 0.04])


def test_told_rates_last_until_the_target_is_tracked() -> None:
    """Claim: missed once after its first sighting a target is found again with its told rates; lost after it was
    tracked it begins anew, and so does one that was told without rates."""
    settings = TrackerSettings(patience=1)
    state, whole = told(settings, 6)
    state = found(state, along(0.1), 0.1, settings)
    state = advance(state, measured(None, 0.2), settings, DIAMETER, 0.3)
    assert state.mode is TrackMode.LOST
    state = found(state, along(0.3), 0.3, settings)
    np.testing.assert_allclose(state.motion.mean[3:], TOLD, rtol=1e-9)
    state = found(state, along(0.4), 0.4, settings)
    assert state.mode is TrackMode.TRACK
    state = advance(state, measured(None, 0.5), settings, DIAMETER, 0.6)
    assert state.mode is TrackMode.LOST
    np.testing.assert_array_equal(found(state, along(0.6), 0.6, settings).motion.mean[3:], 0.0)
    unsaid = pointed(EXPECTED, settings, 0.0, covariance=whole[:3, :3])
    np.testing.assert_array_equal(found(unsaid, along(0.02), 0.1, settings).motion.mean[3:], 0.0)


def test_a_told_target_is_not_taken_for_one_that_is_followed() -> None:
    """Claim: in a search with told rates, too, what is another target already is not taken."""
    settings = TrackerSettings()
    other = tracked(settings).motion._replace(covariance=1e-18 * np.eye(6), time=np.float64(0.0))
    state, _ = told(settings, 6)
    seen = measured(EXPECTED, 0.0)
    after = advance(state, seen, settings, DIAMETER, PERIOD, others=[other])
    assert after.refusal is Refusal.OTHER
    assert after.told


@pytest.mark.parametrize("changes", [{"search_amplitude": 1.05}, {"search_most": 0.6 * RADIUS}])
def test_no_search_pattern_is_smaller_than_one_that_tracks(changes: dict[str, float]) -> None:
    """Claim: a first pattern of 1.05 radii, or the largest of 0.6, is one of 1.22, at which a target is seen at all."""
    settings = TrackerSettings(**changes)
    order = command(init(EXPECTED, settings), settings, DIAMETER, 0.0)
    assert order.amplitude == pytest.approx(1.22 * RADIUS, rel=1e-9)


def test_a_motion_is_no_surer_before_its_time_than_after_it() -> None:
    """Claim: to 0.3 s before a motion's time it goes back along its rates, and white acceleration makes it as unsure
    as it makes it as long afterwards: its rates by q Δ, its places by q Δ³/3 besides what the rates' σ does."""
    start = motion()
    back = predict(start, 1.2, UNREST)
    np.testing.assert_allclose(back.mean[:3], start.mean[:3] - 0.3 * start.mean[3:], rtol=1e-12)
    onward = np.eye(6)
    onward[:3, 3:] = -0.3 * np.eye(3)
    more = back.covariance - onward @ start.covariance @ onward.T
    np.testing.assert_allclose(np.diag(more), [*(UNREST * 0.027 / 3.0), *(UNREST * 0.3)], rtol=1e-6)


@pytest.mark.parametrize("distance", [2e-3, 0.0, -3.0, -1e16])
@pytest.mark.parametrize("mode", list(TrackMode))
def test_a_target_that_has_gone_by_is_looked_for_with_a_pattern(mode: TrackMode, distance: float) -> None:
    """Claim: where the prediction leads behind the scanner, or nearer than the target's radius, the pattern is that of
    a target at its radius: a radian, and no number that the mirrors cannot be told."""
    settings = TrackerSettings()
    there = initiate([0.1, -0.05, distance], np.eye(3) * 1e-10, [1e-5] * 3, 1.0)
    order = command(TrackState(mode, there, EXPECTED), settings, DIAMETER, 1.0)
    np.testing.assert_array_equal(order.position, [0.1, -0.05, 0.5 * DIAMETER])
    assert order.amplitude == settings.track_amplitude


def test_a_target_near_its_radius_is_taken_where_it_is() -> None:
    there = initiate([0.1, -0.05, 0.51 * DIAMETER], np.eye(3) * 1e-10, [1e-5] * 3, 1.0)
    order = command(TrackState(TrackMode.TRACK, there, EXPECTED), TrackerSettings(), DIAMETER, 1.0)
    assert order.position[2] == 0.51 * DIAMETER
