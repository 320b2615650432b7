"""Least squares of a dot's ten parameters on the numbers of its pixels, with weights from the fit itself.

Variance beyond the sensor's that is told pixel by pixel, as by a finite number of paths of light, is itself an estimate
from few numbers, and errs with the pixel's own value: as a weight it would choose among errors. Weights have its mean
over the pixels about, and the covariance is that of least squares with such weights, N⁻¹ Jᵀ W V W J N⁻¹ with N = Jᵀ W J
and V the variances as told (White, *Econometrica* 48, 1980, 817).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from scanner_sim.foundation.arithmetic import inverse, product, solve_linear
from scanner_sim.signals.dots.edge_model import (
    BLUR,
    CONTRAST,
    COUNT,
    L_UU,
    L_VV,
    LIGHT,
    expected_numbers,
)
from scanner_sim.signals.dots.settings import LEAST_BLUR, FrameCalibration

Array = NDArray[np.float64]

_ROUNDS = 3
"""Fits, each with the variances of the one before."""
_MOST_STEPS = 25
_SETTLED = 1e-5
"""Fall of χ² that a step promises below which a fit has settled."""
_BLUR_KNOWN, _BLUR_OPEN = 0.3, 0.06
"""Share to which the blur is known beforehand, and pixels at best: focus and motion change it."""
_ABOUT = 2
"""Pixels to each side over which variance that is told pixel by pixel is a mean where it weighs."""


class Told(NamedTuple):
    """Variance beyond the sensor's [DN²]: of each pixel, and its mean about each."""

    own: Array
    about: Array

    @classmethod
    def of(cls, sigma: Array) -> Told:
        """Return that of a frame, by standard deviations of its pixels [DN], shape (rows, columns)."""
        own = np.square(sigma, dtype=np.float64)
        return cls(own, uniform_filter(own, 2 * _ABOUT + 1, mode="nearest"))

    def at(self, where: tuple[NDArray[np.int64], NDArray[np.int64]]) -> Told:
        """Return that of some pixels, by their rows and columns."""
        return Told(self.own[where], self.about[where])


@dataclass
class Fitted:
    """Parameters (d, 10), their covariance (d, 10, 10), χ², number of residuals and what is left per depth (d,)."""

    parameters: Array
    covariance: Array
    chi2: Array
    freedom: Array
    misfit: Array
    settled: NDArray[np.bool_]


def adjusted(
    numbers: Array,
    used: NDArray[np.bool_],
    start: Array,
    about: Array,
    calibration: FrameCalibration,
    more: Told,
) -> Fitted:
    """Return fits of all dots of a window's size together.

    Parameters
    ----------
    numbers, used
        Digital numbers above black and which of them count, shape (d, h, w).
    start
        First parameters, see :func:`~scanner_sim.signals.dots.edge_model.expected_numbers`, shape (d, 10); their blur
        is the one that is believed.
    about
        Rows and columns of the window about its middle [pixel], shape (w,).
    calibration
        What is believed of the sensor.
    more
        Variance beyond that, shapes (d, h, w).
    """
    longest = float(np.abs(start[:, L_UU : L_VV + 1]).max()) * 1.2 + 1.0
    window = _Window(numbers, used, about, longest, start[:, BLUR], more)
    values, settled = start.copy(), np.ones(len(start), dtype=bool)
    for _ in range(_ROUNDS):
        # What does not settle once is no dot.
        left = np.flatnonzero(settled)
        if not left.size:
            break
        own, image = window.of(left), expected_numbers(values[left], about, about, longest)
        weight = _weights(own, image[0], calibration)
        values[left], settled[left] = _descended(own, weight, values[left], image)
    expected, rows = expected_numbers(values, about, about, longest)
    weight = _weights(window, expected, calibration)
    _, normal, _ = _normal(window, weight, values, expected, rows)
    apart = np.where(used, numbers - expected, 0.0)
    chi2 = np.sum(weight * apart**2, axis=(1, 2))
    pixels = used.sum(axis=(1, 2))
    beyond = np.sum(apart**2 - np.where(used, 1.0 / np.where(used, weight, 1.0), 0.0), axis=(1, 2))
    depth = np.abs(values[:, LIGHT] * values[:, CONTRAST])
    # The blur's own observation leaves nine parameters to the pixels where they tell nothing of it.
    return Fitted(
        values,
        _covariance(window, weight, inverse(normal), expected, rows, calibration),
        chi2,
        pixels - COUNT + 1.0,
        np.sqrt(np.maximum(beyond, 0.0) / pixels) / depth,
        settled,
    )


