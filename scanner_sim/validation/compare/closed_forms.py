"""The judge's view of an instrument: closed forms of ``analytic/`` with the numbers of a scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import geometry, spot
from scanner_sim.analytic.array import SensorArray
from scanner_sim.analytic.beam import beam_radius, spread_rate
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.filter import PassBand
from scanner_sim.analytic.noise import first_order, fit_gradient, width_spread
from scanner_sim.analytic.spot import SpotImage
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError

Array = NDArray[np.float64]
FormName: TypeAlias = Literal["position", "sigma"]

LINE = 49
"""Pixels of the judge's line: the 24 to each side that the program's fit reads at most, the core of a wider spot."""
FIT = "maximum_likelihood"


@dataclass(frozen=True)
class ClosedSpot:
    """A spot on the line: its position, width and the position of its chief ray [pixel]; its charge [electron].

    ``beam`` is the share of the width's square that the image of the beam has.
    """

    centre: float
    chief: float
    sigma: float
    charge: float
    beam: float

    @property
    def phase(self) -> float:
        """Where the spot lies in its pixel, −1/2 to 1/2."""
        return self.centre - round(self.centre)

    @property
    def line(self) -> Array:
        """The noise-free charges of a line of 49 pixels, the spot at ``phase`` from its middle."""
        return self.charge * spot.pixel_shares(LINE // 2 + self.phase, self.sigma, LINE)


@dataclass(frozen=True)
class EstimatorForms:
    """Closed forms of an estimator of the peak that is the user's own; None where he gives none.

    They are asked about spots without noise or background, of which the line has 49 pixels.

    Attributes
    ----------
    position
        Of the charges of a line [electron], shape (49,), the position [pixel] that the estimator tells, 0 in the middle
        of the first one.
    sigma
        Of such charges and of the variance of each [electron²], both of shape (49,), the estimator's σ [pixel]. By
        default that of the first order, by differences of ``position``.
    """

    position: Callable[[Array], float] | None = None
    sigma: Callable[[Array, Array], float] | None = None

    @classmethod
    def of(cls, given: Mapping[str, Callable[..., float]]) -> EstimatorForms:
        """Return those of a mapping.

        Raises
        ------
        InputError
            If it names anything else, or what is no function.
        """
        known = [field.name for field in fields(cls)]
        for name, form in given.items():
            if name not in known or not callable(form):
                raise InputError(
                    f"closed_forms: '{name}' is no closed form of an estimator, or no function.",
                    remedy=f"Possible: {', '.join(known)}.",
                )
        return cls(**given)

    def has(self, name: FormName) -> bool:
        """Return whether a form is given, or follows from one that is."""
        return self.position is not None or (name == "sigma" and self.sigma is not None)


NO_FORMS = EstimatorForms()


@dataclass(frozen=True)
class ClosedForms:
    """Closed forms with the numbers of a scenario's instrument, and those of an estimator that is the user's own."""

    scenario: Scenario
    own: EstimatorForms = NO_FORMS

    @cached_property
    def f(self) -> float:
        """Focal length [m]."""
        return self.scenario.scanner.receiver.focal_length

    @cached_property
    def d(self) -> float:
        """Base [m]."""
        return self.scenario.scanner.receiver.baseline

    @cached_property
    def array(self) -> SensorArray:
        """The array behind the lens."""
        receiver = self.scenario.scanner.receiver
        focus = math.inf if receiver.focus_distance == "infinity" else receiver.focus_distance
        return SensorArray(self.f, self.d, receiver.aperture, receiver.array_tilt, focus)

    @cached_property
    def D(self) -> float:
        """Separation of the axes [m]."""
        return self.scenario.scanner.mirrors.axis_separation

    @cached_property
    def pitch(self) -> float:
        """Distance of the pixels [m]."""
        return self.scenario.scanner.position_sensor.pitch

    @cached_property
    def band(self) -> PassBand | None:
        """The filter; None where there is none."""
        chosen = self.scenario.scanner.filter
        if chosen == "none":
            return None
        centre = self.scenario.scanner.laser.wavelength if chosen.centre is None else chosen.centre
        cavities = chosen.cavities if chosen.shape == "cavities" else 0
        return PassBand(centre, chosen.bandwidth, chosen.effective_index, chosen.blocking, cavities)

    @property
    def peak_transmission(self) -> float:
        """Transmission of lens and filter at the filter's peak."""
        chosen = self.scenario.scanner.filter
        lens = self.scenario.scanner.receiver.transmission
        return lens if chosen == "none" else lens * chosen.transmission

    def passed(self, incidence: float, response: tuple[float, float] | None = None) -> float:
        """Return the filter's transmission of the laser's line over its peak, at an incidence [rad].

        ``response`` are the wavelengths [m] to which a detector responds other than the line sensor.
        """
        laser = self.scenario.scanner.laser
        low, high = self.scenario.scanner.position_sensor.response if response is None else response
        line = laser.wavelength + laser.drift
        if not low <= line <= high:
            return 0.0
        return 1.0 if self.band is None else self.band.passed(line, incidence)

    def pixel(self, position: float) -> float:
        """Return the pixel of a position p [m] on the sensor."""
        return (position - self.scenario.scanner.position_sensor.offset) / self.pitch - 0.5

    def spot(self, theta: float, phi: float, point: Array, normal: Array, reflectance: float) -> ClosedSpot:
        """Return the spot on a plane through a point with a normal, shapes (3,), at deflections [rad]."""
        scanner = self.scenario.scanner
        laser, receiver, sensor = scanner.laser, scanner.receiver, scanner.position_sensor
        R = float(geometry.range_to_plane(theta, phi, self.D, point, normal))
        beam = laser.waist_radius, laser.waist_distance, laser.wavelength, laser.m_squared
        sharp = spot.spot_image(
            theta, phi, self.f, self.d, self.D, point, normal,
            0.5 * float(beam_radius(R, *beam)), float(spread_rate(R, *beam)), 0.0,
        )  # fmt: skip
        image = self.array_image(sharp, R, theta)
        of_beam = float(self.array.scale(R, theta)[0]) / self.f * sharp.sigma
        u = geometry.scanner_axes(theta, phi)[0]
        seen = geometry.laser_origin(phi, self.D) + R * u - geometry.lens_node(phi, self.D, self.d)
        unit = normal / np.linalg.norm(normal)
        transmission = self.peak_transmission * self.passed(math.atan(float(self.array.tangent(image.chief))))
        watts = spot.collected_power(
            laser.power, reflectance, receiver.aperture, transmission, seen, u, unit
        ) * spot.share_within_height(image.sigma_height, sensor.height)
        charge = spot.electrons(watts, 1.0 / scanner.rate, laser.wavelength, sensor.quantum_efficiency)
        return ClosedSpot(
            self.pixel(image.centroid),
            self.pixel(image.chief),
            image.sigma / self.pitch,
            float(charge),
            (of_beam / image.sigma) ** 2,
        )

    def array_image(self, image: SpotImage, R: float, theta: float) -> SpotImage:
        """Return the image of a spot on the array, blurred, from the one in the focal plane without.

        To second order: a tilted array stretches the spot unevenly, which moves its centroid by ½ d²s/dp² σ². What
        defocus moves it by belongs to the place of the chief ray: a calibration knows it.
        """
        receiver, diffusion = self.scenario.scanner.receiver, self.scenario.scanner.position_sensor.diffusion
        step = 1e-4 * self.f
        places = self.array.position_at((image.chief + step * np.array([-1.0, 0.0, 1.0])) / self.f)
        along, bend = (places[2] - places[0]) / (2.0 * step), np.diff(places, 2)[0] / step**2
        across = float(self.array.scale(R, theta)[1]) / self.f
        blur = self.array.blur(R, theta)
        lens = math.hypot(receiver.aberration * along / across, blur.along)
        chief = float(places[1]) + blur.shift
        return SpotImage(
            chief,
            float(chief + along * (image.centroid - image.chief) + 0.5 * bend * image.sigma**2),
            math.sqrt((along * image.sigma) ** 2 + lens**2 + diffusion**2),
            math.hypot(across * image.sigma_height, receiver.aberration, blur.across, diffusion),
        )

    def facing(self, R: float, reflectance: float, theta: float = 0.0, phi: float = 0.0) -> ClosedSpot:
        """Return the spot on a plate that faces the beam at the range R [m]."""
        u = geometry.scanner_axes(theta, phi)[0]
        return self.spot(theta, phi, geometry.point_from_shot(R, theta, phi, self.D), u, reflectance)

    def on_array(self, seen: ClosedSpot) -> bool:
        """Return whether the spot lies on the array with six standard deviations to each side."""
        reach = 6.0 * max(seen.sigma, 1.0)
        return reach < seen.centre < self.scenario.scanner.position_sensor.pixels - 1 - reach

    def range_per_pixel(self, R: float, theta: float = 0.0) -> float:
        """Return |∂R/∂p| times the pitch [m/pixel]: the exact form of eq 4, on the array as it stands."""
        return self.pitch * float(self.array.range_error(R, theta))

    @property
    def angle_sigma(self) -> float:
        """Standard deviation [rad] of what an encoder reads about the true deflection, drift left out."""
        mirrors = self.scenario.scanner.mirrors
        return math.sqrt(
            (1.0 - mirrors.jitter_seen) * mirrors.jitter**2
            + mirrors.wobble**2
            + mirrors.readout_noise**2
            + mirrors.readout_step**2 / 12.0
        )

    def synchronisation_error(self, R: float, theta: float = 0.0) -> float:
        """Return the error of p [m] from the angle between projection and reception: upright, f (1 + p²/f²) σ."""
        return float(self.array.turned(R, theta)) * self.scenario.scanner.mirrors.synchronisation

    def follows(self, seen: ClosedSpot) -> float:
        """Return by how much the estimate moves with the spot, ∂p̂/∂p: 1 but for the slope of a systematic error."""
        chosen = self.scenario.processing
        if chosen.peak == FIT or chosen.bias_correction != "none":
            return 1.0
        step = 1e-3
        found = []
        for side in (1.0, -1.0):
            line = seen.charge * spot.pixel_shares(LINE // 2 + seen.phase + side * step, seen.sigma, LINE)
            found.append(self.estimated(chosen.peak, line))
        return (found[0] - found[1]) / (2.0 * step)

    def estimated(self, estimator: str, line: Array) -> float:
        """Return the position [pixel] that an estimator tells of a line without noise."""
        if estimator in ESTIMATORS:
            return ESTIMATORS[estimator](line.tolist())
        assert self.own.position is not None
        return float(self.own.position(np.asarray(line)))

    def position(self, R: float, phase: float) -> float:
        """Return the range [m] next to one at which a facing plate's spot lies at a position in its pixel."""
        target = round(self.facing(R, 1.0).centre) + phase
        for _ in range(5):
            R += (self.facing(R, 1.0).centre - target) * self.range_per_pixel(R)
        return R

    def sigma_pixel(self, seen: ClosedSpot, estimator: str, variance: Array) -> float:
        """Return σ of the estimate [pixel] for the variances of the judge's pixels, to first order."""
        if estimator == FIT:
            spread = width_spread(self.scenario.processing.validation.beam_width, seen.beam)
            slopes = fit_gradient(LINE // 2 + seen.phase, seen.sigma, seen.charge, variance, spread)
            return float(np.sqrt(slopes**2 @ variance))
        if estimator not in ESTIMATORS and self.own.sigma is not None:
            return float(self.own.sigma(seen.line, variance))
        return first_order(lambda line: self.estimated(estimator, np.array(line)), seen.line, variance)
