"""The instrument as built: each departure moves the point as the judge's closed form has it, and 0 moves nothing."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from claims import mean, mean_square
from numpy.typing import NDArray

from scanner_sim import (
    Instrument,
    Scenario,
    load_scenario,
    parameter_jacobian,
    simulate,
    simulate_lines,
    simulate_many,
    track,
    track_many,
)
from scanner_sim.analytic.instrument_errors import EFFECTS, Sighted
from scanner_sim.config import resolved_yaml, scenario_from_text
from scanner_sim.config.built import drawn_departures, instrument_as_built, scanner_as_built
from scanner_sim.config.calibration import calibration_text, design_of
from scanner_sim.config.scanner import Scanner
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.instrument.together import alike, takes_seeds
from scanner_sim.instrument.voxel_records import voxel_record
from scanner_sim.optics.as_built import AsBuilt
from scanner_sim.optics.vibration import Vibration
from scanner_sim.products.formats.cloud import cloud_of_track
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.ranging.ranges import Deflections, ranged_peaks
from scanner_sim.tracking.record import TrackStatus

Array = NDArray[np.float64]

F, BASE, D, PERIOD = 0.1, 0.2, 0.05, 0.3
QUIET: dict[str, Any] = {
    "laser": {"speckle": False},
    "mirrors": dict.fromkeys(
        ("jitter", "wobble", "synchronisation", "readout_noise", "readout_step"), 0.0
    ),
    "position_sensor": {
        "height": 2e-3,
        "full_well": 1e12,
        "adc_bits": 24,
        "noise": dict.fromkeys(("shot", "read", "prnu", "saturation", "quantisation"), False),
    },
    "lidar": {
        "digitiser": {"bits": 24},
        "photodiode": {"noise": dict.fromkeys(("shot", "amplifier", "clock", "saturation", "quantisation"), False)},
    },
}  # fmt: skip
"""No noise, light enough of each pulse for a fine timing, and pixels so high that no light misses them."""
VALUES = {
    "base": 2e-3, "focal_length": 1e-3, "axis_separation": 2e-3, "axis_offset": 2e-3, "axis_skew": 2e-3,
    "theta_zero": 1e-3, "phi_zero": 1e-3, "theta_scale": 5e-3, "phi_scale": 5e-3, "theta_cubic": 2e-2,
    "phi_cubic": 2e-2, "theta_sine": 1e-3, "theta_cosine": 1e-3, "phi_sine": 1e-3, "phi_cosine": 1e-3,
    "array_offset": 2e-5, "array_scale": 5e-3, "array_tilt": 5e-2, "radial_1": 1.0, "radial_2": 2.0,
    "tangential": 5e-2, "tof_zero": 2e-2, "tof_scale": 5e-3,
}  # fmt: skip
LEAST = 4e-6
"""What single precision leaves of a point at 6 m, and the estimator's bias of half a thousandth of a pixel [m]: see
the test."""


def scenario(ranging: str = "triangulation", **as_built: Any) -> Scenario:
    scanner = copy.deepcopy(QUIET) | ({"as_built": as_built} if as_built else {})
    return load_scenario(
        {
            "schema": 1,
            "ranging": ranging,
            "scanner": scanner,
            "scene": {
                "objects": [
                    {"shape": "rectangle", "name": "wall", "material": "grey_reference", "position": [0, 0, 2.5],
                     "size": [9.0, 9.0]}
                ]
            },
            "scan": {"type": "raster", "rows": 5, "columns": 5, "horizontal": [-0.35, 0.35], "vertical": [-0.35, 0.35]},
            "output": {"truth": ["point"]},
            "processing": {"peak": "gaussian", "validation": {"uneven": False, "shape": False}},
        }
    )  # fmt: skip


def errors_of(found: Scenario) -> tuple[Array, Sighted]:
    """Return measured less true points of beams that stand still, and the true points as the judge wants them."""
    bench = Instrument(found)
    theta, phi = (
        angles.ravel() for angles in np.meshgrid(np.linspace(-0.35, 0.35, 5), np.linspace(-0.33, 0.36, 5))
    )
    samples = bench.measure(bench.aim(theta, phi))
    assert not samples["status"].any()
    measured, true = (
        np.stack([samples[f"{of}.{axis}"] for axis in "XYZ"], axis=1).astype(np.float64)
        for of in ("P", "truth.P")
    )
    r, theta, phi = (
        samples[f"truth.{name}"].astype(np.float64) for name in ("range_m", "theta_rad", "phi_rad")
    )
    return measured - true, Sighted(r, theta, phi, F, BASE, D, PERIOD)


@cache
def as_designed(ranging: str) -> tuple[Array, Sighted]:
    return errors_of(scenario(ranging))


@pytest.mark.parametrize(("ranging", "name"), [(way, name) for way in EFFECTS for name in EFFECTS[way]])
def test_each_departure_moves_the_point_as_the_judge_says(ranging: str, name: str) -> None:
    """Claim: with all noise off, half the difference of +v and −v is v times the closed form, to 1 % of its largest.

    The second order falls out of the difference; the third is below v², 6e-5 of the effect for the largest v (5e-3) and
    2.5e-3 for the array's tilt of 50 mrad. What the estimator errs on a spot at another part of its pixel stays: a
    thousandth of a pixel, 15 µm of range at 2.5 m, and as much of a pulse.
    """
    value = VALUES[name]
    period = {"encoder_period": PERIOD} if "sine" in name else {}
    (above, _), (below, _) = (
        errors_of(scenario(ranging, **{name: sign * value}, **period)) for sign in (1.0, -1.0)
    )
    _, seen = as_designed(ranging)
    wanted = EFFECTS[ranging][name](seen) * value
    np.testing.assert_allclose(
        0.5 * (above - below), wanted, rtol=0.0, atol=0.01 * np.abs(wanted).max() + LEAST
    )


@pytest.mark.parametrize("name", ["axis_offset", "axis_skew", "axis_separation"])
def test_mirrors_are_as_built_without_a_line_sensor_too(name: str) -> None:
    """Claim: pulses alone measure what they measure beside a line sensor, of axes that stand 2 mm or mrad off."""
    beside = scenario("tof", **{name: VALUES[name]})
    (found, _), (wanted, _) = (
        errors_of(one) for one in (beside.replace({"scanner.position_sensor": "none"}), beside)
    )
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=LEAST)
    assert np.abs(found - as_designed("tof")[0]).max() > 5e-4


def image_of(r: Array, read: Array, own: Mapping[str, float]) -> Array:
    """Return the pixels on which points at ranges [m] lie whose beams' encoders read so [rad]: the table of departures
    of *The error model* in double precision."""
    z, k, c, a, b = (own.get(f"theta_{name}", 0.0) for name in ("zero", "scale", "cubic", "sine", "cosine"))
    turn = 2.0 * np.pi * read / PERIOD
    theta = read + z + k * read + c * read**3 + a * np.sin(turn) + b * np.cos(turn)
    base, tilt = BASE + own.get("base", 0.0), own.get("array_tilt", 0.0)
    x = base * np.cos(theta) / (r - base * np.sin(theta))
    k_1, k_2, p_2 = (own.get(name, 0.0) for name in ("radial_1", "radial_2", "tangential"))
    x = x * (1.0 + k_1 * x**2 + k_2 * x**4) + 3.0 * p_2 * x**2
    place = (F + own.get("focal_length", 0.0)) * x / (np.cos(tilt) - np.sin(tilt) * x)
    sensor, wider = scenario().scanner.position_sensor, 1.0 + own.get("array_scale", 0.0)
    start = sensor.offset * wider + own.get("array_offset", 0.0)
    return np.asarray((place - start) / (sensor.pitch * wider) - 0.5)


@pytest.mark.parametrize(
    "name",
    ["base", "focal_length", "array_offset", "array_scale", "array_tilt", "radial_1", "tangential", "theta_scale", ""],
)  # fmt: skip
def test_the_true_peak_is_where_the_light_falls(name: str) -> None:
    """Claim: ``truth.peak_px`` is the image of the true point by the departures' own equations, and the centroid of the
    light on the pixels, both to 0.002 pixel, as single precision and the beam's width leave them; for all departures at
    once (the last) that of a voxel's record as well. An instrument as designed would have it 0.05 pixel or more aside.
    """
    own = {name: VALUES[name]} if name else {key: 0.3 * value for key, value in VALUES.items()}
    more = {} if name else {"encoder_period": PERIOD, "tangential_across": 0.02, "field_blur": 2e-5}
    found = scenario(**own, **more).replace({"scan.motion": "stepped"})
    lines = simulate_lines(found, [(row, column) for row in (0, 4) for column in range(5)])
    r, read, true = (
        lines[name].astype(np.float64) for name in ("truth.range_m", "theta_rad", "truth.peak_px")
    )
    np.testing.assert_allclose(true, image_of(r, read, own), atol=2e-3)
    light = lines["laser_w"].astype(np.float64)
    np.testing.assert_allclose(true, light @ np.arange(lines.samples) / light.sum(axis=1), atol=2e-3)
    assert np.abs(true - image_of(r, read, {})).max() > 0.05
    if not name:
        record = voxel_record(Instrument(found), 4, 1)
        assert record.truth_peak_px == pytest.approx(true[6], abs=1e-6)


@pytest.mark.parametrize("off", [0.0, 0.3])
@pytest.mark.parametrize("lit", [False, True])
def test_an_expected_line_is_the_mean_of_those_that_are_measured(off: float, lit: bool) -> None:
    """Claim: with all departures, stray light of 5 % and all noise but speckle and unlike pixels, charges scatter
    about ``expected`` by shot and read noise, dark charge and rounding, and so does their mean.

    Set-up: 36 lines of 256 pixels, half of which see a lit wall, in the dark and under the Sun, with and without an
    exposure without the laser, whose light and read noise count for its scale.
    """
    moving = {"turn": [[5.0, 1e-10], [100.0, 1e-12]], "shift": [[5.0, 1e-10], [100.0, 1e-12]]}
    more = {"tangential_across": 0.02, "field_blur": 2e-5, "base_expansion": 1e-4, "focal_expansion": 1e-4}
    own = (
        KNOWN
        | more
        | {"stray_light": 0.05, "power_noise": 0.05, "vibration": moving, "encoder_period": PERIOD}
    )
    scanner = {"as_built": own, "laser_off": off, "laser": {"speckle": False}}
    wall = {"shape": "rectangle", "name": "wall", "material": "grey_reference", "position": [0, 0, 4.0]}
    found = noisy().replace(
        {
            "ranging": "triangulation",
            "scene.objects": [wall | {"size": [0.3, 0.3]}],
            "scanner": scanner | {"position_sensor": {"noise": {"prnu": False}}},
            "lighting": {"sun": {"direction": (0.3, -0.4, -0.85)}} if lit else {},
        }
    )
    lines, sensor = simulate_lines(found), found.scanner.position_sensor
    numbers = lines.about.numbers
    floor = sensor.read_noise**2 + numbers["dark_electron"] + numbers["electrons_per_number"] ** 2 / 12.0
    beneath = 0.0 * lines.charge
    if lit:
        around = lines["background_w"] * numbers["electrons_per_watt"]
        beneath = 0.95 * around + 0.05 * around.mean(axis=1, keepdims=True)
    variance = lines.expected + floor
    if off:
        dark_floor = floor - numbers["dark_electron"] * (1.0 - 0.3 / 0.7)
        variance = variance + beneath + (0.7 / 0.3) ** 2 * (beneath * 0.3 / 0.7 + dark_floor)
    z = ((lines.charge - lines.expected) / np.sqrt(variance))[lines.number < sensor.largest_number]
    assert mean(z)
    assert mean_square(z)


KNOWN = {name: 0.3 * value for name, value in VALUES.items()} | {"array_tilt": 5e-3}


def calibrated(
    found: Scenario, folder: Path, values: Mapping[str, float], covariance: Array | None = None
) -> Scenario:
    """Return a scenario whose instrument has a calibration with some values."""
    given = np.array([values.get(name, 0.0) for name in NAMES])
    spread = np.zeros((len(NAMES), len(NAMES))) if covariance is None else covariance
    own = Calibration(given, spread, design_of(found.scanner), PERIOD)
    (folder / "calibration.yaml").write_text(calibration_text(own, found.scanner), encoding="utf-8")
    return found.replace({"processing.calibration": str(folder / "calibration.yaml")})


@pytest.mark.parametrize("ranging", EFFECTS)
def test_an_instrument_that_knows_itself_measures_as_one_that_is_as_designed(
    ranging: str, tmp_path: Path
) -> None:
    """Claim: of 11 to 24 mm by all parameters at once nothing is left where they are known: 10 µm, by the estimator."""
    found = scenario(ranging, encoder_period=PERIOD, **KNOWN)
    blind, _ = errors_of(found)
    seeing, _ = errors_of(calibrated(found, tmp_path, KNOWN))
    assert np.abs(blind).max() > 5e-3
    np.testing.assert_allclose(seeing, as_designed(ranging)[0], atol=1e-5)


def test_the_search_has_ranges_on_the_pixels_by_which_they_are_read(tmp_path: Path) -> None:
    """Claim: of an instrument that knows all of its departures the pixel at which the search expects a range is that of
    the departures' own equations, to 1e-6, and the range of the peak there, by the search and as it is measured, is the
    range again to 1 µm. By the design it is 23 mm off at 2 to 9 m."""
    bench = Instrument(calibrated(scenario(encoder_period=PERIOD, **KNOWN), tmp_path, KNOWN))
    r, theta, none = np.array([2.0, 2.5, 4.0, 9.0]), np.array([0.3, -0.3, 0.1, 0.0]), np.zeros(4)
    spot, turned = bench.triangulation.spot, (np.sin(theta), np.cos(theta))
    pixel = np.asarray(spot.pixel(r, *turned))
    own = {name: value for name, value in KNOWN.items() if not name.startswith("theta_")}
    np.testing.assert_allclose(pixel, image_of(r, theta, own), atol=1e-6)
    np.testing.assert_allclose(spot.range(pixel, *turned), r, atol=1e-6)
    read = Deflections(theta, none, none, none)
    found = ranged_peaks(pixel, none, none.astype(np.uint32), read, bench.geometry, None)
    np.testing.assert_allclose(found.range, r, atol=1e-6)
    designed = Instrument(scenario()).triangulation.spot.pixel(r, *turned)
    blind = ranged_peaks(np.asarray(designed), none, none.astype(np.uint32), read, bench.geometry, None)
    assert np.abs(blind.range - r).min() > 0.02


@pytest.mark.slow
def test_voxels_of_a_track_lie_where_a_calibrated_instrument_places_them(tmp_path: Path) -> None:
    """Claim: with axes that are known to be 2 mm farther, 1 mm beside the beam and 1 mrad askew, the median depth of a
    pattern's voxels on a plate at 4 m is the plate's to 20 µm; by the designed axes it would be 0.3 mm off."""
    own = {"axis_separation": 2e-3, "axis_offset": 1e-3, "axis_skew": 1e-3}
    target = {"name": "node", "array": {"diameter": 0.05, "plate": 0.2}, "position": [0.6, -0.9, 4.0]}
    told = scenario(**own).replace(
        {
            "scene": {"objects": [target]},
            "scan": {"type": "track", "targets": ["node"], "duration": 0.02},
            "output": {},
        }
    )
    made = track(calibrated(told, tmp_path, own))
    cloud = cloud_of_track(made)
    depth = cloud.points[cloud.valid, 2].astype(np.float64)
    assert len(depth) > 50
    assert abs(np.median(depth) - 4.0) < 2e-5
    samples = [getattr(made.records[0].samples, name)[0] for name in ("range", "theta", "phi", "status")]
    designed = coordinates(*(values[samples[3] == 0] for values in samples[:3]), D)[2]
    assert abs(np.median(designed) - 4.0) > 2e-4


def test_departures_are_drawn_by_the_seed_of_the_instrument() -> None:
    """Each parameter has numbers of its own: one more tolerance changes no other, and the seed of the light counts."""
    drawn = scenario(base={"tolerance": "1 mm"}, theta_zero={"tolerance": "50 urad"}, phi_zero="20 urad")

    def parameters(found: Scenario) -> Array:
        built = instrument_as_built(found)
        assert built is not None
        return built.parameters

    first = parameters(drawn)
    assert first[INDEX["base"]] not in (0.0, 1e-3)
    assert first[INDEX["phi_zero"]] == 2e-5
    assert np.count_nonzero(first) == 3
    other = parameters(drawn.replace({"seed": 7}))
    assert other[INDEX["base"]] != first[INDEX["base"]]
    assert other[INDEX["phi_zero"]] == 2e-5
    np.testing.assert_array_equal(parameters(drawn.replace({"seed": 7, "scanner.as_built.seed": 0})), first)
    np.testing.assert_array_equal(parameters(drawn.replace({"seed": 7, "transport.light_seed": 0})), first)
    more = parameters(drawn.replace({"scanner.as_built.base": "1 mm", "scanner.as_built.tof_zero": "1 mm"}))
    assert more[INDEX["theta_zero"]] == first[INDEX["theta_zero"]]


def test_draws_have_the_tolerance_as_their_standard_deviation() -> None:
    built = AsBuilt.model_validate({"base": {"tolerance": 1e-3}, "tangential": {"tolerance": 0.2}})
    values = np.array([built.parameters(seed) for seed in range(2000)])
    assert mean_square(values[:, INDEX["base"]] / 1e-3)
    assert mean_square(values[:, INDEX["tangential"]] / 0.2)
    assert mean(values[:, INDEX["base"]])


def test_a_resolved_scenario_says_what_was_drawn_and_reads_as_before() -> None:
    drawn = scenario(base={"tolerance": "1 mm"}, phi_zero="20 urad")
    text = resolved_yaml(drawn)
    built = instrument_as_built(drawn)
    assert built is not None
    assert drawn_departures(drawn).keys() == {"base"}
    assert (
        f"# Truth: the instrument as built, drawn from its tolerances:\n#   base: {drawn_departures(drawn)['base']}"
        in text
    )
    number, unit = drawn_departures(drawn)["base"].split()
    metres = {"mm": 1e-3, "um": 1e-6, "nm": 1e-9}[unit]
    assert float(number) * metres == pytest.approx(built.value("base"), rel=1e-5)
    assert scenario_from_text(text, name="again") == drawn
    assert "# Truth" not in resolved_yaml(scenario(base="1 mm"))


def test_seeds_that_draw_other_instruments_do_not_go_together() -> None:
    """Runs that share a launch share its optics: with an instrument of its own each is measured alone."""
    drawn = scenario(base={"tolerance": "1 mm"})
    one, other = (drawn.replace({"seed": seed}) for seed in (1, 2))
    assert not takes_seeds(drawn)
    assert not alike(one, other)
    fixed = drawn.replace({"scanner.as_built.seed": 3})
    assert takes_seeds(fixed)
    alone = [simulate(found).channels["range_m"] for found in (one, other)]
    together = [image.channels["range_m"] for image in simulate_many([one, other])]
    np.testing.assert_array_equal(alone, together)
    assert np.nanmax(np.abs(alone[0] - alone[1])) > 1e-3


def noisy(**as_built: Any) -> Scenario:
    """Return a scenario with all the noise of the preset, and both rangefinders."""
    scanner = {"as_built": as_built} if as_built else {}
    return load_scenario(
        {
            "schema": 1, "ranging": "both", "scanner": scanner,
            "scene": {"objects": [
                {"shape": "rectangle", "name": "wall", "material": "grey_reference", "position": [0, 0, 4.0],
                 "size": [4.0, 4.0]}
            ]},
            "scan": {"type": "raster", "rows": 6, "columns": 6, "horizontal": [-0.02, 0.02], "vertical": [-0.02, 0.02]},
        }
    )  # fmt: skip


def test_nothing_departs_and_no_byte_changes() -> None:
    """An empty block, and zeros for everything, leave every layer of a noisy raster by both rangefinders as it is."""
    plain = simulate(noisy()).channels
    for block in ({"seed": 5}, dict.fromkeys((*NAMES, "power_noise", "stray_light", "field_blur"), 0.0)):
        found = simulate(noisy(**block)).channels
        assert found.keys() == plain.keys()
        for name, layer in plain.items():
            np.testing.assert_array_equal(found[name], layer, err_msg=name)


def test_the_power_of_the_laser_scatters_by_its_noise() -> None:
    """Claim: over 400 shots at one place the charge scatters by 5 % more than shot noise's 0.1 %."""
    quiet = scenario().scanner
    bench = Instrument(scenario(power_noise=0.05))
    signal = bench.measure(bench.aim(np.zeros(400), np.zeros(400)))["Y"]
    assert quiet.laser.power > 0.0
    assert mean_square((signal / signal.mean() - 1.0) / 0.05, freedom=399)


