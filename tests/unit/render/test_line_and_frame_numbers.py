"""Where rays meet a leaning array, and what a camera's pixels sum up: by rays, by loops over cells, by quantiles."""

from __future__ import annotations

import math
from itertools import combinations
from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import mitsuba
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Laser, Receiver
from scipy.stats import norm

from scanner_sim.render.device import Device

Array = NDArray[np.float64]
mi: Any = mitsuba


def number(value: Any) -> float:
    return float(np.asarray(value.numpy()).ravel()[0])


def layout_of(receiver: Any) -> Any:
    from scanner_sim.render.transport import OpticalLayout

    return OpticalLayout(Laser(), receiver, 0.05, 1.0, 50e-6, 250e-6, 1e-3, 12e-6)


@pytest.mark.parametrize(("tilt", "focus"), [("scheimpflug", "infinity"), (0.0, 3.0), (0.2, 2.0)])
@pytest.mark.parametrize("tangent", [0.02, 0.09])
def test_an_image_lies_where_rays_through_the_pupil_meet_the_array(
    device: Device, tilt: Any, focus: Any, tangent: float
) -> None:
    """Claim: place, scale, blur by defocus and its lopsidedness on a leaning array are those of rays from a point
    through the pupil: u = (ξ + (t − ξ/v) v₀)/(1 − g (t − ξ/v)), v the image's depth, and 1/cosτ along the array.

    Expected: derivatives by differences over the pupil, whose points have a standard deviation of a fourth of the
    aperture; tolerance: theirs, and single precision.
    """
    from scanner_sim.render.beam.line_projection import array_position, on_array, to_pixels
    from scanner_sim.render.shots import Shots

    receiver = Receiver(array_tilt=tilt, focus_distance=focus, baseline=0.2, focal_length=0.1, aperture=0.05)
    layout, line, f, depth, tall = layout_of(receiver), receiver.line_image, 0.1, 2.5, 3e-3
    secant = math.hypot(1.0, line.slope)
    v = 1.0 / (1.0 / f - 1.0 / depth)

    def meets(xi: float) -> tuple[float, float]:
        """Place along the array and depth behind the lens."""
        ray = tangent - xi / v
        u = (xi + ray * line.depth) / (1.0 - line.slope * ray)
        return secant * u, line.depth + line.slope * u

    middle, behind = meets(0.0)
    step = 1e-4
    ahead, back = meets(step)[0], meets(-step)[0]
    shots = Shots(auto.UInt32(0), auto.Float(0.0), auto.Float(0.0))
    p, q = auto.Float(f * tangent), auto.Float(tall)
    found = on_array(layout, p, q, auto.Float(depth), shots)
    sigma = 0.05 / 4.0
    assert number(array_position(layout, p, q, shots)) == pytest.approx(middle, rel=1e-5)
    assert number(to_pixels(layout, auto.Float(middle))) == pytest.approx(
        (middle - 1e-3) / 50e-6 - 0.5, rel=1e-5
    )
    assert number(found.q) == pytest.approx(tall / f * behind, rel=1e-5)
    wide = sigma * (ahead - back) / (2.0 * step)
    spread, aberration = layout.point_spread**2, receiver.aberration**2
    skewed = secant / (1.0 - line.slope * tangent)
    assert number(found.blur_p) == pytest.approx(
        spread - aberration + aberration * skewed**2 + wide**2, rel=2e-3
    )
    high = sigma * (1.0 - behind / v)
    assert number(found.blur_q) == pytest.approx(spread + high**2, rel=2e-3)
    bent = 0.5 * sigma**2 * (ahead - 2.0 * middle + back) / step**2
    assert number(found.shift) == pytest.approx(bent, rel=2e-3, abs=1e-9)
    along = (line.scale * (tangent + 1e-6) / (1.0 - line.slope * (tangent + 1e-6)) - middle) / (1e-6 * f)
    by_p, by_q = found.slopes(auto.Float(1.0), auto.Float(0.0))
    assert number(by_p) == pytest.approx(along, rel=1e-4)
    tilted = line.depth / (1.0 - line.slope * (tangent + 1e-6))
    assert number(by_q) == pytest.approx(tall / f * (tilted - behind) / (1e-6 * f), rel=1e-3, abs=1e-6)
    assert number(found.slopes(auto.Float(0.0), auto.Float(1.0))[1]) == pytest.approx(behind / f, rel=1e-5)
    assert bool(found.behind.numpy()[0])


