"""The judge's own formulas by hand: small lines, limits, and plain integrals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from claims import mean
from scipy.optimize import least_squares
from scipy.stats import norm

from scanner_sim.analytic import beam, dots, estimators, noise, retroreflector, speckle, time_of_flight
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.errors import InputError


def line(*values: float) -> list[float]:
    """Return 24 pixels with these from the eighth on."""
    return [0.0] * 8 + list(values) + [0.0] * (16 - len(values))


def test_centre_of_mass_takes_three_pixels_to_each_side() -> None:
    """Claim: of 4 1 0 0 5 0 0 3 4 the pixels 1 to 3 count, 9 at the left and 15 at the right end: (9 + 60 + 45)/9."""
    assert estimators.centre_of_mass(line(4.0, 1.0, 0.0, 0.0, 5.0, 0.0, 0.0, 3.0, 4.0)) == pytest.approx(
        (9.0 * 1.0 + 12.0 * 5.0 + 15.0 * 3.0) / 9.0
    )


def test_a_parabola_has_its_vertex() -> None:
    found = estimators.parabola(line(*(10.0 - (k - 2.3) ** 2 for k in range(5))))
    assert found == pytest.approx(8 + 2.3)


def test_filters_cross_zero_between_pixels() -> None:
    """Claim: of 0 2 4 3 0 1, with the peak p: g₁ is −1 and 4, g₂ −1 and 5, g₄ −2 and 5 at p and p + 1."""
    held = line(0.0, 2.0, 4.0, 3.0, 0.0, 1.0)
    assert estimators.ESTIMATORS["blais_rioux_2"](held) == pytest.approx(10 + 1 / 5)
    assert estimators.ESTIMATORS["blais_rioux_4"](held) == pytest.approx(10 + 1 / 6)
    assert estimators.ESTIMATORS["blais_rioux_8"](held) == pytest.approx(10 + 2 / 7)


def test_a_narrow_spot_of_the_known_width_is_where_it_is() -> None:
    """Claim: with ln s² known to 0.001 a spot of 0.5 pixels is found to 2e-4; of a wrong width it would not be."""
    held = (1e5 * pixel_shares(11.3, 0.5, 24)).tolist()
    assert estimators.maximum_likelihood(held, 0.5, 1.0, 1e-3) == pytest.approx(11.3, abs=2e-4)
    assert abs(estimators.maximum_likelihood(held, 0.8, 1.0, 1e-3) - 11.3) > 1e-3


def test_the_bound_has_the_limits_of_shots_and_of_white_noise() -> None:
    """Claim: s/√N, and √(4√π s³ (σ² + b))/N: of a wide spot, within 2 %."""
    assert noise.cramer_rao(0.1, 3.0, 1e4, 0.0, 0.0) == pytest.approx(0.03, rel=0.02)
    white = math.sqrt(4.0 * math.sqrt(math.pi) * 27.0) / 1e4
    assert noise.cramer_rao(0.1, 3.0, 1e4, 0.0, 3e4) == pytest.approx(3e4 * white, rel=0.02)
    assert noise.cramer_rao(0.1, 3.0, 1e4, 9e8, 0.0) == pytest.approx(3e4 * white, rel=0.02)
    both = math.sqrt((9.0 + 1 / 12) / 1e4 + 4.0 * math.sqrt(math.pi) * (9.0 + 1 / 12) ** 1.5 * 125.0 / 1e8)
    assert noise.cramer_rao_closed(3.0, 1e4, 25.0, 10.0) == pytest.approx(both)


@pytest.mark.parametrize("place", [-0.5, -0.2, 0.0, 0.35])
def test_what_is_known_of_the_width_bounds_a_fit(place: float) -> None:
    """Claim: of a spot of 0.5 px the fit's σ is not below Winick's bound where the width is known, and that of three
    unknown quantities where nothing is; in the middle of a pixel and between two the width costs nothing."""
    read, many = 100.0, 1e5
    line = 20.0 + place
    m = many * pixel_shares(line, 0.5, 41)

    def sigma(spread: float) -> float:
        slopes = noise.fit_gradient(line, 0.5, many, m + read**2, spread)
        return float(np.sqrt(slopes**2 @ (m + read**2)))

    def shifted(place: float, square: float) -> np.ndarray:
        return many * pixel_shares(place, math.sqrt(square), 41)

    known = noise.cramer_rao(place, 0.5, many, 0.0, read)
    step = 1e-5
    by_place = (shifted(line + step, 0.25) - shifted(line - step, 0.25)) / (2.0 * step)
    by_width = (shifted(line, 0.25 + step) - shifted(line, 0.25 - step)) / (2.0 * step)
    slopes = np.stack([by_place, m / many, by_width]) / np.sqrt(m + read**2)
    unknown = 1.0 / math.sqrt(1.0 / np.linalg.inv(slopes @ slopes.T)[0, 0])
    assert sigma(1e-6) >= known * (1.0 - 1e-6)
    assert sigma(1e3) == pytest.approx(unknown, rel=1e-4)
    assert sigma(1e-6) <= sigma(0.1) <= sigma(1e3) * (1.0 + 1e-9)
    if place in (-0.5, 0.0):
        assert sigma(1e3) == pytest.approx(known, rel=1e-4)


def test_what_is_granted_to_a_width_is_a_quarter_of_its_limits() -> None:
    assert noise.width_spread((0.7, 1.5), 0.0) == 0.005
    assert noise.width_spread((0.7, 1.5), 0.5) == pytest.approx(math.hypot(0.22, 0.005))


def test_errors_add_by_their_slopes() -> None:
    found = noise.first_order(lambda pixels: 2.0 * pixels[0] - 3.0 * pixels[1], [5.0, 4.0], [1.0, 4.0])
    assert found == pytest.approx(math.sqrt(4.0 + 36.0))


def test_alarms_and_steps() -> None:
    assert noise.false_alarms(3.0, 200) == pytest.approx(1.0 - norm.cdf(3.0) ** 200)
    assert noise.quantisation_sd(2.0) == pytest.approx(1.0 / math.sqrt(3.0))


def test_a_beam_spreads_by_its_distance_from_the_waist() -> None:
    """Claim: d ln w/dz of w₀√(1 + (z − z₀)²/z_R²), by differences."""
    rayleigh = math.pi * 1e-6 / 1.5e-6

    def width(z: float) -> float:
        return math.sqrt(1.0 + ((z - 0.5) / rayleigh) ** 2)

    for z in (0.3, 2.0, 10.0):
        expected = (math.log(width(z + 1e-4)) - math.log(width(z - 1e-4))) / 2e-4
        assert float(beam.spread_rate(z, 1e-3, 0.5, 1.5e-6)) == pytest.approx(expected, rel=1e-6)


def test_published_limits_of_speckle_in_numbers() -> None:
    """Claim: 0.225, 0.399 and 0.318 of C λN, and 9.5 mm at 10 m for C = 1, 1.5 µm, 25 mm and 0.2 m."""
    for limit, share in (
        (speckle.centroid_limit, 0.22508),
        (speckle.halving_limit, 0.39894),
        (speckle.published_limit, 0.31831),
    ):
        assert limit(0.5, 1.5e-6, 4.0) == pytest.approx(0.5 * 6e-6 * share, rel=1e-4)
    assert speckle.published_range_limit(1.0, 1.5e-6, 10.0, 0.025, 0.2) == pytest.approx(9.55e-3, rel=1e-3)


@pytest.mark.parametrize("x", [1e-4, 0.009, 0.011, 0.1, 0.5, 2.0, 6.0])
def test_packets_of_a_round_pupil_are_the_plain_integral(x: float) -> None:
    """Claim: ∬ exp(−(π x Δu)²) g g' over two points of the unit disc, g = 1 and 2u, by Gauss's quadrature of both radii
    and the mean over the angle between them."""
    node, weight = np.polynomial.legendre.leggauss(80)
    r, area = 0.5 * (node + 1.0), weight * 0.5 * (node + 1.0)
    angle = np.linspace(0.0, 2.0 * math.pi, 160, endpoint=False)[:, None, None]
    square = r[:, None] ** 2 + r**2 - 2.0 * r[:, None] * r * np.cos(angle)
    pairs = np.exp(-((math.pi * x) ** 2) * square)
    # The mean of u u' over the common turn of both points is half of their scalar product.
    energy = area @ pairs.mean(axis=0) @ area
    slope = area @ (pairs * 2.0 * r[:, None] * r * np.cos(angle)).mean(axis=0) @ area
    assert speckle.pupil_averages(x) == pytest.approx((energy, slope), rel=1e-6)


def test_a_sheets_lobe_is_half_as_bright_at_its_half_width() -> None:
    sheet = retroreflector.Sheet(0.8, 0.5, 0.01)
    bright, half = retroreflector.lobe_intensity(sheet, [0.0, 0.01])
    assert half == pytest.approx(0.5 * bright, rel=1e-4)
    assert retroreflector.lobe_within(sheet, 2.0 * math.atan(sheet.alpha)) == pytest.approx(0.5)


def test_cubes_return_what_two_discs_have_in_common() -> None:
    """Claim: of discs whose centres are a radius apart 39.1 % overlap, and none of those that are two apart."""
    cubes = retroreflector.Sheet(0.8, 0.5, 0.01, refractive_index=1.5)
    for apart, share in ((0.5, 2.0 / 3.0 - math.sqrt(3.0) / (2.0 * math.pi)), (1.0, 0.0)):
        beta = math.asin(1.5 * math.sin(math.atan(apart / math.sqrt(2.0)))) if apart < 1.0 else 1.2
        found = float(retroreflector.entrance_share(cubes, beta))
        assert found == pytest.approx(share, abs=1e-12)
    angles = (np.arange(20000) + 0.5) * (math.pi / 2.0 / 20000)
    mean = float((retroreflector.entrance_share(cubes, angles) * np.sin(2.0 * angles)).mean() * math.pi / 2.0)
    assert retroreflector.mean_entrance(cubes) == pytest.approx(mean, rel=1e-4)


def test_a_sheet_returns_what_it_reflects() -> None:
    """Claim: lobe and diffuse rest of a narrow lobe add up to ρ over the half space, to 1 %."""
    sheet = retroreflector.Sheet(0.8, 0.5, 0.01, half_angle=0.6)
    edges = np.concatenate([np.linspace(0.0, 0.2, 40001), np.linspace(0.2, math.pi / 2.0, 20001)[1:]])
    delta, width = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    total = (retroreflector.intensity(sheet, delta) * 2.0 * math.pi * np.sin(delta) * width).sum()
    assert total == pytest.approx(0.8, rel=0.01)


def test_pulses_walk_and_widen() -> None:
    sigma = 2e-9 / 2.3548200450309493
    walk = 0.5 * SPEED_OF_LIGHT * sigma * (math.sqrt(2.0 * math.log(8.0)) - math.sqrt(2.0 * math.log(2.0)))
    assert time_of_flight.leading_edge_walk(2e-9, 8.0) == pytest.approx(walk)
    # Without pulse and electronics: light passes the footprint's depth, 10 mm of tan 45°, twice.
    assert time_of_flight.tilted_plane_sigma(0.0, 0.0, 0.01, math.pi / 4.0) == pytest.approx(
        0.02 / SPEED_OF_LIGHT
    )
    bound = math.sqrt(2.0 * 1e-9 * 1e-10 / math.sqrt(math.pi)) / 20.0
    assert time_of_flight.white_noise_bound(1e-9, 1e-10, 20.0) == pytest.approx(bound)
    # All white, the bound of coloured noise is the same.
    assert time_of_flight.coloured_noise_bound(1e-9, 1e-13, 1e-10, 20.0, 1.0) == pytest.approx(
        bound, rel=1e-3
    )


def test_a_large_sphere_is_a_little_farther_than_its_nearest_point() -> None:
    """Claim: of a narrow beam the mean depth is s²/r, and the way back is longer by s²/R at half weight: 2 %."""
    found = time_of_flight.sphere_range(10.0, 2.0, 0.02) - 10.0
    assert found == pytest.approx(4e-4 / 2.0 + 0.25 * 2.0 * 4e-4 / 10.0, rel=0.02)


def test_receivers_numbers() -> None:
    """Claim: McIntyre's F of 100 and 0.2 is 21.592, and the band of a Gaussian is √(π/ln 2)/2 of its −3 dB."""
    assert time_of_flight.excess_noise(100.0, 0.2) == pytest.approx(21.592)
    assert time_of_flight.noise_bandwidth(1e9) == pytest.approx(0.5e9 * math.sqrt(math.pi / math.log(2.0)))
    assert float(beam.rayleigh_length(1e-3, 1.5e-6, 2.0)) == pytest.approx(math.pi * 1e-6 / 3e-6)


