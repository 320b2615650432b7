"""Lines and waveforms that are kept, and what is made of their light again: the bytes of a whole run.

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from claims import mean_square
from typer.testing import CliRunner

from scanner_sim import LineSet, Scenario, load_scenario, simulate, simulate_lines, simulate_waveforms
from scanner_sim.cli import app
from scanner_sim.config import scenario_from_text
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.instrument.reprocess import KeptSignals
from scanner_sim.products.files.signal_files import read_signals, write_signals

pytestmark = pytest.mark.usefixtures("device")

SCENE = """\
schema: 1
seed: 1
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 9 m], material: grey_reference}
    - {name: ball, shape: sphere, diameter: 0.6 m, position: [0 m, 0 m, 7 m], material: z93_white}
  labels: {objects: {ball: 9}, materials: {z93_white: 4}}
scan: {type: raster, rows: 12, columns: 10, horizontal: [-4 deg, 4 deg], vertical: [-4 deg, 4 deg]}
output: {pictures: false, points: false, lines: all}
"""
LIT = "lighting={sun: {direction: [-0.35, -0.45, -0.8]}}"
BOTH = ("ranging=both", "output.waveforms=all")


def scene(*overrides: str) -> Scenario:
    return scenario_from_text(SCENE, name="scene.yaml", overrides=overrides)


def command(*words: object, exit_code: int = 0) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == exit_code, result.output
    return result.output


def run(folder: Path, *overrides: str) -> Path:
    (folder / "scene.yaml").write_text(SCENE, encoding="utf-8")
    values = [word for value in overrides for word in ("--set", value)]
    command(
        "run", folder / "scene.yaml", "-o", folder / "run", "--device", "cpu", "-q", "--overwrite", *values
    )
    return folder / "run"


def reprocess(folder: Path, *words: str, exit_code: int = 0) -> str:
    out = folder.with_name("again")
    return command("reprocess", folder, "-o", out, "--device", "cpu", *words, exit_code=exit_code)


def rerun(folder: Path) -> Path:
    """Run the scenario that ``reprocess`` has written, as a whole."""
    again = folder.with_name("again")
    command("run", again / "scenario.yaml", "-o", folder.with_name("whole"), "--device", "cpu", "-q")
    return folder.with_name("whole")


def assert_same(one: Path, other: Path, *, without: tuple[str, ...] = ()) -> None:
    names = {path.name for path in one.iterdir()}
    assert names == {path.name for path in other.iterdir()} - set(without)
    for name in names:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


CHANGES = {
    "seed": ("--seed", "2"),
    "estimator": ("--set", "processing.peak=gaussian", "--set", "processing.validation.isolated=null"),
    "sensor": (
        "--set",
        "scanner.position_sensor.read_noise=3000 electron",
        "--set",
        "scanner.laser.speckle=false",
    ),
    "encoder": ("--set", "scanner.mirrors.readout_noise=50 urad", "--seed", "3"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_made_again_is_a_whole_run(change: str, tmp_path: Path) -> None:
    """Claim: every file of ``reprocess`` has the bytes of a whole run of the scenario that it writes."""
    kept = run(tmp_path)
    reprocess(kept, *CHANGES[change])
    assert_same(tmp_path / "again", rerun(kept))
    assert (kept / "range.exr").read_bytes() != (tmp_path / "again" / "range.exr").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    "more",
    [
        (LIT, "transport.bounces=2", *BOTH),
        (LIT, "scanner.laser_off=0.4", "transport.background_seed=7"),
        ("ranging=tof", "output.lines=none", "output.waveforms=all"),
    ],
)
def test_light_of_every_kind_is_kept(more: tuple[str, ...], tmp_path: Path) -> None:
    """Claim: the same under the Sun, with several bounces, a second exposure and time of flight."""
    kept = run(tmp_path, *more)
    pulse = ("--set", "processing.pulse.timing=leading_edge", "--set", "scanner.lidar.digitiser.rate=2 GHz")
    reprocess(kept, "--seed", "2", *(pulse if "ranging" in str(more) else ()))
    assert_same(tmp_path / "again", rerun(kept))


def test_with_its_own_values_nothing_changes(tmp_path: Path) -> None:
    kept = run(tmp_path)
    reprocess(kept)
    assert_same(tmp_path / "again", kept)


def test_the_seed_of_the_light_leaves_the_light(tmp_path: Path) -> None:
    """Claim: another seed redraws noise, speckle and encoders, and moves neither the light nor the truth."""
    kept = run(tmp_path)
    reprocess(kept, "--seed", "2")
    before, after = (read_signals(path / "lines.parquet", LineSet) for path in (kept, tmp_path / "again"))
    for name in ("laser_w", "cluster_px", "truth.range_m", "surface_point_m"):
        np.testing.assert_array_equal(before[name], after[name])
    for name in ("number", "theta_read_rad"):
        assert (before[name] != after[name]).any()
    other = simulate_lines(scene("seed=2"), device="cpu")
    assert (other["cluster_px"] != before["cluster_px"]).any()


def test_lines_may_be_left_out(tmp_path: Path) -> None:
    """Claim: the image alone can be made again of all lines, but not of some."""
    kept = run(tmp_path)
    reprocess(kept, "--seed", "4", "--set", "output.lines=none")
    assert_same(tmp_path / "again", rerun(kept))
    assert not (tmp_path / "again" / "lines.parquet").exists()
    some = run(tmp_path, "output.lines=[[3, 4]]", "output.compression=zip")
    assert "output.lines" in reprocess(some, "--set", "output.lines=none", "--overwrite", exit_code=2)


def test_some_voxels_have_lines_but_no_neighbours(tmp_path: Path) -> None:
    """Claim: of some voxels lines are made again as in a whole run, and it is said that the image is missing."""
    kept = run(tmp_path, "output.lines=[[3, 4], [0, 9], [11, 0]]")
    said = reprocess(kept, "--seed", "5")
    assert "range.exr, and what neighbours say" in said
    assert {path.name for path in (tmp_path / "again").iterdir()} == {"lines.parquet", "scenario.yaml"}
    whole = rerun(kept)
    assert (whole / "lines.parquet").read_bytes() == (tmp_path / "again" / "lines.parquet").read_bytes()


def test_lines_are_those_of_the_image() -> None:
    """Claim: peaks, light and truth of lines are those of the image's voxels, in any order and any choice."""
    known = scene("processing.validation.isolated=null", "processing.validation.mixed=null")
    image, every = simulate(known, device="cpu"), simulate_lines(known, device="cpu")
    np.testing.assert_array_equal(every.status.reshape(image.shape), image["status"])
    for name in ("peak_px", "sigma_peak_px", "Y", "snr_detection", "truth.range_m", "truth.object"):
        np.testing.assert_array_equal(every[name].reshape(image.shape), image[name])
    voxels = np.array([(11, 9), (0, 0), (5, 5)])
    some = simulate_lines(known, voxels, device="cpu")
    shots = voxels[:, 0] * 10 + voxels[:, 1]
    for name in ("number", "laser_w", "peak_px", "theta_read_rad"):
        np.testing.assert_array_equal(some[name], every[name][shots])


