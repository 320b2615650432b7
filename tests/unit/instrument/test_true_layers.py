"""Truth that a scenario asks for: normals, incidence and poses against closed forms, kept apart from all estimates."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim import (
    RangeImage,
    Scenario,
    ScenarioError,
    load_scenario,
    read_range_image,
    read_shots,
    simulate,
    simulate_shots,
    write_run,
    write_shots,
)
from scanner_sim.config.built import instrument_as_built
from scanner_sim.foundation.status import Status
from scanner_sim.ranging.coordinates import coordinates

pytestmark = pytest.mark.usefixtures("device")

GREY = {"reflectance": 0.5}
SCAN = {"rows": 9, "columns": 9, "horizontal": ["-3 deg", "3 deg"], "vertical": ["-3 deg", "3 deg"]}
PLATE: dict[str, Any] = {"name": "plate", "shape": "rectangle", "size": (4.0, 4.0), "material": GREY}
TILTED = PLATE | {"position": (0.1, 0.0, 7.0), "rotation": {"axis": (1.0, 2.0, 0.5), "angle": 0.7}}
BALL: dict[str, Any] = {"name": "ball", "shape": "sphere", "diameter": 1.2, "material": GREY}
SPIN = {"type": "twist", "velocity": (0.0, 0.3, 1.0), "turn_rate": (0.0, 40.0, 0.0)}
ROUNDING = 3e-6
"""Error of a normal in single precision, several roundings of a vector turned twice [rad]."""


def scenario_of(*objects: dict[str, Any], truth: tuple[str, ...] = (), **changes: Any) -> Scenario:
    given = {"schema": 1, "scene": {"objects": list(objects)}, "scan": SCAN, "output": {"truth": list(truth)}}
    return load_scenario(given | changes)


def normals(image: RangeImage) -> np.ndarray:
    """Return the true normals, shape (rows, columns, 3)."""
    return np.stack([image[f"truth.normal.{axis}"] for axis in "XYZ"], axis=-1).astype(float)


def beams(image: RangeImage, separation: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the true points that beams meet, and the directions of the beams, by eq 3; shape (rows, columns, 3)."""
    r, theta, phi = (image[f"truth.{name}"].astype(float) for name in ("range_m", "theta_rad", "phi_rad"))
    point, nearer = (np.stack(coordinates(r - step, theta, phi, separation), axis=-1) for step in (0.0, 1.0))
    return point, point - nearer


def check_incidence(image: RangeImage, separation: float) -> None:
    """Hold the incidence to the angle between normal and beam, by its sine and cosine."""
    _, beam = beams(image, separation)
    found, met = image["truth.incidence_rad"].astype(float), image["truth.object"] > 0
    np.testing.assert_allclose(np.cos(found)[met], -(normals(image) * beam).sum(-1)[met], atol=ROUNDING)
    across = np.linalg.norm(np.cross(normals(image), beam), axis=-1)
    np.testing.assert_allclose(np.sin(found)[met], across[met], atol=ROUNDING)
    assert ((found >= 0.0) & (found <= np.pi / 2))[met].all()


def test_a_tilted_plane_has_its_own_normal_everywhere() -> None:
    """Claim: the turned axis that faces the scanner, to rounding; the incidence is the angle to the beam.

    From behind, the other side faces the scanner.
    """
    scenario = scenario_of(TILTED, truth=("normal", "incidence"))
    image = simulate(scenario, device="cpu")
    axis = np.array([1.0, 2.0, 0.5])
    expected = Rotation.from_rotvec(0.7 * axis / np.linalg.norm(axis)).apply([0.0, 0.0, -1.0])
    np.testing.assert_allclose(normals(image), np.broadcast_to(expected, (9, 9, 3)), atol=ROUNDING)
    check_incidence(image, scenario.scanner.mirrors.axis_separation)
    behind = TILTED | {"rotation": [{"axis": "y", "angle": np.pi}, TILTED["rotation"]]}
    turned = simulate(scenario_of(behind, truth=("normal",)), device="cpu")
    np.testing.assert_allclose(normals(turned), normals(image), atol=2 * ROUNDING)
    assert "truth.incidence_rad" not in turned


