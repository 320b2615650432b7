"""Places of targets from made-up voxels: levels, ranges of planes and spheres, what counts, and their covariance."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.analytic import tracking as judge
from scanner_sim.foundation.status import Status
from scanner_sim.ranging.coordinates import angles_and_range, coordinates
from scanner_sim.scan.lissajous import LissajousPattern, figure_angles, figures
from scanner_sim.tracking import measurement
from scanner_sim.tracking.disc_fit import disc_fit
from scanner_sim.tracking.measurement import Measurement, TargetAppearance, measure_target
from scanner_sim.tracking.response import TargetKind, target_response, two_levels
from scanner_sim.tracking.samples import PatternSamples, rise_per_point
from scanner_sim.tracking.target_ranges import target_ranges

Array = NDArray[np.float64]

DISTANCE, RADIUS, SPOT, D = 8.0, 0.05, 2e-4, 0.05
CENTRE = np.array([0.1, -0.05])
NONE: dict[str, Any] = {"axis_separation": None}


def pattern() -> tuple[Array, Array]:
    """Return places and travels of a pattern over a disc, shape (points, 2)."""
    shape = LissajousPattern(points=160, amplitude=1.6 * RADIUS / DISTANCE)
    figure, half = figures(shape, 4, CENTRE), 0.5 / shape.points
    middle = (np.arange(shape.points) + 0.5) / shape.points
    start, place, end = (
        np.stack(figure_angles(figure, shape.cycles, middle + shift), axis=-1)[0]
        for shift in (-half, 0.0, half)
    )
    return place, end - start


def voxels(
    reach: Array, sigma: Array | float = 1e-4, levels: tuple[float, float] = (0.1, 1.0)
) -> PatternSamples:
    """Return a pattern over a disc that is round in the angles, with these ranges."""
    place, travel = pattern()
    value = judge.disc_signal(place, travel, CENTRE, RADIUS / DISTANCE, SPOT, levels)
    one = np.ones((1, len(place)))
    return PatternSamples(
        50e-6 * np.arange(len(place))[None], place[None, :, 0], place[None, :, 1], 1e6 * value[None], 3e3 * one,
        reach[None] * one, sigma * one, np.zeros(one.shape, np.uint8),
    )  # fmt: skip


def seen(samples: PatternSamples, kind: str = "black", **changes: Any) -> Measurement:
    appearance = TargetAppearance(
        kind=TargetKind(kind), diameter=2.0 * RADIUS, **changes.pop("appearance", {})
    )
    return measure_target(samples, appearance, DISTANCE, spot=SPOT, **NONE | changes)


def off() -> Array:
    """Return the angles from the disc's centre."""
    return np.asarray(np.hypot(*(pattern()[0] - CENTRE).T))


def test_rises_are_of_the_second_order_at_the_ends_too() -> None:
    index = np.arange(7.0)
    values = np.stack([2.0 + 3.0 * index - 0.5 * index**2, index**2])
    np.testing.assert_allclose(rise_per_point(values), np.stack([3.0 - index, 2.0 * index]), atol=1e-12)


def test_levels_are_medians_and_the_threshold_their_middle() -> None:
    value = np.concatenate([np.full(60, 0.1), np.full(40, 1.0), [0.3, 0.7]])[None]
    threshold, low, high, clear = two_levels(value, np.ones_like(value, dtype=bool))
    assert (threshold[0], low[0], high[0]) == pytest.approx((0.55, 0.1, 1.0))
    assert clear[0]
    # A value on the wrong side would move a median.
    value = np.concatenate([np.arange(9.0), 100.0 + np.arange(7.0)])[None]
    threshold, low, high, _ = two_levels(value, np.ones_like(value, dtype=bool))
    assert (threshold[0], low[0], high[0]) == (53.5, 4.0, 103.0)


