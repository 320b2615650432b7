"""The scanner's poses beside the camera's: differences at common times, and what they are held against."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from claims import mean_square
from scipy.spatial.transform import Rotation as Turning

from scanner_sim.pose.beside import beside_camera, combined_series
from scanner_sim.pose.series import PoseSeries, SeriesMethod
from scanner_sim.pose.status import PoseStatus

FRAMES, ROUNDS = np.arange(6.0), np.array([-0.1, 0.25, 1.6, 4.9, 5.2])


def series(time: np.ndarray, method: SeriesMethod, sigma: np.ndarray, seed: int | None = None) -> PoseSeries:
    """An object in even motion, (δt, δω) of errors by ``seed`` or none."""
    error = (
        np.zeros((len(time), 6))
        if seed is None
        else sigma * np.random.default_rng(seed).standard_normal((len(time), 6))
    )
    position = np.outer(time, [0.1, -0.2, 0.3]) + np.array([0.5, 0.0, 6.0])
    turned = Turning.from_rotvec(np.outer(time, [0.02, 0.05, -0.1]))
    count = len(time)
    return PoseSeries(
        name="panel",
        relative_to="",
        method=method,
        time=time,
        position=position + error[:, :3],
        rotation=(Turning.from_rotvec(error[:, 3:]) * turned).as_matrix(),
        covariance=np.broadcast_to(np.diag(sigma**2), (count, 6, 6)),
        chi2=np.zeros(count),
        dof=np.full(count, 2),
        targets=np.full(count, 4),
        status=np.zeros(count, dtype=np.int8),
        truth_position=position,
        truth_rotation=turned.as_matrix(),
        lasting=np.full((count, 6, 6), np.nan),
        common=np.full((count, 6, 6), np.nan),
    )


SCANNER, CAMERA = (np.array(values) for values in ([3e-4] * 3 + [2e-4] * 3, [1e-4] * 3 + [4e-4] * 3))


def test_what_is_the_same_has_no_difference() -> None:
    """Claim: of an even motion nothing is left between frames, and nothing is compared beyond them."""
    (found,) = beside_camera([series(FRAMES, "camera", CAMERA), series(ROUNDS, "joint", SCANNER)])
    np.testing.assert_array_equal(found.time, [0.25, 1.6, 4.9])
    np.testing.assert_allclose(found.difference, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.sigma, np.tile(np.hypot(SCANNER, CAMERA), (3, 1)))
    assert (found.scanner.method, found.camera.method) == ("joint", "camera")


def test_the_difference_is_from_the_camera_to_the_scanner() -> None:
    """Claim: a scanner that is off by (δt, δω) along the reference's axes differs by just that."""
    off = np.array([1e-3, -2e-3, 3e-3, 4e-4, -5e-4, 6e-4])
    scanner = series(ROUNDS, "uv", SCANNER)
    turned = Turning.from_rotvec(off[3:]) * Turning.from_matrix(scanner.rotation)
    moved = replace(scanner, position=scanner.position + off[:3], rotation=turned.as_matrix())
    (found,) = beside_camera([moved, series(FRAMES, "camera", CAMERA)])
    np.testing.assert_allclose(found.difference, np.tile(off, (3, 1)), atol=1e-12)


def test_sigma_holds_at_the_times_of_frames() -> None:
    """Claim: differences scatter by their σ. Set-up: 400 common moments with errors drawn by the covariances."""
    time = np.arange(400.0)
    pair = [series(time, "camera", CAMERA, 1), series(time, "xyz", SCANNER, 2)]
    (found,) = beside_camera(pair)
    assert len(found.time) == 400
    assert mean_square(found.difference / found.sigma)


@pytest.mark.parametrize(
    ("which", "compared"),
    [
        ("scanner", [0.25, 4.9]),
        ("frame after", [0.25, 4.9]),
        ("frame before", [0.25, 1.6]),
        ("all", []),
        ("one frame", []),
    ],
)
def test_poses_that_are_not_valid_are_not_compared(which: str, compared: list[float]) -> None:
    camera, scanner = series(FRAMES, "camera", CAMERA), series(ROUNDS, "uv", SCANNER)
    if which == "scanner":
        scanner.status[2] = PoseStatus.IMPLAUSIBLE
    elif which.startswith("frame"):
        camera.status[2 if which == "frame after" else 4] = PoseStatus.AMBIGUOUS
    elif which == "all":
        camera.status[:] = PoseStatus.HIDDEN
    else:
        camera = series(FRAMES[:1], "camera", CAMERA)
    (found,) = beside_camera([camera, scanner])
    np.testing.assert_array_equal(found.time, compared)
    assert found.difference.shape == found.sigma.shape == (len(compared), 6)


