"""Every shipped scenario runs through the command line, and says where its schema is."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from scanner_sim import load_scenario, read_shots
from scanner_sim.cli import app
from scanner_sim.config import json_schema, scenario_warnings
from scanner_sim.foundation.status import Status
from scanner_sim.products.files.contents import planned_files
from scanner_sim.products.files.exr import read_range_image

CONFIGS = sorted((Path(__file__).resolve().parents[2] / "configs").glob("*.yaml"))
TRACKS = [path for path in CONFIGS if path.stem.startswith("track_") or path.stem == "camera_and_scanner"]
SHOTS = [path for path in CONFIGS if path.stem.startswith("shots_")]
RASTERS = [path for path in CONFIGS if path not in (*TRACKS, *SHOTS)]
SIZE = 24

pytestmark = pytest.mark.usefixtures("device")


def test_all_of_them_are_here() -> None:
    assert {path.stem for path in CONFIGS} >= {
        "quickstart", "node_512", "node_near", "target_board", "plane", "tilted_plane", "step", "sphere",
        "own_mesh", "empty", "lighting_normal", "lighting_partial_shadow", "lighting_full_shadow",
        "lighting_saturation", "lighting_dark", "lighting_back", "lighting_worst_case",
        "lighting_worst_case_no_filter", "lighting_orbit", "tof_node", "tof_both", "tof_retro",
        "track_still", "track_moving", "track_two_objects", "shots_spiral", "shots_lissajous", "shots_listed",
        "shots_gauge", "tiles", "pulsed_scanner",
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=path.stem, marks=[pytest.mark.slow] if path.stem.startswith("lighting") else [])
        for path in RASTERS
    ],
)
def test_it_runs(path: Path, tmp_path: Path) -> None:
    arguments = ["run", str(path), "-o", str(tmp_path / "out"), "--device", "cpu"]
    arguments += [
        "--set",
        f"scan.rows={SIZE}",
        "--set",
        f"scan.columns={SIZE}",
        "--set",
        "camera.interior={columns: 48, rows: 36, pixel_pitch: 130 um}",
    ]
    # Few columns are far apart: a sweep would smear each over a degree. Most of the time goes into the sunlit scene.
    arguments += ["--set", "scan.motion=stepped", "--set", "transport.background_samples=2"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    scenario = load_scenario(path)
    lit = scenario.lighting.sky().sun_visible > 0.0
    assert {item.name for item in (tmp_path / "out").iterdir()} == set(
        planned_files(scenario.output, lit=lit, rangefinders=scenario.rangefinders)
    )
    image = read_range_image(tmp_path / "out" / "range.exr")
    assert image.shape == (SIZE, SIZE)
    if path.stem == "empty":
        assert not image.valid.any()
        assert "nothing was hit" in result.stderr
        return
    # Meant to be looked at: much of the picture has a return, edges included, and measured ranges are the true ones.
    seen = np.isin(image["status"], (Status.VALID, Status.MIXED))
    assert seen.mean() > 0.15
    layer = "fused." if scenario.ranging == "both" else ""
    error = np.abs(image[f"{layer}range_m"] - image["truth.range_m"])
    # One pattern of speckle leaves 9 mm at 9 m, time of flight has a floor of 10 mm.
    assert np.nanmedian(error) < 0.015
    # Half of all normal errors are below 0.67 σ; spots on edges add to it.
    assert np.nanmedian(error / image[f"{layer}sigma_range_m"]) < 1.0
    assert not result.stderr


@pytest.mark.slow
@pytest.mark.parametrize("path", TRACKS, ids=lambda path: path.stem)
def test_it_tracks(path: Path, tmp_path: Path) -> None:
    arguments = ["run", str(path), "-o", str(tmp_path / "out"), "--device", "cpu"]
    result = CliRunner().invoke(
        app, [*arguments, "--set", "scan.duration=0.25 s", "--set", "output.pictures=false"]
    )
    assert result.exit_code == 0, result.output
    assert not result.stderr
    table = (tmp_path / "out" / "track.csv").read_text(encoding="utf-8").splitlines()
    assert len(table) > 20


@pytest.mark.slow
@pytest.mark.parametrize("path", SHOTS, ids=lambda path: path.stem)
def test_it_gives_shots(path: Path, tmp_path: Path) -> None:
    """Claim: nearly all have a range, and half of the errors are below 0.67 σ, those on edges included.

    A beam at rest sees one patch of a surface that rests, and so one draw of its speckle: all errors there are alike,
    and normal to 3.9 σ but for 10⁻⁴ of the seeds.
    """
    arguments = ["run", str(path), "-o", str(tmp_path / "out"), "--device", "cpu"]
    result = CliRunner().invoke(app, [*arguments, "--set", "output.pictures=false"])
    assert result.exit_code == 0, result.output
    assert not result.stderr
    shots = read_shots(tmp_path / "out")
    assert shots.valid.mean() > 0.9
    layer = "fused." if "fused.range_m" in shots else ""
    error = np.abs(shots[f"{layer}range_m"] - shots["truth.range_m"])
    most = 3.9 if load_scenario(path).open_scan.type == "fixed" else 1.0
    assert np.nanmedian(error / shots[f"{layer}sigma_range_m"]) < most


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_it_names_its_schema_and_raises_no_doubts(path: Path) -> None:
    assert path.read_text(encoding="utf-8").startswith(
        "# yaml-language-server: $schema=scenario.schema.json\n"
    )
    assert path.stem == "empty" or not scenario_warnings(load_scenario(path))


def test_the_shipped_schema_is_the_generated_one(repo_root: Path) -> None:
    shipped = json.loads((repo_root / "configs" / "scenario.schema.json").read_text(encoding="utf-8"))
    assert shipped == json_schema(), "run: scanner-sim schema > configs/scenario.schema.json"
