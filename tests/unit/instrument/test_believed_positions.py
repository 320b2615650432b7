"""What the closed loop believes of positions: what a calibration's errors make of those that two ways measure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import load_scenario
from scanner_sim.config.calibration import believed_geometry, calibration_text, design_of
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.instrument.closed_loop.believed_positions import BelievedPositions, RangeNoise
from scanner_sim.instrument.closed_loop.target_sensor import TargetSensor
from scanner_sim.ranging import fusion
from scanner_sim.ranging.believed import Design
from scanner_sim.ranging.calibration import Calibration, position_in_common
from scanner_sim.ranging.ranges import Deflections, Ranges

Array = NDArray[np.float64]

PLACE = np.array([[0.3, -0.25, 2.1], [-0.2, 0.1, 5.3], [0.05, 0.35, 9.2]])


def believed(sigma: float, prefix: str) -> tuple[BelievedPositions, Calibration]:
    """Return an instrument of both rangefinders whose parameters have one σ each, and its calibration."""
    none, count = np.zeros(len(NAMES)), len(NAMES)
    calibration = Calibration(none, sigma**2 * np.eye(count), Design(0.1, 0.2, 0.05), 0.4)
    made = object.__new__(BelievedPositions)
    made._calibration = calibration
    made._ways = {"": ("triangulation",)}
    if prefix:
        made._ways[prefix] = ("triangulation", "coaxial")
    return made, calibration


def test_each_way_has_the_share_in_common_errors_that_it_has_in_the_range() -> None:
    """Claim: shares are those of the least variance of the range, of noise and of the calibration together, with what
    both share of either; a way that measures nothing has none, and one way alone has all.

    Expected: the least of 100 001 shares. Tolerance: that of their steps.
    """
    made, calibration = believed(1e-4, "fused.")
    ways = [position_in_common(calibration, way, PLACE) for way in ("triangulation", "coaxial")]
    noise = np.array([[2e-3, 7e-3, np.inf], [3e-3, 1e-3, 4e-3]])
    shares = np.linspace(0.0, 1.0, 100_001)
    far = 1e-5 * np.abs(ways[0] - ways[1]).max()
    for shared in (np.zeros(3), np.array([3.6e-6, 4.2e-6, 0.0]), np.array([-3.6e-6, -4.2e-6, 0.0])):
        found = made.in_common(PLACE, lambda c=shared: RangeNoise(*noise, c))
        for number in range(2):
            one, other = (
                own[number] ** 2 + (part[number, 2] ** 2).sum() for own, part in zip(noise, ways, strict=True)
            )
            c = shared[number] + ways[0][number, 2] @ ways[1][number, 2]
            least = np.argmin(
                (1.0 - shares) ** 2 * one + shares**2 * other + 2.0 * shares * (1.0 - shares) * c
            )
            wanted = (1.0 - shares[least]) * ways[0][number] + shares[least] * ways[1][number]
            np.testing.assert_allclose(found[number], wanted, rtol=0.0, atol=far)
        np.testing.assert_allclose(found[2], ways[1][2], rtol=1e-12, atol=1e-15)
    alone, calibration = believed(1e-4, "")
    np.testing.assert_array_equal(
        alone.in_common(PLACE, lambda: pytest.fail("one way needs no noise")), ways[0]
    )


def test_an_exact_instrument_has_no_common_errors() -> None:
    made, _ = believed(0.0, "fused.")
    assert made.in_common(PLACE, lambda: pytest.fail("there is nothing to weigh")).shape == (3, 3, 0)


def test_ranges_of_visits_vary_together_as_those_of_voxels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: at one place the covariance of the noise of both ranges is the one by which a voxel's are fused, with the
    believed base, 30 mm longer than the designed one, which the photodiode beside the projector has, too.

    Expected: what :func:`~scanner_sim.ranging.fusion.fuse_points` hands on, by a calibration without errors.
    """
    disc = {"name": "node", "array": {"diameter": 0.1, "plate": 0.4}, "position": (0.1, 0.05, 9.0)}
    known = load_scenario(
        {
            "schema": 1,
            "scanner": {"lidar": {"photodiode": {"place": "offset"}}},
            "ranging": "both",
            "scene": {"objects": [disc]},
            "scan": {"type": "track", "targets": ["node"]},
        }
    )
    values = np.zeros(len(NAMES))
    values[INDEX["base"]] = 0.03
    own = Calibration(values, np.zeros((len(NAMES), len(NAMES))), design_of(known.scanner), 0.4)
    (tmp_path / "known.yaml").write_text(calibration_text(own, known.scanner), encoding="utf-8")
    known = known.replace({"processing.calibration": str(tmp_path / "known.yaml")})
    time = np.array([0.1, 0.2, 0.3])
    theta, phi, r = PLACE.T
    told: list[Array] = []

    class FusedError(Exception):
        pass

    def fuse(_: Any, __: Any, covariance: Array) -> None:
        told.append(covariance)
        raise FusedError

    monkeypatch.setattr(fusion, "fuse", fuse)
    one: Any = Ranges(r, 1e-3 + 0.0 * r, r, r, r, None, np.zeros(3, dtype=np.uint32))  # type: ignore[arg-type]
    other = replace(one, sigma=2e-3 + 0.0 * r)
    sigma = (known.scanner.mirrors.reading_sigma(angle, time) for angle in (theta, phi))
    with pytest.raises(FusedError):
        fusion.fuse_points(one, other, Deflections(theta, phi, *sigma), believed_geometry(known))
    instrument: Any = None
    found = TargetSensor([known], instrument)._range_covariance(PLACE, time)
    np.testing.assert_allclose(found, told[0], rtol=1e-12)
