"""What the study of poses gives its estimators: true directions and ranges with the errors of its pool."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.analytic.geometry import point_from_shot
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
