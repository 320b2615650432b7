"""Speckle of the program against wave optics, which knows of nothing but random phases and a lens.

The bench (:mod:`scanner_sim.analytic.wave_optics`) has no packets, modes or sizes of grains: what the program assumes
of speckle is measured there. Lenses: none of the blur from the lens, 40 µm of defocus, 40 µm of a random wavefront, the
preset's share; the rest of 40 µm is diffusion.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from claims import at_most, mean_square
from numpy.typing import NDArray

from scanner_sim.analytic import speckle as closed
from scanner_sim.analytic.wave_optics import Lens, centroid, defocus, images, on_pixels, random_wavefront
from scanner_sim.detector.packets import dwell_average
from scanner_sim.render.device import activate

Array = NDArray[np.float64]

pytestmark = pytest.mark.slow

WAVELENGTH, F_NUMBER, FOCAL, PITCH = 1.5e-6, 4.0, 0.1, 50e-6
CELL = WAVELENGTH * F_NUMBER
BLUR = 40e-6
RANGES = (3.0, 10.0, 20.0)
ABERRATIONS = {"diffusion": 0.0, "preset": 12e-6, "defocus": 40e-6, "random": 40e-6}
PIXELS, PATTERNS = 24, 600
WAVEFRONTS = 8
"""Random wavefronts that the patterns are shared out to."""
PHASES = (12.1, 12.3, 12.48)
FEW_PIXELS = ("gaussian", "parabola", "blais_rioux_2", "blais_rioux_4", "blais_rioux_8")


def image_sigma(distance: float) -> float:
    """Return the standard deviation of the preset's beam on the sensor [m]."""
    waist = 2e-3
    rayleigh = math.pi * waist**2 / WAVELENGTH
    return 0.5 * waist * math.hypot(1.0, distance / rayleigh) * FOCAL / distance


def lenses(kind: str) -> list[Lens]:
    """Return the lenses of a kind."""
    bare, sigma = Lens(WAVELENGTH, F_NUMBER), ABERRATIONS[kind]
    if kind == "diffusion":
        return [bare]
    if kind == "random":
        return [
            Lens(WAVELENGTH, F_NUMBER, random_wavefront(bare, sigma, number)) for number in range(WAVEFRONTS)
        ]
    return [Lens(WAVELENGTH, F_NUMBER, defocus(bare, sigma))]


