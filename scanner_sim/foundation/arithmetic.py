"""Float64 arithmetic that gives the same bytes on every processor of a kind.

NumPy chooses code by processor for some functions, and so do the libraries (BLAS, LAPACK) behind ``@`` and
``numpy.linalg``: results differ in the last bit, a closed loop or an iteration then goes another way, and its files
differ. What follows is made of sums, products, quotients and square roots, which IEEE 754 defines to the bit and which
are done in an order of their own, or of the C library's extended precision, rounded. ``numpy.einsum`` without
``optimize``, ``numpy.sum``, ``sin``, ``cos`` and ``hypot`` do not depend on the processor and serve as they are.

Matrices are stacks of small ones, shape (..., n, n); none is too small for them to be quick.
"""

from __future__ import annotations

from decimal import Decimal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_SWEEPS = 12
"""Jacobi's method needs about six sweeps for 6 × 6 in float64."""
_POLISH = 3
"""Steps of Newton's method on roots that are known to half the digits."""
_ROUNDING = 1e-9
"""Share of a covariance that is rounding."""
_HIDDEN = 1e-17
"""Size of an entry over the geometric mean of its diagonal ones that float64 does not notice."""
_FEW = 1024
"""Values below which exponentials in extended precision take no longer than by cells."""
_TOGETHER = 1 << 14
"""Values of which exponentials are found together: what lies between fits the processor's cache."""
_CELLS = 1024
_CELL = float(Decimal(2).ln() / _CELLS) // 2.0**-42 * 2.0**-42
_CELL_REST = float(Decimal(2).ln() / _CELLS - Decimal(_CELL))
"""ln 2 over the cells in two parts; multiples of the first by numbers of 22 bits are exact."""
_MIDDLE = np.exp2((np.arange(_CELLS) + np.longdouble(0.5)) / _CELLS)
_OF_MIDDLE = _MIDDLE.astype(np.float64)
_BESIDE_MIDDLE = (_MIDDLE - _OF_MIDDLE).astype(np.float64)
_SURE = 2.0**-53 - 2.0**-60
"""Rest beside a float64 between 1 and 2 below which an error of 2⁻⁶⁰ makes it no other one."""
_NORMAL, _NOTHING = 1020, -746.0
"""Largest power of two, up and down, with which all products are normal numbers; and from where on eˣ is 0."""


def product(*matrices: ArrayLike) -> Array:
    """Return the product of stacks of matrices from left to right, as ``@`` does; at least two of two axes each."""
    result = np.asarray(matrices[0], dtype=np.float64)
    for other in matrices[1:]:
        result = np.einsum("...ij,...jk->...ik", result, np.asarray(other, dtype=np.float64))
    return result


def applied(matrix: ArrayLike, vector: ArrayLike) -> Array:
    """Return matrices (..., m, n) times vectors (..., n)."""
    return np.asarray(
        np.einsum(
            "...ij,...j->...i", np.asarray(matrix, dtype=np.float64), np.asarray(vector, dtype=np.float64)
        )
    )


def columns(*arrays: Array) -> Array:
    """Return k arrays (n, ...) side by side, (n, k, ...): as ``numpy.stack`` does, in a third of its time."""
    return np.concatenate([array[:, None] for array in arrays], axis=1)


def solve_linear(matrix: Array, right: Array) -> Array:
    """Return X of A X = B for symmetric positive definite A.

    Parameters
    ----------
    matrix
        A, shape (..., n, n). Others will do whose leading minors are not small, as triangular ones.
    right
        B, shape (..., n, m).

    Returns
    -------
    ndarray
        Shape (..., n, m); without meaning where A is not positive definite, not finite where it is singular.

    Notes
    -----
    Elimination by Gauss and Jordan, which needs no pivots for such matrices (Golub, Van Loan, *Matrix Computations*,
    2013, section 4.2; Higham, *Accuracy and Stability of Numerical Algorithms*, 2002, section 14.4).
    """
    size = matrix.shape[-1]
    stack = matrix.shape[:-2]
    if right.shape[:-2] not in ((), stack):
        stack = np.broadcast_shapes(stack, right.shape[:-2])
    both = np.empty((size, size + right.shape[-1], *stack))
    both[:, :size], both[:, size:] = _axes_first(matrix, len(stack)), _axes_first(right, len(stack))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for step in range(size):
            # Columns that are done with are carried on: nobody reads them, and to leave them out takes longer.
            row = both[step] / both[step, step]
            both -= both[:, step, None] * row
            both[step] = row
    return _axes_last(both[:, size:])