def test_an_image_grows_with_the_distance_of_its_array(device: Device) -> None:
    """Claim: an image distance that is 7 % longer makes places and scales, along the array and across it, 7 % larger,
    on one that leans too; the blur is that of the lens."""
    from scanner_sim.render.beam.line_projection import array_position, on_array
    from scanner_sim.render.shots import Shots

    layout = layout_of(Receiver(array_tilt=0.2, focus_distance=2.0, baseline=0.2, focal_length=0.1))
    p, q, depth = auto.Float(7e-3), auto.Float(3e-3), auto.Float(2.5)
    shots = Shots(auto.UInt32(0), auto.Float(0.0), auto.Float(0.0))
    longer: Any = SimpleNamespace(departures=SimpleNamespace(focus=auto.Float(0.07)))
    here, there = (on_array(layout, p, q, depth, one) for one in (shots, longer))
    for name, factor in (("q", 1.07), ("along", 1.07), ("across", 1.07), ("shear", 1.07), ("blur_q", 1.0)):
        assert number(getattr(there, name)) == pytest.approx(factor * number(getattr(here, name)), rel=1e-5)
    places = (number(array_position(layout, p, q, one)) for one in (longer, shots))
    assert next(places) == pytest.approx(1.07 * next(places), rel=1e-5)


@pytest.mark.parametrize("tilt", ["scheimpflug", 0.0, 0.2])
def test_a_lens_bends_and_blurs_before_the_array_leans(device: Device, tilt: Any) -> None:
    """Claim: a real lens's image lies where an ideal one's does that it moves there; along a leaning array the blur of
    its field is stretched as everything is, across it not; and scales follow places.

    Expected: the same array behind an ideal lens, and differences. Tolerance: single precision.
    """
    from dataclasses import replace

    from scanner_sim.optics.lens_errors import LensErrors
    from scanner_sim.render.beam.line_projection import array_position, on_array
    from scanner_sim.render.shots import Shots

    ideal = layout_of(Receiver(array_tilt=tilt, baseline=0.2, focal_length=0.1))
    lens = LensErrors(-0.3, 0.5, 2e-3, 1e-3, 80e-6, 9e-3)
    real = replace(ideal, lens=lens)
    shots = Shots(auto.UInt32(0), auto.Float(0.0), auto.Float(0.0))
    p, q, depth = 7e-3, 2e-3, auto.Float(2.5)
    there = on_array(real, auto.Float(p), auto.Float(q), depth, shots)
    moved = [auto.Float(float(one)) for one in lens.image(p, q, 0.1)[:2]]
    here = on_array(ideal, *moved, depth, shots)
    assert number(array_position(real, auto.Float(p), auto.Float(q), shots)) == pytest.approx(
        number(array_position(ideal, *moved, shots)), rel=1e-6
    )
    assert number(there.q) == pytest.approx(number(here.q), rel=1e-6)
    field = lens.variance(number(moved[0]))
    skewed = number(here.along) / number(here.across)
    assert number(there.blur_q) - number(here.blur_q) == pytest.approx(field, rel=1e-3)
    assert number(there.blur_p) - number(here.blur_p) == pytest.approx(field * skewed**2, rel=1e-3)
    assert number(there.shift) == pytest.approx(number(here.shift), rel=1e-6, abs=1e-12)
    step = 1e-3
    ahead, back = (
        number(array_position(real, auto.Float(p + way * step), auto.Float(q), shots)) for way in (1.0, -1.0)
    )
    assert number(there.along) == pytest.approx((ahead - back) / (2.0 * step), rel=1e-3)


@pytest.mark.parametrize("tangent", [-0.08, 0.0, 0.12])
def test_a_receiver_that_looks_past_the_laser_moves_the_spot(device: Device, tangent: float) -> None:
    """Claim: f tan(α + e) to the first order in e: what is left is 2 f t (1 + t²) e²/2."""
    from scanner_sim.render.beam.line_projection import synchronisation_shift

    e, f = 1e-3, 0.1
    found = synchronisation_shift(layout_of(Receiver(focal_length=f)), auto.Float(f * tangent), auto.Float(e))
    exact = f * math.tan(math.atan(tangent) + e)
    assert number(found) - exact == pytest.approx(-f * tangent * (1.0 + tangent**2) * e**2, abs=1e-8)


