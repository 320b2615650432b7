"""The second exposure without the laser, piece by piece."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Laser, PositionSensor, Receiver
from pydantic import ValidationError

from scanner_sim import load_scenario, simulate
from scanner_sim.analytic import spot
from scanner_sim.config.scanner import Scanner
from scanner_sim.detector.line.exposure import electrons_per_watt, expose, pairwise
from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.simulate import simulate_voxel
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.peaks import Peaks, faintest_signal, find_peaks
from scanner_sim.signals.processing import Processing, Validation

DWELL = 50e-6
SILENT = dict.fromkeys(NoiseSwitches.model_fields, False)
# Told of noise, given none: every outcome is exact.
TOLD = PositionSensor(dark_current=0.0, adc_bits=24, gain=4.0)
QUIET = TOLD.model_copy(update={"noise": NoiseSwitches(**{**SILENT, "saturation": True})})
WELL = TOLD.full_well

Array = NDArray[np.float64]


def spot_known(laser_off: float) -> ExpectedSpot:
    return ExpectedSpot.of(Laser(), Receiver(), 1.0, TOLD, (1.0 - laser_off) * DWELL)


def laser(centre: float, reflectance: float = 0.5) -> Array:
    """Return the line of a facing surface whose spot lies at a place [electron of a whole dwell]."""
    known = spot_known(0.0)
    charge = reflectance * known.white / known.range(centre, 0.0, 1.0) ** 2
    return charge * spot.pixel_shares(centre, np.sqrt(sum(known.variances(centre, 0.0, 1.0))), 256)


def block(first: int, last: int, charge: float) -> Array:
    """Return a line with a charge on some pixels."""
    line = np.zeros(256)
    line[first : last + 1] = charge
    return line


def peaks_of(light: Array, ambient: Array, laser_off: float, processing: Processing | None = None) -> Peaks:
    """Return the peaks of noise-free lines of laser and ambient light [electron of a whole dwell]."""
    scale = electrons_per_watt(QUIET, 1.5e-6, DWELL)

    def power(line: Array) -> Any:
        table = auto.Float((np.atleast_2d(line) / scale).astype(np.float32).ravel())
        return lambda pixel, place: dr.gather(auto.Float, table, place * 256 + pixel)

    signal = expose(
        pairwise(power(light + ambient)),
        dr.arange(auto.UInt32, len(np.atleast_2d(light))),
        QUIET,
        1.5e-6,
        DWELL,
        1,
        background=pairwise(power(ambient)),
        laser_off=laser_off,
    )
    settings = Processing() if processing is None else processing
    return find_peaks(signal, TOLD, settings, DWELL, spot_known(laser_off))


@pytest.mark.usefixtures("device")
class TestLines:
    @pytest.mark.parametrize("background", [True, False])
    @pytest.mark.parametrize("laser_off", [0.0, 0.5])
    def test_the_faintest_spots_that_are_found(self, laser_off: float, background: bool) -> None:
        """Claim: of spots in the middle of a pixel, 2 % more light than the faintest has a peak and 2 % less has none,
        by the σ that a line without light states and the spot's own width, for thresholds of 4 to 12."""
        known = spot_known(0.0)
        centre = 30.0
        width = np.sqrt(sum(known.variances(centre, 0.0, 1.0)))
        shape = laser(centre) / laser(centre).sum()
        for threshold in (4.0, 6.0, 12.0):
            validation = Validation(background=background, min_reflectance=0.0)
            settings = Processing(threshold=threshold, validation=validation)
            # So little light that it tells where the nine pixels lie, and nothing else.
            dark = peaks_of(400.0 * shape, 0.0 * shape, laser_off, settings)
            assert int(dark.status.numpy()[0]) == Status.BELOW_THRESHOLD
            faintest = faintest_signal(dark.sigma_signal.numpy().astype(float), np.array([width]), settings)
            light = shape * faintest / (1.0 - laser_off)
            found = peaks_of(np.outer([0.98, 1.02], light), np.zeros((2, 256)), laser_off, settings)
            assert found.status.numpy().tolist() == [Status.BELOW_THRESHOLD, Status.VALID]

    @pytest.mark.parametrize("laser_off", [0.1, 0.5, 0.9])
    def test_ambient_light_of_any_shape_goes(self, laser_off: float) -> None:
        """The peak stands where it does in the dark, with the same charge; only σ knows of the light."""
        rng = np.random.default_rng(1)
        ambient = rng.uniform(2e7, 4e7, 256)
        dark, lit = (peaks_of(laser(60.3), light, laser_off) for light in (0.0 * ambient, ambient))
        assert lit.status.numpy() == Status.VALID
        assert lit.position.numpy() == pytest.approx(dark.position.numpy(), abs=1e-3)
        assert lit.signal.numpy() == pytest.approx((1.0 - laser_off) * laser(60.3).sum(), rel=2e-3)
        assert lit.sigma.numpy() > 1.2 * dark.sigma.numpy()

    def test_sigma_in_the_dark_follows_the_noise_of_both(self) -> None:
        """Read-limited: half the charge and √2 the read noise make σ 2√2 times as large."""
        faint = laser(60.3, 0.02)
        settings = Processing(validation=Validation(misfit=0.0))
        always, half = (peaks_of(faint, 0.0 * faint, off, settings).sigma.numpy() for off in (0.0, 0.5))
        assert half / always == pytest.approx(2.0 * np.sqrt(2.0), rel=0.05)

    @pytest.mark.parametrize(
        ("light", "ambient", "laser_off", "status"),
        [
            # The laser itself fills the well.
            (laser(60.0, 100.0), 0.0 * laser(60.0), 0.5, Status.SATURATED),
            # Both exposures are full beneath the spot, or the one without the laser alone.
            (laser(60.0), block(50, 70, 5.0 * WELL), 0.5, Status.SATURATED),
            (laser(60.0), block(50, 70, 1.5 * WELL), 0.8, Status.SATURATED),
            # Full elsewhere: the spot is measured.
            (laser(60.0), block(150, 170, 5.0 * WELL), 0.5, Status.VALID),
            (laser(60.0), block(150, 153, 1.5 * WELL), 0.8, Status.VALID),
            (laser(60.0), block(150, 153, 1.5 * WELL), 0.2, Status.VALID),
            # Full and no spot.
            (0.0 * laser(60.0), block(150, 153, 5.0 * WELL), 0.5, Status.SATURATED),
            (0.0 * laser(60.0), block(150, 150, 1.5 * WELL), 0.8, Status.SATURATED),
            # A glint of the laser's shape, brighter than the laser.
            (laser(60.0), 3.0 * laser(90.0), 0.5, Status.VALID),
            (0.0 * laser(60.0), laser(90.0), 0.5, Status.BELOW_THRESHOLD),
        ],
    )
    def test_status(self, light: Array, ambient: Array, laser_off: float, status: Status) -> None:
        assert Status(int(peaks_of(light, ambient, laser_off).status.numpy()[0])) is status

    def test_the_brightest_pixel_alone_knows_it_too(self) -> None:
        """Without search and baseline the subtraction stands."""
        plain = Processing(validation=Validation(background=False, shape=False, misfit=0.0))
        found = peaks_of(laser(60.3), block(100, 200, 1e7), 0.5, plain)
        assert found.position.numpy() == pytest.approx(60.3, abs=0.01)

    def test_an_odd_number_of_pixels(self) -> None:
        odd = QUIET.model_copy(update={"pixels": 9, "noise": NoiseSwitches(**SILENT)})
        scale = electrons_per_watt(odd, 1.5e-6, DWELL)
        shots = dr.arange(auto.UInt32, 70)

        def power(pixel: Any, place: Any) -> Any:
            return (100.0 * auto.Float(place) + auto.Float(pixel)) * (1e3 / scale)

        signal = expose(
            pairwise(power),
            shots,
            odd,
            1.5e-6,
            DWELL,
            1,
            background=pairwise(lambda p, s: 2.0 * power(p, s)),
            laser_off=0.25,
        )
        number = (1e3 * (100.0 * np.arange(70)[:, None] + np.arange(9))) / 4.0
        np.testing.assert_allclose(signal.lines(0) - odd.bias, 0.75 * number, atol=0.1)
        np.testing.assert_allclose(signal.lines(1) - odd.bias, 0.5 * number, atol=0.1)

    def test_a_short_second_exposure_is_one(self) -> None:
        """Claim: of a fiftieth of the dwell a fiftieth of the background is read."""
        scale = electrons_per_watt(QUIET, 1.5e-6, DWELL)
        nothing, even = (
            pairwise(lambda p, s: 0.0 * auto.Float(p + s)),
            pairwise(lambda p, s: auto.Float(5e5 / scale)),
        )
        shots = dr.arange(auto.UInt32, 3)
        signal = expose(nothing, shots, QUIET, 1.5e-6, DWELL, 1, background=even, laser_off=0.02)
        assert signal.exposures == 2
        np.testing.assert_allclose(
            (signal.lines(1) - QUIET.bias) * QUIET.electrons_per_number, 0.02 * 5e5, rtol=1e-3
        )

    def test_the_second_exposure_needs_its_light(self) -> None:
        shots = dr.arange(auto.UInt32, 1)
        with pytest.raises(ValueError, match="background"):
            expose(
                pairwise(lambda pixel, place: auto.Float(pixel)),
                shots,
                QUIET,
                1.5e-6,
                DWELL,
                1,
                laser_off=0.5,
            )


