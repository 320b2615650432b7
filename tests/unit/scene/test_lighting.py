"""Sun and Earth as parts of a scenario: what they mean, how they are written, and what is refused."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from scanner_sim.config.load import scenario_from_text
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.scene.light.clock import SkyClock, differ
from scanner_sim.scene.light.earth import EARTH_RADIUS, earth_angular_radius, visible_share
from scanner_sim.scene.light.lighting import Earth, LightChange, Lighting, Sky, Sun, lighting_warnings
from scanner_sim.scene.light.orbit import Orbit

TLE = {
    "line1": "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
    "line2": "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
    "time": "2008-09-20T12:25:40Z",
}
COMPONENT = st.floats(-1e6, 1e6)


def test_it_is_dark_by_default() -> None:
    sky = Lighting().sky()
    assert sky.dark
    assert sky.sun_direction is None
    assert sky.earth_direction is None
    assert sky.sun_visible == sky.albedo == 0.0
    assert Sky().dark


def test_a_lit_scene() -> None:
    sky = Lighting.model_validate(
        {
            "sun": {"direction": [0, -3, 0]},
            "earth": {"direction": [0, 0, 5], "altitude": "500 km", "albedo": 0.4},
        }
    ).sky()
    assert not sky.dark
    np.testing.assert_array_equal(sky.sun_direction, [0.0, -1.0, 0.0])
    np.testing.assert_array_equal(sky.earth_direction, [0.0, 0.0, 1.0])
    assert sky.sun_visible == 1.0
    assert sky.sun_angular_radius == pytest.approx(math.asin(695e3 / 149.68e6))
    assert math.sin(sky.earth_angular_radius) == pytest.approx(EARTH_RADIUS / (EARTH_RADIUS + 500e3))
    assert (sky.earth_altitude, sky.earth_radius, sky.albedo) == (500e3, EARTH_RADIUS, 0.4)
    assert sky.phase == pytest.approx(math.pi / 2.0)


@given(x=COMPONENT, y=COMPONENT, z=COMPONENT)
def test_directions_are_made_unit_vectors(x: float, y: float, z: float) -> None:
    if math.hypot(x, y, z) < 1e-90:
        return
    direction = Lighting(sun=Sun(direction=(x, y, z))).sky().sun_direction
    assert direction is not None
    assert np.linalg.norm(direction) == pytest.approx(1.0, abs=1e-12)
    assert direction @ np.array([x, y, z]) == pytest.approx(math.hypot(x, y, z), rel=1e-9, abs=0.0)


@pytest.mark.parametrize(
    "data",
    [
        {},
        {"sun": {"direction": [0.1, -0.7, 0.3], "spectrum": "astm_g173", "temperature": "5800 K"}},
        {"sun": "none", "earth": {"direction": [0, 1, 0], "altitude": "412.3 km"}},
        {"orbit": {"beta": "30 deg", "anomaly": "90 deg", "attitude": {"forward": "wake", "down": "port"}}},
        {"orbit": {}, "earth": "none", "sun": {"radius": "1 km"}},
        {"tle": TLE},
    ],
)
def test_written_back_it_is_the_same(data: dict[str, Any]) -> None:
    lighting = Lighting.model_validate(data)
    written = lighting.model_dump(mode="json")
    assert Lighting.model_validate(written, context={"units": "required"}) == lighting


def test_an_orbit_brings_sun_and_earth() -> None:
    """Without a word about them both are there; each can be changed or left out, but not placed."""
    both = Lighting.model_validate({"orbit": {"anomaly": "20 deg"}}).sky()
    assert both.sun_direction is not None
    np.testing.assert_allclose(both.earth_direction, [0.0, 1.0, 0.0], atol=1e-12)
    assert both.phase == pytest.approx(math.radians(20.0))
    assert Lighting.model_validate({"orbit": {}, "sun": "none"}).sky().dark
    assert Lighting.model_validate({"orbit": {}, "earth": "none"}).sky().earth_direction is None
    changed = Lighting.model_validate({"tle": TLE, "earth": {"albedo": 0.5}})
    assert changed.sky().albedo == 0.5
    assert Lighting(orbit=Orbit()) == Lighting.model_validate({"orbit": {}})


def test_without_an_earth_no_eclipse() -> None:
    night = {"orbit": {"anomaly": "180 deg"}}
    assert Lighting.model_validate(night).sky().sun_visible == 0.0
    assert Lighting.model_validate({**night, "earth": "none"}).sky().sun_visible == 1.0


def test_in_an_eclipse_the_sun_keeps_its_place() -> None:
    sky = Lighting(orbit=Orbit(anomaly=math.pi)).sky()
    assert not sky.dark
    np.testing.assert_allclose(sky.sun_direction, [0.0, 1.0, 0.0], atol=1e-12)
    assert sky.phase == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"sun": {}}, "sun: it has no direction"),
        ({"sun": {"direction": [0, 0, 0]}}, "has no direction"),
        ({"sun": {"direction": [0, 1]}}, "direction"),
        ({"earth": {"direction": [0, 0, 0]}}, "has no direction"),
        ({"earth": {}}, "earth: it has no direction"),
        ({"sun": "bright"}, "none"),
        ({"sun": {"direction": [0, 0, 1], "spectrum": "plank"}}, "planck"),
        ({"sun": {"direction": [0, 0, 1], "temperature": "5500 degC"}}, "kelvins"),
        ({"sun": {"direction": [0, 0, 1], "temperature": "10 K"}}, "greater than or equal to 1000"),
        ({"sun": {"direction": [0, 0, 1], "distance": "1e6 km"}}, "no small disc"),
        ({"earth": {"direction": [0, 1, 0], "albedo": 1.2}}, "less than or equal to 1"),
        ({"earth": {"direction": [0, 1, 0], "altitude": "50 km"}}, "greater than 100000"),
        ({"orbit": {}, "sun": {"direction": [0, 0, 1]}}, "sun.direction: it follows from the orbit"),
        ({"orbit": {}, "earth": {"direction": [0, 0, 1]}}, "earth.direction: it follows from the orbit"),
        ({"orbit": {}, "earth": {"altitude": "500 km"}}, "earth.altitude: it follows from the orbit"),
        ({"orbit": {}, "tle": TLE}, "tle: there is an orbit already"),
        ({"moon": {}}, "Extra inputs"),
    ],
)
def test_impossible_lighting(data: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Lighting.model_validate(data)
    assert words in str(caught.value)


@pytest.mark.parametrize(("degrees", "possible"), [(0.0, False), (69.9, False), (70.3, True), (71.0, True)])
def test_a_sun_behind_the_earth(degrees: float, possible: bool) -> None:
    """The Earth's radius is 70.2° at 400 km, the Sun's 0.27°: fully hidden is an error, half hidden is a sunset."""
    sun = Sun(direction=(math.sin(math.radians(degrees)), math.cos(math.radians(degrees)), 0.0))
    earth = Earth(direction=(0.0, 2.0, 0.0))
    if not possible:
        with pytest.raises(ValidationError, match=r"behind the Earth.*an orbit"):
            Lighting(sun=sun, earth=earth)
        return
    share = Lighting(sun=sun, earth=earth).sky().sun_visible
    assert (share == 1.0) if degrees == 71.0 else (0.5 < share < 0.9)


@pytest.mark.parametrize("earth", [math.radians(70.2), 0.3, 0.02, 5e-3])
@pytest.mark.parametrize("at", [-0.9, -0.5, 0.0, 0.3, 0.8])
def test_visible_share_against_the_sphere(earth: float, at: float) -> None:
    """Claim: the hidden share of the Sun's disc is right on the sphere, for near and far Earths.

    Set-up: the limb ``at`` Sun's radii from the Sun's centre; on each of 20 000 rings of the disc (even in area) the
    arc outside of the Earth's cap, by the law of cosines on the sphere. Tolerance: 3e-6, the rings and the second order
    of the Sun's radius; a plane Earth of the radius β would be 2e-4 off at 70°.
    """
    sun = 4.65e-3
    separation = earth + at * sun
    r = sun * np.sqrt((np.arange(20_000) + 0.5) / 20_000.0)
    cosine = (np.cos(separation) * np.cos(r) - np.cos(earth)) / (np.sin(separation) * np.sin(r))
    expected = float(np.mean(np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi))
    assert visible_share(separation, sun, earth) == pytest.approx(expected, abs=3e-6)


@given(first=st.floats(-1.5, 1.5), second=st.floats(-1.5, 1.5), altitude=st.floats(101e3, 1e9))
def test_the_sun_only_grows_as_it_rises(first: float, second: float, altitude: float) -> None:
    sun, earth = 4.65e-3, earth_angular_radius(altitude)
    low, high = sorted((first, second))
    shares = [visible_share(max(earth + at * sun, 0.0), sun, earth) for at in (low, high)]
    assert 0.0 <= shares[0] <= shares[1] + 1e-9 <= 1.0 + 1e-9


def test_an_earth_smaller_than_the_sun_makes_a_ring() -> None:
    assert visible_share(0.0, 4.65e-3, 2e-3) == pytest.approx(1.0 - (2e-3 / 4.65e-3) ** 2, rel=1e-5)
    assert visible_share(7e-3, 4.65e-3, 2e-3) == 1.0


def test_lighting_loads_no_heavy_library() -> None:
    """Colour-science waits until it is needed: the command line answers at once."""
    code = (
        "import sys; from scanner_sim.scene.light.lighting import Lighting; "
        "Lighting.model_validate({'orbit': {}}).sky(); "
        "print(sorted({'colour', 'mitsuba', 'drjit'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({}, ""),
        ({"orbit": {}}, ""),
        ({"tle": TLE}, ""),
        ({"tle": {**TLE, "time": "2008-12-20T12:25:40Z"}}, "91 days"),
        ({"tle": {**TLE, "time": "2008-08-20T12:25:40Z"}}, "31 days"),
        ({"earth": {"direction": [0, 1, 0]}}, "the Earth is dark too"),
    ],
)
def test_doubts(data: dict[str, Any], words: str) -> None:
    found = lighting_warnings(Lighting.model_validate(data))
    assert len(found) == (1 if words else 0)
    assert words in "".join(found)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "{sun: {direction: [0, 1]}}",
            "lighting.sun.direction: this list has 2 entries. Write for example [0.3",
        ),
        ("{sun: nine}", "lighting.sun: 'nine' is not possible here. Did you mean 'none'?"),
        ("{orbit: {beta: 80 deg}}", "line 3, lighting.orbit.beta: 80 deg is impossible"),
        (
            "{sun: {direction: [0, 1, 0], spectrum: plank}}",
            "Did you mean 'planck'? Possible: planck, astm_g173.",
        ),
    ],
)
def test_a_file_is_told_where_it_is_wrong(text: str, words: str) -> None:
    scan = "{type: raster, rows: 4, columns: 4, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}"
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(f"schema: 1\nscan: {scan}\nlighting: {text}\n", name="it")
    assert words in str(caught.value)


def test_a_sky_serves_for_a_second_and_in_the_penumbra_for_a_sixteenth() -> None:
    """Claim: by an orbit's clock the sky is that of the middle of a second; where the Earth's limb passes the Sun, of
    1/16 s, in which the share changes by less than 1 %. Written down, Sun and Earth stay."""
    low = Lighting.model_validate({"orbit": {}})
    clock, period = SkyClock(low), low.period
    assert period is not None
    assert clock.sky(3.2) is clock.sky(3.9)
    np.testing.assert_allclose(clock.sky(3.2).sun_direction, low.sky(3.5).sun_direction)
    shares = [low.sky(time).sun_visible for time in np.arange(0.0, period, 1.0)]
    entry = next(second for second, share in enumerate(shares) if share < 1.0)
    times = np.arange(entry - 2.0, entry + 12.0, 0.02)
    used = np.array([clock.sky(time).sun_visible for time in times])
    assert np.abs(used - [low.sky(time).sun_visible for time in times]).max() < 0.008
    assert len(np.unique(used)) > 60
    written = SkyClock(Lighting.model_validate({"sun": {"direction": [0, -1, 0]}}))
    assert written.sky(0.0) is written.sky(1e4)


def test_a_second_in_which_the_sun_dims_is_looked_at_in_sixteenths(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: whole seconds serve where all or nothing of the Sun is seen at both of their ends, else sixteenths."""
    shares = {3: 1.0, 4: 1.0, 5: 0.7, 6: 0.0, 7: 0.0, 8: 1.0}
    clock = SkyClock(Lighting.model_validate({"orbit": {}}))
    monkeypatch.setattr(clock, "_share", lambda time: shares[round(time)])
    for second, steps in ((3, 1), (4, 16), (5, 16), (6, 1), (7, 16)):
        wanted = second + (math.floor(0.3 * steps) + 0.5) / steps
        assert clock._moment(second + 0.3) == pytest.approx(wanted, rel=1e-12)


