"""Scans without rows from a scenario to files: ranges, times and background of their shots, and what is read back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
import trimesh
from typer.testing import CliRunner

from scanner_sim import InputError, Status, load_scenario, read_shots, simulate, simulate_shots, write_shots
from scanner_sim.cli import app
from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.memory import background_times
from scanner_sim.products.files.contents import (
    CALIBRATION,
    FORMAT_FILES,
    PAGE,
    SHOT_FILES,
    SHOTS,
    converted_files,
)
from scanner_sim.products.shots import COLUMN, ShotTable

pytestmark = pytest.mark.usefixtures("device")

WALL = {
    "name": "wall",
    "shape": "rectangle",
    "size": [6, 6],
    "position": [0, 0, 7],
    "material": {"reflectance": 0.4},
}
TILTED = WALL | {"rotation": {"axis": "y", "angle": "20 deg"}}
SUN = {"sun": {"direction": [-0.35, -0.45, -0.8]}, "earth": "none"}
DARK = WALL | {"name": "dark", "size": [6, 2], "position": [0, 1.2, 6.9], "material": {"reflectance": 0.1}}
"""Before the wall from φ = 29 mrad down: one of three rows."""
QUICK = {"background_samples": 2, "background_bounces": 1}


def grid(path: Path, rows: int = 5, columns: int = 7) -> dict[str, object]:
    """Return a list of the angles of a raster, row by row, to the last bit."""
    theta, phi = np.linspace(-0.1, 0.1, columns), np.linspace(-0.06, 0.06, rows)
    lines = [f"{one!r},{other!r}" for other in phi.tolist() for one in theta.tolist()]
    path.write_text("\n".join(["theta_rad,phi_rad", *lines]))
    return {"type": "listed", "file": str(path)}


def raster(rows: int = 5, columns: int = 7) -> dict[str, object]:
    ends = {"horizontal": [-0.1, 0.1], "vertical": [-0.06, 0.06]}
    return {"type": "raster", "rows": rows, "columns": columns, "motion": "stepped", **ends}


def scenario(scan: dict[str, object], *objects: dict[str, object], **more: object) -> Scenario:
    scene = {"objects": objects or (TILTED,)}
    return load_scenario({"schema": 1, "seed": 5, "scene": scene, "scan": scan, **more})


@pytest.fixture(scope="module")
def shots() -> ShotTable:
    return simulate_shots(
        scenario({"type": "spiral", "radius": "6 deg", "turns": 6, "points": 400}, ranging="both"),
        device="cpu",
    )


def same(one: ShotTable, other: ShotTable) -> bool:
    return one.columns.keys() == other.columns.keys() and all(
        one.columns[name].tobytes() == other.columns[name].tobytes() for name in one.columns
    )


def ranges_to_plane(shots: ShotTable) -> np.ndarray:
    """Return the ranges from the first mirror's axis to the tilted wall along the true beams (eq 3, D_g = 50 mm)."""
    theta, phi = (shots[f"truth.{name}_rad"].astype(np.float64) for name in ("theta", "phi"))
    tilt, gap = np.radians(20.0), 0.05
    # x = R sinΘ, z = (R cosΘ − D) cosφ + D on x sin(tilt) + (z − 7) cos(tilt) = 0.
    normal = np.sin(theta) * np.sin(tilt) + np.cos(theta) * np.cos(phi) * np.cos(tilt)
    return np.asarray((7.0 - gap + gap * np.cos(phi)) * np.cos(tilt) / normal)


@pytest.mark.parametrize("kind", ["lissajous", "spiral", "listed"])
def test_ranges_are_right_within_their_sigma(kind: str, shots: ShotTable, tmp_path: Path) -> None:
    """Claim: true ranges are those of the plane along the true beams, to single precision of angles and ranges; by
    either method and both together all errors are within 6 σ (2e-9 each) and their rms is 1 σ.

    Shots lie a spot or more apart, so that their speckle is independent; the rms of n normal errors scatters by
    1/√(2n), and 5 of these are allowed, with 3 % for what σ leaves to second order.
    """
    scans: dict[str, dict[str, object]] = {
        "lissajous": {"type": "lissajous", "pattern": {"points": 400, "amplitude": "5 deg", "ratio": "5:4"}},
        "listed": grid(tmp_path / "angles.csv", 15, 25),
    }
    if kind in scans:
        shots = simulate_shots(scenario(scans[kind], ranging="both"), device="cpu")
    assert shots.valid.mean() > 0.99
    expected = ranges_to_plane(shots)
    np.testing.assert_allclose(shots["truth.range_m"], expected, atol=2e-5)
    for way in ("", "tof.", "fused."):
        good = shots[f"{way}status"] == Status.VALID
        pull = ((shots[f"{way}range_m"] - expected) / shots[f"{way}sigma_range_m"])[good]
        assert np.abs(pull).max() < 6.0
        assert abs(np.sqrt(np.mean(pull**2)) - 1.0) < 5.0 / np.sqrt(2.0 * len(pull)) + 0.03, way


