"""One pose against a plain least-squares fit of its own: unequal weights, χ², degrees of freedom, residuals, σ."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from claims import LEVEL, mean_square
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.inputs import PosePrior
from scanner_sim.pose.result import PoseEstimate
from scanner_sim.pose.transforms import vector_from_rotation

Array = NDArray[np.float64]

D = 0.05
POINTS = np.array(
    [
        [-0.5, -0.4, 0.0],
        [0.5, -0.5, 0.1],
        [0.6, 0.5, -0.1],
        [-0.5, 0.6, 0.0],
        [0.1, 0.0, 0.5],
        [0.3, -0.1, -0.4],
    ]
) + np.array([0.2, -0.1, 0.3])
COUNT = len(POINTS)
TURN, PLACE = Rotation.from_rotvec([0.3, -0.4, 0.2]).as_matrix(), np.array([0.7, -0.5, 6.0])
# No two of them alike, so that none can stand for another.
SIGMA_THETA = np.array([1.0, 2.0, 4.0, 1.5, 3.0, 2.5]) * 20e-6
SIGMA_PHI = np.array([3.0, 1.0, 1.5, 5.0, 2.0, 0.8]) * 60e-6
SIGMA_RANGE = np.array([2.0, 1.0, 5.0, 3.0, 1.2, 0.7]) * 0.4e-3
CORRELATION = np.array([0.5, -0.3, 0.7, 0.0, -0.6, 0.2])
SHARED = CORRELATION * SIGMA_THETA * SIGMA_RANGE


def seen(turn: Array, place: Array, points: Array = POINTS) -> Array:
    """Return (Θ, φ, R) of the targets by the judge's geometry, shape (n, 3)."""
    r, theta, phi = geometry.shot_from_point(points @ turn.T + place, D)
    return np.stack([theta, phi, r], axis=-1)


def measured() -> Array:
    """Return observations with errors of about three standard deviations, shape (n, 3)."""
    scatter = np.random.default_rng(8).normal(size=(COUNT, 3))
    return seen(TURN, PLACE) + 3.0 * scatter * np.stack([SIGMA_THETA, SIGMA_PHI, SIGMA_RANGE], axis=-1)


def covariances(*, together: bool) -> Array:
    """Return the covariance of each observation, shape (n, 3, 3)."""
    found = np.zeros((COUNT, 3, 3))
    for axis, sigma in enumerate((SIGMA_THETA, SIGMA_PHI, SIGMA_RANGE)):
        found[:, axis, axis] = sigma**2
    if together:
        found[:, 0, 2] = found[:, 2, 0] = SHARED
    return found


def plain_fit(whiten: Any) -> tuple[Array, Array, Array, float]:
    """Return position, rotation, covariance and χ² of the least squares of ``whiten(turn, place)``."""

    def residuals(change: Array) -> Array:
        return np.asarray(whiten(Rotation.from_rotvec(change[3:]).as_matrix() @ TURN, PLACE + change[:3]))

    precise: dict[str, Any] = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "jac": "3-point"}
    best = least_squares(residuals, np.zeros(6), x_scale=np.full(6, 1e-3), **precise)
    turned = Rotation.from_rotvec(best.x[3:]).as_matrix() @ TURN
    # Derivatives by turns of the pose that was found, not of the one it began with.
    steps = 1e-6 * np.eye(6)
    rows = (
        np.stack(
            [
                np.asarray(
                    whiten(Rotation.from_rotvec(s[3:]).as_matrix() @ turned, PLACE + best.x[:3] + s[:3])
                )
                - np.asarray(
                    whiten(Rotation.from_rotvec(-s[3:]).as_matrix() @ turned, PLACE + best.x[:3] - s[:3])
                )
                for s in steps
            ],
            axis=-1,
        )
        / 2e-6
    )
    return PLACE + best.x[:3], turned, np.linalg.inv(rows.T @ rows), 2.0 * float(best.cost)