def test_stray_light_is_spread_over_all_pixels() -> None:
    """Claim: a share of 10 % leaves 90 % in the spot and puts 10 %/pixels of the whole on each pixel."""
    plain, veiled = (Instrument(found) for found in (scenario(), scenario(stray_light=0.1)))
    lines = []
    for bench in (plain, veiled):
        _, groups = bench.expose(bench.aim([0.0], [0.0]))
        (group,) = groups
        lines.append(group.light.line(0))
    whole = lines[0].sum()
    np.testing.assert_allclose(
        lines[1], 0.9 * lines[0] + 0.1 * whole / len(lines[0]), rtol=1e-3, atol=1e-6 * whole
    )


def test_base_and_focus_grow_with_the_temperature() -> None:
    """Claim: after an hour at 10 K/h what grows by 100 ppm/K is 0.1 % longer, and ranges read 0.1 % too short."""
    course = {
        "scanner.mirrors.temperature.rate": "10 K/h",
        "scanner.mirrors.drift_zero": "0 urad/K",
        "scanner.mirrors.drift_scale": "0 ppm/K",
    }
    for key in ("base_expansion", "focal_expansion"):
        bench = Instrument(scenario(**{key: 1e-4}).replace(course))
        cold, hot = (
            bench.measure(replace(bench.aim([0.0], [0.0]), time=np.array([time])))["range_m"][0]
            for time in (0.0, 3600.0)
        )
        assert hot - cold == pytest.approx(-1e-3 * cold, rel=0.01)