@pytest.mark.parametrize("word", ["point", "normal", "incidence"])
def test_each_word_alone_has_its_layers(word: str) -> None:
    """Claim: what is asked for of the surfaces' truth is the same with and without the others, nothing beside it."""
    every = simulate(scenario_of(TILTED, truth=("point", "normal", "incidence")), device="cpu")
    alone, none = (simulate(scenario_of(TILTED, truth=words), device="cpu") for words in ((word,), ()))
    own = {
        "point": ["truth.P.X", "truth.P.Y", "truth.P.Z"],
        "normal": ["truth.normal.X", "truth.normal.Y", "truth.normal.Z"],
        "incidence": ["truth.incidence_rad"],
    }[word]
    assert sorted(set(alone.channels) - set(none.channels)) == own
    for name in own:
        np.testing.assert_array_equal(alone[name], every[name])


def test_a_sphere_s_normals_point_from_its_centre() -> None:
    """Claim: to the true point's own error, single precision at 5 m over the radius of 0.6 m; NaN beside it."""
    centre = (0.05, -0.1, 5.0)
    scenario = scenario_of(
        BALL | {"position": centre}, truth=("normal", "incidence"), scan=SCAN | {"rows": 31}
    )
    image = simulate(scenario, device="cpu")
    met = image["truth.object"] == 1
    point, _ = beams(image, scenario.scanner.mirrors.axis_separation)
    radial = (point - centre) / 0.6
    np.testing.assert_allclose(normals(image)[met], radial[met], atol=5.0 * 2.0**-22 / 0.6)
    check_incidence(image, scenario.scanner.mirrors.axis_separation)
    missed = simulate(
        scenario_of(BALL | {"position": (0.4, 0.0, 9.0)}, truth=("normal", "incidence")), device="cpu"
    )
    nothing = missed["truth.object"] == 0
    assert nothing.any()
    for name in ("truth.normal.X", "truth.normal.Y", "truth.normal.Z", "truth.incidence_rad"):
        np.testing.assert_array_equal(np.isnan(missed[name]), nothing)


def test_a_moving_plane_s_normal_is_that_of_the_voxel_s_time() -> None:
    """Claim: it turns by 40 rad/s while the 81 voxels are measured, each at its own time."""
    still = PLATE | {"position": (0.0, 0.0, 6.0), "rotation": {"axis": "y", "angle": 0.4}}
    scenario = scenario_of(still | {"motion": SPIN}, truth=("normal",))
    image = simulate(scenario, device="cpu")
    time = (np.arange(81).reshape(9, 9) + 0.5) * scenario.scanner.dwell
    angle = 0.4 + 40.0 * time
    expected = np.stack([-np.sin(angle), 0.0 * angle, -np.cos(angle)], axis=-1)
    met = image["truth.object"] > 0
    assert met.all()
    assert np.ptp(angle) > 0.1
    np.testing.assert_allclose(normals(image), expected, atol=ROUNDING)


def test_what_the_lens_does_not_see_has_its_true_range() -> None:
    """Claim: where a board before the lens hides the wall from it, the beam meets the wall all the same: nothing is
    measured, and range, object and incidence are those of the wall; beside both is nothing, without any of them."""
    board = PLATE | {"name": "board", "size": (0.12, 0.2), "position": (0.1, 0.0, 1.0)}
    wall = PLATE | {"name": "wall", "position": (0.0, 2.1, 6.0)}
    scenario = scenario_of(wall, board, truth=("normal", "incidence"))
    image = simulate(scenario, device="cpu")
    depth = beams(image, scenario.scanner.mirrors.axis_separation)[0][..., 2]
    on_wall, on_board = (image["truth.object"] == number for number in (1, 2))
    for met, distance in ((on_wall, 6.0), (on_board, 1.0)):
        assert met.any()
        np.testing.assert_allclose(depth[met], distance, rtol=1e-6)
    hidden = on_wall & (image["status"] == Status.BELOW_THRESHOLD)
    assert hidden.any()
    assert (on_wall & image.valid).any()
    nothing = ~(on_wall | on_board)
    assert nothing.any()
    for name in ("truth.range_m", "truth.incidence_rad"):
        np.testing.assert_array_equal(np.isnan(image[name]), nothing)
    check_incidence(image, scenario.scanner.mirrors.axis_separation)


