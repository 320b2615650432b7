"""Poses by a camera: perspective of dots, resection against OpenCV, σ, and which dot is which target."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from claims import at_most, mean_square, share
from made_dots import SIGMA, made_dots
from numpy.typing import NDArray
from scipy.optimize import least_squares

from scanner_sim.analytic.dots import circle_image_centre
from scanner_sim.foundation.errors import InputError
from scanner_sim.optics.interior_orientation import PARAMETERS, InteriorOrientation
from scanner_sim.pose.camera import combined_poses, estimate_camera_pose, moved_to, pixel_angles
from scanner_sim.pose.dot_images import DotArray, dot_images
from scanner_sim.pose.identify_dots import _poses_of_three, identify, symmetries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import rotation_from_vector, vector_from_rotation
from scanner_sim.signals.dots.settings import DotStatus

Array = NDArray[np.float64]

PINHOLE = InteriorOrientation(focal_length=0.016, pixel_pitch=1e-5, columns=640, rows=480)
CAMERA = PINHOLE.changed(k1=-0.21, k2=0.11, p1=0.0013, p2=-0.0021)
POINTS = np.array(
    [
        [-0.5, -0.4, 0.0],
        [0.5, -0.4, 0.0],
        [0.5, 0.4, 0.0],
        [-0.3, 0.4, 0.0],
        [0.1, 0.1, -0.3],
        [0.3, -0.1, 0.0],
    ]
)


def dot_array(points: Array, radius: float = 0.04) -> DotArray:
    count = len(points)
    return DotArray(
        tuple("abcdefgh"[:count]), points, np.tile([0.0, 0.0, -1.0], (count, 1)), np.full(count, radius)
    )


ARRAY = dot_array(POINTS)
SQUARE = dot_array(np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]]))


def poses(count: int, seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    position = np.column_stack([rng.uniform(-0.3, 0.3, (count, 2)), rng.uniform(4.0, 9.0, count)])
    return rotation_from_vector(rng.uniform(-0.5, 0.5, (count, 3))), position


def seen(array: DotArray, rotation: Array, position: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return noisy centres of ellipses and their covariance."""
    ellipse = dot_images(CAMERA, array, rotation, position).ellipse
    centres = ellipse + rng.normal(0.0, SIGMA, ellipse.shape)
    return centres, np.broadcast_to(SIGMA**2 * np.eye(2), (*centres.shape, 2))


def test_an_ellipses_middle_is_that_of_the_cone() -> None:
    """Claim: without distortion the middle of a disc's ellipse is the judge's, not the image of the disc's."""
    rotation, position = poses(40, 1)
    images = dot_images(PINHOLE, dot_array(POINTS, 0.3), rotation, position)
    for pose in range(len(position)):
        for target in range(len(POINTS)):
            centre = rotation[pose] @ POINTS[target] + position[pose]
            middle = circle_image_centre(centre, rotation[pose] @ [0.0, 0.0, -1.0], 0.3)
            expected = middle * PINHOLE.scale + PINHOLE.centre
            np.testing.assert_allclose(images.ellipse[pose, target], expected, atol=1e-8)
    assert np.abs(images.ellipse - images.centre).max() > 0.5


def test_half_axes_of_a_disc_that_faces_the_camera() -> None:
    images = dot_images(PINHOLE, dot_array(np.zeros((1, 3)), 0.1), np.eye(3), np.array([0.0, 0.0, 5.0]))
    np.testing.assert_allclose(images.half_axes, [[PINHOLE.scale * 0.02] * 2], rtol=1e-12)
    assert images.facing[0] == pytest.approx(1.0)


