"""Strips of φ that rows share: what a pixel counts of their samples, where rows lie closer than pixels are high."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba
import numpy as np
import pytest
from claims import mean
from numpy.typing import NDArray
from prototype import Laser, Receiver
from scipy.special import ndtr

from scanner_sim.analytic.geometry import lens_node, scanner_axes
from scanner_sim.render.background import sharp
from scanner_sim.render.background.sky import sky_light
from scanner_sim.render.background.strips import Strips
from scanner_sim.render.background.view import PanoramaView
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

Array = NDArray[np.float64]
mi: Any = mitsuba
PITCH, HEIGHT = 50e-6, 250e-6
RECEIVER = Receiver(aberration=0.0)
LAYOUT = OpticalLayout(Laser(), RECEIVER, 0.05, 0.8, PITCH, HEIGHT, 1e-3, 0.0)
BLURRED = replace(LAYOUT, diffusion=40e-6)
STEP, HIGH = PITCH / RECEIVER.focal_length, HEIGHT / RECEIVER.focal_length
BINS, FIRST = 12, 0.55
EDGE, SLOPE = -0.03, 0.4
"""y/z where the lit half ends, in the middle of the bins, and how that rises with x/z."""
FINE = 500

pytestmark = pytest.mark.usefixtures("device")


def rows_apart(step: float, count: int = 40) -> PanoramaView:
    """Return rows so many heights of a pixel apart, in the midst of which the lit half ends."""
    return PanoramaView(math.atan(EDGE) + step * HIGH * (np.arange(count) - 0.5 * count), FIRST, STEP, BINS)


def is_lit(x: Any, y: Any, z: Any) -> Any:
    """Return whether directions see the lit half."""
    return y < z * EDGE + SLOPE * (x - z * math.tan(FIRST + 0.5 * BINS * STEP))


def wanted(view: PanoramaView, layout: OpticalLayout) -> Array:
    """Return what share of what each pixel counts is lit, by plain sums over its width and height."""
    reach = 0.5 * layout.height + 5.0 * layout.point_spread
    height = reach * ((np.arange(FINE) + 0.5) / FINE * 2.0 - 1.0)
    spread = max(layout.point_spread, 1e-12)
    high = layout.height
    if view.between:  # interpolation adds a sixth of a squared step to the variance
        high = math.sqrt(high**2 - 2.0 * (RECEIVER.focal_length * view.row_step) ** 2)
    weight = ndtr((height + 0.5 * high) / spread) - ndtr((height - 0.5 * high) / spread)
    even = (np.arange(24) + 0.5) / 24 - 0.5
    angle = FIRST + STEP * (np.arange(BINS)[:, None, None] + even[:, None])
    found = []
    for phi in view.phi:
        along, _, normal = scanner_axes(angle, np.array(phi))
        ray = along + normal * (height[:, None] / RECEIVER.focal_length)
        found.append((is_lit(*np.moveaxis(ray, -1, 0)) * weight).mean(axis=(1, 2)) / weight.mean())
    return np.array(found)


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Array, float]]:
    """Return a function that tells what rows see of a lit half, (2 · seeds, rows, bins), by how many rays."""
    asked: list[int] = []

    def traced(loaded: Any, sky: Any, origin: Any, direction: Any, *_: Any, dark: float) -> tuple[Any, Any]:
        asked.append(dr.width(direction))
        light = dr.select(is_lit(*direction), mi.Float(1.0), dark)
        return light, 2.0 * light

    def rows(
        view: PanoramaView, layout: OpticalLayout, seeds: int, dark: float = 0.0, fine: Any = 1.0
    ) -> tuple[Array, float]:
        asked.clear()
        monkeypatch.setattr(sharp, "trace_sharp", lambda *given: traced(*given, dark=dark))
        uneven = mi.Float(np.broadcast_to(np.transpose([fine]), (view.rows, view.bins)).ravel().copy())
        found = [
            sharp.sharp_light(None, layout, None, view, uneven, finer=1, seed=seed)  # type: ignore[arg-type]
            for seed in range(seeds)
        ]
        both = np.array([[part.numpy() for part in half] for halves in found for half in halves])
        np.testing.assert_allclose(both[:, 1], 2.0 * both[:, 0], rtol=1e-5)
        return both[:, 0].reshape(-1, view.rows, view.bins).astype(np.float64), sum(asked) / seeds

    monkeypatch.setattr(sharp, "at_time", lambda loaded, time: loaded)
    monkeypatch.setattr(sharp, "for_rows", lambda loaded, row: loaded)
    return rows


@pytest.mark.parametrize("layout", [LAYOUT, BLURRED], ids=["sharp", "blurred"])
@pytest.mark.parametrize("step", [0.04, 0.19, 0.26, 0.41, 0.49, 0.8, 2.0])
def test_a_pixel_at_an_edge_is_lit_by_its_share(
    seen: Callable[..., tuple[Array, float]], step: float, layout: OpticalLayout
) -> None:
    """Claim: the lit share of what a pixel counts is right on average, where much is lit as where little is, however
    close the rows lie, and scatters by less than half as much as by 24 random samples in the height of a pixel.

    Set-up: twelve bins, 32° off the axis, in forty rows, across which the light ends aslant; forty seeds. Expected:
    plain sums, of 500 places. Tolerance: halves and seeds are independent; that weights are divided by their sum may
    cost 0.001 of an edge, as may the plain sums.
    """
    view = rows_apart(step)
    share = wanted(view, layout)
    edge = (share > 0.0) & (share < 1.0)
    found, _ = seen(view, layout, 40)
    errors = found - share
    assert edge.any(axis=0).all()
    assert_right(errors[:, edge], share[edge])
    assert np.mean(errors[:, edge] ** 2) < 0.5 * np.mean((share * (1.0 - share))[edge]) / 24.0
    assert np.all(abs(errors[:, ~edge]) < 1e-3)


def assert_right(errors: Array, share: Array) -> None:
    """Check that lit shares are right on average, and not drawn to the middle: errors (n, shares)."""
    assert mean(errors.mean(axis=-1), slack=5e-4)
    assert mean((errors * (share - 0.5)).mean(axis=-1), slack=5e-4)


@pytest.mark.parametrize("step", [0.1, 0.35])
def test_rows_between_which_one_interpolates_have_lower_pixels(
    seen: Callable[..., tuple[Array, float]], step: float
) -> None:
    """Claim: the same of them, by h²/12 less a sixth of the squared step; strips have the samples for their share of
    the lower height, rounded up."""
    view = replace(rows_apart(step), between=True)
    share = wanted(view, BLURRED)
    found, rays = seen(view, BLURRED, 40)
    edge = (share > 0.0) & (share < 1.0)
    assert_right((found - share)[:, edge], share[edge])
    strips = Strips.of(view, BLURRED)
    each = math.ceil(24 * strips.tall / (HEIGHT * math.sqrt(1.0 - 2.0 * step**2)))
    assert rays == 2 * each * BINS * strips.view.rows


@pytest.mark.parametrize("step", [0.1, 0.26])
def test_strips_count_by_their_height_and_not_by_their_samples(step: float) -> None:
    """Claim: of strips that are bright and dark in turns, with one sample and eight of them, a pixel counts the bright
    by the share of its height, weighed by the blurred pixel at the places of the samples."""
    strips = Strips.of(rows_apart(step), BLURRED)
    numbers = np.arange(strips.view.rows)
    tall = strips.tall * np.cos(FIRST + STEP * np.arange(BINS))
    parts = []
    for which, each in ((numbers[1::2], 8), (numbers[::2], 1)):
        within = (np.arange(each) + 0.5) / each - 0.5
        place = np.broadcast_to(within[:, None] * tall, (len(which), each, BINS)).swapaxes(1, 2)
        parts.append((which, each, place))
    groups = [
        (mi.UInt32((which[:, None] * BINS + np.arange(BINS)).ravel()), each) for which, each, _ in parts
    ]
    light = np.concatenate([np.full(place.size, each > 1, dtype=np.float64) for _, each, place in parts])
    places = np.concatenate([place.ravel() for *_, place in parts])
    found = strips.seen([mi.Float(values) for values in (places, light, 3.0 * light)], groups)
    places = np.concatenate([place.swapaxes(1, 2).reshape(-1, BINS) for *_, place in parts]).T
    number = np.concatenate([np.repeat(which, each) for which, each, _ in parts])
    many = np.where(numbers % 2, 8, 1)
    light = 1.0 * (number % 2)
    row_phi = strips.rows.phi[:, None, None]
    away = (
        (strips.view.phi[number] - row_phi)
        * RECEIVER.focal_length
        * np.cos(FIRST + STEP * np.arange(BINS))[:, None]
    )
    height = away + places
    weight = ndtr((height + 0.5 * HEIGHT) / 40e-6) - ndtr((height - 0.5 * HEIGHT) / 40e-6)
    weight /= many[number]
    share = (weight * light).sum(axis=-1) / weight.sum(axis=-1)
    np.testing.assert_allclose(found[0].numpy().reshape(-1, BINS), share, rtol=2e-3)
    np.testing.assert_allclose(found[1].numpy(), 3.0 * found[0].numpy(), rtol=1e-5)


def test_rays_are_the_same_however_many_are_traced_together(
    seen: Callable[..., tuple[Array, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: every byte is, if 30 bins are traced at a time."""
    view, fine = rows_apart(0.26), np.arange(40) % 2.0
    whole, _ = seen(view, BLURRED, 1, fine=fine)
    monkeypatch.setattr(sharp, "_RAYS_TOGETHER", 210)
    parts, _ = seen(view, BLURRED, 1, fine=fine)
    np.testing.assert_array_equal(parts, whole)


