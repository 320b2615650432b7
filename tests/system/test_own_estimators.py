"""Estimators of the user's own through every verb: the same numbers as the program's, judged by what they state."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import own_estimators as own
import pytest
from typer.testing import CliRunner

from scanner_sim import compare, load_scenario, open_campaign, register_peak, register_pulse, simulate, track
from scanner_sim.cli import app
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.signals.processing import PEAKS
from scanner_sim.signals.waveform.settings import PULSES
from scanner_sim.validation.compare.closed_forms import EstimatorForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget
from scanner_sim.validation.compare.law import Law
from scanner_sim.validation.compare.laws import LAWS
from scanner_sim.validation.studies.budget import measure_budget

pytestmark = pytest.mark.usefixtures("device")

BARE = [
    "processing.validation={background: false, shape: false, misfit: 0, max_reflectance: null, uneven: false}",
    "processing.ambiguity=1.0",
    "scanner.laser.speckle=false",
]
"""What the copy leaves out: the program's search under sunlight, its tests of the spot, speckle, and what differences
of neighbours, which rounding changes most, add to σ."""
ULP = 2.0**-16
"""Rounding of a position below 256 pixels to single precision, from charges in single precision [pixel]: four units in
the last place."""


@pytest.fixture(autouse=True)
def _registered() -> Iterator[None]:
    PEAKS.clear()
    PULSES.clear()
    for name in ("gaussian_copy", "centroid", "overconfident", "biased", "blundering"):
        register_peak(name, getattr(own, name))
    for name in ("pulse_vertex", "overconfident_pulse"):
        register_pulse(name, getattr(own, name))
    yield
    PEAKS.clear()
    PULSES.clear()


def plane(repo_root: Path, *changes: str) -> Scenario:
    return load_scenario(repo_root / "configs" / "plane.yaml", list(changes))


def pair(repo_root: Path, config: str, *changes: str) -> list[Scenario]:
    """Return a scenario with the program's estimator, and with its copy."""
    path = repo_root / "configs" / config
    return [
        load_scenario(path, [*BARE, *changes, f"processing.peak={name}"])
        for name in ("gaussian", "gaussian_copy")
    ]


def test_a_copy_of_an_estimator_gives_the_same_image(repo_root: Path) -> None:
    """Claim: position, σ, status and light are those of the program's kernel within single precision.

    Positions within four units of their last place, σ within 10⁻⁵, a covariance within twice that of both σ, light and
    status to the bit: what the instrument adds is summed about the same pixel.
    """
    one, other = (
        simulate(scenario, device="cpu")
        for scenario in pair(repo_root, "plane.yaml", "scan.rows=24", "scan.columns=24")
    )
    assert np.abs(one["peak_px"] - other["peak_px"]).max() < ULP
    for name in ("sigma_peak_px", "sigma_range_m"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-5)
    apart = (one["cov_xz_m2"] - other["cov_xz_m2"]) / (one["sigma_x_m"] * one["sigma_z_m"])
    np.testing.assert_allclose(apart, np.where(one["status"] == 0, 0.0, np.nan), atol=2e-5)
    for name in ("Y", "snr_detection", "status", "background"):
        assert (one[name] == other[name]).all(), name
    assert (one["status"] == 0).mean() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("batch", [97, 4096])
def test_any_batch_gives_the_same_bytes(repo_root: Path, batch: int) -> None:
    """Claim: nothing depends on which lines a function is given together; here with speckle and under the Sun."""
    scenario = load_scenario(
        repo_root / "configs" / "lighting_full_shadow.yaml",
        ["processing.peak=centroid", "scan.rows=12", "scan.columns=12", "transport.background_samples=2"],
    )
    one, other = simulate(scenario, device="cpu"), simulate(scenario, device="cpu", batch=batch)
    assert all(one[name].tobytes() == other[name].tobytes() for name in one.channels)


@pytest.mark.slow
def test_a_copy_of_an_estimator_gives_the_same_track(repo_root: Path) -> None:
    """Claim: the closed loop aims by it; centres differ by less than a hundredth of their σ, which is the same.

    Pixels are alike: unlike ones count for a function of the user's as for an efficient fit, and for the program's own
    by the three that it leans on, so that σ of R is twice as large with these.
    """
    changes = ("scan.duration=0.2 s", "processing.range_gate=null", "scanner.position_sensor.prnu=0")
    one, other = (track(scenario, device="cpu") for scenario in pair(repo_root, "track_still.yaml", *changes))
    assert len(one.records) == len(other.records) > 4
    for first, second in zip(one.records, other.records, strict=True):
        assert first.status == second.status
        sigma = np.sqrt(np.diagonal(first.covariance))
        assert np.all(np.abs(first.position - second.position) <= 0.01 * sigma)
        np.testing.assert_allclose(
            first.covariance, second.covariance, rtol=1e-2, atol=1e-3 * sigma.min() ** 2
        )