@pytest.mark.parametrize("lit", [(), (LIT,)], ids=["dark", "sunlit"])
def test_charges_scatter_about_the_light(lit: tuple[str, ...]) -> None:
    """Claim: digital numbers scatter about ``expected`` by shot noise, read noise, dark charge and rounding.

    Set-up: a wall without speckle and unlike pixels, 120 lines of 256 pixels. Expected: mean square 1 of
    (charge − expected)/σ with σ² = expected + dark + read² + gain²/12.
    """
    quiet = ("scanner.laser.speckle=false", "scanner.position_sensor.noise={prnu: false}")
    known = scene(*quiet, *lit)
    lines, sensor = simulate_lines(known, device="cpu"), known.scanner.position_sensor
    gain = lines.about.numbers["electrons_per_number"]
    floor = sensor.read_noise**2 + lines.about.numbers["dark_electron"] + gain**2 / 12.0
    inside = lines.number < sensor.largest_number
    z = ((lines.charge - lines.expected) / np.sqrt(lines.expected + floor))[inside]
    assert mean_square(z)


def test_the_truth_of_a_peak_is_where_the_light_is() -> None:
    """Claim: with mirrors that do not err the centroid of ``laser_w`` is ``truth.peak_px`` within 0.05 pixel.

    Set-up: 8° to either side, where the wall's range, 9 m over the cosine, and eq 1 move the peak by pixels.
    """
    still = "scanner.mirrors={jitter: 0 rad, wobble: 0 rad, synchronisation: 0 rad}"
    wide = "scan.horizontal=[-8 deg, 8 deg]"
    lines = simulate_lines(scene(still, wide, "scan.motion=stepped"), [(0, 0), (0, 5), (0, 9)], device="cpu")
    light = lines["laser_w"].astype(np.float64)
    centroid = light @ np.arange(lines.samples) / light.sum(axis=1)
    np.testing.assert_allclose(centroid, lines["truth.peak_px"], atol=0.05)
    assert np.ptp(centroid) > 0.5


