"""An instrument asks its rangefinders, whatever they are, and puts together what they read."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Mirrors, TemperatureCourse

from scanner_sim import Scenario, load_scenario
from scanner_sim.foundation.channels import CHANNEL, Channel
from scanner_sim.foundation.status import Status
from scanner_sim.instrument import instrument as instrument_room
from scanner_sim.instrument.closed_loop.frozen_instrument import FrozenInstrument
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.rangefinder import Reading
from scanner_sim.instrument.time_of_flight import TimeOfFlight
from scanner_sim.instrument.triangulation import Triangulation
from scanner_sim.ranging.ranges import Deflections, Geometry, Ranges, ranges_with_points
from scanner_sim.render.device import Device
from scanner_sim.render.shots import Pointing
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.raster import raster_aim

Array = NDArray[np.float64]
COLUMNS, FAR, NEAR = 6, 7.0, 6.0


def held(values: NDArray[Any]) -> Any:
    return SimpleNamespace(numpy=lambda: values)


BENCH = Geometry(0.1, 0.2, 0.05, 50e-6, 0.0, 0.0)


class Stadia:
    """A rangefinder that is part of no scenario: it reads a staff that it always sees at one distance."""

    prefix = "stadia."
    channels = (
        Channel("stadia.hairs", "1", "number of hairs that were read", "signal"),
        Channel("stadia.sigma_Y", "1", "standard deviation of stadia.Y", "signal"),
    )

    def __init__(self, sight: Any, refused: tuple[int, ...] = ()) -> None:
        self.sight, self.refused, self.backgrounds = sight, refused, []  # type: ignore[var-annotated]

    def measure(
        self,
        aim: Aim,
        shots: Any,  # noqa: ARG002 (a staff needs no light)
        deflections: Deflections,
        background: Any = None,
    ) -> Reading:
        """Return one range of all shots."""
        self.backgrounds.append(background)
        one = np.ones(len(aim.shot))
        status = np.zeros(len(one), dtype=np.uint32)
        status[list(self.refused)] = Status.BELOW_THRESHOLD
        r = np.where(status, np.nan, FAR)
        truth: Any = SimpleNamespace(
            distance=held(8.0 * one), object=held(aim.shot % 2), material=held((aim.shot + 1) % 2)
        )
        ranges: Ranges = ranges_with_points(r, 0.1 * r, status, 0.1 * one, 0.0 * one, deflections, BENCH)
        return Reading(
            truth, ranges, {"stadia.Y": 3.0 * one, "stadia.sigma_Y": 0.5 * one, "stadia.hairs": 2 * status}
        )


def scenario(**changes: Any) -> Scenario:
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": (2.0, 2.0),
        "position": (0.0, 0.0, NEAR),
        "material": {"reflectance": 0.5},
    }
    scan = {"rows": 1, "columns": COLUMNS, "horizontal": (-0.1, 0.1), "vertical": (0.0, 0.0)}
    return load_scenario({"schema": 1, "seed": 4, "scene": {"objects": [wall]}, "scan": scan} | changes)


def aim_of(known: Scenario) -> Aim:
    return raster_aim(known.raster, np.arange(COLUMNS, dtype=np.uint32), known.scanner.dwell)


def test_another_rangefinder_takes_a_class_and_no_more(device: Device) -> None:
    """Claim: what is measured by a rangefinder alone stands under its own names and without a prefix."""
    known = scenario()
    instrument = Instrument(known, device="cpu")
    stadia = Stadia(instrument.triangulation.sight)
    instrument.rangefinders = (stadia,)
    samples = instrument.measure(aim_of(known))
    np.testing.assert_array_equal(samples["stadia.range_m"], FAR)
    np.testing.assert_array_equal(samples["range_m"], FAR)
    np.testing.assert_array_equal(samples["Y"], 3.0)
    np.testing.assert_array_equal(samples["sigma_Y"], 0.5)
    np.testing.assert_array_equal(samples["truth.range_m"], 8.0)
    assert "hairs" not in samples
    assert not any(name.startswith(("fused.", "tof.")) for name in samples)
    assert samples.channel("stadia.hairs").unit == "1"
    patterns = FrozenInstrument(instrument)
    assert not patterns.fast
    np.testing.assert_array_equal(patterns.measure(aim_of(known))["stadia.range_m"], FAR)
    assert stadia.backgrounds == [None, None]


def test_two_rangefinders_stand_side_by_side(device: Device) -> None:
    """Claim: the first one's columns have no prefix, and refuse for themselves alone; no law fuses these two."""
    known = scenario()
    instrument = Instrument(known, device="cpu")
    alone = instrument.measure(aim_of(known))
    instrument.rangefinders = (
        instrument.triangulation,
        Stadia(instrument.triangulation.sight, refused=(1, 2)),
    )
    both = instrument.measure(aim_of(known))
    for name in alone.measured:
        np.testing.assert_array_equal(both[name], alone[name])
    assert (alone["status"] == Status.VALID).all()
    np.testing.assert_array_equal(np.isnan(both["stadia.range_m"]), [False, True, True, False, False, False])
    assert not any(name.startswith("fused.") for name in both)


