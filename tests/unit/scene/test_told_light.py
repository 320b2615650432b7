"""Light that a controller tells: which change holds, what it replaces, and what the Earth hides all the same."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from scanner_sim.foundation.units import FROM_FILE
from scanner_sim.scene.light.clock import SkyClock, differ
from scanner_sim.scene.light.earth import earth_angular_radius, visible_share
from scanner_sim.scene.light.lighting import LightChange, Lighting, Sun
from scanner_sim.scene.light.orbit import TwoLineElements

LIMB = earth_angular_radius(400e3)
SUN = {"radius": "6e6 km", "distance": "149.5e6 km"}
"""A Sun of 2.3°."""


def lit(degrees: float, *changes: LightChange) -> Lighting:
    """Return a Sun so many degrees above the Earth's limb."""
    turn = LIMB + math.radians(degrees)
    data = {
        "sun": {"direction": [math.sin(turn), 0.0, math.cos(turn)], **SUN},
        "earth": {"direction": [0.0, 0.0, 2.0]},
    }
    return Lighting.model_validate(data).model_copy(update={"changes": changes})


@pytest.mark.parametrize("degrees", [-2.1, -1.2, 0.4, 5.0, -5.0])
@pytest.mark.parametrize("told", [0.0, 0.2, 0.9, 1.0])
def test_the_earth_hides_what_it_hides_whatever_is_told(degrees: float, told: float) -> None:
    """Claim: the smaller of both shares arrives, and the dimming is what is told over what the Earth leaves, 1 at most;
    where nothing is left there is nothing to dim."""
    turn = LIMB + math.radians(degrees)
    left = visible_share(turn, math.asin(6.0 / 149.5), LIMB)
    assert 0.0 < left < 1.0 or abs(degrees) > 3.0
    # Told, for nobody may write down a Sun behind the Earth.
    plain, sun = lit(30.0), (math.sin(turn), 0.0, math.cos(turn))
    sky = plain.sky(0.0, LightChange(time=0.0, sun=sun, visible=told))
    assert sky.sun_visible == pytest.approx(min(left, told), rel=1e-12)
    assert sky.sun_dimming == pytest.approx(min(left, told) / left if left else 1.0, rel=1e-12)
    untold = plain.sky(0.0, LightChange(time=0.0, sun=sun))
    assert (untold.sun_visible, untold.sun_dimming) == (pytest.approx(left, rel=1e-12), 1.0)


def test_each_change_holds_from_its_time_on_and_replaces_what_it_tells() -> None:
    """Claim: before the first change all is as written, from each time on the last one holds, and what it does not tell
    is as written too; the phase and the share are those of what holds."""
    first = LightChange(time=2.0, sun=(0.0, -3.0, 0.0))
    second = LightChange(time=5.0, earth=(0.0, 4.0, 0.0), visible=0.4)
    lighting = lit(30.0, first, second)
    written = lighting.sky(1.99)
    for time, sun, earth, share in (
        (1.99, written.sun_direction, (0.0, 0.0, 1.0), 1.0),
        (2.0, (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), 1.0),
        (4.99, (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), 1.0),
        (5.0, written.sun_direction, (0.0, 1.0, 0.0), 0.4),
        (1e6, written.sun_direction, (0.0, 1.0, 0.0), 0.4),
    ):
        sky = lighting.sky(time)
        np.testing.assert_allclose(sky.sun_direction, sun, atol=1e-12)
        np.testing.assert_allclose(sky.earth_direction, earth, atol=1e-12)
        assert sky.sun_visible == pytest.approx(share)
        separation = math.acos(float(np.dot(sky.sun_direction, sky.earth_direction)))
        assert sky.phase == pytest.approx(math.pi - separation)
    # What holds at a stated moment holds from it on.
    for time in (0.0, 3.0, 5.0):
        later = lighting.at(time)
        assert len(later.changes) == (time >= 2.0)
        for after in (0.0, 100.0):
            assert later.sky(after).sun_visible == lighting.sky(time).sun_visible
            np.testing.assert_allclose(later.sky(after).sun_direction, lighting.sky(time).sun_direction)


def test_told_earths_count_as_suns_do() -> None:
    """Claim: the Earth's light is another from half a milliradian on as well; eclipse and full light are so at once."""
    plain = lit(30.0)
    used = LightChange(time=0.0, earth=(0.0, 0.0, 1.0))
    for turn, other in ((4e-4, False), (6e-4, True)):
        assert differ(plain, used, LightChange(time=1.0, earth=(0.0, turn, 1.0)), 1.0) is other
    part = LightChange(time=0.0, visible=0.997)
    assert differ(plain, part, LightChange(time=1.0, visible=1.0), 1.0)
    assert not differ(plain, LightChange(time=1.0, visible=1.0), part, 1.0)


