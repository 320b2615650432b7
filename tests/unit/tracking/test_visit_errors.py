"""What visits have in common of their errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ive

from scanner_sim.optics.deflection import WOBBLE_LASTS, wobble_correlation
from scanner_sim.tracking.errors import ErrorParts, _left_apart, common_covariance, pixel_correlation


def parts(count: int) -> ErrorParts:
    """As many equal visits, each with all parts."""
    white = ErrorParts.all_white(np.broadcast_to(np.diag([4.0, 3.0, 2.0]), (count, 3, 3)))
    one = np.ones(count)
    surface = np.array([[1.0, 0.2, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 5.0]])
    return replace(
        white,
        surface=np.broadcast_to(surface, (count, 3, 3)),
        pixels=7.0 * one,
        image=50.0 * one,
        wobble=0.5 * one,
        wobble_time=0.05 * one,
        wobble_angle=0.05 * one,
        drift=np.broadcast_to([0.1, -0.2], (count, 2)),
    )


def test_the_parts_make_the_whole() -> None:
    whole = parts(2).whole[1]
    drift = np.outer([0.1, -0.2, 0.0], [0.1, -0.2, 0.0])
    wanted = np.array([[5.5, 0.2, 0.0], [0.2, 4.5, 0.0], [0.0, 0.0, 14.0]]) + drift
    np.testing.assert_allclose(whole, wanted, rtol=1e-14)


def test_a_visit_shares_with_itself_all_but_the_white_part() -> None:
    made = parts(1)
    common = common_covariance(made, np.zeros((1, 3)), np.zeros(1), [0])
    np.testing.assert_allclose(common[0, 0], made.whole[0] - made.white[0], rtol=1e-14)


def test_surfaces_belong_to_targets_and_the_rest_to_all() -> None:
    """Two targets at one φ, 0.2 rad apart in Θ, at one time: they share Θ's wobble and the pixels."""
    place = np.array([[0.0, 0.1, 8.0], [0.2, 0.1, 8.0]])
    between = common_covariance(parts(2), place, np.zeros(2), [0, 1])[0, 1]
    np.testing.assert_allclose(between, [[0.51, -0.02, 0.0], [-0.02, 0.04, 0.0], [0.0, 0.0, 7.0]], atol=1e-14)
    later = common_covariance(parts(2), place, np.array([0.0, 1.0]), [0, 1])[0, 1]
    np.testing.assert_allclose(np.diag(later), [0.01, 0.04, 7.0], atol=1e-14)
    lasting = common_covariance(parts(2), place, np.zeros(2), [0, 0], lasting=True)[0, 1]
    np.testing.assert_allclose(np.diag(lasting), [1.01, 1.04, 12.0], atol=1e-14)


def test_visits_whose_dwells_lie_alike_share_what_the_dither_moves() -> None:
    """Claim: visits to one target share Σ C_h cos(2π h Δ) beside the rest, and it is of the white part: a visit shares
    none of it with itself, nor visits to other targets, and it does not last."""
    plain = parts(3)
    made = replace(
        plain,
        dither=np.broadcast_to([np.diag([2.0, 1.0, 0.5]), np.diag([0.5, 0.2, 1.0])], (3, 2, 3, 3)),
        dwell_place=np.array([0.0, 0.25, 1.1]),
    )
    place, time = np.zeros((3, 3)), np.zeros(3)
    more = common_covariance(made, place, time, [0, 0, 1]) - common_covariance(plain, place, time, [0, 0, 1])
    wanted = np.zeros((3, 3, 3, 3))
    # A quarter apart the first harmonic shares nothing and the second is opposite.
    wanted[0, 1] = wanted[1, 0] = np.diag([-0.5, -0.2, -1.0])
    np.testing.assert_allclose(more, wanted, atol=1e-12)
    alike = common_covariance(made, place, time, [0, 1, 0]) - common_covariance(plain, place, time, [0, 1, 0])
    first, second = np.cos(0.2 * np.pi), np.cos(0.4 * np.pi)
    np.testing.assert_allclose(
        np.diag(alike[0, 2]), [2.0 * first + 0.5 * second, first + 0.2 * second, 0.5 * first + second]
    )
    lasts = [common_covariance(own, place, time, [0, 0, 0], lasting=True) for own in (made, plain)]
    np.testing.assert_array_equal(*lasts)


@pytest.mark.parametrize("rate", [0.0, 2.7])
@pytest.mark.parametrize("apart", [0.1, 0.4, 1.0])
def test_patterns_beside_each_other_share_less(rate: float, apart: float) -> None:
    """Claim: what is left is the mean over all directions of a curve of exp(−(n·δ)²) cos(k t·δ), to 1 %: without k the
    closed form exp(−δ²/2) I₀(δ²/2)."""
    turn = np.linspace(0.0, np.pi, 2000, endpoint=False)
    wanted = np.mean(np.exp(-((apart * np.sin(turn)) ** 2)) * np.cos(rate * apart * np.cos(turn)))
    if rate == 0.0:
        assert wanted == pytest.approx(ive(0, 0.5 * apart**2))
    for way in (0.0, 0.3, 1.9):
        moved = apart * np.array([np.cos(way), np.sin(way)])
        assert _left_apart(moved, rate) == pytest.approx(wanted, abs=0.01)


