"""What the sheet of an instrument holds, whatever it measures ranges with; which laws apply to it, and where."""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import numpy as np
import pytest

from scanner_sim import load_scanner, load_scenario
from scanner_sim.config.preset import shipped_presets
from scanner_sim.validation.compare import pulses, speckle, uneven
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.instrument_sheet import REFLECTANCE, instrument_sheet
from scanner_sim.validation.compare.laws import LAWS
from scanner_sim.validation.compare.run import judge_laws

STILL = {"rows": 8, "columns": 8, "horizontal": (-0.01, 0.01), "vertical": (-0.01, 0.01)}


def setup(preset: str, **scanner: object) -> ComparisonSetup:
    return ComparisonSetup(
        load_scenario({"schema": 1, "scanner": {"preset": preset, **scanner}, "scan": STILL})
    )


@pytest.mark.parametrize("preset", shipped_presets())
def test_a_sheet_has_what_the_instrument_has(preset: str) -> None:
    """Claim: columns of an array where there is one, σ of each way of ranging, ranges over what is seen."""
    scanner = load_scanner(preset)
    sheet = instrument_sheet(scanner, 12)
    assert (sheet.line is not None) is ("triangulation" in scanner.rangefinders)
    if sheet.line is not None:
        middle = len(sheet.theta) // 2
        assert sheet.line.nearest[middle] == pytest.approx(sheet.depth[0])
        assert sheet.line.farthest[middle] == pytest.approx(sheet.depth[1])
        assert ((sheet.line.image_px > 0.3) & (sheet.line.image_px < 8.0)).all()
    assert (sheet.diode_field is not None) is ("tof" in scanner.rangefinders)
    assert set(sheet.sigma_m) - {"fused"} == set(scanner.seeing)
    assert ("fused" in sheet.sigma_m) is (len(scanner.seeing) == 2)
    assert sheet.range_m[0] == pytest.approx(sheet.depth[0])
    assert sheet.range_m[-1] <= sheet.depth[1] * (1.0 + 1e-12)
    # The spot's diameter at 1/e², by the program's own beam.
    assert sheet.spot_m[3] == pytest.approx(
        2.0 * float(scanner.laser.radius(float(sheet.range_m[3]))), rel=1e-6
    )
    for values in sheet.sigma_m.values():
        assert (values[np.isfinite(values)] > 0.0).all()


def test_points_err_across_by_their_angles() -> None:
    """Claim: σ across is σ of an angle times the range: 5 µrad of jitter alone are 50 µm at 10 m."""
    scanner = load_scanner("nrc_2000")
    still = scanner.changed(mirrors=scanner.mirrors.still().model_copy(update={"jitter": 5e-6}))
    sheet = instrument_sheet(still, 4)
    assert sheet.lateral_m == pytest.approx(5e-6 * sheet.range_m)
    assert (sheet.baseline, sheet.aperture) == (scanner.receiver.baseline, scanner.receiver.aperture)
    assert (sheet.focal_length, sheet.rate) == (scanner.receiver.focal_length, scanner.rate)
    assert sheet.theta[[0, -1]] == pytest.approx(
        [-scanner.mirrors.max_deflection, scanner.mirrors.max_deflection]
    )


def test_a_well_fills_with_the_time_that_the_laser_shines() -> None:
    """Claim: of a grey plate the brightest pixel's charge over the well's: half where the laser is off for half of
    the dwell, and twice as much at half of the rate."""
    whole = load_scanner("nrc_2000")
    sheet = instrument_sheet(whole, 2)
    line, ranges = sheet.line, sheet.range_m
    assert line is not None
    forms = ClosedForms(load_scenario({"schema": 1, "scanner": {"preset": "nrc_2000"}, "scan": STILL}))
    charges = [forms.facing(float(R), REFLECTANCE).line.max() for R in ranges]
    assert line.filled == pytest.approx(
        np.array(charges) * (1.0 - whole.laser_off) / whole.position_sensor.full_well
    )
    for changes, factor in (
        ({"laser_off": 0.5}, 0.5 / (1.0 - whole.laser_off)),
        ({"rate": 0.5 * whole.rate}, 2.0),
    ):
        other = instrument_sheet(whole.model_copy(update=changes), 2).line
        assert other is not None
        assert other.filled == pytest.approx(factor * line.filled)


def test_both_ways_are_fused_where_both_measure() -> None:
    """Claim: a laser of 300 mW fills the pixels near the scanner and a gate ends at 20 m: there one way is alone."""
    strong = load_scanner("nrc_2000").changed(
        laser={"power": 0.3}, lidar={"digitiser": {"gate": (0.5, 20.0)}}
    )
    sheet = instrument_sheet(strong, 24)
    seen = {mode: np.isfinite(values) for mode, values in sheet.sigma_m.items()}
    assert not seen["triangulation"][0]
    assert seen["tof"][0]
    assert not seen["tof"][sheet.range_m > 20.0].any()
    assert (seen["fused"] == (seen["triangulation"] & seen["tof"])).all()
    assert seen["fused"].any()


