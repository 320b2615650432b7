"""What the errors of a cloud's points have in common, and what a bar's length makes of two fits: by closed forms."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import SHARP
from scipy.spatial.transform import Rotation

from scanner_sim import Scenario, load_scenario
from scanner_sim.acceptance import measured
from scanner_sim.acceptance.measured import (
    _cloud,
    _grain,
    _of_mirrors,
    _of_pixels,
    _root,
    _sight,
    _voxels,
    _without,
)
from scanner_sim.acceptance.plan import Ball, LengthBar, Plate
from scanner_sim.acceptance.setup import Surface, on_plate
from scanner_sim.acceptance.shapes import Fit
from scanner_sim.acceptance.verdicts import COVERAGE, Verdict, _length, _results
from scanner_sim.analytic import geometry as judge
from scanner_sim.config.calibration import calibration_text, design_of
from scanner_sim.config.scanner import speckle_optics
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.closed_loop.visit_errors import range_variances
from scanner_sim.optics.deflection import wobble_correlation
from scanner_sim.optics.speckle import packets_of
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.render.device import Device
from scanner_sim.tracking.errors import pixel_correlation

Array = NDArray[np.float64]

ROWS, COLUMNS = 5, 4


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """An instrument in front of a wall."""
    return load_scenario(
        {
            "schema": 1,
            "scene": {"objects": []},
            "scan": {
                "type": "raster", "rows": ROWS, "columns": COLUMNS, "horizontal": (-0.1, 0.06),
                "vertical": (-0.03, 0.09), "motion": "stepped",
            },
        }
    )  # fmt: skip


def points_of(scenario: Scenario) -> tuple[Array, Array, Array, Array]:
    """Return points of all voxels, and their R, Θ and φ."""
    theta, phi = (angles.ravel() for angles in np.meshgrid(*scenario.raster.angles()))
    r = 3.0 + 0.1 * np.arange(theta.size)
    return judge.point_from_shot(r, theta, phi, scenario.scanner.mirrors.axis_separation), r, theta, phi


@pytest.mark.parametrize("way", ["triangulation", "tof"])
def test_the_mirrors_wobble_moves_points_at_a_fixed_reading(scenario: Scenario, way: str) -> None:
    """Claim: two points share σ² a a'ᵀ ρ(Δφ) ρ(Δt) + σ² b b'ᵀ ρ(ΔΘ) ρ(Δt), a and b their derivatives by Θ and φ at a
    fixed spot on the sensor, or a fixed way of the pulse, where the range does not go by Θ.

    Tolerance: 3e-3 of the variance, for parts below a thousandth of the largest are left out.
    """
    scenario = scenario.replace({"ranging": way})
    mirrors = scenario.scanner.mirrors
    points, r, theta, phi = points_of(scenario)
    valid = np.ones((ROWS, COLUMNS), dtype=bool)
    valid[1, 2] = False
    kept = valid.ravel()
    points, r, theta, phi = points[kept], r[kept], theta[kept], phi[kept]
    receiver, separation = scenario.scanner.receiver, mirrors.axis_separation
    f, d = receiver.focal_length, receiver.baseline
    slopes = judge.shot_jacobian(r, theta, phi, f, d, separation)[:, :3]
    if way == "tof":
        slopes[:, :, 1] = judge.scanner_axes(theta, phi)[1] * r[:, None]
    moved = _of_mirrors(scenario, valid, points, r)
    found = np.einsum("aik,bjk->abij", moved, moved) / mirrors.wobble**2
    time = np.repeat((np.arange(ROWS) + 0.5) * COLUMNS * scenario.scanner.dwell, COLUMNS)[kept]
    together = wobble_correlation((time[:, None] - time) / mirrors.wobble_time)
    wanted = np.zeros_like(found)
    for column, angle in ((1, phi), (2, theta)):
        other = wobble_correlation((angle[:, None] - angle) / mirrors.wobble_angle)
        both = np.einsum("ai,bj->abij", slopes[..., column], slopes[..., column])
        wanted += (together * other)[..., None, None] * both
    np.testing.assert_allclose(found, wanted, atol=3e-3 * (r**2).max())


@pytest.mark.parametrize("peak", ["maximum_likelihood", "gaussian"])
def test_unlike_pixels_are_shared_by_images_on_the_same_pixels(
    device: Device, scenario: Scenario, peak: Any
) -> None:
    """Claim: along their beams two points share σ σ' ρ(Δ/s), ρ that of images by unlike pixels, s one width of all; σ
    that of the estimator."""
    scenario = scenario.replace({"processing.peak": peak})
    points, r, theta, _ = points_of(scenario)
    place = 40.0 + 0.31 * np.arange(len(r))
    signal = np.full(len(r), 2e4)
    moved = _of_pixels(scenario, points, r, signal, place)
    along = points / np.linalg.norm(points, axis=1)[:, None]
    told = np.einsum("aik,ai->ak", moved, along)
    np.testing.assert_allclose(moved, told[:, None] * along[:, :, None], atol=1e-12)
    scanner = scenario.scanner
    grain = _grain(scenario, float(np.median(r)))
    _, variance, widths = range_variances(scanner, peak, r, theta, signal, grain)
    width = float(np.median(widths))
    wanted = np.sqrt(variance[:, None] * variance) * pixel_correlation((place[:, None] - place) / width)
    np.testing.assert_allclose(told @ told.T, wanted, atol=1e-4 * variance.max())


def test_the_grain_is_that_of_a_resting_spot(scenario: Scenario) -> None:
    """Claim: V = C² times the energy's share and the ratio's fourth power of the packets of the spot's image alone."""
    scanner, distance = scenario.scanner, 3.7
    beam = 0.5 * scanner.laser.radius(distance) * scanner.receiver.focal_length / distance
    variance = (beam / scanner.position_sensor.pitch) ** 2
    light = packets_of(speckle_optics(scanner), variance, variance, SHARP)
    wanted = scenario.processing.speckle_contrast**2 * light.energy * light.ratio**4
    assert float(_grain(scenario, distance)[0]) == pytest.approx(float(wanted), rel=1e-9)


