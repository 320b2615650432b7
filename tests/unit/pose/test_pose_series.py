"""Observations at a common time, and poses over time."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.frames import rotation_about
from scanner_sim.pose.interpolation import Interpolated, interpolate, rounds_of
from scanner_sim.pose.series import PoseSeries, _shared_by, pose_series, relative_series
from scanner_sim.pose.settings import PoseSettings
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import vector_from_rotation
from scanner_sim.pose.weights import Method
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.tracking.errors import ErrorParts

SQUARE = 0.5 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])


def observations(rounds: int = 8, targets: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Targets in even motion: times, places, covariances, common times."""
    time = 0.04 * np.arange(rounds)[:, None] + 0.01 * np.arange(targets)
    start = np.arange(3.0 * targets).reshape(targets, 3) + 1.0
    rate = np.array([1e-3, -2e-3, 0.02]) * (1.0 + np.arange(targets)[:, None])
    covariance = np.broadcast_to(np.diag([1e-10, 4e-10, 1e-6]), (rounds, targets, 3, 3))
    return time, start + rate * time[..., None], covariance, time.mean(axis=1)


def own(found: Interpolated) -> np.ndarray:
    """Covariances of single targets, shape (rounds, targets, 3, 3)."""
    target = np.arange(found.position.shape[1])
    return found.covariance[:, target, target]


def test_even_motion_is_carried_exactly() -> None:
    time, place, covariance, at = observations()
    found = interpolate(time, place, ErrorParts.all_white(covariance), at)
    moved, spread = found.position, own(found)
    (later,) = {round(float(value), 12) for value in at - time[:, 0]}
    rate = (place[1] - place[0]) / (time[1] - time[0])[:, None]
    np.testing.assert_allclose(moved, place[:1] + rate * (at[:, None] - time[0])[..., None], rtol=1e-12)
    # The first target is seen 15 ms before the common time, of 40 ms between two visits; nobody comes after the last.
    share = later / 0.04
    np.testing.assert_allclose(spread[:-1, 0], ((1 - share) ** 2 + share**2) * covariance[:-1, 0], rtol=1e-9)
    np.testing.assert_allclose(spread[-1, 0], ((1 + share) ** 2 + share**2) * covariance[-1, 0], rtol=1e-9)
    # The last target is seen after it: the observation before counts with it.
    np.testing.assert_allclose(spread[1:, 3], spread[:-1, 0], rtol=1e-9)


def test_a_target_that_was_missed_in_a_round_does_not_count_in_it() -> None:
    time, place, covariance, at = observations()
    time, place = time.copy(), place.copy()
    time[3, 1], place[3, 1] = np.nan, np.nan
    found = interpolate(time, place, ErrorParts.all_white(covariance), at)
    moved, spread = found.position, own(found)
    assert np.isnan(moved[3, 1]).all()
    assert np.isnan(spread[3, 1]).all()
    time, place, covariance, at = observations()
    whole = interpolate(time, place, ErrorParts.all_white(covariance), at).position
    np.testing.assert_allclose(np.delete(moved, 3, axis=0), np.delete(whole, 3, axis=0), rtol=1e-12)


@pytest.mark.parametrize("gap", [2, 3])
def test_a_lone_observation_says_nothing_of_the_motion(gap: int) -> None:
    """Claim: a target must be seen again within three rounds (docs/theory/pose.md)."""
    time, place, covariance, at = observations()
    time = time.copy()
    time[: 4 + gap + 1, 0] = np.nan
    time[4, 0] = 0.16
    moved = interpolate(time, place, ErrorParts.all_white(covariance), at).position
    assert np.isfinite(moved[4, 0]).all() == (gap < 3)


def test_no_target_depends_on_another() -> None:
    time, place, covariance, at = observations()
    errors = ErrorParts.all_white(covariance)
    every = interpolate(time, place, errors, at)
    one = interpolate(time[:, 2:3], place[:, 2:3], errors.at((slice(None), slice(2, 3))), at)
    np.testing.assert_array_equal(every.position[:, 2:3], one.position)
    np.testing.assert_array_equal(every.of([2]).covariance, one.covariance)


