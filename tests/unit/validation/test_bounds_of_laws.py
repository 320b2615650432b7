"""Just inside and just outside of what a law of a comparison asks of an instrument, and what the Sun makes of eq 17."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from made_settings import setting

from scanner_sim.validation.compare import instrument_sheet, light, pulses, shape, test_bench, uneven
from scanner_sim.validation.compare.closed_forms import ClosedForms, ClosedSpot, EstimatorForms


@pytest.mark.parametrize(("share", "reason"), [(1.02, ""), (0.98, "do not reach over 64 voxels, 3 radii")])
def test_scenes_of_64_voxels_three_radii_apart_lie_within_the_mirrors(share: float, reason: str) -> None:
    """Claim: half of 64 times three radii of the beam at 1.6 times the nearest range, where that is widest."""
    scanner = setting().scenario.scanner
    R = 1.6 * scanner.nearest_range
    reach = share * 96.0 * float(scanner.laser.radius(R)) / R
    told = setting(scanner={"mirrors": {"max_deflection": reach}}, scan=NARROW)
    assert (reason in uneven.UNEVEN.applies(told)) if reason else not uneven.UNEVEN.applies(told)


NARROW = {"type": "raster", "rows": 4, "columns": 4, "horizontal": (-1e-3, 1e-3), "vertical": (-1e-3, 1e-3)}


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ({"response": (527.9e-9, 900e-9)}, ""),
        ({"response": (528.1e-9, 900e-9)}, "beyond the detector's response"),
        ({"response": (400e-9, 535.9e-9)}, "beyond the detector's response"),
        ({"response": (400e-9, 536.1e-9)}, ""),
    ],
)
def test_the_band_of_a_filter_lies_within_the_response(line: dict[str, Any], reason: str) -> None:
    """Claim: the filter's band of 532 nm ± half its width is seen whole, or the law of sunlight says why not."""
    told = setting(scanner={"position_sensor": line, "filter": FILTER, "laser": {"wavelength": 532e-9}})
    assert (reason in light._filtered(told)) if reason else not light._filtered(told)


FILTER = {"centre": 532e-9, "bandwidth": 8e-9}


@pytest.mark.parametrize(("radius", "distance"), [(1.0, 1.0), (0.9, 1.3), (1.2, 0.8)])
def test_a_sun_that_is_smaller_or_farther_is_dimmer(radius: float, distance: float) -> None:
    """Claim: light goes by the square of the Sun's radius over its distance, which the paper has as 695 000 km and
    1.4968e11 m; without a Sun that is meant."""
    sun = {"direction": (0.0, 0.5, 1.0), "radius": radius * 6.95e8, "distance": distance * 1.4968e11}
    found = light._dilution(setting(lighting={"sun": sun}))
    assert found == pytest.approx((radius / distance) ** 2)
    assert light._dilution(setting()) == 1.0


@pytest.mark.parametrize("incidence", [0.0, 0.2])
def test_a_line_that_has_drifted_passes_as_one_that_is_made_so(incidence: float) -> None:
    """Claim: a filter about 1500 nm passes a line of 1500 + 9 nm as it does one of 1509 nm; a detector whose response
    ends before it sees none."""
    filter_ = {"centre": 1.5e-6, "bandwidth": 20e-9, "shape": "cavities"}

    def passed(wavelength: float, drift: float, response: Any = None) -> float:
        laser = {"wavelength": wavelength, "drift": drift}
        told = setting(scanner={"laser": laser, "filter": filter_})
        return ClosedForms(told.scenario).passed(incidence, response)

    assert passed(1.5e-6, 9e-9) == pytest.approx(passed(1.509e-6, 0.0), rel=1e-9)
    assert passed(1.5e-6, 9e-9) != pytest.approx(passed(1.5e-6, 0.0), rel=1e-3)
    for ends, seen in (((1e-6, 1.5091e-6), True), ((1e-6, 1.5089e-6), False), ((1.5091e-6, 1.6e-6), False)):
        assert (passed(1.5e-6, 9e-9, ends) > 0.0) is seen


@pytest.mark.parametrize("centre", [30.3, 30.8, 7.0])
def test_a_closed_line_holds_its_charge_about_its_middle(centre: float) -> None:
    """Claim: 49 pixels hold the charge of a spot that lies as far from the middle one as it does from its own; the
    pixels widen its variance by a twelfth."""
    line = ClosedSpot(centre=centre, chief=1.0, sigma=1.4, charge=5e3, beam=0.3).line
    place = np.arange(49.0)
    middle = float(place @ line / line.sum())
    assert line.sum() == pytest.approx(5e3)
    assert middle == pytest.approx(24.0 + {30.3: 0.3, 30.8: -0.2, 7.0: 0.0}[centre])
    assert float((place - middle) ** 2 @ line / line.sum()) == pytest.approx(1.4**2 + 1.0 / 12.0, rel=1e-4)


@pytest.mark.parametrize("phase", [-0.4, 0.0, 0.3])
def test_a_plate_is_set_where_its_spot_lies_at_a_place_in_its_pixel(phase: float) -> None:
    closed = ClosedForms(setting().scenario)
    R = closed.position(7.0, phase)
    assert pytest.approx(7.0, rel=0.02) == R
    assert closed.facing(R, 1.0).phase == pytest.approx(phase, abs=1e-9)
    assert round(closed.facing(R, 1.0).centre) == round(closed.facing(7.0, 1.0).centre)


