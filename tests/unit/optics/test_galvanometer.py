"""Mirrors that follow their commands: lag, limits, state, jumps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Galvanometers
from scipy.integrate import solve_ivp

from scanner_sim.optics.galvanometer import at_rest, follow, latch, response
from scanner_sim.optics.jump import (
    attainable_amplitude,
    attainable_frequency,
    jump_duration,
    jump_path,
    jump_time,
    latest_settling,
)

SERVO = Galvanometers()
STEP = 12.5e-6


def sine(frequency: float, amplitude: float, updates: int) -> NDArray[np.float64]:
    return amplitude * np.sin(2.0 * np.pi * frequency * STEP * np.arange(1, updates + 1))


def test_the_motion_is_the_solution_of_the_equation() -> None:
    """Against a Runge–Kutta solver of x″ = ω²(u − x) − 2ζω x′ on the same straight pieces; 1e-9 of the amplitude."""
    u = np.random.default_rng(1).normal(0.0, 1e-3, 120).cumsum() * 1e-2
    motion, after = follow(SERVO, at_rest(0.0), u, STEP)
    assert not motion.limited.any()
    knots, values = STEP * np.arange(121), np.concatenate([[0.0], u])

    def slope(t: float, y: NDArray[np.float64]) -> list[float]:
        pull = SERVO.omega**2 * (np.interp(t, knots, values) - y[0])
        return [y[1], float(pull - 2.0 * SERVO.damping * SERVO.omega * y[1])]

    solved = solve_ivp(
        slope, (0.0, knots[-1]), [0.0, 0.0], t_eval=knots[1:], rtol=1e-10, atol=1e-15, max_step=STEP
    )
    scale = np.abs(u).max()
    np.testing.assert_allclose(motion.true, solved.y[0], atol=1e-6 * scale)
    np.testing.assert_allclose(motion.rate, solved.y[1], atol=1e-6 * scale * SERVO.omega)
    assert after.angle == motion.true[-1]
    assert after.command == u[-1]


@pytest.mark.parametrize("frequency", [303.0, 455.0, 2000.0])
def test_a_sine_comes_out_with_the_gain_and_lag_of_the_transfer_function(frequency: float) -> None:
    """Fitted after the transient; 3e-3 for the sampled command's straight pieces, whose gain is sinc²(f step)."""
    updates = 4000
    motion, _ = follow(SERVO, at_rest(0.0), sine(frequency, 1e-4, updates), STEP)
    t = STEP * np.arange(1, updates + 1)
    late = t > 5e-3
    design = np.stack([np.sin(2 * np.pi * frequency * t), np.cos(2 * np.pi * frequency * t)], axis=1)[late]
    a, b = np.linalg.lstsq(design, motion.true[late] / 1e-4, rcond=None)[0]
    assert complex(a, b) == pytest.approx(complex(response(SERVO, frequency)), abs=3e-3)


def test_the_default_lag_is_64_microseconds() -> None:
    """A slow ramp is followed 2ζ/ω late."""
    assert SERVO.lag == pytest.approx(64e-6, rel=0.01)
    motion, _ = follow(SERVO, at_rest(0.0), 1.0 * STEP * np.arange(1, 400), STEP)
    assert motion.commanded[-1] - motion.true[-1] == pytest.approx(SERVO.lag, rel=1e-6)


@pytest.mark.parametrize("amplitude", [5e-3, 60e-3])
def test_two_halves_are_the_whole(amplitude: float) -> None:
    """State carried over: also where the limits hold."""
    u = sine(455.0, amplitude, 300)
    whole, end = follow(SERVO, at_rest(0.0), u, STEP)
    first, between = follow(SERVO, at_rest(0.0), u[:131], STEP)
    second, last = follow(SERVO, between, u[131:], STEP)
    np.testing.assert_allclose(np.concatenate([first.true, second.true]), whole.true, atol=1e-12)
    np.testing.assert_allclose(np.array(last), np.array(end), atol=1e-9)


