"""Which dots agree with a pose, by hand, and what estimates refuse: limits of place and size, signs, unknown parts."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_dots import made_dots
from numpy.typing import NDArray

from scanner_sim import InputError, estimate_pose
from scanner_sim.optics.interior_orientation import InteriorOrientation
from scanner_sim.pose.covariance import error_ellipsoid
from scanner_sim.pose.dot_images import DotArray
from scanner_sim.pose.identify_dots import (
    _agreeing,
    _as_good,
    _named,
    _settled,
    _threes,
    identify,
    symmetries,
)
from scanner_sim.pose.transforms import rotation_from_vector
from scanner_sim.signals.dots.settings import DotStatus

Array = NDArray[np.float64]

CAMERA = InteriorOrientation(focal_length=0.016, pixel_pitch=1e-5, columns=640, rows=480)
SCALE, DISTANCE, RADIUS = 1600.0, 8.0, 0.04
POINTS = np.array([[-0.5, -0.4, 0.0], [0.5, -0.4, 0.0], [0.5, 0.4, 0.0], [-0.3, 0.4, 0.0], [0.1, 0.1, -0.3]])
ARRAY = DotArray(tuple("abcde"), POINTS, np.tile([0.0, 0.0, -1.0], (5, 1)), np.full(5, RADIUS))
TURN, PLACE = np.eye(3), np.array([0.0, 0.0, DISTANCE])
DEPTH = POINTS[:, 2] + DISTANCE
CENTRES = SCALE * POINTS[:, :2] / DEPTH[:, None] + np.array([319.5, 239.5])
HALF = SCALE * RADIUS / np.sqrt((POINTS[:, :2] ** 2).sum(axis=1) + DEPTH**2)
"""A disc's half axis by its radius over its distance."""


def agreeing(
    centres: Array, half: Array, reach: float = 0.0, array: DotArray = ARRAY
) -> tuple[list[int], float]:
    dots = made_dots(centres, half)
    chosen, score = _agreeing(CAMERA, array, dots, np.arange(len(half)), TURN[None], PLACE[None], reach)
    return chosen[0].tolist(), float(score[0])


@pytest.mark.parametrize("reach", [0.0, 3.0])
def test_a_dot_agrees_within_half_its_axis_and_a_pixel_and_a_half(reach: float) -> None:
    """Claim: by the larger of its half axis, 8 pixels here, and 2, halved, with 1.5 and what the prediction may err by;
    the score is how many agree, less the mean of their distances over that."""
    limit = 0.5 * HALF[2] + 1.5 + reach
    away = np.array([0.6, -0.8])
    for share in (0.97, 0.4):
        centres = CENTRES.copy()
        centres[2] += share * limit * away
        chosen, score = agreeing(centres, HALF, reach)
        assert chosen == [0, 1, 2, 3, 4]
        assert score == pytest.approx(5.0 - share / 5.0, abs=1e-6)
    centres = CENTRES.copy()
    centres[2] += 1.03 * limit * away
    chosen, score = agreeing(centres, HALF, reach)
    assert chosen == [0, 1, -1, 3, 4]
    assert score == pytest.approx(4.0, abs=1e-6)


@pytest.mark.parametrize(
    ("ratio", "agrees"), [(1.37, True), (1.43, False), (1.0 / 1.37, True), (1.0 / 1.43, False)]
)
def test_a_dot_agrees_within_a_ratio_of_sizes(ratio: float, agrees: bool) -> None:
    half = HALF.copy()
    half[1] *= ratio
    assert (agreeing(CENTRES, half)[0][1] == 1) == agrees


@pytest.mark.parametrize(("cosine", "agrees"), [(0.16, True), (0.14, False), (-0.9, False)])
def test_a_target_seen_from_the_side_or_from_behind_has_no_dot(cosine: float, agrees: bool) -> None:
    """Claim: a disc agrees with a dot only if its normal is within 81.4° of the way to the camera: cosine 0.15."""
    sight = (POINTS[1] + PLACE) / np.linalg.norm(POINTS[1] + PLACE)
    across = np.cross(sight, [0.0, 1.0, 0.0])
    normals = ARRAY.normals.copy()
    normals[1] = np.sqrt(1.0 - cosine**2) * across / np.linalg.norm(across) - cosine * sight
    turned = DotArray(ARRAY.names, POINTS, normals, ARRAY.radii)
    assert agreeing(CENTRES, HALF, array=turned)[0] == [0, 1 if agrees else -1, 2, 3, 4]


def test_a_dot_belongs_to_the_target_nearest_to_it() -> None:
    """Claim: of two dots beside a target the nearer is its own."""
    both = np.concatenate([CENTRES, CENTRES[3:4] + 2.0])
    both[3] += 3.0
    assert agreeing(both, np.append(HALF, HALF[3]))[0] == [0, 1, 2, 5, 4]


