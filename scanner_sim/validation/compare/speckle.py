"""Laws of speckle: its contrast and what it does to the range, from wave optics."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.speckle import fitted_place
from scanner_sim.analytic.wave_optics import Lens, defocus, images, on_pixels
from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import FIT, ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, spread_of
from scanner_sim.validation.compare.noise import SPREAD, phases, plate_side, slope_expected, slope_over, spots

Array = NDArray[np.float64]

_MODEL = 0.04
"""What the packets' sizes leave: the pupil's edge, a Gaussian for what lies under it, the modes that are left out."""
_LINE = 25
"""Pixels of the judge's line."""
_WIDEST = 2.0
"""Standard deviation of a spot [pixel] that this line holds."""
_SIDE = 8
"""Pixels of a line of zeros beside it, for estimators that look beyond the spot."""
_SURFACES = 1000
"""Surfaces of wave optics at each range: normal scatter is known to 1/√(2 · 1000)."""
_FEW = 2.0
"""Image of the beam over λN below which all of them are taken, quick or not: few packets scatter wildly."""
_CHANCE = 3.0
_APART = 7_368_787
"""Of the seeds of the surfaces of one place."""


def _coherent(setting: ComparisonSetup) -> str:
    if not setting.scenario.scanner.laser.speckle:
        return "the scenario's laser makes no speckle"
    if not _ranges(setting):
        return "the array sees no spot at these ranges that wave optics could integrate on its line"
    return ""


def _ranges(setting: ComparisonSetup) -> tuple[float, ...]:
    """Return the ranges at which the array sees a spot that is no wider than the line of wave optics."""
    closed = ClosedForms(setting.scenario)
    seen = {R: closed.facing(R, setting.flat.reflectance) for R in setting.flat.ranges}
    return tuple(R for R, one in seen.items() if closed.on_array(one) and one.sigma <= _WIDEST)


def _judged(setting: ComparisonSetup) -> str:
    """Return the estimator of the range: the window of the centre of mass jumps, which is of no order in the noise."""
    chosen = setting.scenario.processing.peak
    return FIT if chosen == "centre_of_mass" else chosen


def _surfaces(setting: ComparisonSetup, ratio: float) -> int:
    """Return the number of surfaces for an image of the beam, in λN."""
    return _SURFACES if ratio < _FEW else setting.shots(_SURFACES)


def _slack(numbers: Array, contrast: float) -> float:
    """Return how far a relative standard deviation of wave optics and one of the program may differ.

    That of a sample with the kurtosis κ is known to √((κ − 1)/4n) (Kendall, Stuart, *The advanced theory of statistics*
    1, 1977, sec 10.9). The program's modes are normal and move the light linearly: place over energy of the contrast c
    scatters by 1 + 3c² in variance, to second order.
    """
    apart = (numbers - numbers.mean(axis=-1, keepdims=True)) ** 2
    kurtosis = max(float(np.mean(apart**2) / np.mean(apart) ** 2), 3.0)
    return _MODEL + 1.5 * contrast**2 + _CHANCE * math.sqrt((kurtosis - 1.0) / (4.0 * numbers.shape[-1]))


