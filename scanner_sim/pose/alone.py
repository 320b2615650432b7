"""One pose by itself, of a planar array from angles: the ordinary case without the overhead of a batch.

NumPy needs longer to be called than to compute for four targets, so that here floats do the work. What is found agrees
with :mod:`scanner_sim.pose.solution`, whose steps these are, to far less than a standard deviation, but not to the last
bit. Whatever is not ordinary (a bad fit, a step that does not help, an array that is not flat) is left to that.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, hypot, sin, sqrt, tan

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

from scanner_sim.pose.adjustment import COARSE, FINE, FIRST_DAMPING, IMMATERIAL
from scanner_sim.pose.resection import PLANAR
from scanner_sim.pose.status import PoseStatus

Array = NDArray[np.float64]
Floats = list[float]
Rows = list[list[float]]

MOST_TARGETS = 12
"""Targets up to which floats are quicker than arrays."""
_MOST_STEPS = 25
_COLLINEAR = 1e-3
"""Width over length of an array below which it is left to the general way."""


@dataclass
class LoneFit:
    """A pose of the centre of an array, and its adjustment.

    ``rotation`` (3, 3), ``position`` (3,) [m], ``cost``, ``normal`` matrix (6, 6) and right-hand side ``slope`` (6,) at
    it, and the residuals over σ, ``rest``, (2 n,), Θ and φ in turn.
    """

    rotation: Array
    position: Array
    cost: float
    normal: Array
    slope: Array
    rest: Array


@dataclass(frozen=True)
class LoneCase:
    """What was measured of n targets.

    Attributes
    ----------
    points
        Targets about their mean [m], n rows.
    theta, phi
        Deflections [rad].
    by_theta, by_phi
        1/σ of each.
    axis_separation
        D_g [m].
    """

    points: Rows
    theta: Floats
    phi: Floats
    by_theta: Floats
    by_phi: Floats
    axis_separation: float


def lone_fits(case: LoneCase) -> tuple[LoneFit, LoneFit] | None:
    """Return both poses of a planar array, the better one settled finely; None where that is not the ordinary case."""
    starts = _planar_starts(case)
    if starts is None:
        return None
    coarse = [_adjusted(case, _linearised(case, *start), COARSE) for start in starts]
    first, second = coarse
    if first is None or second is None:
        return None
    best, other = (first, second) if first.cost <= second.cost else (second, first)
    fine = _adjusted(case, best, IMMATERIAL)
    return None if fine is None else (fine, other)


def inverse_of(normal: Array) -> Array | None:
    """Return the inverse of a normal matrix (6, 6); None where it has none.

    By elimination: LAPACK's inverse of a Cholesky factor wakes threads, which takes milliseconds on a busy machine.
    """
    try:
        inverse = np.linalg.inv(normal)
    except np.linalg.LinAlgError:
        return None
    return np.asarray(0.5 * (inverse + inverse.T))


def lone_status(
    best: LoneFit, other: LoneFit, same: float, doubtful: float, apart: float
) -> tuple[int, bool]:
    """Return the status of the better of two poses, and whether the other is another.

    The limits are those of :mod:`scanner_sim.pose.solution`: squared Mahalanobis distances within which poses are the
    same and beyond which they are apart, and the difference of χ² that leaves doubt.
    """
    turn = other.rotation @ best.rotation.T
    (_, xy, xz), (yx, _, yz), (zx, zy, _) = turn.tolist()
    change = np.array([*(other.position - best.position), 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)])
    distance = np.inf if np.trace(turn) < 1.0 else float(change @ best.normal @ change)
    new = not distance < same
    ambiguous = new and other.cost - best.cost < doubtful and distance > apart
    return int(PoseStatus.AMBIGUOUS if ambiguous else PoseStatus.VALID), new


def _adjusted(case: LoneCase, fit: LoneFit, until: float) -> LoneFit | None:
    """Return the pose after steps down to a promised fall of χ²; None where it does not settle.

    Steps, their share and their damping are those of :func:`scanner_sim.pose.adjustment.adjust`.
    """
    share, damping = 1.0, 0.0
    for _ in range(_MOST_STEPS):
        matrix = fit.normal
        if damping:
            matrix = matrix + damping * np.diag(np.diag(matrix))
        _, step, failed = dposv(matrix, fit.slope)
        if failed:
            return None
        promised = float(step @ fit.slope)
        moves = step.tolist()
        far = max(map(abs, fit.position.tolist()))
        small = promised < until or (
            max(map(abs, moves[3:])) < FINE and max(map(abs, moves[:3])) < FINE * far
        )
        small = small and damping < 2.0 * FIRST_DAMPING
        scaled = step * share
        rotation, position = _cayley(*scaled[3:].tolist()) @ fit.rotation, fit.position + scaled[:3]
        trial = _linearised(case, rotation, position)
        left = float(scaled @ trial.slope) / (promised * share) if promised > 0.0 else 0.0
        share = min(max(share / (1.0 - left), 0.1), 4.0) if abs(left) > 0.3 and left < 0.95 else 1.0
        if trial.cost <= fit.cost or small:
            fit = trial
            damping = 0.1 * damping if damping > 1e-4 else 0.0
        else:
            damping = max(10.0 * damping, FIRST_DAMPING)
        if small:
            return fit
    return None


def _linearised(case: LoneCase, rotation: Array, position: Array) -> LoneFit:
    """Return a pose with cost, normal equations and residuals: :func:`scanner_sim.pose.adjustment.linearise`."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    cx, cy, cz = position.tolist()
    separation = case.axis_separation
    rows: list[Floats] = []
    for (px, py, pz), theta, phi, by_theta, by_phi in zip(
        case.points, case.theta, case.phi, case.by_theta, case.by_phi, strict=True
    ):
        rx, ry, rz = a * px + b * py + c * pz, d * px + e * py + f * pz, g * px + h * py + i * pz
        x, y, ahead = cx + rx, cy + ry, cz + rz - separation
        q_squared = y * y + ahead * ahead
        q = sqrt(q_squared)
        w = q + separation
        r_squared = x * x + w * w
        by_q = -by_theta * x / (r_squared * q)
        tx, ty, tz = by_theta * w / r_squared, by_q * y, by_q * ahead
        fy, fz = by_phi * ahead / q_squared, -by_phi * y / q_squared
        rest = by_theta * (theta - atan2(x, w))
        rows.append([tx, ty, tz, ry * tz - rz * ty, rz * tx - rx * tz, rx * ty - ry * tx, rest])
        rest = by_phi * (phi - atan2(y, ahead))
        rows.append([0.0, fy, fz, ry * fz - rz * fy, -rx * fz, rx * fy, rest])
    design = np.array(rows)
    product = design.T @ design
    return LoneFit(rotation, position, float(product[6, 6]), product[:6, :6], product[:6, 6], design[:, 6])


