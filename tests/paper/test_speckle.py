"""Speckle: the limit C λN/π to 0.40 C λN of Dorsch, and of Baribeau and Rioux, and the field that makes it.

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Scenario, simulate
from scanner_sim.analytic import speckle as judge
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.geometry import range_error
from scanner_sim.detector.speckle import CELL, BeamPlaces, LineSpeckle, gamma_like, line_speckle
from scanner_sim.optics.laser import Laser
from scanner_sim.optics.receiver import Receiver
from scanner_sim.optics.speckle import Grain
from scanner_sim.products.image import RangeImage
from scanner_sim.scene.materials import MATERIALS
from scanner_sim.scene.polarisation import speckle_contrast

Array = NDArray[np.float64]

WAVELENGTH, FOCAL, BASE, PITCH, HEIGHT = 1.5e-6, 0.1, 0.2, 50e-6, 250e-6
DEPOLARISED = 1.0 / np.sqrt(2.0)

pytestmark = pytest.mark.usefixtures("device")


def test_closed_limits_of_the_judge() -> None:
    """Claim: centroid and halving place of a Gaussian spot err by 0.225 and 0.40 C λN whatever the spot's size.

    Set-up: the judge's covariance of 10 µm pixels at f/2, round spots of 60 and 90 µm; the centroid is Σ i q_i, the
    halving place Σ sign(i − c) q_i over twice the profile's height. Expected: its closed forms, between which C λN/π
    lies; 9.5 mm at 10 m. Tolerance: 8 %: grain that lies across the middle counts on both sides, which takes 6 % away
    from the second at 60 µm.
    """
    for width in (60e-6, 90e-6):
        pixels, pitch = 61, 10e-6
        centre = 30 * pitch
        covariance = judge.pixel_covariance(WAVELENGTH, 2.0, pitch, centre, (width, width), pixels)
        x = np.arange(pixels) * pitch - centre
        middle = np.sqrt(x @ covariance @ x)
        half = np.sign(x) * 0.5 * np.sqrt(2.0 * np.pi) * width
        halving = np.sqrt(half @ covariance @ half)
        assert middle == pytest.approx(judge.centroid_limit(1.0, WAVELENGTH, 2.0), rel=0.08)
        assert halving == pytest.approx(judge.halving_limit(1.0, WAVELENGTH, 2.0), rel=0.08)
        assert middle < judge.published_limit(1.0, WAVELENGTH, 2.0) < halving
    assert judge.halving_limit(1.0, 1.0, 1.0) == pytest.approx(0.40, abs=0.005)
    limit = judge.published_range_limit(1.0, WAVELENGTH, 10.0, 25e-3, BASE)
    assert limit == pytest.approx(9.5e-3, abs=0.06e-3)


@pytest.mark.parametrize("f_number", [2.0, 4.0, 8.0, 16.0])
@pytest.mark.parametrize("pitch", [50e-6, 5e-6])
def test_grain_has_the_covariance_of_the_pupil(f_number: float, pitch: float) -> None:
    """Claim: variance and correlation of pixels under an even light are those of |μ|² of a circular pupil.

    Set-up: cells of a twentieth of a pixel up to five pixels; the simulator sums over the pupil's transfer
    function, the judge over space. Expected: equal. Tolerance: 1 % of the variance, 0.02 of a correlation: what the
    taps leave out.
    """
    width, pixels = 40e-6, 12 if pitch > 1e-5 else 40
    grain = Grain.of(WAVELENGTH, Receiver(aperture=FOCAL / f_number), pitch, HEIGHT)
    centre = 0.5 * (pixels - 1) * pitch
    covariance = judge.pixel_covariance(WAVELENGTH, f_number, pitch, centre, (1.0, width), pixels)
    share = judge.pixel_shares(pitch, centre, 1.0, pixels)
    relative = covariance / np.outer(share, share)
    row = relative[pixels // 2, pixels // 2 :]
    assert grain.variance == pytest.approx(row[0], rel=0.01)
    near = np.zeros(len(row))
    near[: len(grain.correlations)] = grain.correlations[: len(row)]
    np.testing.assert_allclose(near, row / row[0], atol=0.02)


@dataclass
class Light:
    """Clusters of light for the field alone."""

    amount: Any
    position: Any
    sigma: Any
    across: Any
    coherence: Any
    shots: int

    @property
    def count(self) -> int:
        return int(dr.width(self.amount)) // self.shots


def one_spot(shots: int, centre: float, sigma: float, coherence: float = 1.0) -> Light:
    """Return one round spot for each of many shots [pixel]."""
    values = (1.0, centre, sigma, sigma**2, coherence)
    return Light(*(dr.full(auto.Float, value, shots) for value in values), shots)


def at(horizontal: Array, vertical: Array, slimness: float = 0.0) -> BeamPlaces:
    """Return beams at places in pitches of the lattice."""
    return BeamPlaces(
        *(auto.Float(np.asarray(axis, dtype=np.float32)) for axis in (horizontal, vertical)),
        dr.full(auto.Float, slimness, len(horizontal)),
    )


def factors(found: LineSpeckle, pixels: range) -> Array:
    """Return the factors of some pixels of all shots, shape (pixels, shots)."""
    place = dr.arange(auto.UInt32, found.shots)
    rows = [found(dr.full(auto.UInt32, pixel, found.shots), place).numpy() for pixel in pixels]
    return np.array(rows, dtype=np.float64)


def apart(shots: int) -> BeamPlaces:
    """Return beams so far from one another that nothing is common to their patterns."""
    row, column = np.divmod(np.arange(shots), 200)
    return at(3.0 * column + 0.37 * row % 1.0, 3.0 * row + 0.61 * column % 1.0)


@pytest.mark.parametrize(("f_number", "pitch"), [(2.0, 50e-6), (8.0, 50e-6), (16.0, 50e-6), (4.0, 5e-6)])
def test_charges_have_the_judges_covariance(f_number: float, pitch: float) -> None:
    """Claim: the charges of a spot have mean 1, and the covariance of speckle integrated over pixels and spot.

    Set-up: 40 000 independent patterns on a round spot of 43 µm, off the pixels' middle; C = 1. Expected: the judge's
    covariance, of the five brightest pixels. Tolerance: the mean to 4.5 standard errors; of the covariance 0.09 of
    √(var_i var_j): 4.5 standard errors are 0.03 and the field's own approximations 0.05 (two standard deviations from
    the middle and at the coarsest grain). Power: a variance wrong by 15 % is found with a probability above 0.9999.
    """
    shots, width = 40_000, 43e-6
    middle = 40.3 if pitch > 1e-5 else 80.3
    grain = Grain.of(WAVELENGTH, Receiver(aperture=FOCAL / f_number), pitch, HEIGHT)
    found = line_speckle(one_spot(shots, middle, width / pitch), apart(shots), grain, 0.0, 200, 3)
    first, window = round(middle) - 2, 14 if pitch > 1e-5 else 80
    got = factors(found, range(first, first + 5))
    origin = round(middle) - window // 2
    centre = (middle - origin) * pitch
    inner = slice(first - origin, first - origin + 5)
    shares = judge.pixel_shares(pitch, centre, width, window)[inner]
    covariance = judge.pixel_covariance(WAVELENGTH, f_number, pitch, centre, (width, width), window)
    relative = covariance[inner, inner] / np.outer(shares, shares)
    deviation = np.sqrt(np.diag(relative))
    slack = 4.5 * deviation.max() / np.sqrt(shots) + deviation.max() ** 6 / 729.0
    assert np.abs(got.mean(axis=1) - 1.0).max() < slack
    error = (np.cov(got) - relative) / np.outer(deviation, deviation)
    assert np.abs(error).max() < 0.09


def test_light_of_several_clusters_adds_its_amplitudes() -> None:
    """Claim: two clusters that coincide have the speckle of one; two apart have each its own contrast.

    Set-up: 20 000 patterns; a spot as one cluster and as two halves; and two spots 30 pixels apart, one depolarised.
    Expected: equal factors; the ratio of the standard deviations √2. Tolerance: 0.02 for the quicker law of
    several clusters, four standard deviations from 1; of the ratio 4.5 standard errors, 4.5/√20 000 = 3.2 %.
    """
    shots = 20_000
    grain = Grain.of(WAVELENGTH, Receiver(), PITCH, HEIGHT)
    whole = one_spot(shots, 40.0, 0.9)
    halves = Light(*(dr.concat((part, part)) for part in _arrays(whole)), shots)
    one, two = (line_speckle(light, apart(shots), grain, 0.0, 256, 3) for light in (whole, halves))
    np.testing.assert_allclose(factors(one, range(38, 43)), factors(two, range(38, 43)), atol=0.02)
    other = one_spot(shots, 70.0, 0.9, 0.5)
    pair = Light(*(dr.concat(parts) for parts in zip(_arrays(whole), _arrays(other), strict=True)), shots)
    both = line_speckle(pair, apart(shots), grain, 0.0, 256, 3)
    bright, dull = factors(both, range(40, 71, 30)).std(axis=1)
    assert bright / dull == pytest.approx(np.sqrt(2.0), rel=0.032)


def _arrays(light: Light) -> tuple[Any, ...]:
    return light.amount, light.position, light.sigma, light.across, light.coherence


def test_pattern_belongs_to_the_place_of_the_beam() -> None:
    """Claim: a beam that stays sees a frozen pattern, one that moves by δ keeps exp(−δ²/w²) of it.

    Set-up: 20 000 beams at random places of the lattice, moved by 0, 1/4, 1/2, 1, 3/2 and 3 radii w. Expected: no
    change at 0; the correlation exp(−δ²/w²). Tolerance: 0.06: 0.03 of the lattice's own form and 4.5/√20 000 = 0.032.
    """
    shots, random = 20_000, np.random.default_rng(2)
    grain = Grain.of(WAVELENGTH, Receiver(), PITCH, HEIGHT)
    column, row = random.uniform(-500.0, 500.0, (2, shots))
    light = one_spot(shots, 40.0, 0.9)

    def pattern(moved: float) -> Array:
        return factors(
            line_speckle(light, at(column + moved / CELL, row), grain, 0.0, 256, 7), range(40, 41)
        )[0]

    still = pattern(0.0)
    np.testing.assert_array_equal(still, pattern(0.0))
    for moved in (0.25, 0.5, 1.0, 1.5, 3.0):
        got = np.corrcoef(still, pattern(moved))[0, 1]
        assert got == pytest.approx(np.exp(-(moved**2)), abs=0.06), moved


def test_dwell_averages_patterns() -> None:
    """Claim: a beam that travels by its own diameter in the dwell halves the variance: M = 1 + travel/diameter.

    Set-up: 40 000 patterns, R/w = 2000, sweeps of 0 and 1 mrad, hence a travel of 2 w. Expected: a ratio of 2.
    Tolerance: 4.5 √2 √(2/40 000) = 4.5 %.
    """
    shots = 40_000
    grain = Grain.of(WAVELENGTH, Receiver(), PITCH, HEIGHT)
    places = apart(shots)
    places.slimness = dr.full(auto.Float, 2000.0, shots)
    variances = [
        factors(line_speckle(one_spot(shots, 40.0, 0.9), places, grain, sweep, 256, 3), range(40, 41)).var()
        for sweep in (0.0, 1e-3)
    ]
    assert variances[0] / variances[1] == pytest.approx(2.0, rel=0.045)


def test_integrated_speckle_is_gamma_like() -> None:
    """Claim: mean, variance and skewness of the factors are those of a gamma distribution.

    Set-up: a million normal numbers, relative standard deviations 0.05 to 0.5. Expected: mean 1, variance v,
    skewness 2√v. Tolerance: v³/729 and 4.5 standard errors; of the variance and skewness 4 % more for the cube.
    """
    normal = auto.Float(np.random.default_rng(4).normal(size=1_000_000).astype(np.float32))
    for deviation in (0.05, 0.2, 0.5):
        got = gamma_like(auto.Float(deviation), normal).numpy().astype(np.float64)
        assert got.mean() == pytest.approx(1.0, abs=4.5 * deviation / 1e3 + deviation**6 / 729)
        assert got.var() == pytest.approx(deviation**2, rel=0.04)
        skewness = np.mean((got - got.mean()) ** 3) / got.std() ** 3
        assert skewness == pytest.approx(2.0 * deviation, abs=0.08 * deviation + 0.012)


def test_contrast_follows_polarisation() -> None:
    """Claim: C is 1 on metal and 1/√2 on paint (degree of polarisation 1 and 0)."""
    assert speckle_contrast(0.0) == 1.0
    assert speckle_contrast(1.0) == pytest.approx(DEPOLARISED)
    assert MATERIALS["nickel"].depolarised_share == 0.0
    assert MATERIALS["z93_white"].depolarised_share == 1.0


def plane(
    distance: float, aperture: float, peak: str, *, tilt: float = 25.0, speckle: bool = True, **surface: float
) -> RangeImage:
    """Return an image of a plane, tilted so that the spots lie everywhere between the pixels.

    The mirrors are still and the pixels alike: both errors are fixed or common, and not what is asked for.
    """
    still = dict.fromkeys(("jitter", "wobble", "synchronisation", "readout_noise", "readout_step"), 0.0)
    mirrors = {name: value for name, value in still.items() if name in _mirror_keys()}
    scanner = {
        "laser": {"speckle": speckle},
        "mirrors": mirrors,
        "receiver": {"aperture": aperture},
        "position_sensor": {"noise": {"prnu": False}},
    }
    target = {
        "name": "plane",
        "shape": "rectangle",
        "size": [40.0, 40.0],
        "position": [0.0, 0.0, distance],
        "rotation": {"axis": "y", "angle": np.deg2rad(tilt)},
        "material": {"reflectance": 0.5, **surface},
    }
    half = np.deg2rad(3.0)
    scan = {
        "type": "raster",
        "rows": 120,
        "columns": 120,
        "horizontal": [-half, half],
        "vertical": [-half, half],
    }
    scenario = Scenario.model_validate(
        {
            "schema": 1,
            "seed": 5,
            "scanner": scanner,
            "scene": {"objects": [target]},
            "scan": scan,
            "processing": {"peak": peak},
        }
    )
    return simulate(scenario, device="cpu")


@cache
def _mirror_keys() -> frozenset[str]:
    from scanner_sim.optics.deflection import Mirrors

    return frozenset(Mirrors.model_fields)


def position_errors(image: RangeImage) -> tuple[Array, Array]:
    """Return the errors of the positions on the sensor [m] and √M of each, the patterns of the dwell."""
    valid = image["status"] == 0
    assert valid.mean() > 0.999
    truth = image["truth.range_m"].astype(np.float64)
    theta = image.theta[None, :] + np.zeros_like(truth)
    slope = range_error(truth, theta, FOCAL, BASE, 1.0)
    error = (truth - image["range_m"]) / slope
    laser = Laser()
    radius = laser.waist_radius * np.hypot(1.0, truth / laser.rayleigh_length)
    averaged = 1.0 + (image.theta[1] - image.theta[0]) * truth / (2.0 * radius)
    return error[valid], np.sqrt(averaged[valid])


def expected_factor(peak: str, f_number: float, sigma: float) -> float:
    """Return the judge's standard deviation of an estimator [λN], root mean square over the place in a pixel."""
    pixels, squares = 12, []
    for phase in (np.arange(6) + 0.5) / 6.0 - 0.5:
        centre = (6.0 + phase) * PITCH
        width = sigma * PITCH
        covariance = judge.pixel_covariance(WAVELENGTH, f_number, PITCH, centre, (width, width), pixels)
        shares = judge.pixel_shares(PITCH, centre, width, pixels)
        estimator: Callable[..., float] = _padded(ESTIMATORS[peak])
        squares.append((judge.position_sigma(estimator, shares, covariance) * PITCH) ** 2)
    return float(np.sqrt(np.mean(squares)) / (WAVELENGTH * f_number))


