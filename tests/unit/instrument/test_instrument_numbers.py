"""Numbers that the instrument makes beside its light: how fast objects pass, a pulse's own shape, noise of patterns."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Digitiser, Photodiode, Pulse
from scipy.spatial.transform import Rotation

from scanner_sim.config.scanner import Scanner
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.foundation.device_streams import RunSeeds, device_seeds
from scanner_sim.instrument import triangulation
from scanner_sim.instrument.closed_loop.target_sensor import range_noise, unevenness
from scanner_sim.instrument.expected_light import expected_spot, white_light
from scanner_sim.instrument.time_of_flight import fitted_pulse
from scanner_sim.instrument.time_slots import TimeSlots, angles_moved, middle

Array = NDArray[np.float64]

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.2, 0.2) for z in (-0.1, 0.3)]).T


class Box:
    """A box in the place of a mesh's."""

    def corner(self, number: int) -> Array:
        return CORNERS[:, number]


class Flight:
    """An object that passes at a steady rate and turns about its y axis."""

    def __init__(self, velocity: tuple[float, float, float], rate: float) -> None:
        self.velocity, self.rate = np.array(velocity), rate

    def pose_at(self, time: Array) -> Array:
        time = np.atleast_1d(time)
        pose = np.tile(np.eye(4), (len(time), 1, 1))
        pose[:, :3, :3] = Rotation.from_rotvec(np.outer(time, [0.0, self.rate, 0.0])).as_matrix()
        pose[:, :3, 3] = np.array([0.0, 0.0, 5.0]) + np.outer(time, self.velocity)
        return pose


def slots(step: float, *items: Any) -> TimeSlots:
    body = SimpleNamespace(mitsuba=SimpleNamespace(bbox=Box))
    loaded: Any = SimpleNamespace(bodies=[SimpleNamespace(item=item, mitsuba=body.mitsuba) for item in items])
    return TimeSlots(loaded, step)


def test_a_slot_is_as_short_as_its_fastest_corner_asks() -> None:
    """Claim: slots are a power of two of a second in which no corner moves by more than a bin, and the next longer is
    too long; the moment lies in its slot, and the middle in the middle.

    Expected: the fastest of eight corners, as an angle from the scanner, by differences over the second.
    """
    step, flight = 8e-3, Flight((0.3, 0.1, -0.2), 0.4)
    time = np.linspace(0.0, 1.0, 5)
    speed = 0.0
    for corner in CORNERS.T:
        places = [
            np.einsum("nij,j->ni", flight.pose_at(time + h)[:, :3, :3], corner)
            + flight.pose_at(time + h)[:, :3, 3]
            for h in (-1e-4, 1e-4)
        ]
        moved = np.linalg.norm(places[1] - places[0], axis=1) / np.linalg.norm(places[1], axis=1) / 2e-4
        speed = max(speed, float(moved.max()))
    own = slots(step, flight)
    number, halvings = own.at(0.3)
    length = 2.0 * (0.3 - middle((number, halvings)))
    assert abs(length) <= 0.5**halvings
    whole = middle((1, halvings)) - middle((0, halvings))
    assert whole * speed <= step < 2.0 * whole * speed
    assert middle((0, halvings)) == pytest.approx(0.5 * whole)
    assert own.at(number * whole + 0.01 * whole) == own.at((number + 0.99) * whole)
    later = Flight((0.0, 0.0, 0.0), 0.0)
    later.pose_at = lambda time: flight.pose_at(np.maximum(np.atleast_1d(time) - 1.5, 0.0))  # type: ignore[method-assign]
    resting = slots(step, later)
    assert (resting.at(0.9), resting.at(1.9)[1]) == ((0, 0), halvings)
    both = slots(step, Flight((0.0, 0.0, 0.0), 0.0), flight)
    assert both.at(0.3) == (number, halvings)
    assert slots(step).at(7.3) == (0, 0)


