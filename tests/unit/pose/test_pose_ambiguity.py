"""Which poses are called ambiguous: exact fits always, and others only beyond what their covariance covers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry
from scanner_sim.pose import solution
from scanner_sim.pose.adjustment import PoseFit
from scanner_sim.pose.identify_dots import _bare
from scanner_sim.pose.observations import Prior
from scanner_sim.pose.solution import Solution, _try_again, _with_others
from scanner_sim.pose.starts import _by_cost, _starts
from scanner_sim.pose.status import PoseStatus

Array = NDArray[np.float64]

D = 0.05
LIMIT = 13.816
"""χ² of two angles that one of a thousand exceeds: −2 ln 0.001."""
SQUARE = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])


def angles(points: Array, turn: Array, place: Array) -> Array:
    """Return (Θ, φ) by the judge's geometry, shape (2, ..., n)."""
    placed = np.einsum("...ij,nj->...ni", turn, points) + place[..., None, :]
    _, theta, phi = geometry.shot_from_point(placed, D)
    return np.stack([theta, phi])


def statuses(points: Array, turn: Array, place: Array, sigma: float) -> Array:
    found = estimate_pose(
        points, *angles(points, turn, place), sigma_theta=sigma, sigma_phi=sigma, axis_separation=D
    )
    return np.asarray(found.status)


def test_three_targets_are_ambiguous_however_wide_their_covariance() -> None:
    """Claim: nothing checks an exact fit; with angles known to 20 mrad the covariance covers the other poses, too."""
    rng = np.random.default_rng(11)
    turn = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (300, 3))).as_matrix()
    place = np.column_stack([rng.uniform(-1.0, 1.0, (300, 2)), rng.uniform(4.0, 9.0, 300)])
    assert not (statuses(SQUARE[:3], turn, place, 20e-3) == PoseStatus.VALID).any()


def test_both_tilts_of_a_plane_are_one_pose_while_the_covariance_covers_them() -> None:
    """Claim: a square of 1 m, 9 m ahead and tilted by 30°, has two poses. Angles of 50 µrad tell which is right; of
    3 mrad they do not, and both differ by more than the covariance covers; of 20 mrad it covers them, for a tilt is
    then known to no better than 2 σR²/a² = 3 rad."""
    tilted = Rotation.from_rotvec([[0.0, 0.52, 0.0]]).as_matrix()
    for place in ([0.0, 0.0, 9.0], [0.1, 0.2, 9.0]):
        found = [int(statuses(SQUARE, tilted, np.array([place]), sigma)[0]) for sigma in (50e-6, 3e-3, 20e-3)]
        assert found == [PoseStatus.VALID, PoseStatus.AMBIGUOUS, PoseStatus.VALID]


def test_a_corner_eight_sigma_off_agrees_if_the_fit_of_all_hides_it() -> None:
    """Claim: with an angle of one corner 8 σ off, all seven targets stay where the fit of all leaves each of them no
    more than χ²(99.9 %) = 13.8; where it leaves one more, the corner alone goes.

    Expected: of the error e the fit leaves e − J (JᵀJ)⁻¹Jᵀe, J by differences of the judge's geometry, for any turns;
    those that leave within 0.05 of the limit are not judged, for J bends by some 10⁻³.
    """
    points = np.vstack([SQUARE, [[0.1, 0.2, 0.6], [0.2, -0.3, -0.5], [-0.2, 0.1, 0.3]]])
    place, count = np.array([0.3, -0.2, 6.0]), 24
    turns = Rotation.from_rotvec(np.random.default_rng(4).uniform(-0.4, 0.4, (count, 3)))
    values = angles(points, turns.as_matrix(), np.tile(place, (count, 1)))
    wrong, of = np.arange(count) % 4, np.arange(count) // 4 % 2
    left = np.empty(count)
    for pose, turn in enumerate(turns):

        def moved(step: Array, turn: Any = turn) -> Array:
            return angles(points, (Rotation.from_rotvec(step[:3]) * turn).as_matrix(), place + step[3:])

        slopes = [(moved(step) - moved(-step)).ravel() / 2e-5 for step in 1e-5 * np.eye(6)]
        error = np.zeros((2, 7))
        error[of[pose], wrong[pose]] = 8.0
        fitted = np.transpose(slopes) @ np.linalg.lstsq(np.transpose(slopes), error.ravel(), rcond=None)[0]
        left[pose] = np.sum((error - fitted.reshape(2, 7)) ** 2, axis=0).max()
    values[of, np.arange(count), wrong] += 8.0 * 50e-6
    found = estimate_pose(
        points, *values, sigma_theta=50e-6, sigma_phi=50e-6, axis_separation=D, robust="ransac"
    )
    goes = (np.arange(7) == wrong[:, None]) & (left > LIMIT)[:, None]
    judged = np.abs(left - LIMIT) > 0.05
    np.testing.assert_array_equal((found.weights == 0.0)[judged], goes[judged])


