"""Moving objects in the renderer: each ray meets them where they are at its own instant."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Scenario, simulate
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.geometry import laser_origin, range_to_sphere, scanner_axes
from scanner_sim.config import scenario_warnings
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.photograph import take_photo
from scanner_sim.products.image import RangeImage
from scanner_sim.scan.raster import raster_aim
from scanner_sim.scene.objects import Scene

Array = NDArray[np.float64]

WALL = {"name": "wall", "shape": "rectangle", "size": (8, 8), "position": (0, 0, 10), "material": "z93_white"}
GREY = {"reflectance": 0.3}
VELOCITY, TURN_RATE = (0.25, -0.1, -0.4), (0.02, 0.2, 0.1)
TWIST = {"type": "twist", "velocity": VELOCITY, "turn_rate": TURN_RATE}
TILT = {"axis": "y", "angle": 0.35}
SUN = {"sun": {"direction": (0.35, -0.5, -0.8)}}
SEPARATION = 0.05
"""Distance of the mirrors' axes of the default instrument [m]."""

pytestmark = pytest.mark.usefixtures("device")


def plate(**keys: Any) -> dict[str, Any]:
    return {
        "name": "plate",
        "shape": "rectangle",
        "size": (1.0, 0.8),
        "position": (-0.1, 0.05, 7.0),
        "rotation": TILT,
        "material": GREY,
        **keys,
    }


def scenario(*objects: dict[str, Any], rows: int = 24, columns: int = 32, **keys: Any) -> Scenario:
    """A raster of 12° over objects, in the dark unless told otherwise."""
    ends = (-0.1, 0.1)
    scan = {"rows": rows, "columns": columns, "horizontal": ends, "vertical": ends}
    return Scenario.model_validate({"schema": 1, "scan": scan, "scene": {"objects": objects}, **keys})


def turned(vector: Array, turn: Array) -> Array:
    """Turn a vector (3,) by rotation vectors (n, 3): Rodrigues' formula."""
    angle = np.linalg.norm(turn, axis=1, keepdims=True)
    axis = turn / angle
    cos, sin = np.cos(angle), np.sin(angle)
    return vector * cos + np.cross(axis, vector) * sin + axis * (axis @ vector)[:, None] * (1.0 - cos)


def measured(told: Scenario) -> tuple[dict[str, Array], Array]:
    """Return the layers of all voxels of a raster, in the order of the shots, and their times [s]."""
    shots = np.arange(told.raster.shots, dtype=np.uint32)
    aim = raster_aim(told.raster, shots, told.scanner.dwell)
    return Instrument(told, device="cpu").measure(aim), aim.time


def test_a_plate_with_a_twist_is_where_it_is_at_each_voxels_instant() -> None:
    """The plate's plane at each shot's time, in closed form: to 20 µm, while it moves by 0.1 m in all.

    Float32 leaves 2 µm; a pose at the wrong end of the dwell would make 30 µm, one of the row's time 0.5 mm.
    """
    told = scenario(plate(motion=TWIST), WALL, scanner={"rate": 4000.0})
    layers, time = measured(told)
    here = layers["truth.object"] == 1
    theta, phi, time = layers["truth.theta_rad"][here], layers["truth.phi_rad"][here], time[here]
    assert here.sum() > 100
    normal = turned(np.array([np.sin(0.35), 0.0, np.cos(0.35)]), time[:, None] * np.array(TURN_RATE))
    place = np.array([-0.1, 0.05, 7.0]) + time[:, None] * np.array(VELOCITY)
    along = scanner_axes(theta, phi)[0]
    apart = np.sum((place - laser_origin(phi, SEPARATION)) * normal, axis=1)
    expected = apart / np.sum(along * normal, axis=1)
    np.testing.assert_allclose(layers["truth.range_m"][here], expected, atol=20e-6)
    resting = np.array([-0.1, 0.05, 7.0]) - laser_origin(phi, SEPARATION)
    still = np.sum(resting * normal[0], axis=1) / np.sum(along * normal[0], axis=1)
    assert np.abs(still - expected).max() > 20e-3