def test_vibration_has_the_spectrum_that_it_was_given() -> None:
    """Claim: band by band the mean power of turns and shifts is the integral of their spectra.

    Set-up: 20 instruments, ten instants each, farther apart than anything swings, of a density that falls as f⁻²
    and of one that is even. Expected: the variance of each axis is ∫ S df, in closed form. Axes are independent.
    """
    shaken = Vibration.model_validate(
        {"turn": [[10.0, 1e-10], [1000.0, 1e-14]], "shift": [[5.0, 1e-12], [50.0, 1e-12]]}
    )
    variances = np.repeat([1e-10 * 10.0 * (1.0 - 0.01), 1e-12 * 45.0], 3)
    apart = 97.3 * np.arange(10.0)
    moves = np.concatenate([shaken.motion(0.37 * seed + apart, seed) for seed in range(20)])
    assert mean_square(moves / np.sqrt(variances))
    np.testing.assert_allclose(shaken.deviations, np.sqrt(variances[[0, 3]]), rtol=1e-12)
    assert abs(np.corrcoef(moves.T) - np.eye(6)).max() < 5.0 / np.sqrt(200)
    time = np.arange(4096) / 4096.0
    # The window keeps what lies between the lines of a second from spreading over all of them.
    power = np.abs(np.fft.rfft(np.hanning(4096) * shaken.motion(time, 3)[:, 3])) ** 2
    assert power[60:].sum() < 0.01 * power[:60].sum()


