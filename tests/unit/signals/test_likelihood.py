"""The fit of the spot where it is hard: at the ends, with wide spots, without noise, and where there is none to fit."""

from __future__ import annotations

from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import PositionSensor

from scanner_sim.analytic import spot
from scanner_sim.detector.line.exposure import electrons_per_watt, expose, pairwise
from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.foundation.status import Status
from scanner_sim.optics.line_image import sharp_everywhere
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.likelihood import inverse_of
from scanner_sim.signals.line.peaks import Peaks, find_peaks
from scanner_sim.signals.processing import Processing, Validation

PIXELS, PITCH = 64, 50e-6
BARE = Validation(background=False, shape=False, misfit=0.0, max_reflectance=None)
SILENT = dict.fromkeys(NoiseSwitches.model_fields, False)

pytestmark = pytest.mark.usefixtures("device")


def fitted(lines: NDArray[np.float64], sigma: float | None, *switched_on: str) -> Peaks:
    """Fit lines of charges [electron], shape (m, pixels), with a spot of a known width, or of none."""
    noise = NoiseSwitches(**(SILENT | dict.fromkeys(switched_on, True)))
    sensor = PositionSensor(pixels=PIXELS, gain=1.0, adc_bits=24, full_well=1e9, noise=noise)
    table = auto.Float((lines / electrons_per_watt(sensor, 1.5e-6, 50e-6)).astype(np.float32).ravel())

    def power(pixel: Any, place: Any) -> Any:
        return dr.gather(auto.Float, table, place * PIXELS + pixel)

    signal = expose(pairwise(power), dr.arange(auto.UInt32, len(lines)), sensor, 1.5e-6, 50e-6, 1)
    known = None
    if sigma is not None:
        known = ExpectedSpot(
            sharp_everywhere(0.1), 0.2, 1e-9, 0.0, 1e3, sigma * PITCH, 0.0, PITCH, 0.0, PIXELS, 1e12
        )
    processing = Processing(peak="maximum_likelihood", ambiguity=1.0, validation=BARE)
    return find_peaks(signal, sensor, processing, 50e-6, known)


def lines(centres: NDArray[np.float64], sigma: float, charge: float = 1e6) -> NDArray[np.float64]:
    return charge * spot.pixel_shares(centres, np.full_like(centres, sigma), PIXELS)


@pytest.mark.parametrize("sigma", [0.4, 1.0, 2.5, 6.0])
def test_narrow_and_wide_spots_without_noise(sigma: float) -> None:
    centres = np.linspace(30.0, 31.0, 21)
    peaks = fitted(lines(centres, sigma), sigma)
    np.testing.assert_allclose(peaks.position.numpy(), centres, rtol=0.0, atol=2e-4)


@pytest.mark.parametrize("sigma", [0.8, 1.5, 3.0])
def test_a_width_of_which_nothing_is_known_is_fitted(sigma: float) -> None:
    centres = np.linspace(30.0, 31.0, 21)
    peaks = fitted(lines(centres, sigma), None)
    valid = peaks.status.numpy() == Status.VALID
    assert valid.all()
    np.testing.assert_allclose(peaks.position.numpy(), centres, rtol=0.0, atol=2e-3)


def test_a_wrong_width_hardly_moves_the_fit() -> None:
    """Claim: a spot 20 % narrower or wider than known to 0.5 % is found within 0.001 px, by the symmetry of the fit.

    Of 10⁸ electrons noise leaves 1.4·10⁻⁴ px, so that the bound is seven σ of it.
    """
    centres = np.linspace(30.0, 31.0, 21)
    for sigma in (0.8, 1.2):
        peaks = fitted(lines(centres, sigma, 1e8), 1.0, "shot", "read")
        assert np.abs(peaks.position.numpy() - centres).max() < 1e-3


def test_spots_near_the_ends_are_fitted_with_the_pixels_there_are() -> None:
    centres = np.array([2.0, 2.4, 3.3, 60.2, 60.9])
    peaks = fitted(lines(centres, 1.2), 1.2)
    np.testing.assert_allclose(peaks.position.numpy(), centres, rtol=0.0, atol=2e-4)
    beyond = fitted(lines(np.array([0.3, 62.8]), 1.2), 1.2)
    assert (beyond.status.numpy() == Status.OUT_OF_ARRAY).all()


def test_fits_that_do_not_come_to_rest_are_refused() -> None:
    """Without the test of shape lines of unrelated charges still do not all get a position, and real spots do."""
    rng = np.random.default_rng(0)
    jumble = 1e5 * rng.random((500, PIXELS)) ** 3
    brightest = jumble.argmax(axis=1)
    jumble[np.arange(500), brightest] *= 1.1  # so that noise does not choose between equals
    peaks = fitted(jumble, 1.0, "shot", "read")
    status, position = peaks.status.numpy(), peaks.position.numpy()
    assert (status == Status.BAD_SHAPE).mean() > 0.05
    valid = status == Status.VALID
    assert np.isfinite(peaks.sigma.numpy()[valid]).all()
    assert (np.abs(position - brightest)[valid] <= 4.0).all()
    spots = fitted(lines(rng.uniform(20.0, 40.0, 500), 1.0, 1e5), 1.0, "shot", "read")
    assert (spots.status.numpy() == Status.VALID).all()


def test_a_line_without_a_peak_has_no_position() -> None:
    peaks = fitted(np.full((4, PIXELS), 5.0), 1.0, "read")
    assert (peaks.status.numpy() == Status.BELOW_THRESHOLD).all()
    assert np.isnan(peaks.position.numpy()).all()


@pytest.mark.parametrize("apart", [0.3, 0.1, 0.03])
def test_parameters_that_go_together_have_their_inverse(apart: float) -> None:
    """Claim: of a matrix whose diagonal made 1 has a determinant down to 1e-3, to what is left of single precision."""
    rows = np.array([[1.0, 0.2, -0.4], [1.0, 0.2 + apart, -0.4], [0.3, 0.5, 1.0]])
    matrix = rows @ rows.T
    entries = [auto.Float([float(matrix[i, j])]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    found = np.array([[entry.numpy()[0] for entry in row] for row in inverse_of(entries)])
    size = np.sqrt(np.diag(matrix))
    determinant = np.linalg.det(matrix / np.outer(size, size))
    assert 5e-4 < determinant < 0.1
    wanted = np.linalg.inv(matrix)
    np.testing.assert_allclose(found, wanted, atol=1e-6 / determinant * np.abs(wanted).max())
