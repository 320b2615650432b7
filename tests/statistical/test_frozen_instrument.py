"""Patterns measured by frozen kernels against the instrument that measures anything."""

from __future__ import annotations

from typing import Any

import claims
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.config import load_scenario
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.closed_loop.frozen_instrument import FrozenInstrument
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.render.device import Device
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.raster import raster_aim

Array = NDArray[np.float64]

POINTS, DWELL = 128, 50e-6
OBJECTS: list[dict[str, Any]] = [
    {
        "name": "wall",
        "shape": "rectangle",
        "position": [0.0, 0.0, 10.0],
        "size": [8.0, 8.0],
        "material": {"reflectance": 0.8},
    },
    {
        "name": "black",
        "shape": "disc",
        "position": [0.0, 0.0, 9.999],
        "diameter": 0.1,
        "material": {"reflectance": 0.05},
    },
    {
        "name": "ball",
        "shape": "sphere",
        "position": [0.3, 0.0, 9.7],
        "diameter": 0.2,
        "material": {"reflectance": 0.5},
    },
    {
        "name": "step",
        "shape": "rectangle",
        "position": [-0.35, 0.0, 9.5],
        "size": [0.2, 0.3],
        "rotation": {"axis": "y", "angle": 0.5},
        "material": {"reflectance": 0.4},
    },
]
SUN = {"sun": {"direction": [-0.35, -0.45, -0.8]}, "earth": {"direction": [0.0, 1.0, 0.0]}}
PLACES = ((0.0, 0.0), (0.03, 0.0), (-0.035, 0.0))
"""Centres of patterns (Θ, φ) [rad]: on the black disc, the ball and the step."""


def scenario(*, moving: bool = False, **changes: Any) -> Scenario:
    objects = [dict(item) for item in OBJECTS]
    if moving:
        objects[1]["motion"] = {"type": "twist", "velocity": [0.009, 0.0, 0.0]}
    keys: dict[str, Any] = {
        "schema": 1,
        "seed": 5,
        "scanner": {"preset": "nrc_2000"},
        "scan": {
            "type": "raster",
            "rows": 1,
            "columns": POINTS,
            "horizontal": [-0.03, 0.03],
            "vertical": [0.0, 0.0],
        },
        "scene": {"objects": objects},
        "processing": {"range_gate": [9.0, 10.5]},
    }
    return load_scenario(keys | changes)


def quiet(known: Scenario) -> Scenario:
    """The same without noise, speckle and errors of the mirrors."""
    scanner = known.scanner
    sensor, laser = scanner.position_sensor, scanner.laser
    silent = sensor.noise.model_copy(update=dict.fromkeys(type(sensor.noise).model_fields, False))
    parts = {
        "position_sensor": sensor.model_copy(update={"noise": silent}),
        "laser": laser.model_copy(update={"speckle": False}),
        "mirrors": scanner.mirrors.still(),
    }
    return known.model_copy(update={"scanner": scanner.changed(**parts)})


def pattern(number: int, centre: tuple[float, float] = (0.0, 0.0), points: int = POINTS) -> Aim:
    """A 3:2 pattern of 12 mrad; each has another phase."""
    phase = 2.0 * np.pi * (np.arange(points) + 0.5) / points
    reach, shift = 12e-3, 0.3 * number
    first = number * points
    return Aim(
        shot=np.arange(first, first + points, dtype=np.uint32),
        theta=centre[0] + reach * np.sin(3.0 * phase + shift),
        phi=centre[1] + reach * np.sin(2.0 * phase),
        time=(np.arange(first, first + points) + 0.5) * DWELL,
        travel_theta=reach * 6.0 * np.pi / points * np.cos(3.0 * phase + shift),
        travel_phi=reach * 4.0 * np.pi / points * np.cos(2.0 * phase),
    )


def same(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]]) -> bool:
    return one.keys() == other.keys() and all(
        np.array_equal(one[name], other[name], equal_nan=one[name].dtype.kind == "f") for name in one
    )


@pytest.fixture(scope="module")
def benches(device: Device) -> tuple[Instrument, FrozenInstrument]:
    """With all noise, in the dark."""
    bench = Instrument(scenario(), device="cpu")
    return bench, FrozenInstrument(bench)


@pytest.fixture(scope="module")
def moving_sunlit(device: Device) -> Scenario:
    """The black disc moves by 9 mm/s under the Sun."""
    return scenario(moving=True, lighting=SUN)