def test_some_of_the_targets_keep_what_is_known_of_them() -> None:
    """Claim: those that are named, in that order, have the places, covariances, lasting parts and common errors that
    they and their pairs had among all."""
    rng = np.random.default_rng(3)
    covariance, lasting = rng.normal(size=(2, 5, 4, 4, 3, 3))
    every = Interpolated(rng.normal(size=(5, 4, 3)), covariance, lasting, rng.normal(size=(5, 4, 3, 2)))
    chosen = [2, 0, 3]
    some = every.of(chosen)
    assert len(some.position[0]) == len(chosen)
    for i, one in enumerate(chosen):
        np.testing.assert_array_equal(some.position[:, i], every.position[:, one])
        np.testing.assert_array_equal(some.common[:, i], every.common[:, one])
        for j, other in enumerate(chosen):
            np.testing.assert_array_equal(some.covariance[:, i, j], covariance[:, one, other])
            np.testing.assert_array_equal(some.lasting[:, i, j], lasting[:, one, other])


def test_rounds_end_where_a_target_comes_again() -> None:
    assert rounds_of(["a", "b", "c", "a", "b", "c"]).tolist() == [0, 0, 0, 1, 1, 1]
    # b is dropped and taken up again.
    assert rounds_of(["a", "b", "c", "a", "c", "a", "c", "b", "a"]).tolist() == [0, 0, 0, 1, 1, 2, 2, 2, 3]
    assert rounds_of(["a", "a", "b", "b"]).tolist() == [0, 1, 1, 2]
    assert rounds_of([]).tolist() == []


def series(
    name: str, position: list[float], turn: float, status: PoseStatus = PoseStatus.VALID
) -> PoseSeries:
    rotation = rotation_about([0.0, 1.0, 0.0], turn)[None]
    placed = np.array([position])
    return PoseSeries(
        name=name,
        relative_to="",
        method="joint",
        time=np.zeros(1),
        position=placed,
        rotation=rotation,
        covariance=1e-6 * np.eye(6)[None],
        chi2=np.full(1, 5.0),
        dof=np.full(1, 6),
        targets=np.full(1, 4),
        status=np.array([status], dtype=np.int8),
        truth_position=placed,
        truth_rotation=rotation,
        lasting=np.zeros((1, 6, 6)),
        common=np.zeros((1, 6, 6)),
    )


def test_relative_poses_are_those_of_the_matrices() -> None:
    a, b = series("a", [1.0, 0.0, 8.0], 0.3), series("b", [-1.0, 0.5, 7.0], -0.2)
    found = relative_series(a, b)
    matrices = []
    for one in (a, b):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = one.rotation[0], one.position[0]
        matrices.append(matrix)
    wanted = np.linalg.inv(matrices[0]) @ matrices[1]
    np.testing.assert_allclose(found.position[0], wanted[:3, 3], atol=1e-12)
    np.testing.assert_allclose(found.rotation[0], wanted[:3, :3], atol=1e-12)
    np.testing.assert_allclose(found.error, 0.0, atol=1e-12)
    assert (found.label, found.dof[0], found.chi2[0], found.targets[0]) == ("b from a", 12, 10.0, 8)
    with pytest.raises(ValueError, match="same times"):
        relative_series(a, replace(b, time=np.ones(1)))


@pytest.mark.parametrize(
    ("first", "second", "wanted"),
    [
        (PoseStatus.VALID, PoseStatus.AMBIGUOUS, PoseStatus.AMBIGUOUS),
        (PoseStatus.AMBIGUOUS, PoseStatus.VALID, PoseStatus.AMBIGUOUS),
        (PoseStatus.TOO_FEW, PoseStatus.AMBIGUOUS, PoseStatus.TOO_FEW),
        (PoseStatus.AMBIGUOUS, PoseStatus.TOO_FEW, PoseStatus.TOO_FEW),
        (PoseStatus.HIDDEN, PoseStatus.TOO_FEW, PoseStatus.HIDDEN),
        # One pose is IMPLAUSIBLE before it is AMBIGUOUS, and NOT_CONVERGED before either.
        (PoseStatus.AMBIGUOUS, PoseStatus.IMPLAUSIBLE, PoseStatus.IMPLAUSIBLE),
        (PoseStatus.IMPLAUSIBLE, PoseStatus.AMBIGUOUS, PoseStatus.IMPLAUSIBLE),
        (PoseStatus.NOT_CONVERGED, PoseStatus.IMPLAUSIBLE, PoseStatus.NOT_CONVERGED),
        (PoseStatus.IMPLAUSIBLE, PoseStatus.NOT_CONVERGED, PoseStatus.NOT_CONVERGED),
        (PoseStatus.NOT_CONVERGED, PoseStatus.UNDETERMINED, PoseStatus.UNDETERMINED),
    ],
)
def test_a_relative_pose_has_the_status_of_the_worse_one(
    first: PoseStatus, second: PoseStatus, wanted: PoseStatus
) -> None:
    pair = [
        replace(
            one,
            status=np.array([code], dtype=np.int8),
            position=one.position + (0.0 if code.has_pose else np.nan),
        )
        for one, code in (
            (series("a", [1.0, 0.0, 8.0], 0.3), first),
            (series("b", [0.0, 0.0, 7.0], 0.0), second),
        )
    ]
    assert relative_series(*pair).status.tolist() == [wanted]


