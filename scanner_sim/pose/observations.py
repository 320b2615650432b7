"""What was measured of the targets, with its variances: checked at the door, the batch as the last axis."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import eigen

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def take(values: Any, index: NDArray[np.intp]) -> Any:
    """Return the poses ``index`` of an array whose last axis is the batch, or is 1 and common to all poses.

    ``take`` and not an index in brackets, which would give another order in memory, and so other last bits of sums.
    """
    return values if values is None or values.shape[-1] == 1 else values.take(index, axis=-1)


def at_least_two(index: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return pose numbers (k,), a lone one twice.

    NumPy adds up in another order where the last axis has the length 1; without this the last bit of a pose would
    depend on whether others are estimated with it.
    """
    return np.repeat(index, 2) if len(index) == 1 else index


def shared(used: Flags) -> Flags:
    """Return the flags (n, B) as (n, 1) where all poses have the same, so that work on the object is done once."""
    return used[:, :1] if (used == used[:, :1]).all() else used


def principal_axes(points: Array, used: Flags) -> tuple[Array, Array, Array]:
    """Return middle, widths and axes of the targets that are used.

    Parameters
    ----------
    points
        Shape (3, n, B or 1) [m].
    used
        Shape (n, B or 1).

    Returns
    -------
    tuple
        The middle (3, B or 1) [m]; the widths, ascending, (3, B or 1) [m]: the root mean squares along the
        eigenvectors of the scatter; these, right-handed, the columns of (3, 3, B or 1).
    """
    share = used / np.maximum(used.sum(axis=0), 1)
    middle = np.einsum("inb,nb->ib", points, share)
    about = points - middle[:, None]
    squares, axes = eigen(np.einsum("inb,jnb->bij", about * share, about))
    # The first as the vector product of the others, so that they are right-handed.
    axes[:, :, 0] = np.cross(axes[:, :, 1], axes[:, :, 2])
    return middle, np.sqrt(np.maximum(squares, 0.0)).T, axes.transpose(1, 2, 0)


@dataclass(frozen=True)
class Prior:
    """A pose known before, as an observation.

    Attributes
    ----------
    rotation, position
        ``scanner_from_object`` (3, 3, B or 1) and the position of the object's origin [m] (3, B or 1).
    root
        W with WᵀW the inverse of the prior's covariance, shape (6, 6, B or 1).
    """

    rotation: Array
    position: Array
    root: Array

    def take(self, index: NDArray[np.intp]) -> Prior:
        """Return the poses ``index``."""
        return Prior(*(take(getattr(self, field.name), index) for field in fields(self)))


@dataclass(frozen=True)
class Observations:
    """Targets as surveyed and as measured, of B poses; an axis of length 1 is common to all poses.

    Attributes
    ----------
    points
        Surveyed targets [m] less ``centre``, along the object's axes, shape (3, n, B or 1).
    centre
        Their mean [m], shape (3, B or 1).
    values
        Θ [rad], φ [rad], R [m], shape (3, n, B); zero where not measured.
    seen, ranged
        Which targets have both angles, and a range too, shape (n, B).
    variances
        Of (Θ, φ, R), shape (3, n, B or 1).
    theta_range
        Covariance of Θ and R [rad m], shape (n, B or 1), or None: independent.
    theta_phi
        Covariance of Θ and φ [rad²], shape (n, B or 1), or None: independent.
    object_variances
        Of the surveyed coordinates [m²], along the object's axes, shape (3, n, 1), or None: exact.
    axis_separation
        D_g [m].
    prior
        Pose known before, or None.
    """

    points: Array
    centre: Array
    values: Array
    seen: Flags
    ranged: Flags
    variances: Array
    theta_range: Array | None
    theta_phi: Array | None
    object_variances: Array | None
    axis_separation: float
    prior: Prior | None

    @property
    def count(self) -> int:
        """Number of poses B."""
        return len(self.seen[0])

    @cached_property
    def principal(self) -> tuple[Array, Array, Array]:
        """Middle, widths and axes of the targets seen: see :func:`principal_axes`."""
        return principal_axes(self.points, shared(self.seen))

    def take(self, index: NDArray[np.intp]) -> Observations:
        """Return the poses ``index``."""
        batched = ("points", "centre", "values", "seen", "ranged", "variances", "theta_range", "theta_phi")
        chosen = {name: take(getattr(self, name), index) for name in batched}
        if self.count == 1:  # an axis of length 1 that is the whole batch may be asked for twice
            chosen |= {
                name: getattr(self, name).take(index, axis=-1) for name in ("values", "seen", "ranged")
            }
        prior = None if self.prior is None else self.prior.take(index)
        return replace(self, **chosen, prior=prior)

    def only(self, kept: Flags) -> Observations:
        """Return the observations with all targets but ``kept``, shape (n, B), left out."""
        return replace(self, seen=self.seen & kept, ranged=self.ranged & kept)

    def mirrored(self) -> Observations:
        """Return the observations of the mirror image of the object, its x axis turned round."""
        sign = np.array([-1.0, 1.0, 1.0])
        return replace(self, points=self.points * sign[:, None, None], centre=self.centre * sign[:, None])