def test_each_rangefinder_sees_its_own_background(device: Device) -> None:
    known = scenario()
    instrument = Instrument(known, device="cpu")
    first, second = (Stadia(instrument.triangulation.sight) for _ in range(2))
    instrument.rangefinders = (first, second)
    given: Any = ["line", "field"]
    instrument.measure(aim_of(known), backgrounds=given)
    assert (first.backgrounds, second.backgrounds) == (["line"], ["field"])


@pytest.mark.parametrize(
    ("ranging", "prefixes"), [("triangulation", [""]), ("tof", ["tof."]), ("both", ["", "tof."])]
)
def test_a_scenario_chooses_its_rangefinders(device: Device, ranging: str, prefixes: list[str]) -> None:
    """Claim: every column of every choice has a unit and its meaning; where there are two ways, they are fused; the
    first has no prefix."""
    known = scenario(ranging=ranging)
    instrument = Instrument(known, device="cpu")
    assert [rangefinder.prefix for rangefinder in instrument.rangefinders] == prefixes
    samples = instrument.measure(aim_of(known))
    assert ("fused.range_m" in samples) == (ranging == "both")
    assert len(samples) == len(list(samples)) == len(samples.to_xarray())
    for name, values in samples.items():
        assert values.shape == (COLUMNS,)
        assert samples.to_xarray()[name].attrs["units"] == samples.channel(name).unit
    for name in ("Y", "sigma_Y", "range_m", "status"):
        np.testing.assert_array_equal(samples[name], samples[prefixes[0] + name])
    for name in samples.keys() - {"sigma_Y", "tof.sigma_Y"}:
        assert name in CHANNEL
        assert samples.to_xarray()[name].attrs["long_name"] == CHANNEL[name].meaning


def test_the_truth_is_where_the_beam_went(device: Device) -> None:
    """Claim: true deflections are the commanded ones and the mirrors' errors; peaks of refused voxels go."""
    known = scenario()
    instrument = Instrument(known, device="cpu")
    aim, zero = aim_of(known), np.zeros(COLUMNS)
    off_theta, off_phi = 1e-3 * np.arange(COLUMNS), -2e-3 * np.arange(1, COLUMNS + 1)
    deflections = Deflections(aim.theta, aim.phi, zero, zero)
    read = Stadia(None, refused=(1,)).measure(aim, None, deflections)
    layers = {name: np.ones(COLUMNS) for name in ("peak_px", "sigma_peak_px", "Y")}
    found = instrument.samples(
        aim, Pointing(off_theta, off_phi, zero, zero), deflections, [Reading(read.truth, read.ranges, layers)]
    )
    np.testing.assert_allclose(found["truth.theta_rad"], aim.theta + off_theta)
    np.testing.assert_allclose(found["truth.phi_rad"], aim.phi + off_phi)
    np.testing.assert_array_equal(found["truth.object"], aim.shot % 2)
    np.testing.assert_array_equal(found["truth.material"], (aim.shot + 1) % 2)
    assert not any(name.startswith("truth.") for name in found.measured)
    for name in ("peak_px", "sigma_peak_px"):
        np.testing.assert_array_equal(np.isnan(found[name]), np.arange(COLUMNS) == 1)
    assert not np.isnan(found["Y"]).any()


def test_what_fusion_refuses_has_no_measured_layer_left() -> None:
    """Claim: where two ranges lie farther apart than their σ allow, the one with the larger σ is inconsistent, and all
    that it measured is NaN, its peak as well as its range; layers of what stands keep their numbers.

    Set-up: both read 7 m, but shot 1, where a σ of 1 mm is 1 m off one of 1 µm, shot 4 the same the other way round,
    and shot 2, which triangulation did not see.
    """
    known = scenario(ranging="both")
    made: Any = object.__new__(Instrument)
    made.scenario, made.geometry = known, BENCH
    made.loaded = SimpleNamespace(
        object_labels=SimpleNamespace(number_of=np.arange(3)),
        material_labels=SimpleNamespace(number_of=np.arange(3)),
    )
    made.rangefinders = object.__new__(Triangulation), object.__new__(TimeOfFlight)
    aim, zero = aim_of(known), np.zeros(COLUMNS)
    deflections = Deflections(aim.theta, aim.phi, zero, zero)
    at = np.arange(COLUMNS)
    unseen = np.where(at == 2, np.uint32(Status.BELOW_THRESHOLD), np.uint32(0)).astype(np.uint32)

    def ranges(coarse: int, off: int, status: NDArray[np.uint32]) -> Ranges:
        r = np.where(status, np.nan, FAR + np.where(at == off, 1.0, 0.0))
        sigma = np.where(at == coarse, 1e-3, 1e-6)
        return ranges_with_points(r, sigma, status, sigma, zero, deflections, BENCH)

    truth: Any = SimpleNamespace(distance=held(zero + FAR), object=held(at % 2), material=held(at % 2))
    line = dict(zip(("peak_px", "sigma_peak_px", "Y"), np.ones((3, COLUMNS)), strict=True))
    pulse = {"tof.Y": zero + 2.0}
    readings = [Reading(truth, ranges(1, 1, unseen), line), Reading(truth, ranges(4, 4, 0 * unseen), pulse)]
    found = made.samples(aim, Pointing(zero, zero, zero, zero), deflections, readings)
    for name, refused in (("status", 1), ("tof.status", 4)):
        np.testing.assert_array_equal(np.flatnonzero(found[name] == Status.INCONSISTENT), [refused])
    for name in ("peak_px", "sigma_peak_px", "range_m", "sigma_range_m"):
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(found[name])), [1, 2], err_msg=name)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found["tof.range_m"])), [4])
    np.testing.assert_allclose(found["fused.range_m"], FAR, atol=1e-5)
    np.testing.assert_array_equal(found["Y"], 1.0)
    np.testing.assert_array_equal(found["tof.Y"], 2.0)


