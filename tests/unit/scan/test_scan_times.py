"""Times of a scan by hand: rows, updates of the drive, visits, and the mirrors' temperature."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from prototype import Galvanometers, Mirrors, TemperatureCourse
from pydantic import ValidationError

from scanner_sim.foundation.channels import layer_bytes
from scanner_sim.scan.lissajous import LissajousPattern, frequencies, sample_shares
from scanner_sim.scan.listed import ListedScan
from scanner_sim.scan.protocol import ScanSetup
from scanner_sim.scan.raster import RasterScan, raster_aim
from scanner_sim.scan.schedule import raster_time, visits
from scanner_sim.scan.ways import _falls_behind
from scanner_sim.scene.objects import Scene


def test_a_row_is_measured_about_its_middle() -> None:
    scan = RasterScan(rows=3, columns=5, horizontal=(-0.1, 0.3), vertical=(-0.2, 0.2))
    np.testing.assert_allclose(scan.row_times(2.0), [5.0, 15.0, 25.0])
    aim = raster_aim(scan, np.arange(15, dtype=np.uint32), 2.0)
    np.testing.assert_allclose(aim.time, 2.0 * (np.arange(15) + 0.5))
    np.testing.assert_allclose(aim.time.reshape(3, 5).mean(axis=1), scan.row_times(2.0))
    assert scan.travel == pytest.approx(0.1)
    np.testing.assert_allclose(aim.travel_theta, 0.1)
    np.testing.assert_array_equal(aim.travel_phi, 0.0)
    assert scan.model_copy(update={"motion": "stepped"}).travel == 0.0


def test_the_drive_is_told_at_the_ends_of_its_updates() -> None:
    """Claim: the first share is one update after the start, the last the end; the middle of a dwell is one of them."""
    np.testing.assert_allclose(sample_shares(4), [0.25, 0.5, 0.75, 1.0])
    shares = sample_shares(4, 2)
    np.testing.assert_allclose(shares, np.arange(1, 9) / 8.0)
    np.testing.assert_allclose(shares[0::2], (np.arange(4) + 0.5) / 4.0)
    assert frequencies(LissajousPattern(ratio="3:2", points=100), 1e-3) == pytest.approx((30.0, 20.0))


def test_a_raster_takes_a_dwell_for_each_voxel() -> None:
    assert raster_time(128 * 128, 50e-6) == pytest.approx(0.8192)


def test_visits_end_with_their_patterns() -> None:
    """Claim: of three targets in turn each visit takes a period, and the pattern is its last part."""
    found = visits(3, 7, 0.04, 0.0066)
    np.testing.assert_array_equal(found.target, [0, 1, 2, 0, 1, 2, 0])
    np.testing.assert_array_equal(found.number, [0, 0, 0, 1, 1, 1, 2])
    np.testing.assert_allclose(found.start + 0.0066, 0.04 * np.arange(1, 8))


def test_the_temperature_rises_and_swings() -> None:
    """Claim: rate · t + amplitude · sin(2π t/period); the instrument expects hypot(rate · t, amplitude/√2)."""
    course = TemperatureCourse(rate=0.5, amplitude=3.0, period=8.0)
    time = np.array([0.0, 2.0, 4.0, 6.0])
    np.testing.assert_allclose(course.difference(time), [0.0, 4.0, 2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(course.spread(time), np.hypot(0.5 * time, 3.0 / np.sqrt(2.0)))


def test_a_reading_errs_by_all_that_it_does_not_see() -> None:
    """Claim: √((1 − seen) jitter² + wobble² + noise² + step²/12 + drift²) of the mirror's own angle and time."""
    course = TemperatureCourse(rate=0.5)
    known = Mirrors(
        jitter=10e-6, jitter_seen=0.36, wobble=7e-6, readout_noise=5e-6, readout_step=20e-6, temperature=course,
        drift_zero=3e-6, drift_scale=40e-6,
    )  # fmt: skip
    angle, time = np.array([0.1, -0.2]), np.array([4.0, 10.0])
    drift = 0.5 * time * (3e-6 + 40e-6 * angle)
    np.testing.assert_allclose(known.drift(angle, time), drift)
    random = 0.64 * 10e-6**2 + 7e-6**2 + 5e-6**2 + 20e-6**2 / 12.0
    np.testing.assert_allclose(known.reading_sigma(angle, time), np.sqrt(random + drift**2))


@pytest.mark.parametrize("duration", [0.2e-3, 1e-3, 5e-3])
def test_mirrors_fall_behind_what_their_torque_lacks(duration: float) -> None:
    """Claim: from rest to rest the limit of the distance D is where (m − aT)²/4m = 2 · lag · a, m = 6D/T.

    The acceleration of the cubic runs straight from m/T to −m/T; what of it lies beyond a, over each half of the time,
    is the speed that the mirrors lack. Tolerance: 5 %, as the integral is a sum of 16.
    """
    servo = Galvanometers()
    limit, enough = servo.acceleration * duration, 2.0 * servo.lag * servo.acceleration
    peak = limit + 2.0 * enough + 2.0 * np.sqrt(enough * (limit + enough))
    distance, rest = np.array([peak * duration / 6.0, 0.0]), np.zeros(2)
    found = [
        _falls_behind(servo, share * distance, rest, rest, duration) for share in (-1.05, -0.95, 0.95, 1.05)
    ]
    assert found == [True, False, False, True]


def test_the_memory_of_a_raster_that_none_holds_is_told() -> None:
    """Claim: beyond 2²⁶ voxels a raster is refused, with how many they are and what their layers take together."""
    edge = {"horizontal": (-0.1, 0.3), "vertical": (-0.2, 0.2)}
    assert not list(RasterScan(rows=8192, columns=8192, **edge).cross_checks())
    with pytest.raises(ValidationError, match=r"16384 × 8000 are 131 million voxels") as told:
        RasterScan(rows=16384, columns=8000, **edge)
    size = 16384 * 8000 * layer_bytes(["triangulation"]) / 1e9
    assert f"take {size:.0f} GB; at most 67 million are possible" in str(told.value)


@pytest.mark.parametrize(("faster", "told"), [(0.98, False), (1.02, True)])
@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, -1.0)])
def test_angles_that_servos_cannot_follow_are_told(
    tmp_path: Path, way: tuple[float, float], faster: float, told: bool
) -> None:
    """Claim: a list is warned of where either mirror would turn faster than its servo can; not where they rest."""
    servos = Galvanometers(slew=3.0)
    rate = 3.0 * faster * np.array(way)
    time = 50e-6 * (np.arange(5) + 0.5)
    lines = [f"{theta},{phi}" for theta, phi in (rate * time[:, None]).tolist()]
    (tmp_path / "angles.csv").write_text("\n".join(["theta_rad,phi_rad", *lines]))
    scan = ListedScan(type="listed", file=tmp_path / "angles.csv", motion="continuous")
    setup = ScanSetup(Scene(), Mirrors(), servos, 50e-6)
    sentences = list(scan.warnings(setup))
    assert bool(sentences) is told
    assert all(
        f"by up to {3.0 * faster:.3g} rad/s, more than the mirrors' 3 rad/s" in one for one in sentences
    )
    assert not list(scan.model_copy(update={"motion": "stepped"}).warnings(setup))
