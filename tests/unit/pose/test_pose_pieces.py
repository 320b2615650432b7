"""Single laws of poses, each against another way to the same number."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import huber
from scipy.stats import chi2

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry as judge
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.adjustment import _solve, _sum_of_squares
from scanner_sim.pose.beside import combined_series
from scanner_sim.pose.covariance import error_ellipsoid
from scanner_sim.pose.curvature import _widest_swing
from scanner_sim.pose.dot_images import _ellipse
from scanner_sim.pose.first_motions import _bends
from scanner_sim.pose.inputs import _distinct
from scanner_sim.pose.observations import principal_axes
from scanner_sim.pose.resection import _inverse_of_apart, _triangles, plane_strength, widest_three
from scanner_sim.pose.series import PoseSeries, SeriesMethod
from scanner_sim.pose.solution import _distance
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.target_layouts import circle, line_and_one, pyramid, square
from scanner_sim.pose.transforms import rates_between, turn_jacobian

Array = NDArray[np.float64]

D = 0.05
POINTS = np.array([[-0.6, -0.5, 0.0], [0.5, -0.6, 0.2], [0.6, 0.5, -0.1], [-0.5, 0.6, 0.3], [0.1, 0.0, -0.3]])
TURN = Rotation.from_rotvec([0.3, -0.2, 0.15])
PLACE = np.array([0.4, -0.3, 6.0])


def test_an_error_ellipsoid_makes_its_covariance_again() -> None:
    """Claim: Σ l² a aᵀ over the half-axes is the covariance, the longest first, and they stand in columns."""
    root = np.random.default_rng(3).normal(size=(4, 3, 3)) * np.array([[1.0], [3.0], [0.2]])
    covariance = root @ np.swapaxes(root, 1, 2)
    lengths, axes = error_ellipsoid(covariance)
    assert (np.diff(lengths, axis=1) < 0.0).all()
    again = np.einsum("nik,nk,njk->nij", axes, lengths**2, axes)
    np.testing.assert_allclose(again, covariance, rtol=1e-9, atol=1e-12)


def test_rates_are_those_of_the_even_motion_between_two_poses() -> None:
    """Claim: v and ω along the outer axes, of objects that stand turned, each over its own time."""
    velocity, rate = (
        np.array([[0.1, -0.2, 0.3], [-5.0, 0.0, 1.0]]),
        np.array([[0.4, -1.0, 2.0], [9.0, 3.0, -7.0]]),
    )
    time = np.array([0.5, 0.02])
    first, then = np.tile(np.eye(4), (2, 2, 1, 1))
    first[:, :3, :3], first[:, :3, 3] = TURN.as_matrix(), PLACE
    for pose, v, turn, t in zip(then, velocity, rate, time, strict=True):
        pose[:3, :3], pose[:3, 3] = (Rotation.from_rotvec(turn * t) * TURN).as_matrix(), PLACE + v * t
    found = rates_between(first, then, time)
    assert found[0] == pytest.approx(velocity, abs=1e-11)
    assert found[1] == pytest.approx(rate, abs=1e-11)
    assert rates_between(first[1:], then[1:], 0.02)[1] == pytest.approx(rate[1:], abs=1e-11)


def sights(change: Array) -> Array:
    """Return (Θ, φ, R) of the targets, shape (n, 3), after a shift and a turn (δt, δω) of the object."""
    placed = (Rotation.from_rotvec(change[3:]) * TURN).apply(POINTS) + PLACE + change[:3]
    r, theta, phi = judge.shot_from_point(placed, D)
    return np.stack([theta, phi, r], axis=1)


@pytest.mark.parametrize("correlated", [False, True])
@pytest.mark.parametrize("method", ["uv", "joint"])
def test_common_errors_pass_through_the_weights_of_the_estimate(method: str, correlated: bool) -> None:
    """Claim: the covariance is N⁻¹ + B Bᵀ, N = Σ JᵀWJ and B = N⁻¹ Σ JᵀW K, with W of sights, survey and correlations.

    Expected: J by central differences of the judge's sights, W by inverting each target's covariance.
    """
    rng = np.random.default_rng(6)
    channels = 2 if method == "uv" else 3
    sigma = np.array([2e-5, 5e-5, 2e-3])
    survey = np.array([1e-3, 4e-4, 2e-4])
    kinds = rng.normal(size=(5, 3, 2)) * np.array([[3e-5], [4e-5], [1e-3]])
    steps = np.concatenate([np.full(3, 1e-5), np.full(3, 1e-5)])
    slope = np.stack([(sights(h) - sights(-h)) / 2e-5 for h in np.diag(steps)], axis=-1)[:, :channels]
    ranged = {} if method == "uv" else {"covariance_theta_range": 0.4 * sigma[0] * sigma[2]}
    more = {"covariance_theta_phi": -0.3 * sigma[0] * sigma[1], **ranged, "sigma_object": survey}
    normal, driven = np.zeros((6, 6)), np.zeros((6, 2))
    turn = TURN.as_matrix()
    for number in range(5):
        own = np.diag(sigma[:channels] ** 2)
        if correlated:
            own[0, 1] = own[1, 0] = -0.3 * sigma[0] * sigma[1]
            if channels == 3:
                own[0, 2] = own[2, 0] = 0.4 * sigma[0] * sigma[2]
            # The first three columns of J are the sight's derivatives by the target's place.
            by_place = slope[number, :, :3] @ turn
            own = own + by_place @ np.diag(survey**2) @ by_place.T
        weight = np.linalg.inv(own)
        normal += slope[number].T @ weight @ slope[number]
        driven += slope[number].T @ weight @ kinds[number, :channels]
    own_part = np.linalg.inv(normal)
    by_common = own_part @ driven
    wanted = own_part + by_common @ by_common.T
    theta, phi, ranges = sights(np.zeros(6)).T
    found = estimate_pose(
        POINTS, theta, phi, None if method == "uv" else ranges,
        sigma_theta=sigma[0], sigma_phi=sigma[1], sigma_range=None if method == "uv" else sigma[2],
        axis_separation=D, method=method, common=kinds, **(more if correlated else {}),
    )  # fmt: skip
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(
        found.covariance / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-4
    )


def series(time: Array, method: SeriesMethod, sigma: Array, targets: Array, off: Array) -> PoseSeries:
    """Return a resting object whose poses are off by (δt, δω), with σ of each time, shape (count, 6)."""
    count = len(time)
    covariance = np.einsum("ni,ij->nij", sigma**2, np.eye(6))
    still = np.tile(np.eye(3), (count, 1, 1))
    return PoseSeries(
        name="panel",
        relative_to="",
        method=method,
        time=time,
        position=np.tile([0.5, 0.0, 6.0], (count, 1)) + off[:3],
        rotation=np.tile(Rotation.from_rotvec(off[3:]).as_matrix(), (count, 1, 1)),
        covariance=covariance,
        chi2=np.zeros(count),
        dof=np.full(count, 2),
        targets=targets,
        status=np.zeros(count, dtype=np.int8),
        truth_position=np.tile([0.5, 0.0, 6.0], (count, 1)),
        truth_rotation=still,
        lasting=0.5 * covariance,
        common=0.25 * covariance,
    )


def test_between_frames_the_cameras_covariance_is_between_theirs() -> None:
    """Claim: a fifth of the way from frame to frame each part of the covariance is 0.8 of one and 0.2 of the other.

    Expected: 1/σ² of both instruments add up; lasting parts add up by the squares of both weights; the dots counted are
    those of the frame before.
    """
    widths = np.outer([1.0, 3.0], [1e-4] * 3 + [4e-4] * 3)
    camera = series(np.array([0.0, 1.0]), "camera", widths, np.array([4, 9]), np.zeros(6))
    own = np.array([[3e-4] * 3 + [2e-4] * 3])
    scanner = series(np.array([0.2]), "joint", own, np.array([5]), np.zeros(6))
    (found,) = combined_series([camera, scanner])
    seen = 0.8 * widths[0] ** 2 + 0.2 * widths[1] ** 2
    whole = 1.0 / (own[0] ** -2 + 1.0 / seen)
    np.testing.assert_allclose(found.covariance[0], np.diag(whole), rtol=1e-9, atol=1e-18)
    weights = whole / own[0] ** 2, whole / seen
    for part, share in ((found.lasting, 0.5), (found.common, 0.25)):
        wanted = share * (weights[0] ** 2 * own[0] ** 2 + weights[1] ** 2 * seen)
        np.testing.assert_allclose(part[0], np.diag(wanted), rtol=1e-9, atol=1e-18)
    assert found.targets.tolist() == [9]


@pytest.mark.parametrize(("share", "status"), [(0.99, PoseStatus.VALID), (1.01, PoseStatus.IMPLAUSIBLE)])
def test_two_instruments_contradict_each_other_once_in_ten_thousand(share: float, status: PoseStatus) -> None:
    """Claim: the difference of two poses has a χ² of six degrees of freedom, and is doubted beyond its quantile."""
    sigma = np.full((2, 6), 2e-4)
    off = np.sqrt(share * chi2.isf(1e-4, 6) / 6.0) * np.sqrt(2.0) * 2e-4 * np.ones(6)
    time, many = np.array([0.0, 1.0]), np.full(2, 4)
    (found,) = combined_series(
        [series(time, "camera", sigma, many, np.zeros(6)), series(time, "uv", sigma, many, off)]
    )
    assert (found.status == status).all()


def test_the_nearest_ellipse_of_an_outline_that_is_none() -> None:
    """Claim: of an outline that a lens bends the conic has the least ∮ F²/|∇F|² dl, however its points lie on it.

    Expected: a search over all five numbers of a conic, with the integral over 400 points evenly in angle.
    """

    def outline(angle: Array) -> Array:
        u = 30.0 * np.cos(angle) - 6.0 * np.sin(angle) + 4.0
        v = 12.0 * np.sin(angle) + 5.0 * np.cos(angle) - 3.0
        # The bends are of the order of what a lens does within a dot.
        return np.stack([u + 6e-4 * u * u, v + 4e-4 * u * v + 2e-6 * u**3], axis=-1)

    dense = outline(2.0 * np.pi / 400 * np.arange(400))
    length = np.linalg.norm(np.roll(dense, -1, axis=0) - np.roll(dense, 1, axis=0), axis=1)
    x, y = (dense / 30.0).T

    def distances(conic: Array) -> Array:
        a, b, c, d, e = conic
        f = a * x * x + b * x * y + c * y * y + d * x + e * y - 1.0
        return np.asarray(np.sqrt(length) * f / np.hypot(2.0 * a * x + b * y + d, b * x + 2.0 * c * y + e))

    design = np.stack([x * x, x * y, y * y, x, y], axis=1)
    start = np.linalg.lstsq(design, np.ones(len(x)), rcond=None)[0]
    found = least_squares(distances, start, xtol=1e-12, ftol=1e-12)
    a, b, c, d, e = found.x
    centre = 30.0 * np.linalg.solve([[2.0 * a, b], [b, 2.0 * c]], [-d, -e])
    uneven = 2.0 * np.pi / 64 * np.arange(64)
    got, _ = _ellipse(outline(uneven + 0.4 * np.sin(uneven)))
    np.testing.assert_allclose(got, centre, atol=5e-5)


def test_layouts_fit_into_a_square_of_their_size() -> None:
    """Claim: each has its targets where its name says, its middle at the origin, and the front along −z."""
    four, nine, ring = square(0.8), square(0.8, 3), circle(0.8, 6)
    np.testing.assert_allclose(np.abs(four.points[:, :2]), 0.4)
    assert len({tuple(point) for point in np.sign(four.points[:, :2])}) == 4
    np.testing.assert_allclose(np.unique(nine.points[:, 0]), [-0.4, 0.0, 0.4], atol=1e-15)
    assert (four.name, nine.name, len(nine.points)) == ("square", "grid 3 × 3", 9)
    np.testing.assert_allclose(np.hypot(*ring.points[:, :2].T), 0.4)
    turns = np.diff(np.unwrap(np.arctan2(ring.points[:, 1], ring.points[:, 0])))
    np.testing.assert_allclose(turns, np.pi / 3.0)
    assert len(line_and_one(0.8).points) == 4
    line = line_and_one(0.8, 5)
    np.testing.assert_allclose(np.sort(line.points[:-1, 0]), [-0.4, -0.4 / 3.0, 0.4 / 3.0, 0.4], atol=1e-15)
    assert np.ptp(line.points[:-1, 1]) == 0.0
    np.testing.assert_allclose(line.points[-1, :2] - line.points[0, :2], [0.4, -0.8])
    peak = pyramid(0.8)
    np.testing.assert_allclose(peak.points[-1], [0.0, 0.0, -0.4])
    np.testing.assert_array_equal(peak.points[:-1], four.points)
    for one in (four, nine, ring, line):
        np.testing.assert_allclose(one.points.mean(axis=0), 0.0, atol=1e-15)
        assert one.size == 0.8


@pytest.mark.parametrize("knee", [0.0, 0.7, 2.5])
def test_doubtful_targets_count_by_hubers_function(knee: float) -> None:
    """Claim: the cost is Σ r², and beyond the knee twice Huber's function of r, the length of a target's residual."""
    whitened = np.random.default_rng(7).normal(size=(3, 6, 5)) * 2.0
    lengths = np.linalg.norm(whitened, axis=0)
    wanted = 2.0 * huber(knee, lengths) if knee else lengths**2
    problem: Any = SimpleNamespace(huber=knee)
    np.testing.assert_allclose(_sum_of_squares(problem, whitened), wanted.sum(axis=0), rtol=1e-12)


def test_the_widest_three_span_the_array() -> None:
    """Claim: the target farthest from the middle, the one farthest from that, and the largest triangle over both; a
    target that was not seen is none of them."""
    points = np.random.default_rng(8).normal(size=(3, 7, 1))
    used = np.ones((7, 2), dtype=bool)
    used[2, 1] = used[5, 1] = False
    found = widest_three(points, used)
    for pose in range(2):
        seen = np.flatnonzero(used[:, pose])
        own = points[:, :, 0].T
        first = max(seen, key=lambda i: np.linalg.norm(own[i] - own[seen].mean(axis=0)))
        second = max(seen, key=lambda i: np.linalg.norm(own[i] - own[first]))
        third = max(
            seen, key=lambda i: np.linalg.norm(np.cross(own[i] - own[first], own[second] - own[first]))
        )
        assert found[:, pose].tolist() == [first, second, third]


def test_the_widest_swing_is_one_standard_deviation_of_the_turn_that_bends_most() -> None:
    """Claim: of the array's three axes a the step C e/√(eᵀ C e), e = (0, a), is taken whose second order,
    ½ δω × (δω × r), moves the targets most, root mean square about the object's origin.

    Expected: every step has a Mahalanobis distance of 1; the second order by the turn of each target there and back.
    Three of the poses are turned thirteen times as unsurely about one of the axes as about the others; the fourth is as
    unsure about all, so that the axis is taken about which the targets lie farthest.
    """
    rng = np.random.default_rng(9)
    points = rng.normal(size=(3, 6, 1)) * np.array([[[0.9]], [[0.4]], [[0.05]]])
    points -= points.mean(axis=1, keepdims=True)
    used = np.ones((6, 4), dtype=bool)
    axes = principal_axes(points, used)
    turn = Rotation.from_rotvec(rng.normal(size=(4, 3)))
    roots = rng.normal(size=(4, 6, 6)) * 1e-3
    covariance = roots @ np.swapaxes(roots, 1, 2)
    covariance[3] = 1e-6 * np.eye(6)
    for pose in range(3):
        about = turn[pose].as_matrix() @ np.broadcast_to(axes[2], (3, 3, 4))[:, pose, pose]
        covariance[pose, 3:, 3:] += 1e-3 * np.outer(about, about)
    centre = np.array([[0.2], [-0.1], [0.3]])
    problem: Any = SimpleNamespace(centre=centre)
    fit: Any = SimpleNamespace(rotation=np.moveaxis(turn.as_matrix(), 0, -1), position=np.zeros((3, 4)))
    found = _widest_swing(problem, fit, np.moveaxis(covariance, 0, -1), axes)
    chosen = []
    for pose in range(4):
        own = turn[pose].as_matrix()
        bends, steps = [], []
        for axis in np.broadcast_to(axes[2], (3, 3, 4))[:, :, pose].T:
            along = np.append(np.zeros(3), own @ axis)
            step = covariance[pose] @ along / np.sqrt(along @ covariance[pose] @ along)
            small = 1e-2 * step[3:] / np.linalg.norm(step[3:])
            arms = (points[:, :, 0] + centre).T @ own.T
            there, back = (Rotation.from_rotvec(sign * small).apply(arms) for sign in (1.0, -1.0))
            second = 0.5 * (there + back) - arms
            bends.append(np.mean(np.sum(second**2, axis=1)) * (np.linalg.norm(step[3:]) / 1e-2) ** 4)
            steps.append(step)
        chosen.append(int(np.argmax(bends)))
        np.testing.assert_allclose(found[:, pose], steps[chosen[-1]], rtol=1e-9)
    assert chosen[:3] == [0, 1, 2]


def test_widths_of_an_array_are_root_mean_squares_along_its_axes() -> None:
    """Claim: of the targets that are used, about their middle, by the covariance that NumPy makes of them alone."""
    rng = np.random.default_rng(11)
    points = rng.normal(size=(3, 7, 2)) * np.array([0.2, 1.0, 0.5])[:, None, None]
    used = np.array([[True, False, True, True, True, False, True], [True] * 7]).T
    middle, widths, axes = principal_axes(points, used)
    for pose in range(2):
        own = points[:, used[:, pose], pose]
        scatter = np.cov(own, bias=True)
        np.testing.assert_allclose(middle[:, pose], own.mean(axis=1), atol=1e-14)
        np.testing.assert_allclose(widths[:, pose] ** 2, np.linalg.eigvalsh(scatter), rtol=1e-10)
        turned = axes[:, :, pose].T @ scatter @ axes[:, :, pose]
        np.testing.assert_allclose(turned, np.diag(widths[:, pose] ** 2), atol=1e-12)
        assert np.linalg.det(axes[:, :, pose]) == pytest.approx(1.0)


def test_two_poses_lie_apart_by_their_mahalanobis_distance() -> None:
    """Claim: (δt, δω)ᵀ N (δt, δω) with the small turn δω from one to the other, and infinite beyond a quarter turn."""
    rng = np.random.default_rng(13)
    own = Rotation.random(4, random_state=5)
    turn = np.vstack([1e-4 * rng.normal(size=(3, 3)), [2.0, 0.0, 0.0]])
    moved = Rotation.from_rotvec(turn) * own
    root = rng.normal(size=(4, 6, 6))
    normal = root @ np.swapaxes(root, 1, 2)
    position, other = rng.normal(size=(2, 3, 4))
    found = _distance(
        *(np.moveaxis(one.as_matrix(), 0, -1) for one in (moved,)), position,
        np.moveaxis(own.as_matrix(), 0, -1), other, np.moveaxis(normal, 0, -1),
    )  # fmt: skip
    change = np.concatenate([(position - other).T, turn], axis=1)
    wanted = np.einsum("ba,bac,bc->b", change, normal, change)
    np.testing.assert_allclose(found[:3], wanted[:3], rtol=1e-6)
    assert found[3] == np.inf


@pytest.mark.parametrize("angle", [0.0, 1e-9, 9.9e-3, 1.01e-2, 0.3, 3.0])
def test_a_turn_changes_with_its_vector_by_the_jacobian(angle: float) -> None:
    """Claim: exp([ω + δ]×) is exp([J δ]×) exp([ω]×): against differences of SciPy's rotations."""
    omega = angle * np.array([[2.0, -1.0, 2.0], [0.6, 0.0, -0.8]]) / np.array([[3.0], [1.0]])
    found = turn_jacobian(omega)
    for number, vector in enumerate(omega):
        for axis, change in enumerate(1e-5 * np.eye(3)):
            later, sooner = (Rotation.from_rotvec(vector + sign * change) for sign in (1.0, -1.0))
            np.testing.assert_allclose(
                found[number][:, axis], (later * sooner.inv()).as_rotvec() / 2e-5, atol=1e-9
            )