def test_vibration_moves_the_scanner_and_no_reading() -> None:
    """Claim: a turn of the scanner by ω moves what it measures by −ω × P, to first order, and encoders read nothing."""
    found = scenario(vibration={"turn": [["20 Hz", "1e-8 rad^2/Hz"], ["40 Hz", "1e-8 rad^2/Hz"]]})
    own = found.scanner.as_built
    assert own is not None
    assert own.vibration is not None
    still, shaken = (Instrument(one) for one in (scenario(), found))
    theta = np.zeros(40)
    one, other = (bench.measure(bench.aim(theta, theta, first=0)) for bench in (still, shaken))
    turn = own.vibration.motion(still.aim(theta, theta).time, 0)
    # The wall stands across z: only turns about x and y that are not about the beam's own foot move its range, by
    # the second order; the truth says where the beam went.
    beam = np.stack([other[f"truth.P.{axis}"] for axis in "XY"], axis=1)
    np.testing.assert_allclose(beam, 2.5 * np.stack([turn[:, 1], -turn[:, 0]], axis=1), atol=5e-6)
    np.testing.assert_allclose(other["P.X"], one["P.X"], atol=2e-5)
    assert np.abs(turn[:, :2]).max() > 1e-4


DEPARTED = {"theta_zero": 3e-4, "phi_zero": -4e-4, "phi_scale": 2e-3, "axis_skew": 1e-3, "base": 2e-4}


