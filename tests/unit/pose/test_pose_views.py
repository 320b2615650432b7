"""Poses in other forms: matrices, quaternions, and the boxes of a notebook."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from html_cells import cells
from scipy.spatial.transform import Rotation

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry as judge
from scanner_sim.pose.pose_filter import FilteredPose, FilterStatus
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus

POINTS = np.array([[-0.6, -0.5, 0.0], [0.5, -0.6, 0.2], [0.6, 0.5, -0.1], [-0.5, 0.6, 0.3], [0.1, 0.0, -0.3]])


def test_a_pose_is_the_same_as_matrix_quaternion_and_angles() -> None:
    """Claim: the matrix takes points of the object into the scanner's frame, the quaternion (w, x, y, z) is the same
    turn with w ≥ 0, and yaw, pitch and roll turn about y, x and z in this order; σ are roots of the diagonal."""
    turn, place = (
        Rotation.from_rotvec([[0.3, -0.2, 0.15], [-0.4, 0.1, 0.5]]),
        np.array([[0.4, -0.3, 6.0], [0.1, 0.2, 7.0]]),
    )
    placed = np.stack([one.apply(POINTS) for one in turn]) + place[:, None]
    r, theta, phi = judge.shot_from_point(placed, 0.05)
    pose = estimate_pose(
        POINTS,
        theta,
        phi,
        r,
        sigma_theta=2e-5,
        sigma_phi=3e-5,
        sigma_range=1e-3,
        axis_separation=0.05,
        method="joint",
    )
    ones = np.ones((5, 1))
    moved = np.einsum("bij,nj->bni", pose.scanner_from_object, np.hstack([POINTS, ones]))
    np.testing.assert_allclose(moved, np.concatenate([placed, np.ones((2, 5, 1))], axis=2), atol=1e-8)
    wanted = turn.as_quat(canonical=True, scalar_first=True)
    np.testing.assert_allclose(pose.quaternion, wanted, atol=1e-8)
    np.testing.assert_allclose(pose.yaw_pitch_roll, turn.as_euler("YXZ"), atol=1e-8)
    np.testing.assert_allclose(pose.sigma**2, np.einsum("bii->bi", pose.covariance), rtol=1e-12)
    state = FilteredPose(
        object="panel",
        time=0.5,
        status=FilterStatus.FOLLOWING,
        position=place[0],
        rotation=turn[0].as_matrix(),
        velocity=np.zeros(3),
        turn_rate=np.zeros(3),
        covariance=np.diag(np.arange(1.0, 13.0) ** 2),
        surprise=2.0,
    )
    np.testing.assert_allclose(state.scanner_from_object, pose.scanner_from_object[0], atol=1e-8)
    np.testing.assert_allclose(state.quaternion, wanted[0], atol=1e-12)
    np.testing.assert_allclose(state.sigma, np.arange(1.0, 13.0))


def series(status: list[PoseStatus]) -> PoseSeries:
    """Poses whose errors and σ are all different."""
    rng, count = np.random.default_rng(4), len(status)
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.3, (count, 3)))
    errors = rng.normal(0.0, [1e-3, 2e-3, 5e-3, 1e-4, 3e-4, 7e-4], (count, 6))
    sigma = np.array([1e-3, 2e-3, 4e-3, 1e-4, 2e-4, 4e-4]) * (1.0 + np.arange(count)[:, None])
    place = rng.uniform(-1.0, 1.0, (count, 3))
    return PoseSeries(
        name="panel",
        relative_to="",
        method="joint",
        time=np.arange(float(count)),
        position=place + errors[:, :3],
        rotation=(Rotation.from_rotvec(errors[:, 3:]) * turn).as_matrix(),
        covariance=np.einsum("ni,ij->nij", sigma**2, np.eye(6)),
        chi2=np.ones(count),
        dof=np.ones(count, dtype=np.int64),
        targets=np.full(count, 4),
        status=np.array(status, dtype=np.int8),
        truth_position=place,
        truth_rotation=turn.as_matrix(),
        lasting=np.zeros((count, 6, 6)),
        common=np.zeros((count, 6, 6)),
    )


def test_a_notebook_shows_what_poses_scatter_and_err() -> None:
    """Claim: in millimetres and thousandths of a degree, the median of σ and the root of the mean square error of valid
    poses alone; a dash where the truth is not known, and no table where no pose is valid."""
    valid = PoseStatus.VALID
    shown = series([valid, PoseStatus.AMBIGUOUS, valid, valid, PoseStatus.NOT_CONVERGED])
    page = shown._repr_html_()
    assert "panel by joint: 3 of 5 poses valid" in page
    heading, sigma, rms = cells(page)
    assert heading[1:] == ["x [mm]", "y [mm]", "z [mm]", "about x [m°]", "about y [m°]", "about z [m°]"]
    # Of σ once, three and four times as large the median is the second.
    wanted = 3.0 * np.array([1.0, 2.0, 4.0, *np.degrees([0.1, 0.2, 0.4])])
    np.testing.assert_allclose([float(cell) for cell in sigma[1:]], wanted, rtol=6e-3)
    chosen = [0, 2, 3]
    turned = (
        Rotation.from_matrix(shown.rotation[chosen])
        * Rotation.from_matrix(shown.truth_rotation[chosen]).inv()
    )
    off = np.hstack([shown.position[chosen] - shown.truth_position[chosen], np.degrees(turned.as_rotvec())])
    found = [float(cell) for cell in rms[1:]]
    np.testing.assert_allclose(found, 1e3 * np.sqrt((off**2).mean(axis=0)), rtol=6e-3)
    unknown = replace(shown, relative_to="node", truth_position=np.full((5, 3), np.nan))
    page = unknown._repr_html_()
    assert "panel from node by joint" in page
    assert cells(page)[2][1:4] == ["–"] * 3
    none = series([PoseStatus.AMBIGUOUS])._repr_html_()
    assert "0 of 1 poses valid" in none
    assert "<table>" not in none
