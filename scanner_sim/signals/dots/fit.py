"""Centres of dots by least squares on the pixels about them, weighed by the noise that the sensor is known to have.

Gauss and Markov's estimate with variances from the fit itself, read²/g² + 1/12 + n/g, which tends to maximum likelihood
where a pixel holds more than some tens of electrons (Nelder and Wedderburn, *J. R. Statist. Soc. A* 135, 1972, 370).
σ are from the Fisher information Jᵀ W J of all ten parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from scanner_sim.foundation.arithmetic import inverse, solve_linear
from scanner_sim.signals.dots.edge_model import (
    BLUR,
    CONTRAST,
    COUNT,
    L_UU,
    L_UV,
    L_VV,
    LIGHT,
    U,
    V,
    edge_steps,
    expected_numbers,
)
from scanner_sim.signals.dots.found import Blobs, find_blobs
from scanner_sim.signals.dots.settings import LEAST_BLUR, DotStatus, FrameCalibration

Array = NDArray[np.float64]

_MARGIN = 4.0
"""Pixels beyond the edge of a dot, blur apart, that are fitted."""
_WINDOWS = (8, 11, 15, 20, 27, 36, 48, 64)
"""Half sizes of windows [pixel]."""
_ROUNDS = 3
"""Fits, each with the variances of the one before."""
_MOST_STEPS = 25
_SETTLED = 1e-5
"""Fall of χ² that a step promises below which a fit has settled."""
_BLUR_KNOWN = 0.3
"""Share to which the blur is known beforehand: focus and motion change it."""
_LEAST_AXIS = 0.6
"""Half axis below which a dot has no shape [pixel]."""
_LEAST_SIGNAL = 8.0
"""Depth of a dot over the noise of one pixel of its surroundings."""
_LEAST_PROBABILITY = 1e-3
"""Probability of χ² below which σ are widened by the misfit."""
_LARGEST_MISFIT = 0.05
"""Root mean square of what the fit leaves, over the depth of the dot and beyond noise, at which it is no ellipse."""
_LEAST_LIGHT = 0.2
"""Share of its median that the light of a dot's window has in a corner at least; below, a shadow lies across it."""


@dataclass(frozen=True)
class Dots:
    """Dots of a frame.

    Attributes
    ----------
    centre
        (u, v) of the ellipses [pixel], shape (d, 2); of one that is not valid where the blob is.
    covariance
        Theirs [pixel²], shape (d, 2, 2); NaN of those that are not valid.
    shape
        (L_uu, L_uv, L_vv): the symmetric matrix that makes the ellipse of the unit circle [pixel], shape (d, 3).
    light, contrast, blur
        White above black [DN], share of it that the disc lacks, standard deviation of the edge's blur [pixel].
    chi2, pixels
        Squared residuals in standard deviations, and their number, shape (d,).
    status
        :class:`~scanner_sim.signals.dots.settings.DotStatus`, shape (d,).
    """

    centre: Array
    covariance: Array
    shape: Array
    light: Array
    contrast: Array
    blur: Array
    chi2: Array
    pixels: NDArray[np.int64]
    status: NDArray[np.int8]

    @property
    def half_axes(self) -> Array:
        """Longer and shorter half axis [pixel], shape (d, 2): the eigenvalues of the shape's matrix."""
        middle, apart = self._halves
        return np.stack([middle + apart, middle - apart], axis=1)

    @property
    def angle(self) -> Array:
        """Direction of the longer axis, from u towards v [rad], shape (d,)."""
        return np.asarray(0.5 * np.arctan2(2.0 * self.shape[:, 1], self.shape[:, 0] - self.shape[:, 2]))

    @property
    def _halves(self) -> tuple[Array, Array]:
        uu, uv, vv = self.shape.T
        return 0.5 * (uu + vv), np.hypot(0.5 * (uu - vv), uv)


def find_dots(
    frame: NDArray[np.generic], calibration: FrameCalibration, *, sigma: Array | None = None
) -> Dots:
    """Return the dots of a frame, from top left to bottom right.

    Parameters
    ----------
    frame
        Digital numbers, shape (rows, columns).
    calibration
        What is believed of the sensor.
    sigma
        Standard deviation of each pixel beyond that, as by a finite number of paths of light [DN], shape of the frame.
    """
    return fit_dots(frame, find_blobs(frame, calibration), calibration, sigma=sigma)


