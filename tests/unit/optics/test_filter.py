"""The interference filter: its shape, what moves it, and what it lets the detector count."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from prototype import BandpassFilter, Laser, PositionSensor
from pydantic import TypeAdapter, ValidationError

from scanner_sim.config.scanner import Scanner
from scanner_sim.optics.band_irradiance import band_irradiance
from scanner_sim.optics.filter import (
    FilterChoice,
    centre_at,
    filter_warnings,
    incidence,
    laser_gain,
    passband,
    peak_transmission,
)
from scanner_sim.scene.light.lighting import Sun

LASER, INGAAS = Laser(), (0.9e-6, 1.7e-6)
REAL = BandpassFilter(shape="cavities")


def test_tophat_ends_at_half_its_width() -> None:
    wavelengths = 1.5e-6 + np.array([-15.001, -14.999, 0.0, 14.999, 15.001]) * 1e-9
    assert passband(BandpassFilter(), wavelengths, nominal=1.5e-6).tolist() == [0.0, 1.0, 1.0, 1.0, 0.0]


@pytest.mark.parametrize("cavities", [2, 3, 5])
def test_a_real_filter_has_its_stated_width_and_skirts(cavities: int) -> None:
    """Half of the peak at half the width; beyond, each factor of 10 takes 20 dB per cavity."""
    real = BandpassFilter(shape="cavities", cavities=cavities)
    wavelengths = 1.5e-6 + np.array([0.0, 15.0, -15.0, 150.0]) * 1e-9
    peak, right, left, far = passband(real, wavelengths, nominal=1.5e-6)
    assert peak == 1.0
    assert (right, left) == pytest.approx((0.5, 0.5), rel=1e-9)
    assert 10.0 * math.log10(far) == pytest.approx(-20.0 * cavities, abs=1e-3)


@given(
    shape=st.sampled_from(["tophat", "cavities"]),
    wavelength=st.floats(0.2e-6, 30e-6),
    angle=st.floats(-1.5, 1.5),
    bandwidth=st.floats(1e-11, 1e-6),
)
def test_a_passband_lies_between_0_and_1_and_knows_no_left_or_right(
    shape: str, wavelength: float, angle: float, bandwidth: float
) -> None:
    chosen = BandpassFilter(shape=shape, bandwidth=bandwidth)
    share = passband(chosen, wavelength, angle, nominal=1.5e-6)
    assert 0.0 <= share <= 1.0
    assert share == passband(chosen, wavelength, -angle, nominal=1.5e-6)


def test_blue_shift() -> None:
    """λ₀ √(1 − sin²θ/n²): 1.43 nm at 5° for n = 2, by hand 1500 (1 − √(1 − 0.0075961/4)); always to the blue."""
    assert 1e9 * (1.5e-6 - centre_at(1.5e-6, 2.0, math.radians(5.0))) == pytest.approx(1.425, abs=5e-4)
    angles = np.linspace(0.0, 1.0, 50)
    assert (np.diff(centre_at(1.5e-6, 2.0, angles)) < 0.0).all()
    assert centre_at(1.5e-6, 3.0, 0.3) > centre_at(1.5e-6, 2.0, 0.3)


def test_incidence_follows_from_the_place_on_the_array() -> None:
    assert incidence(0.0, 0.1) == 0.0
    assert np.degrees(incidence(12.8e-3, 0.1)) == pytest.approx(7.29, abs=0.01)


@pytest.mark.parametrize(
    ("drift", "angle", "passes"),
    [(0.0, 0.0, True), (14e-9, 0.0, True), (16e-9, 0.0, False), (-16e-9, 0.0, False),
     (14e-9, 0.128, False), (-16e-9, 0.128, True)],
)  # fmt: skip
def test_drift_and_blue_shift_add_up(drift: float, angle: float, passes: bool) -> None:
    """At 0.128 rad the band moves 3.06 nm to the blue: it loses a line that drifted to the red, and gains one
    that drifted to the blue."""
    gain = laser_gain(BandpassFilter(), Laser(drift=drift), INGAAS, angle)
    assert gain == (1.0 if passes else pytest.approx(1e-6, rel=1e-9))


def test_outside_of_the_response_nothing_counts() -> None:
    assert laser_gain(BandpassFilter(centre=1.8e-6), Laser(wavelength=1.8e-6), INGAAS) == 0.0
    assert laser_gain("none", Laser(wavelength=0.8e-6), INGAAS) == 0.0
    assert laser_gain("none", LASER, INGAAS) == 1.0


def test_gain_keeps_the_shape_of_the_incidence() -> None:
    angles = np.zeros((3, 4))
    assert laser_gain(REAL, LASER, INGAAS, angles).shape == (3, 4)
    inside, outside = band_irradiance(Sun(), REAL, INGAAS, 1.5e-6, angles)
    assert inside.shape == outside.shape == (3, 4)


def test_a_real_filter_passes_more_than_its_width() -> None:
    """∫ dx/(1 + x^2m) = π/m / sin(π/2m): 1.0472 of the tophat for m = 3. A tolerance of 1e-3 for the spectrum."""
    (tophat, _), (real, _) = (
        band_irradiance(Sun(), chosen, INGAAS, 1.5e-6) for chosen in (BandpassFilter(), REAL)
    )
    assert real / tophat == pytest.approx(math.pi / 6.0 / math.sin(math.pi / 6.0), rel=1e-3)


def test_light_is_either_in_the_band_or_blocked() -> None:
    """Without blocking both add up to everything, at any place of the band; half of a band outside does not count."""
    everything = float(band_irradiance(Sun(), "none", INGAAS, 1.5e-6)[1])
    for shape in ("tophat", "cavities"):
        leaky = BandpassFilter(shape=shape, blocking=0.1, bandwidth="100 nm")
        inside, outside = band_irradiance(Sun(), leaky, INGAAS, 1.5e-6)
        assert inside + outside / 0.1 == pytest.approx(everything, rel=1e-9)
    middle, edge, beyond = (
        float(band_irradiance(Sun(), BandpassFilter(centre=centre), INGAAS, 1.5e-6)[0])
        for centre in (1.68e-6, 1.7e-6, 1.72e-6)
    )
    assert 0.45 < edge / middle < 0.55
    assert beyond == 0.0


def test_light_is_counted_by_its_photons() -> None:
    """A watt at 1 µm frees two thirds of the electrons of a watt at 1.5 µm, where the laser is."""
    at_laser, elsewhere = (
        float(band_irradiance(Sun(), BandpassFilter(centre=1e-6, bandwidth=1e-9), INGAAS, wavelength)[0])
        for wavelength in (1e-6, 1.5e-6)
    )
    assert elsewhere / at_laser == pytest.approx(2.0 / 3.0, rel=1e-9)


def test_the_blue_shift_moves_the_sunlight_too() -> None:
    at_normal, askew = band_irradiance(Sun(), BandpassFilter(), INGAAS, 1.5e-6, [0.0, 0.128])[0]
    assert askew > at_normal  # the Sun is brighter to the blue


@pytest.mark.parametrize(
    ("chosen", "laser", "words"),
    [
        (BandpassFilter(), LASER, ""),
        ("none", LASER, ""),
        (BandpassFilter(centre=1.55e-6), LASER, "misses the laser's 1500 nm, so hardly any"),
        (BandpassFilter(), Laser(drift=20e-9), "misses the laser's 1520 nm"),
        (BandpassFilter(bandwidth=5e-9), LASER, "near ranges image"),
        (BandpassFilter(shape="cavities", centre=1.518e-6), LASER, "most of the light is lost"),
        ("none", Laser(wavelength=1.8e-6), "outside of it"),
    ],
)
def test_doubts(chosen: FilterChoice, laser: Laser, words: str) -> None:
    """A filter that misses the line is possible, and said."""
    found = filter_warnings(chosen, laser, INGAAS, 0.128)
    assert len(found) == (1 if words else 0)
    assert words in "".join(found)


def test_none_is_a_filter_that_passes_everything() -> None:
    scanner = Scanner.model_validate({"filter": "none"})
    assert scanner.filter == "none"
    assert peak_transmission(scanner.filter) == 1.0
    assert peak_transmission(BandpassFilter(transmission=0.7)) == 0.7
    assert passband("none", [0.3e-6, 10e-6], nominal=1.5e-6).tolist() == [1.0, 1.0]
    assert Scanner.model_validate(scanner.model_dump(mode="json")) == scanner


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"bandwidth": 0.0}, "bandwidth"),
        ({"bandwidth": 0.93e-6, "centre": 0.9e-6}, "a band of 930 nm is wider than its centre of 900 nm"),
        ({"blocking": "10 dB"}, "blocking"),
        ({"effective_index": 1.0}, "effective_index"),
        ({"shape": "round"}, "shape"),
        ({"cavities": 1}, "cavities"),
    ],
)
def test_impossible_filters(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words) as caught:
        BandpassFilter(**wrong)
    assert caught.value.error_count() == 1


def test_no_other_word_is_a_filter() -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(FilterChoice).validate_python("off")


def test_a_response_ascends() -> None:
    with pytest.raises(ValidationError, match="ascend"):
        PositionSensor(response=(1.7e-6, 0.9e-6))