def inverse(matrix: Array) -> Array:
    """Return the inverse of matrices (..., n, n) of the kind that :func:`solve_linear` takes."""
    return solve_linear(matrix, np.eye(matrix.shape[-1]))


def pseudo_inverse(matrix: ArrayLike) -> Array:
    """Return the inverse of symmetric matrices (..., n, n) in the space that they span (Moore and Penrose).

    What is less than n ε of the largest eigenvalue counts as none.
    """
    values, vectors = eigen(matrix)
    size = np.abs(values)
    spanned = size > values.shape[-1] * np.finfo(np.float64).eps * size.max(axis=-1, keepdims=True)
    inverted = np.where(spanned, 1.0 / np.where(spanned, values, 1.0), 0.0)
    return product(vectors * inverted[..., None, :], np.swapaxes(vectors, -1, -2))


def cholesky(matrix: ArrayLike) -> Array:
    """Return lower triangular L with L Lᵀ the symmetric positive definite matrices (..., n, n); NaN for others."""
    given = _axes_first(np.asarray(matrix, dtype=np.float64))
    lower = np.zeros_like(given)
    with np.errstate(divide="ignore", invalid="ignore"):
        for step in range(len(given)):
            known = lower[step, :step]
            rest = given[step:, step] - np.sum(lower[step:, :step] * known, axis=1)
            lower[step:, step] = rest / np.sqrt(rest[0])
    return _axes_last(lower)


def eigen(matrix: ArrayLike) -> tuple[Array, Array]:
    """Return eigenvalues, ascending, and eigenvectors of symmetric matrices.

    Parameters
    ----------
    matrix
        Shape (..., n, n).

    Returns
    -------
    values, vectors
        Shapes (..., n) and (..., n, n); vector k is column k, of unit length and of either sign.

    Notes
    -----
    Jacobi's method, cyclic by rows (Golub, Van Loan, *Matrix Computations*, 2013, section 8.5).
    """
    here = _axes_first(np.asarray(matrix, dtype=np.float64)).copy()
    size = len(here)
    vectors = np.zeros_like(here)
    vectors[np.arange(size), np.arange(size)] = 1.0
    pairs = [(p, q) for p in range(size) for q in range(p + 1, size)]
    for _ in range(_SWEEPS):
        turned = [_rotate(here, vectors, p, q) for p, q in pairs]
        if not any(turned):
            break
    values = np.moveaxis(here[np.arange(size), np.arange(size)], 0, -1)
    order = np.argsort(values, axis=-1, kind="stable")
    return np.take_along_axis(values, order, -1), np.take_along_axis(
        _axes_last(vectors), order[..., None, :], -1
    )


def _rotate(matrix: Array, vectors: Array, p: int, q: int) -> bool:
    """Bring entry (p, q) of matrices (n, n, ...) to zero by a plane rotation, in place; their vectors turn with them.

    Return whether there was anything to do: what rounding hides beside the diagonal stays.
    """
    off, first, second = matrix[p, q], matrix[p, p], matrix[q, q]
    small = np.abs(off) <= _HIDDEN * np.sqrt(np.abs(first * second))
    if small.all():
        return False
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratio = (second - first) / (2.0 * off)
        tangent = np.copysign(1.0, ratio) / (np.abs(ratio) + np.sqrt(1.0 + ratio * ratio))
    tangent = np.where(small, 0.0, tangent)
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    sine = tangent * cosine
    for array in (matrix, vectors, np.swapaxes(matrix, 0, 1)):
        along, across = array[:, p].copy(), array[:, q].copy()
        array[:, p], array[:, q] = cosine * along - sine * across, sine * along + cosine * across
    matrix[p, q] = matrix[q, p] = 0.0
    return True


