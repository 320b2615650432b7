"""What laws of ``compare`` ask of the instrument, and what they make of errors that are known."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import claims
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import hadamard

from scanner_sim import load_scenario
from scanner_sim.analytic import geometry
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.status import Status
from scanner_sim.render.device import Device
from scanner_sim.scan.lissajous import LissajousPattern
from scanner_sim.validation.compare import (
    coverage,
    light,
    mixed_scenes,
    noise,
    pulses,
    shape,
    speckle,
    targets,
    test_bench,
    time_walk,
    uneven,
)
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget
from scanner_sim.validation.compare.law import Measured
from scanner_sim.validation.compare.mixed_scenes import MixedCoverage, MixedScene

Array = NDArray[np.float64]

GREY, MIDDLE = 0.4, 9.0
RANGES = (3.0, MIDDLE, 20.0)
SCAN = {"type": "raster", "rows": 4, "columns": 4, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}


class Few(ComparisonSetup):
    """A setting whose laws take the same small number of shots."""

    count = 16

    def shots(self, number: int) -> int:  # noqa: ARG002 (whatever is wanted)
        return self.count


def setting(seeds: int = 1, **changes: Any) -> Few:
    told = load_scenario({"schema": 1, "seed": 7, "scan": SCAN} | changes)
    return Few(told, FlatTarget(GREY, RANGES), seeds)


def lidar(told: Few, **unit: Any) -> Few:
    return dataclasses.replace(told, scenario=told.scenario.changed(scanner={"lidar": unit}))


# Time of flight.


def test_echoes_are_asked_for_where_gate_and_amplifier_let_them(device: Device) -> None:
    """Claim: a plate of the middle range that lies four widths of the echo, as ranges, within the gate; a
    ratio of 20, 100 and 500 of the noise, while the plate is no whiter than white and the peak less than 0.8 of the
    saturation."""
    told = setting(ranging="both")
    width = 2.0 * SPEED_OF_LIGHT * math.hypot(*pulses.pulse_widths(told))
    for gate, expected in (
        ((MIDDLE - 1.001 * width, 15.0), MIDDLE),
        ((MIDDLE - 0.999 * width, 30.0), RANGES[2]),
        ((5.0, RANGES[2] + 1.001 * width), RANGES[2]),
        ((5.0, RANGES[2] + 0.999 * width), MIDDLE),
        ((0.5, RANGES[2] + 1.001 * width), MIDDLE),
        ((0.5, MIDDLE + 0.999 * width), RANGES[0]),
        ((RANGES[2] - 0.999 * width, RANGES[2] + 2.0 * width), None),
    ):
        assert pulses.echo_range(lidar(told, digitiser={"gate": gate})) == expected, gate
    sigma, _ = pulses.dark_noise(told)
    white = pulses.echo_peak(told, MIDDLE, 1.0) / sigma
    assert {name.split()[2] for name in pulses._echoes(told)} == {
        f"{ratio:g}" for ratio in (20.0, 100.0, 500.0) if ratio <= white
    }
    power = told.scenario.scanner.lidar.pulse.pulse_energy
    for ratio in (20.0, 100.0, 500.0):
        # So much energy that a white plate returns a little less, or a little more, than the ratio.
        for share in (0.999, 1.001):
            faint = lidar(told, pulse={"energy": power * ratio * share / white})
            found = {name.split()[2]: grey for name, (_, grey) in pulses._echoes(faint).items()}
            assert (f"{ratio:g}" in found) == (share > 1.0)
            if share > 1.0:
                assert found[f"{ratio:g}"] == pytest.approx(1.0 / share)


@pytest.mark.parametrize(("share", "kept"), [(0.801, False), (0.799, True)])
def test_echoes_stay_below_the_saturation(monkeypatch: pytest.MonkeyPatch, share: float, kept: bool) -> None:
    """Claim: of an echo of 100 times the noise the peak is less than 0.8 of what the amplifier bears."""
    told = setting(ranging="both")
    saturation = told.scenario.scanner.lidar.photodiode.saturation
    monkeypatch.setattr(pulses, "dark_noise", lambda _: (share * saturation / 100.0, 0.0))
    monkeypatch.setattr(pulses, "echo_peak", lambda *_: 1e9 * saturation)
    found = pulses._echoes(told)
    assert list(found) == [f"echo of {ratio} times the noise, 9 m" for ratio in ("20", "100")[: 1 + kept]]


def test_a_receiver_has_the_named_noise_alone() -> None:
    """Claim: of what the scenario has on; no drift of the clock, no speckle, mirrors without errors, no gate."""
    told = lidar(setting(ranging="both"), photodiode={"noise": {"amplifier": False}})
    changes = pulses.silent(told, "amplifier", "quantisation", timing="matched_filter")
    made = told.scenario.changed(**changes)
    on = {name for name, value in made.scanner.lidar.photodiode.noise if value}
    assert on == {"quantisation"}
    assert made.scanner.lidar.digitiser.drift == 0.0
    assert not made.scanner.laser.speckle
    assert made.scanner.mirrors.jitter == made.scanner.mirrors.wobble == 0.0
    assert (made.rangefinders, made.processing.range_gate) == (("tof",), None)
    assert made.processing.pulse.timing == "matched_filter"


@pytest.mark.parametrize(("most", "aside"), [(0.4, 0.15), (0.1, 0.1)])
def test_plates_for_echoes_stand_side_by_side(
    monkeypatch: pytest.MonkeyPatch, most: float, aside: float
) -> None:
    """Claim: each faces the beam at its range, over 0.15 rad to each side or as far as mirrors reach, and is shot at as
    often as asked; errors in mm, plate by plate; no plate hides another, and each holds eight radii of the beam."""
    small = SCAN | {"horizontal": (-0.05, 0.05), "vertical": (-0.05, 0.05)}
    told = setting(ranging="both", scanner={"mirrors": {"max_deflection": most}}, scan=small)
    ranges, greys = [9.0, 9.1, 9.2, 9.3], [0.1, 0.2, 0.3, 0.4]
    seen: list[Any] = []

    def errors(_: Any, scenario: Any, aim: Any) -> Array:
        seen.append((scenario, aim))
        return 1e-3 * np.arange(12.0)

    monkeypatch.setattr(test_bench, "range_errors", errors)
    found = pulses.plate_errors(told, ranges, greys, 5, 3, pulses.silent(told))
    np.testing.assert_allclose(found, np.arange(12.0).reshape(4, 3))
    ((made, aim),) = seen
    theta = np.linspace(-aside, aside, 4)
    np.testing.assert_allclose(aim.theta, np.repeat(theta, 3))
    np.testing.assert_array_equal(aim.phi, 0.0)
    assert made.seed == 5
    separation = made.scanner.mirrors.axis_separation
    radius = made.scanner.laser.radius(9.0)
    for plate, R, grey, angle in zip(made.scene.objects, ranges, greys, theta, strict=True):
        np.testing.assert_allclose(
            plate.position, geometry.point_from_shot(R, angle, 0.0, separation), atol=1e-12
        )
        assert plate.rotation[1].angle == pytest.approx(angle)
        assert plate.material.reflectance == grey
        assert min(plate.size) > 16.0 * radius
        assert max(plate.size) < R * 2.0 * aside / 3.0


def test_scatter_and_bias_of_echoes_pool_their_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: σ over places in a sample is the root mean square of theirs, about the mean of each, of all seeds; a bias
    is the mean of all. Amplifier and converter make noise, and the clock where it is asked for."""
    told = setting(2, ranging="both")
    asked: list[Any] = []

    def errors(_: Any, ranges: Any, greys: Any, seed: int, shots: int, made: Any) -> Array:
        asked.append((seed, shots, made, list(greys)))
        np.testing.assert_allclose(
            (np.array(ranges) - MIDDLE) * told.scenario.scanner.lidar.digitiser.rate / (0.5 * SPEED_OF_LIGHT),
            [-0.375, -0.125, 0.125, 0.375],
            atol=1e-9,
        )
        sign = np.where(np.arange(shots) % 2 == 0, 1.0, -1.0) * math.sqrt((shots - 1) / shots)
        place = np.arange(4.0)[:, None]
        return place + (1.0 + (len(asked) % 2)) * sign

    monkeypatch.setattr(pulses, "plate_errors", errors)
    echoes = pulses._echoes(told)
    found = pulses.TOF_SIGMA.measure(told)
    assert list(found) == list(echoes)
    assert [one.value for one in found.values()] == pytest.approx([math.sqrt(2.5)] * len(echoes))
    assert len({seed for seed, *_ in asked}) == 2 * len(echoes)
    assert [greys for *_, greys in asked[::2]] == [[grey] * 4 for _, grey in echoes.values()]
    on = {name for name, value in asked[0][2]["scanner"]["lidar"]["photodiode"]["noise"].items() if value}
    assert on == {"amplifier", "quantisation", "clock"}
    asked.clear()
    bias = pulses.TOF_RANGE.measure(told)
    assert [one.value for one in bias.values()] == pytest.approx([1.5] * len(echoes))
    on = {name for name, value in asked[0][2]["scanner"]["lidar"]["photodiode"]["noise"].items() if value}
    assert on == {"amplifier", "quantisation"}
    assert asked[0][2]["processing"]["pulse"] == {"timing": "matched_filter", "echo": "strongest"}


