"""Section 4 and Figure 15: the errors of the pose of a square array, by angles (UV), points (XYZ) and both."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry
from scanner_sim.analytic import pose as judge
from scanner_sim.pose.result import PoseEstimate
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import vector_from_rotation

Array = NDArray[np.float64]

SIGMA, SIDE, SEPARATION = 56.6e-6, 1.0, 0.05
SQUARE = 0.5 * SIDE * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
METHODS: dict[str, dict[str, Any]] = {
    "uv": {"method": "uv"},
    "xyz": {"method": "xyz", "point_weights": "equal"},
    "joint": {"method": "joint"},
}


def sigma_range(R: float) -> float:
    """Return the σ of triangulation [m]: R² Δp/(f d) with Δp 2 µm (speckle), f 0.1 m, d 0.2 m: 10 mm at 10 m."""
    return R**2 * 2e-6 / (0.1 * 0.2)


def facing(R: float) -> tuple[Array, Array, Array]:
    """Return exact (Θ, φ, R) of the square that faces the scanner at the range R."""
    r, theta, phi = geometry.shot_from_point(SQUARE + np.array([0.0, 0.0, R]), SEPARATION)
    return theta, phi, r


def closed_form(method: str, R: float, sigma: float, sigma_r: float) -> Array:
    """Return the judge's standard deviations in the order of the covariance."""
    errors = {
        "uv": lambda: judge.square_resection(sigma, R, SIDE),
        "xyz": lambda: judge.square_points(sigma, sigma_r, R, SIDE),
        "joint": lambda: judge.square_joint(sigma, sigma_r, R, SIDE),
    }[method]()
    return np.array([errors.lateral] * 2 + [errors.depth] + [errors.tilt] * 2 + [errors.roll])


def estimate(method: str, sigma: float, sigma_r: float, *measured: Array) -> PoseEstimate:
    return estimate_pose(
        SQUARE,
        *measured,
        sigma_theta=sigma,
        sigma_phi=sigma,
        sigma_range=sigma_r,
        axis_separation=SEPARATION,
        **METHODS[method],
    )


def test_four_millimetres_in_depth_at_ten_metres() -> None:
    """Claim: the paper's "4 mm at 10 m" is the depth error of resection with 56.6 µrad and a square of 1 m.

    Set-up: exact angles at 10 m. Expected: σ(t_z) = σR²/(√2 a) = 4.002 mm, from the judge and in the reported
    covariance. Tolerance: 1 %: the judge leaves (h/R)² = 0.25 % and D_g/R = 0.5 % out.
    """
    assert judge.square_resection(SIGMA, 10.0, SIDE).depth == pytest.approx(4.0e-3, rel=1e-3)
    assert estimate("uv", SIGMA, 1.0, *facing(10.0)).sigma[2] == pytest.approx(4.0e-3, rel=0.01)


