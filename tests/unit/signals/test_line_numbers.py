"""What is known of the line before a spot is seen, by hand: ranges of a tilted array, sweeps, gates, limits,
charges."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
from prototype import Laser, PositionSensor, Receiver

from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.foundation.errors import InputError
from scanner_sim.render.device import Device
from scanner_sim.signals.line.bias import Bias, computed_bias, widths_of
from scanner_sim.signals.line.bias_table import COLUMNS, HEADING, BiasTable, invert, read_bias
from scanner_sim.signals.line.calibration import SensorCalibration, measured_charges
from scanner_sim.signals.line.expected import STEEP_SWEEP, ExpectedSpot
from scanner_sim.signals.line.likelihood import Width
from scanner_sim.signals.line.limits import distance_of_sides, flank_limit, gate_of, limits_of
from scanner_sim.signals.processing import Processing, Validation

DWELL = 50e-6
SENSOR = PositionSensor()
UPRIGHT = Receiver(array_tilt="ideal")
TILTED = Receiver(array_tilt="scheimpflug")


def known(receiver: Any, **changes: Any) -> ExpectedSpot:
    return replace(ExpectedSpot.of(Laser(), receiver, 1e-3, SENSOR, DWELL), **changes)


def number(value: Any) -> float:
    return float(np.asarray(value.numpy()).ravel()[0])


@pytest.mark.parametrize("theta", [-0.3, 0.0, 0.25])
def test_ranges_of_a_tilted_array_are_those_of_its_image(theta: float) -> None:
    """Claim: R − d sinΘ = d cosΘ (scale/p + slope), by the scale and slope that the judge's rays hold the array's image
    to; and each range has its pixel again."""
    spot, image = known(TILTED), TILTED.line_image
    assert abs(image.slope) > 0.05
    for pixel in (40.0, 130.5, 300.0):
        found = float(spot.range(pixel, math.sin(theta), math.cos(theta)))
        p = spot.offset + (pixel + 0.5) * spot.pitch
        depth = (found - TILTED.baseline * math.sin(theta)) / (TILTED.baseline * math.cos(theta))
        assert depth == pytest.approx(image.scale / p + image.slope, rel=1e-12)
        assert float(spot.pixel(found, math.sin(theta), math.cos(theta))) == pytest.approx(pixel, rel=1e-9)


@pytest.mark.parametrize("receiver", [UPRIGHT, Receiver(array_tilt="ideal", focus_distance=3.0)])
def test_white_light_by_pixel_is_that_by_range(receiver: Any) -> None:
    """Claim: at Θ = 0 a white surface that is seen at a pixel has the light of its range, both ways."""
    spot = known(receiver)
    assert spot.offset == 0.0
    for pixel in (40.0, 130.5, 300.0):
        range_m = float(spot.range(pixel, 0.0, 1.0))
        assert number(auto.Float(spot.white_by_pixel)) * (pixel + 0.5) ** 2 == pytest.approx(
            number(auto.Float(spot.white)) / range_m**2, rel=1e-5
        )


def test_a_sweep_draws_an_even_line_over_the_pixels() -> None:
    """Claim: on a plane tilted by 60° a beam that turns by δ moves over δ R tan 60° of range; the variance is that of
    an even line over as many pixels as ranges at both ends are imaged apart."""
    sweep = 2e-4
    for receiver in (UPRIGHT, TILTED):
        spot = known(receiver, sweep=sweep)
        for pixel, theta in ((60.0, 0.1), (200.0, -0.3)):
            at = math.sin(theta), math.cos(theta)
            middle = float(spot.range(pixel, *at))
            half = 0.5 * sweep * middle * math.tan(STEEP_SWEEP)
            length = float(spot.pixel(middle - half, *at)) - float(spot.pixel(middle + half, *at))
            assert float(spot.swept_variance(pixel, *at)) == pytest.approx(length**2 / 12.0, rel=1e-4)


def test_a_gate_reaches_one_pixel_beyond_the_ranges(device: Device) -> None:
    """Claim: far ranges have the first pixels; peaks of 0.8 of the threshold above their sides are looked for there."""
    spot = known(UPRIGHT)
    processing = Processing(range_gate=(4.0, 9.0), threshold=6.0)
    gate = gate_of(spot, processing, auto.Float(0.1), auto.Float(math.sqrt(0.99)))
    assert gate is not None
    f, d, r = UPRIGHT.focal_length, UPRIGHT.baseline, math.sqrt(0.99)
    first, last = ((f * d * r / (reach - 0.1 * d) - spot.offset) / spot.pitch - 0.5 for reach in (9.0, 4.0))
    assert number(gate.first) == pytest.approx(first - 1.0, abs=1e-3)
    assert number(gate.last) == pytest.approx(last + 1.0, abs=1e-3)
    assert number(gate.level) == pytest.approx(4.8)
    assert gate_of(spot, Processing(), auto.Float(0.0), auto.Float(1.0)) is None


def test_no_spot_exceeds_its_limits(device: Device) -> None:
    """Claim: a white facing surface has white/R² of charge, ∝ (pixel + 1/2 + offset/pitch)², and the least contrast is
    0.15 of the least reflectance's; what of that one pixel holds at most is that of a point."""
    spot = known(UPRIGHT)
    spot = spot.lit(spot.white, spot.white * (spot.pitch / (UPRIGHT.focal_length * UPRIGHT.baseline)) ** 2)
    settings = Validation(min_reflectance=0.02, max_reflectance=1.2)
    cosine = 0.9
    limits, away = limits_of(
        spot, Processing(validation=settings, threshold=6.0), auto.Float(50.0), auto.Float(cosine)
    )
    origin = number(limits.origin)
    assert origin == pytest.approx(spot.offset / spot.pitch + 1.0)
    pixel = 200.0
    charge = spot.white / float(spot.range(pixel, 0.0, cosine)) ** 2 * cosine**4
    place = (pixel + 0.5 + spot.offset / spot.pitch) ** 2 / (pixel + origin) ** 2
    assert number(limits.charge[0]) == pytest.approx(300.0)
    assert number(limits.charge[1]) * (pixel + origin) ** 2 * place == pytest.approx(
        1.2 * spot.largest_share * charge / cosine**4, rel=1e-5
    )
    assert number(limits.dimmest) / number(limits.charge[1]) == pytest.approx(
        0.02 * 0.15 / (1.2 * spot.largest_share), rel=1e-5
    )
    assert away == distance_of_sides(spot.largest_sigma)
    least, rise = flank_limit(spot.widest(settings.beam_width[1]), away, origin)
    assert (number(limits.flank[0]), number(limits.flank[1])) == pytest.approx((least, rise), rel=1e-5)
    beam, spread = spot.variances(pixel, 0.0, 1.0)
    assert spot.widest(1.5)[200] == pytest.approx(2.25 * beam + spread)