@pytest.mark.parametrize(("moving", "when"), [(True, 2.6), (False, None)])
def test_a_background_is_that_of_the_middle_of_its_aims_time(
    monkeypatch: pytest.MonkeyPatch, moving: bool, when: float | None
) -> None:
    """Claim: what moves stands where it is half-way between the first and the last shot, in whatever order; each
    rangefinder sees its own rows of that, and in the dark none sees anything."""
    dark, asked = [False], []

    def rows(aims: Any, times: Any, sight: Any) -> list[str]:
        asked.append((aims, times))
        return [f"rows of {sight}"]

    monkeypatch.setattr(instrument_room, "rows_about", rows)
    made: Any = object.__new__(Instrument)
    finders = [SimpleNamespace(sight=(name,), panorama_of=lambda rows: rows) for name in ("line", "field")]
    made.rangefinders, made._stay = finders, SimpleNamespace(resume=nullcontext)
    made.loaded = SimpleNamespace(bodies=["node"] if moving else [])
    sky = SimpleNamespace(sky=lambda: SimpleNamespace(dark=dark[0]))
    made.scenario = SimpleNamespace(lighting=sky)
    aim: Any = SimpleNamespace(time=np.array([1.7, 4.1, 1.1, 3.9]))
    assert made.backgrounds(aim) == ["rows of line", "rows of field"]
    assert [times for _, times in asked] == 2 * [[when if when is None else pytest.approx(when)]]
    dark[0] = True
    assert made.backgrounds(aim) == [None, None]


def test_each_encoder_reads_its_own_angle_with_its_own_noise() -> None:
    """Claim: what is read is what is seen of the mirror and 3 µrad for each of the numbers that were drawn for it, to
    half a step of 0.01 µrad."""
    rng = np.random.default_rng(6)
    commanded, seen, drawn = (
        rng.uniform(-0.3, 0.3, (2, 4)),
        rng.normal(0.0, 1e-4, (2, 4)),
        rng.normal(size=(2, 4)),
    )
    made: Any = object.__new__(Instrument)
    mirrors = Mirrors(readout_noise=3e-6, readout_step=1e-8)
    made.scenario = SimpleNamespace(scanner=SimpleNamespace(mirrors=mirrors, exposure=1.0, dwell=1.0))
    made.geometry = BENCH
    zero = np.zeros(4)
    aim = Aim(np.arange(4, dtype=np.uint32), *commanded, zero, zero, zero)
    pointing: Any = SimpleNamespace(seen_theta=seen[0], seen_phi=seen[1])
    found = made.deflections(aim, pointing, drawn.astype(np.float32))
    np.testing.assert_allclose([found.theta, found.phi], commanded + seen + 3e-6 * drawn, atol=0.51e-8)


def test_each_encoder_drifts_in_proportion_to_its_own_angle() -> None:
    """Claim: of a scale that drifts by 2e-5/K and 3 K/h, what is known after half an hour and an hour is 3e-5 and 6e-5
    of the angle of that mirror, Θ or φ."""
    theta, phi = np.array([0.1, 0.2]), np.array([0.05, 0.3])
    course = TemperatureCourse(rate=3.0 / 3600.0, amplitude=0.0)
    drifts = {"drift_zero": 0.0, "drift_scale": 2e-5, "temperature": course}
    made: Any = object.__new__(Instrument)
    made.scenario = SimpleNamespace(
        scanner=SimpleNamespace(mirrors=Mirrors().still().model_copy(update=drifts), exposure=1.0, dwell=1.0)
    )
    made.geometry = BENCH
    zero = np.zeros(2)
    aim = Aim(np.arange(2, dtype=np.uint32), theta, phi, np.array([1800.0, 3600.0]), zero, zero)
    pointing: Any = SimpleNamespace(seen_theta=zero, seen_phi=zero)
    found = made.deflections(aim, pointing, np.zeros((2, 2), dtype=np.float32))
    np.testing.assert_allclose(found.sigma_theta, [3e-5, 6e-5] * theta, rtol=1e-9)
    np.testing.assert_allclose(found.sigma_phi, [3e-5, 6e-5] * phi, rtol=1e-9)
