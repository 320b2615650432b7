"""What runs take of memory and disk, the Sun beside a frame, a pulse's height, and windows of a background, by hand."""

from __future__ import annotations

import contextlib
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from prototype import Digitiser, Photodiode, Pulse

from scanner_sim import Scenario, load_scenario
from scanner_sim.analytic import sun as judge
from scanner_sim.config.built import instrument_as_built
from scanner_sim.config.scanner import geometry_of
from scanner_sim.detector.frame.glare import Glare
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.instrument import frame_stage, memory, photograph, simulate, voxel_records
from scanner_sim.instrument.closed_loop import windows
from scanner_sim.instrument.frame_stage import Stage, electron_rates, photon_irradiance
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.neighbourhood import _travel, reach
from scanner_sim.instrument.optics_as_built import optics_as_built
from scanner_sim.instrument.time_of_flight import TimeOfFlight
from scanner_sim.optics.interior_orientation import InteriorOrientation
from scanner_sim.render.device import Device
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.light.lighting import Lighting, Sky

SHAKEN = {"turn": [(5.0, 1e-11), (500.0, 1e-15)]}
LIT = {"sun": {"direction": (0.0, 0.0, -1.0)}}
RASTER = {"type": "raster", "rows": 30, "columns": 50, "horizontal": (-0.1, 0.15), "vertical": (-0.02, 0.06)}
TARGET = {"name": "node", "array": {"diameter": 0.1, "plate": 0.2}, "position": (0.0, 0.0, 5.0)}


def scenario(**changes: Any) -> Scenario:
    return load_scenario({"schema": 1, "scan": RASTER} | changes)


def following(duration: float) -> Scenario:
    scan = {"type": "track", "targets": ["node"], "duration": duration}
    return scenario(scan=scan, scene={"objects": [TARGET]})


def limits(monkeypatch: pytest.MonkeyPatch, check: Any, needed: float) -> None:
    """Hold a check to the memory that it needs: one byte less is refused."""
    monkeypatch.setattr(memory, "_free_memory", lambda: 1.0001 * needed)
    check()
    monkeypatch.setattr(memory, "_free_memory", lambda: 0.9999 * needed)
    with pytest.raises(InputError, match="are free"):
        check()


def test_patterns_take_64_bytes_a_voxel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: as many patterns as periods have begun, of all runs together; and 0.5 GB for the program."""
    runs = [following(2.0), following(3.0)]
    scan = runs[0].following
    period = scan.visiting.turnaround + scan.pattern.points * runs[0].scanner.dwell
    each = [64.0 * math.ceil(duration / period) * scan.pattern.points for duration in (2.0, 3.0)]
    limits(monkeypatch, lambda: memory.check_patterns(runs), sum(each))
    assert memory.memory(runs[1]) == pytest.approx(0.5e9 + each[1])


def test_kept_lines_take_24_bytes_a_pixel_and_less_on_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 256 pixels at 24 bytes in memory; on the disk 1 byte, 3.5 more in the light, and 120 for a voxel; 1.2 for
    a sample of a waveform, lit or not; all voxels, or those that are named."""
    limits(monkeypatch, lambda: memory.check_signals(scenario(), "triangulation", 77), 24.0 * 256 * 77)
    samples = scenario().scanner.lidar.digitiser.samples
    limits(monkeypatch, lambda: memory.check_signals(scenario(), "tof", 77), 24.0 * samples * 77)
    assert memory.disk(scenario()) == 0.0
    line, wave = 1500 * (256.0 + 120.0), 2 * (1.2 * samples + 120.0)
    assert memory.disk(scenario(output={"lines": "all"})) == pytest.approx(line)
    more = 1500 * 3.5 * 256.0
    assert memory.disk(scenario(output={"lines": "all"}, lighting=LIT)) == pytest.approx(line + more)
    both = {"lines": "all", "waveforms": [(0, 0), (1, 2)]}
    assert memory.disk(scenario(output=both, ranging="both", lighting=LIT)) == pytest.approx(
        line + more + wave
    )


