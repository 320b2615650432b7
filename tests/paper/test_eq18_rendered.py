"""Eqs 18 and 19 from rendered light: a Lambertian plane, laser and Sun on and off."""

from __future__ import annotations

import numpy as np
import pytest

from scanner_sim import Scenario
from scanner_sim.analytic import spot, sun
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.scan.raster import raster_aim

RANGES = (2.0, 5.0, 10.0, 20.0, 30.0)
WINDOW = 200e-6
TEMPERATURE = 5770.0

pytestmark = pytest.mark.usefixtures("device")


def light(
    distance: float,
    reflectance: float = 0.5,
    bandwidth: float = 30e-9,
    focal_length: float = 0.1,
    height: float = 250e-6,
    sunlit: bool = True,
) -> tuple[float, float]:
    """Return I_laser and I_sun [W] of the shot straight ahead at a plane that Sun and scanner face."""
    wall = {"name": "wall", "shape": "rectangle", "size": (50.0, 50.0), "position": (0.0, 0.0, distance)}
    scenario = Scenario(
        schema=1,
        scanner={
            "mirrors": {"jitter": 0.0},
            "receiver": {"focal_length": focal_length},
            "filter": {"bandwidth": bandwidth},
            "position_sensor": {"height": height, "pixels": 256},
        },
        scene={"objects": [{**wall, "material": {"reflectance": reflectance}}]},
        lighting={"sun": {"direction": (0.0, 0.0, -1.0), "temperature": TEMPERATURE}} if sunlit else {},
        scan={"rows": 1, "columns": 1, "horizontal": (0.0, 0.0), "vertical": (0.0, 0.0)},
        transport={"background_bounces": 1},
    )
    bench = Instrument(scenario, device="cpu")
    _, groups = bench.expose(raster_aim(scenario.scan, np.array([0], dtype=np.uint32), 50e-6))
    (group,) = groups
    budget = group.light.link_budget()
    return float(budget.laser[0]), float(budget.background[0])


def printed(distance: float, reflectance: float, bandwidth: float) -> tuple[float, float]:
    """Return I_laser and I_sun [W] by eqs 19 and 18, the laser's cut by the pixels' height."""
    gain = np.pi / 4.0 * 0.025**2 * 0.5
    image = 0.1 * 0.5 * 2e-3 * np.hypot(1.0, distance * 1.5e-6 / (np.pi * 2e-3**2)) / distance
    share = float(spot.share_within_height(np.hypot(image, 40e-6), 250e-6))
    laser = float(spot.laser_power_printed(distance, 15e-3, reflectance, gain)) * share
    effective = sun.effective_irradiance(1.5e-6, bandwidth, T=TEMPERATURE)
    return laser, sun.sun_power(reflectance, WINDOW * 250e-6, 0.1, gain, effective)


def off_axis(distance: float) -> float:
    """Return cos⁴ψ for light that images at p = f d/R: what eqs 18 and 19 leave out."""
    return float((1.0 + (0.2 / distance) ** 2) ** -2)


@pytest.mark.parametrize("bandwidth", [10e-9, 30e-9, 50e-9])
@pytest.mark.parametrize("reflectance", [0.05, 0.9])
@pytest.mark.parametrize("distance", RANGES)
def test_rendered_light_is_that_of_the_equations(
    distance: float, reflectance: float, bandwidth: float
) -> None:
    """Claim: rendered I_laser, I_sun and their ratio follow eqs 18 and 19 (repaired).

    Set-up: a Lambertian plane faces scanner and Sun. Expected: the equations, with the share of the laser that the
    pixels' height leaves, and with cos⁴ψ of both (2 % at 2 m, where the spot images 5.7° off the axis; the ratio
    needs none). Tolerance: 1 %; there is no noise in it.
    """
    laser, window = light(distance, reflectance, bandwidth)
    expected_laser, expected_window = printed(distance, reflectance, bandwidth)
    assert laser == pytest.approx(expected_laser * off_axis(distance), rel=0.01)
    assert window == pytest.approx(expected_window * off_axis(distance), rel=0.01)
    assert laser / window == pytest.approx(expected_laser / expected_window, rel=0.01)
    if distance >= 5.0:
        assert laser == pytest.approx(expected_laser, rel=0.01)
        assert window == pytest.approx(expected_window, rel=0.01)


def slope(x: tuple[float, ...], y: list[float]) -> float:
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


@pytest.mark.slow
def test_slopes_of_the_ratio() -> None:
    """Claim: SNR falls as R⁻², rises as f², falls as 1/S and 1/bandwidth.

    Set-up: log-log fits of rendered ratios at four values each, from 8 m on, where the pixels' height cuts less
    than 1e-3 of the laser's light. Expected: −2, 2, −1 and −1; the Sun out of band adds 2e-4. Tolerance: 0.01.
    """

    def ratios(**sweep: tuple[float, ...]) -> tuple[tuple[float, ...], list[float]]:
        ((name, values),) = sweep.items()
        pairs = [light(**{"distance": 15.0, name: value}) for value in values]
        return values, [laser / window for laser, window in pairs]

    assert slope(*ratios(distance=(8.0, 12.0, 18.0, 27.0))) == pytest.approx(-2.0, abs=0.01)
    assert slope(*ratios(focal_length=(0.06, 0.08, 0.1, 0.12))) == pytest.approx(2.0, abs=0.01)
    assert slope(*ratios(height=(250e-6, 300e-6, 400e-6, 500e-6))) == pytest.approx(-1.0, abs=0.01)
    assert slope(*ratios(bandwidth=(10e-9, 20e-9, 30e-9, 50e-9))) == pytest.approx(-1.0, abs=0.01)


def test_without_the_sun_there_is_no_background() -> None:
    assert light(10.0, sunlit=False)[1] == 0.0
