"""The verb ``pose-study``: its folder, its tables, and what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.products.files.contents import POSE_STUDY
from scanner_sim.products.pose_study import COMPONENTS
from scanner_sim.validation.studies.pose_study import StudyPlan

ARRAY = """\
schema: 1
seed: 3
scene:
  objects:
    - name: panel
      array: {diameter: 100 mm, plate: 250 mm, rows: 2, columns: 3, spacing: [0.5 m, 0.8 m]}
      position: [0 m, 0 m, 9 m]
    - name: strip
      array: {diameter: 100 mm, plate: 250 mm, rows: 1, columns: 5, spacing: [0.5 m, 0.5 m]}
      position: [0 m, 2 m, 9 m]
scan: {type: raster, rows: 8, columns: 8, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}
"""

pytestmark = pytest.mark.usefixtures("device")


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "panel.yaml"
    path.write_text(ARRAY, encoding="utf-8")
    return path


def rows_of(name: str) -> list[dict[str, str]]:
    with open(Path("out", name), encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.slow
def test_study_writes_its_folder(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Fewer poses and patterns than --quick has: what is looked at here is the folder.
    few = StudyPlan.__init__

    def smaller(self: StudyPlan, distances: Any, arrays: Any, *_: int) -> None:
        few(self, distances, (arrays[0], *arrays[-2:]), poses=40, positions=1, patterns=1)

    monkeypatch.setattr(StudyPlan, "__init__", smaller)
    result = invoke("pose-study", config, "-o", "out", "--quick", "--device", "cpu")
    assert result.exit_code == 0, result.output
    assert "R^1.5" in result.output
    assert {path.name for path in Path("out").iterdir()} == set(POSE_STUDY.files)
    for name in ("figure_15.png", "arrays.png"):
        with Image.open(Path("out", name)) as picture:
            assert picture.width > 1000
    told = json.loads(Path("out/pose_study.json").read_text(encoding="utf-8"))
    rows = rows_of("pose_study.csv")
    assert len(rows) == len(told["rows"]) == 3 * 3 * 5 * 6
    assert {row["component"] for row in rows} == set(COMPONENTS)
    # The scene's own array with a pose is among them; the strip has none.
    assert "panel (own)" in {row["array"] for row in rows}
    assert not [row for row in rows if row["array"].startswith("strip")]
    assert all(float(row["simulated"]) > 0.0 and float(row["analytic"]) > 0.0 for row in rows)
    assert {row["quantity"] for row in rows_of("targets.csv")} == {
        "theta",
        "phi",
        "range_triangulation",
        "range_tof",
    }
    assert len(rows_of("gains.csv")) == 3 * 2 * 2 * 6
    assert {row["printed"] for row in rows_of("exponents.csv")} == {"", "1", "1.5"}
    again = invoke("pose-study", config, "-o", "out", "--quick")
    assert again.exit_code == 2
    assert "--overwrite" in again.output


def test_targets_that_cannot_be_followed_are_refused(config: Path) -> None:
    result = invoke("pose-study", config, "-o", "out", "--diameter", 1.0)
    assert result.exit_code == 2
    assert "smaller targets" in result.output
    assert not Path("out").exists()
