"""Poses of few targets, of planes, of lines, of hidden and of wrong targets: each case by itself, on small batches."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose import estimate, robust
from scanner_sim.pose.inputs import PosePrior, observations_from
from scanner_sim.pose.resection import planar_starts, three_point_starts
from scanner_sim.pose.solution import _few
from scanner_sim.pose.starts import _beside, _three_starts
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.weights import problem_of

Array = NDArray[np.float64]

D, SIGMA, SIGMA_RANGE = 0.05, 50e-6, 2e-3
NOISE: dict[str, Any] = {
    "sigma_theta": SIGMA,
    "sigma_phi": SIGMA,
    "sigma_range": SIGMA_RANGE,
    "axis_separation": D,
}
SQUARE = np.array([[-0.2, -0.7, 0.1], [0.8, -0.7, 0.1], [0.8, 0.3, 0.1], [-0.2, 0.3, 0.1]])
SOLID = np.vstack([SQUARE, [[0.1, 0.2, 0.6], [0.5, -0.4, -0.4], [0.2, 0.1, 0.3]]])


def measure(points: Array, turn: Array, place: Array, separation: float = D) -> Array:
    """Return (Θ, φ, R) by the judge's geometry, shape (3, ..., n)."""
    placed = np.einsum("...ij,nj->...ni", turn, points) + place[..., None, :]
    r, theta, phi = geometry.shot_from_point(placed, separation)
    return np.stack([theta, phi, r])


def attitudes(count: int) -> tuple[Array, Array]:
    """Return turns of up to a radian about any axis, and places 4 to 9 m ahead."""
    rng = np.random.default_rng(11)
    turn = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (count, 3))).as_matrix()
    return turn, np.column_stack([rng.uniform(-1.0, 1.0, (count, 2)), rng.uniform(4.0, 9.0, count)])


def given(points: Array, values: Array, separation: float = D) -> Any:
    more: dict[str, Any] = dict.fromkeys(("covariance_theta_range", "sigma_object", "prior"))
    return observations_from(points, *values, **(NOISE | more | {"axis_separation": separation}))[0]


def nearest(turns: Array, places: Array, turn: Array, place: Array) -> Array:
    """Return how far the nearest of some starts, (3, 3, k, B) and (3, k, B), is: turn [rad] and place [m] together."""
    apart = np.arccos(np.clip(0.5 * (np.einsum("ijkb,bij->kb", turns, turn) - 1.0), -1.0, 1.0))
    away = np.linalg.norm(places - place.T[:, None], axis=0)
    return np.asarray(np.nanmin(apart + away, axis=0))


def test_one_of_the_starts_of_three_targets_is_the_pose() -> None:
    """Claim: of 60 exact cases one of the starts is within 0.02 rad and m of it: the beams have no common origin."""
    turn, place = attitudes(60)
    points = SOLID[[0, 1, 4]]
    known = given(points, measure(points, turn, place))
    turns, places = three_point_starts(known, np.tile(np.arange(3)[:, None], 60))
    centre = place + turn @ points.mean(axis=0)
    assert np.quantile(nearest(turns, places, turn, centre), 0.9) < 0.02


def test_of_three_near_targets_the_poses_that_fit_all_best_are_kept() -> None:
    """Claim: three of seven targets that are about as far apart as they are away have three to eight poses. Kept are
    the four that fit the angles of all seven best, or as many as there are.

    Expected: sums of squares of the angles by the judge's geometry.
    """
    turn = attitudes(80)[0]
    place = np.column_stack([np.zeros((80, 2)), np.linspace(1.0, 2.0, 80)])
    values = measure(SOLID, turn, place)
    known = given(SOLID, values)
    three = np.tile(np.array([0, 2, 4])[:, None], 80)
    turns, places = three_point_starts(known, three)
    kept_turns, kept = _three_starts(known, three[None], 4)
    about = (
        np.einsum("ijkb,nj->kbni", turns, SOLID - SOLID.mean(axis=0)) + np.moveaxis(places, 0, -1)[:, :, None]
    )
    _, theta, phi = geometry.shot_from_point(about, D)
    off = np.sum((np.stack([theta, phi]) - values[:2, None]) ** 2, axis=(0, 3))
    fewer = 0
    for case in range(80):
        there = int(np.isfinite(off[:, case]).sum())
        best = np.argsort(np.where(np.isfinite(off[:, case]), off[:, case], np.inf))[: min(4, there)]
        np.testing.assert_allclose(kept[:, : len(best), case], places[:, best, case])
        np.testing.assert_allclose(kept_turns[..., : len(best), case], turns[..., best, case])
        fewer += there < 8
    assert fewer > 20


