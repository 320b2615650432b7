"""Light that is kept and made into signals again, one voxel's record, a look at a scene, a raster between two
visits."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim import RangeImage, Scenario, load_scenario, simulate
from scanner_sim.config import load_scanner
from scanner_sim.config.preset import shipped_presets
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.instrument.closed_loop.raster_between import between_visits, measure_raster
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.reprocess import KeptSignals, Reprocessing
from scanner_sim.instrument.signal_records import RECORDERS, WaveformRecorder, recorded
from scanner_sim.instrument.simulate_signals import voxel_shots
from scanner_sim.instrument.view_scene import view_scene
from scanner_sim.instrument.viewing import _signals, surroundings_of
from scanner_sim.instrument.voxel_records import voxel_record
from scanner_sim.products.files import signal_files
from scanner_sim.products.files.signal_files import write_signals
from scanner_sim.products.signal_set import SignalSet
from scanner_sim.ranging.axes import Axes
from scanner_sim.render.beam.splitter import BOUNCE_CLUSTERS

pytestmark = pytest.mark.usefixtures("device")

C = 299_792_458.0
ROWS, COLUMNS = 3, 5


def scene(**changes: Any) -> Scenario:
    objects = [
        {
            "name": "wall",
            "shape": "rectangle",
            "size": (4.0, 4.0),
            "position": (0.0, 0.0, 9.0),
            "material": "grey_reference",
        },
        {
            "name": "ball",
            "shape": "sphere",
            "diameter": 0.6,
            "position": (0.45, 0.0, 7.0),
            "material": "z93_white",
        },
    ]
    scan = {
        "type": "raster",
        "rows": ROWS,
        "columns": COLUMNS,
        "horizontal": (-0.06, 0.06),
        "vertical": (-0.03, 0.03),
    }
    return load_scenario(
        {
            "schema": 1,
            "seed": 3,
            "ranging": "both",
            "scene": {"objects": objects},
            "scan": scan,
            "scanner": {"laser_off": 0.3, "lidar": {"photodiode": {"noise": {"clock": False}}}},
            "output": {"lines": "all", "waveforms": "all", "pictures": False},
        }
        | changes
    )


def signals(scenario: Scenario, name: str) -> SignalSet:
    """Return the lines or waveforms of all voxels."""
    instrument = Instrument(scenario, device="cpu")
    (found,) = recorded(instrument, RECORDERS[name](instrument), voxel_shots(scenario, None))
    return found


@pytest.fixture(scope="module")
def image() -> RangeImage:
    return simulate(scene(), device="cpu")


@pytest.fixture(scope="module")
def lines() -> SignalSet:
    return signals(scene(), "triangulation")


@pytest.fixture(scope="module")
def waveforms() -> SignalSet:
    return signals(scene(), "tof")


def layers_alike(one: RangeImage, other: RangeImage) -> bool:
    alike = all(one[name].tobytes() == other[name].tobytes() for name in one.channels)
    return list(one.channels) == list(other.channels) and alike


def test_kept_light_makes_the_image_of_a_whole_run(
    image: RangeImage, lines: SignalSet, waveforms: SignalSet, tmp_path: Path
) -> None:
    """Claim: without a change the bytes of all layers; with another seed and estimator those of a run of that scenario,
    and the lines those of a run."""
    write_signals(tmp_path / "lines.parquet", [lines])
    write_signals(tmp_path / "waveforms.parquet", [waveforms])
    kept = KeptSignals.find(tmp_path)
    assert kept.whole
    told: list[tuple[int, int]] = []
    same = Reprocessing(kept, kept.changed([]), device="cpu")
    assert layers_alike(same.image(lambda *done: told.append(done)), image)
    assert told == [(ROWS * COLUMNS, ROWS * COLUMNS)]
    changed = kept.changed(["seed=4", "processing.peak=gaussian"])
    assert changed.transport.light_seed == 3
    again = Reprocessing(kept, changed, device="cpu")
    assert not layers_alike(again.image(), image)
    assert layers_alike(again.image(), simulate(changed, device="cpu"))
    for name in ("triangulation", "tof"):
        parts = again.parts(name)
        assert parts is not None
        (part,) = parts
        whole = signals(changed, name)
        assert set(part) == set(whole)
        for column in whole:
            assert part[column].tobytes() == whole[column].tobytes(), column


@pytest.mark.parametrize(("name", "amount"), [("triangulation", "cluster_w"), ("tof", "echo_share")])
def test_runs_that_share_their_light_keep_the_same(name: str, amount: str) -> None:
    """Claim: of two seeds with one ``transport.light_seed`` the light that is kept is the same to the byte, that of
    random paths over both sides of a corner too, and what noise makes of it is not; another seed of the light has other
    paths."""
    wall = {"shape": "rectangle", "size": (4.0, 4.0), "material": "z93_white"}
    side = {"position": (0.2, 0.0, 8.0), "rotation": {"axis": "y", "angle": -0.5 * math.pi}}
    corner = [wall | {"name": "wall", "position": (0.0, 0.0, 9.0)}, wall | side | {"name": "side"}]

    def kept(seed: int, light: int | None) -> SignalSet:
        transport = {"light_seed": light, "bounces": 2, "bounce_paths": 32}
        scanner = {"lidar": {"photodiode": {"field_of_view": 0.2}}}
        return signals(
            scene(seed=seed, transport=transport, scanner=scanner, scene={"objects": corner}), name
        )

    def of_paths(found: SignalSet) -> Any:
        shots = np.split(found[amount], np.cumsum(found["clusters"])[:-1])
        return np.concatenate([shot[-BOUNCE_CLUSTERS:] for shot in shots])

    own, shared, other = kept(3, None), kept(4, 3), kept(3, 4)
    columns = [column for column in RECORDERS[name].kept if column in own]
    assert amount in columns
    for column in columns:
        assert own[column].tobytes() == shared[column].tobytes(), column
    assert (of_paths(own) != of_paths(other)).any()
    assert (own["number"] != shared["number"]).any()


def test_kept_light_is_read_in_parts(
    lines: SignalSet, waveforms: SignalSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: fifteen voxels by four, the last three alone, in their order, and of each the light that was kept."""
    monkeypatch.setattr(signal_files, "_ROWS", 4)
    monkeypatch.setattr(signal_files, "SAMPLES_TOGETHER", 1)
    write_signals(tmp_path / "lines.parquet", [lines])
    write_signals(tmp_path / "waveforms.parquet", [waveforms])
    kept = KeptSignals.find(tmp_path)
    again = Reprocessing(kept, kept.changed([]), device="cpu")
    parts = list(kept.columns(again.scenario, again.recorders))
    assert [shots.tolist() for shots, _ in parts] == [
        [0, 1, 2, 3],
        [4, 5, 6, 7],
        [8, 9, 10, 11],
        [12, 13, 14],
    ]
    for name, whole in (("triangulation", lines), ("tof", waveforms)):
        for column in again.recorders[name].kept:
            if column in whole:
                found = np.concatenate([light[name][column] for _, light in parts])
                np.testing.assert_array_equal(found, whole[column], err_msg=column)


