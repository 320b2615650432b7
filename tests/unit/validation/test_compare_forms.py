"""What ``compare`` takes from a scenario, and where it puts its targets, by the plain forms of the literature."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import Scenario, load_scenario
from scanner_sim.analytic import geometry as judge
from scanner_sim.analytic.echo_budget import EchoInstrument
from scanner_sim.analytic.spot import pixel_shares, share_within_height
from scanner_sim.foundation.constants import PLANCK, SPEED_OF_LIGHT
from scanner_sim.foundation.frames import rotation_about
from scanner_sim.validation.compare import coverage, light, noise, pulses, shape, time_walk
from scanner_sim.validation.compare import test_bench as stand
from scanner_sim.validation.compare.closed_forms import ClosedForms, EstimatorForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget
from scanner_sim.validation.compare.instrument import echo_instrument_of

R, GREY = 9.0, 0.4


def scenario(**changes: Any) -> Scenario:
    scan = {"type": "raster", "rows": 4, "columns": 4, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    return load_scenario({"schema": 1, "seed": 7, "scan": scan} | changes)


def setting(**changes: Any) -> ComparisonSetup:
    return ComparisonSetup(scenario(**changes), FlatTarget(GREY, (3.0, R, 20.0)))


@pytest.mark.parametrize(("theta", "phi"), [(0.0, 0.0), (0.3, -0.2), (-0.2, 0.4)])
def test_a_plate_faces_the_beam_where_the_beam_meets_it(theta: float, phi: float) -> None:
    """Claim: its middle is the point at (R, Θ, φ), and its normal lies along the beam there."""
    made = stand.plate(R, GREY, theta=theta, phi=phi, separation=0.05)
    np.testing.assert_allclose(made["position"], judge.point_from_shot(R, theta, phi, 0.05), atol=1e-12)
    turned = np.eye(3)
    for turn in made["rotation"]:
        axis = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0]}[turn["axis"]]
        turned = rotation_about(axis, turn["angle"]) @ turned
    beam = judge.scanner_axes(theta, phi)[0]
    np.testing.assert_allclose(turned[:, 2], beam, atol=1e-12)
    assert made["material"] == {"reflectance": GREY}


@pytest.mark.parametrize("tilt", ["ideal", "scheimpflug"])
def test_single_precision_moves_a_spot_by_no_more_than_is_granted(tilt: str) -> None:
    """Claim: eqs 1 and 3 in single precision place a spot as the law of the spot's place grants, and not far better.

    Set-up: NumPy in float32 against float64, 200 directions of a lens of 35 mm before pixels of 5.5 µm, wall at 2.2 m,
    on which a point is a mean of the corners.
    Expected: none beyond what is granted, four standard deviations of even roundings of their largest size, as rounding
    is smaller for most numbers; the root mean square between a twentieth and a quarter of it.
    """
    receiver = {"focal_length": 0.035, "baseline": 0.12, "aperture": 0.008, "array_tilt": tilt}
    made = setting(scanner={"receiver": receiver, "position_sensor": {"pitch": 5.5e-6, "offset": 1e-3}})
    line, rng = made.scenario.scanner.receiver.line_image, np.random.default_rng(5)
    theta, phi = rng.uniform(-0.4, 0.4, (2, 200))

    def places(real: type[np.floating]) -> np.ndarray:
        angles = [angle.astype(np.float32).astype(real) for angle in (theta, phi)]
        s, c, sp, cp = (turn(angle) for angle in angles for turn in (np.sin, np.cos))
        D, d, z, half = (real(length) for length in (0.05, 0.12, 2.2, 0.5 * shape._wall_size(made, 2.2)))
        u, n = (s, c * sp, c * cp), (c, -s * sp, -s * cp)
        start = (0.0 * sp, -D * sp, D * (real(1.0) - cp))
        way = (z - start[2]) / u[2]
        shares = [(start[k] + way * u[k] + half) / (half + half) for k in (0, 1)]
        point = [half * share - half * (real(1.0) - share) for share in shares]
        seen = [coordinate - (start[k] + d * (k == 0)) for k, coordinate in enumerate([*point, z])]
        depth, across = (sum(v * a for v, a in zip(seen, axis, strict=True)) for axis in (u, n))
        t = -across / depth
        s_array = real(line.scale) * t / (real(1.0) - real(line.slope) * t)
        return np.asarray((s_array - real(1e-3)) / real(5.5e-6), dtype=np.float64)

    moved = places(np.float32) - places(np.float64)
    granted = np.array(
        [
            shape.position_rounding(made, shape.FieldPosition("", 2.2, *angles))
            for angles in zip(theta, phi, strict=True)
        ]
    )
    assert (np.abs(moved) < granted).all()
    assert 0.05 < np.sqrt(np.mean((moved / granted) ** 2)) < 0.25


def test_the_judge_asks_the_forms_of_an_estimator_that_is_not_his() -> None:
    """Claim: σ is that of the form where there is one, else of first order by the position; without either none."""
    moment = EstimatorForms(position=lambda line: float(line @ np.arange(line.size) / line.sum()))
    stated = EstimatorForms(sigma=lambda line, variance: 0.25)
    assert [moment.has("position"), moment.has("sigma")] == [True, True]
    assert [stated.has("position"), stated.has("sigma")] == [False, True]
    assert not EstimatorForms().has("sigma")
    seen = ClosedForms(scenario()).facing(R, GREY)
    variance = np.full(seen.line.size, 4.0)
    away = np.arange(seen.line.size) - moment.position(seen.line)
    first = 2.0 * np.sqrt(np.sum(away**2)) / seen.line.sum()
    assert ClosedForms(scenario(), moment).sigma_pixel(seen, "mine", variance) == pytest.approx(
        first, rel=1e-6
    )
    assert ClosedForms(scenario(), stated).sigma_pixel(seen, "mine", variance) == 0.25
    theirs = [
        ClosedForms(scenario(), own).sigma_pixel(seen, "gaussian", variance) for own in (stated, moment)
    ]
    assert theirs[0] == theirs[1] != 0.25


def test_shots_of_the_stand_wobble_apart() -> None:
    mirrors = scenario().scanner.mirrors
    aim = stand.directions([0.0, 0.1, 0.2], 0.05, mirrors, 1e-6)
    np.testing.assert_allclose(aim.time, 2.0 * mirrors.wobble_time * np.arange(3))
    np.testing.assert_allclose(stand.directions([0.0, 0.1], 0.0, mirrors, 1.0).time, [0.0, 1.0])
    np.testing.assert_allclose(aim.phi, 0.05)


def test_errors_are_measured_less_true(monkeypatch: pytest.MonkeyPatch) -> None:
    layers = {"range_m": np.array([5.1, 4.8]), "truth.range_m": np.array([5.0, 5.0])}
    monkeypatch.setattr(stand, "measure", lambda *_: layers)
    found = stand.range_errors(
        setting(), scenario(), stand.directions(0.0, 0.0, scenario().scanner.mirrors, 0.0)
    )
    np.testing.assert_allclose(found, [0.1, -0.2])


def test_settings_share_out_seeds_and_shots() -> None:
    one = ComparisonSetup(scenario(), seeds=3)
    assert one.shots(100) == 100
    assert ComparisonSetup(scenario(), quick=True).shots(100) == 25
    every = [seed for place in ((1,), (2,), (1, 2), (2, 1), (1, 2, 3)) for seed in one.seed(*place)]
    assert len(set(every)) == 15
    flat = one.flat.ranges
    nearest = one.scenario.scanner.nearest_range
    np.testing.assert_allclose(flat, np.geomspace(1.15 * nearest, 25.0, 5), rtol=5e-3)
    assert one.middle == flat[2]
    assert setting().middle == R


def test_a_facing_spot_has_the_light_and_width_of_eq_19() -> None:
    """Claim: N = P ρ A T/(π R²) · cos³ of the base · QE t λ/hc, within the pixels' height; σ by beam and lens."""
    known = scenario()
    scanner, closed = known.scanner, ClosedForms(known)
    laser, receiver, sensor = scanner.laser, scanner.receiver, scanner.position_sensor
    seen = closed.facing(R, GREY)
    away = math.hypot(R, receiver.baseline)
    area = 0.25 * math.pi * receiver.aperture**2
    transmission = receiver.transmission * scanner.filter.transmission  # type: ignore[union-attr]
    watts = laser.power * GREY / math.pi * area * transmission * (R / away) ** 2 / away**2
    electrons = (
        watts / scanner.rate * sensor.quantum_efficiency * laser.wavelength / (PLANCK * SPEED_OF_LIGHT)
    )
    width = 0.5 * laser.radius(R) * receiver.focal_length / R
    blurred = math.hypot(width, math.hypot(receiver.aberration, sensor.diffusion))
    assert seen.charge == pytest.approx(
        electrons * float(share_within_height(blurred, sensor.height)), rel=1e-4
    )
    assert seen.sigma == pytest.approx(blurred / sensor.pitch, rel=1e-3)
    position = receiver.focal_length * receiver.baseline / R
    assert seen.chief == pytest.approx((position - sensor.offset) / sensor.pitch - 0.5, abs=1e-9)
    assert closed.range_per_pixel(R) == pytest.approx(
        R**2 * sensor.pitch / (receiver.focal_length * receiver.baseline)
    )


