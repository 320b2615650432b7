"""Which dot of a frame is which target of a surveyed array: dots bear no codes, their layout tells them apart.

From scratch every three dots are tried as three far targets: each trial has up to four poses (Grunert), which say where
the other targets are and how large, and the pose that most dots agree with wins (Fischler and Bolles, *Comm. ACM* 24,
1981, 381). From frame to frame a predicted pose says it at once. What agrees is estimated and looked for again, until
it stays. A layout with a symmetry has several poses that agree alike; then the answer is AMBIGUOUS, unless an attitude
that is expected coarsely leaves one.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from scanner_sim.optics.interior_orientation import InteriorOrientation
from scanner_sim.pose.camera import estimate_camera_pose, pixel_angles
from scanner_sim.pose.dot_images import DotArray, dot_images
from scanner_sim.pose.observations import Observations
from scanner_sim.pose.resection import three_point_starts, wide_threes
from scanner_sim.pose.result import PoseEstimate
from scanner_sim.pose.solution import AMBIGUOUS_DIFFERENCE, LEAST_PROBABILITY
from scanner_sim.pose.transforms import vector_from_rotation
from scanner_sim.signals.dots.fit import Dots
from scanner_sim.signals.dots.settings import DotStatus

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_Fit = tuple[NDArray[np.int64], PoseEstimate]
_Poses = dict[bytes, PoseEstimate]
"""Poses by the assignment that they were estimated from: several trials lead to the same."""

MOST_DOTS = 24
"""Dots of a frame that are tried; of more the darkest."""
FEWEST = 4
"""Dots that must agree: three always have a pose."""
EXPECTED_TURN = np.radians(40.0)
"""Angle from an expected attitude beyond which a pose is not the expected one."""
OTHER_RANGE = 1.4
"""Ratio of distances beyond which a pose is not the predicted one."""
_REACH = 1.5
"""Pixels, beside half a dot's longer axis, within which a dot agrees with a predicted one."""
_SIZES = 1.4
"""Ratio of measured and predicted axes beyond which a dot is another thing."""
_GRAZING = 0.15
"""Cosine of the tilt below which a dot is not looked for."""
_MOST_POSES = 16
"""Trials that are estimated with all dots that agree."""
_ROUNDS = 4
_POSES_AT_ONCE = 4096


@dataclass(frozen=True)
class Identified:
    """The dots of a frame as targets.

    Attributes
    ----------
    dot
        Number of each target's dot, −1 for none, shape (n,).
    status
        :class:`~scanner_sim.signals.dots.settings.DotStatus` of each target, shape (n,).
    pose
        ``camera_from_object`` by the dots that agree, one pose, or None.
    ambiguous
        Whether other targets fit the dots as well.
    """

    dot: Index
    status: NDArray[np.int8]
    pose: PoseEstimate | None
    ambiguous: bool