@pytest.mark.parametrize("share", [-0.1, 0.95])
def test_the_share_is_bounded(share: float) -> None:
    with pytest.raises(ValidationError):
        Scanner(laser_off=share)


def test_the_laser_shines_for_the_rest_of_the_dwell() -> None:
    assert Scanner(laser_off=0.25, rate=1e4).exposure == pytest.approx(75e-6)
    assert Scanner().exposure == Scanner().dwell


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_any_batch_and_a_voxel_alone(repo_root: Path) -> None:
    """The noise of the second exposure has an address of its own, as all noise has."""
    changes = ["scan.rows=6", "scan.columns=7", "scanner.laser_off=0.5", "transport.background_samples=2"]
    scenario = load_scenario(repo_root / "configs" / "lighting_normal.yaml", changes)
    image, split = (simulate(scenario, device="cpu", batch=batch) for batch in (1000, 5))
    assert all(image[name].tobytes() == split[name].tobytes() for name in image.channels)
    row, column = (int(place[0]) for place in np.nonzero(image.valid))
    record = simulate_voxel(scenario, row, column, device="cpu")
    np.testing.assert_array_equal(np.float32(record.range_m), image["range_m"][row, column])
    residual = (record.pixel_signal - record.expected_signal) / record.noise_sigma
    assert np.abs(residual).max() < 6.0
