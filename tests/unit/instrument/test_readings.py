"""What the line told of shots, column by column: from the device to groups, from groups to layers in electrons."""

from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
import scipy.constants

from scanner_sim import load_scenario
from scanner_sim.instrument import viewing
from scanner_sim.instrument.line_readings import LineReadings
from scanner_sim.instrument.signal_records import LineRecorder, WaveformRecorder
from scanner_sim.instrument.time_of_flight import TimeOfFlight
from scanner_sim.instrument.triangulation import Triangulation

pytestmark = pytest.mark.usefixtures("device")

NAMES = (
    "position", "sigma", "signal", "sigma_signal", "snr", "laser", "background", "background_error", "background_peak",
    "status",
)  # fmt: skip
COUNT = 5
BALL = {
    "name": "ball",
    "shape": "sphere",
    "diameter": 1.0,
    "position": (0.0, 0.0, 5.0),
    "material": "z93_white",
}


def column(number: int) -> np.ndarray:
    """Return what a column holds of all shots: all unlike, the light in watts."""
    scale = 1e-9 if 5 <= number <= 8 else 1.0
    return np.float32(scale * (10.0 * number + 1.5 + np.arange(COUNT))).astype(np.float64)


def told(index: list[int]) -> LineReadings:
    """Return the readings of some of the shots, on the device."""
    held: dict[str, Any] = {
        name: auto.Float(column(number)[index].astype(np.float32)) for number, name in enumerate(NAMES[:-1])
    }
    peaks: Any = SimpleNamespace(**held, status=auto.UInt32(column(9)[index].astype(np.uint32)))
    return LineReadings.of(peaks, peaks, held["background_peak"])


def test_columns_keep_their_names_and_shots_their_places() -> None:
    """Claim: what is gathered from groups, or unpacked from one array, is each shot's own; others have none."""
    assert tuple(field.name for field in fields(LineReadings)) == NAMES
    groups = [(np.array(index), told(index)) for index in ([3, 0], [4])]
    found = LineReadings.gathered(COUNT, groups)
    whole = told(list(range(COUNT)))
    packed = np.concatenate([np.asarray(values.numpy(), dtype=np.float32) for values in whole.columns])
    unpacked = LineReadings.unpacked(packed, COUNT)
    for number, name in enumerate(NAMES):
        wanted = column(number) if name != "status" else np.floor(column(number))
        np.testing.assert_array_equal(getattr(found, name)[[0, 3, 4]], wanted[[0, 3, 4]], err_msg=name)
        np.testing.assert_array_equal(getattr(unpacked, name), wanted, err_msg=name)
    assert np.isnan(found.position[[1, 2]]).all()
    assert (found.status[[1, 2]] == 0).all()


@pytest.mark.parametrize("off", [0.0, 0.3])
def test_layers_are_in_electrons_of_the_time_for_which_the_laser_shines(off: float) -> None:
    """Claim: each layer is its column; light on a pixel in electrons is QE t λ/(h c) times its power, and the signal
    over its background stays a ratio of powers, without an end where there is none."""
    scanner = {
        "preset": "nrc_2000",
        "laser_off": off,
        "rate": 1.0 / 7e-6,
        "position_sensor": {"quantum_efficiency": 0.63},
    }
    known = load_scenario(
        {
            "schema": 1,
            "scanner": scanner | {"laser": {"wavelength": 1.31e-6}},
            "scene": {"objects": [BALL]},
            "scan": {"rows": 1, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (0.0, 0.0)},
        }
    )
    line = LineReadings.gathered(COUNT, [(np.arange(COUNT), told(list(range(COUNT))))])
    line.background[2] = 0.0
    layers = Triangulation._layers(SimpleNamespace(scenario=known), line)  # type: ignore[arg-type]
    photon = scipy.constants.h * scipy.constants.c / 1.31e-6
    electrons = 0.63 * (1.0 - off) * 7e-6 / photon
    background = column(6) * (np.arange(COUNT) != 2)
    wanted = {
        "Y": column(2), "sigma_Y": column(3), "snr_detection": column(4), "peak_px": column(0),
        "sigma_peak_px": column(1),
        "background": electrons * background, "background_error": electrons * column(7),
        "background_peak": electrons * column(8),
    }  # fmt: skip
    assert sorted(layers) == sorted([*wanted, "snr"])
    for name, values in wanted.items():
        np.testing.assert_allclose(layers[name], values, rtol=1e-12, err_msg=name)
    there = np.arange(COUNT) != 2
    np.testing.assert_allclose(layers["snr"][there], column(5)[there] / column(6)[there], rtol=1e-12)
    assert layers["snr"][2] == np.inf


