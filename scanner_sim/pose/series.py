"""Poses over time: of an object before the scanner, or of one object seen from another."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import inverse, product, pseudo_inverse
from scanner_sim.foundation.html_text import html_box, html_rows
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.covariance import relative_pose
from scanner_sim.pose.estimate import Robust, estimate_pose
from scanner_sim.pose.interpolation import Interpolated
from scanner_sim.pose.result import PoseEstimate
from scanner_sim.pose.status import PoseStatus, worse_of
from scanner_sim.pose.transforms import quaternion_from_rotation, vector_from_rotation
from scanner_sim.pose.weights import Method

Array = NDArray[np.float64]

SeriesMethod = Literal[Method, "camera", "combined"]
"""Methods of the scanner, the dots in the video camera's frames, and both by their covariances."""
_PARTS = ("covariance", "lasting", "common")
_WEIGHED_ENTRIES = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]])
"""Entries of the covariance of (Θ, φ, R) that weigh a target."""


@dataclass(frozen=True, eq=False)
class PoseSeries:
    """Poses of one object by one method.

    Attributes
    ----------
    name
        The object.
    relative_to
        The object in whose frame they are; empty for the scanner's.
    method
        How they were estimated.
    time
        When [s], shape (n,).
    position, rotation
        Of the object's origin [m], shape (n, 3), and ``reference_from_object``, shape (n, 3, 3); NaN where there is
        none.
    covariance
        Of (δt, δω) along the axes of the reference, shape (n, 6, 6): see :mod:`scanner_sim.pose.transforms`.
    chi2, dof
        Squared residuals in standard deviations and their number less six, shape (n,).
    targets
        Number of targets that counted, shape (n,).
    status
        :class:`~scanner_sim.pose.status.PoseStatus`, shape (n,).
    truth_position, truth_rotation
        True pose, of the shapes of ``position`` and ``rotation``; NaN where nobody knows it.
    lasting
        The part of ``covariance`` that neighbouring poses share beyond their common observations, and that no mean over
        seconds makes smaller: the surfaces' speckle, unlike pixels, drift and calibration, shape (n, 6, 6); NaN where
        it is not known.
    common
        The part of ``lasting`` by the errors of the calibration, which is in all poses of the instrument and which no
        mean makes smaller, shape (n, 6, 6); the noise of a pose is ``covariance`` less this. NaN where it is not known.
    gains
        By how much each observation (Θ, φ, R) moves the pose, shape (n, targets, 6, 3); None of relative poses, and
        where a table was read.
    """

    name: str
    relative_to: str
    method: SeriesMethod
    time: Array
    position: Array
    rotation: Array
    covariance: Array
    chi2: Array
    dof: NDArray[np.int64]
    targets: NDArray[np.int64]
    status: NDArray[np.int8]
    truth_position: Array
    truth_rotation: Array
    lasting: Array
    common: Array
    gains: Array | None = None

    @property
    def label(self) -> str:
        """The object and, where it is not the scanner, what it is seen from."""
        return f"{self.name} from {self.relative_to}" if self.relative_to else self.name

    @property
    def quaternion(self) -> Array:
        """Unit quaternions (w, x, y, z), w ≥ 0, shape (n, 4)."""
        return quaternion_from_rotation(self.rotation)

    @property
    def sigma(self) -> Array:
        """Standard deviations of (δt, δω) [m, rad], shape (n, 6)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2)))

    def _repr_html_(self) -> str:
        """Return what a notebook shows: how many poses there are, with their median σ and the rms of their errors."""
        good = self.status == PoseStatus.VALID
        rows = []
        if good.any():
            # Millimetres, and thousandths of a degree.
            units = np.repeat([1e3, 1e3 * np.degrees(1.0)], 3)
            sigma = units * np.median(self.sigma[good], axis=0)
            rms = units * np.sqrt(np.mean(np.square(self.error[good]), axis=0))
            for name, values in (("median σ", sigma), ("rms error", rms)):
                rows.append((name, *(f"{value:.3g}" if np.isfinite(value) else "–" for value in values)))
        axes = ("x [mm]", "y [mm]", "z [mm]", "about x [m°]", "about y [m°]", "about z [m°]")
        title = f"{self.label} by {self.method}: {np.count_nonzero(good)} of {len(good)} poses valid"
        return html_box(title, html_rows(rows, ("", *axes)) if rows else "")

    @property
    def error(self) -> Array:
        """Measured less true (δt, δω) [m, rad], shape (n, 6): exp([δω]×) true rotation = rotation."""
        turned = product(self.rotation, np.swapaxes(self.truth_rotation, 1, 2))
        return np.concatenate([self.position - self.truth_position, vector_from_rotation(turned)], axis=1)


def pose_series(
    name: str,
    object_points: Array,
    at: Array,
    observations: Interpolated,
    *,
    axis_separation: float,
    method: Method,
    robust: Robust | None = None,
    truth: Array | None = None,
) -> PoseSeries:
    """Return the poses of an object from observations of its targets at common times.

    Parameters
    ----------
    name
        The object.
    object_points
        Its targets along its own axes [m], shape (targets, 3).
    at
        Times [s], shape (n,).
    observations
        Of its targets. Each pose is weighed by the covariances of single targets, of them Θ with R but not φ, which a
        symmetrical pattern leaves small. What targets share is added to the covariance of the pose, Σ K_i C_ij K_jᵀ
        over i ≠ j with K the pose's rise with each observation; the weights know nothing of it, and χ² comes out a
        little too small.
    axis_separation
        D_g [m].
    method, robust
        See :func:`~scanner_sim.pose.estimate.estimate_pose`.
    truth
        True ``scanner_from_object`` at the times, shape (n, 4, 4), for comparison only.

    Raises
    ------
    InputError
        As :func:`~scanner_sim.pose.estimate.estimate_pose`.
    """
    target = np.arange(len(object_points))
    position, own = observations.position, observations.covariance[:, target, target]
    sigma = np.sqrt(np.diagonal(own, axis1=2, axis2=3))
    found = estimate_pose(
        object_points,
        position[..., 0],
        position[..., 1],
        position[..., 2],
        sigma_theta=sigma[..., 0],
        sigma_phi=sigma[..., 1],
        sigma_range=sigma[..., 2],
        covariance_theta_range=own[..., 0, 2],
        axis_separation=axis_separation,
        method=method,
        robust=robust,
    )
    gains = _gains(found, object_points, own, axis_separation, with_range=method != "uv")
    apart = np.where(np.eye(len(target), dtype=bool)[..., None, None], 0.0, observations.covariance)
    unknown = np.full((len(at), 4, 4), np.nan)
    true = unknown if truth is None else truth
    return PoseSeries(
        name=name,
        relative_to="",
        method=method,
        time=at,
        position=found.position,
        rotation=found.rotation,
        covariance=found.covariance + between_poses(gains, apart, gains),
        chi2=found.chi2,
        dof=found.dof,
        targets=np.count_nonzero(found.weights, axis=1).astype(np.int64),
        status=found.status,
        truth_position=true[:, :3, 3],
        truth_rotation=true[:, :3, :3],
        lasting=between_poses(gains, observations.lasting, gains),
        common=_in_common(gains, observations.common, gains, observations.common),
        gains=gains,
    )


def between_poses(one: Array, covariance: Array, other: Array) -> Array:
    """Return the covariance of two poses from that of their observations, Σ K_i C_ij K_jᵀ, shape (n, 6, 6).

    ``one`` (n, i, 6, 3) and ``other`` (n, j, 6, 3) are their gains, ``covariance`` (n, i, j, 3, 3); what is NaN of it
    counts as none.
    """
    spread = np.einsum("nijab,njdb->niad", np.nan_to_num(covariance), other)
    return np.asarray(np.einsum("nica,niad->ncd", one, spread))


def _in_common(one: Array, moved: Array, other: Array, also: Array) -> Array:
    """Return the covariance of two poses by errors of unit variance that all observations have in common, (n, 6, 6).

    ``moved`` and ``also`` are what k of them make of the observations, shape (n, targets, 3, k); NaN counts as none.
    """
    first, second = (
        np.einsum("ntca,ntak->nck", gains, np.nan_to_num(common))
        for gains, common in ((one, moved), (other, also))
    )
    return np.asarray(np.einsum("nck,ndk->ncd", first, second))


def _gains(
    found: PoseEstimate,
    object_points: Array,
    covariance: Array,
    axis_separation: float,
    *,
    with_range: bool,
) -> Array:
    """Return by how much each observation moves a pose, ∂(δt, δω)/∂(Θ, φ, R) of every target, shape (n, targets, 6, 3).

    N⁻¹ Jᵀ W with J the derivatives of (Θ, φ, R) by (δt, δω), g and R p × g, W the weights of the estimate, and
    N = Σ Jᵀ W J: first order.
    """
    arm = np.einsum("nij,tj->nti", found.rotation, object_points)
    placed = np.moveaxis(arm + found.position[:, None], -1, 0)
    _, gradients = project(placed, axis_separation, with_range=True)
    by_shift = np.moveaxis(gradients, (0, 1), (-1, -2))
    rows = np.concatenate([by_shift, np.cross(arm[:, :, None], by_shift)], axis=-1)
    counted = (
        (found.weights > 0.0) & np.isfinite(rows).all(axis=(2, 3)) & np.isfinite(covariance).all(axis=(2, 3))
    )
    rows = np.where(counted[..., None, None], rows, 0.0)
    used = covariance * _WEIGHED_ENTRIES if with_range else covariance * np.eye(3)
    weight = inverse(np.where(counted[..., None, None], used, np.eye(3)))
    if not with_range:
        weight = weight * np.diag([1.0, 1.0, 0.0])
    weighted = found.weights[..., None, None] * product(np.swapaxes(rows, -1, -2), weight)
    normal = product(weighted, rows).sum(axis=1)
    return np.asarray(product(pseudo_inverse(normal)[:, None], weighted))


def relative_series(
    reference: PoseSeries, other: PoseSeries, observations: Interpolated | None = None
) -> PoseSeries:
    """Return the poses of one object in the frame of another, M_a⁻¹ M_b, of series at the same times.

    ``observations``, those of the targets of the first and then of the second, say what both have in common; without
    them they are taken as measured independently (:func:`~scanner_sim.pose.covariance.relative_pose`). χ² and degrees
    of freedom add, and the status is the worse one (:func:`~scanner_sim.pose.status.worse_of`).

    Raises
    ------
    ValueError
        If the series have not the same times and method.
    """
    if reference.method != other.method or not np.array_equal(reference.time, other.time):
        raise ValueError("relative poses need series of one method at the same times")
    shared = _shared_by(reference, other, observations)
    between, stays, common = (
        relative_pose(
            replace(reference, covariance=getattr(reference, part)),
            replace(other, covariance=getattr(other, part)),
            own,
        )
        for part, own in zip(_PARTS, shared, strict=True)
    )
    true = np.swapaxes(reference.truth_rotation, 1, 2)
    apart = (other.truth_position - reference.truth_position)[..., None]
    return PoseSeries(
        name=other.name,
        relative_to=reference.name,
        method=other.method,
        time=other.time,
        position=between.position,
        rotation=between.rotation,
        covariance=between.covariance,
        chi2=reference.chi2 + other.chi2,
        dof=reference.dof + other.dof,
        targets=reference.targets + other.targets,
        status=worse_of(reference.status, other.status),
        truth_position=product(true, apart)[..., 0],
        truth_rotation=product(true, other.truth_rotation),
        lasting=stays.covariance,
        common=common.covariance,
    )


def _shared_by(
    one: PoseSeries, other: PoseSeries, observations: Interpolated | None
) -> tuple[Array | None, Array | None, Array | None]:
    """Return the covariance between poses of two objects, and its parts, in the order of ``_PARTS``, (n, 6, 6)."""
    if observations is None or one.gains is None or other.gains is None:
        return None, None, None
    first = one.gains.shape[1]
    whole, lasting = (
        between_poses(one.gains, values[:, :first, first:], other.gains)
        for values in (observations.covariance, observations.lasting)
    )
    moved = observations.common
    return whole, lasting, _in_common(one.gains, moved[:, :first], other.gains, moved[:, first:])
