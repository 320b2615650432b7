"""The verb ``calibrate`` and its table: from the bench through the file into a scan, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from scanner_sim import Scenario, simulate
from scanner_sim.cli import app
from scanner_sim.config import scenario_warnings
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.signals.line.bias_table import BiasTable, read_bias, write_bias

SCENARIO = """\
schema: 1
seed: 3
scanner: {laser: {m_squared: 1.0}}
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 4 m], material: {reflectance: 0.5}}
scan: {type: raster, rows: 8, columns: 8, horizontal: [1 deg, 8 deg], vertical: [1 deg, 8 deg]}
processing: {peak: parabola}
"""

pytestmark = pytest.mark.usefixtures("device")


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "wall.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_measured_table_corrects_a_scan(config: Path) -> None:
    """Claim: the table that the program measures takes the systematic error out of a scan.

    Set-up: the parabola, which errs by up to 0.05 px at 4 m; a sloping pencil of 1024 shots on a wall without any
    noise, with and without the table. Expected: the largest error of the peak falls below 0.002 px. Tolerance: that;
    the slope of up to 12° changes the width by 0.2 %.
    """
    result = invoke("calibrate", config, "-o", "bias.csv", "--device", "cpu")
    assert result.exit_code == 0, result.output
    assert "parabola" in result.output
    with Image.open("bias.png") as picture:
        assert picture.width > 600
    table = read_bias(Path("bias.csv"))
    assert table.estimator == "parabola"
    assert 0.04 < np.abs(table.bias).max() < 0.07
    for correction, low, high in (("none", 0.02, 0.06), (Path("bias.csv").resolve(), 0.0, 0.002)):
        scenario = quiet(correction)
        layers = simulate(scenario, device="cpu").channels
        receiver, sensor = scenario.scanner.receiver, scenario.scanner.position_sensor
        theta = np.linspace(*scenario.scan.horizontal, scenario.scan.columns)
        reach = layers["truth.range_m"].astype(np.float64) - receiver.baseline * np.sin(theta)
        position = receiver.focal_length * receiver.baseline * np.cos(theta) / reach
        error = layers["peak_px"] - (position / sensor.pitch - 0.5)
        assert low <= np.nanmax(np.abs(error)) < high


def quiet(correction: object) -> Scenario:
    """Return a scan of a wall without noise and speckle."""
    off = ("shot", "read", "dark", "prnu", "saturation", "quantisation")
    return Scenario(
        schema=1,
        scanner={
            "laser": {"speckle": False},
            "mirrors": {"jitter": 0.0, "wobble": 0.0, "synchronisation": 0.0},
            "position_sensor": {"noise": dict.fromkeys(off, False)},
        },
        scene={
            "objects": [
                {
                    "name": "wall",
                    "shape": "rectangle",
                    "size": (8.0, 8.0),
                    "position": (0.0, 0.0, 4.0),
                    "material": {"reflectance": 0.5},
                }
            ]
        },
        scan={"rows": 4, "columns": 256, "horizontal": (0.02, 0.2), "vertical": (0.02, 0.1)},
        processing={"peak": "parabola", "bias_correction": correction},
    )


def test_what_stands_in_the_way_of_a_calibration(config: Path) -> None:
    Path("there.csv").write_text("", encoding="utf-8")
    for file, words in (
        ("bias.txt", ".csv"),
        ("nowhere/bias.csv", "no folder"),
        ("there.csv", "--overwrite"),
    ):
        result = invoke("calibrate", config, "-o", file)
        assert result.exit_code == 2
        assert words in result.output


def test_a_table_comes_back_from_its_file(tmp_path: Path) -> None:
    table = BiasTable("gaussian", np.array([0.8, 1.2]), np.array([-0.5, 0.0, 0.5]), np.full((2, 3), 0.01))
    write_bias(table, tmp_path / "bias.csv")
    again = read_bias(tmp_path / "bias.csv")
    assert again.estimator == "gaussian"
    for name in ("widths", "shifts", "bias"):
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name))


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "",
        lambda text: text.replace("# scanner-sim", "# other"),
        lambda text: text.replace("0.8,0,", "0.8,0.1,"),
        lambda text: text.replace("0.010000", "much"),
        lambda text: text.replace("0.010000", "nan"),
        lambda text: text.replace("0.010000", "3.0"),
        lambda text: "\n".join(text.splitlines()[:-1]),
        lambda text: "\n".join(text.splitlines()[:3]),
    ],
)
def test_a_damaged_table_is_refused(change: Any, tmp_path: Path) -> None:
    path = tmp_path / "bias.csv"
    table = BiasTable("gaussian", np.array([0.8, 1.2]), np.array([-0.5, 0.0, 0.5]), np.full((2, 3), 0.01))
    write_bias(table, path)
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(InputError, match="scanner-sim calibrate"):
        read_bias(path)


def test_a_table_of_another_estimator_is_refused(config: Path, tmp_path: Path) -> None:
    table = BiasTable("gaussian", np.array([0.8, 1.2]), np.array([-0.5, 0.0, 0.5]), np.full((2, 3), 0.01))
    write_bias(table, tmp_path / "bias.csv")
    result = invoke("check", config, "--set", "processing.bias_correction=bias.csv")
    assert result.exit_code == 2
    assert "was measured with the estimator gaussian, not parabola" in result.output
    result = invoke("check", config, "--set", "processing.bias_correction=compute")
    assert "Did you mean 'computed'?" in result.output


def scenario(**parts: Any) -> Scenario:
    scan = {"rows": 1, "columns": 1, "horizontal": (0.0, 0.0), "vertical": (0.0, 0.0)}
    return Scenario(**{"schema": 1, "scan": scan, **parts})


def test_estimators_that_find_no_room_are_refused(config: Path) -> None:
    changes = ("--set", "processing.peak=blais_rioux_8", "--set", "scanner.position_sensor.pixels=8")
    result = invoke("check", config, *changes)
    assert result.exit_code == 2
    assert "blais_rioux_8 reads 11 pixels, and the array has 8" in result.output
    with pytest.raises((ScenarioError, ValueError), match="blais_rioux_8"):
        scenario(processing={"peak": "blais_rioux_8"}, scanner={"position_sensor": {"pixels": 8}})


@pytest.mark.parametrize(
    ("peak", "scanner", "words"),
    [
        ("gaussian", {"position_sensor": {"diffusion": 1e-6}}, "below 0.35 no estimator interpolates, not gaussian"),
        ("centre_of_mass", {}, "centre_of_mass reads 7 pixels and cuts the spot"),
        ("gaussian", {"position_sensor": {"diffusion": 600e-6}}, "see its core only"),
    ],
)  # fmt: skip
def test_estimators_that_work_badly_are_named(peak: str, scanner: dict[str, Any], words: str) -> None:
    assert any(
        words in doubt for doubt in scenario_warnings(scenario(processing={"peak": peak}, scanner=scanner))
    )
    corrected = {"peak": "maximum_likelihood", "bias_correction": "computed"}
    assert not any(
        "estimator" in doubt or "core" in doubt for doubt in scenario_warnings(scenario(processing=corrected))
    )
