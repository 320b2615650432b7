"""What the laws of a comparison predict of speckle: how much of a spot its place is fitted to."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from made_settings import Array, setting

from scanner_sim.validation.compare import speckle


@pytest.mark.parametrize(("sigma", "guard"), [(1.25, 5), (1.26, 6), (2.0, 8), (1.21, 5)])
def test_a_spot_in_speckle_is_fitted_to_four_standard_deviations(
    sigma: float, guard: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: to each side as many whole pixels as hold four standard deviations, about the place where it lies on its
    pixel; the scatter of the places [pixel] times that of a range per pixel is σ, and of several places of a pixel the
    mean of the squares counts."""
    told = setting()
    seen = [SimpleNamespace(sigma=sigma, phase=phase) for phase in (0.125, 0.375)]
    monkeypatch.setattr(speckle, "spots", lambda _, R: [(R, one) for one in seen])
    monkeypatch.setattr(speckle, "_seen", lambda *_: np.ones((2, 4, 9)))
    asked: list[tuple[float, float, int]] = []

    def fitted(lines: Array, centre: float, width: float, reach: int) -> Array:
        asked.append((centre, width, reach))
        return np.array([0.0, 3.0, 4.0, 5.0]) * (1.0 if len(asked) % 2 else 2.0)

    monkeypatch.setattr(speckle, "fitted_place", fitted)
    found = speckle._predict_limit(told)
    middle = speckle._LINE // 2
    assert asked[:2] == [(middle + 0.125, sigma, guard), (middle + 0.375, sigma, guard)]
    ranges = speckle._ranges(told)
    # Of 0, 3, 4, 5 the mean is 3 and the variance (9 + 0 + 1 + 4)/3.
    spread = math.sqrt(0.5 * (1.0 + 4.0) * 14.0 / 3.0)
    for R in ranges:
        assert found[f"{R:.4g} m"].value == pytest.approx(
            1e3 * told.closed.range_per_pixel(R) * spread, rel=1e-9
        )
