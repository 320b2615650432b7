"""One step of the pose filter against a plain Kalman filter whose derivatives are differences."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.analytic import geometry as judge
from scanner_sim.optics.deflection import WOBBLE_LASTS, wobble_correlation
from scanner_sim.pose.filter import FilterModel, FilterState
from scanner_sim.pose.pixel_process import SHARES, SPREAD, moved_on
from scanner_sim.tracking.errors import ErrorParts, pixel_correlation
from scanner_sim.tracking.record import PatternRecord, TrackStatus
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import Refusal, TrackMode

Array = NDArray[np.float64]

D = 0.05
POINTS = {"a": [-0.5, -0.4, 0.1], "b": [0.5, -0.3, 0.0], "c": [0.1, 0.6, -0.2]}
FILTER = FilterModel({"node": POINTS}, D, acceleration=2e-4, turn_acceleration=3e-3)
BIASES = 14 * 3 + 1
SIZE = 12 + BIASES


def parts(white: Array) -> ErrorParts:
    one = np.ones(())
    root = np.random.default_rng(4).normal(size=(3, 3)) * np.array([[2e-5], [3e-5], [4e-4]])
    return ErrorParts(
        white=white, surface=root @ root.T + np.diag([1e-10, 1e-10, 1e-8]), turn=0.02 * one, approach=0.003 * one,
        range_fades=1.7 * one, pixels=9e-8 * one,
        image=44.0 * one, image_width=0.9 * one, wobble=16e-12 * one, wobble_time=0.05 * one, wobble_angle=0.06 * one,
        drift=np.array([2e-5, -3e-5]), common=np.zeros((3, 0)),
        dither=np.stack([0.1 * white, 0.05 * white]), dwell_place=0.3 * one,
        dwell_step=2.1 * one, offset=np.array([0.15, -0.08]),
    )  # fmt: skip


def record(target: str, time: float, place: Array) -> PatternRecord:
    """Return a visit that measured a place, with all parts of its error."""
    white = np.array([[4e-10, 1e-10, 2e-9], [1e-10, 6e-10, -1e-9], [2e-9, -1e-9, 1e-6]])
    errors = parts(white)
    nothing = np.zeros((1, 0))
    samples = PatternSamples(*(nothing for _ in range(7)), status=np.zeros((1, 0), dtype=np.uint8))
    made: dict[str, Any] = {
        "number": 0, "target": target, "time": time, "mode": TrackMode.TRACK, "after": TrackMode.TRACK,
        "refusal": Refusal.NONE, "status": TrackStatus.MEASURED, "amplitude": 0.01, "centre": place[:2],
        "position": place, "covariance": errors.whole, "errors": errors, "point": place, "point_covariance": white,
        "truth": place, "truth_point": place, "samples": samples,
    }  # fmt: skip
    return PatternRecord(**made)


def state(*, resting: bool = False) -> FilterState:
    """Return a state with all its numbers different and a full covariance."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(SIZE, SIZE)) * 0.3 + np.eye(SIZE)
    scale = np.concatenate([np.repeat([3e-3, 2e-3, 4e-3, 5e-3], 3), np.ones(BIASES)])
    moving = 0.0 if resting else 1.0
    return FilterState(
        time=10.0,
        position=np.array([[0.6, -0.4, 7.0]]),
        rotation=Rotation.from_rotvec([0.2, -0.3, 0.4]).as_matrix()[None],
        velocity=moving * np.array([[0.01, -0.02, 0.03]]),
        turn_rate=moving * np.array([[0.05, 0.04, -0.06]]),
        bias=rng.normal(size=BIASES),
        covariance=(root @ root.T) * np.outer(scale, scale),
    )