def test_limits_hold() -> None:
    u = sine(455.0, 200e-3, 800)
    motion, _ = follow(SERVO, at_rest(0.0), u, STEP)
    assert motion.limited.any()
    assert np.abs(motion.rate).max() <= SERVO.slew * (1.0 + 1e-12)
    assert np.abs(np.diff(motion.rate)).max() <= SERVO.acceleration * STEP * (1.0 + 1e-9)
    assert np.abs(motion.true).max() < 0.9 * np.abs(u).max()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_far_goal_is_approached_with_all_the_servo_has_on_either_side(sign: float) -> None:
    """Claim: on the way to a far goal the mirror gains the largest acceleration A until it has the fastest speed S,
    and keeps that: x = S t − S²/(2A), whichever way it goes; to an update, S step."""
    goal = 3.0 * SERVO.slew**2 / SERVO.acceleration
    motion, _ = follow(SERVO, at_rest(0.0), np.full(4000, sign * goal), STEP)
    far = np.cumprod(np.abs(motion.true) < 0.5 * goal).astype(bool)
    time = STEP * np.arange(1, 4001)[far]
    assert time[-1] > 1.5 * SERVO.slew / SERVO.acceleration
    speed = np.minimum(SERVO.acceleration * time, SERVO.slew)
    np.testing.assert_allclose(sign * motion.rate[far], speed, rtol=1e-9)
    way = SERVO.slew * time[-1] - 0.5 * SERVO.slew**2 / SERVO.acceleration
    assert sign * motion.true[far][-1] == pytest.approx(way, abs=SERVO.slew * STEP)


@pytest.mark.parametrize("limit", ["acceleration", "slew"])
def test_a_limit_just_above_what_a_motion_takes_changes_nothing(limit: str) -> None:
    """Claim: of a motion whose free servo takes a mean acceleration A of its updates, and a speed S, the limits hold
    from 1 % below either on, and 1 % above it the motion is that of the free servo."""
    free = SERVO.model_copy(update={"acceleration": 1e9, "slew": 1e6})
    u = sine(455.0, 30e-3, 300)
    motion, _ = follow(free, at_rest(0.0), u, STEP)
    assert not motion.limited.any()
    gained = np.diff(motion.rate, prepend=0.0) / STEP
    most = float(np.abs(gained if limit == "acceleration" else motion.rate).max())
    loose, _ = follow(free.model_copy(update={limit: 1.01 * most}), at_rest(0.0), u, STEP)
    assert not loose.limited.any()
    np.testing.assert_array_equal(loose.true, motion.true)
    tight, _ = follow(free.model_copy(update={limit: 0.99 * most}), at_rest(0.0), u, STEP)
    assert tight.limited.any()


def test_mirrors_of_a_batch_do_not_know_of_one_another() -> None:
    """One that is limited leaves its neighbour exact."""
    u = np.stack([sine(455.0, 2e-3, 200), sine(455.0, 0.2, 200)])
    both, _ = follow(SERVO, at_rest(np.zeros(2)), u, STEP)
    for one, row in enumerate(u):
        alone, _ = follow(SERVO, at_rest(0.0), row, STEP)
        np.testing.assert_array_equal(both.true[one], alone.true)