@pytest.mark.parametrize(("sigmas", "kept"), [(3.4, True), (4.2, False)])
def test_a_target_agrees_within_the_quantile_of_a_thousandth(sigmas: float, kept: bool) -> None:
    """Claim: the limit is χ²(99.9 %) = 13.8 of two angles. Of s² a fit of 40 targets leaves s² (1 − h), with leverages
    h of 0.075 on the average: 10.7 of 3.4² is within it, above χ²(99 %) = 9.2, and 16.3 of 4.2² is not."""
    points = np.random.default_rng(6).uniform(-0.6, 0.6, (40, 3))
    points[0] = points.mean(axis=0)
    turn = Rotation.from_rotvec([[0.2, -0.3, 0.1]]).as_matrix()
    values = angles(points, turn, np.array([[0.3, -0.2, 6.0]]))
    values[0, 0, 0] += sigmas * 50e-6
    found = estimate_pose(
        points, *values, sigma_theta=50e-6, sigma_phi=50e-6, axis_separation=D, robust="ransac"
    )
    assert bool(found.weights[0, 0] > 0.0) is kept
    assert (found.weights[0, 1:] > 0.0).all()


def test_a_prior_is_one_of_the_starts() -> None:
    """Claim: the pose that was known before is tried as it is, its position that of the array's centre."""
    turn = Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix()
    place, centre = np.array([0.3, -0.2, 6.0]), np.array([0.1, 0.2, -0.05])
    theta, phi = angles(SQUARE, np.stack([turn] * 2), np.array([place, place + 0.1]))
    known = _bare(SQUARE + centre, np.ones((4, 2), dtype=bool), theta.T, phi.T)
    prior = Prior(turn[:, :, None], place[:, None], np.eye(6)[:, :, None])
    rotations, positions = _starts(replace(known, prior=prior), "uv", False)
    np.testing.assert_allclose(rotations[:, :, -1], np.stack([turn] * 2, axis=-1))
    np.testing.assert_allclose(positions[:, -1], np.stack([place + turn @ centre] * 2, axis=-1))


def epochs(separation: float) -> tuple[Array, Array, Array, Array]:
    """Return points, exact (Θ, φ) of twelve epochs (2, 12, n), turns and places: in turn all targets are seen, those
    of a plane, and three."""
    points = np.vstack([SQUARE, [[0.1, 0.2, 0.6], [0.2, -0.3, -0.5]]])
    rng = np.random.default_rng(7)
    turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, (12, 3))).as_matrix()
    place = np.column_stack([rng.uniform(-1.0, 1.0, (12, 2)), rng.uniform(4.0, 9.0, 12)])
    _, theta, phi = geometry.shot_from_point(
        np.einsum("bij,nj->bni", turn, points) + place[:, None], separation
    )
    values = np.stack([theta, phi])
    values[:, 1::3, 4:] = np.nan
    values[:, 2::3, 3:] = np.nan
    return points, values, turn, place


def test_each_epoch_starts_as_the_targets_that_it_sees_ask_for() -> None:
    """Claim: of epochs that see a plane and of others beside them one start of each is the pose, by beams of a common
    origin. Two of the plane would not be for the others.

    Tolerance: 10⁻⁴. Where two poses of three targets lie close together, both are roots to √ε = 10⁻⁸ times what the
    resection makes of it, up to 10⁻⁶ in a hundred epochs; starts of another kind are off by 10⁻² and more.
    """
    points, values, turn, place = epochs(0.0)
    seen = np.isfinite(values[0]).T
    known = _bare(points, seen, *np.nan_to_num(values).transpose(0, 2, 1))
    rotations, positions = _starts(known, "uv", False)
    middle = place + turn @ points.mean(axis=0)
    apart = np.abs(rotations - turn.transpose(1, 2, 0)[:, :, None]).max(axis=(0, 1))
    away = np.abs(positions - middle.T[:, None]).max(axis=0)
    assert (np.nanmin(apart + away, axis=0) < 1e-4).all()