def moved(start: FilterState, change: Array) -> FilterState:
    """Return a state with errors (δt, δω, δv, δ rate, biases) added."""
    turned = Rotation.from_rotvec(change[3:6]).as_matrix() @ start.rotation[0]
    return replace(
        start,
        position=start.position + change[:3],
        rotation=turned[None],
        velocity=start.velocity + change[6:9],
        turn_rate=start.turn_rate + change[9:12],
        bias=start.bias + change[12:],
    )


def seen(now: FilterState, target: str, errors: ErrorParts) -> Array:
    """Return what would be measured: the judge's place, and what the biases make of it."""
    point = now.rotation[0] @ np.array(POINTS[target]) + now.position[0]
    r, theta, phi = judge.shot_from_point(point, D)
    own = now.bias[14 * list(POINTS).index(target) :][:14]
    place = np.array([float(theta), float(phi), float(r)])
    place += np.linalg.cholesky(errors.surface + np.diag([1e-18, 1e-18, 1e-14])) @ own[:3]
    place[:2] += np.sqrt(errors.wobble) * own[3:5]
    place[2] += np.sqrt(errors.pixels) * (SHARES @ own[5:8])
    turn = 2.0 * np.pi * 0.3
    waves = np.cos(turn) * own[8:11] + np.sin(turn) * own[11:14]
    place += np.linalg.cholesky(errors.dither[0] + np.diag([1e-24, 1e-24, 1e-20])) @ waves
    place[:2] += errors.drift * now.bias[-1]
    return np.asarray(place)


@pytest.mark.parametrize("target", list(POINTS))
def test_a_visit_at_the_same_time_is_a_plain_update(target: str) -> None:
    """Claim: K = P Hᵀ (H P Hᵀ + R)⁻¹ with H of place and biases, R the white part without that of the dwells' places;
    P in Joseph's form."""
    now = state()
    errors = record(target, now.time, np.zeros(3)).errors
    truth = seen(now, target, errors) + np.array([3e-5, -4e-5, 2e-3])
    visit = record(target, now.time, truth)
    after = FILTER.updated(now, visit)
    steps = np.concatenate([np.full(12, 1e-6), np.full(BIASES, 1e-3)])
    slope = np.stack(
        [
            (seen(moved(now, h), target, errors) - seen(moved(now, -h), target, errors)) / (2.0 * h.sum())
            for h in np.diag(steps)
        ],
        axis=1,
    )
    noise = visit.errors.white - visit.errors.dither[0]
    spread = slope @ now.covariance @ slope.T + noise
    gain = now.covariance @ slope.T @ np.linalg.inv(spread)
    change = gain @ (truth - seen(now, target, errors))
    wanted = moved(now, change)
    scale = np.sqrt(np.diag(now.covariance))
    np.testing.assert_allclose(after.position, wanted.position, atol=1e-6 * scale[0])
    np.testing.assert_allclose(after.rotation, wanted.rotation, atol=1e-6 * scale[3])
    np.testing.assert_allclose(after.velocity, wanted.velocity, atol=1e-6 * scale[6])
    np.testing.assert_allclose(after.turn_rate, wanted.turn_rate, atol=1e-6 * scale[9])
    np.testing.assert_allclose(after.bias, wanted.bias, atol=1e-6)
    keep = np.eye(SIZE) - gain @ slope
    covariance = keep @ now.covariance @ keep.T + gain @ noise @ gain.T
    np.testing.assert_allclose(
        after.covariance / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=1e-6
    )