def assert_is(pose: PoseEstimate, expected: tuple[Array, Array, Array, float], dof: int) -> None:
    """Assert that a pose is the expected one: 1e-4 σ, covariance to 1e-5, χ² to 1e-8."""
    position, rotation, covariance, chi2 = expected
    sigma = np.sqrt(np.diag(covariance))
    apart = np.concatenate([pose.position - position, vector_from_rotation(pose.rotation @ rotation.T)])
    assert np.abs(apart / sigma).max() < 1e-4
    np.testing.assert_allclose(
        pose.covariance / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-5
    )
    assert pose.chi2 == pytest.approx(chi2, rel=1e-8)
    assert pose.dof == dof


def arguments(*, ranges: bool, together: bool = False) -> dict[str, Any]:
    """Return what the estimate is given."""
    values = measured()
    given: dict[str, Any] = {
        "object_points": POINTS,
        "theta": values[:, 0],
        "phi": values[:, 1],
        "sigma_theta": SIGMA_THETA,
        "sigma_phi": SIGMA_PHI,
        "axis_separation": D,
    }
    if ranges:
        given |= {"ranges": values[:, 2], "sigma_range": SIGMA_RANGE}
    if together:
        given |= {"covariance_theta_range": SHARED}
    return given


def test_angles_weigh_by_their_own_sigmas() -> None:
    """Claim: resection is the least squares of Θ over σ_Θ and φ over σ_φ; its residuals are measured less predicted."""
    values = measured()

    def whiten(turn: Array, place: Array) -> Array:
        apart = values - seen(turn, place)
        return np.concatenate([apart[:, 0] / SIGMA_THETA, apart[:, 1] / SIGMA_PHI])

    expected = plain_fit(whiten)
    pose = estimate_pose(**arguments(ranges=False))
    assert_is(pose, expected, 2 * COUNT - 6)
    residuals = (values - seen(pose.rotation, pose.position))[:, :2]
    np.testing.assert_allclose(pose.residuals, residuals, atol=1e-12)
    assert np.sum((residuals / np.stack([SIGMA_THETA, SIGMA_PHI], axis=-1)) ** 2) == pytest.approx(pose.chi2)


@pytest.mark.parametrize("together", [False, True])
def test_angles_and_ranges_weigh_by_their_covariance(together: bool) -> None:
    """Claim: the joint fit is the least squares of eᵀC⁻¹e, with the covariance of Θ and R where there is one."""
    values = measured()
    root = np.linalg.inv(np.linalg.cholesky(covariances(together=together)))

    def whiten(turn: Array, place: Array) -> Array:
        return np.einsum("nab,nb->na", root, values - seen(turn, place)).ravel()

    pose = estimate_pose(**arguments(ranges=True, together=together), method="joint")
    assert_is(pose, plain_fit(whiten), 3 * COUNT - 6)
    np.testing.assert_allclose(pose.residuals, values - seen(pose.rotation, pose.position), atol=1e-9)


@pytest.mark.parametrize("together", [False, True])
def test_points_weigh_by_their_covariance(together: bool) -> None:
    """Claim: the fit of points is least squares by J C Jᵀ, with the judge's J at what was measured."""
    values, steps = measured(), np.array([1e-7, 1e-7, 1e-5])

    def points_of(shots: Array) -> Array:
        return np.asarray(geometry.point_from_shot(shots[:, 2], shots[:, 0], shots[:, 1], D))

    slopes = np.stack(
        [(points_of(values + s) - points_of(values - s)) / (2.0 * s.sum()) for s in np.diag(steps)], -1
    )
    spread = np.einsum("nia,nab,njb->nij", slopes, covariances(together=together), slopes)
    root, there = np.linalg.inv(np.linalg.cholesky(spread)), points_of(values)

    def whiten(turn: Array, place: Array) -> Array:
        return np.einsum("nab,nb->na", root, there - POINTS @ turn.T - place).ravel()

    pose = estimate_pose(**arguments(ranges=True, together=together), method="xyz")
    assert_is(pose, plain_fit(whiten), 3 * COUNT - 6)