def test_angles_err_by_what_encoders_do_not_see() -> None:
    mirrors = {
        "jitter": 10e-6, "jitter_seen": 0.36, "wobble": 7e-6, "readout_noise": 5e-6, "readout_step": 20e-6,
        "synchronisation": 4e-6,
    }  # fmt: skip
    closed = ClosedForms(scenario(scanner={"mirrors": mirrors}))
    random = 0.64 * 10e-6**2 + 7e-6**2 + 5e-6**2 + 20e-6**2 / 12.0
    assert closed.angle_sigma == pytest.approx(math.sqrt(random))
    f, d = closed.f, closed.d
    near = 1.5
    assert closed.synchronisation_error(near) == pytest.approx(f * (1.0 + (d / near) ** 2) * 4e-6)


def test_noise_of_a_pixel_is_light_read_and_dark() -> None:
    told = setting()
    sensor = told.scenario.scanner.position_sensor
    seen = ClosedForms(told.scenario).facing(R, GREY)
    dark = sensor.dark_current / told.scenario.scanner.rate
    found = noise._both_variances(told, seen)
    np.testing.assert_allclose(found, seen.line + sensor.read_noise**2 + dark)
    np.testing.assert_allclose(noise._read_variance(told, seen), sensor.read_noise**2)


def test_sunlight_falls_with_the_fourth_power_of_the_cosine() -> None:
    """Claim: (ρ/π) (S/f²) A T E cos⁴ψ, in electrons, S = 200 µm times the pixels' height."""
    told = setting()
    scanner, closed = told.scenario.scanner, ClosedForms(told.scenario)
    near = 1.2
    assert closed.band is not None
    tangent = closed.d / near
    seen = closed.facing(near, GREY)
    slope = (seen.centre - closed.pixel(0.0)) * closed.pitch / closed.f
    assert slope == pytest.approx(tangent, rel=1e-3)
    sun = told.scenario.lighting.sun
    assert sun == "none"
    irradiance = closed.band.counted(
        scanner.laser.wavelength, scanner.position_sensor.response, math.atan(slope), light._temperature(told)
    )
    gain = 0.25 * math.pi * scanner.receiver.aperture**2 * closed.peak_transmission
    watts = GREY / math.pi * 200e-6 * scanner.position_sensor.height / closed.f**2 * gain * irradiance
    watts *= math.cos(math.atan(slope)) ** 4
    electrons = (
        scanner.position_sensor.quantum_efficiency * scanner.laser.wavelength / (PLANCK * SPEED_OF_LIGHT)
    )
    assert light._sun_charge(told, near) == pytest.approx(watts / scanner.rate * electrons, rel=1e-9)
    full, told_of = light._well(told), light._predict_saturation(told)
    assert told_of["charge at 1.25 times the full well"].value == pytest.approx(full)
    assert told_of["charge at 0.8 times the full well"].value == pytest.approx(0.8 * full)