def test_a_moving_sphere_is_where_it_is_at_each_voxels_instant() -> None:
    ball = {
        "name": "ball",
        "shape": "sphere",
        "diameter": 0.9,
        "position": (-0.3, 0.1, 6.0),
        "material": GREY,
    }
    velocity = np.array([3.0, 0.0, 1.0])
    layers, time = measured(
        scenario({**ball, "motion": {"type": "twist", "velocity": velocity}}, scanner={"rate": 4000.0})
    )
    here = layers["truth.object"] == 1
    centre = np.array([-0.3, 0.1, 6.0]) + time[:, None] * velocity
    expected = range_to_sphere(layers["truth.theta_rad"], layers["truth.phi_rad"], SEPARATION, centre, 0.45)
    np.testing.assert_array_equal(here, np.isfinite(expected))
    # Near the limb the range varies fast: there float32's place across the beam counts.
    error = np.abs(layers["truth.range_m"] - expected)[here]
    assert np.median(error) < 3e-6
    assert np.quantile(error, 0.95) < 20e-6


@pytest.mark.slow
@pytest.mark.parametrize("keys", [{}, {"transport": {"bounces": 2}}, {"ranging": "tof"}, {"lighting": SUN}])
def test_an_object_of_no_speed_is_an_object_at_rest(keys: dict[str, Any]) -> None:
    """Every layer, light and noise included, agrees within float32: surfaces lie δ elsewhere, 5 µm along a beam.

    Whole electrons and whole numbers are off: of a millionth of the light they make a whole step or none. Places across
    the beams, within 1 m of the axis, are known to a, eight roundings of 1 m; numbers to u, sixteen of their own.

    - Light falls as 1/R², by 2δ/R + u. Grains of speckle that lie a elsewhere under a beam of the radius w change it by
      2a/w: a contrast g/(πw/2) of grains g = λR/D apart changes by πa/g.
    - The range changes by δ + uR and by πa/g of its σ.
    - A beamlet within a of an edge meets another surface, or another shadow. Of 48 beamlets 2w across, in the 80 voxels
      or fewer that edges cross, 48 · 80 · 2a/2w = 0.8 do; more than seven, with a chance of 1e-6. Two of them are a
      twentieth of the light, and the surfaces lie 4.2 m apart at most.
    - Echoes of the retro-reflector are many clusters with a speckle of their own, and beamlets lie on their borders.
      By roundings one changes sides, which changes the height by less than a twentieth, too, and not the range.
    """
    retro = {**plate(), "name": "retro", "position": (0.3, -0.2, 6.0), "material": "retro_sheet"}
    objects, still = [plate(), retro], {"type": "twist"}
    smooth: dict[str, Any] = {"position_sensor": {"noise": {"shot": False, "quantisation": False}}}
    if keys.get("ranging") == "tof":
        smooth = {"lidar": {"photodiode": {"noise": {"quantisation": False}}}}
    keys = {**keys, "scanner": smooth}
    resting = scenario(*objects, WALL, rows=12, columns=20, **keys)
    moving = scenario(*({**item, "motion": still} for item in objects), WALL, rows=12, columns=20, **keys)
    one, other = measured(moving)[0], measured(resting)[0]
    assert one.keys() == other.keys()
    assert len(np.unique(one["truth.object"])) == 3
    for name in ("truth.object", "truth.material", "status"):
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    along, across, rounding = 5e-6, 8.0 * 2.0**-24, 16.0 * 2.0**-24
    distance = other["truth.range_m"].astype(np.float64)
    np.testing.assert_allclose(one["truth.range_m"], distance, atol=along)
    laser, lens = resting.scanner.laser, resting.scanner.receiver.aperture
    width = beam_radius(distance, laser.waist_radius, laser.waist_distance, laser.wavelength, laser.m_squared)
    share, light = 2.0 * across / width, 2.0 * along / distance + rounding
    granted = {
        "Y": (share + light) * other["Y"],
        "background": light * np.nanmax(other["background"]) if "background" in other else 0.0,
        "range_m": along
        + rounding * distance
        + np.pi * across * lens / (laser.wavelength * distance) * other["sigma_range_m"],
        "sigma_range_m": (share + light) * other["sigma_range_m"],
    }
    at_edges = {name: 0.05 * other[name] for name in granted if name in other} | {"range_m": 0.05 * 4.2}
    for name, most in at_edges.items():
        apart = np.abs(one[name].astype(np.float64) - other[name])
        many = (other["truth.object"] == 2) & (name == "Y") & (keys.get("ranging") == "tof")
        assert np.sum((apart > granted[name]) & ~many) <= 7, name
        assert not np.any(apart > most + granted[name]), name