@pytest.mark.parametrize("known", [False, True])
def test_equal_points_have_the_covariance_of_unequal_ones(known: bool) -> None:
    """Claim: points that count alike (eq 11) have the covariance N⁻¹ Jᵀ C J N⁻¹ of their true, unequal errors, and of
    those of a prior, where there is one.

    Of 4000 draws the mean square of error over σ is 1 for each component. The prior is about as good as the points.
    """
    rng = np.random.default_rng(9)
    draws = np.einsum(
        "nab,knb->kna", np.linalg.cholesky(covariances(together=True)), rng.normal(size=(4000, COUNT, 3))
    )
    values = seen(TURN, PLACE) + draws
    given = arguments(ranges=True, together=True) | {
        "theta": values[..., 0],
        "phi": values[..., 1],
        "ranges": values[..., 2],
    }
    prior = None
    if known:
        sigma = np.array([2.0, 3.0, 5.0, 3.0, 4.0, 2.0]) * 1e-4
        off = sigma * rng.normal(size=(4000, 6))
        prior = PosePrior(
            PLACE + off[:, :3], Rotation.from_rotvec(off[:, 3:]).as_matrix() @ TURN, np.diag(sigma**2)
        )
    pose = estimate_pose(**given, method="xyz", point_weights="equal", prior=prior)
    turn = vector_from_rotation(pose.rotation @ TURN.T)
    error = np.concatenate([pose.position - PLACE, turn], axis=1)
    for z in (error / pose.sigma).T:
        assert mean_square(z, slack=0.01, level=LEVEL / 6.0)


@pytest.mark.parametrize("sigma", [np.nan, 1e-6, 1e3])
def test_a_prior_is_weighed_against_measured_points_alone(sigma: float) -> None:
    """Claim: points that count alike weigh with a prior as those do that were measured; what σ a hidden target is given
    changes nothing."""
    given, kept = arguments(ranges=True), np.arange(COUNT) != 3
    scale = np.array([1.0, 2.0, 3.0, 2.0, 1.0, 3.0]) * 1e-3
    prior = PosePrior(PLACE + 1e-3, TURN, np.diag(scale**2))
    alone = {
        name: values[kept] if np.ndim(values) and len(values) == COUNT else values
        for name, values in given.items()
    }
    hidden = given | {
        "theta": np.where(kept, given["theta"], np.nan), "sigma_range": np.where(kept, SIGMA_RANGE, sigma)
    }  # fmt: skip
    found, wanted = (
        estimate_pose(**each, method="xyz", point_weights="equal", prior=prior) for each in (hidden, alone)
    )
    assert np.abs((found.position - wanted.position) / wanted.sigma[:3]).max() < 1e-6
    np.testing.assert_allclose(found.sigma, wanted.sigma, rtol=1e-6)


def test_surveyed_points_err_along_the_objects_axes() -> None:
    """Claim: errors of the survey enter as C + (G R) C_object (G R)ᵀ, along the object's axes."""
    values, sigma = measured(), np.array([0.1, 0.9, 0.3]) * 1e-3
    own = covariances(together=False)

    def whiten(turn: Array, place: Array) -> Array:
        return np.einsum("nab,nb->na", root, values - seen(turn, place)).ravel()

    turn, place = TURN, PLACE
    for _ in range(4):  # at the pose that comes out
        steps = 1e-6 * np.eye(3)
        by_point = np.stack(
            [(seen(turn, place, POINTS + s) - seen(turn, place, POINTS - s)) / 2e-6 for s in steps], axis=-1
        )
        whole = own + np.einsum("nai,i,nbi->nab", by_point, sigma**2, by_point)
        root = np.linalg.inv(np.linalg.cholesky(whole))
        expected = plain_fit(whiten)
        place, turn = expected[:2]
    pose = estimate_pose(**arguments(ranges=True), method="joint", sigma_object=np.tile(sigma, (COUNT, 1)))
    apart = np.concatenate([pose.position - expected[0], vector_from_rotation(pose.rotation @ turn.T)])
    # The program takes the survey's errors at a pose one step before the last: second order.
    np.testing.assert_allclose(apart / np.sqrt(np.diag(expected[2])), 0.0, atol=1e-2)
    np.testing.assert_allclose(pose.sigma, np.sqrt(np.diag(expected[2])), rtol=1e-2)
    assert pose.chi2 == pytest.approx(expected[3], rel=1e-2)


