"""The speckle that stays with a surface: sums over a curve by brute force, and the limits of its share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from claims import mean, share
from numpy.typing import NDArray
from scipy.linalg import eigh

from scanner_sim.analytic import tracking as judge
from scanner_sim.scan.lissajous import LissajousPattern, figure_angles, figures
from scanner_sim.tracking import lasting
from scanner_sim.tracking.centroid import Centroid
from scanner_sim.tracking.disc_fit import disc_fit
from scanner_sim.tracking.measurement import Measurement, TargetAppearance, measure_target
from scanner_sim.tracking.plane import TargetPlane
from scanner_sim.tracking.response import TargetKind, target_response
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import TrackerSettings

Array = NDArray[np.float64]

RADIUS, COUNT = 2e-3, 24
TURN = 2.0 * np.pi * np.arange(COUNT) / COUNT
PLACE = 8e-3 * np.stack([np.cos(TURN), np.sin(TURN)])
RISE = 8e-3 * 2.0 * np.pi / COUNT * np.stack([-np.sin(TURN), np.cos(TURN)])


def common(place: Array, rise: Array, errors: Array, radius: float, on_surface: float) -> Array:
    one, half = np.ones(1), errors[None] * (np.arange(errors.shape[1]) < COUNT // 2)
    # The errors by light change nothing of those by place.
    kept = lasting._common(place[None], rise[None], half, errors[None], radius * one, on_surface * one)[1]
    return np.asarray(kept[1, 0])


def test_ends_of_a_way_over_a_target_keep_seven_eighths() -> None:
    """Claim: of voxels one point apart, which count where they lie on the target, another pattern anywhere within half
    a point has the first and the last of each way with the mean chance 7/8: by 10⁵ patterns."""
    counts = np.array([0, 1, 1, 1, 0, 0, 1, 0, 1, 1], dtype=bool)
    found = lasting._kept(np.where(counts, 2.0, 0.0)[None, None])[0] ** 2
    np.testing.assert_allclose(found[counts], [0.875, 1.0, 0.875, 0.875, 0.875, 1.0])
    random = np.random.default_rng(5)
    inside, moved = random.random(100_000), random.random(100_000) - 0.5
    assert share(int((inside + moved > 0.0).sum()), 100_000, 0.875)
    # Of a resting beam two visits share e K e by these shares' roots, and neighbours within one all of theirs.
    place = np.stack([1.5e-3 * np.arange(10.0), np.zeros(10)])
    errors, one = np.where(counts, 1.0 + np.arange(10.0), 0.0), np.ones(1)
    light = np.zeros((1, 1, 10))
    sums = lasting._common(
        place[None], 0.0 * place[None], light, errors[None, None], RADIUS * one, 0.0 * one
    )[1]
    kernel = np.exp(-(((place[0][:, None] - place[0]) / RADIUS) ** 2))
    left = np.where(counts, errors * np.sqrt(found), 0.0)
    assert sums[1, 0, 0, 0] == pytest.approx(left @ kernel @ left, rel=2e-3)
    assert sums[0, 0, 0, 0] == pytest.approx(errors @ kernel @ errors - errors @ errors, rel=2e-3)


@pytest.mark.parametrize("on_surface", [0.0, 0.6])
def test_two_dithers_share_what_their_places_on_the_surface_do(on_surface: float) -> None:
    """Claim: Σ_ij e_i e_j ⟨ρ(r_i + u t_i − r_j − u′ t_j)⟩ over u, u′ all over a dwell, with exp(−δ²/w²) of the
    light and (1 − 2δ_x²/w²) exp(−δ²/w²) of its place on the surface: by a plain sum over all pairs, each at nine by
    nine places. A pattern beside it whose voxels count for more or for less changes no bit of it."""
    errors = np.stack([1.0 + 0.3 * np.cos(TURN), np.sin(2.0 * TURN) + 0.5])
    found = common(PLACE, RISE, errors, RADIUS, on_surface)
    for others in (np.eye(2, COUNT), np.ones((2, COUNT)), 1e6 * np.ones((2, COUNT))):
        pairs = (2.0 * PLACE, PLACE), (RISE, RISE), (errors, others), (others, errors)
        both = (np.stack(pair) for pair in pairs)
        light, place = lasting._common(*both, np.array([2e-3, RADIUS]), np.array([0.3, on_surface]))
        assert place[1, 1].tobytes() == found.tobytes()
        alone = common(2.0 * PLACE, RISE, errors, 2e-3, 0.0)
        assert light[1, 0].tobytes() == alone.tobytes()
    steps = (np.arange(9) + 0.5) / 9.0 - 0.5
    wanted = np.zeros((2, 2))
    for i in range(COUNT):
        for j in range(COUNT):
            shared = []
            for u in steps:
                for other in steps:
                    x, y = (PLACE[:, i] + u * RISE[:, i] - PLACE[:, j] - other * RISE[:, j]) / RADIUS
                    shared.append((1.0 - 2.0 * on_surface * x**2) * np.exp(-(x**2) - y**2))
            wanted += np.outer(errors[:, i], errors[:, j]) * np.mean(shared)
    # Beyond 2.5 radii two points are taken to share nothing: 2e-3.
    np.testing.assert_allclose(found, wanted, rtol=5e-3, atol=5e-3 * np.abs(wanted).max())


@pytest.mark.parametrize("on_surface", [0.0, 0.6])
def test_neighbours_share_what_lies_under_both_beams(on_surface: float) -> None:
    """Claim: in one visit different voxels add Σ_{i≠j} e_i e_j ρ(r_i − r_j) to their own variances, by a plain sum."""
    errors = np.stack([1.0 + 0.3 * np.cos(TURN), np.sin(2.0 * TURN) + 0.5])
    errors[:, 3] *= 1e-3  # counts for nothing
    x, y = (PLACE[:, :, None] - PLACE[:, None]) / RADIUS
    share = (1.0 - 2.0 * on_surface * x**2) * np.exp(-(x**2) - y**2) * (1.0 - np.eye(COUNT))
    one = np.ones(1)
    _, place = lasting._common(
        PLACE[None], RISE[None], errors[None], errors[None], RADIUS * one, on_surface * one
    )
    wanted = errors @ share @ errors.T
    np.testing.assert_allclose(place[0, 0], wanted, rtol=5e-3, atol=5e-3 * np.abs(wanted).max())


@pytest.mark.parametrize("on_surface", [0.0, 0.6])
def test_visits_share_what_their_places_on_the_curve_do(on_surface: float) -> None:
    """Claim: two visits whose dwells lie Δ points apart share C₀ + Σ C_h cos(2π h Δ), by a plain sum over all pairs.

    Set-up: a beam that moves by 2.6 of its radii from voxel to voxel, all the way round a circle.
    Expected: to 4 % of one visit's variance: a circle is no straight way (δ²/2r is 0.03 w), and third harmonics, 2 % of
    it by the light and 3 % by the place, are taken for first ones. Neither could stand in for the other: the visits
    share all of it at Δ = 0 and next to nothing at ½ by the place on the surface.
    """
    radius, errors = 0.8e-3, 1.0 + 0.3 * np.cos(TURN) + 0.2 * np.sin(2.0 * TURN)
    one, plain = np.ones(1), errors[None, None]
    _, place = lasting._common(PLACE[None], RISE[None], plain, plain, radius * one, on_surface * one)
    constant, *harmonics = place[1:, 0, 0, 0]
    shares = []
    for apart in (0.0, 0.1, 0.25, 0.37, 0.5):
        turn = TURN + 2.0 * np.pi * apart / COUNT
        x, y = (
            8e-3 * (one[:, None] - PLACE[axis] / 8e-3) / radius
            for axis, one in enumerate((np.cos(turn), np.sin(turn)))
        )
        wanted = errors @ ((1.0 - 2.0 * on_surface * x**2) * np.exp(-(x**2) - y**2)) @ errors
        found = constant + sum(c * np.cos(2.0 * np.pi * (h + 1) * apart) for h, c in enumerate(harmonics))
        assert found == pytest.approx(wanted, abs=0.04 * (errors @ errors)), apart
        shares.append(wanted / (errors @ errors))
    assert shares[0] > 0.9
    assert shares[-1] < 0.45


def test_a_dither_leaves_nothing_where_it_was() -> None:
    """Claim: at most nine tenths of any variance last: in every direction of (Θ, φ), and of the range."""
    whole = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 9.0]])
    small = 0.5 * whole
    np.testing.assert_allclose(lasting._limit(small[None], whole[None])[0], small)
    # Angles and range are limited each by itself.
    part = np.diag([1.0, 1.0, 0.0]) @ (2.0 * whole) + np.diag([0.0, 0.0, 4.5])
    limited = lasting._limit(part[None], whole[None])[0]
    np.testing.assert_allclose(limited[:2, :2], 0.9 * whole[:2, :2], rtol=1e-12)
    assert limited[2, 2] == pytest.approx(4.5)
    assert lasting._limit(np.diag([0.0, 0.0, 20.0])[None], whole[None])[0, 2, 2] == pytest.approx(8.1)


DISTANCE, DISC, BEAM = 8.0, 5e-3, 3.2e-3


def visit(amplitude: float = 8e-3) -> tuple[PatternSamples, Measurement]:
    """Return a pattern over a black disc of the radius ``DISC`` [rad] about (0, 0), and its measurement."""
    pattern = LissajousPattern(amplitude=amplitude)
    shape, half = figures(pattern, 3, np.zeros(2)), 0.5 / pattern.points
    middle = (np.arange(pattern.points) + 0.5) / pattern.points
    start, place, end = (
        np.stack(figure_angles(shape, pattern.cycles, middle + shift), axis=-1)[0]
        for shift in (-half, 0.0, half)
    )
    signal = judge.disc_signal(place, end - start, np.zeros(2), DISC, 0.5 * BEAM / DISTANCE, (0.1, 1.0))
    one = np.ones((1, len(place)))
    samples = PatternSamples(
        50e-6 * np.arange(len(place))[None],
        place[None, :, 0],
        place[None, :, 1],
        signal[None],
        0.01 * one,
        DISTANCE / (np.cos(place[None, :, 0]) * np.cos(place[None, :, 1])),
        0.01 * one,
        np.zeros(one.shape, np.uint8),
    )
    seen = measure_target(
        samples,
        TargetAppearance(kind=TargetKind.BLACK, diameter=2.0 * DISC * DISTANCE),
        DISTANCE,
        spot=0.5 * BEAM / DISTANCE,
        axis_separation=0.0,
    )
    # What the surface leaves is as large as can be.
    return samples, replace(seen, covariance=1e-2 * np.eye(3)[None])


def surface(light: float) -> Array:
    samples, seen = visit()
    one = np.ones(1)
    speckle = lasting.SurfaceSpeckle(BEAM * one, np.full(samples.theta.shape, light), 0.0 * one, 1e-4 * one)
    return np.asarray(lasting.surface_parts(samples, seen, speckle).lasting[0])


def errors_of(place: Array, rise: Array, gains: Array, waves: Array, rng: np.random.Generator) -> Array:
    """Return Σ g_i z(r_i) of a pattern whose dwells begin anywhere, of fields z of plane waves, shape (2, fields)."""
    at = (place + rng.uniform(-0.5, 0.5) * rise) / BEAM
    field = np.cos(np.tensordot(waves[:, :2], at, axes=(1, 0)) + waves[:, 2][..., None])
    return np.asarray(gains @ field.sum(axis=1).T * np.sqrt(2.0 / waves.shape[-1]))


def test_speckle_lasts_until_a_pattern_has_moved_by_two_radii() -> None:
    """Claim: what a pattern's errors Θ and φ by speckle have in common with those of the same pattern δ radii of the
    beam further on the surface has the integral that :data:`LASTING_RADII` states, over the six radii to which it is
    meant.

    Set-up: the disc's fit of :func:`visit` at the tracker's amplitude, its gains; 3000 random fields of the correlation
    exp(−δ²/w²), 48 plane waves each, no double sum; dwells begin anywhere, the way has any of 150 directions, whose
    means are the independent values. Expected: that of an exponential, 2 (1 − exp(−3)) = 1.90. Level 1e-4, besides a
    slack of 0.25 radii (the mean over directions is exact for straight parts of a pattern alone). One of the length of
    one radius, exp(−δ), would make 1.00: the claim would find it.
    """
    _, seen = visit(TrackerSettings().track_amplitude * DISC)
    assert seen.sight is not None
    assert seen.sight.light_gains is not None
    rng = np.random.default_rng(8)
    place = DISTANCE * seen.sight.place[0]
    rise, gains = lasting.rise_per_point(place), seen.sight.light_gains[0]
    counted = np.abs(gains).max(axis=0) > 0.01 * np.abs(gains).max()
    place, rise, gains = place[:, counted], rise[:, counted], gains[:, counted]
    found = []
    for _ in range(150):
        waves = np.sqrt(2.0) * rng.standard_normal((20, 3, 48))
        waves[:, 2] = rng.uniform(0.0, 2.0 * np.pi, (20, 48))
        direction = rng.uniform(0.0, 2.0 * np.pi)
        first, again, *further = (
            errors_of(
                place + BEAM * way * np.array([[np.cos(direction)], [np.sin(direction)]]),
                rise,
                gains,
                waves,
                rng,
            )
            for way in (0.0, 0.0, 0.5, 1.5, 2.5, 3.5, 4.5, 5.5)
        )
        found.append([(first * other).mean(axis=1) for other in (again, np.sum(further, axis=0))])
    same, moved = np.moveaxis(np.array(found), 1, 0)
    length = lasting.LASTING_RADII
    claim = mean((moved / same.mean(axis=0)).mean(axis=1), length * (1.0 - np.exp(-6.0 / length)), slack=0.25)
    assert claim
    assert claim.finds < 0.9, claim


@pytest.mark.parametrize("on_surface", [0.0, 0.38, 0.73, 1.0])
def test_ranges_meet_other_speckle_sooner(on_surface: float) -> None:
    """Claim: of straight parts in all directions, moved in all directions, the errors of range have an integral over
    the six radii that is so much shorter than that of the errors of light: by sums over two points of each part.

    Expected: of the field (1 − 2κ x²) exp(−r²) over the part's own length, over what it is without a move; the same
    without κ. Tolerance 1e-3: steps of the sums.
    """
    along = np.linspace(-12.0, 12.0, 241)
    move, part = np.linspace(0.0, 6.0, 121), np.pi * (np.arange(24) + 0.5) / 24
    moved = np.zeros((2, len(move)))
    for way in 2.0 * part:
        for lie in part:
            x = along * np.cos(lie) + move[:, None] * np.cos(way)
            y = along * np.sin(lie) + move[:, None] * np.sin(way)
            decay = np.exp(-(x**2) - y**2)
            moved += decay.sum(axis=1), (decay * (1.0 - 2.0 * on_surface * x**2)).sum(axis=1)
    light, place = np.trapezoid(moved / moved[:, :1], move, axis=1)
    assert lasting.range_fades(np.array([on_surface]))[0] == pytest.approx(light / place, rel=1e-3)


def test_what_does_not_last_is_a_covariance() -> None:
    """Claim: where more speckle is expected than the whole error has, a tenth of the whole is left in every direction.

    On a steep target, whose range errs with its centre: both by the same slope, so that nothing negative is left.
    """
    samples, seen = visit()
    assert seen.sight is not None
    slope = np.array([[4.0, -9.0]])
    steep = replace(seen.sight, plane=replace(seen.sight.plane, slope=slope))
    whole = lasting._on_slope(np.diag([1e-10, 2e-10, 1e-8])[None], slope)
    seen = replace(seen, covariance=whole, sight=steep)
    one = np.ones(1)
    speckle = lasting.SurfaceSpeckle(BEAM * one, np.full(samples.theta.shape, 0.04), 0.0 * one, 0.0 * one)
    made = lasting.surface_parts(samples, seen, speckle)
    part, whole = made.lasting, whole + made.neighbours
    share = np.linalg.eigvals(np.linalg.solve(whole, part))[0].real
    assert share.max() == pytest.approx(0.9, rel=1e-6)
    root = np.sqrt(np.diagonal(whole[0]))
    assert np.linalg.eigvalsh((whole - part)[0] / np.outer(root, root)).min() > 1e-3
    left = whole[0] - part[0] - made.dither[0].sum(axis=0)
    assert np.linalg.eigvalsh(left / np.outer(root, root)).min() > 1e-4
    assert part[0, 0, 2] == pytest.approx((part[0, :2, :2] @ slope[0])[0], rel=1e-6, abs=0.0)


def test_what_lasts_on_a_plane_goes_back_as_its_centres_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: angles on a leaning target's plane go back to those of the scanner by its matrix, neighbours' too."""
    samples, seen = visit()
    one = np.ones(1)
    speckle = lasting.SurfaceSpeckle(BEAM * one, np.full(samples.theta.shape, 0.04), 0.0 * one, 1e-4 * one)
    found = []
    back = np.array([[1.3, 0.2], [-0.4, 0.9]])
    for matrix in (np.eye(2), back):
        monkeypatch.setattr(TargetPlane, "back", matrix[None])
        found.append(lasting.surface_parts(samples, seen, speckle))
    for name in ("lasting", "neighbours", "dither"):
        here, there = (getattr(one, name)[0] for one in found)
        wanted = back @ here[..., :2, :2] @ back.T
        np.testing.assert_allclose(there[..., :2, :2], wanted, rtol=1e-9, atol=1e-12 * np.abs(wanted).max())
    assert found[0].lasting[0, 0, 0] > 0.0


