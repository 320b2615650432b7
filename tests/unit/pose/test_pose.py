"""Poses from exact and from faulty input: recovery, degenerate cases, the door, and what follows from a pose."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.covariance import error_ellipsoid, point_on_object, relative_pose
from scanner_sim.pose.inputs import PosePrior
from scanner_sim.pose.status import PoseStatus, legend
from scanner_sim.pose.transforms import (
    cayley,
    exponential,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    vector_from_rotation,
)
from scanner_sim.pose.weights import Method

Array = NDArray[np.float64]

SEPARATION, SIGMA, SIGMA_RANGE = 0.05, 56.6e-6, 5e-3
NOISE: dict[str, Any] = {
    "sigma_theta": SIGMA,
    "sigma_phi": SIGMA,
    "sigma_range": SIGMA_RANGE,
    "axis_separation": SEPARATION,
}
METHODS: tuple[Method, ...] = get_args(Method)
SQUARE = 0.5 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
ARRAYS = {
    "square": SQUARE,
    "four with three on a line": np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0], [0.0, 1.0, 0]]),
    "thin": np.vstack([SQUARE, [[0.1, 0.2, 0.02], [-0.3, 0.1, -0.01]]]),
    "tetrahedron": np.array([[0.0, 0, 0], [1.0, 0, 0], [0.0, 1.0, 0], [0.3, 0.3, 0.8]]),
    "seven in space": np.vstack([SQUARE, [[0.0, 0, 0.5], [0.3, 0.1, -0.4], [0.1, -0.3, 0.2]]]),
}


def attitudes(count: int, seed: int) -> tuple[Array, Array]:
    """Return rotations of any attitude (count, 3, 3) and positions within ±0.35 rad at 3–20 m (count, 3)."""
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(count, rng=rng).as_matrix()
    z = rng.uniform(3.0, 20.0, count)
    return rotation, np.column_stack([*(rng.uniform(-0.35, 0.35, (2, count)) * z), z])


def measure(points: Array, rotation: Array, position: Array) -> tuple[Array, Array, Array]:
    """Return exact (Θ, φ, R) of targets, by the judge's geometry."""
    placed = np.einsum("...ij,nj->...ni", rotation, points) + position[..., None, :]
    r, theta, phi = geometry.shot_from_point(placed, SEPARATION)
    return theta, phi, r


def turn_between(rotation: Array, other: Array) -> Array:
    return np.linalg.norm(vector_from_rotation(rotation @ np.swapaxes(other, -1, -2)), axis=-1)


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("method", METHODS)
def test_exact_measurements_give_the_exact_pose(method: Method, name: str) -> None:
    """500 random attitudes, planes seen nearly edge-on and from behind included: 1e-9 m and 1e-9 rad.

    Where another pose fits nearly as well (AMBIGUOUS) the best one is still the true one.
    """
    points = ARRAYS[name] + [0.3, -0.2, 0.1]
    rotation, position = attitudes(500, 3)
    pose = estimate_pose(points, *measure(points, rotation, position), method=method, **NOISE)
    assert np.isin(pose.status, (PoseStatus.VALID, PoseStatus.AMBIGUOUS)).all()
    assert np.abs(pose.position - position).max() < 1e-9
    assert turn_between(pose.rotation, rotation).max() < 1e-9
    assert pose.chi2.max() < 1e-9


def test_three_targets_have_several_poses_one_of_them_true() -> None:
    """Angles of three targets: up to four poses fit exactly; the true one is among the best and the alternatives."""
    points = ARRAYS["tetrahedron"][:3]
    rotation, position = attitudes(500, 4)
    theta, phi, _ = measure(points, rotation, position)
    pose = estimate_pose(points, theta, phi, **NOISE)
    every = np.concatenate([pose.rotation[:, None], pose.alternatives.rotation], axis=1)
    nearest = np.nanmin(turn_between(every, rotation[:, None]), axis=1)
    assert np.mean(nearest < 1e-3) > 0.99
    assert np.mean(pose.status == PoseStatus.AMBIGUOUS) > 0.9
    np.testing.assert_array_equal(pose.dof, 0)


