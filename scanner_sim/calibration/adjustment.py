"""The adjustment of a calibration field: parameters, stations, boards and targets together, by least squares.

Each sighting gives three conditions: the point that the instrument believes to have measured,
:func:`~scanner_sim.ranging.believed.believed_points`, is the target as it stands before the station. Since three
readings meet three conditions, the point's misfit e is as good as the readings' own, v = J⁻¹ e with J =
∂point/∂readings, whose covariance L Lᵀ is known: a combined adjustment (Gauss-Helmert) becomes one of ordinary
observation equations for L⁻¹ v (Mikhail, *Observations and Least Squares*, 1976, ch. 9). Tolerances, the survey of the
targets and scale bars are observations as well, and so are errors that the sightings of one station have in common: k
numbers with the mean 0 and variance 1. The field's axes are those of the first board.

Steps are Gauss-Newton's, damped where one fails (Levenberg, *Quart. Appl. Math.* 2, 1944; Marquardt, *SIAM J. Appl.
Math.* 11, 1963). Doubtful sightings count by Huber's weights (*Ann. Math. Statist.* 35, 1964) of the norm of their
three readings, whose square is χ² distributed with three degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import coo_array, csr_array
from scipy.stats import chi2

from scanner_sim.calibration.network import Field, Poses
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.pose.transforms import cross_matrix
from scanner_sim.ranging.believed import believed_points

Array = NDArray[np.float64]

DOUBTED = 0.999
"""Share of good sightings whose readings count in full."""
_KNEE = float(np.sqrt(chi2.ppf(DOUBTED, 3)))
_MOST_STEPS = 60
_SETTLED = 1e-6
"""Fall of the loss that a step promises below which all is settled: a thousandth of a standard deviation."""
_ROUNDING = 1e-6
"""Rise of the loss, relative to it, that a step may bring: slopes leave out how J changes, of second order."""
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e6


@dataclass(frozen=True)
class Unknowns:
    """What is adjusted.

    Attributes
    ----------
    parameters
        All of them [SI], shape (23,).
    stations, boards
        Their poses.
    displaced
        By how much targets are off their survey, along the axes of their boards [m], shape (T, 3).
    common
        What the sightings of each station have in common, over its σ, shape (S, k).
    """

    parameters: Array
    stations: Poses
    boards: Poses
    displaced: Array
    common: Array


@dataclass(frozen=True)
class Adjusted:
    """The result of an adjustment.

    Attributes
    ----------
    unknowns
        The adjusted values.
    covariance
        Of the parameters that were looked for, with their tolerances as prior knowledge.
    information
        What the sightings alone say of them, the inverse of a covariance; singular where they say nothing.
    residuals
        Of the readings, L⁻¹ v with L Lᵀ their covariance, shape (N, 3).
    weights
        Huber's, shape (N,): below 1 where a sighting is doubted.
    freedom
        Observations less unknowns.
    cost
        Sum of the squared residuals of all observations, as weighted.
    steps, settled
        Steps that were taken, and whether the last one changed nothing any more.
    """

    unknowns: Unknowns
    covariance: Array
    information: Array
    residuals: Array
    weights: Array
    freedom: int
    cost: float
    steps: int
    settled: bool

    @property
    def unit_weight(self) -> float:
        """Standard deviation of unit weight: 1 where σ of the readings is right and the model is complete."""
        return float(np.sqrt(self.cost / max(self.freedom, 1)))


def adjust(field: Field, start: Unknowns, *, robust: bool = True) -> Adjusted:
    """Adjust a field from starting values, which need to be good to some per cent of the distances only.

    Parameters
    ----------
    field
        Targets, sightings and what is looked for.
    start
        Starting values: :func:`scanner_sim.calibration.starts.start_of`.
    robust
        Whether doubtful sightings count less.
    """
    layout = _Layout.of(field)
    # Far from the solution every sighting would look doubtful: doubts begin where plain least squares have settled.
    now, system, steps, settled = _descended(field, layout, start, robust=False)
    if robust:
        now, system, more, settled = _descended(field, layout, now, robust=True)
        steps += more
    covariance, information = _of_parameters(field, layout, system.normal)
    return Adjusted(
        now,
        covariance,
        information,
        system.residuals,
        system.weights,
        len(system.weights) * 3 + layout.known - layout.count,
        system.cost,
        steps,
        settled,
    )


def _descended(
    field: Field, layout: _Layout, start: Unknowns, *, robust: bool
) -> tuple[Unknowns, _System, int, bool]:
    """Return the values at which the loss is least, their normal equations, the steps taken, and whether it settled."""
    now, damping, steps = start, _LEAST_DAMPING, 0
    system = _linearise(field, layout, now, robust=robust)
    while steps < _MOST_STEPS and damping < _MOST_DAMPING:
        steps += 1
        normal = system.normal + damping * np.diag(np.diag(system.normal))
        step = cho_solve(cho_factor(normal), system.slope)
        if system.slope @ step < _SETTLED:
            return now, system, steps, True
        moved = _moved(field, layout, now, step)
        tried = _linearise(field, layout, moved, robust=robust)
        if tried.loss <= system.loss * (1.0 + _ROUNDING):
            now, system, damping = moved, tried, max(0.1 * damping, _LEAST_DAMPING)
        else:
            damping *= 10.0
    return now, system, steps, False


@dataclass(frozen=True)
class _Layout:
    """Where each unknown stands: parameters, stations, boards but for the first, surveyed targets, common errors."""

    parameters: int
    stations: int
    boards: int
    targets: int
    common: int
    bars: int

    @classmethod
    def of(cls, field: Field) -> _Layout:
        surveyed = len(field.targets.names) if field.targets.sigma > 0.0 else 0
        return cls(
            len(field.sought),
            len(field.stations),
            len(field.targets.boards) - 1,
            surveyed,
            field.sightings.common.shape[2],
            len(field.bars.length),
        )

    @property
    def first_board(self) -> int:
        return self.parameters + 6 * self.stations

    @property
    def first_target(self) -> int:
        return self.first_board + 6 * self.boards

    @property
    def first_common(self) -> int:
        return self.first_target + 3 * self.targets

    @property
    def count(self) -> int:
        """How many unknowns there are."""
        return self.first_common + self.common * self.stations

    @property
    def known(self) -> int:
        """How many observations there are beside the sightings."""
        return self.parameters + 3 * self.targets + self.common * self.stations + self.bars


@dataclass(frozen=True)
class _System:
    normal: Array
    slope: Array
    residuals: Array
    weights: Array
    cost: float
    loss: float


def _linearise(field: Field, layout: _Layout, at: Unknowns, *, robust: bool) -> _System:
    """Return normal equations, residuals and sums of squares at some values."""
    residuals, jacobian = _sightings(field, layout, at)
    norm = np.sqrt(np.einsum("ni,ni->n", residuals, residuals))
    weights = np.minimum(1.0, _KNEE / np.maximum(norm, 1e-300)) if robust else np.ones_like(norm)
    beside, slopes = _known(field, layout, at)
    root = np.repeat(np.sqrt(weights), 3)
    weighted = csr_array(jacobian.multiply(root[:, None]))
    normal = (weighted.T @ weighted).toarray() + (slopes.T @ slopes).toarray()
    slope = -(weighted.T @ (root * residuals.ravel())) - slopes.T @ beside
    doubted = norm > _KNEE
    loss = np.where(doubted & robust, _KNEE * (2.0 * norm - _KNEE), norm**2).sum() + beside @ beside
    cost = float((weights * norm**2).sum() + beside @ beside)
    return _System(normal, slope, residuals, weights, cost, float(loss))


def _sightings(field: Field, layout: _Layout, at: Unknowns) -> tuple[Array, csr_array]:
    """Return the readings' residuals over σ, (N, 3), and their derivatives by all unknowns, (3N, unknowns)."""
    seen, targets = field.sightings, field.targets
    believed = believed_points(seen.readings, field.design, at.parameters, field.encoder_period)
    board = targets.board[seen.target]
    local = targets.places[seen.target] + at.displaced[seen.target]
    turned = np.einsum("nij,nj->ni", at.boards.rotation[board], local)
    away = turned + at.boards.position[board] - at.stations.position[seen.station]
    back = np.swapaxes(at.stations.rotation[seen.station], 1, 2)
    misfit = believed.point - np.einsum("nij,nj->ni", back, away)
    whiten = np.linalg.inv(believed.by_readings @ seen.root)
    to_field = whiten @ back
    blocks = [
        (whiten @ believed.by_parameters[..., [INDEX[name] for name in field.sought]], 0 * seen.station),
        (
            np.concatenate([to_field, -to_field @ cross_matrix(away)], axis=-1),
            layout.parameters + 6 * seen.station,
        ),
    ]
    moves = np.concatenate([-to_field, to_field @ cross_matrix(turned)], axis=-1)
    # The first board holds the axes: its columns stand nowhere.
    blocks.append(
        (np.where(board[:, None, None] > 0, moves, 0.0), layout.first_board + 6 * np.maximum(board - 1, 0))
    )
    if not layout.boards:
        blocks.pop()
    if layout.targets:
        blocks.append((-to_field @ at.boards.rotation[board], layout.first_target + 3 * seen.target))
    residuals = np.einsum("nij,nj->ni", whiten, misfit)
    if layout.common:
        shared = np.linalg.solve(seen.root, seen.common)
        residuals = residuals - np.einsum("nik,nk->ni", shared, at.common[seen.station])
        blocks.append((-shared, layout.first_common + layout.common * seen.station))
    return residuals, _assembled(blocks, len(seen), layout.count)


