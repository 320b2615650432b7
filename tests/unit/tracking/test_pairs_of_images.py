"""What images of a pattern share of the errors of unlike pixels: all pairs one by one."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad

from scanner_sim.tracking.errors import mean_pixel_correlation, pixel_correlation


def test_the_mean_over_all_pairs_is_that_of_a_double_sum() -> None:
    """Claim: Σ w_i w_j ρ(x_i − x_j)/(Σ w)² of three patterns far from one another, one of them a single place."""
    rng = np.random.default_rng(3)
    position = np.stack([rng.uniform(0.0, 6.0, 20), rng.uniform(-40.0, -39.0, 20), np.full(20, 17.3)])
    weight = rng.uniform(0.2, 1.0, (3, 20))
    apart = position[:, :, None] - position[:, None, :]
    rho = (1.0 - 0.5 * apart**2) * np.exp(-0.25 * apart**2)
    wanted = np.einsum("pi,pij,pj->p", weight, rho, weight) / weight.sum(axis=1) ** 2
    np.testing.assert_allclose(mean_pixel_correlation(position, weight), wanted, atol=1e-8)


def test_two_images_share_the_overlap_of_their_slopes() -> None:
    """Claim: an error of pixels moves an image by the light's slope x e^(−x²/2): what two share is the overlap of two
    slopes over that of one."""
    for apart in (0.0, 0.7, 1.5, 3.0):

        def both(x: float, apart: float = apart) -> float:
            other = x - apart
            return float(x * np.exp(-0.5 * x**2) * other * np.exp(-0.5 * other**2))

        wanted = quad(both, -12.0, 15.0)[0] / (0.5 * np.sqrt(np.pi))
        np.testing.assert_allclose(pixel_correlation(apart), wanted, atol=1e-9)
