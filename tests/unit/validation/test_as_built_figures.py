"""Figures 12, 13 and 15 with the instrument as built: tolerances, derivatives of poses, and the axis of residuals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from drawn import line
from matplotlib.figure import Figure

from scanner_sim.analytic.pose import facing_errors
from scanner_sim.config import load_scanner
from scanner_sim.config.calibration import design_of
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.validation.reproduce.as_built import ITEMS
from scanner_sim.validation.reproduce.built_instruments import (
    SQUARE,
    Method,
    built_text,
    closed_depth,
    estimator_of,
    pose_sigma,
    shared_errors,
    tolerances,
)
from scanner_sim.validation.reproduce.item import Verdict
from scanner_sim.validation.reproduce.residual_axis import ResidualAxis, per_pixel

SIGMA = (8e-6, 4e-6, 1e-3)
METHODS: tuple[Method, ...] = ("xyz", "uv", "joint")


def test_a_limit_is_a_rectangular_distribution() -> None:
    """Claim: σ is the limit over √3, and what is drawn has it."""
    given = tolerances().given
    assert math.isclose(given["base"], 0.2e-3 / math.sqrt(3.0))
    assert math.isclose(given["theta_scale"], 0.01 / math.sqrt(3.0))
    assert "base: {tolerance: " in built_text(tolerances())


@pytest.mark.parametrize("method", METHODS)
def test_derivatives_of_the_estimate_give_its_errors(method: Method) -> None:
    """Claim: own and shared errors go to a facing square as the closed form has it, to 2 % (D_g/R, (h/R)²)."""
    common = (3e-6, 5e-6, 2e-3)
    shared = np.broadcast_to(np.diag(common), (len(SQUARE), 3, 3))
    got = pose_sigma(estimator_of(SQUARE, 10.0, method, SIGMA), SIGMA, shared)
    np.testing.assert_allclose(got, facing_errors(SQUARE, 10.0, method, SIGMA, common), rtol=0.02)


@pytest.mark.parametrize("method", METHODS[:2])
@pytest.mark.parametrize("name", ["base", "array_offset", "theta_scale", "phi_scale"])
def test_each_parameter_goes_to_the_depth_as_by_the_judge(method: Method, name: str) -> None:
    """Claim: of one parameter alone the product's and the judge's errors of the depth agree to 2 % and a micrometre."""
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[INDEX[name], INDEX[name]] = tolerances().given[name] ** 2
    believed = Calibration(np.zeros(len(NAMES)), covariance, design_of(load_scanner("nrc_2000")))
    none = (0.0, 0.0, 0.0)
    got = pose_sigma(estimator_of(SQUARE, 10.0, method, SIGMA), none, shared_errors(believed, SQUARE, 10.0))[
        2
    ]
    expected = closed_depth(SQUARE, 10.0, method, SIGMA, covariance)
    assert math.isclose(got, expected, rel_tol=0.02, abs_tol=1e-6)


def test_where_ten_lies_and_where_it_does_not() -> None:
    """Claim: at 10 m the axis agrees with its closed forms, and only weights that know the residual gain ten."""
    assert math.isclose(per_pixel(10.0), 0.25)
    axis = ResidualAxis.at(10.0, 6e-6, 0.6e-3)
    # From 0.001 to 1 pixel, each R² p/(f d) of the range: σ of points over σ of both, to 2 % (D_g/R, (h/R)²).
    for row, pixel in enumerate(np.geomspace(1e-3, 1.0, 31)):
        sigma = (6e-6, 6e-6, math.hypot(0.6e-3, pixel * 10.0**2 * 50e-6 / (0.1 * 0.2)))
        points, both = (facing_errors(SQUARE, 10.0, method, sigma) for method in METHODS[::2])
        np.testing.assert_allclose(axis.aware[row, :5], (points / both)[:5], rtol=0.02)
        assert (axis.unaware[row, 2:5] <= 1.001 * axis.aware[row, 2:5]).all()
    rows = axis.rows()
    assert [row.verdict for row in rows] == [Verdict.UNPRINTED] * 7
    assert axis.aware[:, :2].max() > 10.0
    assert axis.unaware[:, :5].max() < 2.0
    # Drawn over the residual: depth, tilt and lateral place, where the weights know it, and dashed where they do not.
    axes = Figure().subplots()
    axis.draw(axes)
    for number, column in enumerate((2, 3, 0)):
        for shift, gains in ((0, axis.aware), (1, axis.unaware)):
            expected = np.stack([np.geomspace(1e-3, 1.0, 31), gains[:, column]], axis=1)
            np.testing.assert_allclose(line(axes, 2 * number + shift), expected)
    np.testing.assert_allclose(line(axes, 7)[:, 1], 10.0)


def test_items_stand_beside_the_figures_of_the_paper() -> None:
    assert [item.key for item in ITEMS] == ["fig12b", "fig15b"]


@pytest.mark.parametrize("words", ["depth", "tilt"])
def test_weights_of_noise_bound_the_gain(words: str) -> None:
    """Claim: one over the share that ranges have in the joint estimate by the weights of their noise, by sums."""
    axis = ResidualAxis.at(10.0, 5e-6, 0.7e-3)
    a, s, r, far = 1.0, axis.angle, axis.noise, axis.distance
    ranges, angles = {
        "depth": (4.0 / r**2, 2.0 * a**2 / (s**2 * far**4)),
        "tilt": (a**2 / r**2, a**4 / (4.0 * s**2 * far**4)),
    }[words]
    assert axis._bound(words) == pytest.approx((ranges + angles) / ranges, rel=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_readings_that_grow_alike_move_the_pose_that_way(method: Method) -> None:
    """Claim: all ranges a little longer put an array farther away by as much, all Θ larger to the right and all φ
    downwards by the distance times that, to 2 % (D_g/R, (h/R)²); directions alone know no ranges, and where both tell
    the depth the ranges have a share of it."""
    moved = estimator_of(SQUARE, 10.0, method, SIGMA).sum(axis=1)
    assert moved[0, 0] == pytest.approx(10.0, rel=0.02)
    assert moved[1, 1] == pytest.approx(10.0, rel=0.02)
    if method == "joint":
        assert 0.01 < moved[2, 2] < 0.99
    else:
        assert moved[2, 2] == pytest.approx(0.0 if method == "uv" else 1.0, rel=0.02)
