"""What is left of an object's targets once those that do not agree are left out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim import estimate_pose
from scanner_sim.analytic import geometry
from scanner_sim.pose.status import PoseStatus

Array = NDArray[np.float64]

D, SIGMA = 0.05, 50e-6
NOISE: dict[str, Any] = {"sigma_theta": SIGMA, "sigma_phi": SIGMA, "sigma_range": 2e-3, "axis_separation": D}
LINE = np.outer([-0.9, -0.5, -0.1, 0.4, 0.8], [1.0, 0.2, -0.3])
"""Five targets on a line."""
BESIDE = np.array([0.2, 0.7, 0.3])
"""One beside it, without which nothing says how the object is turned about the line."""


@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
def test_targets_that_are_left_on_a_line_have_no_pose(method: Any) -> None:
    """Claim: where the one target beside a line of five is wrong, by more than any turn about the line could bring it,
    those that agree have no pose, as they have none alone; where one of the line is wrong by as much, the others do.

    Set-up: exact angles and ranges of ten poses 5 to 9 m away. A turn about the line, from which it is 0.75 m away,
    brings a target by 1.5 m at most; a sight that is 0.5 rad off passes it at more, as it is 4 m away at least.
    """
    points = np.vstack([LINE, BESIDE])
    rng = np.random.default_rng(11)
    turn = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (10, 3))).as_matrix()
    place = np.column_stack([rng.uniform(-1.0, 1.0, (10, 2)), np.linspace(5.0, 9.0, 10)])
    placed = np.einsum("bij,nj->bni", turn, points) + place[:, None]
    r, theta, phi = geometry.shot_from_point(placed, D)
    # In turn one of the line and the one beside it, in a batch.
    wrong = np.array([2, 5])[np.arange(10) % 2]
    theta[np.arange(10), wrong] += 0.5
    found = estimate_pose(points, theta, phi, r, method=method, robust="ransac", **NOISE)
    left = wrong == 5
    assert (found.status[left] == PoseStatus.COLLINEAR).all()
    for values in (found.position, found.rotation, found.covariance):
        assert np.isnan(values[left]).all()
    alone = [values[left][:, :5] for values in (theta, phi, r)]
    assert (estimate_pose(LINE, *alone, method=method, **NOISE).status == PoseStatus.COLLINEAR).all()
    np.testing.assert_allclose(found.position[~left], place[~left], atol=1e-8)
    np.testing.assert_allclose(found.rotation[~left], turn[~left], atol=1e-8)
