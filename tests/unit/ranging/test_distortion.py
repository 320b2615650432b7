"""The believed lens against OpenCV's model, where they coincide: along the line, in the plane of triangulation."""

from __future__ import annotations

import cv2
import numpy as np

from scanner_sim.foundation.parameters import INDEX
from scanner_sim.ranging.believed import Design, VoxelReadings, believed_points
from scanner_sim.ranging.departures import _distortion, _distortion_slope, _undistorted

RADIAL_1, RADIAL_2, TANGENTIAL = -0.21, 0.35, 0.004


def test_a_distorted_image_is_ranged_as_opencv_distorts_it() -> None:
    """Claim: an instrument that believes in k₁, k₂ and p₂ finds the tangents that OpenCV projected with them.

    Set-up: points at known tangents x in the plane of triangulation, projected by ``cv2.projectPoints`` of a camera of
    the focal length in metres. Expected: R = d (cosΘ/x + sinΘ), eq 1. Tolerance: rounding of both.
    """
    design = Design(0.12, 0.2, 0.05)
    x = np.linspace(0.01, 0.2, 40)
    theta = np.linspace(-0.4, 0.4, 40)
    points = np.stack([x, 0.0 * x, np.ones_like(x)], axis=1)
    camera = np.diag([design.image_distance, design.image_distance, 1.0])
    lens = np.array([RADIAL_1, RADIAL_2, 0.0, TANGENTIAL])
    image, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera, lens)
    parameters = np.zeros(len(INDEX))
    for name, value in (("radial_1", RADIAL_1), ("radial_2", RADIAL_2), ("tangential", TANGENTIAL)):
        parameters[INDEX[name]] = value
    found = believed_points(VoxelReadings(theta, 0.0 * theta, image[:, 0, 0]), design, parameters)
    expected = design.baseline * (np.cos(theta) / x + np.sin(theta))
    np.testing.assert_allclose(found.range, expected, rtol=1e-9)
    ideal = believed_points(VoxelReadings(theta, 0.0 * theta, image[:, 0, 0]), design, np.zeros(len(INDEX)))
    assert np.abs(ideal.range / expected - 1.0).max() > 1e-3


def test_the_slope_of_a_distortion_is_that_of_its_differences() -> None:
    """Claim: ∂ of what is added to x by x, for a lens whose terms are all large, by differences; a distorted tangent
    is undistorted again."""
    x, step = np.linspace(-0.5, 0.6, 12), 1e-6
    lens = RADIAL_1, 2.0 * RADIAL_2, 10.0 * TANGENTIAL
    rise = (_distortion(x + step, *lens) - _distortion(x - step, *lens)) / (2.0 * step)
    np.testing.assert_allclose(_distortion_slope(x, *lens), rise, atol=1e-9)
    np.testing.assert_allclose(_undistorted(x + _distortion(x, *lens), *lens), x, atol=1e-12)
