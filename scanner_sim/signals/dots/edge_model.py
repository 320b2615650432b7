"""What pixels read of a black ellipse on white: its edge blurred by the point spread and integrated over the pixels.

With K the pixel's square widened by a Gaussian, a product of one function of u and one of v, the share of black in a
pixel is ∬ K over the ellipse. By Green's theorem it is a line integral round the edge (X, Y)(s),

    c = ∮ H(X − u) B(Y − v) Y' ds,    B(t) = Φ((t + ½)/σ) − Φ((t − ½)/σ),    H' = B,

and its change with a parameter is that of the edge times K, ∮ B(X − u) B(Y − v) (X_p Y' − Y_p X') ds. Both are
integrals of smooth periodic functions, for which equal steps of s are exact to rounding (Trefethen and Weideman, *SIAM
Review* 56, 2014, 385). A step reaches the few pixels about it; farther away H is 0 or 1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from scanner_sim.foundation.arithmetic import exp

Array = NDArray[np.float64]

COUNT = 10
"""Parameters of a dot: see :func:`expected_numbers`."""
U, V, L_UU, L_UV, L_VV, LIGHT, LIGHT_U, LIGHT_V, CONTRAST, BLUR = range(COUNT)
_STEPS_PER_BLUR = 0.9
"""Steps of the edge per standard deviation of the blur: the error is exp(−2 π² 0.9²), 1e-7."""
_FEWEST_STEPS = 24
_FEET = 6.0
"""Standard deviations of the blur beyond which a kernel is none: 1e-9."""


def expected_numbers(parameters: Array, u: Array, v: Array, half_axis: float) -> tuple[Array, Array]:
    """Return what pixels of D windows read above black, and its derivatives.

    Parameters
    ----------
    parameters
        Shape (D, 10): centre u, v; L_uu, L_uv, L_vv of the symmetric matrix that makes the ellipse of the unit circle
        [pixel]; light, its rise along u and v about the centre of the window [DN, DN/pixel]; contrast, 1 for a disc
        that reflects nothing; standard deviation of the blur [pixel].
    u, v
        Columns and rows of the windows [pixel], one apart, about the middle of each, shapes (w,) and (h,).
    half_axis
        Longest half axis for which edges are divided into enough steps [pixel].

    Returns
    -------
    tuple
        Numbers [DN], light × (1 − contrast × share of black), shape (D, h, w), and derivatives, shape (D, 10, h, w).
    """
    # Each dot has the steps of the power of two below its blur: what is blurred more needs fewer.
    power = np.frexp(parameters[:, BLUR])[1] - 1
    numbers = np.empty((len(parameters), len(v), len(u)))
    derivatives = np.empty((len(parameters), COUNT, len(v), len(u)))
    for one in np.unique(power).tolist():
        rows, least = np.flatnonzero(power == one), 2.0**one
        steps = max(_FEWEST_STEPS, int(np.ceil(2.0 * np.pi * half_axis / least * _STEPS_PER_BLUR)))
        numbers[rows], derivatives[rows] = _numbers(parameters[rows], u, v, steps)
    return numbers, derivatives


def _numbers(parameters: Array, u: Array, v: Array, steps: int) -> tuple[Array, Array]:
    """Return :func:`expected_numbers` by edges of so many steps."""
    p = parameters.T[..., None]  # (10, D, 1)
    s = 2.0 * np.pi / steps * np.arange(steps)
    cos, sin = np.cos(s), np.sin(s)
    x, y = p[U] + p[L_UU] * cos + p[L_UV] * sin, p[V] + p[L_UV] * cos + p[L_VV] * sin
    dx, dy = -p[L_UU] * sin + p[L_UV] * cos, -p[L_UV] * sin + p[L_VV] * cos
    across, down = _Near.of(x, u, p[BLUR]), _Near.of(y, v, p[BLUR])
    normals = (dy, -dx, cos * dy, sin * dy - cos * dx, -sin * dx)
    weight = 2.0 * np.pi / steps
    near = _Window.of(down, across)
    share = weight * (near.gathered(dy, down.box, across.bend) + _behind(down, x, dy, down.box, u))
    by_edge = weight * np.stack([near.gathered(n, down.box, across.box) for n in normals], axis=1)
    by_blur = weight * (
        near.gathered(dy, down.box, across.bend_by_blur)
        + near.gathered(dy, down.box_by_blur, across.bend)
        + _behind(down, x, dy, down.box_by_blur, u)
    )
    q = parameters.T[..., None, None]
    light = q[LIGHT] + q[LIGHT_U] * u + q[LIGHT_V] * v[:, None]
    left = 1.0 - q[CONTRAST] * share
    derivatives = np.empty((len(parameters), COUNT, len(v), len(u)))
    derivatives[:, :LIGHT] = -(q[CONTRAST] * light)[:, None] * by_edge
    derivatives[:, LIGHT], derivatives[:, LIGHT_U], derivatives[:, LIGHT_V] = (
        left,
        left * u,
        left * v[:, None],
    )
    derivatives[:, CONTRAST] = -light * share
    derivatives[:, BLUR] = -light * q[CONTRAST] * by_blur
    return light * left, derivatives


class _Near(NamedTuple):
    """One axis: kernels of the few pixels that a blurred point of the edge reaches, each (D, steps, 2r + 1).

    Attributes
    ----------
    pixel
        Which pixels of the window these are, from −1, which stands for all before it, to ``size``, for all behind.
    size
        Pixels of the window along the axis.
    box, bend
        B(t), and H(t) less the step from 0 to 1 at t = 0, which is all that is left of it farther away.
    box_by_blur, bend_by_blur
        Derivatives of B and H.
    """

    pixel: NDArray[np.int64]
    size: int
    box: Array
    bend: Array
    box_by_blur: Array
    bend_by_blur: Array

    @classmethod
    def of(cls, edge: Array, pixels: Array, blur: Array) -> _Near:
        """Return those of points (D, steps) of edges; with g(x) = x Φ(x) + φ(x), H = σ (g(t₊) − g(t₋))."""
        reach = int(np.ceil(0.5 + _FEET * float(blur.max())))
        # A trial far outside of the window has no pixels near.
        nearest = np.rint(np.clip(edge - pixels[0], -reach - 2.0, len(pixels) + reach + 1.0)).astype(np.int64)
        number = nearest[..., None] + np.arange(-reach, reach + 1)
        t = edge[..., None] - (pixels[0] + number)
        blur = blur[..., None]
        upper, lower = (t + 0.5) / blur, (t - 0.5) / blur
        phi_upper, phi_lower = (exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi) for x in (upper, lower))
        above, below = ndtr(upper), ndtr(lower)
        return cls(
            np.clip(number, -1, len(pixels)),
            len(pixels),
            above - below,
            blur * (upper * above - lower * below + phi_upper - phi_lower) - (t > 0.0),
            -(upper * phi_upper - lower * phi_lower) / blur,
            phi_upper - phi_lower,
        )


class _Window(NamedTuple):
    """Where the pixels near points of edges stand in windows with a margin, one behind the other.

    Attributes
    ----------
    place
        For each of D dots, points and pixels, shape (D × steps × (2r + 1)²,).
    shape
        Of all windows, (D, h + 2, w + 2).
    """

    place: NDArray[np.int64]
    shape: tuple[int, int, int]

    @classmethod
    def of(cls, down: _Near, across: _Near) -> _Window:
        """Return those of two axes."""
        shape = len(down.pixel), down.size + 2, across.size + 2
        dot = np.arange(shape[0])[:, None, None]
        place = (dot * shape[1] + down.pixel + 1)[..., None] * shape[2] + across.pixel[:, :, None] + 1
        return cls(place.ravel(), shape)

    def gathered(self, along: Array, rows: Array, columns: Array) -> Array:
        """Return sums over the edge of ``along`` (D, steps) times kernels of v and of u, shape (D, h, w)."""
        values = (along[..., None] * rows)[..., None] * columns[:, :, None]
        found = np.bincount(self.place, values.ravel(), math.prod(self.shape))
        return np.asarray(found.reshape(self.shape)[:, 1:-1, 1:-1], dtype=np.float64)


def _behind(down: _Near, x: Array, along: Array, rows: Array, u: Array) -> Array:
    """Return sums of ``along`` times a kernel of v over the points of the edge to the right of pixels, (D, h, w)."""
    height, width = down.size + 2, len(u) + 1
    first = np.ceil(np.clip(x - u[0], 0.0, len(u)))
    # A point in a pixel's middle, within rounding, is behind it where its bend says so.
    first = np.clip(first + (u[0] + first < x) - (u[0] + first - 1.0 >= x), 0.0, len(u)).astype(np.int64)
    dot = np.arange(len(along))[:, None, None]
    place = (dot * height + down.pixel + 1) * width + first[..., None]
    found = np.bincount(place.ravel(), (along[..., None] * rows).ravel(), len(along) * height * width)
    summed = np.cumsum(found.reshape(len(along), height, width)[..., ::-1], axis=-1)
    return np.asarray(summed[:, 1:-1, -2::-1])
