"""The Gaussian fit of an echo against another least-squares program, its first order, and tables of errors."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Digitiser, Photodiode, Pulse
from scipy.optimize import least_squares

from scanner_sim.foundation.errors import InputError
from scanner_sim.signals.line.bias import widths_of
from scanner_sim.signals.line.bias_table import BiasTable, read_bias, write_bias
from scanner_sim.signals.waveform.calibration import send_all_phases
from scanner_sim.signals.waveform.detection import Delays
from scanner_sim.signals.waveform.edge_timing import EdgeTiming, three_samples
from scanner_sim.signals.waveform.edges import _residuals
from scanner_sim.signals.waveform.filter import Noise
from scanner_sim.signals.waveform.fit import PulseFit, fit_gaussian, fit_weights

Array = NDArray[np.float64]

HALF = 4
TAPS = np.arange(-HALF, HALF + 1.0)

pytestmark = pytest.mark.usefixtures("device")


def peer(samples: Array, width: float) -> Array:
    """Return height, position and standard deviation of the Gaussian nearest to samples, by SciPy."""

    def left(values: Array) -> Array:
        height, position, sigma = values
        return np.asarray(samples - height * np.exp(-0.5 * ((TAPS - position) / sigma) ** 2))

    start = [samples.max(), TAPS[samples.argmax()], width]
    return np.asarray(least_squares(left, start, xtol=1e-14, ftol=1e-14, gtol=1e-14).x)


@pytest.mark.parametrize("guess", [1.0, 3.0])
def test_the_gaussian_of_least_squares(guess: float) -> None:
    """Claim: height, position and width are those of the least sum of squares, of pulses that are no Gaussians too.

    Set-up: 12 pulses off the middle by up to 0.6 samples, skewed by up to a tenth, with noise of 2 %; a first guess of
    the height that is the middle sample, and one three times as high. Tolerance: that of single precision and of
    eight steps of Gauss and Newton.
    """
    rng = np.random.default_rng(5)
    shifts, skew = np.linspace(-0.6, 0.6, 12), np.linspace(-0.1, 0.1, 12)
    away = (TAPS[:, None] - shifts) / 1.4
    samples = 300.0 * np.exp(-0.5 * away**2) * (1.0 + skew * away) + 6.0 * rng.standard_normal(away.shape)
    rows = [auto.Float(row.astype(np.float32)) for row in samples]
    nowhere = auto.Float(np.zeros(12, np.float32)), auto.UInt32(np.zeros(12, np.uint32))
    fit, sigma = fit_gaussian(rows, PulseFit(nowhere[0], guess * rows[HALF], nowhere[1]), 1.3)
    wanted = np.array([peer(column, 1.3) for column in samples.T])
    np.testing.assert_allclose(fit.amplitude.numpy(), wanted[:, 0], rtol=2e-4)
    np.testing.assert_allclose(fit.shift.numpy(), wanted[:, 1], atol=3e-4)
    np.testing.assert_allclose(sigma.numpy(), wanted[:, 2], rtol=3e-4)


@pytest.mark.parametrize("width", [1.1, 1.7])
def test_weights_of_the_gaussian_fit_are_its_slopes(width: float) -> None:
    """Claim: a sample that is larger by a part of the height moves the Gaussian by its weight: by differences."""
    bell = np.exp(-0.5 * (TAPS / width) ** 2)
    step = 1e-4
    slopes = [
        (peer(bell + h, width)[1] - peer(bell - h, width)[1]) / (2.0 * step) for h in step * np.eye(len(TAPS))
    ]
    np.testing.assert_allclose(fit_weights(HALF, width)[1], slopes, atol=1e-6)


def test_a_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Claim: widths, shifts and errors come back, each where it stood; a line that is missing or elsewhere is told."""
    widths, shifts = np.array([0.8, 1.1]), np.array([-0.5, -0.1, 0.2, 0.5])
    table = BiasTable("parabola", widths, shifts, np.arange(8.0).reshape(2, 4) / 100.0 - 0.03)
    path = tmp_path / "bias.csv"
    write_bias(table, path)
    found = read_bias(path)
    assert found.estimator == "parabola"
    for name in ("widths", "shifts", "bias"):
        np.testing.assert_allclose(getattr(found, name), getattr(table, name), atol=1e-12)
    lines = path.read_text(encoding="utf-8").splitlines()
    for bad in (lines[:-1], [*lines[:3], lines[4], lines[3], *lines[5:]], lines[:5], ["# x", *lines[1:]]):
        path.write_text("\n".join(bad), encoding="utf-8")
        with pytest.raises(InputError):
            read_bias(path)


def test_between_the_nodes_of_a_table_errors_are_linear() -> None:
    widths, shifts = np.array([0.8, 1.2]), np.array([-0.5, 0.0, 0.5])
    table = BiasTable("parabola", widths, shifts, np.array([[-0.02, 0.0, 0.02], [-0.06, 0.01, 0.04]]))
    found = table.at(np.array([0.5, 0.9, 2.0]), np.array([-0.25, 0.1, 9.0]))
    at_nodes = np.array([[-0.01, 0.004, 0.02], [-0.025, 0.016, 0.04]])
    wanted = [at_nodes[0], 0.75 * at_nodes[0] + 0.25 * at_nodes[1], at_nodes[1]]
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_a_spot_is_as_wide_as_its_narrowest_and_widest_place() -> None:
    """Claim: least and largest width are those of both variances together; a fifth wider at the
    largest deflection, of 30° at most."""
    beam, spread = np.array([1.0, 4.0, 2.0]), np.array([0.5, 0.2, 0.1])
    spot: Any = SimpleNamespace(pixels=3, variances=lambda _pixels, _theta, _facing: (beam, spread))
    least, largest = widths_of(spot)
    assert least == pytest.approx(math.sqrt(1.5))
    assert largest == pytest.approx(1.2 * math.sqrt(4.2))
    assert largest > math.sqrt(4.2) / math.cos(math.radians(30.0))