def test_clusters_are_the_light_of_the_pixels() -> None:
    """Claim: the Gaussians of the file, integrated over the pixels by hand, are ``laser_w``: what users are told."""
    from scipy.special import erf

    lines = simulate_lines(scene("scanner.filter=none"), [(0, 0), (5, 5), (6, 4)], device="cpu")
    edges = np.arange(lines.samples + 1) - 0.5
    for voxel in range(3):
        own = slice(lines.first_cluster[voxel], lines.first_cluster[voxel + 1])
        power, place, sigma = (
            lines[name][own, None] for name in ("cluster_w", "cluster_px", "cluster_sigma_px")
        )
        share = np.diff(0.5 * erf((edges - place) / (np.sqrt(2.0) * sigma)), axis=1)
        expected = (power * np.where(power > 0.0, share, 0.0)).sum(axis=0)
        np.testing.assert_allclose(lines["laser_w"][voxel], expected, atol=2e-6 * expected.sum())


def test_expected_waveforms_are_what_noise_is_added_to() -> None:
    """Claim: without noise, speckle and clock a record is ``expected_a`` in whole steps."""
    quiet = "{shot: false, amplifier: false, saturation: false, quantisation: true, clock: false}"
    known = scene(
        *BOTH, "output.lines=none", "scanner.laser.speckle=false", f"scanner.lidar.photodiode.noise={quiet}"
    )
    found = simulate_waveforms(known, [(0, 0), (6, 5)], device="cpu")
    np.testing.assert_array_equal(found.number, np.rint(found["expected_a"] / np.float32(found.step)))
    assert found.number.max() > 10


REFUSED = {
    "scanner.laser.power=1 mW": "scanner.laser.power",
    "scan.rows=5": "scan.rows",
    "scene.objects.wall.position=[0 m, 0 m, 5 m]": "scene.objects",
    "scanner.position_sensor.pitch=40 um": "scanner.position_sensor.pitch",
    "scanner.mirrors.jitter=0 rad": "scanner.mirrors.jitter",
    "output.lines=[[0, 0]]": "output.lines",
    "transport.light_seed=8": "transport.light_seed",
    "transport.background_seed=8": "transport.background_seed",
    LIT: "lighting.sun",
    "processing.peak=centre": "processing.peak",
}


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory, device: object) -> Path:
    return run(tmp_path_factory.mktemp("kept"))


