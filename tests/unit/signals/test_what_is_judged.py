"""Where peaks lie on a line, which fits of echoes are sane, and what a dark line is traced with."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest

from scanner_sim.signals.line import dark_line
from scanner_sim.signals.line.digital_line import Around
from scanner_sim.signals.waveform.detection import PulseDetector

pytestmark = pytest.mark.usefixtures("device")


def test_pixels_about_a_peak_end_with_the_line() -> None:
    """Claim: of nine pixels the first and the last are on the line, and what lies beyond is the last one's."""
    line: Any = SimpleNamespace(pixels=9, floor_sigma=3.0, full=lambda pixel: pixel == 8)
    none: Any = None
    around = Around(line, auto.Int32([3, 3, 3, 3, 3]), none)
    step = auto.Int32([-4, -3, 0, 5, 6])
    assert around.inside(step).numpy().tolist() == [False, True, True, True, False]
    assert around.pixel(step).numpy().tolist() == [0, 0, 3, 8, 8]
    assert around.full(step).numpy().tolist() == [False, False, False, True, True]
    assert around.floor_sigma == 3.0


def test_a_fit_is_sane_where_there_is_a_pulse_within_its_samples() -> None:
    """Claim: of good peaks those whose amplitude is above 0 and whose shift is less than half of what was fitted to."""
    shift, amplitude = [0.5, -1.9, 2.1, -2.1, 0.3, 0.3], [4.0, 4.0, 4.0, 4.0, -1.0, 4.0]
    good = [True, True, True, True, True, False]
    fit = SimpleNamespace(
        shift=auto.Float(shift), amplitude=auto.Float(amplitude), phase=auto.Float(np.zeros(6))
    )
    detector: Any = object.__new__(PulseDetector)
    about = {
        "half": 2,
        "step": 0.5,
        "matched": True,
        "settings": SimpleNamespace(timing="matched_filter"),
        "shape": SimpleNamespace(summit=0.0),
        "_stated": (None, SimpleNamespace(white=3.0, per_current=0.5)),
        "timing": SimpleNamespace(
            fit=lambda *_: fit, variances=lambda _: ((2.0, 0.25, 0.125), (1.0, 0.5, 2.0))
        ),
    }
    for name, value in about.items():
        object.__setattr__(detector, name, value)
    samples = [auto.Float(np.full(6, value)) for value in (0.0, 1.0, 3.0, 1.5, 0.0)]
    waveforms: Any = SimpleNamespace(shots=6)
    found: Any = SimpleNamespace(sample=auto.UInt32(np.arange(6)))
    timed = detector._time_echo(waveforms, found, samples, auto.Float(np.full(6, 7.0)), auto.Bool(good))
    assert timed.whole.numpy().tolist() == [True, True, False, False, False, False]
    np.testing.assert_allclose(timed.shift.numpy(), shift, rtol=1e-6)
    np.testing.assert_allclose(timed.height.numpy(), 0.5 * np.array(amplitude))
    # Coloured noise, white noise and the current's own, each by its weight; of the shift over the current's square.
    wanted = (7.0 * 2.0 + 3.0 * 0.25 + 2.0 * 0.5 * 0.125) / 4.0
    np.testing.assert_allclose(timed.variance.numpy()[:4], wanted, rtol=1e-6)
    wanted = 7.0 * 1.0 + 3.0 * 0.5 + 2.0 * 0.5 * 2.0
    np.testing.assert_allclose(timed.height_variance.numpy()[:4], wanted, rtol=1e-6)


def test_a_dark_line_is_traced_with_a_spot_of_no_light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: instruments that differ in the light of a white surface alone share what is traced: it is told later."""
    asked: list[Any] = []
    monkeypatch.setattr(dark_line, "_traced", lambda *known: asked.append(known))
    spot: Any = SimpleNamespace(lit=lambda *light: ("spot", light))
    sensor: Any = "sensor"
    dark_line.dark_line(sensor, sensor, 0.1, spot, None)
    assert asked == [(auto.Float, "sensor", "sensor", 0.1, ("spot", (0.0, 0.0)), None)]
