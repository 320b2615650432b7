"""Ranges of the time-of-flight unit from its delays, and the numbers that it takes from its parts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Scenario, ScenarioError, load_scenario, simulate
from scanner_sim.analytic import geometry as judge
from scanner_sim.config import scenario_warnings
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.instrument import time_of_flight
from scanner_sim.instrument.time_of_flight import EchoDelays, TimeOfFlight
from scanner_sim.ranging.ranges import Deflections

Array = NDArray[np.float64]

BASE, D = 0.2, 0.05
BAND, NARROW, BLIND = (0.9e-6, 1.7e-6), (1.4e-6, 1.6e-6), (0.9e-6, 1.4e-6)
THETA, PHI, R = np.array([-0.3, 0.1, 0.4]), np.array([0.2, -0.1, 0.3]), np.array([2.0, 5.0, 12.0])


@dataclass(frozen=True)
class Optics:
    """What of the triangulation's optics the unit reads."""

    filter_transmission: float = 0.8
    axis_separation: float = D


def bench(place: str, **more: object) -> TimeOfFlight:
    known: Scenario = load_scenario(
        {
            "schema": 1,
            "ranging": "tof",
            "scanner": {"lidar": {"photodiode": {"place": place}}},
            "scan": {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)},
        }
        | more
    )
    return TimeOfFlight(known, None, Optics())


def delay_of(reach: Array, theta: Array, base: float) -> Array:
    """Return the delays of echoes: there from the laser, back to the lens."""
    return np.asarray(
        (reach + np.sqrt(reach**2 - 2.0 * reach * base * np.sin(theta) + base**2)) / SPEED_OF_LIGHT
    )


@pytest.mark.parametrize(("place", "base"), [("coaxial", 0.0), ("offset", BASE)])
def test_ranges_have_the_covariance_of_delay_and_angles(place: str, base: float) -> None:
    """Claim: with σ of delay, clock, Θ and φ the point's covariance is J C Jᵀ, J by differences."""
    made = bench(place)
    delay, sigma = delay_of(R, THETA, base), np.array([30e-12, 60e-12, 90e-12])
    timed = EchoDelays.empty(3)
    timed.delay[:], timed.sigma[:] = delay, sigma
    # So coarse an encoder that what it makes of the range is as large as what the delay does.
    sigma_theta, sigma_phi = np.full(3, 0.05), np.full(3, 3e-4)
    found = made.ranges(timed, Deflections(THETA, PHI, sigma_theta, sigma_phi))
    np.testing.assert_allclose(found.range, R, rtol=1e-12)
    clock = made.unit.digitiser.jitter
    assert clock > 0.0
    for n in range(3):

        def point(change: Array, n: int = n) -> Array:
            """Return x, y, z and R where delay, Θ and φ are other ones."""
            when, theta, phi = delay[n] + change[0], THETA[n] + change[1], PHI[n] + change[2]
            way = SPEED_OF_LIGHT * when
            reach = (way**2 - base**2) / (2.0 * (way - base * math.sin(theta)))
            return np.append(judge.point_from_shot(reach, theta, phi, D), reach)

        steps = np.array([1e-13, 1e-6, 1e-6])
        slopes = np.stack([(point(h) - point(-h)) / (2.0 * h.sum()) for h in np.diag(steps)], axis=1)
        spread = np.array([sigma[n] ** 2 + clock**2, 2.5e-3, 9e-8])
        wanted = slopes * spread @ slopes.T
        own = found.covariance
        got = np.array([own.xx[n], own.yy[n], own.zz[n], own.xy[n], own.xz[n], own.yz[n]])
        pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
        np.testing.assert_allclose(got, [wanted[pair] for pair in pairs], rtol=1e-5)
        assert found.sigma[n] == pytest.approx(math.sqrt(wanted[3, 3]), rel=1e-6)


def test_a_gate_is_what_is_recorded_and_wanted() -> None:
    near, far = bench("coaxial").unit.digitiser.gate
    assert bench("coaxial").gate == (near, far)
    for wanted, gate in (((2.0, 50.0), (2.0, far)), ((0.1, 7.0), (near, 7.0))):
        assert bench("coaxial", processing={"range_gate": wanted}).gate == gate