def test_a_point_is_seen_along_its_beam(scenario: Scenario) -> None:
    """Claim: axes are those into which Θ, φ and R move a point; the spot is half of the beam's 1/e² radius."""
    points, r, theta, phi = points_of(scenario)
    separation, step = scenario.scanner.mirrors.axis_separation, 1e-6
    sight = _sight(scenario, points, r)

    def moved(d_r: float, d_theta: float, d_phi: float) -> Array:
        there, before = (
            judge.point_from_shot(r + sign * d_r, theta + sign * d_theta, phi + sign * d_phi, separation)
            for sign in (1.0, -1.0)
        )
        return np.asarray((there - before) / np.linalg.norm(there - before, axis=1)[:, None])

    wanted = np.stack([moved(0.0, step, 0.0), moved(0.0, 0.0, step), moved(step, 0.0, 0.0)], axis=1)
    np.testing.assert_allclose(sight.axes, wanted, atol=1e-8)
    radius = np.array([scenario.scanner.laser.radius(float(one)) for one in r])
    np.testing.assert_allclose(sight.spot, 0.5 * radius, rtol=1e-12)
    np.testing.assert_allclose(sight.theta, theta, atol=1e-12)
    assert sight.baseline == scenario.scanner.receiver.baseline


@pytest.mark.parametrize("uncertain", [(), ("base",), ("base", "phi_zero")])
def test_a_cloud_holds_the_covariance_of_its_channels(
    scenario: Scenario, uncertain: tuple[str, ...], tmp_path: Path
) -> None:
    """Claim: what is each point's own, what is shared and what the calibration's errors have in common add up to the
    channels' covariance; invalid voxels are out."""
    if uncertain:
        spread = np.zeros((len(NAMES), len(NAMES)))
        for name in uncertain:
            spread[INDEX[name], INDEX[name]] = 1e-10
        known = Calibration(np.zeros(len(NAMES)), spread, design_of(scenario.scanner))
        path = tmp_path / "calibration.yaml"
        path.write_text(calibration_text(known, scenario.scanner), encoding="utf-8")
        scenario = scenario.replace({"processing.calibration": str(path)})
    points, r, _, _ = points_of(scenario)
    root = np.random.default_rng(2).normal(size=(len(r), 3, 3)) * 1e-3
    covariance = root @ np.swapaxes(root, 1, 2) + 1e-5 * np.eye(3)
    shape = (ROWS, COLUMNS)
    status = np.zeros(shape)
    status[2, 1] = Status.BELOW_THRESHOLD
    channels: dict[str, Array] = {"status": status, "range_m": r.reshape(shape)}
    for axis, name in enumerate("xyz"):
        channels[f"P.{name.upper()}"] = points[:, axis].reshape(shape)
        channels[f"sigma_{name}_m"] = np.sqrt(covariance[:, axis, axis]).reshape(shape)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        channels[f"cov_{'xyz'[one]}{'xyz'[other]}_m2"] = covariance[:, one, other].reshape(shape)
    channels["sigma_texture_m"] = np.linspace(1e-4, 2e-4, len(r)).reshape(shape)
    channels["Y"], channels["peak_px"] = np.full(shape, 2e4), 50.0 + 0.2 * np.arange(len(r)).reshape(shape)
    image: Any = SimpleNamespace(channels=channels)
    cloud = _cloud(scenario, image)
    kept = np.arange(len(r)) != 2 * COLUMNS + 1
    np.testing.assert_array_equal(cloud.points, points[kept])
    assert [cloud.common[:, :, one].any() for one in range(cloud.common.shape[2])] == [True] * len(uncertain)
    together = np.concatenate([cloud.shared, cloud.common], axis=2)
    told = cloud.covariance + together @ np.swapaxes(together, 1, 2)
    np.testing.assert_allclose(told, covariance[kept], atol=1e-12)
    np.testing.assert_allclose(cloud.uneven, channels["sigma_texture_m"].ravel()[kept] ** 2)