@pytest.mark.parametrize("rows", [True, False])
def test_all_truth_is_of_the_instrument_as_built(rows: bool) -> None:
    """Claim: with errors of encoders, mirrors that err and turn about an axis aside, and a platform that shakes, the
    true angles are what the encoders' law makes of the commanded ones, to the mirrors' jitter; and the beam that leaves
    at these, turned about the axis by SciPy, shifted and turned with the platform, meets the plane at the true range,
    point and incidence, to 3 µm, 10 µm and 1 µrad, as single precision leaves them. By the designed axes, on a platform
    at rest, points would be a millimetre aside.
    """
    moving = {"turn": [[5.0, 1e-8], [100.0, 1e-10]], "shift": [[5.0, 1e-8], [100.0, 1e-10]]}
    law = {"zero": 3e-4, "scale": 2e-3, "cubic": 6e-3, "sine": 3e-4, "cosine": 2e-4}
    own = {f"{axis}_{name}": value for axis in ("theta", "phi") for name, value in law.items()}
    own |= {"axis_separation": 6e-4, "axis_offset": 1e-3, "axis_skew": 2e-3, "encoder_period": 0.3}
    own |= {"base": 6e-4, "array_offset": 1e-4, "radial_1": 0.3, "tof_zero": 5e-3, "power_noise": 0.05}
    wide = {"horizontal": (-0.3, 0.3), "vertical": (-0.3, 0.3)}
    scan = SCAN | wide if rows else {"type": "spiral", "radius": 0.3, "turns": 3.0, "points": 64}
    scenario = scenario_of(
        TILTED | {"size": (30.0, 30.0)},
        truth=("point", "normal", "incidence"),
        ranging="both",
        scan=scan,
        scanner={"as_built": own | {"vibration": moving}},
    )
    if rows:
        image = simulate(scenario, device="cpu")
        commands = [angles.ravel() for angles in np.meshgrid(image.phi, image.theta, indexing="ij")][::-1]
        time = (np.arange(81) + 0.5) * scenario.scanner.dwell
        found = {name: image[name].astype(float).ravel() for name in image.channels}
    else:
        shots = simulate_shots(scenario, device="cpu")
        commands, time = [shots.theta, shots.phi], shots.time
        found = {name: shots[name].astype(float) for name in shots.channels}
    true = [found["truth.theta_rad"], found["truth.phi_rad"]]
    for angle, read in zip(true, commands, strict=True):
        turn = 2.0 * np.pi * read / 0.3
        wanted = read + 3e-4 + 2e-3 * read + 6e-3 * read**3 + 3e-4 * np.sin(turn) + 2e-4 * np.cos(turn)
        np.testing.assert_allclose(angle, wanted, atol=1e-4)
        assert np.abs(angle - read).max() > 3e-4
    middle = np.array([0.0, 1e-3, scenario.scanner.mirrors.axis_separation + 6e-4])
    about = Rotation.from_rotvec(-true[1][:, None] * [np.cos(2e-3), np.sin(2e-3), 0.0])
    built = instrument_as_built(scenario)
    assert built is not None
    shaken = built.unsteadiness(time)
    carried = Rotation.from_rotvec(shaken.turn.T)
    ahead = np.stack([np.sin(true[0]), 0.0 * true[0], np.cos(true[0])], axis=1)
    beam = carried.apply(about.apply(ahead))
    laser = carried.apply(about.apply(-middle) + middle) + shaken.shift.T
    axis = np.array([1.0, 2.0, 0.5])
    normal = Rotation.from_rotvec(0.7 * axis / np.linalg.norm(axis)).apply([0.0, 0.0, -1.0])
    reach = (np.array(TILTED["position"]) - laser) @ normal / (beam @ normal)
    np.testing.assert_allclose(found["truth.range_m"], reach, atol=3e-6)
    point = np.stack([found[f"truth.P.{axis}"] for axis in "XYZ"], axis=1)
    np.testing.assert_allclose(point, laser + reach[:, None] * beam, atol=1e-5)
    np.testing.assert_allclose(found["truth.incidence_rad"], np.arccos(-beam @ normal), atol=1e-6)
    designed = np.stack(coordinates(reach, *true, scenario.scanner.mirrors.axis_separation), axis=1)
    assert np.abs(designed - point).max() > 1e-3
    assert np.abs(shaken.shift).max() > 2e-4


