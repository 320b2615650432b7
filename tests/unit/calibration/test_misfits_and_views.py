"""What boards leave over that were held out, and which targets a station has in view."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from calibration_fields import TOLERANCE, made_field
from numpy.typing import NDArray
from prototype import NRC_2000
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from scanner_sim.analytic import geometry as judge
from scanner_sim.calibration.holdout import Misfit, misfit
from scanner_sim.calibration.simulated import _in_view, _objects, _placed
from scanner_sim.foundation.parameters import NAMES
from scanner_sim.ranging.believed import believed_points
from scanner_sim.scene.objects import Scene, TargetPattern
from scanner_sim.scene.surfaces import Surface

Array = NDArray[np.float64]


@pytest.mark.parametrize("shared", [0.0, 1e-6])
def test_a_misfit_is_what_the_best_rigid_motions_leave(shared: float) -> None:
    """Claim: Σ over views of the least squares over σ by six numbers of motion, and one of what the readings share with
    a variance of 1, over 3 n − 6 each. Expected: the same sums from a search by another program.

    Tolerance: 1e-3: one step from the closed form is exact to second order, of which departures of a tenth of the usual
    ones leave 1e-4 of a misfit of about 2, and the judge's weights are its own.
    """
    tolerance = {name: 0.1 * usual for name, usual in TOLERANCE.items()}
    field, truth = made_field(np.random.default_rng(3), stations=2, tolerance=tolerance)
    seen = field.sightings
    common = np.zeros((len(seen.target), 3, 1 if shared else 0))
    common[:, 2] = shared
    field = replace(field, sightings=replace(seen, common=common))
    roots = []
    for parameters in (np.zeros(len(NAMES)), truth):
        points = believed_points(seen.readings, field.design, parameters, field.encoder_period)
        total, freedom, views = 0.0, 0, 0
        for station in range(2):
            for board in range(2):
                chosen = (seen.station == station) & (field.targets.board[seen.target] == board)
                slope = points.by_readings[chosen]
                spread = np.einsum("nij,njk,nlk->nil", slope, seen.root[chosen] ** 2, slope)
                whiten = [
                    np.linalg.cholesky(np.linalg.inv(one + field.targets.sigma**2 * np.eye(3))).T
                    for one in spread
                ]
                local, there = field.targets.places[seen.target[chosen]], points.point[chosen]
                turn, _ = Rotation.align_vectors(there - there.mean(axis=0), local - local.mean(axis=0))

                def left(
                    x: Array,
                    local: Array = local,
                    there: Array = there,
                    turn: Any = turn,
                    whiten: Any = whiten,
                    slope: Array = slope,
                    part: Array = common[chosen],
                ) -> Array:
                    moved = (Rotation.from_rotvec(x[:3]) * turn).apply(local - local.mean(axis=0)) + x[3:6]
                    errors = there - there.mean(axis=0) - moved
                    if part.shape[2]:
                        errors = errors - np.einsum("nij,nj->ni", slope, part[..., 0]) * x[6]
                    return np.append(np.einsum("nij,nj->ni", whiten, errors).ravel(), x[6:])

                best = least_squares(
                    left, np.zeros(7 if shared else 6), x_scale="jac", xtol=1e-14, ftol=1e-14
                )
                total += 2.0 * best.cost
                freedom += 3 * int(chosen.sum()) - 6
                views += 1
        roots.append(math.sqrt(total / freedom))
    found = misfit(field, truth)
    assert (found.views, found.targets) == (views, len(seen.target))
    assert [found.designed, found.calibrated] == pytest.approx(roots, rel=1e-3)
    assert Misfit(4.0, 1.0, 1, 8).improvement == pytest.approx(0.75)


def seen_at(points: Array, facing: float = 0.0, *, flat: bool = True) -> list[bool]:
    """Return which targets of a board in front of a scanner are in view; the board turned about its y axis."""
    board: Any = SimpleNamespace(name="b", array=None, plate=0.2 if flat else None, diameter=0.1)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([0.0, facing, 0.0]).as_matrix()
    pose[2, 3] = 4.0
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    setup: Any = SimpleNamespace(
        places={"b": {str(i): place for i, place in enumerate(local)}}, base=SimpleNamespace(scanner=NRC_2000)
    )
    return [bool(one) for one in _in_view(board, setup, pose)]


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_target_is_in_view_with_the_pattern_around_it(axis: int, side: float) -> None:
    """Claim: deflection and the target's diameter over its range stay within the mirrors' reach, on every side."""
    mirrors = NRC_2000.mirrors
    limit = mirrors.max_deflection - 0.1 / 4.0
    points = []
    for share in (0.999, 1.001):
        angles = [0.0, 0.0]
        angles[axis] = side * share * limit
        points.append(judge.point_from_shot(4.0, *angles, mirrors.axis_separation))
    assert seen_at(np.array(points), flat=False) == [True, False]


@pytest.mark.parametrize(
    ("degrees", "seen"), [(64.5, True), (65.5, False), (-64.5, True), (-65.5, False), (180.0, False)]
)
def test_a_flat_target_is_in_view_up_to_65_degrees(degrees: float, seen: bool) -> None:
    middle = np.array([[0.0, 0.0, 4.0]])
    assert seen_at(middle, math.radians(degrees)) == [seen]
    assert seen_at(middle, math.radians(degrees), flat=False) == [True]
    assert seen_at(np.array([[0.0, 0.0, -4.0]]), flat=False) == [False]


def test_an_object_stands_where_its_pose_is() -> None:
    """Claim: position and turn as scenes write them give the pose again, also for one that is not turned."""
    for turn in ([0.3, -1.2, 0.4], [0.0, 0.0, 0.0]):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), [1.0, -2.0, 5.0]
        told: Any = _placed(pose)
        axis = [0.0, 0.0, 1.0] if told["rotation"]["axis"] == "z" else told["rotation"]["axis"]
        again = Rotation.from_rotvec(told["rotation"]["angle"] * np.array(axis)).as_matrix()
        np.testing.assert_allclose(again, pose[:3, :3], atol=1e-12)
        assert told["position"] == (1.0, -2.0, 5.0)


@pytest.mark.parametrize("plate", [None, 0.15])
def test_surveyed_targets_stand_where_their_board_has_them(plate: float | None) -> None:
    """Claim: each is an object of its own, a ball of its diameter or a disc on a plate, at pose · place and turned as
    the board is, of the materials that are named; an array is one object."""
    turn = Rotation.from_rotvec([0.3, -0.5, 0.2])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.as_matrix(), [0.4, -0.1, 5.0]
    places = {"a": np.array([0.2, 0.1, -0.3]), "b": np.array([-0.4, 0.05, 0.0])}
    setup: Any = SimpleNamespace(places={"far": places})
    grey = Surface(reflectance=0.3)
    about = {"name": "far", "disc": "target_black", "material": grey}
    board: Any = SimpleNamespace(array=None, diameter=0.1, plate=plate, **about)
    made = list(_objects(board, setup, pose))
    for number, (one, place) in enumerate(zip(made, places.values(), strict=True), start=1):
        assert one["name"] == f"far-{number}"
        assert one["material"] == grey.model_dump()
        np.testing.assert_allclose(one["position"], turn.apply(place) + pose[:3, 3], atol=1e-12)
        told: Any = one["rotation"]
        np.testing.assert_allclose(np.array(told["axis"]) * told["angle"], turn.as_rotvec(), atol=1e-12)
        if plate is None:
            assert (one["shape"], one["diameter"]) == ("sphere", 0.1)
        else:
            assert (one["array"], one["disc"]) == ({"diameter": 0.1, "plate": plate}, "target_black")
        Scene.model_validate({"objects": [one]})
    pattern = TargetPattern(diameter=0.1, rows=2, columns=3, spacing=(0.4, 0.3), plate=0.2)
    (whole,) = _objects(SimpleNamespace(array=pattern, **about), setup, pose)  # type: ignore[arg-type]
    (item,) = Scene.model_validate({"objects": [whole]}).objects
    assert (whole["name"], item.array) == ("far", pattern)  # type: ignore[union-attr]
    np.testing.assert_allclose(item.pose_at(0.0)[0], pose, atol=1e-12)