def test_both_poses_of_a_plane_are_found_and_ranked() -> None:
    """A square tilted by ±30° at 10 m: the other tilt is the alternative, with a larger χ²."""
    rotation = rotation_from_vector([0.0, np.deg2rad(30.0), 0.0])
    theta, phi, _ = measure(SQUARE, rotation, np.array([0.2, 0.1, 10.0]))
    pose = estimate_pose(SQUARE, theta, phi, **NOISE)
    assert turn_between(pose.rotation, rotation) < 1e-9
    other = vector_from_rotation(pose.alternatives.rotation[0])
    assert other[1] == pytest.approx(-np.deg2rad(30.0), abs=0.1)
    assert pose.alternatives.chi2[0] > pose.chi2 + 9.0
    assert np.isnan(pose.alternatives.chi2[1:]).all()
    assert pose.status == PoseStatus.VALID


def test_reference_is_scipy() -> None:
    """The same minimum and covariance as ``scipy.optimize.least_squares`` on the judge's geometry: 1e-6 σ, 1e-4."""
    rng = np.random.default_rng(5)
    points = ARRAYS["seven in space"]
    rotation, position = rotation_from_vector([0.3, -0.4, 0.2]), np.array([0.5, -0.3, 6.0])
    theta, phi, _ = measure(points, rotation, position)
    theta, phi = theta + SIGMA * rng.standard_normal(7), phi + SIGMA * rng.standard_normal(7)

    def residuals(change: Array) -> Array:
        turned = Rotation.from_rotvec(change[3:]).as_matrix() @ rotation
        model = measure(points, turned, position + change[:3])
        return np.concatenate([theta - model[0], phi - model[1]]) / SIGMA

    scale = np.array([1e-3] * 6)
    best = least_squares(residuals, np.zeros(6), x_scale=scale, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    pose = estimate_pose(points, theta, phi, **NOISE)
    turn = vector_from_rotation(pose.rotation @ rotation.T)
    apart = (np.concatenate([pose.position - position, turn]) - best.x) / pose.sigma
    assert np.abs(apart).max() < 1e-5
    assert pose.chi2 == pytest.approx(2.0 * best.cost, rel=1e-9)
    np.testing.assert_allclose(pose.sigma, np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac))), rtol=1e-3)


@pytest.mark.parametrize("method", METHODS)
def test_a_pose_does_not_depend_on_its_batch(method: Method) -> None:
    """The same bytes as a batch of one, of 7, and among 5000 on several threads."""
    rng = np.random.default_rng(6)
    rotation, position = attitudes(5000, 6)
    theta, phi, r = measure(SQUARE, rotation, position)
    theta = theta + SIGMA * rng.standard_normal(theta.shape)
    whole = estimate_pose(SQUARE, theta, phi, r, method=method, **NOISE)
    for count in (1, 2, 7):
        part = estimate_pose(SQUARE, theta[:count], phi[:count], r[:count], method=method, **NOISE)
        np.testing.assert_array_equal(part.position, whole.position[:count])
        np.testing.assert_array_equal(part.covariance, whole.covariance[:count])
    alone = estimate_pose(SQUARE, theta[0], phi[0], r[0], method=method, **NOISE)
    np.testing.assert_allclose(alone.rotation, whole.rotation[0], atol=1e-12)
    assert alone.status.shape == ()


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_of_two_poses_none_stands_for_the_other(method: Method) -> None:
    """One of two that settles first must not be overwritten by the other, which goes on alone."""
    rng = np.random.default_rng(12)
    rotation, position = attitudes(400, 12)
    position[:, 2] = rng.uniform(4.0, 8.0, 400)
    points = ARRAYS["seven in space"]
    placed = points @ np.swapaxes(rotation, 1, 2) + position[:, None]
    r, theta, phi = geometry.shot_from_point(placed, SEPARATION)
    theta, phi = (angle + SIGMA * rng.standard_normal(angle.shape) for angle in (theta, phi))
    r = r + SIGMA_RANGE * rng.standard_normal(r.shape)
    whole = estimate_pose(points, theta, phi, r, method=method, **NOISE)
    for first in range(0, 400, 2):
        rows = slice(first, first + 2)
        pair = estimate_pose(points, theta[rows], phi[rows], r[rows], method=method, **NOISE)
        np.testing.assert_array_equal(pair.position, whole.position[rows])