def test_departures_of_a_shot_stand_in_their_columns(device: Device) -> None:
    from scanner_sim.render.shot_departures import ShotDepartures

    found = ShotDepartures.of([auto.Float(float(column)) for column in range(8)])
    assert (number(found.base), number(found.focus)) == (0.0, 1.0)
    assert found.turn is not None
    assert found.shift is not None
    assert [number(one) for one in found.turn] == [2.0, 3.0, 4.0]
    assert [number(one) for one in found.shift] == [5.0, 6.0, 7.0]


@pytest.mark.parametrize("spread", [0.0, 40e-6, 200e-6])
def test_light_lands_across_the_line_as_pixel_and_point_spread_say(device: Device, spread: float) -> None:
    """Claim: below the quantile of a share lies that share of a box of the pixel's height, blurred by a Gaussian."""
    from scanner_sim.render.background.view import height_quantiles

    height = 250e-6
    quantiles = height_quantiles(height, spread)
    shares = np.linspace(0.0, 1.0, len(quantiles))
    box = height * ((np.arange(4000) + 0.5) / 4000.0 - 0.5)
    inner = quantiles[4:-4]
    below = ((inner[:, None] > box) if spread == 0.0 else norm.cdf((inner[:, None] - box) / spread)).mean(
        axis=1
    )
    np.testing.assert_allclose(below, shares[4:-4], atol=1e-3)


def test_samples_of_a_pixel_are_summed_by_cells(device: Device) -> None:
    """Claim: the mean; (Σ twist²)/n² of two by two cells, twist = a − b − c + d; the ends of the sharp light and of the
    materials. By loops, of three pixels of 4 × 4 cells."""
    from types import SimpleNamespace

    from scanner_sim.render.frame.light import _summed

    rng = np.random.default_rng(4)
    light, sharp = rng.random((2, 3, 16)).astype(np.float32)
    material = rng.integers(0, 9, (3, 16))
    met: Any = SimpleNamespace(material=auto.UInt32(material.astype(np.uint32).ravel()))
    mean, variance, least, most, first, last = _summed(
        auto.Float(light.ravel()), auto.Float(sharp.ravel()), met, 16
    )
    np.testing.assert_allclose(mean, light.mean(axis=1), rtol=1e-6)
    cells = light.reshape(3, 4, 4).astype(float)
    wanted = np.zeros(3)
    for row in (0, 2):
        for column in (0, 2):
            a, b = cells[:, row, column], cells[:, row, column + 1]
            c, d = cells[:, row + 1, column], cells[:, row + 1, column + 1]
            wanted += (a - b - c + d) ** 2
    np.testing.assert_allclose(variance, wanted / 256.0, rtol=1e-5)
    np.testing.assert_array_equal(least, sharp.min(axis=1))
    np.testing.assert_array_equal(most, sharp.max(axis=1))
    np.testing.assert_array_equal(first, material.min(axis=1))
    np.testing.assert_array_equal(last, material.max(axis=1))