@pytest.mark.parametrize("laser_off", [0.25, 0.5])
def test_what_is_read_without_the_laser_is_taken_off(laser_off: float) -> None:
    """Claim: of a pixel that the ambient light gives A and the laser L electrons in a whole dwell, the first exposure
    has (1 − o)(A + L) and the second o A, both with dark charge; what is left is (1 − o) L, with the variances of both.
    """
    sensor = PositionSensor(dark_current=4e6, read_noise=30.0, prnu=0.0)
    known = SensorCalibration.of(sensor, DWELL, laser_off)
    gain, ambient, laser = sensor.electrons_per_number, 3000.0, 5000.0
    dark = 4e6 * DWELL
    on = sensor.bias + ((1.0 - laser_off) * (ambient + laser + dark)) / gain
    off = sensor.bias + laser_off * (ambient + dark) / gain
    charge, sigma = measured_charges([np.array([[on]]), np.array([[off]])], known)
    assert charge[0, 0] == pytest.approx((1.0 - laser_off) * laser, rel=1e-9)
    again = (1.0 - laser_off) / laser_off
    read = 30.0**2 + gain**2 / 12.0
    wanted = (1.0 - laser_off) * (ambient + laser + dark) + read
    wanted += again**2 * (laser_off * (ambient + dark) + read)
    assert sigma[0, 0] ** 2 == pytest.approx(wanted, rel=1e-9)
    alone, _ = measured_charges([np.array([[on]])], SensorCalibration.of(sensor, DWELL))
    assert alone[0, 0] == pytest.approx((on - sensor.bias) * gain - dark)


