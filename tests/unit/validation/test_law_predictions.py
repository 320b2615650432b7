"""What the laws of ``compare`` predict of the preset's instrument, by the plain forms of the literature."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from scanner_sim import Scenario, load_scenario
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.analytic.time_of_flight import coloured_noise_bound
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.scan.lissajous import figure_angles, figures
from scanner_sim.validation.compare import (
    light,
    noise,
    point_errors,
    pulses,
    shape,
    speckle,
    targets,
    time_walk,
)
from scanner_sim.validation.compare.closed_forms import LINE, ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget
from scanner_sim.validation.compare.law import Measured, Predicted, slope_of, spread_of

Array = NDArray[np.float64]

GREY, MIDDLE = 0.4, 9.0
RANGES = (3.0, MIDDLE, 20.0)
SCAN = {"type": "raster", "rows": 4, "columns": 4, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}


def scenario(**changes: Any) -> Scenario:
    return load_scenario({"schema": 1, "seed": 7, "scan": SCAN} | changes)


def setting(**changes: Any) -> ComparisonSetup:
    return ComparisonSetup(scenario(**changes), FlatTarget(GREY, RANGES))


def metres_per_pixel(told: ComparisonSetup, distance: float) -> float:
    """Return eq 4: R² pitch/(f d)."""
    scanner = told.scenario.scanner
    return (
        distance**2
        * scanner.position_sensor.pitch
        / (scanner.receiver.focal_length * scanner.receiver.baseline)
    )


def places(told: ComparisonSetup, distance: float) -> list[tuple[float, Any]]:
    """Return ranges about one whose spots lie at ±1/8 and ±3/8 of a pixel, and the spots."""
    forms = ClosedForms(told.scenario)
    whole, near = round(forms.facing(distance, 1.0).centre), 2.0 * metres_per_pixel(told, distance)
    found = []
    for phase in (-0.375, -0.125, 0.125, 0.375):
        at = brentq(
            lambda R, wanted=whole + phase: forms.facing(R, 1.0).centre - wanted,
            distance - near,
            distance + near,
            xtol=1e-12,
        )
        found.append((at, forms.facing(at, GREY)))
    return found


@pytest.mark.parametrize("law", ["shot", "read", "bound"])
def test_sigma_of_the_range_is_that_of_the_place_times_eq_4(law: str) -> None:
    """Claim: root mean square over four places in a pixel of R² pitch/(f d) σ_p, in mm; the second order is eight times
    (σ_p/width)² of it. The exponent is a straight line's through the logarithms."""
    told, chosen = setting(), {"shot": noise.SHOT, "read": noise.READ, "bound": noise.BOUND}[law]
    sensor = told.scenario.scanner.position_sensor
    dark = sensor.dark_current / told.scenario.scanner.rate
    found = chosen.predict(told)
    values = []
    for distance in RANGES:
        squares, seconds = [], []
        for where, seen in places(told, distance):
            read = np.full(LINE, sensor.read_noise**2)
            variance = {"shot": seen.line, "read": read, "bound": seen.line + read + dark}[law]
            sigma = told.closed.sigma_pixel(seen, "maximum_likelihood", variance)
            squares.append((metres_per_pixel(told, where) * sigma) ** 2)
            seconds.append(8.0 * (sigma / seen.sigma) ** 2)
        values.append(1e3 * math.sqrt(np.mean(squares)))
        one = found[f"{distance:.4g} m"]
        assert one.value == pytest.approx(values[-1], rel=1e-5)
        assert one.accuracy == pytest.approx(max(seconds) * values[-1], rel=1e-4)
    if law != "bound":
        line = np.polyfit(np.log(RANGES), np.log(values), 1)
        assert found[noise.SLOPE].value == pytest.approx(line[0], rel=1e-5)


def test_errors_are_of_the_first_order_up_to_a_twentieth_of_the_spot() -> None:
    """Claim: the worst place in the pixel decides; an estimator whose σ is in proportion to the noise. A forms' own
    estimator may be off by a hundredth more."""
    told = setting()
    worst = max(
        told.closed.sigma_pixel(seen, "gaussian", np.ones(LINE)) / seen.sigma
        for _, seen in places(told, MIDDLE)
    )
    for ratio, usable in ((0.0495, True), (0.0505, False)):
        variance = np.full(LINE, (ratio / worst) ** 2)
        kept = noise._usable(told, lambda *_, given=variance: given, "gaussian")
        assert (MIDDLE in kept) is usable
        # Nearer spots have more light, farther ones less.
        assert 3.0 in kept
        assert 20.0 not in kept


