"""What the judge is told of an instrument: each number once, and none of what is switched off."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.foundation.status import Status
from scanner_sim.validation.compare import instrument, uneven
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.studies import calibrate

SCAN = {"type": "raster", "rows": 4, "columns": 5, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}


def scenario(**changes: Any) -> Any:
    return load_scenario({"schema": 1, "seed": 7, "scan": SCAN} | changes)


def changed_fields(one: Any, other: Any) -> dict[str, tuple[Any, Any]]:
    pairs = {field.name: (getattr(one, field.name), getattr(other, field.name)) for field in fields(one)}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1] and name != "array"}


@pytest.mark.parametrize(
    ("change", "field", "value"),
    [
        ({"position_sensor": {"noise": {"shot": False}}}, "shot", 0.0),
        ({"position_sensor": {"noise": {"read": False}}}, "read", 0.0),
        ({"position_sensor": {"noise": {"dark": False}}}, "dark", 0.0),
        ({"position_sensor": {"noise": {"quantisation": False}}}, "step", 0.0),
        ({"position_sensor": {"noise": {"prnu": False}}}, "response", 0.0),
        ({"laser": {"speckle": False}}, "contrast", 0.0),
        ({"mirrors": {"wobble": 4.5e-6}}, "wobble", 4.5e-6),
        ({"mirrors": {"synchronisation": 2.5e-6}}, "synchronisation", 2.5e-6),
        ({"mirrors": {"drift_zero": 1.5e-6}}, "drift_zero", 1.5e-6),
        ({"mirrors": {"drift_scale": 2.5e-6}}, "drift_scale", 2.5e-6),
        # What an encoder sees of a jitter is no error: a share of its variance.
        ({"mirrors": {"jitter": 5e-6, "jitter_seen": 0.36}}, "jitter", 4e-6),
        # Noise of 3 µrad and steps of √12 · 4 are 5 µrad.
        ({"mirrors": {"readout_noise": 3e-6, "readout_step": 4e-6 * math.sqrt(12.0)}}, "readout", 5e-6),
    ],
)
def test_a_change_of_the_instrument_is_one_number_of_the_judges(
    change: dict[str, Any], field: str, value: float
) -> None:
    whole, made = (instrument.instrument_of(one, 0.3, 0.05) for one in (scenario(), scenario(scanner=change)))
    found = changed_fields(whole, made)
    assert set(found) == {field}
    assert found[field][1] == pytest.approx(value, abs=1e-15)


@pytest.mark.parametrize("ranging", ["triangulation", "tof", "both"])
@pytest.mark.parametrize(
    ("timing", "shape", "closed"),
    [
        ("matched_filter", "gaussian", True),
        ("leading_edge", "gaussian", False),
        ("matched_filter", "t2_exponential", False),
    ],
)
def test_a_budget_has_closed_forms_of_what_ranges(
    ranging: str, timing: str, shape: str, closed: bool
) -> None:
    """Claim: triangulation's always, time of flight's of Gaussian pulses by the matched filter; both together where
    there are both, as 1/σ² add."""
    preset = {"triangulation": "laser_camera_system", "tof": "pulsed_scanner", "both": "nrc_2000"}[ranging]
    pulse = {} if ranging == "triangulation" else {"lidar": {"pulse": {"shape": shape}}}
    timed = {"pulse": {"timing": timing}} | ({"peak": "gaussian"} if ranging != "tof" else {})
    more = {"ranging": ranging} if ranging == "both" else {}
    known = scenario(scanner={"preset": preset, **pulse}, processing=timed, **more)
    found = instrument.closed_budget(known, 0.5, 8.0)
    ways = {"triangulation", "tof"} if ranging == "both" else {ranging}
    wanted = ways - (set() if closed else {"tof"})
    assert set(found) == wanted | ({"fused"} if len(wanted) == 2 else set())
    if "fused" in found:
        added = sum(found[way]["all"] ** -2 for way in wanted)
        assert found["fused"]["all"] == pytest.approx(added**-0.5)


def test_numbers_of_a_line_are_those_of_its_exposure() -> None:
    """Claim: with a quarter of the dwell without the laser three quarters are exposed, swept and filled with dark
    charge; what is subtracted is scaled by three. Speckle of a grey surface has a contrast of √½."""
    known = scenario()
    whole = instrument.instrument_of(known, 0.3, 0.05)
    sensor, dwell = known.scanner.position_sensor, known.scanner.dwell
    assert (whole.dwell, whole.subtracted, whole.half, whole.reflectance) == (dwell, 0.0, 0.05, 0.3)
    assert (whole.dark, whole.shot) == (pytest.approx(sensor.dark_current * dwell), 1.0)
    assert whole.contrast == pytest.approx(math.sqrt(0.5))
    assert whole.sweep == pytest.approx(0.2 / 4.0)
    assert whole.step == sensor.electrons_per_number
    off = instrument.instrument_of(scenario(scanner={"laser_off": 0.25}), 0.3, 0.05)
    found = changed_fields(whole, off)
    assert set(found) == {"dwell", "subtracted", "dark", "sweep"}
    for name in ("dwell", "dark", "sweep"):
        assert found[name][1] == pytest.approx(0.75 * found[name][0])
    assert off.subtracted == pytest.approx(3.0)


@pytest.mark.parametrize(
    ("change", "field", "value"),
    [
        ({"photodiode": {"noise": {"shot": False}}}, "shot", 0.0),
        ({"photodiode": {"noise": {"amplifier": False}}}, "amplifier", 0.0),
        ({"photodiode": {"noise": {"saturation": False}}}, "saturation", math.inf),
        ({"photodiode": {"noise": {"quantisation": False}}}, "step", 0.0),
        ({"digitiser": {"jitter": 3e-12}}, "jitter", 3e-12),
        ({"digitiser": {"drift": 7e-12}}, "drift", 7e-12),
        ({"photodiode": {"bulk_dark_current": 3e-12}}, "bulk", 3e-12),
        ({"photodiode": {"surface_dark_current": 4e-9}}, "surface", 4e-9),
    ],
)
def test_a_change_of_the_receiver_is_one_number_of_the_judges(
    change: dict[str, Any], field: str, value: float
) -> None:
    whole, made = (
        instrument.echo_instrument_of(one, 0.3)
        for one in (scenario(ranging="tof"), scenario(ranging="tof", scanner={"lidar": change}))
    )
    found = changed_fields(whole, made)
    assert set(found) == {field}
    assert found[field][1] == pytest.approx(value)


@pytest.mark.parametrize("distance", [3.0, 12.0])
def test_the_beam_has_its_share_of_a_spots_width(distance: float) -> None:
    """Claim: variances add: f w/(2 R) of the beam on the array, and aberration and diffusion beside it."""
    known = scenario()
    scanner = known.scanner
    seen = ClosedForms(known).facing(distance, 0.5)
    image = scanner.receiver.focal_length * 0.5 * scanner.laser.radius(distance) / distance
    other = math.hypot(scanner.receiver.aberration, scanner.position_sensor.diffusion)
    # To the slant of the rays, (d/R)².
    slack = 3.0 * (scanner.receiver.baseline / distance) ** 2 + 1e-3
    assert seen.beam == pytest.approx(image**2 / (image**2 + other**2), rel=slack)
    assert 0.02 < seen.beam < 0.98


def test_ends_of_speckle_are_those_of_one_blur(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: aberration and diffusion of 30 and 40 µm are 50 µm of the one, or of the other."""
    numbers = instrument.instrument_of(scenario(), 0.3, 0.05)
    numbers = replace(numbers, aberration=30e-6, diffusion=40e-6)
    asked: list[tuple[float, float, float]] = []

    def told(one: Any, R: float) -> dict[str, float]:
        asked.append((one.aberration, one.diffusion, R))
        return {"speckle": one.aberration + R}

    monkeypatch.setattr(instrument, "range_budget", told)
    rows = instrument._ends_of_speckle(numbers, [4.0, 9.0])
    assert {(row.source, row.range_m): row.analytic_m for row in rows} == {
        (row.source, row.range_m): a + R for row, (a, d, R) in zip(rows, asked, strict=True)
    }
    assert {(round(1e6 * a, 9), round(1e6 * d, 9)) for a, d, _ in asked} == {(0.0, 50.0), (50.0, 0.0)}


