"""The verb ``selfcal``: from the light on boards and balls to a calibration, and what it is worth elsewhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from claims import mean_square
from PIL import Image
from scipy.stats import chi2
from typer.testing import CliRunner

from scanner_sim import load_scenario
from scanner_sim.calibration.setup import read_setup
from scanner_sim.cli import app
from scanner_sim.config.calibration import read_calibration
from scanner_sim.foundation.parameters import INDEX

pytestmark = pytest.mark.usefixtures("device")

SCANNER = """\
schema: 1
scanner:
  as_built:
    base: 0.1 mm
    theta_zero: -0.2 mrad
    phi_scale: 500 ppm
    array_offset: 10 um
scan: {type: raster, rows: 8, columns: 8, horizontal: [-10 deg, 10 deg], vertical: [-10 deg, 10 deg]}
"""
PLAN = """\
schema: 1
base: scanner.yaml
seed: 5
parameters: {base: 0.1 mm, theta_zero: 0.2 mrad, phi_scale: 500 ppm, array_offset: 10 um}
survey: 20 um
visits: 2
boards:
  - name: near
    array: {rows: 3, columns: 3, spacing: [280 mm, 280 mm], diameter: 50 mm, plate: 120 mm}
    position: [-0.55 m, 0 m, 2.2 m]
    rotation: {axis: y, angle: -20 deg}
  - {name: balls, points: balls.csv, diameter: 120 mm, position: [0.9 m, 0.2 m, 3.4 m]}
  - name: check
    array: {rows: 2, columns: 3, spacing: [300 mm, 300 mm], diameter: 60 mm, plate: 140 mm}
    position: [0.2 m, -0.9 m, 3.1 m]
    held_out: true
stations:
  - {name: upright}
  - {name: turned, position: [0.2 m, 0 m, -0.3 m], rotation: {axis: z, angle: 90 deg}}
scale_bars: [{between: [near/1, balls/e], sigma: 50 um}]
"""
BALLS = "target,x_m,y_m,z_m\na,-0.5,-0.4,0\nb,0.5,-0.4,0.3\nc,0.4,0.4,-0.3\nd,-0.4,0.45,0.6\ne,0,0,0.9\n"


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory, device: str) -> Path:
    """A folder with plan, scanner and the calibration that came of them."""
    folder = tmp_path_factory.mktemp("selfcal")
    for name, text in (("scanner.yaml", SCANNER), ("plan.yaml", PLAN), ("balls.csv", BALLS)):
        (folder / name).write_text(text, encoding="utf-8")
    result = invoke("selfcal", folder / "plan.yaml", "-o", folder / "calib.yaml", "--device", "cpu")
    assert result.exit_code == 0, result.output
    assert "of what was held out" in result.stdout
    assert not result.stderr
    return folder


def test_the_calibrated_instrument_errs_by_noise_alone_on_a_board_that_it_has_not_seen(
    calibrated: Path,
) -> None:
    """Claim: what the light of two boards tells takes the instrument's errors off a third one, down to noise.

    Set-up: an instrument off by its tolerances, nine discs and five balls from two stations. Expected: the rms
    misfit of the held-out views over noise is 1, from above 3 as designed; the true parameters lie within the
    ellipsoid. Tolerance: of χ² at the level of the suite; lasting errors that targets share are
    taken for independent, which a rigid fit takes off in part: 15 % of slack.
    """
    told = json.loads((calibrated / "calib.json").read_text(encoding="utf-8"))
    held = told["misfit"]["held_out"]
    assert held["as_designed"] > 3.0
    freedom = 3 * held["sightings"] - 6 * held["views"]
    claim = mean_square(np.array([held["calibrated"]]), freedom=freedom, slack=0.15)
    assert claim, claim
    scanner = load_scenario(calibrated / "scanner.yaml").scanner
    found = read_calibration(calibrated / "calib.yaml", scanner)
    names = list(told["parameters"])
    index = [INDEX[name] for name in names]
    error = found.values[index] - scanner.as_built.parameters(0)[index]
    square = error @ np.linalg.solve(found.covariance[np.ix_(index, index)], error)
    assert square < chi2.isf(1e-4, len(names))
    sigma = np.sqrt(np.diagonal(found.covariance)[index])
    assert (sigma < [0.5 * told["parameters"][name]["tolerance"] for name in names]).all()


def test_the_file_says_what_the_report_says(calibrated: Path) -> None:
    scanner = load_scenario(calibrated / "scanner.yaml").scanner
    found = read_calibration(calibrated / "calib.yaml", scanner)
    told = json.loads((calibrated / "calib.json").read_text(encoding="utf-8"))
    for name, one in told["parameters"].items():
        number = INDEX[name]
        assert found.value(name) == pytest.approx(one["value"], rel=1e-12)
        assert found.covariance[number, number] == pytest.approx(one["sigma"] ** 2, rel=1e-12)
    for name in ("field", "residuals", "parameters"):
        with Image.open(calibrated / f"calib_{name}.png") as picture:
            assert picture.width > 900


MEASURED = """\
schema: 1
base: scanner.yaml
parameters: {base: 0.1 mm, theta_zero: 0.2 mrad, phi_scale: 500 ppm, array_offset: 10 um}
survey: 20 um
sightings: calib_sightings.csv
boards:
  - {name: near, points: calib_targets.csv}
  - {name: balls, points: calib_targets.csv}
  - {name: check, points: calib_targets.csv, held_out: true}
