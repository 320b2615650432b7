"""Which source makes most of the stated σ of time of flight."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from scanner_sim import load_scenario
from scanner_sim.analytic.echo_budget import echo_budget
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.render.device import Device
from scanner_sim.scan.raster import raster_aim
from scanner_sim.signals.waveform.detection import PulseDetector
from scanner_sim.validation.compare.instrument import echo_instrument_of
from scanner_sim.validation.studies import dominance

Array = NDArray[np.float64]
SOURCES = ("shot", "amplifier", "quantisation", "clock", "deflection")
DISTANCE = 20.0


def scenario(**parts: Any) -> Any:
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": (8.0, 8.0),
        "position": (0.0, 0.0, DISTANCE),
        "material": {"reflectance": 0.5},
    }
    scan = {"rows": 3, "columns": 3, "horizontal": (-0.02, 0.02), "vertical": (-0.02, 0.02)}
    told = {"schema": 1, "ranging": "tof", "scene": {"objects": [wall]}, "scan": scan}
    return load_scenario(told | parts)


def test_parts_of_time_of_flight_are_those_of_the_closed_forms(device: Device) -> None:
    """Claim: of a facing wall at 20 m, where nothing is clipped, each source has its part of the judge's σ².

    Tolerance: 5 % of the part of shot noise, which makes nearly all; 25 % of those a hundredth as large, since the
    filter reckons with a little white noise on top, for pulses that are not quite known, and the judge's does not.
    """
    known = scenario()
    found = dominance.dominating(known, device="cpu")
    assert (found.mode, found.sources) == ("tof", SOURCES)
    closed = echo_budget(echo_instrument_of(known, 0.5), DISTANCE)
    for name, slack in (("shot", 0.05), ("amplifier", 0.25), ("quantisation", 0.25)):
        parts = found.variances[found.sources.index(name)]
        np.testing.assert_allclose(parts.mean(), closed[name] ** 2, rtol=slack, err_msg=name)
    jitter = 0.5 * 299_792_458.0 * known.scanner.lidar.digitiser.jitter
    np.testing.assert_allclose(found.variances[3], jitter**2, rtol=1e-9)
    np.testing.assert_array_equal(found.variances[4], 0.0)


@pytest.mark.parametrize("timing", ["matched_filter", "leading_edge"])
def test_parts_of_time_of_flight_add_up(device: Device, timing: str) -> None:
    """Claim: weights, levels and thresholds stay, so that the parts are the stated σ²; the mirrors' is (∂R/∂Θ σ_Θ)².

    Set-up: the clock is left out, whose jitter would be nearly all of σ²; the lens stands beside the laser, so that an
    error of Θ moves ranges, and the encoders err by 10 mrad alone. Expected: ∂R/∂Θ at a fixed way R + √(R² + d² −
    2 R d sinΘ), solved for R on either side of Θ. Tolerance: 10⁻³ for single precision in differences of σ².
    """
    lidar = {"photodiode": {"place": "offset", "field_of_view": 0.05, "noise": {"clock": False}}}
    mirrors = {"jitter": 0.0, "wobble": 0.0, "readout_step": 0.0, "readout_noise": 1e-2}
    known = scenario(processing={"pulse": {"timing": timing}}, scanner={"lidar": lidar, "mirrors": mirrors})
    found = dominance.dominating(known, device="cpu")
    instrument = Instrument(known, device="cpu")
    scan = known.raster
    aim = raster_aim(scan, np.arange(scan.shots, dtype=np.uint32), known.scanner.dwell)
    shots, pointing = instrument.fire(aim)
    told = instrument.time_of_flight.measure(aim, shots, instrument.deflections(aim, pointing))
    sigma = told.ranges.sigma.reshape(3, 3)
    np.testing.assert_allclose(found.variances.sum(axis=0), sigma**2, rtol=1e-3)
    np.testing.assert_array_equal(found.variances[3], 0.0)
    base, at, step = known.scanner.receiver.baseline, np.tile(scan.angles()[0], 3), 1e-4

    def way(r: float, theta: float) -> float:
        return r + math.sqrt(r**2 + base**2 - 2.0 * r * base * math.sin(theta))

    def range_of(length: float, theta: float) -> float:
        return float(brentq(lambda r: way(r, theta) - length, 0.4 * length, 0.6 * length, xtol=1e-13))

    for number, (r, theta) in enumerate(zip(told.ranges.range.tolist(), at.tolist(), strict=True)):
        above, below = (range_of(way(r, theta), near) for near in (theta + step, theta - step))
        expected = ((above - below) / (2.0 * step) * 1e-2) ** 2
        assert found.variances[4].flat[number] == pytest.approx(expected, rel=1e-3)
        assert 0.01 < expected / sigma.flat[number] ** 2 < 1.0


def test_detections_are_made_once_for_all_batches(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: nine shots by twos have the parts that they have at once, by three detections, one for each source."""
    known, made = scenario(), []
    whole = dominance.dominating(known, device="cpu").variances
    stating = PulseDetector.stating
    monkeypatch.setattr(dominance, "_BATCH", 2)
    monkeypatch.setattr(
        PulseDetector, "stating", lambda self, diode: made.append(diode.noise) or stating(self, diode)
    )
    np.testing.assert_allclose(dominance.dominating(known, device="cpu").variances, whole, rtol=1e-5)
    assert [[name for name in SOURCES[:3] if not getattr(noise, name)] for noise in made] == [
        ["shot"], ["amplifier"], ["quantisation"],
    ]  # fmt: skip


def test_ranges_beyond_the_gate_have_no_parts(device: Device) -> None:
    """Claim: a wall at 20 m and a gate to 19 m: no voxel has a source."""
    known = scenario(processing={"range_gate": (1.0, DISTANCE - 1.0)})
    found = dominance.dominating(known, device="cpu")
    assert np.isnan(found.variances).all()
    assert (found.largest == -1).all()


def test_variance_that_goes_is_a_sources() -> None:
    """Claim: σ of 5, and of 4 without a source, leave 9 to it; more without it, or no answer, leave nothing."""
    found = dominance._gone(np.array([5.0, 5.0, 5.0]), np.array([[4.0, 6.0, math.nan]]))
    np.testing.assert_array_equal(found, [[9.0, 0.0, 0.0]])
