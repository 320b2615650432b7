"""The judge's pinhole and its speckled pixels by hand."""

from __future__ import annotations

import numpy as np
import pytest

from scanner_sim.analytic import geometry, speckle


def test_a_point_images_where_the_pinhole_says() -> None:
    """Claim: of a lens of 0.1 m at x = 0.2 m that looks along z, what lies 4 m ahead, 0.2 m left of it and 0.4 m down
    images 5 mm to the right of its axis, on the line of eq 1, and 10 mm down the sensor."""
    p, q = geometry.image_of_point([0.0, 0.4, 4.0], 0.0, 0.0, 0.1, 0.2, 0.05)
    assert (float(p), float(q)) == pytest.approx((5e-3, 10e-3), rel=1e-12)
    aim = (0.3, -0.2)
    hit = geometry.point_from_shot(4.0, *aim, 0.05)
    p, q = geometry.image_of_point(hit, *aim, 0.1, 0.2, 0.05)
    assert float(p) == pytest.approx(float(geometry.image_position(4.0, aim[0], 0.1, 0.2)), rel=1e-12)
    assert float(q) == pytest.approx(0.0, abs=1e-15)


def test_speckle_of_all_pixels_is_that_of_the_energy_and_their_places_average_apart() -> None:
    """Claim: over a line that holds the whole spot the pixels' shares vary in sum as the energy does, Σ C = left₀ v;
    the centroid, Σ x x' C, as packets of the variance σ²/2 and σ_a² that count left₁ and left₀ times."""
    spot = speckle.SpeckledSpot(image=30e-6, cell=6e-6, aberration=20e-6, diffusion=15e-6, pitch=10e-6)
    found = speckle.pixel_covariance(spot, 40.0, 81, (0.6, 0.2))
    energy, slope = speckle.pupil_averages(5.0)
    assert found.sum() == pytest.approx(0.6 * energy, rel=1e-6)
    x = 10e-6 * (np.arange(81) - 40.0)
    wanted = 0.2 * 0.5 * 30e-6**2 * energy + 0.6 * 20e-6**2 * slope
    assert x @ found @ x == pytest.approx(
        wanted, rel=2e-3
    )  # the grid of packets ends at four of their deviations


def test_packets_are_blurred_by_the_square_of_the_aberration() -> None:
    """Claim: a lens without aberration blurs a packet by λN/π, one whose aberration is as wide as the image by twice
    its square, and three times as wide by ten times; the sensor's diffusion adds its own square."""
    cell, image, diffusion = 6e-6, 30e-6, 15e-6
    for wide, factor in ((0.0, 1.0), (1.0, 2.0), (3.0, 10.0)):
        spot = speckle.SpeckledSpot(image, cell, wide * image, diffusion, 10e-6)
        assert spot.packets[2] == pytest.approx(diffusion**2 + factor * (cell / np.pi) ** 2)
        assert spot.packets[0] == pytest.approx(0.5 * image**2)


@pytest.mark.parametrize("place", [19.7, 20.0, 20.4])
def test_a_fitted_place_is_the_spots_also_where_its_flanks_are_cut(place: float) -> None:
    """Claim: a line without noise is found where it is, whether five pixels count of a spot of σ = 1.3 or fifteen."""
    line = 5e4 * speckle.pixel_shares(1.0, place, 1.3, 41)
    for guard in (2, 7):
        found = speckle.fitted_place(line[None], 20.1, 1.3, guard)
        assert float(found[0]) == pytest.approx(place, abs=1e-4)
