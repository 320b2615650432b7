"""Jumps, latched angles, drifts and folds by sums of their own: closed forms, averages and differences."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from prototype import BandpassFilter, Galvanometers, Laser, Mirrors, Pulse, TemperatureCourse

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import PARAMETERS
from scanner_sim.optics.as_built import AsBuilt
from scanner_sim.optics.built_instrument import BuiltInstrument
from scanner_sim.optics.deflection import WOBBLE_LASTS, wobble_correlation
from scanner_sim.optics.filter import filter_warnings
from scanner_sim.optics.galvanometer import MirrorMotion, MirrorState, latch
from scanner_sim.optics.interior_orientation import InteriorOrientation
from scanner_sim.optics.jump import jump_duration, jump_path, latest_settling
from scanner_sim.optics.lens_errors import LensErrors
from scanner_sim.optics.pulse import read_pulse

SERVO = Galvanometers(jump_share=0.7)


def test_a_jump_takes_the_time_of_its_peak_speed() -> None:
    """Claim: with the peak speed p = min(v, √(D a)) a jump takes D/p + p/a, on both sides of where it coasts."""
    v, a = 0.7 * SERVO.slew, 0.7 * SERVO.acceleration
    coasts = v * v / a
    for distance in coasts * np.array([0.01, 0.5, 0.97, 1.03, 2.0, 30.0]):
        peak = min(v, math.sqrt(distance * a))
        found = float(jump_duration(SERVO, -distance))
        assert found == pytest.approx(distance / peak + peak / a, rel=1e-12)


@pytest.mark.parametrize("far", [0.4, 3.0])
def test_a_jump_asks_for_its_share_of_speed_and_acceleration(far: float) -> None:
    """Claim: differences of the path reach 0.7 of both limits and no more, and the path is the same backwards."""
    v, a = 0.7 * SERVO.slew, 0.7 * SERVO.acceleration
    distance = far * v * v / a
    lasts = float(jump_duration(SERVO, distance))
    time = np.linspace(0.0, lasts, 2001)
    path = jump_path(SERVO, np.array([0.1]), np.array([0.1 + distance]), time)[0] - 0.1
    step = time[1]
    rate, gain = np.diff(path) / step, np.diff(path, 2) / step**2
    assert rate.max() == pytest.approx(min(v, math.sqrt(distance * a)), rel=2e-3)
    assert (gain.max(), gain.min()) == pytest.approx((a, -a), rel=1e-6)
    np.testing.assert_allclose(path + path[::-1], distance, rtol=1e-12)


def test_a_jump_is_looked_at_for_25_time_constants() -> None:
    """Claim: to the command's end e⁻²⁵ of the jump is left; two steps of 5 µs, or of 1e-6 of what is long, are more."""
    left = math.exp(
        -SERVO.damping * 2.0 * math.pi * SERVO.natural_frequency * (latest_settling(SERVO, 2e-3) - 2.01e-3)
    )
    assert left == pytest.approx(math.exp(-25.0), rel=1e-6, abs=0.0)
    assert latest_settling(SERVO, 1e3) - 1e3 == pytest.approx(2e-3, abs=1e-3 * 25.0)


@pytest.mark.parametrize("delay", [0.25, 2.5, 3.75])
def test_angles_are_latched_whole_updates_and_a_part_earlier(delay: float) -> None:
    """Claim: the cubic is exact on t³ − 2t; before the motion began the mirror stood where it began."""
    time = np.arange(1.0, 9.0)
    true = time**3 - 2.0 * time
    motion = MirrorMotion(true, true, 3.0 * time**2 - 2.0, np.zeros(8, dtype=bool))
    found = latch(motion, MirrorState(np.array(0.0), np.array(-2.0), np.array(0.0)), 1.0, delay)
    then = time - delay
    np.testing.assert_allclose(found, np.where(then > 0.0, then**3 - 2.0 * then, 0.0), atol=1e-12)


