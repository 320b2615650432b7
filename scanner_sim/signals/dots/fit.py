"""Centres of dots by least squares on the pixels about them, weighed by the noise that the sensor is known to have.

Gauss and Markov's estimate with variances from the fit itself, read²/g² + 1/12 + n/g and the pixels' unlike responses,
which tends to maximum likelihood where a pixel holds more than some tens of electrons (Nelder and Wedderburn,
*J. R. Statist. Soc. A* 135, 1972, 370). σ are from the Fisher information Jᵀ W J of all ten parameters, or where
variance is told pixel by pixel as :mod:`~scanner_sim.signals.dots.adjust` says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from scanner_sim.signals.dots.adjust import Fitted, Told, adjusted
from scanner_sim.signals.dots.edge_model import BLUR, CONTRAST, COUNT, L_UU, L_UV, L_VV, LIGHT, U, V
from scanner_sim.signals.dots.found import Blobs, find_blobs, is_same
from scanner_sim.signals.dots.settings import LEAST_BLUR, DotStatus, FrameCalibration

Array = NDArray[np.float64]

_MARGIN = 4.0
"""Pixels beyond the edge of a dot, blur apart, that are fitted."""
_WINDOWS = (8, 11, 15, 20, 27, 36, 48, 64)
"""Half sizes of windows [pixel]."""
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

    Notes
    -----
    A dot that is blurred over several pixels may be found by its darker core as well; both fits are the whole dot then,
    of which the first stays.
    """
    dots = fit_dots(frame, find_blobs(frame, calibration), calibration, sigma=sigma)
    valid = np.flatnonzero(dots.status == DotStatus.VALID)
    ellipses = np.hstack([dots.centre, dots.shape])[valid]
    again = np.tril(is_same(ellipses, ellipses), -1).any(axis=1)
    return Dots(**{name: np.delete(values, valid[again], axis=0) for name, values in vars(dots).items()})


def fit_dots(
    frame: NDArray[np.generic], blobs: Blobs, calibration: FrameCalibration, *, sigma: Array | None = None
) -> Dots:
    """Return dots fitted to the pixels about blobs, in their order; ``sigma`` as of :func:`find_dots`."""
    count = len(blobs.centre)
    told = None if sigma is None else Told.of(sigma)
    dots = Dots(
        blobs.centre.copy(),
        np.full((count, 2, 2), np.nan),
        blobs.shape.copy(),
        blobs.light.copy(),
        blobs.contrast.copy(),
        np.full(count, calibration.blur),
        np.full(count, np.nan),
        np.zeros(count, dtype=np.int64),
        _before(frame, blobs, calibration, told),
    )
    reach = _reach(blobs.shape, calibration.blur)
    for least, half in zip((0, *_WINDOWS), _WINDOWS, strict=False):
        chosen = np.flatnonzero((dots.status == DotStatus.VALID) & (reach > least) & (reach <= half))
        if chosen.size:
            _fit(dots, chosen, np.asarray(frame, dtype=np.float64), blobs, calibration, half, told)
    return dots


def _reach(shape: Array, blur: float) -> Array:
    """Return how far a fit looks from the centres [pixel]."""
    return np.asarray(np.hypot(np.abs(shape).max(axis=1), np.abs(shape[:, 1])) + _MARGIN + 2.0 * blur)


def _before(
    frame: NDArray[np.generic], blobs: Blobs, calibration: FrameCalibration, told: Told | None
) -> NDArray[np.int8]:
    """Return VALID, or why a blob is not fitted."""
    status = np.full(len(blobs.centre), DotStatus.VALID, dtype=np.int8)
    smallest = 0.5 * (blobs.shape[:, 0] + blobs.shape[:, 2]) - np.hypot(
        0.5 * (blobs.shape[:, 0] - blobs.shape[:, 2]), blobs.shape[:, 1]
    )
    column, row = np.rint(blobs.centre).astype(np.int64).T
    more = 0.0 if told is None else told.own[row, column]
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
    told: Told | None,
) -> None:
    """Fit the dots ``chosen`` in windows of one size, and write them to their places."""
    middle = np.rint(blobs.centre[chosen]).astype(np.int64)
    along = np.arange(-half, half + 1)
    # Beyond the frame the nearest pixel stands for any: it is not fitted.
    row = np.clip(middle[:, 1, None] + along, 0, frame.shape[0] - 1)
    column = np.clip(middle[:, 0, None] + along, 0, frame.shape[1] - 1)
    pixels = row[:, :, None], column[:, None, :]
    raw = frame[pixels]
    more = Told(np.zeros_like(raw), np.zeros_like(raw)) if told is None else told.at(pixels)
    start = np.zeros((len(chosen), COUNT))
    start[:, [U, V]] = blobs.centre[chosen] - middle
    start[:, [L_UU, L_UV, L_VV]] = blobs.shape[chosen]
    start[:, LIGHT], start[:, CONTRAST] = blobs.light[chosen], blobs.contrast[chosen]
    start[:, BLUR] = max(calibration.blur, LEAST_BLUR)
    about = along.astype(np.float64)
    used = _within(start, about, _MARGIN + 2.0 * calibration.blur)
    saturated = (used & (raw >= calibration.saturation)).any(axis=(1, 2))
    fitted = adjusted(raw - calibration.black, used, start, about, calibration, more)
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


def _within(values: Array, about: Array, margin: float) -> NDArray[np.bool_]:
    """Return which pixels lie within the ellipses widened by a margin, shape (d, h, w)."""
    uu, uv, vv = (values[:, k, None, None] for k in (L_UU, L_UV, L_VV))
    du, dv = about - values[:, U, None, None], about[:, None] - values[:, V, None, None]
    uu, vv = uu + margin, vv + margin
    determinant = uu * vv - uv * uv
    return np.asarray(np.hypot(vv * du - uv * dv, uu * dv - uv * du) <= determinant)


def _widening(fitted: Fitted) -> Array:
    """Return χ² over its freedom where that is beyond chance, 1 elsewhere."""
    improbable = chdtrc(fitted.freedom, fitted.chi2) < _LEAST_PROBABILITY
    return np.where(improbable, np.maximum(fitted.chi2 / fitted.freedom, 1.0), 1.0)


def _after(
    fitted: Fitted, about: Array, used: NDArray[np.bool_], calibration: FrameCalibration
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
