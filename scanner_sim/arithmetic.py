"""Float64 arithmetic that gives the same bytes on every processor of a kind.

NumPy chooses code by processor for some functions, and so do the libraries (BLAS, LAPACK) behind ``@`` and
``numpy.linalg``: results differ in the last bit, a closed loop or an iteration then goes another way, and its files
differ. What follows is made of sums, products, quotients and square roots, which IEEE 754 defines to the bit and which
are done in an order of their own, or of the C library's extended precision, rounded. ``numpy.einsum`` without
``optimize``, ``numpy.sum``, ``sin``, ``cos`` and ``hypot`` do not depend on the processor and serve as they are.

Matrices are stacks of small ones, shape (..., n, n); none is too small for them to be quick.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_SWEEPS = 12
"""Jacobi's method needs about six sweeps for 6 × 6 in float64."""
_HIDDEN = 1e-17
"""Size of an entry over the geometric mean of its diagonal ones that float64 does not notice."""


def product(*matrices: ArrayLike) -> Array:
    """Return the product of stacks of matrices from left to right, as ``@`` does; at least two of two axes each."""
    first, *others = (np.asarray(matrix, dtype=np.float64) for matrix in matrices)
    for other in others:
        first = np.einsum("...ij,...jk->...ik", first, other)
    return first


def applied(matrix: ArrayLike, vector: ArrayLike) -> Array:
    """Return matrices (..., m, n) times vectors (..., n)."""
    return np.asarray(
        np.einsum(
            "...ij,...j->...i", np.asarray(matrix, dtype=np.float64), np.asarray(vector, dtype=np.float64)
        )
    )


def solve(matrix: Array, right: Array) -> Array:
    """Return X of A X = B for symmetric positive definite A.

    Parameters
    ----------
    matrix
        A, shape (..., n, n).
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
    stack = np.broadcast_shapes(matrix.shape[:-2], right.shape[:-2])
    both = np.empty((*stack, size, size + right.shape[-1]))
    both[..., :size], both[..., size:] = matrix, right
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for step in range(size):
            row = both[..., step, step + 1 :] / both[..., step, step, None]
            both[..., step + 1 :] -= both[..., step, None] * row[..., None, :]
            both[..., step, step + 1 :] = row
    return both[..., size:]


def inverse(matrix: Array) -> Array:
    """Return the inverse of symmetric positive definite matrices, shape (..., n, n), as :func:`solve` does."""
    return solve(matrix, np.eye(matrix.shape[-1]))


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
    here = np.array(matrix, dtype=np.float64)
    size = here.shape[-1]
    vectors = np.zeros_like(here) + np.eye(size)
    pairs = [(p, q) for p in range(size) for q in range(p + 1, size)]
    for _ in range(_SWEEPS):
        turned = [_turned(here, vectors, p, q) for p, q in pairs]
        if not any(turned):
            break
    values = np.diagonal(here, axis1=-2, axis2=-1)
    order = np.argsort(values, axis=-1, kind="stable")
    return np.take_along_axis(values, order, -1), np.take_along_axis(vectors, order[..., None, :], -1)


def _turned(matrix: Array, vectors: Array, p: int, q: int) -> bool:
    """Bring entry (p, q) of matrices to zero by a plane rotation, in place; their vectors turn with them.

    Return whether there was anything to do: what rounding hides beside the diagonal stays.
    """
    off, first, second = matrix[..., p, q], matrix[..., p, p], matrix[..., q, q]
    small = np.abs(off) <= _HIDDEN * np.sqrt(np.abs(first * second))
    if small.all():
        return False
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratio = (second - first) / (2.0 * off)
        tangent = np.copysign(1.0, ratio) / (np.abs(ratio) + np.sqrt(1.0 + ratio * ratio))
    tangent = np.where(small, 0.0, tangent)[..., None]
    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
    sine = tangent * cosine
    for array in (matrix, vectors):
        along, across = array[..., p].copy(), array[..., q].copy()
        array[..., p], array[..., q] = cosine * along - sine * across, sine * along + cosine * across
    along, across = matrix[..., p, :].copy(), matrix[..., q, :].copy()
    matrix[..., p, :], matrix[..., q, :] = cosine * along - sine * across, sine * along + cosine * across
    matrix[..., p, q] = matrix[..., q, p] = 0.0
    return True


def exp(x: ArrayLike) -> Array:
    """Return eˣ."""
    return np.exp(x, dtype=np.longdouble).astype(np.float64)


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