@cache
def patterns(kind: str, distance: float) -> tuple[Array, Array, Array]:
    """Return energies and centroids [m] of 2 · PATTERNS surfaces, and their lines, shape (places, PATTERNS, PIXELS).

    The lines have C = 1/√2: light that has lost its polarisation is the mean of two surfaces' light.
    """
    sigma, aberration = image_sigma(distance), ABERRATIONS[kind]
    diffusion = math.sqrt(BLUR**2 - aberration**2)
    own = lenses(kind)
    energy, place, lines = [], [], []
    for number, lens in enumerate(own):
        for image in images(lens, (sigma, sigma), 2 * PATTERNS // len(own), 100 + number, blur=aberration):
            energy.append(image.profile.sum())
            place.append(centroid(image)[0])
            lines.append([on_pixels(image, PITCH, PIXELS, centre, diffusion)[0] for centre in PHASES])
    both = 0.5 * (np.array(lines[::2]) + np.array(lines[1::2]))
    return np.array(energy), np.array(place), both.transpose(1, 0, 2)


def spot(kind: str, distance: float) -> closed.SpeckledSpot:
    """Return the spot of the closed forms."""
    aberration = ABERRATIONS[kind]
    return closed.SpeckledSpot(
        image_sigma(distance), CELL, aberration, math.sqrt(BLUR**2 - aberration**2), PITCH
    )


@pytest.mark.parametrize("distance", RANGES)
@pytest.mark.parametrize("kind", ABERRATIONS)
def test_closed_forms_are_those_of_wave_optics(kind: str, distance: float) -> None:
    """Claim: contrast of the energy and scatter of the centroid follow from counting packets, for any wavefront.

    Set-up: 1200 surfaces, C = 1. Expected: the closed forms. Tolerance: 4.5/√2400 = 9 % of chance; the random
    wavefronts differ among themselves by 3 %.
    """
    energy, place, _ = patterns(kind, distance)
    expected = spot(kind, distance)
    slack = 4.5 / math.sqrt(4.0 * PATTERNS)
    assert energy.std() / energy.mean() == pytest.approx(math.sqrt(expected.energy_variance), rel=slack)
    assert place.std() == pytest.approx(expected.centroid_sigma, rel=slack)


def test_numbers_that_no_model_may_break() -> None:
    """Claim: the figures of the theory, C = 1/√2 for the energy and C = 1 for the centroid, 10 m (energy also 20 m).

    Expected: 8.7 and 10.4 % from C/√M; 1.27 and 4.7 µm as found by wave optics elsewhere. Tolerance: 8 % (what the
    pupil's edge takes off is 4 %). The 4.0 µm found elsewhere for random wavefronts are no such figure: they depend on
    the wavefronts' spectrum, which is not told, and 48 wavefronts of this bench give 4.66 ± 0.04 µm; what is claimed of
    those is the closed form, above.
    """
    for distance, contrast in ((10.0, 0.087), (20.0, 0.104)):
        found = math.sqrt(0.5 * spot("diffusion", distance).energy_variance)
        assert found == pytest.approx(contrast, rel=0.08)
    for kind, sigma in (("diffusion", 1.27e-6), ("defocus", 4.7e-6)):
        assert spot(kind, 10.0).centroid_sigma == pytest.approx(sigma, rel=0.08)


@cache
def _find(kind: str, distance: float, peak: str) -> tuple[Array, Array, Array]:
    """Return errors [m], z and status of the program's own peaks on lines of wave optics, C = 1/√2, of all places."""
    activate("cpu", None)
    import drjit as dr
    import drjit.auto.ad as auto

    from scanner_sim.config.scenario import Scenario
    from scanner_sim.detector.line.exposure import electrons_per_watt, expose, pairwise
    from scanner_sim.instrument.instrument import Instrument

    aberration = ABERRATIONS[kind]
    scenario = Scenario.model_validate(
        {
            "schema": 1,
            "scanner": {
                "receiver": {"aberration": aberration},
                "position_sensor": {
                    "diffusion": math.sqrt(BLUR**2 - aberration**2),
                    "noise": {"prnu": False},
                },
            },
            "scene": {
                "objects": [
                    {
                        "name": "plate",
                        "shape": "rectangle",
                        "size": [1.0, 1.0],
                        "material": {"reflectance": 0.5},
                    }
                ]
            },
            "scan": {
                "type": "raster",
                "rows": 2,
                "columns": 2,
                "horizontal": [-0.1, 0.1],
                "vertical": [-0.1, 0.1],
                "motion": "stepped",
            },
            "processing": {"peak": peak},
        }
    )
    bench, sensor = Instrument(scenario, device="cpu"), scenario.scanner.position_sensor
    _, _, lines = patterns(kind, distance)
    pixel = round(float(bench.triangulation.spot.pixel(distance, 0.0, 1.0)))
    first = pixel - round(PHASES[0])
    charge = 0.5 * bench.triangulation.spot.white / distance**2
    whole = np.zeros((lines.shape[0] * lines.shape[1], sensor.pixels), np.float32)
    kept = slice(max(first, 0), first + PIXELS)
    whole[:, kept] = (charge * lines.reshape(-1, PIXELS))[:, max(-first, 0) :]
    watts = electrons_per_watt(sensor, WAVELENGTH, scenario.scanner.dwell)
    table = auto.Float((whole / watts).ravel())
    shots = dr.arange(auto.UInt32, len(whole))
    signal = expose(
        pairwise(
            lambda pixel, place: dr.gather(
                auto.Float, table, place * sensor.pixels + pixel, pixel < sensor.pixels
            )
        ),
        shots,
        sensor,
        WAVELENGTH,
        scenario.scanner.dwell,
        3,
    )
    found = bench.triangulation.find(signal, np.zeros(len(whole), np.float32))
    truth = first + np.repeat(PHASES, lines.shape[1])
    error = (found.position.numpy() - truth) * PITCH
    return error, error / (found.sigma.numpy() * PITCH), found.status.numpy()


@pytest.mark.parametrize("distance", RANGES)
@pytest.mark.parametrize("kind", ABERRATIONS)
def test_sigma_is_true_on_lines_of_wave_optics(kind: str, distance: float) -> None:
    """Claim: the default estimator's σ is right on lines of wave optics with the sensor's noise.

    Set-up: 600 surfaces at three places in the pixel, C = 1/√2. Expected: a mean square of z of 1, 0.27 % beyond 3; all
    valid, but for spots that are refused for their shape. Tolerance: 20 % of the mean square (σ to 10 %) and 1 % beyond
    3 are the claim, to which chance adds what it does to 600 surfaces: the places share their speckle. Refused are 4 of
    1800 at most, where 18 are a chance of 1e-6; of random wavefronts, of which eight make all spots, 0.7 to 3.8 % in
    five drawings, 2.1 ± 1.5 %, and five of these beyond the mean are allowed.
    """
    _, z, status = _find(kind, distance, "maximum_likelihood")
    valid = status == 0
    assert valid.mean() > (0.904 if kind == "random" else 0.99)
    assert mean_square(z[valid], freedom=PATTERNS, slack=0.2)
    assert at_most(round(np.mean(np.abs(z[valid]) > 3.0) * PATTERNS), PATTERNS, 0.01)


@pytest.mark.parametrize("distance", RANGES)
@pytest.mark.parametrize("kind", ABERRATIONS)
def test_default_estimator_errs_as_little_as_the_centroid(kind: str, distance: float) -> None:
    """Claim: the fit errs as the centroid of the light does, and no less: flanks hold no speckle of their own.

    Set-up: as above. Expected: the closed form, C = 1/√2, and the sensor's noise. Tolerance: 10 % and what chance takes
    of 600 surfaces, 4.5/√1200 = 13 %; at 20 m read noise adds 0.5 µm in quadrature.
    """
    error, _, status = _find(kind, distance, "maximum_likelihood")
    expected = math.sqrt(0.5) * spot(kind, distance).centroid_sigma
    found = float(np.std(error[status == 0]))
    assert found / expected > 0.77
    assert found**2 < (1.23 * expected) ** 2 + (0.6e-6 if distance > 15.0 else 0.2e-6) ** 2


@pytest.mark.parametrize("distance", RANGES)
@pytest.mark.parametrize(
    ("peak", "kind"),
    [
        *((peak, kind) for peak in FEW_PIXELS for kind in ("diffusion", "preset")),
        ("blais_rioux_4", "defocus"),
        ("blais_rioux_8", "defocus"),
        ("blais_rioux_8", "random"),
    ],
)
def test_other_estimators_err_as_they_say(peak: str, kind: str, distance: float) -> None:
    """Claim: σ of the estimators of a few pixels is right too where diffusion makes most of the spot.

    Set-up: as above, each place in the pixel and each wavefront on its own: what they err systematically is no noise,
    and a lopsided wavefront moves all of its images alike, by up to 1.6 σ. Expected: variances of z of 1. Tolerance:
    30 % (σ to 15 %) is the claim, to which chance adds as above. With 40 µm of aberration, and no diffusion, the image
    of each surface is so coarse that few pixels miss what is between them: only estimators that see most of the spot
    are right there. ``centre_of_mass`` is left out: near a pixel's edge its window jumps, and σ is
    that of the mean place.
    """
    _, z, status = _find(kind, distance, peak)
    wavefronts = len(lenses(kind))
    for own in np.where(status == 0, z, np.nan).reshape(3, wavefronts, -1):
        scatter = own - np.nanmean(own, axis=1, keepdims=True)
        valid = scatter[~np.isnan(scatter)]
        assert mean_square(valid * math.sqrt(valid.size / (valid.size - wavefronts)), slack=0.3)


@cache
def moved(axis: int) -> tuple[Array, Array]:
    """Return energies and centroids [w] of a beam at 33 places over 4 w along an axis, shape (400, 33)."""
    sigma = image_sigma(10.0)
    step = CELL / 2.5
    places = np.zeros((33, 2))
    # Whole samples: the receiver's shift is then exact.
    places[:, axis] = np.rint(np.linspace(0.0, 8.0 * sigma, 33) / step) * step
    found = list(images(Lens(WAVELENGTH, F_NUMBER), (sigma, sigma), 400, 7, places=places))
    energy = np.array([image.profile.sum(axis=1) for image in found])
    return energy, np.array([centroid(image) for image in found]) / (2.0 * sigma)


@pytest.mark.parametrize("axis", [0, 1])
def test_travel_averages_energy_and_centroid_apart(axis: int) -> None:
    """Claim: a dwell's travel averages the centroid faster than the energy where it goes along the line, alike across.

    Set-up: wave optics without aberration, beams at 33 places over 2 w and 4 w, 400 surfaces. Expected: the program's
    law and the judge's integral, which agree to 10⁻³; energy 1.6 and 2.6 (1 + L/2w says 2 and 3), centroid along the
    line 4.1 and 16. Tolerance: 4.5 √2 √(2/400) = 45 % of chance if the two variances were independent, of which both
    have most in common at 2 w: 35 %.
    """
    energy, place = moved(axis)
    for travel, last in ((2.0, 17), (4.0, 33)):
        way = (travel, 0.0) if axis == 0 else (0.0, travel)
        expected = closed.averaged(way, 1.0)
        np.testing.assert_allclose(
            dwell_average(*(np.array([part]) for part in way), 1.0), np.c_[expected].reshape(2, 1), rtol=2e-3
        )
        # The mean of the dwell's light: centroids weigh by energy.
        weight = np.ones(last)
        weight[[0, -1]] = 0.5
        dwell = energy[:, :last] @ weight
        centre = ((energy * place)[:, :last] @ weight) / dwell
        assert energy.var() / energy.mean() ** 2 / (dwell.var() / dwell.mean() ** 2) == pytest.approx(
            1.0 / expected[0], rel=0.35
        )
        assert place.var() / centre.var() == pytest.approx(1.0 / expected[1], rel=0.35)


def test_neighbours_share_energy_and_oppose_in_place() -> None:
    """Claim: a beam that moves by w along the line keeps +0.37 of the energy's fluctuation and −0.37 of the centroid's.

    Set-up: as above. Expected: exp(−1) and (1 − 2) exp(−1); across the line +0.37 for both. Tolerance: 4.5 (1 −
    ρ²)/√(400 · 4), since 17 pairs of 400 surfaces hold about four independent ones, and 0.05 for the edge of the
    pupil: 0.15.
    """
    for axis, expected in ((0, -math.exp(-1.0)), (1, math.exp(-1.0))):
        energy, place = moved(axis)
        for values, wanted in ((energy, math.exp(-1.0)), (place, expected)):
            one, other = values[:, :-8].ravel(), values[:, 8:].ravel()
            assert np.corrcoef(one, other)[0, 1] == pytest.approx(wanted, abs=0.15)