def test_kept_light_of_more_materials_than_objects_makes_its_image(tmp_path: Path) -> None:
    """Claim: discs and plate of one array are told apart as in a whole run: its names and the bytes of all layers."""
    node = {"name": "node", "array": {"diameter": 0.2, "plate": 0.5}, "position": (0.0, 0.0, 5.0)}
    only = scene(
        scene={"objects": [node]}, ranging="triangulation", output={"lines": "all", "pictures": False}
    )
    whole = simulate(only, device="cpu")
    assert len(whole.materials) > len(whole.objects) == 1
    assert {0.0, 1.0, 2.0} <= set(whole["truth.material"].ravel().tolist())
    write_signals(tmp_path / "lines.parquet", [signals(only, "triangulation")])
    kept = KeptSignals.find(tmp_path)
    again = Reprocessing(kept, kept.changed([]), device="cpu").image()
    assert again.materials == whole.materials
    assert layers_alike(again, whole)


def test_kept_pulses_have_the_speckle_of_their_own_surface() -> None:
    """Claim: before a wall of C² ½ stands a plate that keeps the polarisation of light, C² of 1, with an edge in the
    beams of the middle column, which are read apart: of each pulse what is read of its kept light is what is heard at
    once, to the bit."""
    shape = {"shape": "rectangle", "size": (4.0, 4.0)}
    wall = {"name": "wall", **shape, "position": (0.0, 0.0, 9.0), "material": "grey_reference"}
    polished = {"reflectance": 0.5, "depolarisation": 0.0}
    plate = {"name": "plate", **shape, "position": (2.0, 0.0, 7.0), "material": polished}
    known = scene(ranging="tof", scene={"objects": [wall, plate]}, output={})
    instrument = Instrument(known, device="cpu")
    recorder, shots = WaveformRecorder(instrument), voxel_shots(known, None)
    (found,) = recorded(instrument, recorder, shots)
    assert set(found["coherence"].tolist()) == {0.5, 1.0}
    assert len(set(found["clusters"].tolist())) > 1
    image = simulate(known, device="cpu")
    np.testing.assert_array_equal(found["tof.snr_detection"], image["tof.snr_detection"].ravel())