def test_the_clock_has_a_law_where_it_jitters() -> None:
    told = setting(ranging="both")
    assert not pulses._clocked(told)
    assert pulses._clocked(lidar(told, digitiser={"jitter": 0.0})) == "the clock has no jitter"
    assert pulses._clocked(lidar(told, photodiode={"noise": {"clock": False}})) == "the clock has no jitter"


def test_a_walk_is_the_mean_of_the_places_less_that_of_the_lowest_echo(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: means 0, 1 … 7 mm of eight places, moved by 0, −2, −5 and −9 mm, are 2, 5 and 9 nearer; standard errors of
    the places are those of their means, of two ratios in squares."""
    told = setting(ranging="both")
    moves, asked = iter([0.0, -2.0, -5.0, -9.0]), []

    def errors(_: Any, ranges: Any, greys: Any, seed: int, shots: int, made: Any) -> Array:
        asked.append(
            (ranges, greys, made["processing"]["pulse"], made["scanner"]["lidar"]["photodiode"]["noise"])
        )
        sign = np.where(np.arange(shots) % 2 == 0, 1.0, -1.0) * math.sqrt((shots - 1) / shots)
        return np.arange(8.0)[:, None] + next(moves) + 0.4 * sign

    monkeypatch.setattr(time_walk, "plate_errors", errors)
    found = time_walk._measure_walk(told)
    assert [one.value for one in found.values()] == pytest.approx([2.0, 5.0, 9.0])
    # 16 shots of σ = 0.4 at 8 places: 0.1/√8 each.
    assert [one.error for one in found.values()] == pytest.approx([0.1 / math.sqrt(8.0) * math.sqrt(2.0)] * 3)
    level = time_walk._walk_level(told)
    for (ranges, greys, pulse, noises), ratio in zip(asked, (2.0, 4.0, 8.0, 16.0), strict=True):
        peaks = [pulses.echo_peak(told, *pair) for pair in zip(ranges, greys, strict=True)]
        assert peaks == pytest.approx([ratio * level] * 8)
        assert pulse == {"timing": "leading_edge", "level": level, "walk_correction": False, "overlap": False}
        assert {name for name, value in noises.items() if value} == {"amplifier"}


@pytest.mark.parametrize(
    ("share", "reason"), [(1.001, ""), (0.999, "the level would lie within the noise at this range")]
)
def test_a_level_lies_ten_times_above_the_noise(
    monkeypatch: pytest.MonkeyPatch, share: float, reason: str
) -> None:
    told = setting(ranging="both")
    monkeypatch.setattr(time_walk, "_walk_level", lambda _: share * 10.0 * pulses.dark_noise(told)[0])
    assert time_walk._walks(told) == reason


# Targets.


def test_centres_are_fitted_to_the_judges_disc(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: signals are the judge's disc about no angle, and normal noise of 2 %, which is stated; at the middle
    range. Centres are told in µrad, over their σ, by axis; what is not found does not count."""
    told = setting()
    centres = 1e-6 * np.array([[3.0, -1.0]]) * np.where(np.arange(16) % 2 == 0, 1.0, -1.0)[:, None] + [
        2e-6,
        0.0,
    ]
    seen: list[Any] = []

    def fit(samples: Any, response: Any, start: Any, spot: float) -> Any:
        seen.append((samples, spot))
        found = np.arange(16) < 14
        return SimpleNamespace(found=found, centre=centres, sigma=np.array([1e-6, 2e-6]))

    def signal(position: Array, travel: Array, centre: Array, *disc: Any) -> Array:
        seen.append((position, travel, centre, *disc))
        return 0.5 + 10.0 * position.sum(axis=-1)

    monkeypatch.setattr(targets, "disc_fit", fit)
    monkeypatch.setattr(targets.tracking, "disc_signal", signal)
    monkeypatch.setattr(targets, "target_response", lambda samples, kind, gate: seen.append((kind, gate)))
    for name in ("circle_fit", "hit_centroid", "better_of"):
        monkeypatch.setattr(targets, name, lambda *_: None)
    found = targets._measure_centre(told)
    (asked, (kind, gate), (samples, spot)) = seen
    radius, wanted = targets._disc(told)
    position, travel = targets._figure(targets._pattern(told), 16)
    np.testing.assert_array_equal(asked[0], position)
    np.testing.assert_array_equal(asked[1], travel)
    assert asked[2].tolist() == [0.0, 0.0]
    assert asked[3:] == (radius, wanted, (0.1, 1.0))
    assert spot == wanted
    assert (kind, gate) == (targets.TargetKind.BLACK, (0.5 * MIDDLE, 1.5 * MIDDLE))
    assert claims.mean_square((samples.signal - 0.5 - 10.0 * position.sum(axis=-1)) / 0.02)
    np.testing.assert_array_equal(samples.theta, position[..., 0])
    np.testing.assert_array_equal(samples.phi, position[..., 1])
    assert (samples.range == MIDDLE).all()
    np.testing.assert_allclose(samples.sigma_signal, 0.02)
    np.testing.assert_allclose(np.diff(samples.time), 1.0 / told.scenario.scanner.rate)
    scale = math.sqrt(14.0 / 13.0)
    assert [found[f"mean of {name}"].value for name in ("Θ", "φ")] == pytest.approx([2.0, 0.0], abs=1e-9)
    assert [found[f"σ of {name}"].value for name in ("Θ", "φ")] == pytest.approx([3.0 * scale, 1.0 * scale])
    assert [found[f"stated σ of {name}"].value for name in ("Θ", "φ")] == pytest.approx(
        [3.0 * scale, 0.5 * scale]
    )


@pytest.mark.parametrize(
    ("pattern", "reason"),
    [
        ({"amplitude": 6e-3}, ""),
        ({"amplitude": 6e-3, "aspect": 0.9}, "wider than high"),
        ({"amplitude": 0.4e-3}, "not small against a disc"),
        ({"amplitude": 6e-3, "points": 50}, "too sparse"),
    ],
)
def test_the_law_of_a_disc_speaks_of_fine_round_patterns(
    monkeypatch: pytest.MonkeyPatch, pattern: dict[str, Any], reason: str
) -> None:
    monkeypatch.setattr(targets, "_pattern", lambda _: LissajousPattern(**pattern))
    said = targets._round(setting())
    assert (reason in said) if reason else not said


def test_a_pattern_has_points_enough_where_they_are_half_a_radius_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: at its fastest, 2π times the larger number of cycles, a figure goes less than half of the disc's radius of
    0.625 from point to point; the spot's σ is a fifth of that radius at most."""
    told = setting()
    cycles = max(LissajousPattern().cycles)
    limit = 2.0 * math.pi * cycles / 0.5 / 0.625
    for points in (math.floor(limit), math.floor(limit) + 1):
        monkeypatch.setattr(
            targets, "_pattern", lambda _, many=points: LissajousPattern(amplitude=6e-3, points=many)
        )
        assert bool(targets._round(told)) == (points < limit)
    spot = 0.5 * told.scenario.scanner.laser.radius(MIDDLE) / MIDDLE
    for share in (0.999, 1.001):
        amplitude = share * spot / 0.2 / 0.625
        monkeypatch.setattr(
            targets, "_pattern", lambda _, wide=amplitude: LissajousPattern(amplitude=wide, points=128)
        )
        assert ("not small" in targets._round(told)) == (share < 1.0)


def test_corners_err_by_what_is_measured_less_what_is_true(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: angles of the measured point and its range less the true ones, corner by corner about the corner's mean:
    each axis by itself. The plate is twice the square; shot, read and dark noise and the mirrors' errors are on."""
    told = setting()
    points, (R, theta, phi) = targets._array(told)
    D = told.closed.D
    side = 0.1 * MIDDLE
    np.testing.assert_allclose(
        np.sort(points[:, :2], axis=0), 0.5 * side * np.array([[-1, -1], [-1, -1], [1, 1], [1, 1]])
    )
    np.testing.assert_allclose(
        geometry.point_from_shot(R, theta, phi, D), points + np.array([0.0, 0.0, MIDDLE]), atol=1e-12
    )
    moved = np.random.default_rng(2).normal(size=(3, 16, 4)) * np.array([1e-5, 2e-5, 3e-3])[:, None, None]

    def measure(_: Any, made: Any, aim: Any) -> dict[str, Array]:
        np.testing.assert_allclose(aim.theta, np.tile(theta, 16))
        np.testing.assert_allclose(aim.phi, np.tile(phi, 16))
        on = {name for name, value in made.scanner.position_sensor.noise if value}
        assert on == {"shot", "read", "dark"}
        assert made.scanner.mirrors.jitter == told.scenario.scanner.mirrors.jitter > 0.0
        (wall,) = made.scene.objects
        assert wall.size == pytest.approx((2.0 * side, 2.0 * side))
        assert wall.position[2] == MIDDLE
        # What is true differs from shot to shot, as the mirrors' errors have it.
        shaken = 1e-3 * np.sin(np.arange(64.0))
        true_theta, true_phi, true_R = aim.theta + shaken, aim.phi - 2.0 * shaken, np.tile(R, 16) + shaken
        bias = np.tile([1.0, 2.0, 3.0, 4.0], 16)
        seen = [
            true_theta + moved[0].ravel() + 1e-5 * bias,
            true_phi + moved[1].ravel() - 1e-5 * bias,
            true_R + moved[2].ravel() + 1e-2 * bias,
        ]
        # The point carries the range that is measured.
        point = geometry.point_from_shot(seen[2], seen[0], seen[1], D)
        return {
            "P.X": point[:, 0],
            "P.Y": point[:, 1],
            "P.Z": point[:, 2],
            "range_m": seen[2],
            "truth.theta_rad": true_theta,
            "truth.phi_rad": true_phi,
            "truth.range_m": true_R,
        }

    monkeypatch.setattr(test_bench, "measure", measure)
    found = targets._corner_errors(told, 3, 16)
    np.testing.assert_allclose(found, moved - moved.mean(axis=1, keepdims=True), atol=1e-12)


def test_poses_of_a_square_scatter_by_its_closed_forms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: errors of twelve readings that are orthogonal over sixteen runs, each of its σ, make the six components of
    each method scatter as σR/√2, σR²/(√2 a), σ_R/2 and so on have it: here exactly, but for the first order."""
    told = setting()
    angle, along = targets._sigmas(told)
    signs = hadamard(16)[:, 1:13].reshape(16, 3, 4).transpose(1, 0, 2) * math.sqrt(15.0 / 16.0)
    asked = []

    def errors(_: Any, seed: int, shots: int) -> Array:
        asked.append((seed, shots))
        return signs * np.array([angle, angle, along])[:, None, None]

    monkeypatch.setattr(targets, "_corner_errors", errors)
    found, wanted = targets._measure_pose(told), targets._predict_pose(told)
    assert list(found) == list(wanted)
    assert len(found) == 18
    assert len(asked) == 1
    for case, one in wanted.items():
        assert found[case].value == pytest.approx(one.value, abs=one.accuracy + 0.02 * one.value), case
        assert one.unit == ("mm" if case.startswith("t") else "mrad")
        assert one.quantity == f"σ of {case.split()[0]}"


@pytest.mark.parametrize(
    ("change", "reason"),
    [({}, ""), ({"mirrors": "still"}, "no errors"), ({"most": 0.05}, "reach the corners")],
)
def test_the_law_of_a_square_needs_angles_with_errors_and_mirrors_that_reach(
    change: dict[str, Any], reason: str
) -> None:
    """Claim: its corners are at 0.05/(1 − D_g/R) rad."""
    told = setting(scan=SCAN | {"horizontal": (-0.04, 0.04), "vertical": (-0.04, 0.04)})
    if change.get("mirrors"):
        told = dataclasses.replace(
            told, scenario=told.scenario.changed(scanner={"mirrors": told.scenario.scanner.mirrors.still()})
        )
    reach = 0.05 / (1.0 - told.closed.D / MIDDLE)
    for share in (1.001, 0.999) if "most" in change else ():
        limited = told.scenario.changed(scanner={"mirrors": {"max_deflection": share * reach}})
        said = targets._posed(dataclasses.replace(told, scenario=limited))
        assert bool(said) == (share < 1.0)
        assert (reason in said) == (share < 1.0)
    if "most" not in change:
        said = targets._posed(told)
        assert (reason in said) if reason else not said


# Light.


def test_sunlight_is_measured_on_a_wall_that_sun_and_scanner_face(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: background and its ratio of one shot straight ahead at each range; one reflection; a wall four times as
    wide as far, no noise."""
    told = setting()
    seen = []

    def measure(_: Any, made: Any, aim: Any) -> dict[str, Array]:
        (wall,) = made.scene.objects
        R = wall.position[2]
        seen.append(R)
        assert wall.size == pytest.approx((4.0 * R, 4.0 * R))
        assert wall.material.reflectance == GREY
        assert made.lighting.sun.direction == (0.0, 0.0, -1.0)
        assert made.transport.background_bounces == 1
        assert not any(value for _, value in made.scanner.position_sensor.noise)
        assert (aim.theta.tolist(), aim.phi.tolist()) == ([0.0], [0.0])
        return {"background": np.array([100.0 * R]), "snr": np.array([7.0 / R])}

    monkeypatch.setattr(test_bench, "measure", measure)
    sun, ratio = light._measure_sun(told), light._measure_ratio(told)
    assert seen == [*RANGES, *RANGES]
    assert sun == {f"{R:.4g} m": Measured("exact", 100.0 * R) for R in RANGES}
    assert ratio == {f"{R:.4g} m": Measured("exact", 7.0 / R) for R in RANGES}


def test_the_law_of_sunlight_needs_a_band_within_the_response_and_room_for_its_window() -> None:
    """Claim: half of the band to each side of its middle; twice 200 µm of pixels."""
    told = setting()
    band = told.closed.band
    assert band is not None
    for share in (0.999, 1.001):
        edges = (band.centre - 0.5 * share * band.width, band.centre + 0.5 * share * band.width)
        for response in ((edges[0], 1.7e-6), (0.9e-6, edges[1])):
            sensor = {"position_sensor": {"response": response}}
            narrow = dataclasses.replace(told, scenario=told.scenario.changed(scanner=sensor))
            assert ("response" in light._filtered(narrow)) == (share < 1.0)
    assert not light._filtered(told)
    none = dataclasses.replace(told, scenario=told.scenario.changed(scanner={"filter": "none"}))
    assert "no filter" in light._filtered(none)


# Speckle.


def test_speckle_errs_by_coherent_less_even_light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of the same directions and seeds, with speckle and without: the difference of ranges in mm, the ratio of
    charges; as many surfaces as are asked for, each with a seed of its own; facing plates that hold the field."""
    told = setting()
    monkeypatch.setattr(speckle, "_separate", lambda *_: (0.02, 3, 5))
    asked = []

    def measure(_: Any, made: Any, aim: Any, seeds: Any) -> dict[str, Array]:
        coherent = made.scanner.laser.speckle
        asked.append((coherent, made.scene.objects[0].position[2], seeds))
        assert len(set(seeds)) == 5
        edge = np.array([-0.02, 0.0, 0.02])
        np.testing.assert_allclose(aim.theta, np.tile(edge, 3), atol=1e-15)
        np.testing.assert_allclose(aim.phi, np.repeat(edge, 3), atol=1e-15)
        size = made.scene.objects[0].size[0]
        R = made.scene.objects[0].position[2]
        assert size == pytest.approx(2.4 * 0.05 * R + 16.0 * made.scanner.laser.radius(R))
        shot = np.arange(9.0)
        return {
            "range_m": R + 5e-4 * shot + (1e-3 * shot**2 if coherent else 0.0),
            "Y": 10.0 + shot + (2.0 if coherent else 0.0) * (10.0 + shot),
        }

    monkeypatch.setattr(test_bench, "measure", measure)
    errors, charges = speckle._shots(told, 1, MIDDLE)
    shot = np.arange(9.0)
    for error, charge in zip(errors, charges, strict=True):
        np.testing.assert_allclose(error, shot**2, atol=1e-9)
        np.testing.assert_allclose(charge, 3.0)
    wheres = [where for where, _ in noise.spots(told, MIDDLE)]
    assert [one[1] for one in asked] == pytest.approx(np.repeat(wheres, 2))
    assert [one[0] for one in asked] == [True, False] * len(wheres)
    assert len({one[2] for one in asked}) == len(wheres)


def test_the_judges_lines_are_of_the_beams_image_through_the_lens(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the image's σ is f w/(2 R), N is f over the aperture, λ the laser's; aberration, diffusion and pitch are
    those of the scenario. As many lines as are asked for, or the most where speckle is hardly averaged."""
    told = setting()
    given: list[Any] = []
    monkeypatch.setattr(speckle, "_lines", lambda *args: given.append(args))
    scanner = told.scenario.scanner
    speckle._seen(told, 20.0)
    ((lens, blur, pitch, image, count),) = given
    along = float(told.closed.array.scale(20.0)[0])
    # The array is all but square to the axis: the focal length, and a little for the rays' slant.
    assert along == pytest.approx(scanner.receiver.focal_length, rel=1e-3)
    assert lens == pytest.approx((scanner.laser.wavelength, along / scanner.receiver.aperture))
    assert blur[0] == pytest.approx(scanner.receiver.aberration, rel=1e-3)
    assert (blur[1], pitch) == (scanner.position_sensor.diffusion, scanner.position_sensor.pitch)
    radius = scanner.laser.waist_radius * math.hypot(
        1.0,
        (20.0 - scanner.laser.waist_distance) * scanner.laser.wavelength * scanner.laser.m_squared
        / (math.pi * scanner.laser.waist_radius**2),
    )  # fmt: skip
    assert image == pytest.approx(0.5 * radius * along / 20.0)
    assert count in (16, speckle._SURFACES)


# Scenes with more than one surface.


def test_shares_of_pulls_are_counted_at_their_bounds() -> None:
    """Claim: what is within 1.96 σ, beyond 3 and beyond 6; the share of hits that have a range; what has no truth is
    left out, and an image without ranges has no shares."""
    pulls = np.array([0.0, 1.9599, -1.96, 2.99, -3.01, 5.99, -6.01, 7.0])
    found = MixedCoverage(pulls, 1.0).shares()
    assert found == pytest.approx((2 / 8, 4 / 8, 2 / 8))
    assert all(math.isnan(one) for one in MixedCoverage(np.array([]), 0.0).shares())

    class Image(dict[str, Any]):
        valid = np.array([True, True, False, True, False])

    image: Any = Image(
        {
            "range_m": np.array([10.2, 9.9, math.nan, 10.0, math.nan]),
            "sigma_range_m": np.array([0.1, 0.05, math.nan, 0.1, math.nan]),
            "truth.range_m": np.array([10.0, 10.0, 10.0, math.nan, math.nan]),
            "truth.object": np.array([1, 2, 1, 0, 0]),
        }
    )
    made = MixedCoverage.of(image)
    np.testing.assert_allclose(made.pulls, [2.0, -2.0])
    assert made.kept == pytest.approx(2 / 3)


def test_scenes_are_drawn_evenly_in_logarithms() -> None:
    """Claim: of 400 scenes ranges and pitches, 0.25 to 2 mrad, are even in logarithms, and 70 % sweep; to 4 standard
    errors of means and of a share."""
    drawn = [MixedScene.drawn("clutter", seed, ranges=(2.0, 8.0)) for seed in range(400)]
    for values, low, high in (
        ([one.distance for one in drawn], 2.0, 8.0),
        ([one.pitch / one.distance for one in drawn], 0.25e-3, 2e-3),
    ):
        place = (np.log(values) - math.log(low)) / math.log(high / low)
        assert 0.0 <= place.min() < 0.02 < 0.98 < place.max() <= 1.0
        assert abs(place.mean() - 0.5) < 4.0 / math.sqrt(12.0 * 400.0)
    sweeps = np.mean([one.motion == "continuous" for one in drawn])
    assert abs(sweeps - 0.7) < 4.0 * math.sqrt(0.21 / 400.0)
    assert {one.tilt for one in drawn} == {math.radians(50.0)}
    one = drawn[0]
    assert one.half == pytest.approx(0.5 * 127.0 * one.pitch / one.distance)


@pytest.mark.parametrize("kind", ["clutter", "glossy", "sunlit", "retro"])
def test_clutter_fills_the_field_before_a_wall(kind: Any) -> None:
    """Claim: twelve boxes and spheres of a tenth to four tenths of the field, within half of it from the middle; a wall
    behind them that leaves a gap above; materials of the kind, turns about three axes."""
    scene = MixedScene(kind, 3, distance=5.0, pitch=8e-3, side=64, speed=0.2)
    made = scene.scenario()
    wide = 63 * 8e-3
    (wall, *items), sun = made.scene.objects, made.lighting.sun
    assert len(items) == 12
    assert wall.size == pytest.approx((1.1 * wide, 0.8 * wide))
    assert wall.position == pytest.approx((0.0, 0.15 * wide, 5.0 + 0.6 * wide))
    assert max(abs(turn.angle) for turn in wall.rotation) <= math.radians(40.0)
    for item in items:
        away = np.array(item.position) - [0.0, 0.0, 5.0]
        assert np.abs(away).max() <= 0.5 * wide
        sizes = [item.diameter] if item.shape == "sphere" else list(item.size)
        assert 0.1 * wide <= min(sizes) <= max(sizes) <= 0.4 * wide
        assert tuple(item.motion.velocity) == (0.2, 0.0, 0.0)
    assert {item.shape for item in items} == {"box", "sphere"}
    assert (sun != "none") == (kind == "sunlit")
    if kind == "sunlit":
        assert sun.direction[2] < 0.0
        assert made.lighting.earth.direction == (0.0, 1.0, 0.0)
    materials = {str(item.material) for item in (wall, *items)}
    if kind == "clutter":
        assert all(item.material.reflectance == 0.5 for item in (wall, *items))
    else:
        assert len(materials) > 1
    assert (made.raster.rows, made.raster.columns) == (64, 64)
    assert made.raster.horizontal == pytest.approx((-0.5 * wide / 5.0, 0.5 * wide / 5.0))
    assert made.raster.vertical == made.raster.horizontal
    assert made.seed == 3


def test_shares_of_glossy_and_retroreflecting_surfaces() -> None:
    """Claim: half of the glossy kind shine, 30 % of the other return light; of 2000 draws to 4 standard errors."""
    random = np.random.default_rng(5)
    shiny = [mixed_scenes._material(random, "glossy") in mixed_scenes._SHINY for _ in range(2000)]
    retro = [mixed_scenes._material(random, "retro") == "retro_sheet" for _ in range(2000)]
    assert abs(np.mean(shiny) - 0.5) < 4.0 * math.sqrt(0.25 / 2000.0)
    assert abs(np.mean(retro) - 0.3) < 4.0 * math.sqrt(0.21 / 2000.0)
    turns = np.array([[turn["angle"] for turn in mixed_scenes._turns(random, 0.5)] for _ in range(300)])
    assert np.abs(turns).max() <= 0.5
    assert (turns.min(axis=0) < -0.45).all()
    assert (turns.max(axis=0) > 0.45).all()
    assert [turn["axis"] for turn in mixed_scenes._turns(random, 0.5)] == ["x", "y", "z"]


def test_uneven_spots_are_measured_in_rasters_of_the_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: middles from 1.6 to 6.4 times the nearest range, voxels one to three radii of the beam apart, stripes of
    1.5 to 11 radii; seed, scene, scan and light are those of what was drawn, the instrument is the scenario's."""
    told = setting(ranging="both", processing={"range_gate": (2.0, 9.0)})
    near = told.scenario.scanner.nearest_range
    assert uneven._ranges(told) == pytest.approx((1.6 * near, 6.4 * near))
    far = 0.9 * told.scenario.scanner.farthest_range
    assert 6.4 * near < far
    seen: list[Any] = []

    def of(image: Any) -> Any:
        return image

    monkeypatch.setattr(uneven.MixedCoverage, "of", of)
    monkeypatch.setattr(uneven, "simulate", lambda scenario, device: seen.append(scenario))
    real = MixedScene.scenario
    drawn: list[Any] = []

    def kept(scene: Any, **changes: Any) -> Any:
        drawn.append(scene)
        return real(scene, **changes)

    monkeypatch.setattr(MixedScene, "scenario", kept)
    for seed in range(12):
        uneven._scene(told, "stripes", seed)
    places = []
    for seed, (made, scene) in enumerate(zip(seen, drawn, strict=True)):
        beam = told.scenario.scanner.laser.radius(scene.distance)
        assert 1.6 * near <= scene.distance <= 6.4 * near
        places.append(math.log(scene.pitch / beam) / math.log(3.0))
        assert scene.widths == pytest.approx((1.5 * beam, 11.0 * beam))
        assert (made.seed, made.scan.rows, scene.side) == (seed, 64, 64)
        assert made.rangefinders == ("triangulation",)
        assert made.processing.range_gate is None
        assert made.scan.horizontal == pytest.approx((-scene.half, scene.half))
        assert len(made.scene.objects) > 1
    assert min(places) >= 0.0
    assert max(places) <= 1.0
    assert max(places) - min(places) > 0.5


def test_kinds_of_scenes_are_judged_by_those_that_have_ranges(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the mean over scenes of the shares, of those with a hundred ranges or more, and of two such at least."""
    told = setting()
    many, few = np.zeros(100), np.zeros(99)
    asked = []

    def scene(_: Any, kind: str, seed: int) -> MixedCoverage:
        asked.append((kind, seed))
        number = len([one for one in asked if one[0] == kind]) - 1
        if kind == "glossy":
            return MixedCoverage(many if number == 0 else few, 1.0)
        pulls = many.copy()
        pulls[: {0: 10, 1: 20}.get(number, 0)] = 4.0
        pulls[:1] = 7.0
        return MixedCoverage(pulls if number < 2 or kind != "stripes" else few, 1.0)

    monkeypatch.setattr(uneven, "_scene", scene)
    found = uneven._measure(told)
    assert {case.split(":")[0] for case in found} == {"clutter", "stripes", "sunlit"}
    assert found["stripes: within 1.96 σ"].value == pytest.approx(0.85)
    assert found["stripes: beyond 3 σ"].value == pytest.approx(0.15)
    assert found["stripes: beyond 6 σ"].value == pytest.approx(0.01)
    # Sixteen scenes, of which 14 have one beyond.
    assert found["clutter: beyond 3 σ"].value == pytest.approx((0.1 + 0.2 + 14 * 0.01) / 16.0)
    assert len({seed for _, seed in asked}) == len(asked) == 64


# Coverage.


def test_voxels_of_a_scene_are_drawn_once_each_in_the_order_of_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of 16 voxels all, of more as many as are wanted, none twice; every seed has random numbers of its own."""
    told = setting()
    monkeypatch.setattr(coverage, "_DRAWN", 10)
    seen: list[Any] = []

    class Made:
        def __init__(self, scenario: Any, *, reuse: Any = None, **_: Any) -> None:
            self.scenario, self.reuse = scenario, reuse

        def measure(self, aim: Any) -> Any:
            seen.append((self.scenario.seed, aim.shot))
            return {"status": np.zeros(aim.shot.size)}

    monkeypatch.setattr(coverage, "Instrument", Made)
    monkeypatch.setattr(
        coverage, "_smooth",
        lambda known, own, aim, layers: (known is told) & np.full(aim.shot.size, own.scenario.seed in (5, 6)),
    )  # fmt: skip
    monkeypatch.setattr(coverage, "_unclipped", lambda own, layers: np.arange(layers["status"].size) > 3)
    found = list(coverage._on_scene(told, (5, 6), "triangulation"))
    assert [seed for seed, _ in seen] == [5, 6]
    for _, shots in seen:
        assert len(set(shots.tolist())) == 10
        assert (np.diff(shots.astype(int)) > 0).all()
        assert shots.max() < 16
    assert not np.array_equal(seen[0][1], seen[1][1])
    assert found[0][1].sum() == 6


@pytest.mark.parametrize(
    ("what", "good"),
    [
        ("plane", True),
        ("bent", False),
        ("hardly bent", True),
        ("steep", False),
        ("less steep", True),
        ("another object", False),
        ("another material", False),
        ("grainy", False),
        ("no range", False),
        ("no truth", False),
    ],
)
def test_smooth_is_what_lies_on_one_plane_of_known_speckle(
    monkeypatch: pytest.MonkeyPatch, what: str, good: bool
) -> None:
    """Claim: beside the axis by the beam's diameter and half of the travel, along both axes, object and material are
    the same, the range bends by less than a fifth of σ and rises by less than tan 60° of it; contrast as assumed."""
    told = setting()
    scanner, R = told.scenario.scanner, np.array([9.0, 9.0])
    apart = 2.0 * scanner.laser.radius(9.0) / 9.0 + 0.5e-3
    sigma = 1e-3
    bend = {"bent": 0.101, "hardly bent": 0.099}.get(what, 0.0) * sigma
    rise = {"steep": 1.001, "less steep": 0.999}.get(what, 0.5) * math.tan(math.radians(60.0)) * apart * 9.0
    status = np.array([0.0, float(Status.BELOW_THRESHOLD) if what == "no range" else 0.0])
    layers = {
        "status": status,
        "truth.range_m": np.array([9.0, math.nan if what == "no truth" else 9.0]),
        "truth.material": np.array([1.0, 2.0]),
        "truth.object": np.array([4.0, 4.0]),
        "sigma_range_m": np.full(2, sigma),
    }
    contrast = np.full(3, told.scenario.processing.speckle_contrast)
    contrast[2] += 1.01e-3 if what == "grainy" else 0.99e-3
    instrument: Any = SimpleNamespace(
        loaded=SimpleNamespace(coherence=SimpleNamespace(numpy=lambda: contrast**2))
    )
    aim: Any = SimpleNamespace(travel_theta=np.array([1e-3, -1e-3]))
    asked = []

    def truth(_: Any, aim: Any, some: Any, axis: str, moved: Array) -> tuple[Array, ...]:
        asked.append((axis, moved))
        np.testing.assert_allclose(np.abs(moved), apart, rtol=1e-6)
        side = np.sign(moved)
        spoilt = (axis == "phi") & (some == 1)
        ranges = R[some] + np.where(spoilt, bend + side * rise, 0.0)
        other = np.where(spoilt & (side > 0.0), 1.0, 0.0)
        return (
            ranges,
            4.0 + (other if what == "another object" else 0.0),
            layers["truth.material"][some] + (other if what == "another material" else 0.0),
        )

    monkeypatch.setattr(coverage, "_truth", truth)
    found = coverage._smooth(told, instrument, aim, layers)
    assert found.tolist() == [True, good]
    assert {axis for axis, _ in asked} == {"theta", "phi"}


def test_a_moved_shot_is_moved_along_one_axis(monkeypatch: pytest.MonkeyPatch) -> None:
    aim = test_bench.directions([0.1, 0.2, 0.3], [0.01, 0.02, 0.03], setting().scenario.scanner.mirrors, 1e-3)
    seen: list[Any] = []

    def expose(moved: Any) -> Any:
        seen.append(moved)
        held = [SimpleNamespace(numpy=lambda n=n: np.array([n, n])) for n in (7.0, 2.0, 3.0)]
        return SimpleNamespace(distance=held[0], object=held[1], material=held[2]), None

    found = coverage._truth(
        SimpleNamespace(expose=expose), aim, np.array([0, 2]), "phi", np.array([1e-3, -1e-3])
    )  # type: ignore[arg-type]
    np.testing.assert_allclose(found, [[7.0, 7.0], [2.0, 2.0], [3.0, 3.0]])
    np.testing.assert_allclose(seen[0].theta, [0.1, 0.3])
    np.testing.assert_allclose(seen[0].phi, [0.011, 0.029])
    assert seen[0].shot.tolist() == [0, 2]


@pytest.mark.parametrize(("height", "kept"), [(0.949, True), (0.951, False)])
def test_echoes_that_may_be_clipped_are_left_out(height: float, kept: bool) -> None:
    """Claim: of time of flight alone, those below 0.95 of the amplifier's saturation, in amperes."""
    unit = SimpleNamespace(
        amperes_per_electron=2e-9, unit=SimpleNamespace(photodiode=SimpleNamespace(saturation=1e-3))
    )
    layers = {"Y": np.array([height * 1e-3 / 2e-9])}
    timed: Any = SimpleNamespace(scenario=SimpleNamespace(rangefinders=("tof",)), time_of_flight=unit)
    assert coverage._unclipped(timed, layers).tolist() == [kept]
    both: Any = SimpleNamespace(scenario=SimpleNamespace(rangefinders=("triangulation", "tof")))
    assert coverage._unclipped(both, layers).tolist() == [True]


@pytest.mark.parametrize(("shots", "reason"), [(160, ""), (159, "159 voxels only")])
def test_a_scene_needs_four_times_the_fewest_voxels(shots: int, reason: str) -> None:
    told: Any = SimpleNamespace(
        scenario=SimpleNamespace(
            scanner=SimpleNamespace(
                mirrors=SimpleNamespace(temperature=SimpleNamespace(rate=0.0, amplitude=0.0))
            ),
            scan=SimpleNamespace(layout="image", shots=shots),
        ),
        own_scene=True,
    )
    said = coverage._surveyed(told)
    assert (reason in said) if reason else not said
    told.scenario.scanner.mirrors.temperature.amplitude = 1.0
    assert "drift" in coverage._surveyed(told)


@pytest.mark.parametrize("peak", ["gaussian", "maximum_likelihood"])
def test_speckle_is_told_by_the_scatter_of_the_estimator_on_the_judges_lines(
    monkeypatch: pytest.MonkeyPatch, peak: Any
) -> None:
    """Claim: lines that are moved by ±0.02 pixel, and brighter by a tenth, scatter by that much of R² pitch/(f d), and
    by 10 % of their charge, whatever the estimator, also where its taps reach beyond the lines. Their kurtosis is 1."""
    told = setting(processing={"peak": peak, "bias_correction": "none"})
    length = speckle._LINE
    moved = np.tile([-0.02, 0.02], 30) * math.sqrt(59.0 / 60.0)
    grown = 1.0 + np.repeat([-0.1, 0.1], 30) * math.sqrt(59.0 / 60.0)

    def lines(_: Any, R: float) -> Array:
        shares = []
        for _, seen in noise.spots(told, R):
            places = length // 2 + seen.phase + moved
            shares.append(
                [g * pixel_shares(p, seen.sigma, length) for p, g in zip(places, grown, strict=True)]
            )
        return np.array(shares)

    monkeypatch.setattr(speckle, "_seen", lines)
    monkeypatch.setattr(speckle, "_ranges", lambda _: RANGES)
    limit, contrast = speckle._predict_limit(told), speckle._predict_contrast(told)
    scanner = told.scenario.scanner
    for R in RANGES:
        # Places lie about the middle of a pixel, which is not quite R.
        squares = [where**4 for where, _ in noise.spots(told, R)]
        per_pixel = math.sqrt(np.mean(squares)) * scanner.position_sensor.pitch
        per_pixel /= scanner.receiver.focal_length * scanner.receiver.baseline
        one, other = limit[f"{R:.4g} m"], contrast[f"{R:.4g} m"]
        assert one.value == pytest.approx(20.0 * per_pixel, rel=0.02)
        assert (one.unit, other.unit) == ("mm", "%")
        assert other.value == pytest.approx(10.0, rel=1e-6)
        # 4 % of the model, 1.5 c² for a contrast of a tenth, and three of a sample of normal numbers.
        wide = math.sqrt(59.0 / 60.0)
        slack = 0.04 + 1.5 * (0.1 * wide) ** 2 + 3.0 * math.sqrt(2.0 / 240.0)
        assert one.accuracy == pytest.approx(slack * one.value, rel=1e-3)


def test_speckles_measured_numbers_are_those_of_the_shots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: σ of ranges in mm and of relative charges in %, root mean square over places; each range is a step."""
    told = setting()
    steps = []
    sign = np.where(np.arange(16) % 2 == 0, 1.0, -1.0) * math.sqrt(15.0 / 16.0)

    def shots(_: Any, step: int, R: float) -> Any:
        steps.append(step)
        return [R * sign + 5.0, 3.0 * R * sign], [1.0 + 0.1 * sign, 1.0 + 0.3 * sign]

    monkeypatch.setattr(speckle, "_shots", shots)
    monkeypatch.setattr(speckle, "_ranges", lambda _: RANGES)
    limit = speckle._measure_limit(told)
    assert [limit[f"{R:.4g} m"].value for R in RANGES] == pytest.approx([R * math.sqrt(5.0) for R in RANGES])
    (slope,) = (value for case, value in limit.items() if not case.endswith(" m"))
    assert slope.value == pytest.approx(1.0)
    contrast = speckle._measure_contrast(told)
    assert [contrast[f"{R:.4g} m"].value for R in RANGES] == pytest.approx([10.0 * math.sqrt(5.0)] * 3)
    assert steps == [0, 1, 2] * 2


def test_the_judges_lines_have_the_light_of_one_surface(device: Device) -> None:
    """Claim: of 60 surfaces behind a small lens the mean charge is that of an even one, 1, to four standard errors of
    its contrast √½/√M, for all places in a pixel; diffusion spreads lines by its square, in pixels."""
    image, lens, pitch = 25e-6, (1.5e-6, 4.0), 50e-6
    sharp, spread = (speckle._lines(lens, (0.0, blur), pitch, image, 60) for blur in (0.0, 40e-6))
    assert sharp.shape == spread.shape == (4, 60, speckle._LINE)
    modes = (math.pi * image / (lens[0] * lens[1])) ** 2
    error = math.sqrt(0.5 / modes / 60.0)
    for lines in (sharp, spread):
        np.testing.assert_allclose(lines.sum(axis=2).mean(axis=1), 1.0, atol=4.0 * error)
    x = np.arange(speckle._LINE) - speckle._LINE // 2

    def width(lines: Array) -> Array:
        mean = lines.mean(axis=1)
        mean = mean / mean.sum(axis=1, keepdims=True)
        middle = mean @ x
        return mean @ x**2 - middle**2

    np.testing.assert_allclose(width(spread) - width(sharp), (40e-6 / pitch) ** 2, rtol=0.02)
    # Places of the spot in its pixel, each a quarter from the next.
    places = sharp.mean(axis=1) / sharp.mean(axis=1).sum(axis=1, keepdims=True) @ x
    np.testing.assert_allclose(np.diff(places), 0.25, atol=0.01)


def test_light_and_width_are_granted_the_lenss_extent() -> None:
    """Claim: the square of the lens over the range of the point, which moves light by itself and a width by twice that,
    and single precision; the range is that of the beam to the wall."""
    told = setting()
    aperture = told.scenario.scanner.receiver.aperture
    width, charge = shape._predict_width(told), shape._predict_charge(told)
    positions = list(shape.field_positions(told, shape.wall_ranges(told)))
    assert len(positions) > 3
    for position in positions:
        extent = (aperture / position.distance) ** 2
        for found, factor in ((width, 2.0), (charge, 1.0)):
            one = found[position.name]
            assert one.accuracy == pytest.approx((factor * extent + shape._PRECISION) * one.value, rel=1e-9)
    lines = [np.eye(60)[20] * 3.0 + np.eye(60)[21]]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shape, "_wall_lines", lambda _: zip(positions[:1], lines, strict=True))
        (found,) = shape._measure_position(told).values()
        sensor = told.scenario.scanner.position_sensor
        # Three quarters on pixel 20 and a quarter on 21: 20.25, whose middle is half a pixel further.
        assert found.value == pytest.approx(1e3 * (sensor.offset + 20.75 * sensor.pitch))
    assert shape._width(np.array([1.0, 0.0, 1.0])) == pytest.approx(math.sqrt(1.0 - 1.0 / 12.0))


def test_noise_is_measured_straight_ahead_at_even_places_in_a_pixel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: σ in mm, root mean square over four places, with the named noise alone; R² of it has the exponent 2."""
    told = setting()
    monkeypatch.setattr(noise, "_usable", lambda *_: RANGES)
    asked = []

    def errors(_: Any, made: Any, aim: Any) -> Array:
        (plate,) = made.scene.objects
        asked.append(plate.position[2])
        assert {name for name, value in made.scanner.position_sensor.noise if value} == {"shot", "read"}
        assert not aim.theta.any()
        assert not aim.phi.any()
        assert aim.theta.size == 16
        assert plate.material.reflectance == GREY
        # A plate that holds the beam eight radii to each side.
        assert plate.size[0] > 16.0 * made.scanner.laser.radius(plate.position[2])
        sign = np.where(np.arange(16) % 2 == 0, 1.0, -1.0) * math.sqrt(15.0 / 16.0)
        R = min(RANGES, key=lambda one: abs(math.log(one / plate.position[2])))
        return 1e-3 * R**2 * (1.0 + 2.0 * ((len(asked) - 1) % 4 == 0)) * sign + 0.5

    monkeypatch.setattr(test_bench, "range_errors", errors)
    found = noise._measure_sigma(
        told, number=3, noise=("shot", "read"), variance=lambda *_: 0.0, peak=None, slope=True  # type: ignore[arg-type, return-value]
    )  # fmt: skip
    # Three times as much at one of four places: √((9 + 3)/4).
    assert [found[f"{R:.4g} m"].value for R in RANGES] == pytest.approx(
        [math.sqrt(3.0) * R**2 for R in RANGES]
    )
    assert found[noise.SLOPE].value == pytest.approx(2.0)
    assert asked == pytest.approx([where for R in RANGES for where, _ in noise.spots(told, R)])
