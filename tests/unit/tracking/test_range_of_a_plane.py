"""Which voxels tell the range of a target's plane, and what errs with it, each by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.tracking import measurement
from scanner_sim.tracking.centroid import Centroid, centroid_of, hit_centroid
from scanner_sim.tracking.measurement import TargetAppearance, _covariance, _Seeing
from scanner_sim.tracking.response import Response, TargetKind
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.target_ranges import Ranges

Array = NDArray[np.float64]

DISC, SPOT, STEP = 4e-3, 3e-4, 2e-4


def centroid(radius: float = DISC, centre: tuple[float, float] = (0.01, -0.02)) -> Centroid:
    one = np.ones(1)
    covariance = np.array([[[4.0, 1.0], [1.0, 2.0]]]) * 1e-10
    return Centroid(np.array([centre]), covariance, radius * one, 1e-5 * one, one, one > 0.0)


def row(theta: Array, phi: float = -0.02) -> PatternSamples:
    """Return one pattern of voxels along Θ."""
    one = np.ones((1, len(theta)))
    return PatternSamples(
        50e-6 * np.arange(len(theta))[None], theta[None], phi * one, one, 0.1 * one, 5.0 * one, 1e-3 * one,
        np.zeros(one.shape, np.uint8),
    )  # fmt: skip


def response(samples: PatternSamples, hit: NDArray[np.bool_]) -> Response:
    one, used = np.ones(1), samples.theta < np.inf
    return Response(
        samples.signal, samples.signal, used, hit, one, one, 2.0 * one, 0.5 * one, one > 0.0, ~used
    )


@pytest.mark.parametrize("duty_cycle", [1.0, 0.4])
def test_a_spot_is_away_from_the_rim_by_its_blur_and_half_its_way(duty_cycle: float) -> None:
    """Claim: of voxels 0.2 mrad apart those count whose middle is farther from the circle than the blur and half of the
    way that the beam goes with light, inside and outside, on either side of the middle."""
    limit = SPOT + 0.5 * duty_cycle * STEP
    for side in (-1.0, 1.0):
        for rim in (-1.0, 1.0):
            for share, away in ((0.995, False), (1.005, True)):
                place = 0.01 + side * (DISC + rim * share * limit)
                found = centroid().away_from_rim(
                    row(place + STEP * np.arange(-4.0, 5.0)), np.array([[SPOT]]), duty_cycle
                )
                assert bool(found[0, 4]) is away


@pytest.mark.parametrize(("gap", "enough"), [(0, True), (16, True), (17, False)])
def test_a_dozen_voxels_away_from_the_rim_tell_the_range(gap: int, enough: bool) -> None:
    """Claim: of 28 voxels that are, twelve at least must count; else all that count tell the range, and those at the
    rim with them."""
    away = np.arange(40) >= 12
    samples = row(np.where(away, 0.01, 0.01 + DISC + 0.8 * SPOT))
    used, hit = np.ones((1, 40), dtype=bool), np.arange(40)[None] % 3 > 0
    used[0, 12 : 12 + gap] = False
    seen = replace(response(samples, hit & used), used=used)
    for kind in (TargetKind.WHITE, TargetKind.RETRO):
        look = _Seeing(
            samples, seen, TargetAppearance(kind=kind, diameter=0.04), np.array(SPOT / 3.0), 1.0, 0.0, None
        )
        found = look._ranged(samples, centroid(), np.array([DISC]))
        only = away[None] if enough else np.ones((1, 40), dtype=bool)
        np.testing.assert_array_equal(found.used, used & only)
        np.testing.assert_array_equal(found.hit, hit & used & only)


@pytest.mark.parametrize("leans", [True, False])
def test_a_range_errs_with_its_plane_and_with_the_centre_on_it(leans: bool) -> None:
    """Claim: J C Jᵀ for R = R₀ + g₀·(c − a) + g·δ, of the errors of R₀ and the fitted slopes g₀, and of the centre's δ
    on a plane of the slope g; without a plane the centre moves no range. Unknown ranges have no variance."""
    random = np.random.default_rng(4)
    root = random.normal(size=(2, 3, 3))
    fitted = root @ root.transpose(0, 2, 1)
    about = np.array([[0.3, -0.2], [0.1, 0.4]])
    at, known = np.array([5.0, 6.0]), np.array([True, False])
    ranges = Ranges(about, at, np.zeros((2, 2)), fitted, np.zeros((2, 3, 1)), known)
    two = np.ones(2)
    spread = np.array([[[4.0, 1.0], [1.0, 2.0]]] * 2)
    centre = Centroid(about + np.array([[0.5, -0.7], [0.2, 0.1]]), spread, two, two, two, two > 0.0)
    slope = np.array([[3.0, -2.0], [1.0, 5.0]])
    sight: Any = SimpleNamespace(plane=SimpleNamespace(slope=slope)) if leans else None
    found = _covariance(centre, ranges, sight)
    g = slope[0] if leans else np.zeros(2)
    change = np.array([[1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0], [*g, 1.0, 0.5, -0.7]])
    whole = np.zeros((5, 5))
    whole[:2, :2], whole[2:, 2:] = spread[0], fitted[0]
    np.testing.assert_allclose(found[0], change @ whole @ change.T, rtol=1e-12)
    assert np.isnan(found[1, 2, 2])
    np.testing.assert_array_equal(found[1, :2, :2], spread[1])


def test_a_spot_on_a_lean_is_told_with_its_size_and_base(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: slopes are those on the surface, ∂R/R∂Θ and ∂R/((R cosΘ − D_g) ∂φ), the spot is as wide as its angle makes
    it there, and the base is the instrument's; as much is taken off as triangulation has of the range, and none where
    no range is known or nothing triangulates."""
    asked: list[Any] = []
    monkeypatch.setattr(measurement, "spot_shift", lambda *given: asked.append(given) or np.array([7.0, 8.0]))
    ranges = Ranges(
        np.array([[0.2, 0.1], [0.3, 0.1]]), np.array([5.0, 6.0]), np.array([[2.0, 3.0], [4.0, 5.0]]),
        np.zeros((2, 3, 3)), np.zeros((2, 3, 1)), np.array([True, False]),
    )  # fmt: skip
    nothing: Any = None
    looks = TargetAppearance(kind=TargetKind.BLACK, diameter=0.1)
    for by_line, wanted in ((None, [0.0, 0.0]), (np.array([0.5, 0.25]), [3.5, 0.0])):
        seen = _Seeing(nothing, nothing, looks, np.array(1e-3), 1.0, 0.0, by_line)
        assert seen._spot_shift(ranges, (0.05, 0.25)).tolist() == wanted
    ((reach, theta, base, slopes, width),) = asked
    assert (reach[0], base) == (5.0, 0.25)
    assert theta.tolist() == [0.2, 0.3]
    assert slopes[0][0] == pytest.approx(2.0 / 5.0)
    assert slopes[1][0] == pytest.approx(3.0 / (5.0 * np.cos(0.2) - 0.05))
    assert width[0] == pytest.approx(5e-3)