def test_a_lens_beside_the_laser_sees_the_sheet_aslant() -> None:
    """Claim: I(δ) A cos δ T P/(R² + d²), tan δ = d/R."""
    sheet = retroreflector.Sheet(0.8, 0.5, 0.2)
    delta = math.atan(1.0)
    expected = float(retroreflector.intensity(sheet, delta)) * math.pi * 0.01**2 * math.cos(delta) * 0.7 * 3.0
    found = retroreflector.offset_power(2.0, 3.0, sheet, 2.0, 0.02, 0.7)
    assert float(found) == pytest.approx(expected / 8.0, rel=1e-6)


def test_light_over_two_planes_goes_by_their_corner() -> None:
    """Claim: from a plane at 5 m by a wall at x = 1 m no way is shorter than 5 m and that of the mirrored lens, √29 m;
    the share is ∫ ρ²/π² cosθ₁ cosθ₂/r² cosθ₃ cosθ₄/b² dA over the wall, to 1e-4 by 200 × 200 sums of Gauss and 5 σ."""
    rays, field = 40_000, 0.6
    way, share = time_of_flight.corner_echoes([0, 0, 1, 5.0], [1, 0, 0, 1.0], 0.5, field, rays, 3)
    seen = share > 0.0
    assert 5.0 + math.sqrt(29.0) - 1e-9 <= way[seen].min() < 5.0 + math.sqrt(29.0) + 0.01
    node, weight = np.polynomial.legendre.leggauss(200)
    low = 1.0 / math.tan(field)
    z, dz = low + 0.5 * (node[:, None] + 1.0) * (5.0 - low), 0.5 * (5.0 - low) * weight[:, None]
    edge = np.sqrt((math.tan(field) * z) ** 2 - 1.0)
    y, dy = edge * node, edge * weight
    r, b = np.sqrt(1.0 + y**2 + (z - 5.0) ** 2), np.sqrt(1.0 + y**2 + z**2)
    wanted = np.sum(0.25 / math.pi**2 * (5.0 - z) / r / r / r**2 * (1.0 / b) * (z / b) / b**2 * dy * dz)
    assert mean(rays * share, float(wanted), slack=1e-4 * float(wanted))


