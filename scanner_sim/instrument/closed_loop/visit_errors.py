"""What the instrument knows of the errors of visits, any number of them at once: the parts of their covariances."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from scanner_sim.config.scanner import Scanner, geometry_of
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.arithmetic import columns, exp, log
from scanner_sim.optics.speckle import Optics, Packets, packets_of
from scanner_sim.ranging.ranges import Geometry
from scanner_sim.ranging.triangulation import position_from_range, range_jacobian
from scanner_sim.scan.lissajous import dwell_places
from scanner_sim.scan.schedule import PatternMotion
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.signals.line.estimators import CLOSED_FORMS
from scanner_sim.signals.line.sensitivity import PLACES, sensitivity
from scanner_sim.signals.processing import PeakMethod
from scanner_sim.tracking.errors import HARMONICS, ErrorParts, mean_pixel_correlation
from scanner_sim.tracking.lasting import (
    LASTING_RADII,
    SurfaceParts,
    SurfaceSpeckle,
    range_fades,
    surface_parts,
)
from scanner_sim.tracking.measurement import Measurement, Sight
from scanner_sim.tracking.record import TrackTarget
from scanner_sim.tracking.samples import PatternSamples

Array = NDArray[np.float64]

_BETWEEN = np.array([0.25])
"""Place of a typical spot from the centre of its pixel, where a fit weighs pixels alike at all places [pixel]."""
_PIXELS = np.arange(-8, 8)
"""The pixels about it."""


@dataclass(frozen=True)
class PatternSpeckle:
    """What the instrument knows of the speckle in patterns.

    ``optics`` on which it depends; ``light`` the relative variance of each voxel's light, shape (patterns, points);
    ``grain`` V of the ranges' weights (:attr:`~scanner_sim.signals.line.speckle.SpotSpeckle.single`), (patterns,).
    """

    optics: Optics
    light: Array
    grain: Array


def error_parts(
    scenario: Scenario,
    samples: PatternSamples,
    seen: Measurement,
    target: TrackTarget,
    motion: PatternMotion,
    number: NDArray[np.int64],
    speckle: PatternSpeckle | None,
    by_line: Array,
) -> ErrorParts:
    """Return what the errors of measured positions are made of, leading axis (patterns,).

    The covariance as independent voxels tell it is ``seen``'s; to it comes what neighbours share. The errors of a
    calibration, ``common``, are not among them.

    Parameters
    ----------
    scenario
        Instrument.
    samples, seen
        Patterns, and where their voxels show a target.
    target
        What is known of the target.
    motion
        How the mirrors ran the patterns.
    number
        Of each pattern at its target, shape (patterns,): it decides where the dwells lie.
    speckle
        What is known of the speckle; None without.
    by_line
        Triangulation's share of the ranges, whose errors alone voxels and visits share, shape (patterns,).
    """
    scanner, mirrors, appearance = scenario.scanner, scenario.scanner.mirrors, target.appearance
    spread = mirrors.temperature.spread(motion.time[:, 0])
    points = motion.time.shape[1]
    commanded = columns(
        motion.commanded_theta.sum(axis=1) / points, motion.commanded_phi.sum(axis=1) / points
    )
    known, none = seen.found, np.zeros(len(seen.found))
    theta, distance = np.where(known, seen.position[:, 0], 0.0), np.where(known, seen.position[:, 2], 1.0)
    beam = beam_radius(scanner, distance)
    wide, upright = beam / distance, _upright_variance(scanner, distance, beam)
    width = np.sqrt(_image_variance(scanner, distance, upright))
    levels = np.array([_median(samples.signal), *_extremes(samples.signal)])
    alone, unlike, weighed = _range_variances(
        scanner,
        scenario.processing.peak,
        distance,
        theta,
        width,
        levels,
        0.0 if speckle is None else speckle.grain,
    )
    no_dither = np.zeros((len(known), HARMONICS, 3, 3))
    by_surface, sooner = SurfaceParts(0.0 * seen.covariance, 0.0 * seen.covariance, no_dither), none + 1.0
    if speckle is not None and appearance.surface == "flat":
        known_speckle = SurfaceSpeckle(
            beam,
            speckle.light,
            _on_surface(scanner, speckle.optics, distance, upright),
            _range_noise(samples, levels[1:], alone[1:], by_line),
        )
        by_surface = surface_parts(samples, seen, known_speckle)
        sooner = range_fades(known_speckle.on_surface)
    place = dwell_places(scenario.following.pattern, number, scanner.galvanometers.lag / scanner.dwell)
    line = geometry_of(scanner)
    image = position_from_range(distance, theta, line.scale, line.baseline, line.slope)
    share = alike(line, samples, distance, weighed[0], seen.sight)
    return ErrorParts(
        white=seen.covariance + by_surface.neighbours - by_surface.lasting,
        surface=by_surface.lasting,
        turn=LASTING_RADII * beam / (0.5 * appearance.diameter),
        approach=_approach(scanner, distance, beam, target),
        range_fades=sooner,
        pixels=unlike[0] * share * by_line**2,
        image=image / line.pitch,
        image_width=_width_of_all(weighed[0], share),
        wobble=none + mirrors.wobble**2,
        wobble_time=none + mirrors.wobble_time,
        wobble_angle=none + mirrors.wobble_angle,
        drift=spread[:, None] * (mirrors.drift_zero + mirrors.drift_scale * commanded),
        common=np.zeros((len(known), 3, 0)),
        dither=no_dither if place is None else by_surface.dither,
        dwell_place=none if place is None else place,
        dwell_step=_step(motion) / wide,
        offset=np.where(known[:, None], commanded - seen.position[:, :2], 0.0)
        * columns(1.0 / wide, np.cos(theta) / wide),
    )


def _width_of_all(width: Array, share: Array) -> Array:
    """Return the width of one image that weighs unlike pixels as images of a ``width`` do that lie apart.

    Of images s and s_x apart it is √(s² + s_x²), and (1 + s_x²/s²)^(−3/2) of the variance is left, the ``share``.
    """
    return width * exp(log(share) / -3.0)


def _step(motion: PatternMotion) -> Array:
    """Return the mean angle from dwell to dwell of patterns [rad], (n,)."""
    theta, phi = motion.commanded_theta, motion.commanded_phi
    across, down = theta[:, 1:] - theta[:, :-1], (phi[:, 1:] - phi[:, :-1]) * np.cos(theta[:, 1:])
    return np.asarray(np.sqrt(across * across + down * down).sum(axis=1) / across.shape[1])


def _approach(scanner: Scanner, distance: Array, beam: Array, target: TrackTarget) -> Array:
    """Return by how much ranges change until the beam, of radius ``beam`` w, meets other speckle [m], shape (n,).

    A surface's speckle lies in units of the beam's radius w about the object's origin
    (:mod:`scanner_sim.detector.surface_noise`): a rim at the distance a from there is carried over it by a Δ(1/w)
    radii, by the :data:`LASTING_RADII` n with Δz = n w²/(a dw/dz). With a² = c² + r² of a disc r whose centre is at c.
    """
    centre = float((np.asarray(target.centre, dtype=np.float64) ** 2).sum())
    away = math.sqrt(centre + (0.5 * target.appearance.diameter) ** 2)
    widening = np.array([abs(scanner.laser.widening(one)) for one in distance.tolist()])
    return np.asarray(LASTING_RADII * beam**2 / (away * np.maximum(widening, 1e-12)))


def _median(values: Array) -> Array:
    """Return the medians of rows; NaN where one of the values is."""
    ascending, count = np.sort(values, axis=1), values.shape[1]
    found = 0.5 * (ascending[:, (count - 1) // 2] + ascending[:, count // 2])
    return np.asarray(np.where(np.isnan(ascending[:, -1]), np.nan, found))


def range_variances(
    scanner: Scanner, peak: PeakMethod, distance: Array, theta: Array, signal: Array, grain: ArrayLike = 0.0
) -> tuple[Array, Array, Array]:
    """Return the variances of ranges [m²] in triangulation: of one voxel without speckle, and by unlike pixels.

    The spot stays on the same pixels, whose unlike responses move every range of the pattern alike. The charge q_i of
    each pixel i moves the spot's position by w_i. Of an efficient estimate, as ``maximum_likelihood`` is,
    w_i = (q_i′/v_i)/Σ q′²/v with the charge's slope q_i′ and its variance v_i = σ₀² + q_i + (s q_i)² + V N q_i of a
    pixel without light, shot noise, the response's relative standard deviation s and what the fit's weights know of
    speckle; the other estimators have their own (:func:`~scanner_sim.signals.line.sensitivity.sensitivity`), as the
    mean over all places in a pixel. s adds Σ (w_i s q_i)² to the position's variance, the first two Σ w_i² (σ₀² + q_i),
    and ∂R/∂p of eq 1, nearly R²/(f d cosΘ), makes it the range's. σ₀² is that of reading, steps and dark charge of both
    exposures, where the one without the laser is subtracted
    (:class:`~scanner_sim.signals.line.calibration.SensorCalibration`): the noisier pixels are, the more the fit leans
    on the spot's bright middle, whose unlike responses move it most. Sunlight beneath the spot is not known here, nor
    how an estimator of the user's own weighs pixels, which counts as efficient, nor what a table of systematic errors
    does to the weights.

    Third is how wide a Gaussian image over pixels of even noise would be that weighs unlike responses as this one does
    [pixel]: its w q, x exp(−x²/2s²), has Σ x² (w q)²/Σ (w q)² = 3s²/2. Where the variance grows with q², outer pixels
    count for more, and images share more of their errors over longer ways.

    Parameters
    ----------
    scanner
        The instrument.
    peak
        Its estimator of the position.
    distance, theta
        Ranges [m] and deflections Θ [rad], shape (n,).
    signal
        Charge N of each spot [electron], shape (n,); where there is none, both variances are 0.
    grain
        V, () or (n,); 0 for light without speckle.
    """
    return _range_variances(
        scanner, peak, distance, theta, np.sqrt(image_variance(scanner, distance)), signal, grain
    )


def _range_variances(
    scanner: Scanner,
    peak: PeakMethod,
    distance: Array,
    theta: Array,
    width: Array,
    signal: Array,
    grain: ArrayLike,
) -> tuple[Array, Array, Array]:
    """Return :func:`range_variances` of spots of known standard deviations [pixel], (n,), and charges, (..., n).

    Within it arrays have two axes more, places in a pixel and pixels.
    """
    sensor = scanner.position_sensor
    lit = np.asarray(signal > 0.0)
    charges = np.where(lit, signal, 1.0)[..., None, None]
    spread = sensor.prnu if sensor.noise.prnu else 0.0
    places = PLACES if peak in CLOSED_FORMS else _BETWEEN
    edge = (np.append(_PIXELS, _PIXELS[-1] + 1) - 0.5 - places[:, None]) / width[:, None, None]
    below, density = ndtr(edge), exp(-0.5 * edge**2) / math.sqrt(2.0 * math.pi)
    charge = charges * (below[..., 1:] - below[..., :-1])
    floor = SensorCalibration.of(sensor, scanner.dwell, scanner.laser_off).floor
    random = floor + charge
    if peak in CLOSED_FORMS:
        weight = sensitivity(peak, width, _PIXELS) / charges
    else:
        slope = -charges * (density[..., 1:] - density[..., :-1]) / width[:, None, None]
        variance = random + (spread * charge) ** 2 + np.reshape(grain, (-1, 1, 1)) * charges * charge
        weight = slope / variance / (slope**2 / variance).sum(axis=-1, keepdims=True)
    line, d = scanner.receiver.line_image, scanner.receiver.baseline
    place = position_from_range(distance, theta, line.scale, d, line.slope)
    by_pixel = (sensor.pitch * range_jacobian(place, theta, line.scale, d, line.slope)[0]) ** 2
    told = (weight * charge) ** 2
    alone, unlike = (
        (weight**2 * random).sum(axis=-1).mean(axis=-1),
        spread**2 * told.sum(axis=-1).mean(axis=-1),
    )
    about = (told * (_PIXELS - places[:, None]) ** 2).sum(axis=(-2, -1))
    weighed = np.sqrt(about / (1.5 * told.sum(axis=(-2, -1))))
    return np.where(lit, alone * by_pixel, 0.0), np.where(lit, unlike * by_pixel, 0.0), weighed


def _extremes(signal: Array) -> tuple[Array, Array]:
    """Return the light of the brightest and of the faintest voxel of each pattern [electron], (n,); some, and apart."""
    lit = signal > 0.0
    most = np.where(lit, signal, 0.0).max(axis=1)
    least = np.minimum(np.where(lit, signal, np.inf).min(axis=1), 0.5 * most)
    return np.where(most > 0.0, most, 2.0), np.where(most > 0.0, least, 1.0)


def _range_noise(samples: PatternSamples, extremes: Array, alone: Array, by_line: Array) -> Array:
    """Return the variances of voxels' ranges without speckle [m²], shape (patterns, points).

    Of two independent ranges, weighted by one over their variances, the variance σ² holds λ σ² of triangulation's with
    its share λ, of which λ² times the line's own noise is without speckle.
    """
    line, share = _noise_of_voxels(samples.signal, extremes, alone), by_line[:, None]
    whole = np.where(samples.valid, samples.sigma_range, 0.0) ** 2
    return np.where(share == 1.0, line, share * share * line + (1.0 - share) * whole)


def _noise_of_voxels(signal: Array, extremes: Array, variance: Array) -> Array:
    """Return the variances of ranges without speckle [m²] of voxels of some light [electron], (n, points).

    α/N + β/N² of the light N, shot noise and what does not go with the light, through the ``variance`` of the brightest
    and of the faintest voxel of each pattern, ``extremes``, both (2, n).
    """
    most, least = extremes
    known = variance * extremes
    reading = (known[1] - known[0]) / (1.0 / least - 1.0 / most)
    shot = known[0] - reading / most
    light = np.where(signal > 0.0, signal, np.inf)
    return np.asarray((shot[:, None] + reading[:, None] / light) / light)


def alike(
    line: Geometry, samples: PatternSamples, expected: Array, width: Array, sight: Sight | None = None
) -> Array:
    """Return the shares of the variance by unlike pixels that are left in the range of patterns' targets, (n,).

    Spots on a tilted target stand on different pixels. Images Δ pixels apart, of standard deviation s, share
    (1 − Δ²/2s²) exp(−Δ²/4s²) of what unlike pixels do to them, the correlation of Σ x q(x) ε(x) for two Gaussian images
    q over white ε; the sum over all pairs of voxels, each weighed by how far its range moves the target's. Image
    positions by eq 1.

    Parameters
    ----------
    line, samples
        The instrument, and the voxels of patterns.
    expected
        Ranges [m] of voxels without one, which count for nothing, shape (n,).
    width
        s of images there [pixel], shape (n,).
    sight
        What flat targets were seen on, with those weights; without it all voxels count, by 1/σ_R².
    """
    valid = samples.valid
    weight = np.where(valid, 1.0 / np.maximum(samples.sigma_range, 1e-9) ** 2, 0.0)
    if sight is not None:
        weight = np.where(valid & np.isfinite(sight.range_gains), sight.range_gains, 0.0)
    reach = np.where(valid, samples.range, expected[:, None])
    along = np.sin(samples.theta) + line.slope * np.cos(samples.theta)
    pixel = line.scale * line.baseline / line.pitch * np.cos(samples.theta) / (reach - line.baseline * along)
    told = np.asarray(weight.any(axis=1))
    weight = np.where(told[:, None], weight, 1.0)
    return np.where(told, mean_pixel_correlation(pixel / width[:, None], weight), 1.0)


def _on_surface(scanner: Scanner, optics: Optics, distance: Array, upright: Array) -> Array:
    """Return the share of the variance of the light's position by speckle that its position on the surface makes.

    ``upright`` is :func:`_upright_variance` there.
    """
    variance = upright - (scanner.point_spread / scanner.position_sensor.pitch) ** 2
    return np.asarray(spot_packets(scanner, optics, variance, distance).on_surface)


def image_variance(scanner: Scanner, distance: Array) -> Array:
    """Return the variances [pixel²] of spots on the line, on surfaces that face the scanner at ranges [m], (n,)."""
    upright = _upright_variance(scanner, distance, beam_radius(scanner, distance))
    return _image_variance(scanner, distance, upright)


def _image_variance(scanner: Scanner, distance: Array, upright: Array) -> Array:
    """Return :func:`image_variance` from that on an upright line."""
    pitch, seen = scanner.position_sensor.pitch, scanner.seen_at(distance)
    beam = upright - (scanner.point_spread / pitch) ** 2
    blur = seen.spread(0.0, (scanner.receiver.aberration / pitch) ** 2)
    return np.asarray(upright + beam * (seen.along**2 - 1.0) + blur)


def _upright_variance(scanner: Scanner, distance: Array, beam: Array) -> Array:
    """Return those on an upright line that is in focus everywhere, of beams of radii [m], (n,)."""
    image = 0.5 * beam * scanner.receiver.focal_length / distance
    return np.asarray((scanner.point_spread**2 + image**2) / scanner.position_sensor.pitch**2)


def beam_radius(scanner: Scanner, distance: Array) -> Array:
    """Return the 1/e² radii of the beam [m] at distances [m], shape (n,)."""
    return np.array([scanner.laser.radius(one) for one in distance.tolist()])


def spot_packets(scanner: Scanner, optics: Optics, variance: Array, distance: Array) -> Packets:
    """Return the packets of round spots at ranges [m], each field of shape (n,).

    ``optics`` is the scanner's; ``variance`` that of their images in the focal plane [pixel²], (n,).

    One after the other: NumPy's powers of arrays depend on the processor.
    """
    found = [
        vars(packets_of(optics, one, one, scanner.seen_at(away))).values()
        for one, away in zip(variance.tolist(), distance.tolist(), strict=True)
    ]
    return Packets(*np.array(list(zip(*found, strict=True))))


def duty_cycle_of(scenario: Scenario) -> float:
    """Return the share of a dwell in which there is light; a pulse lasts none."""
    scanner = scenario.scanner
    return 0.0 if scenario.rangefinders[0] == "tof" else scanner.exposure / scanner.dwell


def seen_from(scenario: Scenario) -> float:
    """Return how far from the laser the lens stands through which targets are seen, along x [m]."""
    scanner = scenario.scanner
    if scenario.rangefinders[0] == "tof" and scanner.lidar.photodiode.place == "coaxial":
        return 0.0
    return scanner.receiver.baseline