@pytest.mark.parametrize("method", ["uv", "joint"])
def test_covariances_between_targets_are_carried_to_the_pose(method: Method) -> None:
    """Σ over i, j of K_i C_ij K_jᵀ, i ≠ j, with K the derivatives of the pose by observations, taken by differences."""
    rng = np.random.default_rng(5)
    turned, centre = rotation_about([1.0, 2.0, 0.0], 0.3), np.array([0.4, -0.2, 8.0])
    points = SQUARE + np.outer([0.1, 0.0, 0.0, 0.2], [0.0, 0.0, 1.0])
    r, theta, phi = angles_and_range(*(points @ turned.T + centre).T, 0.05)
    sigma = np.array([20e-6, 30e-6, 1e-3])
    root = rng.normal(size=(12, 12)) * np.tile(sigma, 4)[:, None] / 4.0
    shared = (root @ root.T).reshape(4, 3, 4, 3).transpose(0, 2, 1, 3)
    by_calibration = shared.copy()
    alone = np.zeros((4, 4, 3, 3))
    alone[np.arange(4), np.arange(4)] = np.diag(sigma**2)
    alone[np.arange(4), np.arange(4), 0, 2] = alone[np.arange(4), np.arange(4), 2, 0] = 6e-9
    shared[np.arange(4), np.arange(4)] = alone[np.arange(4), np.arange(4)]

    def found(moved: np.ndarray, between: np.ndarray) -> PoseSeries:
        place = np.stack([theta, phi, r], axis=-1)[None] + moved
        sighted = Interpolated(place, between[None], 0.5 * between[None], root.reshape(1, 4, 3, -1))
        return pose_series("plate", points, np.zeros(1), sighted, axis_separation=0.05, method=method)

    base = found(np.zeros((4, 3)), alone)
    gains = np.zeros((4, 6, 3))
    for target in range(4):
        for axis in range(2 if method == "uv" else 3):
            step = np.zeros((4, 3))
            step[target, axis] = 0.1 * sigma[axis]
            up, down = found(step, alone), found(-step, alone)
            turn = vector_from_rotation(up.rotation @ np.swapaxes(down.rotation, 1, 2))[0]
            change = np.concatenate([up.position[0] - down.position[0], turn])
            gains[target, :, axis] = change / (0.2 * sigma[axis])
    wanted = np.einsum("iax,ijxy,jby->ab", gains, shared, gains)
    got = found(np.zeros((4, 3)), shared)
    assert base.gains is not None
    size = np.abs(gains).max(axis=0)
    assert (np.abs(base.gains[0] - gains) <= 0.01 * size).all()
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose((got.covariance[0] - wanted) / (scale[:, None] * scale), 0.0, atol=0.01)
    np.testing.assert_allclose(got.lasting, 0.5 * got.covariance, rtol=0.02, atol=1e-3 * got.covariance.max())
    # Errors of the calibration come as a root of what they make of all targets.
    wanted = np.einsum("iax,ijxy,jby->ab", gains, by_calibration, gains)
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose((got.common[0] - wanted) / (scale[:, None] * scale), 0.0, atol=0.02)


