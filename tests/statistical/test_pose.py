"""Do the covariances of poses tell the truth, and do wrong targets leave them alone?

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from claims import at_most
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial.transform import Rotation

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry
from scanner_sim.pose.covariance import point_on_object, relative_pose
from scanner_sim.pose.inputs import PosePrior
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import rotation_from_vector, vector_from_rotation
from scanner_sim.pose.weights import Method

Array = NDArray[np.float64]

SEPARATION, SIGMA, SIGMA_RANGE = 0.05, 56.6e-6, 5e-3
NOISE: dict[str, Any] = {
    "sigma_theta": SIGMA,
    "sigma_phi": SIGMA,
    "sigma_range": SIGMA_RANGE,
    "axis_separation": SEPARATION,
}
POINTS = np.array(
    [
        [-0.5, -0.5, 0.0],
        [0.5, -0.5, 0.0],
        [0.5, 0.5, 0.0],
        [-0.5, 0.5, 0.0],
        [0.0, 0.1, 0.5],
        [0.3, 0.1, -0.4],
        [0.1, -0.3, 0.2],
        [-0.2, 0.3, 0.1],
    ]
)
FAR_ORIGIN = POINTS + np.array([0.3, -0.2, 1.0])


def poses(count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return rotations and positions: turned by up to 0.7 rad about each axis, 4–8 m, ±0.2 rad off the axis."""
    rotation = rotation_from_vector(rng.uniform(-0.7, 0.7, (count, 3)))
    z = rng.uniform(4.0, 8.0, count)
    return rotation, np.column_stack([*(rng.uniform(-0.2, 0.2, (2, count)) * z), z])


