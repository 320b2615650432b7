"""What the instrument knows of a visit's error: single voxels, unlike pixels, images, and the parts by their names."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import SHARP
from scipy.stats import norm

from scanner_sim import Scenario, load_scenario
from scanner_sim.analytic import geometry as judge
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.config.scanner import geometry_of, speckle_optics
from scanner_sim.instrument.closed_loop import visit_errors
from scanner_sim.instrument.closed_loop.target_sensor import range_noise, share_of_line
from scanner_sim.instrument.closed_loop.visit_errors import (
    PatternSpeckle,
    alike,
    duty_cycle_of,
    error_parts,
    image_variance,
    range_variances,
)
from scanner_sim.optics.speckle import packets_of
from scanner_sim.render.device import Device
from scanner_sim.scan.schedule import PatternMotion
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.tracking.errors import pixel_correlation
from scanner_sim.tracking.lasting import SurfaceParts, SurfaceSpeckle
from scanner_sim.tracking.measurement import Measurement, Sight, TargetAppearance
from scanner_sim.tracking.record import TrackTarget
from scanner_sim.tracking.response import TargetKind
from scanner_sim.tracking.samples import PatternSamples

Array = NDArray[np.float64]

DISTANCE, SIGNAL = 9.0, 3e4
FIT = "maximum_likelihood"
DISC = {"name": "node", "array": {"diameter": 0.1, "plate": 0.4}, "position": (0.1, 0.05, 9.0)}


def scenario(**scanner: Any) -> Scenario:
    return load_scenario(
        {
            "schema": 1,
            "scanner": scanner,
            "scene": {"objects": [DISC]},
            "scan": {"type": "track", "targets": ["node"]},
        }
    )


def width_of_image(scanner: Any) -> float:
    return math.sqrt(image_variance(scanner, np.array([DISTANCE]))[0])


def test_an_image_is_as_wide_as_beam_and_lens_make_it() -> None:
    scanner = scenario().scanner
    beam = 0.5 * scanner.laser.radius(DISTANCE) * scanner.receiver.focal_length / DISTANCE
    spread = math.hypot(scanner.receiver.aberration, scanner.position_sensor.diffusion)
    wanted = (beam**2 + spread**2) / scanner.position_sensor.pitch**2
    assert image_variance(scanner, np.array([DISTANCE]))[0] == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(
    ("grain", "laser_off", "theta"), [(0.0, 0.0, 0.0), (2e-3, 0.0, -0.4), (0.0, 0.2, 0.35)]
)
def test_a_range_errs_as_a_weighed_fit_of_its_spot(grain: float, laser_off: float, theta: float) -> None:
    """Claim: noise and unlike pixels move the range as they move the place that a weighed fit of the spot finds.

    Each pixel is changed by itself; the fit is the least squares of the change by the slope, weighed by 1/v. A pixel
    without light has the noise of reading, steps and dark charge; of the exposure without the laser, for a fifth of the
    dwell, four times as large. A pixel is as many metres as eq 1 says at the deflection Θ: 19 % more in the variance at
    −0.4 rad than straight ahead.
    """
    scanner = scenario(laser_off=laser_off).scanner
    sensor, receiver = scanner.position_sensor, scanner.receiver
    width = width_of_image(scanner)
    pixel, step = np.arange(-8, 8), 1e-4

    def charges(middle: float) -> Array:
        return SIGNAL * np.asarray(norm.cdf(pixel + 1.0, middle, width) - norm.cdf(pixel, middle, width))

    charge = charges(0.75)
    slope = (charges(0.75 + step) - charges(0.75 - step)) / (2.0 * step)
    step_size = sensor.full_well / 2**sensor.adc_bits
    reading = sensor.read_noise**2 + step_size**2 / 12.0
    dark = (1.0 - laser_off) * sensor.dark_current / scanner.rate
    floor = reading + dark if laser_off == 0.0 else 17.0 * reading + 5.0 * dark
    variance = floor + charge + (sensor.prnu * charge) ** 2 + grain * SIGNAL * charge
    moved = np.array([np.sum(slope * change / variance) for change in np.eye(16)]) / np.sum(
        slope**2 / variance
    )
    place = judge.image_position(DISTANCE, theta, receiver.focal_length, receiver.baseline)
    there, before = (
        judge.triangulated_range(
            place + sign * 1e-3 * sensor.pitch, theta, receiver.focal_length, receiver.baseline
        )
        for sign in (1.0, -1.0)
    )
    by_pixel = float(there - before) / 2e-3
    noise = np.sum(moved**2 * (floor + charge)) * by_pixel**2
    unlike = np.sum((moved * sensor.prnu * charge) ** 2) * by_pixel**2
    assert sensor.prnu > 0.0
    *found, _ = range_variances(
        scanner, FIT, np.full(2, DISTANCE), np.full(2, theta), np.array([SIGNAL, 0.0]), grain
    )
    np.testing.assert_allclose(found, [[noise, 0.0], [unlike, 0.0]], rtol=1e-4)


@pytest.mark.parametrize("peak", [name for name in ESTIMATORS if name != FIT])
@pytest.mark.parametrize("distance", [2.5, DISTANCE])
def test_ranges_of_other_estimators_err_by_their_own_weights(
    device: Device, peak: Any, distance: float
) -> None:
    """Claim: noise and unlike pixels move the range as they move the place that the judge's own estimator finds.

    Each pixel is changed by itself, on lines with the spot at 32 places in its brightest pixel, where all of them count
    alike. That of `gaussian` moves more than √2 times as far as an efficient fit. The third is the width of the
    Gaussian image of the same second moment. Tolerance: 2 %, for 16 places of 32 and a table that is linear between
    widths.
    """
    scanner = scenario().scanner
    sensor, width = scanner.position_sensor, math.sqrt(image_variance(scanner, np.array([distance]))[0])
    floor = SensorCalibration.of(sensor, scanner.dwell).floor
    found, noise, unlike, second = ESTIMATORS[peak], 0.0, 0.0, 0.0
    places = (np.arange(32) + 0.5) / 32.0 - 0.5
    for place in places:
        line = np.asarray(SIGNAL * pixel_shares(12.0 + place, width, 25))
        moved = np.array(
            [found((line + one).tolist()) - found((line - one).tolist()) for one in 0.1 * np.eye(25)]
        )
        moved /= 0.2
        noise += float(np.sum(moved**2 * (floor + line))) / len(places)
        unlike += float(np.sum((moved * line) ** 2)) / len(places)
        second += float(np.sum((moved * line * (np.arange(25) - 12.0 - place)) ** 2)) / len(places)
    receiver = scanner.receiver
    by_pixel = distance**2 * sensor.pitch / (receiver.focal_length * receiver.baseline)
    wanted = noise * by_pixel**2, unlike * (sensor.prnu * by_pixel) ** 2, math.sqrt(second / (1.5 * unlike))
    told = range_variances(scanner, peak, np.array([distance]), np.zeros(1), np.array([SIGNAL]), 2e-3)
    np.testing.assert_allclose(np.ravel(told), wanted, rtol=0.02)
    fitted = range_variances(scanner, FIT, np.array([distance]), np.zeros(1), np.array([SIGNAL]), 2e-3)
    assert peak != "gaussian" or told[1][0] > 2.0 * fitted[1][0]


@pytest.mark.parametrize(("signal", "grain"), [(3e4, 0.0), (3e5, 0.0), (1e7, 5e-5)])
def test_images_share_what_their_weights_on_pixels_do(signal: float, grain: float) -> None:
    """Claim: errors by unlike pixels of two images go together as those of Gaussian images over even noise that are as
    wide as is told, where reading, shot noise or speckle rules the noise of a pixel.

    Set-up: Σ w_i q_i ε_i of one image and of another beside it, the products of their weights w q added over the pixels
    and over 16 places between two of them, w the slope of the charge over its variance. Tolerance: 0.02, by which no
    Gaussian image is like it; with the image's own width it is 0.1, 0.26 and 0.3.
    """
    scanner = scenario().scanner
    sensor, own = scanner.position_sensor, width_of_image(scanner)
    floor = SensorCalibration.of(sensor, scanner.dwell).floor
    pixel = np.arange(-30, 30)

    def weighed(middle: float) -> Array:
        def charges(at: float) -> Array:
            return signal * np.asarray(norm.cdf(pixel + 1.0, at, own) - norm.cdf(pixel, at, own))

        charge, slope = charges(middle), charges(middle + 1e-4) - charges(middle - 1e-4)
        return slope * charge / (floor + charge + (sensor.prnu * charge) ** 2 + grain * signal * charge)

    places = np.arange(16) / 16.0
    one = np.stack([weighed(place) for place in places])
    here = np.array([DISTANCE])
    (width,) = range_variances(scanner, FIT, here, np.zeros(1), np.array([signal]), grain)[2]
    for apart in own * np.array([0.5, 1.0, 1.5, 2.0, 3.0]):
        other = np.stack([weighed(place + apart) for place in places])
        told = (one * other).sum() / (one**2).sum()
        assert told == pytest.approx(float(pixel_correlation(apart / width)), abs=0.02)


def voxels(theta: Array, reach: Array, sigma: Array) -> PatternSamples:
    """Return voxels of which only deflection, range and its σ count."""
    blank = np.zeros((1, theta.size))
    return PatternSamples(
        50e-6 * np.arange(theta.size)[None], theta[None], blank, blank + SIGNAL, blank + 1.0, reach[None],
        sigma[None], blank.astype(np.uint8),
    )  # fmt: skip


def test_spots_on_the_same_pixels_share_all_and_others_nothing() -> None:
    """Claim: voxels whose images coincide, whatever their deflection, share all; two groups far apart share their
    weights' squares."""
    scanner = scenario().scanner
    f, d, pitch = scanner.receiver.focal_length, scanner.receiver.baseline, scanner.position_sensor.pitch
    theta = np.linspace(-0.3, 0.3, 20)
    same = judge.triangulated_range(45.0 * pitch, theta, f, d)
    sigma, here = np.linspace(1e-3, 3e-3, 20), np.array([DISTANCE])
    width = np.sqrt(image_variance(scanner, here))
    assert alike(geometry_of(scanner), voxels(theta, same, sigma), here, width)[0] == pytest.approx(
        1.0, abs=1e-9
    )
    far = np.where(np.arange(20) < 6, 45.0, 75.0) * pitch
    weight = 1.0 / sigma**2
    wanted = (weight[:6].sum() ** 2 + weight[6:].sum() ** 2) / weight.sum() ** 2
    reach = judge.triangulated_range(far, theta, f, d)
    assert alike(geometry_of(scanner), voxels(theta, reach, sigma), here, width)[0] == pytest.approx(
        wanted, abs=1e-9
    )


