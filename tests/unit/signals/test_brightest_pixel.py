"""The brightest pixel of a line, and the brightest that is no part of its peak, wherever they lie."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest

from scanner_sim.signals.line.search import brightest_pixel

PIXELS = 37

pytestmark = pytest.mark.usefixtures("device")


@pytest.mark.parametrize("apart", [3, 6, 7, 15])
def test_peaks_are_found_in_every_pixel(apart: int) -> None:
    """Claim: by plain comparison of all pixels; what lies more than six pixels away is another peak."""
    charges = np.random.default_rng(1).uniform(0.0, 10.0, (PIXELS, PIXELS)).astype(np.float32)
    place = np.arange(PIXELS)
    charges[place, (place + apart) % PIXELS] = 50.0
    charges[place, place] = 100.0
    table, shot = auto.Float(charges.ravel()), dr.arange(auto.UInt32, PIXELS)
    line: Any = SimpleNamespace(
        pixels=PIXELS,
        shots=PIXELS,
        floor_sigma=2.0,
        charge=lambda pixel: dr.gather(auto.Float, table, shot * PIXELS + pixel),
    )
    found = brightest_pixel(line)
    np.testing.assert_array_equal(found.pixel.numpy(), place)
    np.testing.assert_array_equal(found.height.numpy(), 100.0)
    np.testing.assert_array_equal(found.level.numpy(), 50.0)
    far = np.abs(place[:, None] - place) > 6
    wanted = np.where(far, charges, -np.inf).max(axis=1)
    np.testing.assert_array_equal(found.rival.numpy(), wanted)
    np.testing.assert_array_equal(found.rival_level.numpy(), 0.5 * wanted)