def test_the_memory_of_a_scan_is_the_sum_of_its_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: beside program, layers and one batch, 4600 bytes a shot, 220 bytes a direction of the background, and 24
    for a pixel or sample of what is kept at a time, the larger of both; layers and background alone count where the
    program is there already, and so do batches. A check speaks of what takes the most."""
    dark, lit = scenario(), scenario(lighting=LIT)
    begun = 0.5e9 + 4600.0 * 1500
    layers = memory.memory(dark) - begun
    square = scenario(scan=RASTER | {"rows": 400, "columns": 500})
    assert memory.memory(square) - memory._layers(square) == pytest.approx(0.5e9 + 4600.0 * 131072)
    assert layers > 1500 * 4 * 10
    more = 220.0 * memory.background_bins(lit)
    assert more > 0.0
    assert memory.memory(lit) - memory.memory(dark) == pytest.approx(more)
    kept = scenario(lighting=LIT, ranging="both", output={"lines": "all", "waveforms": [(0, 0)]})
    without = scenario(lighting=LIT, ranging="both")
    samples = kept.scanner.lidar.digitiser.samples
    together = [24.0 * memory.voxels_together(some) * some for some in (256, samples)]
    assert memory.memory(kept) - memory.memory(without) == pytest.approx(max(together))
    # A batch of so many shots that it takes less than all.
    limits(monkeypatch, lambda: memory.check_shots(lit, 2), layers + more)
    limits(monkeypatch, lambda: memory.check_shots(dark), 4600.0 * 1500)
    limits(monkeypatch, lambda: memory.check_memory(lit), begun + layers + more)
    monkeypatch.setattr(memory, "_free_memory", lambda: 1.0)
    with pytest.raises(InputError, match=f"{memory.background_bins(lit):,} directions of the background"):
        memory.check_memory(lit)
    with pytest.raises(InputError, match="30 × 50 voxels"):
        memory.check_memory(dark)


@pytest.mark.parametrize(("background", "words"), [(1.03, "directions of the background"), (0.97, "30 × 50")])
def test_what_takes_most_of_the_memory_is_named(
    monkeypatch: pytest.MonkeyPatch, background: float, words: str
) -> None:
    lit, taken = scenario(lighting=LIT), 1e9
    monkeypatch.setattr(memory, "_layers", lambda _: taken)
    monkeypatch.setattr(memory, "_background", lambda _: background * taken)
    monkeypatch.setattr(memory, "_free_memory", lambda: taken)
    with pytest.raises(InputError, match=words):
        memory.check_memory(lit)


def test_a_background_is_followed_by_its_paths_for_each_bin() -> None:
    """Claim: bins, times the samples of each, finer where rows stand farther apart than bins; none in the dark."""
    assert memory.background_paths(scenario()) == 0.0
    told = scenario(lighting=LIT, transport={"background_samples": 8})
    more = scenario(lighting=LIT, transport={"background_samples": 16})
    bins = memory.background_bins(told)
    assert memory.background_paths(told) >= 8.0 * bins
    assert memory.background_paths(told) % (8.0 * bins) == 0.0
    assert memory.background_paths(more) == 2.0 * memory.background_paths(told)
    row = {"rows": 401, "vertical": (0.0, 400.0 * 5e-4)}
    square = scenario(lighting=LIT, transport={"background_samples": 8}, scan=RASTER | row)
    assert memory.background_paths(square) == 8.0 * memory.background_bins(square)


def test_layers_take_what_is_asked_for_and_what_each_rangefinder_judges(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: bytes of the layers for each shot, and for each rangefinder those of the voxels judged together; the
    derivatives by uncertain parameters count where they are written."""
    asked: list[Any] = []
    monkeypatch.setattr(memory, "layer_bytes", lambda _, names: (asked.append(list(names)), 10.0)[1])
    monkeypatch.setattr(memory, "most_together", lambda _: 7)
    monkeypatch.setattr(memory, "JUDGED_BYTES", 1e6)
    monkeypatch.setattr(memory, "WHOLE_BYTES", 3.0)
    monkeypatch.setattr(
        memory, "believed_instrument", lambda _: SimpleNamespace(uncertain=("base", "theta_zero"))
    )
    for rangefinders, derived in ((("tof",), False), (("triangulation", "tof"), True)):
        told: Any = SimpleNamespace(
            rangefinders=rangefinders,
            output=SimpleNamespace(truth=("pose",), jacobian=derived),
            open_scan=SimpleNamespace(shots=1000),
        )
        assert memory._layers(told) == 13e3 + 7e6 * len(rangefinders)
    known = ["pose", "calibration"]
    assert asked == [known, [*known, "J.base", "J.theta_zero"]]