@pytest.mark.parametrize("spread", [0.01, 0.05, 0.5])
def test_a_fit_that_knows_its_width_roughly_moves_as_the_form_says(spread: float) -> None:
    """Claim: the form's derivatives are those of the fit itself, found by least squares, to 1e-3 of the largest.

    Set-up: a spot of 0.45 pixel, 0.2 pixel off a pixel's middle, so that place, charge and width are not even about it.
    """
    centre, sigma, charge, pixels = 8.2, 0.45, 3000.0, 17
    edges = np.arange(pixels + 1) - 0.5

    def spot(values: np.ndarray) -> np.ndarray:
        return charge * np.exp(values[0]) * np.diff(norm.cdf((edges - values[1]) / np.exp(0.5 * values[2])))

    true = np.array([0.0, centre, 2.0 * np.log(sigma)])
    seen = spot(true)
    variance = seen + 400.0

    def place(charges: np.ndarray) -> float:
        def pulls(values: np.ndarray) -> np.ndarray:
            return np.append((spot(values) - charges) / np.sqrt(variance), (values[2] - true[2]) / spread)

        return float(least_squares(pulls, true, xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale="jac").x[1])

    step = 2.0
    found = np.array([(place(seen + step * one) - place(seen - step * one)) for one in np.eye(pixels)])
    stated = noise.fit_gradient(centre, sigma, charge, variance, spread)
    np.testing.assert_allclose(found / (2.0 * step), stated, atol=1e-3 * np.abs(stated).max())


