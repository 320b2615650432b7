"""An instrument as it was built: lengths with their departures, and those of which none can be made."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.config import built
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import INDEX, NAMES

SCAN = {"type": "raster", "rows": 2, "columns": 2, "horizontal": [-0.1, 0.1], "vertical": [-0.1, 0.1]}


def departed(monkeypatch: pytest.MonkeyPatch, seed: int | None = None, **departures: float) -> Scenario:
    """Return a scenario whose instrument departs by what is said; its draw is told to be of the light's seed."""
    as_built = {"base": "1 mm"} | ({} if seed is None else {"seed": seed})
    scenario = load_scenario({"schema": 1, "seed": 5, "scan": SCAN, "scanner": {"as_built": as_built}})
    values = np.zeros(len(NAMES))
    for name, value in departures.items():
        values[INDEX[name]] = value

    def parameters(_: Any, drawn: int) -> Any:
        assert drawn == scenario.transport.seed_of_light(scenario.seed)
        return values

    monkeypatch.setattr(type(scenario.scanner.as_built), "parameters", parameters)
    return scenario


@pytest.mark.parametrize("seed", [None, 17])
def test_an_instrument_has_its_departures(monkeypatch: pytest.MonkeyPatch, seed: int | None) -> None:
    """Claim: the true base is the designed one and its departure; its
    vibration is drawn by the seed of the light, whatever draws the instrument."""
    scenario = departed(
        monkeypatch, seed, base=2e-3, axis_separation=3e-4, array_scale=0.01, array_offset=5e-5
    )
    made = built.instrument_as_built(scenario)
    assert made is not None
    assert made.baseline == pytest.approx(scenario.scanner.receiver.baseline + 2e-3)
    assert made.seed == scenario.transport.seed_of_light(5)
    true = built.scanner_as_built(scenario.scanner, made)
    sensor = scenario.scanner.position_sensor
    assert true.position_sensor.pitch == pytest.approx(1.01 * sensor.pitch)
    assert true.position_sensor.offset == pytest.approx(1.01 * sensor.offset + 5e-5)
    assert true.mirrors.axis_separation == pytest.approx(scenario.scanner.mirrors.axis_separation + 3e-4)
    assert built.scanner_as_built(scenario.scanner, None) is scenario.scanner


@pytest.mark.parametrize("share", [0.999, 1.001])
@pytest.mark.parametrize("name", ["base", "focal_length", "array_scale"])
def test_an_instrument_without_a_base_an_image_or_pixels_is_none(
    monkeypatch: pytest.MonkeyPatch, name: str, share: float
) -> None:
    """Claim: departures may take nearly all of the base, of the distance of lens and array, or of the pixels' pitch,
    and not more."""
    scanner = load_scenario({"schema": 1, "scan": SCAN}).scanner
    lengths = scanner.receiver.baseline, scanner.receiver.line_image.depth, scanner.position_sensor.pitch
    whole = dict(zip(("base", "focal_length", "array_scale"), lengths, strict=True))[name]
    scenario = departed(monkeypatch, **{name: -share * (1.0 if name == "array_scale" else whole)})
    if share < 1.0:
        assert built.instrument_as_built(scenario) is not None
        return
    word = "pitch" if name == "array_scale" else name
    with pytest.raises(InputError, match=f"a {word} of {(1.0 - share) * whole:.4g} m") as fault:
        built.instrument_as_built(scenario)
    assert f"scanner.as_built.{name}" in fault.value.remedy


@pytest.mark.parametrize("light", [None, 7])
def test_an_instrument_with_its_serial_number_is_the_same_under_other_seeds(light: int | None) -> None:
    """Claim: what the scenario's seed draws, or that of its light, stays; mirrors and light err by the seed that is
    given then. One with a number has its own."""
    as_built = {"base": {"tolerance": "1 mm"}}
    given = {
        "schema": 1,
        "seed": 5,
        "scan": SCAN,
        "scanner": {"as_built": as_built},
        "transport": {"light_seed": light},
    }
    drawn = load_scenario(given)
    (base,) = built.drawn_departures(drawn).values()
    for seed in (5, 99):
        again = built.with_serial_number(drawn).changed(seed=seed)
        assert list(built.drawn_departures(again).values()) == [base]
        assert again.transport.seed_of_light(again.seed) == seed
    assert list(
        built.drawn_departures(drawn.replace({"seed": 99, "transport.light_seed": None})).values()
    ) != [base]
    numbered = drawn.replace({"scanner.as_built.seed": 3})
    assert built.with_serial_number(numbered).scanner.as_built.seed == 3  # type: ignore[union-attr]
    plain = load_scenario({"schema": 1, "seed": 5, "scan": SCAN})
    assert built.with_serial_number(plain) == plain


def test_the_same_instrument_stands_before_another_scene() -> None:
    """Claim: whatever the seed of the scan, departures that a seed draws are those of the scenario's light; a seed of
    its own stays, and an instrument as designed has none."""
    drawn = load_scenario({"schema": 1, "seed": 5, "scan": SCAN, "scanner": {"as_built": {"base": "1 mm"}}})
    again = built.same_instrument(drawn, {"seed": 99}, "x")
    assert again.seed == 99
    assert again.transport.light_seed is None
    assert again.scanner.as_built is not None
    assert again.scanner.as_built.seed == drawn.transport.seed_of_light(5)
    own = drawn.replace({"scanner.as_built.seed": 3})
    assert built.same_instrument(own, {"seed": 99}, "x").scanner.as_built.seed == 3  # type: ignore[union-attr]
    plain = load_scenario({"schema": 1, "seed": 5, "scan": SCAN})
    assert built.same_instrument(plain, {"seed": 99}, "x").scanner.as_built is None
