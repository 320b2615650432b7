"""The small laws beneath poses, each by itself: turns, projections, weights, least squares."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from scanner_sim.analytic import geometry
from scanner_sim.pose import transforms
from scanner_sim.pose.adjustment import (
    Problem,
    jacobian,
    linearise,
    place_points,
    predict,
    prior_residual,
    whiten,
)
from scanner_sim.pose.collinearity import bearings, project, virtual_origin
from scanner_sim.pose.covariance import error_ellipsoid, point_on_object, relative_pose
from scanner_sim.pose.observations import Prior
from scanner_sim.pose.point_fit import point_fit
from scanner_sim.pose.weights import _inverse_root

Array = NDArray[np.float64]

D = 0.05
OMEGA = np.array([0.3, -0.5, 0.7])
TURN = Rotation.from_rotvec(OMEGA).as_matrix()
VECTORS = np.array([[0.0, 0.0, 0.0], [0.3, -0.5, 0.7], [1e-6, 2e-6, -3e-6], [1.2, 1.9, -0.4]])
POINTS = np.array([[-0.5, 0.5, 0.6, -0.4], [-0.4, -0.5, 0.5, 0.6], [0.0, 0.1, -0.1, 0.3]])
PLACE = np.array([0.7, -0.5, 6.0])


def test_the_cross_matrix_crosses() -> None:
    v, w = np.array([[1.0, 2.0, 3.0], [-0.5, 4.0, 0.2]]), np.array([0.3, -0.7, 0.9])
    np.testing.assert_allclose(transforms.cross_matrix(v) @ w, np.cross(v, w), rtol=1e-14)


@pytest.mark.parametrize("omega", VECTORS)
def test_turns_are_exponentials_of_cross_matrices(omega: Array) -> None:
    """Claim: exp([ω]×) by SciPy's Padé approximation, and back; no turn is the unit matrix."""
    x, y, z = omega
    wanted = expm(np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
    np.testing.assert_allclose(transforms.exponential(omega), wanted, atol=1e-14)
    np.testing.assert_allclose(transforms.rotation_from_vector(omega), wanted, atol=1e-14)
    np.testing.assert_allclose(transforms.vector_from_rotation(wanted), omega, atol=1e-12)


def test_quaternions_begin_with_the_cosine() -> None:
    """Claim: (cos ω/2, sin ω/2 n), and SciPy's matrix of it, whatever its length."""
    angle = np.linalg.norm(OMEGA)
    wanted = np.append(np.cos(angle / 2.0), np.sin(angle / 2.0) * OMEGA / angle)
    np.testing.assert_allclose(transforms.quaternion_from_rotation(TURN), wanted, atol=1e-14)
    np.testing.assert_allclose(transforms.rotation_from_quaternion(3.0 * wanted), TURN, atol=1e-14)


def test_steps_of_an_adjustment_are_turns_by_a_quaternion() -> None:
    """Claim: of (1, ω/2), and so rotations, about ω by 2 atan |ω|/2."""
    omega = VECTORS.T
    found = np.moveaxis(transforms.cayley(omega), -1, 0)
    length = np.linalg.norm(VECTORS, axis=1, keepdims=True)
    angle = 2.0 * np.arctan(0.5 * length)
    wanted = Rotation.from_rotvec(
        VECTORS * np.divide(angle, length, out=np.ones_like(length), where=length > 0)
    )
    np.testing.assert_allclose(found, wanted.as_matrix(), atol=1e-14)


def test_yaw_pitch_and_roll_are_turns_about_y_x_and_z() -> None:
    """Claim: SciPy's intrinsic Y, X, Z."""
    angles = np.array([0.4, -0.3, 1.1])
    wanted = Rotation.from_euler("YXZ", angles).as_matrix()
    np.testing.assert_allclose(transforms.rotation_from_yaw_pitch_roll(angles), wanted, atol=1e-14)
    np.testing.assert_allclose(transforms.yaw_pitch_roll_from_rotation(wanted), angles, atol=1e-14)


def test_a_beam_leaves_its_virtual_origin_along_its_bearing() -> None:
    """Claim: origin + R u is the judge's point, and what projects to (Θ, φ, R) again."""
    theta, phi, r = np.array([0.3, -0.2]), np.array([-0.25, 0.4]), np.array([4.0, 7.0])
    points = virtual_origin(phi, D) + r * bearings(theta, phi)
    np.testing.assert_allclose(points, geometry.point_from_shot(r, theta, phi, D).T, atol=1e-14)
    found, _ = project(points, D, with_range=True)
    np.testing.assert_allclose(found, [theta, phi, r], rtol=1e-13)


@pytest.mark.parametrize("with_range", [False, True])
def test_gradients_of_the_projection_are_differences(with_range: bool) -> None:
    points = POINTS + np.array([[0.9], [-1.4], [5.0]])
    _, gradients = project(points, D, with_range=with_range)
    for axis in range(3):
        step = 1e-6 * np.eye(3)[axis][:, None]
        ahead, behind = (project(points + s * step, D, with_range=with_range)[0] for s in (1.0, -1.0))
        np.testing.assert_allclose(gradients[axis], (ahead - behind) / 2e-6, atol=2e-9)


def test_whitening_is_a_root_of_the_inverse() -> None:
    """Claim: WᵀW C = 1 for a full covariance, and W is lower triangular."""
    mixed = np.random.default_rng(1).normal(size=(5, 3, 3))
    covariance = mixed @ np.swapaxes(mixed, 1, 2) + np.eye(3)
    root = np.moveaxis(_inverse_root(np.moveaxis(covariance, 0, -1)), -1, 0)
    unit = np.swapaxes(root, 1, 2) @ root @ covariance
    np.testing.assert_allclose(unit, np.tile(np.eye(3), (5, 1, 1)), atol=1e-10)
    np.testing.assert_allclose(np.triu(root, 1), 0.0)


def problem(
    *, in_space: bool = False, matrix: bool = False, huber: float = 0.0, prior: Any = None
) -> Problem:
    """Return residuals of four targets of one pose, with unlike weights."""
    rng = np.random.default_rng(2)
    placed = TURN @ POINTS + PLACE[:, None]
    exact = placed if in_space else project(placed, D, with_range=True)[0]
    whitening = (
        np.eye(3)[:, :, None, None] * rng.uniform(1e2, 1e3, (3, 1, 4, 1))
        if matrix
        else rng.uniform(1e2, 1e3, (3, 4, 1))
    )
    if matrix:
        whitening = whitening + np.tril(rng.uniform(1e2, 3e2, (3, 3)), -1)[:, :, None, None]
    measured = exact[..., None] + 5e-3 * rng.normal(size=(3, 4, 1))
    centre = np.array([[0.2], [-0.1], [0.4]])
    return Problem(POINTS[..., None], measured, whitening, in_space, D, huber, prior, centre)


def moved(step: Array) -> tuple[Array, Array]:
    """Return a pose a small step (δc, δω) away."""
    return (transforms.rotation_from_vector(step[3:]) @ TURN)[..., None], (PLACE + step[:3])[:, None]


@pytest.mark.parametrize("matrix", [False, True])
@pytest.mark.parametrize("in_space", [False, True])
def test_the_jacobian_is_by_differences(in_space: bool, matrix: bool) -> None:
    """Claim: rows are those of W predicted(δc, δω)."""
    here = problem(in_space=in_space, matrix=matrix)

    def predicted(step: Array) -> Array:
        return whiten(here, predict(here, place_points(here, *moved(step))[1])[0])

    turned, placed = place_points(here, *moved(np.zeros(6)))
    rows = jacobian(here, turned, predict(here, placed)[1])
    for axis in range(6):
        step = 1e-6 * np.eye(6)[axis]
        slope = (predicted(step) - predicted(-step)) / 2e-6
        np.testing.assert_allclose(rows[axis], slope, atol=1e-5 * np.abs(slope).max())


def a_prior() -> Prior:
    """Return a pose known before, a tenth of a radian and a few millimetres beside the one that is tried."""
    root = np.tril(np.random.default_rng(3).uniform(50.0, 200.0, (6, 6)))
    turn = Rotation.from_rotvec([0.3, -0.5, 0.4]).as_matrix() @ TURN
    return Prior(position=(PLACE - 0.3)[:, None], rotation=turn[..., None], root=root[..., None])


def test_the_priors_derivative_is_by_differences() -> None:
    """Claim: W (origin − prior's, log(R R₀ᵀ)) about the centre of the array, which is moved, and its slopes."""
    here = problem()
    prior = a_prior()

    def residual(step: Array) -> Array:
        turn, place = moved(step)
        origin = place[:, 0] - turn[..., 0] @ here.centre[:, 0]
        off = Rotation.from_matrix(turn[..., 0] @ prior.rotation[..., 0].T).as_rotvec()
        return prior.root[..., 0] @ np.concatenate([origin - prior.position[:, 0], off])

    found, change = prior_residual(prior, here.centre, *moved(np.zeros(6)))
    np.testing.assert_allclose(found[:, 0], residual(np.zeros(6)), rtol=1e-10)
    for axis in range(6):
        step = 1e-6 * np.eye(6)[axis]
        slope = (residual(step) - residual(-step)) / 2e-6
        np.testing.assert_allclose(change[:, axis, 0], slope, atol=1e-5 * np.abs(slope).max() + 1e-6)


@pytest.mark.parametrize(("huber", "prior"), [(0.0, None), (2.0, None), (0.0, a_prior())])
def test_cost_and_its_slope_belong_together(huber: float, prior: Any) -> None:
    """Claim: the cost is Σ ρ(|e|) of the targets, with ρ = e², and 2 k e − k² beyond k, and the prior's square; its
    derivative is −2 b; without Huber's function the normal matrix is the sum of the slopes' squares."""
    here = problem(huber=huber, prior=prior)

    def cost(step: Array) -> float:
        turn, place = moved(step)
        apart = (here.measured - predict(here, place_points(here, turn, place)[1])[0]) * here.whitening
        length = np.sqrt(np.sum(apart[..., 0] ** 2, axis=0))
        large = (length > huber) & (huber > 0.0)
        total = float(np.where(large, 2.0 * huber * length - huber**2, length**2).sum())
        if prior is not None:
            total += float(np.sum(prior_residual(prior, here.centre, turn, place)[0] ** 2))
        return total

    found, normal, slope = linearise(here, *moved(np.zeros(6)))
    assert found[0] == pytest.approx(cost(np.zeros(6)), rel=1e-12)
    steps = 1e-6 * np.eye(6)
    wanted = np.array([(cost(step) - cost(-step)) / 2e-6 for step in steps])
    np.testing.assert_allclose(-2.0 * slope[:, 0], wanted, atol=1e-6 * np.abs(wanted).max())
    rows = jacobian(here, *_turned_and_gradients(here))[:6].reshape(6, -1)
    weights = np.ones(4)
    if huber:
        apart = (
            here.measured - predict(here, place_points(here, *moved(np.zeros(6)))[1])[0]
        ) * here.whitening
        weights = np.minimum(1.0, huber / np.sqrt(np.sum(apart[..., 0] ** 2, axis=0)))
    weighed = (rows * np.tile(weights, 3)) @ rows.T
    if prior is not None:
        change = prior_residual(prior, here.centre, *moved(np.zeros(6)))[1][..., 0]
        weighed = weighed + change.T @ change
    np.testing.assert_allclose(normal[..., 0], weighed, rtol=1e-9, atol=1e-9 * np.abs(weighed).max())


def _turned_and_gradients(here: Problem) -> tuple[Array, Array | None]:
    turned, placed = place_points(here, *moved(np.zeros(6)))
    return turned, predict(here, placed)[1]


def test_points_are_fitted_by_the_best_turn() -> None:
    """Claim: SciPy's alignment of vectors (Kabsch) about the means, of the points that count; noise of a centimetre."""
    rng = np.random.default_rng(4)
    measured = TURN @ POINTS + PLACE[:, None] + 0.01 * rng.normal(size=POINTS.shape)
    points = np.hstack([POINTS, [[9.0], [9.0], [9.0]]])
    seen = np.hstack([measured, [[0.0], [0.0], [0.0]]])
    used = np.array([True] * 4 + [False])
    rotation, position = point_fit(points[..., None], seen[..., None], used[:, None])
    middle, mean = POINTS.mean(axis=1), measured.mean(axis=1)
    best, _ = Rotation.align_vectors((measured - mean[:, None]).T, (POINTS - middle[:, None]).T)
    np.testing.assert_allclose(rotation[..., 0], best.as_matrix(), atol=1e-7)
    np.testing.assert_allclose(position[:, 0], mean - best.as_matrix() @ middle, atol=1e-7)


class Known:
    """A pose with a covariance."""

    def __init__(self, omega: Array, position: Array, seed: int) -> None:
        mixed = np.random.default_rng(seed).normal(size=(6, 6))
        self.rotation = Rotation.from_rotvec(omega).as_matrix()
        self.position = position
        self.covariance = mixed @ mixed.T

    def moved(self, step: Array) -> tuple[Array, Array]:
        """Return its rotation and position after (δt, δω)."""
        return Rotation.from_rotvec(step[3:]).as_matrix() @ self.rotation, self.position + step[:3]


def test_a_point_of_an_object_errs_with_its_arm() -> None:
    """Claim: J C Jᵀ with J by differences of t + R p; without turns the covariance of t."""
    pose, point = Known(OMEGA, PLACE, 5), np.array([0.3, -0.2, 0.9])
    place, covariance = point_on_object(pose, point)

    def there(step: Array) -> Array:
        rotation, position = pose.moved(step)
        return np.asarray(position + rotation @ point)

    slopes = np.stack([(there(step) - there(-step)) / 2e-6 for step in 1e-6 * np.eye(6)], axis=-1)
    np.testing.assert_allclose(place, there(np.zeros(6)), rtol=1e-14)
    np.testing.assert_allclose(covariance, slopes @ pose.covariance @ slopes.T, rtol=1e-7)


def test_ellipsoids_have_the_longest_axis_first() -> None:
    """Claim: of diag(4, 9, 1) turned, half-axes 3, 2, 1 along the turned y, x and z, up to their sign."""
    lengths, axes = error_ellipsoid(TURN @ np.diag([4.0, 9.0, 1.0]) @ TURN.T)
    assert lengths == pytest.approx([3.0, 2.0, 1.0])
    np.testing.assert_allclose(np.abs(axes.T @ TURN[:, [1, 0, 2]]), np.eye(3), atol=1e-12)


@pytest.mark.parametrize("together", [False, True])
def test_one_object_seen_from_another_errs_by_both(together: bool) -> None:
    """Claim: M_a⁻¹ M_b, and J C Jᵀ with J by differences of its place and its turn, of both poses."""
    a, b = Known(OMEGA, PLACE, 6), Known(-0.5 * OMEGA, PLACE + np.array([1.0, 2.0, -0.7]), 7)
    between = np.random.default_rng(8).normal(size=(6, 6)) if together else None
    found = relative_pose(a, b, between)

    def relative(step: Array) -> tuple[Array, Array]:
        (turn_a, place_a), (turn_b, place_b) = a.moved(step[:6]), b.moved(step[6:])
        return turn_a.T @ turn_b, turn_a.T @ (place_b - place_a)

    turn, place = relative(np.zeros(12))
    np.testing.assert_allclose(found.rotation, turn, atol=1e-14)
    np.testing.assert_allclose(found.position, place, atol=1e-14)

    def change(step: Array) -> Array:
        other, there = relative(step)
        return np.concatenate([there - place, Rotation.from_matrix(other @ turn.T).as_rotvec()])

    slopes = np.stack([(change(step) - change(-step)) / 2e-6 for step in 1e-6 * np.eye(12)], axis=-1)
    whole = np.zeros((12, 12))
    whole[:6, :6], whole[6:, 6:] = a.covariance, b.covariance
    if between is not None:
        whole[:6, 6:], whole[6:, :6] = between, between.T
    wanted = slopes @ whole @ slopes.T
    np.testing.assert_allclose(found.covariance, wanted, atol=1e-7 * np.abs(wanted).max())
