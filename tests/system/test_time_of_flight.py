"""Time of flight from the scenario to the layers: ranges, their σ, fusion, background, and the same bytes.

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from claims import at_most
from PIL import Image
from typer.testing import CliRunner

from scanner_sim import load_scenario, simulate
from scanner_sim.cli import app
from scanner_sim.config import scenario_from_text, scenario_warnings
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.channels import MEASURED_BY, channels_by
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.simulate import simulate_voxel
from scanner_sim.instrument.simulate_signals import simulate_waveforms
from scanner_sim.instrument.time_of_flight import fitted_pulse
from scanner_sim.optics.band_irradiance import band_irradiance
from scanner_sim.optics.filter import peak_transmission
from scanner_sim.products.files.contents import planned_files
from scanner_sim.products.files.exr import read_range_image
from scanner_sim.products.files.signal_files import read_signals
from scanner_sim.products.image import RangeImage
from scanner_sim.products.waveforms import WaveformSet
from scanner_sim.ranging.fusion import crossing_distance
from scanner_sim.ranging.time_of_flight import range_from_delay

pytestmark = pytest.mark.usefixtures("device")

SILENT_MIRRORS = "mirrors: {jitter: 0 rad, wobble: 0 rad, synchronisation: 0 rad}"
NOISELESS = "noise: {shot: false, amplifier: false, saturation: false, quantisation: false, clock: false}"


def wall(
    distance: float, ranging: str, scanner: str = "", *, size: int = 24, tilt: float = 0.0, more: str = ""
) -> Scenario:
    """Return a scenario before a wall."""
    side = 2.0 * distance
    return scenario_from_text(
        f"""\
schema: 1
seed: 5
ranging: {ranging}
scanner: {{{scanner}}}
scene:
  objects:
    - {{name: wall, shape: rectangle, size: [{side} m, {side} m], position: [0 m, 0 m, {distance} m],
       rotation: {{axis: y, angle: {tilt} deg}}, material: {{reflectance: 0.5}}}}