def is_covariance(matrix: Array) -> bool:
    """Return whether a matrix (n, n) is a covariance but for rounding: symmetric, and no variance is negative.

    Rounding goes by the standard deviations, so that units do not count: 1e-9 of their products.
    """
    sigma = np.sqrt(np.maximum(np.diagonal(matrix), 0.0))
    size = np.outer(sigma, sigma)
    related = np.divide(matrix, size, out=np.zeros_like(matrix), where=size > 0.0)
    unlike = np.abs(matrix - matrix.T) > _ROUNDING * size
    alone = (matrix != 0.0) & (size == 0.0)
    return not (unlike.any() or alone.any() or eigen(related)[0].min() < -_ROUNDING)


def quartic_roots(coefficients: ArrayLike) -> tuple[Array, Array]:
    """Return the roots of x⁴ + b x³ + c x² + d x + e.

    Parameters
    ----------
    coefficients
        b, c, d, e, shape (4, ...).

    Returns
    -------
    real, imaginary
        Shapes (4, ...); a pair of complex roots has opposite imaginary parts.

    Notes
    -----
    Ferrari's way: y = x + b/4 obeys y⁴ + p y² + q y + r = 0, which is the product of y² ± s y + ½(p + s² ∓ q/s) with
    s² the largest root of z³ + 2p z² + (p² − 4r) z − q² (Abramowitz, Stegun, *Handbook of Mathematical Functions*,
    1964, section 3.8.3). Real roots are then polished by Newton's method.
    """
    b, c, d, e = np.asarray(coefficients, dtype=np.float64)
    shift = 0.25 * b
    p = c - 6.0 * shift * shift
    q = d - 2.0 * c * shift + 8.0 * shift * shift * shift
    r = e - d * shift + c * shift * shift - 3.0 * (shift * shift) * (shift * shift)
    z = np.maximum(_largest_root(2.0 * p, p * p - 4.0 * r, -q * q), 0.0)
    s, between = np.sqrt(z), p + z
    apart = np.copysign(np.sqrt(np.maximum(between * between - 4.0 * r, 0.0)), q)
    real, imaginary = np.empty((4, *b.shape)), np.zeros((4, *b.shape))
    for pair, sign in enumerate((1.0, -1.0)):
        square = 0.25 * z - 0.5 * (between - sign * apart)
        reach = np.sqrt(np.abs(square))
        for number, side in enumerate((1.0, -1.0)):
            at = 2 * pair + number
            real[at] = -0.5 * sign * s + np.where(square > 0.0, side * reach, 0.0) - shift
            imaginary[at] = np.where(square > 0.0, 0.0, side * reach)
    for _ in range(_POLISH):
        value = (((real + b) * real + c) * real + d) * real + e
        slope = ((4.0 * real + 3.0 * b) * real + 2.0 * c) * real + d
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            better = real - value / slope
            ahead = (((better + b) * better + c) * better + d) * better + e
            # A step that gains nothing is rounding, or leaves a pair of near roots.
            taken = (imaginary == 0.0) & (np.abs(ahead) < np.abs(value))
        real = np.where(taken, better, real)
    return real, imaginary