def test_the_band_moves_to_the_blue_and_leaks() -> None:
    """Claim: λ₀ √(1 − sin²θ/n²); the leak is what the band does not pass times the blocking."""
    filtered = {
        "bandwidth": 30e-9,
        "shape": "cavities",
        "cavities": 2,
        "effective_index": 1.8,
        "blocking": 1e-3,
    }
    band = ClosedForms(scenario(scanner={"filter": filtered})).band
    assert band is not None
    assert band.centre_at(0.3) == pytest.approx(1.5e-6 * math.sqrt(1.0 - (math.sin(0.3) / 1.8) ** 2))
    inside = 1.0 / (1.0 + 2.0**4)
    assert band.passed(1.5e-6 + 30e-9) == pytest.approx(inside + 1e-3 * (1.0 - inside))
    assert band.passed(1.5e-6 + 15e-9) == pytest.approx(0.5 + 0.5e-3)


@pytest.mark.parametrize("incidence", [0.0, 0.3, -0.3])
def test_sunlight_behind_the_filter_counts_photons(incidence: float) -> None:
    """Claim: ∫ E T λ/λ₀ dλ by a fine sum, within the response, of the band where it lies at an incidence."""
    from scanner_sim.analytic.sun import planck_irradiance

    chosen = {"bandwidth": 60e-9, "shape": "cavities", "blocking": 1e-3, "effective_index": 1.8}
    band = ClosedForms(scenario(scanner={"filter": chosen})).band
    assert band is not None
    edges = np.linspace(0.9e-6, 1.7e-6, 400_001)
    middle = 0.5 * (edges[1:] + edges[:-1])
    x = (middle - 1.5e-6 * math.sqrt(1.0 - (math.sin(incidence) / 1.8) ** 2)) / 30e-9
    inside = 1.0 / (1.0 + x**6)
    passed = inside + 1e-3 * (1.0 - inside)
    wanted = np.sum(planck_irradiance(middle, 5770.0) * passed * middle / 1.5e-6) * (edges[1] - edges[0])
    assert band.counted(1.5e-6, (0.9e-6, 1.7e-6), incidence, 5770.0) == pytest.approx(wanted, rel=1e-6)