def tracking(**as_built: Any) -> Scenario:
    """Return a run of a few visits to the targets of an array, in the noise of the preset."""
    node = {
        "name": "node",
        "position": [0.1, -0.2, 4.0],
        "array": {"diameter": 0.1, "plate": 0.2, "rows": 2, "columns": 2, "spacing": [0.4, 0.4]},
    }
    return load_scenario(
        {
            "schema": 1, "seed": 4, "scanner": {"as_built": as_built} if as_built else {},
            "scene": {"objects": [node]},
            "scan": {"type": "track", "targets": ["node"], "duration": 0.25},
        }
    )  # fmt: skip


def target_errors(found: Scenario) -> Array:
    """Return the errors of the points of followed targets."""
    records = [record for record in track(found).records if record.status == TrackStatus.MEASURED]
    assert len(records) > 4
    return np.array([record.point - record.truth_point for record in records])


def test_the_closed_loop_follows_the_true_instrument_and_believes_its_calibration(tmp_path: Path) -> None:
    """Claim: targets are off by what the departures make of them, and where these are known by noise alone.

    Set-up: 1.7 mm of zeros at 4 m and 4 mm of range by the base, against noise of some tenths and a millimetre. The
    calibration has σ as large as the departures: the covariance of every visit holds them, and they last.
    """
    blind = target_errors(tracking(**DEPARTED))
    assert np.abs(blind.mean(axis=0)[:2]).min() > 8e-4
    spread = np.diag([DEPARTED.get(name, 0.0) ** 2 for name in NAMES])
    seeing = calibrated(tracking(**DEPARTED), tmp_path, DEPARTED, spread)
    found = track(seeing)
    errors = np.array(
        [one.point - one.truth_point for one in found.records if one.status == TrackStatus.MEASURED]
    )
    plain = target_errors(tracking())
    assert np.abs(errors.mean(axis=0)[:2]).max() < 3e-4
    assert np.abs(errors.mean(axis=0) - plain.mean(axis=0)).max() < 1.5e-3
    last = [one for one in found.records if one.status == TrackStatus.MEASURED][-1]
    common = last.errors.common
    assert common.shape == (3, len(DEPARTED))
    sigma = np.sqrt((common**2).sum(axis=1))
    assert sigma[0] == pytest.approx(np.hypot(3e-4, 1e-3 * last.position[1]), rel=0.1)
    assert sigma[2] == pytest.approx(last.position[2] * 2e-4 / BASE, rel=0.1)
    assert (np.diagonal(last.covariance) > sigma**2).all()