@pytest.mark.parametrize("word", ["point", "normal", "incidence"])
def test_truth_that_is_not_kept_with_the_light_is_left_out_or_refused(word: str, tmp_path: Path) -> None:
    """Claim: of a run with true points, normals or angles an image is made only where they are no longer asked for, as
    the fault says; it has what a run without them has. More truth than there was cannot be had."""
    output = {"lines": "all", "waveforms": "all", "pictures": False}
    asked = scene(output=output | {"truth": [word, "pose"]})
    write_signals(tmp_path / "lines.parquet", [signals(asked, "triangulation")])
    write_signals(tmp_path / "waveforms.parquet", [signals(asked, "tof")])
    kept = KeptSignals.find(tmp_path)
    for same in ([], [f"output.truth=[{word}]"]):
        with pytest.raises(ScenarioError) as refused:
            kept.changed(same)
        (fault,) = refused.value.faults
        assert fault.location == "output.truth"
        assert "--set output.truth=[]" in fault.remedy
    for rest in ("", "pose"):
        less = kept.changed([f"output.truth=[{rest}]"])
        plain = scene(output=output | {"truth": [rest] if rest else []})
        assert layers_alike(Reprocessing(kept, less, device="cpu").image(), simulate(plain, device="cpu"))
    with pytest.raises(ScenarioError, match="changes the light"):
        kept.changed([f"output.truth=[{'normal' if word == 'point' else 'point'}]"])


@pytest.fixture(scope="module")
def sunlit() -> SignalSet:
    """Lines without noise or speckle; the Sun stands aside, so that pixels differ."""
    quiet = dict.fromkeys(("shot", "read", "prnu", "quantisation", "saturation"), False)
    scanner = {"laser_off": 0.3, "laser": {"speckle": False}, "position_sensor": {"noise": quiet}}
    sun = {"sun": {"direction": (0.3, -0.4, -0.85)}}
    return signals(scene(scanner=scanner, lighting=sun, ranging="triangulation", output={}), "triangulation")


def test_a_lines_background_has_its_peak_on_the_brightest_pixel(sunlit: SignalSet) -> None:
    """Claim: of each line, by the line itself."""
    background = sunlit["background_w"]
    np.testing.assert_array_equal(sunlit["background_peak_w"], background.max(axis=1))
    assert (sunlit["background_peak_w"] > 0.0).all()
    assert (background.sum(axis=1) > 10.0 * background.max(axis=1)).all()


def test_both_exposures_of_a_line_have_their_light_for_their_share_of_the_dwell(sunlit: SignalSet) -> None:
    """Claim: (QE λ/(hc) light + dark current) times 0.7 of the dwell for laser and background, and 0.3 of it for the
    background alone, to a tenth of an electron."""
    scanner, sensor = scene().scanner, scene().scanner.position_sensor
    per_joule = 1.5e-6 / (6.62607015e-34 * C) * sensor.quantum_efficiency
    background = sunlit["background_w"].astype(float)
    lights = {"number": (background + sunlit["laser_w"], 0.7), "number_off": (background, 0.3)}
    for name, (light, share) in lights.items():
        charge = (sunlit[name].astype(float) - sensor.bias) * sensor.electrons_per_number
        wanted = (per_joule * light + sensor.dark_current) * share * scanner.dwell
        np.testing.assert_allclose(charge, wanted, rtol=1e-5, atol=0.1, err_msg=name)