@pytest.mark.parametrize(
    ("seen", "ends"),
    [
        ({"triangulation": (1.5, 40.0), "tof": (0.5, 30.0)}, (1.5, 30.0)),
        ({"triangulation": (1.5, 20.0), "tof": (0.5, 30.0)}, (1.5, 20.0)),
        ({"triangulation": (1.5, math.inf), "tof": (0.5, 2.0)}, (1.5, 3.0)),
        ({"triangulation": (1.5, math.inf)}, (1.5, 1.5 * instrument_sheet._DEEPEST)),
        ({"tof": (0.7, 30.0)}, (0.7, 30.0)),
    ],
)
def test_a_sheet_goes_over_what_is_seen(
    seen: dict[Any, tuple[float, float]], ends: tuple[float, float]
) -> None:
    """Claim: from the nearest range of the first way to its farthest, or to the end of the gate where that is nearer,
    but twice as far as it begins at least; evenly in logarithms."""
    found = instrument_sheet._ranges(seen, 5)
    np.testing.assert_allclose(found, ends[0] * (ends[1] / ends[0]) ** (np.arange(5) / 4.0))


@pytest.mark.parametrize(
    ("filter_", "reason"),
    [
        ({"centre": 1.5e-6, "bandwidth": 30e-9, "shape": "tophat"}, ""),
        # At 3 m the base of 0.2 m is seen at 3.8°: a narrow band has its edge within the spot.
        ({"centre": 1.5e-6, "bandwidth": 1e-9, "shape": "tophat"}, "steep edge"),
        ({"centre": 1.5e-6, "bandwidth": 1e-9, "shape": "cavities"}, ""),
        ({"centre": 1.504e-6, "bandwidth": 6e-9, "shape": "tophat"}, "blocks the laser's line"),
    ],
)
def test_laws_of_spots_need_their_light(filter_: dict[str, Any], reason: str) -> None:
    """Claim: half of the light passes the filter straight ahead, and at the nearest range if the edge is steep."""
    found = shape.unlit(setting(scanner={"filter": filter_}))
    assert (reason in found) if reason else not found


@pytest.mark.parametrize(("white", "coarse"), [(0.249, False), (0.251, True)])
def test_steps_are_coarse_that_are_twice_the_noise(
    monkeypatch: pytest.MonkeyPatch, white: float, coarse: bool
) -> None:
    """Claim: rounding to Δ has a variance of Δ²/12; it is a quarter of all where Δ is twice the noise besides."""
    monkeypatch.setattr(pulses, "dark_noise", lambda _: (3e-8, white))
    assert pulses._rounds_coarsely(setting()) is coarse


def test_pixels_count_from_the_middle_of_the_first() -> None:
    """Claim: on a line that begins 2 mm beside p = 0 a place is (p − 2 mm)/pitch − ½."""
    closed = ClosedForms(setting(scanner={"position_sensor": {"offset": 2e-3}}).scenario)
    assert closed.pixel(2e-3 + 7.25 * closed.pitch) == pytest.approx(6.75)


@pytest.mark.parametrize(
    ("sigma", "centre", "held"),
    [
        (0.5, 6.01, True), (0.5, 5.99, False), (2.0, 12.01, True), (2.0, 11.99, False),
        (0.5, 255.0 - 6.01, True), (0.5, 255.0 - 5.99, False), (2.0, 255.0 - 12.01, True), (2.0, 255.0 - 11.99, False),
    ],
)  # fmt: skip
def test_a_spot_lies_on_the_array_with_six_sigma_to_each_side(
    sigma: float, centre: float, held: bool
) -> None:
    """Claim: and with six pixels, however narrow it is, of 256."""
    assert ClosedForms(setting().scenario).on_array(ClosedSpot(centre, centre, sigma, 1e3, 0.5)) is held


def test_estimators_of_ones_own_tell_their_sigma_by_charges_and_variances() -> None:
    told: list[Any] = []
    own = EstimatorForms(
        position=lambda line: 0.0, sigma=lambda line, variance: told.extend((line, variance)) or 0.25
    )
    closed = ClosedForms(setting().scenario, own)
    seen, variance = ClosedSpot(30.3, 30.3, 1.2, 1e4, 0.5), np.full(49, 7.0)
    assert closed.sigma_pixel(seen, "mine", variance) == 0.25
    np.testing.assert_array_equal(told, [seen.line, variance])


def test_a_square_of_directions_is_even_about_the_axis() -> None:
    """Claim: of at most 30 directions within ±0.2 rad 5 by 5, each once, Θ the faster."""
    theta, phi = test_bench.square(0.2, 30)
    step = np.linspace(-0.2, 0.2, 5)
    np.testing.assert_allclose(theta, np.tile(step, 5))
    np.testing.assert_allclose(phi, np.repeat(step, 5))


@pytest.mark.parametrize(
    ("processing", "slope"),
    [
        ({"peak": "gaussian"}, 1.3),
        ({"peak": "centre_of_mass", "bias_correction": "computed"}, 1.0),
        ({"peak": "maximum_likelihood"}, 1.0),
    ],
)
def test_an_estimate_follows_its_spot_by_its_slope(
    monkeypatch: pytest.MonkeyPatch, processing: dict[str, Any], slope: float
) -> None:
    """Claim: one that tells 1.3 times the centre of mass moves by 1.3; what fits, or is corrected, follows as it is."""
    place = np.arange(49.0)
    monkeypatch.setattr(
        ClosedForms, "estimated", lambda self, peak, line: 1.3 * float(place @ line / line.sum())
    )
    closed = ClosedForms(setting(processing=processing).scenario)
    assert closed.follows(ClosedSpot(30.3, 30.3, 1.2, 1e4, 0.5)) == pytest.approx(slope, rel=1e-6)
