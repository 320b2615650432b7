"""Small sums of the instrument: what a picture of the scene shows, what fits on a page, what is changed, what fits
into memory, and how mirrors go to a raster between visits."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import Scenario, load_scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument import neighbourhood, simulate_signals, viewing
from scanner_sim.instrument.closed_loop.raster_between import between_visits, first_time, mirrors_after
from scanner_sim.instrument.memory import background_bins, background_rows, background_times
from scanner_sim.instrument.reprocess import AFTER_LIGHT, _acts_after_light, changed_keys
from scanner_sim.instrument.simulate_signals import voxel_shots
from scanner_sim.instrument.view_scene import _dots, _middles, _wider, field_of_view
from scanner_sim.instrument.voxel_records import _window
from scanner_sim.optics.jump import jump_time
from scanner_sim.scan.ways import mirrors_at

SCAN = {"rows": 30, "columns": 50, "horizontal": (-0.1, 0.15), "vertical": (-0.02, 0.06)}
LIT = {"sun": {"direction": (0.0, 0.0, -1.0)}}


def scenario(**changes: Any) -> Scenario:
    return load_scenario({"schema": 1, "scan": {"type": "raster", **SCAN}} | changes)


@pytest.mark.parametrize(
    ("ends", "window"),
    [
        ((0.0, 0.4), (-0.05, 0.45)),
        # A line is a hundredth of a radian wide.
        ((0.2, 0.2), (0.195, 0.205)),
        ((-1.4, 1.4), (-1.5, 1.5)),
        ((0.5, 1.5), (0.375, 1.5)),
    ],
)
def test_a_picture_is_a_quarter_wider_than_the_scan(
    ends: tuple[float, float], window: tuple[float, float]
) -> None:
    assert _wider(ends) == pytest.approx(window)


def test_dots_of_a_picture_are_square() -> None:
    """Claim: 640 along the longer side, 32 at least, each seen through its middle."""
    assert _dots(((-0.2, 0.2), (-0.05, 0.15))) == (320, 640)
    assert _dots(((0.0, 0.1), (0.0, 0.4))) == (640, 160)
    assert _dots(((0.0, 1.0), (0.0, 1e-3))) == (32, 640)
    np.testing.assert_allclose(_middles((-0.2, 0.2), 4), [-0.15, -0.05, 0.05, 0.15])


def test_a_scan_covers_its_field_and_the_ranges_of_all_that_measures() -> None:
    found = field_of_view(scenario())
    assert (found.horizontal, found.vertical) == (SCAN["horizontal"], SCAN["vertical"])
    scanner = scenario().scanner
    both = field_of_view(scenario(ranging="both"))
    line, pulse = scanner.seen_by("triangulation"), scanner.seen_by("tof")
    assert both.near == min(line[0], pulse[0])
    assert both.far == max(line[1], pulse[1])


def test_a_page_is_thinned_out_until_it_fits() -> None:
    """Claim: every nth of something along each of its axes leaves an nth, or n², of it; and where there is hardly any
    room, a hundredth."""
    assert viewing._step(100.0, 100.0, 2) == 1
    assert viewing._step(101.0, 100.0, 1) == 2
    assert viewing._step(399.0, 100.0, 2) == 2
    assert viewing._step(401.0, 100.0, 2) == 3
    assert viewing._step(399.0, 100.0, 1) == 4
    assert viewing._step(1e6, -5.0, 2) == 10
    assert [viewing._th(step) for step in (2, 3, 4)] == ["second", "third", "4th"]


def test_what_a_page_of_an_image_takes() -> None:
    """Claim: 0.7 MB of the page; 1.8 bytes for each voxel and layer, of which three are the points; 1.6 for each pixel
    of a window, 2.2 times as much with a second exposure: the first MB that leaves all as it is."""
    told = scenario()
    image: Any = SimpleNamespace(shape=(30, 50))

    class Layers(SimpleNamespace):
        def __contains__(self, name: str) -> bool:
            return name in ("range_m", "status")

    image = Layers(shape=(30, 50))
    own = [name for name in (*viewing.LAYERS, *viewing.CODES) if name in image]
    voxels = 1500 * (len(own) + 3) * 1.8
    for off in (0.0, 0.3):
        told = scenario(scanner={"laser_off": off})
        lines = 1500 * 1.6 * viewing.WINDOW["line"] * (2.2 if off else 1.0)
        whole = 1e-6 * (0.7e6 + voxels + lines)
        assert viewing._fitting(image, told, True, 1.0001 * whole)[:2] == (1, 1)
        step, line_step, notes = viewing._fitting(image, told, True, 0.9999 * whole)
        assert (step, line_step) == (1, 2)
        assert "second row and column has its lines" in notes[0]
    assert viewing._fitting(image, told, False, 1e-6 * (0.7e6 + 1.0001 * voxels))[:2] == (1, 1)
    step, _, notes = viewing._fitting(image, told, False, 1e-6 * (0.7e6 + 0.9999 * voxels))
    assert step == 2
    assert "second row and column of voxels" in notes[0]


def test_lines_of_a_thinned_page_belong_to_voxels_that_are_shown() -> None:
    """Claim: where every second row and column of voxels is shown, and of these every kth has its line, lines stand at
    every 2kth: the room is what such a page takes."""
    layers = [name for name in (*viewing.LAYERS, *viewing.CODES) if name in ("range_m", "status")]

    class Layers(SimpleNamespace):
        def __contains__(self, name: str) -> bool:
            return name in layers

    voxels = 1500 * (len(layers) + 3) * 1.8
    lines = 1500 * 1.6 * viewing.WINDOW["line"]
    fewest = math.ceil(math.sqrt(lines / (2.0 * voxels)))
    image: Any = Layers(shape=(30, 50))
    for kth in (fewest, fewest + 1):
        room = voxels / 4.0 + 1.0001 * lines / (2 * kth) ** 2
        assert viewing._fitting(image, scenario(), True, 1e-6 * (0.7e6 + room))[:2] == (2, 2 * kth)


@pytest.mark.parametrize("off", [0.0, 0.25])
def test_a_page_draws_the_threshold_in_electrons(off: float) -> None:
    """Claim: so many times the noise of a pixel in the dark, by hand: read² + step²/12 + dark charge, and with a
    quarter of the dwell without the laser 3² times its read² + step²/12 and dark charge."""
    sensor = {"read_noise": 300.0, "dark_current": 4e8, "full_well": 1e6, "bias": 0}
    told = scenario(
        processing={"threshold": 4.5}, scanner={"laser_off": off, "rate": 5e3, "position_sensor": sensor}
    )
    constant = 300.0**2 + told.scanner.position_sensor.electrons_per_number**2 / 12.0
    variance = constant + 4e8 * 2e-4
    if off:
        variance = constant + 4e8 * 1.5e-4 + 9.0 * (constant + 4e8 * 0.5e-4)
    assert viewing._threshold(told) == pytest.approx(4.5 * math.sqrt(variance), rel=1e-9)


def test_lines_of_every_third_row_and_column_are_simulated() -> None:
    shots = np.asarray(viewing._shots(scenario(), 3)).ravel()
    rows, columns = np.arange(0, 30, 3), np.arange(0, 50, 3)
    assert sorted(shots.tolist()) == sorted((rows[:, None] * 50 + columns).ravel().tolist())


@pytest.mark.parametrize(
    ("peak", "window"), [(10.0, (7, 13)), (11.4, (8, 14)), (1.2, (0, 4)), (18.6, (16, 19)), (math.nan, None)]
)
def test_the_estimator_read_the_pixels_about_the_brightest(
    peak: float, window: tuple[int, int] | None
) -> None:
    """Claim: the centre of mass reads three pixels to each side of the brightest within one of the peak."""
    line = np.exp(-0.5 * ((np.arange(20) - (0.0 if math.isnan(peak) else peak)) / 1.3) ** 2)
    assert _window(line, peak, "centre_of_mass") == window
    # What is brighter farther away is another peak.
    beside = line.copy()
    beside[np.abs(np.arange(20) - (0.0 if math.isnan(peak) else round(peak))) == 2] = 9.0
    assert _window(beside, peak, "centre_of_mass") == window
    assert _window(line, peak, "of my own") is None  # type: ignore[arg-type]


@pytest.mark.parametrize("beside", [-1, 0, 1])
@pytest.mark.parametrize("middle", [1, 10, 18])
def test_the_brightest_may_be_on_either_side_of_the_peak(middle: int, beside: int) -> None:
    """Claim: of an uneven spot, whose peak lies up to a pixel from its brightest pixel on either side, those about the
    brightest were read, whichever part of a pixel the peak is at, also at either end of the line."""
    line = np.ones(20)
    line[middle + beside] = 5.0
    # What is brighter two pixels from the peak is another one.
    line[[place for place in (middle - 2, middle + 2) if 0 <= place < 20]] = 9.0
    window = max(middle + beside - 3, 0), min(middle + beside + 3, 19)
    for part in (-0.4, 0.0, 0.4):
        assert _window(line, middle + part, "centre_of_mass") == window


def test_keys_of_what_was_changed_and_whether_the_light_stays() -> None:
    """Claim: a key belongs to a block only behind its dot."""
    new = scenario(seed=4, scanner={"position_sensor": {"gain": 7.0}}, processing={"threshold": 7.5})
    assert sorted(changed_keys(scenario(), new)) == [
        "processing.threshold",
        "scanner.position_sensor.gain",
        "seed",
    ]
    assert changed_keys(new, new) == []
    after = ("seed", "processing.validation.mixed", "scanner.lidar.photodiode.gain", "scanner.laser.speckle")
    assert all(map(_acts_after_light, after))
    before = (
        "seeds",
        "scanner.laser.power",
        "scanner.position_sensor.pitch",
        "scanner.lidar.photodiode.place",
    )
    assert not any(map(_acts_after_light, before))
    assert len(set(AFTER_LIGHT)) == len(AFTER_LIGHT)


def test_mirrors_jump_to_a_raster_and_rest_at_its_end() -> None:
    """Claim: the farther axis decides; the first voxel is at the smaller angles, the last at the larger."""
    told = scenario()
    raster = between_visits(told, 4, 6, (-0.1, 0.15), (-0.02, 0.06))
    servos = told.scanner.galvanometers
    for theta, phi, far in ((-0.05, -0.3, 0.28), (0.2, 0.0, 0.3)):
        wanted = 7.0 + float(jump_time(servos, far))
        assert first_time(told, raster, mirrors_at(theta, phi), 7.0) == pytest.approx(wanted)
    after = mirrors_after(raster, 9.0)
    assert after.state.angle.tolist() == [0.15, 0.06]
    assert (after.time, after.slope.tolist()) == (9.0, [0.0, 0.0])
    assert between_visits(told, 256, 256, (-0.1, 0.1), (-0.1, 0.1)).shots == 65536
    with pytest.raises(InputError, match="more than the 65536"):
        between_visits(told, 256, 257, (-0.1, 0.1), (-0.1, 0.1))
    with pytest.raises(InputError, match="beyond the mirrors"):
        between_visits(told, 4, 4, (-0.1, 0.9), (-0.1, 0.1))


def test_bins_of_a_background_cover_scan_and_line() -> None:
    """Claim: a row for each of the raster's, (scan + length/f)/(pitch/f) bins of each; none in the dark."""
    assert background_rows(scenario()) == (0, math.inf)
    told = scenario(lighting=LIT)
    sensor, f = told.scanner.position_sensor, told.scanner.receiver.focal_length
    rows, step = background_rows(told)
    assert (rows, step) == (30, pytest.approx(0.08 / 29))
    assert background_bins(told) == 30 * math.ceil((0.25 + 256 * sensor.pitch / f) / (sensor.pitch / f))
    spiral = {"type": "spiral", "radius": 0.1}
    open_rows, apart = background_rows(scenario(lighting=LIT, scan=spiral))
    assert apart == pytest.approx(0.5 * sensor.height / f)
    assert open_rows == math.ceil(0.2 / apart) + 4


