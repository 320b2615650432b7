"""Closed forms with the numbers of an instrument: spots on planes, σ of a fitted position, where an array stands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr

from scanner_sim import Scenario, load_scenario
from scanner_sim.analytic import geometry
from scanner_sim.analytic.noise import width_spread
from scanner_sim.config.built import instrument_as_built
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.validation.compare import departures, light
from scanner_sim.validation.compare.closed_forms import FIT, ClosedForms, ClosedSpot, EstimatorForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget
from scanner_sim.validation.compare.instrument import echo_instrument_of
from scanner_sim.validation.compare.instrument_sheet import _behind_lens

SCAN = {"type": "raster", "rows": 4, "columns": 5, "horizontal": (-0.2, 0.3), "vertical": (-0.1, 0.2)}


def scenario(**changes: Any) -> Scenario:
    return load_scenario({"schema": 1, "seed": 7, "ranging": "both", "scan": SCAN} | changes)


def test_a_plane_is_dark_by_the_cosine_at_which_it_is_seen() -> None:
    """Claim: Lambert's law at one point: the charges of two planes through it are as the cosines between their normals
    and the way to the lens; how long a normal is said to be does not matter.

    Set-up: pixels that are too high to lose light, so that a change of the spot's height costs none.
    """
    closed = ClosedForms(scenario(scanner={"position_sensor": {"height": 5e-3}}))
    theta, phi, R = 0.21, -0.13, 6.0
    point = geometry.point_from_shot(R, theta, phi, closed.D)
    to_lens = geometry.lens_node(phi, closed.D, closed.d) - point
    to_lens = to_lens / np.linalg.norm(to_lens)
    beam = geometry.scanner_axes(theta, phi)[0]
    tilted = np.array([0.3, -0.2, -1.0])
    spots = {}
    for name, normal in (("facing", -beam), ("tilted", tilted), ("long", 7.0 * tilted)):
        spots[name] = closed.spot(theta, phi, point, normal, 0.4)
    assert spots["long"].charge == pytest.approx(spots["tilted"].charge, rel=1e-12)
    assert spots["long"].centre == pytest.approx(spots["tilted"].centre, rel=1e-12)
    assert spots["long"].sigma == pytest.approx(spots["tilted"].sigma, rel=1e-12)
    cosines = [abs(float(to_lens @ normal)) / np.linalg.norm(normal) for normal in (tilted, beam)]
    assert spots["tilted"].charge / spots["facing"].charge == pytest.approx(cosines[0] / cosines[1], rel=1e-9)
    assert cosines[0] / cosines[1] < 0.95


def test_a_fit_errs_by_the_pixels_that_its_spot_covers() -> None:
    """Claim: σ² = Σ g² v with g the slopes of the best fit of charge, place and width to the judge's own line, weighed
    by each pixel's variance, the width held by what is known of it.

    Set-up: variances that differ from pixel to pixel; the slopes by differences of a model written anew.
    """
    closed = ClosedForms(scenario())
    for R in (2.3, 9.0):
        seen = closed.facing(R, 0.4)
        line, rng = seen.line, np.random.default_rng(3)
        variance = rng.uniform(20.0, 900.0, line.size)
        place = 24.0 + seen.phase

        def model(at: np.ndarray) -> np.ndarray:
            edges = (np.arange(line.size + 1) - 0.5 - at[1]) / math.exp(0.5 * at[2])  # noqa: B023
            return math.exp(at[0]) * np.diff(ndtr(edges))

        best = np.array([math.log(seen.charge), place, 2.0 * math.log(seen.sigma)])
        np.testing.assert_allclose(model(best), line, rtol=1e-9, atol=1e-9 * line.max())
        steps = 1e-4 * np.eye(3)
        slopes = np.stack([(model(best + step) - model(best - step)) / 2e-4 for step in steps])
        known = np.diag(
            [0.0, 0.0, width_spread(closed.scenario.processing.validation.beam_width, seen.beam) ** -2.0]
        )
        by_charge = np.linalg.solve((slopes / variance) @ slopes.T + known, slopes / variance)[1]
        wanted = math.sqrt(float(np.sum(by_charge**2 * variance)))
        assert closed.sigma_pixel(seen, FIT, variance) == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize(
    "receiver",
    [
        {"array_tilt": "ideal"},
        {"array_tilt": "scheimpflug", "focus_distance": 4.0},
        {"array_tilt": 0.3, "focus_distance": 3.0},
    ],
    ids=["upright", "scheimpflug", "tilted"],
)
def test_an_array_stands_where_the_images_of_its_ranges_are(receiver: dict[str, Any]) -> None:
    """Claim: the image of a point of the beam lies on the straight way from it through the lens's node and as far
    behind it as it must, upright a focal length; as far along the array as the position says."""
    forms = ClosedForms(scenario(scanner={"receiver": receiver}))
    places = [_behind_lens(forms, float(forms.array.position(R))) for R in (1.7, 5.0, 40.0)]
    for R, (x, z) in zip((1.7, 5.0, 40.0), places, strict=True):
        assert z < 0.0
        # The point is at (-d, R): on the line through the node the two ways are as their parts.
        assert x == pytest.approx(forms.d * -z / R, rel=1e-9)
        if receiver["array_tilt"] == "ideal":
            assert z == pytest.approx(-forms.f)
    near, far = (float(forms.array.position(R)) for R in (1.7, 40.0))
    assert math.dist(places[0], places[2]) == pytest.approx(near - far, rel=1e-9)


def test_the_judge_of_echoes_is_told_each_number_of_the_unit() -> None:
    """Claim: all twenty, with the lens's and the filter's transmission at the laser's line together, and the samples'
    interval as the inverse of their rate."""
    lidar = {
        "pulse": {"width": 1.3e-9, "energy": 3e-8},
        "photodiode": {
            "gain": 31.0,
            "ionisation_ratio": 0.23,
            "response": (1.0e-6, 1.65e-6),
            "field_of_view": 2.3e-3,
        },
        "digitiser": {"rate": 1.7e9},
    }
    given = {"receiver": {"aperture": 0.019, "transmission": 0.83}, "lidar": lidar}
    filtered = {"transmission": 0.71, "bandwidth": 40e-9}
    told = echo_instrument_of(scenario(scanner=given | {"filter": filtered}), 0.37)
    unit = scenario(scanner=given).scanner.lidar
    assert told.energy == pytest.approx(3e-8)
    assert (told.aperture, told.reflectance, told.gain) == (0.019, 0.37, 31.0)
    # McIntyre: k M + (2 - 1/M)(1 - k).
    assert told.excess == pytest.approx(0.23 * 31.0 + (2.0 - 1.0 / 31.0) * 0.77)
    assert told.transmission == pytest.approx(0.83 * 0.71, rel=1e-6)
    assert (told.field, told.responsivity) == (2.3e-3, unit.photodiode.responsivity)
    assert told.interval == pytest.approx(1.0 / 1.7e9)
    assert told.pulse == pytest.approx(1.3e-9 / (2.0 * math.sqrt(2.0 * math.log(2.0))), rel=1e-6)
    bare = echo_instrument_of(scenario(scanner=given | {"filter": "none"}), 0.37)
    assert bare.transmission == pytest.approx(0.83)
    assert (told.sunlight, told.shot) == (0.0, 1.0)
    assert told.amplifier == unit.photodiode.amplifier_noise > 0.0
    assert told.saturation == unit.photodiode.saturation
    assert 0.5 * SPEED_OF_LIGHT * told.interval == pytest.approx(0.0882, rel=1e-3)


def test_longer_optics_are_those_of_an_instrument_that_is_so_designed() -> None:
    """Claim: what departures move with a focal length, a base and a separation that are longer is what they move on an
    instrument that has these as its own."""
    built = {"base": 3e-4, "theta_zero": 2e-4, "phi_scale": 1e-3, "array_offset": 4e-6, "focal_length": 1e-4}
    lengths = {"focal_length": 2e-3, "base": 7e-3, "axis_separation": 5e-3}
    plain = scenario(scanner={"as_built": built})
    scanner = plain.scanner
    receiver = {
        "focal_length": scanner.receiver.focal_length + lengths["focal_length"],
        "baseline": scanner.receiver.baseline + lengths["base"],
    }
    mirrors = {"axis_separation": scanner.mirrors.axis_separation + lengths["axis_separation"]}
    longer = scenario(scanner={"as_built": built, "receiver": receiver, "mirrors": mirrors})
    target = FlatTarget(0.4, (3.0, 5.0, 9.0))
    r, theta, phi = np.array([2.1, 5.5, 13.0]), np.array([0.2, -0.1, 0.3]), np.array([-0.15, 0.22, 0.1])
    by = np.zeros(len(NAMES))
    for name, more in lengths.items():
        by[INDEX[name]] = more
    for way in ("triangulation", "tof"):
        moved = departures._moved(ComparisonSetup(plain, target), way, r, theta, phi, by)
        wanted = departures._moved(ComparisonSetup(longer, target), way, r, theta, phi)
        assert np.abs(wanted).max() > 1e-5
        np.testing.assert_allclose(moved, wanted, rtol=1e-9, atol=1e-12)
        assert (
            np.abs(departures._moved(ComparisonSetup(plain, target), way, r, theta, phi) - moved).max() > 1e-6
        )


@pytest.mark.parametrize("light", [None, 70])
@pytest.mark.parametrize("seed", [None, 11])
def test_what_is_steady_is_the_same_instrument_with_any_seed(seed: int | None, light: int | None) -> None:
    """Claim: what was drawn of the instrument stays, whatever seed its noise has; what shakes, expands, scatters or
    flickers is gone."""
    tolerances = {"base": {"tolerance": 2e-4}, "theta_zero": {"tolerance": 3e-4}, "phi_scale": 2e-3}
    moving = {"vibration": {"turn": [[5.0, 1e-10], [100.0, 1e-12]]}, "stray_light": 0.01, "power_noise": 0.02}
    own = {} if seed is None else {"seed": seed}
    given = scenario(scanner={"as_built": tolerances | moving | own}, transport={"light_seed": light})
    drawn = instrument_as_built(given)
    steady = departures._steady(given)
    found = [instrument_as_built(one) for one in (steady, steady.model_copy(update={"seed": 12345}))]
    assert drawn is not None
    for one in found:
        assert one is not None
        np.testing.assert_array_equal(one.parameters, drawn.parameters)
    assert np.count_nonzero(drawn.parameters) == 3
    kept = steady.scanner.as_built
    assert kept is not None
    for name in ("vibration", "stray_light", "power_noise"):
        assert getattr(kept, name) is None
        assert getattr(given.scanner.as_built, name) is not None
    assert departures._steady(scenario()) == scenario()


@pytest.mark.parametrize(
    ("sensor", "full"),
    [
        ({"adc_bits": 8, "bias": 5, "gain": 3.0}, 250 * 3.0),
        ({"adc_bits": 8, "bias": 5, "gain": 3.0, "full_well": 700.0}, 700.0),
        ({"adc_bits": 8, "bias": 5, "full_well": 700.0}, 700.0),
    ],
    ids=["converter", "pixel", "any gain"],
)
def test_a_pixel_is_full_where_it_or_the_converter_is(sensor: dict[str, Any], full: float) -> None:
    """Claim: eight bits tell 0 to 255, of which the bias takes five; without a gain of its own it follows the well."""
    given = scenario(scanner={"position_sensor": sensor})
    assert light._well(ComparisonSetup(given)) == pytest.approx(full)


def test_forms_of_an_estimator_are_functions_of_their_names() -> None:
    """Claim: what is neither of the two, or is no function, is refused with its name and both words."""
    forms = EstimatorForms.of({"sigma": lambda line, variance: 0.5})
    assert (forms.position, forms.sigma is None) == (None, False)
    for given in ({"sigma": 0.5}, {"place": len}, {"position": len, "sigma": None}):
        with pytest.raises(InputError, match=r"closed_forms: '(sigma|place)' is no closed form") as fault:
            EstimatorForms.of(given)  # type: ignore[arg-type]
        assert fault.value.remedy == "Possible: position, sigma."


def test_an_estimate_follows_its_spot_by_the_slope_at_its_own_place() -> None:
    """Claim: ∂p̂/∂p of a centre of mass of seven pixels, by differences of a line written anew: it is not 1 on a spot
    that its window cuts, and differs from place to place in a pixel; a fit, or what is corrected, follows wholly."""
    closed = ClosedForms(scenario(processing={"peak": "centre_of_mass"}))

    def line(place: float, sigma: float) -> np.ndarray:
        return np.asarray(np.diff(ndtr((np.arange(50) - 0.5 - place) / sigma)))

    slopes = []
    for phase in (-0.3, 0.02, 0.31):
        seen = ClosedSpot(centre=100.0 + phase, chief=100.0, sigma=1.9, charge=5e4, beam=0.5)
        both = [
            closed.estimated("centre_of_mass", 5e4 * line(24.0 + phase + side, 1.9)) for side in (1e-4, -1e-4)
        ]
        slopes.append((both[0] - both[1]) / 2e-4)
        assert closed.follows(seen) == pytest.approx(slopes[-1], abs=1e-5)
    assert np.ptp(slopes) > 1e-3
    for whole in ({"peak": FIT}, {"peak": "centre_of_mass", "bias_correction": "computed"}):
        assert ClosedForms(scenario(processing=whole)).follows(seen) == 1.0