def test_encoders_latch_earlier() -> None:
    """The latched angle is the true one of the delay before: on a steady sine within 0.1 µrad of 6 mrad."""
    fine, coarse = 2.5e-6, STEP
    frequency, delay = 469.0, 10e-6

    def run(step: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        u = 6e-3 * np.sin(2.0 * np.pi * frequency * step * np.arange(1, round(6e-3 / step) + 1))
        motion, _ = follow(SERVO, at_rest(0.0), u, step)
        return motion.true, latch(motion, at_rest(0.0), step, delay)

    (true, _), (_, seen) = run(fine), run(coarse)
    earlier = true[round((coarse - delay) / fine) - 1 :: round(coarse / fine)]
    np.testing.assert_allclose(seen[200:], earlier[200 : len(seen)], atol=2e-6)
    still, _ = follow(SERVO, at_rest(0.1), np.full(5, 0.1), coarse)
    np.testing.assert_allclose(latch(still, at_rest(0.1), coarse, 30e-6), 0.1)
    with pytest.raises(ValueError, match="longer than the motion"):
        latch(still, at_rest(0.1), coarse, 1.0)


def test_attainable_is_the_edge_of_the_limits() -> None:
    for frequency in (303.0, 455.0, 1000.0):
        edge = float(attainable_amplitude(SERVO, frequency))
        # Begun gently: the kink of a sudden sine asks for more than the sine.
        u = sine(frequency, 1.0, 4000) * np.minimum(np.arange(4000) / 1500.0, 1.0)
        within, _ = follow(SERVO, at_rest(0.0), 0.97 * edge * u, STEP)
        beyond, _ = follow(SERVO, at_rest(0.0), 1.05 * edge * u, STEP)
        assert not within.limited[2000:].any()
        assert beyond.limited[2000:].any()
        assert attainable_frequency(SERVO, edge) == pytest.approx(frequency, rel=1e-6)


def test_small_sines_are_followed_up_to_the_natural_frequency() -> None:
    """Claim: the search ends at the natural frequency, where 2ζ a/ω² is attainable; beyond it, what a servo that rings
    attains falls and rises again, so that not all sines up to a frequency from there are followed."""
    servo = SERVO.model_copy(update={"damping": 0.2})
    amplitude = 0.99 * 2.0 * servo.damping * servo.acceleration / servo.omega**2
    found = attainable_frequency(servo, amplitude)
    assert found == pytest.approx(servo.natural_frequency, rel=1e-6)
    assert (attainable_amplitude(servo, np.linspace(1.0, found, 2000)) >= amplitude).all()


@pytest.mark.parametrize(
    ("damping", "frequency", "distance", "side"),
    [(0.2, 500.0, 0.01, 1.0), (0.7, 1500.0, -0.05, -1.0), (0.7, 3500.0, 0.01, -1.0)],
)
def test_a_jump_has_settled_when_it_stays_near_its_goal_on_either_side(
    damping: float, frequency: float, distance: float, side: float
) -> None:
    """Claim: what is followed for 20 ms longer leaves ``settled`` of the goal last in the update before the time that
    is told: where it rings beyond the goal (two jumps, one to each side) or on its way there."""
    servo = SERVO.model_copy(update={"damping": damping, "natural_frequency": frequency})
    told = float(jump_time(servo, distance))
    time = 5e-6 * np.arange(1, round((told + 20e-3) / 5e-6) + 1)
    goal = np.array([distance])
    motion, _ = follow(servo, at_rest(np.zeros(1)), jump_path(servo, np.zeros(1), goal, time), 5e-6)
    away = motion.true[0] - distance
    last = np.flatnonzero(np.abs(away) > servo.settled)[-1]
    assert time[last] == pytest.approx(told - 5e-6, abs=1e-9)
    assert np.sign(away[last]) == side


@pytest.mark.parametrize("damping", [0.2, 0.7, 0.99])
def test_jumps_have_settled_by_the_latest_time(damping: float) -> None:
    """Claim: no jump settles later than the time that is told without following it, not even that of a servo that rings
    for as long as is looked at; and that time is no more than thirty time constants after the command's end."""
    for frequency in (50.0, 2000.0):
        servo = SERVO.model_copy(
            update={"damping": damping, "natural_frequency": frequency, "settled": 1e-12}
        )
        for distance in (1e-5, 0.05, 1.0):
            command = float(jump_duration(servo, distance))
            latest, settled = latest_settling(servo, command), float(jump_time(servo, distance))
            assert settled <= latest
            assert latest - command < 30.0 / (servo.damping * servo.omega)


def test_jumps_stay_within_the_limits_and_settle() -> None:
    """The time comes out of the servo: it is the command's and a few time constants, and no update is limited."""
    distance = np.array([1e-5, 1e-3, 0.05, 0.2, 0.5, 1.0])
    command, settled = jump_duration(SERVO, distance), jump_time(SERVO, distance)
    assert settled[0] == 0.0
    assert (settled[1:] > 0.8 * command[1:]).all()
    assert (settled < command + 8.0 / (SERVO.damping * SERVO.omega)).all()
    time = STEP * np.arange(1, 800)
    path = jump_path(SERVO, np.full(6, 0.1), 0.1 - distance, time)
    np.testing.assert_allclose(path[:, -1], 0.1 - distance, atol=1e-12)
    motion, _ = follow(SERVO, at_rest(np.full(6, 0.1)), path, STEP)
    assert not motion.limited.any()
    for row, when in zip(np.abs(motion.true - path[:, -1:]), settled, strict=True):
        assert row[time >= when].max() <= SERVO.settled


def test_a_jump_can_wait_for_a_longer_one() -> None:
    time = STEP * np.arange(1, 800)
    long = float(jump_duration(SERVO, 0.5))
    path = jump_path(SERVO, np.zeros(2), np.array([0.5, 0.1]), time, np.full(2, long))
    np.testing.assert_allclose(
        path[:, time >= long], [[0.5], [0.1]] * np.ones((time >= long).sum()), atol=1e-12
    )
    assert path[1, time < 0.98 * long].max() < 0.1
