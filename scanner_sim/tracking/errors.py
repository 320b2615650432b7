"""What the error of a visit is made of, and what it has in common with those of other visits and targets.

A covariance says how large the error of one visit is, but not whether the next visit has another one. Six parts do:

========  ==========================================  ====================================  ======================
part      from                                        lasts                                 shared by
========  ==========================================  ====================================  ======================
white     jitter, encoders, light, read noise, and    not at all, but for visits whose      nobody
          what the dither changes of the speckle      dwells lie alike (``dither``)
surface   speckle of the target's own surface         until the target has turned by        nobody
          (:mod:`~scanner_sim.tracking.lasting`)      ``turn`` beneath the pattern or
                                                      come nearer by ``approach``
pixels    unlike pixels under the spot's image        until the image has moved by its      targets whose images
                                                      width                                 lie on the same pixels
wobble    the mirrors' bearings                       ``wobble_time``                       targets at the same
                                                                                            φ in Θ, same Θ in φ
drift     temperature of the encoders                 minutes: for ever                     all
common    errors of the calibration                   for ever                              all
========  ==========================================  ====================================  ======================
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import cholesky, exp, product
from scanner_sim.optics.deflection import wobble_correlation

Array = NDArray[np.float64]

_STEP, _REACH = 0.5, 12
"""Distance of the nodes of an integral over images, over their width, and nodes on each side of an image."""
_NODES = np.arange(-_REACH, _REACH + 1.0)[:, None, None]
_DECAY = exp(-0.5 * (_NODES * _STEP) ** 2)

HARMONICS = 2
"""Harmonics of a dither that are followed."""
_DIRECTIONS = tuple(
    (math.cos(angle), math.sin(angle)) for angle in (math.pi * (k + 0.5) / 8.0 for k in range(8))
)
"""Of a pattern's curve on a surface, evenly."""
_LEAST_SURFACE = np.diag([1e-24, 1e-24, 1e-20])
"""Added to surfaces' parts, so that those of nothing have a root too [rad², m²]."""


@dataclass(frozen=True)
class ErrorParts:
    """Parts of the covariance of measured positions (Θ, φ, R), which add up to it; leading axes (...).

    Attributes
    ----------
    white
        Covariance of what no other visit has [rad, m], shape (..., 3, 3).
    surface
        Covariance of what the target's surface makes of all its visits, shape (..., 3, 3).
    turn, approach
        Turn of the target beneath the pattern with which that goes [rad], and change of its range with which it goes
        [m], (...).
    range_fades
        How many times sooner the surface's part of R goes that is not its slope's, (...).
    pixels
        Variance of R by unlike pixels [m²], (...).
    image, image_width
        Position of the spot's image on the line, and the standard deviation of a Gaussian image that weighs unlike
        pixels as the range of the whole pattern does [pixel], (...).
    wobble
        Variance of Θ and of φ by the mirrors' wobble [rad²], (...).
    wobble_time, wobble_angle
        Over which it changes [s, rad], (...).
    drift
        Standard deviations of Θ and φ by the encoders' drift, which have the same sign where these have [rad],
        shape (..., 2).
    common
        What k errors of the calibration, of unit variance each, make of (Θ, φ, R), shape (..., 3, k); k is 0 without
        any.
    dither
        Covariances of what of the white part goes as cos(2π h u), sin(2π h u) with the place u of the dwells on the
        curve of the target's pattern, h = 1, 2, …, shape (..., h, 3, 3): visits Δ apart share cos(2π h Δ) of it.
    dwell_place
        u [point], (...).
    dwell_step
        Way from dwell to dwell on the target's surface, in 1/e² radii of the beam, (...).
    offset
        How far along Θ and φ the pattern's middle lies there from the target's, in radii, shape (..., 2).
    """

    white: Array
    surface: Array
    turn: Array
    approach: Array
    range_fades: Array
    pixels: Array
    image: Array
    image_width: Array
    wobble: Array
    wobble_time: Array
    wobble_angle: Array
    drift: Array
    common: Array
    dither: Array
    dwell_place: Array
    dwell_step: Array
    offset: Array

    @property
    def shared(self) -> Array:
        """Covariance of what targets share: pixels, wobble, drift and calibration, shape (..., 3, 3)."""
        result = np.zeros_like(self.white)
        result[..., 2, 2] = self.pixels
        for axis in (0, 1):
            result[..., axis, axis] = self.wobble
        result[..., :2, :2] += self.drift[..., :, None] * self.drift[..., None, :]
        return result + _products(self.common, self.common) if self.common.shape[-1] else result

    @property
    def surface_root(self) -> Array:
        """L with L Lᵀ the surfaces' part, but for a picoradian and 0.1 nm, shape (..., 3, 3)."""
        return cholesky(self.surface + _LEAST_SURFACE)

    @property
    def dither_root(self) -> Array:
        """The same of what goes with the places of the dwells, shape (..., h, 3, 3)."""
        return cholesky(self.dither + _LEAST_SURFACE)

    @property
    def lasting(self) -> Array:
        """Covariance of what other visits have too: all but the white part, shape (..., 3, 3)."""
        return self.surface + self.shared

    @property
    def whole(self) -> Array:
        """Covariance of the whole error, shape (..., 3, 3)."""
        return self.white + self.surface + self.shared

    @classmethod
    def all_white(cls, covariance: ArrayLike) -> ErrorParts:
        """Return errors of covariances (..., 3, 3) that have nothing in common."""
        white = np.array(covariance, dtype=np.float64)
        none = np.zeros(white.shape[:-2])
        one = none + 1.0
        still = np.zeros((*none.shape, 2))
        common, dither = np.zeros((*none.shape, 3, 0)), np.zeros((*none.shape, HARMONICS, 3, 3))
        alone = (white, 0.0 * white, one, one, one, none, none, one, none, one, one)
        return cls(*alone, still, common, dither, none, one, still)

    @classmethod
    def stack(cls, parts: Sequence[ErrorParts]) -> ErrorParts:
        """Return the parts of several visits as one, along a new first axis.

        Visits that measured nothing know of no calibration: where others do, they have zeros in ``common``.
        """
        widest = max((one.common.shape[-1] for one in parts), default=0)
        alike = [one._widened(widest) for one in parts]
        return cls(*(np.stack([getattr(one, field.name) for one in alike]) for field in fields(cls)))

    def _widened(self, count: int) -> ErrorParts:
        """Return the same with as many errors of the calibration, further ones without effect."""
        missing = count - self.common.shape[-1]
        if not missing:
            return self
        none = np.zeros((*self.common.shape[:-1], missing))
        return replace(self, common=np.concatenate([self.common, none], axis=-1))

    def reshape(self, shape: tuple[int, ...]) -> ErrorParts:
        """Return the same with other leading axes."""
        leading = self.turn.ndim
        return ErrorParts(*(part.reshape(*shape, *part.shape[leading:]) for part in vars(self).values()))

    def at(self, index: int | tuple[NDArray[np.intp], NDArray[np.intp]]) -> ErrorParts:
        """Return some of them by an index into the leading axes."""
        return ErrorParts(*(part[index] for part in vars(self).values()))