def measure(
    points: Array, rotation: Array, position: Array, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return (Θ, φ, R) with noise; the points may differ from pose to pose."""
    placed = points @ np.swapaxes(rotation, -1, -2) + position[:, None]
    r, theta, phi = geometry.shot_from_point(placed, SEPARATION)
    return (
        theta + SIGMA * rng.standard_normal(theta.shape),
        phi + SIGMA * rng.standard_normal(theta.shape),
        r + SIGMA_RANGE * rng.standard_normal(theta.shape),
    )


def errors(rotation: Array, position: Array, true_rotation: Array, true_position: Array) -> Array:
    """Return (δt, δω) from the estimate to the truth, shape (count, 6)."""
    turn = vector_from_rotation(true_rotation @ np.swapaxes(rotation, -1, -2))
    return np.concatenate([true_position - position, turn], axis=-1)


def check_normal(normalised: Array) -> None:
    """Compare components (count, k) with the standard normal law.

    Mean within 4.9 standard errors, variance within 4.9 of its own and 1 % for the second order, Kolmogorov-Smirnov
    p > 1e-6: of some 120 comparisons of this file together less than one false alarm in 10⁴ seeds.
    """
    count = len(normalised)
    assert np.abs(normalised.mean(axis=0)).max() < 4.9 / np.sqrt(count)
    assert np.abs(normalised.var(axis=0) - 1.0).max() < 4.9 * np.sqrt(2.0 / count) + 0.01
    assert min(stats.kstest(column, "norm").pvalue for column in normalised.T) > 1e-6


def check_chi2(squares: Array, dof: int) -> None:
    """Compare sums of squares with the χ² law: Kolmogorov-Smirnov p > 1e-6, mean within 4.9 errors and 0.5 %."""
    assert stats.kstest(squares, stats.chi2(dof).cdf).pvalue > 1e-6
    assert abs(squares.mean() - dof) < 4.9 * np.sqrt(2.0 * dof / len(squares)) + 0.005 * dof


CASES: dict[str, tuple[Array, dict[str, Any], int]] = {
    "uv": (FAR_ORIGIN, {"method": "uv"}, 10),
    "xyz": (FAR_ORIGIN, {"method": "xyz"}, 18),
    "xyz, equal weights": (FAR_ORIGIN, {"method": "xyz", "point_weights": "equal"}, 0),
    "joint": (FAR_ORIGIN, {"method": "joint"}, 18),
    "uv, four in a plane": (POINTS[:4], {"method": "uv"}, 2),
    "joint, four in a plane": (POINTS[:4], {"method": "joint"}, 6),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_coverage_and_residuals(name: str) -> None:
    """Claim: (truth − estimate)/σ of all six components is standard normal, and χ² of the residuals is a χ².

    Set-up: 12 000 random poses at 4–8 m, noise on angles and ranges; the object's origin stands 1 m from its targets,
    so that the covariance of the origin has strong correlations. Expected: mean 0, variance 1, normal law for each
    component, χ²₆ for the Mahalanobis distance, χ² with dof for the residuals (equal weights do not minimise it).
    Tolerance: see ``check_normal``; a σ wrong by 5 % shifts the variance by 10 %, seven of its errors.
    """
    points, options, dof = CASES[name]
    rng = np.random.default_rng(31)
    rotation, position = poses(12_000, rng)
    pose = estimate_pose(points, *measure(points, rotation, position, rng), **NOISE, **options)
    found = pose.status <= 1
    assert found.mean() > 0.999
    apart = errors(pose.rotation, pose.position, rotation, position)[found]
    check_normal(apart / pose.sigma[found])
    distance = np.einsum("ki,kij,kj->k", apart, np.linalg.inv(pose.covariance[found]), apart)
    assert abs(distance.mean() - 6.0) < 4.9 * np.sqrt(12.0 / len(distance)) + 0.12
    if dof:
        assert (pose.dof[found] == dof).all()
        check_chi2(pose.chi2[found], dof)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
def test_uncertain_survey(method: Method) -> None:
    """Claim: errors of the surveyed points go into covariance and χ².

    Set-up: 6000 poses, each of an object whose points were surveyed with 1, 2, 3 mm along its axes. Expected and
    tolerance: as above; without ``sigma_object`` χ² would be some 30 times its degrees of freedom.
    """
    rng = np.random.default_rng(32)
    survey = np.array([1e-3, 2e-3, 3e-3])
    rotation, position = poses(6000, rng)
    measured = measure(POINTS, rotation, position, rng)
    surveyed = POINTS + survey * rng.standard_normal((6000, *POINTS.shape))
    spread = np.broadcast_to(survey, POINTS.shape)
    pose = estimate_pose(surveyed, *measured, method=method, sigma_object=spread, **NOISE)
    check_normal(errors(pose.rotation, pose.position, rotation, position) / pose.sigma)
    assert abs(pose.chi2.mean() / pose.dof[0] - 1.0) < 0.03


@pytest.mark.slow
def test_prior_points_and_relative_poses() -> None:
    """Claim: priors, points of the object and relative poses have the covariance they state.

    Set-up: 6000 pairs of poses, the first with a prior of 1 mm and 2 mrad that is itself wrong by that much, whose
    three targets alone would be ambiguous. Expected: standard normal errors. Tolerance: ``check_normal``.
    """
    rng = np.random.default_rng(33)
    rotation, position = poses(6000, rng)
    spread = np.array([1e-3] * 3 + [2e-3] * 3)
    wrong = spread * rng.standard_normal((6000, 6))
    prior = PosePrior(
        position + wrong[:, :3], rotation_from_vector(wrong[:, 3:]) @ rotation, np.diag(spread**2)
    )
    theta, phi, _ = measure(POINTS[:3], rotation, position, rng)
    a = estimate_pose(POINTS[:3], theta, phi, prior=prior, **NOISE)
    check_normal(errors(a.rotation, a.position, rotation, position) / a.sigma)
    check_chi2(a.chi2, 6)

    other_rotation, other_position = poses(6000, rng)
    b = estimate_pose(POINTS, *measure(POINTS, other_rotation, other_position, rng), method="joint", **NOISE)
    back = np.swapaxes(rotation, -1, -2)
    true_place = np.einsum("kij,kj->ki", back, other_position - position)
    found = relative_pose(a, b)
    apart = errors(found.rotation, found.position, back @ other_rotation, true_place)
    check_normal(apart / np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)))

    boss = np.array([0.2, -0.4, -1.5])
    place, covariance = point_on_object(b, boss)
    apart = other_position + other_rotation @ boss - place
    check_normal(apart / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))


def test_triangulation_ranges_follow_the_angle() -> None:
    """Claim: with the covariance of Θ and R the joint pose is right although R was computed with a wrong Θ.

    Set-up: 6000 poses whose ranges are off by their own noise of 1 mm and by ∂R/∂Θ δΘ with the angle's own error, here
    5 m/rad, as at 10 m and Θ = 0.5; 0.3 mrad. Expected: normal errors and χ². Tolerance: as above; without the
    covariance χ² is too small or too large by the share of the common error, a factor above 1.5.
    """
    rng = np.random.default_rng(34)
    sigma, slope = 3e-4, 5.0
    rotation, position = poses(6000, rng)
    r, theta, phi = geometry.shot_from_point(
        POINTS @ np.swapaxes(rotation, 1, 2) + position[:, None], SEPARATION
    )
    off = sigma * rng.standard_normal(theta.shape)
    pose = estimate_pose(
        POINTS,
        theta + off,
        phi + sigma * rng.standard_normal(theta.shape),
        r + slope * off + 1e-3 * rng.standard_normal(theta.shape),
        sigma_theta=sigma,
        sigma_phi=sigma,
        sigma_range=float(np.hypot(slope * sigma, 1e-3)),
        covariance_theta_range=slope * sigma**2,
        axis_separation=SEPARATION,
        method="joint",
    )
    check_normal(errors(pose.rotation, pose.position, rotation, position) / pose.sigma)
    check_chi2(pose.chi2, 18)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
def test_wrong_targets_are_found(method: Method) -> None:
    """Claim: two wrong targets of eight do not touch a pose by ``ransac``.

    Set-up: 300 poses; two targets are off by 5–50 mrad and 0.1–1 m (another bright spot, a wrong name). Expected: both
    rejected in every pose, no more than 1 % of the good ones (χ² at 99.9 %, two per cent of the poses), and Mahalanobis
    distances of χ²₆. Tolerance: mean distance 6 ± 4.5 √(12/300) = 0.9. Plain least squares is off by hundreds of σ.
    One pose in 10⁴ is called implausible by its residuals.
    """
    rng = np.random.default_rng(35)
    rotation, position = poses(300, rng)
    theta, phi, r = measure(POINTS, rotation, position, rng)
    wrong = rng.permuted(np.tile(np.arange(8), (300, 1)), axis=1)[:, :2]
    rows = np.arange(300)[:, None]
    theta[rows, wrong] += rng.uniform(5e-3, 5e-2, (300, 2))
    phi[rows, wrong] -= rng.uniform(5e-3, 5e-2, (300, 2))
    r[rows, wrong] += rng.uniform(0.1, 1.0, (300, 2))
    pose = estimate_pose(POINTS, theta, phi, r, method=method, robust="ransac", **NOISE)
    implausible = pose.status == PoseStatus.IMPLAUSIBLE
    assert at_most(int(implausible.sum()), 300, 1e-4)
    assert (pose.status[~implausible] <= PoseStatus.AMBIGUOUS).all()
    assert (pose.weights[rows, wrong] == 0.0).all()
    assert pose.weights.sum() > 0.99 * 300 * 6
    apart = errors(pose.rotation, pose.position, rotation, position)
    distance = np.einsum("ki,kij,kj->k", apart, np.linalg.inv(pose.covariance), apart)
    assert abs(distance.mean() - 6.0) < 0.9


@pytest.mark.slow
def test_huber_bounds_the_pull_of_a_doubtful_target() -> None:
    """Claim: one target off by 30 σ pulls a pose by ``huber`` less than a third as far as plain least squares.

    Set-up: 2000 poses by angles, the fifth target off by 30 σ in Θ. Expected: root mean square Mahalanobis distance
    below a third of the plain one. The ratio is 0.2 and its sampling error below 0.01.
    """
    rng = np.random.default_rng(36)
    rotation, position = poses(2000, rng)
    theta, phi, _ = measure(POINTS, rotation, position, rng)
    theta[:, 4] += 30.0 * SIGMA
    lengths = []
    for robust in ("huber", None):
        pose = estimate_pose(POINTS, theta, phi, robust=robust, **NOISE)
        apart = errors(pose.rotation, pose.position, rotation, position) / pose.sigma
        lengths.append(np.sqrt(np.mean(apart**2)))
        if robust == "huber":
            assert np.median(pose.weights[:, 4]) < 0.15
    assert lengths[0] < lengths[1] / 3.0


def few_targets(name: str, count: int, rng: np.random.Generator) -> Array:
    """Return layouts of few targets that angles tell badly, shape (count, n, 3) [m]."""
    points = rng.uniform(-0.5, 0.5, (count, 5 if name == "five" else 4, 3))
    if name == "T":
        return np.tile([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (count, 1, 1))
    if name in ("quadrangle", "three on a line", "narrow"):
        points[..., 2] = 0.0
    else:
        points[..., 2] *= 10.0 ** rng.uniform(-4.0, 0.0, (count, 1))
    if name in ("three on a line", "nearly on a line"):
        off = 0.0 if name == "three on a line" else 10.0 ** rng.uniform(-6.0, -1.5, (count, 1, 1))
        points[:, :3, 1:] = off * rng.standard_normal((count, 3, 2))
    if name == "narrow":
        points[..., 1] *= 10.0 ** rng.uniform(-3.0, -1.0, (count, 1))
    return points


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["quadrangle", "three on a line", "nearly on a line", "T", "thick or thin", "five", "narrow"]
)
def test_exact_angles_never_give_a_wrong_valid_pose(name: str) -> None:
    """Claim: with exact angles a pose of status VALID is the true one, whatever the layout and the attitude.

    Set-up: 2000 layouts and attitudes of a kind, planes from behind and nearly edge-on included, 3–20 m. Expected: none
    lies farther from the truth than its covariance covers, 99 % of χ²₆. Tolerance: none; errors are exact. With starts
    from the plane and one three of targets alone 0.2 to 4 % of the cases on a line or nearly so are wrong, and 2 % of
    those where all four are within 0.5 to 50 mm of a line, of which one in ten is told well enough to be valid.
    """
    rng = np.random.default_rng(37)
    points = few_targets(name, 2000, rng)
    rotation = Rotation.random(2000, rng=rng).as_matrix()
    z = rng.uniform(3.0, 20.0, 2000)
    position = np.column_stack([*(rng.uniform(-0.35, 0.35, (2, 2000)) * z), z])
    placed = np.einsum("kij,knj->kni", rotation, points) + position[:, None]
    _, theta, phi = geometry.shot_from_point(placed, SEPARATION)
    pose = estimate_pose(points, theta, phi, **NOISE)
    valid = pose.status == PoseStatus.VALID
    assert valid.mean() > (0.05 if name == "narrow" else 0.3)
    apart = errors(pose.rotation, pose.position, rotation, position)[valid]
    distance = np.einsum("ki,kij,kj->k", apart, np.linalg.inv(pose.covariance[valid]), apart)
    assert distance.max() < stats.chi2(6).ppf(0.99)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
def test_implausible_residuals_are_never_valid(method: Method) -> None:
    """Claim: a target that is not where it was surveyed makes a pose implausible, and chance does once in 10⁴.

    Set-up: 500 poses of eight targets, without and with one that is wrong by 60 σ of its angle and 40 of its range.
    Expected: all of the wrong ones IMPLAUSIBLE, with the pose beside it; of the right ones 0.05, and fewer than 4 but
    for one seed in 10⁶.
    """
    rng = np.random.default_rng(38)
    rotation, position = poses(500, rng)
    theta, phi, r = measure(POINTS, rotation, position, rng)
    right = estimate_pose(POINTS, theta, phi, r, method=method, **NOISE)
    assert np.count_nonzero(right.status == PoseStatus.IMPLAUSIBLE) < 4
    theta[:, 3] += 60.0 * SIGMA
    r[:, 3] += 40.0 * SIGMA_RANGE
    wrong = estimate_pose(POINTS, theta, phi, r, method=method, **NOISE)
    assert (wrong.status == PoseStatus.IMPLAUSIBLE).all()
    assert np.isfinite(wrong.position).all()