def test_a_background_is_rendered_for_each_slot_of_what_moves() -> None:
    """Claim: an object that goes sideways at 5 m by v has v/5 rad/s; slots are powers of two of a second in which that
    is a bin, 0.5 mrad, at most."""
    item = {"name": "ball", "shape": "sphere", "diameter": 0.1, "material": "z93_white"}
    for speed, slots in ((4.9e-3, 2), (5.1e-3, 4)):
        motion = {"type": "twist", "velocity": (speed, 0.0, 0.0)}
        told = scenario(
            lighting=LIT,
            scan={"type": "spiral", "radius": 0.1},
            scene={"objects": [item | {"position": (0.0, 0.0, 5.0), "motion": motion}]},
        )
        lasts = float(told.scan.scan_time(told.scan_setup))
        assert background_times(told) == math.ceil(lasts * slots), speed
    assert background_times(scenario(lighting=LIT)) == 1


def test_voxels_are_shots_of_their_raster() -> None:
    """Claim: row times columns and column; without any all of them; what are no pairs of whole numbers is refused."""
    told = scenario(scan={"rows": 3, "columns": 7, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)})
    assert voxel_shots(told, [(0, 0), (2, 6), (1, 3)]).tolist() == [0, 20, 10]
    large = scenario(scan={"rows": 99, "columns": 300, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)})
    assert voxel_shots(large, np.array([[98, 7], [0, 100]], dtype=np.int8)).tolist() == [29407, 100]
    assert voxel_shots(told, None).tolist() == list(range(21))
    for wrong in (
        [],
        [(0.0, 1.0)],
        [(0, 1, 2)],
        [0, 1],
        [[[0, 1]]],
        [(3, 0)],
        [(0, 7)],
        [(-1, 0)],
        [(1, 2), (1, 2)],
    ):
        with pytest.raises(InputError):
            voxel_shots(told, wrong)  # type: ignore[arg-type]