def test_patterns_are_left_out_of_a_page_that_they_would_make_too_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: four numbers of 1.8 bytes for each shot of each visit's pattern, beside 0.7 MB of the page."""
    seen: list[Any] = []
    monkeypatch.setattr(viewing, "outlines_of", lambda _: lambda _: None)
    monkeypatch.setattr(
        viewing, "track_data", lambda *_, **given: seen.append((given["patterns"], given["notes"]))
    )
    shots = (40_000, 70_000, 30_000)
    records = [SimpleNamespace(samples=SimpleNamespace(time=np.empty((2, count)))) for count in shots]
    track: Any = SimpleNamespace(records=records)
    largest = 1e-6 * (0.7e6 + 4.0 * 1.8 * sum(shots))
    for share in (1.0001, 0.9999):
        viewing._track_page(track, (), None, "", share * largest)  # type: ignore[arg-type]
    assert [patterns for patterns, _ in seen] == [True, False]
    assert seen[0][1] == []
    assert seen[1][1] == [f"Patterns were left out, to keep the page below {0.9999 * largest:g} MB."]


@pytest.mark.parametrize(
    ("bits", "line", "waveform"),
    [(8, "<u2", "<i2"), (14, "<u2", "<i2"), (15, "<u2", "<i4"), (16, "<u2", "<i4")],
)
def test_digital_numbers_are_kept_in_the_smallest_type_that_holds_them(
    bits: int, line: str, waveform: str
) -> None:
    """Claim: a line counts from 0 to 2ⁿ − 1, a waveform to 2ⁿ on either side of 0; what is not rounded, or where light
    without an end makes numbers without one, is a float."""
    for rounded, ended in ((True, True), (False, True), (True, False), (False, False)):
        noise = {"quantisation": rounded, "saturation": ended}
        known = load_scenario(
            {
                "schema": 1,
                "ranging": "both",
                "scanner": {
                    "preset": "nrc_2000",
                    "position_sensor": {"adc_bits": bits, "noise": noise},
                    "lidar": {"digitiser": {"bits": bits}, "photodiode": {"noise": noise}},
                },
                "scene": {"objects": [BALL]},
                "scan": {"rows": 1, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (0.0, 0.0)},
            }
        )
        bench: Any = SimpleNamespace(triangulation=None, time_of_flight=None, loaded=None, scenario=known)
        kinds = [np.dtype(recorder(bench).number_kind) for recorder in (LineRecorder, WaveformRecorder)]
        assert kinds == [np.dtype(kind if rounded and ended else "f4") for kind in (line, waveform)]


def test_layers_of_echoes_are_in_electrons_of_their_gain() -> None:
    """Claim: a current over the gain is its electrons, and so is σ of it."""
    delays: Any = SimpleNamespace(
        signal=np.array([6e-6, 3e-6, 0.0]),
        sigma_signal=np.array([5e-7, 1.2e-5, 3e-8]),
        snr=np.array([12.0, 0.25, 0.0]),
        echoes=np.array([1, 2, 0]),
    )
    bench: Any = SimpleNamespace(amperes_per_electron=1.5e-9, ranges=lambda *given: given)
    light = np.float32([1e-9, 2e-9, 3e-9])
    reading = TimeOfFlight.reading(bench, "truth", delays, light, "deflections")  # type: ignore[arg-type]
    assert (reading.truth, reading.ranges) == ("truth", (delays, "deflections"))
    wanted = {
        "tof.Y": [4000.0, 2000.0, 0.0],
        "tof.sigma_Y": [1000.0 / 3.0, 8000.0, 20.0],
        "tof.snr_detection": delays.snr,
        "tof.echoes": delays.echoes,
        "tof.background_w": light,
    }
    assert sorted(reading.layers) == sorted(wanted)
    for name, values in wanted.items():
        np.testing.assert_allclose(reading.layers[name], values, rtol=1e-12, err_msg=name)