def test_exponents_and_scatters_have_their_errors() -> None:
    """Claim: R³ has the exponent 3, bent by relative accuracies of one sign at each end; ln s has the variance 1/2ν; a
    scatter of normal errors is known to 1/√(2ν)."""
    x = np.array([1.0, 2.0, 4.0])
    cases = {f"{R:.4g} m": Predicted("σ", "mm", 5.0 * R**3, 0.05 * R**3) for R in x}
    slope = noise.slope_expected(tuple(x), cases, True, "3")[noise.SLOPE]
    assert slope.value == pytest.approx(3.0)
    # Ends at ±ln 2 about the middle: (ln 2 · 0.01 + ln 2 · 0.01)/(2 ln² 2).
    assert slope.accuracy == pytest.approx(0.01 / math.log(2.0))
    assert noise.slope_expected(tuple(x[:2]), cases, True, "3") == {}
    assert noise.slope_expected(tuple(x), cases, False, "3") == {}
    found = slope_of(x, [Measured("spread", 5.0 * R**3, 0.0, 50.0) for R in x])
    assert found.value == pytest.approx(3.0)
    assert found.error == pytest.approx(math.sqrt(2.0 * 0.01) * math.log(2.0) / (2.0 * math.log(2.0) ** 2))
    errors = np.random.default_rng(1).standard_normal((4, 4000)) + np.arange(4.0)[:, None]
    scatter = spread_of(errors)
    assert scatter.value == pytest.approx(math.sqrt(np.mean(errors.var(axis=1, ddof=1))))
    assert scatter.error == pytest.approx(scatter.value / math.sqrt(2.0 * 4 * 3999), rel=0.05)


def test_a_spot_is_where_eqs_1_and_3_put_it_on_a_wall() -> None:
    """Claim: p = f d cosΘ/(R − d sinΘ) at the range of the wall, which the beam of eq 3 meets at
    (z − D (1 − cosφ))/(cosΘ cosφ), for the axis and four corners of 0.8 of the field at three ranges; the image of the
    slanting spot lies off it by less than a pixel, and the lens's extent counts by D²/16R²."""
    told = setting()
    receiver, sensor = told.scenario.scanner.receiver, told.scenario.scanner.position_sensor
    mirrors = told.scenario.scanner.mirrors
    far = 0.8 * mirrors.max_deflection
    corners = [(0.0, 0.0), (-far, 0.7 * far), (-0.6 * far, -far), (0.8 * far, 0.9 * far), (far, -far)]
    found = list(shape.field_positions(told, shape.wall_ranges(told)))
    wanted = [(z, *angles) for z in RANGES for angles in corners]
    assert len(found) == len(wanted)
    predicted = shape._predict_position(told)
    for position, (z, theta, phi) in zip(found, wanted, strict=True):
        np.testing.assert_allclose(position[1:], (z, theta, phi))
        D = mirrors.axis_separation
        R = (z - D * (1.0 - math.cos(phi))) / (math.cos(theta) * math.cos(phi))
        p = receiver.focal_length * receiver.baseline * math.cos(theta)
        p /= R - receiver.baseline * math.sin(theta)
        one = predicted[position.name]
        assert one.value == pytest.approx(1e3 * p, abs=1e3 * sensor.pitch)
        rounding = shape.position_rounding(told, position) * sensor.pitch
        lens = (receiver.aperture / z) ** 2 / 16.0
        assert one.accuracy == pytest.approx(1e3 * rounding + lens * one.value, rel=1e-9)


def test_moments_of_a_line_are_those_of_its_spot() -> None:
    """Claim: the centroid and, less the pixels' own twelfth, the variance of a Gaussian that pixels cut."""
    edges = np.arange(42) - 0.5
    line = 300.0 * np.diff([0.5 * math.erf((edge - 19.3) / (1.7 * math.sqrt(2.0))) for edge in edges])
    assert shape._centroid(line) == pytest.approx(19.3, abs=1e-6)
    assert shape._width(line) == pytest.approx(1.7, abs=1e-6)