def common_covariance(
    parts: ErrorParts, position: Array, time: Array, target: ArrayLike, *, lasting: bool = False
) -> Array:
    """Return what the errors of several visits have in common.

    Parameters
    ----------
    parts
        Of m visits, leading axes (..., m).
    position, time
        Measured (Θ, φ, R) [rad, m], shape (..., m, 3), and when [s], shape (..., m).
    target
        Number of the target of each visit, shape (m,).
    lasting
        Leave out wobble and dither, so that only what lasts for seconds remains.

    Returns
    -------
    ndarray
        Covariances between visits, shape (..., m, m, 3, 3), without the white parts. Surfaces: L₁ L₂ᵀ, the same three
        standard errors by the root L of each visit's part, which differ where patterns do; of one target (visits that
        lie close in time) what is left where the patterns' middles lie apart (:func:`_left_apart`). Pixels: images Δ
        apart, of width s, share (1 − Δ²/2s²) exp(−Δ²/4s²), the correlation of Σ x q(x) ε(x) for two Gaussian images q
        over white ε. Wobble: :func:`~scanner_sim.optics.deflection.wobble_correlation` of the times and of the other
        mirror's angles. Drift: all.
    """
    number = np.asarray(target)
    same = number[:, None] == number

    def apart(values: Array) -> Array:
        return np.asarray(values[..., :, None] - values[..., None, :])

    def geometric(variance: Array) -> Array:
        return np.asarray(np.sqrt(variance[..., :, None] * variance[..., None, :]))

    root = parts.surface_root
    result = _products(root[..., :, None, :, :], root[..., None, :, :, :])
    if same.sum() > len(same):
        moved = parts.offset[..., :, None, :] - parts.offset[..., None, :, :]
        result *= _left_apart(moved, 0.0)[..., None, None]
        if not lasting and parts.dither.any():
            result += _by_dither(parts, apart(parts.dwell_place), moved)
    result = np.where(same[..., None, None], result, 0.0)
    result[..., 2, 2] += geometric(parts.pixels) * pixel_correlation(
        apart(parts.image) / geometric(parts.image_width**2) ** 0.5
    )
    drift = parts.drift
    result[..., :2, :2] += drift[..., :, None, :, None] * drift[..., None, :, None, :]
    if parts.common.shape[-1]:
        result += _products(parts.common[..., :, None, :, :], parts.common[..., None, :, :, :])
    if not lasting:
        together = geometric(parts.wobble) * wobble_correlation(apart(time) / parts.wobble_time[..., None])
        for axis in (0, 1):
            other = apart(position[..., 1 - axis]) / parts.wobble_angle[..., None]
            result[..., axis, axis] += together * wobble_correlation(other)
    return result


