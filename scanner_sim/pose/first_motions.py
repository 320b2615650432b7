"""Motions to begin a filter with: of each object the likeliest even motion by the first visits, each at its own time.

Errors are taken for new in each visit here; what they have in common the filter knows, which goes over the visits along
these motions (:meth:`scanner_sim.pose.filter.FilterModel.begin`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammainccinv

from scanner_sim.foundation.arithmetic import applied, inverse, product, solve_linear
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.point_fit import point_fit
from scanner_sim.pose.transforms import cross_matrix, rotation_from_vector, turn_jacobian
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.tracking.record import PatternRecord

Array = NDArray[np.float64]

_MOST_STEPS, _SAME = 40, 1e-3
"""Steps of an adjustment at most, and one in standard deviations that is none."""
_CHANCE = 1e-6
"""Share of right visits that are put off. The best of the wrong motions nearby have χ² of a thousand and more."""
_STRAIGHT = 0.25
"""How far the ways of targets may bend, over the visits' errors, where a filter takes them for straight."""


class Push(NamedTuple):
    """A change of an object's velocity that somebody causes.

    At a ``time`` [s], of the object with a ``number``, by a ``velocity`` [m/s], shape (3,), known to ``sigma`` [m/s]
    along each axis.
    """

    time: float
    number: int
    velocity: Array
    sigma: float


@dataclass(frozen=True)
class Expected:
    """What is known of motions beforehand.

    Attributes
    ----------
    fastest, fastest_turn
        Standard deviations of velocity [m/s] and rate of turn [rad/s].
    acceleration, turn_acceleration
        Spectral densities of accelerations [m²/s³, rad²/s³].
    """

    fastest: float
    fastest_turn: float
    acceleration: float
    turn_acceleration: float


class FirstMotion(NamedTuple):
    """An object at a time: position [m], ``scanner_from_object``, velocity [m/s] and rate of turn [rad/s]."""

    position: Array
    rotation: Array
    velocity: Array
    turn_rate: Array


def first_motion(
    name: str,
    points: Mapping[str, ArrayLike],
    visits: Sequence[PatternRecord],
    span: tuple[float, float],
    axis_separation: float,
    expected: Expected,
    pushes: Sequence[Push] = (),
) -> FirstMotion:
    """Return the likeliest motion of an object, even but for pushes, by some visits to its targets.

    Parameters
    ----------
    name, points
        The object's, and its targets along its own axes [m], shape (3,) each.
    visits
        Of these, in the order of time, all of them measured.
    span
        First and last time of all visits [s], also to other objects.
    axis_separation
        D_g [m].
    expected, pushes
        What is known beforehand. Rates are about zero; what acts on the object makes a visit the less certain the older
        it is.

    Returns
    -------
    FirstMotion
        At the first time, of what is likeliest at the last (Gauss and Newton with the damping of Levenberg).

    Raises
    ------
    InputError
        If fewer than three targets were visited, if no such motion explains the visits, or if they leave the attitude
        so open that the way of a target until the next visit bends by more than a quarter of what visits err.
    """
    own = [record for record in visits if record.target in points]
    motion = _rough(name, points, own, span[1], axis_separation, expected)
    seen = _seen(points, own, span[1], axis_separation, expected, pushes)
    cost, weight, pull = _normal_equations(seen, motion)
    damping = 1e-3
    for _ in range(_MOST_STEPS):
        damped = weight + damping * np.diag(np.diagonal(weight))
        change = solve_linear(damped, pull[:, None])[:, 0]
        tried = _moved(motion, change)
        after = _normal_equations(seen, tried)
        if after[0] <= cost:
            motion, (cost, weight, pull), damping = tried, after, 0.1 * damping
            if float((change * applied(weight, change)).sum()) < _SAME**2:
                break
        else:
            damping = 10.0 * damping
    if not cost < 2.0 * float(gammainccinv(1.5 * len(own), _CHANCE)):
        raise InputError(f"the first visits show no even motion of '{name}'.", remedy="Begin later.")
    # Of a turn that is quite open, as about the line of all targets so far, rounding may say anything.
    if not 0.0 <= _bends(inverse(weight), points, own) <= _STRAIGHT:
        raise InputError(f"the first visits leave the attitude of '{name}' open.", remedy="Begin later.")
    return _back(motion, span, pushes)