@pytest.mark.parametrize("step", [0.1, 0.26])
def test_a_strip_is_as_uneven_as_the_most_uneven_of_its_rows(step: float) -> None:
    """Claim: in each bin; strips beyond the ends are as the first and the last row."""
    strips = Strips.of(rows_apart(step), LAYOUT)
    contrast = np.random.default_rng(3).random((40, BINS))
    found = strips.uneven(mi.Float(contrast.ravel())).numpy().reshape(-1, BINS)
    number = strips.among * (np.arange(strips.view.rows) - strips.reach)
    own = np.clip(number[:, None] + np.arange(strips.among), 0, 39)
    np.testing.assert_allclose(found, contrast[own].max(axis=1), rtol=1e-6)


@pytest.mark.parametrize("step", [0.04, 0.26, 0.49, 0.8])
def test_even_light_is_even(seen: Callable[..., tuple[Array, float]], step: float) -> None:
    """Claim: where all is lit alike each pixel counts it, in the first and in the last row as in the others."""
    found, _ = seen(rows_apart(step), BLURRED, 2, dark=1.0)
    np.testing.assert_allclose(found, 1.0, rtol=1e-5)


def test_rows_that_look_at_the_same_need_few_rays(seen: Callable[..., tuple[Array, float]]) -> None:
    """Claim: where ten rows lie in the height of a pixel, two strips of 12 samples in each half serve five rows each,
    with two or three strips more at both ends; rows that hardly overlap have 24 samples each."""
    _, many = seen(rows_apart(0.1, 50), LAYOUT, 1)
    _, own = seen(rows_apart(0.6, 50), LAYOUT, 1)
    assert own == 2 * 24 * BINS * 50
    assert 2 * 12 * BINS * (10 + 4) <= many <= 2 * 12 * BINS * (10 + 6)