@pytest.mark.slow
def test_a_copy_of_an_estimator_gives_the_same_budget(repo_root: Path) -> None:
    """Claim: every source alone and all together agree within the rounding of positions, and none has a closed form."""
    one, other = (
        measure_budget(scenario, np.array([4.3, 9.1]), 0.5, device="cpu")
        for scenario in pair(repo_root, "plane.yaml")
    )
    for first, second in zip(one, other, strict=True):
        rounding = ULP * first.range_m**2 * 2.5e-3
        assert first.simulated_m == pytest.approx(second.simulated_m, rel=1e-3, abs=rounding), first.source
        assert first.freedom == second.freedom


def verdicts(found: Any) -> dict[str, str]:
    return {finding.name: finding.verdict for finding in found.findings}


def test_a_copy_of_an_estimator_is_judged_alike(repo_root: Path) -> None:
    """Claim: the law of photons finds the same σ for both, and the copy's prediction comes from the caller's form."""
    how: dict[str, Any] = {
        "only": ["sigma_shot"],
        "quick": True,
        "target": "50 % at 5 m, 9 m",
        "device": "cpu",
    }
    scenarios = pair(repo_root, "plane.yaml")
    one = compare(scenarios[0], **how).findings[0]
    silent = compare(scenarios[1], **how).findings[0]
    other = compare(scenarios[1], closed_forms={"position": own_gaussian}, **how).findings[0]
    assert not silent.checks
    assert "closed_forms={'sigma': function}" in silent.reason
    for first, second in zip(one.checks, other.checks, strict=True):
        assert second.predicted == pytest.approx(first.predicted, rel=1e-6)
        assert second.simulated == pytest.approx(first.simulated, rel=1e-3)
        assert not second.broken


def own_gaussian(line: Any) -> float:
    top = int(line.argmax())
    left, middle, right = np.log(line[top - 1 : top + 2])
    return float(top + 0.5 * (left - right) / (left - 2.0 * middle + right))


def test_a_closed_form_that_is_none_is_refused(repo_root: Path) -> None:
    with pytest.raises(InputError, match="Possible: position, sigma"):
        compare(plane(repo_root, "processing.peak=centroid"), closed_forms={"place": own_gaussian})


@pytest.mark.parametrize(
    ("peak", "broken"),
    [
        ("centroid", set()),
        ("overconfident", {"mean square", "share within 1.96 σ", "point: χ² of three, over three"}),
        ("biased", {"mean"}),
    ],
)
def test_compare_judges_the_estimators_own_sigma(repo_root: Path, peak: str, broken: set[str]) -> None:
    """Claim: at a level of 10⁻³ σ that is 30 % too small and a bias of half a σ are found, an honest σ is not accused.

    16 seeds of some 400 voxels: the mean square of the pulls, 2.04 where σ is 30 % too small, is known to 0.05; their
    mean to 0.02.
    """
    scenario = plane(repo_root, f"processing.peak={peak}")
    found = compare(scenario, only=["coverage"], quick=True, target="50 % at 4 m, 16 m", device="cpu")
    got = {check.case for check in found.findings[0].checks if check.broken}
    assert got >= broken
    assert bool(got) == bool(broken)
    assert found.own_estimators == (peak,)


@pytest.mark.parametrize(("pulse", "holds"), [("pulse_vertex", True), ("overconfident_pulse", False)])
def test_compare_judges_the_sigma_of_a_timing(repo_root: Path, pulse: str, holds: bool) -> None:
    """Claim: as the test above, for time of flight."""
    scenario = plane(repo_root, "ranging=tof", f"processing.pulse.timing={pulse}")
    how: dict[str, Any] = {"only": ["tof_coverage"], "quick": True, "device": "cpu"}
    found = compare(scenario, target="50 % at 8 m, 16 m", **how)
    assert verdicts(found) == {"tof_coverage": "holds" if holds else "broken"}


TOUCHES = {"light": set(), "built-in": set(), "targets": set(), "peak": {"peak"}, "pulse": {"pulse"}}


