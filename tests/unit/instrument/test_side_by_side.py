"""Runs side by side, and what a calibrated loop believes: what must be alike, and readings there and back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim import Scenario, load_scenario
from scanner_sim.config.calibration import calibration_text, design_of
from scanner_sim.config.scanner import Scanner
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.instrument.closed_loop.believed_positions import BelievedPositions
from scanner_sim.instrument.closed_loop.track import check_alike
from scanner_sim.ranging.calibration import Calibration


def scenario(
    seed: int = 1, z: float = 9.0, x: float = 0.3, processing: dict[str, Any] | None = None, **scan: Any
) -> Scenario:
    """A node that moves, whose place is ``z``, before a wall that does not, whose place is ``x``."""
    return load_scenario(
        {
            "schema": 1,
            "seed": seed,
            "processing": processing or {},
            "scene": {
                "objects": [
                    {"name": "node", "array": {"diameter": 0.1, "plate": 0.4}, "position": (0.1, 0.05, z),
                     "motion": {"type": "twist"}},
                    {"name": "wall", "shape": "rectangle", "size": (4.0, 4.0), "position": (x, 0.0, 12.0),
                     "material": "z93_white"},
                ]
            },
            "scan": {"type": "track", "targets": ["node"], **scan},
        }
    )  # fmt: skip


def test_runs_side_by_side_are_alike_but_for_what_is_their_own() -> None:
    """Claim: seed, duration, tracker, expected places and the place of what moves are a run's own; of all else the
    first key that differs is named, and the first run in which it does."""
    own = scenario(2, 8.5, duration=0.7, targets=[{"target": "node", "offset": [0.01, -0.02, 0.1]}])
    check_alike([scenario()])
    check_alike([scenario(), own, scenario(3, duration=0.2, tracker={"acceleration_psd": 1e-3})])
    other, faster = scenario(x=0.4), scenario(pattern={"points": 24})
    for number, key, several in (
        (2, "scene.objects[1].position[0]", (scenario(), other, other)),
        (3, "scene.objects[1].position[0]", (scenario(), own, other)),
        (4, "scan.pattern.points", (own, scenario(), scenario(4), faster)),
    ):
        with pytest.raises(InputError) as caught:
            check_alike(several)
        assert f"scenario {number} differs from the first in '{key}';" in str(caught.value)
    with pytest.raises(InputError, match="no scenarios"):
        check_alike([])


def test_a_calibrated_loop_points_where_it_then_reads(tmp_path: Path) -> None:
    """Claim: by axes and encoders that depart from their design, the readings that the mirrors are told for a place by
    the designed axes mean the deflections from which that place was found; without a calibration all stays."""
    scanner, values = Scanner(), np.zeros(len(NAMES))
    for name, value in {
        "theta_zero": 1.2e-3, "theta_scale": 1e-3, "phi_zero": -2e-4, "phi_scale": -4e-4, "theta_cosine": 2e-5,
        "phi_sine": -3e-5, "axis_separation": 6e-4, "axis_offset": 4e-4, "axis_skew": 2e-3,
    }.items():  # fmt: skip
        values[INDEX[name]] = value
    known = Calibration(values, np.zeros((len(NAMES),) * 2), design_of(scanner), 0.05)
    (tmp_path / "own.yaml").write_text(calibration_text(known, scanner), encoding="utf-8")
    own = {"processing": {"calibration": str(tmp_path / "own.yaml")}}
    made, plain = (BelievedPositions(one) for one in (scenario(**own), scenario()))
    position = np.random.default_rng(6).uniform([-0.2, -0.2, 3.0], [0.2, 0.2, 8.0], (2, 5, 3))
    angles = np.swapaxes(position[..., :2], -1, -2)
    placed = made.designed(position)
    told = made.commands(placed)
    np.testing.assert_allclose(made.deflections(np.swapaxes(told, -1, -2)), angles, atol=1e-9)
    assert np.abs(told - placed[..., :2]).min() > 1e-5
    assert np.abs(placed - position).max(axis=(0, 1)).min() > 1e-5
    np.testing.assert_array_equal(plain.designed(position), position)
    np.testing.assert_array_equal(plain.commands(position), position[..., :2])
    np.testing.assert_array_equal(plain.deflections(angles), angles)