def test_the_surface_lasts_less_where_patterns_lie_apart() -> None:
    """Claim: of one target's visits the surface's part and the dither's are what is left at their distance and the way
    from dwell to dwell; a visit keeps all of its own, and other targets' visits do not feel it."""
    plain = parts(3)
    dither = np.broadcast_to([np.diag([2.0, 1.0, 0.5]), np.diag([0.5, 0.2, 1.0])], (3, 2, 3, 3))
    place, time = np.zeros((3, 3)), np.zeros(3)
    moved = replace(
        plain, dither=dither, dwell_step=np.array([2.0, 3.0, 1.0]),
        offset=np.array([[0.1, 0.0], [0.1, 0.3], [0.5, 0.5]]),
    )  # fmt: skip
    found = common_covariance(moved, place, time, [0, 0, 1]) - common_covariance(
        plain, place, time, [0, 0, 1]
    )
    wanted = np.zeros((3, 3, 3, 3))
    left = [float(_left_apart(np.array([0.0, 0.3]), 2.0 * np.pi * h / 2.5)) for h in (0, 1, 2)]
    surface = plain.surface[0]
    wanted[0, 1] = (left[0] - 1.0) * surface + left[1] * dither[0, 0] + left[2] * dither[0, 1]
    wanted[1, 0] = wanted[0, 1]
    np.testing.assert_allclose(found, wanted, atol=1e-9)


@pytest.mark.parametrize("share", [1.0, 4.0, -0.5])
def test_surfaces_that_differ_share_standard_errors(share: float) -> None:
    """Claim: of visits to one target whose surfaces' parts differ no weighted sum has a negative variance.

    Expected: the surfaces' part of a sum is (w₁ L₁ + w₂ L₂)(w₁ L₁ + w₂ L₂)ᵀ of both roots. The rest is that of
    visits to two targets, whose surfaces have nothing in common.
    """
    made = parts(2)
    large = np.array([[26.0, 3.0, 1.0], [3.0, 20.0, 0.0], [1.0, 0.0, 9.0]])
    made = replace(made, surface=np.stack([made.surface[0], large]))
    between = common_covariance(made, np.zeros((2, 3)), np.zeros(2), [0, 0], lasting=True)
    others = common_covariance(made, np.zeros((2, 3)), np.zeros(2), [0, 1], lasting=True)
    weight = np.array([1.0 - share, share])
    found = np.einsum("i,j,ijab->ab", weight, weight, between)
    roots = np.linalg.cholesky(made.surface)
    both = np.einsum("i,iab->ab", weight, roots)
    apart = np.einsum("i,j,ijab->ab", weight, weight, others)
    own = np.einsum("i,iab->ab", weight**2, made.surface)
    np.testing.assert_allclose(found - apart, both @ both.T - own, atol=1e-12)


def test_images_apart_share_what_their_weights_do() -> None:
    """Σ x q(x) ε(x) of Gaussian images q over white ε, by sums on a fine grid."""
    x = np.linspace(-12.0, 12.0, 4801)

    def weight(middle: float) -> np.ndarray:
        return (x - middle) * np.exp(-0.5 * (x - middle) ** 2)

    for apart in (0.0, 0.5, 1.0, 2.5):
        wanted = (weight(0.0) * weight(apart)).sum() / (weight(0.0) ** 2).sum()
        assert pixel_correlation(apart) == pytest.approx(wanted, abs=1e-9)


def test_the_wobble_is_as_alike_as_its_lattice_makes_it() -> None:
    """4000 lattices of normal numbers, 400 cells each: correlations to 0.01, four σ of a mean of 8000 products."""
    rng = np.random.default_rng(6)
    numbers = rng.standard_normal((4000, 12))

    def wobble(at: np.ndarray) -> np.ndarray:
        cell = np.floor(at).astype(int)
        step = 0.5 * np.pi * (at - cell) ** 2 * (3.0 - 2.0 * (at - cell))
        return np.cos(step) * numbers[:, cell] + np.sin(step) * numbers[:, cell + 1]

    at = np.linspace(0.0, 9.0, 361)[:-1]
    for apart in (0.2, 0.7, 1.3, 1.9):
        found = float((wobble(at) * wobble(at + apart)).mean())
        assert wobble_correlation(apart) == pytest.approx(found, abs=0.02)
    assert wobble_correlation([-0.7, 2.0, 7.0]).tolist() == [wobble_correlation(0.7), 0.0, 0.0]
    # The mean of many visits has 2 WOBBLE_LASTS times of a wobble's variance over its length.
    apart = np.linspace(0.0, 3.0, 3001)
    assert pytest.approx(np.trapezoid(wobble_correlation(apart), apart), abs=1e-3) == WOBBLE_LASTS


