"""Budgets and pose studies as text, every number under its own name and null where there is none; lines of voxels."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, fields, replace
from typing import Any

import numpy as np
import pytest

from scanner_sim.products.budget import BudgetRow, Dominance, budget_json
from scanner_sim.products.pose_study import Exponent, Gain, PoseRow, PoseStudy, TargetRow, study_json
from scanner_sim.products.provenance import versions
from scanner_sim.products.voxel import VoxelRecord


def rows() -> list[BudgetRow]:
    """Return a budget of which time of flight is the more precise from √2 · 4 m by closed forms, and never as it was
    simulated."""
    made = []
    for distance, lines, pulses in (
        (2.0, 1e-3, 4e-3),
        (4.0, 2e-3, 3e-3),
        (8.0, 4.5e-3, 3e-3),
        (16.0, 9e-3, 2e-3),
    ):
        for mode, sigma in (("triangulation", lines), ("tof", pulses)):
            made.append(BudgetRow(mode, "all", distance, sigma, 5e-3, 4e-3, 7e-3, 77))  # type: ignore[arg-type]
            made.append(BudgetRow(mode, "shot", distance, 9.0, 9.0, 9.0, math.nan, 3))  # type: ignore[arg-type]
    return made


def test_a_budget_is_written_with_where_its_curves_cross() -> None:
    """Claim: between 4 m and 8 m the ratio of the curves goes from 2/3 to 3/2, and passes 1 in the middle of the
    logarithms; shares are those of measured voxels of which a source has the largest part, of one way of ranging."""
    variances = np.array(
        [[[3.0, 1.0, np.nan, 5.0, 1.0]], [[1.0, 2.0, 1.0, 4.0, 9.0]], [[2.0, 1.0, 1.0, 1.0, 1.0]]]
    )
    dominance = Dominance(("shot", "speckle", "read"), variances, np.zeros(5), np.zeros(1), "triangulation")
    found = json.loads(budget_json(rows(), 0.35, dominance, 2e-3, 6.5))
    assert found["crossing"] == {
        "analytic_m": pytest.approx(4.0 * math.sqrt(2.0)), "simulated_m": None, "at_rest_m": 6.5,
    }  # fmt: skip
    assert (found["reflectance"], found["sweep_rad"]) == (0.35, 2e-3)
    assert found["share_of_voxels_dominated"] == {"shot": 0.5, "speckle": 0.5, "read": 0.0}
    assert found["mode_of_voxels_dominated"] == "triangulation"
    timed = json.loads(budget_json(rows(), 0.35, replace(dominance, mode="tof")))
    assert timed["mode_of_voxels_dominated"] == "tof"
    assert found["rows"][2] == {
        "mode": "tof", "source": "all", "range_m": 2.0, "analytic_m": 4e-3, "simulated_m": 5e-3, "low_m": 4e-3,
        "high_m": 7e-3, "freedom": 77,
    }  # fmt: skip
    assert found["rows"][1]["high_m"] is None
    assert len(found["rows"]) == 16
    assert found["versions"] == dict(versions())
    bare = json.loads(budget_json(rows(), 0.35, None))
    assert bare["share_of_voxels_dominated"] is bare["sweep_rad"] is bare["crossing"]["at_rest_m"] is None
    assert bare["mode_of_voxels_dominated"] is None


def filled(kind: Any, start: int) -> Any:
    """Return a row of numbers that are all different, the last of them none."""
    numbers = [float(start + number) for number in range(len(fields(kind)) - 1)]
    return kind(*numbers, math.nan)


def test_a_study_is_written_table_by_table() -> None:
    tables = {
        "targets": (filled(TargetRow, 100),), "rows": (filled(PoseRow, 200), filled(PoseRow, 300)),
        "exponents": (filled(Exponent, 400),), "gains": (filled(Gain, 500),),
    }  # fmt: skip
    found = json.loads(study_json(PoseStudy("square", 1.25, **tables)))
    assert (found.pop("base"), found.pop("base_size_m"), found.pop("versions")) == (
        "square",
        1.25,
        dict(versions()),
    )
    assert found.keys() == tables.keys()
    for name, own in tables.items():
        wanted = [
            {key: None if value != value else value for key, value in asdict(row).items()} for row in own
        ]
        assert found[name] == wanted


@pytest.mark.parametrize(
    ("window", "held"),
    [(None, True), ((0, 8), True), ((3, 3), True), ((-1, 3), False), ((5, 4), False), ((4, 9), False)],
)
def test_a_window_lies_on_its_line(window: tuple[int, int] | None, held: bool) -> None:
    """Claim: of nine pixels those from the first to the last; two residuals are measured less true."""
    told: dict[str, Any] = dict.fromkeys((one.name for one in fields(VoxelRecord)), 0.0)
    told |= {name: np.zeros(9) for name in ("pixel_signal", "expected_signal", "noise_sigma")}
    told |= {"window": window, "peak_px": 4.5, "truth_peak_px": 4.25, "range_m": 7.0, "truth_range_m": 7.5}
    if held:
        made = VoxelRecord(**told)
        assert (made.pixels, made.residual_px, made.residual_m) == (9, 0.25, -0.5)
        with pytest.raises(ValueError, match="must have one shape"):
            VoxelRecord(**told | {"noise_sigma": np.zeros(8)})
        return
    with pytest.raises(ValueError, match="leaves the line of 9 pixels"):
        VoxelRecord(**told)