def test_a_second_is_looked_at_from_its_beginning_to_its_end() -> None:
    """Claim: what moves about its ends or one of its quarters alone has slots as short as what moves all the time."""
    flight = Flight((0.3, 0.1, -0.2), 0.0)
    _, halvings = slots(8e-3, flight).at(0.5)
    quarters = [(0.25 * n - 0.01, 0.25 * n + 0.01) for n in (1, 2, 3)]
    for first, last in ((-1.0, 0.01), *quarters, (0.99, 2.0)):
        short = Flight((0.0, 0.0, 0.0), 0.0)
        short.pose_at = lambda time, first=first, last=last: flight.pose_at(np.clip(time, first, last))  # type: ignore[method-assign,misc]
        assert slots(8e-3, short).at(0.5)[1] >= halvings > 0


def test_a_corner_moves_by_its_way_over_its_distance() -> None:
    before, after = np.eye(4)[None], np.eye(4)[None].copy()
    after[0, :3, 3] = [0.01, 0.0, 4.0]
    before[0, :3, 3] = [0.0, 0.0, 4.0]
    found = angles_moved(np.array([[0.0, 3.0], [0.0, 0.0], [0.0, 0.0]]), before, after)
    np.testing.assert_allclose(found, [[0.01 / math.hypot(0.01, 4.0), 0.01 / math.hypot(3.01, 4.0)]])
    near = angles_moved(np.zeros((3, 1)), np.eye(4)[None], np.eye(4)[None] + 0.0)
    np.testing.assert_array_equal(near, 0.0)


def test_the_noise_of_a_pattern_is_the_median_of_its_voxels() -> None:
    """Claim: voxels without a range do not count; of an even number it is the lower of both in the middle."""
    nan = np.nan
    layers = {"sigma_range_m": np.array([[3.0, nan, 1.0, 2.0, nan], [nan, 8.0, 5.0, 7.0, 6.0], [nan] * 5])}
    found = range_noise(layers, np.array([1.0, 2.0, 3.0]))
    assert found.covariance.tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(found.triangulation, [2.0, 6.0, np.inf])
    assert np.isposinf(found.pulses).all()
    found = range_noise({"tof.sigma_range_m": np.array([[4.0, 1.0, 9.0]])}, np.zeros(1))
    assert found.pulses.tolist() == [4.0]


def test_a_jump_of_the_acceleration_shows_where_it_is() -> None:
    """Claim: of a jump of the acceleration half before a point and half after it angles may err by ½ Δa T²/12 there,
    and at both neighbours; an even acceleration leaves nothing."""
    index, jump = np.arange(20.0), 3e-6
    angles = np.zeros((1, 2, 20))
    angles[0, 0] = 0.5 * 1e-6 * index**2
    angles[0, 1] = np.where(index > 10.0, 0.5 * jump * (index - 10.0) ** 2, 0.0)
    found = unevenness(angles)[0]
    np.testing.assert_allclose(found[9:12], 0.5 * jump / 12.0, rtol=1e-9)
    np.testing.assert_allclose(np.delete(found, [9, 10, 11]), 0.0, atol=1e-18)


@pytest.mark.usefixtures("device")
def test_a_fitted_pulse_has_the_height_that_fits_best() -> None:
    """Claim: of a record that is the unit's own pulse, c times as high, the fitted one is c times as high and stands at
    its delay; clipped samples do not count; without an echo there is none."""
    pulse, photodiode, digitiser = Pulse(), Photodiode(), Digitiser()
    unit: Any = SimpleNamespace(pulse=pulse, photodiode=photodiode)
    rate = digitiser.rate
    response, variance = PulseResponse.of(pulse, rate), (photodiode.response_sigma * rate) ** 2
    time, delay, step = np.arange(200) / rate, 90.3 / rate, 1e-3 * photodiode.saturation
    shape = response.values((time - delay) * rate, variance)
    height = 0.6 * photodiode.saturation / shape.max()
    for top, most in ((height, np.inf), (3.0 * height, photodiode.saturation)):
        number = np.minimum(top * shape, most) / step
        waveforms: Any = SimpleNamespace(
            delay=np.array([np.nan, delay]), rate=rate, step=step, time=time, number=[number, number]
        )
        found = fitted_pulse(unit, waveforms, 1)
        assert found is not None
        np.testing.assert_allclose(
            found[1], top * response.values((found[0] - delay) * rate, variance), rtol=1e-9, atol=1e-12 * top
        )
        assert fitted_pulse(unit, waveforms, 0) is None
    assert found[0][0] < delay < found[0][-1]
    assert found[1].max() == pytest.approx(3.0 * height * shape.max(), rel=0.05)


