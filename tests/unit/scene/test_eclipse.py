"""How much of the Sun the Earth leaves visible: a fine grid of points on the Sun's disc."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scanner_sim.scene.light.earth import angle_between, visible_share

SUN = 4.65e-3


@pytest.mark.parametrize("earth", [SUN, 0.01, 0.3, 1.15])
@pytest.mark.parametrize("depth", [-0.98, -0.5, 0.0, 0.3, 0.9])
def test_the_earth_covers_the_points_of_the_sun_behind_it(earth: float, depth: float) -> None:
    """Claim: the share of the Sun's disc that is farther from the Earth's centre than its limb, on the sphere.

    Set-up: 500 × 500 points; the centres lie ``depth`` Suns' radii beyond where the limb cuts the Sun in half.
    Tolerance: half a row of points, and the second order of the Sun's radius.
    """
    separation = earth + depth * SUN
    grid = ((np.arange(500) + 0.5) / 250.0 - 1.0) * SUN
    x, y = (axis[np.hypot(*np.meshgrid(grid, grid)) < SUN] for axis in np.meshgrid(grid, grid))
    # Angles from the Sun's centre (the small disc as plane), which lies at ``separation`` along x.
    away = np.hypot(x, y)
    turn = np.arctan2(y, x)
    cosine = np.cos(separation) * np.cos(away) - np.sin(separation) * np.sin(away) * np.cos(turn)
    wanted = float(np.mean(np.arccos(np.clip(cosine, -1.0, 1.0)) > earth))
    assert visible_share(separation, SUN, earth) == pytest.approx(wanted, abs=3e-3)


def test_the_limb_bends_away_from_the_sun() -> None:
    """Claim: a limb through the Sun's middle leaves a half and what lies behind y²/(2 tan β), a³/(3 tan β) of πa²."""
    for earth in (0.3, 1.15):
        wanted = 0.5 + SUN / (3.0 * math.pi * math.tan(earth))
        assert visible_share(earth, SUN, earth) == pytest.approx(wanted, abs=1e-6)


def test_a_body_before_the_sun_leaves_a_ring() -> None:
    assert visible_share(1e-4, SUN, 2e-3) == pytest.approx(1.0 - (math.tan(2e-3) / SUN) ** 2)
    assert visible_share(0.3 + 1.001 * SUN, SUN, 0.3) == 1.0
    assert visible_share(0.3 - 1.001 * SUN, SUN, 0.3) == 0.0


def test_angles_are_exact_where_vectors_are_alike() -> None:
    for angle in (0.0, 1e-9, 0.4, 3.0, math.pi):
        other = np.array([math.cos(angle), math.sin(angle), 0.0])
        assert angle_between(np.array([1.0, 0.0, 0.0]), other) == pytest.approx(angle, rel=1e-9, abs=1e-15)