scan: {{type: raster, rows: {size}, columns: {size}, horizontal: [-9 deg, 9 deg], vertical: [-7 deg, 7 deg]}}
{more}
""",
        name="wall.yaml",
    )


def same(one: RangeImage, other: RangeImage) -> bool:
    return all(one[name].tobytes() == other[name].tobytes() for name in one.channels)


def layers(image: RangeImage, prefix: str) -> dict[str, Any]:
    return {name: image[prefix + name] for name in ("range_m", "sigma_range_m", "P.X", "P.Z", "status")}


@pytest.mark.parametrize("place", ["coaxial", "offset"])
@pytest.mark.parametrize(("distance", "tilt"), [(2.5, 20.0), (18.0, 0.0), (200.0, 0.0)])
def test_ranges_without_noise_are_the_true_ones(distance: float, tilt: float, place: str) -> None:
    """Claim: noise-free ranges lie within 20 µm of the truth to 20 m, and 2e-6 of it to 200 m.

    Set-up: walls through the whole scenario, every noise off. Expected: the chief ray's range. Tolerance: that,
    and half a step of the float32 in which both layers are kept. The offset field is wide enough to see 2.5 m.
    """
    unit = f"digitiser: {{gate: [1 m, {1.2 * distance} m]}}"
    diode = f"photodiode: {{place: {place}, field_of_view: 0.15 rad, {NOISELESS}}}"
    image = simulate(wall(distance, "tof", f"{SILENT_MIRRORS}, lidar: {{{diode}, {unit}}}", tilt=tilt))
    assert image.valid.all()
    error = np.abs(image["range_m"].astype(float) - image["truth.range_m"])
    assert error.max() < max(20e-6, 2e-6 * distance) + float(np.spacing(np.float32(distance)))


@pytest.fixture(scope="module")
def plane(device: object) -> RangeImage:
    """A plane at 12 m, where both ways are of like precision, with the default's allowance for misfits in σ.

    Without the pixels' fixed pattern: σ has its share in it, but it is the same for all voxels of a plane.
    """
    scanner = f"{SILENT_MIRRORS}, position_sensor: {{noise: {{prnu: false}}}}"
    # One voxel far off makes mixed ones of all about it, which happens to some of a thousand.
    more = "processing: {validation: {mixed: null}}"
    return simulate(wall(12.0, "both", scanner, size=128, more=more))


@pytest.mark.parametrize("prefix", ["tof.", "fused."])
def test_sigma_covers_the_error(plane: RangeImage, prefix: str) -> None:
    """Claim: (estimate − truth)/σ has a standard deviation of 1 and no mean.

    Set-up: 16 384 voxels of a plane. Expected: 1 ± 0.05 (its own standard error is 0.0055), and
    a mean within 0.04, 5 standard errors of 0.0078. Ranges disagree, and one is left out, for one voxel of 10⁴.
    """
    pull = (plane[prefix + "range_m"] - plane["truth.range_m"]) / plane[prefix + "sigma_range_m"]
    refused = at_most(int((~np.isfinite(pull)).sum()), pull.size, 1e-4)
    assert refused, refused
    assert np.nanstd(pull) == pytest.approx(1.0, abs=0.05)
    assert abs(np.nanmean(pull)) < 0.04


def test_points_are_covered_too(plane: RangeImage) -> None:
    """Claim: σ of z covers its error. The true point is that of the true deflections; 1 ± 0.05 as above."""
    d_g, r, phi = 50e-3, plane["truth.range_m"].astype(float), plane["truth.phi_rad"]
    z = d_g + (r * np.cos(plane["truth.theta_rad"]) - d_g) * np.cos(phi)
    for prefix in ("tof.", "fused."):
        pull = (plane[prefix + "P.Z"] - z) / plane[prefix + "sigma_z_m"]
        assert np.nanstd(pull) == pytest.approx(1.0, abs=0.05)


def test_fused_is_as_good_as_the_better(plane: RangeImage) -> None:
    """Claim: the fused σ is never worse than the better of both by more than 2 %, stated and found."""
    better = np.fmin(plane["sigma_range_m"], plane["tof.sigma_range_m"])
    assert (plane["fused.sigma_range_m"] <= 1.02 * better)[plane["fused.status"] == 0].all()
    spread = [
        np.nanstd(plane[prefix + "range_m"] - plane["truth.range_m"]) for prefix in ("", "tof.", "fused.")
    ]
    assert spread[2] <= 1.02 * min(spread[:2])


@pytest.mark.slow
def test_the_ways_cross_where_the_closed_form_says() -> None:
    """Claim: stated σ of both are equal at R = √(σ_TOF f d/Δp).

    Set-up: planes from 8 to 24 m at a narrow field about the axis; where the two curves of median σ cross, by
    interpolation. Expected: the closed form with σ_TOF and Δp found there. Tolerance 2 %: interpolation and the field.
    """
    distances = np.array([8.0, 12.0, 16.0, 24.0])
    sigmas = []
    for distance in distances:
        image = simulate(wall(float(distance), "both", size=16))
        sigmas.append(
            [np.nanmedian(image[name]) for name in ("sigma_range_m", "tof.sigma_range_m", "sigma_peak_px")]
        )
    triangulation, timed, peak = np.array(sigmas).T
    ratio = np.log(triangulation / timed)
    assert ratio[0] < 0.0 < ratio[-1]
    crossing = np.exp(np.interp(0.0, ratio, np.log(distances)))
    at_crossing = np.exp(np.interp(0.0, ratio, np.log(peak))) * 50e-6
    # The synchronisation error of 1 µrad is an error of the position, too.
    at_crossing = np.hypot(at_crossing, 0.1 * 1e-6)
    expected = crossing_distance(float(np.median(timed)), 0.1, 0.2, at_crossing)
    assert crossing == pytest.approx(float(expected), rel=0.02)


def test_the_curve_is_flat_within_its_floor() -> None:
    """Claim: from 1 to 30 m σ of time of flight stays within 10 % of the clock's 10 mm floor (Figure 12)."""
    for distance in (1.0, 5.0, 15.0, 30.0):
        image = simulate(wall(distance, "tof", size=8))
        assert np.median(image["sigma_range_m"]) == pytest.approx(10.04e-3, rel=0.1)