@pytest.mark.parametrize("step", [0.3, -0.2])
def test_the_rigid_part_moves_at_steady_rates(step: float) -> None:
    """Claim: position and attitude go on with their rates, errors with them, and white accelerations are added. What an
    error of a turn rate makes of the attitude is that of exp([(ω + δ) Δ]×), by differences.

    To a time before, what is unknown grows likewise: its place is Δ behind the rate's, with the sign of Δ.
    """
    now = state()
    ahead = FILTER.predicted(now, record("a", now.time + step, np.array([0.08, -0.06, 7.1])))
    turn = Rotation.from_rotvec(step * now.turn_rate[0]).as_matrix()
    np.testing.assert_allclose(ahead.position, now.position + step * now.velocity)
    np.testing.assert_allclose(ahead.rotation[0], turn @ now.rotation[0], atol=1e-14)
    onward = np.eye(12)
    onward[:3, 6:9] = onward[3:6, 9:12] = step * np.eye(3)
    onward[3:6, 3:6] = turn
    for axis, change in enumerate(1e-6 * np.eye(3)):
        later, sooner = (
            Rotation.from_rotvec(step * (now.turn_rate[0] + sign * change)) for sign in (1.0, -1.0)
        )
        onward[3:6, 9 + axis] = (later * sooner.inv()).as_rotvec() / 2e-6
    assert np.abs(onward[3:6, 9:12] - step * np.eye(3)).max() > 5e-3 * abs(step)
    wanted = onward @ now.covariance[:12, :12] @ onward.T
    for first, q in ((0, 2e-4), (3, 3e-3)):
        for axis in range(first, first + 3):
            wanted[axis, axis] += q * abs(step) ** 3 / 3.0
            wanted[axis + 6, axis + 6] += q * abs(step)
            wanted[axis, axis + 6] += q * step * abs(step) / 2.0
            wanted[axis + 6, axis] += q * step * abs(step) / 2.0
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(
        ahead.covariance_of() / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-9
    )


def test_two_half_steps_of_a_resting_object_are_one() -> None:
    now = state(resting=True)
    visits = [record("a", now.time + after, np.array([0.08, -0.06, 7.1])) for after in (0.1, 0.2)]
    halves, whole = (
        FILTER.predicted(FILTER.predicted(now, visits[0]), visits[1]),
        FILTER.predicted(now, visits[1]),
    )
    scale = np.sqrt(np.diag(whole.covariance))
    # Biases, too: ρ of two steps is that of both together, and the noise what is lost.
    same = np.outer(scale, scale)
    np.testing.assert_allclose(halves.covariance / same, whole.covariance / same, atol=1e-9)
    np.testing.assert_allclose(halves.bias, whole.bias, atol=1e-12)


def test_biases_fade_each_in_its_own_way() -> None:
    """Claim: surfaces by the turn about the sight over ``turn`` and by the range over ``approach``, what is the range's
    own ``range_fades`` times as soon and what goes with the dwells' places three times, wobble by time, pixels by the
    image, drift never."""
    now, step = state(), 0.02
    visit = record("b", now.time + step, np.array([0.15, -0.1, 7.0]))
    ahead = FILTER.predicted(now, visit)
    places = []
    for when in (now, ahead):
        points = np.array(
            [when.rotation[0] @ np.array(point) + when.position[0] for point in POINTS.values()]
        )
        r, theta, _ = judge.shot_from_point(points, D)
        depth = visit.position[2] / np.cos(visit.position[0])
        places.append((points, 44.0 * depth * np.cos(theta) / r, r))
    (_, before, range_before), (points, image, ranges) = places
    onward = np.eye(BIASES)
    for number in range(3):
        sight = points[number] / np.linalg.norm(points[number])
        roll = abs(float(now.turn_rate[0] @ sight))
        way = roll * step / 0.02 + abs(ranges[number] - range_before[number]) / 0.003
        onward[14 * number :][:3, 14 * number :][:, :3] = np.diag(np.exp(-way * np.array([1.0, 1.0, 1.7])))
        wobble = np.exp(-step / (WOBBLE_LASTS * 0.05))
        onward[14 * number + 3 :][:2, 14 * number + 3 :][:, :2] = wobble * np.eye(2)
        gone = np.sqrt(np.mean((image - before) ** 2))
        onward[14 * number + 5 :][:3, 14 * number + 5 :][:, :3] = moved_on(float(gone) / 0.9)
        onward[14 * number + 8 :][:6, 14 * number + 8 :][:, :6] = np.exp(-3.0 * way) * np.eye(6)
    np.testing.assert_allclose(ahead.bias, onward @ now.bias, rtol=1e-9)
    # What fades comes back as noise with the correlation between targets.
    _, theta, phi = judge.shot_from_point(points, D)
    stay = np.eye(BIASES)
    for axis, angle in ((3, phi), (4, theta)):
        stay[axis:-1:14, axis:-1:14] = wobble_correlation((angle[:, None] - angle) / 0.06)
    alike = pixel_correlation((image[:, None] - image) / 0.9)
    for one in range(3):
        for other in range(3):
            stay[5 + one : -1 : 14, 5 + other : -1 : 14] = SPREAD[one, other] * alike
    noise = ahead.covariance[12:, 12:] - onward @ now.covariance[12:, 12:] @ onward.T
    np.testing.assert_allclose(noise, stay - onward @ stay @ onward.T, atol=1e-9)


