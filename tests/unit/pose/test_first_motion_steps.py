"""The first motion of an object from visits: back in time over pushes, and a slope that is that of its χ²."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from scanner_sim.pose import curvature
from scanner_sim.pose.adjustment import _next_share
from scanner_sim.pose.first_motions import (
    Expected,
    FirstMotion,
    Push,
    _back,
    _moved,
    _normal_equations,
    _rates,
    _seen,
)
from scanner_sim.ranging.coordinates import angles_and_range, coordinates

APART = 0.05
EXPECTED = Expected(fastest=0.3, fastest_turn=0.2, acceleration=1e-6, turn_acceleration=1e-6)
MOTION = FirstMotion(
    np.array([0.3, -0.2, 7.0]),
    Rotation.from_rotvec([0.2, -0.5, 0.3]).as_matrix(),
    np.array([0.05, -0.03, 0.08]),
    np.array([0.04, 0.09, -0.06]),
)


def test_back_over_its_pushes_a_motion_is_where_it_began() -> None:
    """Claim: an object that drifts and turns evenly and is pushed twice, followed forwards by hand, is taken back to
    where it was at first, with the velocity from before the pushes; a push after the span changes nothing."""
    pushes = [
        Push(time, 0, np.array(velocity), 1e-3)
        for time, velocity in ((1.3, [0.02, 0.01, -0.03]), (2.1, [-0.01, 0.04, 0.02]), (4.0, [9.0, 9.0, 9.0]))
    ]
    position, velocity, now = MOTION.position, MOTION.velocity, 0.7
    for push in pushes[:2]:
        position, velocity, now = position + (push.time - now) * velocity, velocity + push.velocity, push.time
    position = position + (3.2 - now) * velocity
    turned = Rotation.from_rotvec(2.5 * MOTION.turn_rate).as_matrix() @ MOTION.rotation
    found = _back(FirstMotion(position, turned, velocity, MOTION.turn_rate), (0.7, 3.2), pushes)
    for one, wanted in zip(found, MOTION, strict=True):
        np.testing.assert_allclose(one, wanted, atol=1e-12)


def test_the_slope_is_that_of_chi_square() -> None:
    """Claim: −½ ∂χ² by each of the twelve unknowns is what differences of χ² have, to 1e-5 of what one standard
    deviation changes; on the true motion χ² is that of the rates alone."""
    random = np.random.default_rng(7)
    points = {f"n/{number}": place for number, place in enumerate(random.uniform(-0.6, 0.6, (4, 3)))}
    visits: list[Any] = []
    for number in range(9):
        time, name = 0.11 * number, f"n/{number % 4}"
        turn = Rotation.from_rotvec((time - 1.0) * MOTION.turn_rate).as_matrix()
        place = MOTION.position + (time - 1.0) * MOTION.velocity + turn @ MOTION.rotation @ points[name]
        reach, theta, phi = angles_and_range(*place, APART)
        root = np.diag([1e-4, 2e-4, 3e-3]) @ random.normal(0.3, 1.0, (3, 3))
        visits.append(
            SimpleNamespace(
                time=time, target=name, position=np.array([theta, phi, reach]), covariance=root @ root.T
            )
        )
    seen = _seen(points, visits, 1.0, APART, EXPECTED, ())
    rates = np.concatenate([MOTION.velocity / 0.3, MOTION.turn_rate / 0.2])
    assert abs(_normal_equations(seen, MOTION)[0] - float(rates @ rates)) < 1e-6
    away = _moved(MOTION, 1e-3 * random.normal(size=12))
    _, weight, pull = _normal_equations(seen, away)
    for number, step in enumerate(np.eye(12)):
        ends = [_normal_equations(seen, _moved(away, side * 1e-6 * step)) for side in (1.0, -1.0)]
        slope = (ends[0][0] - ends[1][0]) / 2e-6
        assert abs(-0.5 * slope - pull[number]) < 1e-5 * np.sqrt(weight[number, number]) * np.sqrt(ends[0][0])


def test_the_next_step_ends_where_the_secant_has_no_slope() -> None:
    """Claim: along a parabola a share s of the step leaves 1 − s w of the slope, and the next is 1/w, within 0.1 to 4;
    a step that left less than 0.3, or nearly all, is followed by a whole one."""
    share, width = np.array([1.0, 1.0, 0.5, 1.0, 1.0, 2.0]), np.array([0.4, 1.6, 0.8, 0.9, 0.02, 6.0])
    found = _next_share(share, 1.0 - share * width)
    np.testing.assert_allclose(found, [1.0 / 0.4, 1.0 / 1.6, 1.0 / 0.8, 1.0, 1.0, 1.0 / 6.0], rtol=1e-12)


def test_at_both_ends_of_a_standard_deviation_the_origin_has_moved_straight(monkeypatch: Any) -> None:
    """Claim: the object's origin, from which the array's centre stands off, moves by as much to one side as to the
    other, along δc + arm × δω; the rotation is exp(±[δω]×) R."""
    asked: list[tuple[Any, Any]] = []

    def cost(_: Any, rotation: Any, position: Any) -> Any:
        asked.append((rotation[..., 0], position[:, 0]))
        return np.array([5.0])

    centre = np.array([0.7, -0.4, 1.1])
    step = np.array([0.02, -0.03, 0.05, 0.3, -0.2, 0.25])
    monkeypatch.setattr(curvature, "cost_of", cost)
    monkeypatch.setattr(curvature, "_widest_swing", lambda *_: step[:, None])
    fit: Any = SimpleNamespace(
        position=MOTION.position[:, None],
        rotation=MOTION.rotation[..., None],
        normal=np.eye(6)[..., None],
        cost=np.array([4.0]),
    )
    problem: Any = SimpleNamespace(centre=centre[:, None])
    curvature.bent(problem, fit, np.eye(6)[..., None], (np.eye(3), np.eye(3), np.eye(3)))
    arm = MOTION.rotation @ centre
    for side, (rotation, position) in zip((1.0, -1.0), asked, strict=True):
        turned = Rotation.from_rotvec(side * step[3:]).as_matrix() @ MOTION.rotation
        np.testing.assert_allclose(rotation, turned, atol=1e-12)
        moved = position - rotation @ centre - (MOTION.position - arm)
        np.testing.assert_allclose(moved, side * (step[:3] + np.cross(arm, step[3:])), atol=1e-12)


def test_first_rates_are_those_of_least_squares_over_the_ways() -> None:
    """Claim: each later visit of a target tells a way, Δt (v + ω × arm) of the arm from the middle to half-way, to both
    visits' errors R²(σ_Θ² + σ_φ²) + σ_R²; what is expected of v and ω counts as six observations of zero. By a general
    solver on stacked rows."""
    random = np.random.default_rng(3)
    middle = np.array([0.3, -0.2, 7.0])
    visits: list[Any] = []
    for number in range(9):
        place = middle + random.uniform(-0.8, 0.8, 3) * (number < 4)
        if number >= 4:
            reach, theta, phi = angles_and_range(*(middle + random.uniform(-0.8, 0.8, 3)), APART)
        else:
            reach, theta, phi = angles_and_range(*place, APART)
        root = np.diag([1e-3, 2e-3, 0.02]) @ random.normal(0.3, 1.0, (3, 3))
        visits.append(
            SimpleNamespace(
                time=0.11 * number, target=f"n/{number % 4}", position=np.array([theta, phi, reach]),
                covariance=root @ root.T,
            )
        )  # fmt: skip
    expected = Expected(fastest=0.9, fastest_turn=0.4, acceleration=0.0, turn_acceleration=0.0)
    rows, right = [np.diag([1.0 / 0.9] * 3 + [1.0 / 0.4] * 3)], [np.zeros(6)]
    for late in visits[4:]:
        early = next(one for one in visits if one.target == late.target)
        here, there = (
            np.stack(coordinates(one.position[2], *one.position[:2], APART)) for one in (early, late)
        )
        arm, step = 0.5 * (here + there) - middle, late.time - early.time
        # ω × arm, column by column.
        turns = np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=1)
        spread = late.covariance
        across = late.position[2] ** 2 * (spread[0, 0] + spread[1, 1])
        sigma = np.sqrt(2.0 * (across + spread[2, 2]))
        rows.append(step * np.concatenate([np.eye(3), turns], axis=1) / sigma)
        right.append((there - here) / sigma)
    wanted = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    found = np.concatenate(_rates(visits, middle, APART, expected))
    np.testing.assert_allclose(found, wanted, rtol=1e-8)
