"""The sensor's axis: p = 0 is infinity, p grows towards nearer ranges; pixel i has its centre at i."""

from __future__ import annotations

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from prototype import PositionSensor

from scanner_sim.analytic import spot
from scanner_sim.detector.line.exposure import expose, pairwise
from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.optics.deflection import deflected_frame
from scanner_sim.ranging import triangulation
from scanner_sim.ranging.ranges import Geometry
from scanner_sim.render.device import Device
from scanner_sim.signals.line.peaks import find_peaks
from scanner_sim.signals.processing import Processing

F, D = 0.1, 0.2


def test_infinity_images_at_zero() -> None:
    assert triangulation.position_from_range(1e12, 0.3, F, D) < 1e-12


def test_nearer_images_at_larger_p() -> None:
    p = triangulation.position_from_range(np.array([1.6, 3.0, 30.0]), 0.0, F, D)
    assert (np.diff(p) < 0.0).all()
    assert (p > 0.0).all()


def test_p_runs_against_across() -> None:
    """The lens turns the picture round: what lies to the left of its axis (−across) images at positive p."""
    frame = deflected_frame(0.0, 1.0, 0.0, 1.0, 0.05, D)
    seen = np.subtract(np.array([0.0, 0.0, 5.0]), frame.lens)
    assert seen @ np.array(frame.across) < 0.0
    assert triangulation.position_from_range(5.0, 0.0, F, D) > 0.0


def test_range_falls_with_p() -> None:
    by_p, _ = triangulation.range_jacobian(4e-3, 0.2, F, D)
    assert by_p < 0.0


def test_position_of_a_pixel() -> None:
    """Pixel i spans offset + i pitch to offset + (i + 1) pitch: its centre is half a pitch further."""
    geometry = Geometry(
        scale=F, baseline=D, axis_separation=0.05, pitch=50e-6, offset=1e-3, synchronisation=0.0
    )
    np.testing.assert_allclose(geometry.position(np.array([0.0, 10.0, 10.5])), [1.025e-3, 1.525e-3, 1.55e-3])


def test_pixel_has_its_centre_at_its_number(device: Device) -> None:
    """A spot that is even about pixel 13 is found at 13.0; one between 13 and 14 at 13.5. Shots come first."""
    light = spot.pixel_shares(np.array([13.0, 13.5]), np.ones(2), 32)
    lines = auto.Float((1e-10 * light).astype(np.float32).ravel())
    sensor = PositionSensor(
        pixels=32, noise=NoiseSwitches(**dict.fromkeys(NoiseSwitches.model_fields, False))
    )
    signal = expose(
        pairwise(lambda pixel, place: dr.gather(auto.Float, lines, place * 32 + pixel)),
        dr.arange(auto.UInt32, 2),
        sensor,
        1.5e-6,
        50e-6,
        0,
    )
    assert signal.lines().shape == (2, 32)
    assert np.argmax(signal.lines()[0]) == 13
    peaks = find_peaks(signal, sensor, Processing(), 50e-6)
    np.testing.assert_allclose(peaks.position.numpy(), [13.0, 13.5], atol=1e-4)


def test_a_receiver_that_looks_further_right_sees_the_spot_nearer(device: Device) -> None:
    """Positive synchronisation turns the lens's axis to the right of the spot, whose p grows by f e."""
    import mitsuba as mi

    from scanner_sim.config.scanner import Scanner
    from scanner_sim.render.beam.line_projection import synchronisation_shift
    from scanner_sim.render.transport import OpticalLayout

    scanner = Scanner()
    bench = OpticalLayout(scanner.laser, scanner.receiver, 0.05, 1.0, 50e-6, 250e-6, 0.0, 40e-6)
    moved = synchronisation_shift(bench, mi.Float(0.0), mi.Float(1e-5))
    np.testing.assert_allclose(moved.numpy(), 1e-6, rtol=1e-5)
