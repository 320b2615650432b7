"""In the dark only the pixels that can matter are exposed: what is measured is that of whole lines, bit by bit."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from prototype import PositionSensor

from scanner_sim import Scenario, load_scenario
from scanner_sim.detector.line.exposure import Signal, Window, expose, pairwise, unlit_numbers
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.triangulation import Triangulation
from scanner_sim.render.beam.line_projection import LineProjection
from scanner_sim.render.beam.splitter import render_light
from scanner_sim.scan.raster import raster_aim
from scanner_sim.signals.processing import MARGIN

pytestmark = pytest.mark.usefixtures("device")

ROWS, COLUMNS = 30, 70


def plate(name: str, x: float, z: float, reflectance: float) -> dict[str, Any]:
    return {
        "name": name,
        "shape": "rectangle",
        "position": [x, 0.0, z],
        "size": [0.18 * z, 0.3 * z],
        "material": {"reflectance": reflectance},
    }


def scenario(**changes: Any) -> Scenario:
    """Plates at 2 to 14 m, one before the other, with nothing between some of them; edges make two spots apart."""
    places = ((-1.1, 6.0, 0.5), (-0.3, 3.0, 0.9), (-0.1, 14.0, 0.3), (0.5, 2.0, 0.02), (2.2, 9.0, 0.9))
    keys = {
        "schema": 1,
        "seed": 5,
        "scanner": {"preset": "nrc_2000"},
        "scan": {
            "type": "raster",
            "rows": ROWS,
            "columns": COLUMNS,
            "horizontal": [-0.3, 0.3],
            "vertical": [-0.16, 0.16],
        },
        "scene": {"objects": [plate(f"plate{k}", *place) for k, place in enumerate(places)]},
    }
    return load_scenario(keys | changes)


@pytest.fixture(scope="module")
def instrument() -> Instrument:
    return Instrument(scenario(), device="cpu")


@pytest.fixture(scope="module")
def lights(instrument: Instrument) -> list[tuple[Any, ...]]:
    return lights_of(instrument)


def lights_of(instrument: Instrument) -> list[tuple[Any, ...]]:
    """Light, shots, truth and deflections in groups; each shot's light is that of another power of the laser.

    The powers fill 10⁻⁴ to 10² evenly: from light that drowns in the noise to light that fills the well.
    """
    known = instrument.scenario
    aim = raster_aim(known.raster, np.arange(ROWS * COLUMNS, dtype=np.uint32), known.scanner.dwell)
    shots, _ = instrument.fire(aim)
    line = LineProjection(instrument.optics)
    truth, groups = render_light(instrument.loaded, line, known.transport, shots, known.seed)
    found = []
    for light in groups:
        index = light.index.numpy()
        factor = 10.0 ** (6.0 * np.mod(index * 0.6180339887498949, 1.0) - 4.0)
        amount = light.amount * auto.Float(np.tile(factor, light.count).astype(np.float32))
        theta = aim.theta[index].astype(np.float32)
        dimmed = replace(light, amount=amount)
        found.append((dimmed, shots.take(light.index), truth.take(light.index), theta, None))
    return found


CASES: dict[str, dict[str, Any]] = {
    **{method: {"processing": {"peak": method}} for method in MARGIN},
    "false alarms": {"processing": {"threshold": 1.5}},
    "gate": {"processing": {"range_gate": [5.0, 8.0]}},
    "any brightness": {"processing": {"validation": {"max_reflectance": None, "min_reflectance": 0.0}}},
    "dark surfaces": {"processing": {"validation": {"min_reflectance": 0.2, "max_reflectance": 2.0}}},
    "bias": {"processing": {"bias_correction": "computed"}},
    "few electrons": {
        "scanner": {
            "preset": "nrc_2000",
            "position_sensor": {
                "read_noise": 3.0,
                "dark_current": 1e5,
                "full_well": 1e6,
                "bias": 0,
                "pixels": 251,
            },
        }
    },
    "no noise": {
        "scanner": {"preset": "nrc_2000", "position_sensor": {"noise": {"read": False, "shot": False}}}
    },
}

LONG = set(CASES) - {"maximum_likelihood", "false alarms", "few electrons"}
"""Cases that the quick tests leave out: each compiles kernels of its own."""


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=[pytest.mark.slow] if case in LONG else []) for case in CASES],
)
def test_what_is_measured_is_that_of_whole_lines(
    case: str, instrument: Instrument, lights: list[tuple[Any, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: every field of every peak is the same to the last bit, from false alarms to saturated edges."""
    known = scenario(**CASES[case])
    line, exposed = Triangulation(known, instrument.loaded, instrument.optics), []
    plain = Triangulation._expose

    def watched(self: Triangulation, *arguments: Any, **named: Any) -> Signal:
        exposed.append(arguments[2] if len(arguments) > 2 else None)
        return plain(self, *arguments, **named)

    monkeypatch.setattr(Triangulation, "_expose", watched)
    statuses: set[int] = set()
    for light in lights:
        statuses |= same_peaks(line, light)
    windows = [window for window in exposed if window is not None]
    pixels = sum(int(pixels_of(window).sum()) for window in windows)
    again = sum(int((pixels_of(window) > 0).sum()) for window in windows[1::2])
    shots = ROWS * COLUMNS
    assert len(windows) == 2 * len(lights)
    assert {Status.VALID, Status.BELOW_THRESHOLD} <= statuses
    assert 0 < again < 0.5 * shots
    if case != "any brightness":
        assert pixels < 0.7 * shots * known.scanner.position_sensor.pixels


