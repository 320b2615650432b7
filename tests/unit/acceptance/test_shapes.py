"""Spheres and planes through points: held to exact points, to closed forms of their σ, to another search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from claims import mean_square, share
from numpy.typing import NDArray
from scipy import integrate, optimize, stats

from scanner_sim.acceptance.shapes import FEWEST, Cloud, Sight, fit_plane, fit_sphere
from scanner_sim.acceptance.verdicts import Verdict, decide
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.ranging.spot_light import spot_shift

Array = NDArray[np.float64]

CENTRE, DIAMETER = np.array([0.3, -0.2, 2.5]), 0.2


def cap(count: int, half_angle: float = 0.9) -> Array:
    """Unit vectors evenly over a cap that looks at the scanner, shape (count, 3)."""
    number = np.arange(count) + 0.5
    cosine = 1.0 - (1.0 - np.cos(half_angle)) * number / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number
    sine = np.sqrt(1.0 - cosine**2)
    local = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)
    axis = -CENTRE / np.linalg.norm(CENTRE)
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    return np.asarray(local @ np.stack([side, np.cross(axis, side), axis]))


def cloud(points: Array, sigma: float, shared: Array | None = None, common: Array | None = None) -> Cloud:
    none = np.zeros((len(points), 3, 0))
    return Cloud(
        points,
        np.tile(sigma**2 * np.eye(3), (len(points), 1, 1)),
        none if shared is None else shared,
        none if common is None else common,
        np.zeros(len(points)),
    )


def draws() -> np.random.Generator:
    return np.random.default_rng(5)


def test_exact_points_give_the_exact_sphere_and_plane() -> None:
    fit = fit_sphere(cloud(CENTRE + 0.5 * DIAMETER * cap(400), 1e-4), 0.0, draws())
    assert fit is not None
    assert fit.parameters == pytest.approx([*CENTRE, DIAMETER], abs=1e-10)
    assert fit.form < 1e-10
    across = np.random.default_rng(1).uniform(-0.2, 0.2, (200, 2))
    plane = fit_plane(cloud(np.column_stack([across, 2.0 + across @ [0.5, -0.3]]), 1e-4), 0.0, draws())
    assert plane is not None
    assert plane.form < 1e-12


def test_the_light_of_a_sphere_does_not_move_its_centre() -> None:
    """Claim: ranges that are off by what a matt sphere's light does to them give the exact sphere.

    Without it the centre is a fifth of a millimetre aside. Tolerance: 2 µm, the second order of the shift.
    """
    points, spot, base = CENTRE + 0.5 * DIAMETER * cap(400), 1e-3, 0.2
    r, theta, phi = angles_and_range(*points.T, 0.0)
    level = np.zeros_like(phi)
    across = np.stack([np.cos(theta), -np.sin(theta) * np.sin(phi), -np.sin(theta) * np.cos(phi)], axis=1)
    normal = np.stack([level, np.cos(phi), -np.sin(phi)], axis=1)
    axes = np.stack([across, normal, points / r[:, None]], axis=1)
    facing = np.einsum("nij,nj->in", axes, (points - CENTRE) / (0.5 * DIAMETER))
    slope = -facing[0] / facing[2], -facing[1] / facing[2]
    off = spot_shift(r, theta, base, slope, spot, 2.0 / DIAMETER)
    moved = cloud(points + off[:, None] * axes[:, 2], 1e-4)
    uneven = np.where(np.arange(400) % 3 == 0, 0.0, 1e-9)  # evenly lit points among them
    seen = replace(moved, sight=Sight(r, theta, axes, np.full(400, spot), base), uneven=uneven)
    blind, knowing = (fit_sphere(one, 0.0, draws()) for one in (moved, seen))
    assert blind is not None
    assert knowing is not None
    assert np.linalg.norm(blind.parameters[:3] - CENTRE) > 1.5e-4
    assert knowing.parameters == pytest.approx([*CENTRE, DIAMETER], abs=2e-6)
    # Of the light nothing is left in σ.
    assert knowing.covariance == pytest.approx(knowing.noise)
    assert (np.diag(knowing.covariance) < 0.97 * np.diag(blind.covariance)).all()


def test_a_sphere_is_that_of_a_search_without_slopes() -> None:
    """Claim: the centre is where distances from it vary least, which a simplex finds without any derivative."""
    points = CENTRE + 0.5 * DIAMETER * cap(300) + 1e-3 * np.random.default_rng(2).standard_normal((300, 3))
    fit = fit_sphere(cloud(points, 1e-3), 0.0, draws())
    assert fit is not None
    used = points[fit.used]
    found = optimize.minimize(
        lambda at: 1e6 * np.linalg.norm(used - at, axis=1).var(),
        CENTRE + 1e-3,
        method="Nelder-Mead",
        options={"xatol": 1e-10, "fatol": 1e-14, "maxiter": 4000, "maxfev": 4000},
    )
    assert fit.parameters[:3] == pytest.approx(found.x, abs=1e-8)
    assert 0.5 * fit.parameters[3] == pytest.approx(np.linalg.norm(used - found.x, axis=1).mean(), abs=1e-8)


def test_sigma_of_centre_diameter_and_form_are_those_of_the_errors() -> None:
    """Claim: errors of fits over their σ have a mean square of 1, with noise of each point and noise that is shared.

    Set-up: 200 clouds of 250 points, isotropic noise of 0.4 mm and two shared shifts. Tolerance: χ² at the usual level,
    which finds a variance off by 70 %.
    """
    rng, unit = np.random.default_rng(3), cap(250)
    shared = np.stack([np.tile([1e-4, 0.0, 0.0], (250, 1)), 2e-4 * unit * unit[:, :1]], axis=2)
    pulls, forms = [], []
    for _ in range(200):
        errors = 4e-4 * rng.standard_normal((250, 3)) + shared @ rng.standard_normal(2)
        fit = fit_sphere(cloud(CENTRE + 0.5 * DIAMETER * unit + errors, 4e-4, shared), 0.01, rng)
        assert fit is not None
        off = fit.parameters - [*CENTRE, DIAMETER]
        pulls.append(off / np.sqrt(np.diagonal(fit.covariance)))
        forms.append((fit.form - fit.expected_form) / fit.sigma_form)
    for component in np.transpose(pulls):
        claim = mean_square(component)
        assert claim
        assert claim.finds < 0.7
    assert mean_square(forms, slack=0.1)


def test_the_form_that_noise_makes_is_tippetts_range() -> None:
    """Claim: the expected form of a plate is the mean range of n normal numbers, ∫ 1 − Φⁿ − (1 − Φ)ⁿ (Tippett 1925).

    Points are tilted by what they share, which the fit takes up. Tolerance: three degrees of freedom of 400 go into the
    fit, 0.4 %, and 400 draws of a spread of a tenth.
    """
    side = np.linspace(-0.2, 0.2, 20)
    across = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    tilt = np.zeros((400, 3, 1))
    tilt[:, 2, 0] = 0.05 * across[:, 0]
    fit = fit_plane(cloud(np.column_stack([across, np.full(400, 2.0)]), 1e-3, tilt), 0.0, draws())
    assert fit is not None
    normal = stats.norm.cdf
    mean, _ = integrate.quad(lambda x: 1.0 - normal(x) ** 400 - (1.0 - normal(x)) ** 400, -9.0, 9.0)
    assert fit.expected_form == pytest.approx(1e-3 * mean, rel=0.03)


def test_common_errors_move_a_sphere_and_not_its_form() -> None:
    unit = cap(200)
    common = np.tile([[0.0], [0.0], [1e-3]], (200, 1, 1))
    fit = fit_sphere(cloud(CENTRE + 0.5 * DIAMETER * unit, 1e-4, common=common), 0.0, draws())
    assert fit is not None
    assert fit.common[:, 0] == pytest.approx([0.0, 0.0, 1e-3, 0.0], abs=1e-9)
    assert fit.expected_form < 1e-3


def test_what_is_left_out_is_the_allowed_share_and_no_more() -> None:
    points = CENTRE + 0.5 * DIAMETER * cap(400)
    points[[5, 50, 350]] += 5e-3 * cap(400)[[5, 50, 350]]
    forms = {}
    for allowed in (0.0, 0.005, 0.01):
        fit = fit_sphere(cloud(points, 1e-4), allowed, draws())
        assert fit is not None
        assert (~fit.used).sum() == int(allowed * 400)
        forms[allowed] = fit.form
    assert forms[0.0] > 4e-3
    assert forms[0.005] > 4e-3
    assert forms[0.01] < 1e-6


def test_what_is_left_out_does_not_tilt_a_plate() -> None:
    """Claim: a plane that is exact but for four odd points at one corner is flat and square to the beam without them:
    the plane is that of the points that stay."""
    side = np.linspace(-0.2, 0.2, 20)
    points = np.column_stack([np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2), np.full(400, 2.0)])
    points[[0, 1, 20, 21], 2] += 5e-3
    odd = np.isin(np.arange(400), [0, 1, 20, 21])
    for allowed, flat in ((0.0, False), (0.01, True)):
        fit = fit_plane(cloud(points, 1e-4), allowed, draws())
        assert fit is not None
        np.testing.assert_array_equal(fit.used, ~odd | (not flat))
        assert (fit.form < 1e-9) is flat
        assert (float(np.ptp(fit.deviations[~odd])) < 1e-9) is flat
        if flat:
            np.testing.assert_allclose(np.abs(fit.deviations[odd]), 5e-3, rtol=1e-9)


@pytest.mark.parametrize("discarded", [0.0, 0.1, 0.3])
def test_the_form_of_what_is_left_is_that_which_noise_makes_of_it(discarded: float) -> None:
    """Claim: mean and scatter of the form that a perfect plate should have, with a share of its points left out, are
    those of plates that are measured with the same errors. Tolerance: slopes of the errors, 1e-3 over 0.2, squared.
    """
    side = np.linspace(-0.2, 0.2, 6)
    across = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    errors = 1e-3 * np.random.default_rng(6).standard_normal((36, 400))
    forms = []
    for error in errors.T:
        fit = fit_plane(cloud(np.column_stack([across, 2.0 + error]), 1e-3), discarded, draws())
        assert fit is not None
        forms.append(fit.form)
    perfect = cloud(np.column_stack([across, np.full(36, 2.0)]), 1e-3)
    fit = fit_plane(perfect, discarded, np.random.default_rng(6))
    assert fit is not None
    assert fit.expected_form == pytest.approx(np.mean(forms), rel=1e-4)
    assert fit.sigma_form == pytest.approx(np.std(forms, ddof=1), rel=1e-3)


def test_chosen_points_keep_all_that_is_theirs() -> None:
    """Claim: every part of a cloud and of its sight is that of the same points."""
    number = np.arange(8.0)
    matrix, three = np.eye(3) * number[:, None, None], np.ones((3, 2)) * number[:, None, None]
    sight = Sight(number, 10.0 + number, matrix, 20.0 + number, 0.2)
    whole = Cloud(np.ones(3) * number[:, None], matrix, three, -three, 30.0 + number, sight)
    where = number % 3.0 == 1.0
    part = whole.chosen(where)
    assert part.sight is not None
    assert part.sight.baseline == 0.2
    for name in ("points", "covariance", "shared", "common", "uneven"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[[1, 4, 7]])
    for name in ("range", "theta", "axes", "spot"):
        np.testing.assert_array_equal(getattr(part.sight, name), getattr(sight, name)[[1, 4, 7]])


def test_steep_points_are_not_taken() -> None:
    unit = cap(600, 1.5)
    fit = fit_sphere(cloud(CENTRE + 0.5 * DIAMETER * unit, 1e-4), 0.0, draws())
    assert fit is not None
    steepness = np.rad2deg(np.arccos(unit @ (-CENTRE / np.linalg.norm(CENTRE))))
    assert steepness[fit.used].max() == pytest.approx(60.0, abs=1.0)
    assert fit_sphere(cloud(CENTRE + 0.5 * DIAMETER * cap(FEWEST - 1), 1e-4), 0.0, draws()) is None
    assert fit_plane(cloud(np.ones((FEWEST - 1, 3)), 1e-4), 0.0, draws()) is None


def test_verdicts_are_those_of_the_closed_form() -> None:
    """Claim: an error of N(0, σ²) passes a limit M with a guard of U in 2Φ((M − U)/σ) − 1 of all cases."""
    errors = np.random.default_rng(4).normal(0.0, 1.0, 20_000)
    verdicts = [decide(error, 2.0, 0.5, "guarded") for error in errors]
    passed, failed = (verdicts.count(one) for one in (Verdict.PASSES, Verdict.FAILS))
    assert share(passed, len(errors), float(2.0 * stats.norm.cdf(1.5) - 1.0))
    assert share(failed, len(errors), float(2.0 * stats.norm.sf(2.5)))
    simple = [decide(error, 2.0, 0.5, "simple") for error in errors]
    assert share(simple.count(Verdict.PASSES), len(errors), float(2.0 * stats.norm.cdf(2.0) - 1.0))
    assert Verdict.UNDECIDED not in simple