@pytest.mark.parametrize(("kind", "target"), [("black", 0.1), ("white", 1.0)])
def test_what_counts_as_target(kind: str, target: float) -> None:
    """Claim: levels by the kind, gate at both ends, no strays, and a share of what counts."""
    count = 100
    signal = np.where(np.arange(count) < 40, 0.1, 1.0)
    one = np.ones((1, count))
    reach = np.full(count, DISTANCE)
    reach[50:55], reach[55:60] = DISTANCE - 0.31, DISTANCE + 0.31
    strays = signal.copy()
    # 0.55 is the threshold, 0.9 the levels' distance: 3 times that is a stray.
    strays[60], strays[61] = 0.55 + 3.05 * 0.9, 0.55 + 2.95 * 0.9
    samples = PatternSamples(
        one, one, one, strays[None], 0.01 * one, reach[None], 0.01 * one, np.zeros(one.shape, np.uint8)
    )
    found = target_response(samples, TargetKind(kind), (DISTANCE - 0.3, DISTANCE + 0.3))
    outside = (np.arange(count) >= 50) & (np.arange(count) < 60)
    np.testing.assert_array_equal(~found.used[0], outside | (np.arange(count) == 60))
    assert found.target[0] == pytest.approx(target)
    assert found.ground[0] == pytest.approx(1.1 - target)
    hits = 40 if kind == "black" else 49
    assert found.fraction[0] == pytest.approx(hits / 89.0)


def test_a_flat_target_has_the_range_of_its_middle() -> None:
    """Claim: off the centre a facing plane is farther by 1/cos: taken off, it is flat to 10⁻⁷ m."""
    found = seen(voxels(DISTANCE / np.cos(off())))
    assert found.found[0]
    np.testing.assert_allclose(found.position[0, :2], CENTRE, atol=1e-6)
    assert found.position[0, 2] == pytest.approx(DISTANCE, abs=1e-7)


def test_a_sphere_has_the_range_of_its_middle() -> None:
    """Claim: each voxel within 0.8 of the radius is carried to the middle: √(r² − ρ²), ρ by angle and range."""
    reach = np.full(160, DISTANCE)
    for _ in range(50):  # ρ = R sin δ on the sphere: R = R₀ cos δ − √(r² − R₀² sin² δ)
        reach = DISTANCE * np.cos(off()) - np.sqrt(
            np.maximum(RADIUS**2 - (DISTANCE * np.sin(off())) ** 2, 0.0)
        )
    reach = np.where(off() < RADIUS / DISTANCE, reach, DISTANCE + 0.2)
    found = seen(voxels(reach), "raised", appearance={"surface": "sphere"})
    assert found.found[0]
    assert found.position[0, 2] == pytest.approx(DISTANCE, abs=1e-4)
    # Voxels up to 0.8 of the radius count, and those beyond do not.
    inside, beyond = off() < 0.75 * RADIUS / DISTANCE, off() > 0.85 * RADIUS / DISTANCE
    for part, moves in (
        (beyond & (off() < RADIUS / DISTANCE), False),
        (inside & (off() > 0.6 * RADIUS / DISTANCE), True),
    ):
        assert part.sum() > 3
        moved = seen(voxels(np.where(part, reach + 2e-3, reach)), "raised", appearance={"surface": "sphere"})
        assert (abs(moved.position[0, 2] - found.position[0, 2]) > 1e-5) == moves


def test_ranges_count_by_the_inverse_of_their_variance() -> None:
    loose = np.arange(160) % 3 == 0
    true = DISTANCE / np.cos(off())
    found = seen(voxels(np.where(loose, true + 5e-3, true), np.where(loose, 1e-1, 1e-4)))
    assert found.position[0, 2] == pytest.approx(DISTANCE, abs=1e-7)


def test_voxels_at_the_rim_do_not_tell_the_range() -> None:
    """Claim: what stands within three spots and half a dwell's way of the rim may be wrong without any harm."""
    rise = np.hypot(*rise_per_point(pattern()[0].T.copy()))
    rim = np.abs(off() - RADIUS / DISTANCE) < 2.9 * SPOT + 0.5 * rise
    assert rim.sum() > 5
    true = DISTANCE / np.cos(off())
    found = seen(voxels(np.where(rim, true + 10e-3, true)))
    assert found.position[0, 2] == pytest.approx(DISTANCE, abs=1e-7)


def test_a_range_belongs_to_the_mean_time_of_the_hits() -> None:
    """Claim: of a target that recedes at 2 m/s the range is that at the time stamp, the mean over the hits."""
    time = 50e-6 * np.arange(160)
    found = seen(voxels(DISTANCE / np.cos(off()) + 2.0 * time))
    hit = off() < RADIUS / DISTANCE
    assert found.time[0] == pytest.approx(time[hit].mean(), abs=0.6 * 50e-6)
    assert abs(time[hit].mean() - time.mean()) > 1e-6 or abs(found.time[0] - time.mean()) < 60e-6
    assert found.position[0, 2] == pytest.approx(DISTANCE + 2.0 * found.time[0], abs=1e-6)