def test_the_expected_drift_is_the_mean_square_over_all_phases() -> None:
    """Claim: spread² is the mean of (rate t + amplitude sin α)² over α, and a mirror drifts by ΔT (zero + scale Θ)."""
    course = TemperatureCourse(amplitude=4.0, period=600.0, rate=0.01)
    phase = 2.0 * math.pi * np.arange(360) / 360.0
    for time in (0.0, 90.0, 700.0):
        mean = np.mean((0.01 * time + 4.0 * np.sin(phase)) ** 2)
        assert float(course.spread(np.array(time))) ** 2 == pytest.approx(mean, rel=1e-12)
    warm = float(course.difference(np.array(150.0)))
    assert warm == pytest.approx(1.5 + 4.0)
    mirrors = Mirrors(
        temperature=course, drift_zero=2e-5, drift_scale=-3e-4, jitter=3e-5, jitter_seen=0.75, wobble=2e-5,
        readout_noise=1e-5, readout_step=4e-5,
    )  # fmt: skip
    assert float(mirrors.drift(np.array(0.2), np.array(150.0))) == pytest.approx(5.5 * (2e-5 - 6e-5))
    wanted = 0.25 * 9e-10 + 4e-10 + 1e-10 + 16e-10 / 12.0
    wanted += (1.5**2 + 8.0) * (2e-5 - 6e-5) ** 2
    assert float(mirrors.reading_sigma(np.array(0.2), np.array(150.0))) ** 2 == pytest.approx(
        wanted, rel=1e-6, abs=0.0
    )


def test_wobbles_are_alike_as_their_weights_share_numbers() -> None:
    """Claim: each place u has the weights (cos s, sin s) of the independent numbers at ⌊u⌋ and ⌊u⌋ + 1, s the smooth
    step from 0 to ½π; the mean over u of what two places share is the law, to the 2e-4 of its table, and its integral
    lasts."""

    def weights(place: np.ndarray) -> np.ndarray:
        whole = np.floor(place).astype(int)
        part = place - whole
        angle = 0.5 * math.pi * (part * part * (3.0 - 2.0 * part))
        shares = np.zeros((len(place), 5))
        shares[np.arange(len(place)), whole] = np.cos(angle)
        shares[np.arange(len(place)), whole + 1] = np.sin(angle)
        return shares

    here = (np.arange(1000) + 0.5) / 1000.0
    apart = np.linspace(0.0, 2.5, 41)
    shared = np.array([(weights(here) * weights(here + far)).sum(axis=1).mean() for far in apart])
    np.testing.assert_allclose(wobble_correlation(apart), shared, atol=5e-4)
    np.testing.assert_array_equal(wobble_correlation(-apart), wobble_correlation(apart))
    assert np.trapezoid(shared, apart) == pytest.approx(WOBBLE_LASTS, rel=1e-3)


def test_a_laser_between_the_skirts_of_a_filter_is_weak_and_not_gone() -> None:
    """Claim: how weak it is is said of normal incidence, where a tenth passes, not of the edge, where nothing does."""
    chosen = BandpassFilter(shape="cavities", centre=1.513e-6, bandwidth=15e-9, cavities=2)
    laser = Laser(wavelength=1.5e-6)
    (said,) = filter_warnings(chosen, laser, (0.9e-6, 1.7e-6), 0.0)
    assert "most of the light is lost" in said
    away = BandpassFilter(shape="cavities", centre=1.5095e-6, bandwidth=15e-9, cavities=2, blocking=1e-9)
    away = away.model_copy(update={"centre": 1.487e-6})
    (said,) = filter_warnings(away, laser, (0.9e-6, 1.7e-6), 0.6)
    assert "most of the light is lost" in said


@pytest.mark.parametrize(("aside", "words"), [(0.99, "where near ranges image"), (1.01, "most of the light")])
def test_a_laser_is_missed_where_less_than_half_of_it_passes(aside: float, words: str) -> None:
    """Claim: half of the light passes at half of the width; within it only the array's end, where the band is bluer,
    misses a line on the red side."""
    chosen = BandpassFilter(shape="cavities", centre=1.5e-6 - aside * 7.5e-9, bandwidth=15e-9, cavities=2)
    (said,) = filter_warnings(chosen, Laser(wavelength=1.5e-6), (0.9e-6, 1.7e-6), 0.1)
    assert words in said