def _assembled(blocks: list[tuple[Array, NDArray[np.intp]]], count: int, unknowns: int) -> csr_array:
    """Return blocks (N, 3, w), whose columns begin at given numbers (N,), as one sparse matrix."""
    values, rows, columns = [], [], []
    for block, first in blocks:
        width = block.shape[2]
        row = np.arange(3 * count).reshape(count, 3, 1)
        values.append(block.ravel())
        rows.append(np.broadcast_to(row, block.shape).ravel())
        columns.append(np.broadcast_to(first[:, None, None] + np.arange(width), block.shape).ravel())
    where = np.concatenate(rows), np.concatenate(columns)
    return csr_array(coo_array((np.concatenate(values), where), shape=(3 * count, unknowns)))


def _known(field: Field, layout: _Layout, at: Unknowns) -> tuple[Array, csr_array]:
    """Return residuals and derivatives of what is known beside the sightings: tolerances, survey, scale bars."""
    sought = [INDEX[name] for name in field.sought]
    residuals = [at.parameters[sought] / field.tolerances]
    slopes = np.zeros((layout.known, layout.count))
    slopes[: layout.parameters, : layout.parameters] = np.diag(1.0 / field.tolerances)
    row = layout.parameters
    if layout.targets:
        residuals.append(at.displaced.ravel() / field.targets.sigma)
        for _ in range(3 * layout.targets):
            slopes[row, layout.first_target + row - layout.parameters] = 1.0 / field.targets.sigma
            row += 1
    if layout.common:
        residuals.append(at.common.ravel())
        for column in range(layout.first_common, layout.count):
            slopes[row, column] = 1.0
            row += 1
    if layout.bars:
        residuals.append(_bars(field, layout, at, slopes[row:]))
    return np.concatenate(residuals), csr_array(slopes)


