"""Eq 18 and Figure 17: sunlight that the detector collects, and the laser over it.

The first tests fix the judge; the others hold the simulator's irradiances in and out of the band against it.
"""

from __future__ import annotations

import numpy as np
import pytest
from prototype import BandpassFilter

from scanner_sim.analytic import sun as judge
from scanner_sim.optics.band_irradiance import band_irradiance
from scanner_sim.scene.light.lighting import Sun

P, F, S, WAVELENGTH = 15e-3, 0.1, 200e-6 * 250e-6, 1.5e-6
INGAAS = (0.9e-6, 1.7e-6)


@pytest.mark.parametrize(
    ("bandwidth", "at_ten_metres", "equal_range"), [(10e-9, 12.06, 34.7), (30e-9, 4.02, 20.05)]
)
def test_check_values(bandwidth: float, at_ten_metres: float, equal_range: float) -> None:
    """Claim: with 15 mW, f 100 mm and 200 × 250 µm the laser is 12.06 (4.02) times the Sun at 10 m.

    Set-up: black body, filter of 10 (30) nm, 60 dB. Expected: by hand for 10 nm, E_eff = 10 × 0.248689 +
    1e-6 × 1355.06 = 2.4882 W/m², 15e-3 × 0.01/(100 × 5e-8 × 2.4882) = 12.057; SNR = 1 at 10 m × √12.057 =
    34.7 m; for 30 nm at 20.05 m: "operational at distances of up to 20 m". Tolerance: half of the last digit.
    """
    E_eff = judge.effective_irradiance(WAVELENGTH, bandwidth)
    assert judge.signal_to_sun(10.0, P, F, S, E_eff) == pytest.approx(at_ten_metres, abs=5e-3)
    assert judge.equal_range(P, F, S, E_eff) == pytest.approx(equal_range, abs=5e-2)


def test_twenty_metres_with_thirty_nanometres() -> None:
    """Claim: SNR = 1.005 at 20 m with 30 nm. Expected: 4.0197/4 = 1.0049. Tolerance: half of the last digit."""
    E_eff = judge.effective_irradiance(WAVELENGTH, 30e-9)
    assert judge.signal_to_sun(20.0, P, F, S, E_eff) == pytest.approx(1.005, abs=5e-4)


def test_laws() -> None:
    """Claim: SNR falls as R⁻² and 1/S, grows as f², and falls as 1/bandwidth but for the blocked light.

    Set-up: 2–30 m, doubled S, f and bandwidth. Expected: slope −2, factors 1/2, 4 and 1/2; with blocking a
    little more than 1/2. Tolerance: rounding; 1e-3 for the bandwidth, as the spectrum curves within it.
    """
    R = np.array([2.0, 5.0, 10.0, 20.0, 30.0])
    E_eff = judge.effective_irradiance(WAVELENGTH, 30e-9)
    snr = judge.signal_to_sun(R, P, F, S, E_eff)
    assert np.polyfit(np.log(R), np.log(snr), 1)[0] == pytest.approx(-2.0, abs=1e-12)
    np.testing.assert_allclose(judge.signal_to_sun(R, P, F, 2.0 * S, E_eff), snr / 2.0)
    np.testing.assert_allclose(judge.signal_to_sun(R, P, 2.0 * F, S, E_eff), 4.0 * snr)
    narrow, wide = (judge.effective_irradiance(WAVELENGTH, width, blocking=0.0) for width in (20e-9, 40e-9))
    assert wide / narrow == pytest.approx(2.0, rel=1e-3)