def test_signals_are_made_of_the_voxels_whose_files_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: all of them, those that are named, or no file at all; of lines and of waveforms each as it is asked."""
    monkeypatch.setattr(simulate_signals, "Instrument", lambda *_, **__: "instrument")
    recorders = {name: lambda instrument, name=name: (name, instrument) for name in ("triangulation", "tof")}
    monkeypatch.setattr(simulate_signals, "RECORDERS", recorders)
    monkeypatch.setattr(
        simulate_signals,
        "recorded",
        lambda _, recorder, shots, progress: [(recorder, shots.tolist(), progress)],
    )
    asked = scenario(ranging="both", output={"lines": [(1, 3), (0, 7)], "waveforms": "all"})
    told: Any = "progress"
    for name, shots in (("triangulation", [53, 7]), ("tof", list(range(1500)))):
        parts = simulate_signals.signal_parts(asked, name, device="cpu", progress=told)
        assert parts is not None
        assert list(parts) == [((name, "instrument"), shots, told)]
        assert simulate_signals.signal_parts(scenario(ranging="both"), name, device="cpu") is None


@pytest.mark.parametrize("waist", [0.0, 6.0, 40.0])
def test_a_spot_is_half_the_radius_of_the_beam_about_its_waist(waist: float) -> None:
    """Claim: σ = w/2 of a Gaussian beam, w² = w₀² (1 + (λ (R − z₀)/(π w₀²))²), as wide before the waist as behind."""
    told = scenario(
        scanner={"laser": {"waist_distance": waist, "waist_radius": 1.5e-3, "wavelength": 1.5e-6}}
    )
    away = np.array([0.5, 6.0, 20.0])
    reach = np.concatenate([waist + away, waist - away])
    half = 0.5 * np.sqrt(1.5e-3**2 + (1.5e-6 * away / (math.pi * 1.5e-3)) ** 2)
    np.testing.assert_allclose(neighbourhood._spot(told, reach), np.tile(half, 2), rtol=1e-12)