def _cayley(x: float, y: float, z: float) -> Array:
    """Return the rotation of the quaternion (1, ω/2): :func:`scanner_sim.pose.transforms.cayley`."""
    x, y, z = 0.5 * x, 0.5 * y, 0.5 * z
    two = 2.0 / (1.0 + x * x + y * y + z * z)
    return np.array(
        [
            [1.0 - two * (y * y + z * z), two * (x * y - z), two * (x * z + y)],
            [two * (x * y + z), 1.0 - two * (x * x + z * z), two * (y * z - x)],
            [two * (x * z - y), two * (y * z + x), 1.0 - two * (x * x + y * y)],
        ]
    )


def _planar_starts(case: LoneCase) -> list[tuple[Array, Array]] | None:
    """Return both poses to start from, R and c: :func:`scanner_sim.pose.resection.planar_starts`; None if not flat."""
    points = np.array(case.points)
    squares, axes = np.linalg.eigh(points.T @ points)
    thin, narrow, long = (sqrt(max(square, 0.0)) for square in squares.tolist())
    if not (thin < PLANAR * narrow and narrow > _COLLINEAR * long):
        return None
    flat = (points @ axes[:, 1:]).tolist()
    # Along the principal axes 1, X and Y are orthogonal, so that their pseudo-inverse is themselves over their squares.
    weights = [(1.0 / len(flat), x / float(squares[1]), y / float(squares[2])) for x, y in flat]
    image = [(tan(t) / cos(p), tan(p)) for t, p in zip(case.theta, case.phi, strict=True)]
    alone = [[0.0] * 2 for _ in range(3)]
    linear = [[[0.0] * 2, [0.0] * 2] for _ in range(3)]
    for weight, (x, y), pair in zip(weights, flat, image, strict=True):
        for k in range(3):
            for j, value in enumerate(pair):
                alone[k][j] += weight[k] * value
                linear[k][j][0] += weight[k] * value * x
                linear[k][j][1] += weight[k] * value * y
    xx = yy = xy = bx = by = 0.0
    for (x, y), pair in zip(flat, image, strict=True):
        for j, value in enumerate(pair):
            ((k0, l0), (k1, l1), (k2, l2)) = linear[0][j], linear[1][j], linear[2][j]
            rx, ry = value * x - k0 - k1 * x - k2 * y, value * y - l0 - l1 * x - l2 * y
            left = value - alone[0][j] - alone[1][j] * x - alone[2][j] * y
            xx, yy, xy = xx + rx * rx, yy + ry * ry, xy + rx * ry
            bx, by = bx - rx * left, by - ry * left
    determinant = xx * yy - xy * xy
    if determinant <= 1e-14 * (xx * yy):
        return None
    gx, gy = (yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant
    (u, v), *slopes = (
        [alone[k][j] + linear[k][j][0] * gx + linear[k][j][1] * gy for j in range(2)] for k in range(3)
    )
    tangent = [[slopes[0][0] - u * gx, slopes[1][0] - u * gy], [slopes[0][1] - v * gx, slopes[1][1] - v * gy]]
    length = sqrt(u * u + v * v + 1.0)
    sx, sy, sz = u / length, v / length, 1.0 / length
    s = 1.0 / (1.0 + sz)
    towards = [[1.0 - s * sx * sx, -s * sx * sy, sx], [-s * sx * sy, 1.0 - s * sy * sy, sy], [-sx, -sy, sz]]
    p00, p01 = towards[0][0] - u * towards[2][0], towards[0][1] - u * towards[2][1]
    p10, p11 = towards[1][0] - v * towards[2][0], towards[1][1] - v * towards[2][1]
    scale = p00 * p11 - p01 * p10
    (t00, t01), (t10, t11) = tangent
    a, b = (p11 * t00 - p01 * t10) / scale, (p11 * t01 - p01 * t11) / scale
    c, d = (p00 * t10 - p10 * t00) / scale, (p00 * t11 - p10 * t01) / scale
    spread = hypot(a * a + c * c - b * b - d * d, 2.0 * (a * b + c * d))
    size = sqrt(0.5 * (a * a + b * b + c * c + d * d + spread))
    a, b, c, d = a / size, b / size, c / size, d / size
    first, second = sqrt(max(1.0 - a * a - c * c, 0.0)), sqrt(max(1.0 - b * b - d * d, 0.0))
    second = -second if a * b + c * d > 0.0 else second
    mean = sum(case.phi) / len(case.phi)
    separation = case.axis_separation
    position = np.array(
        [u / size, v / size - separation * sin(mean), 1.0 / size + separation * (1.0 - cos(mean))]
    )
    along, across = axes[:, 1].tolist(), axes[:, 2].tolist()
    frame = np.array([along, across, _cross(along, across)])
    found = []
    for sign in (1.0, -1.0):
        x_axis, y_axis = [a, c, sign * first], [b, d, sign * second]
        turned = np.array(towards) @ np.array([x_axis, y_axis, _cross(x_axis, y_axis)]).T
        found.append((turned @ frame, position))
    return found


def _cross(a: Floats, b: Floats) -> Floats:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