def test_sunlight_counts_against_the_laser_where_it_drifted_to() -> None:
    """Claim: a line at the half maximum of the filter, 30 nm off, has half the light, beside which sunlight doubles."""

    def told(drift: float) -> EchoInstrument:
        scanner = {
            "laser": {"drift": drift},
            "filter": {"bandwidth": 60e-9, "shape": "cavities", "blocking": 0.0},
        }
        lit = {"sun": {"direction": (0.0, 0.0, -1.0)}}
        return echo_instrument_of(setting(ranging="tof", scanner=scanner, lighting=lit).scenario, GREY)

    usual, off = told(0.0), told(30e-9)
    assert off.transmission == pytest.approx(0.5 * usual.transmission)
    assert off.sunlight == pytest.approx(2.0 * usual.sunlight)


def test_an_echo_has_its_peak_and_the_dark_its_noise() -> None:
    """Claim: E ρ A T/(π R²) over √(2π) times the width of pulse and electronics, times M R₀; noise i²B and step²/12."""
    told = setting(ranging="both")
    scanner, closed = told.scenario.scanner, ClosedForms(told.scenario)
    unit = scanner.lidar
    pulse = unit.pulse.width / (2.0 * math.sqrt(2.0 * math.log(2.0)))
    response = math.sqrt(math.log(2.0)) / (2.0 * math.pi * unit.photodiode.bandwidth)
    assert pulses.pulse_widths(told) == pytest.approx((pulse, response))
    energy = unit.pulse.pulse_energy * closed.peak_transmission
    share = GREY * 0.25 * math.pi * scanner.receiver.aperture**2 / (math.pi * R**2)
    peak = energy * share / (math.sqrt(2.0 * math.pi) * math.hypot(pulse, response))
    assert pulses.echo_peak(told, R, GREY) == pytest.approx(
        peak * unit.photodiode.gain * unit.photodiode.responsivity
    )
    step = unit.photodiode.saturation * 17.0 / 16.0 / (2.0**unit.digitiser.bits - 1.0)
    coloured = (
        unit.photodiode.amplifier_noise**2
        * unit.photodiode.bandwidth
        * math.sqrt(math.pi / math.log(2.0))
        / 2.0
    )
    sigma, white = pulses.dark_noise(told)
    assert sigma == pytest.approx(math.sqrt(step**2 / 12.0 + coloured), rel=1e-6)
    assert white == pytest.approx(step**2 / 12.0 / (step**2 / 12.0 + coloured), rel=1e-6)
    near = list(pulses.near(told, R))
    half = 0.5 * SPEED_OF_LIGHT / unit.digitiser.rate
    np.testing.assert_allclose(near, R + half * np.array([-0.375, -0.125, 0.125, 0.375]))