def meshes(folder: Path) -> dict[str, dict[str, Any]]:
    """Return one object of each kind that comes from a file or has several shapes, and of some others."""
    import trimesh

    trimesh.creation.icosahedron().export(folder / "stone.ply")
    (folder / "pair.xml").write_text(
        """<scene version="3.0.0">
        <shape type="sphere"><float name="radius" value="0.4"/></shape>
        <shape type="cube"><transform name="to_world"><scale value="0.3"/><translate x="0.6"/></transform></shape>
        </scene>"""
    )
    pattern = {"diameter": 0.3, "plate": 0.6, "rows": 2, "columns": 2, "spacing": (0.7, 0.7)}
    return {
        "mesh": {"mesh": folder / "stone.ply", "material": GREY, "length_unit": 0.5},
        "file": {"file": folder / "pair.xml"},
        "array": {"array": pattern},
        "cylinder": {"shape": "cylinder", "diameter": 0.5, "length": 1.0, "material": GREY},
        "box": {"shape": "box", "size": (0.5, 1.0, 0.7), "material": GREY},
        "disc": {"shape": "disc", "diameter": 1.0, "material": GREY},
    }


@pytest.mark.parametrize("kind", ["mesh", "file", "array", "cylinder", "box", "disc"])
def test_every_kind_of_object_moves_as_one_body(tmp_path: Path, kind: str) -> None:
    """At any instant rays meet what they meet in a scene that is built with the object there."""
    import mitsuba as mi

    from scanner_sim.render.rays import at_time, intersect, is_occluded
    from scanner_sim.scene.files.loader import load_scene

    item = {"name": "thing", "position": (0.1, 0.0, 5.0), "rotation": TILT, "motion": TWIST}
    scene = Scene.model_validate({"objects": [{**item, **meshes(tmp_path)[kind]}, WALL]})
    random = np.random.default_rng(1)
    aimed = random.normal(0.0, 0.1, (3, 4000))
    aimed[2] = 1.0
    ray = mi.Ray3f(mi.Point3f(0.02, 0.01, 0.0), dr.normalize(mi.Vector3f(aimed)))
    short = mi.Ray3f(ray)
    short.maxt = 5.0
    moving, built = at_time(load_scene(scene), 1.3), load_scene(scene.resting_at(1.3))
    assert len(moving.bodies) == 1
    one, other = intersect(moving, ray), intersect(built, ray)
    names = [
        dr.gather(mi.UInt32, table, dr.reinterpret_array(mi.UInt32, si.shape)).numpy()
        for loaded, si in ((moving, one), (built, other))
        for table in (loaded.object_of, loaded.material_of)
    ]
    same = (names[0] == names[2]) & (names[1] == names[3])
    assert same.mean() > 0.998
    assert (names[0] == 1).sum() > 200
    hit = same & np.isfinite(other.t.numpy())
    # Small triangles far from the scanner's origin have rounded normals in the scene that is built there.
    for name, limit in (("t", 3e-5), ("p", 3e-5), ("n", 2e-4), ("wi", 2e-4)):
        apart = getattr(one, name).numpy()[..., hit] - getattr(other, name).numpy()[..., hit]
        assert np.quantile(np.abs(apart), 0.99) < limit, name
    blocked = is_occluded(moving, short).numpy(), is_occluded(built, short).numpy()
    assert (blocked[0] == blocked[1]).mean() > 0.998
    assert 0.02 < blocked[0].mean() < 0.9