def _bars(field: Field, layout: _Layout, at: Unknowns, slopes: Array) -> Array:
    """Return residuals of the scale bars over σ, and write their derivatives."""
    bars, targets = field.bars, field.targets
    ends = []
    for target in (bars.first, bars.second):
        board = targets.board[target]
        turned = np.einsum(
            "nij,nj->ni", at.boards.rotation[board], targets.places[target] + at.displaced[target]
        )
        ends.append((turned, board, target))
    between = [turned + at.boards.position[board] for turned, board, _ in ends]
    apart = between[1] - between[0]
    length = np.linalg.norm(apart, axis=1)
    along = apart / length[:, None] / bars.sigma[:, None]
    for sign, (turned, board, target) in zip((-1.0, 1.0), ends, strict=True):
        for bar, number in enumerate(board):
            if number > 0:
                first = layout.first_board + 6 * (number - 1)
                moves = np.concatenate([along[bar], np.cross(turned[bar], along[bar])])
                slopes[bar, first : first + 6] += sign * moves
            if layout.targets:
                first = layout.first_target + 3 * target[bar]
                slopes[bar, first : first + 3] += sign * along[bar] @ at.boards.rotation[number]
    return np.asarray((length - bars.length) / bars.sigma)


def _moved(field: Field, layout: _Layout, now: Unknowns, step: Array) -> Unknowns:
    """Return the unknowns after a step."""
    parameters = now.parameters.copy()
    parameters[[NAMES.index(name) for name in field.sought]] += step[: layout.parameters]
    stations = now.stations.turned(step[layout.parameters : layout.first_board].reshape(-1, 6))
    still = np.zeros((1, 6))
    boards = now.boards.turned(
        np.concatenate([still, step[layout.first_board : layout.first_target].reshape(-1, 6)])
    )
    displaced = now.displaced
    if layout.targets:
        displaced = displaced + step[layout.first_target : layout.first_common].reshape(-1, 3)
    common = now.common + step[layout.first_common :].reshape(now.common.shape)
    return Unknowns(parameters, stations, boards, displaced, common)


def _of_parameters(field: Field, layout: _Layout, normal: Array) -> tuple[Array, Array]:
    """Return covariance and information of the parameters, all else eliminated (Schur); tolerances are in the first."""
    k = layout.parameters
    others = cho_factor(normal[k:, k:])
    reduced = normal[:k, :k] - normal[:k, k:] @ cho_solve(others, normal[k:, :k])
    reduced = 0.5 * (reduced + reduced.T)
    information = reduced - np.diag(field.tolerances**-2.0)
    return np.linalg.inv(reduced), information
