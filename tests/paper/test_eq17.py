"""Eq 17 and Figure 16: the Sun's spectrum, as a black body and as measured."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scanner_sim.analytic import sun as judge
from scanner_sim.scene.light.lighting import Sun
from scanner_sim.scene.light.sun import irradiance_between, solar_irradiance, total_irradiance

PLANCK, MEASURED = Sun(), Sun(spectrum="astm_g173")


def test_numbers_of_the_paper() -> None:
    """Claim: a black body of 5770 K of the Sun's size sends 1355.1 W/m², and 0.2487 W/m²/nm at 1.5 µm.

    Set-up: eq 17 with the radius 695 000 km (a zero is lost in print) at 149.68e6 km. Expected: by hand,
    σT⁴ = 5.670374e-8 × 5770⁴ = 6.28515e7 W/m², times (695e6/149.68e9)² = 2.15598e-5: 1355.06 W/m²; hc/λkT =
    1.662361, 2πhc²/λ⁵ = 4.92744e13, over (e^1.662361 − 1) = 4.27174 and times the same: 2.48689e8. The paper
    prints 1353 W/m². Tolerance: half of the last digit.
    """
    for total, line in (
        (judge.total_irradiance(), float(judge.planck_irradiance(1.5e-6))),
        (total_irradiance(PLANCK), float(solar_irradiance(PLANCK, 1.5e-6))),
    ):
        assert total == pytest.approx(1355.06, abs=5e-3)
        assert 1e-9 * line == pytest.approx(0.248689, abs=5e-7)


@given(wavelength=st.floats(0.2e-6, 20e-6), temperature=st.floats(2000.0, 10_000.0))
def test_spectrum_is_the_judges(wavelength: float, temperature: float) -> None:
    """Claim: the simulator's black body is the judge's at every wavelength and temperature.

    Set-up: 0.2–20 µm, 2000–10 000 K; colour-science on one side, eq 17 written out on the other. Expected:
    equal. Tolerance: 1e-10, rounding. The radiation constants of ITS-90 would be 3e-5 off.
    """
    got = solar_irradiance(Sun(temperature=temperature), wavelength)
    assert float(got) == pytest.approx(float(judge.planck_irradiance(wavelength, temperature)), rel=1e-10)


@pytest.mark.parametrize("low", [0.3e-6, 0.9e-6, 1.485e-6, 3e-6])
def test_integrals_are_the_judges(low: float) -> None:
    """Claim: integrals over a band are right.

    Set-up: from ``low`` to 1.7 or 10 µm; the judge has the series of the black body's fraction. Tolerance:
    1e-6, the trapezoidal rule on 20 001 wavelengths.
    """
    high = 1.7e-6 if low < 1.7e-6 else 10e-6
    below = judge.fraction_below(np.array([low, high]))
    expected = judge.total_irradiance() * float(below[1] - below[0])
    assert irradiance_between(PLANCK, low, high) == pytest.approx(expected, rel=1e-6)


def test_measured_spectrum() -> None:
    """Claim: ASTM G-173 outside of the atmosphere has 0.2931 W/m²/nm over 1490–1510 nm and 1347.9 W/m² in all.

    Set-up: the simulator's ``astm_g173``. Expected: these, 0.2696 at 1550 nm (both from the standard's table),
    18–21 % above the black body near 1.5 µm, and 27 % of it within 0.9–1.7 µm. Tolerance: half of the last digit.
    """
    assert 1e-9 * irradiance_between(MEASURED, 1490e-9, 1510e-9) / 20e-9 == pytest.approx(0.2931, abs=5e-5)
    assert 1e-9 * float(solar_irradiance(MEASURED, 1550e-9)) == pytest.approx(0.2696, abs=5e-5)
    assert total_irradiance(MEASURED) == pytest.approx(1347.9, abs=0.05)
    ratio = solar_irradiance(MEASURED, [1490e-9, 1500e-9, 1510e-9, 1550e-9]) / judge.planck_irradiance(
        [1490e-9, 1500e-9, 1510e-9, 1550e-9]
    )
    assert 1.18 < ratio.mean() < 1.21
    share = irradiance_between(MEASURED, 0.9e-6, 1.7e-6) / total_irradiance(MEASURED)
    assert share == pytest.approx(0.27, abs=5e-3)


def test_measured_spectrum_ends_with_its_table() -> None:
    """Claim: nothing is invented outside of 280–4000 nm. Expected: zero there. Tolerance: none."""
    assert not solar_irradiance(MEASURED, [200e-9, 279e-9, 4.1e-6, 10e-6]).any()
    assert irradiance_between(MEASURED, 5e-6, 6e-6) == 0.0


def test_figure_16() -> None:
    """Claim: the three curves of Figure 16: black body and measurement agree outside, the atmosphere absorbs.

    Set-up: the judge's curves from 280 nm to 4 µm. Expected: both simulator's spectra are the first two curves;
    the measured total is within 1 % of the black body's; on the ground light is missing, almost all of it in the
    water band at 1.38 µm and little of it at 1.5–1.7 µm. Tolerance: 1e-10 for the curves.
    """
    curves = judge.solar_spectra()
    np.testing.assert_allclose(solar_irradiance(PLANCK, curves.wavelength), curves.planck, rtol=1e-10)
    np.testing.assert_allclose(solar_irradiance(MEASURED, curves.wavelength), curves.outside, rtol=1e-10)
    outside, ground = (np.trapezoid(curve, curves.wavelength) for curve in (curves.outside, curves.ground))
    assert outside == pytest.approx(judge.total_irradiance(), rel=1e-2)
    assert ground == pytest.approx(1000.4, abs=0.05)

    def passed(low: float, high: float) -> float:
        inside = (curves.wavelength >= low) & (curves.wavelength <= high)
        return float(curves.ground[inside].sum() / curves.outside[inside].sum())

    assert passed(1.36e-6, 1.40e-6) < 0.02
    assert passed(1.5e-6, 1.7e-6) > 0.85


def test_disc() -> None:
    """Claim: the Sun's disc is 9.29 mrad wide. Expected: 2 × 695e6/149.68e9 m. Tolerance: half a digit."""
    assert 2e3 * Sun().angular_radius == pytest.approx(9.29, abs=5e-3)