def _padded(estimator: Callable[..., float]) -> Callable[..., float]:
    """Return an estimator that may read beyond the spot's pixels."""
    return partial(lambda line: estimator([0.0] * 6 + list(line) + [0.0] * 6) - 6.0)


@pytest.mark.parametrize("f_number", [2.0, 4.0, 8.0])
@pytest.mark.parametrize("peak", ["gaussian", "centre_of_mass", "blais_rioux_4"])
def test_rendered_error_is_the_judges(peak: str, f_number: float) -> None:
    """Claim: the whole chain errs by the speckle's limit, as the estimator's window lets through.

    Set-up: a depolarising plane at 10 m, tilted by 25°, 120 × 120 voxels, f/2, f/4 and f/8; the same seed without
    speckle takes away the estimator's systematic error. Expected: C/√M times the judge's first-order propagation of its
    covariance for a spot of 0.86 px. Tolerance: 10 %: 4.5/√(2 · 14 400/3) = 4.6 % for voxels that share patterns with
    neighbours, and 5 % for the second order at f/8 and the spot's width.
    """
    noisy, root = position_errors(plane(10.0, FOCAL / f_number, peak))
    clean, _ = position_errors(plane(10.0, FOCAL / f_number, peak, speckle=False))
    got = float(np.sqrt(np.mean(((noisy - clean) * root) ** 2))) / (DEPOLARISED * WAVELENGTH * f_number)
    assert got == pytest.approx(expected_factor(peak, f_number, 0.86), rel=0.10)
    assert clean.std() < noisy.std()