def fit_dots(
    frame: NDArray[np.generic], blobs: Blobs, calibration: FrameCalibration, *, sigma: Array | None = None
) -> Dots:
    """Return dots fitted to the pixels about blobs, in their order; ``sigma`` as of :func:`find_dots`."""
    count = len(blobs.centre)
    dots = Dots(
        blobs.centre.copy(),
        np.full((count, 2, 2), np.nan),
        blobs.shape.copy(),
        blobs.light.copy(),
        blobs.contrast.copy(),
        np.full(count, calibration.blur),
        np.full(count, np.nan),
        np.zeros(count, dtype=np.int64),
        _before(frame, blobs, calibration, sigma),
    )
    reach = _reach(blobs.shape, calibration.blur)
    for least, half in zip((0, *_WINDOWS), _WINDOWS, strict=False):
        chosen = np.flatnonzero((dots.status == DotStatus.VALID) & (reach > least) & (reach <= half))
        if chosen.size:
            _fit(dots, chosen, np.asarray(frame, dtype=np.float64), blobs, calibration, half, sigma)
    return dots


def _reach(shape: Array, blur: float) -> Array:
    """Return how far a fit looks from the centres [pixel]."""
    return np.asarray(np.hypot(np.abs(shape).max(axis=1), np.abs(shape[:, 1])) + _MARGIN + 2.0 * blur)


def _before(
    frame: NDArray[np.generic], blobs: Blobs, calibration: FrameCalibration, sigma: Array | None
) -> NDArray[np.int8]:
    """Return VALID, or why a blob is not fitted."""
    status = np.full(len(blobs.centre), DotStatus.VALID, dtype=np.int8)
    smallest = 0.5 * (blobs.shape[:, 0] + blobs.shape[:, 2]) - np.hypot(
        0.5 * (blobs.shape[:, 0] - blobs.shape[:, 2]), blobs.shape[:, 1]
    )
    column, row = np.rint(blobs.centre).astype(np.int64).T
    more = 0.0 if sigma is None else np.square(sigma[row, column], dtype=np.float64)
    noise = np.sqrt(calibration.variance(blobs.light) + more)
    status[blobs.contrast * blobs.light < _LEAST_SIGNAL * noise] = DotStatus.SHADOWED
    status[smallest < _LEAST_AXIS] = DotStatus.TOO_SMALL
    far = _reach(blobs.shape, calibration.blur)
    status[far > _WINDOWS[-1]] = DotStatus.NOT_ELLIPTICAL
    rows, columns = frame.shape
    inside = (blobs.centre - far[:, None] >= 0.0) & (blobs.centre + far[:, None] <= [columns - 1, rows - 1])
    status[blobs.clipped | ~inside.all(axis=1)] = DotStatus.CLIPPED
    return status


def _fit(
    dots: Dots,
    chosen: NDArray[np.intp],
    frame: Array,
    blobs: Blobs,
    calibration: FrameCalibration,
    half: int,
    sigma: Array | None,
) -> None:
    """Fit the dots ``chosen`` in windows of one size, and write them to their places."""
    middle = np.rint(blobs.centre[chosen]).astype(np.int64)
    along = np.arange(-half, half + 1)
    # Beyond the frame the nearest pixel stands for any: it is not fitted.
    row = np.clip(middle[:, 1, None] + along, 0, frame.shape[0] - 1)
    column = np.clip(middle[:, 0, None] + along, 0, frame.shape[1] - 1)
    pixels = row[:, :, None], column[:, None, :]
    raw = frame[pixels]
    more = np.zeros_like(raw) if sigma is None else np.square(sigma[pixels], dtype=np.float64)
    start = np.zeros((len(chosen), COUNT))
    start[:, [U, V]] = blobs.centre[chosen] - middle
    start[:, [L_UU, L_UV, L_VV]] = blobs.shape[chosen]
    start[:, LIGHT], start[:, CONTRAST] = blobs.light[chosen], blobs.contrast[chosen]
    start[:, BLUR] = max(calibration.blur, LEAST_BLUR)
    about = along.astype(np.float64)
    used = _within(start, about, _MARGIN + 2.0 * calibration.blur)
    saturated = (used & (raw >= calibration.saturation)).any(axis=(1, 2))
    fitted = _adjust(raw - calibration.black, used, start, about, calibration, more)
    status = np.where(saturated, DotStatus.SATURATED, _after(fitted, about, used, calibration))
    good = status == DotStatus.VALID
    spread = fitted.covariance[:, :2, :2] * _widening(fitted)[:, None, None]
    values = fitted.parameters
    dots.status[chosen], dots.chi2[chosen] = status, fitted.chi2
    dots.pixels[chosen] = used.sum(axis=(1, 2))
    into = chosen[good]
    dots.centre[into] = (values[:, :2] + middle)[good]
    dots.covariance[into] = spread[good]
    dots.shape[into] = values[good, L_UU : L_VV + 1]
    dots.light[into], dots.contrast[into] = values[good, LIGHT], values[good, CONTRAST]
    dots.blur[into] = values[good, BLUR]


