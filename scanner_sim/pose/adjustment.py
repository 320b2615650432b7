"""Least squares of many poses at once: Gauss-Newton, damped where a step fails (Levenberg, Marquardt).

The pose is changed by (δc, δω): X = c + R r with r the target about the centre of the array becomes
X + δc + δω × R r, so a measured quantity with the gradient g changes by g·δc + (R r × g)·δω. The normal equations
N δ = b, 6 × 6, are solved for all poses in one call of LAPACK.

SciPy's optimisers take one problem per call, 1.5 ms each of four targets; a batch of poses would be a Python loop. They
stand in the tests as the reference for this one. Levenberg, *Quart. Appl. Math.* 2 (1944); Marquardt, *SIAM J. Appl.
Math.* 11 (1963); Huber, *Ann. Math. Statist.* 35 (1964) for the weights of doubtful targets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import applied, product, pseudo_inverse, solve_linear
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.observations import Flags, Prior, at_least_two, take
from scanner_sim.pose.transforms import cayley, cross_matrix, vector_from_rotation

Array = NDArray[np.float64]

SETTLED_STEP = 1e-8
"""Step [rad, and of the distance] below which a pose has settled; the error left is its square, or a small share."""
COARSE_DECREASE = 1e-3
"""Fall of χ² that a step promises below which a pose is good enough to be compared with others."""
FINAL_DECREASE = 1e-10
"""The same for a final pose: 1e-5 standard deviations."""
_MOST_STEPS, _MOST_COARSE_STEPS, _MOST_HUBER_STEPS = 100, 40, 300
_SHARE_CLOSED = 0.15
FIRST_DAMPING, _LAST_DAMPING = 1e-3, 1e9
_RIDGE = 1e-14
"""Share of the diagonal that is always added: keeps a singular matrix from stopping the whole batch."""


@dataclass(frozen=True)
class Problem:
    """Residuals of B poses: W (measured − predicted).

    Attributes
    ----------
    points
        Targets about the centre of the array [m], shape (3, n, B or 1).
    measured
        (Θ, φ[, R]), or points (x, y, z) in the scanner frame where ``in_space``, shape (c, n, B).
    whitening
        W: 1/σ of each quantity, shape (c, n, B or 1), or a matrix per target, shape (c, c, n, B or 1); zero for what
        was not measured.
    in_space
        Whether points are compared (eq 12), rather than angles and ranges (eq 16).
    axis_separation
        D_g [m].
    huber
        Standard deviations beyond which a target's residual counts linearly; 0 for plain least squares.
    prior, centre
        Pose known before, or None, and the centre of the array [m] (3, B or 1), about which it is moved.
    """

    points: Array
    measured: Array
    whitening: Array
    in_space: bool
    axis_separation: float
    huber: float
    prior: Prior | None
    centre: Array

    def take(self, index: NDArray[np.intp]) -> Problem:
        """Return the poses ``index``."""
        return replace(
            self,
            points=take(self.points, index),
            measured=self.measured.take(index, axis=-1),
            whitening=take(self.whitening, index),
            prior=None if self.prior is None else self.prior.take(index),
            centre=take(self.centre, index),
        )


@dataclass
class PoseFit:
    """State of an adjustment of B poses.

    Attributes
    ----------
    rotation, position
        ``scanner_from_object`` (3, 3, B) and the position of the centre of the array [m] (3, B).
    cost
        Σ of the squared whitened residuals, or of Huber's function of them (B,).
    normal, slope
        N (6, 6, B) and b (6, B).
    settled
        Whether the last step was small enough (B,).
    """

    rotation: Array
    position: Array
    cost: Array
    normal: Array
    slope: Array
    settled: Flags

    def take(self, index: NDArray[np.intp]) -> PoseFit:
        """Return the poses ``index``."""
        return PoseFit(*(getattr(self, name).take(index, axis=-1) for name in self.__dataclass_fields__))


def place_points(problem: Problem, rotation: Array, position: Array) -> tuple[Array, Array]:
    """Return (R r, X) of the targets [m], both of shape (3, n, B)."""
    turned: Array = np.einsum("ijb,jnb->inb", rotation, problem.points)
    return turned, turned + position[:, None]


def predict(problem: Problem, placed: Array) -> tuple[Array, Array | None]:
    """Return what would be measured of points at ``placed`` (3, n, B) and its gradients; None is the unit matrix."""
    if problem.in_space:
        return placed, None
    return project(placed, problem.axis_separation, with_range=len(problem.measured) == 3)


def target_weights(problem: Problem, whitened: Array) -> Array | None:
    """Return Huber's weights min(1, k/|e|) of the targets, shape (n, B), or None for plain least squares."""
    if not problem.huber:
        return None
    length = np.sqrt(np.sum(whitened * whitened, axis=0))
    weights: Array = np.minimum(1.0, problem.huber / np.maximum(length, 1e-300))
    return weights