def test_what_was_not_followed_changes_nothing() -> None:
    now = state()
    good = record("a", now.time, np.array([0.08, -0.06, 7.1]))
    for bad in (
        replace(good, status=TrackStatus.REFUSED),
        replace(good, after=TrackMode.ACQUIRE),
        replace(good, target="stranger"),
    ):
        assert FILTER.updated(now, bad) is now


@pytest.mark.parametrize("name", ["first", "other"])
def test_what_is_seen_of_one_body_corrects_another_by_what_they_share(name: str) -> None:
    """Claim: of two bodies that one is corrected which carries the target, as if it were alone, and the other by P₀₁
    P₁₁⁻¹ of that: exact, as no error but those of the first enters the visit. In time each moves as it would alone.

    Bodies stand in the state as they were given, whichever of the names comes first by the alphabet.
    """
    others = {"p": [0.3, 0.1, 0.0], "q": [-0.2, 0.4, 0.1], "r": [0.0, -0.3, 0.2]}
    both = FilterModel({name: others, "node": POINTS}, D, acceleration=2e-4, turn_acceleration=3e-3)
    rng, lone, size = np.random.default_rng(12), state(), 2 * 12 + 14 * 6 + 1
    own = np.concatenate([np.arange(12, 24), np.arange(24 + 42, size)])
    rest = np.setdiff1d(np.arange(size), own)
    scale = np.concatenate([np.tile(np.repeat([3e-3, 2e-3, 4e-3, 5e-3], 3), 2), np.ones(85)])
    root = 0.3 * rng.normal(size=(size, size)) + np.eye(size)
    covariance = (root @ root.T) * np.outer(scale, scale)
    now = FilterState(
        time=lone.time,
        position=np.concatenate([[[-0.5, 0.2, 6.0]], lone.position]),
        rotation=np.concatenate([Rotation.from_rotvec([[-0.4, 0.1, 0.2]]).as_matrix(), lone.rotation]),
        velocity=np.concatenate([[[0.02, 0.01, -0.03]], lone.velocity]),
        turn_rate=np.concatenate([[[-0.03, 0.05, 0.02]], lone.turn_rate]),
        bias=np.concatenate([rng.normal(size=42), lone.bias]),
        covariance=covariance,
    )
    lone = replace(lone, covariance=covariance[np.ix_(own, own)])
    place = seen(lone, "b", record("b", lone.time, np.zeros(3)).errors) + np.array([3e-5, -4e-5, 2e-3])
    visit = record("b", lone.time, place)
    after, alone = both.updated(now, visit), FILTER.updated(lone, visit)
    near = 1e-9 * np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(after.position[1], alone.position[0], atol=near[0])
    np.testing.assert_allclose(after.rotation[1], alone.rotation[0], atol=near[3])
    np.testing.assert_allclose(after.bias[42:], alone.bias, atol=1e-9)
    size_of = np.outer(near, near) * 1e10
    np.testing.assert_allclose(
        (after.covariance / size_of)[np.ix_(own, own)],
        alone.covariance / size_of[np.ix_(own, own)],
        atol=1e-8,
    )
    assert after.surprise == pytest.approx(alone.surprise, rel=1e-9)
    turned = Rotation.from_matrix(alone.rotation[0] @ lone.rotation[0].T).as_rotvec()
    change = np.concatenate(
        [
            (alone.position - lone.position)[0], turned,
            (alone.velocity - lone.velocity)[0], (alone.turn_rate - lone.turn_rate)[0], alone.bias - lone.bias,
        ]
    )  # fmt: skip
    wanted = covariance[np.ix_(rest, own)] @ np.linalg.solve(covariance[np.ix_(own, own)], change)
    np.testing.assert_allclose(after.position[0] - now.position[0], wanted[:3], atol=1e-6 * near[0] * 1e9)
    spin = Rotation.from_matrix(after.rotation[0] @ now.rotation[0].T).as_rotvec()
    np.testing.assert_allclose(spin, wanted[3:6], atol=1e-6 * near[3] * 1e9)
    np.testing.assert_allclose(after.velocity[0] - now.velocity[0], wanted[6:9], atol=1e-6 * near[6] * 1e9)
    np.testing.assert_allclose(after.bias[:42] - now.bias[:42], wanted[12:], atol=1e-6)
    later = record("b", lone.time + 0.3, place)
    ahead, one = both.predicted(now, later), FILTER.predicted(lone, later)
    np.testing.assert_allclose(ahead.position[1], one.position[0], rtol=1e-12)
    np.testing.assert_allclose(ahead.rotation[1], one.rotation[0], atol=1e-14)
    np.testing.assert_allclose(ahead.position[0], now.position[0] + 0.3 * now.velocity[0], rtol=1e-12)
    rigid = np.ix_(own[:12], own[:12])
    np.testing.assert_allclose(
        (ahead.covariance / size_of)[rigid], one.covariance_of() / size_of[rigid], atol=1e-8
    )


