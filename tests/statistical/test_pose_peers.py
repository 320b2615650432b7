"""OpenCV's pose solvers as peers: the same camera, the same noise, and what a pinhole makes of two mirrors."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry
from scanner_sim.pose.transforms import rotation_from_vector, vector_from_rotation

Array = NDArray[np.float64]

SIGMA = 56.6e-6
POINTS = np.array(
    [
        [-0.5, -0.5, 0.0],
        [0.5, -0.5, 0.0],
        [0.5, 0.5, 0.0],
        [-0.5, 0.5, 0.0],
        [0.0, 0.1, 0.5],
        [0.3, 0.1, -0.4],
    ]
)


def scenes(count: int, seed: int) -> tuple[Array, Array]:
    """Return rotations and positions: turned by up to 0.7 rad about each axis, 3–12 m, ±0.2 rad off the axis."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(3.0, 12.0, count)
    position = np.column_stack([*(rng.uniform(-0.2, 0.2, (2, count)) * z), z])
    return rotation_from_vector(rng.uniform(-0.7, 0.7, (count, 3))), position


def angles(rotation: Array, position: Array, separation: float) -> tuple[Array, Array]:
    placed = POINTS @ np.swapaxes(rotation, -1, -2) + position[:, None]
    return geometry.shot_from_point(placed, separation)[1:]


def pinhole(theta: Array, phi: Array) -> Array:
    """Return (x/z, y/z) of beams that all start at the origin: eq 15 with ψ = 0, which is D_g = 0."""
    return np.stack([np.tan(theta) / np.cos(phi), np.tan(phi)], axis=-1)


def solve_pnp(image: Array, start: tuple[Array, Array] | None = None) -> tuple[Array, Array]:
    """Return rotation and position by OpenCV: EPnP (or ``start``), refined until it no longer moves."""
    camera, none = np.eye(3), np.zeros(4)
    if start is None:
        found, turn, place = cv2.solvePnP(POINTS, image, camera, none, flags=cv2.SOLVEPNP_EPNP)
        assert found
    else:
        turn, place = vector_from_rotation(start[0])[:, None], start[1][:, None].copy()
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-15)
    turn, place = cv2.solvePnPRefineLM(POINTS, image, camera, none, turn, place, criteria)
    return rotation_from_vector(turn[:, 0]), place[:, 0]


def distances(rotation: Array, position: Array, other: Array, place: Array) -> tuple[Array, Array]:
    turn = np.linalg.norm(vector_from_rotation(rotation @ np.swapaxes(other, -1, -2)), axis=-1)
    return np.linalg.norm(position - place, axis=-1), turn


def test_pinhole_agrees() -> None:
    """Claim: with D_g = 0 the scanner is a pinhole camera, and uv gives the pose of OpenCV's solvePnP.

    Set-up: 100 scenes without noise. Expected: equal poses, and equal to the truth. Tolerance: 1e-6 m and rad.
    """
    rotation, position = scenes(100, 41)
    theta, phi = angles(rotation, position, 0.0)
    pose = estimate_pose(POINTS, theta, phi, sigma_theta=SIGMA, sigma_phi=SIGMA, axis_separation=0.0)
    for k, image in enumerate(pinhole(theta, phi)):
        turned, placed = solve_pnp(image)
        assert np.abs(pose.position[k] - placed).max() < 1e-6
        assert np.abs(vector_from_rotation(pose.rotation[k] @ turned.T)).max() < 1e-6


def test_error_is_no_larger_with_noise() -> None:
    """Claim: with noise on the angles uv is no worse than solvePnP refined to its own minimum.

    Set-up: 1000 scenes, D_g = 0, 56.6 µrad. Both see the same noise; OpenCV weights image coordinates alike, uv angles.
    Expected: root mean square errors of place and turn no larger. Tolerance: 2 %, since the weighting differs by
    1/cos² of at most 0.3 rad and both are nearly efficient; the paired errors agree far better than that.
    """
    rotation, position = scenes(1000, 42)
    rng = np.random.default_rng(43)
    theta, phi = (
        exact + SIGMA * rng.standard_normal(exact.shape) for exact in angles(rotation, position, 0.0)
    )
    pose = estimate_pose(POINTS, theta, phi, sigma_theta=SIGMA, sigma_phi=SIGMA, axis_separation=0.0)
    peers = [solve_pnp(image) for image in pinhole(theta, phi)]
    ours = distances(pose.rotation, pose.position, rotation, position)
    theirs = distances(np.stack([p[0] for p in peers]), np.stack([p[1] for p in peers]), rotation, position)
    for own, other in zip(ours, theirs, strict=True):
        assert np.sqrt(np.mean(own**2)) < 1.02 * np.sqrt(np.mean(other**2))


@pytest.mark.parametrize("separation", [0.05])
def test_a_pinhole_is_biased_by_the_second_axis(separation: float) -> None:
    """Claim: a pinhole solver cannot stand in for two mirrors 50 mm apart; uv can.

    Set-up: 200 scenes without noise, D_g 50 mm; solvePnP starts at the truth. Expected: uv exact; the pinhole's place
    is off by about D_g along the sight, since rows fan out from the second axis and columns from the first, and its
    turn by far more than the noise would. Tolerance: median error between 10 and 100 mm, and above 5 σ of the depth.
    """
    rotation, position = scenes(200, 44)
    theta, phi = angles(rotation, position, separation)
    pose = estimate_pose(POINTS, theta, phi, sigma_theta=SIGMA, sigma_phi=SIGMA, axis_separation=separation)
    assert distances(pose.rotation, pose.position, rotation, position)[0].max() < 1e-9
    image = pinhole(theta, phi)
    peers = [solve_pnp(image[k], (rotation[k], position[k])) for k in range(len(image))]
    off = np.stack([p[1] for p in peers]) - position
    bias = np.linalg.norm(off, axis=1)
    assert 0.01 < np.median(bias) < 0.1
    assert np.median(bias / pose.sigma[:, 2]) > 5.0