def test_a_lens_of_the_seventh_power_folds_where_its_image_turns_back() -> None:
    """Claim: the fold is where ρ (1 + k₁ρ² + k₂ρ⁴ + k₃ρ⁶) is largest, sought on a grid of 1e-5."""
    camera = InteriorOrientation(
        focal_length=0.02, pixel_pitch=1e-5, columns=640, rows=480, k1=0.1, k2=-0.05, k3=-0.3
    )
    rho = np.arange(1e-5, 2.0, 1e-5)
    image = rho * (1.0 + 0.1 * rho**2 - 0.05 * rho**4 - 0.3 * rho**6)
    assert math.sqrt(camera.fold) == pytest.approx(rho[np.argmax(image)], abs=2e-5)


def test_a_lens_images_a_point_as_opencv_does() -> None:
    """Claim: (p', q') = f (x', y') of ``cv2.projectPoints`` with k₁, k₂, p₁, p₂, an implementation apart."""
    lens = LensErrors(radial_1=-0.4, radial_2=1.7, across=0.03, along=-0.05, blur=0.0, end=12e-3)
    points = np.array([[0.11, 0.04, 1.0], [-0.06, 0.02, 1.0], [0.3, -0.2, 1.0]])
    wanted, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), np.eye(3), np.array([-0.4, 1.7, 0.03, -0.05])
    )
    for point, pixel in zip(points, wanted[:, 0], strict=True):
        p, q, _ = lens.image(0.1 * point[0], 0.1 * point[1], 0.1)
        assert (p, q) == pytest.approx(tuple(0.1 * pixel), rel=1e-12)


def test_a_warmer_instrument_has_a_longer_base_and_focus() -> None:
    """Claim: at 150 s the course is 5.5 K warmer: base · expansion · ΔT, and the focus relative to itself."""
    course = TemperatureCourse(amplitude=4.0, period=600.0, rate=0.01)
    own = AsBuilt(base_expansion=2e-5, focal_expansion=-3e-5)
    built = BuiltInstrument(own, np.zeros(len(PARAMETERS)), Mirrors(temperature=course), 0.8, 1)
    found = built.unsteadiness(np.array([0.0, 150.0]))
    np.testing.assert_allclose(found.base, [0.0, 0.8 * 2e-5 * 5.5], rtol=1e-12)
    np.testing.assert_allclose(found.focus, [0.0, -3e-5 * 5.5], rtol=1e-12)
    assert not found.turn.any()
    assert not found.shift.any()
    assert not built.is_steady


def test_a_pulse_lasts_from_its_first_sample_to_its_last(tmp_path: Path) -> None:
    """Claim: a bell of FWHM w is followed over 14 σ; a measured one over its own times, which ascend."""
    width = 4e-9
    assert Pulse(shape="gaussian", width=width).length == pytest.approx(14.0 * width / 2.354820045, rel=1e-9)
    table = tmp_path / "pulse.csv"
    table.write_text("1e-9,0\n2e-9,3\n4e-9,0\n")
    time, power = read_pulse(table)
    assert time.tolist() == [1e-9, 2e-9, 4e-9]
    pulse = Pulse(shape=table)
    assert pulse.length == pytest.approx(3e-9, rel=1e-6, abs=0.0)
    time, power = pulse.samples()
    # A triangle's area is half its base times its height, its centroid the mean of its corners.
    assert power.max() == pytest.approx(2.0 / 3e-9)
    assert time[1] == pytest.approx(2e-9 - 7e-9 / 3.0, rel=1e-6, abs=0.0)
    table.write_text("1e-9,0\n1e-9,3\n4e-9,0\n")
    with pytest.raises(InputError):
        read_pulse(table)
