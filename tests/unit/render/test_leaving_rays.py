"""Where rays begin that leave a surface."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import mitsuba
import numpy as np
import pytest

from scanner_sim.render.rays import leaving_rays

mi: Any = mitsuba

pytestmark = pytest.mark.usefixtures("device")


@pytest.mark.parametrize("point", [(0.0, 0.0, 0.0), (0.1, -9.0, 4.0), (1.0, 2.0, 30.0), (-80.0, 1.0, 5.0)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_rays_start_beside_their_surface_by_roundings_of_its_point(point: Any, side: float) -> None:
    """Claim: along the normal, to the side to which they go, 2⁻¹⁹ of a metre and of the point's largest coordinate:
    20 µm at 10 m, and enough at any distance for single precision; the direction is what was given."""
    normal = np.array([0.6, 0.0, 0.8])
    direction = side * np.array([0.0, 0.6, 0.8])
    surface: Any = SimpleNamespace(p=mi.Point3f(*point), n=mi.Normal3f(*normal.tolist()))
    ray = leaving_rays(surface, mi.Vector3f(*direction.tolist()))
    away = 2.0**-19 * (1.0 + max(map(abs, point)))
    moved = np.array(ray.o.numpy(), dtype=np.float64).ravel() - np.array(point)
    rounding = 2.0**-23 * max(map(abs, point))
    np.testing.assert_allclose(moved, side * away * normal, atol=1e-9 + rounding)
    np.testing.assert_allclose(np.array(ray.d.numpy()).ravel(), direction, rtol=1e-6)
    # A plane through the point is left behind by more than its points are rounded by.
    assert away > 8.0 * rounding
