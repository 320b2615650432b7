"""Values that contradict one another: each by itself just within its limit and just beyond, with place and remedy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from scanner_sim import load_scenario
from scanner_sim.config import load_scanner
from scanner_sim.foundation.errors import ScenarioError

RASTER = {"type": "raster", "rows": 4, "columns": 5, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
SPIRAL = {"type": "spiral", "radius": 0.05, "turns": 5.0, "points": 80}
TARGETS = {
    "scene": {"objects": [{
        "name": "disc", "shape": "disc", "diameter": 0.1, "position": (0.0, 0.0, 5.0), "material": "black_oxide"
    }]},
}  # fmt: skip
TOF: dict[str, Any] = {"ranging": "tof"}


def faults(**given: Any) -> dict[str, tuple[str, str]]:
    """Return problem and remedy of each fault of a scenario, by its place."""
    try:
        load_scenario({"schema": 1, "scan": RASTER} | given)
    except ScenarioError as error:
        return {fault.location: (fault.problem, fault.remedy) for fault in error.faults}
    return {}


def shipped() -> Any:
    return load_scenario({"schema": 1, "scan": RASTER}).scanner


@pytest.mark.parametrize(
    ("given", "place", "words"),
    [
        ({"processing": {"range_gate": (1.0, 1.562)}}, "processing.range_gate", "[1 m, 1.562 m] lies outside"),
        ({"processing": {"range_gate": (1.0, 1.563)}}, "", ""),
        (TOF | {"processing": {"range_gate": (35.0, 40.0)}}, "processing.range_gate", "0.5 m to 35 m"),
        (TOF | {"processing": {"range_gate": (34.9, 40.0)}}, "", ""),
        (TOF | {"processing": {"range_gate": (0.4, 0.5)}}, "processing.range_gate", "what the digitiser records"),
        (TOF | {"processing": {"range_gate": (0.4, 0.51)}}, "", ""),
        ({"output": {"lines": "all"}}, "", ""),
        ({"output": {"lines": "all"}} | TOF, "output.lines", "time of flight has no lines"),
        ({"output": {"waveforms": "all"}}, "output.waveforms", "triangulation has no waveforms"),
        ({"output": {"waveforms": "all"}} | TOF, "", ""),
        ({"output": {"waveforms": "all", "lines": "all"}, "ranging": "both"}, "", ""),
        ({"output": {"lines": "all"}, "scan": SPIRAL}, "output.lines", "a scan of type spiral keeps no lines"),
        ({"output": {"lines": [[3, 4]]}}, "", ""),
        ({"output": {"lines": [[4, 4]]}}, "output.lines", ""),
        ({"output": {"lines": [[3, 5]]}}, "output.lines", ""),
        ({"output": {"jacobian": True}}, "output.jacobian", "without a calibration no parameter has an error"),
    ],
)  # fmt: skip
def test_what_finds_no_room_is_told_where_it_stands(given: dict[str, Any], place: str, words: str) -> None:
    """Claim: gates must overlap what the array sees, from 1.5625 m on, or what the digitiser records, 0.5 to 35 m;
    lines are of triangulation and waveforms of time of flight, of voxels of a raster of 4 × 5."""
    found = faults(**given)
    assert list(found) == ([place] if place else [])
    if place:
        problem, remedy = found[place]
        assert words in problem
        assert remedy


@pytest.mark.parametrize(("share", "told"), [(0.999, True), (1.0, False)])
def test_every_voxel_has_a_pulse(share: float, told: bool) -> None:
    rate = share * shipped().rate
    found = faults(**TOF, scanner={"lidar": {"pulse": {"repetition_rate": rate}}})
    assert ("scanner.lidar.pulse.repetition_rate" in found) is told
    if told:
        assert f"{rate:.4g} pulses a second leave some of" in found["scanner.lidar.pulse.repetition_rate"][0]


@pytest.mark.parametrize(("share", "told"), [(0.999, True), (1.0, False)])
def test_an_instrument_of_pulses_alone_has_one_for_every_voxel(
    share: float, told: bool, tmp_path: Path
) -> None:
    """Claim: told of a file that is asked for itself as well; an instrument with an array may do without pulses."""
    for preset in ("pulsed_scanner", "nrc_2000"):
        rate = share * load_scanner(preset).rate
        value = f"{{value: {rate!r} Hz, mark: assumed, source: an estimate}}"
        path = tmp_path / f"{preset}.yaml"
        path.write_text(
            f"schema: 1\nextends: {preset}\nabout: a slow one\n"
            f"scanner: {{lidar: {{pulse: {{repetition_rate: {value}}}}}}}\n"
        )
        found = []
        try:
            load_scanner(path)
        except ScenarioError as error:
            found = [(fault.location, fault.problem) for fault in error.faults]
        rare = f"{rate:.4g} pulses a second leave some of {load_scanner(preset).rate:.4g} voxels without one."
        assert found == (
            [("scanner.lidar.pulse.repetition_rate", rare)] if told and preset == "pulsed_scanner" else []
        )


@pytest.mark.parametrize(("samples", "told"), [(203, True), (205, False)])
def test_a_record_has_the_echoes_of_one_pulse(samples: int, told: bool) -> None:
    """Claim: 180 ns of ranges and 12 ns before and after them are 204 samples of 1 GHz, which fit between pulses."""
    gate = (5000.0, 5000.0 + 90e-9 * 299_792_458.0 - 1e-6)
    lidar = {"pulse": {"repetition_rate": 1e9 / samples}, "digitiser": {"gate": gate, "rate": 1e9}}
    found = faults(**TOF, scanner={"lidar": lidar})
    assert ("scanner.lidar.digitiser.gate" in found) is told
    if told:
        problem, remedy = found["scanner.lidar.digitiser.gate"]
        assert "record of 2.04e-07 s is longer than the 2.03e-07 s from pulse to pulse" in problem
        assert "lidar.pulse.repetition_rate" in remedy


@pytest.mark.parametrize(("share", "told"), [(1.0, True), (0.999, False)])
def test_a_level_lies_below_saturation(share: float, told: bool) -> None:
    level = share * shipped().lidar.photodiode.saturation
    found = faults(**TOF, processing={"pulse": {"timing": "leading_edge", "level": level}})
    assert ("processing.pulse.level" in found) is told


@pytest.mark.parametrize(("pixels", "told"), [(10, True), (11, False)])
def test_an_array_holds_the_window_of_its_estimator(pixels: int, told: bool) -> None:
    """Claim: Blais and Rioux's filter of eight reads four pixels to each side, at the peak and at its neighbour."""
    found = faults(scanner={"position_sensor": {"pixels": pixels}}, processing={"peak": "blais_rioux_8"})
    assert any("reads 11 pixels, and the array has" in problem for problem, _ in found.values()) is told


