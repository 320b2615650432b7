"""The two deflecting mirrors: where the laser and the receiver stand and look (eqs 1 and 3).

The first mirror turns the beam by Θ in a plane; the second turns that plane, with laser *and* receiver in it,
by φ about the line x ∥, z = D_g. Laser and receiver are virtual points that move with φ. See
:mod:`scanner_sim.frames` for the axes. The equations are those of Blais, Beraldin, El-Hakim (2000), section
2.2, and hold exactly in this model; the mirrors are infinitely thin and of unlimited size.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from pydantic import Field

from scanner_sim.parts import Part
from scanner_sim.units import Angle, Length


class Mirrors(Part):
    """The two galvanometer mirrors."""

    axis_separation: Length = Field(default=50e-3, ge=0.0, le=1.0)
    """Distance D_g between the two deflection axes (eq 3)."""
    max_deflection: Angle = Field(default=0.5, gt=0.0, lt=1.5)
    """Largest optical deflection of each axis, to both sides."""
    jitter: Angle = Field(default=8e-6, ge=0.0, le=1e-2)
    """Standard deviation of the pointing error common to laser and receiver, per axis and shot."""


class Frame(NamedTuple):
    """Axes and points of the deflected optics in the scanner frame: triples (x, y, z), or a renderer's vectors.

    ``along`` is the direction of the beam u, ``across`` the transverse direction n in the plane of
    triangulation (positive towards +x), ``normal`` their common normal (towards +y), ``laser`` and ``lens`` the virtual
    positions of the laser's origin and of the receiver's node.
    """

    along: Any
    across: Any
    normal: Any
    laser: Any
    lens: Any


def deflected_frame(
    sin_theta: Any, cos_theta: Any, sin_phi: Any, cos_phi: Any, axis_separation: Any, baseline: Any
) -> Frame:
    """Return the deflected optics for the sines and cosines of (Θ, φ).

    Parameters
    ----------
    sin_theta, cos_theta, sin_phi, cos_phi
        Arrays of one shape (NumPy or Dr.Jit).
    axis_separation, baseline
        D_g and d [m].

    Returns
    -------
    Frame
        u = (sinΘ, cosΘ sinφ, cosΘ cosφ), n = (cosΘ, −sinΘ sinφ, −sinΘ cosφ), laser at
        (0, −D_g sinφ, D_g (1 − cosφ)), lens node at (d, −D_g sinφ, D_g (1 − cosφ)): eq 3 with the second
        mirror acting on the laser and on the receiver alike.
    """
    zero = 0.0 * sin_phi
    y = -axis_separation * sin_phi
    z = axis_separation * (1.0 - cos_phi)
    return Frame(
        along=(sin_theta, cos_theta * sin_phi, cos_theta * cos_phi),
        across=(cos_theta, -sin_theta * sin_phi, -sin_theta * cos_phi),
        normal=(zero, cos_phi, -sin_phi),
        laser=(zero, y, z),
        lens=(zero + baseline, y, z),
    )