def test_echoes_are_of_light_to_which_the_photodiode_responds() -> None:
    """Claim: what the line responds to is nothing to the closed forms of an echo; a blind photodiode has none."""
    band, blind, lit = (0.9e-6, 1.7e-6), (0.9e-6, 1.4e-6), {"sun": {"direction": (0.0, 0.0, -1.0)}}

    def forms(line: tuple[float, float], diode: tuple[float, float]) -> tuple[float, EchoInstrument]:
        scanner = {"position_sensor": {"response": line}, "lidar": {"photodiode": {"response": diode}}}
        told = setting(ranging="tof", scanner=scanner | {"filter": "none"}, lighting=lit)
        return pulses.echo_peak(told, R, GREY), echo_instrument_of(told.scenario, GREY)

    usual = forms(band, band)
    assert forms(blind, band) == usual
    assert forms(band, (1.4e-6, 1.6e-6))[1].sunlight < 0.5 * usual[1].sunlight
    # A file that says so is refused.
    seeing = setting(ranging="tof")
    unlit = seeing.scenario.changed(scanner={"lidar": {"photodiode": {"response": blind}}})
    dark = dataclasses.replace(seeing, scenario=unlit)
    assert pulses.echo_peak(dark, R, GREY) == 0.0
    assert echo_instrument_of(dark.scenario, GREY).transmission == 0.0