def _back(motion: FirstMotion, span: tuple[float, float], pushes: Sequence[Push]) -> FirstMotion:
    """Return at the first time of a span the motion that an object has at its last."""
    step = span[0] - span[1]
    position, velocity = motion.position + step * motion.velocity, motion.velocity
    for push in pushes:
        if span[0] <= push.time <= span[1]:
            position = position - (span[0] - push.time) * push.velocity
            velocity = velocity - push.velocity
    turned = product(rotation_from_vector(step * motion.turn_rate), motion.rotation)
    return FirstMotion(position, turned, velocity, motion.turn_rate)


class _Seen(NamedTuple):
    """n visits as arrays.

    ``point`` on the object [m], (n, 3); ``step`` from the time that is asked for [s], (n,); by how much the way until
    then is ``pushed`` from an even one [m], (n, 3); ``measured`` (Θ, φ, R), (n, 3), and ``weight``, the inverse of the
    covariance of these, (n, 3, 3).
    """

    point: Array
    step: Array
    pushed: Array
    measured: Array
    weight: Array
    axis_separation: float
    expected: Expected


def _seen(
    points: Mapping[str, ArrayLike],
    visits: Sequence[PatternRecord],
    time: float,
    axis_separation: float,
    expected: Expected,
    pushes: Sequence[Push],
) -> _Seen:
    """Return visits as arrays; what acts on the object between a visit and the time that is asked for adds to its σ."""
    when = np.array([record.time for record in visits])
    measured = np.array([record.position for record in visits])
    point = np.array([points[record.target] for record in visits], dtype=np.float64)
    since = np.abs(when - time) ** 3 / 3.0
    loose = expected.acceleration * since + expected.turn_acceleration * since * (point**2).sum(axis=1)
    pushed = np.zeros_like(point)
    for push in pushes:
        if push.time <= time:
            before = np.minimum(when - push.time, 0.0)
            pushed -= before[:, None] * push.velocity
            loose += (before * push.sigma) ** 2
    _, gradients = project(_places(measured, axis_separation).T, axis_separation, with_range=True)
    slope = gradients.transpose(2, 1, 0)
    whole = np.array([record.covariance for record in visits])
    whole = whole + loose[:, None, None] * product(slope, np.swapaxes(slope, 1, 2))
    return _Seen(point, when - time, pushed, measured, inverse(whole), axis_separation, expected)


def _normal_equations(seen: _Seen, motion: FirstMotion) -> tuple[float, Array, Array]:
    """Return χ² of visits and rates along a motion, its second derivatives, and its slope downwards.

    In errors (δt, δω, δv, δ rate) at the time that is asked for.
    """
    step = seen.step[:, None]
    turned, bent = rotation_from_vector(step * motion.turn_rate), turn_jacobian(step * motion.turn_rate)
    arm = applied(product(turned, motion.rotation), seen.point)
    place = motion.position + step * motion.velocity + seen.pushed + arm
    wanted, gradients = project(place.T, seen.axis_separation, with_range=True)
    turns, even = -cross_matrix(arm), np.zeros((len(arm), 3, 3)) + np.eye(3)
    step = step[..., None]
    parts = [even, product(turns, turned), step * even, step * product(turns, bent)]
    slope = product(gradients.transpose(2, 1, 0), np.concatenate(parts, axis=2))
    away = seen.measured - wanted.T
    rates = np.concatenate([np.zeros(6), motion.velocity, motion.turn_rate])
    known = np.repeat([0.0, 0.0, seen.expected.fastest**-2.0, seen.expected.fastest_turn**-2.0], 3)
    back = product(np.swapaxes(slope, 1, 2), seen.weight)
    cost = float((away * applied(seen.weight, away)).sum() + (known * rates**2).sum())
    weight = product(back, slope).sum(axis=0) + np.diag(known)
    return cost, weight, applied(back, away).sum(axis=0) - known * rates