def test_what_is_left_of_a_covariance_is_none_that_is_negative() -> None:
    """Claim: C − S Sᵀ where that is a covariance, and without its negative variances elsewhere."""
    turn = Rotation.from_rotvec([0.3, 0.5, -0.2]).as_matrix()
    whole = turn @ np.diag([4.0, 3.0, 2.0]) @ turn.T
    shared = turn @ np.diag([1.0, 1.5, 2.0])
    found = _without(whole[None], shared[None])[0]
    np.testing.assert_allclose(found, turn @ np.diag([3.0, 0.75, 0.0]) @ turn.T, atol=1e-12)


def surface(**changes: Any) -> Surface:
    made: dict[str, Any] = {
        "name": "one", "artefact": 0, "is_plate": True, "horizontal": (-0.1, 0.1), "vertical": (-0.05, 0.1),
        "nearest": 2.0, "farthest": 3.0, "extent": 0.3, "spot": 4e-3,
    }  # fmt: skip
    return Surface(**made | changes)


def test_spots_of_a_scan_do_not_overlap() -> None:
    """Claim: over 0.15 rad at 2 m spots of 4 mm stand 75 times side by side; no more than the plan allows."""
    assert _voxels(surface(), (-0.05, 0.1001), 200) == 76
    assert _voxels(surface(), (-0.05, 0.1001), 40) == 40