@pytest.mark.parametrize("f_number", [2.0, 4.0, 8.0])
def test_published_limit(f_number: float) -> None:
    """Claim: with the authors' own estimator the limit C λN/π to 0.40 C λN is met within 25 %.

    Set-up: as above with ``blais_rioux_4``; one frozen pattern (the errors times √M). Expected: between 0.75/π and
    1.25 · 0.40. ``gaussian`` reads three pixels only and is worse, 0.51; ``maximum_likelihood`` knows what speckle does
    and is better: not what those authors had.
    """
    noisy, root = position_errors(plane(10.0, FOCAL / f_number, "blais_rioux_4"))
    clean, _ = position_errors(plane(10.0, FOCAL / f_number, "blais_rioux_4", speckle=False))
    factor = float(np.sqrt(np.mean(((noisy - clean) * root) ** 2))) / (DEPOLARISED * WAVELENGTH * f_number)
    assert 0.75 / np.pi < factor < 1.25 * 0.40


def test_nothing_is_left_without_speckle() -> None:
    """Claim: with the switch off neither light nor σ knows of speckle.

    Set-up: two contrasts of the surface, and two that the processing reckons with. Expected: the same bytes.
    """
    images = [
        plane(10.0, 25e-3, "gaussian", speckle=False, **surface) for surface in ({}, {"depolarisation": 0.0})
    ]
    for name in ("range_m", "sigma_range_m", "status", "Y"):
        assert images[0][name].tobytes() == images[1][name].tobytes()