def test_hidden_targets_are_left_out_and_too_few_are_a_status() -> None:
    points = ARRAYS["seven in space"]
    rotation, position = attitudes(5, 7)
    theta, phi, r = measure(points, rotation, position)
    theta[0] = np.nan
    theta[1, 2:] = np.nan
    phi[2, 4:] = np.nan
    theta[3, 5:] = np.nan
    pose = estimate_pose(points, theta, phi, **NOISE)
    wanted = [PoseStatus.HIDDEN, PoseStatus.TOO_FEW, PoseStatus.VALID, PoseStatus.VALID, PoseStatus.VALID]
    assert [PoseStatus(code) for code in pose.status] == wanted
    assert np.isnan(pose.position[:2]).all()
    assert np.isnan(pose.covariance[:2]).all()
    assert np.abs(pose.position[2:] - position[2:]).max() < 1e-9
    np.testing.assert_array_equal(np.isnan(pose.residuals[3, :, 0]), np.isnan(theta[3]))
    np.testing.assert_array_equal(pose.weights[3], ~np.isnan(theta[3]))
    np.testing.assert_array_equal(pose.dof, [0, 0, 2, 4, 8])
    # Without a range a target still counts with its angles.
    r[4, 3:] = np.nan
    joint = estimate_pose(points, theta[4], phi[4], r[4], method="joint", **NOISE)
    assert joint.dof == 11
    assert np.abs(joint.position - position[4]).max() < 1e-9


def test_targets_on_a_line_and_near_a_line() -> None:
    """On a line: a status. A ten-thousandth off it, or a tiny far array: finite, with a covariance that says so, or, of
    16 400 such poses once, undetermined: were it eight times as many, four of 200 came with one seed in 10⁵."""
    line = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0], [1.4, 0.0, 0.0]])
    rng = np.random.default_rng(8)
    rotation, position = attitudes(200, 8)
    theta, phi, _ = measure(line, rotation, position)
    assert (estimate_pose(line, theta, phi, **NOISE).status == PoseStatus.COLLINEAR).all()
    for points in (line + 1e-4 * np.array([[0, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 1]]), 0.02 * SQUARE):
        theta, phi, _ = measure(points, rotation, 2.0 * position)
        theta = theta + SIGMA * rng.standard_normal(theta.shape)
        pose = estimate_pose(points, theta, phi, **NOISE)
        given = pose.status != PoseStatus.UNDETERMINED
        assert np.count_nonzero(~given) < 4
        assert all(PoseStatus(code).has_pose for code in pose.status[given])
        assert np.isfinite(pose.position[given]).all()
        assert np.isfinite(pose.covariance[given]).all()
        assert np.median(pose.sigma[given, 3:].max(axis=1)) > 0.05