@dataclass(frozen=True)
class _Window:
    """Numbers above black and which of them count (d, h, w), pixels about the middle, longest half axis, believed blur.

    ``more`` is the variance beyond the sensor's [DN²], shapes (d, h, w).
    """

    numbers: Array
    used: NDArray[np.bool_]
    about: Array
    longest: float
    blur: Array
    more: Told

    @property
    def blur_known(self) -> Array:
        """What is known of the blurs beforehand, as an inverse variance [1/pixel²], shape (d,)."""
        return 1.0 / np.maximum(_BLUR_KNOWN * self.blur, _BLUR_OPEN) ** 2

    def of(self, chosen: NDArray[np.intp]) -> _Window:
        """Return the windows of some dots."""
        return replace(
            self,
            numbers=self.numbers[chosen],
            used=self.used[chosen],
            blur=self.blur[chosen],
            more=Told(self.more.own[chosen], self.more.about[chosen]),
        )


def _weights(window: _Window, expected: Array, calibration: FrameCalibration) -> Array:
    """Return the inverse variances of pixels [1/DN²], zero of those that are not fitted, shape (d, h, w)."""
    return np.where(window.used, 1.0 / (calibration.variance(expected) + window.more.about), 0.0)


def _covariance(
    window: _Window, weight: Array, spread: Array, expected: Array, rows: Array, calibration: FrameCalibration
) -> Array:
    """Return the parameters' covariance (d, 10, 10), by N⁻¹ and the variances of pixels as they are told."""
    weighted = rows * weight[:, None]
    variance = calibration.variance(expected) + window.more.own
    middle = np.einsum("dahw,dchw->dac", weighted * variance[:, None], weighted)
    middle[:, BLUR, BLUR] += window.blur_known
    return product(spread, middle, spread)


def _descended(
    window: _Window, weight: Array, values: Array, image: tuple[Array, Array]
) -> tuple[Array, NDArray[np.bool_]]:
    """Return parameters of least weighted squares, by Levenberg and Marquardt's steps, and which of them settled.

    ``image`` is what pixels read by the first parameters, with derivatives.
    """
    about = window.about
    damping, settled = np.full(len(values), 1e-3), np.zeros(len(values), dtype=bool)
    values = values.copy()
    cost, normal, slope = _normal(window, weight, values, *image)
    going = np.arange(len(values))
    for _ in range(_MOST_STEPS):
        matrix, right = _within_bounds(values[going], normal[going], slope[going])
        matrix += (damping[going, None] * np.einsum("dii->di", matrix))[..., None] * np.eye(COUNT)
        step = solve_linear(matrix, right[..., None])[..., 0]
        step = np.where(np.isfinite(step), step, 0.0)
        promised = np.einsum("di,di->d", step, right)
        settled[going] = (promised < _SETTLED) & (damping[going] < 1e-2)
        left = ~settled[going] & (damping[going] <= 1e6)
        going, step = going[left], step[left]
        if not going.size:
            break
        own, trial = window.of(going), _bounded(values[going] + step)
        after = _normal(own, weight[going], trial, *expected_numbers(trial, about, about, own.longest))
        better = after[0] <= cost[going]
        taken = going[better]
        values[taken] = trial[better]
        cost[taken], normal[taken], slope[taken] = (part[better] for part in after)
        damping[going] *= np.where(better, 0.1, 10.0)
    return values, settled


def _normal(
    window: _Window, weight: Array, values: Array, expected: Array, rows: Array
) -> tuple[Array, Array, Array]:
    """Return weighted squares (d,), normal matrix (d, 10, 10) and right-hand side (d, 10), the blur's known."""
    apart = window.numbers - expected
    flat = rows.reshape(*rows.shape[:2], -1)
    weighted = flat * weight.reshape(len(weight), 1, -1)
    normal = np.einsum("dap,dcp->dac", weighted, flat)
    slope = np.einsum("dap,dp->da", weighted, apart.reshape(len(apart), -1))
    known = window.blur_known
    off = window.blur - values[:, BLUR]
    normal[:, BLUR, BLUR] += known
    slope[:, BLUR] += known * off
    return np.sum(weight * apart * apart, axis=(1, 2)) + known * off * off, normal, slope


def _within_bounds(values: Array, normal: Array, slope: Array) -> tuple[Array, Array]:
    """Return normal matrix and right-hand side with the blur left out where it is at its least and would be less."""
    held = (values[:, BLUR] <= LEAST_BLUR) & (slope[:, BLUR] < 0.0)
    matrix, right = normal.copy(), slope.copy()
    matrix[held, BLUR], matrix[held, :, BLUR], right[held, BLUR] = 0.0, 0.0, 0.0
    matrix[held, BLUR, BLUR] = 1.0
    return matrix, right


def _bounded(values: Array) -> Array:
    """Return parameters within what a dot can have, so that no trial leads out of the numbers."""
    bounded = values.copy()
    bounded[:, BLUR] = np.clip(values[:, BLUR], LEAST_BLUR, 10.0)
    bounded[:, CONTRAST] = np.clip(values[:, CONTRAST], 0.01, 1.5)
    bounded[:, [L_UU, L_VV]] = np.maximum(values[:, [L_UU, L_VV]], 0.3)
    return bounded
