"""Orbits in time and the Earth's disc by hand."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from scanner_sim.scene.light.earth import EARTH_RADIUS, angle_between, earth_angular_radius, visible_share
from scanner_sim.scene.light.elements import elements_age, elements_period, sun_from_elements
from scanner_sim.scene.light.lighting import Lighting, orbit_times
from scanner_sim.scene.light.orbit import Orbit, largest_beta, period, sun_from_anomaly

LINES = (
    "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
    "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
)
MOMENT = datetime(2008, 9, 20, 12, 25, 40, tzinfo=UTC)


@pytest.mark.parametrize("after", [90.0, 5000.0, 80_000.0])
def test_seconds_after_a_moment_are_seconds(after: float) -> None:
    """Claim: so many seconds after a time is the later time: the satellite turns by 0.2° in each three seconds."""
    sun, altitude = sun_from_elements(*LINES, MOMENT, after)
    later, its = sun_from_elements(*LINES, MOMENT + timedelta(seconds=after))
    np.testing.assert_allclose(sun, later, atol=1e-7)
    assert altitude == pytest.approx(its, abs=0.01)
    with_parts, _ = sun_from_elements(*LINES, MOMENT + timedelta(microseconds=250_000), after)
    further, _ = sun_from_elements(*LINES, MOMENT, after + 0.25)
    np.testing.assert_allclose(with_parts, further, atol=1e-7)


def test_elements_have_an_age_and_a_period() -> None:
    """Claim: day 264.51782528 of 2008 is the 20th of September, 12:25:40.1; 15.72125391 turns a day."""
    for days in (0.0, 2.5):
        age = elements_age(*LINES, MOMENT + timedelta(days=days))
        assert age == pytest.approx(86400.0 * days - 0.104, abs=0.01)
    assert elements_period(*LINES) == pytest.approx(86400.0 / 15.72125391, rel=1e-6)


def test_a_circular_orbit_keeps_keplers_third_law() -> None:
    """Claim: 2π √(a³/µ) with µ = 3.986004418e14 m³/s²: 92.4 min at 400 km, and a day at 35 786 km above the equator."""
    for altitude in (400e3, 35.793e6):
        wanted = 2.0 * math.pi * math.sqrt((6_371_008.8 + altitude) ** 3 / 3.986004418e14)
        assert period(altitude) == pytest.approx(wanted, rel=1e-12)
    assert period(35.793e6) == pytest.approx(86164.0, rel=1e-3)
    lighting = Lighting(orbit=Orbit(altitude=400e3, beta=0.3, anomaly=0.7))
    times = orbit_times(lighting, 4)
    np.testing.assert_allclose(times, np.arange(4) * period(400e3) / 4.0)
    ahead = lighting.sky(float(times[1])).sun_direction
    turned = Lighting(orbit=Orbit(altitude=400e3, beta=0.3, anomaly=0.7 + 0.5 * math.pi)).sky().sun_direction
    assert ahead is not None
    assert turned is not None
    np.testing.assert_allclose(ahead, turned, atol=1e-12)


def test_the_sun_stands_where_beta_and_anomaly_say() -> None:
    np.testing.assert_allclose(
        sun_from_anomaly(0.3, 0.8),
        [-math.cos(0.3) * math.sin(0.8), -math.sin(0.3), -math.cos(0.3) * math.cos(0.8)],
    )
    assert largest_beta(0.9) == pytest.approx(0.9 + math.radians(23.44))
    assert largest_beta(2.5) == pytest.approx(math.pi - 2.5 + math.radians(23.44))
    assert largest_beta(1.5) == pytest.approx(0.5 * math.pi)


def test_the_earth_covers_the_sun_by_the_area_of_two_circles() -> None:
    """Claim: the visible share is that of points spread over the Sun's disc, for a small Earth drawn on the sphere."""
    assert pytest.approx(6_371_008.8) == EARTH_RADIUS
    assert earth_angular_radius(400e3) == pytest.approx(math.asin(6371008.8 / 6771008.8))
    assert angle_between(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])) == pytest.approx(0.5 * math.pi)
    sun = 0.00465
    turn = np.pi * (1.0 + math.sqrt(5.0)) * np.arange(200_000)
    away = sun * np.sqrt((np.arange(200_000) + 0.5) / 200_000)
    x, y = away * np.cos(turn), away * np.sin(turn)
    for earth in (0.003, 0.02, 1.2):
        for share in (-0.9, -0.3, 0.0, 0.4, 0.95):
            separation = earth + share * sun
            if separation <= 0.0:
                continue
            # The centre of the Earth lies at −separation along x; the limb is a circle on the sphere.
            distance = np.arccos(np.clip(np.cos(separation + x) * np.cos(y), -1.0, 1.0))
            seen = np.mean(distance > earth)
            assert visible_share(separation, sun, earth) == pytest.approx(seen, abs=2e-3)
        assert visible_share(earth + 1.001 * sun, sun, earth) == 1.0
        if earth > sun:
            assert visible_share(earth - 1.001 * sun, sun, earth) == 0.0
    assert visible_share(1e-4, sun, 0.003) == pytest.approx(1.0 - (math.tan(0.003) / sun) ** 2, rel=1e-3)
