"""The expected spot, the search, the baseline and the neighbours, piece by piece."""

from __future__ import annotations

from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Laser, PositionSensor, Receiver
from pydantic import ValidationError
from scipy.stats import norm

from scanner_sim.analytic import beam, spot
from scanner_sim.analytic.estimators import blais_rioux
from scanner_sim.detector.line.exposure import electrons_per_watt, expose, pairwise
from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.foundation.status import Status
from scanner_sim.ranging.neighbours import is_isolated
from scanner_sim.signals.line import peaks, validation
from scanner_sim.signals.line.dark_line import DarkLine
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.peaks import Peaks, find_peaks
from scanner_sim.signals.line.validation import SpotFit, farthest_pixel, guard_pixels
from scanner_sim.signals.processing import PeakMethod, Processing, Validation

DWELL = 50e-6
SILENT = dict.fromkeys(NoiseSwitches.model_fields, False)
# Told of noise, given none: every outcome is exact.
TOLD = PositionSensor(dark_current=0.0, adc_bits=24, gain=4.0)
QUIET = TOLD.model_copy(update={"noise": NoiseSwitches(**{**SILENT, "saturation": True})})
SPOT = ExpectedSpot.of(Laser(), Receiver(), 1.0, TOLD, DWELL)

Array = NDArray[np.float64]


def peaks_of(
    lines: Array,
    processing: Processing | None = None,
    known: ExpectedSpot | None = SPOT,
    sensors: tuple[PositionSensor, PositionSensor] = (QUIET, TOLD),
) -> Peaks:
    """Return the peaks of noise-free lines [electron], shape (m, 256), of a sensor and what is believed of it."""
    sensor, told = sensors
    table = auto.Float((lines / electrons_per_watt(sensor, 1.5e-6, DWELL)).astype(np.float32).ravel())
    signal = expose(
        pairwise(lambda pixel, place: dr.gather(auto.Float, table, place * 256 + pixel)),
        dr.arange(auto.UInt32, len(lines)),
        sensor,
        1.5e-6,
        DWELL,
        1,
    )
    return find_peaks(signal, told, Processing() if processing is None else processing, DWELL, known)


def laser(centre: float, reflectance: float = 0.5) -> Array:
    """Return the line of a facing surface whose spot lies at a place."""
    variance, spread = SPOT.variances(centre, 0.0, 1.0)
    charge = reflectance * SPOT.white / SPOT.range(centre, 0.0, 1.0) ** 2
    return charge * spot.pixel_shares(centre, np.sqrt(variance + spread), 256)


def edge(place: float, step: float) -> Array:
    """Return a line that rises at a place."""
    return step * spot.pixel_shares(np.arange(place, 300.0, 0.05), 0.8, 256).sum(0) * 0.05


def one(line: Array, **settings: Any) -> Status:
    """Return the status of one line."""
    processing = Processing(validation=Validation(**settings))
    return Status(int(peaks_of(line[None], processing).status.numpy()[0]))


@pytest.mark.parametrize("theta", [-0.4, 0.0, 0.4])
@pytest.mark.parametrize("distance", [1.8, 10.0, 25.0])
def test_the_spot_is_the_judges(theta: float, distance: float) -> None:
    """Width and charge at a place equal those that the judge finds on a facing white plane at its range."""
    place = spot.spot_image(
        theta,
        0.0,
        0.1,
        0.2,
        0.05,
        np.array([np.sin(theta), 0.0, np.cos(theta)]) * distance,
        np.array([np.sin(theta), 0.0, np.cos(theta)]),
        0.5 * float(beam.beam_radius(distance, 2e-3, 0.0, 1.5e-6)),
        0.0,
        np.hypot(12e-6, 38.2e-6),
    )
    pixel = place.chief / 50e-6 - 0.5
    assert SPOT.range(pixel, np.sin(theta), np.cos(theta)) == pytest.approx(distance, rel=1e-9)
    width = np.sqrt(sum(SPOT.variances(pixel, np.sin(theta), np.cos(theta)))) * 50e-6
    assert width == pytest.approx(place.sigma, rel=1e-6)
    area = 0.5 * np.pi / 4.0 * 25e-3**2
    printed = spot.laser_power_printed(distance, 15e-3, 1.0, area)
    charge = float(spot.electrons(printed, DWELL, 1.5e-6, 0.8))
    assert SPOT.white / distance**2 == pytest.approx(charge, rel=1e-6)


