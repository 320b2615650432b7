"""Light in a window of a frame and beside it: what stands for what, which pixels are followed again, and their σ."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.optics.pixel_window import NOWHERE, PixelWindow

pytestmark = pytest.mark.usefixtures("device")

ROWS, COLUMNS = 10, 15
CORNER = 5 * COLUMNS + 6
"""Pixel in which two materials meet."""


class Tracer:
    """Light by a law of the pixel's number and the paths' number, slow light by the path's; notes what was asked."""

    def __init__(self, frames: int = 1) -> None:
        self.frames, self.shape = frames, (ROWS, COLUMNS)
        self.asked: list[tuple[list[int], int]] = []

    def trace(
        self, pixels: NDArray[np.uint32], samples: int, *, apart: bool = False
    ) -> tuple[NDArray[Any], ...]:
        self.asked.append((pixels.tolist(), samples))
        number = pixels.astype(np.float32)
        even = np.ones_like(number)
        other = np.where(pixels == CORNER, 2.0, 1.0).astype(np.float32)
        parts = (100.0 * samples + number, 0.01 * samples + 0.001 * number, even, even, even, other)
        if not apart:
            return parts
        slow = (np.arange(samples) ** 2 + number[:, None] % 7.0).astype(np.float32)
        return (*parts, slow.ravel(), np.full(slow.size, 3, dtype=np.uint32))