def test_images_of_a_disc_do_not_depend_on_the_frame_of_its_normal() -> None:
    """Claim: a disc that faces the camera is a circle of f r/z, whatever its normal is in the frame of its object."""
    normals = np.random.default_rng(6).normal(size=(20, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    to_camera = np.array([0.0, 0.0, -1.0])
    for normal in normals:
        # A half turn about the direction in the middle between the normal and the way to the camera.
        turn = rotation_from_vector(np.pi * (normal + to_camera) / np.linalg.norm(normal + to_camera))
        array = DotArray(("a",), np.zeros((1, 3)), normal[None], np.array([0.1]))
        images = dot_images(PINHOLE, array, turn, np.array([0.0, 0.0, 5.0]))
        np.testing.assert_allclose(images.half_axes, [[PINHOLE.scale * 0.02] * 2], rtol=1e-6)
        assert images.facing[0] == pytest.approx(1.0)


def test_angles_of_pixels_are_those_of_their_directions() -> None:
    """Claim: Θ and φ turn z into the pixel's direction, and their slopes are differences."""
    pixels = np.random.default_rng(2).uniform((0.0, 0.0), (639.0, 479.0), (50, 2))
    angles = pixel_angles(CAMERA, pixels)
    direction = CAMERA.directions(pixels)
    np.testing.assert_allclose(np.sin(angles.theta), direction[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.cos(angles.theta) * np.sin(angles.phi), direction[:, 1], atol=1e-12)
    for axis in range(2):
        step = 1e-3 * np.eye(2)[axis]
        ends = [pixel_angles(CAMERA, pixels + way * step) for way in (1.0, -1.0)]
        for row, name in enumerate(("theta", "phi")):
            slope = (getattr(ends[0], name) - getattr(ends[1], name)) / 2e-3
            np.testing.assert_allclose(angles.by_pixel[:, row, axis], slope, atol=1e-10)


def test_resection_is_opencvs() -> None:
    """Claim: on the same centres the pose is that of ``cv2.solvePnP``, refined, to 1e-6 m and 1e-6 of the rotation.

    Set-up: points without extent, 0.02 pixel of noise, a lens with distortion.
    """
    rng = np.random.default_rng(3)
    rotation, position = poses(40, 4)
    tiny = dot_array(POINTS, 1e-6)
    centres, covariance = seen(tiny, rotation, position, rng)
    found = estimate_camera_pose(CAMERA, tiny, centres, covariance)
    u, v = CAMERA.centre
    matrix = np.array([[CAMERA.scale, 0.0, u], [0.0, CAMERA.scale, v], [0.0, 0.0, 1.0]])
    lens = np.array([CAMERA.k1, CAMERA.k2, CAMERA.p1, CAMERA.p2, CAMERA.k3])
    for number, image in enumerate(centres):
        _, turn, place = cv2.solvePnP(POINTS, image, matrix, lens, flags=cv2.SOLVEPNP_SQPNP)
        turn, place = cv2.solvePnPRefineLM(POINTS, image, matrix, lens, turn, place, (3, 200, 1e-15))
        np.testing.assert_allclose(found.position[number], place[:, 0], atol=1e-6)
        np.testing.assert_allclose(found.rotation[number], rotation_from_vector(turn[:, 0]), atol=1e-6)


def test_sigma_holds_and_the_perspective_is_removed() -> None:
    """Claim: 95 % of the errors of all six components lie within 1.96 σ, of large dots whose ellipses are far off; one
    pose in 10⁴ is called implausible by its residuals."""
    rotation, position = poses(400, 5)
    large = dot_array(POINTS, 0.08)
    centres, covariance = seen(large, rotation, position, np.random.default_rng(6))
    found = estimate_camera_pose(CAMERA, large, centres, covariance)
    implausible = found.status == PoseStatus.IMPLAUSIBLE
    assert at_most(int(implausible.sum()), 400, 1e-4)
    assert (found.status[~implausible] == PoseStatus.VALID).all()
    turned = vector_from_rotation(found.rotation @ np.swapaxes(rotation, 1, 2))
    errors = np.concatenate([found.position - position, turned], axis=1)
    pulls = errors / np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    for column in pulls.T:
        assert share(int((np.abs(column) < 1.96).sum()), len(column), 0.95, slack=0.01)
    whole = np.einsum("bi,bij,bj->b", errors, np.linalg.inv(found.covariance), errors)
    assert mean_square(np.sqrt(whole / 6.0), freedom=6.0 * len(whole), slack=0.02)


def test_a_calibrations_errors_are_shared_by_all_dots() -> None:
    """Claim: poses of a camera that is not what it is believed to be scatter as its calibration's covariance says.

    Set-up: 300 cameras drawn from the covariance, each with one frame without other noise to speak of.
    """
    rng = np.random.default_rng(7)
    spread = np.array([3e-6, 0.5, 0.4, 1e-3, 0.0, 0.0, 2e-4, 2e-4])
    (rotation,), (position,) = poses(1, 8)
    centres = []
    for _ in range(300):
        off = dict(zip(PARAMETERS, rng.normal(0.0, 1.0, 8) * spread, strict=True))
        centre = (CAMERA.centre[0] + off.pop("principal_u"), CAMERA.centre[1] + off.pop("principal_v"))
        changed = {name: getattr(CAMERA, name) + value for name, value in off.items()}
        true = CAMERA.changed(principal_point=centre, **changed)
        centres.append(dot_images(true, ARRAY, rotation, position).ellipse)
    covariance = np.tile(1e-4 * np.eye(2), (300, len(POINTS), 1, 1))
    found = estimate_camera_pose(CAMERA, ARRAY, np.array(centres), covariance, calibration=np.diag(spread**2))
    turned = vector_from_rotation(found.rotation @ rotation.T)
    errors = np.concatenate([found.position - position, turned], axis=1)
    without = estimate_camera_pose(CAMERA, ARRAY, centres[0], covariance[0]).covariance
    # Of the stated covariance the dots' own share is left out: these frames have no noise.
    stated = np.diagonal(found.covariance - without, axis1=1, axis2=2)
    for error, variance in zip(errors.T, stated.T, strict=True):
        assert mean_square(error / np.sqrt(variance), slack=0.05)


def test_a_calibrations_share_is_what_each_parameter_moves_the_pose_by() -> None:
    """Claim: of small errors a calibration adds ∂pose/∂parameters · C · (∂pose/∂parameters)ᵀ, all its parts together.

    Set-up: the slopes are central differences between poses of cameras that differ in one parameter from the believed
    one; C has correlations. Tolerance: third order in a tenth of σ.
    """
    (rotation,), (position,) = poses(1, 8)
    spread = np.array([3e-6, 0.5, 0.4, 1e-3, 2e-3, 3e-3, 2e-4, 2e-4])
    mixed = np.random.default_rng(18).normal(0.0, 1.0, (8, 8)) * spread[:, None]
    covariance = np.tile(1e-4 * np.eye(2), (len(POINTS), 1, 1))

    def pose_of(name: str, off: float) -> Array:
        if name.startswith("principal"):
            centre = np.array(CAMERA.centre) + off * np.array([name == "principal_u", name == "principal_v"])
            true = CAMERA.changed(principal_point=(float(centre[0]), float(centre[1])))
        else:
            true = CAMERA.changed(**{name: getattr(CAMERA, name) + off})
        centres = dot_images(true, ARRAY, rotation, position).ellipse
        found = estimate_camera_pose(CAMERA, ARRAY, centres, covariance)
        return np.append(found.position - position, vector_from_rotation(found.rotation @ rotation.T))

    steps = 0.1 * spread
    slopes = np.column_stack(
        [
            (pose_of(name, step) - pose_of(name, -step)) / (2.0 * step)
            for name, step in zip(PARAMETERS, steps, strict=True)
        ]
    )
    centres = dot_images(CAMERA, ARRAY, rotation, position).ellipse
    told = estimate_camera_pose(CAMERA, ARRAY, centres, covariance, calibration=mixed @ mixed.T).covariance
    without = estimate_camera_pose(CAMERA, ARRAY, centres, covariance).covariance
    expected = slopes @ mixed @ mixed.T @ slopes.T
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose((told - without) / size, expected / size, atol=2e-3)


def test_poses_move_with_the_mount() -> None:
    """Claim: a pose in the scanner's frame is the mount's product, and its covariance is turned with it."""
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = rotation_from_vector([0.1, -0.2, 0.3]), [0.4, 0.0, -0.1]
    (rotation,), (position,) = poses(1, 9)
    spread = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    off = 1e-4 * np.eye(6)
    there, turned, covariance = moved_to(mount, position, rotation, spread, off)
    np.testing.assert_allclose(there, mount[:3, :3] @ position + mount[:3, 3])
    np.testing.assert_allclose(turned, mount[:3, :3] @ rotation)
    arm = there - mount[:3, 3]
    cross = np.array([[0.0, arm[2], -arm[1]], [-arm[2], 0.0, arm[0]], [arm[1], -arm[0], 0.0]])
    change = np.block([[np.eye(3), cross], [np.zeros((3, 3)), np.eye(3)]])
    both = np.kron(np.eye(2), mount[:3, :3])
    np.testing.assert_allclose(covariance, both @ spread @ both.T + change @ off @ change.T)


def test_two_poses_are_combined_by_their_covariances() -> None:
    """Claim: the combined pose scatters as it says and less than either; χ² has six degrees of freedom."""
    rotation, position = poses(400, 10)
    rng = np.random.default_rng(11)
    pair = [estimate_camera_pose(CAMERA, ARRAY, *seen(ARRAY, rotation, position, rng)) for _ in range(2)]
    both = combined_poses(*pair)
    assert (
        np.diagonal(both.covariance, axis1=1, axis2=2) < np.diagonal(pair[0].covariance, axis1=1, axis2=2)
    ).all()
    turned = vector_from_rotation(both.rotation @ np.swapaxes(rotation, 1, 2))
    errors = np.concatenate([both.position - position, turned], axis=1)
    whole = np.einsum("bi,bij,bj->b", errors, np.linalg.inv(both.covariance), errors)
    for squares in (whole, both.chi2):
        assert mean_square(np.sqrt(squares / 6.0), freedom=6.0 * len(squares), slack=0.02)


@pytest.mark.slow
def test_targets_are_found_among_other_dots() -> None:
    """Claim: an array is found from scratch among rivets of its size, with a target hidden, and its poses are right."""
    rng = np.random.default_rng(12)
    rotation, position = poses(2, 13)
    for turn, place in zip(rotation, position, strict=True):
        images = dot_images(CAMERA, ARRAY, turn, place)
        centres, _ = seen(ARRAY, turn, place, rng)
        rivets = rng.uniform(centres.min(axis=0), centres.max(axis=0), (2, 2))
        every = np.concatenate([centres[1:], rivets])
        half = np.concatenate([images.half_axes[1:, 0], np.full(2, images.half_axes[0, 0])])
        order = rng.permutation(len(every))
        named = identify(CAMERA, ARRAY, made_dots(every[order], half[order]))
        assert not named.ambiguous
        assert named.pose is not None
        expected = np.argsort(order)[: len(POINTS) - 1]
        np.testing.assert_array_equal(named.dot[1:], expected)
        assert named.status[0] in (DotStatus.NOT_FOUND, DotStatus.VALID)
        assert np.abs(named.pose.position - place).max() < 0.02


def test_a_symmetrical_array_is_ambiguous_until_an_attitude_is_expected() -> None:
    """Claim: a square of equal dots looks the same four times round, and is named so; an attitude to 40° decides."""
    assert len(symmetries(SQUARE)) == 3
    assert symmetries(ARRAY) == []
    (turn,), (place,) = poses(1, 14)
    centres, _ = seen(SQUARE, turn, place, np.random.default_rng(15))
    dots = made_dots(centres, dot_images(CAMERA, SQUARE, turn, place).half_axes[:, 0])
    alone = identify(CAMERA, SQUARE, dots)
    assert alone.ambiguous
    assert (alone.status == DotStatus.AMBIGUOUS).all()
    known = identify(CAMERA, SQUARE, dots, expected=turn @ rotation_from_vector([0.1, 0.2, -0.3]))
    assert not known.ambiguous
    np.testing.assert_array_equal(known.dot, np.arange(4))


def test_a_predicted_array_is_followed_and_a_failed_dot_says_why() -> None:
    (turn,), (place,) = poses(1, 16)
    centres, _ = seen(ARRAY, turn, place, np.random.default_rng(17))
    dots = made_dots(centres, dot_images(CAMERA, ARRAY, turn, place).half_axes[:, 0])
    dots.status[2] = DotStatus.SATURATED
    followed = identify(CAMERA, ARRAY, dots, predicted=(turn, place + np.array([0.01, 0.0, 0.05])), reach=3.0)
    np.testing.assert_array_equal(followed.dot, [0, 1, -1, 3, 4, 5])
    assert followed.status[2] == DotStatus.SATURATED
    nothing = identify(CAMERA, ARRAY, made_dots(centres[:3], np.full(3, 8.0)))
    assert nothing.pose is None
    assert (nothing.status == DotStatus.NOT_FOUND).all()


def test_wrong_shapes_are_refused() -> None:
    centres = np.zeros((len(POINTS), 2))
    with pytest.raises(InputError, match="centres and covariance"):
        estimate_camera_pose(CAMERA, ARRAY, centres[:3], np.zeros((3, 2, 2)))
    for spread in (np.zeros((2, 2)), np.array([[1.0, 2.0], [2.0, 1.0]]), -np.eye(2)):
        with pytest.raises(InputError, match="covariance is not positive definite"):
            estimate_camera_pose(CAMERA, ARRAY, centres, np.tile(spread, (len(POINTS), 1, 1)))
    with pytest.raises(InputError, match="calibration has the shape"):
        estimate_camera_pose(CAMERA, ARRAY, centres, np.tile(np.eye(2), (6, 1, 1)), calibration=np.eye(3))


def test_a_frame_without_dots_has_no_pose_whatever_was_predicted() -> None:
    nothing = made_dots(np.zeros((0, 2)), np.zeros(0))
    found = identify(CAMERA, ARRAY, nothing, predicted=(np.eye(3), np.array([0.0, 0.0, 5.0])))
    assert found.pose is None
    assert (found.status == DotStatus.NOT_FOUND).all()


def test_a_smaller_array_nearby_is_not_the_predicted_one() -> None:
    """Claim: four dots that look as a square at twice the predicted range do are not that square."""
    images = dot_images(CAMERA, SQUARE, np.eye(3), np.array([0.0, 0.0, 10.0]))
    dots = made_dots(images.ellipse, images.half_axes[:, 0])
    near, there = (np.eye(3), np.array([0.0, 0.0, 5.0])), (np.eye(3), np.array([0.3, 0.0, 9.0]))
    assert identify(CAMERA, SQUARE, dots, predicted=near, expected=np.eye(3)).pose is None
    assert identify(CAMERA, SQUARE, dots, predicted=there, expected=np.eye(3)).pose is not None


@pytest.mark.parametrize("ratio", [0.5, 1.0 / 1.43, 1.0 / 1.37, 1.37, 1.43, 2.0])
def test_an_array_is_looked_for_about_its_predicted_range(ratio: float) -> None:
    """Claim: from scratch it is found no nearer and no farther than predicted by more than a ratio of 1.4: a smaller
    array looks the same farther off, a larger one nearer."""
    place = np.array([0.0, 0.0, 8.0])
    images = dot_images(CAMERA, SQUARE, np.eye(3), place)
    dots = made_dots(images.ellipse, images.half_axes[:, 0])
    # As far as said, and so far aside that the prediction itself finds no dot.
    there = np.array([1.5, 0.0, 0.0]) + place / ratio
    there *= np.linalg.norm(place) / ratio / np.linalg.norm(there)
    found = identify(CAMERA, SQUARE, dots, predicted=(np.eye(3), there), expected=np.eye(3))
    assert (found.pose is not None) is (1.0 / 1.4 < ratio < 1.4)


def test_three_dots_have_the_pose_that_made_their_angles() -> None:
    """Claim: one of the eight poses is the true one, for a camera whose axes cross: Θ, φ by arc tangents."""
    array = ARRAY
    rotation, position = poses(5, 3)
    three = np.array([0, 1, 3])
    placed = np.einsum("bij,nj->bni", rotation, array.points[three]) + position[:, None]
    x, y, z = placed.transpose(2, 1, 0)
    theta, phi = np.arctan2(x, np.hypot(y, z)), np.arctan2(y, z)
    turns, places = _poses_of_three(array, three, theta, phi)
    turns, places = turns.reshape(-1, 5, 3, 3), places.reshape(-1, 5, 3)
    off = np.abs(turns - rotation).max(axis=(2, 3)) + np.abs(places - position).max(axis=2)
    assert np.nanmin(off, axis=0).max() < 1e-6


@pytest.mark.parametrize("correlation", [0.9, -0.9])
def test_a_centre_is_weighted_by_the_whole_of_its_covariance(correlation: float) -> None:
    """Claim: the pose is that of least Σ rᵀC⁻¹r over the pixels, and χ² that sum, where u and v err together.

    Set-up: a general minimiser over six numbers that knows of pixels alone; errors of 0.3 σ in u and v, against the
    correlation. Tolerance: residuals in angles are those in pixels to first order, 10⁻⁵ of themselves.
    """
    (rotation,), (position,) = poses(1, 8)
    tiny = dot_array(POINTS, 1e-6)
    covariance = np.array([[4e-4, correlation * 2e-4], [correlation * 2e-4, 1e-4]])
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    signs = np.array([[1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [0.5, 0.2]])
    centres = dot_images(CAMERA, tiny, rotation, position).ellipse + signs * [6e-3, 3e-3]

    def residuals(step: Array) -> Array:
        points = POINTS @ (rotation_from_vector(step[3:]) @ rotation).T + position + step[:3]
        return np.asarray(((centres - CAMERA.project(points)) @ root.T).ravel())

    wanted = least_squares(residuals, np.zeros(6), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    found = estimate_camera_pose(CAMERA, tiny, centres, np.broadcast_to(covariance, (6, 2, 2)))
    assert found.chi2 == pytest.approx(2.0 * wanted.cost, rel=1e-4)
    np.testing.assert_allclose(found.position, position + wanted.x[:3], atol=1e-8)
