"""Drawn Suns and Earths: as an orbit has them, and as often."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from scanner_sim import draw_lightings
from scanner_sim.analytic.orbit import beta_angle, eclipse_fraction, sun_direction
from scanner_sim.scene.light.draw import beta_angles
from scanner_sim.scene.light.earth import angle_between
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.light.orbit import largest_beta

COUNT = 2000
ISS = math.radians(51.6)
OBLIQUITY = math.radians(23.44)


def drawn(inclination: float = ISS, *, any_attitude: bool = False) -> list[Lighting]:
    lighting = Lighting.model_validate({"orbit": {"inclination": inclination, "altitude": 400e3}})
    return list(draw_lightings(lighting, COUNT, 5, any_attitude=any_attitude))


@pytest.mark.parametrize("inclination", [0.0, ISS, math.radians(98.0)])
def test_the_sun_stands_off_the_plane_as_over_the_years(inclination: float) -> None:
    """Claim: the mean of sin²β is ½ (1 − ½ s) sin²i + ½ s cos²i, s = sin²ε, within five standard errors: 6e-7.

    The Sun's declination δ has the mean square sine s/2; the node is even, so the part in the equator counts half.
    No β is beyond what the inclination allows, and the places on the orbit are even (Kolmogorov and Smirnov, 1e-6).
    """
    orbits = [one.orbit for one in drawn(inclination) if one.orbit is not None]
    square = np.sin([one.beta for one in orbits]) ** 2
    s = 0.5 * math.sin(OBLIQUITY) ** 2
    expected = 0.5 * (1.0 - s) * math.sin(inclination) ** 2 + s * math.cos(inclination) ** 2
    assert square.mean() == pytest.approx(expected, abs=5.0 * square.std() / math.sqrt(COUNT))
    assert max(abs(one.beta) for one in orbits) <= largest_beta(inclination) + 1e-12
    places = [one.anomaly for one in orbits]
    assert stats.kstest(places, stats.uniform(-math.pi, 2.0 * math.pi).cdf).pvalue > 1e-6


def test_beta_is_that_of_the_almanac_s_sun() -> None:
    """Claim: β of a node and the Sun's longitude is that of the judge, whose Sun is the Almanac's, at any time.

    The judge's obliquity changes by 4e-7 degrees a day and is 0.001° less at the start: 0.005° in 25 years.
    """
    rng = np.random.default_rng(2)
    for days, inclination, node in rng.uniform([0.0, 0.0, -3.0], [9000.0, math.pi, 3.0], (20, 3)).tolist():
        sun = sun_direction(days)
        longitude = math.atan2(math.hypot(sun[1], sun[2]) * math.copysign(1.0, sun[1]), sun[0])
        found = beta_angles(inclination, np.array(node), np.array(longitude))
        assert float(found) == pytest.approx(beta_angle(days, inclination, node), abs=math.radians(0.005))


@pytest.mark.parametrize("any_attitude", [False, True])
def test_sun_and_earth_are_possible_together(any_attitude: bool) -> None:
    """Claim: the Sun is hidden where it is behind the Earth's disc, in the share of time that eclipses take.

    The share in closed form is the mean of that of each β; of 2000 draws it scatters by a binomial's standard deviation
    at the most, and five of it are the bound. Turning the scanner moves both directions, and their angle stays.
    """
    lightings = drawn(any_attitude=any_attitude)
    skies = [one.sky() for one in lightings]
    for one, sky in zip(lightings, skies, strict=True):
        assert sky.sun_direction is not None
        assert sky.earth_direction is not None
        apart = angle_between(sky.sun_direction, sky.earth_direction)
        assert one.orbit is not None
        assert math.cos(apart) == pytest.approx(
            -math.cos(one.orbit.beta) * math.cos(one.orbit.anomaly), abs=1e-12
        )
        above = apart - sky.earth_angular_radius
        assert abs(above) < sky.sun_angular_radius or sky.sun_visible == float(above > 0.0)
    expected = eclipse_fraction(400e3, [one.orbit.beta for one in lightings if one.orbit is not None]).mean()
    hidden = np.mean([1.0 - sky.sun_visible for sky in skies])
    assert hidden == pytest.approx(expected, abs=5.0 * math.sqrt(expected * (1.0 - expected) / COUNT))


def test_all_attitudes_are_alike() -> None:
    """Claim: each coordinate of each direction is even from −1 to 1, as on a sphere (Archimedes); 1e-6 for each."""
    skies = [one.sky() for one in drawn(any_attitude=True)]
    for directions in ([sky.sun_direction for sky in skies], [sky.earth_direction for sky in skies]):
        for coordinate in np.array(directions).T:
            assert stats.kstest(coordinate, stats.uniform(-1.0, 2.0).cdf).pvalue > 1e-6


def test_draws_are_those_of_their_seed_and_need_an_orbit() -> None:
    assert drawn() == drawn()
    with pytest.raises(ValueError, match="no orbit"):
        next(draw_lightings(Lighting(), 1, 1))
