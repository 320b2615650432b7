"""The speckle that stays with a surface: sums over a curve by brute force, and the limits of its share."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.tracking import lasting

Array = NDArray[np.float64]

RADIUS, COUNT = 2e-3, 24
TURN = 2.0 * np.pi * np.arange(COUNT) / COUNT
PLACE = 8e-3 * np.stack([np.cos(TURN), np.sin(TURN)])
RISE = 8e-3 * 2.0 * np.pi / COUNT * np.stack([-np.sin(TURN), np.cos(TURN)])


@pytest.mark.parametrize("on_surface", [0.0, 0.6])
def test_two_dithers_share_what_their_places_on_the_surface_do(on_surface: float) -> None:
    """Claim: Σ_ij e_i e_j ⟨ρ(r_i + u t_i − r_j − u′ t_j)⟩ over u, u′ at the thirds of a dwell, with exp(−δ²/w²) of the
    light and (1 − 2δ_x²/w²) exp(−δ²/w²) of its place on the surface: by a plain sum over all pairs."""
    errors = np.stack([1.0 + 0.3 * np.cos(TURN), np.sin(2.0 * TURN) + 0.5])
    found = lasting._common(PLACE, RISE, errors, RADIUS, on_surface)
    steps = np.array([-1.0, 0.0, 1.0]) / 3.0
    wanted = np.zeros((2, 2))
    for i in range(COUNT):
        for j in range(COUNT):
            shared = []
            for u in steps:
                for other in steps:
                    x, y = (PLACE[:, i] + u * RISE[:, i] - PLACE[:, j] - other * RISE[:, j]) / RADIUS
                    shared.append((1.0 - 2.0 * on_surface * x**2) * np.exp(-(x**2) - y**2))
            wanted += np.outer(errors[:, i], errors[:, j]) * np.mean(shared)
    # Beyond 2.5 radii two points are taken to share nothing: 2e-3.
    np.testing.assert_allclose(found, wanted, rtol=5e-3, atol=5e-3 * np.abs(wanted).max())


def test_a_dither_leaves_nothing_where_it_was() -> None:
    """Claim: at most nine tenths of any variance last: in every direction of (Θ, φ), and of the range."""
    whole = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 9.0]])
    small = 0.5 * whole
    np.testing.assert_allclose(lasting._limited(small, whole), small)
    # Angles and range are limited each by itself.
    part = np.diag([1.0, 1.0, 0.0]) @ (2.0 * whole) + np.diag([0.0, 0.0, 4.5])
    limited = lasting._limited(part, whole)
    np.testing.assert_allclose(limited[:2, :2], 0.9 * whole[:2, :2], rtol=1e-12)
    assert limited[2, 2] == pytest.approx(4.5)
    assert lasting._limited(np.diag([0.0, 0.0, 20.0]), whole)[2, 2] == pytest.approx(8.1)