@pytest.mark.parametrize("method", METHODS)
def test_what_the_measurements_leave_open_is_a_status(method: Method) -> None:
    """Angles that err by a radian lead anywhere: a pose is given with a covariance that is positive, or not at all."""
    rng = np.random.default_rng(9)
    points = ARRAYS["seven in space"][:3]
    theta, phi, r = measure(points, np.eye(3), np.array([0.0, 0.0, 10.0]))
    theta, phi = (angle + rng.standard_normal((400, 3)) for angle in (theta, phi))
    wide = {"sigma_theta": 1.0, "sigma_phi": 1.0, "sigma_range": 10.0, "axis_separation": SEPARATION}
    pose = estimate_pose(points, theta, phi, np.tile(r, (400, 1)), method=method, **wide)
    known = np.isfinite(pose.covariance).all(axis=(-2, -1))
    sizes = pose.sigma[known]
    correlation = pose.covariance[known] / (sizes[:, :, None] * sizes[:, None, :])
    assert known.any()
    assert np.linalg.eigvalsh(correlation).min() > 0.0
    given = np.array([PoseStatus(code).has_pose for code in pose.status])
    np.testing.assert_array_equal(given, known)
    np.testing.assert_array_equal(np.isfinite(pose.position).all(axis=-1), known)
    if method == "uv":  # without ranges many run off along their lines of sight
        assert np.count_nonzero(pose.status == PoseStatus.UNDETERMINED) > 20


def test_a_prior_tells_what_the_measurements_leave_open() -> None:
    """Known to 1 µm and one radian, where turning about the origin moves the targets' centre: a pose, and its σ."""
    points, rotation, position = ARRAYS["seven in space"][:3], np.eye(3), np.array([0.0, 0.0, 10.0])
    theta, phi, _ = measure(points, rotation, position)
    known = PosePrior(position, rotation, np.diag([1e-12] * 3 + [1.0] * 3))
    wide = {"sigma_theta": 1e6, "sigma_phi": 1e6, "axis_separation": SEPARATION}
    pose = estimate_pose(points, theta, phi, prior=known, **wide)
    assert pose.status != PoseStatus.UNDETERMINED
    np.testing.assert_allclose(pose.sigma, [1e-6] * 3 + [1.0] * 3, rtol=0.02)


@pytest.mark.parametrize("method", METHODS)
def test_a_mirrored_array_is_an_error(method: Method) -> None:
    """Also in a batch; where only some poses are mirrored it is their status."""
    points = ARRAYS["seven in space"]
    rotation, position = attitudes(3, 9)
    theta, phi, r = measure(points, rotation, position)
    wrong = points * [1.0, -1.0, 1.0]
    with pytest.raises(InputError, match="mirror"):
        estimate_pose(wrong, theta, phi, r, method=method, **NOISE)
    mixed = np.stack([points, wrong, points])
    pose = estimate_pose(mixed, theta, phi, r, method=method, **NOISE)
    assert pose.status.tolist() == [PoseStatus.VALID, PoseStatus.MIRRORED, PoseStatus.VALID]
    assert np.isnan(pose.position[1]).all()


def test_names_go_with_the_targets() -> None:
    """Mappings are put into the order of the object's; names that do not match are listed."""
    rotation, position = rotation_from_vector([0.1, 0.5, 0.0]), np.array([0.1, 0.2, 7.0])
    theta, phi, _ = measure(SQUARE, rotation, position)
    names = ["a", "b", "c", "d"]
    points = dict(zip(names, SQUARE, strict=True))
    angles = [dict(reversed(list(zip(names, values, strict=True)))) for values in (theta, phi)]
    pose = estimate_pose(points, *angles, **NOISE)
    np.testing.assert_allclose(pose.position, estimate_pose(SQUARE, theta, phi, **NOISE).position, atol=1e-12)
    del angles[0]["b"]
    with pytest.raises(InputError, match="theta are not those of object_points: b missing"):
        estimate_pose(points, *angles, **NOISE)
    with pytest.raises(InputError, match="Some arguments go by the names"):
        estimate_pose(points, theta, angles[1], **NOISE)
    angles[0]["b"] = [0.0, 0.1]
    with pytest.raises(InputError, match=r"targets of theta have the shapes \(\), \(2,\)"):
        estimate_pose(points, *angles, **NOISE)
    angles[0]["b"] = "left"
    with pytest.raises(InputError, match="theta is not an array of numbers"):
        estimate_pose(points, *angles, **NOISE)


