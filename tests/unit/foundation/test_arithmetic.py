"""Float64 arithmetic that does not depend on the processor, against NumPy's own and exact values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scanner_sim.foundation import arithmetic

EPSILON = np.finfo(np.float64).eps


def positive(size: int, stack: tuple[int, ...]) -> np.ndarray:
    """Symmetric positive definite matrices with condition numbers up to about 10⁶."""
    rng = np.random.default_rng(size)
    root = rng.normal(size=(*stack, size, size))
    scale = 10.0 ** rng.uniform(-1.0, 1.0, (*stack, size))
    spread = root @ np.swapaxes(root, -1, -2) + 1e-3 * np.eye(size)
    return scale[..., None] * spread * scale[..., None, :]


@pytest.mark.parametrize("size", [1, 2, 3, 5, 6])
def test_solutions_are_backward_stable(size: int) -> None:
    """Claim: |A X − B| ≤ 10 n ε |A| |X|, which bounds the error by the condition number as LAPACK's does."""
    matrix = positive(size, (50, 4))
    right = np.random.default_rng(1).normal(size=(4, size, 3))
    found = arithmetic.solve_linear(matrix, right)
    most = 10 * size * EPSILON * np.abs(matrix).sum((-2, -1)) * np.abs(found).max((-2, -1))
    assert (np.abs(matrix @ found - right).max((-2, -1)) <= most).all()
    np.testing.assert_allclose(
        arithmetic.inverse(matrix) @ matrix, np.eye(size) + np.zeros_like(matrix), atol=1e-7
    )


def test_one_of_a_stack_has_the_bytes_that_it_has_alone() -> None:
    matrix = positive(6, (20,))
    for whole, alone in (
        (arithmetic.inverse(matrix), [arithmetic.inverse(one) for one in matrix]),
        (arithmetic.eigen(matrix)[1], [arithmetic.eigen(one)[1] for one in matrix]),
        (arithmetic.product(matrix, matrix), [arithmetic.product(one, one) for one in matrix]),
    ):
        assert whole.tobytes() == np.stack(alone).tobytes()


def test_a_singular_matrix_spoils_its_own_solution_only() -> None:
    stack = np.stack([np.eye(2), np.ones((2, 2)), 2.0 * np.eye(2)])
    found = arithmetic.inverse(stack)
    assert np.isfinite(found[[0, 2]]).all()
    assert not np.isfinite(found[1]).all()


@pytest.mark.parametrize("size", [2, 3, 4, 6])
def test_eigenvectors_diagonalise_and_ascend(size: int) -> None:
    matrix = positive(size, (30,))
    values, vectors = arithmetic.eigen(matrix)
    largest = np.abs(matrix).max((-2, -1), keepdims=True)
    rebuilt = vectors * values[:, None] @ np.swapaxes(vectors, -1, -2)
    assert (np.abs(rebuilt - matrix) <= 40 * EPSILON * size * largest).all()
    np.testing.assert_allclose(
        np.swapaxes(vectors, -1, -2) @ vectors, np.eye(size) + 0.0 * matrix, atol=1e-13
    )
    assert (np.diff(values, axis=-1) >= 0.0).all()
    # Of matrices in rows and columns, each as it is by itself.
    rows = arithmetic.eigen(matrix.reshape(5, 6, size, size))
    np.testing.assert_array_equal(rows[0], values.reshape(5, 6, size))
    np.testing.assert_array_equal(rows[1], vectors.reshape(5, 6, size, size))


def test_eigenvalues_of_degenerate_matrices() -> None:
    for matrix, expected in (
        (np.zeros((3, 3)), [0.0, 0.0, 0.0]),
        (np.diag([3.0, 1.0, 2.0]), [1.0, 2.0, 3.0]),
        (np.ones((3, 3)), [0.0, 0.0, 3.0]),
    ):
        np.testing.assert_allclose(arithmetic.eigen(matrix)[0], expected, atol=1e-15)