def test_every_law_says_what_it_exercises() -> None:
    assert {law.exercises for law in LAWS} <= TOUCHES.keys()
    assert all(law.exercises == "peak" for law in LAWS if law.needs)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_what_a_law_says_that_it_exercises_is_true(repo_root: Path, law: Law) -> None:
    """Claim: what a law measures changes with the scenario's estimators if it says so, and only then, to the bit.

    A peak that is three pixels away and blind for full pixels, and a timing whose σ is too small, take the place of
    honest ones.
    """
    changes = ["ranging=both", "scanner.mirrors.synchronisation=20 urad"]
    if law.of_built:
        changes.append("scanner.as_built.phi_zero=100 urad")
    measured = {}
    for peak, pulse in (
        ("centroid", "pulse_vertex"),
        ("blundering", "pulse_vertex"),
        ("centroid", "overconfident_pulse"),
    ):
        chosen = [*changes, f"processing.peak={peak}", f"processing.pulse.timing={pulse}"]
        scenario, targets = plane(repo_root, *chosen), FlatTarget(0.5, (7.3, 9.1, 16.7))
        forms = EstimatorForms(position=own.centroid_of_line)
        setting = ComparisonSetup(scenario, targets, quick=True, device="cpu", closed_forms=forms)
        measured[peak, pulse] = law.measure(setting)
    honest, blunder, overconfident = measured.values()
    assert honest
    touched = {name for name, other in (("peak", blunder), ("pulse", overconfident)) if other != honest}
    assert touched == TOUCHES[law.exercises]


def test_the_report_lists_the_laws_that_say_nothing(
    repo_root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: on the terminal and on the page stand the laws that judge other code; without an own estimator neither."""
    monkeypatch.chdir(tmp_path)
    laws = [word for name in ("link_budget", "cramer_rao", "points") for word in ("--only", name)]
    given = [
        str(repo_root / "configs/plane.yaml"),
        "--quick",
        "--target",
        "50 % at 9 m",
        "--device",
        "cpu",
        *laws,
    ]
    told = run("compare", *given, "-o", "mine", "--peak", "own_estimators:centroid")
    page = Path("mine/compare.html").read_text(encoding="utf-8")
    for text in (told, page):
        assert "say nothing about centroid" in text.replace("Say", "say")
        assert "judges light, before any estimator" in text
        assert "judges the built-in estimator only" in text
        assert "no closed form is given of centroid" in text.replace("&#39;", "'")
    told = run("compare", *given, "-o", "theirs")
    assert "othing about" not in told + Path("theirs/compare.html").read_text(encoding="utf-8")


def run(*words: str, status: int = 0) -> str:
    result = CliRunner().invoke(app, list(words))
    assert result.exit_code == status, result.output
    return result.output


def test_the_command_line_takes_a_function(
    small_scenario: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: --peak registers and takes it, check and show know it, and without it a voxel is refused, pictures not."""
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(small_scenario, encoding="utf-8")
    mine = ("--peak", "own_estimators:centroid")
    assert "peak: centroid" in run("check", "small.yaml", *mine)
    run("run", "small.yaml", "-o", "out", "--device", "cpu", *mine)
    PEAKS.clear()
    run("show", "out", "-o", "pictures")
    assert "no estimator 'centroid' is registered" in run("show", "out", "--voxel", "2", "2", status=2)
    run("show", "out", "--voxel", "2", "2", *mine)
    PEAKS.clear()
    assert "register_peak" in run("run", "out/scenario.yaml", "-o", "again", status=2)
    assert "no function nowhere" in run("check", "small.yaml", "--peak", "own_estimators:nowhere", status=2)
    assert "is not MODULE:FUNCTION" in run("check", "small.yaml", "--pulse", "own_estimators", status=2)


PLAN = """\
schema: 1
base: small.yaml
seed: 5
vary:
  - keys: {processing.peak: [maximum_likelihood, centroid]}
measure: [sigma_range]
"""


@pytest.mark.pinned
@pytest.mark.slow
def test_the_workers_of_a_campaign_know_it(
    small_scenario: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: a plan may vary estimators, the user's among them; rows in this process and on a worker are the same."""
    pytest.importorskip("distributed", reason="the extra campaign is not installed")
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(small_scenario, encoding="utf-8")
    Path("plan.yaml").write_text(PLAN, encoding="utf-8")
    Path("mine.py").write_text(Path(own.__file__).read_text(encoding="utf-8"), encoding="utf-8")
    PEAKS.clear()
    assert "register_peak" in run("campaign", "plan.yaml", "-o", "none", "--workers", "0", status=2)
    tables = []
    for workers in ("0", "1"):
        PEAKS.clear()
        words = ("plan.yaml", "-o", workers, "--workers", workers, "--quiet", "--peak", "mine:centroid")
        run("campaign", *words, "--device", "cpu")
        assert "2 of 2 done" in run("campaign", "status", workers)
        tables.append(open_campaign(Path(workers)).table())
    sigma = [table["sigma_range"] for table in tables]
    assert sigma[0].tolist() == sigma[1].tolist()
    assert sigma[0][0] != sigma[0][1]
    PEAKS.clear()
    assert "register_peak" in run("campaign", "rerun", "0", "--run", "1", status=2)
    run("campaign", "rerun", "0", "--run", "1", "--peak", "mine:centroid", "--device", "cpu")