@pytest.mark.parametrize("robust", [None, "huber"])
@pytest.mark.parametrize("shape", [(), (COUNT,), (COUNT, 3)], ids=len)
def test_targets_that_are_known_exactly_are_as_without_a_survey(
    shape: tuple[int, ...], robust: str | None
) -> None:
    """Claim: σ of 0 is one that adds nothing, of all targets or of single axes; anything below is refused."""
    given: dict[str, Any] = arguments(ranges=True) | {"method": "joint", "robust": robust}
    known, bare = (estimate_pose(**given, sigma_object=sigma) for sigma in (np.zeros(shape), None))
    np.testing.assert_allclose(known.position, bare.position, atol=1e-9)
    np.testing.assert_allclose(known.rotation, bare.rotation, atol=1e-9)
    np.testing.assert_allclose(known.sigma, bare.sigma, rtol=1e-6)
    assert known.chi2 == pytest.approx(bare.chi2, rel=1e-6)
    for wrong in (-1e-300, math.nan, math.inf):
        sigma = np.zeros(shape)
        sigma[(-1,) * sigma.ndim] = wrong
        with pytest.raises(InputError, match="sigma_object must be zero or more"):
            estimate_pose(**given, sigma_object=sigma)
    if len(shape) == 2:
        partly = np.zeros(shape)
        partly[-1, -1] = 5e-3
        assert estimate_pose(**given, sigma_object=partly).chi2 < 0.999 * bare.chi2


def test_a_prior_is_six_more_observations() -> None:
    """Claim: a prior adds (pose − prior)ᵀ C⁻¹ (pose − prior) to χ², six degrees of freedom, and its information."""
    values = measured()
    mixed = np.random.default_rng(10).normal(size=(6, 6))
    scale = np.array([1e-3, 2e-3, 4e-3, 1e-3, 3e-3, 2e-3])
    prior_covariance = (mixed @ mixed.T + 6.0 * np.eye(6)) / 12.0 * np.outer(scale, scale)
    known_turn = Rotation.from_rotvec([2e-3, -1e-3, 3e-3]).as_matrix() @ TURN
    known_place = PLACE + np.array([1e-3, -2e-3, 5e-3])
    root = np.linalg.inv(np.linalg.cholesky(prior_covariance))

    def whiten(turn: Array, place: Array) -> Array:
        apart = values - seen(turn, place)
        off = np.concatenate([place - known_place, vector_from_rotation(turn @ known_turn.T)])
        return np.concatenate([apart[:, 0] / SIGMA_THETA, apart[:, 1] / SIGMA_PHI, root @ off])

    prior = PosePrior(known_place, known_turn, prior_covariance)
    pose = estimate_pose(**arguments(ranges=False), prior=prior)
    assert_is(pose, plain_fit(whiten), 2 * COUNT)