def test_products_apply_as_numpys_do() -> None:
    rng = np.random.default_rng(2)
    a, b, c, v = (
        rng.normal(size=(7, 2, 3)),
        rng.normal(size=(3, 4)),
        rng.normal(size=(7, 4, 5)),
        rng.normal(size=3),
    )
    np.testing.assert_allclose(arithmetic.product(a, b, c), a @ b @ c, rtol=0, atol=1e-14)
    np.testing.assert_allclose(arithmetic.applied(a, v), a @ v, rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", ["exp", "log", "tan", "arcsin"])
def test_functions_are_rounded_from_more_digits(name: str) -> None:
    """Claim: within an ulp of the C library's, at scalars and arrays alike."""
    x = np.linspace(0.01, 0.99, 500)
    of_math = np.array([getattr(math, {"arcsin": "asin"}.get(name, name))(value) for value in x])
    found = getattr(arithmetic, name)(x)
    assert (np.abs(found - of_math) <= np.spacing(np.abs(of_math))).all()
    assert float(getattr(arithmetic, name)(float(x[3]))) == found[3]


def test_many_exponentials_are_those_of_few() -> None:
    """Claim: the way of many values gives the number of extended precision at all of them, and where there is none.

    A hundredth of them is not told by the table: an error of its first terms would show in thousands.
    """
    rng = np.random.default_rng(4)
    size = 10.0 ** rng.uniform(-12.0, np.log10(760.0), 200_000)
    x = np.concatenate([-size, size[size < 709.0], [0.0, -0.0, -np.inf, np.nan, 1.0]])
    expected = np.exp(x, dtype=np.longdouble).astype(np.float64)
    np.testing.assert_array_equal(arithmetic.exp(x), expected)
    np.testing.assert_array_equal(
        arithmetic.exp(x[:1000].reshape(2, 5, 100)[:, :, ::-1])[1, 4, 99], expected[900]
    )


def test_exponentials_lie_where_their_exponents_do() -> None:
    """Claim: of many values in any layout: turned, backwards, every second, one repeated along an axis without memory
    of its own; what was given stays."""
    given = np.random.default_rng(3).normal(size=(20, 18))
    turned = np.broadcast_to(given.T[::-1, ::2], (8, 18, 10))
    for values in (turned, np.moveaxis(turned, 0, 2), np.broadcast_to(given[..., None], (20, 18, 5)).T):
        before = values.copy()
        np.testing.assert_array_equal(
            arithmetic.exp(values), np.exp(values, dtype=np.longdouble).astype(float)
        )
        np.testing.assert_array_equal(values, before)


def test_angles_in_all_quadrants() -> None:
    for degrees in range(-179, 180, 7):
        angle = math.radians(degrees)
        assert float(arithmetic.arctan2(math.sin(angle), math.cos(angle))) == pytest.approx(angle, abs=1e-15)


def test_a_covariance_is_told_from_what_is_none() -> None:
    """Claim: the square of any root is one, of full rank or not, in any units; none of its spoilt copies is."""
    rng = np.random.default_rng(3)
    units = 10.0 ** rng.uniform(-9.0, 9.0, 6)
    for rank in (1, 3, 6):
        root = units[:, None] * rng.normal(size=(6, rank))
        good = root @ root.T
        good = 0.5 * (good + good.T)
        assert arithmetic.is_covariance(good)
        assert arithmetic.is_covariance(0.0 * good)
        aslant, opposed, negative, alone = (good.copy() for _ in range(4))
        aslant[0, 1] *= 1.0 + 1e-6
        size = 1.01 * np.sqrt(good[0, 0] * good[1, 1])
        opposed[0, 1] = opposed[1, 0] = size
        negative[2, 2] *= -1.0
        alone[3, 3] = 0.0
        assert not any(map(arithmetic.is_covariance, (aslant, opposed, negative, alone))), rank


def test_roots_of_a_quartic_are_those_that_it_is_made_of() -> None:
    """Claim: four real roots, by their own rounding, and two real ones and a pair of complex ones, by the roots' sums.

    Set-up: 400 sets, a quarter apart at least, also one root a millionth of the others. Tolerance: a coefficient's
    rounding moves a root by ε Σ|terms|/|slope|, of which 20 are granted; NumPy's eigenvalues are not asked.
    """
    rng = np.random.default_rng(7)
    roots = np.cumsum(rng.uniform(0.25, 2.0, (4, 400)), axis=0) - 4.0
    roots[0, 200:] = 1e-6 * rng.uniform(1.0, 2.0, 200)
    roots[1:, 200:] += 6.0
    exact = np.sort(roots, axis=0)
    terms = np.array([np.poly(one)[1:] for one in exact.T]).T
    real, imaginary = arithmetic.quartic_roots(terms)
    found = np.sort(real, axis=0)
    whole = np.stack([np.ones(400), *terms])
    sizes = np.stack([np.polyval(np.abs(whole[:, n]), np.abs(exact[:, n])) for n in range(400)], axis=1)
    slopes = np.stack([np.polyval(np.polyder(whole[:, n]), exact[:, n]) for n in range(400)], axis=1)
    assert not imaginary.any()
    assert (np.abs(found - exact) <= 20.0 * EPSILON * sizes / np.abs(slopes)).all()
    middle, apart = rng.uniform(-2.0, 2.0, 400), rng.uniform(0.5, 2.0, 400)
    pair = np.stack([np.ones(400), -2.0 * middle, middle**2 + apart**2])
    lone = np.stack([np.ones(400), -exact[0] - exact[3], exact[0] * exact[3]])
    terms = np.array([np.polymul(one, other)[1:] for one, other in zip(pair.T, lone.T, strict=True)]).T
    real, imaginary = arithmetic.quartic_roots(terms)
    order = np.argsort(np.abs(imaginary), axis=0, kind="stable")
    real, imaginary = np.take_along_axis(real, order, 0), np.take_along_axis(imaginary, order, 0)
    assert not imaginary[:2].any()
    np.testing.assert_allclose(np.sort(real[:2], axis=0), exact[[0, 3]], rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(real[2:], np.stack([middle, middle]), atol=1e-9)
    np.testing.assert_allclose(np.sort(imaginary[2:], axis=0), np.stack([-apart, apart]), atol=1e-9)


@pytest.mark.parametrize("rank", [1, 3, 5])
def test_a_pseudo_inverse_is_that_of_moore_and_penrose(rank: int) -> None:
    """Claim: A A⁺ A = A, A⁺ A A⁺ = A⁺ and A⁺ A is symmetric, of indefinite matrices too; an eigenvalue of 10⁻¹³ of the
    largest counts, and one of 10⁻¹⁷ does not."""
    rng = np.random.default_rng(rank)
    turned = np.linalg.qr(rng.normal(size=(20, 5, 5)))[0]
    values = np.zeros((20, 5))
    values[:, :rank] = rng.uniform(0.5, 2.0, (20, rank)) * rng.choice([-1.0, 1.0], (20, rank))
    matrix = turned * values[:, None] @ np.swapaxes(turned, -1, -2)
    found = arithmetic.pseudo_inverse(matrix)
    np.testing.assert_allclose(matrix @ found @ matrix, matrix, atol=1e-13)
    np.testing.assert_allclose(found @ matrix @ found, found, atol=1e-13)
    both = found @ matrix
    np.testing.assert_allclose(both, np.swapaxes(both, -1, -2), atol=1e-13)
    np.testing.assert_allclose(np.einsum("nii->n", both), rank, rtol=1e-12)
    small = arithmetic.pseudo_inverse(np.diag([2.0, 2e-13, 2e-17]))
    np.testing.assert_allclose(np.diagonal(small), [0.5, 0.5e13, 0.0])