def test_free_memory_is_told_in_kibibytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: what Linux calls kB is 1024 bytes, in the line of what is available; other systems tell nothing."""
    told = "MemTotal:  9999999 kB\nMemFree:   1048576 kB\nMemAvailable:    2097152 kB\nBuffers:  7 kB\n"
    for text, free in ((told, 2.0**31), ("MemTotal: 8 kB\n", None)):
        known = SimpleNamespace(read_text=lambda encoding, text=text: text)
        monkeypatch.setattr(memory, "Path", lambda _, known=known: known)
        assert memory._free_memory() == free


def test_a_beam_travels_while_the_laser_shines() -> None:
    """Claim: the voxels of a row lie a pitch apart, and with the laser off for 0.3 of the dwell 0.7 of it is seen."""
    whole, part = _travel(scenario()), _travel(scenario(scanner={"laser_off": 0.3}))
    assert whole == pytest.approx(scenario().raster.travel)
    assert part == pytest.approx(0.7 * whole)


CAMERA = InteriorOrientation(focal_length=0.016, pixel_pitch=1e-5, columns=640, rows=480)
RADIUS = 4.65e-3


@pytest.mark.parametrize("away", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 1.0)])
def test_the_sun_shines_beside_the_frame_from_its_edge_on(
    monkeypatch: pytest.MonkeyPatch, away: tuple[float, float]
) -> None:
    """Claim: 0.3 pixels before its disc leaves the frame there is none beside it, 0.3 after there is, where a pinhole
    images it, as bright as its visible share."""
    hidden: list[bool] = []
    monkeypatch.setattr(frame_stage, "is_hidden", lambda *_: bool(hidden))
    stage: Any = SimpleNamespace(
        camera=SimpleNamespace(true_interior=CAMERA, lens=SimpleNamespace(glare=SimpleNamespace(veil=0.02))),
        loaded=None,
        _sun_rate=lambda cosine: 100.0 * cosine,
    )
    half = np.array([320.0, 240.0]) + 1600.0 * RADIUS
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    pose = np.eye(4)
    pose[:3, :3] = turn
    for beyond, seen in ((-0.3, False), (0.3, True)):
        pixel = np.array(away) * (half + beyond)
        ray = np.array([*(pixel / 1600.0), 1.0])
        cosine = 1.0 / np.linalg.norm(ray)
        sky = Sky(sun_direction=turn @ ray * cosine, sun_angular_radius=RADIUS, sun_visible=0.75)
        found = Stage._sun_beside(stage, sky, 0.0, pose)
        assert (found is not None) == seen
        if found is not None:
            assert found.pixel == pytest.approx((319.5 + pixel[0], 239.5 + pixel[1]), abs=1e-6)
            assert found.rate == pytest.approx(75.0 * cosine)
            hidden.append(True)
            assert Stage._sun_beside(stage, sky, 0.0, pose) is None


def test_the_whole_sun_gives_what_its_photons_bring_through_the_pupil(device: Device) -> None:
    """Claim: Φ η T A cosθ electrons a second, with A the pupil of the focal length as built, whatever pixels see."""
    own = VideoCamera.model_validate(
        {
            "interior": {"columns": 48, "rows": 36, "focal_length": 12e-3, "pixel_pitch": 50e-6, "k1": -0.2},
            "lens": {"f_number": 8.0},
            "as_built": {"focal_length": 3e-4, "principal_point": (3.0, -2.0), "k1": 0.02},
        }
    )
    sun = Lighting.model_validate(LIT).sun
    stage: Any = SimpleNamespace(camera=own, rates=electron_rates(own, sun))
    area = 0.25 * math.pi * ((12e-3 + 3e-4) / 8.0) ** 2
    photons = photon_irradiance(sun, own.sensor) * own.sensor.quantum_efficiency * own.lens.transmission
    for cosine in (1.0, 0.8):
        assert Stage._sun_rate(stage, cosine) == pytest.approx(photons * area * cosine, rel=1e-9)


@pytest.mark.parametrize("band", [(400e-9, 700e-9), (350e-9, 500e-9), (650e-9, 1050e-9)])
def test_a_camera_counts_the_suns_photons_of_its_band(band: tuple[float, float]) -> None:
    """Claim: ∫ E λ/(hc) dλ from the band's shortest to its longest wavelength, in the middle of visible light and to
    either side of it, by the judge's spectrum with the energy of each photon."""
    own = VideoCamera.model_validate({"sensor": {"band": band}})
    nodes = np.linspace(*band, 20_001)
    photons = judge.planck_irradiance(nodes) * nodes / (6.62607015e-34 * 299792458.0)
    found = photon_irradiance(Lighting.model_validate(LIT).sun, own.sensor)
    assert found == pytest.approx(np.trapezoid(photons, nodes), rel=1e-6)