def test_a_lens_around_the_laser_collects_the_intensity_on_the_way_back() -> None:
    """Claim: of a sheet of cubes with a wide lobe far off a small lens takes I(0) over its solid angle, π/4 D²/R²,
    whatever share of the entrance the cubes show to light from all sides; to the square of the cone's angle."""
    sheet = retroreflector.Sheet(0.8, 0.6, 0.8, refractive_index=1.5)
    ranges, aperture = np.array([20.0, 55.0]), 0.04
    found = retroreflector.coaxial_power(ranges, 3.0, sheet, aperture, 0.7)
    wanted = 3.0 * 0.7 * retroreflector.intensity(sheet, 0.0) * math.pi / 4.0 * aperture**2 / ranges**2
    np.testing.assert_allclose(found, wanted, rtol=1e-3)


def test_the_bound_of_a_dot_knows_no_axis() -> None:
    """Claim: a dot and its light with u and v exchanged have the bound exchanged."""
    one = dots.DotScene(0.2, -0.4, 4.1, 3.0, 0.3, 0.7, 5000.0, 90.0, -40.0, 0.9, 20.0)
    other = dots.DotScene(-0.4, 0.2, 4.1, 3.0, math.pi / 2.0 - 0.3, 0.7, 5000.0, -40.0, 90.0, 0.9, 20.0)
    np.testing.assert_allclose(dots.centre_bound(other, 7), dots.centre_bound(one, 7)[::-1, ::-1], rtol=1e-4)