def _moved(motion: FirstMotion, change: Array) -> FirstMotion:
    """Return a motion with errors (δt, δω, δv, δ rate) added."""
    shift, turn, speed, rate = change.reshape(4, 3)
    turned = product(rotation_from_vector(turn), motion.rotation)
    return FirstMotion(motion.position + shift, turned, motion.velocity + speed, motion.turn_rate + rate)


def _bends(covariance: Array, points: Mapping[str, ArrayLike], visits: Sequence[PatternRecord]) -> float:
    """Return how far a turn by its σ bends the ways of an object's targets, over what visits err across the sight.

    As it will be at the next visit, after the mean time between these.
    """
    pause = (visits[-1].time - visits[0].time) / (len(visits) - 1)
    corners = np.array(list(points.values()), dtype=np.float64)
    arm = np.sqrt(((corners - corners.mean(axis=0)) ** 2).sum(axis=1).max())
    turns, rates = slice(3, 6), slice(9, 12)
    now, both = (np.trace(covariance[turns, other]) for other in (turns, rates))
    later = now + 2.0 * pause * both + pause**2 * np.trace(covariance[rates, rates])
    across = min(one.position[2] * np.sqrt(np.trace(one.covariance[:2, :2])) for one in visits)
    return float(0.5 * arm * later / across)


def _rough(
    name: str,
    points: Mapping[str, ArrayLike],
    visits: Sequence[PatternRecord],
    time: float,
    axis_separation: float,
    expected: Expected,
) -> FirstMotion:
    """Return a motion to start from: rates by the ways of targets, and the pose of their last places, carried on."""
    last = {record.target: record for record in visits}
    if len(last) < 3:
        raise InputError(
            f"of '{name}' {len(last)} targets were measured.", remedy="Begin when three are tracked."
        )
    sighted = list(last.values())
    places = _places(np.array([record.position for record in sighted]), axis_separation)
    middle = places.mean(axis=0)
    speed, turn = _rates(visits, middle, axis_separation, expected)
    waits = time - np.array([record.time for record in sighted])
    carried = places + waits[:, None] * (speed + np.cross(turn, places - middle))
    corners = np.array([points[target] for target in last], dtype=np.float64)
    rotation, position = point_fit(
        corners.T[:, :, None], carried.T[:, :, None], np.ones((len(last), 1), dtype=bool)
    )
    moving = speed + np.cross(turn, position[:, 0] - carried.mean(axis=0))
    return FirstMotion(position[:, 0], rotation[:, :, 0], moving, turn)


def _rates(
    visits: Sequence[PatternRecord], middle: Array, axis_separation: float, expected: Expected
) -> tuple[Array, Array]:
    """Return velocity at a point and rate of turn by the ways of targets from their first visits to later ones."""
    first: dict[str, PatternRecord] = {}
    known = np.repeat([expected.fastest**-2.0, expected.fastest_turn**-2.0], 3)
    weight, pull = np.diag(known), np.zeros(6)
    for record in visits:
        begun = first.setdefault(record.target, record)
        if record.time > begun.time:
            step = record.time - begun.time
            here, there = _places(np.array([begun.position, record.position]), axis_separation)
            turns = -cross_matrix(0.5 * (here + there) - middle)
            slope = step * np.concatenate([np.eye(3), turns], axis=1)
            across = record.position[2] ** 2 * np.trace(record.covariance[:2, :2])
            variance = 2.0 * (across + record.covariance[2, 2])
            weight = weight + product(slope.T, slope) / variance
            pull = pull + applied(slope.T, there - here) / variance
    rates = solve_linear(weight, pull[:, None])[:, 0]
    return rates[:3], rates[3:]


def _places(measured: Array, axis_separation: float) -> Array:
    """Return the places of measured (Θ, φ, R) [m], shape (n, 3) each."""
    theta, phi, reach = measured.T
    return np.stack(coordinates(reach, theta, phi, axis_separation), axis=1)
