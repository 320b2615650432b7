"""Orbits: local axes, attitudes, real orbits and what is refused."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta

import erfa
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from scanner_sim.analytic import orbit as judge
from scanner_sim.scene.light.elements import _sun_in_teme, elements_age, elements_period, sun_from_elements
from scanner_sim.scene.light.lighting import Lighting, orbit_times, skies
from scanner_sim.scene.light.orbit import AXES, Attitude, Orbit, TwoLineElements, period, sun_from_anomaly

LINE1 = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927"
LINE2 = "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537"
EPOCH = datetime(2008, 9, 20, 12, 25, 40, tzinfo=UTC)

DIRECTIONS = st.sampled_from(sorted(AXES))


@pytest.mark.parametrize(
    ("beta", "anomaly", "where"),
    [(0.0, 0.0, "zenith"), (0.0, 90.0, "wake"), (0.0, 180.0, "nadir"), (0.0, 270.0, "ram"), (90.0, 0.0, "port"),
     (-90.0, 0.0, "starboard")],
)  # fmt: skip
def test_where_the_sun_stands(beta: float, anomaly: float, where: str) -> None:
    """Highest at noon; behind at the evening terminator, as one flies away from it; positive β to port."""
    got = sun_from_anomaly(math.radians(beta), math.radians(anomaly))
    np.testing.assert_allclose(got, AXES[where], atol=1e-12)


def test_local_axes_are_right_handed() -> None:
    np.testing.assert_array_equal(np.cross(AXES["ram"], AXES["starboard"]), AXES["nadir"])
    for one, other in (("ram", "wake"), ("port", "starboard"), ("zenith", "nadir")):
        np.testing.assert_array_equal(AXES[one], -np.array(AXES[other]))


@given(forward=DIRECTIONS, down=DIRECTIONS)
def test_attitudes_are_rotations_that_do_what_they_say(forward: str, down: str) -> None:
    """z looks forward, y points down, x is right of both; along one line is refused."""
    if abs(np.dot(AXES[forward], AXES[down])) > 0.5:
        with pytest.raises(ValidationError, match="line of sight"):
            Attitude.model_validate({"forward": forward, "down": down})
        return
    turn = Attitude.model_validate({"forward": forward, "down": down}).scanner_from_lvlh()
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(turn @ AXES[forward], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(turn @ AXES[down], [0.0, 1.0, 0.0], atol=1e-12)


def test_flying_upright_starboard_is_to_the_right() -> None:
    np.testing.assert_allclose(
        Attitude().scanner_from_lvlh() @ AXES["starboard"], [1.0, 0.0, 0.0], atol=1e-12
    )


def test_turns_move_the_scanner_and_not_the_world() -> None:
    """Turned by +90° about y (down), z goes to x: a scanner that looked to ram now looks to starboard."""
    turned = Attitude.model_validate({"rotation": {"axis": "y", "angle": "90 deg"}}).scanner_from_lvlh()
    np.testing.assert_allclose(turned @ AXES["starboard"], [0.0, 0.0, 1.0], atol=1e-12)
    twice = Attitude.model_validate(
        {"rotation": [{"axis": "y", "angle": "90 deg"}, {"axis": "x", "angle": "90 deg"}]}
    ).scanner_from_lvlh()
    # The second turn is about the first x axis: it leaves the line of sight, which lies along it.
    np.testing.assert_allclose(twice @ AXES["starboard"], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(twice @ AXES["ram"], [0.0, 1.0, 0.0], atol=1e-12)


def test_the_station_goes_round_in_92_minutes() -> None:
    assert period(400e3) / 60.0 == pytest.approx(92.4, abs=0.05)
    assert elements_period(LINE1, LINE2) == pytest.approx(86400.0 / 15.72125391, rel=1e-9)
    orbit = Lighting(orbit=Orbit())
    assert orbit_times(orbit, 4)[-1] == pytest.approx(0.75 * period(400e3))


def test_a_sweep_returns_to_its_start() -> None:
    lighting = Lighting(orbit=Orbit(beta=0.5, anomaly=1.0))
    start = lighting.sky().sun_direction
    (after,) = skies(lighting, np.array([lighting.period]))
    (half,) = skies(lighting, np.array([0.5 * period(400e3)]))
    np.testing.assert_allclose(after.sun_direction, start, atol=1e-12)
    np.testing.assert_allclose(
        half.sun_direction,
        Lighting(orbit=Orbit(beta=0.5, anomaly=1.0 + math.pi)).sky().sun_direction,
        atol=1e-12,
    )


def test_a_lighting_without_an_orbit_has_no_times() -> None:
    with pytest.raises(ValueError, match="no orbit"):
        orbit_times(Lighting(), 3)


@pytest.mark.parametrize(("hours", "days"), [(0.0, 0.0), (7.3, 0.0), (0.0, 90.0)])
def test_the_sun_of_elements_is_the_almanacs(hours: float, days: float) -> None:
    """Claim: the Sun's place above a real orbit is right, through every change of frame.

    Set-up: SGP4's own position and velocity turned into axes by hand, the Almanac's Sun of date; at the epoch, hours
    and months after. Expected: equal directions. Tolerance: 0.02° (Almanac 0.01°, its equinox is the true one less
    1″). Leaving precession out would be 0.12°, a sign far more.
    """
    from sgp4.api import Satrec, jday

    time = EPOCH + timedelta(hours=hours, days=days)
    got, altitude = sun_from_elements(LINE1, LINE2, time)
    error, r, v = Satrec.twoline2rv(LINE1, LINE2).sgp4(*jday(*time.timetuple()[:6]))
    assert error == 0
    up = np.array(r) / np.linalg.norm(r)
    port = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    axes = np.stack([np.cross(port, up), -port, -up])
    since_2000 = (time - datetime(2000, 1, 1, 12, tzinfo=UTC)) / timedelta(days=1)
    expected = axes @ judge.sun_direction(since_2000)
    assert math.degrees(math.acos(min(float(got @ expected), 1.0))) < 0.02
    # Above a sphere of the Earth's mean radius.
    assert altitude == pytest.approx(1e3 * np.linalg.norm(r) - 6_371_008.8, abs=1.0)


def test_age_of_elements() -> None:
    assert elements_age(LINE1, LINE2, EPOCH) == pytest.approx(0.0, abs=1.0)
    assert elements_age(LINE1, LINE2, EPOCH + timedelta(days=3)) == pytest.approx(3 * 86400.0, abs=1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"line1": LINE1[:-5]}, "64 characters"),
        ({"line1": LINE2}, "begins with '2'"),
        ({"line1": LINE1[:-1] + "3"}, "checksum is 7, but it ends in 3"),
        ({"line2": LINE2.replace("51.6416", "51.6417")}, "checksum"),
        ({"line1": LINE1.replace("-11606-4", "-1160²-4")}, "line1: its checksum"),
        ({"line2": LINE2.replace("25544", "25543")[:-1] + "6"}, "satellite 25543"),
        ({"time": "yesterday"}, "no time in UTC"),
        ({"time": "1900-01-01"}, "no time in UTC"),
        ({"time": 5}, "no time in UTC"),
    ],
)
def test_damaged_elements(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        TwoLineElements.model_validate({"line1": LINE1, "line2": LINE2, "time": EPOCH, **change})
    assert words in str(caught.value)


def test_an_orbit_that_came_down() -> None:
    """The Station's orbit lowered to 170 km with ten times its drag: a month later there is none, and it is said."""
    low1, low2 = LINE1.replace("-11606-4", " 11606-2"), LINE2.replace("15.72125391", "16.40125391")
    lines = [line[:68] + str(checksum(line)) for line in (low1, low2)]
    TwoLineElements(line1=lines[0], line2=lines[1], time=EPOCH)
    with pytest.raises(ValidationError, match=r"time: the orbit"):
        TwoLineElements(line1=lines[0], line2=lines[1], time=EPOCH + timedelta(days=30))