def test_a_mean_of_hits_is_as_rough_as_its_crossings() -> None:
    """Claim: centre, √2 of the rms distance, Σ (x_k − c)²/(12 n²) of the middles of gaps in which the edge lies and a
    tenth of the radius; the radius is known to a tenth of itself. By loops."""
    random = np.random.default_rng(5)
    theta, phi = random.normal(0.0, 1e-2, (2, 30))
    samples = row(theta)
    samples.phi[:] = phi
    hit = random.random(30) < 0.5
    found = hit_centroid(samples, response(samples, hit[None]))
    points = np.stack([theta, phi])
    middle = points[:, hit].mean(axis=1)
    radius = np.sqrt(2.0 * np.mean(np.sum((points[:, hit] - middle[:, None]) ** 2, axis=0)))
    spread = (0.1 * radius) ** 2 * np.eye(2)
    for k in range(29):
        if hit[k] != hit[k + 1]:
            off = 0.5 * (points[:, k] + points[:, k + 1]) - middle
            spread += np.outer(off, off) / (12.0 * hit.sum() ** 2)
    np.testing.assert_allclose(found.centre[0], middle, rtol=1e-12)
    np.testing.assert_allclose(found.covariance[0], spread, rtol=1e-9)
    assert found.radius[0] == pytest.approx(radius, rel=1e-12)
    assert found.sigma_radius[0] == pytest.approx(0.1 * radius, rel=1e-12)
    assert np.isnan(found.misfit[0])