def whiten(problem: Problem, residuals: Array) -> Array:
    """Return W times the residuals, shape (c, n, B)."""
    if problem.whitening.ndim == residuals.ndim:
        return residuals * problem.whitening
    result: Array = np.einsum("cdnb,dnb->cnb", problem.whitening, residuals)
    return result


def jacobian(problem: Problem, turned: Array, gradients: Array | None) -> Array:
    """Return W ∂(predicted)/∂(δc, δω), the rows W g and R r × W g, shape (7, c, n, B) with a row left for residuals."""
    whitening = problem.whitening
    if gradients is None and whitening.ndim == 4:
        scaled = np.swapaxes(whitening, 0, 1)
    elif gradients is None:
        scaled = np.eye(3)[:, :, None, None] * whitening
    elif whitening.ndim == 3:
        scaled = gradients * whitening
    else:
        scaled = np.einsum("cdnb,kdnb->kcnb", whitening, gradients)
    rows = np.empty((7, *np.broadcast_shapes(scaled.shape[1:], turned.shape[1:])))
    rows[:3] = scaled
    spare = np.empty(rows.shape[1:])
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(turned[j], scaled[k], out=rows[3 + i])
        rows[3 + i] -= np.multiply(turned[k], scaled[j], out=spare)
    return rows


def linearise(problem: Problem, rotation: Array, position: Array) -> tuple[Array, Array, Array]:
    """Return cost (B,), normal matrix (6, 6, B) and right-hand side (6, B) of poses."""
    turned, placed = place_points(problem, rotation, position)
    predicted, gradients = predict(problem, placed)
    whitened = whiten(problem, problem.measured - predicted)
    rows = jacobian(problem, turned, gradients)
    rows[6] = whitened
    weights = target_weights(problem, whitened)
    if weights is not None:
        rows *= np.sqrt(weights)
    # With the residuals as a seventh row one product gives normal matrix, right-hand side and cost.
    flat = rows.reshape(7, -1, rows.shape[-1])
    product = np.einsum("akb,ckb->acb", flat, flat)
    normal, slope, cost = product[:6, :6], product[:6, 6], product[6, 6]
    if weights is not None:
        cost = _sum_of_squares(problem, whitened)
    if problem.prior is not None:
        apart, change = prior_residual(problem.prior, problem.centre, rotation, position)
        cost = cost + np.einsum("kb,kb->b", apart, apart)
        normal = normal + np.einsum("kab,kcb->acb", change, change)
        slope = slope - np.einsum("kab,kb->ab", change, apart)
    return cost, normal, slope


def cost_of(problem: Problem, rotation: Array, position: Array) -> Array:
    """Return the cost (B,) of poses alone, to rounding that of :func:`linearise`."""
    _, placed = place_points(problem, rotation, position)
    cost = _sum_of_squares(problem, whiten(problem, problem.measured - predict(problem, placed)[0]))
    if problem.prior is not None:
        apart, _ = prior_residual(problem.prior, problem.centre, rotation, position)
        cost += np.sum(apart * apart, axis=0)
    return cost


def _sum_of_squares(problem: Problem, whitened: Array) -> Array:
    """Return the sum (B,) of squared residuals, those of doubtful targets by Huber's function."""
    squared = np.sum(whitened * whitened, axis=0)
    if problem.huber:
        beyond = 2.0 * problem.huber * np.sqrt(squared) - problem.huber**2
        squared = np.where(squared > problem.huber**2, beyond, squared)
    cost: Array = squared.sum(axis=0)
    return cost


def prior_residual(prior: Prior, centre: Array, rotation: Array, position: Array) -> tuple[Array, Array]:
    """Return W (pose − prior), shape (6, B), and its derivative by (δc, δω), shape (6, 6, B).

    The rotation differs by ρ = log(R R₀ᵀ), which changes by J⁻¹(ρ) δω, with J the left Jacobian of the rotations:
    J⁻¹ = I − ½ [ρ]× + (1/ρ² − (1 + cosρ)/(2ρ sinρ)) [ρ]×² (Barfoot, *State Estimation for Robotics*, 2017, eq 7.76).
    """
    arm = np.einsum("ijb,jb->ib", rotation, np.broadcast_to(centre, position.shape))
    apart = np.einsum("ijb,kjb->ikb", rotation, np.broadcast_to(prior.rotation, rotation.shape))
    rho = vector_from_rotation(np.moveaxis(apart, -1, 0))
    angle = np.maximum(np.linalg.norm(rho, axis=-1), 1e-4)
    cross = cross_matrix(rho)
    factor = 1.0 / angle**2 - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle))
    by_turn = np.eye(3) - 0.5 * cross + factor[:, None, None] * product(cross, cross)
    change = np.zeros((len(rho), 6, 6))
    change[:, :3, :3] = np.eye(3)
    change[:, :3, 3:] = cross_matrix(arm.T)
    change[:, 3:, 3:] = by_turn
    difference = np.concatenate([position - arm - prior.position, rho.T])
    return (
        np.einsum("kab,ab->kb", prior.root, difference),
        np.einsum("kab,bac->kcb", np.broadcast_to(prior.root, (6, 6, len(rho))), change),
    )