@pytest.mark.slow
def test_a_moving_object_casts_a_moving_shadow() -> None:
    """The background of each row is that of a scene that rests as it is in the middle of the row's time.

    A plate beside the field of view moves through the sunlight; the shadow on the wall moves by 0.4 m in the scan.
    """
    shade = plate(
        position=(1.5, -2.2, 6.6), size=(1.5, 1.5), rotation=(), motion={**TWIST, "velocity": (8.0, 0, 0)}
    )
    told = scenario(shade, WALL, rows=10, columns=20, lighting=SUN, scanner={"rate": 4000.0})
    background = np.reshape(measured(told)[0]["background"], (10, 20))
    for row in (0, 3, 6):
        time = float(told.raster.row_times(told.scanner.dwell)[row])
        built = told.model_copy(update={"scene": told.scene.resting_at(time)})
        expected = np.reshape(measured(built)[0]["background"], (10, 20))
        np.testing.assert_allclose(background[row], expected[row], rtol=2e-3)
    # At time 0 the shadow's edges are elsewhere.
    first = told.model_copy(update={"scene": told.scene.resting_at(0.0)})
    still = np.reshape(measured(first)[0]["background"], (10, 20))
    assert np.abs(background[6] / still[6] - 1.0).max() > 0.5


def test_a_moving_object_hides_the_spot_from_the_lens() -> None:
    """A strip between the lens and the wall, beside the beam: for as long as it is there the wall is not seen."""
    # At 5 m the line of sight to the wall at 10 m passes half the baseline beside the beam, on the lens's side.
    strip = {"name": "strip", "shape": "rectangle", "size": (0.03, 4.0), "material": GREY}
    points = [
        {"time": time, "position": (x, 0.0, 5.0)} for time, x in ((0.0, 0.0), (0.004, 0.0), (0.008, 2.0))
    ]
    path = {"type": "waypoints", "interpolation": "linear", "points": points}
    baseline = scenario().scanner.receiver.baseline
    for point in points:
        point["position"] = (point["position"][0] + 0.5 * baseline, 0.0, 5.0)
    told = scenario({**strip, "motion": path}, WALL, scanner={"rate": 10000.0}, rows=12, columns=10)
    straight = told.raster.model_copy(update={"horizontal": (-1e-5, 1e-5), "vertical": (-1e-5, 1e-5)})
    layers, time = measured(told.model_copy(update={"scan": straight}))
    assert (layers["truth.object"] == 2).all()
    dark = layers["Y"] < 0.1 * layers["Y"].max()
    assert dark[time < 0.0035].all()
    assert not dark[time > 0.005].any()


@pytest.mark.slow
def test_the_same_bytes_for_any_batch_and_threads(threads_restored: None) -> None:
    told = scenario(plate(motion=TWIST), WALL, lighting=SUN, rows=10, columns=16, transport={"bounces": 2})
    whole = simulate(told, device="cpu")
    for keys in ({"batch": 7}, {"batch": 100, "threads": 1}, {"threads": 3}):
        assert same(simulate(told, device="cpu", **keys), whole)


@pytest.fixture
def threads_restored() -> Iterator[None]:
    before = dr.thread_count()
    yield
    dr.set_thread_count(before)


def same(one: RangeImage, other: RangeImage) -> bool:
    return one.channels.keys() == other.channels.keys() and all(
        one[name].tobytes() == other[name].tobytes() for name in one.channels
    )


def test_motion_compiles_nothing_anew() -> None:
    """After the first batch, later instants and another twist are traced by the kernels that are there."""
    from scanner_sim.render.beam.beamlets import probe_beamlets
    from scanner_sim.render.beam.line_projection import LineProjection
    from scanner_sim.render.beam.projection import trace_returns
    from scanner_sim.render.shots import true_shots

    def compiled(velocity: tuple[float, float, float], shots: NDArray[np.uint32]) -> int:
        told = scenario(plate(motion={"type": "twist", "velocity": velocity}), WALL)
        bench = Instrument(told, device="cpu")
        aim = raster_aim(told.raster, shots, told.scanner.dwell)
        poses = bench.loaded.poses_at(aim.time)
        fired, _ = true_shots(aim, told.scanner.mirrors, 1, 1.0, poses)
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            dr.eval(trace_returns(bench.loaded, LineProjection(bench.optics), probe_beamlets(), fired))
            kernels = [one for one in dr.kernel_history() if one["type"] == dr.KernelType.JIT]
        assert kernels
        return sum(not one["cache_hit"] for one in kernels)

    compiled((0.1, 0.0, 0.0), np.arange(100, dtype=np.uint32))
    assert compiled((0.1, 0.0, 0.0), np.arange(300, 400, dtype=np.uint32)) == 0
    assert compiled((0.3, 0.1, 0.0), np.arange(100, 200, dtype=np.uint32)) == 0


