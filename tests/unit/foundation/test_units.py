"""Units at the door: what is understood, what is refused, and how values are written back."""

from __future__ import annotations

import math
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scanner_sim.foundation import units
from scanner_sim.foundation.units import Dimension


def dimension(annotated: object) -> Dimension:
    return get_args(annotated)[1]


LENGTH, ANGLE, RATIO = (dimension(kind) for kind in (units.Length, units.Angle, units.Ratio))
ALL = [
    dimension(kind)
    for kind in (
        units.Length,
        units.Angle,
        units.Power,
        units.Frequency,
        units.Time,
        units.Electrons,
        units.ElectronRate,
        units.ElectronsPerNumber,
    )
]


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (LENGTH, "200 mm", 0.2),
        (LENGTH, "50 um", 50e-6),
        (LENGTH, "50 µm", 50e-6),
        (LENGTH, "1500nm", 1.5e-6),
        (LENGTH, "-1e-3 m", -1e-3),
        (LENGTH, "1 inch", 0.0254),
        (ANGLE, "15 deg", math.radians(15.0)),
        (ANGLE, "0.5 rad", 0.5),
        (ANGLE, "50 urad", 50e-6),
        (dimension(units.Power), "15 mW", 15e-3),
        (dimension(units.Frequency), "20 kHz", 20e3),
        (dimension(units.Frequency), "20000 1/s", None),
        (dimension(units.Electrons), "1000 e-", 1000.0),
        (dimension(units.ElectronRate), "2.5e7 e-/s", 2.5e7),
        (RATIO, "50 %", 0.5),
        (RATIO, "-60 dB", 1e-6),
        (RATIO, "60 dB", 1e6),
        (RATIO, "250 ppm", 250e-6),
        (RATIO, "0.25", 0.25),
        (dimension(units.RatioPerKelvin), "50 ppm/K", 50e-6),
        (dimension(units.AnglePerKelvin), "15 urad/K", 15e-6),
        (dimension(units.TemperatureRate), "3.6 K/h", 1e-3),
        (dimension(units.CurrentNoise), "2 pA/rtHz", 2e-12),
        (dimension(units.Responsivity), "0.95 A/W", 0.95),
        (dimension(units.Temperature), "5770 K", 5770.0),
    ],
)
def test_a_quantity_is_its_si_value(kind: Dimension, text: str, value: float | None) -> None:
    if value is None:
        with pytest.raises(ValueError, match="not a known unit"):
            kind.parse(text)
    else:
        assert kind.parse(text) == value


@pytest.mark.parametrize(
    ("kind", "text", "sentence"),
    [
        (LENGTH, "200", "has no unit"),
        (LENGTH, "3 kg", "cannot be converted to m"),
        (LENGTH, "3 metre stick", "not a known unit"),
        (LENGTH, "nan m", "not a number"),
        (LENGTH, "inf m", "not a number"),
        (LENGTH, "1e999 m", "not finite"),
        (LENGTH, "far", "not a number"),
        (LENGTH, "3 %", "not a known unit"),
        (LENGTH, "5 10**10**10 m", "not a known unit"),
        (LENGTH, "5 m; import os", "not a known unit"),
        (ANGLE, "3 %", "not a known unit"),
        (ANGLE, "3 m", "not a unit of angle"),
        (RATIO, "3 m", "no unit of a ratio"),
        (RATIO, "9999 dB", "too large"),
        (dimension(units.Temperature), "20 degC", "not a number of kelvins"),
        (dimension(units.Temperature), "20", "not a number of kelvins"),
        (dimension(units.Temperature), "warm K", "not a number of kelvins"),
        (dimension(units.CurrentNoise), "2 pA/Hz", "cannot be converted"),
        (dimension(units.RatioPerKelvin), "50 ppm", "cannot be converted"),
    ],
)
def test_what_is_no_quantity_is_refused_with_a_sentence(kind: Dimension, text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        kind.parse(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [("5770 K", 5770.0), ("5770K", 5770.0), (" 5770 kelvin ", 5770.0), ("2 kelvins", 2.0), ("250 mK", 0.25)],
)
def test_kelvins_are_written_as_other_units_are(text: str, value: float) -> None:
    """Claim: with a space before them or without, in full or with a prefix."""
    assert dimension(units.Temperature).parse(text) == value


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.unit)
@given(value=st.floats(allow_nan=False, allow_infinity=False, min_value=-1e30, max_value=1e30))
def test_what_is_written_is_read_back_to_the_last_bit(kind: Dimension, value: float) -> None:
    text = kind.format(value)
    assert isinstance(text, str)
    assert kind.parse(text) == value


@pytest.mark.parametrize(
    ("kind", "value", "text"),
    [
        (LENGTH, 0.2, "0.2 m"),
        (LENGTH, 50e-6, "50 um"),
        (LENGTH, 1.5e-6, "1.5 um"),
        (LENGTH, 0.0, "0 m"),
        (LENGTH, 123.456789, "123.456789 m"),
        (LENGTH, 0.1 + 0.2, "0.30000000000000004 m"),
        (ANGLE, math.radians(15.0), "15 deg"),
        (ANGLE, math.radians(-33.3), "-33.3 deg"),
        (ANGLE, 0.5, "0.5 rad"),
        (ANGLE, 8e-6, "8 urad"),
        (dimension(units.Power), 15e-3, "15 mW"),
        (dimension(units.Frequency), 20e3, "20 kHz"),
        (dimension(units.Electrons), 5e7, "5e7 electron"),
    ],
)
def test_values_are_written_as_a_person_would(kind: Dimension, value: float, text: str) -> None:
    assert kind.format(value) == text


def test_ratios_stay_plain_numbers() -> None:
    assert RATIO.format(0.05) == 0.05
