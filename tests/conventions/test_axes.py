"""Scanner frame: right-handed, x right, y down, z forward; Θ > 0 looks right, φ > 0 looks down."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from scanner_sim.foundation.frames import pose_matrix, rotation_about
from scanner_sim.optics.deflection import Frame, deflected_frame
from scanner_sim.ranging.coordinates import coordinates

SEPARATION, BASE = 0.05, 0.2


def _frame(theta: float, phi: float) -> Frame:
    return deflected_frame(np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), SEPARATION, BASE)


def test_undeflected_beam_looks_forward() -> None:
    np.testing.assert_array_equal(_frame(0.0, 0.0).along, (0.0, 0.0, 1.0))


def test_positive_theta_looks_right() -> None:
    assert _frame(0.1, 0.0).along[0] > 0.09
    assert _frame(0.1, 0.0).along[1] == 0.0


def test_positive_phi_looks_down() -> None:
    assert _frame(0.0, 0.1).along[1] > 0.09
    assert _frame(0.0, 0.1).along[0] == 0.0


def test_points_follow_the_beam() -> None:
    x, y, z = coordinates(5.0, 0.1, 0.2, SEPARATION)
    assert x > 0.4
    assert y > 0.9
    assert z > 4.0


def test_deflected_axes_are_right_handed() -> None:
    """across × normal = along, as x × y = z: a picture in (across, normal) is not mirrored."""
    frame = _frame(0.3, -0.2)
    np.testing.assert_allclose(np.cross(frame.across, frame.normal), frame.along, atol=1e-15)


def test_across_points_right() -> None:
    assert _frame(0.3, 0.2).across[0] > 0.9


def test_normal_points_down() -> None:
    assert _frame(0.3, 0.2).normal[1] > 0.9


def test_receiver_stands_to_the_right_of_the_laser() -> None:
    frame = _frame(0.3, 0.2)
    np.testing.assert_allclose(np.subtract(frame.lens, frame.laser), (BASE, 0.0, 0.0), atol=1e-15)


def test_undeflected_laser_stands_at_the_origin() -> None:
    np.testing.assert_array_equal(_frame(0.3, 0.0).laser, (0.0, 0.0, 0.0))


def test_second_axis_lies_ahead_of_the_first() -> None:
    """Looking down (φ > 0) the virtual laser rises (−y) and moves forward, as behind a mirror at z = D_g."""
    _, y, z = _frame(0.0, 0.2).laser
    assert y < 0.0
    assert 0.0 < z < SEPARATION


def test_rotations_are_right_handed() -> None:
    """A quarter turn about x takes y to z, about y takes z to x, about z takes x to y."""
    x, y, z = np.eye(3)
    for axis, before, after in ((x, y, z), (y, z, x), (z, x, y)):
        np.testing.assert_allclose(rotation_about(axis, np.pi / 2) @ before, after, atol=1e-15)


def test_axes_may_have_any_length_and_direction() -> None:
    """Claim: a turn about (1, 2, −2), of whatever length, is that of the rotation vector along it."""
    axis = np.array([1.0, 2.0, -2.0])
    for length in (0.1, 1.0, 7.0):
        turned = rotation_about(length * axis, 0.7)
        np.testing.assert_allclose(turned, Rotation.from_rotvec(0.7 * axis / 3.0).as_matrix(), atol=1e-15)


def test_turn_about_y_swings_the_front_to_the_left() -> None:
    """A front that faces back (−z) and is turned by +20° about y looks back and to the left (−x)."""
    front = rotation_about((0.0, 1.0, 0.0), np.deg2rad(20.0)) @ np.array([0.0, 0.0, -1.0])
    assert front[0] < -0.3
    assert front[2] < -0.9


def test_pose_maps_object_points_to_the_scanner() -> None:
    """scanner_from_object turns first and shifts then, and multiplies columns."""
    scanner_from_object = pose_matrix(rotation_about((0.0, 0.0, 1.0), np.pi / 2), (1.0, 2.0, 3.0))
    np.testing.assert_allclose(scanner_from_object @ [1.0, 0.0, 0.0, 1.0], [1.0, 3.0, 3.0, 1.0], atol=1e-15)