def test_a_turn_bends_the_ways_of_targets_by_half_its_square() -> None:
    """Claim: ½ r σ², σ² the variance of the turn after the mean pause, Cov(ω + p ω′), r the farthest target from their
    middle, over the least σ of a visit across the sight: R (σ_Θ² + σ_φ²)^½. By a plain propagation."""
    rng = np.random.default_rng(5)
    root = rng.normal(size=(12, 12))
    covariance = root @ root.T
    points = {"a": (0.0, 0.0, 0.0), "b": (3.0, 0.0, 0.0), "c": (0.0, 3.0, 0.0)}
    visits: Any = [
        SimpleNamespace(time=time, position=np.array([0.1, 0.2, reach]), covariance=np.diag(sigma) ** 2)
        for time, reach, sigma in (
            (1.0, 5.0, (3e-3, 4e-3, 9.0)), (1.1, 4.0, (3e-3, 4e-3, 9.0)), (1.6, 6.0, (5e-3, 5e-3, 9.0)),
        )
    ]  # fmt: skip
    later = np.zeros((3, 12))
    later[:, 3:6], later[:, 9:12] = np.eye(3), 0.3 * np.eye(3)
    turned = float(np.trace(later @ covariance @ later.T))
    assert _bends(covariance, points, visits) == pytest.approx(0.5 * np.sqrt(5.0) * turned / (4.0 * 5e-3))


