"""The sensor's axis: p = 0 is infinity, p grows towards nearer ranges; pixel i has its centre at i."""

from __future__ import annotations

import numpy as np

from scanner_sim.analytic import spot
from scanner_sim.optics.deflection import deflected_frame
from scanner_sim.ranging import triangulation

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


def test_pixel_has_its_centre_at_its_number() -> None:
    """A spot at 3.0 lies evenly about pixel 3; at 3.5 it lies evenly on pixels 3 and 4."""
    on_pixel, between = spot.pixel_shares(np.array([3.0, 3.5]), 1.0, 8)
    assert np.argmax(on_pixel) == 3
    np.testing.assert_allclose(on_pixel[2], on_pixel[4], rtol=1e-12)
    np.testing.assert_allclose(between[3], between[4], rtol=1e-12)