def test_an_array_sees_gates_up_to_its_farthest_range() -> None:
    """Claim: of an array that sees 0.311 to 1.006 m a gate beyond is told with both ends."""
    scanner = {"scanner": {"preset": "close_range_scanner"}}
    assert not faults(**scanner, processing={"range_gate": (1.005, 2.0)})
    (found,) = faults(**scanner, processing={"range_gate": (1.006, 2.0)}).values()
    assert "0.311 m to 1.006 m" in found[0]


@pytest.mark.parametrize(
    ("output", "place"),
    [
        ({"truth": ["normal"]}, "output.truth"), ({"jacobian": True}, "output.jacobian"),
        ({"lines": "all"}, "output.lines"),
        ({}, ""),
    ],
)  # fmt: skip
def test_runs_that_follow_keep_no_layers(output: dict[str, Any], place: str) -> None:
    scan = {"type": "track", "targets": ["disc"], "duration": 1.0}
    found = faults(**TARGETS, scan=scan, output=output)
    assert list(found) == ([place] if place else [])
    assert not place or "a run that follows targets" in found[place][0]


def test_a_run_that_follows_draws_light_and_noise_together() -> None:
    scan = {"type": "track", "targets": ["disc"], "duration": 1.0}
    assert list(faults(**TARGETS, scan=scan, transport={"light_seed": 3})) == ["transport.light_seed"]
    assert not faults(transport={"light_seed": 3})