def test_told_light_counts_from_half_a_milliradian_and_half_a_per_cent_on() -> None:
    """Claim: small changes leave what is in use, larger ones and full eclipses replace it."""
    lit = Lighting.model_validate({"sun": {"direction": [0, -1, 0]}})
    used = LightChange(time=0.0, sun=(0.0, -1.0, 0.0), visible=0.5)
    for turn, share, other in (
        (4e-4, 0.5, False),
        (6e-4, 0.5, True),
        (0.0, 0.504, False),
        (0.0, 0.506, True),
    ):
        told = LightChange(time=1.0, sun=(turn, -1.0, 0.0), visible=share)
        assert differ(lit, used, told, 1.0) is other
    faint = used.model_copy(update={"visible": 0.003})
    assert differ(lit, faint, faint.model_copy(update={"visible": 0.0}), 1.0)
    assert differ(lit, None, used, 0.0)
    assert not differ(lit, used, used, 0.0)
    assert lit.sky(0.0, used).sun_visible == 0.5


def test_a_later_stated_moment_is_the_same_sky() -> None:
    """Claim: ``at`` moves the stated moment along orbit and elements, and keeps the change that holds then."""
    change = LightChange(time=50.0, visible=0.25)
    for data in ({"orbit": {"anomaly": "170 deg"}}, {"tle": TLE}):
        lighting = Lighting.model_validate(data).model_copy(update={"changes": (change,)})
        for time in (20.0, 700.0):
            one, other = lighting.sky(time), lighting.at(time).sky()
            np.testing.assert_allclose(one.sun_direction, other.sun_direction, atol=1e-9)
            assert one.sun_visible == other.sun_visible