def test_a_run_without_a_camera_has_nothing_beside_it() -> None:
    assert not list(beside_camera([series(ROUNDS, "uv", SCANNER), series(ROUNDS, "joint", SCANNER)]))


def test_both_together_are_their_weighted_mean() -> None:
    """Claim: of diagonal covariances each component is the mean by 1/σ², with 1/σ² the sum, and scatters by that.

    Set-up: 400 moments at the times of frames; ``joint`` is taken where there are several methods.
    """
    time = np.arange(400.0)
    camera, scanner = series(time, "camera", CAMERA, 1), series(time, "joint", SCANNER, 2)
    (found,) = combined_series([camera, series(time, "uv", 9.0 * SCANNER, 3), scanner])
    weight = SCANNER**-2 / (SCANNER**-2 + CAMERA**-2)
    np.testing.assert_allclose(found.sigma, np.tile((SCANNER**-2 + CAMERA**-2) ** -0.5, (400, 1)))
    expected = weight * scanner.error + (1.0 - weight) * camera.error
    np.testing.assert_allclose(found.error, expected, atol=1e-9)
    assert (found.method, found.targets.tolist()[0]) == ("combined", 8)
    assert mean_square(found.error / found.sigma)
    assert not list(beside_camera([camera, found]))


def test_poses_that_contradict_each_other_are_doubted_together() -> None:
    time = np.arange(4.0)
    camera, scanner = series(time, "camera", CAMERA), series(time, "uv", SCANNER)
    off = np.array([0.0, 0.0, 9.0 * np.hypot(SCANNER[2], CAMERA[2])])
    (found,) = combined_series([camera, replace(scanner, position=scanner.position + off)])
    assert (found.status == PoseStatus.IMPLAUSIBLE).all()
    np.testing.assert_allclose(found.chi2, 81.0)


def test_what_lasts_of_both_lasts_by_their_weights() -> None:
    time = np.arange(3.0)
    lasting = [np.tile(np.diag(0.5 * sigma**2), (3, 1, 1)) for sigma in (CAMERA, SCANNER)]
    camera, scanner = (
        replace(series(time, name, sigma), lasting=part)
        for name, sigma, part in zip(("camera", "uv"), (CAMERA, SCANNER), lasting, strict=True)
    )
    (found,) = combined_series([camera, scanner])
    np.testing.assert_allclose(found.lasting, 0.5 * found.covariance, atol=1e-15)


def test_a_notebook_shows_millimetres_and_thousandths_of_a_degree() -> None:
    """Claim: the median σ and the rms error of the valid poses, each of six; 0.2 mrad are 11.5 thousandths."""
    off = np.array([1e-3, -2e-3, 3e-3, 4e-4, -5e-4, 6e-4])
    still = series(ROUNDS, "joint", SCANNER)
    turned = Turning.from_rotvec(off[3:]) * Turning.from_matrix(still.rotation)
    # Of σ that are 1, 2, 4 and 5 thirds of the series' own the median is that, and of all five another.
    scale = np.array([1.0, 300.0, 2.0, 4.0, 5.0]) / 3.0
    moved = replace(
        still,
        position=still.position + off[:3],
        rotation=turned.as_matrix(),
        covariance=still.covariance * np.square(scale)[:, None, None],
    )
    moved.status[1] = PoseStatus.HIDDEN
    moved.position[1] += 7.0
    page = moved._repr_html_()
    assert "panel by joint: 4 of 5 poses valid" in page
    numbers = [float(text) for text in re.findall(r">([0-9.]+)<", page)]
    assert numbers == pytest.approx([0.3] * 3 + [11.5] * 3 + [1.0, 2.0, 3.0, 22.9, 28.6, 34.4])
