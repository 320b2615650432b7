"""The spot that a laser return must be: its width and strength wherever it lies on the line."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.line.exposure import electrons_per_watt
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.foundation.device_numbers import beside, over
from scanner_sim.foundation.device_types import FloatLike
from scanner_sim.optics.laser import Laser
from scanner_sim.optics.line_image import ArrayPlace, LineImage
from scanner_sim.optics.receiver import Receiver

_SETTLED = 4
"""Steps by which distortion is taken off a position: each leaves a tenth or less of the last."""
STEEP_SWEEP = math.radians(60.0)
"""Tilt of planes on which a beam that sweeps must still be known for the laser's."""


@dataclass(frozen=True)
class ExpectedSpot:
    """What is known of the laser's spot before it is seen, SI.

    The methods take numbers, NumPy or Dr.Jit arrays; no kernel knows the numbers of a spot.

    Attributes
    ----------
    image, baseline
        How the lens images the beam on the line, and d of eq 1.
    waist_radius, waist_distance, rayleigh_length
        The beam: 1/e² radius at the waist, distance of the waist, Rayleigh length [m].
    aberration, diffusion
        Standard deviations of the lens's rays, square to its axis, and of the sensor's blur [m].
    pitch, offset
        Pixel i of the line lies at p = offset + (i + 1/2) pitch.
    pixels
        Pixels of the line.
    white, white_by_pixel
        Charge of a white Lambertian surface that faces the scanner, times its range squared [electron m²]; and over
        (pixel + 1/2)², at Θ = 0 [electron]. Numbers, or arrays with one for each of m shots.
    sweep
        Angle Θ by which the beam moves while it is seen [rad], likewise.
    lens
        k₁, k₂ and p₂ of the lens's distortion; None for a lens without.
    """

    image: LineImage
    baseline: float
    waist_radius: float
    waist_distance: float
    rayleigh_length: float
    aberration: float
    diffusion: float
    pitch: float
    offset: float
    pixels: int
    white: FloatLike
    white_by_pixel: FloatLike = None
    sweep: FloatLike = 0.0
    lens: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        """Work out the one light of a white surface from the other where it is not given."""
        if self.white_by_pixel is None:
            slope = self.image.scale * self.baseline / self.pitch
            object.__setattr__(self, "white_by_pixel", self.white / slope**2)

    @classmethod
    def of(
        cls, laser: Laser, receiver: Receiver, transmission: float, sensor: PositionSensor, dwell: float
    ) -> ExpectedSpot:
        """Return the spot of an instrument whose filter passes a share of the laser's light.

        White surface: N R² = P T A / π · QE t λ/(h c), eq 19 of Blais, Beraldin, El-Hakim (2000).
        """
        watts = laser.power * receiver.transmission * transmission * receiver.aperture_area / math.pi
        return cls(
            image=receiver.line_image,
            baseline=receiver.baseline,
            waist_radius=laser.waist_radius,
            waist_distance=laser.waist_distance,
            rayleigh_length=laser.rayleigh_length,
            aberration=receiver.aberration,
            diffusion=sensor.diffusion,
            pitch=sensor.pitch,
            offset=sensor.offset,
            pixels=sensor.pixels,
            white=watts * electrons_per_watt(sensor, laser.wavelength, dwell),
        )

    def lit(self, white: FloatLike, white_by_pixel: FloatLike, sweep: FloatLike = 0.0) -> ExpectedSpot:
        """Return the same spot by other light, of a beam that moves."""
        return replace(self, white=white, white_by_pixel=white_by_pixel, sweep=sweep)

    @property
    def point_spread(self) -> float:
        """Standard deviation of the image of a point on an upright line in focus [m]."""
        return math.hypot(self.aberration, self.diffusion)

    def range(self, pixel: FloatLike, sine: FloatLike, cosine: FloatLike) -> FloatLike:
        """Return the range [m] of a fractional pixel at a deflection Θ given as sine and cosine (eq 1)."""
        product, baseline, slope = self._numbers(pixel)
        return product * cosine / self._position(pixel) + baseline * (sine + slope * cosine)

    def pixel(self, range_m: FloatLike, sine: FloatLike, cosine: FloatLike) -> FloatLike:
        """Return the fractional pixel of a range [m] at a deflection Θ: :meth:`range` solved for it."""
        product, baseline, slope = self._numbers(cosine)
        (offset,) = beside(cosine, self.offset)
        depth = range_m - baseline * (sine + slope * cosine)
        position = product * cosine / depth
        return over(position + self._bent(position) - offset, self.pitch) - 0.5

    def _numbers(self, array: FloatLike) -> tuple[FloatLike, FloatLike, FloatLike]:
        product, baseline, slope = beside(
            array, self.image.scale * self.baseline, self.baseline, self.image.slope
        )
        return product, baseline, slope

    def variances(self, pixel: FloatLike, sine: FloatLike, cosine: FloatLike) -> tuple[FloatLike, FloatLike]:
        """Return the two parts of the spot's variance [pixel²] on a surface that faces the scanner.

        The beam's image, (w(R)/2 · m)² with the magnification m = dp/dt/(R − d sinΘ) = p (v_a/v₀)/(d cosΘ) of
        :mod:`~scanner_sim.optics.line_image`, and the image of a point. The pixel's own width is not in them.
        """
        baseline, waist, distance = beside(pixel, self.baseline, 0.5 * self.waist_radius, self.waist_distance)
        seen = self.seen_at(pixel, cosine)
        (aberration,) = beside(pixel, (self.aberration / self.pitch) ** 2)
        (spread,) = beside(pixel, (self.point_spread / self.pitch) ** 2)
        magnification = self._position(pixel) * seen.stretch / (baseline * cosine)
        away = over(self.range(pixel, sine, cosine) - distance, self.rayleigh_length)
        half = over(waist * magnification, self.pitch)
        return half * half * (1.0 + away * away), seen.spread(spread, aberration)

    def swept_variance(self, pixel: FloatLike, sine: FloatLike, cosine: FloatLike) -> FloatLike:
        """Return what the sweep adds to the spot's variance [pixel²] on a plane tilted by :data:`STEEP_SWEEP`.

        On a plane inclined by α in the plane of triangulation the range changes by R δΘ tanα during the dwell, and the
        image by dp/dR = p (v_a/v₀)/(R − d sinΘ) of that: an even line, whose variance is the square of its length/12.
        """
        baseline, steep = beside(pixel, self.baseline, math.tan(STEEP_SWEEP))
        distance = self.range(pixel, sine, cosine)
        magnification = (
            self._position(pixel) * self.seen_at(pixel, cosine).stretch / (distance - baseline * sine)
        )
        length = over(steep * magnification * distance, self.pitch) * self.sweep
        return length * length * (1.0 / 12.0)

    def seen_at(self, pixel: FloatLike, cosine: FloatLike) -> ArrayPlace:
        """Return how the lens images the beam on pixels at deflections Θ given as cosine; lengths in pixels."""
        (baseline,) = beside(pixel, self.baseline)
        return self.image.at(self._position(pixel), baseline * cosine, self.pitch)

    def _position(self, pixel: FloatLike) -> FloatLike:
        """Return where on the line [m] a lens without distortion would bring what lies on a fractional pixel."""
        offset, pitch = beside(pixel, self.offset, self.pitch)
        seen = position = offset + (pixel + 0.5) * pitch
        for _ in range(0 if self.lens is None else _SETTLED):
            position = seen - self._bent(position)
        return position

    def _bent(self, position: FloatLike) -> FloatLike:
        """Return by how much the lens's distortion moves images along the line [m], from where it would be without.

        x' = x (1 + k₁ x² + k₂ x⁴) + 3 p₂ x² of the tangents x on the line (Brown, *Photogramm. Eng.* 37, 1971,
        855-866).
        """
        if self.lens is None:
            return 0.0
        k1, k2, p2, scale, slope = beside(position, *self.lens, self.image.scale, self.image.slope)
        tangent = self.image.tangent(position)
        squared = tangent * tangent
        moved = squared * (tangent * (k1 + k2 * squared) + 3.0 * p2)
        return scale * moved / ((1.0 - slope * tangent) * (1.0 - slope * (tangent + moved)))

    @property
    def largest_sigma(self) -> float:
        """Largest standard deviation that a facing surface gives anywhere on the line, at Θ = 0 [pixel]."""
        beam, spread = self.variances(np.arange(self.pixels), 0.0, 1.0)
        return float(np.sqrt(np.max(beam + spread)))

    def widest(self, factor: float) -> NDArray[np.float64]:
        """Return the variance of a spot [pixel²] whose beam is wider by a factor, for every pixel, at Θ = 0."""
        beam, spread = self.variances(np.arange(self.pixels), 0.0, 1.0)
        return np.asarray(factor**2 * beam + spread)

    @property
    def largest_share(self) -> float:
        """Largest share of the charge that one pixel can hold: that of a point, centred on it."""
        return math.erf(0.5 * self.pitch / (math.sqrt(2.0) * self.point_spread))
