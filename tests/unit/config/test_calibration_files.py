"""Calibrations as files: what is read is what was written, and every fault has its place and remedy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from scanner_sim import load_scenario
from scanner_sim.config.calibration import (
    CalibratedCubic,
    CalibratedRatio,
    KnownExpansion,
    TemperatureOfUse,
    believed_geometry,
    calibration_text,
    design_digest,
    design_of,
    read_calibration,
)
from scanner_sim.config.load import load_scanner
from scanner_sim.config.warnings import scenario_warnings
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.ranging.calibration import Calibration

SCANNER = load_scanner("nrc_2000")
DIGEST = design_digest(SCANNER)
GOOD = f"""\
schema: 1
about: bench, March
instrument: '{DIGEST}'
parameters:
  base: {{value: 0.12 mm, sigma: 5 um}}
  theta_zero: {{value: -12 urad, sigma: 3 urad}}
  tof_zero: {{value: 4 mm}}
correlation:
  of: [base, theta_zero]
  matrix:
    - [1.0, 0.4]
    - [0.4, 1.0]
"""


def read(folder: Path, text: str) -> Calibration:
    (folder / "calibration.yaml").write_text(text, encoding="utf-8")
    return read_calibration(folder / "calibration.yaml", SCANNER)


def test_a_file_gives_values_and_covariance(tmp_path: Path) -> None:
    found = read(tmp_path, GOOD)
    assert found.value("base") == 1.2e-4
    assert found.value("tof_zero") == 4e-3
    wanted = np.zeros((len(NAMES), len(NAMES)))
    base, zero = INDEX["base"], INDEX["theta_zero"]
    wanted[base, base], wanted[zero, zero] = 5e-6**2, 3e-6**2
    wanted[base, zero] = wanted[zero, base] = 0.4 * 5e-6 * 3e-6
    np.testing.assert_allclose(found.covariance, wanted, rtol=1e-14)
    np.testing.assert_allclose(found.root @ found.root.T, wanted, rtol=1e-9, atol=1e-24)
    assert found.root.shape == (len(NAMES), 2)


@pytest.mark.parametrize(("apart", "errors"), [(1e-7, 2), (1e-15, 1)])
def test_what_is_nearly_one_combination_keeps_what_rounding_leaves_of_it(apart: float, errors: int) -> None:
    """Claim: of two parameters of correlation 1 − a the difference keeps its variance 2 a σ² unless a is rounding."""
    covariance = np.zeros((len(NAMES), len(NAMES)))
    pair = np.ix_(*2 * ([INDEX["base"], INDEX["theta_zero"]],))
    covariance[pair] = 9e-12 * np.array([[1.0, 1.0 - apart], [1.0 - apart, 1.0]])
    root = Calibration(np.zeros(len(NAMES)), covariance, design_of(SCANNER)).root
    assert root.shape == (len(NAMES), errors)
    difference = root[INDEX["base"]] - root[INDEX["theta_zero"]]
    assert difference @ difference == pytest.approx(2.0 * apart * 9e-12, rel=1e-6, abs=1e-25)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    values, root = 1e-4 * random.standard_normal(len(NAMES)), 1e-5 * random.standard_normal((len(NAMES), 4))
    written = Calibration(values, root @ root.T, design_of(SCANNER), 0.03)
    found = read(tmp_path, calibration_text(written, SCANNER, "a 'test': all of them"))
    np.testing.assert_array_equal(found.values, values)
    np.testing.assert_allclose(found.covariance, written.covariance, rtol=1e-12, atol=1e-24)
    assert found.encoder_period == 0.03
    assert found.root.shape == (len(NAMES), 4)


USE = """\
power_noise: 0.5 %
pulse_noise: 2 %
vibration:
  turn: [[5 Hz, 1e-10 rad^2/Hz], [100 Hz, 1e-13 rad^2/Hz]]