def same_peaks(line: Triangulation, light: tuple[Any, ...]) -> set[int]:
    """Check that peaks are those of whole lines; return their statuses."""
    _, signal, whole = line.sense(*light, whole=True)
    _, _, peaks = line.sense(*light)
    for field in fields(whole):
        values = [getattr(found, field.name).numpy() for found in (whole, peaks)]
        assert values[0].tobytes() == values[1].tobytes(), field.name
    assert np.isfinite(signal.lines()).all()
    return {int(code) for code in whole.status.numpy()}


def test_light_before_and_beyond_the_array_is_no_pixel_s() -> None:
    """Claim: spots wholly before the first pixel, on the array, at its ends and beyond it are read as from whole lines.

    Set-up: an array of 4.8 mm that begins 4 mm from infinity's image: the plates image at 1.4 to 10 mm, in pixels −50
    to 120 of 96. Strong light before the array once asked for pixels of negative numbers.
    """
    known = scenario(scanner={"preset": "nrc_2000", "position_sensor": {"offset": 4e-3, "pixels": 96}})
    own = Instrument(known, device="cpu")
    statuses: set[int] = set()
    for light in lights_of(own):
        statuses |= same_peaks(own.triangulation, light)
    assert {Status.VALID, Status.BELOW_THRESHOLD} <= statuses


def pixels_of(window: Window) -> np.ndarray[Any, np.dtype[np.int64]]:
    first, last = (end.numpy().astype(np.int64) for end in (window.first, window.last))
    return np.maximum(last - first + 1, 0)


@pytest.mark.parametrize(
    ("read", "dark", "switches"),
    [
        (1000.0, 2.5e7, {}),
        (2.0, 4e4, {}),
        (5.0, 0.0, {"quantisation": False}),
        (0.0, 2.5e7, {"saturation": False}),
    ],
)
def test_noise_has_an_end_and_comes_near_it(read: float, dark: float, switches: dict[str, bool]) -> None:
    """Claim: no number of a pixel without light leaves the range that is stated, which is not much wider than they are.

    Of 8 million numbers 18 are expected beyond 4.6 standard deviations: none with a chance of 2e-8.
    """
    sensor = PositionSensor(read_noise=read, dark_current=dark, full_well=1e6, gain=1.0)
    sensor = sensor.model_copy(update={"noise": sensor.noise.model_copy(update=switches)})
    nothing = pairwise(lambda pixel, index: 0.0 * auto.Float(pixel + index))
    signal = expose(nothing, dr.arange(auto.UInt32, 2**15), sensor, 1.5e-6, 50e-6, 3)
    numbers, (least, largest) = signal.lines(), unlit_numbers(sensor, 50e-6)
    assert least <= numbers.min()
    assert numbers.max() <= largest
    centre, spread = float(numbers.mean()), float(numbers.std())
    assert numbers.max() > centre + 4.6 * spread - 1.0
    assert largest < centre + 12.0 * spread + 3.0


def test_lines_that_were_not_exposed_are_not_given_out() -> None:
    window = Window(auto.UInt32([0]), auto.UInt32([9]))
    nothing = pairwise(lambda pixel, index: 0.0 * auto.Float(pixel + index))
    signal = expose(nothing, auto.UInt32([0]), PositionSensor(), 1.5e-6, 50e-6, 3, window=window)
    with pytest.raises(ValueError, match="only a window"):
        signal.lines()