@pytest.mark.parametrize("seed", range(4))
def test_a_plane_is_as_strong_as_its_second_moments_are_free(seed: int) -> None:
    """Claim: the least singular value, over √n, of the parts of X², XY and Y² that no linear function explains, as
    two rows for each target that is seen; 1 for a square, 0 for four with three on a line. By general least squares."""
    random = np.random.default_rng(seed)
    flat = np.zeros((3, 7, 1))
    flat[:2, :, 0] = random.normal(size=(2, 7)) * [[1.0], [0.4]]
    turn = Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix()
    points = np.einsum("ij,jnb->inb", turn, flat)
    seen = np.ones((7, 2), dtype=bool)
    seen[3, 0] = seen[5, 1] = seen[6, 1] = False

    def strength(points: Array, seen: NDArray[np.bool_]) -> Array:
        told: Any = SimpleNamespace(
            points=points, seen=seen, principal=principal_axes(points, seen), count=seen.shape[1]
        )
        return plane_strength(told)

    found = strength(points, seen)
    for pose in range(2):
        own = flat[:2, seen[:, pose], 0]
        about = own - own.mean(axis=1, keepdims=True)
        x, y = np.linalg.cholesky(np.linalg.inv(about @ about.T / about.shape[1])).T @ about
        linear = np.stack([np.ones_like(x), x, y], axis=1)
        left = [one - linear @ np.linalg.lstsq(linear, one, rcond=None)[0] for one in (x * x, x * y, y * y)]
        stack = np.concatenate([np.stack(left[:2], axis=1), np.stack(left[1:], axis=1)])
        least = np.linalg.svd(stack, compute_uv=False)[-1] / np.sqrt(len(x))
        assert found[pose] == pytest.approx(least, rel=1e-9)
    corners = np.array([[1.0, 1.0, -1.0, -1.0], [1.0, -1.0, 1.0, -1.0], [0.0] * 4])[..., None]
    assert strength(corners, np.ones((4, 1), dtype=bool))[0] == pytest.approx(1.0)
    line = np.array([[0.0, 1.0, 3.0, 1.0], [0.0, 0.0, 0.0, 2.0], [0.0] * 4])[..., None]
    assert strength(line, np.ones((4, 1), dtype=bool))[0] == pytest.approx(0.0, abs=1e-6)