def test_a_flight_instrument_is_accurate_to_a_few_millimetres_at_ten_metres() -> None:
    """Claim: the fact that has set its base holds: 1 to 5 mm at 10 m for a grey target, beam at rest."""
    sheet = instrument_sheet(load_scanner("laser_camera_system"), 16)
    at_ten = math.exp(
        np.interp(math.log(10.0), np.log(sheet.range_m), np.log(sheet.sigma_m["triangulation"]))
    )
    assert 1e-3 < at_ten < 5e-3


def test_laws_of_a_detector_need_that_detector() -> None:
    """Claim: of an instrument without a line all laws of the line say so, and only they; likewise without a diode."""
    for preset, part, rangefinder in (
        ("pulsed_scanner", "position sensor", "triangulation"),
        ("point_gauge", "time-of-flight unit", "tof"),
    ):
        names = [law.name for law in LAWS if law.rangefinder == rangefinder]
        found = judge_laws(setup(preset), only=names)
        assert {finding.reason for finding in found.findings} == {f"the instrument has no {part}"}
    assert {law.name for law in LAWS if law.rangefinder == "tof"} == {
        "tof_range", "tof_bound", "tof_sigma", "tof_coverage", "tof_walk",
    }  # fmt: skip


def test_flat_targets_stand_over_the_gate_where_there_is_no_array() -> None:
    assert setup("pulsed_scanner").flat.ranges[0] == pytest.approx(1.15 * 1.5, rel=5e-3)
    assert setup("pulsed_scanner").flat.ranges[-1] == pytest.approx(500.0 / 1.15, rel=5e-3)
    assert setup("nrc_2000").flat.ranges[-1] == 25.0


def test_rounding_of_a_silent_signal_is_no_white_noise() -> None:
    """Claim: a step of more than two standard deviations of the noise on it; of less, the laws apply."""
    fine, coarse = (setup("pulsed_scanner", lidar={"digitiser": {"bits": bits}}) for bits in (16, 14))
    assert not pulses.pulses_uncovered(fine)
    assert "is no white noise" in pulses.pulses_uncovered(coarse)


def test_laws_stay_within_the_mirrors() -> None:
    """Claim: of a gauge that tilts by 2°, speckle is sought in as many directions as fit two radii apart, and runs."""
    gauge = setup("point_gauge")
    limit = gauge.scenario.scanner.mirrors.max_deflection
    R = gauge.flat.ranges[0]
    reach, side, runs = speckle._separate(gauge, R)
    assert reach <= limit
    assert 2.0 * reach / (side - 1) >= 2.0 * gauge.scenario.scanner.laser.radius(R) / R
    assert side**2 * runs >= 4900 > side**2 * (runs - 1)
    assert "do not reach over 64 voxels" in uneven.UNEVEN.applies(gauge)


@pytest.mark.slow
def test_the_page_of_shipped_instruments_is_what_its_program_makes(
    repo_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where this fails: python docs/instruments.py."""
    monkeypatch.syspath_prepend(str(repo_root / "docs"))
    instruments = importlib.import_module("instruments")
    own = instruments.sheets()
    assert instruments.made(own) in instruments.PAGE.read_text(encoding="utf-8")
    for name in own:
        assert (instruments.PICTURES / instruments.picture(name)).exists()


def test_each_law_says_where_it_is_tested_and_what_it_goes_through() -> None:
    """Claim: flat targets but where a scene or noise alone is meant; the laser's light, the peak as it is chosen or the
    fit, the pulse, or targets; one rangefinder but for departures and centroids; and a statement in sentences."""
    light = ("true_ranges", "spot_position", "spot_width", "link_budget", "sunlight", "snr")
    scenes = {"coverage": "scene", "tof_coverage": "scene", "uneven": "signals", "centroid": "signals"}
    through = dict.fromkeys(light, "light") | {"tof_coverage": "pulse", "centroid": "targets"}
    through |= dict.fromkeys(
        ("cramer_rao", "departures", "tof_range", "tof_bound", "tof_sigma", "tof_walk"), "built-in"
    )
    positions = ("points", "sigma_synchronisation", "speckle_limit", "covariance", "pose")
    needs = dict.fromkeys(positions, ("position",)) | dict.fromkeys(("sigma_shot", "sigma_read"), ("sigma",))
    whose: dict[str, str | None] = {"true_ranges": None, "departures": None, "centroid": None}
    assert len({law.name for law in LAWS}) == len(LAWS) == 25
    for law in LAWS:
        assert law.scene == scenes.get(law.name, "target"), law.name
        assert law.exercises == through.get(law.name, "peak"), law.name
        assert law.needs == needs.get(law.name, ()), law.name
        assert law.of_built == (law.name == "departures")
        usual = "tof" if law.name.startswith("tof_") else "triangulation"
        assert law.rangefinder == whose.get(law.name, usual), law.name
        assert law.statement.endswith("."), law.name
        assert not law.title.endswith("."), law.name