def test_a_line_is_its_light_in_digital_numbers(lines: SignalSet) -> None:
    """Claim: bias + (laser · (1 − o) dwell + dark) QE λ/(hc)/gain within six σ of shot, read and pixels' noise, where
    speckle leaves the sum; voxels are row by row."""
    scenario = scene()
    scanner, sensor = scenario.scanner, scenario.scanner.position_sensor
    np.testing.assert_array_equal(lines["row"], np.repeat(np.arange(ROWS), COLUMNS))
    np.testing.assert_array_equal(lines["column"], np.tile(np.arange(COLUMNS), ROWS))
    theta = lines["theta_rad"].reshape(ROWS, COLUMNS)
    np.testing.assert_allclose(
        np.diff(theta, axis=1), np.full((ROWS, COLUMNS - 1), theta[0, 1] - theta[0, 0])
    )
    numbers = lines.about.numbers
    per_watt = 1.5e-6 / (6.62607015e-34 * C) * sensor.quantum_efficiency * 0.7 * scanner.dwell
    assert numbers["electrons_per_watt"] == pytest.approx(per_watt, rel=1e-6)
    assert numbers["off_scale"] == pytest.approx(0.7 / 0.3)
    charge = (lines["number"].astype(float) - numbers["bias"]) * numbers["electrons_per_number"]
    dark = numbers["dark_electron"]
    light = lines["laser_w"].sum(axis=1) * per_watt
    np.testing.assert_allclose(lines["laser_w"].sum(axis=1), lines["laser_total_w"], rtol=1e-2)
    noise = np.sqrt(sensor.pixels * (sensor.read_noise**2 + dark) + light)
    # Speckle of a line's light: less than half of it.
    assert (np.abs((charge - dark).sum(axis=1) - light) < 6.0 * noise + 0.5 * light).all()
    p = scanner.receiver.focal_length * scanner.receiver.baseline
    turn = lines["theta_rad"]
    p = p * np.cos(turn) / (lines["truth.range_m"] - scanner.receiver.baseline * np.sin(turn))
    pixel = (p - sensor.offset) / sensor.pitch - 0.5
    apart = scanner.receiver.focal_length * scanner.mirrors.synchronisation / sensor.pitch
    # The light goes by the true difference of the mirrors, the design by none: six of its σ.
    np.testing.assert_allclose(lines["truth.peak_px"], pixel, atol=6.0 * apart)
    away = (lines["peak_px"] - pixel) / lines["sigma_peak_px"]
    assert np.nanmax(np.abs(away[lines["truth.object"] == 1])) < 6.0


def test_a_waveform_peaks_at_its_delay(waveforms: SignalSet) -> None:
    """Claim: 2R/c to six σ, and what is expected without noise is highest there, to a sample and the pulse's skew."""
    delay = 2.0 * waveforms["truth.range_m"] / C
    valid = waveforms["truth.object"] == 1
    assert valid.sum() > 5
    away = (waveforms["delay_s"] - delay) / waveforms["sigma_delay_s"]
    assert np.abs(away[valid]).max() < 6.0
    numbers = waveforms.about.numbers
    highest = numbers["start_s"] + waveforms["expected_a"].argmax(axis=1) / numbers["rate_hz"]
    assert np.abs(highest - delay)[valid].max() < 2.0 / numbers["rate_hz"]
    expected = waveforms["expected_a"].max(axis=1)[valid]
    seen = waveforms["number"].max(axis=1)[valid] * numbers["step_a"]
    np.testing.assert_allclose(seen, expected, rtol=0.6)


