"""Every verb that makes a result, or opens one, works with every shipped instrument, whichever rangefinders it has."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.config import load_scanner, load_scenario, resolved_yaml
from scanner_sim.config.preset import shipped_presets
from scanner_sim.config.scanner import Scanner

FARTHEST = 40.0
"""Distance of the wall [m] before instruments that see so far; nearer for others."""
FIELD = math.radians(3.0)
"""Half of the field before mirrors that turn so far."""

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("device")]


def told(*words: object) -> str:
    """Return what a command says that does its work."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, (words, result.output)
    return result.output


def scene(scanner: Scanner) -> tuple[list[dict[str, Any]], float]:
    """Return a wall and a ball that moves before it, as an instrument sees them, and half of the field [rad]."""
    ends = [scanner.seen_by(name) for name in scanner.rangefinders]
    near, far = max(end[0] for end in ends), min(end[1] for end in ends)
    wall = min(near + 0.5 * (far - near), FARTHEST) if math.isfinite(far) else max(2.0 * near, 8.0)
    half = min(FIELD, 0.9 * scanner.mirrors.max_deflection)
    size, ball = 4.0 * wall * half, 0.5 * (near + wall)
    return [
        {
            "name": "wall",
            "shape": "rectangle",
            "size": [size, size],
            "position": [0.0, 0.0, wall],
            "material": "z93_white",
        },
        {
            "name": "ball",
            "material": "grey_reference",
            "shape": "sphere",
            "diameter": 0.5 * ball * half,
            "position": [0.0, 0.0, ball],
            "motion": {
                "type": "twist",
                "velocity": [0.1 * ball * half, 0.0, 0.0],
                "turn_rate": [0.0, 0.02, 0.0],
            },
        },
    ], half


def written(path: Path, name: str, scan: dict[str, Any], **more: Any) -> Path:
    """Write a scenario under a Sun that grazes the wall, since the gauge has less light than others."""
    objects, _ = scene(load_scanner(name))
    about = {"schema": 1, "scanner": {"preset": name}, "scene": {"objects": objects}, "scan": scan}
    about |= {"lighting": {"sun": {"direction": [-1.0, 0.0, -0.01]}}, **more}
    path.write_text(resolved_yaml(load_scenario(about)), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", shipped_presets())
def test_a_moving_sunlit_scene_is_scanned_shown_and_processed_again(name: str, tmp_path: Path) -> None:
    """Claim: of a raster with all lines and waveforms kept, under the Sun, with an object that moves."""
    scanner = load_scanner(name)
    half = scene(scanner)[1]
    kept = {"triangulation": "lines", "tof": "waveforms"}
    scenario = written(
        tmp_path / "scene.yaml",
        name,
        {"type": "raster", "rows": 6, "columns": 8, "horizontal": [-half, half], "vertical": [-half, half]},
        ranging="both" if len(scanner.rangefinders) > 1 else scanner.rangefinders[0],
        output={"pictures": False, **{kept[one]: "all" for one in scanner.rangefinders}},
    )
    run, again = tmp_path / "run", tmp_path / "again"
    told("check", scenario)
    told("scene", scenario, "-o", tmp_path / "scene.png")
    assert "with a range" in told("run", scenario, "-o", run)
    told("show", run, "--voxel", 3, 4)
    told("view", run, "-o", tmp_path / "page.html")
    told("convert", run, "--to", "pcd", "-o", tmp_path / "points")
    told("reprocess", run, "--seed", 4, "-o", again)
    told("difference", run, again, "-o", tmp_path / "difference")


@pytest.mark.parametrize("name", ["nrc_2000", "pulsed_scanner"])
def test_a_moving_sunlit_scene_is_scanned_without_rows(name: str, tmp_path: Path) -> None:
    figure = {"points": 64, "amplitude": 0.5 * scene(load_scanner(name))[1]}
    scan = {"type": "lissajous", "centre": [0.0, 0.0], "patterns": 2, "pattern": figure}
    scenario = written(tmp_path / "scene.yaml", name, scan)
    told("run", scenario, "-o", tmp_path / "run")
    told("show", tmp_path / "run")
    told("view", tmp_path / "run", "-o", tmp_path / "page.html")
