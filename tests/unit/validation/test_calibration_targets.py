"""The targets of the calibration of the peak, and what is made of the errors that they show."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim import load_scenario
from scanner_sim.analytic.geometry import point_from_shot
from scanner_sim.config.calibration import design_digest
from scanner_sim.foundation.errors import RunError
from scanner_sim.render.device import Device
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.validation.studies import calibrate

Array = NDArray[np.float64]
SCAN = {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}


def scenario(**parts: Any) -> Any:
    return load_scenario({"schema": 1, "scan": SCAN, **parts})


@pytest.mark.parametrize("most", [0.4, 0.8])
def test_each_target_stands_square_before_a_beam_of_its_own(most: float) -> None:
    """Claim: the middle of a target is the point of eq 3 at its range, Θ 0.06 and φ from 0.1 to 0.9 of the largest
    deflection, 0.5 rad at most; its face looks back along the beam; neighbours leave a twentieth of the way free."""
    known = scenario(scanner={"mirrors": {"max_deflection": most}})
    largest = min(most, 0.5)
    ranges = 7.0 + 1e-3 * np.arange(6.0)
    separation = known.scanner.mirrors.axis_separation
    scene, scan = calibrate._targets(known, ranges, 0.37)
    theta, phi = scan.angles()
    np.testing.assert_allclose(theta, 0.06 * largest)
    np.testing.assert_allclose(phi, np.linspace(0.1, 0.9, 6) * largest)
    objects: Any = scene.objects
    points = point_from_shot(ranges, float(theta[0]), phi, separation)
    radius = known.scanner.laser.radius(7.005)
    for number, (target, point, tilt) in enumerate(zip(objects, points, phi.tolist(), strict=True)):
        np.testing.assert_allclose(target.position, point, rtol=1e-12)
        turns = [(turn.axis, turn.angle) for turn in target.rotation]
        whole = np.eye(3)
        for axis, angle in turns:
            whole = Rotation.from_euler(axis, angle).as_matrix() @ whole
        step = 1e-6
        along = (point_from_shot(7.0 + step, float(theta[0]), tilt, separation)
                 - point_from_shot(7.0, float(theta[0]), tilt, separation)) / step  # fmt: skip
        np.testing.assert_allclose(np.abs(whole[:, 2] @ along), 1.0, atol=1e-8)
        width, height = target.size
        assert width == pytest.approx(20.0 * radius)
        arm = math.hypot(point[1], point[2] - separation)
        assert height == pytest.approx(0.95 * 0.8 * largest / 6.0 * arm)
        assert target.material.reflectance == 0.37
        assert target.name == f"target_{number}"


@pytest.mark.parametrize("nearest", [2.0, 10.0, 300.0])
def test_targets_are_nine_radii_high_and_as_many_as_find_room(nearest: float) -> None:
    """Claim: the height over which φ goes, R less D_g times 0.8 of 0.5 rad at most, holds targets of nine radii; all of
    the places are shared out in order, each once."""
    known = scenario()
    parts = list(calibrate._parts(known, nearest))
    places = [place for part in parts for place in range(calibrate.PLACES)[part]]
    assert places == list(range(calibrate.PLACES))
    largest = min(known.scanner.mirrors.max_deflection, 0.5)
    height = 0.8 * largest * (nearest - known.scanner.mirrors.axis_separation)
    radius = known.scanner.laser.radius(nearest)
    count = parts[0].stop
    assert count == 1 or count * 9.0 * radius <= height
    assert count == calibrate.PLACES or (count + 1) * 9.0 * radius > height


def test_a_row_goes_on_along_straight_lines_and_ends_level() -> None:
    """Claim: errors 0.1 + 0.2 e of estimates e go on by a quarter of a pixel beyond the last, along the line through
    the outer eighth, and are the same from there on; within a pixel, whatever the order of the passage."""
    phase = np.linspace(-0.5, 0.5, 48)
    bias = 0.1 + 0.25 * (phase + 0.1)
    # e = p + b: p = (e − 0.125)/1.25, so b = 0.125 + (e − 0.125)/5.
    order = np.random.default_rng(1).permutation(48)
    row = calibrate._row(calibrate.Passage(1.0, 9.0, phase[order], bias[order]))
    shifts = np.linspace(-1.0, 1.0, 97)
    line = 0.125 + (shifts - 0.125) / 5.0
    ends = phase[[0, -1]] + bias[[0, -1]] + [-0.25, 0.25]
    expected = np.clip(line, *(0.125 + (ends - 0.125) / 5.0))
    np.testing.assert_allclose(row, expected, atol=1e-12)
    assert row.shape == (97,)
    # A bend beyond the outer eighth, of six places, does not turn the line.
    bent = bias.copy()
    bent[6:] += 0.02 * (phase[6:] - phase[6])
    again = calibrate._row(calibrate.Passage(1.0, 9.0, phase, bent))
    low = shifts < phase[0] + bias[0]
    np.testing.assert_allclose(again[low], expected[low], atol=1e-12)
    huge = calibrate._row(calibrate.Passage(1.0, 9.0, phase, 5.0 + 0.0 * phase))
    np.testing.assert_array_equal(huge, np.ones(97))


@pytest.mark.parametrize("error", [0.999, -0.999, 1.001, -1.001, 1.4, -1.4])
def test_errors_of_more_than_a_pixel_make_no_table(error: float) -> None:
    """Claim: one error beyond a pixel, to either side and in any passage, is refused, with what it is: 1.001 px is
    told from the 1 px that a table holds."""
    phase = np.linspace(-0.5, 0.5, 5)
    passages = [calibrate.Passage(1.0, 9.0, phase, value + 0.0 * phase) for value in (0.0, error, 0.0)]
    if abs(error) <= 1.0:
        calibrate._within_reach(passages)
        return
    with pytest.raises(RunError) as told:
        calibrate._within_reach(passages)
    assert told.value.message.startswith(f"positions err by up to {error} px, and a table holds 1 px:")


def test_passages_go_through_pixels_from_a_kilometre_to_the_arrays_end() -> None:
    """Claim: twelve pixels, evenly, that keep twelve pixels or a quarter of a short array from its ends, none that lies
    beyond 1000 m at the deflection of the measurement."""
    known = scenario()
    scanner = known.scanner
    spot = ExpectedSpot.of(scanner.laser, scanner.receiver, 1.0, scanner.position_sensor, scanner.dwell)
    found = list(calibrate._nodes(known, spot))
    theta = 0.06 * min(scanner.mirrors.max_deflection, 0.5)
    # p = f d cosΘ/(R − d sinΘ) of eq 1, the middle of pixel n at n + 1/2 pitches.
    receiver, pitch = scanner.receiver, scanner.position_sensor.pitch
    beside = receiver.baseline * math.sin(theta)
    far = receiver.focal_length * receiver.baseline * math.cos(theta) / (1000.0 - beside) / pitch - 0.5
    first = max(12, math.ceil(far))
    assert found == [round(one) for one in np.linspace(first, scanner.position_sensor.pixels - 13, 12)]
    short = scenario(scanner={"position_sensor": {"pixels": 20}})
    sensor = short.scanner.position_sensor
    spot = ExpectedSpot.of(scanner.laser, scanner.receiver, 1.0, sensor, scanner.dwell)
    assert list(calibrate._nodes(short, spot)) == list(range(5, 15))


def test_a_calibration_is_of_the_line_alone() -> None:
    """Claim: no speckle, noise, mirrors' errors, exposure without the laser, light, correction or gate, nothing that
    shakes or warms, and yet the instrument as built; the sensor that the estimators know has its noise, but for what
    clips, drifts or rounds."""
    course = {"amplitude": 3.0, "period": 1e-3, "rate": 0.1}
    shaken = {"base": 1e-4, "vibration": {"shift": ((5.0, 1e-8), (100.0, 1e-10))}}
    known = scenario(
        scanner={
            "laser_off": 0.5,
            "mirrors": {"jitter": 1e-5, "temperature": course},
            "as_built": shaken,
        },
        lighting={"sun": {"direction": (0.0, 0.0, -1.0)}},
        processing={"range_gate": (2.0, 30.0)},
    )
    scene, scan = calibrate._targets(known, np.array([5.0]), 0.5)
    quiet = calibrate._quiet(known, scene, scan)
    assert not quiet.scanner.laser.speckle
    assert not any(value for _, value in quiet.scanner.position_sensor.noise)
    assert quiet.scanner.mirrors.jitter == 0.0
    assert not quiet.scanner.mirrors.temperature.difference(np.linspace(0.0, 1.0, 77)).any()
    assert quiet.scanner.as_built is not None
    assert quiet.scanner.as_built.vibration is None
    assert quiet.scanner.as_built.base == 1e-4
    assert calibrate._quiet(scenario(), scene, scan).scanner.as_built is None
    assert quiet.scanner.laser_off == 0.0
    assert quiet.lighting.sky().dark
    assert quiet.processing.bias_correction == "none"
    assert quiet.processing.range_gate is None
    assert len(quiet.scene.objects) == 1
    noise = dict(calibrate._assumed_sensor(known.scanner).noise)
    off = {"saturation", "dark", "quantisation"}
    assert {name for name, value in noise.items() if not value} == off


def test_a_bench_sees_the_instrument_as_built(
    device: Device, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Claim: an array that is shifted by a tenth of a pixel unknown to the instrument puts −0.1 pixel into all of the
    table, beside the estimator's error, and nothing where a calibration knows of it; one that is shifted by more than
    the pixel that tables hold is refused with the remedy.

    Tolerance: 0.002 pixel; at one phase the error of the parabola changes by no more than that for 0.001 of a pixel.
    """
    monkeypatch.setattr(calibrate, "NODES", 2)
    plain, _ = calibrate.measure_bias(scenario(processing={"peak": "parabola"}), device="cpu")
    pitch = scenario().scanner.position_sensor.pitch
    told = scenario(processing={"peak": "parabola"}, scanner={"as_built": {"array_offset": 0.1 * pitch}})
    moved, _ = calibrate.measure_bias(told, device="cpu")
    middle = np.abs(plain.shifts) < 0.45
    np.testing.assert_allclose((moved.bias - plain.bias)[:, middle], -0.1, atol=0.002)
    file = tmp_path / "calibration.yaml"
    digest = design_digest(told.scanner)
    file.write_text(
        f"schema: 1\nabout: rail\ninstrument: '{digest}'\n"
        f"parameters:\n  array_offset: {{value: {1e5 * pitch:.9g} um, sigma: 0.1 um}}\n",
        encoding="utf-8",
    )
    knowing = told.replace({"processing.calibration": str(file)})
    left, _ = calibrate.measure_bias(knowing, device="cpu")
    np.testing.assert_allclose((left.bias - plain.bias)[:, middle], 0.0, atol=0.002)
    far = scenario(processing={"peak": "parabola"}, scanner={"as_built": {"array_offset": 1.2 * pitch}})
    with pytest.raises(RunError, match="selfcal"):
        calibrate.measure_bias(far, device="cpu")


@pytest.mark.parametrize("read_noise", [1000.0, 4000.0])
def test_a_target_must_stand_out_of_the_noise_that_the_sensor_has(
    device: Device, monkeypatch: pytest.MonkeyPatch, read_noise: float
) -> None:
    """Claim: the brightest pixel of a target holds three tenths of the full well. By the read noise of the instrument,
    though the lines have none, a threshold of half as many standard deviations is passed everywhere in a pixel, and one
    of twice as many nowhere: then there is no table, and the message names the threshold."""
    monkeypatch.setattr(calibrate, "_nodes", lambda *_: iter((117,)))
    for share, measured in ((0.5, True), (2.0, False)):
        known = scenario(scanner={"position_sensor": {"read_noise": read_noise}})
        level = 0.3 * known.scanner.position_sensor.full_well / read_noise
        known = known.replace({"processing.threshold": share * level})
        if measured:
            _, (passage,) = calibrate.measure_bias(known, device="cpu")
            assert passage.bias.size == calibrate.PLACES
            continue
        with pytest.raises(RunError, match=r"not found anywhere .*processing\.threshold"):
            calibrate.measure_bias(known, device="cpu")
