"""The sums behind the ledger's experiments, on numbers whose answers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from claims import mean_square

from scanner_sim.validation.reproduce.family import crossing, echoes, spots, tiles


def test_a_dark_column_is_seen_by_its_depth_over_the_noise_of_such_means() -> None:
    """Claim: a column of depth s in white noise of σ = 1 is seen at s √(rows/3), as mean over rows and three columns.

    Set-up: 60 rows, 161 columns, a trend along the row, 200 images, s = 6. Expected: 6 √20, and up to a tenth more: the
    largest of the three means that hold the column lies above it by less than one, and one over the noise of some forty
    independent means is 2 % too large. Neither more nor less can come of averaging the wrong number of rows or columns.
    """
    random = np.random.default_rng(11)
    expected = 6.0 * math.sqrt(60.0 / 3.0)
    found = []
    for _ in range(200):
        image = random.normal(size=(60, 161)) + 100.0 + 0.05 * np.arange(161)
        image[:, 80] -= 6.0
        found.append(tiles._visibility(image))
    assert expected < np.mean(found) < 1.1 * expected
    empty = [tiles._visibility(random.normal(size=(60, 161))) for _ in range(200)]
    assert np.mean(np.array(empty) > 5.0) < 0.01


def test_the_narrowest_crack_is_where_the_criterion_is_crossed() -> None:
    widths = np.array([0.1, 0.2, 0.4, 0.8])
    assert tiles._narrowest(widths, np.array([1.0, 2.5, 10.0, 40.0])) == pytest.approx(0.2 * math.sqrt(2.0))
    assert tiles._narrowest(widths, np.array([6.0, 12.0, 20.0, 40.0])) == 0.1
    assert tiles._narrowest(widths, np.array([1.0, 2.0, 3.0, 4.99])) == math.inf
    assert tiles._narrowest(widths, np.array([1.0, 2.0, 3.0, 5.01])) == pytest.approx(0.8, rel=5e-3)


def test_a_dents_depth_is_fitted_through_noise_and_tilt() -> None:
    """Claim: from 6400 points that err by 0.3 mm the depth comes out within 0.1 mm, with a plane of any tilt."""
    random = np.random.default_rng(5)
    edge = np.linspace(-0.06, 0.06, 80)
    x, y = (axis.ravel() for axis in np.meshgrid(edge, edge))
    dent = tiles._sag(np.hypot(x - 2e-3, y + 1e-3), 4e-3, 36e-3)
    z = 4.0 + 0.03 * x - 0.02 * y + dent + 0.3e-3 * random.normal(size=x.size)
    z[::50] = np.nan
    assert tiles._fitted_depth(x, y, z) == pytest.approx(4e-3, abs=1e-4)


def test_a_spherical_dent_is_deepest_in_its_middle_and_ends_at_its_rim() -> None:
    depth = tiles._sag(np.array([0.0, 0.019, 0.038, 0.05]), 5e-3, 38e-3)
    sphere = (0.038**2 + 0.005**2) / 0.01
    assert depth == pytest.approx(
        [5e-3, math.sqrt(sphere**2 - 0.019**2) - (sphere - 5e-3), 0.0, 0.0], abs=1e-12
    )


def test_the_dented_tile_is_as_large_and_as_deep_as_published() -> None:
    """Claim: 0.2 m wide, 5 mm deep in its middle, level beyond 38 mm, and each square of the grid is two triangles."""
    lines = tiles._dented(41).splitlines()
    start = lines.index("end_header") + 1
    points = np.array([line.split() for line in lines[start : start + 41**2]], dtype=np.float64)
    faces = np.array([line.split() for line in lines[start + 41**2 :]], dtype=np.int64)
    assert (points[:, :2].min(), points[:, :2].max()) == (-0.1, 0.1)
    from_axis = np.hypot(points[:, 0], points[:, 1])
    assert points[from_axis < 1e-9, 2] == pytest.approx(5e-3)
    assert not points[from_axis > 0.038, 2].any()
    assert len(faces) == 2 * 40**2
    a, b, c = (points[faces[:, 1 + corner], :2] for corner in range(3))
    area = 0.5 * np.abs(np.linalg.det(np.stack([b - a, c - a], axis=-1)))
    np.testing.assert_allclose(area, 0.5 * 0.005**2, rtol=1e-6)


def test_a_crossing_has_the_standard_error_that_it_states() -> None:
    """Claim: the place where a rising ratio is one errs as stated. Set-up: R² over 9.5 m, 3 % noise, 3000 curves."""
    random = np.random.default_rng(3)
    distances = np.geomspace(3.0, 30.0, 11)
    pairs = []
    for _ in range(3000):
        ratio = (distances / 9.5) ** 2 * np.exp(0.03 * random.normal(size=11))
        pairs.append(spots.crossing_of(distances, ratio, 0.03))
    found, error = np.array(pairs).T
    # The four neighbours are chosen by the noise itself, which narrows the scatter by some per cent.
    assert mean_square((np.log(found) - math.log(9.5)) / (error / found), slack=0.1)
    assert spots.crossing_of(distances, np.full(11, 0.5), 0.03) == (math.inf, 0.0)


@pytest.mark.parametrize(("near", "kept"), [(10.0, slice(4, 8)), (3.3, slice(0, 3)), (2.0, slice(0, 3))])
def test_a_crossing_is_that_of_a_line_through_four_neighbours(near: float, kept: slice) -> None:
    """Claim: of a straight line through two points before the crossing and two behind it, or three at the beginning;
    its error is that of the line's points, each of which moves it by a difference quotient."""
    distances = np.geomspace(3.0, 30.0, 11)
    others = np.where(np.isin(np.arange(11), np.arange(11)[kept]), 1.0, np.where(distances < near, 0.7, 1.3))
    ratio = (distances / near) ** 2 * others
    found, error = spots.crossing_of(distances, ratio, 0.03)
    assert found == pytest.approx(near, rel=1e-9)
    moved = []
    for point in range(11):
        ends = [
            spots.crossing_of(distances, ratio * np.exp(way * 1e-4 * (np.arange(11) == point)), 0.03)[0]
            for way in (1, -1)
        ]
        moved.append((ends[0] - ends[1]) / 2e-4)
    assert error == pytest.approx(0.03 * float(np.linalg.norm(moved)), rel=1e-5)
    assert np.flatnonzero(np.abs(moved) > 1e-6).tolist() == list(range(11)[kept])


def test_the_angle_from_which_a_share_rules() -> None:
    degrees, share = np.array([0.0, 30.0, 60.0, 70.0]), np.array([0.0, 0.25, 0.45, 0.65])
    found = echoes._first_above(degrees, share, np.full(4, 0.02))
    assert (found.value, found.error) == pytest.approx((62.5, 1.0))
    assert echoes._first_above(degrees, 0.5 * share, np.full(4, 0.02)).value == math.inf


def test_closed_forms_meet_where_their_ratio_is_one() -> None:
    distances = np.geomspace(2.0, 30.0, 40)
    assert crossing._meeting(distances, (distances / 8.0) ** 2) == pytest.approx(8.0, rel=1e-6)
    assert math.isnan(crossing._meeting(distances, (distances / 50.0) ** 2))
    assert math.isnan(crossing._meeting(distances, (distances / 1.0) ** 2))
