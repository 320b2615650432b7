"""Poses of a study: what estimators are given, from the errors of a pool, and closed forms beside what they find."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.analytic.geometry import point_from_shot
from scanner_sim.pose.target_layouts import square
from scanner_sim.products.pose_study import PoseRow, TargetRow
from scanner_sim.validation.compare import pose_forms
from scanner_sim.validation.studies.pose_study import _observed

SCAN = {"type": "raster", "rows": 2, "columns": 2, "horizontal": [-0.1, 0.1], "vertical": [-0.1, 0.1]}
POINTS = np.array([[-0.5, -0.4, 0.0], [0.6, -0.3, 0.1], [0.4, 0.5, -0.1], [-0.3, 0.2, 0.2]])


def pool(errors: Any, sigma: Any) -> Any:
    return SimpleNamespace(distance=7.0, of=lambda _: (errors, sigma))


def test_targets_are_seen_where_they_stand_but_for_the_errors_of_the_pool() -> None:
    """Claim: with the pool's one error taken off, directions and ranges lead to the array's points at its distance; σ
    are those of the error that was drawn, and targets that were not found lend none."""
    plan: Any = SimpleNamespace(poses=5, arrays=[SimpleNamespace(points=POINTS)])
    known = load_scenario({"schema": 1, "scan": SCAN})
    one = np.array([2e-4, -3e-4, 4e-3])
    errors, sigma = np.tile(one, (3, 6, 1)), np.tile([1e-4, 2e-4, 3e-3], (3, 6, 1))
    errors[:, 1], sigma[:, 1] = np.nan, np.nan
    array: Any = SimpleNamespace(points=POINTS)
    found = _observed(known, plan, array, pool(errors, sigma), "triangulation")
    assert found is not None
    theta, phi, r = np.moveaxis(found[0] - one, -1, 0)
    points = point_from_shot(r, theta, phi, known.scanner.mirrors.axis_separation)
    np.testing.assert_allclose(
        points, np.broadcast_to(POINTS + np.array([0.0, 0.0, 7.0]), points.shape), rtol=0.0, atol=1e-9
    )
    assert found[1] == pytest.approx(np.broadcast_to([1e-4, 2e-4, 3e-3], found[1].shape))
    # Four of six that were found at a place are enough, three are not.
    errors[0, 1:3] = np.nan
    assert _observed(known, plan, array, pool(errors, sigma), "triangulation") is not None
    errors[0, 1:4] = np.nan
    assert _observed(known, plan, array, pool(errors, sigma), "triangulation") is None


def test_closed_forms_of_a_study_take_the_targets_of_its_range() -> None:
    """Claim: what targets err alone is their scatter without what they have in common, which moves an array as a whole;
    the constant law takes the errors nearest to 10 m, those of triangulation by R²; a single voxel's σ adds up.

    Depth of a square of side a by points: σ_R/2 of what is alone, and what is common as it is (σ²/4 + c²); by angles
    σR²/(√2 a).
    """

    def of_targets(distance: float, growth: float) -> list[TargetRow]:
        sizes = {"theta": 5e-5, "phi": 5e-5, "range_triangulation": 5e-3 * growth, "range_tof": 5e-2}
        return [
            TargetRow(distance, name, "", size, size, 0.6 * size, 0.5 * size, 1.0, 100)
            for name, size in sizes.items()
        ]

    array = square(1.0)
    nan = math.nan

    def row(method: Any, ranging: Any, component: str, distance: float) -> PoseRow:
        numbers = (nan,) * 8
        return PoseRow(array.name, 4, 1.0, distance, method, ranging, component, "m", *numbers, 0.0, 100)

    given = [
        row("xyz", "triangulation", "t_z", 16.0),
        row("xyz", "tof", "t_z", 16.0),
        row("uv", "none", "t_z", 16.0),
    ]
    # Of three ranges the middle one is nearest to the reference.
    targets_of = [*of_targets(4.0, 0.2), *of_targets(9.0, 1.0), *of_targets(16.0, 3.0)]
    # The array stands askew of no axis: any square of the side 1 m.
    side = float(np.ptp(array.points, axis=0).max())
    line, echo, angles = pose_forms.with_closed_forms(given, [array], targets_of, 10.0)

    def depth(sigma: float, voxel: float = 0.0) -> float:
        return math.sqrt((0.64 * sigma**2 + (0.5 * voxel) ** 2) / 4.0 + 0.36 * sigma**2)

    assert line.analytic == pytest.approx(depth(15e-3))
    assert line.voxel == pytest.approx(depth(15e-3, 15e-3))
    assert line.constant == pytest.approx(depth(5e-3) * (16.0 / 9.0) ** 2)
    assert echo.constant == pytest.approx(depth(5e-2)) == echo.analytic
    assert angles.analytic == pytest.approx(0.8 * 5e-5 * 256.0 / (math.sqrt(2.0) * side))
    # Where nothing has a range, angles alone have their law.
    blind = [
        replace(one, scatter=nan, common=nan, voxel=nan) if "range" in one.quantity else one
        for one in targets_of
    ]
    found = pose_forms.with_closed_forms(given, [array], blind, 10.0)
    assert [one.analytic for one in found] == pytest.approx([nan, nan, angles.analytic], nan_ok=True)
    assert found[2].constant == angles.constant


def test_arrays_of_a_study_draw_the_same_errors() -> None:
    """Claim: a target of an array errs as that of the same number in a larger array of the study, pose by pose."""
    larger = np.concatenate([POINTS, POINTS[:3] + 0.1])
    both = [SimpleNamespace(points=POINTS), SimpleNamespace(points=larger)]
    plan: Any = SimpleNamespace(poses=40, arrays=both)
    known = load_scenario({"schema": 1, "scan": SCAN})
    # Each error of the pool has a σ of its own, which tells which one was drawn.
    sigma = np.arange(1.0, 1.0 + 3 * 9 * 3).reshape(3, 9, 3)
    drawn = [_observed(known, plan, one, pool(0.0 * sigma, sigma), "tof") for one in both]  # type: ignore[arg-type]
    assert drawn[0] is not None
    assert drawn[1] is not None
    np.testing.assert_array_equal(drawn[0][1], drawn[1][1][:, : len(POINTS)])