def test_what_lasts_is_nine_tenths_at_most_in_every_direction() -> None:
    """Claim: of angles the share in the direction where it is largest is brought to 0.9, and all of them with it; of
    ranges theirs; smaller shares stay. Expected: generalised eigenvalues by LAPACK. Tolerance: rounding."""
    random = np.random.default_rng(11)

    def covariances(count: int) -> Array:
        root = random.normal(size=(count, 3, 3))
        found = root @ root.transpose(0, 2, 1)
        found[:, 2, :2] = found[:, :2, 2] = 0.0
        return found

    whole, part = covariances(40), covariances(40) * np.exp(random.uniform(-6.0, 3.0, (40, 1, 1)))
    limited = lasting._limit(part, whole)
    cut = 0
    for before, after, total in zip(part, limited, whole, strict=True):
        largest = eigh(before[:2, :2], total[:2, :2], eigvals_only=True)[-1]
        cut += largest > 0.9
        np.testing.assert_allclose(after[:2, :2], before[:2, :2] * min(1.0, 0.9 / largest), rtol=1e-9)
        assert after[2, 2] == pytest.approx(min(before[2, 2], 0.9 * total[2, 2]), rel=1e-9)
    assert 5 < cut < 35


def test_the_centre_moves_with_the_light_of_each_voxel() -> None:
    """Claim: the errors that last are √V_i of each voxel's light, times what the measurement makes of it.

    By the disc's fit itself, one signal after another made brighter and darker by 2e-4: 2 %, for there the light of
    the plane is not divided out.
    """
    samples, _ = visit()
    count = samples.theta.shape[1]
    step = 2e-4
    many = PatternSamples(
        *(np.repeat(getattr(samples, name), count, axis=0) for name in samples.__dataclass_fields__)
    )
    spot = 0.5 * BEAM / DISTANCE
    one, yes = np.ones(count), np.ones(count, dtype=bool)
    start = Centroid(np.zeros((count, 2)), np.zeros((count, 2, 2)), DISC * one, 1e-4 * one, one, yes)
    centres = []
    for sign in (1.0, -1.0):
        moved = replace(many, signal=many.signal * (1.0 + sign * step * np.eye(count)))
        response = target_response(moved, TargetKind.BLACK, (5.0, 15.0))
        response = replace(response, target=0.1 * one, ground=one, threshold=0.55 * one)
        centres.append(disc_fit(moved, response, start, spot=spot).centre)
    errors = 0.2 * (centres[0] - centres[1]).T / (2.0 * step)
    place = DISTANCE * np.concatenate([samples.theta, samples.phi])
    one, none = np.ones(1), np.zeros_like(errors)[None, :1]
    rise = lasting.rise_per_point(place)
    wanted = lasting._common(place[None], rise[None], errors[None], none, BEAM * one, 0.0 * one)[0][1, 0]
    found = surface(0.04)[:2, :2]
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=0.02 * wanted[0, 0])