def test_an_epoch_has_the_pose_that_it_has_alone() -> None:
    """Claim: pose and status do not depend on what the epochs estimated with it see, also of three targets, of whose
    poses, which all fit, the last bit says which is told; what sees all has the pose that made it."""
    points, values, _, place = epochs(D)
    noise = {"sigma_theta": 50e-6, "sigma_phi": 50e-6, "axis_separation": D}
    found = estimate_pose(points, *values, **noise)
    for number in range(12):
        alone = estimate_pose(points, *values[:, number], **noise)
        assert alone.status == found.status[number]
        np.testing.assert_allclose(alone.position, found.position[number], rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(alone.rotation, found.rotation[number], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.position[::3], place[::3], atol=1e-7)


@pytest.mark.parametrize(
    ("chi2", "other", "status", "mirrored"),
    [
        (np.nan, 3.0, PoseStatus.VALID, True), (900.0, 8.9, PoseStatus.VALID, True),
        (900.0, 9.1, PoseStatus.VALID, False),
        (4.0, 0.001, PoseStatus.VALID, False), (900.0, 3.0, PoseStatus.NOT_CONVERGED, False),
    ],
)  # fmt: skip
def test_an_object_fits_mirrored_where_its_mirror_image_fits_a_hundred_times_better(
    monkeypatch: pytest.MonkeyPatch, chi2: float, other: float, status: PoseStatus, mirrored: bool
) -> None:
    """Claim: of poses that fit badly, or not at all; of one that fits well nothing is asked, nor is a mirror image told
    whose pose has not settled."""
    taken: Any = SimpleNamespace(mirrored=lambda: "mirrored")
    observations: Any = SimpleNamespace(count=3, take=lambda _: taken)
    told: Any = SimpleNamespace(chi2=np.array([4.0, chi2, 5.0]), dof=np.full(3, 6))

    def solve(given: Any, *_: Any, **__: Any) -> Any:
        assert given == "mirrored"
        return SimpleNamespace(chi2=np.full(2, other), status=np.full(2, status))

    monkeypatch.setattr(solution, "solve", solve)
    assert solution.fits_mirrored(observations, "uv", "equal", told).tolist() == [False, mirrored, False]


def test_other_poses_differ_from_the_best_and_from_one_another() -> None:
    """Claim: those that settled half a standard deviation or more from the best and from each other are kept, by their
    χ²; one that fits within 9 of the best and lies apart, or has not settled, makes it doubtful; so does an exact fit.

    Set-up: a millimetre is one standard deviation; the best at 0 and four others along x [mm], of six poses.
    """
    away = np.array([[0.4, 3.0, 3.4, 20.0]] * 6).T
    away[1:3, 2] = 1.5, 1.6
    cost = np.array([[11.0, 15.0, 16.0, 25.0]] * 6).T
    cost[1:, 1], cost[1:, 3] = 30.0, (30.0, 31.0, 12.0)
    settled = np.ones((5, 6), dtype=bool)
    settled[4, 3] = False
    settled[0, 5] = False
    dof = np.array([4, 4, 4, 4, 0, 4])
    cost[1:, 4] = 30.0
    place = np.zeros((3, 5, 6))
    place[0, 1:] = 1e-3 * away
    still = np.repeat(np.eye(3)[:, :, None, None], 5, axis=2) * np.ones(6)
    ranked: Any = SimpleNamespace(
        cost=np.concatenate([np.full((1, 6), 10.0), cost]), rotation=still, position=place, settled=settled
    )
    best: Any = SimpleNamespace(
        rotation=still[:, :, 0], position=place[:, 0], settled=settled[0], cost=ranked.cost[0],
        normal=1e6 * np.eye(6)[..., None] * np.ones(6),
    )  # fmt: skip
    found = _with_others(ranked, best, np.zeros((6, 6, 6)), ranked.cost[0], dof, 4.0)
    doubtful, valid = PoseStatus.AMBIGUOUS, PoseStatus.VALID
    assert found.status.tolist() == [doubtful, valid, valid, doubtful, doubtful, PoseStatus.NOT_CONVERGED]
    kept = 1e3 * found.other_position[0]
    np.testing.assert_allclose(kept[:, 0], [3.0, 20.0, np.nan], rtol=1e-9)
    np.testing.assert_allclose(kept[:, 2], [1.5, 20.0, np.nan], rtol=1e-9)
    np.testing.assert_allclose(kept[:, 3], [3.0, np.nan, np.nan], rtol=1e-9)
    np.testing.assert_array_equal(found.other_chi2[:, 1], [30.0, 30.0, np.nan])
    assert found.dof.tolist() == dof.tolist()


def test_poses_are_ranked_by_cost_and_the_settled_ones_first() -> None:
    """Claim: however little one costs that did not settle, those that did go before it; among either the cost decides,
    and what has none comes last. All that belongs to a pose goes with it.

    Set-up: four poses of each of four, numbered by whatever belongs to them.
    """
    cost = np.array(
        [[7.0, 3.0, 5.0, 4.0], [np.nan, 9.0, 8.0, 2e6], [6.0, 5.0, np.inf, 4.0], [1.0, 2.0, 0.0, 3.0]]
    )
    settled = np.array([[1, 0, 1, 1], [0, 0, 0, 1], [0, 0, 0, 0], [1, 1, 0, 0]], dtype=bool)
    number = np.arange(4.0)[:, None] * np.ones(4)
    found = _by_cost(
        PoseFit(
            rotation=number * np.ones((3, 3, 1, 1)),
            position=number * np.ones((3, 1, 1)),
            cost=cost.T,
            normal=number * np.ones((6, 6, 1, 1)),
            slope=number * np.ones((6, 1, 1)),
            settled=settled.T,
        )
    )
    wanted = np.array([[3, 2, 0, 1], [3, 2, 1, 0], [3, 1, 0, 2], [0, 1, 2, 3]])
    for values in (found.rotation, found.position, found.normal, found.slope):
        np.testing.assert_array_equal(values, np.broadcast_to(wanted.T, values.shape))
    np.testing.assert_array_equal(found.cost.T, np.take_along_axis(cost, wanted, axis=1))
    np.testing.assert_array_equal(found.settled.T, np.take_along_axis(settled, wanted, axis=1))


def test_what_fits_as_well_from_all_starts_is_kept_for_what_it_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a pose from all starts replaces one whose χ² is the same but for rounding, for it knows more others; one
    that fits worse or has not settled does not, but any that has settled replaces one that has not, or has no χ².

    Set-up: eight poses, of which the first is not asked for again; the numbers of the new ones are 1, of the old 0.
    """
    valid, doubtful, lost = PoseStatus.VALID, PoseStatus.AMBIGUOUS, PoseStatus.NOT_CONVERGED
    status = np.array([valid, valid, valid, valid, valid, valid, lost, valid], dtype=np.int8)
    chi2 = np.array([5.0, 5.0, 5.0, 5.0, 5.0, 5.0, 5.0, np.nan])
    again = np.array([5.0, 5.0 + 1e-9, 5.0 - 1e-9, 4.0, 6.0, 5.0, 9.0, 9.0])
    new = np.array([doubtful] * 5 + [lost] + [doubtful] * 2, dtype=np.int8)

    def poses(number: float, chi2: Array, status: Any) -> Solution:
        sizes: dict[str, tuple[int, ...]] = {"rotation": (3, 3), "position": (3,), "covariance": (6, 6)}
        sizes |= {"dof": (), "other_rotation": (3, 3, 3), "other_position": (3, 3), "other_chi2": (3,)}
        parts: Any = {name: np.full((*shape, len(chi2)), number) for name, shape in sizes.items()}
        return Solution(**parts, chi2=chi2.copy(), status=status.copy())

    asked = np.arange(1, 8)
    observations: Any = SimpleNamespace(take=lambda index: index)

    def solve(index: Any, *given: Any, thorough: bool) -> Solution:
        assert index.tolist() == asked.tolist()
        assert (given, thorough) == (("uv", "equal", 0.0), True)
        return poses(1.0, again[index], new[index])

    monkeypatch.setattr(solution, "solve", solve)
    found = poses(0.0, chi2, status)
    _try_again(found, asked, observations, "uv", "equal", 0.0)
    taken = np.array([False, True, True, True, False, False, True, True])
    np.testing.assert_array_equal(found.chi2, np.where(taken, again, chi2))
    np.testing.assert_array_equal(found.status, np.where(taken, new, status))
    for name in ("rotation", "position", "covariance", "other_rotation", "other_position", "other_chi2"):
        values = getattr(found, name)
        np.testing.assert_array_equal(values, np.broadcast_to(taken, values.shape))
