"""Correlations of a calibration's parameters: what is one, and what is believed by it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scanner_sim.config.calibration import CalibrationFile, Correlation, design_of
from scanner_sim.config.load import load_scanner
from scanner_sim.foundation.parameters import INDEX

GOOD = ((1.0, 0.5, -0.2), (0.5, 1.0, 0.3), (-0.2, 0.3, 1.0))
OF = ("base", "theta_zero", "phi_zero")


def faults(of: tuple[str, ...], matrix: tuple[tuple[float, ...], ...]) -> list[str]:
    """Return what is wrong with a matrix of correlations."""
    told = Correlation.model_construct(of=of, matrix=matrix)
    return [f"{fault.location}: {fault.problem} {fault.remedy}" for fault in told.cross_checks()]


@pytest.mark.parametrize(
    ("of", "matrix", "words"),
    [
        (OF, GOOD, ""),
        (OF, GOOD[:2], "2 rows of 3 numbers for 3 parameters. Write 3 rows of 3"),
        (OF, (GOOD[0], GOOD[1][:2], GOOD[2]), "3 rows of 2, 3 numbers"),
        (OF, (GOOD[0][:2], GOOD[1], GOOD[2]), "3 rows of 2, 3 numbers"),
        (OF, tuple(row[:2] for row in GOOD), "3 rows of 2 numbers"),
        (OF[:2], GOOD, "3 rows of 3 numbers for 2 parameters"),
        (OF, ((1.0, 0.5, -0.2), (0.5 + 2e-9, 1.0, 0.3), (-0.2, 0.3, 1.0)), "not symmetric"),
        (OF, ((1.0, 0.5, -0.2), (0.5 + 5e-10, 1.0, 0.3), (-0.2, 0.3, 1.0)), ""),
        (OF, ((1.0, 0.5, -0.2), (0.5, 1.0 - 2e-9, 0.3), (-0.2, 0.3, 1.0)), "with 1 on the diagonal"),
        (("base", "bais", "phi_zero"), GOOD, "of[1]: there is no parameter 'bais'. Did you mean 'base'?"),
        (("base", "theta_zero", "base"), GOOD, "names a parameter twice"),
        (OF[:2], ((1.0, 1.0), (1.0, 1.0)), ""),
        (OF, ((1.0, 0.9, -0.9), (0.9, 1.0, 0.9), (-0.9, 0.9, 1.0)), "least eigenvalue is -0.8,"),
    ],
)  # fmt: skip
def test_correlations_are_symmetric_and_give_no_negative_variance(
    of: tuple[str, ...], matrix: tuple[tuple[float, ...], ...], words: str
) -> None:
    """Claim: as many rows and numbers in each as parameters; equal to a billionth across the diagonal of ones; the
    matrix of ±0.9 with one sign turned has 1 − 2 · 0.9 as its least eigenvalue."""
    found = faults(of, matrix)
    assert bool(found) is bool(words)
    if words:
        assert any(words in one for one in found), found


def test_a_calibration_is_believed_with_its_covariances() -> None:
    """Claim: deviations and σ where they are written and nothing elsewhere; covariances are correlation times both
    σ."""
    file = CalibrationFile.model_validate({
        "schema": 1, "instrument": "0123456789ab", "power_noise": 0.02,
        "parameters": {
            "base": {"value": 2e-4, "sigma": 5e-5}, "theta_zero": {"value": -3e-4, "sigma": 2e-5},
            "phi_zero": {"value": 1e-4},
        },
        "correlation": {"of": ["theta_zero", "base"], "matrix": [[1.0, -0.4], [-0.4, 1.0]]},
    })  # fmt: skip
    design = design_of(load_scanner("nrc_2000"))
    believed = file.believed(design)
    values = {"base": 2e-4, "theta_zero": -3e-4, "phi_zero": 1e-4}
    expected = np.zeros(len(INDEX))
    for name, value in values.items():
        expected[INDEX[name]] = value
    np.testing.assert_allclose(believed.values, expected)
    covariance = np.zeros((len(INDEX), len(INDEX)))
    base, theta = INDEX["base"], INDEX["theta_zero"]
    covariance[base, base], covariance[theta, theta] = 25e-10, 4e-10
    covariance[base, theta] = covariance[theta, base] = -0.4 * 5e-5 * 2e-5
    np.testing.assert_allclose(believed.covariance, covariance, atol=1e-24)
    assert believed.design == design
    assert math.isclose(believed.encoder_period, math.tau)
    assert believed.power_noise == 0.02


@pytest.mark.parametrize(
    ("parameters", "correlation", "words"),
    [
        ({"base": {"value": 1e-4}}, ["base"], "base has no standard deviation"),
        ({"base": {"value": 1e-4, "sigma": 1e-5}}, ["theta_zero"], "theta_zero has no standard deviation"),
        ({"base": {"value": 1e-4, "sigma": 1e-5}}, ["base"], ""),
    ],
)
def test_only_what_is_uncertain_is_correlated(
    parameters: dict[str, object], correlation: list[str], words: str
) -> None:
    file = {"schema": 1, "instrument": "0123456789ab", "parameters": parameters}
    file["correlation"] = {"of": correlation, "matrix": [[1.0]]}
    if not words:
        CalibrationFile.model_validate(file)
        return
    with pytest.raises(ValueError, match=words):
        CalibrationFile.model_validate(file)
