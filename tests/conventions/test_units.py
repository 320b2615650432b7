"""Units: SI inside; decibels are power ratios; angles are optical and in radians."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter

from scanner_sim.units import FROM_FILE, Angle, Electrons, Length, Power, Ratio


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (Length, "200 mm", 0.2),
        (Length, "1.5 um", 1.5e-6),
        (Power, "15 mW", 0.015),
        (Angle, "180 deg", np.pi),
        (Electrons, "1000 electron", 1000.0),
        (Ratio, "-60 dB", 1e-6),
        (Ratio, "50 %", 0.5),
    ],
)
def test_files_speak_units_and_the_inside_si(kind: object, text: str, value: float) -> None:
    assert TypeAdapter(kind).validate_python(text, context=FROM_FILE) == pytest.approx(value, rel=1e-12)


def test_python_speaks_si() -> None:
    assert TypeAdapter(Length).validate_python(0.2) == 0.2
