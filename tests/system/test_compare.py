"""The verb ``compare``: files, verdicts, exit status, options, targets and baselines."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from typer.testing import CliRunner

from scanner_sim import load_scenario
from scanner_sim.cli import app
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.comparison import comparison_from_json, comparison_json
from scanner_sim.products.comparison_page import comparison_page
from scanner_sim.validation.compare.baseline import against, read_baseline
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget
from scanner_sim.validation.compare.laws import LAWS
from scanner_sim.validation.compare.run import judge_laws

WALL = """\
schema: 1
seed: 3
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 8 m], material: {reflectance: 0.5}}
scan: {type: raster, rows: 24, columns: 24, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}
"""
QUICK = ("--quick", "--device", "cpu", "--only", "spot_position", "--only", "points", "--only", "covariance")

pytestmark = pytest.mark.usefixtures("device")


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "wall.yaml"
    path.write_text(WALL, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Path]:
    """What the verb says and writes: no test changes the folder."""
    folder = tmp_path_factory.mktemp("compared")
    (folder / "wall.yaml").write_text(WALL, encoding="utf-8")
    return invoke("compare", folder / "wall.yaml", "-o", folder / "out", *QUICK), folder / "out"


@pytest.mark.slow
def test_compare_writes_its_folder(compared: tuple[Any, Path], config: Path) -> None:
    result, folder = compared
    assert result.exit_code == 0, result.output
    shutil.copytree(folder, "out")
    for name in ("spot_position", "points", "covariance", "All laws that apply hold"):
        assert name in result.output
    told = json.loads(Path("out/compare.json").read_text(encoding="utf-8"))
    assert told["passed"]
    assert [finding["name"] for finding in told["findings"]] == ["spot_position", "points", "covariance"]
    for finding in told["findings"]:
        assert finding["verdict"] == "holds"
        for check in finding["checks"]:
            assert check["low"] <= check["simulated"] <= check["high"]
            assert 0.0 <= check["p"] <= check["adjusted_p"] <= 1.0
            assert check["detects_90"] <= check["detects_99"]
    page = Path("out/compare.html").read_text(encoding="utf-8")
    assert page.count("<img") == 3
    assert "://" not in page  # nothing is fetched; letters of a picture may spell anything else
    with Image.open("out/compare.png") as picture:
        assert picture.width > 600
    assert load_scenario("out/scenario.yaml").seed == 3
    again = invoke("compare", config, "-o", "out", *QUICK)
    assert again.exit_code == 2
    assert "already holds a result" in again.output


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes_and_the_baseline_says_so(
    compared: tuple[Any, Path], config: Path
) -> None:
    shutil.copytree(compared[1], "one")
    result = invoke("compare", config, "-o", "two", *QUICK, "--baseline", "one/compare.json")
    assert result.exit_code == 0, result.output
    assert "Nothing differs from the baseline." in result.output
    one, two = (json.loads(Path(name, "compare.json").read_bytes()) for name in ("one", "two"))
    assert one["findings"] == two["findings"]
    other = invoke("compare", config, "-o", "three", *QUICK, "--baseline", "one/compare.json", "--seed", 4)
    assert other.exit_code == 0, other.output
    three = json.loads(Path("three/compare.json").read_bytes())
    assert three["findings"][1]["checks"] != one["findings"][1]["checks"]
    changed = invoke(
        "compare", config, "-o", "four", *QUICK, "--baseline", "one/compare.json",
        "--set", "scanner.receiver.baseline=210 mm",
    )  # fmt: skip
    assert changed.exit_code == 1, changed.output
    assert "Different from the baseline" in changed.output
    assert "All laws that apply hold" in changed.output


def test_a_noisier_run_of_another_seed_is_found(config: Path) -> None:
    """Claim: against a baseline of another seed a measured σ that is 15 % larger is found, an equal one is not.

    Set-up: ``covariance``, 8000 shots in each direction: the ratio of two deviations is known to 1.6 %, and five
    directions of four numbers ask for 4.4 standard errors, 7 %. Expected and tolerance: these verdicts.
    """
    setting = ComparisonSetup(load_scenario(config), FlatTarget(0.5, (3.0, 8.0)), device="cpu")
    before = judge_laws(setting, only=["covariance"])
    now = judge_laws(
        dataclasses.replace(setting, scenario=load_scenario(config, ["seed=9"])), only=["covariance"]
    )
    assert against(now, before).baseline == ()
    assert against(now, before).passed
    (finding,) = before.findings
    checks = tuple(dataclasses.replace(check, simulated=1.15 * check.simulated) for check in finding.checks)
    larger = dataclasses.replace(before, findings=(dataclasses.replace(finding, checks=checks),))
    found = against(now, larger).baseline
    assert found is not None
    assert len(found) == len(checks)
    assert {change.what for change in found} == {"simulated"}


def test_a_broken_law_fails_the_run(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from scanner_sim.ranging import ranges

    original = ranges.range_from_position
    monkeypatch.setattr(ranges, "range_from_position", lambda *given: 1.001 * original(*given))
    result = invoke("compare", config, "-o", "out", "--quick", "--only", "points", "--device", "cpu")
    assert result.exit_code == 1, result.output
    assert "1 of the laws broken" in result.output
    told = json.loads(Path("out/compare.json").read_text(encoding="utf-8"))
    assert not told["passed"]
    assert "Broken: No bias of range and point." in Path("out/compare.html").read_text(encoding="utf-8")


def test_a_comparison_survives_its_file(config: Path) -> None:
    setting = ComparisonSetup(load_scenario(config), quick=True, device="cpu")
    found = judge_laws(setting, only=["sigma_synchronisation", "tof_bound"])
    again = comparison_from_json(comparison_json(found))
    assert again == found
    assert comparison_page(again, "") == comparison_page(found, "")


def test_what_does_not_apply_says_why(config: Path) -> None:
    """Closed forms that do not cover a scenario are not stretched: each case has its reason."""
    cases = {
        "tof_bound": ((), "triangulation alone"),
        "coverage": (("processing.peak=parabola",), "parabola has a systematic error"),
        "speckle_limit": (("scanner.laser.speckle=false",), "makes no speckle"),
        "sigma_read": (("scanner.position_sensor.noise.read=false",), "has no read noise"),
        "sunlight": (("scanner.filter=none",), "no filter"),
        "link_budget": (("scanner.laser.drift=80 nm",), "blocks the laser's line"),
        "saturation": (("scanner.position_sensor.noise.saturation=false",), "switched off"),
    }
    for law, (changes, reason) in cases.items():
        setting = ComparisonSetup(load_scenario(config, list(changes)), device="cpu")
        (finding,) = judge_laws(setting, only=[law]).findings
        assert finding.verdict == "does not apply"
        assert reason in finding.reason, finding.reason


@pytest.mark.slow
def test_laws_hold_for_other_instruments(config: Path) -> None:
    """Claim: the laws are those of the scenario's own instrument, not of the preset.

    Set-up: a longer lens, base and wavelength, coarser pixels, a filter of cavities, another estimator with its bias.
    Expected: all laws hold. Tolerance: level 10⁻³, seed fixed.
    """
    changes = [
        "scanner.receiver={focal_length: 150 mm, baseline: 0.3 m, aperture: 30 mm, aberration: 30 um}",
        "scanner.position_sensor.diffusion=52 um",
        "scanner.laser={wavelength: 1.3 um, waist_radius: 3 mm, power: 8 mW}",
        "scanner.filter={bandwidth: 20 nm, shape: cavities}",
        "scanner.position_sensor={pixels: 320, pitch: 60 um, height: 400 um, read_noise: 2000 electron}",
        "scanner.mirrors={axis_separation: 80 mm, jitter: 20 urad, readout_noise: 5 urad}",
        "processing.peak=blais_rioux_4",
    ]
    setting = ComparisonSetup(
        load_scenario(config, changes), FlatTarget(0.3, (4.0, 7.0, 14.0)), quick=True, device="cpu"
    )
    found = judge_laws(setting)
    verdicts = {finding.name: finding.verdict for finding in found.findings}
    silent = {
        "coverage",
        "departures",
        "uneven",
        "tof_range",
        "tof_bound",
        "tof_sigma",
        "tof_coverage",
        "tof_walk",
    }
    assert {name for name, verdict in verdicts.items() if verdict == "does not apply"} == silent
    assert not found.broken, [
        (finding.name, check.case, check.effect)
        for finding in found.broken
        for check in finding.checks
        if check.broken
    ]


@pytest.mark.parametrize(
    ("text", "reflectance", "ranges"),
    [
        ("50 % at 3 m, 10 m, 20 m", 0.5, (3.0, 10.0, 20.0)),
        ("0.2 at 800 cm", 0.2, (8.0,)),
        ("12 m, 4 m", 0.5, (4.0, 12.0)),
    ],
)
def test_targets_in_words(text: str, reflectance: float, ranges: tuple[float, ...]) -> None:
    assert FlatTarget.parse(text) == FlatTarget(reflectance, pytest.approx(ranges))


@pytest.mark.parametrize("text", ["", "50 % at", "120 % at 3 m", "3", "-2 m", "white at 3 m", "50 % at 3 kg"])
def test_targets_that_are_none(text: str) -> None:
    with pytest.raises(InputError, match="--target"):
        FlatTarget.parse(text)


def test_bad_options_are_refused(config: Path) -> None:
    cases = {
        ("--only", "gravity"): "there is no law called gravity",
        ("--level", 2.0): "not between 0 and 1",
        ("--target", "far away"): "--target",
        ("--baseline", "none.json"): "cannot be opened",
        ("--baseline", config): "is no comparison",
    }
    for options, message in cases.items():
        result = invoke("compare", config, "-o", "out", "--device", "cpu", *options)
        assert result.exit_code == 2, result.output
        assert message in result.output
        assert not Path("out").exists()


def test_laws_have_names_of_their_own() -> None:
    assert len({law.name for law in LAWS}) == len(LAWS)
    assert all(law.title and law.source and law.statement for law in LAWS)


def test_a_baseline_without_a_law_leaves_it_out(config: Path) -> None:
    setting = ComparisonSetup(load_scenario(config), quick=True, device="cpu")
    before = judge_laws(setting, only=["spot_width"])
    now = judge_laws(setting, only=["spot_width", "saturation"])
    Path("old.json").write_text(comparison_json(before), encoding="utf-8")
    assert against(now, read_baseline("old.json")).baseline == ()
