"""Sightings at a common time, and poses over time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scanner_sim.frames import rotation_about
from scanner_sim.pose.carried import FARTHEST, carried, rounds_of
from scanner_sim.pose.series import PoseSeries, pose_series, relative_series
from scanner_sim.pose.settings import PoseSettings
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import vector_from_rotation
from scanner_sim.ranging.coordinates import angles_and_range

SQUARE = 0.5 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])


def sightings(rounds: int = 8, targets: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Targets in even motion: times, places, covariances, common times."""
    time = 0.04 * np.arange(rounds)[:, None] + 0.01 * np.arange(targets)
    start = np.arange(3.0 * targets).reshape(targets, 3) + 1.0
    rate = np.array([1e-3, -2e-3, 0.02]) * (1.0 + np.arange(targets)[:, None])
    covariance = np.broadcast_to(np.diag([1e-10, 4e-10, 1e-6]), (rounds, targets, 3, 3))
    return time, start + rate * time[..., None], covariance, time.mean(axis=1)


def test_even_motion_is_carried_exactly() -> None:
    time, place, covariance, at = sightings()
    moved, spread = carried(time, place, covariance, at)
    (later,) = {round(float(value), 12) for value in at - time[:, 0]}
    rate = (place[1] - place[0]) / (time[1] - time[0])[:, None]
    np.testing.assert_allclose(moved, place[:1] + rate * (at[:, None] - time[0])[..., None], rtol=1e-12)
    # The first target is seen 15 ms before the common time, of 40 ms between two visits; nobody comes after the last.
    share = later / 0.04
    np.testing.assert_allclose(spread[:-1, 0], ((1 - share) ** 2 + share**2) * covariance[:-1, 0], rtol=1e-9)
    np.testing.assert_allclose(spread[-1, 0], ((1 + share) ** 2 + share**2) * covariance[-1, 0], rtol=1e-9)
    # The last target is seen after it: the sighting before counts with it.
    np.testing.assert_allclose(spread[1:, 3], spread[:-1, 0], rtol=1e-9)


def test_a_target_that_was_missed_in_a_round_does_not_count_in_it() -> None:
    time, place, covariance, at = sightings()
    time, place = time.copy(), place.copy()
    time[3, 1], place[3, 1] = np.nan, np.nan
    moved, spread = carried(time, place, covariance, at)
    assert np.isnan(moved[3, 1]).all()
    assert np.isnan(spread[3, 1]).all()
    whole, _ = carried(*sightings())
    np.testing.assert_allclose(np.delete(moved, 3, axis=0), np.delete(whole, 3, axis=0), rtol=1e-12)


@pytest.mark.parametrize("gap", [FARTHEST - 1, FARTHEST])
def test_a_lone_sighting_says_nothing_of_the_motion(gap: int) -> None:
    time, place, covariance, at = sightings()
    time = time.copy()
    time[: 4 + gap + 1, 0] = np.nan
    time[4, 0] = 0.16
    moved, _ = carried(time, place, covariance, at)
    assert np.isfinite(moved[4, 0]).all() == (gap < FARTHEST)


def test_no_target_depends_on_another() -> None:
    time, place, covariance, at = sightings()
    every, _ = carried(time, place, covariance, at)
    one, _ = carried(time[:, 2:3], place[:, 2:3], covariance[:, 2:3], at)
    np.testing.assert_array_equal(every[:, 2:3], one)


def test_rounds_end_where_a_target_comes_again() -> None:
    assert rounds_of(["a", "b", "c", "a", "b", "c"]).tolist() == [0, 0, 0, 1, 1, 1]
    # b is dropped and taken up again.
    assert rounds_of(["a", "b", "c", "a", "c", "a", "c", "b", "a"]).tolist() == [0, 0, 0, 1, 1, 2, 2, 2, 3]
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


def test_covariances_between_ranges_are_carried_to_the_pose() -> None:
    """Σ over i, j of (∂pose/∂R_i) c_ij (∂pose/∂R_j)ᵀ, i ≠ j, with the derivatives taken by differences."""
    turned, centre = rotation_about([1.0, 2.0, 0.0], 0.3), np.array([0.4, -0.2, 8.0])
    points = SQUARE + np.outer([0.1, 0.0, 0.0, 0.2], [0.0, 0.0, 1.0])
    r, theta, phi = angles_and_range(*(points @ turned.T + centre).T, 0.05)
    sigma = np.array([20e-6, 30e-6, 1e-3])
    covariance = np.broadcast_to(np.diag(sigma**2), (1, 4, 3, 3)).copy()
    covariance[..., 0, 2] = covariance[..., 2, 0] = 0.3 * sigma[0] * sigma[2]
    shared = 1e-6 * np.array(
        [[1.0, 0.5, 0.2, -0.1], [0.5, 1.0, 0.3, 0.4], [0.2, 0.3, 1.0, 0.6], [-0.1, 0.4, 0.6, 1.0]]
    )

    def found(moved: np.ndarray, between: np.ndarray | None) -> PoseSeries:
        place = np.stack([theta, phi, r + moved], axis=-1)[None]
        return pose_series(
            "plate",
            points,
            np.zeros(1),
            place,
            covariance,
            axis_separation=0.05,
            method="joint",
            shared=between,
        )

    base = found(np.zeros(4), None)
    gains = []
    for axis in np.eye(4):
        up, down = found(1e-4 * axis, None), found(-1e-4 * axis, None)
        turn = vector_from_rotation(up.rotation @ np.swapaxes(down.rotation, 1, 2))[0]
        gains.append(np.concatenate([up.position[0] - down.position[0], turn]) / 2e-4)
    off = shared - np.diag(np.diag(shared))
    wanted = base.covariance[0] + np.array(gains).T @ off @ np.array(gains)
    got = found(np.zeros(4), shared[None]).covariance[0]
    np.testing.assert_allclose(got, wanted, atol=1e-3 * np.abs(wanted).max(axis=0).min())


def test_a_part_of_the_variance_that_lasts_is_not_averaged() -> None:
    time, place, covariance, at = sightings()
    lasting = np.full(time.shape, 0.4e-6)
    _, spread = carried(time, place, covariance, at, lasting)
    _, alone = carried(time, place, covariance, at)
    own = (alone[..., 2, 2] * 0.6e-6) / 1e-6
    np.testing.assert_allclose(spread[..., 2, 2], own + lasting, rtol=1e-9)
    np.testing.assert_allclose(spread[..., :2, :2], alone[..., :2, :2], rtol=1e-12)


def test_a_method_named_twice_is_a_fault() -> None:
    (fault,) = PoseSettings(methods=("uv",)).model_copy(update={"methods": ("uv", "uv")}).contradictions()
    assert fault.place == "methods"
    assert "twice" in fault.problem