def checksum(line: str) -> int:
    return sum(int(sign) if sign.isdigit() else sign == "-" for sign in line[:68]) % 10


def test_times_are_utc() -> None:
    texts = ("2008-09-20T12:25:40Z", "2008-09-20T12:25:40", "2008-09-20T14:25:40+02:00")
    times = {TwoLineElements(line1=LINE1, line2=LINE2, time=text).time for text in texts}
    assert times == {EPOCH}


def test_a_time_beyond_the_leap_seconds_is_no_warning() -> None:
    sun_from_elements(LINE1, LINE2, datetime(2008, 9, 20, tzinfo=UTC), after=86400.0)
    from scanner_sim.scene.light.elements import _sun_in_teme

    assert np.linalg.norm(_sun_in_teme(2472000.5, 0.0)) == pytest.approx(1.0)  # in 2055


@pytest.mark.parametrize(
    ("orbit", "words"),
    [
        ({"beta": "80 deg"}, "at most 75.04 deg"),
        ({"beta": "-80 deg"}, "at most 75.04 deg"),
        ({"inclination": "0 deg", "beta": "24 deg"}, "at most 23.44 deg"),
        ({"inclination": "170 deg", "beta": "34 deg"}, "at most 33.44 deg"),
        ({"altitude": "100 km"}, "greater than 100000"),
        ({"altitude": "-400 km"}, "greater than"),
        ({"beta": "91 deg", "inclination": "98 deg"}, "less than or equal"),
        ({"attitude": {"forward": "nadir"}}, "square to forward"),
        ({"attitude": {"forward": "up"}}, "ram"),
    ],
)
def test_impossible_orbits(orbit: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Orbit.model_validate(orbit)


def test_polar_and_retrograde_orbits_are_possible() -> None:
    Orbit(inclination=math.radians(98.0), beta=math.radians(90.0))
    Orbit(inclination=math.radians(170.0), beta=math.radians(-33.0))


@pytest.mark.parametrize("year", [1996, 2001, 2006, 2011, 2015, 2020])
def test_the_sun_of_elements_counts_from_the_mean_equinox(year: int) -> None:
    """Claim: SGP4's frame has the true equator and the mean equinox: the Sun's right ascension there is that of date
    less the equation of the equinoxes, Δψ cos ε, of up to 16″; its declination is the same.

    Expected: Δψ by its four leading terms (Meeus, *Astronomical algorithms*, 1998, ch. 22), good to 0.5″; the place of
    date by ERFA's matrix of precession and nutation. Tolerance: 0.5″ and a fifth.
    """
    whole, part = erfa.dtf2d("UTC", year, 3, 21, 0, 0, 0.0)
    tt = erfa.taitt(*erfa.utctai(whole, part))
    sun = erfa.pnm06a(*tt) @ -erfa.epv00(*tt)[0]["p"]
    found = _sun_in_teme(whole, part)
    century = (whole - 2451545.0 + part) / 36525.0
    node, mean_sun, moon = np.radians(
        [125.04452 - 1934.136261 * century, 280.4665 + 36000.7698 * century, 218.3165 + 481267.8813 * century]
    )
    shift = -17.20 * np.sin(node) - 1.32 * np.sin(2 * mean_sun)
    shift += -0.23 * np.sin(2 * moon) + 0.21 * np.sin(2 * node)
    wanted = shift * np.cos(np.radians(23.44))
    apart = np.arctan2(sun[1], sun[0]) - np.arctan2(found[1], found[0])
    assert 3600.0 * np.degrees(apart) == pytest.approx(wanted, abs=0.6)
    assert found[2] == pytest.approx(sun[2] / np.linalg.norm(sun), abs=1e-12)


def test_lighting_by_an_orbit_or_elements_goes_on_and_has_a_period() -> None:
    """Claim: Sun and Earth move by an orbit's clock or by that of elements, and not where there is no Sun or where they
    were written down; the period is 2π√(a³/GM), or a day over the revolutions that elements tell."""
    orbit = Lighting.model_validate({"orbit": {"altitude": "500 km"}})
    elements = Lighting.model_validate({"tle": {"line1": LINE1, "line2": LINE2, "time": EPOCH}})
    written = Lighting.model_validate({"sun": {"direction": [0, -1, 0]}})
    assert [one.runs for one in (orbit, elements, written, Lighting())] == [True, True, False, False]
    assert not elements.changed(sun="none").runs
    assert orbit.period == pytest.approx(2.0 * math.pi * math.sqrt(6_871_008.8**3 / 3.986004418e14))
    assert elements.period == pytest.approx(86400.0 / 15.72125391, rel=1e-6)
    assert written.period is None
