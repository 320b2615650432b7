"""Where resection starts: poses from angles alone, for planar arrays and for any three targets.

Both take the beams as if they met in one point, which the exact adjustment that follows does not: planes in the virtual
origin at the mean φ; three points in the centre of the second axis, (0, 0, D_g), from which the point at Θ, φ and a
distance ρ is seen along ((1 + D_g/ρ) tanΘ, sinφ, cosφ). A plane has two such poses, because a small tilt to one side
looks nearly as one to the other: from the homography to its tangent and from there in closed form (Collins and Bartoli,
*Int. J. Comput. Vision* 109 (2014) 252). Three points have up to four (Grunert 1841, in the form of Haralick et al.,
*Int. J. Comput. Vision* 13 (1994) 331).
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import quartic_roots, tan
from scanner_sim.pose.collinearity import bearings, virtual_origin
from scanner_sim.pose.observations import Flags, Observations, shared

Array = NDArray[np.float64]

PLANAR = 0.05
"""Thickness of an array over its lesser width below which it starts as a plane."""
MOST_THREES = 84
"""Threes of targets that are looked at; of more every so many-th is."""
_TRIED_THREES = 10
"""The widest of them, from which a doubtful pose starts again: all of five targets."""


def planar_starts(observations: Observations) -> tuple[Array, Array]:
    """Return both poses of planar arrays of at least four targets.

    With the plane's coordinates (X, Y) about the middle, u (1 + g·(X, Y)) = h_u·(1, X, Y) and the same for v: the
    parts of both that no linear function of (X, Y) can explain are two equations for g, or more, solved by least
    squares. The homography has the derivative J at the middle, and with R₂₂ the upper left quarter of the rotation from
    the plane to a frame along the sight, B R₂₂ = z J with B the projection's derivative: the largest singular value of
    a quarter of a rotation is 1, so z = 1/σ_max(B⁻¹J), and its columns are completed to unit length in two ways.

    Returns
    -------
    tuple
        R (3, 3, 2, B) and c [m] (3, 2, B): ``scanner_from_object``, for the centre of the array. NaN where four of
        the targets are not in general position.
    """
    seen = shared(observations.seen)
    middle, _, axes = observations.principal
    along, across = axes[:, 1], axes[:, 2]
    about = observations.points - middle[:, None]
    plane = np.stack([np.einsum("inb,ib->nb", about, along), np.einsum("inb,ib->nb", about, across)])
    rays = bearings(*observations.values[:2])
    image = np.where(observations.seen, rays[:2] / rays[2], 0.0)

    design = np.stack([np.ones_like(plane[0]), *plane]) * np.broadcast_to(seen, plane[0].shape)
    inverse = _inverse_of_apart(design)
    products = np.einsum("inb,jnb->ijnb", image, plane)  # u X, u Y; v X, v Y
    linear = np.einsum("knb,ijnb->kijb", inverse, products)
    rest = products - np.einsum("knb,kijb->ijnb", design, linear)
    alone = np.einsum("knb,inb->kib", inverse, image)
    left_over = image - np.einsum("knb,kib->inb", design, alone)
    xx, yy = np.einsum("ijnb,ijnb->jb", rest, rest)
    xy = np.einsum("inb,inb->b", rest[:, 0], rest[:, 1])
    bx, by = -np.einsum("ijnb,inb->jb", rest, left_over)
    determinant = xx * yy - xy * xy
    g = np.stack([(yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant])
    homography = alone + np.einsum("kijb,jb->kib", linear, g)  # rows 1, X, Y; columns u, v
    centre_image, slopes = homography[0], np.swapaxes(homography[1:], 0, 1)
    tangent = slopes - centre_image[:, None] * g[None]

    sight = np.concatenate([centre_image, np.ones_like(centre_image[:1])])
    to_sight = _towards(sight / np.sqrt(np.sum(sight * sight, axis=0)))
    projection = to_sight[:2, :2] - centre_image[:, None] * to_sight[2:, :2]
    quarter = _inverse_of_two(projection, tangent)
    (a, b), (c, d) = quarter
    size = np.sqrt(
        0.5 * (a * a + b * b + c * c + d * d + np.hypot(a * a + c * c - b * b - d * d, 2.0 * (a * b + c * d)))
    )
    a, b, c, d = a / size, b / size, c / size, d / size
    first, second = (
        np.sqrt(np.maximum(1.0 - a * a - c * c, 0.0)),
        np.sqrt(np.maximum(1.0 - b * b - d * d, 0.0)),
    )
    second = np.where(a * b + c * d > 0.0, -second, second)
    origin = virtual_origin(_mean_phi(observations), observations.axis_separation)
    rotations, positions = [], []
    for sign in (1.0, -1.0):
        x, y = np.stack([a, c, sign * first]), np.stack([b, d, sign * second])
        turned = np.einsum("ijb,jkb->ikb", to_sight, np.stack([x, y, _cross(x, y)], axis=1))
        frame = np.stack([along, across, _cross(along, across)], axis=1)
        rotation = np.einsum("ikb,jkb->ijb", turned, frame)
        rotations.append(rotation)
        positions.append(
            origin + sight / size - np.einsum("ijb,jb->ib", rotation, np.broadcast_to(middle, sight.shape))
        )
    return np.stack(rotations, axis=2), np.stack(positions, axis=1)


def widest_three(points: Array, used: Flags) -> NDArray[np.intp]:
    """Return three targets far from one another, shape (3, B), from points (3, n, B or 1) and flags (n, B).

    The farthest from the middle, the farthest from it, and the one with the largest triangle.
    """
    share = used / np.maximum(used.sum(axis=0), 1)
    middle = np.einsum("inb,nb->ib", points, share)
    points = np.broadcast_to(points, (3, *used.shape))
    poses = np.arange(used.shape[1])

    def farthest(measure: Array) -> NDArray[np.intp]:
        chosen: NDArray[np.intp] = np.where(used, measure, -1.0).argmax(axis=0)
        return chosen

    first = farthest(np.sum((points - middle[:, None]) ** 2, axis=0))
    from_first = points - points[:, first, poses][:, None]
    second = farthest(np.sum(from_first**2, axis=0))
    side = from_first[:, second, poses][:, None]
    third = farthest(np.sum(_cross(from_first, side) ** 2, axis=0))
    return np.stack([first, second, third])


def _inverse_of_apart(design: Array) -> Array:
    """Return the pseudo-inverses, transposed, of rows 1, X, Y at right angles to each other, shape (3, n, B or 1).

    Coordinates along principal axes about the middle are; a row of nothing, of targets on a line, has none.
    """
    squares = np.sum(design * design, axis=1, keepdims=True)
    significant = squares > 1e-30 * squares.max(axis=0, keepdims=True)
    return np.where(significant, design / np.where(significant, squares, 1.0), 0.0)


def plane_strength(observations: Observations) -> Array:
    """Return how well a plane's homography tells its attitude (B,): 1 for a square, 0 with all but one on a line.

    The parts of X², XY and Y² that no linear function of (X, Y) explains, as columns of two symmetric rows, are what
    the two equations for g of :func:`planar_starts` rest on: the least singular value of their stack, for coordinates
    of unit root mean square, over √n. It is small where of four targets three nearly stand on a line.
    """
    seen = shared(observations.seen)
    middle, widths, axes = observations.principal
    x, y = (
        np.einsum("inb,ib->nb", observations.points - middle[:, None], axes[:, k]) / widths[k] * seen
        for k in (1, 2)
    )
    design = np.stack([np.broadcast_to(seen, x.shape), x, y])
    products = np.stack([x * x, x * y, y * y])
    explained = np.einsum("knb,jnb->kjb", _inverse_of_apart(design), products)
    xx, xy, yy = products - np.einsum("knb,kjb->jnb", design, explained)
    first, second = np.sum(xx * xx + xy * xy, axis=0), np.sum(xy * xy + yy * yy, axis=0)
    between = np.sum(xy * (xx + yy), axis=0)
    least = 0.5 * (first + second - np.hypot(first - second, 2.0 * between))
    return np.broadcast_to(np.sqrt(np.maximum(least, 0.0) / seen.sum(axis=0)), (observations.count,))


def wide_threes(observations: Observations) -> NDArray[np.intp]:
    """Return the threes of targets with the largest triangles, shape (k ≤ 10, 3, B), of those that were measured."""
    threes, area = _triangles(observations)
    widest = np.argsort(-area, axis=0, kind="stable")[:_TRIED_THREES]
    return np.moveaxis(threes[widest], 2, 1)


def _triangles(observations: Observations) -> tuple[NDArray[np.intp], Array]:
    """Return threes of targets (k, 3) and twice the areas of their triangles [m²] (k, B); −1 where one is hidden."""
    threes = np.array(list(combinations(range(len(observations.seen)), 3)))
    threes = threes[:: -(-len(threes) // MOST_THREES)]
    first, second, third = (observations.points[:, threes[:, corner]] for corner in range(3))
    area = np.sqrt(np.sum(_cross(second - first, third - first) ** 2, axis=0))
    return threes, np.where(observations.seen[threes].all(axis=1), area, -1.0)


def three_point_starts(observations: Observations, three: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return the poses that three targets of each case allow.

    Parameters
    ----------
    observations
        B poses.
    three
        Numbers of the targets, shape (3, B).

    Returns
    -------
    tuple
        R (3, 3, 8, B) and c [m] (3, 8, B). The law of cosines in the three triangles of sight gives a quartic for
        v = s₃/s₁; each of its roots has two s₂, of which one belongs to the third side; both are given, so that the
        adjustment chooses. NaN where there is no such root. Noise and the common origin of the beams make a pair of
        near roots complex, a ± ib: a + b and a − b stand for them, about as far apart as the pair was.
    """
    poses = np.arange(observations.count)
    corners = np.broadcast_to(observations.points, (3, *observations.seen.shape))[
        :, three, poses
    ]  # (3, 3, B)
    theta, phi = observations.values[:2, three, poses]
    separation = observations.axis_separation
    lateral = tan(theta)
    # By the distances of the poses found first the second look has nearly the exact beams.
    for _ in range(2 if separation else 1):
        rays = np.stack([lateral, np.sin(phi), np.cos(phi)])
        rays /= np.sqrt(np.sum(rays * rays, axis=0))
        placed = _three_sides(rays, corners)
        away = np.sqrt(np.sum(placed[1:] ** 2, axis=0))  # (3, 8, B)
        known = np.isfinite(away)
        mean = np.where(known, away, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
        lateral = tan(theta) * (1.0 + np.where(mean > 0.0, separation / mean, 0.0))
    in_scanner, in_object = _triad(placed), _triad(corners)
    rotation = np.einsum("ikab,jkb->ijab", in_scanner, in_object)
    away = np.einsum("ijab,jb->iab", rotation, corners.mean(axis=1))
    position = placed.mean(axis=1) - away
    position[2] += separation
    return rotation, position


def _three_sides(rays: Array, corners: Array) -> Array:
    """Return where on their rays (3, 3, B) the corners (3, 3, B) of a triangle may be, shape (3, 3, 8, B)."""
    aa, bb, cc = (np.sum((corners[:, i] - corners[:, j]) ** 2, axis=0) for i, j in ((1, 2), (0, 2), (0, 1)))
    ca, cb, cg = (np.sum(rays[:, i] * rays[:, j], axis=0) for i, j in ((1, 2), (0, 2), (0, 1)))
    d, s, k, m = (aa - cc) / bb, (aa + cc) / bb, cc / bb, aa / bb
    quartic = (
        (d - 1.0) ** 2 - 4.0 * k * ca**2,
        4.0 * (d * (1.0 - d) * cb - (1.0 - s) * ca * cg + 2.0 * k * ca**2 * cb),
        2.0
        * (
            d**2
            - 1.0
            + 2.0 * d**2 * cb**2
            + 2.0 * (1.0 - k) * ca**2
            - 4.0 * s * ca * cb * cg
            + 2.0 * (1.0 - m) * cg**2
        ),
        4.0 * (-d * (1.0 + d) * cb + 2.0 * m * cg**2 * cb - (1.0 - s) * ca * cg),
        (1.0 + d) ** 2 - 4.0 * m * cg**2,
    )
    leading = np.where(np.abs(quartic[0]) < 1e-12, 1e-12, quartic[0])
    real, imaginary = quartic_roots(np.nan_to_num(np.stack(quartic[1:]) / leading, posinf=0.0, neginf=0.0))
    v = real + imaginary
    v = np.where(v > 0.0, v, np.nan)
    s1 = np.sqrt(bb / (1.0 + v * v - 2.0 * v * cb))
    root = np.sqrt(np.maximum(cg**2 - 1.0 + cc / s1**2, 0.0))
    s1, v = np.concatenate([s1, s1]), np.concatenate([v, v])
    s2 = s1 * np.concatenate([cg + root, cg - root])
    placed: Array = rays[:, :, None] * np.stack([s1, np.where(s2 > 0.0, s2, np.nan), s1 * v])
    return placed


def _mean_phi(observations: Observations) -> Array:
    mean: Array = (observations.values[1] * observations.seen).sum(axis=0) / np.maximum(
        observations.seen.sum(axis=0), 1
    )
    return mean


def _cross(a: Array, b: Array) -> Array:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _triad(corners: Array) -> Array:
    """Return orthonormal axes, the columns of (3, 3, ...), of triangles (3 coordinates, 3 corners, ...)."""
    along, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = _cross(along, other)
    x, z = (vector / np.sqrt(np.sum(vector * vector, axis=0)) for vector in (along, normal))
    return np.stack([x, _cross(z, x), z], axis=1)


def _towards(unit: Array) -> Array:
    """Return the shortest turns (3, 3, B) that bring z onto unit vectors (3, B) with z > −1."""
    x, y, z = unit
    f = 1.0 / (1.0 + z)
    return np.stack(
        [
            np.stack([1.0 - f * x * x, -f * x * y, x]),
            np.stack([-f * x * y, 1.0 - f * y * y, y]),
            np.stack([-x, -y, z]),
        ]
    )


def _inverse_of_two(matrix: Array, right: Array) -> Array:
    """Return the solutions of 2 × 2 systems: matrix (2, 2, B), right (2, 2, B)."""
    (a, b), (c, d) = matrix
    adjugate = np.stack([np.stack([d, -b]), np.stack([-c, a])])
    result: Array = np.einsum("ijb,jkb->ikb", adjugate, right) / (a * d - b * c)
    return result
