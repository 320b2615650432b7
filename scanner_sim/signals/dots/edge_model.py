"""What pixels read of a black ellipse on white: its edge blurred by the point spread and integrated over the pixels.

With K the pixel's square widened by a Gaussian, a product of one function of u and one of v, the share of black in a
pixel is ∬ K over the ellipse. By Green's theorem it is a line integral round the edge (X, Y)(s),

    c = ∮ H(X − u) B(Y − v) Y' ds,    B(t) = Φ((t + ½)/σ) − Φ((t − ½)/σ),    H' = B,

and its change with a parameter is that of the edge times K, ∮ B(X − u) B(Y − v) (X_p Y' − Y_p X') ds. Both are
integrals of smooth periodic functions, for which equal steps of s are exact to rounding (Trefethen and Weideman, *SIAM
Review* 56, 2014, 385), and a product of matrices over the steps.
"""

from __future__ import annotations

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


def edge_steps(half_axis: float, blur: float) -> int:
    """Return how many steps an ellipse's edge is divided into, by its longest half axis and least blur [pixel]."""
    return max(_FEWEST_STEPS, int(np.ceil(2.0 * np.pi * half_axis / blur * _STEPS_PER_BLUR)))


def expected_numbers(parameters: Array, u: Array, v: Array, steps: int) -> tuple[Array, Array]:
    """Return what pixels of D windows read above black, and its derivatives.

    Parameters
    ----------
    parameters
        Shape (D, 10): centre u, v; L_uu, L_uv, L_vv of the symmetric matrix that makes the ellipse of the unit circle
        [pixel]; light, its rise along u and v about the centre of the window [DN, DN/pixel]; contrast, 1 for a disc
        that reflects nothing; standard deviation of the blur [pixel].
    u, v
        Columns and rows of the windows [pixel], about the middle of each, shapes (w,) and (h,).
    steps
        From :func:`edge_steps`.

    Returns
    -------
    tuple
        Numbers [DN], light × (1 − contrast × share of black), shape (D, h, w), and derivatives, shape (D, 10, h, w).
    """
    p = parameters.T[..., None]  # (10, D, 1)
    s = 2.0 * np.pi / steps * np.arange(steps)
    cos, sin = np.cos(s), np.sin(s)
    x, y = p[U] + p[L_UU] * cos + p[L_UV] * sin, p[V] + p[L_UV] * cos + p[L_VV] * sin
    dx, dy = -p[L_UU] * sin + p[L_UV] * cos, -p[L_UV] * sin + p[L_VV] * cos
    across, summed, _, summed_blurred = _kernels(x[..., None] - u, p[BLUR][..., None])
    down, _, down_blurred, _ = _kernels(y[..., None] - v, p[BLUR][..., None])
    normals = np.stack([dy, -dx, cos * dy, sin * dy - cos * dx, -sin * dx], axis=1)  # (D, 5, n)
    weight = 2.0 * np.pi / steps
    share = weight * np.einsum("dnh,dnw->dhw", down, summed * dy[..., None])
    by_edge = weight * np.einsum("dnh,dknw->dkhw", down, normals[..., None] * across[:, None])
    by_blur = weight * (
        np.einsum("dnh,dnw->dhw", down, summed_blurred * dy[..., None])
        + np.einsum("dnh,dnw->dhw", down_blurred, summed * dy[..., None])
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


def _kernels(t: Array, blur: Array) -> tuple[Array, Array, Array, Array]:
    """Return B(t), H(t) and their derivatives by the blur; with g(x) = x Φ(x) + φ(x), H = σ (g(t₊) − g(t₋))."""
    upper, lower = (t + 0.5) / blur, (t - 0.5) / blur
    phi_upper, phi_lower = (exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi) for x in (upper, lower))
    above, below = ndtr(upper), ndtr(lower)
    box = above - below
    ramp = blur * (upper * above - lower * below + phi_upper - phi_lower)
    return box, ramp, -(upper * phi_upper - lower * phi_lower) / blur, phi_upper - phi_lower