def test_spots_on_a_tilted_line_share_what_their_places_on_it_do() -> None:
    """Claim: a tilted line images a point at Θ, R where its ray meets it; voxels share the correlation of those
    places, pair by pair.

    Set-up: a line 40° off the lens's plane, voxels along a steep surface.
    """
    scanner = scenario(receiver={"array_tilt": math.radians(40.0)}).scanner
    line, d = geometry_of(scanner), scanner.receiver.baseline
    assert abs(line.slope) > 0.5
    theta = np.linspace(-0.01, 0.01, 12)
    reach = DISTANCE + 40.0 * theta
    # The lens, whose axis turns with the beam, lies d cosΘ beside it and d sinΘ ahead: s = t (h + g s) along its ray.
    tangent = d * np.cos(theta) / (reach - d * np.sin(theta))
    place = np.zeros(12)
    for _ in range(30):
        place = tangent * (line.scale + line.slope * place)
    width = np.array([1.2])
    sigma = np.linspace(1e-3, 2e-3, 12)
    weight = 1.0 / sigma**2
    shared = pixel_correlation((place[:, None] - place) / (line.pitch * width[0]))
    wanted = weight @ shared @ weight / weight.sum() ** 2
    found = alike(line, voxels(theta, reach, sigma), np.array([DISTANCE]), width)
    assert found[0] == pytest.approx(wanted, abs=1e-6)