def test_poses_beside_a_pose_look_alike_from_afar() -> None:
    """Claim: the first start sees a plane as the pose does along parallel rays, tilted to the sight's other side; those
    behind it are turned about the length in eighths. All are turns about the place of the pose.

    Set-up: the square, and the same with a target far out, along which its length lies.
    """
    turn, place = attitudes(20)
    points = np.vstack([SQUARE, [3.0, -0.2, 0.1]])
    known = given(points, measure(points, turn, place))
    middle = points.mean(axis=0)
    centre = (place + turn @ middle).T
    fits: Any = SimpleNamespace(rotation=turn.transpose(1, 2, 0)[:, :, None], position=centre[:, None])
    rotations, positions = _beside(known, fits)
    np.testing.assert_allclose(positions, np.repeat(centre[:, None], 8, axis=1))
    made = rotations.transpose(3, 2, 0, 1)
    np.testing.assert_allclose(
        made @ made.swapaxes(-1, -2), np.broadcast_to(np.eye(3), made.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(made), 1.0)
    sight = (centre / np.linalg.norm(centre, axis=0)).T
    across = np.eye(3) - sight[:, :, None] * sight[:, None, :]
    flat = (points - middle).T
    np.testing.assert_allclose(across @ made[:, 0] @ flat, across @ turn @ flat, atol=1e-12)
    np.testing.assert_allclose(
        np.einsum("bi,bin->bn", sight, made[:, 0] @ flat),
        -np.einsum("bi,bin->bn", sight, turn @ flat),
        atol=1e-12,
    )
    along = np.linalg.svd(flat, full_matrices=False)[0][:, 0]
    for part in range(1, 8):
        wanted = turn @ Rotation.from_rotvec(0.25 * np.pi * part * along).as_matrix()
        back = turn @ Rotation.from_rotvec(-0.25 * np.pi * part * along).as_matrix()
        apart = np.minimum(*(np.abs(made[:, part] - one).max(axis=(1, 2)) for one in (wanted, back)))
        np.testing.assert_allclose(apart, 0.0, atol=1e-12)


def test_one_of_both_starts_of_a_plane_is_the_pose() -> None:
    """Claim: of 60 exact squares, seen by beams of a common origin, one of both starts is the pose: 1e-6."""
    turn, place = attitudes(60)
    known = given(SQUARE, measure(SQUARE, turn, place, 0.0), 0.0)
    turns, places = planar_starts(known)
    centre = place + turn @ SQUARE.mean(axis=0)
    assert nearest(turns, places, turn, centre).max() < 1e-6
    # A plane that is not seen squarely has two unlike ones, tilted to either side of the sight.
    tilted = np.linalg.norm(np.cross(turn[:, :, 2], centre), axis=1) > 0.3 * np.linalg.norm(centre, axis=1)
    assert tilted.sum() > 10
    apart = np.arccos(
        np.clip(0.5 * (np.einsum("ijb,ijb->b", turns[:, :, 0], turns[:, :, 1]) - 1.0), -1.0, 1.0)
    )
    assert apart[tilted].min() > 0.3


@pytest.mark.parametrize("points", [SOLID, SQUARE], ids=["solid", "square"])
@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
def test_exact_measurements_have_the_exact_pose(points: Array, method: Any) -> None:
    turn, place = attitudes(40)
    pose = estimate_pose(points, *measure(points, turn, place), method=method, **NOISE)
    np.testing.assert_allclose(pose.position, place, atol=1e-8)
    np.testing.assert_allclose(pose.rotation, turn, atol=1e-8)


def test_three_targets_alone_never_make_a_certain_pose() -> None:
    """Claim: nothing checks an exact fit, of which there are two nearly always: AMBIGUOUS, all of 300."""
    turn, place = attitudes(300)
    points = SOLID[[0, 1, 4]]
    pose = estimate_pose(points, *measure(points, turn, place)[:2], **NOISE)
    settled = pose.status != PoseStatus.NOT_CONVERGED
    assert (pose.dof == 0).all()
    assert settled.mean() > 0.9
    assert not (pose.status == PoseStatus.VALID).any()


def test_other_poses_fit_as_well_as_they_say() -> None:
    """Claim: χ² of the other pose of a square is that of its own place and attitude, off the array's centre, to 1 %."""
    turn = Rotation.from_rotvec([0.0, 0.5, 0.1]).as_matrix()
    values = measure(SQUARE, turn, np.array([0.2, 0.1, 9.0]))
    pose = estimate_pose(SQUARE, *values[:2], **NOISE)
    other = pose.alternatives
    apart = values[:2] - measure(SQUARE, other.rotation[0], other.position[0])[:2]
    # A first fit is only good enough to be ranked: to 0.001 of χ² of one step.
    assert other.chi2[0] == pytest.approx(float(np.sum(apart**2)) / SIGMA**2, rel=0.01)


def test_a_line_has_no_pose_and_a_plane_has() -> None:
    line = np.outer(np.linspace(-1.0, 1.0, 5), [1.0, 0.2, -0.3])
    turn, place = attitudes(2)
    assert (estimate_pose(line, *measure(line, turn, place), **NOISE).status == PoseStatus.COLLINEAR).all()
    square = estimate_pose(SQUARE, *measure(SQUARE, turn, place), method="joint", **NOISE)
    assert (square.status == PoseStatus.VALID).all()


@pytest.mark.parametrize(
    ("left", "status"), [(3, PoseStatus.VALID), (2, PoseStatus.TOO_FEW), (0, PoseStatus.HIDDEN)]
)
def test_hidden_targets_are_counted(left: int, status: PoseStatus) -> None:
    turn, place = attitudes(1)
    values = measure(SOLID, turn[0], place[0])
    values[:, left:] = np.nan
    assert estimate_pose(SOLID, *values, method="joint", **NOISE).status == status


@pytest.mark.parametrize("lost", [0, 1])
def test_a_target_needs_both_angles(lost: int) -> None:
    """Claim: one without Θ or φ counts as if it were not there, its range, too."""
    turn, place = attitudes(1)
    values = measure(SOLID, turn[0], place[0]) + np.outer([3e-5, 3e-5, 1e-3], np.sin(np.arange(7.0)))
    values[lost, 2] = np.nan
    found = estimate_pose(SOLID, *values, method="joint", **NOISE)
    rest = np.arange(7) != 2
    wanted = estimate_pose(SOLID[rest], *values[:, rest], method="joint", **NOISE)
    np.testing.assert_allclose(found.position, wanted.position, atol=1e-8)
    assert found.chi2 == pytest.approx(float(wanted.chi2), rel=1e-6)
    assert (found.dof, found.weights[2]) == (wanted.dof, 0.0)


@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
def test_targets_that_agree_outvote_a_wrong_one(method: Any) -> None:
    """Claim: of 40 poses of seven targets, one of them a degree or 0.2 m off, that one alone counts nothing; a target
    whose range is not known counts by its angles where these are asked."""
    turn, place = attitudes(40)
    values = measure(SOLID, turn, place)
    wrong = np.arange(40) % 7
    values[0, np.arange(40), wrong] += np.deg2rad(1.0)
    if method != "uv":
        values[2, np.arange(20), wrong[:20]] += 0.2
    if method == "joint":
        values[2, np.arange(40), (wrong + 3) % 7] = np.nan
    pose = estimate_pose(SOLID, *values, method=method, robust="ransac", **NOISE)
    np.testing.assert_allclose(pose.position, place, atol=1e-7)
    np.testing.assert_array_equal(pose.weights == 0.0, np.arange(7) == wrong[:, None])


def test_wrong_angles_of_most_targets_have_no_consensus() -> None:
    """Claim: angles of three agree with any pose, so that of seven, all degrees off in turn, none is believed."""
    turn, place = attitudes(8)
    values = measure(SOLID, turn, place)
    values[:2] += np.deg2rad(np.random.default_rng(3).uniform(-4.0, 4.0, (2, 8, 7)))
    wild = estimate_pose(SOLID, *values[:2], robust="ransac", **NOISE)
    assert (wild.status == PoseStatus.NO_CONSENSUS).all()
    good = estimate_pose(SOLID, *measure(SOLID, turn, place)[:2], robust="ransac", **NOISE)
    assert (good.status == PoseStatus.VALID).all()


def test_good_targets_are_seldom_left_out() -> None:
    """Claim: one in a thousand good targets is left out, of 2100 hence 2.1 on the mean: at most 9 but once in 10⁴."""
    turn, place = attitudes(300)
    rng = np.random.default_rng(5)
    values = measure(SOLID, turn, place)[:2] + SIGMA * rng.normal(size=(2, 300, 7))
    pose = estimate_pose(SOLID, *values, robust="ransac", **NOISE)
    assert np.count_nonzero(pose.weights == 0.0) <= 9


def test_equal_weights_tell_their_chi_squared_by_true_covariances() -> None:
    """Claim: χ² of points that count alike is Σ eᵀC⁻¹e with J C Jᵀ of eq 3, and with the survey's errors R C Rᵀ."""
    turn, place = attitudes(1)
    scatter = np.random.default_rng(6).normal(size=(3, 7))
    values = measure(SOLID, turn[0], place[0]) + scatter * np.array([[SIGMA], [SIGMA], [SIGMA_RANGE]])
    survey = np.array([1e-3, 4e-3, 2e-3])
    steps = np.diag([1e-7, 1e-7, 1e-5])

    def points_of(shots: Array) -> Array:
        return np.asarray(geometry.point_from_shot(shots[2], shots[0], shots[1], D))

    slopes = np.stack(
        [(points_of(values + s[:, None]) - points_of(values - s[:, None])) / (2.0 * s.sum()) for s in steps],
        -1,
    )
    own = np.einsum("nia,a,nja->nij", slopes, [SIGMA**2, SIGMA**2, SIGMA_RANGE**2], slopes)
    for sigma in (None, np.tile(survey, (7, 1))):
        pose = estimate_pose(SOLID, *values, method="xyz", point_weights="equal", sigma_object=sigma, **NOISE)
        along = (
            pose.rotation @ np.diag(survey**2) @ pose.rotation.T if sigma is not None else np.zeros((3, 3))
        )
        error = points_of(values) - SOLID @ pose.rotation.T - pose.position
        wanted = sum(e @ np.linalg.solve(c + along, e) for e, c in zip(error, own, strict=True))
        assert pose.chi2 == pytest.approx(float(wanted), rel=1e-4)
        # N⁻¹ Σ JᵀCJ N⁻¹ for equal weights, J = [1, −[R r]×] of each point about the object's origin.
        arms = SOLID @ pose.rotation.T
        rows = np.stack([np.hstack([np.eye(3), -_cross(arm)]) for arm in arms])
        normal = np.linalg.inv(np.einsum("nia,nib->ab", rows, rows))
        middle = np.einsum("nia,nij,njb->ab", rows, own + along, rows)
        np.testing.assert_allclose(pose.covariance, normal @ middle @ normal, rtol=1e-3, atol=1e-12)


def _cross(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def test_a_bad_fit_is_not_blamed_on_a_mirror() -> None:
    """Claim: a nearly flat array with a target 30 σ off looks as bad in a mirror, never a hundred times better; the
    mirror image of a solid one fits at least that much better, and is told."""
    flat = np.vstack([SQUARE, [[0.2, 0.1, 0.102], [0.6, -0.3, 0.099]]])
    turn, place = attitudes(40)
    values = measure(flat, turn, place)[:2]
    values[0, np.arange(40), np.arange(40) % 6] += 30.0 * SIGMA
    found = estimate_pose(flat, *values, **NOISE)
    assert not (found.status == PoseStatus.MIRRORED).any()
    assert (found.status == PoseStatus.IMPLAUSIBLE).mean() > 0.9
    mirrored = measure(SOLID * [1.0, 1.0, -1.0], turn, place)[:2]
    mirrored[:, 0] = measure(SOLID, turn[0], place[0])[:2]
    status = estimate_pose(SOLID, *mirrored, **NOISE).status
    assert status[0] == PoseStatus.VALID
    assert (status[1:] == PoseStatus.MIRRORED).all()


def test_a_pose_of_three_ranges_needs_them_all() -> None:
    """Claim: of six exact cases, of two of which one range is missing, the pose of the three measured places is the
    true one in four and none in those two, where the beams alone have one of their own."""
    turn, place = attitudes(6)
    values = measure(SOLID, turn, place)
    values[2, [1, 4], [2, 5]] = np.nan
    found = robust._poses_of(given(SOLID, values), (0, 2, 5), "joint")
    centre = place + turn @ SOLID.mean(axis=0)
    rotation, position = found[0]
    whole = np.array([True, False, True, True, False, True])
    assert np.isnan(position[:, ~whole]).all()
    np.testing.assert_allclose(position[:, whole].T, centre[whole], atol=1e-9)
    np.testing.assert_allclose(np.moveaxis(rotation, -1, 0)[whole], turn[whole], atol=1e-9)
    assert len(found) > 1
    assert np.isfinite([one[1][:, ~whole] for one in found[1:]]).all(axis=1).any(axis=0).all()


@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
def test_a_target_lies_apart_from_a_pose_of_three_by_both_their_errors(method: Any) -> None:
    """Claim: e'(1 + J C J')⁻¹e with C the inverse of J'J of the three alone, J by differences of whitened residuals.

    Set-up: five targets measured a few σ off. Tolerance: the differences' own errors.
    """
    (turn,), (place,) = attitudes(1)
    points, three = SOLID[[0, 1, 3, 4, 5]], (0, 2, 3)
    values = measure(points, turn, place)
    off = np.random.default_rng(7).normal(0.0, 3.0, values.shape) * [[SIGMA], [SIGMA], [SIGMA_RANGE]]
    known = given(points, (values + off)[:, None])
    middle = np.asarray(known.centre)[:, 0]
    at = (turn @ middle + place)[:, None]
    problem = robust._problem(known, method, (turn[..., None], at))

    def residuals(step: Array) -> Array:
        moved = (Rotation.from_rotvec(step[3:]).as_matrix() @ turn)[..., None]
        _, placed = robust.place_points(problem, moved, at + step[:3, None])
        left = problem.measured - robust.predict(problem, placed)[0]
        return np.asarray(robust.whiten(problem, left)[..., 0].T)

    steps = 1e-5 * np.eye(6)
    slopes = np.stack([(residuals(one) - residuals(-one)) / 2e-5 for one in steps], axis=-1)
    own = slopes[list(three)].reshape(-1, 6)
    covariance = np.linalg.inv(own.T @ own)
    errors = residuals(np.zeros(6))
    wanted = [
        error @ np.linalg.solve(np.eye(len(error)) + slope @ covariance @ slope.T, error)
        for error, slope in zip(errors, slopes, strict=True)
    ]
    found = robust._distances(problem, turn[..., None], at, three)[:, 0]
    np.testing.assert_allclose(found, wanted, rtol=1e-5)


def test_a_batch_in_parts_has_each_pose_once_in_its_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: also where the last part is a single pose."""
    monkeypatch.setattr(estimate, "_POSES_AT_ONCE", 2)
    monkeypatch.setattr(estimate, "_POSES_AT_LEAST", 1)
    monkeypatch.setattr(estimate, "_cores", lambda: 1)
    for count in (1, 2, 3, 4, 5):
        turn, place = attitudes(count)
        found = estimate_pose(SOLID, *measure(SOLID, turn, place), **NOISE)
        np.testing.assert_allclose(found.position, place, atol=1e-8)


def test_only_poses_of_all_targets_are_compared_with_their_mirror_image(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: with wrong targets weighed less or left out a better fit of the mirror image would say nothing."""
    asked: list[int] = []

    def none_mirrored(observations: Any, *_: Any) -> Any:
        asked.append(observations.count)
        return np.zeros(observations.count, dtype=bool)

    monkeypatch.setattr(estimate, "fits_mirrored", none_mirrored)
    turn, place = attitudes(3)
    values = measure(SOLID, turn, place)
    for how in ("ransac", "huber"):
        estimate_pose(SOLID, *values, **NOISE, robust=how)
        assert not asked
    estimate_pose(SOLID, *values, **NOISE)
    assert sum(asked) == 3


def test_three_targets_have_to_beat_all_of_them_with_residuals_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: only poses of which a target does not agree are looked at again; the sum to beat is that of all squared
    residuals, each cut at the limit, the 99.9 % of χ²: of three channels 16.27."""
    squares = np.array(
        [[1.0, 2.0, 40.0, 3.0], [0.5, 90.0, 30.0, 4.0], [2.5, 1.5, 0.5, 1.0], [0.1, 0.2, 0.3, 0.4]]
    )
    asked: list[Any] = []

    def best(chosen: Any, _: Any, limit: float, least: Any, kept: Any) -> Any:
        asked.append((chosen, limit, least))
        return kept

    monkeypatch.setattr(robust, "solve", lambda *_: SimpleNamespace(rotation=None, position=None))
    monkeypatch.setattr(robust, "_refitted", lambda *_: (squares, squares < 16.27))
    monkeypatch.setattr(robust, "_best_of_threes", best)
    seen = np.ones((4, 4), dtype=bool)
    known: Any = SimpleNamespace(seen=seen, take=lambda index: index.tolist())
    kept, enough = robust.agreeing(known, "joint")
    ((chosen, limit, least),) = asked
    assert limit == pytest.approx(16.266, abs=1e-3)
    assert chosen == [1, 2]
    np.testing.assert_allclose(least, [3.7 + limit, 0.8 + 2.0 * limit])
    np.testing.assert_array_equal(kept, squares < 16.27)
    assert enough.tolist() == [True, True, False, True]


def test_a_mirror_image_has_all_of_the_object_mirrored() -> None:
    """Claim: every target stands where its place along the object's own x has the other sign; twice is as before."""
    turn, place = attitudes(2)
    known = given(SOLID, measure(SOLID, turn, place))
    mirrored = known.mirrored()
    whole = mirrored.points + np.asarray(mirrored.centre)[:, None]
    np.testing.assert_allclose(whole[..., 0].T, SOLID * [-1.0, 1.0, 1.0], atol=1e-12)
    again = mirrored.mirrored()
    np.testing.assert_array_equal(again.points, known.points)
    np.testing.assert_array_equal(again.centre, known.centre)


def test_each_prior_of_a_batch_has_a_covariance() -> None:
    """Claim: a covariance that is not positive definite is refused, also of the second of two priors."""
    turn, place = attitudes(2)
    values = measure(SOLID, turn, place)
    good, bad = np.eye(6), np.diag([1.0, 1.0, 1.0, -1.0, 1.0, 1.0])
    for covariance in (bad[None], np.stack([good, bad])):
        prior = PosePrior(position=place, rotation=turn, covariance=covariance)
        with pytest.raises(InputError, match="not positive definite"):
            estimate_pose(SOLID, *values, **NOISE, prior=prior)


def test_arrays_nearly_on_a_line_need_all_starts() -> None:
    """Claim: seven targets a metre long and 2 mm wide and thick do, as their plane is none; seven all about do not."""
    turn, place = attitudes(3)
    for width, few in ((0.002, True), (1.0, False)):
        points = (SOLID - SOLID.mean(axis=0)) * [1.0, width, width]
        assert _few(given(points, measure(points, turn, place))).tolist() == 3 * [few]


@pytest.mark.parametrize(("count", "below", "above"), [(4, 0.0009, 0.0011), (5, 0.19, 0.21)])
def test_few_targets_are_a_plane_by_their_thickness_over_the_lesser_width(
    count: int, below: float, above: float
) -> None:
    """Claim: four are no plane from a thousandth of their lesser width on and need all starts then; five nearly in a
    plane need them up to a fifth of it. The length does not count, here twice the width.

    Set-up: targets whose principal widths are exact, by columns at right angles to one another and to all ones.
    """
    turn, place = attitudes(1)
    free = np.column_stack(
        [np.ones(count), SQUARE[[0, 1, 2, 3, 0]][:count, :2], [0.0, 0.2, -0.1, 0.5, 0.9][:count]]
    )
    axes = np.linalg.qr(free)[0][:, 1:]
    for thickness in (below, above):
        points = axes * [1.0, 0.5, 0.5 * thickness]
        few = bool(_few(given(points, measure(points, turn, place)))[0])
        assert few == ((thickness == above) == (count == 4))


@pytest.mark.parametrize("method", ["uv", "joint"])
def test_a_surveys_errors_are_seen_as_the_pose_turns_and_places_them(method: Any) -> None:
    """Claim: at a pose a target's covariance is that of its measurement and G A C A' G', C of the survey along the
    object's axes, A the attitude, G the change of (Θ, φ, R) with a point, by differences of the judge's geometry.

    Set-up: a scanner whose axes lie 1 m apart, so that they count. Tolerance: the differences' own errors.
    """
    (turn,), (place,) = attitudes(1)
    survey, separation = np.array([4e-3, 1e-3, 9e-3]), 1.0
    values = measure(SOLID, turn, place, separation)
    more: dict[str, Any] = dict.fromkeys(("covariance_theta_range", "prior"))
    made = NOISE | more | {"axis_separation": separation, "sigma_object": survey}
    known = observations_from(SOLID, *values[:, None], **made)[0]
    middle = np.asarray(known.centre)[:, 0]
    pose = turn[..., None], (turn @ middle + place)[:, None]
    channels = 2 if method == "uv" else 3
    whitening = problem_of(known, method, "covariance", pose=pose).whitening[..., 0]
    own = np.diag([SIGMA, SIGMA, SIGMA_RANGE][:channels]) ** 2
    step = 1e-5
    for number, point in enumerate(SOLID @ turn.T + place):
        ends = [geometry.shot_from_point(point + way * step * np.eye(3), separation) for way in (1.0, -1.0)]
        # (R, Θ, φ) of three points each.
        slopes = ((np.stack(ends[0]) - np.stack(ends[1])) / (2.0 * step))[[1, 2, 0][:channels]]
        carried = slopes @ turn @ np.diag(survey)
        root = whitening[:, :, number]
        whole = root @ (own + carried @ carried.T) @ root.T
        np.testing.assert_allclose(whole, np.eye(channels), atol=1e-6)