def test_huber_counts_large_residuals_linearly() -> None:
    """Claim: χ² of ``huber`` is Σ |e|² up to two standard deviations, and 2 k |e| − k² beyond; weights are k/|e|."""
    given = arguments(ranges=False)
    given["phi"] = given["phi"] + 30.0 * SIGMA_PHI * np.eye(COUNT)[2]
    pose = estimate_pose(**given, robust="huber")
    length = np.hypot(*(pose.residuals / np.stack([SIGMA_THETA, SIGMA_PHI], axis=-1)).T)
    assert (length > 2.0).any()
    assert (length < 2.0).any()
    cost = np.where(length > 2.0, 2.0 * 2.0 * length - 2.0**2, length**2)
    assert pose.chi2 == pytest.approx(cost.sum(), rel=1e-6)
    np.testing.assert_allclose(pose.weights, np.minimum(1.0, 2.0 / length), rtol=1e-6)
    # At the minimum the weighed residuals are at right angles to every motion of the pose.
    weights = np.repeat(np.minimum(1.0, 2.0 / length), 2)
    whitened = (pose.residuals / np.stack([SIGMA_THETA, SIGMA_PHI], axis=-1)).ravel()
    sigma = np.stack([SIGMA_THETA, SIGMA_PHI], axis=-1)
    for axis in range(6):
        step = 1e-6 * np.eye(6)[axis]
        ahead, behind = (
            seen(
                Rotation.from_rotvec(sign * step[3:]).as_matrix() @ pose.rotation,
                pose.position + sign * step[:3],
            )
            for sign in (1.0, -1.0)
        )
        slope = ((ahead - behind)[:, :2] / sigma / 2e-6).ravel()
        assert abs(np.sum(weights * whitened * slope)) < 1e-4 * np.sqrt(
            np.sum(slope**2) * np.sum(whitened**2)
        )


def test_a_hidden_target_and_a_missing_range_leave_the_sum() -> None:
    """Claim: degrees of freedom count what was measured: 2 angles each, 1 range each, less six."""
    given = arguments(ranges=True)
    given["theta"] = np.where(np.arange(COUNT) == 1, np.nan, given["theta"])
    given["ranges"] = np.where(np.arange(COUNT) == 4, np.nan, given["ranges"])
    assert estimate_pose(**given, method="joint").dof == 2 * 5 + 4 - 6
    assert estimate_pose(**given, method="xyz").dof == 3 * 4 - 6
    assert estimate_pose(**given, method="uv").dof == 2 * 5 - 6


def test_huber_knows_how_well_targets_are_surveyed() -> None:
    """Claim: errors of places that the survey's σ explains keep their weight; without it they lose most of it."""
    random = np.random.default_rng(3)
    theta, phi, _ = seen(TURN, PLACE, POINTS + 2e-3 * random.normal(size=POINTS.shape)).T
    given: dict[str, Any] = {
        "sigma_theta": 10e-6,
        "sigma_phi": 10e-6,
        "axis_separation": D,
        "robust": "huber",
    }
    surveyed = estimate_pose(POINTS, theta, phi, **given, sigma_object=4e-3)
    np.testing.assert_array_equal(surveyed.weights, 1.0)
    assert estimate_pose(POINTS, theta, phi, **given).weights.min() < 0.1


def test_a_survey_that_is_unsure_makes_large_residuals_smaller() -> None:
    """Claim: weights of ``huber`` are 2/|e|, e whitened by the noise and by what the object's own errors, alike along
    all axes, do to the angles: σ² J Jᵀ, J by differences of the judge's geometry."""
    given = arguments(ranges=False)
    survey = 2e-3
    given["phi"] = given["phi"] + 9.0 * survey / PLACE[2] * np.eye(COUNT)[2]
    pose = estimate_pose(**given, robust="huber", sigma_object=survey)
    points = POINTS @ pose.rotation.T + pose.position
    slopes = np.stack(
        [
            (seen(np.eye(3), step, points) - seen(np.eye(3), -step, points))[:, :2] / 2e-6
            for step in 1e-6 * np.eye(3)
        ],
        axis=-1,
    )
    covariance = survey**2 * slopes @ np.swapaxes(slopes, -1, -2)
    covariance[:, 0, 0] += SIGMA_THETA**2
    covariance[:, 1, 1] += SIGMA_PHI**2
    solved = np.linalg.solve(covariance, pose.residuals[..., None])[..., 0]
    length = np.sqrt(np.sum(pose.residuals * solved, axis=-1))
    assert length.max() > 3.0
    np.testing.assert_allclose(pose.weights, np.minimum(1.0, 2.0 / length), rtol=1e-5)
