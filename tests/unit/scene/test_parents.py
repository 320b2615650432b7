"""Objects that are fixed to others: they stand and move as matrices multiplied by hand say, and images are the same."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim import Scenario, simulate
from scanner_sim.scene.objects import Scene

PLATE = {
    "name": "plate", "shape": "rectangle", "size": (1.0, 1.0), "material": "target_white", "position": (0.1, 0.0, 5.0),
    "rotation": {"axis": "y", "angle": 0.3},
    "motion": {"type": "twist", "velocity": (0.2, 0.0, 0.1), "turn_rate": (0.0, 0.5, 0.1)},
}  # fmt: skip
TARGET = {
    "name": "target", "parent": "plate", "shape": "disc", "diameter": 0.2, "material": "target_black",
    "position": (0.2, 0.1, -0.01), "rotation": {"axis": "z", "angle": 0.4},
}  # fmt: skip


def by_hand(time: float) -> np.ndarray:
    """scanner_from_target: the plate's turn and place, and the target's on it."""
    turn = Rotation.from_rotvec(np.array([0.0, 0.5, 0.1]) * time) * Rotation.from_rotvec([0.0, 0.3, 0.0])
    pose = np.eye(4)
    pose[:3, :3] = (turn * Rotation.from_rotvec([0.0, 0.0, 0.4])).as_matrix()
    pose[:3, 3] = np.array([0.1 + 0.2 * time, 0.0, 5.0 + 0.1 * time]) + turn.apply([0.2, 0.1, -0.01])
    return pose


@pytest.mark.parametrize("order", [(PLATE, TARGET), (TARGET, PLATE)])
def test_a_target_moves_with_its_plate(order: tuple[dict, ...]) -> None:
    scene = Scene(objects=order)
    target = next(item for item in scene.objects if item.name == "target")
    assert target.moves
    for time in (0.0, 0.7, 3.0):
        np.testing.assert_allclose(target.pose_at(time)[0], by_hand(time), atol=1e-12)
        rested = scene.resting_at(time).objects[order.index(TARGET)]
        assert not rested.moves
        np.testing.assert_allclose(rested.pose_at(9.0)[0], by_hand(time), atol=1e-12)


def test_a_chain_of_parents_and_a_motion_of_its_own() -> None:
    """An arm that turns on a plate that moves: poses multiply from the plate to the tip."""
    arm = {"name": "arm", "parent": "plate", "shape": "box", "size": (0.1, 0.1, 0.1), "material": "black_paint",
           "position": (0.0, 0.3, 0.0), "motion": {"type": "twist", "turn_rate": (0.0, 0.0, 2.0)}}  # fmt: skip
    tip = {**TARGET, "name": "tip", "parent": "arm"}
    scene = Scene(objects=(tip, arm, PLATE))
    plate_pose, time = scene.objects[2].pose_at(0.6)[0], 0.6
    own = np.eye(4)
    own[:3, :3], own[:3, 3] = Rotation.from_rotvec([0.0, 0.0, 2.0 * time]).as_matrix(), (0.0, 0.3, 0.0)
    held = np.eye(4)
    held[:3, :3], held[:3, 3] = Rotation.from_rotvec([0.0, 0.0, 0.4]).as_matrix(), (0.2, 0.1, -0.01)
    np.testing.assert_allclose(scene.objects[0].pose_at(time)[0], plate_pose @ own @ held, atol=1e-12)


def scenario(*objects: dict) -> Scenario:
    return Scenario(
        schema=1,
        seed=4,
        scene={"objects": objects},
        scan={
            "type": "raster",
            "rows": 12,
            "columns": 12,
            "horizontal": (-0.05, 0.12),
            "vertical": (-0.1, 0.1),
        },
        output={"pictures": False, "truth": ("pose",)},
    )


@pytest.mark.usefixtures("device")
def test_an_image_is_that_of_the_same_motion_written_out() -> None:
    """Claim: what is fixed to a plate that slides is measured, to the byte, as what slides beside it by itself."""
    slide = {"type": "twist", "velocity": (2.0, 0.0, 1.0)}
    plate = {**PLATE, "rotation": (), "motion": slide}
    alone = {**TARGET, "position": (0.1 + 0.2, 0.1, 5.0 - 0.01), "motion": slide}
    del alone["parent"]
    fixed, apart = (simulate(scenario(plate, one), device="cpu") for one in (TARGET, alone))
    assert (fixed["truth.object"] == 2).sum() > 3
    for name in ("range_m", "truth.object", "status"):
        np.testing.assert_array_equal(fixed[name], apart[name])
    assert fixed.poses is not None
    start, end = fixed.poses.scanner_from_object["target"][:, :3, 3]
    expected = np.array([0.3, 0.1, 4.99])
    np.testing.assert_allclose(start, expected, atol=1e-12)
    passed = fixed.poses.time[1]
    np.testing.assert_allclose(end, expected + passed * np.array([2.0, 0.0, 1.0]), atol=1e-9)


@pytest.mark.usefixtures("device")
def test_a_scene_is_built_anew_when_a_parent_stands_elsewhere() -> None:
    """A resting child is built where its parent puts it, and the keeper of scenes must notice."""
    from scanner_sim.scene.files.loader import load_scene

    resting = {key: value for key, value in PLATE.items() if key != "motion"}
    places = []
    for x in (0.0, 1.0):
        loaded = load_scene(Scene(objects=({**resting, "position": (x, 0.0, 5.0), "rotation": ()}, TARGET)))
        places.append(loaded.shapes[1].bbox().center().x)
    assert places[1] - places[0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    ("parent", "words"),
    [("plat", "Did you mean 'plate'"), ("target", "fixed to itself"), ("Plate9", "no object")],
)
def test_parents_that_are_none(parent: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Scene(objects=(PLATE, {**TARGET, "parent": parent}))


@pytest.mark.parametrize(("ancestors", "taken"), [(50, True), (60, False)])
def test_a_chain_of_fifty_is_possible(ancestors: int, taken: bool) -> None:
    chain = [{**PLATE, "name": "p0"}]
    chain += [{**TARGET, "name": f"p{n}", "parent": f"p{n - 1}"} for n in range(1, ancestors + 1)]
    if taken:
        assert len(Scene(objects=chain).objects) == ancestors + 1
    else:
        with pytest.raises(ValueError, match="fixed to"):
            Scene(objects=chain)
