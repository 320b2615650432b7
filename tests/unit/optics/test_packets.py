"""Packets of a spot's light: how the variances of their places and of their own widths add up."""

from __future__ import annotations

import math

import numpy as np
import pytest
from prototype import SHARP

from scanner_sim.optics.line_image import ArrayPlace
from scanner_sim.optics.speckle import Optics, Packets, packets, packets_of, slope_packets

ALONG, ACROSS = 9.0, 4.0
"""Variances of a spot's geometric image [pixel²]: 3 pixels by 2."""


def test_without_aberration_and_diffusion_half_the_image_is_the_packets_places() -> None:
    """Claim: speckles of a Gaussian scatter by σ_x²/2 about it, and each is (λN/π)² wide."""
    found = packets_of(Optics(1.2, 0.0, 0.0, 8), ALONG, ACROSS, SHARP)
    own = (1.2 / math.pi) ** 2
    assert found.sigma**2 == pytest.approx(0.5 * ALONG + own)
    assert found.ratio**2 == pytest.approx(0.5 * ALONG / (0.5 * ALONG + own))
    assert found.on_surface == pytest.approx(1.0)
    # x is the geometric mean of both widths over λN.
    x = math.sqrt(6.0) / 1.2
    assert found.energy == pytest.approx(1.0 / (1.0 + math.sqrt(math.pi) * x + (math.pi * x) ** 2))


def test_diffusion_widens_packets_and_does_not_move_them() -> None:
    without, with_it = (packets_of(Optics(1.2, 0.7, d, 8), ALONG, ACROSS, SHARP) for d in (0.0, 1.5))
    assert with_it.sigma**2 - without.sigma**2 == pytest.approx(1.5**2)
    places = [(p.sigma * p.ratio) ** 2 for p in (without, with_it)]
    assert places[0] == pytest.approx(places[1])
    assert with_it.on_surface == pytest.approx(without.on_surface)


def test_aberration_scatters_the_packets_by_the_slope_over_each() -> None:
    """Claim: each packet's place errs by σ_a² M/M_s, and its own width grows as that of the pupil's image."""
    found = packets_of(Optics(1.2, 0.7, 0.0, 8), ALONG, ACROSS, SHARP)
    x = math.sqrt(6.0) / 1.2
    aberrant = 0.49 * packets(x) / slope_packets(x)
    places = 0.5 * ALONG + aberrant
    assert (found.sigma * found.ratio) ** 2 == pytest.approx(places)
    assert found.on_surface == pytest.approx(0.5 * ALONG / places)
    own = (1.2 / math.pi) ** 2 * (1.0 + 0.49 / (ALONG + 1.44))
    assert found.sigma**2 == pytest.approx(places + own)


@pytest.mark.parametrize(("x", "tolerance"), [(1.0, 0.06), (2.0, 0.03), (4.0, 0.02)])
def test_packets_are_the_double_integral_over_the_pupil(x: float, tolerance: float) -> None:
    """Claim: 1/M = ∬|γ|² over two points of the unit disc over its area squared, |γ|² = exp(−(2π σ_b Δξ/λf)²).

    With the pupil's diameter 1 the exponent is (2π x Δ)²; the overlap of two discs tells how many pairs are Δ apart.
    """
    apart = (np.arange(200000) + 0.5) / 200000
    overlap = (2.0 / math.pi) * (np.arccos(apart) - apart * np.sqrt(1.0 - apart**2))
    density = 8.0 * apart * overlap
    assert density.mean() == pytest.approx(1.0, rel=1e-4)
    found = (density * np.exp(-((2.0 * math.pi * x * apart) ** 2))).mean()
    assert 1.0 / packets(x) == pytest.approx(found, rel=tolerance)


def test_a_dwell_averages_places_on_the_surface_apart_from_the_light() -> None:
    assert Packets(0.1, 2.0, 0.8, 0.75).moving(0.4, 0.2) == pytest.approx((0.4, 0.75 * 0.2 + 0.25 * 0.4))


def test_slopes_count_the_edge_twice() -> None:
    assert slope_packets(2.0) == pytest.approx(2.0 + 4.0 * math.sqrt(math.pi) + 4.0 * math.pi**2)


def place(across: float, skewed: float, defocus: float) -> ArrayPlace:
    """Return an array on which images are larger, more so along the line, and out of focus."""
    return ArrayPlace(1.0, across, skewed, defocus, 0.0)


def test_an_array_stretches_packets_and_no_diffusion() -> None:
    """Claim: in focus the line sees all of a sharp array's packets larger by its scale along the line; charge that
    spreads within the sensor does not know of it, and aberration as large as the image is stretched as the image is."""
    sharp = packets_of(Optics(1.2, 0.7, 0.0, 8), ALONG, ACROSS, SHARP)
    for diffusion in (0.0, 1.5):
        seen = packets_of(Optics(1.2, 1.3 * 0.7, diffusion, 8), ALONG, ACROSS, place(1.3, 1.25, 0.0))
        assert seen.sigma**2 == pytest.approx((1.3 * 1.25 * sharp.sigma) ** 2 + diffusion**2)
        assert seen.ratio * seen.sigma == pytest.approx(1.3 * 1.25 * sharp.ratio * sharp.sigma)
        assert seen.energy == pytest.approx(sharp.energy)
        assert seen.on_surface == pytest.approx(sharp.on_surface)


def test_defocus_is_an_aberration() -> None:
    """Claim: rays that miss by 0.3 for want of focus and by 0.4 for the lens's errors miss by 0.5 in all."""
    out_of_focus = packets_of(Optics(1.2, 0.4, 0.6, 8), ALONG, ACROSS, place(1.3, 1.25, -0.3))
    wrong = packets_of(Optics(1.2, 0.5, 0.6, 8), ALONG, ACROSS, place(1.3, 1.25, 0.0))
    assert out_of_focus == wrong


@pytest.mark.parametrize(("image", "count"), [(1e-6, 4), (10e-6, 0), (400e-6, 16)])
def test_as_many_modes_fluctuate_as_leave_out_a_hundredth(image: float, count: int) -> None:
    """Claim: behind N modes r^2N and less is left of a point's variance; one less than N − 1 would leave more than 1 %.

    Never fewer than 4 nor more than 16; images in micrometres and pixels of 50 µm.
    """
    given = 6e-6, 3e-6, 8e-6, 50e-6
    found = Optics.of(*given, [(image, SHARP), (0.5 * image, SHARP)])
    assert (found.cell, found.aberration, found.diffusion) == pytest.approx((0.12, 0.06, 0.16))
    variance = (image / 50e-6) ** 2
    ratio = float(packets_of(found, variance, variance, SHARP).ratio)
    if count:
        assert found.modes == count
    else:
        assert 4 < found.modes < 16
        assert ratio ** (2 * (found.modes - 1)) <= 0.01 < ratio ** (2 * (found.modes - 2))
