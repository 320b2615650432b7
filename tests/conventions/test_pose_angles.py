"""Yaw turns right, pitch turns up, roll lowers the right-hand side; perturbations are along the scanner's axes."""

from __future__ import annotations

import numpy as np
import pytest

from scanner_sim import estimate_pose
from scanner_sim.pose.transforms import (
    rotation_from_vector,
    rotation_from_yaw_pitch_roll,
    yaw_pitch_roll_from_rotation,
)
from scanner_sim.ranging.coordinates import angles_and_range

RIGHT, DOWN, FORWARD = np.eye(3)


def test_yaw_turns_to_the_right() -> None:
    assert (rotation_from_yaw_pitch_roll([0.1, 0.0, 0.0]) @ FORWARD)[0] > 0.09


def test_pitch_turns_upwards() -> None:
    assert (rotation_from_yaw_pitch_roll([0.0, 0.1, 0.0]) @ FORWARD)[1] < -0.09


def test_roll_lowers_the_right_hand_side() -> None:
    assert (rotation_from_yaw_pitch_roll([0.0, 0.0, 0.1]) @ RIGHT)[1] > 0.09


def test_roll_is_made_first_and_yaw_last() -> None:
    yaw, pitch, roll = np.deg2rad([70.0, -40.0, 120.0])
    one_by_one = (
        rotation_from_yaw_pitch_roll([yaw, 0.0, 0.0])
        @ rotation_from_yaw_pitch_roll([0.0, pitch, 0.0])
        @ rotation_from_yaw_pitch_roll([0.0, 0.0, roll])
    )
    together = rotation_from_yaw_pitch_roll([yaw, pitch, roll])
    np.testing.assert_allclose(together, one_by_one, atol=1e-15)
    np.testing.assert_allclose(yaw_pitch_roll_from_rotation(together), [yaw, pitch, roll], atol=1e-14)


@pytest.mark.parametrize("component", range(6))
def test_covariance_is_that_of_shifts_and_turns_along_the_scanners_axes(component: int) -> None:
    """A prior that knows all but one component leaves that one free: its σ is the measurement's alone, and largest."""
    from scanner_sim.pose.inputs import PosePrior

    points = np.array([[0.5, 0.5, 0.0], [-0.5, 0.5, 0.1], [-0.5, -0.5, 0.3], [0.5, -0.5, 0.0]])
    rotation, position = rotation_from_vector([0.9, -0.6, 1.4]), np.array([0.4, -0.2, 5.0])
    x, y, z = (points @ rotation.T + position).T
    _, theta, phi = angles_and_range(x, y, z, 0.05)
    theta, phi = theta + 1e-3, phi + 1e-3 * np.arange(4)
    tight = np.full(6, 1e-9)
    tight[component] = 1.0
    pose = estimate_pose(
        points,
        theta,
        phi,
        sigma_theta=1e-3,
        sigma_phi=1e-3,
        axis_separation=0.05,
        prior=PosePrior(position, rotation, np.diag(tight**2)),
    )
    from scanner_sim.pose.transforms import vector_from_rotation

    moved = np.concatenate([pose.position - position, vector_from_rotation(pose.rotation @ rotation.T)])
    assert np.argmax(np.abs(moved)) == component
    assert np.argmax(pose.sigma) == component