@pytest.mark.parametrize(("share", "inside"), [(0.999, True), (1.001, False)])
def test_a_plate_is_cut_out_two_spots_within_its_edges(share: float, inside: bool) -> None:
    """Claim: in the plate's own axes |x| ≤ ½ width − 2 spots and |y| ≤ ½ height − 2 spots, wherever it is turned."""
    turn = {"axis": (0.0, 0.6, 0.8), "angle": 0.7}
    plate = Plate(name="plate", position=(0.3, -0.2, 2.5), size=(0.5, 0.3), rotation=turn)
    matrix = Rotation.from_rotvec(0.7 * np.array([0.0, 0.6, 0.8])).as_matrix()
    x, y = 0.25 - 2.0 * 4e-3, 0.15 - 2.0 * 4e-3
    local = np.array([[share * x, 0.9 * y, 0.05], [-share * x, y * 0.1, 0.0], [0.5 * x, -share * y, 0.0]])
    found = on_plate(plate, surface(), local @ matrix.T + [0.3, -0.2, 2.5])
    assert found.tolist() == [inside] * 3


def fit(parameters: Array, seed: int, kinds: Array) -> Fit:
    """Return a fit with full covariances."""
    roots = np.random.default_rng(seed).normal(size=(2, len(parameters), len(parameters))) * 1e-4
    covariance, noise = roots @ np.swapaxes(roots, 1, 2)
    none = np.zeros((0, 3))
    return Fit(parameters, covariance, noise, kinds, none, none[:, 0], none[:, 0] > 0.0, 3e-4, 2e-4, 5e-5)


def test_a_bars_length_has_the_errors_of_both_of_its_ends() -> None:
    """Claim: the variance of |c₂ − c₁| is g₁ᵀ C₁ g₁ + g₂ᵀ C₂ g₂ + |K₁ᵀ g₁ + K₂ᵀ g₂|², g by differences."""
    ends = np.array([[-0.3, 0.1, 2.0, 0.12], [0.4, -0.2, 2.4, 0.12]])
    kinds = np.random.default_rng(9).normal(size=(2, 4, 3)) * 1e-4
    fits = [fit(one, number, own) for number, (one, own) in enumerate(zip(ends, kinds, strict=True))]
    length, certified, (stated, noise, shared, form) = _length(fits[0], fits[1], 0.8)

    def apart(moved: Array) -> float:
        first, second = (ends + moved.reshape(2, 4))[:, :3]
        return math.dist(first, second)

    slope = np.array([(apart(h) - apart(-h)) / 2e-6 for h in 1e-6 * np.eye(8)]).reshape(2, 4)
    assert (length, certified) == (pytest.approx(apart(np.zeros(8))), 0.8)
    both = sum(g @ own.noise @ g for g, own in zip(slope, fits, strict=True))
    assert noise == pytest.approx(math.sqrt(both), rel=1e-6)
    common = sum(g @ own for g, own in zip(slope, kinds, strict=True))
    assert shared == pytest.approx(np.linalg.norm(common), rel=1e-6)
    both = sum(g @ own.covariance @ g for g, own in zip(slope, fits, strict=True))
    assert stated == pytest.approx(math.sqrt(both + common @ common), rel=1e-6)
    assert math.isnan(form)


def setup_of(one: Any, **zone: float | None) -> Any:
    """Return a test of one artefact."""
    limits = SimpleNamespace(**{"length": None, "size": None, "form": None, "flatness": None, **zone})
    plan = SimpleNamespace(artefacts={"one": one}, rule="guarded")
    return SimpleNamespace(plan=plan, zone_of=lambda _number: limits)