@pytest.mark.usefixtures("device")
def test_each_run_knows_the_light_of_its_own_power() -> None:
    """Claim: beside shots of runs with 5 and 20 mW a white surface has the light of an instrument of that power, behind
    a filter that passes a part of the line as well."""
    known, theta = Scanner(), auto.Float([0.1, 0.2, 0.1, 0.3])
    aside = known.laser.wavelength + 0.5 * known.filter.bandwidth
    scanner = known.changed(filter={"centre": aside, "shape": "cavities", "cavities": 2})
    whole = expected_spot(known, 0.8).white
    assert expected_spot(scanner, 0.8).white == pytest.approx(0.5 * whole, rel=0.1)
    each = [expected_spot(scanner.changed(laser={"power": power}), 0.8) for power in (5e-3, 20e-3)]
    assert each[1].white == pytest.approx(4.0 * each[0].white)
    seeds = RunSeeds.of(device_seeds([3, 4]), 4, (5e-3, 20e-3))
    found = white_light(each[0], scanner, 0.8, theta, seeds)
    for values, name in zip(found, ("white", "white_by_pixel"), strict=True):
        wanted = np.repeat([getattr(one, name) for one in each], 2)
        np.testing.assert_allclose(values.numpy(), wanted, rtol=1e-6)
    alone = white_light(each[0], scanner, 0.8, theta, None)
    np.testing.assert_allclose(
        [float(np.ravel(part)[0]) for part in alone], [each[0].white, each[0].white_by_pixel]
    )


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize(("even", "sweep"), [(0.01, 0.03), (None, 0.0)])
def test_the_light_of_a_line_by_itself_sweeps_along_the_row(
    monkeypatch: pytest.MonkeyPatch, even: float | None, sweep: float
) -> None:
    """Claim: speckle is averaged over the way in Θ of a dwell; of a scan that is not even a lone line rests."""
    monkeypatch.setattr(triangulation, "white_light", lambda *_: (1.0, 2.0))
    line: Any = SimpleNamespace(
        scenario=SimpleNamespace(scan=SimpleNamespace(even_travel=even), scanner=None),
        optics=SimpleNamespace(filter_transmission=1.0),
        spot=None,
        believed=None,
        travel=lambda _shots: (0.03, 0.002),
    )
    found = triangulation.Triangulation.white(line, auto.Float([0.1, 0.2]), None)
    assert found[:2] == (1.0, 2.0)
    np.testing.assert_allclose(np.asarray(found[2]).ravel(), sweep, rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "whole"),
    [
        ({}, False),
        ({"stray": 1e-6}, True),
        ({"dark": False}, True),
        ({"laser_off": 0.02}, True),
        ({"own_peak": "mine"}, True),
    ],
)
def test_parts_of_lines_are_read_where_nothing_but_the_laser_shines(
    changes: dict[str, Any], whole: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: stray light or a sky however faint, a share without the laser, or an estimator of the user's want all."""
    told = {"stray": 0.0, "dark": True, "laser_off": 0.0, "own_peak": None} | changes
    monkeypatch.setattr(triangulation, "dark_line", lambda *given: given)
    line: Any = SimpleNamespace(
        scenario=SimpleNamespace(
            scanner=SimpleNamespace(position_sensor="sensor", dwell=1e-4, laser_off=told["laser_off"]),
            lighting=SimpleNamespace(sky=lambda: SimpleNamespace(dark=told["dark"])),
            processing="processing",
        ),
        throughput=SimpleNamespace(stray=told["stray"]),
        own_peak=told["own_peak"],
        spot="spot",
        bias="bias",
    )
    found = triangulation.Triangulation.dark_line.func(line)  # type: ignore[attr-defined]
    assert found == (None if whole else ("sensor", "processing", 1e-4, "spot", "bias"))