def test_points_err_by_the_shift_of_the_spot_along_the_beam() -> None:
    """Claim: −R² pitch/(f d) (p̂ − p) along (sinΘ, cosΘ sinφ, cosΘ cosφ) and R; of an estimator that is not corrected
    with its systematic error. All coordinates in the middle, the range alone on the axis elsewhere."""
    for peak in ("maximum_likelihood", "parabola"):
        told = setting(processing={"peak": peak, "bias_correction": "none"})
        found = point_errors._predict_points(told)
        assert len(found) == 5 * 4 + 2
        seen = told.closed.facing(20.0, GREY)
        shift = seen.centre - seen.chief
        if peak == "parabola":
            brightest = int(np.argmax(seen.line))
            left, top, right = seen.line[brightest - 1 : brightest + 2]
            vertex = brightest + 0.5 * (left - right) / (left - 2.0 * top + right)
            shift += vertex - LINE // 2 - seen.phase
        axis = found["R at 20 m, Θ +0.00, φ +0.00"]
        assert axis.value == pytest.approx(-1e3 * metres_per_pixel(told, 20.0) * shift, rel=1e-6, abs=1e-12)
        assert axis.scale == pytest.approx(20e3)
        far = 0.8 * told.scenario.scanner.mirrors.max_deflection
        theta, phi = -far, 0.7 * far
        name = f"9 m, Θ {theta:+.2f}, φ {phi:+.2f}"
        along = {
            "x": math.sin(theta),
            "y": math.cos(theta) * math.sin(phi),
            "z": math.cos(theta) * math.cos(phi),
        }
        R = found[f"R at {name}"]
        for coordinate, share in along.items():
            one = found[f"{coordinate} at {name}"]
            assert one.value == pytest.approx(R.value * share, abs=1e-12)
            # What rounding adds is the same for each.
            assert one.accuracy - 6e-5 * 9.0 == pytest.approx((R.accuracy - 6e-5 * 9.0) * abs(share))


@pytest.mark.parametrize("tilt", [0.0, "scheimpflug"])
def test_points_scatter_as_their_coordinates_turn(tilt: float | str) -> None:
    """Claim: σ² of x, y, z and R by differences of the whole way from (p, Θ, φ) to the point; p errs by f (1 + p²/f²)
    times the error of synchronisation, however the array stands, the angles by what encoders do not see."""
    told = setting(scanner={"receiver": {"array_tilt": tilt}})
    receiver, mirrors = told.scenario.scanner.receiver, told.scenario.scanner.mirrors
    f, d, D = receiver.focal_length, receiver.baseline, mirrors.axis_separation
    found = point_errors._predict_covariance(told)

    def point(p: float, theta: float, phi: float) -> Array:
        R = d * (f * math.cos(theta) + p * math.sin(theta)) / p
        arm = R * math.cos(theta) - D
        return np.array([R * math.sin(theta), arm * math.sin(phi), D + arm * math.cos(phi), R])

    far = 0.8 * mirrors.max_deflection
    for theta, phi in ((0.0, 0.0), (0.8 * far, 0.9 * far)):
        p = f * d * math.cos(theta) / (MIDDLE - d * math.sin(theta))
        sigmas = (f * (1.0 + (p / f) ** 2) * mirrors.synchronisation, *[told.closed.angle_sigma] * 2)
        total = np.zeros(4)
        for axis, sigma in enumerate(sigmas):
            step = np.eye(3)[axis] * [1e-7, 1e-5, 1e-5]
            slope = (
                point(*(np.array([p, theta, phi]) + step)) - point(*(np.array([p, theta, phi]) - step))
            ) / (2.0 * step[axis])
            total += (slope * sigma) ** 2
        for coordinate, wanted in zip("xyzR", np.sqrt(total), strict=True):
            one = found[f"{coordinate} at 9 m, Θ {theta:+.2f}, φ {phi:+.2f}"]
            assert one.value == pytest.approx(1e3 * wanted, rel=1e-5)
            rounding = metres_per_pixel(told, MIDDLE) * 2.0**-16
            if theta == phi == tilt == 0.0:
                assert one.accuracy == pytest.approx(1e3 * (0.002 * wanted + rounding**2 / wanted), rel=1e-3)