def test_what_two_objects_share_cancels_in_their_relative_pose() -> None:
    """Two objects of equal attitude whose targets have one error of φ: it moves both, not one from the other."""
    a, b = series("a", [0.0, 0.0, 8.0], 0.0), series("b", [1.0, 0.0, 8.0], 0.0)
    gains = np.zeros((1, 1, 6, 3))
    gains[0, 0, 1, 1] = 8.0
    ones = np.full((1, 2, 3, 1), 1e-4)
    common = Interpolated(
        np.zeros((1, 2, 3)), np.full((1, 2, 2, 3, 3), 1e-8), np.zeros((1, 2, 2, 3, 3)), ones
    )
    own = np.zeros((1, 6, 6))
    own[0, 1, 1] = 64.0 * 1e-8
    a, b = (replace(one, covariance=own, gains=gains) for one in (a, b))
    assert relative_series(a, b).covariance[0, 1, 1] == pytest.approx(2.0 * 64.0 * 1e-8)
    assert relative_series(a, b, common).covariance[0, 1, 1] == pytest.approx(0.0, abs=1e-15)
    # Each has an error of its own besides, of which the other knows nothing.
    apart = np.array([[2e-8, 1e-8], [1e-8, 3e-8]])
    mixed = replace(common, covariance=apart[None, :, :, None, None] * np.ones((3, 3)))
    unlike = [replace(a, covariance=2.0 * own), replace(b, covariance=3.0 * own)]
    assert relative_series(*unlike, mixed).covariance[0, 1, 1] == pytest.approx(
        (2.0 + 3.0 - 2.0) * 64.0 * 1e-8
    )
    # So it is with errors of the calibration, which move both by 8 × 0.1 mm.
    a, b = (replace(one, common=own) for one in (a, b))
    assert relative_series(a, b).common[0, 1, 1] == pytest.approx(2.0 * 64.0 * 1e-8)
    assert relative_series(a, b, common).common[0, 1, 1] == pytest.approx(0.0, abs=1e-15)
    unlike_roots = replace(common, common=ones * np.array([1.0, 2.0])[:, None, None])
    assert relative_series(a, b, unlike_roots).common[0, 1, 1] == pytest.approx((2.0 - 4.0) * 64.0 * 1e-8)


def test_what_lasts_is_not_averaged() -> None:
    time, place, covariance, at = observations()
    white = ErrorParts.all_white(0.4 * covariance)
    stays = replace(white, surface=0.5 * covariance, pixels=0.1 * covariance[..., 2, 2])
    spread = own(interpolate(time, place, stays, at))
    alone = own(interpolate(time, place, ErrorParts.all_white(covariance), at))
    wanted = 0.4 * alone + 0.5 * covariance
    wanted[..., 2, 2] += 0.1 * covariance[..., 2, 2]
    np.testing.assert_allclose(spread, wanted, rtol=1e-9)
    np.testing.assert_allclose(
        own_lasting(interpolate(time, place, stays, at)), wanted - 0.4 * alone, atol=1e-18
    )


def test_no_interpolation_makes_errors_of_the_calibration_smaller() -> None:
    """Claim: what is interpolated has the K that both have; another K at the second one counts by its share."""
    time, place, covariance, at = observations()
    moved = np.arange(6.0).reshape(3, 2) * 1e-4 + np.zeros((*time.shape, 3, 2))
    errors = replace(ErrorParts.all_white(covariance), common=moved)
    found = interpolate(time, place, errors, at)
    np.testing.assert_allclose(found.common, moved, rtol=1e-12)
    alone = interpolate(time, place, replace(errors, common=np.zeros((*time.shape, 3, 0))), at)
    np.testing.assert_allclose(
        found.lasting - alone.lasting, np.einsum("rtck,rudk->rtucd", moved, moved), rtol=1e-9, atol=1e-18
    )
    grown = replace(errors, common=moved * (1.0 + np.arange(len(time)))[:, None, None, None])
    counted = interpolate(time, place + np.arange(len(time))[:, None, None], errors, at).position
    np.testing.assert_allclose(
        interpolate(time, place, grown, at).common,
        (1.0 + counted - found.position)[..., None] * moved,
        rtol=1e-9,
    )