def test_a_pixel_stands_for_its_block_beyond_a_window() -> None:
    """Claim: with a window that holds nothing each pixel has the light of the one in the middle of its 4 × 4, by four
    paths; blocks that the frame's end cuts before their middle have that of the block before; nobody knows its σ."""
    from scanner_sim.render.frame.window_light import window_light

    tracer: Any = Tracer()
    found = window_light(tracer, (16, 64), NOWHERE)
    assert found.radiance.shape == found.variance.shape == (1, ROWS, COLUMNS)
    for row in range(ROWS):
        for column in range(COLUMNS):
            # Middles at 2 and 6, the third block's at 10 lies beyond the ten rows; 2, 6, 10 and 14 across.
            middle = min(row // 4, 1) * 4 + 2, column // 4 * 4 + 2
            assert found.radiance[0, row, column] == 400.0 + middle[0] * COLUMNS + middle[1]
    assert np.isinf(found.variance).all()


def test_light_in_a_window_is_followed_pixel_by_pixel_and_finer_about_an_edge() -> None:
    """Claim: in a window a pixel has its own sharp light and the mean of its slow; those beside a change of material
    have it by more paths. Variance: of the sharp light and of the slow's mean, (σ₁ + σ₂)², σ₂ by the twist of 2 × 2
    strata; a small face has no other mean."""
    from scanner_sim.render.frame.window_light import window_light

    tracer: Any = Tracer()
    window = PixelWindow(3, 9, 2, 11)
    found = window_light(tracer, (4, 16), window)
    for row in range(3, 9):
        for column in range(2, 11):
            near = abs(row - 5) <= 1 and abs(column - 6) <= 1
            samples, number = 16 if near else 4, row * COLUMNS + column
            slow = np.arange(samples) ** 2.0 + number % 7
            side = round(samples**0.5)
            grid = slow.reshape(side, side)
            twist = grid[::2, ::2] - grid[::2, 1::2] - grid[1::2, ::2] + grid[1::2, 1::2]
            doubt = np.sqrt((twist**2).sum()) / samples
            sharp = 0.01 * samples + 0.001 * number
            assert found.radiance[0, row, column] == pytest.approx(100.0 * samples + number + slow.mean())
            assert found.variance[0, row, column] == pytest.approx((np.sqrt(sharp) + doubt) ** 2, rel=1e-5)
    outside = np.ones((ROWS, COLUMNS), dtype=bool)
    outside[window.where] = False
    np.testing.assert_array_equal(np.isinf(found.variance[0]), outside)


def test_pixels_beside_an_edge_are_followed_again_in_every_frame() -> None:
    """Claim: of two frames those about a change of material have the light and the variance of the finer paths, by
    their number through both frames, all others that of the coarser; without more paths nothing is followed twice."""
    from scanner_sim.render.frame.light import frame_light

    tracer: Any = Tracer(frames=2)
    found = frame_light(tracer, (4, 16))
    near = np.zeros((2, ROWS, COLUMNS), dtype=bool)
    near[0, 4:7, 5:8] = True
    number = np.arange(2 * ROWS * COLUMNS).reshape(near.shape)
    samples = np.where(near, 16.0, 4.0)
    np.testing.assert_allclose(found.radiance, 100.0 * samples + number)
    np.testing.assert_allclose(found.variance, 0.01 * samples + 0.001 * number, rtol=1e-6)
    assert [count for _, count in tracer.asked] == [4, 16]
    assert tracer.asked[1][0] == number[near].tolist()
    frame_light(tracer, (4, 4))
    assert [count for _, count in tracer.asked] == [4, 16, 4]


def test_a_frame_has_the_paths_of_its_number() -> None:
    """Claim: the second of two frames is followed by the same random numbers as the frame of that number alone, pixel
    by pixel, and by others than the first; so in every further frame."""
    import drjit as dr
    import mitsuba as mi

    from scanner_sim.render.background.paths import FirstHit, Radiance
    from scanner_sim.render.frame import light

    def trace(_scene: Any, _sky: Any, _bounces: int, _origin: Any, _direction: Any, draw: Any) -> Any:
        drawn = draw(mi.UInt32(1))
        none = dr.zeros(mi.Float, dr.width(drawn))
        met = dr.zeros(mi.UInt32, dr.width(drawn))
        return Radiance(drawn[0], none, none, none), FirstHit(met, mi.Vector3f(0.0), mi.Vector3f(0.0))

    def followed(first: int, frames: int) -> NDArray[Any]:
        view: Any = SimpleNamespace(
            camera=SimpleNamespace(position=dr.zeros(mi.Vector3f, frames)),
            shape=(2, 5),
            footprint=mi.Float([0.0, 1.0]),
        )
        tracer = light.FrameTracer(None, None, view, first, 2, 8)  # type: ignore[arg-type]
        tracer._rays = lambda *_: (None, None, None)  # type: ignore[method-assign, assignment]
        return np.asarray(tracer.trace(np.arange(10 * frames, dtype=np.uint32), 4)[0]).reshape(frames, 10)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(light, "trace_paths", trace)
        both = followed(6, 3)
        assert len(np.unique(both)) == 30
        for number in range(3):
            np.testing.assert_array_equal(followed(6 + number, 1)[0], both[number])


def test_faces_are_told_apart_by_material_and_direction() -> None:
    """Claim: one number for each material and each direction of the normal, by all of its components; rounding of a
    flat face's normal changes none."""
    import mitsuba as mi

    from scanner_sim.render.background.paths import FirstHit
    from scanner_sim.render.frame.light import _face_of

    # Neighbours among the sixteen steps that a component is told apart by.
    normals = np.array([[x, y, z] for x in (-9, 9) for y in (-11, -10) for z in (-2, -1)]) / 16.0
    every = np.concatenate([np.repeat(normals, 3, axis=0), np.repeat(normals + 1e-7, 3, axis=0)])
    material = np.tile([1, 2, 5000], 16)
    met = FirstHit(mi.UInt32(material.tolist()), mi.Vector3f(*every.T.tolist()), mi.Vector3f(0.0))
    face = np.asarray(_face_of(met).numpy()).reshape(2, 24)
    assert len(np.unique(face[0])) == 24
    np.testing.assert_array_equal(face[1], face[0])


def test_a_step_is_an_edge_by_the_pixels_own_light_and_its_frames() -> None:
    """Claim: an edge is in a pixel and its eight neighbours where samples differ by more than a tenth of its mean and
    that of its frame together, or in what they meet; of two frames each has its own mean."""
    from scanner_sim.render.frame.light import edges

    radiance = np.full((2, ROWS, COLUMNS), 1.0, dtype=np.float32)
    radiance[1] = 4.0
    same = np.zeros_like(radiance)
    for frame, limit in ((0, 0.2), (1, 0.8)):
        for step, seen in ((1.02 * limit, True), (0.98 * limit, False)):
            dark, bright = radiance.copy(), radiance.copy()
            bright[frame, 4, 6] += 0.4 * step
            dark[frame, 4, 6] -= 0.6 * step
            wanted = np.zeros(radiance.shape, dtype=bool)
            wanted[frame, 3:6, 5:8] = seen
            np.testing.assert_array_equal(edges(radiance, dark, bright, same, same), wanted)
    other = same.copy()
    other[1, 0, 0] = 1.0
    wanted = np.zeros(radiance.shape, dtype=bool)
    wanted[1, :2, :2] = True
    np.testing.assert_array_equal(edges(radiance, radiance, radiance, same, other), wanted)
    # A dim pixel of a bright frame: its own light and the frame's count alike.
    dim = np.full((1, ROWS, COLUMNS), 3.0, dtype=np.float32)
    dim[0, 4, 6] = 0.5
    even = np.zeros_like(dim)
    limit = 0.1 * (0.5 + float(dim.mean()))
    for step, seen in ((1.02 * limit, True), (0.98 * limit, False)):
        bright = even.copy()
        bright[0, 4, 6] = step
        assert np.argwhere(edges(dim, even, bright, even, even)).tolist() == [[0, 4, 6]] * seen