def test_plates_of_a_walk_return_a_ratio_of_the_level(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: with echoes of 8e-5 ρ/R² A the level is a sixteenth of a white plate's at the farthest place, or of half
    the saturation where that is less; at every place the reflectance makes the echo ``ratio`` times as high."""
    monkeypatch.setattr(time_walk, "echo_peak", lambda _, distance, rho: 8e-5 * rho / distance**2)
    monkeypatch.setattr(time_walk, "echo_range", lambda _: R)
    known = setting()
    places = np.array(time_walk._walk_ranges(known))
    step = 0.5 * SPEED_OF_LIGHT / known.scenario.scanner.lidar.digitiser.rate
    np.testing.assert_allclose(places, R + step * ((np.arange(8) + 0.5) / 8.0 - 0.5))
    saturation = known.scenario.scanner.lidar.photodiode.saturation
    level = min(8e-5 / places[-1] ** 2, 0.5 * saturation) / 16.0
    for ratio in (2.0, 16.0):
        reflectance = np.array(time_walk._walk_reflectances(known, ratio))
        np.testing.assert_allclose(8e-5 * reflectance / places**2, ratio * level, rtol=1e-12)


@pytest.mark.parametrize("moving", [True, False])
def test_pulls_are_errors_over_what_is_stated_of_them(monkeypatch: pytest.MonkeyPatch, moving: bool) -> None:
    """Claim: (R − R₀)/σ_R and eᵀ C⁻¹ e of valid voxels with the stated covariance, eᵀ e if mirrors do not err."""
    random, count = np.random.default_rng(4), coverage._FEWEST + 5
    mirrors = {} if moving else dict.fromkeys(("jitter", "wobble", "synchronisation", "readout_noise"), 0.0)
    known = setting(scanner={"mirrors": mirrors | ({} if moving else {"readout_step": 0.0})})
    root = random.normal(size=(count, 3, 3)) * 1e-3
    stated, error = root @ np.swapaxes(root, 1, 2), 1e-3 * random.normal(size=(count, 3))
    theta, phi = random.uniform(-0.2, 0.2, (2, count))
    points = judge.point_from_shot(R, theta, phi, ClosedForms(known.scenario).D) + error
    layers = {"truth.range_m": np.full(count, R), "truth.theta_rad": theta, "truth.phi_rad": phi}
    layers |= {"range_m": R + error[:, 0], "sigma_range_m": np.full(count, 2e-3), "status": np.zeros(count)}
    layers["status"][0] = 4
    for i, one in enumerate("xyz"):
        layers |= {f"P.{one.upper()}": points[:, i], f"sigma_{one}_m": np.sqrt(stated[:, i, i])}
        layers |= {f"cov_{'xyz'[j]}{one}_m2": stated[:, j, i] for j in range(i)}
    good = np.ones(count, dtype=bool)
    good[1] = False
    monkeypatch.setattr(coverage, "_on_planes", lambda *_: iter([(layers, good)]))
    ((pull, squares),) = coverage._pulls(known, "triangulation")
    np.testing.assert_allclose(pull, error[2:, 0] / 2e-3, rtol=1e-9)
    wanted = [
        e @ (np.linalg.solve(c, e) if moving else e) for e, c in zip(error[2:], stated[2:], strict=True)
    ]
    np.testing.assert_allclose(squares, wanted, rtol=1e-6)


def test_the_fit_errs_by_the_information_of_its_pixels() -> None:
    """Claim: 1/√Σ m'²/V, m' the change of a pixel with the place; neither charge nor width are confused with a place,
    since the spot is as good as symmetric: 2 %."""
    told = setting()
    closed, sensor = ClosedForms(told.scenario), told.scenario.scanner.position_sensor
    seen = closed.facing(R, GREY)
    for variance in (seen.line + sensor.read_noise**2, np.full(seen.line.size, 3e5)):
        middle, step = 24 + seen.phase, 1e-4
        ends = [pixel_shares(middle + way, seen.sigma, seen.line.size) for way in (step, -step)]
        change = seen.charge * (ends[0] - ends[1]) / (2.0 * step)
        wanted = 1.0 / math.sqrt(np.sum(change**2 / variance))
        found = closed.sigma_pixel(seen, "maximum_likelihood", variance)
        assert found == pytest.approx(wanted, rel=0.02)


def test_a_lopsided_blur_moves_the_place_of_the_chief_ray() -> None:
    """Claim: on a tilted array the spot lies where the simulator's own optics put it, to 3 % of the blur's shift."""
    known = scenario(scanner={"receiver": {"array_tilt": "40 deg", "focus_distance": "1 m"}})
    receiver, sensor = known.scanner.receiver, known.scanner.position_sensor
    for distance in (2.2, 9.0):
        p = float(receiver.line_image.position(receiver.baseline / distance))
        shift = float(receiver.line_image.at(p, receiver.baseline, 1.0).shift)
        wanted = (p + shift - sensor.offset) / sensor.pitch - 0.5
        assert abs(shift) > 1e-9
        assert ClosedForms(known).facing(distance, GREY).chief == pytest.approx(
            wanted, abs=0.03 * abs(shift) / sensor.pitch
        )


@pytest.mark.parametrize(
    ("bend", "slope", "other", "counts"),
    [
        (0.19e-3, 0.0, 0, True),
        (0.21e-3, 0.0, 0, False),
        (-0.21e-3, 0.0, 0, False),
        (0.0, math.tan(math.radians(59.5)), 0, True),
        (0.0, -math.tan(math.radians(60.5)), 0, False),
        (0.0, 0.0, 1, False),
    ],
)
@pytest.mark.parametrize("axis", ["theta", "phi"])
def test_sigma_speaks_of_voxels_on_one_plane_that_is_not_steep(
    monkeypatch: pytest.MonkeyPatch, axis: str, bend: float, slope: float, other: int, counts: bool
) -> None:
    """Claim: a bend of a fifth of σ within the spot, a slope of 60°, and one object and material, all by what lies two
    radii of the beam and half of a dwell's travel to each side; a voxel without a truth does not count."""
    known = setting(scanner={"laser": {"speckle": False}})
    distance, sigma = np.array([5.0, np.nan]), 1e-3
    layers = {name: np.zeros(2) for name in ("status", "truth.object", "truth.material")}
    layers |= {"truth.range_m": distance, "sigma_range_m": np.full(2, sigma)}
    aim = stand.directions([0.0, 0.1], 0.0, known.scenario.scanner.mirrors, 0.0)
    aim.travel_theta[:] = 3e-4
    spot = float(known.scenario.scanner.laser.radius(5.0)) / 5.0

    def truth(_: Any, __: Any, some: Any, moved: str, apart: Any) -> tuple[Any, ...]:
        assert some.tolist() == [0]
        np.testing.assert_allclose(np.abs(apart), 2.0 * spot + 1.5e-4, rtol=1e-6)
        own = moved == axis
        found = 5.0 + own * (0.5 * bend + slope * apart * 5.0)
        return found, np.full(1, float(own and other and apart[0] > 0.0)), np.zeros(1)

    monkeypatch.setattr(coverage, "_truth", truth)
    instrument: Any = None
    assert coverage._smooth(known, instrument, aim, layers).tolist() == [counts, False]


def test_echoes_near_the_saturation_are_left_out() -> None:
    """Claim: 95 % of the amplifier's saturation, in electrons; of a line all count."""
    unit = SimpleNamespace(photodiode=SimpleNamespace(saturation=2e-5))
    echo: Any = SimpleNamespace(
        scenario=SimpleNamespace(rangefinders=("tof",)),
        time_of_flight=SimpleNamespace(amperes_per_electron=1e-9, unit=unit),
    )
    layers = {"Y": np.array([18_900.0, 19_100.0])}
    assert coverage._unclipped(echo, layers).tolist() == [True, False]
    line: Any = SimpleNamespace(scenario=SimpleNamespace(rangefinders=("triangulation",)))
    assert coverage._unclipped(line, layers).tolist() == [True, True]
