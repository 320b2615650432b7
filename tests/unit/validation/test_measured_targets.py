"""What laws of targets ask of the instrument, and what they make of errors that are known."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import claims
import numpy as np
import pytest
from made_settings import MIDDLE, SCAN, Array, setting
from scipy.linalg import hadamard

from scanner_sim.analytic import geometry
from scanner_sim.scan.lissajous import LissajousPattern
from scanner_sim.validation.compare import (
    targets,
    test_bench,
)


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


@pytest.mark.parametrize("kind", ["lissajous", "track"])
def test_the_disc_is_under_the_figure_of_the_scan(kind: str) -> None:
    """Claim: a scan of figures, in the open loop or about targets, is judged by its own: a disc of 0.625 of its
    amplitude, met by so many points; one without figures by the shipped one of 6 mrad."""
    own = {"ratio": "5:4", "points": 640, "amplitude": 0.012}
    board = {"name": "board", "position": (0.0, 0.0, 4.0), "array": {"diameter": 0.1, "plate": 0.4}}
    targeted = {"targets": ["board"]} if kind == "track" else {}
    told = setting(scan={"type": kind, "pattern": own, **targeted}, scene={"objects": [board]})
    position, _ = targets._figure(targets._pattern(told), 2)
    assert position.shape == (2, 640, 2)
    assert np.abs(position).max() == pytest.approx(0.012, rel=1e-3)
    assert targets._disc(told)[0] == pytest.approx(0.0075)
    assert targets._disc(setting())[0] == pytest.approx(0.625 * 6e-3)


@pytest.mark.parametrize(("points", "patterns"), [(128, 3200), (2048, 512), (65536, 32)])
def test_long_figures_are_fitted_less_often(
    monkeypatch: pytest.MonkeyPatch, points: int, patterns: int
) -> None:
    """Claim: 3200 patterns, or as many as have 2²⁰ points together, and never fewer than 32."""
    asked: list[int] = []

    def stop(number: int) -> int:
        asked.append(number)
        raise StopIteration

    known = setting()
    told: Any = SimpleNamespace(scenario=known.scenario, middle=known.middle, flat=known.flat, shots=stop)
    monkeypatch.setattr(targets, "_pattern", lambda _: LissajousPattern(points=points))
    with pytest.raises(StopIteration):
        targets._measure_centre(told)
    assert asked == [patterns]


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