@pytest.mark.parametrize("step", [0.03, 0.1, 0.26, 0.49])
def test_strips_leave_no_gap_and_none_is_idle(step: float) -> None:
    """Claim: strips are as wide as the rows between their middles, half as high as a pixel at most and a quarter at
    least where rows are closer; the first reaches beyond all that the first row counts, and the second does not; a
    strip's time is that of the row in its middle, and of the nearest one at the ends."""
    view = replace(rows_apart(step), time=np.arange(40.0))
    strips = Strips.of(view, BLURRED)
    np.testing.assert_allclose(np.diff(strips.view.phi), strips.among * view.row_step)
    assert strips.tall == pytest.approx(strips.among * view.row_step * RECEIVER.focal_length)
    assert min(0.25 * HEIGHT, step * HEIGHT) <= strips.tall * (1.0 + 1e-9) <= 0.5 * HEIGHT * (1.0 + 2e-9)
    far = 0.5 * HEIGHT + 4.0 * BLURRED.point_spread
    narrow = math.cos(FIRST + BINS * STEP)
    for side, row in ((-1.0, 0), (1.0, -1)):
        places = side * (strips.view.phi - view.phi[row]) * RECEIVER.focal_length
        inner = np.sort((places - 0.5 * strips.tall) * narrow)
        assert inner[-1] < far
        assert (strips.tall * narrow + inner[-1]) >= far * (1.0 - 1e-9)
    time: Any = strips.view.time
    nearest = np.abs(strips.view.phi[:, None] - view.phi + 1e-9).argmin(axis=1)
    np.testing.assert_array_equal(time, nearest)


