"""An instrument asks its rangefinders, whatever they are, and puts together what they read."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Scenario, load_scenario
from scanner_sim.foundation.channels import CHANNEL, Channel
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.closed_loop.frozen_instrument import FrozenInstrument
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.rangefinder import Reading
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
    """Claim: every column of every choice has a unit; where there are two, they are fused; the first has no prefix."""
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