def test_an_instrument_that_cannot_be_made_is_refused() -> None:
    drawn = scenario(base={"tolerance": "1 m"})
    draws = [drawn.replace({"scanner.as_built.seed": seed}) for seed in range(8)]
    lengths = [one.scanner.as_built.parameters(0)[INDEX["base"]] for one in draws]  # type: ignore[union-attr]
    with pytest.raises(InputError, match="the instrument as built has a base of -"):
        Instrument(draws[int(np.argmin(lengths))])


def test_runs_side_by_side_have_one_instrument() -> None:
    drawn = tracking(base={"tolerance": "1 mm"})
    with pytest.raises(InputError, match="each seed draws another instrument"):
        track_many([drawn, drawn.replace({"seed": 5})])


@pytest.mark.parametrize(
    ("block", "place", "said"),
    [
        ({"bas": "1 mm"}, "scanner.as_built.bas", "base"),
        ({"base": "1 urad"}, "scanner.as_built.base", "cannot be converted to m"),
        ({"base": {"tolerance": "-1 mm"}}, "scanner.as_built.base.tolerance", "0 m"),
        ({"base": {"tolerance": "1 mm", "mean": "1 mm"}}, "scanner.as_built.base.mean", "tolerance"),
        ({"base": "2 m"}, "scanner.as_built.base", "more than a departure"),
        ({"base": "-2 m"}, "scanner.as_built.base", "-2 m is more than a departure"),
        ({"theta_sine": "1 mrad"}, "scanner.as_built.encoder_period", "30 mrad"),
        (
            {"vibration": {"turn": [["5 Hz", "1e-12 rad^2/Hz"]]}},
            "scanner.as_built.vibration.turn",
            "two or more",
        ),
        (
            {"vibration": {"turn": [["5 Hz", "1e-12 m^2/Hz"], ["6 Hz", "1e-12 m^2/Hz"]]}},
            "turn[0][1]",
            "rad^2/Hz",
        ),
    ],
)
def test_faults_of_the_block_have_their_place_and_remedy(
    block: dict[str, Any], place: str, said: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario(**block)
    told = [f"{fault.problem} {fault.remedy}" for fault in caught.value.faults if place in fault.location]
    assert any(said in sentence for sentence in told), str(caught.value)


def test_derivatives_on_request_are_those_of_the_error_model(tmp_path: Path) -> None:
    """Claim: their sum with the calibration's covariance is the common part, and names are checked."""
    spread = np.diag(
        [VALUES[name] ** 2 if name in ("base", "phi_zero", "tof_zero") else 0.0 for name in NAMES]
    )
    image = simulate(calibrated(noisy(), tmp_path, {}, spread))
    effects = parameter_jacobian(image)
    assert list(effects.parameter.values) == ["base", "phi_zero", "tof_zero"]
    by_range = effects.range.values
    variance = np.einsum("rcp,pq,rcq->rc", by_range, effects.covariance.values, by_range)
    np.testing.assert_allclose(np.sqrt(variance), image.channels["sigma_common_m"], rtol=1e-5)
    pulses = parameter_jacobian(image, ["tof_zero", "base"], prefix="tof.")
    np.testing.assert_allclose(pulses.range.values[..., 0], -1.0)
    np.testing.assert_allclose(pulses.point.values[..., 1], 0.0)
    np.testing.assert_array_equal(pulses.covariance.values, effects.covariance.values[np.ix_([2, 0], [2, 0])])
    assert parameter_jacobian(simulate(noisy())).sizes["parameter"] == len(NAMES)
    with pytest.raises(InputError, match="no parameter 'bas'"):
        parameter_jacobian(image, ["bas"])
    with pytest.raises(InputError, match=r"no points under 'pulse\.'"):
        parameter_jacobian(image, prefix="pulse.")


def test_an_array_that_is_too_long_begins_farther_off() -> None:
    """Claim: a scale stretches pitch and beginning of the array, which is then moved; the second axis moves by itself.

    The light needs the lengths of base and lens, too: the receiver is the one as built.
    """
    scanner = Scanner(position_sensor={"offset": 2e-3, "pitch": 40e-6})
    values = dict.fromkeys(("base", "focal_length", "array_tilt"), 0.0)
    values |= {"array_scale": 0.01, "array_offset": 3e-5, "axis_separation": 1e-3}
    built: Any = SimpleNamespace(value=values.__getitem__)
    found = scanner_as_built(scanner, built)
    assert found.position_sensor.pitch == pytest.approx(40e-6 * 1.01)
    assert found.position_sensor.offset == pytest.approx(2e-3 * 1.01 + 3e-5)
    assert found.mirrors.axis_separation == pytest.approx(scanner.mirrors.axis_separation + 1e-3)
    assert found.receiver.baseline == pytest.approx(scanner.receiver.baseline)
    assert scanner_as_built(scanner, None) is scanner