def test_an_echo_is_as_high_as_a_bell_of_both_widths() -> None:
    """Claim: a charge e behind the avalanche makes a bell whose width is that of pulse and electronics together: its
    height is G e/(√(2π) σ); a round field has the solid angle of the square one."""
    pulse, diode, clock = Pulse(shape="gaussian"), Photodiode(), Digitiser()
    unit = SimpleNamespace(pulse=pulse, photodiode=diode, digitiser=clock)
    sigma = math.hypot(pulse.width / (2.0 * math.sqrt(2.0 * math.log(2.0))), diode.response_sigma)
    way: Any = SimpleNamespace(unit=unit, baseline=0.2)
    found = TimeOfFlight.amperes_per_electron.func(way)
    assert found == pytest.approx(1.602176634e-19 * diode.gain / (math.sqrt(2.0 * math.pi) * sigma), rel=1e-5)
    field = TimeOfFlight.field.func(way)
    assert field.side**2 == pytest.approx(0.25 * math.pi * diode.field_of_view**2)
    assert field.aside == pytest.approx(0.5 * diode.field_of_view)
    coaxial: Any = SimpleNamespace(unit=unit, baseline=0.0)
    assert TimeOfFlight.field.func(coaxial).aside == 0.0


def test_windows_stand_side_by_side_where_their_bins_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: bin and row numbers times their steps, with each window's own layers; joined once."""
    asked: list[Any] = []
    monkeypatch.setattr(windows, "join_windows", lambda places, layers: asked.append((places, layers)))
    made: Any = object.__new__(windows.Windows)
    parts = {"step": 2e-3, "row_step": 5e-3, "_joined": windows.OrderedDict(), "layers": lambda key: key[0]}
    made.__dict__ |= parts
    company = ((made, (-30, 64, 4, 16, b"", None)), (made, (10, 128, -6, 32, b"", None)))
    windows.Windows.join(made, company)  # type: ignore[arg-type]
    windows.Windows.join(made, company)  # type: ignore[arg-type]
    ((places, layers),) = asked
    assert layers == [-30, 10]
    np.testing.assert_allclose(places, [(-0.06, 0.02, 16, 64), (0.02, -0.03, 32, 128)])


def test_the_light_of_one_sky_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windows, "light_of", lambda sky: (sky,))
    made: Any = SimpleNamespace(_lights=None)
    one, other = Sky(), Sky()
    first = windows.Windows._light(made, one)
    assert first[0] is one
    assert windows.Windows._light(made, one) is first
    second = windows.Windows._light(made, other)
    assert second[0] is other
    assert windows.Windows._light(made, other) is second