def test_pixels_count_where_the_range_of_a_target_comes_from() -> None:
    """Claim: voxels beside a disc, which move its range by nothing, leave its share of unlike pixels as it is; those at
    its rims, on pixels of their own, share what the products of their gains do."""
    scanner = scenario().scanner
    f, d, pitch = scanner.receiver.focal_length, scanner.receiver.baseline, scanner.position_sensor.pitch
    theta, here = np.linspace(-0.01, 0.01, 20), np.array([DISTANCE])
    place = np.array([45.0] * 6 + [75.0] * 6 + [105.0] * 8)
    samples = voxels(theta, judge.triangulated_range(place * pitch, theta, f, d), np.full(20, 1e-3))
    width = np.sqrt(image_variance(scanner, here))
    for gains, wanted in (
        (np.where(place == 45.0, 1.0 / 6.0, 0.0), 1.0),
        (np.array([0.125] * 6 + [1.0 / 24.0] * 6 + [0.0] * 8), 0.75**2 + 0.25**2),
    ):
        sight = Sight(cast(Any, None), np.zeros((1, 2, 20)), None, gains[None])
        found = alike(geometry_of(scanner), samples, here, width, sight)
        assert found[0] == pytest.approx(wanted, abs=1e-9)


def made(known: Scenario, by_line: float = 1.0) -> tuple[Any, Measurement, PatternMotion]:
    """Return the parts of a visit's error, what was seen, and how the mirrors ran."""
    theta = np.linspace(0.05, 0.06, 32)
    samples = voxels(theta, np.full(32, DISTANCE), np.full(32, 1e-3))
    mixed = np.random.default_rng(3).normal(size=(3, 3))
    scale = np.array([1e-4, 1e-4, 1e-2])
    covariance = (mixed @ mixed.T + np.eye(3)) * np.outer(scale, scale)
    one = np.ones(1)
    seen = Measurement(
        time=one,
        position=np.array([[0.055, -0.02, DISTANCE]]),
        covariance=covariance[None],
        radius=0.05 / DISTANCE * one,
        sigma_radius=1e-5 * one,
        misfit=one,
        fraction=0.3 * one,
        found=one > 0.0,
    )
    zero = np.zeros(32)
    one_motion = PatternMotion(
        time=10.0 + 50e-6 * np.arange(32), commanded_theta=theta, commanded_phi=2.0 * theta, true_theta=theta,
        true_phi=zero, latched_theta=theta, latched_phi=zero, travel_theta=zero, travel_phi=zero,
        limited=np.zeros((), dtype=np.bool_),
    )  # fmt: skip
    motion = PatternMotion.stack([one_motion])
    appearance = TargetAppearance(kind=TargetKind.BLACK, diameter=0.1)
    target = TrackTarget("node/1", "node", appearance, seen.position[0], np.array([0.3, -0.4, 0.0]))
    speckle = None
    if known.scanner.laser.speckle:
        speckle = PatternSpeckle(speckle_optics(known.scanner), np.full((1, 32), 1e-3), np.zeros(1))
    share = np.array([by_line])
    parts = error_parts(known, samples, seen, target, motion, np.array([3]), speckle, share)
    return parts.at(0), seen, motion


