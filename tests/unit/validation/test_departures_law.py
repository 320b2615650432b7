"""The law of the instrument as built: it holds for what is built so, and sees what is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim import Scenario, compare, load_scenario
from scanner_sim.config.calibration import calibration_text, design_of
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.validation.compare import departures

BUILT = {
    "base": 2e-4, "focal_length": 1e-4, "axis_separation": 5e-4, "axis_offset": 3e-4, "axis_skew": 3e-4,
    "theta_zero": 2e-4, "phi_zero": 2e-4, "theta_scale": 1e-3, "phi_scale": 1e-3, "array_offset": 4e-6,
    "array_scale": 5e-4, "array_tilt": 5e-3, "radial_1": 0.1, "tangential": 5e-3, "tof_zero": 8e-3, "tof_scale": 1e-3,
}  # fmt: skip
PERIOD = 0.3
TARGET = "50 % at 2.5 m, 5 m"

pytestmark = pytest.mark.usefixtures("device")


def scenario(**as_built: Any) -> Scenario:
    """Return an instrument as built whose platform shakes and whose lens scatters, with all noise."""
    shaken = {"vibration": {"turn": [[5.0, 1e-10], [100.0, 1e-12]]}, "stray_light": 0.01, "power_noise": 0.01}
    wall = {
        "shape": "rectangle",
        "name": "wall",
        "material": "grey_reference",
        "position": [0, 0, 4],
        "size": [9, 9],
    }
    return load_scenario(
        {
            "schema": 1, "ranging": "both", "scanner": {"as_built": {**shaken, **as_built}},
            "scene": {"objects": [wall]},
            "scan": {"type": "raster", "rows": 4, "columns": 4, "horizontal": [-0.3, 0.3], "vertical": [-0.3, 0.3]},
        }
    )  # fmt: skip


def judged(found: Scenario) -> dict[str, Any]:
    """Return the checks of the law, by case."""
    (finding,) = compare(found, only=["departures"], target=TARGET, device="cpu").findings
    return {check.case: check for check in finding.checks}


def calibrated(found: Scenario, folder: Path) -> Scenario:
    """Return a scenario that believes four fifths of what its instrument is built by, and its drawn base wrongly."""
    values = np.array([0.8 * BUILT.get(name, 0.0) for name in NAMES])
    own = Calibration(values, np.zeros((len(NAMES), len(NAMES))), design_of(found.scanner), PERIOD)
    (folder / "calibration.yaml").write_text(calibration_text(own, found.scanner), encoding="utf-8")
    return found.replace({"processing.calibration": str(folder / "calibration.yaml")})


def test_it_holds_for_departures_given_drawn_and_believed(tmp_path: Path) -> None:
    """Claim: a mean of some 10 mm at 5 m is what the closed forms say, the largest to less than a tenth, by both ways
    of ranging; with a calibration that knows most of it what is left is, too. The base is the one that the scenario
    draws, whose share at 5 m has a standard deviation of 10 mm; the zero of time of flight alone is worth 8 mm."""
    built = scenario(**BUILT | {"base": {"tolerance": 2e-4}}, encoder_period=PERIOD, theta_sine=2e-4)
    blind, seeing = judged(built), judged(calibrated(built, tmp_path))
    assert len(blind) == len(seeing) == 12
    for checks in (blind, seeing):
        assert not [case for case, check in checks.items() if check.broken]
    largest = max(blind.values(), key=lambda check: abs(check.simulated))
    assert abs(largest.simulated) > 8.0
    assert largest.accuracy < 0.1 * abs(largest.simulated)
    far = "z by triangulation, wall at 5 m"
    assert abs(seeing[far].simulated - blind[far].simulated) > 1.0
    # Nothing that changes from shot to shot, nor the noise, is in it.
    assert judged(built.replace({"scanner.as_built.vibration": None}))[far].simulated == blind[far].simulated


@pytest.mark.parametrize("name", ["base", "theta_zero", "phi_scale", "array_offset", "tof_zero"])
def test_it_sees_a_departure_that_is_a_fifth_off(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: were the light to follow a parameter a fifth larger or smaller than what was built, it would be broken."""
    plain = departures._instruments

    def wrong(setting: Any) -> Any:
        built, believed = plain(setting)
        values = built.values.copy()
        values[INDEX[name]] *= 1.2
        return departures._Instrument(values, built.period), believed

    monkeypatch.setattr(departures, "_instruments", wrong)
    large = {"base": 5e-4, "theta_zero": 5e-4, "phi_scale": 5e-3, "array_offset": 2e-5, "tof_zero": 2e-2}
    assert any(check.broken for check in judged(scenario(**{name: large[name]})).values())


def test_other_laws_are_of_instruments_as_designed() -> None:
    """Claim: they do not apply to one that is built otherwise, and this one to none that is as designed."""
    how: dict[str, Any] = {"target": TARGET, "device": "cpu"}
    (other,) = compare(scenario(**BUILT), only=["spot_position"], **how).findings
    assert other.verdict == "does not apply"
    assert "leave scanner.as_built" in other.reason
    plain = scenario().replace({"scanner.as_built": None})
    (own,) = compare(plain, only=["departures"], **how).findings
    assert own.reason == "the instrument is built and believed as designed"