def test_a_ball_is_judged_by_its_diameter_and_its_form() -> None:
    """Claim: the size's error is the diameter's, its σ the fourth of the fit; the form is judged as it is, each with
    k u of its own certificate."""
    ball = Ball(name="ball", position=(0.0, 0.0, 2.0), diameter=0.15, sigma=2e-5, sigma_form=7e-6)
    kinds = np.random.default_rng(4).normal(size=(4, 2)) * 1e-5
    own = fit(np.array([0.0, 0.0, 2.0, 0.1502]), 3, kinds)
    size, form = _results(setup_of(ball, size=1e-3, form=2.5e-4), 0, 2, (own,))
    assert (size.quantity, size.artefact, size.repetition) == ("size", "ball", 2)
    assert size.error == pytest.approx(2e-4)
    assert size.sigma == pytest.approx(math.sqrt(own.covariance[3, 3] + kinds[3] @ kinds[3]))
    assert size.sigma_noise == pytest.approx(math.sqrt(own.noise[3, 3]))
    assert size.sigma_common == pytest.approx(np.linalg.norm(kinds[3]))
    assert (form.sigma, form.expected) == (5e-5, 2e-4)
    assert size.uncertainty == pytest.approx(COVERAGE * 2e-5)
    assert (form.error, form.uncertainty) == (pytest.approx(3e-4), pytest.approx(COVERAGE * 7e-6))
    assert [size.verdict, form.verdict] == [Verdict.PASSES, Verdict.FAILS]
    assert not _results(setup_of(ball), 0, 1, (own,))


def test_a_bars_limit_grows_with_its_length() -> None:
    """Claim: the limit of a length is a + L/K of the certified one."""
    bar = LengthBar(
        name="bar", position=(0.0, 0.0, 2.0), direction=(1.0, 0.0, 0.0), length=0.8, diameter=0.1, sigma=1e-5
    )
    fits = tuple(fit(np.array([x, 0.0, 2.0, 0.1]), 1, np.zeros((4, 0))) for x in (-0.4, 0.4005))
    (found,) = _results(setup_of(bar, length=1e-4, length_ratio=5e-4), 0, 1, fits)
    assert found.limit == pytest.approx(1e-4 + 5e-4 * 0.8)
    assert found.error == pytest.approx(5e-4)
    assert found.verdict is Verdict.UNDECIDED


def test_surfaces_are_scanned_in_turn_with_seeds_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: each surface as often as the plan says, all with other random numbers, which follow from the plan's seed;
    each is told of when it is done."""
    surfaces = ("a", "b", "c")
    seen: list[Any] = []

    def many(scenarios: Any, device: str) -> Any:
        made = list(scenarios)
        seen.append([seed for _, seed in made])
        return [f"image of {name}" for name, _ in made]

    monkeypatch.setattr(
        measured, "_scenario", lambda _, name: SimpleNamespace(replace=lambda change: (name, change["seed"]))
    )
    monkeypatch.setattr(measured, "simulate_many", many)
    monkeypatch.setattr(measured, "_cloud", lambda scenario, image: f"cloud of {image}")

    def scanned(seed: int) -> list[Any]:
        setup: Any = SimpleNamespace(surfaces=surfaces, plan=SimpleNamespace(seed=seed, repetitions=4))
        return list(measured.measured_clouds(setup, progress=lambda *done: told.append(done)))

    told: list[tuple[int, int]] = []
    found = scanned(5)
    assert [surface for surface, _ in found] == ["a", "b", "c"]
    assert [clouds for _, clouds in found] == [(f"cloud of image of {name}",) * 4 for name in surfaces]
    assert told == [(1, 3), (2, 3), (3, 3)]
    assert len({seed for own in seen for seed in own}) == 12
    before = list(seen)
    seen.clear()
    scanned(5)
    assert seen == before
    seen.clear()
    scanned(6)
    assert seen != before


def test_a_root_is_of_the_correlation_without_its_faint_parts() -> None:
    """Claim: A Aᵀ is the correlation less what is fainter than a thousandth of its largest part, whatever its size."""
    axes = np.linalg.qr(np.random.default_rng(3).normal(size=(5, 5)))[0]
    values = np.array([4.0, 1.0, 2.0 * 4e-3, 0.5 * 4e-3, 1e-9])
    for size in (1.0, 300.0):
        root = _root((axes * size * values) @ axes.T)
        assert root.shape == (5, 3)
        kept = (axes[:, :3] * size * values[:3]) @ axes[:, :3].T
        np.testing.assert_allclose(root @ root.T, kept, atol=1e-12 * size)