def test_the_range_moves_with_that_of_each_voxel() -> None:
    """Claim: gains of a measured range are its derivatives: half a millimetre on one voxel after another."""
    samples, seen = visit()
    assert seen.sight is not None
    appearance = TargetAppearance(kind=TargetKind.BLACK, diameter=2.0 * DISC * DISTANCE)
    for index in range(0, samples.range.shape[1], 9):
        longer = samples.range.copy()
        longer[0, index] += 0.5e-3
        moved = measure_target(
            replace(samples, range=longer),
            appearance,
            DISTANCE,
            spot=0.5 * BEAM / DISTANCE,
            axis_separation=0.0,
        )
        found = (moved.position[0, 2] - seen.position[0, 2]) / 0.5e-3
        assert found == pytest.approx(seen.sight.range_gains[0, index], abs=2e-5)


def test_only_what_is_of_speckle_lasts() -> None:
    """Claim: a range's variance without speckle does not last: σ² − noise remains, here 3/4 or nothing of it."""
    samples, seen = visit()
    assert seen.sight is not None
    gains = seen.sight.range_gains
    for noise, left in ((0.25e-4, 0.01 * np.sqrt(0.75)), (2e-4, 0.0)):
        speckle = lasting.SurfaceSpeckle(np.ones(1), np.ones(1), np.ones(1), np.array([noise]))
        np.testing.assert_allclose(lasting._range_errors(samples, seen.sight, speckle), left * gains)