def test_a_lens_around_the_laser_gathers_the_cone_that_it_spans() -> None:
    """Claim: of a sheet that keeps its share to wide angles, P T times the intensity over the lens's solid angle, by a
    sum; near by, most is of the lobe and a fifth of what is diffuse. Its share is 1 % less at the lens's rim, which
    counts by less than 0.3 %."""
    sheet = retroreflector.Sheet(0.8, 0.3, 2e-3, half_angle=1.2)
    ranges, aperture = np.array([0.5, 1.0, 4.0]), 0.3
    found = retroreflector.coaxial_power(ranges, 5e-3, sheet, aperture, 0.7)
    for R, power in zip(ranges, found, strict=True):
        rim = np.geomspace(1e-6, math.atan(0.5 * aperture / R), 20_001)
        around = retroreflector.intensity(sheet, rim) * 2.0 * np.pi * np.sin(rim)
        assert power == pytest.approx(5e-3 * 0.7 * np.trapezoid(around, rim), rel=3e-3)


@pytest.mark.parametrize(
    ("half", "values"),
    [
        # Of 3 3 3 4 0: g₂ is 2 before the peak, 6 at it: above zero on both sides. Mirrored below zero on both sides.
        (2, (3.0, 3.0, 3.0, 4.0, 0.0)),
        (2, (0.0, 4.0, 3.0, 3.0, 3.0)),
        # Of 2 4 2 4 2 with g₁: nought at both of two neighbours, which tells of no place between them.
        (1, (2.0, 4.0, 2.0, 4.0, 2.0)),
    ],
)
def test_a_line_without_a_rising_zero_crossing_is_refused(half: int, values: tuple[float, ...]) -> None:
    """Claim: where g does not change its sign beside the largest pixel there is no peak, and none is made up."""
    with pytest.raises(InputError, match="no rising zero crossing"):
        estimators.blais_rioux(line(*values), half)


def test_a_zero_of_a_filter_at_a_pixel_is_there() -> None:
    """Claim: of lines that are even about a pixel g is 0 there, and the peak is that pixel, for every filter."""
    for name in ("blais_rioux_2", "blais_rioux_4", "blais_rioux_8"):
        assert estimators.ESTIMATORS[name](line(1.0, 3.0, 7.0, 3.0, 1.0)) == 10.0