def test_where_both_ways_err_alike_lies_between_two_ranges(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: R² and 36 cross at 6; there is no place where they do not cross upwards, or only one way has a form."""
    forms = {"triangulation": {"all": 0.0}, "tof": {"all": 36.0}, "fused": {"all": 1.0}}

    def told(_: Any, grey: float, R: float) -> Any:
        return forms | {"triangulation": {"all": R**2}}

    monkeypatch.setattr(instrument, "closed_budget", told)
    assert instrument.closed_crossing(scenario(), 0.5, 2.0, 30.0) == pytest.approx(6.0, rel=1e-4)
    assert math.isnan(instrument.closed_crossing(scenario(), 0.5, 6.1, 30.0))
    assert math.isnan(instrument.closed_crossing(scenario(), 0.5, 2.0, 5.9))
    del forms["fused"]
    assert math.isnan(instrument.closed_crossing(scenario(), 0.5, 2.0, 30.0))


@pytest.mark.parametrize("width", [1.0, 2.0, 5.0])
def test_the_targets_of_a_calibration_fill_no_well(monkeypatch: pytest.MonkeyPatch, width: float) -> None:
    """Claim: the brightest pixel of a spot of that width in its middle holds three tenths of the full well, to 5 % (the
    density in the middle is taken for the integral over a pixel), or the target is white."""
    known = scenario()
    well = known.scanner.position_sensor.full_well
    asked: list[float] = []
    for charge in (1e3 * well, 1e-3 * well):
        spot: Any = SimpleNamespace(
            range=lambda pixel, *_: 4.0 + 0.0 * np.asarray(pixel),
            variances=lambda *_, wide=width: (0.36 * wide**2, 0.64 * wide**2),
            white=charge * 16.0,
        )
        monkeypatch.setattr(
            calibrate, "_targets", lambda told, ranges, grey: asked.append(grey) or (None, None)
        )
        monkeypatch.setattr(calibrate, "_parts", lambda *_: [slice(0, 48)])
        monkeypatch.setattr(calibrate, "_quiet", lambda *_: None)
        monkeypatch.setattr(calibrate, "raster_aim", lambda *_: None)
        monkeypatch.setattr(
            calibrate, "Instrument", lambda *_, **__: SimpleNamespace(expose=lambda aim: (None, []))
        )
        assert calibrate._passage(known, 60, spot, "cpu") is None
        largest = float(pixel_shares(60.0, width, 121).max())
        if charge > well:
            assert asked[-1] * charge * largest == pytest.approx(0.3 * well, rel=0.05)
        else:
            assert asked[-1] == 1.0


def test_a_table_of_errors_is_that_of_the_passages_that_were_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: rows by ascending width, one for each width to a thousandth; nodes without one are left out; each node is
    told of."""
    known = scenario()
    monkeypatch.setattr(calibrate, "_nodes", lambda *_: iter((10, 20, 30, 40, 50)))
    line = SimpleNamespace(spot="spot")
    monkeypatch.setattr(calibrate, "Instrument", lambda *_, **__: SimpleNamespace(triangulation=line))
    phase = np.linspace(-0.5, 0.5, 48)

    def passage(_: Any, node: int, spot: str, device: str) -> Any:
        width = {10: 2.0, 20: 1.5, 30: None, 40: 1.5002, 50: 1.5022}[node]
        return (
            None
            if width is None
            else calibrate.Passage(width, float(node), phase, 0.001 * node + 0.0 * phase)
        )

    monkeypatch.setattr(calibrate, "_passage", passage)
    told: list[tuple[int, int]] = []
    table, found = calibrate.measure_bias(known, device="cpu", progress=lambda *done: told.append(done))
    assert [one.range for one in found] == [40.0, 50.0, 10.0]
    np.testing.assert_allclose(table.widths, [1.5002, 1.5022, 2.0])
    np.testing.assert_allclose(table.bias, np.repeat([[0.04], [0.05], [0.01]], 97, axis=1))
    assert table.estimator == known.processing.peak
    assert told == [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]


@pytest.mark.parametrize(("measured", "enough"), [(24, True), (23, False)])
def test_half_of_a_passage_must_be_measured(
    monkeypatch: pytest.MonkeyPatch, measured: int, enough: bool
) -> None:
    class Held:
        def __init__(self, values: Any) -> None:
            self.values = values

        def numpy(self) -> Any:
            return self.values

    known = scenario()
    spot: Any = SimpleNamespace(
        range=lambda pixel, *_: np.asarray(pixel, dtype=np.float64),
        variances=lambda *_: (3.0, 1.0),
        white=1.0,
    )
    status = np.where(np.arange(48) < measured, int(Status.VALID), int(Status.SATURATED))
    peaks = SimpleNamespace(position=Held(np.full(48, 60.0)), status=Held(status))
    group = SimpleNamespace(index=np.arange(48), signal=SimpleNamespace(lines=lambda: np.eye(48, 100)))
    bench = SimpleNamespace(
        expose=lambda aim: (None, [group]), triangulation=SimpleNamespace(find=lambda *_, **__: peaks)
    )
    monkeypatch.setattr(
        calibrate, "_targets", lambda told, ranges, _: (None, calibrate._scan(told, len(ranges)))
    )
    monkeypatch.setattr(calibrate, "_parts", lambda *_: [slice(0, 48)])
    monkeypatch.setattr(calibrate, "_quiet", lambda *_: None)
    monkeypatch.setattr(calibrate, "Instrument", lambda *_, **__: bench)
    found = calibrate._passage(known, 60, spot, "cpu")
    assert (found is not None) == enough
    if found is not None:
        assert found.phase.size == measured


def test_shares_where_surfaces_meet_are_bounded_as_the_law_says() -> None:
    """Claim: 94 to 99 % within 1.96 σ, none to 0.5 % beyond 3 σ, none to 0.02 % beyond 6 σ."""
    ends = [(one.value - one.accuracy, one.value + one.accuracy) for one in uneven._expected()]
    np.testing.assert_allclose(ends, [(0.94, 0.99), (0.0, 5e-3), (0.0, 2e-4)], atol=1e-15)
    kinds = uneven._predict(None)  # type: ignore[arg-type]
    assert len(kinds) == 12
    assert kinds["glossy: beyond 6 σ"] == uneven._expected()[2]
    assert [one.divisor for one in uneven._expected()] == pytest.approx([0.965, 1.0, 1.0])


def test_a_spot_lies_on_the_array_with_its_reach() -> None:
    """Claim: its middle is farther from either end than it reaches: pixels 0 to n − 1, the same at both ends."""
    forms = ClosedForms(scenario())
    last = forms.scenario.scanner.position_sensor.pixels - 1.0
    seen = forms.facing(9.0, 0.5)

    def there(centre: float) -> bool:
        return forms.on_array(replace(seen, centre=centre))

    middle = 0.5 * last
    low, high = 0.0, middle
    assert there(middle)
    assert not there(0.0)
    for _ in range(60):
        half = 0.5 * (low + high)
        low, high = (low, half) if there(half) else (half, high)
    assert 3.0 * seen.sigma < high < 12.0 * seen.sigma + 2.0
    assert there(last - high * (1.0 + 1e-9))
    assert not there(last - high * (1.0 - 1e-9))