def identify(
    camera: InteriorOrientation,
    array: DotArray,
    dots: Dots,
    *,
    predicted: tuple[Array, Array] | None = None,
    expected: Array | None = None,
    reach: float = 0.0,
) -> Identified:
    """Return which dot is which target, with the pose that says so.

    Parameters
    ----------
    camera
        The interior orientation that is believed.
    array
        The surveyed targets.
    dots
        Of one frame, from :func:`~scanner_sim.signals.dots.fit.find_dots`; those that are not valid do not take part,
        and lend their status to the target that they stand at.
    predicted
        Rotation (3, 3) and position (3,) ``camera_from_object`` that are expected within a dot's size, as from the
        frames before; where they fail, and without them, the array is looked for from scratch, but no nearer and no
        farther than predicted by more than a ratio of :data:`OTHER_RANGE`: a smaller array nearby looks the same.
    expected
        An attitude ``camera_from_object`` (3, 3) from which the array's is turned by less than :data:`EXPECTED_TURN`.
    reach
        Pixels by which the prediction may be wrong, beside half a dot.

    Returns
    -------
    Identified
    """
    usable = np.flatnonzero(dots.status == DotStatus.VALID)
    usable = usable[np.argsort(-dots.contrast[usable], kind="stable")[:MOST_DOTS]]
    known: _Poses = {}
    if predicted is not None and len(usable):
        chosen = _agreeing(camera, array, dots, usable, predicted[0][None], predicted[1][None], reach)[0][0]
        found = _settled(camera, array, dots, usable, chosen, known)
        if found is not None:
            return _named(camera, array, dots, found, ambiguous=False)
    fits: list[_Fit] = []
    for chosen in _trials(camera, array, dots, usable, expected):
        found = _settled(camera, array, dots, usable, chosen, known)
        if found is not None and not any(np.array_equal(found[0], other[0]) for other in fits):
            fits.append(found)
    if predicted is not None:
        there = np.linalg.norm(predicted[1])
        ratios = [np.linalg.norm(fit[1].position) / there for fit in fits]
        fits = [fit for fit, ratio in zip(fits, ratios, strict=True) if max(ratio, 1.0 / ratio) < OTHER_RANGE]
    if expected is not None:
        fits = [fit for fit in fits if _turn_between(fit[1].rotation, expected) < EXPECTED_TURN]
    if not fits:
        nothing = np.full(len(array.points), -1)
        return Identified(nothing, np.full(len(nothing), DotStatus.NOT_FOUND, dtype=np.int8), None, False)
    fits.sort(key=lambda fit: (-np.count_nonzero(fit[0] >= 0), float(fit[1].chi2)))
    best = fits[0]
    alike = [fit for fit in fits[1:] if _as_good(fit, best)]
    return _named(camera, array, dots, best, ambiguous=bool(alike))


def symmetries(array: DotArray, tolerance: float = 0.02) -> list[tuple[int, ...]]:
    """Return the renumberings of targets under which an array looks the same, the identity apart.

    Parameters
    ----------
    array
        Of at most eight targets; of more the first eight are looked at.
    tolerance
        Difference of distances, over the size of the array, that a camera may not tell.

    Notes
    -----
    Distances between all pairs, radii and the hand stay: a reflection is no symmetry of an array that has
    thickness, and none of a plane that faces one way.
    """
    points, radii = array.points[:8], array.radii[:8]
    apart = np.sqrt(np.sum((points[:, None] - points) ** 2, axis=-1))
    limit = tolerance * apart.max()
    normal = array.normals.mean(axis=0)
    found = []
    for order in permutations(range(len(points))):
        where = list(order)
        if where == sorted(where) or (np.abs(radii[where] / radii - 1.0) > 0.1).any():
            continue
        if (np.abs(apart[np.ix_(where, where)] - apart) < limit).all() and _same_hand(
            points, points[where], normal
        ):
            found.append(order)
    return found


def _same_hand(one: Array, other: Array, normal: Array) -> bool:
    """Whether a rotation, and not a reflection, takes one set of points to another and keeps the side they face."""
    a, b = one - one.mean(axis=0), other - other.mean(axis=0)
    turned = np.einsum("ni,nj->ij", a, b) + 1e-3 * np.sum(a * a) * np.einsum("i,j->ij", normal, normal)
    return bool(np.linalg.det(turned) > 0.0)