def _largest_root(a: Array, b: Array, c: Array) -> Array:
    """Return the largest real root of z³ + a z² + b z + c (Abramowitz, Stegun 1964, section 3.8.2)."""
    third = a / 3.0
    m, n = third * third - b / 3.0, third * third * third - 0.5 * third * b + 0.5 * c
    # With z = y − a/3: y³ − 3 m y + 2 n = 0.
    inside = n * n - m * m * m
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        root = np.sqrt(np.maximum(m, 0.0))
        cosine = np.clip(-n / (root * root * root), -1.0, 1.0)
        three = 2.0 * root * np.cos(arctan2(np.sqrt(1.0 - cosine * cosine), cosine) / 3.0)
        far = -np.copysign(np.cbrt(np.abs(n) + np.sqrt(np.maximum(inside, 0.0)), dtype=np.longdouble), n)
        one = far.astype(np.float64)
        one = one + np.where(one == 0.0, 0.0, m / one)
    return np.where(inside > 0.0, one, np.where(m > 0.0, three, 0.0)) - third


def _axes_first(matrix: Array, axes: int | None = None) -> Array:
    """Return matrices (..., n, m) as (n, m, ...): what is done to all of a stack is then done in one go.

    A stack of fewer axes than asked for gets more in front, as in any broadcast.
    """
    stack = matrix.ndim - 2
    turned = matrix.transpose(stack, stack + 1, *range(stack))
    if axes is None or axes == stack:
        return turned
    return turned.reshape(*turned.shape[:2], *[1] * (axes - stack), *turned.shape[2:])


def _axes_last(matrix: Array) -> Array:
    return np.ascontiguousarray(matrix.transpose(*range(2, matrix.ndim), 0, 1))


def exp(x: ArrayLike) -> Array:
    """Return eˣ, that of extended precision rounded.

    Of many values it is 2ⁿ e^m e^r in float64, e^m of the middle of one of 1024 cells from a table and e^r − 1 by its
    series (Tang, *ACM Transactions on Mathematical Software* 15, 1989), a quarter of the work. What is left beside the
    sum tells of all but a hundredth of them that extended precision is rounded to the same number.
    """
    given = np.asarray(x, dtype=np.float64)
    if given.size < _FEW:
        return np.exp(given, dtype=np.longdouble).astype(np.float64)
    found = given.copy(order="K")
    # As they lie in memory, which decides the order in which others add them up.
    values = found.ravel(order="K")
    for first in range(0, given.size, _TOGETHER):
        part = slice(first, first + _TOGETHER)
        values[part] = _exp_by_cells(values[part])
    return found


def _exp_by_cells(given: Array) -> Array:
    """Return eˣ of many values: see :func:`exp`."""
    bounded = np.fmin(np.fmax(given, -1e3), 1e3)
    middle = np.floor(bounded / _CELL)
    cell = middle.astype(np.int64)
    middle += 0.5
    rest = bounded - middle * _CELL - middle * _CELL_REST
    more = rest + rest * rest * (0.5 + rest * (1.0 / 6.0 + rest * (1.0 / 24.0)))
    place, power = cell & (_CELLS - 1), np.maximum(cell >> 10, -1023)
    table = _OF_MIDDLE.take(place)
    more = table * more + _BESIDE_MIDDLE.take(place)
    found = table + more
    unsure = np.abs(more - (found - table)) > _SURE
    unsure |= np.abs(power) > _NORMAL
    unsure &= ~(given < _NOTHING)
    # A power of two by its bits, of which the least means 0.
    found *= ((power + 1023) << 52).view(np.float64)
    found[unsure] = np.exp(given[unsure], dtype=np.longdouble)
    return found


def log(x: ArrayLike) -> Array:
    """Return the natural logarithm."""
    return np.log(x, dtype=np.longdouble).astype(np.float64)


def tan(x: ArrayLike) -> Array:
    """Return the tangent."""
    return np.tan(x, dtype=np.longdouble).astype(np.float64)


def arcsin(x: ArrayLike) -> Array:
    """Return the arc sine."""
    return np.arcsin(x, dtype=np.longdouble).astype(np.float64)


def arctan2(y: ArrayLike, x: ArrayLike) -> Array:
    """Return the angle of (x, y) from the first axis."""
    return np.arctan2(y, x, dtype=np.longdouble).astype(np.float64)