@pytest.mark.parametrize("degrees", [70.25, 71.0, 75.0, 120.0])
def test_a_sky_is_that_of_the_sun_and_the_earth_that_are_stated(degrees: float) -> None:
    """Claim: disc, dusk and phase follow from the lengths that were written, none of which is a default.

    A Sun of 2.3° is half down where the limb crosses its centre; the share is the sum over 20 000 rings of its disc,
    even in area, of their arcs outside of the Earth's cap, by the law of cosines on the sphere. Tolerance: its second
    order, (2.3° in radians)²/8, 2e-4.
    """
    turn = math.radians(degrees)
    told = {
        "sun": {
            "direction": [3.0 * math.sin(turn), 0.0, 3.0 * math.cos(turn)],
            "radius": "6e6 km",
            "distance": "149.5e6 km",
        },
        "earth": {
            "direction": [0.0, 0.0, 0.7],
            "altitude": "385 km",
            "albedo": 0.13,
            "albedo_out_of_band": 0.41,
            "albedo_visible": 0.57,
        },
    }
    sky = Lighting.model_validate(told).sky()
    sun, earth = math.asin(6.0 / 149.5), math.asin(EARTH_RADIUS / (EARTH_RADIUS + 385e3))
    r = sun * np.sqrt((np.arange(20_000) + 0.5) / 20_000.0)
    cosine = (np.cos(turn) * np.cos(r) - np.cos(earth)) / (np.sin(turn) * np.sin(r))
    share = float(np.mean(np.arccos(np.clip(cosine, -1.0, 1.0)) / np.pi))
    assert sky.sun_angular_radius == pytest.approx(sun, rel=1e-12)
    assert sky.earth_angular_radius == pytest.approx(earth, rel=1e-12)
    assert sky.sun_visible == pytest.approx(share, abs=2e-4)
    assert sky.phase == pytest.approx(math.pi - turn, rel=1e-12)
    assert (sky.albedo, sky.albedo_out_of_band, sky.albedo_visible) == (0.13, 0.41, 0.57)
    assert sky.sun_dimming == 1.0
    dark = Lighting.model_validate({**told, "sun": "none"}).sky()
    assert (dark.sun_angular_radius, dark.sun_visible, dark.albedo) == (0.0, 0.0, 0.13)


def test_light_goes_on_by_an_orbit_or_by_elements_of_one() -> None:
    """Claim: with a Sun, by either; a Sun that is stated stands, and where there is none nothing goes on."""
    stated = {"sun": {"direction": [0, -1, 0]}}
    for data, runs in (({"orbit": {}}, True), ({"tle": TLE}, True), (stated, False), ({}, False)):
        assert Lighting.model_validate(data).runs is runs
    assert not Lighting.model_validate({"orbit": {}, "sun": "none"}).runs