def _trials(
    camera: InteriorOrientation, array: DotArray, dots: Dots, usable: Index, expected: Array | None
) -> list[Index]:
    """Return the assignments (n,) with which most dots agree, over all threes of dots and some of targets."""
    if len(usable) < FEWEST or len(array.points) < FEWEST:
        return []
    angles = pixel_angles(camera, dots.centre[usable])
    orders = np.array(list(permutations(range(len(usable)), 3))).T  # (3, B)
    best: list[tuple[float, Index]] = []
    for three in _threes(array):
        found: list[tuple[float, Index]] = []
        for first in range(0, orders.shape[1], _POSES_AT_ONCE):
            taken = orders[:, first : first + _POSES_AT_ONCE]
            rotation, position = _poses_of_three(array, three, angles.theta[taken], angles.phi[taken])
            keep = np.isfinite(position).all(axis=1) & (position[:, 2] > 0.0)
            if expected is not None:
                keep &= np.einsum("bij,ij->b", rotation, expected) > 1.0 + 2.0 * np.cos(1.3 * EXPECTED_TURN)
            if not keep.any():
                continue
            chosen, score = _agreeing(camera, array, dots, usable, rotation[keep], position[keep], 0.0)
            order = np.argsort(-score, kind="stable")[:_MOST_POSES]
            found += [(float(score[k]), chosen[k]) for k in order if score[k] >= FEWEST - 1.0]
        best += found
        most = max((score for score, _ in best), default=0.0)
        if most > min(len(array.points), len(usable)) - 1.0:
            break
    best.sort(key=lambda one: -one[0])
    distinct: list[Index] = []
    for _, chosen in best:
        if not any(np.array_equal(chosen, other) for other in distinct):
            distinct.append(chosen)
    return distinct[:_MOST_POSES]


def _threes(array: DotArray) -> NDArray[np.intp]:
    """Return threes of targets that span the array, the widest first, shape (k, 3)."""
    used = np.ones((len(array.points), 1), dtype=bool)
    return np.asarray(wide_threes(_bare(array.points, used)))[..., 0]


def _bare(
    points: Array, used: NDArray[np.bool_], theta: Array | None = None, phi: Array | None = None
) -> Observations:
    """Return observations of equal weights, B poses of n points, from angles (n, B)."""
    angles = (
        np.zeros(used.shape) if theta is None or phi is None else np.stack([theta, phi, np.zeros_like(theta)])
    )
    values = np.zeros((3, *used.shape)) if theta is None else angles
    centre = points.mean(axis=0)
    return Observations(
        points=(points - centre).T[..., None],
        centre=centre[:, None],
        values=values,
        seen=used,
        ranged=np.zeros_like(used),
        variances=np.ones((3, len(points), 1)),
        theta_range=None,
        theta_phi=None,
        object_variances=None,
        axis_separation=0.0,
        prior=None,
    )


def _poses_of_three(
    array: DotArray, three: NDArray[np.intp], theta: Array, phi: Array
) -> tuple[Array, Array]:
    """Return the poses (8 B, 3, 3), (8 B, 3) of three targets seen at angles (3, B)."""
    points = array.points[three]
    seen = np.ones(theta.shape, dtype=bool)
    index = np.tile(np.arange(3)[:, None], theta.shape[1])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rotation, position = three_point_starts(_bare(points, seen, theta, phi), index)
    rotation = rotation.reshape(3, 3, -1).transpose(2, 0, 1)
    position = position.reshape(3, -1).T - np.einsum("bij,j->bi", rotation, points.mean(axis=0))
    return rotation, position


def _agreeing(
    camera: InteriorOrientation,
    array: DotArray,
    dots: Dots,
    usable: Index,
    rotation: Array,
    position: Array,
    reach: float,
) -> tuple[Index, Array]:
    """Return for poses (B, …) the dots that agree, (B, n) or −1, and how many, less their mean distance (B,)."""
    turned = np.einsum("bij,nj->bni", rotation, array.points)
    placed = turned + position[:, None]
    away = np.sqrt(np.sum(placed * placed, axis=-1))
    facing = -np.sum(placed * np.einsum("bij,nj->bni", rotation, array.normals), axis=-1) / away
    pixels, long = camera.project(placed), camera.scale * array.radii / away
    at, half = dots.centre[usable], dots.half_axes[usable, 0]
    apart = np.sqrt(np.sum((pixels[:, :, None] - at) ** 2, axis=-1))
    limit = np.maximum(half, 2.0) * 0.5 + _REACH + reach
    ratio = half / long[..., None]
    possible = (apart < limit) & (ratio < _SIZES) & (ratio * _SIZES > 1.0) & (facing[..., None] > _GRAZING)
    cost = np.where(possible, apart / limit, np.inf)
    nearest = cost.argmin(axis=2)
    least = np.take_along_axis(cost, nearest[..., None], axis=2)[..., 0]
    # A dot belongs to the target nearest to it.
    mine = np.take_along_axis(cost.min(axis=1), nearest, axis=1) >= least
    hit = np.isfinite(least) & mine
    chosen = np.where(hit, usable[nearest], -1)
    count = hit.sum(axis=1)
    return chosen, count - np.where(hit, least, 0.0).sum(axis=1) / np.maximum(count, 1)


