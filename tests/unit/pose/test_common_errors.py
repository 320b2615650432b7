"""Errors that all targets share: poses do not take them for independent ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from claims import mean_square
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.estimate import estimate_pose
from scanner_sim.pose.transforms import vector_from_rotation
from scanner_sim.ranging.coordinates import angles_and_range

Array = NDArray[np.float64]

D = 0.05
POINTS = np.array([[-0.6, -0.5, 0.0], [0.5, -0.6, 0.2], [0.6, 0.5, -0.1], [-0.5, 0.6, 0.3], [0.1, 0.0, -0.3]])
CENTRE = np.array([0.4, -0.3, 6.0])
SIGMA = {"sigma_theta": 2e-5, "sigma_phi": 3e-5, "sigma_range": 2e-3}
RUNS = 1500


def shared() -> Array:
    """Return what three errors do to (Θ, φ, R) of five targets, as large as the noise and of unlike shapes."""
    x, y, z = POINTS.T
    zeros = np.stack([3e-5 + 0 * x, 0 * x, 0 * x], axis=1)
    scale = np.stack([0 * x, 4e-5 * (1.0 + y), 0 * x], axis=1)
    base = np.stack([1e-5 * x, 0 * x, 3e-3 * (1.0 + 0.3 * z)], axis=1)
    return np.stack([zeros, scale, base], axis=-1)


def measured(rng: np.random.Generator, runs: int) -> Array:
    """Return (Θ, φ, R) of the targets with noise of each and with the common errors of each run, shape (runs, n, 3)."""
    r, theta, phi = angles_and_range(*(POINTS + CENTRE).T, D)
    noise = rng.standard_normal((runs, len(POINTS), 3)) * list(SIGMA.values())
    return (
        np.stack([theta, phi, r], axis=1)
        + noise
        + np.einsum("nik,rk->rni", shared(), rng.standard_normal((runs, 3)))
    )


def poses(method: Any, given: Array, **more: Any) -> Any:
    theta, phi, r = np.moveaxis(given, -1, 0)
    return estimate_pose(POINTS, theta, phi, r, **SIGMA, axis_separation=D, method=method, **more)


@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
def test_errors_over_sigma_with_what_targets_share(method: str) -> None:
    """Claim: eᵀ C⁻¹ e over runs, each with common errors of its own, has the mean of its six degrees of freedom.

    Slack 1 %: the first order of errors of 3e-5 rad over targets of 0.1 rad. Taken as independent, the same errors have
    a mean square that is larger by half or more.
    """
    given = measured(np.random.default_rng(8), RUNS)
    found, alone = poses(method, given, common=shared()), poses(method, given)
    errors = np.concatenate([found.position - CENTRE, vector_from_rotation(found.rotation)], axis=1)
    np.testing.assert_array_equal(found.position, alone.position)

    def whitened(covariance: Array) -> Array:
        return np.einsum("rij,rj->ri", np.linalg.inv(np.linalg.cholesky(covariance)), errors)

    claim = mean_square(whitened(found.covariance), slack=0.01)
    assert claim
    assert claim.finds < 0.2
    assert np.mean(whitened(alone.covariance) ** 2) > 1.5


def test_a_common_error_is_no_mean_of_independent_ones() -> None:
    """An error of the Θ zero alone turns the pose with the scanner: σ about y does not fall with more targets."""
    zero = np.zeros((len(POINTS), 3, 1))
    zero[:, 0] = 1e-4
    given = measured(np.random.default_rng(1), 1)[0]
    with_it, without = poses("joint", given, common=zero).covariance, poses("joint", given).covariance
    added = with_it - without
    assert np.linalg.matrix_rank(added, tol=1e-12) == 1
    # About the first axis, which stands where z = 0: a turn of 1e-4 and a shift by 1e-4 times the distance.
    assert np.sqrt(added[4, 4]) == pytest.approx(1e-4, rel=0.05)
    assert np.sqrt(added[0, 0]) == pytest.approx(6e-4, rel=0.05)


def test_targets_by_name() -> None:
    given, names = measured(np.random.default_rng(1), 1)[0], "abcde"
    columns = [dict(zip(names, column, strict=True)) for column in (POINTS, *given.T)]
    found = estimate_pose(
        *columns, **SIGMA, axis_separation=D, method="joint",
        common=dict(reversed(list(zip(names, shared(), strict=True)))),
    )  # fmt: skip
    np.testing.assert_array_equal(found.covariance, poses("joint", given, common=shared()).covariance)


def test_targets_by_name_err_by_as_many_numbers() -> None:
    given, names = measured(np.random.default_rng(1), 1)[0], "abcde"
    columns = [dict(zip(names, column, strict=True)) for column in (POINTS, *given.T)]
    uneven = {name: np.zeros((3, 2 + number % 2)) for number, name in enumerate(names)}
    with pytest.raises(InputError, match="common is not an array of numbers"):
        estimate_pose(*columns, **SIGMA, axis_separation=D, method="joint", common=uneven)


def test_no_common_error_adds_nothing() -> None:
    """Claim: a calibration of which all is exact has errors of none, k = 0, and leaves the covariance."""
    given = measured(np.random.default_rng(1), 1)[0]
    alone, with_none = poses("joint", given), poses("joint", given, common=np.zeros((5, 3, 0)))
    np.testing.assert_array_equal(with_none.covariance, alone.covariance)


@pytest.mark.parametrize(
    ("common", "said"),
    [
        (np.zeros((4, 3, 1)), r"shape \(4, 3, 1\); \(..., 5, 3, k\) is wanted"),
        (np.full((5, 3, 1), np.nan), "not finite"),
        ({"a": np.zeros((3, 1))}, "name other targets"),
        ([[1.0], [2.0, 3.0]], "common is not an array of numbers"),
    ],
)
def test_what_does_not_fit_is_refused(common: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        poses("joint", measured(np.random.default_rng(1), 1)[0], common=common)
