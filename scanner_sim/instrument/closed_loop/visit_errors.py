"""What the instrument knows of the error of a visit: the parts of its covariance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from scanner_sim.config.scanner import Scanner, speckle_optics
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.arithmetic import exp
from scanner_sim.optics.speckle import packets_of
from scanner_sim.scan.schedule import PatternMotion
from scanner_sim.tracking.errors import ErrorParts, mean_pixel_correlation
from scanner_sim.tracking.lasting import SurfaceSpeckle, surface_covariance
from scanner_sim.tracking.measurement import Measurement, TargetAppearance
from scanner_sim.tracking.samples import PatternSamples

Array = NDArray[np.float64]

_BETWEEN = 0.75
"""Position of a typical spot between the edges of its pixel, from the lower one."""


def error_parts(
    scenario: Scenario,
    samples: PatternSamples,
    seen: Measurement,
    appearance: TargetAppearance,
    motion: PatternMotion,
    light: Array,
    grain: float,
) -> ErrorParts:
    """Return what the error of a measured position is made of; its covariance as the voxels tell it is ``seen``'s.

    Parameters
    ----------
    scenario
        Instrument.
    samples, seen
        A pattern, and where its voxels show a target.
    appearance
        What is known of the target.
    motion
        How the mirrors ran the pattern.
    light
        Relative variance of each voxel's light by speckle, shape (points,).
    grain
        V of the ranges' weights (:attr:`~scanner_sim.signals.line.speckle.SpotSpeckle.single`).
    """
    scanner, mirrors = scenario.scanner, scenario.scanner.mirrors
    spread = mirrors.temperature.spread(motion.time[:1])[0]
    commanded = np.array([motion.commanded_theta.mean(), motion.commanded_phi.mean()])
    white = ErrorParts.all_white(seen.covariance[0])
    known = bool(seen.found[0])
    theta, _, distance = seen.position[0] if known else (0.0, 0.0, 1.0)
    noise, unlike = range_variances(scanner, distance, float(np.median(samples.signal)), grain)
    by_line = scenario.rangefinders == ("triangulation",)
    surface = np.zeros((3, 3))
    beam = float(scanner.laser.radius(distance))
    if known and scanner.laser.speckle and appearance.surface == "flat":
        surface = surface_covariance(
            samples,
            seen,
            SurfaceSpeckle(beam, light, _on_surface(scanner, distance), noise if by_line else math.inf),
        )
    reach = distance - scanner.receiver.baseline * math.sin(theta)
    image = scanner.receiver.focal_length * scanner.receiver.baseline * math.cos(theta) / reach
    return replace(
        white,
        white=white.white - surface,
        surface=surface,
        turn=np.asarray(beam / (0.5 * appearance.diameter)),
        pixels=np.asarray(unlike * alike(scanner, samples, distance) if by_line else 0.0),
        image=np.asarray(image / scanner.position_sensor.pitch),
        image_width=np.asarray(math.sqrt(image_variance(scanner, distance))),
        wobble=np.asarray(mirrors.wobble**2),
        wobble_time=np.asarray(mirrors.wobble_time),
        wobble_angle=np.asarray(mirrors.wobble_angle),
        drift=spread * (mirrors.drift_zero + mirrors.drift_scale * commanded),
    )


def range_variances(
    scanner: Scanner, distance: float, signal: float, grain: float = 0.0
) -> tuple[float, float]:
    """Return the variances of a range [m²] in triangulation: of one voxel without speckle, and by unlike pixels.

    The spot stays on the same pixels, whose unlike responses move every range of the pattern alike. For an efficient
    estimate of the spot's position each pixel i has the weight w_i = (q_i′/v_i)/Σ q′²/v, with the charge q_i, its slope
    q_i′ and its variance v_i = σ_read² + q_i + (s q_i)² + V N q_i of read noise, shot noise, the response's relative
    standard deviation s and what the fit's weights know of speckle; s adds Σ (w_i s q_i)² to the position's variance,
    the first two Σ w_i² (σ_read² + q_i), and ∂R/∂p = R²/(f d) makes it the range's.

    Parameters
    ----------
    scanner
        The instrument.
    distance
        Range [m].
    signal
        Charge N of the spot [electron].
    grain
        V; 0 for light without speckle.
    """
    sensor, receiver = scanner.position_sensor, scanner.receiver
    if not signal > 0.0:
        return 0.0, 0.0
    spread = sensor.prnu if sensor.noise.prnu else 0.0
    width = math.sqrt(image_variance(scanner, distance))
    edge = (np.arange(-8.0, 9.0) - _BETWEEN) / width
    density = exp(-0.5 * edge**2) / math.sqrt(2.0 * math.pi)
    charge, slope = signal * np.diff(ndtr(edge)), -signal * np.diff(density) / width
    random = sensor.read_noise**2 + charge
    variance = random + (spread * charge) ** 2 + grain * signal * charge
    weight = slope / variance / float((slope**2 / variance).sum())
    by_pixel = distance**2 * sensor.pitch / (receiver.focal_length * receiver.baseline)
    moved = ((weight**2 * random).sum(), ((weight * spread * charge) ** 2).sum())
    return float(moved[0]) * by_pixel**2, float(moved[1]) * by_pixel**2


def alike(scanner: Scanner, samples: PatternSamples, expected: float) -> float:
    """Return the share of the variance by unlike pixels that is left in the mean range of a pattern's voxels.

    Spots on a tilted target stand on different pixels. Images Δ pixels apart, of standard deviation s, share
    (1 − Δ²/2s²) exp(−Δ²/4s²) of what unlike pixels do to them, the correlation of Σ x q(x) ε(x) for two Gaussian images
    q over white ε; the mean over all pairs of voxels, each weighed by 1/σ_R². Image positions by eq 1.
    """
    receiver, valid = scanner.receiver, samples.valid
    if not valid.any():
        return 1.0
    weight = np.where(valid, 1.0 / np.maximum(samples.sigma_range, 1e-9) ** 2, 0.0)
    base = receiver.focal_length * receiver.baseline / scanner.position_sensor.pitch
    theta, reach = samples.theta, np.where(valid, samples.range, expected)
    pixel = base * np.cos(theta) / (reach - receiver.baseline * np.sin(theta))
    return float(mean_pixel_correlation(pixel / math.sqrt(image_variance(scanner, expected)), weight)[0])


def _on_surface(scanner: Scanner, distance: float) -> float:
    """Return the share of the variance of the light's position by speckle that its position on the surface makes."""
    optics, pitch = speckle_optics(scanner), scanner.position_sensor.pitch
    variance = image_variance(scanner, distance) - (scanner.point_spread / pitch) ** 2
    return float(packets_of(optics, variance, variance).on_surface)


def image_variance(scanner: Scanner, distance: float) -> float:
    """Return the variance [pixel²] of the spot on the line, on a surface that faces the scanner at a range [m]."""
    pitch = scanner.position_sensor.pitch
    beam = 0.5 * float(scanner.laser.radius(distance)) * scanner.receiver.focal_length / distance
    return (scanner.point_spread**2 + beam**2) / pitch**2


def duty_cycle_of(scenario: Scenario) -> float:
    """Return the share of a dwell in which there is light; a pulse lasts none."""
    scanner = scenario.scanner
    return 0.0 if scenario.rangefinders[0] == "tof" else scanner.exposure / scanner.dwell