def test_a_raster_as_a_list_of_angles_has_the_same_ranges(tmp_path: Path) -> None:
    """Claim: shots are numbered and timed alike and the mirrors rest, so each range is the same number; the raster's
    image only adds what neighbours say, to σ and to the status."""
    for ranging in ("triangulation", "tof"):
        image = simulate(scenario(raster(), ranging=ranging), device="cpu")
        listed = simulate_shots(scenario(grid(tmp_path / "angles.csv"), ranging=ranging), device="cpu")
        good = image.valid.ravel() & listed.valid
        assert good.mean() > 0.9
        for name in ("range_m", "P.X", "truth.range_m", "truth.theta_rad", "Y"):
            np.testing.assert_array_equal(image[name].ravel()[good], listed[name][good])
        assert (image["sigma_range_m"].ravel()[good] >= listed["sigma_range_m"][good]).all()
        assert "sigma_texture_m" not in listed
    plain = simulate_shots(scenario(raster(), ranging="tof"), device="cpu")
    assert same(plain, listed)


def test_moving_objects_are_where_they_are_at_each_shot(tmp_path: Path) -> None:
    """Claim: along one direction a wall that recedes at 2 m/s is farther by 2 m/s times the time of the file, however
    uneven; to single precision of the range."""
    time = np.cumsum(np.tile([0.01, 0.2, 1e-4], 6))
    (tmp_path / "angles.csv").write_text(
        "theta_rad,phi_rad,time_s\n" + "\n".join(f"0,0,{at!r}" for at in time.tolist())
    )
    wall = WALL | {"motion": {"type": "twist", "velocity": [0, 0, 2]}}
    quiet = {"mirrors": {"jitter": 0, "wobble": 0}}
    made = scenario({"type": "listed", "file": str(tmp_path / "angles.csv")}, wall, scanner=quiet)
    shots = simulate_shots(made, device="cpu")
    np.testing.assert_allclose(shots.time, time, rtol=1e-12)
    np.testing.assert_allclose(shots["truth.range_m"], 7.0 + 2.0 * time, rtol=3e-7)


@pytest.mark.slow
def test_the_background_between_rows_is_that_of_rows(tmp_path: Path) -> None:
    """Claim: under the Sun an even grid of rows gives a shot the background that a raster's own row gives it, within
    5 of the errors that both state and a thousandth, by line and photodiode; the lower row sees a darker surface."""
    more = {"lighting": SUN, "transport": QUICK, "ranging": "both"}
    image = simulate(scenario(raster(3, 5), WALL, DARK, **more), device="cpu")
    scan = grid(tmp_path / "angles.csv", 3, 5)
    listed = simulate_shots(scenario(scan, WALL, DARK, **more), device="cpu")
    own, even = image["background"].ravel(), listed["background"]
    error = np.hypot(image["background_error"].ravel(), listed["background_error"])
    assert own.min() > 1e4
    assert own[10:].max() < 0.5 * own[:10].min()
    assert (np.abs(own - even) < 5.0 * error + 1e-3 * own).all()
    assert (error < 0.05 * own).all()
    np.testing.assert_allclose(listed["tof.background_w"], image["tof.background_w"].ravel(), rtol=0.01)


@pytest.mark.slow
def test_any_batch_gives_the_same_bytes_under_the_sun(tmp_path: Path) -> None:
    """Claim: with objects that move, too, where time slots decide which background a shot sees; and an instrument that
    measures all shots at once, the last one first, sees the same."""
    wall = TILTED | {"motion": {"type": "twist", "velocity": ["50 mm/s", 0, 0]}}
    spiral = {"type": "spiral", "radius": "0.5 deg", "turns": 2, "points": 40}
    made = scenario(
        spiral, wall, lighting=SUN, transport=QUICK, scanner={"rate": "100 Hz", "laser": {"power": "0.1 mW"}}
    )
    one = simulate_shots(made, device="cpu")
    assert (one["background"] > 0.0).all()
    assert background_times(made) > 3
    for batch in (40, 7):
        assert same(simulate_shots(made, device="cpu", batch=batch), one)
    (whole,) = made.open_scan.aims(made.scan_setup, made.open_scan.shots)
    samples = Instrument(made, device="cpu").measure(whole.part(np.arange(made.open_scan.shots)[::-1]))
    assert {"range_m", "background", "status"} <= {name for name in one.columns if name in samples}
    for name in (name for name in one.columns if name in samples):
        np.testing.assert_array_equal(samples[name][::-1].astype(np.float32), one[name], err_msg=name)