def test_a_slow_wobble_is_of_all_targets_and_does_not_last() -> None:
    time, place, covariance, at = observations()
    white = ErrorParts.all_white(0.0 * covariance)
    wobble = np.full(time.shape, 3e-10)
    slow = replace(white, wobble=wobble, wobble_time=1e12 + 0.0 * time, wobble_angle=1e12 + 0.0 * time)
    found = interpolate(time, place, slow, at)
    wanted = np.broadcast_to(np.diag([3e-10, 3e-10, 0.0]), found.covariance.shape)
    np.testing.assert_allclose(found.covariance, wanted, atol=1e-18)
    np.testing.assert_allclose(found.lasting, 0.0, atol=2e-20)


def own_lasting(found: Interpolated) -> np.ndarray:
    """What lasts of single targets."""
    target = np.arange(found.position.shape[1])
    return found.lasting[:, target, target]


def test_a_method_named_twice_is_a_fault() -> None:
    (fault,) = PoseSettings(methods=("uv",)).model_copy(update={"methods": ("uv", "uv")}).cross_checks()
    assert fault.location == "methods"
    assert "twice" in fault.problem


def test_true_poses_stand_beside_the_measured_ones() -> None:
    """Claim: place and attitude of the matrix that is given as true, and errors from it; without one they are
    unknown."""
    points = SQUARE + np.outer([0.1, 0.0, 0.0, 0.2], [0.0, 0.0, 1.0])
    turned, centre = rotation_about([1.0, 2.0, 0.0], 0.3), np.array([0.4, -0.2, 8.0])
    r, theta, phi = angles_and_range(*(points @ turned.T + centre).T, 0.05)
    own = np.zeros((1, 4, 4, 3, 3))
    own[:, np.arange(4), np.arange(4)] = np.diag(np.array([20e-6, 30e-6, 1e-3]) ** 2)
    place = np.stack([theta, phi, r], axis=-1)[None]
    seen = Interpolated(place, own, 0.0 * own, np.zeros((1, 4, 3, 1)))
    true = np.eye(4)[None].copy()
    true[0, :3, :3], true[0, :3, 3] = turned, centre + np.array([1e-3, -2e-3, 3e-3])
    found = pose_series("plate", points, np.zeros(1), seen, axis_separation=0.05, method="joint", truth=true)
    np.testing.assert_array_equal(found.truth_position, true[:, :3, 3])
    np.testing.assert_array_equal(found.truth_rotation, true[:, :3, :3])
    np.testing.assert_allclose(found.error[0], [-1e-3, 2e-3, -3e-3, 0.0, 0.0, 0.0], atol=1e-6)
    alone = pose_series("plate", points, np.zeros(1), seen, axis_separation=0.05, method="joint")
    assert np.isnan(alone.truth_position).all()


def test_what_two_objects_share_goes_through_both_their_gains() -> None:
    """Claim: Σ K_i C_ij K_jᵀ of the first object's two targets i and the second's two j, of the whole covariance and of
    what lasts of it, and K_i m_i (K_j m_j)ᵀ of common errors m; a number that is none counts as none."""
    random = np.random.default_rng(2)
    gains = random.normal(size=(2, 3, 2, 6, 3))
    covariance, lasting = random.normal(size=(2, 3, 4, 4, 3, 3))
    moved = random.normal(size=(3, 4, 3, 5))
    covariance[1, 0, 3, 2, 1] = np.nan
    told: Any = SimpleNamespace(covariance=covariance, lasting=lasting, common=moved)
    one, other = (SimpleNamespace(gains=part) for part in gains)
    found = _shared_by(one, other, told)  # type: ignore[arg-type]
    for row in range(3):
        for values, made in ((covariance, found[0]), (lasting, found[1])):
            wanted = sum(
                gains[0, row, i] @ np.nan_to_num(values[row, i, 2 + j]) @ gains[1, row, j].T
                for i in range(2)
                for j in range(2)
            )
            assert made is not None
            np.testing.assert_allclose(made[row], wanted, rtol=1e-9, atol=1e-9)
        first, second = (sum(gains[k, row, i] @ moved[row, 2 * k + i] for i in range(2)) for k in range(2))
        assert found[2] is not None
        np.testing.assert_allclose(found[2][row], first @ second.T, rtol=1e-9, atol=1e-9)
    assert _shared_by(one, SimpleNamespace(gains=None), told) == (None, None, None)  # type: ignore[arg-type]
