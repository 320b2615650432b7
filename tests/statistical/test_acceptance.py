"""Acceptance tests through light and detector: what a perfect instrument passes, and what a wrong one fails by."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from claims import at_most, mean, scatter_ratio, share
from numpy.typing import NDArray
from scipy.stats import norm

from scanner_sim.acceptance.setup import read_setup
from scanner_sim.acceptance.verdicts import Accepted, Verdict, accept

Array = NDArray[np.float64]

pytestmark = pytest.mark.usefixtures("device")

BASE = """\
schema: 1
scanner: {{preset: nrc_2000{0}}}
scan: {{type: raster, rows: 8, columns: 8, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}}
"""
BAR = "{name: bar, position: [0 m, 0 m, 2.3 m], direction: [1, 0, 1], length: 0.6 m, diameter: 120 mm}"
PLAN = """\
schema: 1
base: base.yaml
seed: {seed}
repetitions: {repetitions}
across: {across}
limits: [{{up_to: 4 m, length: {length} mm, size: 1 mm, form: 3 mm, flatness: 3 mm}}]
lengths: [{bar}]
"""
SURFACES = """\
spheres: [{name: ball, position: [0.3 m, 0.1 m, 2.5 m], diameter: 150 mm}]
plates: [{name: plate, position: [0.2 m, 0 m, 2.4 m], size: [150 mm, 150 mm]}]
"""
REPETITIONS = 80


def accepted(folder: Path, scanner: str = "", more: str = "", **plan: object) -> Accepted:
    values = {"seed": 3, "repetitions": 20, "across": 24, "length": 1.0, "bar": BAR, **plan}
    (folder / "base.yaml").write_text(BASE.format(scanner), encoding="utf-8")
    (folder / "plan.yaml").write_text(PLAN.format(**values) + more, encoding="utf-8")
    return accept(read_setup(folder / "plan.yaml"), device="cpu")


def errors(found: Accepted, quantity: str) -> Array:
    return np.array([one.error for one in found.results if one.quantity == quantity])


@pytest.fixture(scope="module")
def perfect(tmp_path_factory: pytest.TempPathFactory, device: str) -> Accepted:
    """An instrument as designed, before artefacts as certified; the limit of lengths is one standard deviation."""
    return accepted(
        tmp_path_factory.mktemp("perfect"), more=SURFACES, repetitions=REPETITIONS, length=0.06, seed=11
    )


@pytest.mark.slow
@pytest.mark.parametrize("quantity", ["length", "size"])
def test_sigma_covers_and_its_noise_is_the_scatter(perfect: Accepted, quantity: str) -> None:
    """Claim: lengths and diameters scatter by the noise that is stated, and lie within 2 σ in 95 % at least.

    Tolerance: F of 79 degrees of freedom, and 15 %: images select an artefact's points, and unlike pixels are known by
    the mean width of its images. The calibration is exact, so that σ is the noise.
    """
    stated = [one for one in perfect.results if one.quantity == quantity]
    found = errors(perfect, quantity)
    noise = float(np.sqrt(np.mean([one.sigma_noise**2 for one in stated])))
    assert scatter_ratio(float(found.std(ddof=1)), noise, (REPETITIONS - 1, np.inf), slack=0.15)
    sigma = np.array([one.sigma for one in stated])
    assert at_most(int((np.abs(found) > 2.0 * sigma).sum()), REPETITIONS, 0.05)
    assert sigma == pytest.approx([one.sigma_noise for one in stated])


@pytest.mark.slow
@pytest.mark.parametrize("quantity", ["form", "flatness"])
def test_forms_are_those_that_noise_makes(perfect: Accepted, quantity: str) -> None:
    """Claim: form and flatness have the mean and the scatter that a perfect surface has by noise.

    Tolerance: Student's t with a slack of 5 %, the accuracy to which σ of single ranges is stated, and F with 15 %.
    """
    stated = [one for one in perfect.results if one.quantity == quantity]
    expected = float(np.mean([one.expected for one in stated]))
    assert mean(errors(perfect, quantity) / expected, 1.0, slack=0.05)
    spread, scatter = (
        float(np.mean([one.sigma for one in stated])),
        float(errors(perfect, quantity).std(ddof=1)),
    )
    assert scatter_ratio(scatter, spread, (REPETITIONS - 1, np.inf), slack=0.15)


@pytest.mark.slow
def test_a_perfect_instrument_passes_at_the_rate_of_its_noise(perfect: Accepted) -> None:
    """Claim: of lengths whose errors are normal, 2Φ(M/σ) − 1 pass the limit M; σ is that of the sample itself.

    Tolerance: binomial, and 10 % for σ and a mean that are estimated from the same 80.
    """
    found = errors(perfect, "length")
    passed = sum(one.verdict is Verdict.PASSES for one in perfect.results if one.quantity == "length")
    low, high = (norm.cdf((end - found.mean()) / found.std(ddof=1)) for end in (-6e-5, 6e-5))
    assert share(passed, REPETITIONS, float(high - low), slack=0.1)
    others = [one for one in perfect.results if one.quantity != "length"]
    assert all(one.verdict is Verdict.PASSES for one in others)


@pytest.mark.slow
@pytest.mark.parametrize("off", [2.0, -2.0])
def test_a_wrong_base_fails_by_its_closed_form(tmp_path: Path, off: float) -> None:
    """Claim: with a base D + δ that is believed to be D, points of the plane φ = 0 shrink by D/(D + δ) (eq 1).

    Tolerance: Student's t of 20 repetitions, and 5 µm for what is left of the light on spheres.
    """
    found = accepted(tmp_path, f", as_built: {{base: {off} mm}}")
    assert mean(errors(found, "length"), 0.6 * (0.2 / (0.2 + 1e-3 * off) - 1.0), slack=5e-6)
    assert found.verdict is Verdict.FAILS


@pytest.mark.slow
def test_a_wrong_scale_of_time_fails_by_its_closed_form(tmp_path: Path) -> None:
    """Claim: ranges that are longer by a share k make everything in the plane φ = 0 larger by k.

    Tolerance: Student's t of 20 repetitions, and 0.1 mm for pulses from the slopes of spheres. These are so large that
    noise of 10 mm leaves their form: fits of 120 mm are lost in it at times, which is told.
    """
    bar = BAR.replace("120 mm", "240 mm")
    found = accepted(tmp_path, ", as_built: {tof_scale: 2 %}", "ranging: tof\n", across=28, bar=bar)
    assert mean(errors(found, "length"), 0.02 * 0.6, slack=1e-4)
    assert found.verdict is Verdict.FAILS
