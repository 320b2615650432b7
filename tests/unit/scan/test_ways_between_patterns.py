"""The way of the mirrors' command from one pattern to the next: where it begins and ends, how fast, how hard."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Galvanometers
from scipy.optimize import brentq

from scanner_sim.foundation.errors import InputError
from scanner_sim.optics.galvanometer import MirrorState, at_rest
from scanner_sim.scan import schedule
from scanner_sim.scan.lissajous import LissajousPattern, figure_angles, figures
from scanner_sim.scan.schedule import _LONGEST_APPROACH, Course, Visiting, _rested, run_visits
from scanner_sim.scan.ways import (
    MOST_UPDATES,
    MirrorPair,
    _falls_behind,
    _turn,
    resume_state,
    way_between,
)

Array = NDArray[np.float64]

SERVO, STEP = Galvanometers(), 12.5e-6


def way(goal: Array, leaving: Array, arriving: Array, given: float, near: float) -> Array:
    """Return the command from (0.02, −0.01) on, with the point at its start."""
    origin = np.array([0.02, -0.01])
    path = way_between(SERVO, origin, leaving, Visiting().turnaround, goal, arriving, STEP, given, near)
    return np.concatenate([origin[:, None], path], axis=1)


@pytest.mark.parametrize("given", [0.0, 30e-3])
@pytest.mark.parametrize("goal", [[0.12, -0.2], [0.025, 0.2]])
def test_a_jump_brakes_and_speeds_up_within_the_limits(goal: list[float], given: float) -> None:
    """Claim: the command begins and ends with place and rate, and never asks for more than the share of the limits that
    jumps may: by second differences, to 1 % beside the steps in which its acceleration changes. A way takes no less
    time than was given."""
    leaving, arriving = np.array([3.0, -2.0]), np.array([-1.0, 4.0])
    path = way(np.array(goal), leaving, arriving, given, 0.0)
    np.testing.assert_allclose(path[:, -1], goal, atol=1e-9)
    rate = np.diff(path, axis=1) / STEP
    most = SERVO.jump_share * SERVO.acceleration
    np.testing.assert_allclose(rate[:, 0], leaving, atol=0.51 * most * STEP)
    np.testing.assert_allclose(rate[:, -1], arriving, atol=0.51 * most * STEP)
    bend = np.diff(rate, axis=1) / STEP
    assert np.abs(bend).max() < 1.01 * most
    # Braking takes at least half of the turnaround, or as long as the limits want.
    lasts = max(0.5 * Visiting().turnaround, 3.0 / most)
    inside = bend[:, : int(lasts / STEP) - 1]
    np.testing.assert_allclose(inside, np.tile((-leaving / lasts)[:, None], inside.shape[1]), rtol=1e-6)
    assert (path.shape[1] - 1) * STEP >= given - 1e-9


def test_a_turn_is_the_cubic_through_both_ends() -> None:
    """Claim: places and rates at both ends are those that were asked for, and the third derivative is one number."""
    origin, goal = np.array([0.02, -0.01]), np.array([0.021, -0.012])
    leaving, arriving = np.array([3.0, -2.0]), np.array([-1.0, 4.0])
    path = np.concatenate([origin[:, None], _turn(origin, leaving, goal, arriving, STEP, 40)], axis=1)
    cubic = [np.polynomial.Polynomial.fit(STEP * np.arange(41), one, 3) for one in path]
    for one, places, rates in zip(
        cubic, zip(origin, goal, strict=True), zip(leaving, arriving, strict=True), strict=True
    ):
        for at, place, rate in zip((0.0, 40 * STEP), places, rates, strict=True):
            assert one(at) == pytest.approx(place, abs=1e-12)
            assert one.deriv()(at) == pytest.approx(rate, abs=1e-7)
    np.testing.assert_allclose(np.diff(path, 4, axis=1), 0.0, atol=1e-14)


@pytest.mark.parametrize("given", [0.0, 195e-6, 206e-6, 240e-6])
def test_a_turn_takes_the_time_that_is_given(given: float) -> None:
    """Claim: between near places the way is the cubic over what was given, to the nearest update, and no less than the
    turnaround of 16 updates."""
    origin, goal = np.array([0.02, -0.01]), np.array([0.0201, -0.0101])
    leaving, arriving = np.array([0.3, -0.2]), np.array([-0.1, 0.4])
    path = way(goal, leaving, arriving, given, 0.01)[:, 1:]
    count = round(max(given, 0.2e-3) / STEP)
    np.testing.assert_allclose(path, _turn(origin, leaving, goal, arriving, STEP, count), atol=1e-15)


def test_a_way_that_brakes_and_speeds_up_is_taken_where_it_fits() -> None:
    """Claim: half an update more than the turnaround is room for a way to rest and on, in two parabolas where its
    places leave nothing between; with less the way is a cubic."""
    leaving, arriving, half = np.array([0.3, -0.2]), np.array([-0.1, 0.4]), 0.1e-3
    origin = np.array([0.02, -0.01])
    goal = origin + 0.5 * half * (leaving + arriving)
    longer = way(goal, leaving, arriving, 0.2e-3 + 0.7 * STEP, 0.01)
    # A whole number of updates: 17, 8 of braking, one at rest, 8 of speeding up.
    assert longer.shape[1] == 18
    rest = (origin + 0.5 * half * leaving)[:, None]
    np.testing.assert_allclose(longer[:, 8:10], np.tile(rest, 2), atol=1e-15)
    shorter = way(goal, leaving, arriving, 0.2e-3 + 0.4 * STEP, 0.01)[:, 1:]
    np.testing.assert_allclose(shorter, _turn(origin, leaving, goal, arriving, STEP, 16), atol=1e-15)


@pytest.mark.parametrize("rates", [(0.0, 0.0), (-1.5, -0.5)])
def test_a_turn_that_would_fall_behind_is_as_long_as_its_limits_want(rates: tuple[float, float]) -> None:
    """Claim: where a shorter one would leave the mirrors behind, the cubic's largest acceleration is just their limit:
    (6D/T − 4v − 2w)/T at its beginning, if the rates lead away."""
    distance, (leaving, arriving) = 0.03, rates
    goal = np.array([0.02, -0.01 + distance])
    path = way(goal, np.array([0.0, leaving]), np.array([0.0, arriving]), 0.0, 0.1)
    most, count = SERVO.jump_share * SERVO.acceleration, path.shape[1] - 1

    def first(lasts: float) -> float:
        return (6.0 * distance / lasts - 4.0 * leaving - 2.0 * arriving) / lasts

    assert count == round(brentq(lambda lasts: first(lasts) - most, 1e-4, 1.0) / STEP)
    bend = np.diff(path[1], 2) / STEP**2
    # The first second difference stands an update behind the beginning, and updates are whole.
    assert bend.max() == pytest.approx(most * (1.0 - 2.0 / count), rel=1.5 / count)


def test_mirrors_fall_behind_by_the_speed_that_they_lack() -> None:
    """Claim: what of a cubic's acceleration lies beyond the limit adds up to a speed; from two lags' worth of the limit
    on it is too much. A cubic from rest to rest over D asks for 6D/T² (1 − 2s), beyond a by (6D/T² − a)²/(24 D/T²) of
    its duration on either side."""
    lasts, most = 2e-3, SERVO.acceleration
    enough = 2.0 * SERVO.lag * most

    def lacks(distance: float) -> float:
        first = 6.0 * distance / lasts**2
        return lasts * (first - most) ** 2 / (4.0 * first)

    distance = brentq(lambda d: lacks(d) - enough, most * lasts**2 / 6.0, 100.0 * most * lasts**2)
    rest = np.zeros(2)
    # Sixteen instants stand for all.
    for share, behind in ((0.97, False), (1.03, True)):
        for way_ahead in ([share * distance, 0.0], [0.0, -share * distance]):
            assert _falls_behind(SERVO, np.array(way_ahead), rest, rest, lasts) is behind


@pytest.mark.parametrize("turned", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_turn_between_two_rates_asks_for_its_second_derivative(turned: float, axis: int) -> None:
    """Claim: speed that a mirror lacks is what the acceleration of the cubic through both places and rates has beyond
    the limit, one way or the other, by its second differences; at the limit the verdict changes, within 3 %."""
    lasts, most, steps = 2e-3, SERVO.acceleration, 20_000
    enough, both = 2.0 * SERVO.lag * most, np.zeros((3, 2))

    def lacks(scale: float) -> float:
        distance, leaving, arriving = scale * turned * np.array([0.3 * lasts, -1.0, 2.0])
        ends = (np.array([value]) for value in (0.0, leaving, distance, arriving))
        bend = np.diff(_turn(*ends, lasts / steps, steps)[0], 2) / (lasts / steps) ** 2
        return float(max(np.maximum(way * bend - most, 0.0).sum() * lasts / steps for way in (1.0, -1.0)))

    limit = brentq(lambda scale: lacks(scale) - enough, 1e-3 * enough, 1e3 * enough, rtol=1e-4)
    for share in (0.97, 1.03):
        both[:, axis] = share * limit * turned * np.array([0.3 * lasts, -1.0, 2.0])
        assert _falls_behind(SERVO, *both, lasts) is (share > 1.0)


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_without_time_a_step_is_too_far_where_its_speed_is(share: float) -> None:
    """Claim: a step of the angle D ends in √(2a|D|), a step of the rate in itself."""
    most, rest = SERVO.acceleration, np.zeros(2)
    enough = 2.0 * SERVO.lag * most
    angle = np.array([0.0, share * enough**2 / (2.0 * most)])
    for way in (1.0, -1.0):
        assert _falls_behind(SERVO, way * angle, rest, rest, 0.0) is (share > 1.0)
    assert _falls_behind(SERVO, rest, rest, np.array([share * enough, 0.0]), 0.0) is (share > 1.0)


def test_only_a_mirror_that_was_kept_back_begins_anew() -> None:
    """Claim: of two mirrors the one that is not where its command was goes on from the ramp u = x + (2ζ/ω) x′ that it
    follows by itself, at its own rate; the other goes on as it was told."""
    angle, rate = np.array([0.1, -0.05]), np.array([2.0, 1.0])
    ramp = angle + 2.0 * SERVO.damping / SERVO.omega * rate
    enough = SERVO.acceleration / SERVO.omega**2
    for off, anew in ((0.97, False), (1.03, True)):
        command = ramp + np.array([off * enough, 0.0])
        slope = np.array([2.0, 1.0]) + 1e-3
        state, found = resume_state(SERVO, MirrorPair(MirrorState(angle, rate, command), slope))
        np.testing.assert_allclose(state.command, [ramp[0] if anew else command[0], command[1]])
        np.testing.assert_allclose(found, [rate[0] if anew else slope[0], slope[1]])
        np.testing.assert_array_equal(state.angle, angle)


def test_a_way_ends_no_faster_than_the_mirrors_go() -> None:
    """Claim: towards a pattern that begins at twice the share of the slew that jumps may have, the command arrives with
    that share."""
    fastest = SERVO.jump_share * SERVO.slew
    arriving = np.array([2.0 * fastest, -0.5 * fastest])
    path = way(np.array([0.12, -0.2]), np.zeros(2), arriving, 0.0, 0.0)
    rate = (path[:, -1] - path[:, -2]) / STEP
    most = SERVO.jump_share * SERVO.acceleration
    np.testing.assert_allclose(rate, [fastest, -0.5 * fastest], atol=1.01 * most * STEP)
    with pytest.raises(InputError, match="updates of the drive's command"):
        way(np.array([0.12, -0.2]), np.zeros(2), np.zeros(2), 1.01 * MOST_UPDATES * STEP, 0.0)


@pytest.mark.parametrize("longer", [0.0, 0.5])
def test_mirrors_that_wait_long_are_at_rest_where_they_were(longer: float) -> None:
    """Claim: up to ten seconds before a start mirrors go on as they are; beyond, they have come to rest at their
    angles, and the way begins ten seconds before the start."""
    state = MirrorState(np.array([0.02, -0.01]), np.array([0.3, 0.5]), np.array([0.021, -0.012]))
    mirrors = MirrorPair(state, np.array([0.4, -0.6]), 3.0)
    start = 3.0 + _LONGEST_APPROACH + longer
    found = _rested(mirrors, start)
    if not longer:
        assert found is mirrors
        return
    assert found.time == start - _LONGEST_APPROACH
    assert not found.slope.any()
    np.testing.assert_array_equal(found.state, [state[0], np.zeros(2), state[0]])


def test_a_way_leads_to_the_figure_as_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of two visits side by side each way is asked to end at its figure's start, at the rate that the figure has
    there, by differences; a goal is near within the figure's whole width. The mirrors are left at the figure's last
    rate."""
    pattern, dwell, visiting = LissajousPattern(points=127), 50e-6, Visiting()
    centre, amplitude = np.array([[0.02, -0.01], [0.1, 0.05]]), np.array([4e-3, 6e-3])
    number, start = np.array([1, 2]), np.array([0.5, 0.6])
    resting = [MirrorPair(at_rest(place), np.zeros(2), 0.45) for place in centre]
    asked: list[Any] = []

    def spy(*given: Any) -> Array:
        asked.append(given)
        return way_between(*given)

    monkeypatch.setattr(schedule, "way_between", spy)
    course = Course(number, centre, amplitude, start)
    _, after = run_visits(SERVO, resting, pattern, course, dwell=dwell, visiting=visiting)
    figure = figures(pattern, number, centre, amplitude)
    small, whole = 1e-6, pattern.points * dwell
    at = {
        share: figure_angles(figure, pattern.cycles, np.array([share - small, share, share + small]))
        for share in (0.0, 1.0)
    }
    for row, (_, origin, _, turnaround, goal, arriving, step, given, near) in enumerate(asked):
        angles = {share: np.array([axis[row] for axis in values]) for share, values in at.items()}
        rates = {share: (one[:, 2] - one[:, 0]) / (2.0 * small * whole) for share, one in angles.items()}
        np.testing.assert_allclose(goal, angles[0.0][:, 1], atol=1e-12)
        np.testing.assert_allclose(arriving, rates[0.0], rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(after[row].slope, rates[1.0], rtol=1e-5, atol=1e-6)
        np.testing.assert_array_equal(origin, centre[row])
        assert (turnaround, step) == (visiting.turnaround, dwell / visiting.updates)
        assert (given, near) == pytest.approx((start[row] - 0.45, 2.0 * amplitude[row]))
    assert len(asked) == 2


def test_points_are_read_in_the_middle_of_their_dwells(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of seven updates of a way and four of each of five points the second of a point ends in the middle of its
    dwell, where all angles are read; the travel is the rate times the dwell. A mirror that meets its limits counts
    once it has had ten lags to catch up, here seven updates."""
    random, shape = np.random.default_rng(3), (2, 2, 27)
    commanded, true, seen, rate = random.normal(size=(4, *shape))
    dwell = 8e-5
    servos: Any = SimpleNamespace(lag=0.63 * dwell / 4.0, readout_delay=3e-6)
    asked: list[Any] = []
    monkeypatch.setattr(schedule, "latch", lambda *given: asked.append(given[2:]) or seen)
    for late, limited in ((13, False), (14, True)):
        at_limit = np.zeros(shape, dtype=bool)
        at_limit[1, 0, late] = True
        motion = SimpleNamespace(commanded=commanded, true=true, rate=rate, limited=at_limit)
        monkeypatch.setattr(schedule, "follow", lambda *given, motion=motion: (motion, "after"))
        nothing: Any = None
        made, after = schedule._follow(
            servos, nothing, np.zeros(shape), np.array([3.0, 4.0]), 5, dwell, Visiting(updates=4)
        )
        assert after == "after"
        assert asked.pop() == (dwell / 4.0, 3e-6)
        ends = 7.0 / 4.0 + np.arange(5) + 0.5
        np.testing.assert_allclose(made.time, [[3.0], [4.0]] + dwell * ends)
        place = np.array([8, 12, 16, 20, 24])
        for values, theta, phi in (
            (commanded, made.commanded_theta, made.commanded_phi), (true, made.true_theta, made.true_phi),
            (seen, made.latched_theta, made.latched_phi), (dwell * rate, made.travel_theta, made.travel_phi),
        ):  # fmt: skip
            np.testing.assert_array_equal(theta, values[:, 0, place])
            np.testing.assert_array_equal(phi, values[:, 1, place])
        assert made.limited.tolist() == [False, limited]
