"""How the error of synchronisation is measured: it alone, on facing plates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from made_settings import GREY, RANGES, Few, setting

from scanner_sim.validation.compare import constant_error
from scanner_sim.validation.compare.noise import plate_side


def test_synchronisation_errs_alone_on_facing_plates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 8000 shots straight ahead at each range and seed, of mirrors that err by nothing else; the plate has the
    grey and size of its range, the numbers are in mm, and seeds differ from range to range."""
    wanted: list[int] = []
    monkeypatch.setattr(Few, "shots", lambda _, number: wanted.append(number) or 4)
    told = setting(seeds=2)
    seeds: list[int] = []
    plates: list[tuple[float, float, float]] = []

    def made(given: Any, plate: float, *, seed: int, mirrors: Any) -> float:
        assert given is told
        errors = (mirrors.jitter, mirrors.wobble, mirrors.readout_noise, mirrors.readout_step)
        assert errors == (0.0, 0.0, 0.0, 0.0)
        assert mirrors.synchronisation == told.scenario.scanner.mirrors.synchronisation > 0.0
        seeds.append(seed)
        return plate

    def plate(distance: float, grey: float, *, size: float) -> float:
        plates.append((distance, grey, size))
        return distance

    def errors(given: Any, distance: float, aims: Any) -> np.ndarray:
        theta, phi, _, time = aims
        np.testing.assert_array_equal(theta, np.zeros(4))
        assert (phi, time) == (0.0, 0.0)
        return 1e-3 * distance * np.array([1.0, -1.0, 3.0, -3.0])

    for name, stub in (
        ("on_test_bench", made), ("plate", plate), ("range_errors", errors), ("directions", lambda *given: given)
    ):  # fmt: skip
        monkeypatch.setattr(constant_error.test_bench, name, stub)
    found = constant_error._measure_synchronisation(told)
    assert wanted == [8000]
    assert plates == [(R, GREY, plate_side(told, R)) for R in RANGES for _ in (1, 2)]
    assert seeds == [seed for step in range(3) for seed in told.seed(7, step)]
    for R in RANGES:
        # The squares of ±1 and ±3 are 20, over the three degrees that the mean leaves.
        assert found[f"{R:.4g} m"].value == pytest.approx(R * np.sqrt(20.0 / 3.0), rel=1e-12)
    # All of them grow as the range does.
    (slope,) = found.keys() - {f"{R:.4g} m" for R in RANGES}
    assert found[slope].value == pytest.approx(1.0)


def test_a_constant_error_grows_with_the_square_of_the_range() -> None:
    """Claim: σ_R = R²/(f d) Δp, Δp = f (1 + (d/R)²) times the error between the angles, in mm, sure to 2 parts in 1000
    and rounding; of three ranges an exponent of just below 2, as near ones have more."""
    told = setting()
    scanner, found = told.scenario.scanner, constant_error._predict_synchronisation(told)
    d, apart = scanner.receiver.baseline, scanner.mirrors.synchronisation
    for R in RANGES:
        one = found[f"{R:.4g} m"]
        assert one.value == pytest.approx(1e3 * R**2 / d * (1.0 + (d / R) ** 2) * apart, rel=1e-6)
        assert one.accuracy == pytest.approx(0.002 * one.value, rel=0.05)
    (slope,) = found.keys() - {f"{R:.4g} m" for R in RANGES}
    assert 1.98 < found[slope].value < 2.0


def test_the_error_is_by_what_the_estimate_follows() -> None:
    """Claim: where the centre of mass moves by less than its spot, so does the range."""
    told = setting(processing={"peak": "centre_of_mass"})
    whole, found = (constant_error._predict_synchronisation(one) for one in (setting(), told))
    for R in RANGES:
        follows = told.closed.follows(told.closed.facing(R, GREY))
        assert follows != 1.0
        name = f"{R:.4g} m"
        assert found[name].value == pytest.approx(follows * whole[name].value, rel=1e-9)
