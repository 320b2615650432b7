"""Relative orbits: the closed form against two numerical integrations, glideslopes against their law, and signs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from scanner_sim.scene.light.earth import EARTH_RADIUS
from scanner_sim.scene.light.orbit import GRAVITY, period
from scanner_sim.scene.relative_orbit import Burn, Glideslope, RelativeOrbit, transition

ALTITUDE = 400e3
RADIUS = EARTH_RADIUS + ALTITUDE
RATE = math.sqrt(GRAVITY / RADIUS**3)
TIMES = np.linspace(0.0, 2.0 * math.pi / RATE, 13)


def relative(**changes: object) -> RelativeOrbit:
    return RelativeOrbit(type="clohessy_wiltshire", **{"position": (-30.0, 4.0, 5.0), **changes})


def integrated(rates: object, start: np.ndarray) -> np.ndarray:
    return solve_ivp(
        rates, (0.0, TIMES[-1]), start, method="DOP853", t_eval=TIMES, rtol=1e-13, atol=1e-12
    ).y.T


def test_the_closed_form_solves_the_linear_equations() -> None:
    """Claim: each column of Φ is the solution from a unit state. Tolerance: that of the integrator, 1e-13 a step."""

    def rates(_: float, s: np.ndarray) -> list[float]:
        pull = -2.0 * RATE * s[3] + 3.0 * RATE**2 * s[2]
        return [*s[3:], 2.0 * RATE * s[5], -(RATE**2) * s[1], pull]

    phi = transition(RATE, TIMES)
    for column in range(6):
        scale = np.array([1.0, 1.0, 1.0, RATE, RATE, RATE]) / (RATE if column > 2 else 1.0)
        apart = (phi[:, :, column] - integrated(rates, np.eye(6)[column])) / scale
        assert np.abs(apart).max() < 1e-8


def two_body(distance: float) -> np.ndarray:
    """Return the chaser's places by the law of gravity, along the target's axes, from (−d, d/5, d/10) at rest."""
    ahead, starboard, down = -distance, 0.2 * distance, 0.1 * distance
    target = np.array([RADIUS, 0.0, 0.0])
    ram, port, up = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    place = target + ahead * ram - starboard * port - down * up
    # At rest against the axes, which turn with the orbit.
    velocity = np.cross(RATE * port, place)

    def rates(_: float, s: np.ndarray) -> np.ndarray:
        return np.concatenate([s[3:], -GRAVITY * s[:3] / np.linalg.norm(s[:3]) ** 3])

    found = integrated(rates, np.concatenate([place, velocity]))[:, :3]
    c, s = np.cos(RATE * TIMES), np.sin(RATE * TIMES)
    zero = np.zeros_like(c)
    up = np.stack([c, s, zero], axis=1)
    ram = np.stack([-s, c, zero], axis=1)
    away = found - RADIUS * up
    return np.stack([np.sum(away * ram, axis=1), -away[:, 2], -np.sum(away * up, axis=1)], axis=1)


def test_what_is_left_out_of_gravity_grows_with_the_square_of_distance() -> None:
    """Claim: the closed form is the two-body problem to first order of d/r.

    Set-up: one orbit from 250 and 500 m. Expected: the first term left out is of second order, so twice the distance
    makes four times the error, and the third order adds d/r, below 1e-3. The error itself is below 100 d²/r: within an
    orbit the second order grows by the secular (3π)² of the drift.
    """
    errors = []
    for distance in (250.0, 500.0):
        start = np.array([-distance, 0.2 * distance, 0.1 * distance, 0.0, 0.0, 0.0])
        linear = (transition(RATE, TIMES) @ start)[:, :3]
        errors.append(np.linalg.norm(linear - two_body(distance), axis=1).max())
        assert errors[-1] < 100.0 * distance**2 / RADIUS
    assert errors[1] / errors[0] == pytest.approx(4.0, rel=5e-3)


def test_an_object_ahead_and_above_is_ahead_and_above_in_the_scanner() -> None:
    """Claim: a chaser 30 m behind and 5 m below sees the target 30 m ahead, 5 m up; starboard of it is to its left."""
    (pose,) = relative(mounting=(2.0, 0.0, 0.0)).scanner_from_object(0.0, np.diag([-1.0, 1.0, -1.0, 1.0]))
    assert pose[:3, 3] == pytest.approx([-4.0, -5.0, 28.0])
    assert pose[:3, :3] == pytest.approx(np.diag([-1.0, 1.0, -1.0]))


def test_a_burn_changes_velocity_once() -> None:
    """Claim: before a burn the chaser coasts as without it, after it by the sum of both responses."""
    burn = Burn(time=600.0, delta_v=(0.05, -0.02, 0.01))
    free, burnt = relative(), relative(burns=(burn,))
    times = np.array([0.0, 300.0, 599.9, 600.0, 1500.0])
    apart = burnt.chaser(times) - free.chaser(times)
    assert np.abs(apart[:3]).max() == 0.0
    assert apart[3, 3:] == pytest.approx(burn.delta_v)
    assert apart[4] == pytest.approx(transition(RATE, 900.0)[0, :, 3:] @ burn.delta_v, rel=1e-5)
    assert burnt.total_delta_v == pytest.approx(np.linalg.norm(burn.delta_v))
    at_once = relative(burns=(Burn(time=0.0, delta_v=(0.1, 0.0, 0.0)),))
    assert at_once.chaser(0.0)[0, 3] == pytest.approx(0.1)


def test_a_glideslope_passes_its_places_arrives_and_stays() -> None:
    """Claim: at each pulse the chaser is on the line where Hablani's law, integrated numerically, has it."""
    slope = Glideslope(to=(-2.0, 0.5, 1.0), start_speed=0.05, end_speed=0.01, pulses=12)
    motion = relative(position=(-30.0, 0.0, 8.0), glideslope=slope)
    start, end = np.array([-30.0, 0.0, 8.0]), np.array(slope.to)
    distance = float(np.linalg.norm(start - end))
    rate = (slope.end_speed - slope.start_speed) / distance
    # Range rate −(ρ̇_T + (ρ̇_0 − ρ̇_T) ρ/ρ_0).
    law = solve_ivp(lambda _, rho: -(slope.end_speed - rate * rho), (0.0, 2000.0), [distance], rtol=1e-12, atol=1e-13,
                    events=[lambda _, rho: rho[0]], dense_output=True)  # fmt: skip
    arrival = float(law.t_events[0][0])
    assert motion.end == pytest.approx(arrival, rel=1e-8)
    times = np.linspace(0.0, arrival, 13)
    expected = end + law.sol(times)[0][:, None] * (start - end) / distance
    assert motion.chaser(times)[:, :3] == pytest.approx(expected, abs=1e-6)
    # Not only where a leg is said to begin: each one coasts to the next place, at 60 mm/s and less.
    assert motion.chaser(times[1:] - 1e-6)[:, :3] == pytest.approx(expected[1:], abs=1e-6)
    later = motion.chaser([arrival + 1.0, arrival + 1e4])
    assert later[:, :3] == pytest.approx(np.tile(end, (2, 1)))
    assert np.abs(later[:, 3:]).max() == 0.0
    assert motion.total_delta_v > slope.start_speed + slope.end_speed