"""


def test_what_is_known_of_its_use_is_read_back(tmp_path: Path) -> None:
    """Claim: vibration and power noise of a file are believed, and a calibration writes them; faults have places."""
    found = read(tmp_path, GOOD + USE)
    assert (found.power_noise, found.pulse_noise) == (0.005, 0.02)
    assert found.vibration is not None
    assert found.vibration.turn == ((5.0, 1e-10), (100.0, 1e-13))
    again = read(tmp_path, calibration_text(found, SCANNER))
    assert (again.vibration, again.power_noise, again.pulse_noise) == (found.vibration, 0.005, 0.02)
    assert read(tmp_path, GOOD).vibration is None
    with pytest.raises(ScenarioError) as caught:
        read(tmp_path, GOOD + USE.replace("[100 Hz", "[1 Hz"))
    assert [fault.location for fault in caught.value.faults] == ["vibration.turn"]


@pytest.mark.parametrize("period", ["30 mrad", "360 deg"])
@pytest.mark.parametrize("known", ["value: 50 urad", "value: 0 urad, sigma: 5 urad"])
def test_periodic_errors_are_written_with_their_period(tmp_path: Path, period: str, known: str) -> None:
    """Claim: also where they go once round in a turn, as those of an encoder that is off its axis."""
    parameters = f"encoder_period: {period}\nparameters: {{theta_sine: {{{known}}}}}\n"
    found = read(tmp_path, f"schema: 1\ninstrument: '{DIGEST}'\n{parameters}")
    again = read(tmp_path, calibration_text(found, SCANNER))
    assert again.encoder_period == found.encoder_period
    np.testing.assert_array_equal(again.values, found.values)
    np.testing.assert_array_equal(again.covariance, found.covariance)


@pytest.mark.parametrize(("scan", "warned"), [("track", True), ("lissajous", False)])
def test_tracks_with_a_known_vibration_are_warned_of(tmp_path: Path, scan: str, warned: bool) -> None:
    """Claim: a sentence says that σ of visits does not hold it; there is none for points, whose σ does."""
    (tmp_path / "calibration.yaml").write_text(GOOD + USE, encoding="utf-8")
    found = load_scenario(
        {
            "schema": 1,
            "processing": {"calibration": str(tmp_path / "calibration.yaml")},
            "scene": {
                "objects": [
                    {
                        "name": "disc",
                        "array": {"diameter": 0.1, "rows": 1, "columns": 1, "plate": 0.4},
                        "position": (0.0, 0.0, 5.0),
                    }
                ]
            },
            "scan": {"type": scan} | ({"targets": ["disc"]} if scan == "track" else {}),
        }
    )
    assert any("vibration" in words for words in scenario_warnings(found)) == warned


def test_the_believed_lengths_are_the_designs_with_their_deviations(tmp_path: Path) -> None:
    text = f"schema: 1\ninstrument: '{DIGEST}'\nparameters:\n  base: {{value: 1 mm}}\n"
    text += "  focal_length: {value: 0.1 mm}\n  array_offset: {value: 2 um}\n  array_scale: {value: 0.001}\n"
    (tmp_path / "calibration.yaml").write_text(text, encoding="utf-8")
    found = load_scenario(
        {
            "schema": 1,
            "processing": {"calibration": str(tmp_path / "calibration.yaml")},
            "scan": {"rows": 1, "columns": 1, "horizontal": (0, 0), "vertical": (0, 0)},
        }
    )
    geometry = believed_geometry(found)
    assert geometry.baseline == pytest.approx(0.201)
    assert geometry.scale == pytest.approx(0.1001)
    assert geometry.pitch == pytest.approx(50.05e-6)
    assert geometry.offset == pytest.approx(2e-6)


@pytest.mark.parametrize(
    ("change", "to", "place", "said"),
    [
        ("base:", "bas:", "parameters.bas", "base"),
        ("0.12 mm", "0.12 urad", "parameters.base.value", "cannot be converted to m"),
        ("0.12 mm", "0.12", "parameters.base.value", "has no unit"),
        ("5 um", "-5 um", "parameters.base.sigma", "0 m"),
        ("0.4", "1.4", "correlation.matrix[0][1]", "1"),
        ("- [0.4, 1.0]", "- [-0.4, 1.0]", "correlation.matrix", "not symmetric"),
        ("    - [0.4, 1.0]\n", "", "correlation.matrix", "Write 2 rows of 2 numbers"),
        ("of: [base, theta_zero]", "of: [base, theta_zer]", "correlation.of[1]", "theta_zero"),
        ("of: [base, theta_zero]", "of: [base, tof_zero]", "correlation.of[1]", "parameters.tof_zero.sigma"),
        ("of: [base, theta_zero]", "of: [base, base]", "correlation.of", "twice"),
        (DIGEST, "0123456789ab", "instrument", f"write 'instrument: {DIGEST}'"),
        (
            "tof_zero: {value: 4 mm}",
            "matrix: [[1.0]]",
            "parameters.matrix",
            "It belongs to correlation.matrix;",
        ),
        ("tof_zero: {value: 4 mm}", "phi_sine: {value: 4 urad}", "encoder_period", "30 mrad"),
    ],
)
def test_faults_have_their_place_and_remedy(
    tmp_path: Path, change: str, to: str, place: str, said: str
) -> None:
    assert change in GOOD
    with pytest.raises(ScenarioError) as caught:
        read(tmp_path, GOOD.replace(change, to))
    told = [f"{fault.problem} {fault.remedy}" for fault in caught.value.faults if place in fault.location]
    assert any(said in sentence for sentence in told), str(caught.value)


@pytest.mark.parametrize("share", [0.999, 1.0, 1.001])
@pytest.mark.parametrize("name", ["base", "focal_length", "array_scale"])
def test_a_departure_leaves_something_of_its_length(tmp_path: Path, name: str, share: float) -> None:
    """Claim: of base, image distance and pitch nearly all may be taken away; what takes all is refused."""
    design = design_of(SCANNER)
    whole = {"base": design.baseline, "focal_length": design.image_distance, "array_scale": 1.0}[name]
    value = f"{-share * whole!r}{'' if name == 'array_scale' else ' m'}"
    text = f"schema: 1\ninstrument: '{DIGEST}'\nparameters:\n  {name}: {{value: {value}}}\n"
    if share < 1.0:
        assert read(tmp_path, text).value(name) == -share * whole
        return
    with pytest.raises(ScenarioError, match="it takes away all of the design's") as error:
        read(tmp_path, text)
    assert [(fault.location, fault.line) for fault in error.value.faults] == [(f"parameters.{name}.value", 4)]


def test_a_covariance_that_is_none_is_refused(tmp_path: Path) -> None:
    """Three parameters that are all correlated by −0.9 cannot be."""
    text = GOOD.replace("tof_zero: {value: 4 mm}", "tof_zero: {value: 4 mm, sigma: 1 mm}")
    text = text.replace("theta_zero]", "theta_zero, tof_zero]").split("    - ")[0]
    text += "    - [1.0, -0.9, -0.9]\n    - [-0.9, 1.0, -0.9]\n    - [-0.9, -0.9, 1.0]\n"
    with pytest.raises(ScenarioError, match=r"not positive semi-definite: its least eigenvalue is -0\.8"):
        read(tmp_path, text)


def test_a_scenario_with_a_wrong_calibration_is_refused_when_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "calibration.yaml").write_text(GOOD, encoding="utf-8")
    scan = {"rows": 1, "columns": 1, "horizontal": (0, 0), "vertical": (0, 0)}
    own = {"schema": 1, "scan": scan, "processing": {"calibration": str(tmp_path / "calibration.yaml")}}
    assert load_scenario(own).processing.calibration == tmp_path / "calibration.yaml"
    with pytest.raises(ScenarioError, match="belongs to the instrument"):
        load_scenario({**own, "scanner": {"receiver": {"baseline": 0.3}}})
    with pytest.raises((InputError, ScenarioError), match="there is no file"):
        load_scenario({**own, "processing": {"calibration": str(tmp_path / "none.yaml")}})


@pytest.mark.parametrize("kind", [CalibratedRatio, CalibratedCubic])
@pytest.mark.parametrize("key", ["value", "sigma"])
def test_departures_of_more_than_ten_are_none(kind: type[CalibratedRatio], key: str) -> None:
    """Claim: a ratio or a third order of ten, of a design or per rad², is the most that is read."""
    values = {"value": 0.0, "sigma": 0.0}
    assert getattr(kind.model_validate(values | {key: 10.0}), key) == 10.0
    with pytest.raises(ValidationError):
        kind.model_validate(values | {key: 10.01})


def test_one_temperature_moves_all_lengths_together() -> None:
    """Claim: σ_T² l_i l_j (ā_i ā_j + δ_ij σ_i²): coefficients that are known alike make errors of one sign, what is
    unsure of each is its own. By hand, of 2 K, 0.6 m and 0.3 m."""
    design = replace(design_of(SCANNER), baseline=0.6, image_distance=0.3)
    use = TemperatureOfUse(
        sigma=2.0,
        base_expansion=KnownExpansion(value=1e-5, sigma=3e-6),
        focal_expansion=KnownExpansion(value=-2e-5, sigma=1e-6),
    )
    base, focal = INDEX["base"], INDEX["focal_length"]
    wanted = np.zeros((len(NAMES), len(NAMES)))
    # σ_T l ā are 12 µm and -12 µm, σ_T l σ 3.6 µm and 0.6 µm.
    wanted[base, base], wanted[focal, focal] = 12e-6**2 + 3.6e-6**2, 12e-6**2 + 0.6e-6**2
    wanted[base, focal] = wanted[focal, base] = -(12e-6**2)
    np.testing.assert_allclose(use.covariance(design), wanted, rtol=1e-12)