@pytest.mark.parametrize(("step", "shared"), [(0.499, True), (0.501, False)])
def test_rows_share_where_two_lie_in_the_height_of_a_pixel(step: float, shared: bool) -> None:
    """Claim: and only there; with rows between which one interpolates, whose pixels are lower, it is that height."""
    strips = Strips.of(rows_apart(step), LAYOUT)
    assert (strips.reach > 0) == shared
    assert shared or strips.view is strips.rows
    for end, reaches in ((1.36, shared), (1.38, False)):  # the cosine is 0.2 at 1.369
        view = PanoramaView(rows_apart(step).phi, end - BINS * STEP, STEP, BINS)
        assert (Strips.of(view, LAYOUT).reach > 0) == reaches
    lower = math.sqrt(1.0 - 2.0 * 0.499**2)
    assert not Strips.of(replace(rows_apart(0.499), between=True), LAYOUT).reach
    assert Strips.of(replace(rows_apart(0.499 * lower), between=True), LAYOUT).reach


@pytest.mark.parametrize("step", [0.1, 0.26, 0.8])
def test_what_moves_stands_where_it_is_in_the_time_of_a_row(step: float) -> None:
    """Claim: a wall that comes in from the side at 10 mrad/s covers of each row, 10 ms after the one before, what it
    covers then; the first and last rows see strips whose times are those of these rows.

    Tolerance: an edge on one lattice of 12 samples in each half, less than a quarter of a bin in each row.
    """
    side, distance = 4.0, 5.0
    start = RECEIVER.baseline + distance * math.tan(FIRST + 2.0 * STEP)
    speed = 0.01 * distance / math.cos(FIRST) ** 2
    wall = {"name": "wall", "shape": "rectangle", "size": (side, side), "material": {"reflectance": 0.4},
            "position": (start - 0.5 * side, 0.0, distance),
            "motion": {"type": "twist", "velocity": (speed, 0.0, 0.0)}}  # fmt: skip
    view = replace(rows_apart(step), time=0.01 * np.arange(40.0))
    loaded = load_scene(Scene(objects=[wall]))  # type: ignore[list-item]
    light = sky_light((0.0, 0.0, -1.0), 4.65e-3, None)
    uneven = mi.Float(np.ones(view.rows * view.bins))
    halves = sharp.sharp_light(loaded, LAYOUT, light, view, uneven, finer=1, seed=5)
    covered = np.mean([half[0].numpy() for half in halves], axis=0).reshape(40, BINS) / (0.4 / math.pi)
    lens, inner = lens_node(view.phi, 0.05, RECEIVER.baseline), slice(3, -3)
    away = (distance - lens[:, 2]) / np.cos(view.phi)
    edge = np.arctan2(start + speed * view.time - lens[:, 0], away)
    found = covered.sum(axis=1)[inner] - 0.5
    assert abs(found - (edge - FIRST)[inner] / STEP).max() < 0.5