def test_a_table_on_the_device_is_flat_beyond_its_ends(device: Device) -> None:
    """Claim: between nodes the error is linear and its derivative that slope; beyond ±1 pixel it stays, on both
    sides."""
    shifts = np.linspace(-1.0, 1.0, 97)
    table = BiasTable("parabola", np.array([0.5, 1.5]), shifts, np.stack([0.01 * shifts, 0.03 * shifts]))
    error, slope = Bias(table)(auto.Float([-1.3, -0.505, 0.3, 1.2]), auto.Float(1.0))
    np.testing.assert_allclose(error.numpy(), [-0.02, -0.0101, 0.006, 0.02], atol=1e-6)
    np.testing.assert_allclose(slope.numpy(), [0.0, 0.02, 0.02, 0.0], atol=1e-6)


def test_a_computed_table_is_the_error_of_the_judges_estimator(device: Device) -> None:
    """Claim: found less true, over the found place, of noise-free spots of the narrowest and the widest width: by the
    judge's estimator of exactly integrated pixels. Tolerance: linear between 97 nodes, 241 places."""
    table = computed_bias("parabola", 0.5, 1.1)
    for width, row in ((0.5, 0), (1.1, -1)):
        for place in (-0.31, 0.05, 0.4):
            found = ESTIMATORS["parabola"]((1e6 * pixel_shares(12 + place, width, 25)).tolist()) - 12
            error = float(np.interp(found, table.shifts, table.bias[row]))
            assert error == pytest.approx(found - place, abs=3e-4)


def test_an_estimator_is_inverted_between_the_ends_of_what_it_tells() -> None:
    """Claim: of an estimator that tells half of the place the error is −x/2 of the place, −(found) of what it finds,
    where it rises; beyond, that of the nearest end."""
    truth = np.linspace(-1.0, 1.0, 241)
    shifts = np.linspace(-1.0, 1.0, 9)
    found = invert(0.5 * truth, truth, shifts)
    np.testing.assert_allclose(found[np.abs(shifts) <= 0.5], -shifts[np.abs(shifts) <= 0.5], atol=1e-9)


def test_widths_of_spots_are_those_at_the_ends_of_the_line() -> None:
    """Claim: the least and the largest √(beam² + point²) of all pixels, the largest a fifth larger for deflections."""
    spot = known(UPRIGHT)
    sigma = [math.sqrt(sum(spot.variances(float(pixel), 0.0, 1.0))) for pixel in range(spot.pixels)]
    assert widths_of(spot) == pytest.approx((min(sigma), 1.2 * max(sigma)))
    assert spot.largest_sigma == pytest.approx(max(sigma))


