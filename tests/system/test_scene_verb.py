"""``scanner-sim scene``: what stands before the scanner, as a table and a picture, without a simulation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from scanner_sim import load_scenario
from scanner_sim.cli import app
from scanner_sim.instrument.view_scene import view_scene
from scanner_sim.products.pictures.scene import draw_scene

SCENARIO = """\
schema: 1
seed: 1
scene:
  objects:
    - {name: wall, shape: rectangle, size: [4 m, 2 m], position: [0 m, 0 m, 8 m], material: z93_white}
    - {name: ball, parent: wall, shape: sphere, diameter: 50 cm, position: [0 m, 0.3 m, -2 m], material: black_paint}
    - {name: hidden, shape: box, size: [1 m, 1 m, 1 m], position: [0 m, 0 m, 9 m], material: nickel}
    - {name: aside, shape: disc, diameter: 1 m, position: [6 m, 0 m, 5 m], material: nickel}
    - {name: behind, shape: disc, diameter: 1 m, position: [0 m, 0 m, -5 m], material: nickel}
scan: {type: raster, rows: 8, columns: 8, horizontal: [-8 deg, 8 deg], vertical: [-6 deg, 6 deg]}
"""


pytestmark = pytest.mark.usefixtures("device")


def verb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scenario: str) -> Result:
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_text(scenario)
    return CliRunner().invoke(app, ["scene", "a.yaml"])


def test_the_verb_prints_a_table_and_writes_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = verb(tmp_path, monkeypatch, SCENARIO)
    assert done.exit_code == 0, done.stderr
    rows = {line.split()[0]: line for line in done.stdout.splitlines() if line.strip()}
    assert "4 × 2 × 0" in rows["wall"]
    assert "in view" in rows["wall"]
    assert "5.75" in rows["ball"]  # its middle at (0, 0.3, 6) m, less the radius
    assert "black_paint" in rows["ball"]
    assert "hidden, or finer" in rows["hidden"]
    assert "outside of the field of view" in rows["aside"]
    assert "behind the scanner" in rows["behind"]
    with Image.open(tmp_path / "output" / "a_scene.png") as picture:
        assert picture.width > 1000


def test_faults_of_its_files_are_one_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "part.glb").write_bytes(b"glTF")
    text = SCENARIO.replace("shape: disc, diameter: 1 m, position: [6 m", "mesh: part.glb, position: [6 m")
    done = verb(tmp_path, monkeypatch, text)
    assert done.exit_code == 2
    assert "part.glb' cannot be used: it breaks off in its header" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_picture_shows_what_rays_by_hand_meet(tmp_path: Path) -> None:
    """Claim: each dot of the view is the object that a line from the scanner's origin meets, at its distance."""
    (tmp_path / "a.yaml").write_text(SCENARIO)
    view = view_scene(load_scenario(tmp_path / "a.yaml"), device="cpu")
    rows, columns = view.number.shape
    for theta, phi, name, distance in (
        (0.0, 0.3 / 6.0, "ball", np.hypot(0.3, 6.0) - 0.25),
        (0.1, 0.0, "wall", 8.0 / np.cos(0.1)),
        (0.0, -0.12, "wall", 8.0 / np.cos(0.12)),
    ):
        (left, right), (top, bottom) = view.window
        row, column = int((phi - top) / (bottom - top) * rows), int((theta - left) / (right - left) * columns)
        assert view.objects[view.number[row, column] - 1].name == name
        assert view.distance[row, column] == pytest.approx(distance, abs=0.01)
    # The ball's disc of radius asin(0.25 / 6.02) in a field of 16° by 12°.
    expected = np.pi * np.arcsin(0.25 / np.hypot(0.3, 6.0)) ** 2 / np.deg2rad(16.0) / np.deg2rad(12.0)
    assert view.objects[1].share == pytest.approx(expected, rel=0.05)
    draw_scene(view, "$a_title^", tmp_path / "a.png")