@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
@pytest.mark.parametrize("robust", [None, "huber", "ransac"])
@pytest.mark.parametrize("leading", [(0,), (3, 0)])
def test_no_observations_have_no_poses(method: Any, robust: Any, leading: tuple[int, ...]) -> None:
    """Claim: a batch of none is a batch: every result has the leading axes of the arguments."""
    none = np.zeros((*leading, 4))
    common = np.zeros((4, 3, 2))
    pose = estimate_pose(SQUARE, none, none, none, method=method, robust=robust, common=common, **NOISE)
    assert pose.scanner_from_object.shape == (*leading, 4, 4)
    assert pose.covariance.shape == (*leading, 6, 6)
    assert pose.residuals.shape == (*leading, 4, 2 if method == "uv" else 3)
    assert pose.alternatives.rotation.shape == (*leading, 3, 3, 3)
    assert pose.status.shape == pose.dof.shape == leading


FAULTS: dict[str, tuple[dict[str, Any], str]] = {
    "duplicate": ({"object_points": SQUARE[[0, 1, 2, 0]]}, "Targets 0 and 3"),
    "nearly duplicate": (
        {"object_points": SQUARE[[0, 1, 2, 0]] + 5e-10 * np.eye(4)[:, 1:]},
        "Targets 0 and 3",
    ),
    "not finite": ({"object_points": np.where(SQUARE == 0.5, np.nan, SQUARE)}, "not finite"),
    "no target": ({"object_points": np.zeros((0, 3))}, "holds no target"),
    "shape of points": ({"object_points": SQUARE[:, :2]}, "object_points has the shape"),
    "count": ({"theta": np.zeros(3)}, "there are 4 targets"),
    "infinite": ({"theta": np.full(4, np.inf)}, "theta is infinite"),
    "word": ({"phi": "down"}, "phi is not an array"),
    "sigma": ({"sigma_theta": 0.0}, "sigma_theta must be positive"),
    "sigma shape": ({"sigma_phi": np.ones(3)}, "sigma_phi has the shape"),
    "no ranges": ({"method": "xyz", "ranges": None}, "needs ranges"),
    "negative range": ({"ranges": np.full(4, -1.0)}, "ranges must be positive"),
    "method": ({"method": "vu"}, "Give one of uv"),
    "robust": ({"robust": "median"}, "huber, ransac"),
    "equal and robust": ({"robust": "huber", "point_weights": "equal"}, "exclude"),
    "weights": ({"point_weights": "none"}, "covariance or equal"),
    "separation": ({"axis_separation": -0.1}, "axis_separation"),
    "survey": ({"sigma_object": -1.0}, "sigma_object"),
    "correlation": ({"covariance_theta_range": 1.0}, "less than sigma_theta times"),
    "batch": ({"theta": np.zeros((2, 4)), "phi": np.zeros((3, 4))}, "do not fit together"),
    "prior": ({"prior": PosePrior(np.zeros(3), -np.eye(3), np.eye(6))}, "not a rotation"),
    "prior covariance": ({"prior": PosePrior(np.zeros(3), np.eye(3), np.zeros((6, 6)))}, "positive definite"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_bad_input_is_a_clear_error(fault: str) -> None:
    changes, message = FAULTS[fault]
    theta, phi, r = measure(SQUARE, np.eye(3), np.array([0.0, 0.0, 5.0]))
    given: dict[str, Any] = {"object_points": SQUARE, "theta": theta, "phi": phi, "ranges": r, **NOISE}
    with pytest.raises(InputError, match=message):
        estimate_pose(**{**given, **changes})


def test_gradients_are_those_of_the_judges_geometry() -> None:
    """Values equal to rounding; gradients against central differences of 1 µm: 1e-9 of their size."""
    points = np.random.default_rng(10).uniform([-2.0, -2.0, 3.0], [2.0, 2.0, 9.0], (50, 3)).T
    values, gradients = project(points, SEPARATION, with_range=True)
    np.testing.assert_allclose(values[[2, 0, 1]], geometry.shot_from_point(points.T, SEPARATION), rtol=1e-14)
    step = 1e-6
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        plus, minus = (geometry.shot_from_point(points.T + s * shift, SEPARATION) for s in (1.0, -1.0))
        slope = (np.stack(plus) - np.stack(minus))[[1, 2, 0]] / (2.0 * step)
        np.testing.assert_allclose(gradients[axis], slope, rtol=0.0, atol=1e-8)


def test_spellings_of_rotations() -> None:
    rotation = Rotation.random(100, rng=np.random.default_rng(11)).as_matrix()
    np.testing.assert_allclose(rotation_from_vector(vector_from_rotation(rotation)), rotation, atol=1e-14)
    quaternion = quaternion_from_rotation(rotation)
    assert (quaternion[:, 0] >= 0.0).all()
    np.testing.assert_allclose(rotation_from_quaternion(3.0 * quaternion), rotation, atol=1e-14)
    small = 1e-4 * np.random.default_rng(12).standard_normal((3, 5))
    np.testing.assert_allclose(cayley(small), exponential(small), atol=1e-12)
    np.testing.assert_array_equal(exponential(np.zeros((3, 1)))[..., 0], np.eye(3))
    assert np.isnan(vector_from_rotation(np.full((3, 3), np.nan))).all()


def test_points_of_the_object_and_their_ellipsoid() -> None:
    """At the origin the covariance is that of the position; the ellipsoid has its eigenvalues as squares."""
    rotation, position = rotation_from_vector([0.2, 0.4, 0.1]), np.array([0.4, 0.1, 8.0])
    pose = estimate_pose(SQUARE, *measure(SQUARE, rotation, position)[:2], **NOISE)
    place, covariance = point_on_object(pose, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(place, position, atol=1e-9)
    np.testing.assert_array_equal(covariance, pose.covariance[:3, :3])
    place, covariance = point_on_object(pose, (0.0, 0.0, 2.0))
    np.testing.assert_allclose(place, position + 2.0 * rotation[:, 2], atol=1e-9)
    # A boss of 2 m swings with the tilts, which a plane knows badly: its error is almost all theirs.
    lengths, axes = error_ellipsoid(covariance)
    assert lengths[0] > 3.0 * pose.sigma[:2].max()
    np.testing.assert_allclose(axes @ np.diag(lengths**2) @ axes.T, covariance, rtol=1e-9, atol=1e-15)
    assert np.isnan(error_ellipsoid(np.full((3, 3), np.nan))[0]).all()


def test_codes_have_sentences() -> None:
    assert set(legend()) == {str(int(code)) for code in PoseStatus}
    assert PoseStatus.AMBIGUOUS.has_pose
    assert not PoseStatus.COLLINEAR.has_pose


def test_relative_pose_of_two_objects() -> None:
    """M_a⁻¹ M_b, exact from exact measurements; its covariance is judged in the statistical tests."""
    (ra, rb), (ta, tb) = attitudes(2, 13)
    a, b = (
        estimate_pose(SQUARE, *measure(SQUARE, r, t), method="joint", **NOISE)
        for r, t in ((ra, ta), (rb, tb))
    )
    both = np.linalg.inv(a.scanner_from_object) @ b.scanner_from_object
    found = relative_pose(a, b)
    np.testing.assert_allclose(found.position, both[:3, 3], atol=1e-9)
    np.testing.assert_allclose(found.rotation, ra.T @ rb, atol=1e-9)
    np.testing.assert_allclose(found.covariance, found.covariance.T, rtol=1e-6, atol=1e-18)