@dataclass
class _Fitted:
    """Parameters (d, 10), their covariance (d, 10, 10), χ², number of residuals and what is left per depth (d,)."""

    parameters: Array
    covariance: Array
    chi2: Array
    freedom: Array
    misfit: Array
    settled: NDArray[np.bool_]


def _adjust(
    numbers: Array,
    used: NDArray[np.bool_],
    start: Array,
    about: Array,
    calibration: FrameCalibration,
    more: Array,
) -> _Fitted:
    """Return fits of all dots of a window's size together."""
    longest = float(np.abs(start[:, L_UU : L_VV + 1]).max()) * 1.2 + 1.0
    steps = edge_steps(longest, max(0.6 * calibration.blur, LEAST_BLUR))
    window = _Window(numbers, used, about, steps, start[:, BLUR], more)
    values, settled = start.copy(), np.ones(len(start), dtype=bool)
    for _ in range(_ROUNDS):
        # What does not settle once is no dot.
        left = np.flatnonzero(settled)
        if not left.size:
            break
        own = window.of(left)
        weight = _weights(own, expected_numbers(values[left], about, about, steps)[0], calibration)
        values[left], settled[left] = _descended(own, weight, values[left])
    expected, rows = expected_numbers(values, about, about, steps)
    weight = _weights(window, expected, calibration)
    _, normal, _ = _normal(window, weight, values, expected, rows)
    apart = np.where(used, numbers - expected, 0.0)
    chi2 = np.sum(weight * apart**2, axis=(1, 2))
    pixels = used.sum(axis=(1, 2))
    beyond = np.sum(apart**2 - np.where(used, 1.0 / np.where(used, weight, 1.0), 0.0), axis=(1, 2))
    depth = np.abs(values[:, LIGHT] * values[:, CONTRAST])
    # The blur's own observation leaves nine parameters to the pixels where they tell nothing of it.
    return _Fitted(
        values,
        inverse(normal),
        chi2,
        pixels - COUNT + 1.0,
        np.sqrt(np.maximum(beyond, 0.0) / pixels) / depth,
        settled,
    )


@dataclass(frozen=True)
class _Window:
    """Numbers above black and which of them count (d, h, w), pixels about the middle, steps of edges, believed blur.

    ``more`` is the variance beyond the sensor's [DN²], shape (d, h, w).
    """

    numbers: Array
    used: NDArray[np.bool_]
    about: Array
    steps: int
    blur: Array
    more: Array

    def of(self, chosen: NDArray[np.intp]) -> _Window:
        """Return the windows of some dots."""
        return replace(
            self,
            numbers=self.numbers[chosen],
            used=self.used[chosen],
            blur=self.blur[chosen],
            more=self.more[chosen],
        )


def _weights(window: _Window, expected: Array, calibration: FrameCalibration) -> Array:
    """Return the inverse variances of pixels [1/DN²], zero of those that are not fitted, shape (d, h, w)."""
    return np.where(window.used, 1.0 / (calibration.variance(expected) + window.more), 0.0)


