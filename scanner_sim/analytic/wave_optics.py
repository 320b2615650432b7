"""Speckle from first principles: random phases on a surface, through a lens with any wavefront, onto pixels.

A rough surface under a Gaussian beam sends circular complex normal amplitudes, uncorrelated from point to point, whose
mean square is the beam's irradiance. The lens passes the spatial frequencies up to 1/(2 λN) and multiplies them with
its own phase; the image is the square of what arrives (Goodman, *Introduction to Fourier optics*, 2005, secs 5.3 and
6.4; *Speckle phenomena in optics*, 2007, ch. 4). Nothing else is assumed: no size of a grain, no statistics of the
image. All lengths are those on the sensor: the surface is mapped through the lens by its magnification, so that the
beam's 1/e² radius w has the standard deviation σ_b = (w/2) f/R there.

Two polarisations have independent patterns; light that lost its polarisation is half of each (contrast 1/√2).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import gaussian_filter1d

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
Wavefront = Callable[[Floats, Floats], Floats]
"""Phase [rad] over the pupil, of its two coordinates in units of its radius, along the line first."""

_FINE = 2.5
"""Samples of the surface to a λN: the image, whose frequencies end at 1/λN, needs two."""


@dataclass(frozen=True)
class Lens:
    """Light and lens: wavelength λ and f-number N; the wavefront's phase over the pupil."""

    wavelength: float
    f_number: float
    wavefront: Wavefront | None = None

    @property
    def cell(self) -> float:
        """λN [m]."""
        return self.wavelength * self.f_number


def defocus(lens: Lens, sigma: float) -> Wavefront:
    """Return the wavefront of a lens out of focus whose point image has a standard deviation [m] per axis.

    A phase ψ shifts the light of a point of the pupil by λN/π ∂ψ/∂u, u in radii of the pupil: a disc of the radius 2σ
    for ψ = πσ u²/(λN).
    """
    strength = math.pi * sigma / lens.cell
    return lambda u, v: strength * (u * u + v * v)


def random_wavefront(lens: Lens, sigma: float, seed: int, waves: int = 24, finest: float = 0.7) -> Wavefront:
    """Return a smooth random wavefront whose rays scatter with a standard deviation [m] along the line.

    Sum of plane waves of random directions and phases, whose periods are ``finest`` diameters of the pupil and more;
    scaled over the pupil, the wavefront's tilts taken off.
    """
    random = np.random.default_rng(seed)
    turn, phase = random.uniform(0.0, 2.0 * math.pi, (2, waves))
    number = math.pi / finest * np.sqrt(random.uniform(0.05, 1.0, waves))
    ku, kv = number * np.cos(turn), number * np.sin(turn)
    grid = np.linspace(-1.0, 1.0, 129)
    u, v = (
        axis[grid[:, None] ** 2 + grid[None, :] ** 2 <= 1.0]
        for axis in np.meshgrid(grid, grid, indexing="ij")
    )
    angle = ku * u[:, None] + kv * v[:, None] + phase
    slopes = [-(np.sin(angle) * k).sum(axis=1) for k in (ku, kv)]
    means = [float(slope.mean()) for slope in slopes]
    scale = math.pi * sigma / (lens.cell * float(slopes[0].std()))

    def wavefront(u: Floats, v: Floats) -> Floats:
        total = sum(np.cos(ku[n] * u + kv[n] * v + phase[n]) for n in range(waves))
        return np.asarray(scale * (total - means[0] * u - means[1] * v))

    return wavefront


@dataclass(frozen=True)
class Image:
    """Intensity on the sensor, integrated across the line, for a beam that stands at some places.

    ``profile`` power per sample, shape (places, samples), of mean total 1; sample k lies at ``position``[k] [m] from
    the beam's middle.
    """

    position: Floats
    profile: Floats


