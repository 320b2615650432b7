"""The Gaussian beam (section 2: "a collimated laser beam"; the law is Siegman's, *Lasers*, 1986, ch. 17)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from prototype import Laser

from scanner_sim.analytic import beam


@given(z=st.floats(0.0, 100.0), w0=st.floats(1e-4, 1e-2), z0=st.floats(-20.0, 20.0), m2=st.floats(1.0, 20.0))
def test_radius_is_the_judges(z: float, w0: float, z0: float, m2: float) -> None:
    """Claim: the laser's radius at any distance is the judge's.

    Set-up: waists of 0.1–10 mm anywhere, M² up to 20, 1.5 µm. Expected: equal. Tolerance: 1e-12, rounding.
    """
    laser = Laser(waist_radius=w0, waist_distance=z0, m_squared=m2)
    assert laser.radius(z) == pytest.approx(float(beam.beam_radius(z, w0, z0, 1.5e-6, m2)), rel=1e-12)


def test_numbers_of_the_preset() -> None:
    """Claim: the preset's beam has a Rayleigh length of 8.4 m and a diameter of 6.2 mm at 10 m.

    Set-up: waist 2 mm, 1.5 µm, M² 1. Expected: by hand, π × 4e-6/1.5e-6 = 8.3776 m and
    4 mm × √(1 + (10/8.3776)²) = 6.2287 mm. Tolerance: half of the last digit.
    """
    laser = Laser()
    assert laser.rayleigh_length == pytest.approx(8.3776, abs=5e-5)
    assert 2e3 * laser.radius(10.0) == pytest.approx(6.2287, abs=5e-5)
    assert laser.divergence == pytest.approx(1.5e-6 / (np.pi * 2e-3), rel=1e-12)


def test_spread_rate_is_the_slope_of_the_radius() -> None:
    """Claim: the judge's ``spread_rate`` is w'/w.

    Set-up: central differences of ``beam_radius`` at 0–40 m, waist at 3 m, M² 2. Tolerance: 1e-8 of 1/z_R; the
    differences are good to (step/z_R)² = 1e-9.
    """
    z, h = np.linspace(0.0, 40.0, 41), 1e-4
    ahead, here, behind = (beam.beam_radius(z + s, 2e-3, 3.0, 1.5e-6, 2.0) for s in (h, 0.0, -h))
    slope = (ahead - behind) / (2.0 * h) / here
    np.testing.assert_allclose(beam.spread_rate(z, 2e-3, 3.0, 1.5e-6, 2.0), slope, rtol=0.0, atol=1e-8)