@pytest.mark.usefixtures("device")
class TestLines:
    def test_a_spot_beats_a_brighter_edge(self) -> None:
        """The brightest pixel lies on the lit side; the spot in the shadow has the range."""
        line = laser(60.3) + edge(120.0, 1.5 * laser(60.3).max())
        found = peaks_of(line[None])
        assert found.status.numpy() == Status.VALID
        assert found.position.numpy() == pytest.approx(60.3, abs=0.01)
        off = Validation(background=False, shape=False, misfit=0.0)
        assert peaks_of(line[None], Processing(validation=off)).position.numpy() != pytest.approx(60.3, abs=9)

    @pytest.mark.parametrize("method", ["gaussian", "parabola", "centre_of_mass", "blais_rioux_4"])
    def test_an_even_and_a_sloping_background_do_not_move_the_peak(self, method: PeakMethod) -> None:
        line = laser(60.3)
        slope = line.max() * (0.5 + 0.002 * np.arange(256))
        quiet, lit, sloping = peaks_of(
            np.array([line, line + line.max(), line + slope]), Processing(peak=method)
        ).position.numpy()
        assert lit == pytest.approx(quiet, abs=2e-4)
        assert sloping == pytest.approx(quiet, abs=2e-4)

    def test_the_background_is_reported(self) -> None:
        found = peaks_of((laser(60.3) + 12345.0)[None])
        assert found.background.numpy() == pytest.approx(12345.0, rel=1e-3)
        assert found.signal.numpy() == pytest.approx(laser(60.3).sum(), rel=1e-3)

    def test_the_line_beneath_adds_the_noise_of_its_slope(self) -> None:
        """Claim: (Σg)² var(level) + (Σ g k)² var(slope), with the gradient g of the estimator at the pixels k.

        Medians of seven normal numbers have 0.2104 of their variance: the mean of both sides half of it, their
        difference over its distance twice. Faint light, so that all pixels have the noise of the dark.
        """
        line = 1e-3 * laser(60.3, 0.01)
        plain = {"shape": False, "misfit": 0.0, "max_reflectance": None, "min_reflectance": 0.0}
        found = [
            peaks_of(
                line[None],
                Processing(
                    peak="blais_rioux_8",
                    threshold=1e-4,
                    validation=Validation(background=background, **plain),
                ),
            )
            for background in (True, False)
        ]
        on, off = (float(one.sigma.numpy()[0]) for one in found)
        step = 1e-4 * line.max()
        gains = np.array(
            [
                (blais_rioux((line + move).tolist(), 4) - blais_rioux((line - move).tolist(), 4))
                / (2.0 * step)
                for move in step * np.eye(256)
            ]
        )
        beam, spread = SPOT.variances(60.0, 0.0, 1.0)
        apart = 2.0 * (np.ceil(4.0 * np.sqrt(beam + spread)) + 4.0)
        floor = TOLD.read_noise**2 + TOLD.electrons_per_number**2 / 12.0
        level, slope = 0.5 * 0.2104 * floor, 2.0 * 0.2104 * floor / apart**2
        beside = (gains.sum() ** 2 * level, (gains @ (np.arange(256) - 60.0)) ** 2 * slope)
        assert beside[0] == 0.0  # its taps cancel
        assert beside[1] > 0.05 * off**2
        assert off**2 == pytest.approx(np.sum(gains**2) * floor, rel=0.02)
        assert on**2 - off**2 == pytest.approx(sum(beside), rel=0.05)

    def test_an_outlier_beside_the_peak_does_not_move_the_baseline(self) -> None:
        line = laser(60.3)
        line[67:69] += 0.2 * line.max()
        assert peaks_of(line[None]).background.numpy() == pytest.approx(0.0, abs=10.0)

    def test_the_background_adds_its_noise_to_sigma(self) -> None:
        """Shot noise and fixed pattern of the light beneath the spot are those of the whole charge."""
        line = laser(60.3, 0.01)
        dark, lit = peaks_of(np.array([line, line + 4e5])).sigma.numpy()
        floor, prnu = TOLD.read_noise**2, TOLD.prnu
        expected = np.sqrt((4e5 + (prnu * 4e5) ** 2 + floor) / floor)
        assert lit / dark == pytest.approx(expected, rel=0.15)

    @pytest.mark.parametrize(
        ("line", "status"),
        [
            (laser(60.0), Status.VALID),
            (laser(30.0, 20.0), Status.VALID),
            (laser(30.0, 40.0), Status.BAD_AMPLITUDE),
            (laser(60.0, 200.0), Status.SATURATED),
            (3.0 * laser(60.0).sum() * spot.pixel_shares(60.0, 3.0, 256), Status.BAD_SHAPE),
            (laser(180.0).sum() * spot.pixel_shares(180.0, 0.8, 256), Status.BAD_SHAPE),
            (laser(60.0) + 0.8 * laser(64.0), Status.BAD_SHAPE),
            (laser(60.0) + 0.8 * laser(80.0), Status.AMBIGUOUS),
            (laser(60.0) + 0.2 * laser(80.0), Status.VALID),
            (laser(60.0, 5.0) + laser(80.0, 0.1), Status.AMBIGUOUS),
            (laser(60.0) + laser(60.0).sum() * spot.pixel_shares(150.0, 4.0, 256), Status.VALID),
            (laser(60.0, 0.04) + laser(200.0, 0.002), Status.VALID),
            (laser(60.0, 0.04) + laser(200.0, 0.006), Status.AMBIGUOUS),
            (laser(200.0, 0.002), Status.BELOW_THRESHOLD),
            (edge(100.0, 1e7), Status.BELOW_THRESHOLD),
            (edge(100.0, 1e9) - edge(118.0, 1e9), Status.SATURATED),
            (np.zeros(256), Status.BELOW_THRESHOLD),
        ],
    )
    def test_every_refusal(self, line: Array, status: Status) -> None:
        assert one(line) is status

    @pytest.mark.parametrize("reflectance", [0.01, 0.5, 5.0])
    @pytest.mark.parametrize("beneath", [0.0, 4e5])
    def test_a_peak_stands_over_the_noise_of_its_brightest_pixel(
        self, reflectance: float, beneath: float
    ) -> None:
        """Claim: the ratio is that of its height to σ of the pixel's whole charge, by electronics, photons and PRNU."""
        line = laser(60.0, reflectance)
        height, whole = line.max(), line.max() + beneath
        noise = np.sqrt(TOLD.read_noise**2 + whole + (TOLD.prnu * whole) ** 2)
        assert peaks_of((line + beneath)[None]).snr.numpy()[0] == pytest.approx(height / noise, rel=1e-4)

    @pytest.mark.parametrize("wide", [3.0, 5.0, 8.0])
    @pytest.mark.parametrize("height", [0.5, 3.0, 10.0])
    def test_what_no_spot_can_be_is_no_matter_of_the_spot(self, wide: float, height: float) -> None:
        """Claim: a bump too broad for a spot, or a peak brighter than any surface at its range, is refused where it is
        alone, and beside a spot that is found, however much it stands out."""
        line, bump = laser(60.3), spot.pixel_shares(180.0, wide, 256)
        bump = height * line.max() * bump / bump.max()
        assert one(bump) is Status.BAD_SHAPE
        found = peaks_of(np.stack([line + bump, line + 20.0 * height * laser(180.0)]))
        assert (found.status.numpy() == Status.VALID).all()
        np.testing.assert_allclose(found.position.numpy(), 60.3, atol=0.02)

    @pytest.mark.parametrize(("level", "status"), [(0.9, Status.BELOW_THRESHOLD), (1.1, Status.SATURATED)])
    @pytest.mark.parametrize("dark", [0.0, 0.3])
    def test_an_even_line_is_full_with_its_dark_charge(
        self, dark: float, level: float, status: Status
    ) -> None:
        """Claim: pixels are full at the well's charge, of which the dark charge is a part and not light; where there is
        no peak, neither signal nor background is told."""
        warm = {"dark_current": dark * TOLD.full_well / DWELL}
        lines = np.full((1, 256), level * TOLD.full_well)
        told = TOLD.model_copy(update=warm)
        found = peaks_of(lines, sensors=(QUIET.model_copy(update=warm), told))
        assert found.status.numpy()[0] == status
        assert (found.signal.numpy()[0], found.background.numpy()[0]) == (0.0, 0.0)

    def test_the_sun_beside_the_spot_leaves_it_valid(self) -> None:
        """A saturated stretch wider than a spot is not the laser, and the spot elsewhere is measured."""
        line = laser(60.3) + edge(150.0, 1e9) - edge(170.0, 1e9)
        found = peaks_of(line[None])
        assert found.status.numpy() == Status.VALID
        assert found.position.numpy() == pytest.approx(60.3, abs=0.01)

    @pytest.mark.parametrize(
        ("line", "off"),
        [
            (laser(30.0, 20.0), {"max_reflectance": 10.0}),
            (laser(180.0).sum() * spot.pixel_shares(180.0, 0.8, 256), {}),
        ],
    )
    def test_every_test_can_be_switched_off(self, line: Array, off: dict[str, Any]) -> None:
        assert one(line, **off) is not Status.VALID
        assert one(line, shape=False, max_reflectance=None) is Status.VALID

    def test_misfit_widens_sigma(self) -> None:
        """A glint on the spot's flank moves it; σ says so unless it is told to trust the shape."""
        line = laser(60.3) + 0.03 * laser(60.3).sum() * spot.pixel_shares(63.0, 0.8, 256)
        aware, trusting = (
            peaks_of(line[None], Processing(validation=Validation(misfit=misfit))) for misfit in (1.0, 0.0)
        )
        error = abs(aware.position.numpy()[0] - 60.3)
        assert error > 6.0 * trusting.sigma.numpy()[0]
        assert error < 6.0 * aware.sigma.numpy()[0]

    def test_a_misfit_adds_its_share(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Claim: σ² grows by the square of what the setting makes of the misfit [pixel]; a shape that does not fit is
        told unless shapes are not asked."""
        told = SpotFit(auto.Bool(False), auto.Float(2e4), auto.Float(0.03), auto.Bool(False))
        monkeypatch.setattr(peaks, "judge_shape", lambda *_: told)
        assert one(laser(60.3), background=False) is Status.BAD_SHAPE
        settings = [Validation(misfit=misfit, shape=False) for misfit in (0.0, 0.7, 2.0)]
        found = [peaks_of(laser(60.3)[None], Processing(validation=own)) for own in settings]
        bare, *more = (float(of.sigma.numpy()[0]) ** 2 for of in found)
        assert [of - bare for of in more] == pytest.approx([0.021**2, 0.06**2], rel=1e-4)

    @pytest.mark.parametrize("place", [58.0, 60.0, 60.3, 61.0, 65.0])
    def test_an_edge_beneath_the_spot_widens_sigma(self, place: float) -> None:
        """What the sides differ by may be an edge anywhere between them; with or without what the shape shows."""
        line = laser(60.3) + edge(place, 0.2 * laser(60.3).max())
        for misfit in (1.0, 0.0):
            found = peaks_of(line[None], Processing(validation=Validation(misfit=misfit)))
            assert abs(found.position.numpy()[0] - 60.3) < 6.0 * found.sigma.numpy()[0]

    @pytest.mark.parametrize(("step", "widens"), [(0.05, True), (0.2, False)])
    def test_misfit_is_what_an_edge_leaves_unexplained(self, step: float, widens: bool) -> None:
        """A glint's residuals, 3 % of the height, widen σ upon an edge of 5 % (D/√12 = 1.4 %), not upon one of 20 %."""
        height = laser(60.3).max()
        line = laser(60.3) + 0.05 * laser(60.3).sum() * spot.pixel_shares(63.0, 0.8, 256)
        line += edge(56.0, step * height)
        sigma = [
            peaks_of(line[None], Processing(validation=Validation(misfit=misfit))).sigma.numpy()[0]
            for misfit in (1.0, 0.0)
        ]
        assert (sigma[0] > 1.2 * sigma[1]) == widens

    @pytest.mark.parametrize("centre", [60.3, 150.2])
    def test_light_beside_the_pixels_that_a_spot_covers_is_no_misfit(self, centre: float) -> None:
        """Claim: a glint widens σ on the last pixel that the spot covers, and on none of those beyond that are read."""
        middle, line = round(centre), laser(centre)
        covered = int(guard_pixels(SPOT, auto.Int32(middle), auto.Float(0.0), auto.Float(1.0)).numpy()[0])
        steps = np.arange(covered, farthest_pixel(SPOT) + 1)
        lines = np.repeat(line[None], len(steps) + 1, axis=0)
        lines[np.arange(1, len(lines)), middle + steps] += 0.05 * line.max()
        found = peaks_of(lines, Processing(validation=Validation(background=False)))
        assert (found.status.numpy() == Status.VALID).all()
        alone, on_the_spot, *beside = found.sigma.numpy()
        assert on_the_spot > 5.0 * alone
        assert len(beside) >= 2
        np.testing.assert_allclose(beside, alone, rtol=1e-5)

    @pytest.mark.parametrize("place", [2.0, 4.0, 8.0, 250.0])
    def test_near_the_ends_of_the_array(self, place: float) -> None:
        """One side alone gives the baseline where the other leaves the array."""
        # At the far end no surface is bright enough; the amplitude is not what is asked here.
        strong = 1e6 * spot.pixel_shares(place, np.sqrt(sum(SPOT.variances(place, 0.0, 1.0))), 256)
        found = peaks_of((strong + 5e4)[None], Processing(validation=Validation(max_reflectance=None)))
        assert found.status.numpy() == Status.VALID
        assert found.position.numpy() == pytest.approx(place, abs=0.02)
        assert found.background.numpy() == pytest.approx(5e4, rel=0.01)

    def test_without_knowledge_of_the_spot_the_brightest_pixel_wins(self) -> None:
        line = laser(60.3) + 2.0 * laser(180.0).sum() * spot.pixel_shares(90.0, 5.0, 256)
        assert peaks_of(line[None], known=None).status.numpy() == Status.VALID

    def test_a_wide_beam(self) -> None:
        """A beam of 12 mm is found as what it is, and only as that."""
        known = ExpectedSpot.of(Laser(waist_radius=6e-3), Receiver(), 1.0, TOLD, DWELL)
        width = float(np.sqrt(sum(known.variances(150.0, 0.0, 1.0))))
        line = 2e7 * spot.pixel_shares(150.2, width, 256)
        found = peaks_of(line[None], known=known)
        assert found.status.numpy() == Status.VALID
        assert found.position.numpy() == pytest.approx(150.2, abs=0.02)
        assert peaks_of(line[None]).status.numpy() == Status.BAD_SHAPE


@pytest.mark.usefixtures("device")
def test_a_dark_line_grants_what_the_beams_own_sweep_smears() -> None:
    """Claim: on a plane of 50° the range runs R tan 50° times as far as the beam turns, and the spot is the mean of all
    that it is meanwhile; of a beam that turns so it is valid, where the whole line has it, and of one at rest too wide.

    By 20 mrad its variance is 1.2 times the largest of a beam at rest, and 0.7 times what a plane of 60° is granted.
    """
    turned, distance = 20e-3, 2.5
    ranges = distance * (1.0 + turned * np.tan(np.deg2rad(50.0)) * np.linspace(-0.5, 0.5, 41))
    line = np.mean([laser(SPOT.pixel(one, 0.0, 1.0)) for one in ranges], axis=0)
    middle = float(SPOT.pixel(distance, 0.0, 1.0))
    table = auto.Float((line / electrons_per_watt(QUIET, 1.5e-6, DWELL)).astype(np.float32))
    dark = DarkLine.of(TOLD, Processing(), DWELL, SPOT, None)
    assert dark is not None
    ends = auto.Float([middle - 12.0]), auto.Float([middle + 12.0]), auto.Float([line.sum()])

    def read(sweep: float) -> Peaks:
        white = auto.Float([SPOT.white]), auto.Float([SPOT.white_by_pixel]), auto.Float([sweep])
        light = pairwise(lambda pixel, _: dr.gather(auto.Float, table, pixel))
        shot = dr.arange(auto.UInt32, 1)
        return dark.read(
            lambda window, onto: expose(light, shot, QUIET, 1.5e-6, DWELL, 1, window=window, onto=onto),
            ends, auto.Float([0.0]), None, white,
        )[1]  # fmt: skip

    whole = peaks_of(line[None], known=SPOT.lit(SPOT.white, SPOT.white_by_pixel, turned))
    moving = read(turned)
    assert read(0.0).status.numpy() == Status.BAD_SHAPE
    assert moving.status.numpy() == Status.VALID
    assert moving.position.numpy() == pytest.approx(whole.position.numpy(), abs=1e-5)


def test_widths_must_ascend() -> None:
    with pytest.raises(ValidationError, match="must ascend"):
        Validation(beam_width=(2.0, 0.7))


class TestNeighbours:
    ANGLES = np.linspace(-0.1, 0.1, 9)

    def found(self, ranges: Array, sigma: float = 1e-3, steepest: float = 1.2) -> NDArray[np.bool_]:
        status = np.where(np.isnan(ranges), Status.BELOW_THRESHOLD, Status.VALID).astype(np.uint32)
        return is_isolated(
            ranges, np.full(ranges.shape, sigma), status, self.ANGLES, self.ANGLES, 6.0, steepest
        )

    def test_one_voxel_alone(self) -> None:
        ranges = np.full((9, 9), 10.0)
        ranges[4, 5] = ranges[0, 0] = 5.0
        wanted = np.zeros((9, 9), dtype=bool)
        wanted[4, 5] = wanted[0, 0] = True
        np.testing.assert_array_equal(self.found(ranges), wanted)

    @pytest.mark.parametrize("turned", [False, True])
    def test_a_rail_stays(self, turned: bool) -> None:
        """One voxel wide, straight or across the raster's diagonal."""
        ranges = np.full((9, 9), 10.0)
        if turned:
            np.fill_diagonal(ranges[::-1], 8.0)
        else:
            ranges[:, 4] = 8.0
        assert not self.found(ranges).any()

    def test_noise_and_slope_are_granted(self) -> None:
        """A surface inclined by 60° stays; where only 20° are granted every voxel stands alone."""
        ranges = np.tile(10.0 * np.exp(np.tan(np.deg2rad(60.0)) * self.ANGLES), (9, 1))
        ranges = ranges * 2.0 ** np.arange(9)[:, None]
        assert not self.found(ranges).any()
        assert self.found(ranges, steepest=np.deg2rad(20.0)).all()
        assert not self.found(ranges, sigma=1e3, steepest=0.0).any()

    def test_few_neighbours_accuse_nobody(self) -> None:
        ranges = np.full((9, 9), np.nan)
        ranges[4, 4], ranges[4, 5], ranges[5, 4] = 5.0, 10.0, 10.0
        assert not self.found(ranges).any()
        ranges[5, 5] = 10.0
        assert self.found(ranges).sum() == 1

    def test_one_row_is_no_neighbourhood(self) -> None:
        status = np.zeros((1, 9), dtype=np.uint32)
        ranges = np.linspace(5.0, 50.0, 9)[None]
        assert not is_isolated(ranges, ranges * 0.0, status, self.ANGLES, np.zeros(1), 6.0, 1.0).any()


def test_the_curvature_of_integrated_spots_is_as_near_as_granted() -> None:
    """Claim: of pixels' integrals of a Gaussian from s = 0.46 pixel on, wherever it lies, the logarithms' curvature is
    1/(s² + 1/12) to the share that is granted, of which 94 % are needed."""
    place, sigma = np.meshgrid(np.linspace(-0.5, 0.5, 41), np.geomspace(0.46, 3.0, 60))
    edges = np.array([-1.5, -0.5, 0.5, 1.5])[:, None, None]
    left, middle, right = np.log(np.diff(norm.cdf((edges - place) / sigma), axis=0))
    worst = np.abs((2.0 * middle - left - right) * (sigma**2 + 1.0 / 12.0) - 1.0).max()
    assert 0.94 * validation._CURVATURE < worst <= validation._CURVATURE


def test_a_line_that_drifted_matters_to_the_filter_only() -> None:
    assert ExpectedSpot.of(Laser(drift=20e-9), Receiver(), 1.0, TOLD, DWELL).white == SPOT.white


def test_the_largest_share_of_a_pixel_is_that_of_a_point_on_its_middle() -> None:
    spread = np.hypot(12e-6, 38.2e-6)
    assert SPOT.largest_share == pytest.approx(2.0 * norm.cdf(0.5 * 50e-6 / spread) - 1.0, rel=1e-6)