def test_a_folder_of_shots_is_read_as_it_was_written(shots: ShotTable, tmp_path: Path) -> None:
    """Claim: the table in Parquet to the last bit, with units; the CSV's columns and the PLY's points are the same."""
    paths = write_shots(shots, tmp_path / "out")
    assert tuple(path.name for path in paths) == SHOT_FILES
    others = {CALIBRATION, *converted_files(tuple(FORMAT_FILES)), "camera.png", PAGE}
    assert {*SHOT_FILES, *others} == set(SHOTS.files)
    back = read_shots(tmp_path / "out")
    assert same(back, shots)
    assert (back.scenario_yaml, back.objects, back.made_by) == (
        shots.scenario_yaml,
        shots.objects,
        shots.made_by,
    )
    said = json.loads(pyarrow.parquet.read_schema(paths[0]).metadata[b"scanner_sim"])
    assert {name: one["unit"] for name, one in said["columns"].items()} == {
        name: COLUMN[name].unit for name in shots.columns
    }
    table = np.genfromtxt(paths[1], delimiter=",", names=True, deletechars="", replace_space="_")
    assert table.dtype.names == tuple(shots.columns)
    np.testing.assert_allclose(table["range_m"], shots["range_m"], rtol=1e-7)
    np.testing.assert_allclose(table["time_s"], shots.time, rtol=1e-12)
    cloud = trimesh.load(tmp_path / "out" / "points.ply")
    np.testing.assert_array_equal(cloud.vertices, shots.points())
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["shots"] == 400
    assert summary["status"][0]["shots"] == np.count_nonzero(shots.valid)
    assert load_scenario(tmp_path / "out" / "scenario.yaml").open_scan.shots == 400


def test_shots_as_xarray_have_units_and_meanings(shots: ShotTable) -> None:
    data = shots.to_xarray()
    assert data.range_m.dims == ("shot",)
    assert data.time_s.units == "s"
    np.testing.assert_array_equal(data.theta_rad, shots.theta)
    assert "400 shots" in repr(shots)


def test_a_damaged_table_of_shots_is_refused(shots: ShotTable, tmp_path: Path) -> None:
    """Claim: a column less, shots out of order, a status that there is not: one message each, no traceback."""
    (path, *_) = write_shots(shots, tmp_path / "out")
    table = pyarrow.parquet.read_table(path)
    codes = table.set_column(
        table.column_names.index("status"), "status", pyarrow.array(np.full(400, 77, dtype=np.float32))
    )
    for wrong in (table.drop(["time_s"]), table.take(list(range(399, -1, -1))), codes, table.slice(0, 0)):
        pyarrow.parquet.write_table(wrong, path)
        with pytest.raises(InputError, match="damaged or not of this version"):
            read_shots(tmp_path / "out")
    with pytest.raises(InputError, match=r"no shots.parquet"):
        read_shots(tmp_path)


def test_the_command_line_runs_and_shows_a_spiral(tmp_path: Path) -> None:
    text = (
        "schema: 1\n"
        "scene: {objects: [{name: wall, shape: rectangle, size: [3 m, 3 m], position: [0 m, 0 m, 7 m], "
        "material: grey_reference}]}\n"
        "scan: {type: spiral, radius: 2 deg, turns: 4, points: 64}\n"
    )
    (tmp_path / "spiral.yaml").write_text(text)

    def run(*arguments: str) -> str:
        result = CliRunner().invoke(app, list(arguments))
        assert result.exit_code == 0, result.output
        return result.output

    out = str(tmp_path / "out")
    planned = run("run", str(tmp_path / "spiral.yaml"), "-o", out, "--dry-run")
    assert "64 on a spiral of 4 turns" in planned
    assert "Θ -2° to 2°" in planned
    done = run("run", str(tmp_path / "spiral.yaml"), "-o", out, "--device", "cpu")
    assert "64 in" in done
    for name in SHOT_FILES:
        assert name in planned
        assert (tmp_path / "out" / name).stat().st_size > 0
    assert "type: spiral" in run("check", str(tmp_path / "out" / "scenario.yaml"))
    (tmp_path / "out" / "range.png").unlink()
    assert "range.png" in run("show", out)
    assert (tmp_path / "out" / "range.png").exists()
    refused = CliRunner().invoke(app, ["show", out, "--voxel", "1", "1"])
    assert refused.exit_code == 2
    assert "no voxels of a raster" in refused.stderr
    refused = CliRunner().invoke(
        app, ["budget", str(tmp_path / "spiral.yaml"), "--image", "-o", str(tmp_path / "b")]
    )
    assert refused.exit_code == 2
    assert "needs a raster" in refused.stderr
