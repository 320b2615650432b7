"""The judge's wave optics: a small case by plain Fourier sums, wavefronts by their rays, pixels by integrals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from scanner_sim.analytic.wave_optics import (
    Image,
    Lens,
    centroid,
    defocus,
    images,
    on_pixels,
    random_wavefront,
)

Array = NDArray[np.float64]

CELL = 6e-6


@pytest.mark.parametrize("polarisations", [1, 2])
def test_an_image_is_the_fourier_sum_of_its_surface(polarisations: int) -> None:
    """Claim: field = Σ_f P(2λN f) e^(2πi f x) Σ_x' a(x') e^(−2πi f x'), with |a|² the beam; intensity is summed across
    the line and over the field's quadratures, and is 1 over all on the average of surfaces.

    Set-up: a defocused lens, a beam of 1.2 λN by 0.8 λN at two places, of which the image follows the beam; the same
    draws. The mean is Parseval's: the beam's energy times the share of frequencies that pass.
    """
    bare = Lens(1.5e-6, 4.0)
    lens = Lens(1.5e-6, 4.0, defocus(bare, 0.8 * CELL))
    beam, places = (1.2 * CELL, 0.8 * CELL), np.array([[0.0, 0.0], [1.2 * CELL, 0.4 * CELL]])
    found = next(
        images(lens, beam, 1, 5, polarisations=polarisations, places=places, reach=1.0, blur=0.9 * CELL)
    )
    step = CELL / 2.5
    assert bare.cell == pytest.approx(CELL)
    np.testing.assert_allclose(np.diff(found.position), step)
    half = len(found.position) // 2
    assert found.position[half] == 0.0
    # reach · (beam, blur) + 6 λN, and as far as the beam is moved.
    least = math.hypot(1.2, 0.9) + 6.0 + 1.2
    assert least * 2.5 <= half < 1.2 * least * 2.5
    random = np.random.default_rng(5)
    # The sides along and across the line are drawn by the same rule.
    least_across = math.hypot(0.8, 0.9) + 6.0 + 0.4
    across = next(n for n in range(math.ceil(least_across * 2.5), 100) if max(_primes(n)) <= 11)
    x, y = ((np.arange(2 * n) - n) * step for n in (half, across))
    u, v = (2.0 * CELL * np.fft.fftfreq(len(axis), step) for axis in (x, y))
    phase = math.pi * 0.8 * (u[:, None] ** 2 + v[None, :] ** 2)
    pupil = np.where(u[:, None] ** 2 + v[None, :] ** 2 <= 1.0, np.exp(1j * phase), 0.0)
    wanted = np.zeros((2, len(x)))
    energy = np.exp(-0.5 * ((x[:, None] / beam[0]) ** 2 + (y / beam[1]) ** 2)).sum() * np.mean(
        np.abs(pupil) ** 2
    )
    for _ in range(polarisations):
        surface = (random.normal(size=pupil.shape) + 1j * random.normal(size=pupil.shape)) / math.sqrt(2.0)
        for place, (p, q) in enumerate(places):
            lit = np.exp(-0.25 * (((x[:, None] - p) / beam[0]) ** 2 + ((y - q) / beam[1]) ** 2))
            field = np.fft.ifft2(np.fft.fft2(surface * lit) * pupil)
            wanted[place] += np.roll((np.abs(field) ** 2).sum(axis=1), -round(p / step))
    np.testing.assert_allclose(found.profile, wanted / (polarisations * energy), rtol=1e-9)


def _primes(number: int) -> list[int]:
    found, by = [1], 2
    while number > 1:
        while number % by == 0:
            found.append(by)
            number //= by
        by += 1
    return found


@pytest.mark.parametrize("kind", ["defocus", "random"])
def test_rays_of_a_wavefront_scatter_as_stated(kind: str) -> None:
    """Claim: λN/π ∂ψ/∂u over the pupil has the stated standard deviation along the line, and no mean along either axis;
    a defocus the same across, the pupil's own 1/2 per axis. Tolerance: of the sum over the rim."""
    lens, sigma = Lens(1.5e-6, 4.0), 3e-6
    wave = defocus(lens, sigma) if kind == "defocus" else random_wavefront(lens, sigma, 7)
    grid = (np.arange(400) + 0.5) / 200.0 - 1.0
    u, v = (
        axis[np.hypot(*np.meshgrid(grid, grid)) <= 1.0] for axis in np.meshgrid(grid, grid, indexing="ij")
    )
    step = 1e-5
    slopes = [
        CELL / math.pi * (wave(u + step * a, v + step * b) - wave(u - step * a, v - step * b)) / (2.0 * step)
        for a, b in ((1.0, 0.0), (0.0, 1.0))
    ]
    assert slopes[0].std() == pytest.approx(sigma, rel=2e-3)
    assert max(abs(slope.mean()) for slope in slopes) < 2e-3 * sigma
    if kind == "defocus":
        assert slopes[1].std() == pytest.approx(sigma, rel=2e-3)


@pytest.mark.parametrize("diffusion", [0.0, 4e-6])
def test_pixels_collect_what_falls_on_them(diffusion: float) -> None:
    """Claim: a Gaussian of 9 µm, 3 µm off the beam's middle, between the edges of pixels: the normal distribution, with
    the variance of diffusion; and its centroid."""
    position = (np.arange(400) - 200) * 0.5e-6
    profile = np.stack(
        [0.5e-6 * norm.pdf(position, 3e-6, 9e-6), 2.0 * 0.5e-6 * norm.pdf(position, -6e-6, 9e-6)]
    )
    image = Image(position, profile)
    np.testing.assert_allclose(centroid(image), [3e-6, -6e-6], rtol=1e-6)
    pitch, centre = 7e-6, 9.3
    found = on_pixels(image, pitch, 21, centre, diffusion)
    edges = (np.arange(22) - 0.5 - centre) * pitch
    width = math.hypot(9e-6, diffusion)
    np.testing.assert_allclose(found[0], np.diff(norm.cdf(edges, 3e-6, width)), atol=2e-4)
    np.testing.assert_allclose(found[1], 2.0 * np.diff(norm.cdf(edges, -6e-6, width)), atol=4e-4)