def test_images_are_as_far_apart_as_they_are_wide() -> None:
    """Claim: images Δ apart, of the widths s and s′, share what they would at Δ/√(s s′)."""
    made = replace(parts(2), image=np.array([10.0, 13.0]), image_width=np.array([2.0, 4.5]))
    between = common_covariance(made, np.zeros((2, 3)), np.zeros(2), [0, 1])[0, 1]
    assert between[2, 2] == pytest.approx(7.0 * pixel_correlation(3.0 / 3.0))


def test_visits_without_a_measurement_stand_beside_calibrated_ones() -> None:
    """A visit that found nothing has no errors of the calibration: in a stack they are zeros, and the others stay."""
    calibrated = replace(parts(1).at(0), common=np.arange(6.0).reshape(3, 2))
    lost = ErrorParts.all_white(np.full((3, 3), np.nan))
    both = ErrorParts.stack([lost, calibrated])
    assert both.common.shape == (2, 3, 2)
    assert not both.common[0].any()
    np.testing.assert_array_equal(both.common[1], calibrated.common)


def test_errors_that_have_nothing_in_common_are_white_and_their_own() -> None:
    """Claim: all of the covariance is white, and stays so whatever becomes of the array that it came from; nothing
    lasts."""
    covariance = np.diag([4e-12, 9e-12, 1e-8]) + 1e-12
    parts = ErrorParts.all_white(covariance)
    kept = covariance.copy()
    covariance[:] = 7.0
    np.testing.assert_array_equal(parts.white, kept)
    np.testing.assert_array_equal(parts.whole, kept)
    assert not parts.lasting.any()


def test_errors_of_a_calibration_are_those_of_all_visits() -> None:
    """Claim: what k errors of unit variance make of each visit, A (3, k), is A Aᵀ of its own covariance and A Bᵀ of
    that with any other visit, of whichever target, also where only what lasts is asked for."""
    made = np.random.default_rng(9).normal(size=(4, 3, 5))
    plain = parts(4)
    told = replace(plain, common=made)
    place, time, target = np.linspace(0.0, 1.0, 12).reshape(4, 3), 0.1 * np.arange(4.0), [0, 1, 0, 2]
    for lasting in (False, True):
        with_it, without = (
            common_covariance(one, place, time, target, lasting=lasting) for one in (told, plain)
        )
        for first in range(4):
            for second in range(4):
                added = with_it[first, second] - without[first, second]
                np.testing.assert_allclose(added, made[first] @ made[second].T, atol=1e-12)
    own = np.stack([one @ one.T for one in made])
    np.testing.assert_allclose(told.shared - plain.shared, own, atol=1e-12)
    np.testing.assert_allclose(told.whole - plain.whole, own, atol=1e-12)
    np.testing.assert_allclose(told.lasting, told.whole - told.white, atol=1e-12)


def test_some_visits_keep_all_that_is_theirs() -> None:
    """Claim: by an index, in another shape, and put together again, each visit has its own numbers."""
    rng = np.random.default_rng(3)
    plain = parts(6)
    made = replace(plain, **{name: rng.normal(size=part.shape) for name, part in vars(plain).items()})
    table = made.reshape((2, 3))
    for row in range(2):
        for column in range(3):
            one, other = table.at((np.array([row]), np.array([column]))), made.at(3 * row + column)
            for name, part in vars(one).items():
                np.testing.assert_array_equal(part[0], getattr(other, name))
                np.testing.assert_array_equal(part[0], getattr(made, name)[3 * row + column])
    again = ErrorParts.stack([made.at(number) for number in range(6)])
    for name, part in vars(again).items():
        np.testing.assert_array_equal(part, getattr(made, name))


def test_the_wobble_goes_with_time_and_with_the_other_mirrors_angle() -> None:
    """Claim: of visits i and j Θ has in common √(w_i w_j) ρ(Δt/τ) ρ(Δφ/α), φ the same with ΔΘ; τ and α are two numbers,
    and nothing of it is shared by Θ and φ."""
    time, place = np.array([0.3, 0.33]), np.array([[0.1, -0.2, 5.0], [0.13, -0.25, 5.2]])
    plain = ErrorParts.all_white(np.zeros((2, 3, 3)))
    made = replace(
        plain, wobble=np.array([2.0, 4.5]), wobble_time=np.full(2, 0.04), wobble_angle=np.full(2, 0.09)
    )
    found = common_covariance(made, place, time, [0, 1])
    late = 3.0 * wobble_correlation(0.03 / 0.04)
    wanted = np.diag([late * wobble_correlation(0.05 / 0.09), late * wobble_correlation(0.03 / 0.09), 0.0])
    np.testing.assert_allclose(found[0, 1], wanted, rtol=1e-9)
    np.testing.assert_allclose(found[1, 0], wanted, rtol=1e-9)
    np.testing.assert_allclose(found[1, 1], np.diag([4.5, 4.5, 0.0]), atol=1e-15)