def test_a_dot_that_lies_beside_its_target_is_left_out() -> None:
    """Claim: of five dots one lies 2 pixels, a hundred σ, aside: the others agree by themselves, and it is found by
    nobody."""
    centres = CENTRES.copy()
    centres[1] += 2.0
    found = _settled(CAMERA, ARRAY, made_dots(centres, HALF), np.arange(5), np.arange(5))
    assert found is not None
    assert found[0].tolist() == [0, -1, 2, 3, 4]
    np.testing.assert_allclose(found[1].position, PLACE, atol=1e-3)
    assert (
        _settled(CAMERA, ARRAY, made_dots(centres, HALF), np.arange(5), np.array([0, -1, -1, 3, 4])) is None
    )


def test_of_two_dots_aside_that_is_left_out_whose_place_is_known_better() -> None:
    """Claim: 1 pixel, fifty σ, counts for more than 2.5 pixels, half a σ, which stay."""
    centres = CENTRES.copy()
    centres[1, 0] += 1.0
    centres[3, 1] -= 2.5
    dots = made_dots(centres, HALF)
    dots.covariance[3] = 25.0 * np.eye(2)
    found = _settled(CAMERA, ARRAY, dots, np.arange(5), np.arange(5))
    assert found is not None
    assert found[0].tolist() == [0, -1, 2, 3, 4]


@pytest.mark.parametrize(("share", "status"), [(0.97, DotStatus.SATURATED), (1.03, DotStatus.NOT_FOUND)])
def test_a_failed_dot_lends_its_status_where_it_stands(share: float, status: DotStatus) -> None:
    """Claim: within its target's half axis and 1.5 pixels."""
    dots = made_dots(CENTRES.copy(), HALF)
    chosen = np.array([0, 1, -1, 3, 4])
    dots.centre[2] += share * (HALF[2] + 1.5) * np.array([0.6, 0.8])
    dots.status[2] = DotStatus.SATURATED
    found = _settled(CAMERA, ARRAY, dots, np.array([0, 1, 3, 4]), chosen)
    assert found is not None
    named = _named(CAMERA, ARRAY, dots, found, ambiguous=False)
    valid = DotStatus.VALID
    assert named.status.tolist() == [valid, valid, status, valid, valid]
    np.testing.assert_array_equal(named.dot, chosen)


def test_an_oblong_has_one_symmetry_until_a_corner_moves() -> None:
    """Claim: half a turn about its normal; not a fourth of one, nor a mirror, and none where a corner has moved."""
    corners = np.array([[-0.5, -0.3, 0.0], [0.5, -0.3, 0.0], [0.5, 0.3, 0.0], [-0.5, 0.3, 0.0]])

    def array(points: Array) -> DotArray:
        return DotArray(tuple("abcd"), points, np.tile([0.0, 0.0, -1.0], (4, 1)), np.full(4, RADIUS))

    assert symmetries(array(corners)) == [(2, 3, 0, 1)]
    for way in (0.06, -0.06):
        moved = corners.copy()
        moved[0, 0] += way
        assert symmetries(array(moved)) == []


@pytest.mark.parametrize("size", [0.01, 1.0, 50.0])
def test_a_symmetry_keeps_sizes_and_distances_over_the_arrays_own(size: float) -> None:
    """Claim: radii that differ by less than a tenth are alike, a fifth tells them apart; so it is with arrays of any
    size, whose dots may lie two hundredths of it off."""
    corners = size * np.array([[-0.5, -0.3, 0.0], [0.5, -0.3, 0.0], [0.5, 0.3, 0.0], [-0.5, 0.3, 0.0]])
    facing, reach = np.tile([0.0, 0.0, -1.0], (4, 1)), size * np.hypot(1.0, 0.6)
    for larger, shift, same in ((1.08, 0.0, True), (1.2, 0.0, False), (1.0, 0.015, True), (1.0, 0.03, False)):
        radii, points = np.full(4, 0.1 * size), corners.copy()
        radii[1] *= larger
        points[2, 1] += shift * reach
        found = symmetries(DotArray(tuple("abcd"), points, facing, radii))
        assert found == [(2, 3, 0, 1)] * same


def test_a_solid_has_turns_and_no_mirrors() -> None:
    """Claim: dots at the corners of a tetrahedron whose edges are all alike have the eleven turns that take it to
    itself, and none of its twelve mirrors; with two dots larger, the half turn that changes each pair within it."""
    solid = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
    facing, alike = np.tile([0.0, 0.0, -1.0], (4, 1)), np.full(4, RADIUS)
    assert len(symmetries(DotArray(tuple("abcd"), solid, facing, alike))) == 11
    larger = alike * [1.5, 1.5, 1.0, 1.0]
    assert symmetries(DotArray(tuple("abcd"), solid, facing, larger)) == [(1, 0, 3, 2)]


