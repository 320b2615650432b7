"""The interior orientation of a camera against OpenCV's, and its derivatives against differences."""

from __future__ import annotations

import contextlib

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from scanner_sim.optics.interior_orientation import PARAMETERS, InteriorOrientation

IDEAL = InteriorOrientation(focal_length=0.016, pixel_pitch=1e-5, columns=640, rows=480)
LENS = IDEAL.changed(principal_point=(325.25, 236.5), k1=-0.21, k2=0.11, k3=-0.04, p1=0.0013, p2=-0.0021)
CUSHION = IDEAL.changed(k1=0.3, k2=0.1)


def _points(count: int = 500) -> np.ndarray:
    draw = np.random.default_rng(1)
    tangents = draw.uniform((-0.25, -0.2), (0.25, 0.2), (count, 2))
    return np.concatenate([tangents, np.ones((count, 1))], axis=1) * draw.uniform(0.5, 40.0, (count, 1))


@pytest.mark.parametrize("camera", [IDEAL, LENS, CUSHION])
def test_points_are_imaged_as_by_opencv(camera: InteriorOrientation) -> None:
    """Claim: pixels and ∂(u, v)/∂ of the parameters are those of ``cv2.projectPoints``, an implementation apart.

    Tolerance: 1e-9 pixel, rounding of both.
    """
    points = _points()
    matrix = np.array(
        [[camera.scale, 0.0, camera.centre[0]], [0.0, camera.scale, camera.centre[1]], [0.0, 0.0, 1.0]]
    )
    lens = np.array([camera.k1, camera.k2, camera.p1, camera.p2, camera.k3])
    expected, slopes = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, lens)
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(
        camera.jacobian(points), slopes[:, 3:6].reshape(-1, 2, 3), atol=1e-9, rtol=1e-9
    )
    ours = camera.parameter_jacobian(points)
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = np.moveaxis(slopes[:, 6:15].reshape(-1, 2, 9), -1, 0)
    theirs = dict(zip(PARAMETERS, ((fx + fy) / camera.pixel_pitch, cx, cy, k1, k2, k3, p1, p2), strict=True))
    for column, (name, expected) in enumerate(theirs.items()):
        np.testing.assert_allclose(ours[..., column], expected, rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("camera", [IDEAL, LENS, CUSHION])
def test_directions_undo_the_image(camera: InteriorOrientation) -> None:
    """Claim: the direction of a pixel is imaged onto it; tolerance 1e-9 pixel of rounding, 1e-12 of the direction."""
    u, v = np.meshgrid(np.linspace(-0.5, camera.columns - 0.5, 41), np.linspace(-0.5, camera.rows - 0.5, 31))
    pixels = np.stack([u, v], axis=-1)
    directions = camera.directions(pixels)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-14)
    np.testing.assert_allclose(camera.project(3.0 * directions), pixels, atol=1e-9)
    points = _points()
    np.testing.assert_allclose(
        camera.directions(camera.project(points)),
        points / np.linalg.norm(points, axis=1)[:, None],
        atol=1e-12,
    )


def test_nothing_is_imaged_from_behind_or_beyond_the_fold() -> None:
    barrel = IDEAL.changed(k1=-0.5)
    radius = np.sqrt(barrel.fold)
    assert radius == pytest.approx(np.sqrt(1.0 / 1.5))
    beyond = np.array([[radius * 1.001, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])
    assert np.isnan(barrel.project(beyond)).all()
    assert np.isfinite(barrel.project([radius * 0.999, 0.0, 1.0])).all()
    farthest = radius * (1.0 - 0.5 * radius**2) * barrel.scale
    on_axis = np.array(barrel.centre)
    assert np.isfinite(barrel.directions(on_axis + np.array([farthest * 0.999, 0.0]))).all()
    assert np.isnan(barrel.directions(on_axis + np.array([farthest * 1.001, 0.0]))).all()


def test_a_distortion_that_folds_within_the_frame_is_refused() -> None:
    with pytest.raises(ValidationError, match="folds within the frame"):
        InteriorOrientation(focal_length=0.004, pixel_pitch=1e-5, columns=640, rows=480, k1=-0.5)


@pytest.mark.parametrize(("columns", "rows"), [(640, 480), (300, 900)])
def test_the_farthest_corner_decides_whether_a_distortion_folds(columns: int, rows: int) -> None:
    """Claim: ρ(1 + k₁ρ²) is greatest, 2ρ/3, at ρ² = −1/(3k₁): a distortion whose greatest image reaches 1 % beyond the
    outer corners of the frame is taken, and one that ends 1 % before them refused."""
    corner = 0.5 * np.hypot(columns, rows) * 1e-5 / 0.004
    for reach, taken in ((1.01, True), (0.99, False)):
        k1 = -1.0 / (3.0 * (1.5 * reach * corner) ** 2)
        with contextlib.nullcontext() if taken else pytest.raises(ValidationError, match="folds within"):
            InteriorOrientation(focal_length=0.004, pixel_pitch=1e-5, columns=columns, rows=rows, k1=k1)


@pytest.mark.parametrize("principal_point", [(160.0, 120.0), (500.0, 100.0), (100.0, 400.0), (450.0, 300.0)])
def test_a_fold_is_sought_at_the_corner_farthest_from_the_principal_point(
    principal_point: tuple[float, float],
) -> None:
    """Claim: the frame ends half a pixel beyond the centres of its outer pixels, wherever the lens's axis falls: a
    distortion whose greatest image, 2ρ/3 at ρ² = −1/(3k₁), reaches 1 % beyond the farthest corner is taken, and
    one that ends 1 % before it refused."""
    u, v = principal_point
    farthest = np.hypot(max(u + 0.5, 639.5 - u), max(v + 0.5, 479.5 - v)) * 1e-5 / 0.004
    for reach, taken in ((1.01, True), (0.99, False)):
        k1 = -1.0 / (3.0 * (1.5 * reach * farthest) ** 2)
        with contextlib.nullcontext() if taken else pytest.raises(ValidationError, match="folds within"):
            InteriorOrientation(
                focal_length=0.004, pixel_pitch=1e-5, columns=640, rows=480, principal_point=(u, v), k1=k1
            )


def test_the_middle_of_the_frame_is_between_its_middle_pixels() -> None:
    """Claim: the first pixel's centre is (0, 0), so that of 640 × 481 the axis falls between the columns 319 and 320
    and onto the row 240, and a pixel and the one opposite look along mirrored directions."""
    camera = InteriorOrientation(focal_length=0.016, pixel_pitch=1e-5, columns=640, rows=481)
    assert camera.centre == (319.5, 240.0)
    first, last = camera.directions([[0.0, 0.0], [639.0, 480.0]])
    np.testing.assert_allclose(first, last * [-1.0, -1.0, 1.0], rtol=1e-14)
    assert camera.changed(principal_point=(322.5, 241.0)).centre == (322.5, 241.0)
