"""The verb ``budget``: sources alone and together, simulated beside closed forms, and what dominates an image."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from scanner_sim import load_scenario
from scanner_sim.analytic.budget import range_budget
from scanner_sim.budget import HALF, measure_budget, sources_of
from scanner_sim.cli import app
from scanner_sim.cli.budgeting import instrument_of
from scanner_sim.dominance import dominating

WALL = """\
schema: 1
seed: 3
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 8 m], material: {reflectance: 0.5}}
scan: {type: raster, rows: 24, columns: 24, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}
"""

pytestmark = pytest.mark.usefixtures("device")


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "wall.yaml"
    path.write_text(WALL, encoding="utf-8")
    return path


def test_budget_writes_its_folder(config: Path) -> None:
    result = invoke("budget", config, "-o", "out", "--distances", 2, "--image", "--device", "cpu")
    assert result.exit_code == 0, result.output
    assert "speckle" in result.output
    for name in ("budget.png", "dominance.png"):
        with Image.open(Path("out", name)) as picture:
            assert picture.width > 600
    told = json.loads(Path("out/budget.json").read_text(encoding="utf-8"))
    with open("out/budget.csv", encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    names = sources_of(load_scenario(config))
    assert len(rows) == len(told["rows"]) == 2 * len(names)
    assert {row["source"] for row in rows} == set(names)
    assert {row["mode"] for row in rows} == {"triangulation"}
    assert sum(told["share_of_voxels_dominated"].values()) == pytest.approx(1.0)
    again = invoke("budget", config, "-o", "out", "--distances", 2)
    assert again.exit_code == 2
    assert "already holds a result" in again.output


def test_an_array_that_sees_too_little_is_refused(config: Path) -> None:
    result = invoke("budget", config, "-o", "out", "--set", "scanner.position_sensor.pixels=8")
    assert result.exit_code == 2
    assert "the array sees ranges from" in result.output
    assert not Path("out").exists()


@pytest.mark.parametrize("peak", ["gaussian", "maximum_likelihood", "blais_rioux_4"])
def test_simulated_is_analytic(config: Path, peak: str) -> None:
    """Claim: the closed forms are what is simulated, source by source.

    Set-up: the preset at 7 and 20 m, reflectance 0.5, 1936 shots for each source. Expected: equal. Tolerance: 12 % for
    shot, read and quantisation noise, the angle between projection and reception, and speckle: 4 standard errors of
    1.6 % and 5 % for the four places at which the simulation stands for all in the pixel. The bias of ``blais_rioux_4``
    within 25 %. The pixels' response has one pattern for each place: a factor of 3, and hence 25 % for all together.
    """
    scenario = load_scenario(config, [f"processing.peak={peak}"])
    bench = instrument_of(scenario, 0.5, HALF)
    for row in measure_budget(scenario, np.array([7.0, 20.0]), 0.5, device="cpu"):
        expected = range_budget(bench, row.range_m)[row.source]
        if row.source in ("shot", "read", "quantisation", "synchronisation", "speckle", "all"):
            slack = 0.25 if row.source == "all" else 0.12
            assert row.simulated_m == pytest.approx(expected, rel=slack), row.source
            assert row.low_m < row.simulated_m < row.high_m < 1.1 * row.simulated_m
        elif row.source == "response":
            assert expected / 3.0 < row.simulated_m < 3.0 * expected
        elif row.source == "estimator" and peak == "blais_rioux_4":
            assert row.simulated_m == pytest.approx(expected, rel=0.25)


def test_sources_alone_make_the_whole(config: Path) -> None:
    """Claim: the squares of all sources add up to that of all together.

    Set-up: as above, ``gaussian`` at 12 m. Expected: equal. Tolerance: 8 %: 4 standard errors of 1.6 %, and the
    response, whose pattern is another one in each run.
    """
    scenario = load_scenario(config, ["processing.peak=gaussian"])
    rows = measure_budget(scenario, np.array([12.0]), 0.5, device="cpu")
    found = {row.source: row.simulated_m for row in rows}
    whole = found.pop("all")
    assert np.sqrt(sum(value**2 for value in found.values())) == pytest.approx(whole, rel=0.08)


def test_what_dominates_an_image(config: Path) -> None:
    """Claim: speckle makes most of σ at 8 m; without it, and in weak light, read noise; parts sum to σ².

    Set-up: the wall by ``gaussian``, as it is, and of 0.3 mW without speckle. Expected: these; the parts of
    ``gaussian``, which is linear, add up to the stated variance. Tolerance: 3 %, single precision in differences of σ².
    """
    from scanner_sim import simulate

    scenario = load_scenario(config, ["processing.peak=gaussian"])
    found = dominating(scenario, device="cpu")
    assert found.shares()["speckle"] > 0.99
    image = simulate(scenario, device="cpu")
    valid = (image["status"] == 0) & (found.largest >= 0)
    assert valid.mean() > 0.95
    whole = image["sigma_range_m"][valid].astype(np.float64) ** 2
    assert np.median(found.variances.sum(axis=0)[valid] / whole) == pytest.approx(1.0, abs=0.03)
    weak = load_scenario(
        config, ["processing.peak=gaussian", "scanner.laser.power=0.3 mW", "scanner.laser.speckle=false"]
    )
    assert dominating(weak, device="cpu").shares()["read"] > 0.7
