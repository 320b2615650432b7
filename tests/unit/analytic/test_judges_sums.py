"""Closed forms and quadratures of the judge, each by a plain sum: sweeps over planes, receivers, estimators."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.geometry import swept_image
from scanner_sim.analytic.noise import white_noise_performance
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.analytic.sun import SUN_DISTANCE, SUN_RADIUS, effective_irradiance, planck_irradiance
from scanner_sim.analytic.time_of_flight import excess_noise, noise_bandwidth, receiver_snr

F, D, D_G = 0.1, 0.2, 0.05


@pytest.mark.parametrize("travel", [(0.02, 0.0), (0.0, 0.03), (0.01, -0.015)])
def test_light_of_a_sweep_is_averaged_by_what_the_lens_receives(travel: tuple[float, float]) -> None:
    """Claim: mean and deviation of the image's place over the sweep, by 4001 rays turned about both axes; the place is
    f tan of the angle at the lens, the weight cosθ at the surface, cosθ at the lens, over r²."""
    point, normal = np.array([0.0, 0.1, 4.0]), np.array([0.6, -0.3, -1.0])
    share = (np.arange(4001) + 0.5) / 4001.0 - 0.5
    places, weights = [], []
    for theta, phi in zip(0.1 + travel[0] * share, -0.05 + travel[1] * share, strict=True):
        turn = Rotation.from_rotvec([-phi, 0.0, 0.0])
        axis = np.array([0.0, 0.0, D_G])

        def placed(flat: np.ndarray, turn: Rotation = turn, axis: np.ndarray = axis) -> np.ndarray:
            return np.asarray(axis + turn.apply(flat - axis))

        along = np.array([math.sin(theta), 0.0, math.cos(theta)])
        start, ahead = placed(np.zeros(3)), turn.apply(along)
        reach = (point - start) @ normal / (ahead @ normal)
        met = start + reach * ahead
        # Laser and lens turn with the beam: the lens is d cosΘ aside of it and d sinΘ along it.
        lens = placed(np.array([D, 0.0, 0.0]))
        sight = met - lens
        far = np.linalg.norm(sight)
        side = turn.apply(np.array([math.cos(theta), 0.0, -math.sin(theta)]))
        places.append(-F * (sight @ side) / (sight @ ahead))
        weights.append(abs(sight @ normal) / far * (sight @ ahead) / far / far**2)
    mean = np.average(places, weights=weights)
    deviation = math.sqrt(np.average((np.array(places) - mean) ** 2, weights=weights))
    found = swept_image(0.1, -0.05, travel, F, D, D_G, point, normal)
    assert found == pytest.approx((mean, deviation), rel=1e-6)


def test_a_receivers_noise_is_the_sum_of_its_currents() -> None:
    """Claim: shot noise 2 q I B of light and bulk dark current, M² F times multiplied, of the surface's once, and the
    amplifier's; the signal is M R₀ P. Each alone, then together: variances over the signal's square add up."""
    q, base = 1.602176634e-19, {"gain": 40.0, "responsivity": 0.9, "k": 0.2, "bandwidth": 2e8}
    light, B = 3e-8, noise_bandwidth(2e8)
    none = {"bulk": 0.0, "surface": 0.0, "amplifier": 0.0}
    signal = 40.0 * 0.9 * light
    F_M = excess_noise(40.0, 0.2)
    variances = {
        "light": 2.0 * q * 40.0**2 * F_M * 0.9 * light * B,
        "background": 2.0 * q * 40.0**2 * F_M * 0.9 * 7e-8 * B,
        "bulk": 2.0 * q * 40.0**2 * F_M * 5e-8 * B,
        "surface": 2.0 * q * 4e-6 * B,
        "amplifier": (3e-12) ** 2 * B,
    }
    given = {"bulk": 5e-8, "surface": 4e-6, "amplifier": 3e-12}
    for names in (
        ("light",),
        ("light", "background"),
        ("light", "bulk"),
        ("light", "surface"),
        ("light", "amplifier"),
        tuple(variances),
    ):
        more = none | {name: given[name] for name in names if name in given}
        found = receiver_snr(light, 7e-8 if "background" in names else 0.0, **base, **more)
        assert found == pytest.approx(signal / math.sqrt(sum(variances[name] for name in names)), rel=1e-9)
    assert noise_bandwidth(2e8) == pytest.approx(2e8, rel=0.6)
    assert excess_noise(40.0, 0.0) == pytest.approx(2.0 - 1.0 / 40.0)


@pytest.mark.parametrize("name", list(ESTIMATORS))
def test_an_estimators_performance_is_that_of_its_differences(name: str) -> None:
    """Claim: the largest bias over the places, and the root mean square of √Σ (∂x/∂c)² with noise of the highest pixel
    over the ratio; by central differences of the estimator."""
    places = (np.arange(8) + 0.5) / 8.0 - 0.5
    bias, variance = [], []
    for place in places:
        line = pixel_shares(16 + place, 0.9, 32)
        bias.append(abs(ESTIMATORS[name](line.tolist()) - 16.0 - place))
        step, total = 1e-5 * line.max(), 0.0
        for pixel in range(32):
            ahead, behind = line.copy(), line.copy()
            ahead[pixel] += step
            behind[pixel] -= step
            slope = (ESTIMATORS[name](ahead.tolist()) - ESTIMATORS[name](behind.tolist())) / (2.0 * step)
            total += (slope * line.max() / 80.0) ** 2
        variance.append(total)
    found = white_noise_performance(name, 0.9, 80.0, phases=8)
    assert found.bias == pytest.approx(max(bias), abs=1e-6)
    assert found.sd == pytest.approx(math.sqrt(np.mean(variance)), rel=1e-4)


def test_a_filter_leaks_its_share_of_all_sunlight() -> None:
    """Claim: eq 18's bracket is the band's irradiance and B_s/B_p of σ T⁴ (R_s/D_s)², by CODATA's σ."""
    whole = 5.670374e-8 * 5800.0**4 * (SUN_RADIUS / SUN_DISTANCE) ** 2
    band = effective_irradiance(1.5e-6, 30e-9, 0.0, 5800.0)
    assert band == pytest.approx(float(planck_irradiance(1.5e-6, 5800.0)) * 30e-9, rel=1e-3)
    assert effective_irradiance(1.5e-6, 30e-9, 2e-3, 5800.0) - band == pytest.approx(2e-3 * whole, rel=1e-6)