@lru_cache(maxsize=32)
def _lines(
    lens: tuple[float, float], blur: tuple[float, float], pitch: float, image: float, count: int
) -> Array:
    """Return lines of C = 1/√2 for a spot at each position in a pixel, shape (positions, count, pixels), mean total 1.

    ``lens`` λ and N, ``blur`` aberration, taken as defocus, and diffusion [m], ``image`` of the beam [m].
    """
    bare = Lens(*lens)
    seen = Lens(*lens, defocus(bare, blur[0])) if blur[0] > 0.0 else bare
    found = [
        [on_pixels(one, pitch, _LINE, _LINE // 2 + float(phase), blur[1])[0] for phase in phases()]
        for one in images(seen, (image, image), count, 1, polarisations=2, blur=blur[0])
    ]
    return np.array(found).transpose(1, 0, 2)


def _seen(setting: ComparisonSetup, R: float) -> Array:
    """Return the judge's lines at a range."""
    scanner = setting.scenario.scanner
    laser, receiver, sensor = scanner.laser, scanner.receiver, scanner.position_sensor
    radius = beam_radius(R, laser.waist_radius, laser.waist_distance, laser.wavelength, laser.m_squared)
    # Along the array all of the image is stretched alike, grains and aberration with it.
    along, across = (float(one) for one in setting.closed.array.scale(R))
    image = 0.5 * float(radius) * along / R
    lens = laser.wavelength, along / receiver.aperture
    aberration = math.hypot(receiver.aberration * along / across, setting.closed.array.blur(R).along)
    count = _surfaces(setting, image / (lens[0] * lens[1]))
    return _lines(lens, (aberration, sensor.diffusion), sensor.pitch, image, count)


def _separate(setting: ComparisonSetup, R: float) -> tuple[float, int, int]:
    """Return to which side directions reach [rad], how many there are along it, and in how many runs.

    Shots lie four beam radii apart, or as many of them as can at two: there patterns share e⁻⁴, 2 %, of their light
    (Goodman, *Speckle phenomena in optics*, 2007, sec. 5.3). The others are those of further surfaces.
    """
    scanner, side = setting.scenario.scanner, math.isqrt(setting.shots(4900))
    radius = scanner.laser.radius(R) / R
    reach = min(SPREAD, scanner.mirrors.max_deflection, 2.0 * (side - 1) * radius)
    fitting = min(side, math.floor(reach / radius) + 1)
    return reach, fitting, math.ceil(side**2 / fitting**2)


def _shots(setting: ComparisonSetup, step: int, R: float) -> tuple[list[Array], list[Array]]:
    """Return errors of the range by speckle [mm] and relative charges, of phases in a pixel and seeds about a range."""
    errors, charges = [], []
    reach, side, runs = _separate(setting, R)
    theta, phi = test_bench.square(reach, side**2)
    for index, (where, _) in enumerate(spots(setting, R)):
        for seed in setting.seed(8, step, index):
            plate = test_bench.plate(where, setting.flat.reflectance, size=plate_side(setting, where))
            seeds = tuple((seed + _APART * run) % 2**63 for run in range(runs))
            found = []
            # Directions differ, and with them the position in the pixel: what the estimator errs there is no noise.
            for speckle in (True, False):
                made = test_bench.on_test_bench(setting, plate, seed=seed, speckle=speckle)
                aim = test_bench.directions(theta, phi, made.scanner.mirrors, 0.0)
                found.append(test_bench.measure(setting, made, aim, seeds))
            coherent, even = found
            errors.append(1e3 * (coherent["range_m"] - even["range_m"]))
            charges.append(coherent["Y"] / even["Y"])
    return errors, charges


def _measure_limit(setting: ComparisonSetup) -> dict[str, Measured]:
    cases, ranges = {}, _ranges(setting)
    for step, R in enumerate(ranges):
        cases[f"{R:.4g} m"] = spread_of(np.stack(_shots(setting, step, R)[0]))
    return cases | slope_over(ranges, cases, True)


def _predict_limit(setting: ComparisonSetup) -> dict[str, Predicted]:
    closed, cases, ranges, peak = setting.closed, {}, _ranges(setting), _judged(setting)
    for R in ranges:
        squares, positions, every = [], [], _seen(setting, R)
        for (where, seen), lines in zip(spots(setting, R), every, strict=True):
            if peak == FIT:
                guard = math.ceil(4.0 * seen.sigma)
                position = fitted_place(lines, _LINE // 2 + seen.phase, seen.sigma, guard)
            else:
                padded = np.pad(lines, ((0, 0), (_SIDE, _SIDE)))
                position = np.array([closed.estimated(peak, line) for line in padded])
            squares.append((closed.range_per_pixel(where) * float(position.std(ddof=1))) ** 2)
            positions.append(position)
        value = 1e3 * math.sqrt(float(np.mean(squares)))
        charge = every.sum(axis=2)
        slack = _slack(np.array(positions), float(charge.std() / charge.mean()))
        cases[f"{R:.4g} m"] = Predicted("σ of R", "mm", value, slack * value)
    return cases | slope_expected(ranges, cases, True, "2 for a spot of one width")


def _measure_contrast(setting: ComparisonSetup) -> dict[str, Measured]:
    cases = {}
    for step, R in enumerate(_ranges(setting)):
        cases[f"{R:.4g} m"] = spread_of(100.0 * np.stack(_shots(setting, step, R)[1]))
    return cases


def _predict_contrast(setting: ComparisonSetup) -> dict[str, Predicted]:
    cases = {}
    for R in _ranges(setting):
        whole = _seen(setting, R).sum(axis=2)
        value = 100.0 * float(np.mean(whole.std(axis=1, ddof=1) / whole.mean(axis=1)))
        slack = _slack(whole, 0.0)
        cases[f"{R:.4g} m"] = Predicted("contrast of the charge", "%", value, slack * value)
    return cases


LIMIT = Law(
    "speckle_limit",
    "Range noise of speckle",
    "eq 4 with wave optics; slope R²",
    "σ_p of the scenario's estimator on lines of wave optics: random phases under the beam, through a pupil with the "
    "lens's aberration as defocus, on pixels with the sensor's diffusion; one frozen pattern, C = 1/√2. Speckle alone.",
    "target",
    _coherent,
    _measure_limit,
    _predict_limit,
    exercises="peak",
    needs=("position",),
)
CONTRAST = Law(
    "speckle_contrast",
    "Contrast of the charge by speckle",
    "Parseval with wave optics",
    "σ/mean of the spot's charge on the same lines: C/√M with M = π²σ²/(λN)² of the beam's geometric image, whatever "
    "the lens's phase and the sensor's diffusion.",
    "target",
    _coherent,
    _measure_contrast,
    _predict_contrast,
    exercises="peak",
)