@pytest.mark.parametrize("voxel", [(0, 0), (1, 3), (2, 4)])
def test_the_record_of_a_voxel_is_that_of_its_image(
    image: RangeImage, lines: SignalSet, voxel: tuple[int, int]
) -> None:
    """Claim: numbers of the image, the line of the run, its charges and its light by the stated units, and the truth by
    eq 1; neighbours have their say as in the image."""
    scenario = scene()
    sensor = scenario.scanner.position_sensor
    record = voxel_record(Instrument(scenario, device="cpu"), *voxel)
    row = voxel[0] * COLUMNS + voxel[1]
    assert (record.row, record.column) == voxel
    assert record.theta == pytest.approx(lines["theta_rad"][row])
    assert record.phi == pytest.approx(lines["phi_rad"][row])
    for name in ("peak_px", "sigma_peak_px", "range_m", "sigma_range_m", "sigma_texture_m"):
        np.testing.assert_array_equal(np.float32(getattr(record, name)), image[name][voxel])
    assert int(record.status) == image["status"][voxel]
    assert record.truth_range_m == image["truth.range_m"][voxel]
    assert record.truth_peak_px == pytest.approx(float(lines["truth.peak_px"][row]), abs=1e-3)
    numbers = lines.about.numbers
    charge, off = (
        (lines[name][row].astype(float) - numbers["bias"]) * numbers["electrons_per_number"]
        for name in ("number", "number_off")
    )
    ambient = off * numbers["off_scale"] - numbers["dark_electron"]
    np.testing.assert_allclose(
        record.pixel_signal, charge - numbers["dark_electron"] - ambient, rtol=1e-6, atol=1.0
    )
    np.testing.assert_allclose(
        record.expected_signal, lines["laser_w"][row] * numbers["electrons_per_watt"], rtol=0.5, atol=1e3
    )
    floor = np.median(record.noise_sigma)
    assert record.threshold == pytest.approx(scenario.processing.threshold * floor, rel=0.05)
    # A pixel counts as full five σ of reading before its well is; what it holds in the dark is not shown.
    well = min(sensor.full_well, (sensor.largest_number - sensor.bias) * sensor.electrons_per_number)
    full = well - 5.0 * sensor.read_noise - sensor.dark_current * 0.7 * scenario.scanner.dwell
    assert record.saturation_level == pytest.approx(full, rel=1e-6)
    assert (record.window is None) == bool(np.isnan(record.peak_px))
    if record.window is not None:
        assert record.window[0] < record.peak_px < record.window[1]


def test_a_page_reads_lines_of_every_second_row_and_column_again(lines: SignalSet, tmp_path: Path) -> None:
    """Claim: those of the file and those that are simulated again are the same, whose threshold is the dark line's."""
    write_signals(tmp_path / "lines.parquet", [lines])
    scenario = scene(ranging="triangulation", output={"lines": "all", "pictures": False})
    (fresh,) = _signals(scenario, None, 2, "cpu", None)
    (kept,) = _signals(scenario, tmp_path, 2, "cpu", None)
    assert str(fresh) == str(kept)


def test_a_look_at_a_scene_sees_what_stands_where() -> None:
    """Claim: through the middle of each dot the wall's distance is 9 m/cos, a cosine of cos, the ball before it at the
    right; its share is that of the dots within the scan, to one row of them."""
    view = view_scene(scene(), device="cpu")
    rows, columns = view.number.shape
    assert columns == 640
    wide = view.window[0]
    assert wide == pytest.approx((-0.075, 0.075))
    place = wide[0] + (np.arange(columns) + 0.5) * (wide[1] - wide[0]) / columns
    high = view.window[1][0] + (np.arange(rows) + 0.5) * (view.window[1][1] - view.window[1][0]) / rows
    x, y = np.meshgrid(np.tan(place), np.tan(high))
    length = np.sqrt(1.0 + x * x + y * y)
    ball = np.hypot(7.0 * x - 0.45, 7.0 * y) < 0.298
    wall = np.hypot(7.0 * x - 0.45, 7.0 * y) > 0.31
    names = [one.name for one in view.objects]
    assert (view.number[ball] == 1 + names.index("ball")).all()
    assert (view.number[wall] == 1 + names.index("wall")).all()
    np.testing.assert_allclose(view.distance[wall], 9.0 * length[wall], rtol=1e-5)
    np.testing.assert_allclose(view.shade[wall], 1.0 / length[wall], rtol=1e-5)
    assert view.distance[ball].min() == pytest.approx(math.hypot(7.0, 0.45) - 0.3, rel=1e-4)
    inside = (np.abs(x) <= np.tan(0.06)) & (np.abs(y) <= np.tan(0.03))
    share = (view.number[inside] == 1 + names.index("ball")).mean()
    (seen,) = (one.share for one in view.objects if one.name == "ball")
    assert seen == pytest.approx(share, abs=0.01)
    around = surroundings_of(scene())
    assert around.horizontal == (-0.06, 0.06)
    sensor = scene().scanner.position_sensor
    assert around.array == pytest.approx((sensor.offset, sensor.offset + sensor.pitch * sensor.pixels))
    built = {
        "axis_separation": 2e-3,
        "axis_offset": 1e-3,
        "axis_skew": 3e-3,
        "base": 4e-3,
        "array_offset": 5e-5,
    }
    around = surroundings_of(scene(scanner={"as_built": built}))
    mirrors, receiver = scene().scanner.mirrors, scene().scanner.receiver
    assert around.axes == Axes(mirrors.axis_separation + 2e-3, 1e-3, 3e-3)
    assert around.baseline == pytest.approx(receiver.baseline + 4e-3)
    assert around.array[0] == pytest.approx(sensor.offset + 5e-5)