def test_what_was_not_found_is_no_number_and_moves_nothing() -> None:
    """Claim: the second of two patterns is not found, and a third knows its place to no angle: theirs are not numbers,
    their gains are 0, and the first keeps all that it has."""
    spread = np.array([1e-2 * np.eye(2), 1e-2 * np.eye(2), 2e4 * np.eye(2)])
    one, gains = np.array([2.0, 3.0, 4.0]), np.arange(12.0).reshape(3, 2, 2) + 1.0
    centre = np.arange(6.0).reshape(3, 2)
    found = centroid_of(centre, spread, one, 0.1 * one, 0.5 * one, np.array([True, False, True]), gains)
    assert found.found.tolist() == [True, False, False]
    kept = found.found
    for name, value in (
        ("centre", centre), ("covariance", spread), ("radius", one), ("sigma_radius", 0.1 * one), ("misfit", 0.5 * one),
    ):  # fmt: skip
        np.testing.assert_array_equal(getattr(found, name)[kept], value[kept])
        assert np.isnan(getattr(found, name)[~kept]).all()
    np.testing.assert_array_equal(found.gains, np.where(kept[:, None, None], gains, 0.0))


def test_a_gate_lies_about_the_expected_range_by_the_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: nearest and farthest range of target and ground are a depth from where it is expected, by pattern."""

    class AskedError(Exception):
        pass

    asked: list[Any] = []

    def told(samples: Any, kind: TargetKind, gate: Array) -> Any:
        asked.append((kind, np.asarray(gate)))
        raise AskedError

    monkeypatch.setattr(measurement, "target_response", told)
    samples = PatternSamples(*[np.ones((2, 9))] * 7, np.zeros((2, 9), np.uint8))
    looks = TargetAppearance(kind=TargetKind.WHITE, diameter=0.1, depth=0.35)
    for expected in (5.0, np.array([5.0, 7.0])):
        with pytest.raises(AskedError):
            measurement.measure_target(samples, looks, expected, spot=SPOT, axis_separation=0.05)
    for (kind, gate), middle in zip(asked, ([5.0, 5.0], [5.0, 7.0]), strict=True):
        assert kind is TargetKind.WHITE
        np.testing.assert_allclose(gate, np.array(middle)[:, None] + [-0.35, 0.35])


@pytest.mark.parametrize("kind", list(TargetKind))
def test_values_at_an_edge_tell_how_much_of_the_spot_is_on_it(kind: TargetKind) -> None:
    """Claim: light does, and the range does not. A disc is believed whatever the pattern of black and white discs whose
    light has no gaps: that of a retro-reflector may be clipped."""
    nothing: Any = None
    believed = kind in (TargetKind.BLACK, TargetKind.WHITE)
    for duty_cycle in (1.0, 0.6):
        seen = _Seeing(
            nothing, nothing, TargetAppearance(kind=kind, diameter=0.1), np.array(SPOT), duty_cycle, 0.0, None
        )
        assert seen.is_graded is (believed or kind is TargetKind.RETRO)
        assert seen.fits is (believed and duty_cycle == 1.0)