def test_samples_of_a_pixel_lie_one_in_each_cell(device: Device) -> None:
    """Claim: 16 places, points of the Sun and points of the Earth each lie one in each of four by four cells, moments
    one in each of 16 parts of the exposure, and the parts are in other orders; later draws are four numbers of their
    own."""
    from scanner_sim.render.frame.light import _Strata

    sample = dr.arange(auto.UInt32, 16)
    strata = _Strata(7, dr.full(auto.UInt32, 5, 16), sample, 16)

    def cells(point: Any) -> list[int]:
        x, y = (np.asarray(part.numpy()) for part in (point[0], point[1]))
        return (np.floor(4.0 * x) + 4 * np.floor(4.0 * y)).astype(int).tolist()

    place, first = strata.place(), strata.draw(dr.zeros(auto.UInt32, 16))
    sun, earth = cells((first[0], first[1])), cells((first[2], first[3]))
    assert cells((place.x, place.y)) == list(range(16))
    for order in (sun, earth):
        assert sorted(order) == list(range(16))
    # Within its cell a place has two numbers of its own.
    inside = [
        4.0 * np.asarray(part.numpy()) % 1.0 for part in (place.x, place.y, *(first[k] for k in range(4)))
    ]
    assert all(np.abs(one - other).max() > 0.1 for one, other in combinations(inside, 2))
    assert sun != earth
    assert sun != list(range(16))
    moments = strata.moment(64).numpy().astype(int)
    assert sorted((moments // 4).tolist()) == list(range(16))
    assert strata.moment(1).numpy().max() == 0
    later = np.stack([np.asarray(part.numpy()) for part in strata.draw(dr.full(auto.UInt32, 1, 16))])
    assert len(np.unique(later)) == 64
    assert (later >= 0.0).all()
    assert (later < 1.0).all()


def test_slow_light_of_a_large_face_is_a_mean_about_each_pixel() -> None:
    """Claim: a pixel's slow light on a face of 200 pixels or more is the mean of all paths within 24 pixels that meet
    it, with their variance over their number; on others its own paths'. What shares faces have is uncertain by the
    twist of 2 × 2 strata, over the number of paths. By loops over the window."""
    from scanner_sim.render.frame.window_light import REACH, _Faces, _Paths

    rng = np.random.default_rng(8)
    rows, columns, samples = 30, 60, 4
    face = np.where(np.arange(columns) < 55, 3, 8)[None, :, None] * np.ones((rows, 1, samples), int)
    face[4, 9, 1] = 8  # a corner within a pixel
    slow = rng.random(face.shape) + face
    paths = _Paths(slow.astype(np.float32).ravel(), face.astype(np.uint32).ravel())
    pixels = np.array([0, 4 * columns + 9, 15 * columns + 30, 20 * columns + 57])
    one = _Paths(*(part.reshape(rows * columns, samples)[pixels].ravel() for part in paths))
    parts = _Faces(paths, (rows, columns)).light(one, pixels)
    for pixel, light, by_share, variance in zip(pixels, *parts, strict=True):
        row, column = divmod(int(pixel), columns)
        here = slice(max(row - REACH, 0), row + REACH + 1), slice(max(column - REACH, 0), column + REACH + 1)
        about = slow[here][face[here] == 3]
        a, b, c, d = values = np.where(face[row, column] == 3, about.mean(), slow[row, column])
        share = float((face[row, column] == 3).mean())
        assert light == pytest.approx(values.mean(), rel=1e-5)
        assert by_share == pytest.approx((a - b - c + d) ** 2 / samples**2, rel=1e-3, abs=1e-12)
        assert variance == pytest.approx(share**2 * about.var() / len(about), rel=1e-3)


def test_a_pixel_that_is_sampled_again_has_other_numbers(device: Device) -> None:
    """Claim: the draws of 4 and of 16 samples of a pixel have no number in common, and those of other pixels
    neither."""
    from scanner_sim.render.frame.light import _Strata

    found = []
    for pixel, samples in ((5, 4), (5, 16), (6, 4)):
        sample = dr.arange(auto.UInt32, samples)
        drawn = _Strata(7, dr.full(auto.UInt32, pixel, samples), sample, samples).draw(
            dr.full(auto.UInt32, 1, samples)
        )
        found.append(np.stack([np.asarray(part.numpy()) for part in drawn]).ravel())
    every = np.concatenate(found)
    assert len(np.unique(every)) == every.size


def test_each_pattern_looks_into_its_own_window(device: Device) -> None:
    """Claim: of two patterns of three shots, shots 0 to 2 have the first one's window and 3 to 5 the second's."""
    from scanner_sim.render.background.view import WindowsBeside

    numbers = [auto.UInt32(pair) for pair in ([4, 7], [64, 128], [0, 256])]
    windows = WindowsBeside(
        auto.Float([0.1, 0.2]), auto.Float([-0.3, 0.4]), *numbers[:2], 1e-3, 2e-3, start=numbers[2], shots=3
    )
    found = windows.at(auto.UInt32([0, 2, 3, 5]))
    np.testing.assert_allclose(found.first.numpy(), [0.1, 0.1, 0.2, 0.2], rtol=1e-6)
    np.testing.assert_allclose(found.phi.numpy(), [-0.3, -0.3, 0.4, 0.4], rtol=1e-6)
    assert found.rows.numpy().tolist() == [4, 4, 7, 7]
    assert found.bins.numpy().tolist() == [64, 64, 128, 128]
    assert found.start.numpy().tolist() == [0, 0, 256, 256]


def test_places_in_a_footprint_are_quantiles_between_their_nodes(device: Device) -> None:
    """Claim: the table holds quantiles at even shares; between two nodes the place goes evenly, to the last one."""
    from scanner_sim.render.frame.light import _quantile

    shares = np.array([0.0, 0.03, 0.125, 0.41, 0.7, 0.999, 1.0])
    table = np.array([-1.5, -0.2, 0.1, 0.7, 2.0])
    found = _quantile(mi.Float(table.tolist()), mi.Float(4.0), mi.Float(shares.tolist())).numpy()
    np.testing.assert_allclose(found, np.interp(4.0 * shares, np.arange(5), table), atol=1e-6)


def test_light_that_is_kept_apart_is_what_lacks_in_the_rest(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: with the slow part apart or not, the ends of the sharp light are those of the direct light, and the first
    surface's materials are the same; the radiance is less by the mean of the slow part, path by path, which alone has
    faces; σ is of what is summed."""

    from scanner_sim.render.background.paths import FirstHit, Radiance
    from scanner_sim.render.frame import light

    rng = np.random.default_rng(6)
    direct, slow, out, slow_out = rng.random((4, 2, 16)).astype(np.float32)
    material = rng.integers(1, 9, (2, 16)).astype(np.uint32)

    def trace(*_: Any) -> tuple[Radiance, FirstHit]:
        numbers = (auto.Float(part.ravel()) for part in (direct, out, slow, slow_out))
        normal = mi.Vector3f(0.0, 0.6, 0.8)
        return Radiance(*numbers), FirstHit(auto.UInt32(material.ravel()), normal, mi.Vector3f(0.0))

    monkeypatch.setattr(light, "trace_paths", trace)
    tracer: Any = object.__new__(light.FrameTracer)
    tracer.__dict__ |= {
        "_pixels": auto.UInt32(9),
        "_before": auto.UInt32(0),
        "_seed": 1,
        "_sky": None,
        "_bounces": 2,
    }
    tracer._rays = lambda *_: (None, None, None)
    numbers = np.array([3, 5], dtype=np.uint32)
    whole, parted = tracer.trace(numbers, 16), tracer.trace(numbers, 16, apart=True)
    np.testing.assert_allclose(whole[0], (direct + slow).mean(axis=1), rtol=1e-6)
    np.testing.assert_allclose(parted[0], direct.mean(axis=1), rtol=1e-6)
    for found, summed in ((whole[1], direct + slow), (parted[1], direct)):
        a, b, c, d = (summed.reshape(2, 4, 4)[:, i::2, j::2].astype(float) for i in (0, 1) for j in (0, 1))
        np.testing.assert_allclose(found, ((a - b - c + d) ** 2).sum(axis=(1, 2)) / 256.0, rtol=1e-5)
    for found in (whole, parted):
        np.testing.assert_array_equal(found[2:4], [direct.min(axis=1), direct.max(axis=1)])
        np.testing.assert_array_equal(found[4:6], [material.min(axis=1), material.max(axis=1)])
    np.testing.assert_array_equal(parted[6], slow.ravel())
    faces, met = np.asarray(parted[7]), material.ravel()
    assert all(
        (faces == face).tolist() == (met == own).tolist() for face, own in zip(faces, met, strict=True)
    )
    assert len(whole) == 6


@pytest.mark.parametrize(("tilt", "focus"), [("scheimpflug", "infinity"), (0.0, 3.0), (0.2, 2.0)])
def test_beams_are_seen_where_their_pixels_lie(device: Device, tilt: Any, focus: Any) -> None:
    """Claim: pixel i lies at s = offset + (i + ½) pitch along the array; there the image is v_a/f times as large as in
    the focal plane, v_a/v₀ as at infinity's, and along the array 1/(cosτ (1 − g t)) times that; a beam at d cosΘ from
    the axis, whose point lies at its depth, is blurred by (A/4)(1 − v_a (1/f − 1/L)), in pixels."""
    receiver = Receiver(array_tilt=tilt, focus_distance=focus, baseline=0.2, focal_length=0.1, aperture=0.05)
    line, theta, pixel = receiver.line_image, 0.3, np.array([2.0, 61.5, 240.0])
    seen = layout_of(receiver).seen_at(mi.Float(theta))(mi.Float(pixel.tolist()))
    place = 1e-3 + (pixel + 0.5) * 50e-6
    cosine = 1.0 / math.hypot(1.0, line.slope)
    behind = line.depth + place * line.slope * cosine
    tangent = place * cosine / behind
    depth = 0.2 * math.cos(theta) / tangent
    found = [part.numpy() for part in (seen.stretch, seen.across, seen.skewed, seen.defocus)]
    np.testing.assert_allclose(found[0], behind / line.depth, rtol=1e-5)
    np.testing.assert_allclose(found[1], behind / 0.1, rtol=1e-5)
    np.testing.assert_allclose(found[2], 1.0 / (cosine * (1.0 - line.slope * tangent)), rtol=1e-5)
    blur = 0.05 / 4.0 * (1.0 - behind * (10.0 - 1.0 / depth)) / 50e-6
    np.testing.assert_allclose(found[3], blur, rtol=1e-4, atol=1e-4)
