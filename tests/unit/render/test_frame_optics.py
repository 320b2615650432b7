"""A camera's lens and pixels on the device, and at which moments a frame sees the scene."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.optics.interior_orientation import InteriorOrientation
from scanner_sim.render.frame.lens_table import LensTable, pixel_view_factors
from scanner_sim.render.frame.optics import FrameOptics

Array = NDArray[np.float64]

pytestmark = pytest.mark.usefixtures("device")


def interior(**more: Any) -> InteriorOrientation:
    given = {"columns": 60, "rows": 40, "pixel_pitch": 20e-6, "focal_length": 1e-3}
    return InteriorOrientation.model_validate({**given, **more})


@pytest.mark.parametrize("spread", [0.0, 7e-6, 60e-6])
def test_a_footprint_is_the_pixel_and_the_point_spread_in_pixels(spread: float) -> None:
    """Claim: places at even shares of a pixel's light scatter by 1/12 + (σ/p)² and end half a pixel and four σ from its
    middle, evenly to both sides. Tolerance: the feet beyond 4σ, 1e-3 of the variance."""
    optics = FrameOptics.of(interior(), spread)
    nodes = optics.footprint.numpy().astype(np.float64)
    assert optics.shape == (40, 60)
    np.testing.assert_allclose(nodes, -nodes[::-1], atol=1e-7)
    assert nodes[-1] == pytest.approx(0.5 + 4.0 * spread / 20e-6, rel=1e-5)
    between = np.interp(np.linspace(0.0, 1.0, 200_001), np.linspace(0.0, 1.0, len(nodes)), nodes)
    assert np.mean(between**2) == pytest.approx(1.0 / 12.0 + (spread / 20e-6) ** 2, rel=3e-3)


def test_a_frame_sees_moving_objects_at_even_moments_of_its_exposure() -> None:
    """Claim: frame by frame, objects stand where they are in the middles of the equal parts of the exposure."""
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, 3] = [[0.1, 0.2, 0.3], [-0.4, 0.5, 0.6]]
    poses[:, :3, :3] = Rotation.from_rotvec([[0.1, 0.2, -0.3], [0.0, 0.4, 0.1]]).as_matrix()
    loaded: Any = SimpleNamespace(poses_at=lambda times: times)
    seen = FrameOptics.of(interior(), 0.0).view(loaded, poses, np.array([1.0, 3.0]), np.array([0.4, 0.2]), 4)
    np.testing.assert_allclose(seen.bodies, [1.05, 1.15, 1.25, 1.35, 3.025, 3.075, 3.125, 3.175])  # type: ignore[arg-type]
    assert (seen.moments, seen.shape) == (4, (40, 60))
    np.testing.assert_allclose(np.array(seen.camera.position.numpy()).T, poses[:, :3, 3], rtol=1e-6)
    turned = np.moveaxis(np.array(seen.camera.rotation.numpy()), -1, 0)
    np.testing.assert_allclose(turned, poses[:, :3, :3], atol=1e-6)


def looks(lens: LensTable, pixels: Array, beside: Array) -> Array:
    found = lens.directions(
        *(auto.Int32(part.astype(np.int32)) for part in pixels.T),
        *(auto.Float(part.astype(np.float32)) for part in beside.T),
    )
    return np.array(found.numpy(), dtype=np.float64).T


def test_a_pixels_place_looks_where_the_lens_says() -> None:
    """Claim: a place beside a pixel's centre, within the frame or up to four pixels beyond it, looks along (x/z, y/z,
    1) of the lens's law. Tolerance: what lies between corners is linear, an eighth of the second difference: 2e-4."""
    own = interior(k1=-0.15, p1=0.01)
    pixels = np.array([[0, 0], [59, 39], [17, 33], [44, 2]])
    beside = np.array([[-3.2, -2.7], [4.2, 3.4], [0.3, -0.45], [-0.5, 0.49]])
    tangents = own.tangents_of(pixels + beside)
    wanted = np.column_stack([tangents, np.ones(4)])
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    np.testing.assert_allclose(looks(LensTable.of(own), pixels, beside), wanted, atol=2e-4)


def test_beyond_the_fold_of_a_lens_the_edge_of_the_frame_counts() -> None:
    """Claim: where a barrel's distortion brings no light beside the frame, that of its edge is taken there."""
    # The largest image r (1 + k₁ r²) of a lens is ⅔ (−3 k₁)^−½; the frame's corner lies at hypot(0.6, 0.4) = 0.7211.
    own = interior(k1=-(4.0 / 27.0) / 0.73**2)
    assert np.isfinite(own.tangents_of([[59.5, 39.5]])).all()
    assert np.isnan(own.tangents_of([[62.5, 42.5]])).all()
    lens = LensTable.of(own)
    corner, beyond = np.array([[59, 39]]), np.array([[3.5, 3.5]])
    tangents = own.tangents_of([[59.5, 39.5]])[0]
    wanted = np.array([*tangents, 1.0]) / np.linalg.norm([*tangents, 1.0])
    np.testing.assert_allclose(looks(lens, corner, beyond)[0], wanted, atol=1e-6)
    # Beside the middle of an edge there is light, and the law holds.
    middle = own.tangents_of([[62.0, 20.0]])[0]
    wanted = np.array([*middle, 1.0]) / np.linalg.norm([*middle, 1.0])
    np.testing.assert_allclose(
        looks(lens, np.array([[59, 20]]), np.array([[3.0, 0.0]]))[0], wanted, atol=2e-3
    )


@pytest.mark.parametrize("distortion", [{}, {"k1": -0.05, "k2": 0.01, "p1": 4e-3, "p2": -6e-3}])
def test_a_pixel_gathers_by_its_solid_angle_and_the_pupils_slant(distortion: dict[str, float]) -> None:
    """Claim: ∫cosθ dΩ over a pixel is the area between the feet of its corners' unit vectors on the plane of the
    pupil; without distortion cos⁴θ p²/f² in its middle. Tolerance: the second order of a pixel, (p/f)² of some."""
    lens = interior(principal_point=(26.0, 22.0), **distortion)
    found = pixel_view_factors(lens)
    assert found.shape == (40, 60)
    u, v = np.meshgrid(np.arange(61) - 0.5, np.arange(41) - 0.5)
    x, y, _ = np.moveaxis(lens.directions(np.stack([u, v], axis=-1)), -1, 0)
    first = (x[1:, 1:] - x[:-1, :-1]) * (y[1:, :-1] - y[:-1, 1:])
    second = (y[1:, 1:] - y[:-1, :-1]) * (x[1:, :-1] - x[:-1, 1:])
    np.testing.assert_allclose(found, 0.5 * np.abs(first - second), rtol=3e-3)
    if not distortion:
        away = np.hypot(np.arange(60) - 26.0, np.arange(40)[:, None] - 22.0) * 0.02
        np.testing.assert_allclose(found, 4e-4 / (1.0 + away**2) ** 2, rtol=1e-9)
