"""The motion that a filter begins with: exact visits give it back, noisy ones the likeliest, as SciPy finds it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from scanner_sim.analytic import geometry as judge
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.first_motions import Expected, FirstMotion, Push, _rough, first_motion

Array = NDArray[np.float64]

D = 0.05
SPAN = (0.3, 6.9)
POINTS = {"a": [-0.6, -0.5, 0.1], "b": [0.5, -0.7, 0.2], "c": [0.6, 0.5, -0.1], "d": [-0.4, 0.6, 0.3]}
PLACE, TURNED = np.array([0.4, -0.3, 6.0]), Rotation.from_rotvec([0.3, -0.2, 0.15])
VELOCITY, RATE = np.array([0.03, -0.05, 0.11]), np.array([0.07, -0.04, 0.09])
PUSH = Push(2.9, 0, np.array([-0.04, 0.06, 0.05]), 2e-3)
TIMES = 0.7 + np.array([0.0, 0.4, 0.9, 1.5, 1.8, 2.6, 2.9, 3.6, 4.1, 4.3, 5.2, 5.9])
SIGMA = np.array([3e-5, 5e-5, 2e-3])


def sights(points: Array) -> Array:
    """Return (Θ, φ, R), shape (n, 3), of points."""
    r, theta, phi = judge.shot_from_point(points, D)
    return np.stack([theta, phi, r], axis=-1)


def true_places(times: Array, names: list[str]) -> Array:
    """Return where targets are at their times: even from the first time of the span on, but for the push."""
    step, after = times[:, None] - SPAN[0], np.maximum(times - PUSH.time, 0.0)[:, None]
    arms = np.array([POINTS[name] for name in names])
    return (
        PLACE
        + step * VELOCITY
        + after * PUSH.velocity
        + (Rotation.from_rotvec(step * RATE) * TURNED).apply(arms)
    )


def visited(generator: np.random.Generator | None = None) -> list[Any]:
    """Return three rounds of visits to four targets, with noise or exact."""
    names = list("abcd" * 3)
    positions = sights(true_places(TIMES, names))
    if generator is not None:
        positions = positions + SIGMA * generator.standard_normal(positions.shape)
    return [
        SimpleNamespace(target=name, time=float(time), position=place, covariance=np.diag(SIGMA**2))
        for name, time, place in zip(names, TIMES, positions, strict=True)
    ]


def test_exact_visits_give_the_motion_at_the_first_time() -> None:
    """Claim: where nothing is known of rates beforehand, an object that moves evenly but for a push is found as it was
    at the first time of all visits, before its own. Tolerance: a step of a thousandth of σ ends the search."""
    found = first_motion("node", POINTS, visited(), SPAN, D, Expected(1e3, 1e3, 0.0, 0.0), [PUSH])
    np.testing.assert_allclose(found.position, PLACE, atol=1e-5)
    np.testing.assert_allclose(found.rotation, TURNED.as_matrix(), atol=1e-5)
    np.testing.assert_allclose(found.velocity, VELOCITY, atol=1e-5)
    np.testing.assert_allclose(found.turn_rate, RATE, atol=1e-5)


def test_noisy_visits_give_the_likeliest_motion() -> None:
    """Claim: the sum of squares that SciPy makes least, with numerical slopes: of visits, whose errors grow with what
    accelerations and the push's own σ make of the way to the last time, and of rates over what is usual.

    Expected: a density S of acceleration leaves S t³/3 of a way, one of turns |x|² times as much at a point x.
    """
    known = Expected(0.04, 0.06, 2e-7, 3e-7)
    visits = visited(np.random.default_rng(8))
    found = first_motion("node", POINTS, visits, SPAN, D, known, [PUSH])
    since = TIMES - SPAN[1]
    arms = np.array([POINTS[one.target] for one in visits])
    measured = np.array([one.position for one in visits])
    before = np.minimum(TIMES - PUSH.time, 0.0)
    spread = (known.acceleration + known.turn_acceleration * (arms**2).sum(axis=1)) * np.abs(since) ** 3 / 3.0
    spread = spread + (before * PUSH.sigma) ** 2
    roots = []
    for place, more in zip(measured, spread, strict=True):
        x = judge.point_from_shot(place[2], place[0], place[1], D)
        slope = np.stack([(sights(x + h) - sights(x - h)) / 2e-6 for h in 1e-6 * np.eye(3)], axis=-1)
        roots.append(np.linalg.inv(np.linalg.cholesky(np.diag(SIGMA**2) + more * slope @ slope.T)))

    def residuals(at: Array) -> Array:
        position, turn, speed, rate = at.reshape(4, 3)
        turned = Rotation.from_rotvec(since[:, None] * rate) * Rotation.from_rotvec(turn)
        way = since[:, None] * speed - before[:, None] * PUSH.velocity
        away = measured - sights(position + way + turned.apply(arms))
        return np.concatenate(
            [np.einsum("nij,nj->ni", roots, away).ravel(), speed / known.fastest, rate / known.fastest_turn]
        )

    step = SPAN[1] - SPAN[0]
    last = Rotation.from_rotvec(step * RATE) * TURNED
    start = np.concatenate([PLACE + step * VELOCITY, last.as_rotvec(), VELOCITY, RATE])
    best = least_squares(residuals, start, x_scale="jac", xtol=1e-12, ftol=1e-12)
    sigma = np.sqrt(np.diagonal(np.linalg.inv(best.jac.T @ best.jac)))
    # Where it was found, carried on to the last time.
    ended = found.position + step * found.velocity + (SPAN[1] - PUSH.time) * PUSH.velocity
    turned = Rotation.from_rotvec(step * found.turn_rate) * Rotation.from_matrix(found.rotation)
    speed = found.velocity + PUSH.velocity
    ours = np.concatenate([ended, turned.as_rotvec(), speed, found.turn_rate])
    assert np.abs((ours - best.x) / sigma).max() < 5e-3


def test_a_first_guess_carries_straight_ways_to_the_last_time() -> None:
    """Claim: of an object that does not turn, and of whose rates nothing is known, the guess is exact already."""
    times, names = np.linspace(0.5, 4.5, 8), list("abcd" * 2)
    arms = np.array([POINTS[name] for name in names])
    places = sights(PLACE + times[:, None] * VELOCITY + TURNED.apply(arms))
    visits: list[Any] = [
        SimpleNamespace(target=name, time=float(time), position=place, covariance=np.diag(SIGMA**2))
        for name, time, place in zip(names, times, places, strict=True)
    ]
    found = _rough("node", POINTS, visits, 5.5, D, Expected(1e6, 1e6, 0.0, 0.0))
    wanted = FirstMotion(PLACE + 5.5 * VELOCITY, TURNED.as_matrix(), VELOCITY, np.zeros(3))
    for own, true in zip(found, wanted, strict=True):
        np.testing.assert_allclose(own, true, atol=1e-6)


def test_a_motion_that_is_not_even_is_none() -> None:
    """Claim: a push that nobody told of is no even motion, and two targets make none."""
    known = Expected(0.2, 0.2, 1e-9, 1e-9)
    with pytest.raises(InputError, match="no even motion of 'node'"):
        first_motion("node", POINTS, visited(), SPAN, D, known)
    two = [one for one in visited() if one.target in "ab"]
    with pytest.raises(InputError, match="2 targets were measured"):
        first_motion("node", POINTS, two, SPAN, D, known)


def test_targets_on_one_line_leave_the_attitude_open() -> None:
    """Claim: visits to three targets on a line begin nothing, wherever the object's origin is and whatever noise makes
    of a turn about the line; one target beside it closes the attitude."""
    line = {name: at * np.array([0.5, 0.2, 0.1]) for name, at in zip("abc", (-1.0, 0.2, 1.0), strict=True)}
    known, generator = Expected(0.1, 0.1, 1e-6, 1e-6), np.random.default_rng(21)
    for origin in (np.zeros(3), np.array([0.1, -0.4, 0.3])):
        points = {name: at - origin for name, at in line.items()} | {"d": np.array([-0.3, 0.6, 0.1]) - origin}
        places = sights(PLACE + TURNED.apply(np.array(list(points.values()))))
        for _ in range(12):
            seen = places + SIGMA * generator.standard_normal(places.shape)
            visits: list[Any] = [
                SimpleNamespace(target=name, time=0.01 * number, position=place, covariance=np.diag(SIGMA**2))
                for number, (name, place) in enumerate(zip(points, seen, strict=True))
            ]
            with pytest.raises(InputError, match="leave the attitude of 'node' open"):
                first_motion("node", points, visits[:3], (0.0, 0.02), D, known)
            first_motion("node", points, visits, (0.0, 0.03), D, known)