def test_an_even_glideslope_takes_its_distance_over_its_speed() -> None:
    """Claim: equal speeds are the limit of unequal ones."""
    even = Glideslope(to=(0.0, 0.0, 0.0), start_speed=0.03, end_speed=0.03)
    nearly = Glideslope(to=(0.0, 0.0, 0.0), start_speed=0.03, end_speed=0.03 * (1.0 + 1e-6))
    assert even.duration(30.0) == pytest.approx(1000.0)
    assert nearly.duration(30.0) == pytest.approx(1000.0, rel=1e-5)
    times = np.array([0.0, 100.0, 700.0, 1000.0])
    for slope in (even, nearly):
        assert slope.left(30.0, times) == pytest.approx(30.0 - 0.03 * times, abs=1e-4)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"burns": [{"time": t, "delta_v": (0.0, 0.0, 0.0)} for t in (5.0, 4.0)]}, "not after the 5 s"),
        ({"glideslope": {"to": (-30.0, 4.0, 5.0), "start_speed": 0.1, "end_speed": 0.1}}, "ends where it begins"),
        ({"velocity": (0.1, 0.0, 0.0), "glideslope": {"to": (0, 0, 0), "start_speed": 0.1, "end_speed": 0.1}},
         "the glideslope gives the impulses"),
        ({"glideslope": {"to": (0, 0, 0), "start_speed": 0.001, "end_speed": 0.001, "pulses": 2}},
         "half an orbit or more"),
    ],
)  # fmt: skip
def test_paths_that_cannot_be_flown_are_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        relative(**changes)


