"""What speckle's modes do to pixels and to sums of them, by integrals of Hermite functions."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.polynomial.hermite_e import HermiteE
from scipy.integrate import quad
from scipy.special import ndtr

from scanner_sim.signals.line.speckle import SpotSpeckle

pytestmark = pytest.mark.usefixtures("device")

SIGMA, WHOLE, RATIO, ENERGY, OTHERS, MODES = 1.3, 1.5, 0.8, 0.02, 0.03, 7


def speckle() -> SpotSpeckle:
    """Packets of 1.3 pixels in a spot of 1.5, of a mode of energy and seven others."""
    packets: Any = SimpleNamespace(sigma=auto.Float(SIGMA), ratio=auto.Float(RATIO))
    ratios = [auto.Float(RATIO)] * MODES
    return SpotSpeckle(packets, ratios, auto.Float(ENERGY), auto.Float(OTHERS), auto.Float(WHOLE))


def share(order: int, apart: float) -> float:
    """Return rⁿ ∫ He_n φ/√n! over a pixel so far from the spot's middle."""
    mode = HermiteE.basis(order)
    ends = (apart - 0.5) / SIGMA, (apart + 0.5) / SIGMA
    whole = quad(lambda x: mode(x) * math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi), *ends, epsabs=1e-12)[
        0
    ]
    return float(RATIO**order * whole / math.sqrt(math.factorial(order)))


def number(value: Any) -> float:
    return float(np.asarray(value.numpy()).ravel()[0])


@pytest.mark.parametrize("apart", [-2.6, -0.7, 0.0, 0.4, 1.9])
def test_pixels_vary_by_the_modes_beyond_energy_and_place(apart: float) -> None:
    wanted = OTHERS * sum(share(order, apart) ** 2 for order in range(2, MODES + 1))
    assert number(speckle().shape_variance(auto.Float(apart))) == pytest.approx(wanted, rel=1e-4, abs=1e-9)
    assert number(speckle().single) == pytest.approx(OTHERS * RATIO**4, rel=1e-6)


def test_a_quantity_varies_by_what_all_modes_do_to_it() -> None:
    """Claim: (Q/s)² (V₀ S₀² + V Σ S_n²) with S_n the sum of slopes times modes over the pixels, Q their charge and s
    the share of the spot that lies on them."""
    slopes = {-2: 0.3, -1: -0.5, 0: 0.2, 1: 0.7, 2: -0.1}
    charges = {-2: 10.0, -1: 90.0, 0: 150.0, 1: 110.0, 2: 30.0}
    shift = 0.35
    found = speckle().propagated_variance(
        {step: auto.Float(value) for step, value in slopes.items()},
        {step: auto.Float(value) for step, value in charges.items()},
        auto.Float(shift),
    )
    on_them = float(ndtr((2.5 - shift) / WHOLE) - ndtr((-2.5 - shift) / WHOLE))
    sums = [
        sum(slope * share(order, step - shift) for step, slope in slopes.items())
        for order in range(MODES + 1)
    ]
    modes = ENERGY * sums[0] ** 2 + OTHERS * sum(one**2 for one in sums[1:])
    assert number(found) == pytest.approx((sum(charges.values()) / on_them) ** 2 * modes, rel=1e-4)