@pytest.fixture(scope="module")
def module(repo_root: Path) -> Scenario:
    """A module with relief and edges, with two bounces."""
    size = ["scan.rows=24", "scan.columns=30", "transport.bounces=2", "ranging=both"]
    return load_scenario(repo_root / "configs" / "node_512.yaml", size)


@pytest.fixture(scope="module")
def whole(device: object, module: Scenario) -> RangeImage:
    return simulate(module, device="cpu")


@pytest.mark.slow
@pytest.mark.parametrize("batch", [97, 400])
def test_any_batch_gives_the_same_bytes(module: Scenario, whole: RangeImage, batch: int) -> None:
    assert same(simulate(module, device="cpu", batch=batch), whole)


@pytest.mark.slow
def test_the_bench_works_in_parts(
    module: Scenario, whole: RangeImage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scanner_sim.instrument.time_of_flight._SAMPLES_TOGETHER", 256 * 50)
    assert same(simulate(module, device="cpu"), whole)


@pytest.mark.slow
def test_either_way_alone_is_what_it_is_in_both(module: Scenario) -> None:
    """Truth, and each way's ranges where nothing was refused, do not depend on the other way.

    Without the refusal of mixed voxels: those have neighbours, who may be refused because both ways disagree.
    """
    lenient = module.processing.validation.model_copy(
        update={"mixed": None, "uneven": False, "isolated": None}
    )
    module = module.model_copy(
        update={"processing": module.processing.model_copy(update={"validation": lenient})}
    )
    whole = simulate(module, device="cpu")
    for ranging, prefix in (("triangulation", ""), ("tof", "tof.")):
        alone = simulate(module.model_copy(update={"ranging": ranging}), device="cpu")
        for name in ("truth.range_m", "truth.theta_rad", "truth.object"):
            assert alone[name].tobytes() == whole[name].tobytes()
        there = whole[prefix + "status"] != Status.INCONSISTENT
        for name, values in layers(whole, prefix).items():
            np.testing.assert_array_equal(alone[name][there], values[there])
        assert set(alone.channels) == {channel.name for channel in channels_by([ranging])}


@pytest.mark.slow
def test_disagreement_refuses_one(whole: RangeImage) -> None:
    """At edges the two ways see different mixtures: one of them is refused, the fused range is the other's."""
    for way in ("", "tof."):
        refused = whole[way + "status"] == Status.INCONSISTENT
        other = "tof." if way == "" else ""
        kept = refused & (whole[other + "status"] == 0)
        np.testing.assert_array_equal(whole["fused.range_m"][kept], whole[other + "range_m"][kept])
    for status, names in MEASURED_BY.items():
        # Common errors are there where a calibration has them.
        for name in set(names) & set(whole.channels):
            assert np.isnan(whole[name][whole[status] != 0]).all()


def test_background_is_the_light_of_a_sunlit_wall() -> None:
    """Claim: the light on the photodiode is L A Ω T, with L = E ρ cosζ/π of a wall in the Sun.

    Set-up: a wall that fills the field, the Sun 30° off its normal, a filter of 30 nm; both places of the receiver.
    Expected: the closed form. Tolerance 1 %: the field's square against the circle is exact on an even wall, and the
    wall's own indirect light is nothing.
    """
    sun = "lighting: {sun: {direction: [0.5, 0, -0.8660254]}, earth: none}"
    for place in ("coaxial", "offset"):
        scenario = wall(10.0, "tof", f"lidar: {{photodiode: {{place: {place}}}}}", size=8, more=sun)
        image = simulate(scenario)
        scanner = scenario.scanner
        assert scenario.lighting.sun != "none"
        inside, outside = band_irradiance(
            scenario.lighting.sun,
            scanner.filter,
            scanner.lidar.photodiode.response,
            scanner.laser.wavelength,
        )
        radiance = 0.5 * np.cos(np.deg2rad(30.0)) / np.pi * float(inside + outside)
        solid_angle = np.pi / 4.0 * scanner.lidar.photodiode.field_of_view**2
        area = np.pi / 4.0 * scanner.receiver.aperture**2
        expected = (
            radiance * area * solid_angle * scanner.receiver.transmission * peak_transmission(scanner.filter)
        )
        np.testing.assert_allclose(image["tof.background_w"], expected, rtol=0.01)


def test_what_cannot_be_is_said_at_the_door() -> None:
    for more, words in (
        ("scanner: {lidar: {pulse: {repetition_rate: 5 kHz}}}", "without one"),
        ("processing: {pulse: {level: 1 A}}", "not below"),
        ("processing: {range_gate: [40 m, 50 m]}", "records"),
        ("output: {waveforms: [[24, 0]]}", "outside of the 24"),
        ("output: {waveforms: some}", "all"),
    ):
        with pytest.raises(ScenarioError, match=words):
            scenario_from_text(
                "schema: 1\nranging: tof\n"
                "scan: {type: raster, rows: 24, columns: 24, horizontal: [-9 deg, 9 deg], vertical: [-7 deg, 7 deg]}\n"
                f"{more}\n",
                name="bad.yaml",
            )
    with pytest.raises(ScenarioError, match="no waveforms"):
        wall(5.0, "triangulation", more="output: {waveforms: all}")


def test_doubts_speak_of_time_of_flight() -> None:
    assert not scenario_warnings(wall(10.0, "tof"))
    deep = scenario_warnings(wall(60.0, "tof", "lidar: {pulse: {repetition_rate: 3 MHz}}"))
    (sentence,) = deep
    assert "scanner.lidar.digitiser.gate records, 0.5 m to 35 m" in sentence
    assert "a surface at 10.03 m, as the pulses repeat every 49.97 m" in sentence


@pytest.mark.slow
def test_the_command_line_writes_waveforms_and_draws_them(repo_root: Path, tmp_path: Path) -> None:
    """The waveforms of the file are those of the voxels, and their delays those of the image."""
    size = [
        "--set",
        "scan.rows=16",
        "--set",
        "scan.columns=20",
        "--set",
        "output.waveforms=[[3, 4], [9, 11]]",
        "--set",
        "processing.validation.mixed=null",
    ]
    for name, pictures in (
        ("tof_both", ["voxel_9_11.png", "waveform_9_11.png"]),
        ("tof_node", ["waveform_9_11.png"]),
    ):
        out = tmp_path / name
        run = ["run", str(repo_root / "configs" / f"{name}.yaml"), "-o", str(out), "--device", "cpu"]
        result = CliRunner().invoke(app, run + size)
        assert result.exit_code == 0, result.output
        waveforms = read_signals(out / "waveforms.parquet", WaveformSet)
        assert list(zip(waveforms.row, waveforms.column, strict=True)) == [(3, 4), (9, 11)]
        image = read_range_image(out / "range.exr")
        for number, (row, column) in enumerate(zip(waveforms.row, waveforms.column, strict=True)):
            found = image["tof.range_m"][row, column]
            wanted = range_from_delay(waveforms.delay[number], 0.0)
            np.testing.assert_allclose(found, wanted, rtol=1e-6)
        with Image.open(out / "tof.png") as picture:
            assert picture.size == (20, 16)
            np.testing.assert_array_equal(np.asarray(picture) > 0, np.isfinite(image["tof.range_m"]))
        shown = CliRunner().invoke(app, ["show", str(out), "--voxel", "9", "11", "--device", "cpu"])
        assert shown.exit_code == 0, shown.output
        assert "range by time of flight" in shown.stdout
        assert all((out / picture).exists() for picture in pictures)
        assert (out / "voxel_9_11.png").exists() == (name == "tof_both")


def test_all_waveforms_are_the_chosen_ones_in_order() -> None:
    scenario = wall(6.0, "tof", size=5)
    every = simulate_waveforms(scenario)
    some = simulate_waveforms(scenario, [(4, 1), (0, 3)])
    np.testing.assert_array_equal(every.number[[21, 3]], some.number)
    assert (every.row[21], every.column[21]) == (4, 1)
    with pytest.raises(InputError, match="outside"):
        simulate_waveforms(scenario, [(5, 0)])
    with pytest.raises(InputError, match="no waveforms"):
        simulate_waveforms(wall(6.0, "triangulation", size=5))
    with pytest.raises(InputError, match="waveform instead"):
        simulate_voxel(scenario, 0, 0)


def test_the_fitted_pulse_lies_on_the_waveform() -> None:
    """Within 2 % of its height on a wall that faces the scanner, where the echo is the pulse itself."""
    scenario = wall(12.0, "tof", size=5)
    waveforms = simulate_waveforms(scenario, [(2, 2)])
    fit = fitted_pulse(scenario.scanner.lidar, waveforms, 0)
    assert fit is not None
    near = (waveforms.time > fit[0][0]) & (waveforms.time < fit[0][-1])
    measured = waveforms.number[0] * waveforms.step
    assert np.abs(np.interp(waveforms.time[near], *fit) - measured[near]).max() < 0.02 * measured.max()


def test_charge_is_that_of_the_link_budget() -> None:
    """Claim: tof.Y = R₀ E T T_f ρ A/(π R²)/q of a grey wall (eq 19 for a pulse).

    Tolerance 1 %: the wall's cosine over the beam and the pulse's spread. Speckle and noise are off.
    """
    scenario = wall(10.0, "tof", f"laser: {{speckle: false}}, lidar: {{photodiode: {{{NOISELESS}}}}}", size=9)
    scanner = scenario.scanner
    share = (
        0.5 * np.pi / 4.0 * scanner.receiver.aperture**2 / (np.pi * 10.0**2) * scanner.receiver.transmission
    )
    share *= peak_transmission(scanner.filter)
    expected = (
        scanner.lidar.photodiode.responsivity * scanner.lidar.pulse.pulse_energy * share / 1.602176634e-19
    )
    assert simulate(scenario)["tof.Y"][4, 4] == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_under_the_sun_the_planned_files_are_written(repo_root: Path, tmp_path: Path) -> None:
    """With time of flight alone there is no background of the line to draw; the camera still takes its picture."""
    config = repo_root / "configs" / "lighting_normal.yaml"
    size = [
        "scan.rows=8",
        "scan.columns=8",
        "camera.interior={columns: 48, rows: 36, pixel_pitch: 130 um}",
        "transport.background_bounces=2",
    ]
    # Rows that lie close together: sparse ones get many more paths each.
    size += ["scan.vertical=[-0.2 deg, 0.2 deg]"]
    for ranging in ("tof", "both"):
        out = tmp_path / ranging
        changes = [part for change in (*size, f"ranging={ranging}") for part in ("--set", change)]
        result = CliRunner().invoke(app, ["run", str(config), "-o", str(out), "--device", "cpu", *changes])
        assert result.exit_code == 0, result.output
        scenario = load_scenario(config, [*size, f"ranging={ranging}"])
        written = {path.name for path in out.iterdir()}
        assert written == set(planned_files(scenario.output, lit=True, rangefinders=scenario.rangefinders))
        assert ("background.png" in written) == (ranging == "both")
        assert (read_range_image(out / "range.exr")["tof.background_w"] > 0.0).any()