def test_metal_has_the_stronger_speckle() -> None:
    """Claim: a surface that keeps the polarisation errs √2 times as much, and σ, which cannot know, does not.

    Set-up: planes of equal reflectance at 10 m. Expected: √2. Tolerance: 7 %, 4.5 standard errors of both.
    """
    spread = [
        position_errors(plane(10.0, 25e-3, "gaussian", depolarisation=share))[0].std() for share in (0.0, 1.0)
    ]
    assert spread[0] / spread[1] == pytest.approx(np.sqrt(2.0), rel=0.07)


@pytest.mark.parametrize(
    ("peak", "distance", "f_number", "slack"),
    [
        ("gaussian", 2.5, 2.0, 0.02),
        ("gaussian", 10.0, 4.0, 0.02),
        ("gaussian", 25.0, 4.0, 0.02),
        ("gaussian", 10.0, 8.0, 0.05),
        ("maximum_likelihood", 5.0, 4.0, 0.02),
        ("maximum_likelihood", 10.0, 2.0, 0.02),
        ("maximum_likelihood", 25.0, 8.0, 0.02),
    ],
)
def test_sigma_covers_speckle(peak: str, distance: float, f_number: float, slack: float) -> None:
    """Claim: (estimate − truth)/σ has the standard deviation 1 on planes.

    Set-up: depolarising planes, as above. Expected: 1. Tolerance: ``slack``, which is 0.02 but for three pixels whose
    noise is so large (8 %) that the first order ends, and 4.5/√(2 · 14 400 / 2) = 0.037 of chance, patterns of
    neighbours being common in part. Without the speckle's term it is above 2. Left out
    as known to fall short: ``gaussian`` at f/8 and 2.5 m, 1.12, whose brightest pixel is often the wrong one.
    """
    image = plane(distance, FOCAL / f_number, peak)
    valid = image["status"] == 0
    pull = ((image["range_m"] - image["truth.range_m"]) / image["sigma_range_m"])[valid].astype(np.float64)
    assert pull.std() == pytest.approx(1.0, abs=slack + 0.037)