@pytest.mark.parametrize("peak", [FIT, "parabola"])
def test_parts_have_what_the_instrument_knows(device: Device, peak: Any) -> None:
    """Claim: wobble's variance, the turn two beams over radius, the image by eq 1, the drift where commanded; what
    unlike pixels do to the estimator of the scenario."""
    course = {"rate": 0.5, "amplitude": 2.0}
    known = scenario(laser={"speckle": False}, mirrors={"temperature": course})
    known = known.replace({"processing.peak": peak})
    scanner, mirrors = known.scanner, known.scanner.mirrors
    parts, seen, motion = made(known)
    np.testing.assert_allclose(parts.white, seen.covariance[0])
    np.testing.assert_array_equal(parts.surface, 0.0)
    assert parts.wobble == pytest.approx(mirrors.wobble**2)
    assert (parts.wobble_time, parts.wobble_angle) == (mirrors.wobble_time, mirrors.wobble_angle)
    assert parts.turn == pytest.approx(2.0 * scanner.laser.radius(DISTANCE) / 0.05)
    assert parts.range_fades == pytest.approx(1.0)
    # The rim, at √(0.5² + 0.05²) m from the origin, in radii of the beam a millimetre nearer and farther.
    rim = [math.hypot(0.5, 0.05) / scanner.laser.radius(DISTANCE + step) for step in (-1e-3, 1e-3)]
    assert 4e-3 / parts.approach == pytest.approx(rim[0] - rim[1], rel=1e-6)
    image = judge.image_position(DISTANCE, 0.055, scanner.receiver.focal_length, scanner.receiver.baseline)
    assert parts.image == pytest.approx(float(image) / scanner.position_sensor.pitch, rel=1e-9)
    kelvins = mirrors.temperature.spread(motion.time[0, :1])[0]
    assert kelvins > 0.0
    for axis, commanded in enumerate((motion.commanded_theta.mean(), motion.commanded_phi.mean())):
        wanted = kelvins * (mirrors.drift_zero + mirrors.drift_scale * commanded)
        assert parts.drift[axis] == pytest.approx(wanted)
    here = np.array([DISTANCE])
    _, pixels, width = range_variances(scanner, peak, here, np.array([0.055]), np.array([SIGNAL]))
    samples = voxels(np.linspace(0.05, 0.06, 32), np.full(32, DISTANCE), np.full(32, 1e-3))
    (share,) = alike(geometry_of(scanner), samples, here, width)
    assert parts.pixels == pytest.approx(pixels[0] * share)
    # Images that scatter by s_x about the width s are one of √(s² + s_x²), of which (s²/(s² + s_x²))^1.5 is left.
    assert (width[0] / parts.image_width) ** 3 == pytest.approx(share)
    assert share < 1.0


