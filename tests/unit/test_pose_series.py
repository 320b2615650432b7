"""Sightings at a common time, and poses over time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scanner_sim.frames import rotation_about
from scanner_sim.pose.carried import FARTHEST, carried, rounds_of
from scanner_sim.pose.series import PoseSeries, relative_series
from scanner_sim.pose.settings import PoseSettings
from scanner_sim.pose.status import PoseStatus

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


def test_a_method_named_twice_is_a_fault() -> None:
    (fault,) = PoseSettings(methods=("uv",)).model_copy(update={"methods": ("uv", "uv")}).contradictions()
    assert fault.place == "methods"
    assert "twice" in fault.problem