def test_threes_with_a_hidden_target_have_no_area() -> None:
    """Claim: twice the area of each triangle is the vector product's length; −1 where any of its corners is hidden."""
    random = np.random.default_rng(4)
    points, seen = random.normal(size=(3, 5, 1)), np.ones((5, 2), dtype=bool)
    seen[[1, 4], 1] = False
    told: Any = SimpleNamespace(points=points, seen=seen)
    threes, area = _triangles(told)
    assert sorted(map(tuple, threes.tolist())) == list(combinations(range(5), 3))
    for three, twice in zip(threes, area, strict=True):
        a, b, c = points[:, three, 0].T
        assert twice[0] == pytest.approx(np.linalg.norm(np.cross(b - a, c - a)))
        assert twice[1] == (-1.0 if {1, 4} & set(three.tolist()) else pytest.approx(twice[0]))


@pytest.mark.parametrize(("apart", "one"), [(0.9e-9, True), (1.2e-9, False)])
def test_two_targets_stand_apart_by_a_billionth_of_the_array(apart: float, one: bool) -> None:
    """Claim: nearer than that over the array's size, here 3 m, along every axis they are one, and the message has both;
    farther along any axis they are two."""
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.5], [3.0, 1.0, -1.0], [1.0, 2.0, 0.5]])
    points[3] += 3.0 * apart * np.array([0.1, -1.0, 0.4])
    if one:
        with pytest.raises(InputError, match="Targets 1 and 3"):
            _distinct(points)
    else:
        _distinct(points)