def _left_apart(moved: Array, rate: Array | float) -> Array:
    """Return what is left of a part of the speckle where two patterns lie apart by some radii (..., 2), shape (...).

    Where a curve runs along t and across n, other speckle lies beneath it by exp(−(n·δ)²), and what goes as cos(k s)
    with the way s along it has another phase, cos(k t·δ): their mean over all directions. ``rate`` k [1/radius].
    """
    left = np.zeros(moved.shape[:-1])
    for along, across in _DIRECTIONS:
        beside = along * moved[..., 1] - across * moved[..., 0]
        left += exp(-beside * beside) * np.cos(rate * (along * moved[..., 0] + across * moved[..., 1]))
    return left / len(_DIRECTIONS)


def _by_dither(parts: ErrorParts, apart: Array, moved: Array) -> Array:
    """Return what visits (..., m) share whose dwells lie so many points apart, (..., m, m, 3, 3); 0 with themselves."""
    root = parts.dither_root
    other = ~np.eye(apart.shape[-1], dtype=bool)
    step = 0.5 * (parts.dwell_step[..., :, None] + parts.dwell_step[..., None, :])
    found = np.zeros((*apart.shape, 3, 3))
    for number in range(root.shape[-3]):
        own, turns = root[..., number, :, :], 2.0 * np.pi * (number + 1)
        alike = np.where(other, np.cos(turns * apart) * _left_apart(moved, turns / step), 0.0)
        found += alike[..., None, None] * _products(own[..., :, None, :, :], own[..., None, :, :, :])
    return found


def _products(one: Array, other: Array) -> Array:
    """Return A Bᵀ of arrays (..., 3, k)."""
    return product(one, np.swapaxes(other, -1, -2))


def pixel_correlation(apart: ArrayLike) -> Array:
    """Return what two images share of the errors of unlike pixels, by their distance over their width."""
    square = np.asarray(apart, dtype=np.float64) ** 2
    return np.asarray((1.0 - 0.5 * square) * exp(-0.25 * square))


def mean_pixel_correlation(position: Array, weight: Array) -> Array:
    """Return the mean of :func:`pixel_correlation` over all pairs of images, shape (patterns,).

    Parameters
    ----------
    position
        Of the images, over their width, shape (patterns, n).
    weight
        w of each image: a pair counts by the product of both, shape (patterns, n).

    Notes
    -----
    Σ w_i w_j ρ(x_i − x_j) is ∫ (Σ w_i h(x − x_i))² dx, h(x) = x exp(−x²/2) (2/√π)^½, whose trapezium rule in steps of
    ½ is exact to 1e-9: n images of 25 nodes each, and not n² pairs.
    """
    node = np.rint(position / _STEP)
    off = position - node * _STEP
    # exp(−(m s − f)²/2) of the nodes m s about the nearest one, at the distance f.
    rising = np.cumprod(np.repeat(exp(_STEP * off)[None], _REACH, axis=0), axis=0)
    bell = exp(-0.5 * off**2) * np.concatenate([1.0 / rising[::-1], np.ones((1, *off.shape)), rising])
    edge = weight * bell * (_DECAY * (_NODES * _STEP - off))
    # Each pattern has nodes of its own.
    first, last = node.min(axis=1, keepdims=True) - _REACH, node.max() + _REACH
    width = int(last - first.min()) + 1
    place = (node - first) + width * np.arange(len(node))[:, None] + _NODES
    sums = np.bincount(place.astype(np.intp).ravel(), edge.ravel(), width * len(node)).reshape(-1, width)
    # Only over its own nodes: the order in which a row is added up depends on its length.
    own = (node.max(axis=1) + _REACH - first[:, 0] + 1.0).astype(np.intp)
    square = np.array([(row[:count] ** 2).sum() for row, count in zip(sums, own, strict=True)])
    return np.asarray(square * (2.0 * _STEP / np.sqrt(np.pi)) / weight.sum(axis=1) ** 2)