@pytest.mark.parametrize("value", REFUSED)
def test_what_changes_the_light_is_refused_at_its_key(value: str, kept: Path) -> None:
    with pytest.raises(ScenarioError) as found:
        KeptSignals.find(kept).changed([value])
    assert any(fault.location.startswith(REFUSED[value]) for fault in found.value.faults)
    assert all(fault.remedy for fault in found.value.faults)
    output = reprocess(kept, "--set", value, exit_code=2)
    assert REFUSED[value] in output


def test_a_folder_without_lines_is_refused(tmp_path: Path) -> None:
    assert "no lines or waveforms" in command("reprocess", tmp_path, exit_code=2)


def test_a_result_is_not_written_over_its_own_light(kept: Path) -> None:
    said = command("reprocess", kept, "-o", kept, "--overwrite", exit_code=2)
    assert "whose light is read" in said


def lines_without(kept: Path, folder: Path, columns: dict[str, object]) -> None:
    """Write the lines of a run again into another folder, with other columns."""
    lines = read_signals(kept / "lines.parquet", LineSet)
    changed = {name: np.asarray(columns.get(name, lines[name])) for name in lines}
    write_signals(folder / "lines.parquet", [LineSet(changed, lines.about)])


def test_damaged_lines_are_refused(kept: Path, tmp_path: Path) -> None:
    """Claim: another scenario beside, missing voxels, odd numbers and a cut file end with status 2 and a message."""
    lines = read_signals(kept / "lines.parquet", LineSet)
    (tmp_path / "a").mkdir()
    odd = lines["beam_radius_m"].copy()
    odd[7] = np.nan
    lines_without(kept, tmp_path / "a", {"beam_radius_m": odd})
    assert "finite numbers" in reprocess(tmp_path / "a", exit_code=2)
    named = lines["truth.object"].copy()
    named[7] = 99
    lines_without(kept, tmp_path / "a", {"truth.object": named})
    assert "without a name" in reprocess(tmp_path / "a", exit_code=2)
    lines_without(kept, tmp_path / "a", {"row": lines.row[::-1]})
    assert "other voxels" in reprocess(tmp_path / "a", exit_code=2)
    content = (kept / "lines.parquet").read_bytes()
    (tmp_path / "a" / "lines.parquet").write_bytes(content[: len(content) // 2])
    assert "damaged" in reprocess(tmp_path / "a", exit_code=2)
    (tmp_path / "a" / "lines.parquet").write_bytes(content)
    (tmp_path / "a" / "scenario.yaml").write_text("schema: 1\n")
    assert "different scenarios" in reprocess(tmp_path / "a", exit_code=2)
    assert not (tmp_path / "again").exists()


@pytest.mark.parametrize(
    ("voxels", "words"),
    [
        ([(12, 0)], "outside"),
        ([(0, -1)], "outside"),
        ([(3, 3), (1, 1), (3, 3)], "more than once"),
        ([], "no voxel"),
        ([(0.5, 1.0)], "no rows and columns"),
        ([1, 2, 3], "no rows and columns"),
    ],
)
def test_voxels_that_are_none_are_refused(voxels: list[tuple[int, int]], words: str) -> None:
    with pytest.raises(InputError, match=words):
        simulate_lines(scene(), voxels, device="cpu")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (["output.lines=[[12, 0]]"], "outside"),
        (["output.lines=[[1, 1], [1, 1]]"], "more than once"),
        (["output.lines=[]"], "no voxel"),
        (["ranging=tof"], "no lines"),
        (["scan={type: spiral, turns: 3, radius: 4 deg, points: 100}"], "keeps no lines"),
    ],
)
def test_lines_that_cannot_be_kept_are_refused(values: list[str], words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        scene(*values)


def test_tracking_has_no_seed_of_its_light(repo_root: Path) -> None:
    with pytest.raises(ScenarioError, match=r"transport\.light_seed"):
        load_scenario(repo_root / "configs/track_still.yaml", ["transport.light_seed=3"])