def test_a_singular_system_among_others_is_solved_by_the_shortest_step() -> None:
    """Claim: of a stack each system has its own solution; where there are many, that of least norm."""
    rng = np.random.default_rng(19)
    design = rng.normal(0.0, 1.0, (3, 9, 6))
    design[1, :, 4:] = 0.0
    matrix = np.einsum("bni,bnj->bij", design, design)
    right = np.einsum("bij,bj->bi", matrix, rng.normal(0.0, 1.0, (3, 6)))
    found = _solve(np.ascontiguousarray(matrix.transpose(1, 2, 0)), np.ascontiguousarray(right.T)).T
    for one, wanted, side in zip(found, matrix, right, strict=True):
        np.testing.assert_allclose(one, np.linalg.pinv(wanted, rcond=1e-10) @ side, rtol=1e-8, atol=1e-10)


def test_rows_at_right_angles_have_their_pseudo_inverse_however_short_one_is() -> None:
    """Claim: also of a row a hundredth or 10⁻⁸ as long as the others, of narrow arrays; a row of nothing has none."""
    rows = np.linalg.qr(np.random.default_rng(20).normal(0.0, 1.0, (7, 3)))[0].T
    for shortest in (1.0, 0.01, 1e-8, 0.0):
        design = rows * np.array([[2.0], [1.0], [shortest]])
        found = _inverse_of_apart(design[..., None])[..., 0]
        np.testing.assert_allclose(found, np.linalg.pinv(design, rcond=1e-12).T, rtol=1e-7, atol=1e-9)