def test_an_ellipsoid_of_what_is_partly_unknown_is_unknown() -> None:
    covariance = np.diag([4.0, 1.0, 9.0])
    covariance[0, 1] = np.nan
    lengths, axes = error_ellipsoid(np.stack([covariance, np.diag([4.0, 1.0, 9.0])]))
    assert np.isnan(lengths[0]).all()
    assert np.isnan(axes[0]).all()
    np.testing.assert_allclose(lengths[1], [3.0, 2.0, 1.0])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_covariance_is_as_large_as_both_deviations(sign: float) -> None:
    """Claim: |σ_Θφ| < σ_Θ σ_φ, of either sign."""
    sight = np.array([[0.05, 0.02, 8.0], [-0.05, 0.01, 8.1], [0.0, -0.06, 7.9], [0.02, 0.05, 8.0]])

    def estimate(share: float) -> object:
        return estimate_pose(
            POINTS[:4],
            theta=sight[:, 0],
            phi=sight[:, 1],
            ranges=sight[:, 2],
            sigma_theta=2e-5,
            sigma_phi=3e-5,
            sigma_range=1e-3,
            axis_separation=0.05,
            covariance_theta_phi=share * sign * 6e-10,
        )

    estimate(0.97)
    with pytest.raises(InputError, match="less than"):
        estimate(1.03)


def test_a_prediction_may_err_by_its_reach() -> None:
    """Claim: a square of equal dots is told by a pose that is 8 pixels off, within 12 and not within 0, where it looks
    the same four times round."""
    corners = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
    square = DotArray(tuple("abcd"), corners, np.tile([0.0, 0.0, -1.0], (4, 1)), np.full(4, RADIUS))
    centres = SCALE * corners[:, :2] / DISTANCE + np.array([319.5, 239.5])
    dots = made_dots(centres, np.full(4, SCALE * RADIUS / DISTANCE))
    off = PLACE + np.array([8.0 * DISTANCE / SCALE, 0.0, 0.0])
    assert not identify(CAMERA, square, dots, predicted=(TURN, off), reach=12.0).ambiguous
    assert identify(CAMERA, square, dots, predicted=(TURN, off)).ambiguous


@pytest.mark.parametrize(("degrees", "found"), [(38.0, True), (-42.0, False)])
def test_a_pose_is_the_expected_one_within_forty_degrees(degrees: float, found: bool) -> None:
    """Claim: an array that nothing else looks like is found if its attitude is turned from the expected one by less."""
    expected = rotation_from_vector(np.radians(degrees) * np.array([0.6, 0.0, 0.8]))
    named = identify(CAMERA, ARRAY, made_dots(CENTRES, HALF), expected=expected)
    assert named.dot.tolist() == ([0, 1, 2, 3, 4] if found else [-1] * 5)
    assert (named.pose is not None) == found


@pytest.mark.parametrize(("more", "alike"), [(8.8, True), (9.2, False)])
def test_another_assignment_is_as_good_within_a_difference_of_squares(more: float, alike: bool) -> None:
    """Claim: of as many dots, χ² may be 9 larger, however large it is; of other numbers of dots none is as good."""
    best: Any = np.array([3, 1, -1, 0]), SimpleNamespace(chi2=37.0)
    other: Any = np.array([0, -1, 1, 3]), SimpleNamespace(chi2=37.0 + more)
    assert _as_good(other, best) is alike
    fewer: Any = np.array([0, -1, -1, 3]), SimpleNamespace(chi2=1.0)
    assert not _as_good(fewer, best)


def test_threes_of_targets_span_the_array() -> None:
    """Claim: those whose triangles are largest, the largest first, wherever the array's origin is."""
    points = np.random.default_rng(3).uniform(-0.5, 0.5, (6, 3)) + np.array([2.0, -3.0, 1.0])
    array = DotArray(tuple("abcdef"), points, np.tile([0.0, 0.0, -1.0], (6, 1)), np.full(6, RADIUS))
    area = {
        three: np.linalg.norm(
            np.cross(points[three[1]] - points[three[0]], points[three[2]] - points[three[0]])
        )
        for three in (tuple(map(int, one)) for one in combinations(range(6), 3))
    }
    found = [tuple(map(int, one)) for one in _threes(array)]
    assert found == sorted(area, key=area.__getitem__, reverse=True)[: len(found)]
    assert len(found) == 10
