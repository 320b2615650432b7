"""Mirrors whose second axis is not where it should be, and the light's way by matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim.optics.deflection import deflected_frame, turned_axis_frame

BASE, D = 0.2, 0.05


@pytest.mark.parametrize(("offset", "skew"), [(0.0, 0.0), (2e-3, 0.0), (-3e-3, 0.02), (1e-3, -0.05)])
@pytest.mark.parametrize(("theta", "phi"), [(0.0, 0.3), (0.4, -0.35)])
def test_all_turns_about_the_axis_where_it_is(offset: float, skew: float, theta: float, phi: float) -> None:
    """Claim: plane, laser and lens turn by −φ about (cos s, sin s, 0) through (0, e, D): SciPy's rotation. Tolerance:
    of the series of sine and cosine of s, s⁵/120."""
    frame = turned_axis_frame(np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), D, BASE, offset, skew)
    turn = Rotation.from_rotvec(-phi * np.array([np.cos(skew), np.sin(skew), 0.0]))
    through, tolerance = np.array([0.0, offset, D]), abs(skew) ** 5 / 60.0 + 1e-15
    for found, start in (
        (frame.along, [np.sin(theta), 0.0, np.cos(theta)]),
        (frame.across, [np.cos(theta), 0.0, -np.sin(theta)]),
        (frame.normal, [0.0, 1.0, 0.0]),
    ):
        np.testing.assert_allclose(np.array(found, dtype=float), turn.apply(start), atol=tolerance)
    for place, at in ((frame.laser, 0.0), (frame.lens, BASE)):
        wanted = turn.apply(np.array([at, 0.0, 0.0]) - through) + through
        np.testing.assert_allclose(np.array(place, dtype=float), wanted, atol=tolerance)
    if offset == skew == 0.0:
        plain = deflected_frame(np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi), D, BASE)
        for one, other in zip(frame, plain, strict=True):
            np.testing.assert_allclose(np.array(one, dtype=float), np.array(other, dtype=float), atol=1e-15)