@pytest.mark.parametrize(("kind", "told"), [("black", "both"), ("white", "on"), ("hole", "around")])
def test_ranges_come_from_where_the_kind_says(kind: str, told: str) -> None:
    """Claim: black discs are ranged by all voxels, white ones by those on them, holes by those around them."""
    on = off() < RADIUS / DISTANCE
    deep = np.where(on, DISTANCE + 0.2, DISTANCE) if kind == "hole" else np.full(160, DISTANCE)
    levels = (1.0, 0.1) if kind == "white" else (0.1, 1.0)
    base = deep / np.cos(off())
    far_on, far_off = off() < 0.7 * RADIUS / DISTANCE, off() > 1.3 * RADIUS / DISTANCE
    start = seen(voxels(base, levels=levels), kind).position[0, 2]
    assert start == pytest.approx(DISTANCE, abs=1e-6)
    for part, name in ((far_on, "on"), (far_off, "around")):
        moved = seen(voxels(np.where(part, base + 5e-3, base), levels=levels), kind).position[0, 2]
        assert bool(abs(moved - start) > 1e-5) is (told in (name, "both")), name


def test_what_lies_between_disc_and_ground_tells_no_range() -> None:
    """Claim: voxels of a raised disc in whose dwell the spot is partly on the ground do not move its range."""
    half_way = 0.5 * np.hypot(*pattern()[1].T)
    on = off() < RADIUS / DISTANCE
    partly = on & (off() > RADIUS / DISTANCE - half_way - SPOT)
    assert partly.sum() > 1
    base = np.where(on, DISTANCE, DISTANCE + 0.1) / np.cos(off())
    found = seen(voxels(np.where(partly, base + 0.03, base)), "raised")
    assert found.position[0, 2] == pytest.approx(DISTANCE, abs=1e-6)


def tilted(sigma: float) -> tuple[PatternSamples, Array]:
    """Return voxels over a disc on a plane tilted by half a radian, and ∂R/∂(Θ, φ) at its centre."""
    middle = np.stack(coordinates(DISTANCE, *CENTRE, D))
    beam = middle - np.stack(coordinates(DISTANCE - 1.0, *CENTRE, D))
    axis = np.cross(beam, [0.3, 1.0, 0.0])
    axis /= np.linalg.norm(axis)
    normal = np.cos(0.5) * beam + np.sin(0.5) * np.cross(axis, beam)

    def reach(theta: Any, phi: Any) -> Array:
        near, far = (np.stack(coordinates(r, theta, phi, D), axis=-1) for r in (1.0, 2.0))
        return np.asarray(1.0 + (middle - near) @ normal / ((far - near) @ normal))

    place, _ = pattern()
    samples = voxels(reach(*place.T), sigma)
    points = np.stack(coordinates(samples.range[0], *place.T, D), axis=-1)
    away = np.linalg.norm(points - middle, axis=1)
    soft = 1.0 / (1.0 + np.exp(np.clip((away - RADIUS) / (0.5 * SPOT * DISTANCE), -50.0, 50.0)))
    step = 1e-5
    slope = [
        (reach(CENTRE[0] + step, CENTRE[1]) - reach(CENTRE[0] - step, CENTRE[1])) / (2.0 * step),
        (reach(CENTRE[0], CENTRE[1] + step) - reach(CENTRE[0], CENTRE[1] - step)) / (2.0 * step),
    ]
    near, far = (np.stack(coordinates(r, *place.T, D), axis=-1) for r in (1.0, 2.0))
    facing = np.abs((far - near) @ normal) * (DISTANCE / samples.range[0]) ** 2
    return replace(samples, signal=1e6 * (facing * (1.0 - 0.9 * soft))[None]), np.array(slope)


