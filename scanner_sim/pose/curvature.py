"""Whether the covariance of a pose, which is of first order, describes what fits the measurements.

χ² about its least is then a paraboloid that rises by 1 where a pose is changed by one standard deviation. Where the
turn is known badly its second order bends the valley of equal χ² out of that paraboloid: the errors are no longer
normal ones, and a second minimum may lie within one standard deviation. Bates and Watts (*J. R. Statist. Soc. B* 42
(1980) 1) compare the second order with the first over the region of confidence, and distinguish what lies in the model
from what lies in its parameters; here both count, since the covariance is stated in these parameters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.pose.adjustment import PoseFit, Problem, cost_of
from scanner_sim.pose.observations import Flags
from scanner_sim.pose.transforms import exponential

Array = NDArray[np.float64]

_LARGEST_RISE = 2.0
"""Rise of χ², over that of first order, at which what lies beyond the first order is as large as it."""


def bent(problem: Problem, fit: PoseFit, covariance: Array, principal: tuple[Array, Array, Array]) -> Flags:
    """Return the poses (B,) about which χ² rises over one standard deviation twice as much as to first order, or falls.

    Parameters
    ----------
    problem, fit
        What was minimised, and where it is least.
    covariance
        Of (δc, δω), shape (6, 6, B). NaN is not bent.
    principal
        Middle, widths and axes of the targets: see :func:`~scanner_sim.pose.observations.principal_axes`.

    Notes
    -----
    Looked at are both ends of one standard deviation. The pose there is (t + δt, exp([δω]×) R), as the covariance has
    it, with t that of the object's origin: the farther this stands from the targets, the more it swings.
    """
    step = _widest_swing(problem, fit, covariance, principal)
    straight = np.einsum("ab,acb,cb->b", step, fit.normal, step)
    arm = _arm(problem, fit)
    found = np.zeros(len(fit.cost), dtype=bool)
    for move, turn in ((step[:3], step[3:]), (-step[:3], -step[3:])):
        rotation = exponential(turn)
        # The origin moves straight, by δc + arm × δω; the centre of the array is carried round it.
        swung = np.einsum("ijb,jb->ib", rotation, arm) - arm - np.cross(turn, arm, axis=0)
        turned = np.einsum("ijb,jkb->ikb", rotation, fit.rotation)
        rise = cost_of(problem, turned, fit.position + move + swung) - fit.cost
        found |= (rise > _LARGEST_RISE * straight) | (rise < 0.0)
    return found


def _arm(problem: Problem, fit: PoseFit) -> Array:
    """Return the way from the object's origin to the centre of the array along the scanner's axes [m], (3, B)."""
    arm: Array = np.einsum("ijb,jb->ib", fit.rotation, np.broadcast_to(problem.centre, fit.position.shape))
    return arm


def _widest_swing(
    problem: Problem, fit: PoseFit, covariance: Array, principal: tuple[Array, Array, Array]
) -> Array:
    """Return the standard deviation (δc, δω), shape (6, B), whose second order moves the targets most.

    One of three: a turn about each of the array's axes a by its own standard deviation, with all that goes with it,
    C[:, ω] a / √(aᵀ C_ωω a). To second order it moves a target r from the origin by ½ δω × (δω × r), of which the mean
    square is ¼ |δω|² Σ_k (δω_k)² (w² − w_k²) for the widths w_k of the array, and that of its centre is added.
    """
    _, widths, axes = principal
    squares = widths * widths
    levers = squares.sum(axis=0) - squares
    along = np.einsum("ijb,jkb->ikb", fit.rotation, np.broadcast_to(axes, fit.rotation.shape))
    steps = np.einsum("ajb,jkb->akb", covariance[:, 3:], along)
    steps /= np.sqrt(np.einsum("jkb,jkb->kb", along, steps[3:]))
    turns = steps[3:]
    about = np.einsum("jib,jkb->ikb", along, turns)
    swing = np.cross(turns, _arm(problem, fit)[:, None], axis=0)
    second = np.einsum("ikb,ikb,ib->kb", about, about, np.broadcast_to(levers, fit.position.shape))
    second += np.einsum("ikb,ikb->kb", swing, swing)
    second *= np.einsum("ikb,ikb->kb", turns, turns)
    widest: Array = np.take_along_axis(steps, np.argmax(second, axis=0)[None, None], axis=1)[:, 0]
    return widest