def test_visits_at_one_instant_leave_rates_as_they_were_expected() -> None:
    """Claim: place and attitude are told, and of velocity and turn what is believed before, each its own."""
    now, model = state(), replace(FILTER, fastest=0.03, fastest_turn=0.7)
    visits = []
    for target in POINTS:
        errors = record(target, now.time, np.zeros(3)).errors
        still = replace(now, bias=np.zeros(BIASES))
        visits.append(record(target, now.time, seen(still, target, errors)))
    begun = model.begin(visits)
    np.testing.assert_allclose(begun.position, now.position, atol=1e-3)
    np.testing.assert_allclose(begun.velocity, 0.0, atol=1e-9)
    rates = np.repeat([0.03, 0.7], 3) ** 2
    np.testing.assert_allclose(begun.covariance_of()[6:, 6:], np.diag(rates), rtol=1e-9, atol=1e-12)
    assert (np.diag(begun.covariance_of())[:6] < 1e-4).all()


def test_objects_with_three_targets_are_followed() -> None:
    """Claim: by the positions of their targets; an object with two tells no attitude and is left out."""
    counts = {"one": 3, "two": 2, "four": 4}
    targets: Any = [
        SimpleNamespace(object=name, name=f"{name}/{k}", centre=np.array([k, len(name), 0.5]))
        for name, count in counts.items()
        for k in range(count)
    ]
    model = FilterModel.of(targets, 0.07, acceleration=3e-5, turn_acceleration=4e-5)
    assert {name: list(own) for name, own in model.objects.items()} == {
        "one": ["one/0", "one/1", "one/2"],
        "four": ["four/0", "four/1", "four/2", "four/3"],
    }
    np.testing.assert_array_equal(model.objects["four"]["four/2"], [2.0, 4.0, 0.5])
    assert (model.axis_separation, model.acceleration, model.turn_acceleration) == (0.07, 3e-5, 4e-5)