def test_an_error_of_the_centre_moves_the_range_along_the_plane() -> None:
    """Claim: with g = ∂R/∂(Θ, φ) the place's covariance has C g beside C, and g·C g within the variance of R."""
    samples, slope = tilted(1e-6)
    found = seen(samples, axis_separation=D)
    assert found.found[0]
    assert found.position[0, 2] == pytest.approx(DISTANCE, abs=2e-3)
    covariance = found.covariance[0]
    scale = np.abs(slope).max()
    np.testing.assert_allclose(
        covariance[:2, 2], covariance[:2, :2] @ slope, rtol=0.01, atol=0.01 * covariance[0, 0] * scale
    )
    # The ranges themselves err by a micrometre: all else is the centre's.
    assert covariance[2, 2] == pytest.approx(slope @ covariance[:2, :2] @ slope, rel=0.05)
    assert covariance[2, 2] > (5e-6) ** 2


def test_uncertain_slopes_widen_the_centre(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: ranges that tell the plane badly make the centre worse, and by more the worse they are; both slopes do."""
    # Fits that come to rest earlier differ by as much as the slopes move them here.
    monkeypatch.setattr("scanner_sim.tracking.disc_fit._CONVERGED_STEP", 1e-6)
    covariances = []
    for sigma in (1e-6, 3e-3, 6e-3):
        samples, _ = tilted(1e-6)
        told = replace(samples, sigma_range=np.full_like(samples.range, sigma))
        covariances.append(seen(told, axis_separation=D).covariance[0, :2, :2])
    added = [one - covariances[0] for one in covariances[1:]]
    rough, rougher = (np.sqrt(np.diag(one)) for one in added)
    assert (rough > 0.0).all()
    # Twice the noise of the ranges is twice the slope's, and twice what it moves.
    assert np.hypot(*rougher) == pytest.approx(2.0 * np.hypot(*rough), rel=0.1)
    # What one slope alone moves would lie in one direction: its determinant is rounding, 1e-8 of the product.
    assert np.linalg.det(added[0]) > 1e-3 * np.prod(np.diag(added[0]))


def test_uncertain_slopes_count_alike_whichever_way_a_target_leans(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a pattern and its mirror image have mirrored covariances, also where the plane is told so badly that what
    its slopes move is no longer in proportion to them.

    Set-up: a disc under half a radian, ranges that err by 0.2 m, which is a slope of a tenth; mirrored along Θ, along φ
    and along both, with D_g of 0. Errors of the slopes to one side alone differ by a tenth and more.
    """
    monkeypatch.setattr("scanner_sim.tracking.disc_fit._CONVERGED_STEP", 1e-6)
    samples, _ = tilted(0.0)
    samples = replace(samples, sigma_range=np.full_like(samples.range, 0.2))
    found = []
    for theta, phi in ((1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)):
        mirror = np.diag([theta, phi])
        one = seen(replace(samples, theta=theta * samples.theta, phi=phi * samples.phi), axis_separation=0.0)
        found.append(mirror @ one.covariance[0, :2, :2] @ mirror)
    for one in found[1:]:
        np.testing.assert_allclose(one, found[0], rtol=1e-3, atol=1e-3 * np.abs(found[0]).max())


def test_the_error_of_the_angles_is_stretched_as_the_plane_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: seen on a plane tilted by τ, angles are larger by 1/√cos τ in the mean, and their error is, too."""
    asked = []

    def noted(*given: Any, pointing: Any, **more: Any) -> Any:
        asked.append(pointing)
        return disc_fit(*given, pointing=pointing, **more)

    monkeypatch.setattr(measurement, "disc_fit", noted)
    seen(tilted(1e-6)[0], axis_separation=D, pointing=8e-6)
    np.testing.assert_allclose(asked[-1], 8e-6 / np.sqrt(np.cos(0.5)), rtol=1e-3)


def test_nothing_is_measured_of_nothing() -> None:
    samples = replace(
        voxels(np.full(160, DISTANCE)), status=np.full((1, 160), Status.OUT_OF_GATE, dtype=np.uint8)
    )
    assert not seen(samples).found[0]
    _, theta, phi = angles_and_range(*coordinates(DISTANCE, *CENTRE, D), D)
    assert (theta, phi) == pytest.approx(tuple(CENTRE))


@pytest.mark.parametrize(
    ("kind", "separation", "duty_cycle"),
    [("black", D, 1.0), ("black", None, 1.0), ("raised", D, 1.0), ("retro", D, 1.0), ("black", D, 0.5)],
)
def test_patterns_are_measured_together_as_each_alone(
    kind: str, separation: float | None, duty_cycle: float
) -> None:
    """Claim: the same bytes in any company and order: of facing and tilted discs with noise, and of none at all."""
    rng = np.random.default_rng(7)
    place, _ = pattern()
    tilts = [(place - CENTRE) @ slope for slope in ([0.0, 0.0], [3.0, 0.0], [-2.0, 4.0], [0.0, -1.0])]
    alone = []
    for tilt in tilts:
        one = voxels(
            DISTANCE + tilt - 0.1 * (off() < RADIUS / DISTANCE) + rng.normal(0.0, 1e-3, len(place)), 1e-3
        )
        alone.append(replace(one, signal=one.signal + rng.normal(0.0, 3e3, one.signal.shape)))
    alone.append(
        replace(alone[0], signal=np.full_like(alone[0].signal, 1e6), range=alone[0].range * 0.0 + 8.0)
    )
    order = [4, 2, 0, 3, 1]
    together = PatternSamples(
        *(
            np.concatenate([getattr(alone[row], name) for row in order])
            for name in alone[0].__dataclass_fields__
        )
    )
    many = seen(together, kind, axis_separation=separation, duty_cycle=duty_cycle)
    assert many.found.any()
    assert not many.found.all()
    for position, row in enumerate(order):
        one = seen(alone[row], kind, axis_separation=separation, duty_cycle=duty_cycle)
        for name in (
            "time",
            "position",
            "covariance",
            "radius",
            "sigma_radius",
            "misfit",
            "fraction",
            "found",
        ):
            np.testing.assert_array_equal(getattr(many, name)[position], getattr(one, name)[0], err_msg=name)


@pytest.mark.parametrize("kind", ["black", "retro"])
@pytest.mark.parametrize("separation", [D, None])
def test_a_disc_whose_rim_is_lost_is_seen_beside_a_whole_one(kind: str, separation: float | None) -> None:
    """Claim: without the voxels on both sides of its edges a disc has no circle, and its hits tell where it is, alone
    and in a row of discs that have one."""
    whole = voxels(DISTANCE / np.cos(off()))
    crossed = np.diff(off() < RADIUS / DISTANCE, prepend=False, append=False)
    beside = crossed[1:] | crossed[:-1]
    lost = replace(whole, status=np.where(beside, Status.OUT_OF_GATE, 0).astype(np.uint8)[None])
    both = PatternSamples(
        *(
            np.concatenate([getattr(one, name) for one in (whole, lost)])
            for name in whole.__dataclass_fields__
        )
    )
    alone, together = (seen(one, kind, axis_separation=separation, duty_cycle=0.5) for one in (lost, both))
    assert np.isnan(alone.misfit).all()
    np.testing.assert_array_equal(together.found, True)
    np.testing.assert_array_equal(together.position[1], alone.position[0])
    np.testing.assert_allclose(alone.position[0, :2], CENTRE, atol=0.1 * RADIUS / DISTANCE)


def test_a_voxel_without_a_range_leaves_the_others_theirs() -> None:
    """Claim: NaN for the range of every ninth voxel leaves the range of the disc to the others, to 1e-5 m."""
    reach = DISTANCE / np.cos(off())
    gaps = np.where(np.arange(len(reach)) % 9 == 0, np.nan, reach)
    whole, found = seen(voxels(reach)), seen(voxels(gaps))
    assert np.isfinite(found.position).all()
    np.testing.assert_allclose(found.position, whole.position, atol=1e-5)


@pytest.mark.parametrize("rates", [(0.0, 0.0, -4.8), (2e-3, -3e-3, -4.8), (0.0, 0.0, 2.4)])
def test_a_target_that_moves_is_seen_where_it_is(rates: tuple[float, float, float]) -> None:
    """Claim: with its rates known a disc that comes nearer and moves aside is measured as one at rest: within 0.1 µrad
    of what is found of that one, and 0.1 µm in range.

    Set-up: each voxel's signal by the judge, in units of the disc as its range at the voxel's time shows it, the light
    by 1/R²; at 8 m and 4.8 m/s it grows by 0.4 % in a pattern, as at 1.2 m/s at 2 m. Without the rates the centre is
    microradians off, so that the test can fail.
    """
    place, travel = pattern()
    time = 50e-6 * np.arange(len(place))
    middle = time.mean()
    since, moving = time - middle, np.array(rates)
    reach = DISTANCE + moving[2] * since
    centre = CENTRE + moving[:2] * since[:, None]
    disc = np.zeros(2), RADIUS / DISTANCE, SPOT, (0.1, 1.0)
    larger = reach[:, None] / DISTANCE
    value = judge.disc_signal((place - centre) * larger, travel * larger, *disc) / larger[:, 0] ** 2
    still = voxels(np.full(len(place), DISTANCE) / np.cos(off()))
    moved = replace(
        still, signal=1e6 * value[None], range=reach / np.cos(np.hypot(*(place - centre).T))[None]
    )
    one = np.ones(1)
    at_rest = moved.at_rest(middle * one, np.array([[*CENTRE, DISTANCE]]), moving[None])
    wanted, known, unknown = (seen(each).position[0] for each in (still, at_rest, moved))
    np.testing.assert_allclose(known[:2], wanted[:2], rtol=0.0, atol=1e-7)
    assert known[2] == pytest.approx(wanted[2], abs=1e-7)
    assert np.abs(unknown[:2] - wanted[:2]).max() > 1e-6


def test_a_range_and_its_slopes_err_as_the_ranges_that_they_are_made_of() -> None:
    """Claim: R and its slopes are a weighed fit of 1, δΘ, δφ and time, as NumPy's least squares makes it; what they
    change by each voxel's range are the gains, and Σ gᵢ gᵢᵀ σᵢ² is their covariance.

    Tolerance: a hundredth of σ, as 10⁻⁹ is added to the fit's diagonal.
    """
    rng = np.random.default_rng(8)
    sigma = 10.0 ** rng.uniform(-4.5, -3.5, 160)
    plane = DISTANCE + 0.3 * (pattern()[0] - CENTRE) @ [1.0, -2.0]
    samples = voxels(plane / np.cos(off()) + sigma * rng.normal(size=160), sigma)
    every = np.ones((1, 160), dtype=bool)
    response: Any = SimpleNamespace(hit=every, used=every)
    centre: Any = SimpleNamespace(found=np.array([True]), radius=np.array([RADIUS / DISTANCE]))
    about, stamp = CENTRE[None] + [[1e-3, -5e-4]], np.array([3e-3])

    def fit(given: PatternSamples) -> Any:
        return target_ranges(given, response, TargetKind.WHITE, centre, about, stamp)

    found, away = fit(samples), pattern()[0] - about
    design = np.column_stack([np.ones(160), away, samples.time[0] - stamp[0]]) / sigma[:, None]
    value = samples.range[0] * np.cos(np.hypot(*away.T)) / sigma
    wanted = np.linalg.lstsq(design, value, rcond=None)[0]
    spread = np.linalg.inv(design.T @ design)[:3, :3]
    errors = np.sqrt(np.diag(spread))
    assert np.abs(found.at[0] - wanted[0]) < 1e-2 * errors[0]
    assert (np.abs(found.slope[0] - wanted[1:3]) < 1e-2 * errors[1:]).all()
    scale = np.outer(errors, errors)
    np.testing.assert_allclose(found.covariance[0] / scale, spread / scale, atol=1e-5)
    np.testing.assert_allclose(
        (found.gains[0] * sigma**2) @ found.gains[0].T / scale, spread / scale, atol=1e-5
    )
    moved = samples.range.copy()
    moved[0, 17] += 1e-3 / np.cos(np.hypot(*away[17]))
    change = fit(replace(samples, range=moved))
    assert change.at[0] - found.at[0] == pytest.approx(1e-3 * found.gains[0, 0, 17], rel=1e-6)
    np.testing.assert_allclose(change.slope[0] - found.slope[0], 1e-3 * found.gains[0, 1:, 17], rtol=1e-6)


def test_what_is_as_uncertain_as_it_is_large_was_not_measured() -> None:
    """Claim: a target is there while σ of its range is below the range; σ grows as that of the voxels."""
    flat = DISTANCE / np.cos(off())
    sigma = 1.0 / np.sqrt(seen(voxels(flat, 1.0)).covariance[0, 2, 2])
    assert seen(voxels(flat, 0.98 * DISTANCE * sigma)).found[0]
    assert not seen(voxels(flat, 1.02 * DISTANCE * sigma)).found[0]