def test_snr_is_the_ratio_of_both_equations() -> None:
    """Claim: reflectance, aperture and transmission cancel in eq 19 over eq 18.

    Set-up: I_laser = T_r B_p P/(π R²) by hand over ``sun_power`` for several of them at 10 m. Expected: the
    closed ratio, in the physical model; π times less in the printed one. Tolerance: rounding.
    """
    E_eff = judge.effective_irradiance(WAVELENGTH, 30e-9)
    for reflectance, B_p in ((0.05, 1e-4), (0.5, 2.4544e-4), (0.9, 1e-3)):
        laser = reflectance * B_p * P / (np.pi * 10.0**2)
        sun = judge.sun_power(reflectance, S, F, B_p, E_eff)
        printed = judge.sun_power(reflectance, S, F, B_p, E_eff, "printed")
        assert laser / sun == pytest.approx(float(judge.signal_to_sun(10.0, P, F, S, E_eff)), rel=1e-12)
        closed = float(judge.signal_to_sun(10.0, P, F, S, E_eff, "printed"))
        assert laser / printed == pytest.approx(closed, rel=1e-12)
        assert printed / sun == pytest.approx(np.pi, rel=1e-12)


@pytest.mark.parametrize("bandwidth", [10e-9, 30e-9, 50e-9])
def test_simulator_counts_the_light_of_eq_18(bandwidth: float) -> None:
    """Claim: the simulator's irradiances in and out of the band are the bracket of eq 18.

    Set-up: black body, tophat of 10, 30, 50 nm about the laser, 60 dB. Two things differ on purpose: a watt is
    counted by its photons (λ/λ₀), and the blocked light is what an InGaAs detector sees, not all of it.
    Expected in band: the judge's, as λ/λ₀ cancels about λ₀ but for the spectrum's slope E'/E = −2 per µm, which
    leaves E'/E Δλ²/(12 λ₀) = −2.7e-4 at 50 nm. Out of band: 1e-6 × ∫ E λ/λ₀ over 0.9–1.7 µm
    less the band, by the judge's spectrum. Both together: eq 18 within the blocked light that InGaAs does not
    see, 4e-4 of the bracket at 10 nm. Tolerances: 4e-4, 1e-5, 6e-4.
    """
    inside, outside = band_irradiance(Sun(), BandpassFilter(bandwidth=bandwidth), INGAAS, WAVELENGTH)
    assert inside == pytest.approx(judge.band_irradiance(WAVELENGTH, bandwidth), rel=4e-4)
    nodes = np.linspace(*INGAAS, 100_001)
    photons = np.trapezoid(judge.planck_irradiance(nodes) * nodes / WAVELENGTH, nodes)
    assert outside == pytest.approx(1e-6 * (photons - float(inside)), rel=1e-5)
    printed = judge.effective_irradiance(WAVELENGTH, bandwidth)
    assert inside + outside == pytest.approx(printed, rel=6e-4)


def test_measured_sun_is_a_fifth_stronger_in_the_band() -> None:
    """Claim: the measured spectrum lowers the SNR by 15 %: it has 18 % more light in 30 nm about 1.5 µm.

    Expected: ASTM G-173 has 0.2926 W/m²/nm there against 0.2487. Tolerance: half of the last digit.
    """
    (measured, _), (planck, _) = (
        band_irradiance(Sun(spectrum=spectrum), BandpassFilter(), INGAAS, WAVELENGTH)
        for spectrum in ("astm_g173", "planck")
    )
    assert measured / planck == pytest.approx(1.176, abs=5e-4)


def test_without_the_filter() -> None:
    """Claim: without the filter the detector takes 36 times the sunlight of 30 nm (the experiment of Figure 18).

    Set-up: ``filter: none``; all of it is out of band. Expected: ∫ E λ/λ₀ over 0.9–1.7 µm by the judge's spectrum,
    272.2 W/m² of laser-equivalent light; over 7.46 W/m² that is 36.5. Tolerance: 1e-5 and half of the last digit.
    """
    inside, outside = band_irradiance(Sun(), "none", INGAAS, WAVELENGTH)
    nodes = np.linspace(*INGAAS, 100_001)
    photons = np.trapezoid(judge.planck_irradiance(nodes) * nodes / WAVELENGTH, nodes)
    assert inside == 0.0
    assert outside == pytest.approx(photons, rel=1e-5)
    assert outside / judge.effective_irradiance(WAVELENGTH, 30e-9) == pytest.approx(36.5, abs=5e-2)
