"""Errors of encoders and lenses: their slopes are those of their own laws, and each term is what its name says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scanner_sim.optics.encoder_errors import pointing_by_errors, pointing_error, pointing_slope
from scanner_sim.optics.lens_errors import LensErrors

ERRORS = np.array([3e-4, -2e-3, 0.05, 4e-4, -7e-4])
PERIOD = 0.03
READINGS = np.array([-0.31, -0.02, 0.0, 0.013, 0.27])


def test_an_encoder_errs_by_zero_scale_third_order_and_its_lines() -> None:
    """Claim: each of the five alone, by hand, where half a radian and a quarter of a period make round numbers."""
    for part, at, wanted in (
        (0, 0.5, 1.0),
        (1, -0.5, -0.5),
        (2, -0.5, -0.125),
        (3, PERIOD / 4.0, 1.0),
        (3, PERIOD / 12.0, 0.5),
        (4, PERIOD / 2.0, -1.0),
        (4, PERIOD / 6.0, 0.5),
    ):
        alone = np.eye(5)[part]
        assert float(pointing_error(at, alone, PERIOD)) == pytest.approx(wanted, abs=1e-12)


def test_slopes_of_an_encoders_errors_are_differences_of_them() -> None:
    """Claim: central differences by the reading; by the errors, in which the law is linear, its value at each alone."""
    step = 1e-7
    ahead, behind = (pointing_error(READINGS + way, ERRORS, PERIOD) for way in (step, -step))
    np.testing.assert_allclose(
        pointing_slope(READINGS, ERRORS, PERIOD), (ahead - behind) / (2.0 * step), rtol=1e-6
    )
    alone = np.stack([pointing_error(READINGS, one, PERIOD) for one in np.eye(5)], axis=-1)
    np.testing.assert_allclose(pointing_by_errors(READINGS, PERIOD), alone, atol=1e-14)


def test_a_lens_stretches_by_the_slope_of_its_distortion_and_blurs_by_the_square_of_the_field() -> None:
    """Claim: ∂p'/∂p by central differences, off the line too; at half the field a quarter of the blur."""
    lens = LensErrors(radial_1=-0.4, radial_2=1.7, across=0.03, along=-0.05, blur=8e-6, end=12e-3)
    step, f = 1e-7, 0.1
    for p, q in ((11e-3, 0.0), (11e-3, 4e-3), (-6e-3, 2e-3), (2e-3, -5e-3)):
        _, _, slope = lens.image(p, q, f)
        ahead, behind = (lens.image(p + way, q, f)[0] for way in (step, -step))
        assert slope == pytest.approx((ahead - behind) / (2.0 * step), rel=1e-7)
    assert math.sqrt(lens.variance(12e-3)) == pytest.approx(8e-6)
    assert math.sqrt(lens.variance(6e-3)) == pytest.approx(2e-6)
