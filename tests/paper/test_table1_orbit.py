"""Table 1's cause: Sun and Earth along an orbit. How long it is dark, and how bright the Earth is.

The paper's percentages of conditions depend on the scene; what follows from the orbit alone is judged here.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from scanner_sim.analytic import orbit as judge
from scanner_sim.scene.light.lighting import Lighting, orbit_times, skies
from scanner_sim.scene.light.orbit import Orbit, TwoLineElements

STATION = {
    "line1": "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
    "line2": "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
    "time": "2008-09-20T12:25:40Z",
}
"""The Space Station in September 2008, a published example."""


def eclipsed(lighting: Lighting, count: int = 2000) -> float:
    """Return the share of an orbit without the Sun, the penumbra counted by its darkness."""
    return 1.0 - float(np.mean([sky.sun_visible for sky in skies(lighting, orbit_times(lighting, count))]))


@pytest.mark.parametrize(("beta", "share"), [(0.0, 0.390), (52.0, 0.315), (71.0, 0.0)])
def test_eclipse_fractions(beta: float, share: float) -> None:
    """Claim: at 400 km the Sun is eclipsed for 0.390 of an orbit at β = 0, 0.315 at 52°, never beyond 70.2°.

    Set-up: the closed form, and 2000 places of the simulator's orbit with the Sun as a disc. Expected: the
    three digits. Tolerance: half of the last; the penumbra is symmetric to 1e-4, places are 5e-4 apart and the
    two limbs average to half of that.
    """
    assert judge.eclipse_fraction(400e3, math.radians(beta)) == pytest.approx(share, abs=5e-4)
    lighting = Lighting(orbit=Orbit(beta=math.radians(beta)))
    assert eclipsed(lighting) == pytest.approx(share, abs=5e-4)


def test_largest_eclipse_free_beta() -> None:
    """Claim: eclipses end at β = 70.2°, the Earth's angular radius.

    Set-up: β half a degree to either side (the Sun's radius is 0.27°), midnight. Expected: all, then nothing hidden.
    """
    limit = judge.eclipse_free_beta(400e3)
    assert math.degrees(limit) == pytest.approx(70.2, abs=0.05)
    for beta, visible in ((limit - 0.009, 0.0), (limit + 0.009, 1.0)):
        assert Lighting(orbit=Orbit(beta=beta, anomaly=math.pi)).sky().sun_visible == visible


@pytest.mark.parametrize("beta", [0.0, 45.0])
def test_penumbra(beta: float) -> None:
    """Claim: the Sun takes 8 s to set from a low orbit at β = 0, and longer where it sets askew.

    Set-up: 400 km; the visible share every 0.05 s about the time at which the Sun's centre sets. Expected: the
    first-order duration (8.19 s at β = 0) between the first and the last contact, half of the Sun at the middle.
    Tolerance: 0.1 s of steps and second order; 1e-2 of share.
    """
    lighting = Lighting(orbit=Orbit(beta=math.radians(beta)))
    period = lighting.period
    assert period is not None
    middle = period * 0.5 * (1.0 - float(judge.eclipse_fraction(400e3, math.radians(beta))))
    duration = judge.penumbra_duration(400e3, math.radians(beta), 695e6 / 149.68e9, period)
    times = middle + np.arange(-300, 301) * 0.05
    share = np.array([sky.sun_visible for sky in skies(lighting, times)])
    assert (np.diff(share) <= 0.0).all()
    assert np.count_nonzero((share > 0.0) & (share < 1.0)) * 0.05 == pytest.approx(duration, abs=0.15)
    assert share[300] == pytest.approx(0.5, abs=2e-2)


def test_earthshine_on_a_plate_facing_nadir() -> None:
    """Claim: at 400 km the lit Earth gives 0.885 of its albedo times sunlight to a plate facing nadir.

    Set-up: the flat form (all points lit as the one below) and the exact integral over the lit cap. Expected:
    (6371/6771)² = 0.8853; the exact one is 0.4 % lower, as outer points are lit askew, and both tend to
    1 near the ground. Tolerance: half of the last digit.
    """
    assert judge.earthshine_flat(400e3, 0.0) == pytest.approx(0.885, abs=5e-4)
    assert judge.earthshine(400e3, 0.0) == pytest.approx(0.882, abs=5e-4)
    assert judge.earthshine(400e3, 0.3) == pytest.approx(
        judge.earthshine(400e3, 0.0) * math.cos(0.3), rel=1e-12
    )
    assert judge.earthshine(100.0, 0.0) == pytest.approx(1.0, abs=1e-4)


def test_real_orbit_against_closed_forms() -> None:
    """Claim: an orbit from two-line elements sees the Sun where the Almanac has it, and the eclipse that follows.

    Set-up: the Space Station at 2008-09-20 12:25:40 UTC, the elements' own epoch. The judge computes β from
    inclination, node and the Almanac's Sun of date, and the eclipse from β and the mean altitude of one orbit.
    Expected: β within 0.05° (Almanac 0.01°, the node's periodic terms 0.01°); eclipse within 0.003 (the altitude
    varies by 20 km, which is 0.004 of an orbit at one limb, and the elements' eccentricity by less).
    """
    lighting = Lighting(tle=TwoLineElements.model_validate(STATION))
    sky = lighting.sky()
    assert sky.sun_direction is not None
    # The scanner looks forwards with nadir down, so its x axis is starboard, against the orbit's normal.
    beta = -math.asin(sky.sun_direction[0])
    days = 3185.0 + (12.0 + 25.0 / 60.0 + 40.0 / 3600.0 - 12.0) / 24.0  # 2000-01-01 12:00 to 2008-09-20 12:00
    expected = judge.beta_angle(days, math.radians(51.6416), math.radians(247.4627))
    assert math.degrees(beta) == pytest.approx(math.degrees(expected), abs=0.05)
    times = orbit_times(lighting, 400)
    altitude = float(np.mean([sky.earth_altitude for sky in skies(lighting, times)]))
    assert 340e3 < altitude < 365e3
    assert eclipsed(lighting, 400) == pytest.approx(float(judge.eclipse_fraction(altitude, beta)), abs=3e-3)