def test_the_law_of_sunlight_and_of_its_ratio() -> None:
    """Claim: the ratio is the laser's charge over the Sun's; both are known to (D/R)² and five in ten thousand; a Sun
    twice as far away has a quarter of the light. The laser fills the well where its power says so."""
    told = setting()
    suns, ratios = light._predict_sun(told), light._predict_ratio(told)
    aperture = told.scenario.scanner.receiver.aperture
    for distance in RANGES:
        sun, ratio = suns[f"{distance:.4g} m"], ratios[f"{distance:.4g} m"]
        laser = told.closed.facing(distance, GREY).charge
        assert sun.value * ratio.value == pytest.approx(laser)
        for one in (sun, ratio):
            assert one.accuracy == pytest.approx(((aperture / distance) ** 2 + 5e-4) * one.value)
    usual = {"direction": (0.0, 0.0, -1.0)}
    lit = setting(lighting={"sun": usual})
    chosen = lit.scenario.lighting.sun
    assert chosen != "none"
    away = setting(lighting={"sun": usual | {"distance": 2.0 * chosen.distance}})
    assert light._predict_sun(away)["9 m"].value == pytest.approx(0.25 * light._predict_sun(lit)["9 m"].value)
    assert light._dilution(told) == 1.0
    well, power = light._well(told), light._power(told, 0.8)
    stronger = told.scenario.changed(scanner={"laser": {"power": power}})
    assert ClosedForms(stronger).facing(MIDDLE, GREY).line.max() == pytest.approx(0.8 * well)
    accuracy = light._predict_saturation(told)["charge at 0.8 times the full well"].accuracy
    assert accuracy == pytest.approx(((aperture / MIDDLE) ** 2 + 1.5e-3) * 0.8 * well)


def test_errors_of_a_square_array_are_those_of_its_corners() -> None:
    """Claim: σR/√2 … of corners at ±half of a tenth of the range, whose σ of the range is the root mean square of the
    four; the slack is twice D/R and the square of a corner over the range. All of it in mm and mrad. An estimator that
    is not corrected follows the spot by its own slope."""
    told = setting(processing={"peak": "parabola", "bias_correction": "none"})
    forms, D, side = told.closed, told.scenario.scanner.mirrors.axis_separation, 0.1 * MIDDLE
    points, (distance, theta, phi) = targets._array(told)
    np.testing.assert_allclose(np.ptp(points, axis=0), [side, side, 0.0])
    squares = []
    sensor, rate = told.scenario.scanner.position_sensor, told.scenario.scanner.rate
    for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        place = np.array([0.5 * side * x, 0.5 * side * y, MIDDLE])
        tilt = math.atan2(place[1], place[2] - D)
        arm = math.hypot(place[1], place[2] - D) + D
        R, turn = math.hypot(place[0], arm), math.atan2(place[0], arm)
        index = int(np.argmin(np.hypot(theta - turn, phi - tilt)))
        np.testing.assert_allclose([distance[index], theta[index], phi[index]], [R, turn, tilt], rtol=1e-9)
        seen = forms.spot(turn, tilt, place, np.array([0.0, 0.0, -1.0]), GREY)
        variance = seen.line + sensor.read_noise**2 + sensor.dark_current / rate
        sigma = forms.sigma_pixel(seen, told.scenario.processing.peak, variance)
        apart = forms.synchronisation_error(R, turn) / sensor.pitch * forms.follows(seen)
        squares.append((forms.range_per_pixel(R, turn) * math.hypot(sigma, apart)) ** 2)
    angle, along = targets._sigmas(told)
    assert angle == forms.angle_sigma
    assert along == pytest.approx(math.sqrt(np.mean(squares)), rel=1e-9)
    found = targets._predict_pose(told)
    deep = MIDDLE**2 / side
    wanted = {
        "t_y by uv": angle * MIDDLE / math.sqrt(2.0),
        "t_z by uv": angle * deep / math.sqrt(2.0),
        "ω_x by uv": 2.0 * angle * deep / side,
        "ω_z by joint": angle * MIDDLE / (math.sqrt(2.0) * side),
        "t_x by xyz": math.hypot(0.5 * angle * MIDDLE, 0.25 * 0.1 * along),
        "t_z by xyz": 0.5 * along,
        "ω_y by xyz": along / side,
        "t_z by joint": 1.0 / math.sqrt(2.0 / (angle * deep) ** 2 + 4.0 / along**2),
    }
    slack = 2.0 * D / MIDDLE + 2.0 * 0.05**2
    for case, value in wanted.items():
        assert found[case].value == pytest.approx(1e3 * value), case
        assert found[case].accuracy == pytest.approx(slack * 1e3 * value)