def test_poses_at_begin_and_end() -> None:
    """Claim: a resting object has one pose, a moving one goes on; the times are those of the first and last dwell."""
    moving = BALL | {"position": (0.0, 0.0, 6.0), "motion": SPIN}
    scenario = scenario_of(TILTED, moving, truth=("pose",))
    poses = simulate(scenario, device="cpu").poses
    assert poses is not None
    duration = 81 * scenario.scanner.dwell
    assert poses.time == (0.0, pytest.approx(duration))
    plate, ball = (poses.scanner_from_object[name] for name in ("plate", "ball"))
    np.testing.assert_array_equal(plate[0], plate[1])
    np.testing.assert_allclose(plate[0, :3, 3], (0.1, 0.0, 7.0))
    np.testing.assert_allclose(
        ball[1, :3, 3], np.add((0, 0, 6), duration * np.array([0.0, 0.3, 1.0])), atol=1e-12
    )
    turn = Rotation.from_matrix(ball[1, :3, :3]).as_rotvec()
    np.testing.assert_allclose(turn, (0.0, 40.0 * duration, 0.0), atol=1e-12)


def test_what_is_asked_for_changes_nothing_else_and_no_batch_changes_it(tmp_path: Path) -> None:
    """Claim: layers without and with it have the same bytes, in batches of 7 as in one; files give back all of it."""
    every = ("normal", "incidence", "pose")
    plain, asked = (simulate(scenario_of(TILTED, truth=words), device="cpu") for words in ((), every))
    batched = simulate(scenario_of(TILTED, truth=every), device="cpu", batch=7)
    for name in asked.channels:
        assert asked[name].tobytes() == batched[name].tobytes()
        assert name not in plain or asked[name].tobytes() == plain[name].tobytes()
    assert plain.poses is None
    write_run(asked, tmp_path / "out")
    read = read_range_image(tmp_path / "out" / "range.exr")
    assert read.channels.keys() == asked.channels.keys()
    assert read.poses is not None
    assert asked.poses is not None
    assert read.poses.plain() == asked.poses.plain()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["truth"]["poses"] == asked.poses.plain()
    assert (
        b"property float nx\nproperty float ny\nproperty float nz\n"
        in (tmp_path / "out/points.ply").read_bytes()
    )
    header = OpenEXR.File(str(tmp_path / "out" / "range.exr"), separate_channels=True).header()
    assert header["unit.truth.incidence_rad"] == "rad"


def test_a_table_of_shots_has_them_too(tmp_path: Path) -> None:
    spiral = {"type": "spiral", "radius": "3 deg", "turns": 3.0, "points": 64}
    scenario = scenario_of(TILTED, truth=("normal", "pose"), scan=spiral)
    shots = simulate_shots(scenario, device="cpu")
    (aim,) = scenario.open_scan.aims(scenario.scan_setup, scenario.open_scan.shots)
    for found, given in ((shots.time, aim.time), (shots.theta, aim.theta), (shots.phi, aim.phi)):
        np.testing.assert_array_equal(found[aim.shot], given)
    write_shots(shots, tmp_path / "out")
    read = read_shots(tmp_path / "out")
    np.testing.assert_array_equal(read["truth.normal.Z"], shots["truth.normal.Z"])
    assert read.poses is not None
    assert shots.poses is not None
    assert read.poses.plain() == shots.poses.plain()


def test_a_track_has_none() -> None:
    target = {"name": "board", "array": {"diameter": 0.05, "plate": 0.2}, "position": (0.0, 0.0, 5.0)}
    scan = {"type": "track", "targets": ["board"], "duration": 0.1}
    with pytest.raises(ScenarioError, match=r"output\.truth: a run that follows targets"):
        scenario_of(target, truth=("normal",), scan=scan)