def test_told_light_hides_no_second_of_the_penumbra() -> None:
    """Claim: whether the Sun's share changes goes by the orbit, not by what is told."""
    change = LightChange(time=0.0, visible=0.0)
    plain = Lighting.model_validate({"orbit": {}})
    period = plain.period
    assert period is not None
    times = np.arange(0.2 * period, 0.4 * period, 1.0)
    entry = next(time for time in times if plain.sky(time).sun_visible < 1.0)
    told = SkyClock(plain.model_copy(update={"changes": (change,)}))
    free = SkyClock(plain)
    for time in (entry + 0.1, entry + 0.9, entry + 2.3):
        assert told._moment(time) == free._moment(time)


def test_a_change_counts_from_its_own_time_on_and_not_from_the_begin_of_its_second() -> None:
    """Claim: the sky of an orbit's second is that of its middle, and before a change in that second it is the one that
    nobody has told anything of: as it was when nobody had."""
    change = LightChange(time=0.4, visible=0.25)
    plain = Lighting.model_validate({"orbit": {}})
    clock = SkyClock(plain.model_copy(update={"changes": (change,)}))
    assert plain.sky(0.5).sun_visible == 1.0
    assert [clock.sky(0.3).sun_visible, clock.sky(0.45, change).sun_visible] == [1.0, 0.25]


@pytest.mark.parametrize(("share", "possible"), [(0.099, True), (0.101, False)])
def test_a_sun_is_a_small_disc(share: float, possible: bool) -> None:
    """Claim: its radius is below a tenth of its distance."""
    given = {"direction": (0.0, -1.0, 0.0), "radius": share * 2e9, "distance": 2e9}
    if possible:
        assert Sun(**given).angular_radius == pytest.approx(math.asin(share))
        return
    with pytest.raises(ValidationError, match="no small disc"):
        Sun(**given)


def test_a_sun_that_grazes_the_limb_is_looked_at_in_sixteenths(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: equal shares at both ends of a second tell that it stays so where they are all or nothing alone."""
    shares = {0: 0.3, 1: 0.3, 2: 1.0, 3: 1.0, 4: 0.0, 5: 0.0}
    clock = SkyClock(Lighting.model_validate({"orbit": {}}))
    monkeypatch.setattr(clock, "_share", lambda time: shares[round(time)])
    assert [clock._moment(time) for time in (0.2, 2.2, 4.2)] == [(3 + 0.5) / 16, 2.5, 4.5]


def test_changes_need_a_sun_and_the_order_of_time() -> None:
    """Claim: each change is told after the one before; without a Sun there is nothing to change."""
    first, second = ({"time": f"{time} s", "visible": 0.5} for time in (3, 2))
    sun = {"sun": {"direction": [0, -1, 0]}}
    assert len(Lighting.model_validate({**sun, "changes": [second, first]}, context=FROM_FILE).changes) == 2
    for changes in ([first, second], [first, first]):
        with pytest.raises(ValidationError, match="s is not after the 3 s before"):
            Lighting.model_validate({**sun, "changes": changes}, context=FROM_FILE)
    with pytest.raises(ValidationError, match="no light to change"):
        Lighting.model_validate({"changes": [first]}, context=FROM_FILE)


def test_a_change_too_early_is_named_by_its_place_in_the_file() -> None:
    """Claim: of changes at 1, 2, 5, 4 and 3 s those of the places 3 and 4, counted from 0, come too early."""
    told = Lighting.model_construct(
        sun=Sun(direction=(0.0, -1.0, 0.0)),
        changes=tuple(LightChange(time=float(time), visible=0.5) for time in (1, 2, 5, 4, 3)),
    )
    assert [fault.location for fault in told.cross_checks()] == ["changes[3].time", "changes[4].time"]


@pytest.mark.parametrize(("altitude", "possible"), [(100.1e3, True), (99.9e3, False)])
def test_elements_are_followed_down_to_a_hundred_kilometres(
    monkeypatch: pytest.MonkeyPatch, altitude: float, possible: bool
) -> None:
    """Claim: where the orbit has come down to 100 km there is none any more, and it is told how far."""
    lines = {
        "line1": "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
        "line2": "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
    }
    monkeypatch.setattr(
        "scanner_sim.scene.light.orbit.sun_from_elements", lambda *_: (np.array([0.0, 0.0, -1.0]), altitude)
    )
    if possible:
        TwoLineElements(**lines, time="2008-09-20T12:25:40Z")
        return
    with pytest.raises(ValidationError, match=r"come down to 99\.9 km by then"):
        TwoLineElements(**lines, time="2008-09-20T12:25:40Z")