def test_the_photograph_shows_objects_where_they_are_at_the_start() -> None:
    told = scenario(
        plate(motion={**TWIST, "velocity": (0.5, 0.0, 0.0)}), WALL, rows=2, columns=2, lighting=SUN
    )
    small = {"columns": 32, "rows": 24, "pixel_pitch": 200e-6}
    camera = VideoCamera(interior=small, exposure={"type": "fixed", "time": 1e-6})
    told = told.model_copy(update={"camera": camera})
    resting = told.model_copy(update={"scene": told.scene.resting_at(0.0)})
    moving = take_photo(told, device="cpu")
    np.testing.assert_array_equal(moving, take_photo(resting, device="cpu"))
    assert len(np.unique(moving)) > 2


def test_an_object_at_rest_at_an_instant_has_the_pose_of_its_motion() -> None:
    """Positions and turns that are written down again give the same matrices."""
    (item,) = Scene.model_validate({"objects": [plate(motion=TWIST)]}).objects
    for time in (0.0, 0.7, 30.0):
        rested = item.resting_at(time)
        assert rested.motion is None
        np.testing.assert_allclose(rested.scanner_from_object(), item.pose_at(time)[0], atol=1e-12)
    unmoved = Scene.model_validate({"objects": [plate()]}).objects[0]
    assert unmoved.resting_at(3.0) is unmoved
    np.testing.assert_array_equal(unmoved.pose_at([1.0, 2.0])[1], unmoved.scanner_from_object())


def test_the_sunlit_side_of_a_moving_target_is_known() -> None:
    """Points on what the scanner sees of a moving object lie on it, as those of one that rests."""
    from scanner_sim.render.background.illumination import visible_samples
    from scanner_sim.scene.files.loader import load_scene

    scene = Scene.model_validate({"objects": [WALL, plate(motion=TWIST)]})
    found = [visible_samples(load_scene(one), 2, 200, 0) for one in (scene, scene.resting_at(0.0))]
    assert found[0].count == found[1].count > 100
    np.testing.assert_allclose(found[0].point.numpy(), found[1].point.numpy(), atol=1e-5)
    np.testing.assert_allclose(found[0].normal.numpy(), found[1].normal.numpy(), atol=1e-5)


@pytest.mark.parametrize(
    ("motion", "keys", "words"),
    [
        ({"type": "twist", "velocity": (60.0, 0, 0)}, {}, "moves by up to 3 mm during a dwell"),
        ({"type": "twist", "velocity": (20.0, 0, 0)}, {"lighting": SUN}, "moves by up to 32 mm during a row"),
        ({"type": "twist"}, {}, "does not move in the 0.0384 s of the scan"),
        (
            {"type": "waypoints", "points": [{"time": t, "position": (t, 0, 7)} for t in (0.0, 1.0)]},
            {},
            "its position and rotation are not used",
        ),
    ],
)
def test_motions_that_make_little_sense_are_doubted(
    motion: dict[str, Any], keys: dict[str, Any], words: str
) -> None:
    assert any(words in doubt for doubt in scenario_warnings(scenario(plate(motion=motion), WALL, **keys)))
    slow = {"type": "twist", "velocity": (0.01, 0.0, 0.0), "turn_rate": (0.0, 0.0, 0.01)}
    # The raster is coarse, which is another matter.
    others = scenario_warnings(scenario(plate(motion=slow), WALL, **keys))
    assert not [doubt for doubt in others if not doubt.startswith("scan.columns")]