def lit_wall(**responses: tuple[float, float]) -> Scenario:
    """A sunlit wall before both rangefinders without a filter; the detectors respond where it is told."""
    unit = {"photodiode": {"response": responses.get("photodiode", BAND)}}
    return load_scenario(
        {
            "schema": 1,
            "ranging": "both",
            "scanner": {
                "filter": "none",
                "position_sensor": {"response": responses.get("line", BAND)},
                "lidar": unit,
            },
            "lighting": {"sun": {"direction": (0.0, 0.3, -1.0)}},
            "scene": {
                "objects": [
                    {
                        "name": "wall",
                        "shape": "rectangle",
                        "size": (3.0, 3.0),
                        "position": (0.0, 0.0, 6.0),
                        "material": {"reflectance": 0.5},
                    }
                ]
            },
            "scan": {"rows": 2, "columns": 2, "horizontal": (-0.05, 0.05), "vertical": (-0.05, 0.05)},
        }
    )


@pytest.mark.slow
def test_each_detector_responds_by_itself(device: object) -> None:
    """Claim: a narrower response of one detector takes sunlight from it, and leaves the other to the last bit."""
    usual = simulate(lit_wall(), device="cpu")
    line = simulate(lit_wall(line=NARROW), device="cpu")
    diode = simulate(lit_wall(photodiode=NARROW), device="cpu")
    timed = [name for name in usual.channels if name.startswith("tof.")]
    own = ["Y", "background", "background_peak", "peak_px", "sigma_peak_px"]
    assert (usual["status"] == 0).all()
    assert (usual["tof.status"] == 0).all()
    blind = simulate(lit_wall(line=BLIND), device="cpu")
    assert (blind["status"] != 0).all()
    for name in timed:
        np.testing.assert_array_equal(usual[name], line[name])
        np.testing.assert_array_equal(usual[name], blind[name])
    for name in own:
        np.testing.assert_array_equal(usual[name], diode[name])
    assert (line["background"] < 0.5 * usual["background"]).all()
    assert (diode["tof.background_w"] < 0.5 * usual["tof.background_w"]).all()


def test_a_detector_blind_to_the_laser_is_told_of() -> None:
    """Claim: one of two that is blind is warned of under its own key; where none sees, the scenario is at fault."""
    for way, response in (("position_sensor", {"line": BLIND}), ("lidar.photodiode", {"photodiode": BLIND})):
        half = lit_wall(**response)
        told = [words.split(":")[0] for words in scenario_warnings(half) if "no voxel will" in words]
        assert told == [f"scanner.{way}.response"]
        alone = "triangulation" if way == "position_sensor" else "tof"
        with pytest.raises(ScenarioError, match=f"scanner.{way}.response: it does not reach"):
            load_scenario(half.model_dump(by_alias=True) | {"ranging": alone})
    missed = load_scenario(
        lit_wall().model_dump(by_alias=True) | {"ranging": "both"},
        ["scanner.filter={bandwidth: 30 nm}", "scanner.laser.drift=80 nm"],
    )
    assert sum("misses the laser" in words for words in scenario_warnings(missed)) == 1


def test_a_response_ascends() -> None:
    for wrong in ((1.7e-6, 0.9e-6), (0.0, 1e-6)):
        with pytest.raises(ScenarioError, match="ascend") as caught:
            lit_wall(photodiode=wrong)
        assert "scanner.lidar.photodiode.response" in str(caught.value)


def test_a_square_field_has_the_round_ones_solid_angle(
    device: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: side √π/2 of the angle; beside the laser it reaches from infinity inwards."""
    monkeypatch.setattr(time_of_flight, "field_optics", lambda *_: None)
    angle = bench("coaxial").unit.photodiode.field_of_view
    for place, aside in (("coaxial", 0.0), ("offset", 0.5 * angle)):
        field = bench(place).field
        assert field.side**2 == pytest.approx(0.25 * math.pi * angle**2)
        assert field.aside == pytest.approx(aside)
        # From its middle, so far before the beam, half a side to either end.
        assert bench(place).sight[1] == pytest.approx(
            (-aside - 0.25 * math.sqrt(math.pi) * angle, -aside + 0.25 * math.sqrt(math.pi) * angle)
        )


def test_an_electron_makes_the_peak_of_its_pulse() -> None:
    """Claim: M q/(√(2π) σ) with σ of the pulse and the electronics together: 10⁻⁴."""
    made = bench("coaxial")
    pulse = made.unit.pulse.width / math.sqrt(8.0 * math.log(2.0))
    width = math.hypot(pulse, made.unit.photodiode.response_sigma)
    wanted = made.unit.photodiode.gain * 1.602176634e-19 / (math.sqrt(2.0 * math.pi) * width)
    assert made.amperes_per_electron == pytest.approx(wanted, rel=1e-4, abs=0.0)
