"""The verb ``acceptance``: from the light on bars, spheres and plates to a maker's verdict."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import html5lib
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from scanner_sim.cli import app

pytestmark = pytest.mark.usefixtures("device")

BASE = """\
schema: 1
scanner: {{preset: nrc_2000{0}}}
scan: {{type: raster, rows: 8, columns: 8, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}}
{1}
"""
PLAN = """\
schema: 1
base: base.yaml
repetitions: 2
across: 24
limits: [{up_to: 4 m, length: 0.9 mm, length_ratio: 200 ppm, size: 2 mm, form: 4 mm, flatness: 4 mm}]
lengths:
  - {name: bar, position: [0 m, 0 m, 2.3 m], direction: [1, 0, 1], length: 0.6 m, diameter: 120 mm, sigma: 0.2 mm}
spheres: [{name: ball, position: [0.3 m, 0.1 m, 2.5 m], diameter: 150 mm}]
plates: [{name: plate, position: [0.2 m, 0 m, 2.4 m], size: [200 mm, 150 mm], rotation: {axis: y, angle: 20 deg}}]
"""


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def acceptance_of(folder: Path, scanner: str = "", more: str = "", plan: str = PLAN) -> tuple[Any, Path]:
    (folder / "base.yaml").write_text(BASE.format(scanner, more), encoding="utf-8")
    (folder / "plan.yaml").write_text(plan, encoding="utf-8")
    return invoke("acceptance", folder / "plan.yaml", "-o", folder / "out", "--device", "cpu"), folder / "out"


@pytest.fixture(scope="module")
def passed(tmp_path_factory: pytest.TempPathFactory, device: str) -> tuple[Any, Path]:
    return acceptance_of(tmp_path_factory.mktemp("acceptance"))


def test_a_good_instrument_passes_and_the_report_says_what_was_done(passed: tuple[Any, Path]) -> None:
    result, folder = passed
    assert result.exit_code == 0, result.output
    assert "The instrument passes" in result.stdout
    assert "two-face" in result.stdout
    assert "a quarter of the limit" in result.stderr
    report = json.loads((folder / "acceptance.json").read_text(encoding="utf-8"))
    assert report["verdict"] == "passes"
    assert {one["quantity"] for one in report["tests"]} == {"length", "size", "form", "flatness"}
    assert len(report["results"]) == 2 * len(report["tests"])
    for one in report["results"]:
        assert one["error_m"] == pytest.approx(one["measured_m"] - one["reference_m"])
        assert 0.0 < one["sigma_m"] < one["limit_m"]
    assert report["results"][0]["uncertainty_m"] == pytest.approx(4e-4)
    assert report["results"][0]["limit_m"] == pytest.approx(0.9e-3 + 2e-4 * 0.6)
    assert any("two-face" in sentence for sentence in report["departures"])


def test_page_and_pictures_can_be_looked_at(passed: tuple[Any, Path]) -> None:
    _, folder = passed
    text = (folder / "acceptance.html").read_text(encoding="utf-8")
    html5lib.HTMLParser(strict=True).parse(text)
    assert text.count("data:image/png;base64,") == 3
    assert "http://" not in text
    for name in ("errors", "places", "deviations"):
        assert np.ptp(np.asarray(Image.open(folder / f"{name}.png").convert("L"))) > 100


@pytest.mark.slow
def test_the_same_plan_gives_the_same_numbers_and_no_result_is_replaced(
    passed: tuple[Any, Path], tmp_path: Path
) -> None:
    _, folder = passed
    _, again = acceptance_of(tmp_path)
    name = "acceptance.json"
    assert (again / name).read_bytes() == (folder / name).read_bytes()
    result, _ = acceptance_of(tmp_path)
    assert result.exit_code == 2
    assert "--overwrite" in result.stderr


@pytest.mark.slow
def test_a_wrong_instrument_fails_and_passes_with_its_calibration(tmp_path: Path) -> None:
    """Claim: a base that is 1 mm too long fails lengths; the calibration that knows it takes that away."""
    result, folder = acceptance_of(tmp_path, ", as_built: {base: 1 mm}")
    assert result.exit_code == 1, result.output
    assert "The instrument fails" in result.stdout
    report = json.loads((folder / "acceptance.json").read_text(encoding="utf-8"))
    verdicts = {one["quantity"]: one["verdict"] for one in report["tests"]}
    assert verdicts["length"] == "fails"
    assert verdicts["flatness"] == "passes"
    calibration = (
        f"schema: 1\nabout: known\ninstrument: '{report['instrument']}'\n"
        "parameters: {base: {value: 1 mm, sigma: 0.1 mm}}\n"
    )
    more = "processing: {calibration: calib.yaml}"
    plan = PLAN + "rule: simple\n"
    (tmp_path / "known").mkdir()
    (tmp_path / "known" / "calib.yaml").write_text(calibration, encoding="utf-8")
    result, folder = acceptance_of(tmp_path / "known", ", as_built: {base: 1 mm}", more, plan)
    assert result.exit_code == 0, result.output
    report = json.loads((folder / "acceptance.json").read_text(encoding="utf-8"))
    length = next(one for one in report["results"] if one["quantity"] == "length")
    # σ of the base over the base, times the length: all lengths have it in common.
    assert length["sigma_common_m"] == pytest.approx(0.6 * 1e-4 / 0.201, rel=0.05)


def test_an_artefact_that_is_not_seen_is_a_fault(tmp_path: Path) -> None:
    plan = PLAN.replace("diameter: 150 mm", "diameter: 150 mm, material: {reflectance: 0.0001}")
    result, _ = acceptance_of(tmp_path, plan=plan)
    assert result.exit_code == 2, result.output
    assert "valid points" in result.stderr
    assert "brighter" in result.stderr


def test_help_suffices() -> None:
    assert "acceptance" in invoke("--help").stdout
    words = invoke("acceptance", "--help").stdout
    assert "exit status is 1" in words
    assert "prototype.yaml" in words