@pytest.mark.parametrize("fraction", [0.3, 0.5])
def test_a_fraction_of_the_peak_is_crossed_at_the_pulses_own_delay(fraction: float) -> None:
    """Claim: without noise the crossing of a fraction, less what the shape makes of it, is the delay at every phase of
    the samples, and the height is one number. Tolerance: 2e-3 samples, of straight lines between samples and nodes."""
    parts: Any = Pulse(), Photodiode(), Digitiser()
    noise = Noise(coloured=1e-16, white=1e-17, per_current=0.0, sigma=0.6)
    timing = EdgeTiming(*parts, noise, fraction)
    waveforms, truth, top = send_all_phases(*parts, 50)
    found = timing.fraction_of(waveforms, top, dr.full(auto.Float, 1e-16, 50), top >= 0)
    assert found.whole.numpy().all()
    place = found.sample.numpy() + found.shift.numpy().astype(np.float64)
    np.testing.assert_allclose(place, truth, atol=2e-3)
    assert np.ptp(found.height.numpy()) / found.height.numpy().mean() < 2e-3


@pytest.mark.parametrize("shape", ["gaussian", "t2_exponential"])
def test_the_height_of_a_pulse_is_that_of_its_top(shape: Any) -> None:
    """Claim: from three samples about the highest, or the one beside it, the height is one number at every phase.

    Tolerance: 1 % of the table's nodes; by the vertex alone heights of a lopsided pulse differ by more than that.
    """
    parts: Any = Pulse(shape=shape), Photodiode(), Digitiser()
    timing = EdgeTiming(*parts, Noise(coloured=1e-16, white=1e-17, per_current=0.0, sigma=0.6), 0.5)
    waveforms, truth, top = send_all_phases(*parts, 64)
    first = waveforms.records()
    heights = []
    for step in (0, 1):
        at = auto.UInt32(auto.Int32(top) + step)
        three = three_samples(waveforms, at, top >= 0)
        position, height = timing._summit(three)
        near = np.abs(position.numpy()) < 0.95
        assert near.sum() > 16
        heights.append(height.numpy()[near])
    both = np.concatenate(heights)
    assert np.isfinite(both).all()
    assert both.max() / both.min() - 1.0 < 0.01
    assert both.mean() == pytest.approx(first.max(), rel=0.02)
    assert np.ptp(truth) > 0.95


def test_delays_are_seconds_since_the_pulse() -> None:
    """Claim: (sample + fraction)/rate after the record's start, in double precision."""
    digitiser = Digitiser(rate=2e9)
    whole, part = np.array([0, 3, 412]), np.array([0.25, 0.5, 0.875])
    none: Any = auto.Float(0.0)
    delays = Delays(auto.Int32(whole.astype(np.int32)), auto.Float(part.astype(np.float32)), *[none] * 6)
    np.testing.assert_allclose(delays.seconds(digitiser), digitiser.start + (whole + part) / 2e9, rtol=1e-14)


def test_what_a_table_leaves_is_the_root_mean_square_about_each_row() -> None:
    """Claim: a table of 16 rows a sample, whose delays are all 2 samples and whose heights 3, leaves of other pulses
    their errors' root mean square within a quarter of a sample, and between rows without a pulse what lies between."""
    rows, density = 64, 16
    table: Any = SimpleNamespace(
        rows=rows,
        density=density,
        correction=lambda edges: SimpleNamespace(
            delay=SimpleNamespace(value=auto.Float([2.0] * 9)),
            log_height=SimpleNamespace(value=auto.Float([3.0] * 9)),
        ),
    )
    row = np.array([10, 10, 10, 11, 30, 30, 50, 50, 50])
    lead = np.linspace(0.1, 0.5, 9)
    width = (row + 0.5) / density - lead
    error = np.array([0.3, -0.1, 0.2, 0.4, -0.6, 0.2, 0.1, 0.1, -0.1])
    found, height = _residuals(table, width, lead, 2.0 + error, 3.0 - 2.0 * error)
    np.testing.assert_allclose(height, 2.0 * found, rtol=1e-6)
    first, middle = np.sqrt(np.mean(error[:4] ** 2)), np.sqrt(np.mean(error[4:6] ** 2))
    assert found[10] == pytest.approx(first, rel=1e-6)
    assert found[30] == pytest.approx(middle, rel=1e-6)
    assert found[50] == pytest.approx(0.1, rel=1e-6)
    assert found[0] == found[7]
    assert found[63] == pytest.approx(0.1, rel=1e-6)
    between = found[15:28]
    np.testing.assert_allclose(np.diff(between, 2), 0.0, atol=1e-9)