def _settled(
    camera: InteriorOrientation,
    array: DotArray,
    dots: Dots,
    usable: Index,
    chosen: Index,
    known: _Poses | None = None,
) -> _Fit | None:
    """Return the assignment and pose that an assignment leads to, or None where too little agrees."""
    known = {} if known is None else known
    for _ in range(_ROUNDS):
        if np.count_nonzero(chosen >= 0) < FEWEST:
            return None
        pose = _pose_by(camera, array, dots, chosen, known)
        if not np.isfinite(pose.position).all():
            return None
        again = _agreeing(camera, array, dots, usable, pose.rotation[None], pose.position[None], 0.0)[0][0]
        if np.array_equal(again, chosen):
            break
        chosen = again
    if np.count_nonzero(chosen >= 0) < FEWEST:
        return None
    chosen = chosen.copy()
    while True:
        pose = _pose_by(camera, array, dots, chosen, known)
        if not np.isfinite(pose.position).all():
            return None
        if chdtrc(float(pose.dof), float(pose.chi2)) > LEAST_PROBABILITY:
            return chosen, pose
        # A dot that something else touches looks whole, and lies beside its target by more than its σ.
        if np.count_nonzero(chosen >= 0) <= FEWEST:
            return None
        spread = np.where(chosen >= 0, np.einsum("nii->n", dots.covariance[chosen]), np.inf)
        apart = np.sum(np.nan_to_num(pose.residuals[:, :2]) ** 2, axis=1)
        chosen[(apart / spread).argmax()] = -1


def _pose_by(
    camera: InteriorOrientation, array: DotArray, dots: Dots, chosen: Index, known: _Poses
) -> PoseEstimate:
    """Return the pose of the dots chosen for the targets, (n,) or −1; it is estimated once."""
    key = chosen.tobytes()
    if key not in known:
        seen = chosen >= 0
        centres = np.where(seen[:, None], dots.centre[chosen], np.nan)
        covariance = np.where(seen[:, None, None], dots.covariance[chosen], np.nan)
        known[key] = estimate_camera_pose(camera, array, centres, covariance)
    return known[key]


def _as_good(fit: _Fit, best: _Fit) -> bool:
    """Whether another assignment explains as many dots nearly as well."""
    as_many = np.count_nonzero(fit[0] >= 0) == np.count_nonzero(best[0] >= 0)
    return bool(as_many and fit[1].chi2 - best[1].chi2 < AMBIGUOUS_DIFFERENCE)


def _turn_between(one: Array, other: Array) -> float:
    return float(np.linalg.norm(vector_from_rotation(np.einsum("ij,kj->ik", one, other))))


def _named(
    camera: InteriorOrientation, array: DotArray, dots: Dots, fit: _Fit, *, ambiguous: bool
) -> Identified:
    """Return the answer, with the status of the dots that stand where a target was not measured."""
    chosen, pose = fit
    status = np.where(chosen >= 0, DotStatus.VALID, DotStatus.NOT_FOUND).astype(np.int8)
    images = dot_images(camera, array, pose.rotation, pose.position)
    failed = np.flatnonzero(dots.status != DotStatus.VALID)
    for target in np.flatnonzero(chosen < 0):
        apart = np.sqrt(np.sum((dots.centre[failed] - images.centre[target]) ** 2, axis=1))
        near = apart < images.half_axes[target, 0] + _REACH
        if near.any():
            status[target] = dots.status[failed[np.where(near, apart, np.inf).argmin()]]
    if ambiguous:
        status[chosen >= 0] = DotStatus.AMBIGUOUS
    return Identified(chosen, status, pose, ambiguous)