@pytest.mark.parametrize("sigma", [(1.0, 2.5), (2.0, 2.0), (0.8, 4.0)])
def test_no_allowed_spot_has_flanks_beyond_the_limit(sigma: tuple[float, float]) -> None:
    """Claim: of spots as wide as is allowed on each pixel, and anywhere between two, the light one pixel before the
    sides is within the limit; of a spot that is wider by half it is not, where the sides can tell."""
    pixels, origin = 60, 12.0
    widths = np.linspace(*sigma, pixels)
    away = distance_of_sides(float(widths.max()))
    least, rise = flank_limit(widths**2, away, origin)
    place = np.arange(-away - 4, away + 5)

    def flanks(width: float, shift: float) -> tuple[float, float]:
        """Return flank and contrast of a spot about its brightest pixel."""
        line = dict(zip(place.tolist(), np.exp(-0.5 * ((place - shift) / width) ** 2), strict=True))
        side = max(np.mean([line[sign * (away + k)] for k in range(3)]) for sign in (-1, 1))
        flank = 0.5 * (line[away - 1] + line[1 - away]) - side
        return flank, 0.25 * (line[-1] + 2.0 * line[0] + line[1]) - side

    for pixel, width in enumerate(widths):
        limit = least + rise * (pixel + origin) ** 2
        for shift in (-0.5, -0.2, 0.0, 0.3, 0.5):
            flank, contrast = flanks(width, shift)
            assert flank <= limit * contrast
    wider, contrast = flanks(1.6 * widths.max(), 0.0)
    assert wider > (least + rise * (pixels - 1 + origin) ** 2) * contrast
    tight = [
        1.25 * flanks(width, 0.0)[0] / flanks(width, 0.0)[1] + 0.05 - least - rise * (pixel + origin) ** 2
        for pixel, width in enumerate(widths)
    ]
    assert max(tight) == pytest.approx(0.0, abs=1e-9)


def test_a_width_is_unsure_by_a_quarter_of_its_limits(device: Device) -> None:
    """Claim: v of beam and spread, and of ln v a quarter of what lies between the limits, beside half a per cent."""
    spot = known(UPRIGHT)
    beam, spread = spot.variances(40.0, 0.1, math.sqrt(0.99))
    deflection = auto.Float(0.1), auto.Float(math.sqrt(0.99))
    found = Width.of(spot, auto.Int32(40), auto.Int32(4), deflection, (0.7, 1.5), 12)
    assert number(found.variance) == pytest.approx(beam + spread, rel=1e-5)
    wanted = math.hypot(0.25 * (1.5**2 - 0.7**2) * beam / (beam + spread), 0.005)
    assert number(found.spread) == pytest.approx(wanted, rel=1e-5)


def test_a_table_on_the_device_is_the_tables_at_its_ends_and_between(device: Device) -> None:
    """Claim: errors that are linear in the width are those of the table at any width, its first and last among them."""
    widths, shifts = np.array([0.8, 1.4]), np.array([-0.5, 0.0, 0.5])
    table = BiasTable("parabola", widths, shifts, np.array([[-0.02, 0.0, 0.02], [-0.06, 0.01, 0.04]]))
    bias = Bias(table)
    for width in (0.8, 1.0, 1.37, 1.4):
        for shift in (-0.5, -0.25, 0.0, 0.4):
            found, _ = bias(auto.Float(shift), auto.Float(width))
            wanted = table.at(np.array([width]), np.array([shift])).item()
            assert number(found) == pytest.approx(wanted, abs=2e-6)


def test_a_table_of_errors_has_a_width_and_what_lies_between(tmp_path: Path) -> None:
    """Claim: widths are above 0, errors a pixel at most, and shifts three or more; else the file is refused."""
    path = tmp_path / "bias.csv"

    def read(widths: tuple[float, ...], shifts: tuple[float, ...], error: float) -> BiasTable:
        rows = [f"{w},{s},0.1" for w in widths for s in shifts]
        rows[-1] = f"{widths[-1]},{shifts[-1]},{-error}"
        path.write_text("\n".join([HEADING, "# estimator: parabola", ",".join(COLUMNS), *rows]) + "\n")
        return read_bias(path)

    found, shifts = read((0.01, 1.0), (-0.5, 0.0, 0.5), 1.0), (-0.5, 0.0, 0.5)
    assert (found.estimator, found.widths.tolist(), found.shifts.tolist()) == (
        "parabola",
        [0.01, 1.0],
        list(shifts),
    )
    for word, kind in (("none", str), ("computed", str), (str(path), Path)):
        asked = Processing.model_validate({"bias_correction": word, "peak": "parabola"})
        assert isinstance(asked.bias_correction, kind)
    for wrong in (((0.0, 1.0), shifts, 0.1), ((0.5, 1.0), shifts[::2], 0.1), ((0.5,), shifts, 1.01)):
        with pytest.raises(InputError, match="not possible"):
            read(*wrong)