def test_a_disc_fills_five_eighths_of_its_pattern(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: radius and the spot's σ as angles; travel is the way of a dwell, half of it to each side of the middle.
    The bound is the root mean square of eight patterns', of which two hundredths are granted."""
    told = setting()
    pattern = targets._pattern(told)
    radius, spot = targets._disc(told)
    assert radius == pytest.approx(0.625 * pattern.amplitude)
    assert spot == pytest.approx(0.5 * float(told.scenario.scanner.laser.radius(MIDDLE)) / MIDDLE, rel=1e-6)
    position, travel = targets._figure(pattern, 3)
    assert position.shape == (3, pattern.points, 2)
    # A closed figure: its ways add up to nothing, and each is nearly that between its neighbours' middles.
    np.testing.assert_allclose(travel.sum(axis=1), 0.0, atol=1e-12 * pattern.amplitude)
    between = 0.5 * (position[:, 2:] - position[:, :-2])
    assert np.abs(between - travel[:, 1:-1]).max() < 0.02 * np.abs(travel).max()
    middle = (np.arange(pattern.points) + 0.5) / pattern.points
    drawn = figures(pattern, np.arange(3), np.zeros(2))
    np.testing.assert_allclose(position, np.stack(figure_angles(drawn, pattern.cycles, middle), axis=-1))
    asked: list[Any] = []

    def bound(*given: Any) -> Array:
        asked.append(given)
        return 1e-12 * len(asked) * np.diag([1.0, 4.0, 9.0, 16.0, 25.0])

    monkeypatch.setattr(targets.tracking, "centre_bound", bound)
    found = targets._predict_centre(told)
    assert [given[2:] for given in asked] == [(radius, spot, (0.1, 1.0), 0.02)] * 8
    for name, value in (("Θ", math.sqrt(4.5)), ("φ", 2.0 * math.sqrt(4.5))):
        assert found[f"σ of {name}"].value == pytest.approx(value)
        assert found[f"σ of {name}"].accuracy == pytest.approx(0.02 * value)
        assert found[f"mean of {name}"].accuracy == pytest.approx(0.02 * value)
        assert found[f"mean of {name}"].scale == pytest.approx(1e6 * radius)
        assert found[f"stated σ of {name}"].accuracy == 0.02


def test_time_of_flight_errs_by_bound_and_clock() -> None:
    """Claim: c/2 σ_t in mm with σ_t² of the bound, root mean square over places between samples; with the clock's
    jitter in squares; a thousandth of a sample as bias. Echoes are 20, 100 and 500 times the noise."""
    told = setting(ranging="both")
    unit = told.scenario.scanner.lidar
    sigma, _ = pulses.dark_noise(told)
    echoes = pulses._echoes(told)
    half = 0.5e3 * SPEED_OF_LIGHT
    assert len(echoes) >= 2
    bounds, floors, biases = (
        pulses._predict_bound(told),
        pulses._predict_floor(told),
        pulses._predict_bias(told),
    )
    for (case, (R, grey)), ratio in zip(echoes.items(), (20.0, 100.0, 500.0), strict=False):
        assert pulses.echo_peak(told, R, grey) == pytest.approx(ratio * sigma)
        bound, floor = bounds[case].value, floors[case].value
        assert bounds[case].accuracy == pytest.approx(0.02 * bound)
        assert floor**2 - bound**2 == pytest.approx((half * unit.digitiser.jitter) ** 2, rel=1e-6)
        assert floors[case].accuracy == pytest.approx(0.02 * bound**2 / floor + 2e-4 * floor)
        assert biases[case].accuracy == pytest.approx(1e-3 * half / unit.digitiser.rate)
        assert biases[case].scale == pytest.approx(1e3 * R)
    R, grey = next(iter(echoes.values()))
    widths, white = pulses.pulse_widths(told), pulses.dark_noise(told)[1]
    own = [
        coloured_noise_bound(
            *widths,
            1.0 / unit.digitiser.rate,
            pulses.echo_peak(told, R + off * half / unit.digitiser.rate, grey) / sigma,
            white,
        )
        for off in 1e-3 * np.array([-0.375, -0.125, 0.125, 0.375])
    ]
    assert next(iter(bounds.values())).value == pytest.approx(half * math.sqrt(np.mean(np.square(own))))
    # Ten times as much noise of the same colour under echoes ten times as high: the same bound.
    values = [bounds[case].value for case in echoes]
    assert values[0] / values[1] == pytest.approx(5.0, rel=0.02)


def test_a_level_is_crossed_earlier_the_higher_the_echo(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the straight line between the samples beside the level crosses it c/2 times as much earlier as it does on
    pulses that lie evenly between samples: more than c/2 σ (√(2 ln ratio) − √(2 ln 2))."""
    told = setting(ranging="both")
    width, step = math.hypot(*pulses.pulse_widths(told)), 1.0 / told.scenario.scanner.lidar.digitiser.rate
    found = time_walk._predict_walk(told)
    assert len(found) == 3

    def crossing(ratio: float) -> float:
        times = []
        for phase in (np.arange(400) + 0.5) / 400.0:
            time = step * (np.arange(-60, 1) + phase)
            height = ratio * np.exp(-0.5 * (time / width) ** 2)
            above = int(np.argmax(height >= 1.0))
            times.append(np.interp(1.0, height[above - 1 : above + 1], time[above - 1 : above + 1]))
        return float(np.mean(times))

    for ratio in (4.0, 8.0, 16.0):
        one = found[f"peak {ratio:g} times the level"]
        assert one.value == pytest.approx(
            0.5e3 * SPEED_OF_LIGHT * (crossing(2.0) - crossing(ratio)), rel=2e-3
        )
        assert one.value > 0.5e3 * SPEED_OF_LIGHT * width * (
            math.sqrt(2.0 * math.log(ratio)) - math.sqrt(2.0 * math.log(2.0))
        )
        assert 0.05 <= one.accuracy < 5.0
    # Crossings that are the same at all places leave 0.05 mm of rounding.
    monkeypatch.setattr(time_walk, "sampled_crossings", lambda *given: np.full(64, -1e-12 * given[2]))
    assert time_walk._predict_walk(told)["peak 8 times the level"].accuracy == pytest.approx(0.05)


def test_surfaces_of_speckle_are_far_enough_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: as many directions as lie two radii apart, the others of further surfaces; the fourth root of kurtosis
    counts in what a sample tells: √((κ − 1)/4n) three times, with 4 % and 1.5 c²."""
    told = setting(scanner={"laser": {"waist_radius": 6e-3}})
    reach, side, runs = speckle._separate(told, RANGES[0])
    radius = told.scenario.scanner.laser.radius(RANGES[0]) / RANGES[0]
    assert reach <= min(0.05, 2.0 * 69 * radius) + 1e-12
    assert 2.0 * reach / (side - 1) >= 2.0 * radius * (1.0 - 1e-9)
    assert side < 70
    assert 2.0 * reach / side < 2.0 * radius
    assert runs * side**2 >= 70**2 > (runs - 1) * side**2
    told = setting()
    # Far away no more directions are wanted than the shots have.
    radius = told.scenario.scanner.laser.radius(20.0) / 20.0
    assert speckle._separate(told, 20.0) == (pytest.approx(min(0.05, 2.0 * 69 * radius)), 70, 1)
    assert 2.0 * 69 * radius < 0.05
    draws = np.random.default_rng(3).laplace(size=(4, 20_000))
    # Laplace's kurtosis is 6.
    wanted = 0.04 + 1.5 * 0.2**2 + 3.0 * math.sqrt(5.0 / 80_000)
    assert speckle._slack(draws, 0.2) == pytest.approx(wanted, rel=0.02)
    normal = np.random.default_rng(4).normal(size=(4, 20_000))
    assert speckle._slack(normal, 0.0) == pytest.approx(0.04 + 3.0 * math.sqrt(2.0 / 80_000), rel=0.01)
    # Lines that are moved by known amounts, and grow by known shares.
    moved, grown = np.array([-0.02, 0.0, 0.02]), np.array([0.9, 1.0, 1.1])

    def lines(_: Any, R: float) -> Array:
        every = []
        for _, seen in noise.spots(told, R):
            middle = speckle._LINE // 2 + seen.phase
            every.append(
                [
                    share * pixel_shares(middle + shift, seen.sigma, speckle._LINE)
                    for shift, share in zip(moved, grown, strict=True)
                ]
            )
        return np.array(every)

    monkeypatch.setattr(speckle, "_seen", lines)
    limit, contrast = speckle._predict_limit(told), speckle._predict_contrast(told)
    for R in speckle._ranges(told):
        per_pixel = math.sqrt(np.mean([metres_per_pixel(told, where) ** 2 for where, _ in places(told, R)]))
        assert limit[f"{R:.4g} m"].value == pytest.approx(1e3 * per_pixel * 0.02, rel=2e-3)
        assert contrast[f"{R:.4g} m"].value == pytest.approx(10.0, rel=1e-3)