def images(
    lens: Lens,
    beam: tuple[float, float],
    count: int,
    seed: int,
    *,
    polarisations: int = 1,
    places: Floats | None = None,
    reach: float = 4.5,
    blur: float = 0.0,
) -> Iterator[Image]:
    """Yield images of independent surfaces.

    Parameters
    ----------
    lens
        Light and lens.
    beam
        Standard deviations of the beam's geometric image along and across the line [m].
    count, seed
        Number of surfaces, and seed.
    polarisations
        1 for light that keeps its polarisation, 2 for light that lost it.
    places
        Places of the beam on the surface [m], as they are on the sensor, shape (places, 2), along the line first; the
        image is that about the beam's middle. None stands for one place.
    reach
        Half the side of what is computed, in standard deviations of the beam, blur included.
    blur
        Standard deviation of the lens's point image [m], for the size of what is computed.
    """
    where = np.zeros((1, 2)) if places is None else places
    step = lens.cell / _FINE
    sides = [
        2
        * fft.next_fast_len(
            math.ceil(
                (reach * math.hypot(sigma, blur) + 6.0 * lens.cell + np.abs(where[:, axis]).max()) / step
            )
        )
        for axis, sigma in enumerate(beam)
    ]
    x, y = ((np.arange(side) - side // 2) * step for side in sides)
    pupil = _pupil(lens, sides, step)
    # A white surface's light through the pupil, which fills a share of all frequencies.
    middle = np.exp(-((x[:, None] / beam[0]) ** 2 + (y[None, :] / beam[1]) ** 2) / 2.0)
    mean = float(middle.sum() * (np.abs(pupil) ** 2).mean())
    passed = np.flatnonzero(np.abs(np.fft.fftfreq(sides[1], step)) * 2.0 * lens.cell <= 1.0)
    pupil = pupil[:, passed]
    along = [np.exp(-(((x - p) / (2.0 * beam[0])) ** 2)) for p in where[:, 0]]
    across = {q: np.exp(-(((y - q) / (2.0 * beam[1])) ** 2)) for q in where[:, 1]}
    random = np.random.default_rng(seed)
    for _ in range(count):
        profile = np.zeros((len(where), sides[0]))
        for _ in range(polarisations):
            surface = (random.normal(size=sides) + 1j * random.normal(size=sides)) / math.sqrt(2.0)
            lit = {q: fft.fft(surface * amplitude, axis=1)[:, passed] for q, amplitude in across.items()}
            for place, (p, q) in enumerate(where):
                field = fft.ifft(fft.fft(lit[q] * along[place][:, None], axis=0) * pupil, axis=0)
                # The sum across the line is that over its frequencies (Parseval).
                lines = (field.real**2 + field.imag**2).sum(axis=1) / sides[1]
                # The receiver follows the beam.
                profile[place] += np.roll(lines, -round(p / step))
        yield Image(x, profile / (polarisations * mean))


def _pupil(lens: Lens, sides: list[int], step: float) -> Complex:
    """Return what the lens passes of each spatial frequency, shape ``sides``."""
    u, v = (2.0 * lens.cell * np.fft.fftfreq(side, step) for side in sides)
    inside = u[:, None] ** 2 + v[None, :] ** 2 <= 1.0
    if lens.wavefront is None:
        return np.asarray(inside, dtype=np.complex128)
    grid = np.meshgrid(u, v, indexing="ij")
    return np.asarray(np.where(inside, np.exp(1j * lens.wavefront(grid[0], grid[1])), 0.0))


def on_pixels(image: Image, pitch: float, pixels: int, centre: float, diffusion: float = 0.0) -> Floats:
    """Return what each pixel of a line collects, shape (places, pixels).

    Parameters
    ----------
    image
        The image.
    pitch, pixels
        Of the line; pixel i covers (i − 1/2, i + 1/2) pitch.
    centre
        Place of the beam's middle [pixel].
    diffusion
        Standard deviation [m] by which charge diffuses before it is collected.
    """
    step = float(image.position[1] - image.position[0])
    edges = (np.arange(pixels + 1) - 0.5 - centre) * pitch
    reach = math.ceil(5.0 * diffusion / step)
    padded = np.pad(image.profile, ((0, 0), (reach, reach)))
    if diffusion > 0.0:
        padded = gaussian_filter1d(padded, diffusion / step, axis=1, mode="constant", truncate=5.0)
    ends = image.position[0] + (np.arange(padded.shape[1] + 1) - reach - 0.5) * step
    total = np.concatenate([np.zeros((len(padded), 1)), np.cumsum(padded, axis=1)], axis=1)
    return np.stack([np.diff(np.interp(edges, ends, row)) for row in total])


def centroid(image: Image) -> Floats:
    """Return the centroid of an image along the line [m], shape (places,)."""
    return np.asarray(image.profile @ image.position / image.profile.sum(axis=1))