@pytest.mark.slow
def test_light_and_positions_are_those_of_the_instrument(device: Device) -> None:
    """Claim: without noise a pattern's voxels are those of the instrument, but for the beamlets at edges.

    Set-up: four patterns each on a black disc, a ball and a tilted step before a wall, everything that is random
    switched off. Expected: truth, and which voxels are lit, alike; on the disc, where the light changes and the place
    does not, signals within the step at its edge. Tolerance: single beamlets of 64 are in or out, 1/64 of the step rms
    (0.003 found); nine places of ten within 0.005 pixel on disc and ball (0.001 found). Where an edge in depth parts
    the light in two like halves, another one may win: 2 % of the voxels (1 % found).
    """
    bench = Instrument(quiet(scenario()), device="cpu")
    fast = FrozenInstrument(bench)
    differing = 0
    for centre in PLACES:
        signals, places = [], []
        for number in range(4):
            aim = pattern(number, centre)
            ours, theirs = fast.measure(aim), bench.measure(aim)
            assert ours.keys() == theirs.keys()
            for name in ("truth.range_m", "truth.object", "truth.material", "truth.theta_rad"):
                assert np.array_equal(ours[name], theirs[name], equal_nan=True), name
            differing += int((ours["status"] != theirs["status"]).sum())
            signals.append((ours["Y"] - theirs["Y"]) / theirs["Y"].max())
            places.append(ours["peak_px"] - theirs["peak_px"])
        if centre == PLACES[0]:
            assert np.concatenate(signals).std() < 1.0 / 64.0
        if centre != PLACES[2]:
            assert np.nanquantile(np.abs(np.concatenate(places)), 0.9) < 0.005
    assert differing <= 0.02 * 3 * 4 * POINTS


def test_light_of_a_narrow_lobe_is_that_of_the_instrument(device: Device) -> None:
    """Claim: frozen kernels read which materials have narrow lobes: without noise nine places of ten on a disc that
    retro-reflects are within 0.005 pixel of the instrument's, as those on a black one."""
    objects = [item | ({"material": "retro_sheet"} if item["name"] == "black" else {}) for item in OBJECTS]
    bench = Instrument(quiet(scenario(scene={"objects": objects})), device="cpu")
    aim = pattern(0)
    ours, theirs = FrozenInstrument(bench).measure(aim), bench.measure(aim)
    assert np.array_equal(ours["truth.material"], theirs["truth.material"])
    assert np.nanquantile(np.abs(ours["peak_px"] - theirs["peak_px"]), 0.9) < 0.005


@pytest.mark.slow
def test_random_numbers_are_those_of_the_instrument(benches: tuple[Instrument, FrozenInstrument]) -> None:
    """Claim: noise, speckle and the mirrors' errors of a shot are those that the instrument draws for it.

    Set-up: patterns on the black disc with all noise. Expected: the mirrors' errors and the encoders alike, ranges that
    differ by the beamlets only. Tolerance: errors 1e-12 rad (float32 sums), ranges 0.4 of their σ for nine voxels of
    ten (0.2 found): other random numbers would give 2.3.
    """
    bench, fast = benches
    for number in range(3):
        aim = pattern(number)
        ours, theirs = fast.measure(aim), bench.measure(aim)
        for name in ("truth.theta_rad", "truth.phi_rad"):
            assert np.abs(ours[name] - theirs[name]).max() < 1e-12
        both = (ours["status"] == Status.VALID) & (theirs["status"] == Status.VALID)
        assert both.sum() > 0.9 * POINTS
        apart = np.abs(ours["range_m"] - theirs["range_m"])[both] / theirs["sigma_range_m"][both]
        assert np.quantile(apart, 0.9) < 0.4


@pytest.mark.slow
def test_few_recordings_serve_all_patterns(benches: tuple[Instrument, FrozenInstrument]) -> None:
    """Claim: patterns at any place are measured by the kernels of a few: those that probe and those that read are
    recorded once, those that trace shots again once for each number of lanes, of which there are thirteen."""
    bench, _ = benches
    fast = FrozenInstrument(bench)
    for number, centre in enumerate((*PLACES, (0.2, -0.1), (-0.25, 0.2))):
        fast.measure(pattern(number, centre))
        fast.measure(pattern(number, centre))
    assert fast.recordings <= 2 + 5


def test_other_lengths_are_other_kernels(benches: tuple[Instrument, FrozenInstrument]) -> None:
    """Claim: patterns of several lengths may alternate; each shot's voxel depends on its number, not on the length."""
    _, fast = benches
    long, short = pattern(0), pattern(0, points=32)
    before = fast.measure(long)
    few = Aim(*(getattr(long, name)[:32] for name in short.__dataclass_fields__))
    part = fast.measure(few)
    assert same({name: values[:32] for name, values in before.items()}, part)
    assert same(before, fast.measure(long))