def test_sums_stand_where_they_belong_and_none_that_lasts_is_negative(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: what neighbours share may be negative; of what lasts and of its harmonics no variance is. Angles go back
    by the plane's matrix, the range's sum is that of the places."""
    random = np.random.default_rng(2)
    _, seen = visit()
    sight = seen.sight
    assert sight is not None
    back = random.normal(size=(1, 2, 2))
    monkeypatch.setattr(TargetPlane, "back", back)
    root = random.normal(size=(4, 1, 2, 2))
    lit = root @ np.swapaxes(root, -1, -2)
    kept = np.array([-3.0, -2.0, 5.0, -4.0])[:, None, None, None]
    lit[0] *= -1.0
    asked: list[Array] = []

    def common(*given: Array) -> tuple[Array, Array]:
        asked.extend(given[2:4])
        return lit, kept

    monkeypatch.setattr(lasting, "_common", common)
    one = np.ones(1)
    speckle = lasting.SurfaceSpeckle(BEAM * one, np.full(sight.place.shape[::2], 0.09), 0.0 * one, one)
    found = lasting._surface(sight, speckle, 3.0 * sight.range_gains, np.array([0]))
    for number, range_part in enumerate([-3.0, 0.0, 5.0, 0.0]):
        np.testing.assert_allclose(found[number, 0, :2, :2], back[0] @ lit[number, 0] @ back[0].T, rtol=1e-9)
        assert found[number, 0, 2].tolist() == [0.0, 0.0, range_part]
    # Light errs by the root of its relative variance.
    assert sight.light_gains is not None
    np.testing.assert_allclose(asked[0], 0.3 * sight.light_gains)
    np.testing.assert_array_equal(asked[1][:, 0], 3.0 * sight.range_gains)


def test_voxels_without_a_range_move_none() -> None:
    """Claim: a voxel errs by the root of its variance less that of its noise, if it has a range and more than its
    noise; its gain says by how much the target's range does."""
    samples, seen = visit()
    assert seen.sight is not None
    points = samples.theta.shape[1]
    sigma, noise = np.linspace(1e-3, 9e-3, points)[None], np.full((1, points), 9e-6)
    samples = replace(samples, sigma_range=sigma)
    samples.status[0, ::3] = 1
    speckle = lasting.SurfaceSpeckle(np.ones(1), noise, np.ones(1), noise)
    sight = replace(seen.sight, range_gains=np.linspace(-2.0, 5.0, points)[None])
    found = lasting._range_errors(samples, sight, speckle)
    for number in range(points):
        beyond = max(sigma[0, number] ** 2 - 9e-6, 0.0) if number % 3 else 0.0
        assert found[0, number] == pytest.approx(sight.range_gains[0, number] * beyond**0.5, rel=1e-9)