def test_what_samples_leave_open_is_imaged_sharply(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of the light that a lens strews the variance by samples averages out; what is left, 1 − veil − ghost of
    the light, has its variance times the square of that and of the pixels' rates."""
    glare, rates = Glare(veil=0.03, ghost=0.05), np.array([[2.0, 3.0, 5.0], [7.0, 11.0, 13.0]])
    radiance = np.array([[[0.0, 4.0, 1.0], [2.0, 9.0, 6.0]]])
    traced = SimpleNamespace(radiance=radiance, variance=(0.1 * radiance) ** 2)
    for name in ("FrameTracer", "light_of"):
        monkeypatch.setattr(frame_stage, name, lambda *_, **__: None)
    monkeypatch.setattr(frame_stage, "frame_light", lambda *_: traced)
    stage: Any = SimpleNamespace(
        camera=SimpleNamespace(
            true_interior=SimpleNamespace(centre=(0.5, 1.0)),
            lens=SimpleNamespace(glare=glare),
            sampling=SimpleNamespace(bounces=1),
        ),
        lighting=SimpleNamespace(sky=lambda _: SimpleNamespace(dark=False)),
        optics=SimpleNamespace(view=lambda *_: None),
        loaded=None, rates=rates, seed=1, _sun_beside=lambda *_: None,
    )  # fmt: skip
    shot: Any = SimpleNamespace(begins=[0.0], exposures=[1.0], poses=[None], first=0, window=None)
    rate, variance = Stage.lit(stage, shot, (4, 4))
    np.testing.assert_allclose(np.sqrt(variance), 0.1 * 0.92 * radiance * rates, rtol=1e-12)
    assert (rate > 0.92 * radiance * rates).all()


@pytest.mark.parametrize(
    ("given", "way"),
    [
        ({}, ""),
        ({"lighting": LIT}, "transport.background_seed"),
        ({"lighting": LIT, "transport": {"background_seed": 3}}, ""),
        ({"transport": {"light_seed": 3}}, "Leave transport.light_seed out"),
        ({"scanner": {"as_built": {"base": {"tolerance": 1e-3}}}}, "scanner.as_built.seed"),
        ({"scanner": {"as_built": {"base": {"tolerance": 1e-3}, "seed": 3}}}, ""),
        ({"scanner": {"as_built": {"vibration": SHAKEN, "seed": 3}}}, "leave its vibration out"),
    ],
)
def test_several_seeds_are_measured_where_they_see_one_light(given: dict[str, Any], way: str) -> None:
    """Claim: shots of several seeds stand one run after the other, each with the aim's numbers and its own seed; where
    they see other light of the Sun, or have other mirrors or another instrument than alone, this is refused with the
    way out; one seed's own runs need nothing."""
    read: list[Any] = []
    stated: list[bool] = []
    bench: Any = SimpleNamespace(
        scenario=load_scenario({"schema": 1, "scan": RASTER} | given),
        rangefinders=[None], _stay=SimpleNamespace(resume=contextlib.nullcontext),
        read=lambda *given: read.append(given), _stated=lambda _, aim, noise_alone: stated.append(noise_alone),
        _read_runs=lambda *given: Instrument._read_runs(bench, *given),
    )  # fmt: skip
    angle = np.array([0.1, -0.2, 0.3])
    aim = Aim(np.array([4, 7, 9], dtype=np.uint32), angle, -angle, 0.01 * np.arange(3.0), *2 * [0.0 * angle])
    Instrument.measure(bench, aim, backgrounds=[None])
    ((own, *beside),) = read
    assert own is aim
    assert beside == [[None]]
    if way:
        with pytest.raises(InputError) as told:
            Instrument.measure(bench, aim, backgrounds=[None], seeds=[5, 2**63])
        assert way in told.value.remedy
        return
    Instrument.measure(bench, aim, backgrounds=[None], seeds=[5, 2**63])
    own = read[1][0]
    assert own.shot.tolist() == [4, 7, 9, 4, 7, 9]
    np.testing.assert_array_equal(own.theta, np.tile(angle, 2))
    # Whether σ is that of noise alone is said with one seed as with several.
    assert stated == [False, False]
    for seeds in (None, [5, 2**63]):
        Instrument.measure(bench, aim, backgrounds=[None], seeds=seeds, noise_alone=True)
    assert stated == [False, False, True, True]


def test_frames_are_taken_at_the_cameras_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the first begins when it is asked for, each of the next a period of the rate later; none or too many are
    refused."""
    begun: list[Any] = []
    for name in ("activate", "load_scene"):
        monkeypatch.setattr(photograph, name, lambda *_, **__: None)
    monkeypatch.setattr(photograph, "photograph", lambda *given, **_: begun.append(given[-1]))
    known: Any = SimpleNamespace(scene=None, camera=SimpleNamespace(frame_rate=8.0), lighting=None, seed=3)
    photograph.take_frames(known, 4, start=0.3)
    np.testing.assert_allclose(begun[0], [0.3, 0.425, 0.55, 0.675], rtol=1e-12)
    for frames in (0, photograph._MOST_FRAMES + 1):
        with pytest.raises(InputError, match=f"{frames} frames cannot be taken"):
            photograph.take_frames(known, frames)


@pytest.mark.parametrize(("row", "column"), [(15, 20), (0, 49), (29, 1)])
def test_a_voxel_is_judged_among_all_neighbours_that_there_are(
    monkeypatch: pytest.MonkeyPatch, row: int, column: int
) -> None:
    """Claim: those within the reach to all sides are measured, as far as the raster goes, and the answer is the
    voxel's own."""
    known = scenario()
    away, asked = reach(known), []

    def measure(aim: Aim, *, noise_alone: bool) -> dict[str, Any]:
        asked.append((aim.shot.tolist(), noise_alone))
        return {"range_m": aim.shot.astype(np.float64)}

    for name in ("judge_neighbours", "add_common_errors"):
        monkeypatch.setattr(voxel_records, name, lambda *_: None)
    bench: Any = SimpleNamespace(scenario=known, measure=measure, geometry=None)
    found = voxel_records._among_neighbours(bench, row, column)
    wanted = [
        50 * i + j for i in range(30) for j in range(50) if abs(i - row) <= away and abs(j - column) <= away
    ]
    assert asked == [(wanted, True)]
    assert found == {"range_m": 50.0 * row + column}
    assert away > 0


def test_images_go_together_as_many_as_a_batch_holds() -> None:
    """Claim: of 1500 shots each three go together in a batch of 4500, two in one of 4499; what is not alike never."""
    known = scenario()
    three = [known.replace({"seed": seed}) for seed in (1, 2, 3)]
    assert simulate._go_together(three[:2], three[2], 4500)
    assert not simulate._go_together(three[:2], three[2], 4499)
    assert simulate._go_together(three[:1], three[1], 4499)
    assert not simulate._go_together(three[:1], scenario(ranging="tof"), 9000)


def test_results_that_look_unintended_are_said() -> None:
    """Claim: a scan without an object, and one whose every voxel is refused; one valid voxel is enough for silence."""
    hit, missed = np.array([[0.0, 2.0]]), np.zeros((1, 2))
    good, bad = np.array([[5.0, float(Status.VALID)]]), np.array([[5.0, 3.0]])
    cases = [(hit, good, ""), (hit, bad, "no voxel has a valid"), (missed, bad, "nothing was hit")]
    for objects, status, words in cases:
        said = simulate.result_warnings({"truth.object": objects, "status": status})  # type: ignore[dict-item]
        assert len(said) == bool(words)
        assert all(words in sentence for sentence in said)


def test_a_diode_has_what_the_filter_passes_of_the_line() -> None:
    """Claim: of a line at the middle of the band 0.8, as of the bare optics; half a width beside it half of that, and
    0.3 % of the other half, which is not blocked."""
    for line, passed in ((1.50e-6, 0.8), (1.51e-6, 0.8 * (0.5 + 0.5 * 3e-3))):
        band = {
            "transmission": 0.8,
            "centre": 1.5e-6,
            "bandwidth": 20e-9,
            "shape": "cavities",
            "blocking": 3e-3,
        }
        known = scenario(ranging="tof", scanner={"filter": band, "laser": {"wavelength": line}})
        optics = optics_as_built(known.scanner, None)
        way = TimeOfFlight(known, None, optics)  # type: ignore[arg-type]
        assert way.optics.filter_transmission == pytest.approx(passed, rel=1e-9)
        assert way.bare.filter_transmission == pytest.approx(0.8)


def test_the_lens_blurs_at_the_arrays_near_end_as_stated() -> None:
    """Claim: the near end lies half a pixel beyond the last one's middle; there the light is spread by what is stated,
    and half way from the image of infinity by a quarter of it."""
    known = scenario(scanner={"as_built": {"field_blur": 3e-5}})
    lens = optics_as_built(known.scanner, instrument_as_built(known)).lens
    assert lens is not None
    end = float(geometry_of(known.scanner).position(np.array(known.scanner.position_sensor.pixels - 0.5)))
    found = np.sqrt([lens.variance(end), lens.variance(0.5 * end)])
    np.testing.assert_allclose(found, [3e-5, 0.75e-5], rtol=1e-9)
    assert optics_as_built(known.scanner, None).lens is None
