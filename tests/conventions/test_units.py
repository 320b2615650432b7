"""Units: SI inside; decibels are power ratios; angles are optical and in radians."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter

from scanner_sim.foundation.channels import CHANNELS
from scanner_sim.foundation.units import FROM_FILE, Angle, Electrons, Length, Power, Ratio
from scanner_sim.products.lines import LineSet
from scanner_sim.products.signal_set import SignalSet
from scanner_sim.products.waveforms import WaveformSet


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
    assert TypeAdapter(kind).validate_python(text, context=FROM_FILE) == pytest.approx(
        value, rel=1e-12, abs=0.0
    )


def test_python_speaks_si() -> None:
    assert TypeAdapter(Length).validate_python(0.2) == 0.2


ENDINGS = {"m": "m", "m2": "m2", "rad": "rad", "px": "pixel", "w": "W"}
COUNTED = ("Y", "tof.Y", "background", "background_error", "background_peak")
POINTS = ("P.X", "P.Y", "P.Z")


def test_the_name_of_a_channel_ends_in_its_unit() -> None:
    """Claim: the ending of a channel's name is its SI unit; charges are in electrons, and all else has no unit."""
    for channel in CHANNELS:
        ending = channel.name.rpartition("_")[2] if "_" in channel.name else ""
        own = channel.name.rpartition(".")[0].rpartition("P")[0] + channel.name[-3:]
        wanted = (
            "electron" if channel.name in COUNTED else "m" if own[-3:] in POINTS else ENDINGS.get(ending, "1")
        )
        assert channel.unit == wanted, channel.name
    assert sum(channel.unit == "m2" for channel in CHANNELS) == 9
    assert sum(channel.unit == "rad" for channel in CHANNELS) == 3
    assert sum(channel.unit == "pixel" for channel in CHANNELS) == 2


@pytest.mark.parametrize("kind", [LineSet, WaveformSet])
def test_the_name_of_a_signals_column_ends_in_its_unit(kind: type[SignalSet]) -> None:
    """Claim: the same holds for kept lines and waveforms, with seconds and amperes; what a column means is a phrase."""
    endings = ENDINGS | {"s": "s", "a": "A", "Y": "electron"}
    for column in kind.COLUMNS:
        wanted = "electron" if column.name == "Y" else endings.get(column.name.rpartition("_")[2], "1")
        assert column.unit == wanted, column.name
        assert " " in column.meaning, column.name