@pytest.mark.parametrize("share", [1.0, 0.6, 0.0])
def test_ranges_have_what_voxels_share_by_triangulations_share_in_them(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: unlike pixels count by the square of the share λ. Of a range weighted by one over variances λ of its
    variance are triangulation's, and λ² of the line's own noise are without speckle: all of it is where λ is 0."""
    told: list[SurfaceSpeckle] = []
    nothing = SurfaceParts(np.zeros((1, 3, 3)), np.zeros((1, 3, 3)), np.zeros((1, 2, 3, 3)))
    monkeypatch.setattr(
        visit_errors, "surface_parts", lambda samples, seen, speckle: told.append(speckle) or nothing
    )
    whole, _, _ = made(scenario())
    parts, _, _ = made(scenario(), share)
    assert parts.pixels == pytest.approx(share**2 * whole.pixels)
    assert whole.pixels > 0.0
    assert parts.image_width == whole.image_width
    alone, mixed = (one.range_noise for one in told)
    np.testing.assert_allclose(mixed, share**2 * alone + (1.0 - share) * 1e-3**2, rtol=1e-12)


def test_the_share_of_the_line_is_that_of_its_precision() -> None:
    """Claim: 1 or 0 where there is one rangefinder; of both it goes by the medians of σ: one over their squares."""
    sigma = np.array([[1e-3, 3e-3, 2e-3], [2e-3, 2e-3, np.nan], [np.nan] * 3, [1e-3] * 3, [np.nan] * 3])
    pulses = np.array([[4e-3] * 3, [2e-3] * 3, [4e-3] * 3, [np.nan] * 3, [np.nan] * 3])
    layers = {"sigma_range_m": sigma, "tof.sigma_range_m": pulses}
    none = np.zeros(5)
    found = share_of_line(("triangulation", "tof"), lambda: range_noise(layers, none), 5)
    np.testing.assert_allclose(found, [0.8, 0.5, 0.0, 1.0, 0.0], rtol=1e-12)
    # Of σ 2 and 4 mm with a covariance of 2 mm² the shares are 14 and 2 of 16.
    found = share_of_line(("triangulation", "tof"), lambda: range_noise(layers, none + 2e-6), 5)
    np.testing.assert_allclose(found, [7.0 / 8.0, 0.5, 0.0, 1.0, 0.0], rtol=1e-12)
    np.testing.assert_array_equal(
        share_of_line(("triangulation",), lambda: range_noise(layers, none), 5), 1.0
    )
    np.testing.assert_array_equal(share_of_line(("tof",), lambda: range_noise({}, none), 5), 0.0)


def test_faint_voxels_have_more_noise() -> None:
    """Claim: ranges of a pattern's voxels have the noise of their own light, to 3 % between the faintest and the
    brightest; what is dark has none."""
    scanner = scenario().scanner
    here, signal = np.array([DISTANCE]), np.geomspace(0.02, 1.0, 7) * SIGNAL
    width, light = np.sqrt(image_variance(scanner, here)), np.append(signal, 0.0)[None]
    extremes = np.array(visit_errors._extremes(light))
    alone, *_ = visit_errors._range_variances(scanner, FIT, here, np.zeros(1), width, extremes, np.zeros(1))
    found = visit_errors._noise_of_voxels(light, extremes, alone)[0]
    wanted = [range_variances(scanner, FIT, here, np.zeros(1), np.array([one]))[0][0] for one in signal]
    np.testing.assert_allclose(found[:-1], wanted, rtol=0.03)
    np.testing.assert_allclose(found[[0, 6]], [wanted[0], wanted[6]])
    assert found[-1] == 0.0
    assert wanted[0] > 100.0 * wanted[-1]


def test_what_the_surface_makes_is_taken_from_the_white_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: white and surface make what voxels tell and neighbours share; the speckle is that of the image alone."""
    told: list[SurfaceSpeckle] = []
    part = np.diag([1e-10, 2e-10, 3e-6])

    shared = 0.1 * part

    dither = np.stack([0.3 * part, 0.1 * part])

    def surface(samples: Any, seen: Any, speckle: SurfaceSpeckle) -> SurfaceParts:
        assert (samples.signal.shape, seen.covariance.shape) == ((1, 32), (1, 3, 3))
        told.append(speckle)
        return SurfaceParts(part[None], shared[None], dither[None])

    monkeypatch.setattr(visit_errors, "surface_parts", surface)
    known = scenario()
    scanner = known.scanner
    parts, seen, _ = made(known)
    np.testing.assert_allclose(parts.surface, part)
    np.testing.assert_allclose(parts.white + parts.surface, seen.covariance[0] + shared, rtol=1e-12)
    np.testing.assert_array_equal(parts.dither, dither)
    # The third pattern is the second pair's inverted one.
    pair = (0.5 + 0.8191725133961645) % 1.0
    lag = scanner.galvanometers.lag * 20e3
    assert parts.dwell_place == pytest.approx(lag - pair)
    (speckle,) = told
    assert speckle.radius == pytest.approx(scanner.laser.radius(DISTANCE))
    wide = scanner.laser.radius(DISTANCE) / DISTANCE
    assert parts.dwell_step == pytest.approx(
        0.01 / 31.0 * math.hypot(1.0, 2.0 * math.cos(0.055)) / wide, rel=1e-3
    )
    np.testing.assert_allclose(parts.offset, [0.0, 0.13 * math.cos(0.055) / wide], atol=1e-9)
    alone = range_variances(scanner, FIT, np.array([DISTANCE]), np.array([0.055]), np.array([SIGNAL]))[0]
    np.testing.assert_allclose(speckle.range_noise, alone[0] + np.zeros((1, 32)))
    beam = 0.5 * scanner.laser.radius(DISTANCE) * scanner.receiver.focal_length / DISTANCE
    variance = (beam / scanner.position_sensor.pitch) ** 2
    assert speckle.on_surface == pytest.approx(
        packets_of(speckle_optics(scanner), variance, variance, SHARP).on_surface
    )
    # Ranges go sooner, as :mod:`scanner_sim.tracking.lasting` has it.
    kept = 1.0 - 0.5 * float(speckle.on_surface[0])
    assert parts.range_fades == pytest.approx(kept / (kept - 0.3545 * float(speckle.on_surface[0])))
    assert parts.range_fades > 1.1
    assert duty_cycle_of(known) == pytest.approx(1.0)
    assert duty_cycle_of(scenario(laser_off=0.2)) == pytest.approx(0.8)
    # The first rangefinder gives the signals, and pulses have no dwell.
    for ways, wanted in ((("triangulation", "tof"), 0.75), (("tof",), 0.0), (("tof", "triangulation"), 0.0)):
        told: Any = SimpleNamespace(scanner=SimpleNamespace(exposure=3.0, dwell=4.0), rangefinders=ways)
        assert duty_cycle_of(told) == wanted


@pytest.mark.parametrize("count", [1, 2, 5, 6])
def test_a_median_of_patterns_is_the_middle_of_all_or_unknown(count: int) -> None:
    values = np.random.default_rng(21).normal(0.0, 1.0, (4, count))
    values[2, count // 2] = np.nan
    np.testing.assert_allclose(visit_errors._median(values), np.median(values, axis=1), rtol=1e-15)


def test_an_image_on_a_tilted_array_is_drawn_out_along_it() -> None:
    """Claim: a beam seen on a tilted array is as wide as its own image times the array's stretch, beside what lens and
    defocus spread; the plain line image of the scanner says how far."""
    tilted = scenario(receiver={"array_tilt": "scheimpflug"}).scanner
    distance = 3.0
    beam = 0.5 * tilted.laser.radius(distance) * tilted.receiver.focal_length / distance
    place = tilted.seen_at(np.array([distance]))
    pitch = tilted.position_sensor.pitch
    blur = place.spread(0.0, (tilted.receiver.aberration / pitch) ** 2)
    wanted = (beam / pitch * place.along) ** 2 + (tilted.point_spread / pitch) ** 2 + blur
    assert abs(float(np.ravel(place.along)[0]) - 1.0) > 0.02
    np.testing.assert_allclose(image_variance(tilted, np.array([distance])), np.ravel(wanted), rtol=1e-9)