"""


def test_its_own_tables_are_sightings_of_your_own(calibrated: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: sightings and survey as they are written give the same again, without any pose, but for the scale bar."""
    for picture in ("field", "residuals", "parameters"):
        monkeypatch.setattr(f"scanner_sim.calibration.pictures.draw_{picture}", lambda _, path: path.touch())
    told = json.loads((calibrated / "calib.json").read_text(encoding="utf-8"))
    (calibrated / "measured.yaml").write_text(MEASURED, encoding="utf-8")
    result = invoke("selfcal", calibrated / "measured.yaml", "-o", calibrated / "again.yaml", "-q")
    assert result.exit_code == 0, result.output
    again = json.loads((calibrated / "again.json").read_text(encoding="utf-8"))
    assert again["sightings"] == "calib_sightings.csv"
    assert again["degrees_of_freedom"] == told["degrees_of_freedom"] - 1
    assert again["misfit"]["held_out"]["as_designed"] == pytest.approx(
        told["misfit"]["held_out"]["as_designed"]
    )
    for name, one in again["parameters"].items():
        assert abs(one["value"] - told["parameters"][name]["value"]) < one["sigma"]
    for name in ("sightings", "targets"):
        first, second = (
            (calibrated / f"{stem}_{name}.csv").read_text(encoding="utf-8") for stem in ("calib", "again")
        )
        assert first.splitlines()[:3] == second.splitlines()[:3]


def test_sightings_of_another_instrument_are_refused(calibrated: Path) -> None:
    other = (calibrated / "calib_sightings.csv").read_text(encoding="utf-8").splitlines()
    other[0] = "# scanner-sim sightings of instrument 0123456789ab"
    (calibrated / "other.csv").write_text("\n".join(other), encoding="utf-8")
    plan = (
        (calibrated / "plan.yaml")
        .read_text(encoding="utf-8")
        .replace("scale_bars", "sightings: other.csv\n#")
    )
    (calibrated / "other.yaml").write_text(plan, encoding="utf-8")
    result = invoke("selfcal", calibrated / "other.yaml")
    assert result.exit_code == 2
    assert "sightings of the instrument 0123456789ab" in result.stderr


def test_the_shipped_plan_is_one_and_help_names_the_verb(repo_root: Path) -> None:
    setup = read_setup(repo_root / "configs" / "calibration" / "two_boards.yaml")
    assert [board.held_out for board in setup.plan.boards] == [False, False, True]
    assert "selfcal" in invoke("--help").stdout
    assert "processing.calibration" in invoke("selfcal", "--help").stdout


@pytest.mark.parametrize(
    ("output", "words"),
    [("calib.txt", "ends in .yaml"), ("nowhere/calib.yaml", "no folder"), ("calib.yaml", "--overwrite")],
)
def test_a_calibration_is_not_written_just_anywhere(calibrated: Path, output: str, words: str) -> None:
    result = invoke("selfcal", calibrated / "plan.yaml", "-o", calibrated / output)
    assert result.exit_code == 2
    assert words in result.stderr