@pytest.mark.parametrize("R", [8.0, 12.0, 20.0])
@pytest.mark.parametrize("method", METHODS)
def test_reported_covariance_is_the_closed_form(method: str, R: float) -> None:
    """Claim: the reported covariance of a facing square is the closed form, for every component and method.

    Set-up: exact measurements at 8, 12 and 20 m, σ 56.6 µrad, ranges with R² Δp/(f d). Expected: the judge's.
    Tolerance: 2 %: the judge's first order leaves out D_g/R (0.6 % at 8 m) and (h/R)² (0.4 %), twice each at most.
    """
    sigma_r = sigma_range(R)
    got = estimate(method, SIGMA, sigma_r, *facing(R)).sigma
    np.testing.assert_allclose(got, closed_form(method, R, SIGMA, sigma_r), rtol=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_scatter_is_the_closed_form(method: str) -> None:
    """Claim: the scatter of estimated poses is the closed form.

    Set-up: 40 000 noisy measurements at 10 m with a fifth of the errors, 11.3 µrad and 2 mm, so that the second order
    (the tilt's, whose σ is 11 mrad at full errors) is out of the way; the noise goes onto angles and ranges. Expected:
    the judge's standard deviations. Tolerance: 2 %: 0.8 % of first order (see above) and 3.4 standard errors of
    1/√(2 · 40 000) = 0.35 %; six components of three methods, once in 10⁴ seeds.
    """
    count, sigma, sigma_r = 40_000, 0.2 * SIGMA, 0.2 * sigma_range(10.0)
    rng = np.random.default_rng(21)
    theta, phi, r = (
        exact + scale * rng.standard_normal((count, 4))
        for exact, scale in zip(facing(10.0), (sigma, sigma, sigma_r), strict=True)
    )
    pose = estimate(method, sigma, sigma_r, theta, phi, r)
    # An implausible χ² has a probability of 1e-4: more than 16 of 40 000, where 4 are expected, comes once in 10⁵. Of
    # the 400 whose χ² makes other poses worth a look, a few have another one.
    assert np.isin(pose.status, (PoseStatus.VALID, PoseStatus.AMBIGUOUS, PoseStatus.IMPLAUSIBLE)).all()
    assert np.count_nonzero(pose.status == PoseStatus.IMPLAUSIBLE) <= 16
    assert np.count_nonzero(pose.status == PoseStatus.AMBIGUOUS) <= 40
    found = np.concatenate([pose.position, vector_from_rotation(pose.rotation)], axis=1)
    scatter = found[pose.status == PoseStatus.VALID].std(axis=0)
    np.testing.assert_allclose(scatter, closed_form(method, 10.0, sigma, sigma_r), rtol=0.02)


@pytest.mark.parametrize("off", [0.0, 1.0])
def test_where_the_covariance_bends_is_the_closed_form(off: float) -> None:
    """Claim: a facing square by angles is ambiguous from the range on where the second order of its tilt is as large.

    Set-up: exact angles; the object's origin in the middle, and a distance b = 1 m off it in the plane. Expected: over
    one standard deviation of the tilt, ω = 2σR²/a², χ² rises by 1 to first order. To second order a corner comes nearer
    to the middle by h ω²/2, h = a/2, and the middle goes with the origin by b ω²/2, both across the sight; so the
    residuals grow by 4 (ω²/2σR)² (h² + b²), which is 1 at R³ = a⁴/(4σ √(h² + b²)): 20.7 m and 15.8 m. Tolerance: 3 %,
    with which that rise, as R⁶, changes by 19 %; D_g/R is 0.3 % and the fourth order of ω 0.1 %.
    """
    limit = np.cbrt(SIDE**4 / (4.0 * SIGMA * np.hypot(0.5 * SIDE, off)))
    for share, status in ((0.97, PoseStatus.VALID), (1.03, PoseStatus.AMBIGUOUS)):
        theta, phi, _ = facing(share * limit)
        noise = {"sigma_theta": SIGMA, "sigma_phi": SIGMA, "axis_separation": SEPARATION}
        assert estimate_pose(SQUARE + np.array([0.0, off, 0.0]), theta, phi, **noise).status == status


def test_exponents_of_range() -> None:
    """Claim: UV errors grow as R (lateral, roll) and R² (depth, tilt); XYZ as R² where the range has its part.

    Set-up: the reported covariances at 5–40 m, slopes fitted in logarithms. Expected: 1, 1, 2, 2, 2, 1 for UV; for XYZ
    with triangulation's σ_R ∝ R² depth and tilt 2, roll 1, lateral 1, since its two terms both grow as R. The paper
    reads "R" and "R^1.5" from Figure 15: both are mixtures over components; nothing is tuned to them. Tolerance: 0.03,
    the neglected D_g/R and (h/R)² over the span.
    """
    ranges = np.geomspace(5.0, 40.0, 7)
    for method in ("uv", "xyz"):
        errors = np.stack([estimate(method, SIGMA, sigma_range(R), *facing(R)).sigma for R in ranges])
        slopes = np.polyfit(np.log(ranges), np.log(errors), 1)[0]
        np.testing.assert_allclose(slopes, [1.0, 1.0, 2.0, 2.0, 2.0, 1.0], atol=0.03)


@pytest.mark.parametrize("R", [3.0, 5.0, 10.0, 20.0])
@pytest.mark.parametrize("tilt", [0.0, 0.6])
def test_joint_is_never_worse(R: float, tilt: float) -> None:
    """Claim: angles and ranges together are at least as good as either, in every component.

    Set-up: reported covariances of a square that faces or is turned by 0.6 rad about y, at 3 to 20 m, σ_R from
    triangulation and from time of flight (15 mm). Expected: joint ≤ the better of UV and XYZ. Tolerance: rounding; the
    allowance of 2 % is not needed where the covariances are exact.
    """
    turned = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    r, theta, phi = geometry.shot_from_point(SQUARE @ turned.T + [0.3, -0.2, R], SEPARATION)
    for sigma_r in (sigma_range(R), 15e-3):
        uv, xyz, joint = (estimate(method, SIGMA, sigma_r, theta, phi, r).sigma for method in METHODS)
        assert (joint <= np.minimum(uv, xyz) * (1.0 + 1e-9)).all()


def test_where_ranges_give_the_depth_better() -> None:
    """Claim: ranges give the depth better than angles beyond R = √(σ_R a/(√2 σ)).

    Set-up: σ_R 15 mm (TOF). At that range both are equal, σR²/(√2 a) = σ_R/2. Expected: the
    ratio UV/XYZ of the reported depth errors is 1 there. Tolerance: 2 %, first order.
    """
    R = judge.crossing_range(SIGMA, 15e-3, SIDE)
    uv, xyz = (estimate(method, SIGMA, 15e-3, *facing(R)).sigma[2] for method in ("uv", "xyz"))
    assert uv / xyz == pytest.approx(1.0, rel=0.02)