def test_the_rate_is_that_of_the_orbit() -> None:
    assert relative().rate == pytest.approx(RATE)
    assert period(ALTITUDE) == pytest.approx(2.0 * math.pi / RATE)


def test_burns_follow_one_another_and_the_scanner_looks_from_where_it_is_mounted() -> None:
    """Claim: the chaser's state after three burns is coasting and kicks by turns from the start; the object is seen
    from there and the mounting, in the scanner's axes; all impulses count, that at the start too."""
    start = np.array([-30.0, 4.0, 5.0, 0.02, -0.03, 0.01])
    kicks = {0.0: (0.01, 0.02, -0.04), 400.0: (-0.05, 0.01, 0.02), 1300.0: (0.03, -0.06, 0.05)}
    mounting = np.array([0.4, -0.7, 1.1])
    motion = relative(
        velocity=tuple(start[3:]),
        burns=tuple(Burn(time=time, delta_v=kick) for time, kick in kicks.items()),
        mounting=tuple(mounting),
        attitude={"forward": "starboard", "down": "nadir", "rotation": {"axis": "x", "angle": 0.3}},
    )
    state, before = start, 0.0
    for time, kick in kicks.items():
        state = transition(RATE, time - before)[0] @ state + [0.0, 0.0, 0.0, *kick]
        before = time
        assert motion.chaser(time)[0] == pytest.approx(state, rel=1e-9, abs=1e-12)
    state = transition(RATE, 700.0)[0] @ state
    assert motion.chaser(2000.0)[0] == pytest.approx(state, rel=1e-9, abs=1e-12)
    assert motion.total_delta_v == pytest.approx(sum(np.linalg.norm(kick) for kick in kicks.values()))
    # Forwards is starboard and down nadir, so that the right is aft; then a turn about the right by 0.3.
    right, down, ahead = np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    c, s = math.cos(0.3), math.sin(0.3)
    axes = np.stack([right, c * down + s * ahead, c * ahead - s * down])
    (pose,) = motion.scanner_from_object(2000.0, np.eye(4))
    assert pose[:3, 3] == pytest.approx(-axes @ (state[:3] + mounting), rel=1e-9)


@pytest.mark.parametrize(("share", "possible"), [(0.99, True), (1.01, False)])
def test_a_glideslope_has_a_pulse_in_each_half_orbit(share: float, possible: bool) -> None:
    """Claim: pulses may lie up to half an orbit apart; the message has the time between them."""
    apart = share * math.pi / RATE
    slope = {"to": (-30.0, 4.0, 25.0), "start_speed": 20.0 / (3.0 * apart), "pulses": 3}
    given = {"glideslope": {**slope, "end_speed": slope["start_speed"]}}
    if possible:
        assert relative(**given).end == pytest.approx(3.0 * apart)
        return
    with pytest.raises(ValidationError, match=f"there is {apart:.4g} s between pulses"):
        relative(**given)