def begin(problem: Problem, rotation: Array, position: Array) -> PoseFit:
    """Return the state of an adjustment at poses (3, 3, B) and (3, B): see :func:`adjust`."""
    return PoseFit(
        rotation.copy(),
        position.copy(),
        *linearise(problem, rotation, position),
        np.zeros(position.shape[1], dtype=bool),
    )


def adjust(problem: Problem, start: PoseFit, *, until: float) -> PoseFit:
    """Improve poses until they settle.

    Parameters
    ----------
    problem
        The residuals of B poses.
    start
        Where to start, from :func:`begin` or an earlier adjustment of the same problem; it is used up.
    until
        :data:`SETTLED_STEP`, a bound on the step, or :data:`COARSE_DECREASE`, one on the fall of χ² that it promises.

    Returns
    -------
    PoseFit
        Not settled are those that need more than 100 steps (40 for a coarse adjustment, 300 with
        Huber's weights, which settle by equal shares), or that no damping brings down.
        A pose does not depend on the others of its batch.
    """
    done = fit = start
    live, damping, share = np.arange(len(start.cost)), np.zeros(len(start.cost)), np.ones(len(start.cost))
    every = live
    closed = ~np.isfinite(start.cost)
    most = (
        _MOST_COARSE_STEPS
        if until == COARSE_DECREASE
        else _MOST_HUBER_STEPS
        if problem.huber
        else _MOST_STEPS
    )
    for _ in range(most):
        matrix = fit.normal.copy("C")
        matrix.reshape(36, -1)[::7] *= 1.0 + _RIDGE + damping
        step = _solve(matrix, fit.slope)
        promised = np.einsum("ab,ab->b", step, fit.slope)
        length, turn = np.abs(step).reshape(2, 3, -1).max(axis=1)
        small = (turn < SETTLED_STEP) & (length < SETTLED_STEP * np.abs(fit.position).max(axis=0))
        small |= promised < (COARSE_DECREASE if until == COARSE_DECREASE else FINAL_DECREASE)
        small &= damping < 2.0 * FIRST_DAMPING
        step *= share
        turned = np.einsum("ijb,jkb->ikb", cayley(step[3:]), fit.rotation)
        moved = fit.position + step[:3]
        trial = PoseFit(turned, moved, *linearise(problem, turned, moved), small)
        share = _next_share(share, np.einsum("ab,ab->b", step, trial.slope) / (promised * share))
        better = (trial.cost <= fit.cost) | (small & np.isfinite(trial.cost))
        if not better.all():
            worse = np.flatnonzero(~better)
            _store(fit.take(worse), trial, worse)
            trial.settled = better & small
        fit = trial
        if damping.any() or not better.all():
            damping = np.where(better, 0.1 * damping, np.maximum(10.0 * damping, FIRST_DAMPING))
            damping[damping < 1e-5] = 0.0
        finished = (fit.settled | (damping > _LAST_DAMPING)) & ~closed
        if not finished.any():
            continue
        # The lone last one of two goes on twice: the number of poses does not tell whether they are all.
        if live is every and finished.all():
            return fit
        index = np.flatnonzero(finished)
        _store(fit.take(index), done, live[index])
        closed |= finished
        if closed.all():
            return done
        # Copying the open ones together pays only when there are clearly fewer of them.
        if closed.mean() > _SHARE_CLOSED:
            going = at_least_two(np.flatnonzero(~closed))
            live, fit, problem, damping = live[going], fit.take(going), problem.take(going), damping[going]
            closed, share = closed[going], share[going]
    index = np.flatnonzero(~closed)
    _store(fit.take(index), done, live[index])
    return done


def _next_share(share: Array, left: Array) -> Array:
    """Return which share of the next Gauss-Newton step to take, from how much slope along the last one was left.

    Curved residuals make the valley wider or narrower than N says, most of all between the two tilts of a plane: steps
    of N then creep, or leap over the bottom to and fro. The secant through the two slopes gives the right length. Where
    a step left less than 0.3 of the slope N is right, and where it left all of it there is no bottom to aim at: such
    steps stay whole.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        right = np.clip(share / (1.0 - left), 0.1, 4.0)
    result: Array = np.where((np.abs(left) > 0.3) & (left < 0.95), right, 1.0)
    return result


def _store(fit: PoseFit, into: PoseFit, index: NDArray[np.intp]) -> None:
    for name in fit.__dataclass_fields__:
        getattr(into, name)[..., index] = getattr(fit, name)


def _solve(matrix: Array, right: Array) -> Array:
    """Return the solutions (6, B) of matrix (6, 6, B) · x = right (6, B)."""
    stacked = matrix.transpose(2, 0, 1)
    solved = solve_linear(stacked, right.T[..., None])[..., 0]
    singular = ~np.isfinite(solved).all(axis=1) & np.isfinite(stacked).all(axis=(1, 2))
    if singular.any():  # least-norm steps instead
        solved[singular] = applied(pseudo_inverse(stacked[singular]), right.T[singular])
    return np.ascontiguousarray(solved.T)
