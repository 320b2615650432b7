"""Do the covariances of poses tell the truth where targets are measured one after another on a moving object?

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from scanner_sim.analytic import geometry
from scanner_sim.pose.interpolation import Interpolated, interpolate
from scanner_sim.pose.series import PoseSeries, pose_series, relative_series
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import rotation_from_vector
from scanner_sim.pose.weights import Method
from scanner_sim.tracking.errors import ErrorParts

Array = NDArray[np.float64]

SEPARATION, PERIOD = 0.05, 0.01
SIGMA = np.array([40e-6, 60e-6, 3e-3])
"""Of an observation: Θ, φ [rad], R [m]."""
ROUNDS, RUNS = 40, 320
POINTS = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.1, 0.0, 0.4]])
FAST = (0.05, 0.02)
"""Largest speed [m/s] and rate of turn [rad/s] along each axis: 40 and 20 σ of an angle in a round."""


COMMON = 4e-3
"""Of an error that all ranges of a run share [m]."""


def runs(
    rng: np.random.Generator,
    method: Method,
    name: str = "node",
    middle: float = 0.0,
    *,
    common: float = 0.0,
    count: int = RUNS,
    rounds: int = ROUNDS,
) -> PoseSeries:
    """Return every second pose of runs of moving objects, each with the targets of two objects visited in turn.

    A pose draws on its own round and its neighbours, so that those two rounds apart share nothing.
    """
    time = PERIOD * (2 * len(POINTS) * np.arange(rounds)[:, None] + np.arange(len(POINTS)))
    at = PERIOD * (2 * len(POINTS) * np.arange(rounds) + len(POINTS) - 0.5)
    white = ErrorParts.all_white(np.broadcast_to(np.diag(SIGMA**2), (rounds, len(POINTS), 3, 3)))
    errors = replace(white, pixels=np.full(time.shape, common**2))
    rows = slice(0, None, 2)
    observations, truths = [], []
    for _ in range(count):
        start, speed = rng.uniform([-0.6, -0.6, 5.0], [0.6, 0.6, 7.0]), rng.uniform(-FAST[0], FAST[0], 3)
        start[0] += middle
        turned, rate = rotation_from_vector(rng.uniform(-0.5, 0.5, 3)), rng.uniform(-FAST[1], FAST[1], 3)

        def pose(t: Array) -> tuple[Array, Array]:
            return (
                rotation_from_vector(t[..., None] * rate) @ turned,  # noqa: B023 (called in this turn only)
                start + t[..., None] * speed,  # noqa: B023
            )

        rotation, position = pose(time)
        placed = np.einsum("rtij,tj->rti", rotation, POINTS) + position
        r, theta, phi = geometry.shot_from_point(placed, SEPARATION)
        place = np.stack([theta, phi, r], axis=-1) + SIGMA * rng.standard_normal((rounds, len(POINTS), 3))
        place[..., 2] += common * rng.standard_normal()
        truth = np.zeros((rounds, 4, 4))
        truth[:, :3, :3], truth[:, :3, 3] = pose(at)
        observations.append(interpolate(time, place, errors, at))
        truths.append(truth[rows])
    return pose_series(
        name,
        POINTS,
        np.tile(at[rows], count),
        Interpolated(
            *(
                np.concatenate([getattr(one, part)[rows] for one in observations])
                for part in ("position", "covariance", "lasting", "common")
            )
        ),
        axis_separation=SEPARATION,
        method=method,
        truth=np.concatenate(truths),
    )


def pulls_of(made: PoseSeries) -> tuple[Array, Array]:
    """Return errors over σ (n, 6), and errors whitened by the whole covariance."""
    valid = made.status == PoseStatus.VALID
    # A pose in a hundred with doubtful ranges has a second one that fits nearly as well.
    assert valid.mean() > 0.98
    error, covariance = made.error[valid], made.covariance[valid]
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    white = np.linalg.solve(np.linalg.cholesky(covariance), error[..., None])[..., 0]
    return error / sigma, white


def judge(made: PoseSeries) -> None:
    """Fail where means, variances, distributions or the joint χ² are not those of standard normal errors."""
    pulls, white = pulls_of(made)
    count = len(pulls)
    assert np.abs(pulls.mean(axis=0) * np.sqrt(count)).max() < 4.8
    spread = np.sum(pulls**2, axis=0)
    low, high = stats.chi2.ppf([2e-6, 1.0 - 2e-6], count)
    assert ((low < spread) & (spread < high)).all(), spread / count
    for component in pulls.T:
        assert stats.kstest(component, "norm").pvalue > 5e-6
    assert stats.kstest(np.sum(white**2, axis=1), stats.chi2(6).cdf).pvalue > 5e-6


@pytest.mark.slow
@pytest.mark.parametrize("method", ["uv", "joint"])
def test_poses_of_moving_objects_are_covered(method: Method) -> None:
    """Claim: carried to a common time, observations give poses whose errors are normal with the stated covariance.

    Set-up: 320 runs of 40 rounds over five targets not in a plane, visited 10 ms apart between those of another object,
    on objects that move by up to 50 mm/s and 20 mrad/s along each axis: some forty σ of an angle in a round. 6400
    independent poses of each method.
    Expected: errors over σ of all six components standard normal, their squared Mahalanobis length χ² of six, and the
    residuals' χ² of 4 (uv) or 9 (joint) degrees of freedom.
    Tolerance: levels of 5e-6 and less in 14 checks, so that a right program fails once in 10⁴ seeds. The variance may
    be 8 % off, a component's mean 0.06 σ. Without carrying, errors are tens of σ; with C₁ in the place of C, the
    variance comes out a third too small.
    """
    made = runs(np.random.default_rng(71), method)
    judge(made)
    (dof,) = set(made.dof.tolist())
    assert dof == (4 if method == "uv" else 9)
    assert stats.kstest(made.chi2, stats.chi2(dof).cdf).pvalue > 5e-6


@pytest.mark.slow
def test_relative_poses_of_moving_objects_are_covered() -> None:
    """Claim: M_a⁻¹ M_b of two moving objects has the errors that its covariance states.

    Set-up: two objects as above, joint, at the same times, with independent motions. 6400 independent poses.
    Expected: errors over σ of the six components standard normal along the axes of the first object.
    Tolerance: as above. Without the lever arm of the first object's turn the variance is several times wrong.
    """
    rng = np.random.default_rng(72)
    first, second = runs(rng, "joint", "a", -1.0), runs(rng, "joint", "b", 1.0)
    judge(relative_series(first, second))


@pytest.mark.slow
def test_an_error_that_all_ranges_share_is_in_the_covariance() -> None:
    """Claim: where unlike pixels move all ranges of a run alike, the stated covariance still holds.

    Set-up: 1000 runs of two rounds, joint, with 3 mm of independent and 4 mm of common error of the ranges; the first
    pose of each, as those of one run share the error.
    Expected: errors over σ of the six components standard normal, and their Mahalanobis length χ² of six.
    Tolerance: levels of 5e-6 and less in 13 checks. The variance may be 21 % off. If the errors were taken as
    independent, the variance of z would be three times as large as stated, and that of the tilt half as large.
    """
    rng = np.random.default_rng(73)
    judge(runs(rng, "joint", common=COMMON, count=1000, rounds=2))