@pytest.mark.slow
def test_what_was_measured_before_does_not_matter(moving_sunlit: Scenario) -> None:
    """Claim: a pattern's voxels are a function of its aim: the same bytes first or last, with one thread or two."""
    import drjit as dr

    late = pattern(40, PLACES[1])
    alone = FrozenInstrument(Instrument(moving_sunlit, device="cpu")).measure(late)
    bench = FrozenInstrument(Instrument(moving_sunlit, device="cpu"))
    for number in (0, 20, 39):
        bench.measure(pattern(number, PLACES[number % 2]))
    assert same(alone, bench.measure(late))
    threads = dr.thread_count()
    try:
        dr.set_thread_count(1)
        assert same(alone, FrozenInstrument(Instrument(moving_sunlit, device="cpu")).measure(late))
    finally:
        dr.set_thread_count(threads)


@pytest.mark.slow
def test_moving_objects_are_where_they_are(moving_sunlit: Scenario) -> None:
    """Claim: a moving target is met where it is at each shot, and the background follows it in time slots.

    Set-up: a disc that moves by 9 mm/s, 0.9 mrad/s, looked at from 0 to 1.3 s. Expected: the truth of the disc's voxels
    is that of its pose; a bin of 0.5 mrad takes 0.55 s, so windows are rendered for slots of 1/2 s. Tolerance:
    a disc's voxels lie within its radius of its centre, and 20 µm (float32) from its plane.
    """
    fast = FrozenInstrument(Instrument(moving_sunlit, device="cpu"))
    for number in (0, 50, 150, 200):
        aim = pattern(number)
        found = fast.measure(aim)
        on = found["truth.object"] == 2
        assert on.any()
        theta, distance = found["truth.theta_rad"][on], found["truth.range_m"][on].astype(np.float64)
        across = distance * np.sin(theta) - 0.009 * aim.time[on]
        assert np.abs(across).max() < 0.05 + 20e-6
    # The four patterns look from 3 ms to 1.28 s: slots 0, 0, 1 and 2.
    assert fast.windows[0].rendered == 3


@pytest.mark.slow
def test_background_is_the_raster_s(device: Device) -> None:
    """Claim: the background that patterns see in windows is the raster's, within what both state as their errors.

    Set-up: a raster of 24 × 20 voxels over disc, ball and step under Sun and Earth, measured as a raster and as one
    pattern. Expected: the differences over their joint standard errors have a mean square near 1; errors of neighbours
    are correlated over a window of four bins and three rows, and their sizes averaged, so that 480 voxels count as some
    40. Tolerance: the bounds of χ² with 40 degrees of freedom at 10⁻⁴, mean within 1.5 %.
    """
    scan = {
        "type": "raster",
        "rows": 20,
        "columns": 24,
        "horizontal": [-0.05, 0.05],
        "vertical": [-0.02, 0.02],
    }
    known = scenario(scan=scan, lighting=SUN)
    bench = Instrument(known, device="cpu")
    aim = raster_aim(bench.scenario.raster, np.arange(480, dtype=np.uint32), known.scanner.dwell)
    ours, theirs = FrozenInstrument(bench).measure(aim), bench.measure(aim)
    assert theirs["background"].min() > 0.0
    error = np.hypot(ours["background_error"], theirs["background_error"])
    apart = (ours["background"] - theirs["background"]) / error
    assert claims.mean_square(apart, freedom=40.0)
    assert abs(ours["background"].mean() / theirs["background"].mean() - 1.0) < 0.015
    assert np.median(error / theirs["background"]) < 0.1


@pytest.mark.slow
def test_photodiode_sees_the_raster_s_background(device: Device) -> None:
    """Claim: time of flight sees the same background in a pattern's windows as in a raster.

    Set-up: 12 × 16 voxels over disc, ball and step, ranging by both; the fast kernels leave them to the instrument.
    Expected: the light on the photodiode alike but for the paths' noise. Tolerance: mean within 2 %, rms within 6 %
    of the mean (found 0.02 % and 1.3 %): the field averages eight bins, and no error is stated.
    """
    scan = {
        "type": "raster",
        "rows": 12,
        "columns": 16,
        "horizontal": [-0.05, 0.05],
        "vertical": [-0.02, 0.02],
    }
    known = scenario(scan=scan, lighting=SUN, ranging="both")
    bench = Instrument(known, device="cpu")
    fast, aim = FrozenInstrument(bench), raster_aim(known.raster, np.arange(192, dtype=np.uint32), DWELL)
    assert not fast.fast
    ours, theirs = (measured["tof.background_w"] for measured in (fast.measure(aim), bench.measure(aim)))
    assert theirs.min() > 0.0
    assert abs(ours.mean() / theirs.mean() - 1.0) < 0.02
    assert np.sqrt(np.mean((ours - theirs) ** 2)) < 0.06 * theirs.mean()


def test_other_ranging_is_measured_by_the_instrument(device: Device) -> None:
    """Claim: time of flight is measured by the instrument itself."""
    bench = Instrument(scenario(ranging="tof"), device="cpu")
    fast, aim = FrozenInstrument(bench), pattern(0, points=16)
    assert not fast.fast
    assert same(fast.measure(aim), bench.measure(aim))