@pytest.mark.parametrize("name", shipped_presets())
def test_a_page_shows_from_where_to_where_an_instrument_sees(name: str) -> None:
    """Claim: on the axis, by the array of its own tilt, or by the digitiser where time of flight is alone; a range gate
    that is narrower ends it."""
    scanner = load_scanner(name)
    near, far = scanner.seen_by(scanner.rangefinders[0])
    target = {"shape": "rectangle", "size": (0.1, 0.1), "material": "grey_reference"}
    told = {
        "schema": 1,
        "scanner": {"preset": name},
        "scene": {"objects": [{"name": "target", "position": (0.0, 0.0, 1.2 * near), **target}]},
        "scan": {"type": "fixed", "points": 4},
    }
    around = surroundings_of(load_scenario(told))
    assert (around.near, around.far) == pytest.approx((near, far))
    gate = 1.1 * near, 1.5 * near
    gated = surroundings_of(load_scenario({**told, "processing": {"range_gate": gate}}))
    assert (gated.near, gated.far) == pytest.approx(gate)


def test_a_raster_between_visits_has_things_where_they_are_by_then() -> None:
    """Claim: a wall that goes away by 1 m/s is seen at 9 m + t at each voxel's time t; shots are numbered on, so that
    another first number has other noise and the same truth. Of six ranges in steps of a micrometre, of a σ of one
    millimetre and more, two are alike once in a million times."""
    motion = {"type": "twist", "velocity": (0.0, 0.0, 1.0)}
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": (9.0, 9.0),
        "position": (0.0, 0.0, 9.0),
        "motion": motion,
        "material": "z93_white",
    }
    target = {"name": "node", "array": {"diameter": 0.1, "plate": 0.2}, "position": (0.0, 0.0, 5.0)}
    told = load_scenario(
        {
            "schema": 1,
            "scene": {"objects": [target, wall]},
            "scan": {"type": "track", "targets": ["node"]},
        }
    )
    raster = between_visits(told, 2, 3, (0.05, 0.1), (-0.05, 0.05))
    one, other = (measure_raster(told, raster, 2.0, first, device="cpu", threads=None) for first in (0, 1000))
    phi, theta = np.meshgrid(*raster.angles()[::-1], indexing="ij")
    dwell = told.scanner.dwell
    time = 2.0 + (np.arange(6).reshape(2, 3) + 0.5) * dwell
    # z = (R cosΘ − D_g) cosφ + D_g; the mirrors' jitter of some microradians moves R by less than 0.1 mm.
    separation = told.scanner.mirrors.axis_separation
    reach = ((9.0 + time - separation) / np.cos(phi) + separation) / np.cos(theta)
    for image in (one, other):
        np.testing.assert_allclose(image["truth.range_m"], reach, atol=1e-4)
    assert np.count_nonzero(one["range_m"] == other["range_m"]) <= 1


def test_the_sky_of_a_raster_between_visits_is_that_of_its_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of six voxels of a dwell from 2 s on the Sun stands where it does at 2 s and three dwells."""
    told = load_scenario(
        {
            "schema": 1,
            "scene": {
                "objects": [{"name": "node", "array": {"diameter": 0.1, "plate": 0.2}, "position": (0, 0, 5)}]
            },
            "scan": {"type": "track", "targets": ["node"]},
        }
    )
    asked: list[float] = []

    def at(self: Any, time: float) -> Any:
        asked.append(time)
        raise InterruptedError

    monkeypatch.setattr(type(told.lighting), "at", at)
    raster = between_visits(told, 2, 3, (0.05, 0.1), (-0.05, 0.05))
    with pytest.raises(InterruptedError):
        measure_raster(told, raster, 2.0, 0, device="cpu", threads=None)
    assert asked == pytest.approx([2.0 + 3.0 * told.scanner.dwell], rel=1e-9)