def _descended(window: _Window, weight: Array, values: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return parameters of least weighted squares, by Levenberg and Marquardt's steps, and which of them settled."""
    about, steps = window.about, window.steps
    damping, settled = np.full(len(values), 1e-3), np.zeros(len(values), dtype=bool)
    values = values.copy()
    cost, normal, slope = _normal(window, weight, values, *expected_numbers(values, about, about, steps))
    going = np.arange(len(values))
    for _ in range(_MOST_STEPS):
        diagonal = np.einsum("dii->di", normal[going])
        matrix = normal[going] + (damping[going, None] * diagonal)[..., None] * np.eye(COUNT)
        step = solve_linear(matrix, slope[going][..., None])[..., 0]
        step = np.where(np.isfinite(step), step, 0.0)
        promised = np.einsum("di,di->d", step, slope[going])
        settled[going] = (promised < _SETTLED) & (damping[going] < 1e-2)
        left = ~settled[going] & (damping[going] <= 1e6)
        going, step = going[left], step[left]
        if not going.size:
            break
        own, trial = window.of(going), _bounded(values[going] + step)
        after = _normal(own, weight[going], trial, *expected_numbers(trial, about, about, steps))
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
    known = 1.0 / (_BLUR_KNOWN * window.blur) ** 2
    off = window.blur - values[:, BLUR]
    normal[:, BLUR, BLUR] += known
    slope[:, BLUR] += known * off
    return np.sum(weight * apart * apart, axis=(1, 2)) + known * off * off, normal, slope


def _bounded(values: Array) -> Array:
    """Return parameters within what a dot can have, so that no trial leads out of the numbers."""
    bounded = values.copy()
    bounded[:, BLUR] = np.clip(values[:, BLUR], LEAST_BLUR, 10.0)
    bounded[:, CONTRAST] = np.clip(values[:, CONTRAST], 0.01, 1.5)
    bounded[:, [L_UU, L_VV]] = np.maximum(values[:, [L_UU, L_VV]], 0.3)
    return bounded


def _within(values: Array, about: Array, margin: float) -> NDArray[np.bool_]:
    """Return which pixels lie within the ellipses widened by a margin, shape (d, h, w)."""
    uu, uv, vv = (values[:, k, None, None] for k in (L_UU, L_UV, L_VV))
    du, dv = about - values[:, U, None, None], about[:, None] - values[:, V, None, None]
    uu, vv = uu + margin, vv + margin
    determinant = uu * vv - uv * uv
    return np.asarray(np.hypot(vv * du - uv * dv, uu * dv - uv * du) <= determinant)


def _widening(fitted: _Fitted) -> Array:
    """Return χ² over its freedom where that is beyond chance, 1 elsewhere."""
    improbable = chdtrc(fitted.freedom, fitted.chi2) < _LEAST_PROBABILITY
    return np.where(improbable, np.maximum(fitted.chi2 / fitted.freedom, 1.0), 1.0)


def _after(
    fitted: _Fitted, about: Array, used: NDArray[np.bool_], calibration: FrameCalibration
) -> NDArray[np.int64]:
    """Return VALID, or why a fit is not to be trusted."""
    values = fitted.parameters
    uu, uv, vv = values[:, L_UU], values[:, L_UV], values[:, L_VV]
    apart = np.hypot(0.5 * (uu - vv), uv)
    shortest, longest = 0.5 * (uu + vv) - apart, 0.5 * (uu + vv) + apart
    noise = np.sqrt(calibration.variance(values[:, LIGHT]))
    light = values[:, LIGHT, None, None] + (
        values[:, LIGHT + 1, None, None] * about + values[:, LIGHT + 2, None, None] * about[:, None]
    )
    darkest = np.min(np.where(used, light, np.inf), axis=(1, 2))
    status = np.full(len(values), DotStatus.VALID, dtype=np.int64)
    badly = (fitted.misfit > _LARGEST_MISFIT) | ~fitted.settled | (longest > 1.5 * about[-1])
    status[badly | (values[:, CONTRAST] > 1.3)] = DotStatus.NOT_ELLIPTICAL
    status[shortest < _LEAST_AXIS] = DotStatus.TOO_SMALL
    weak = values[:, LIGHT] * values[:, CONTRAST] < _LEAST_SIGNAL * noise
    status[weak | (darkest < _LEAST_LIGHT * values[:, LIGHT])] = DotStatus.SHADOWED
    return status
