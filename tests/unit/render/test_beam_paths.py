"""Rays by plain geometry: how the beam leaves the laser, what it meets, and its way back to lens and photodiode."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import mitsuba
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Laser, Receiver
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from scanner_sim.analytic import geometry as judge
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.render.beam.beamlets import probe_beamlets
from scanner_sim.render.beam.line_projection import LineProjection, on_array
from scanner_sim.render.beam.line_projection import image as image_of
from scanner_sim.render.beam.path_projection import PathProjection
from scanner_sim.render.beam.projection import trace_returns
from scanner_sim.render.rays import intersect, is_occluded
from scanner_sim.render.shot_departures import ShotDepartures
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout, connect, device_frame, launch, meet

Array = NDArray[np.float64]
mi: Any = mitsuba
BASE, D, REFLECTANCE = 0.2, 0.05, 0.4
LASER = Laser(waist_radius=1e-3, waist_distance=4.0)

pytestmark = pytest.mark.usefixtures("device")


def bench(**receiver: Any) -> OpticalLayout:
    return OpticalLayout(LASER, Receiver(**receiver), D, 0.8, 50e-6, 250e-6, 0.0, 38e-6)


def floats(value: Any) -> Array:
    return np.asarray(value.numpy(), dtype=np.float64).ravel()


def plate(distance: float, turn: Array | None = None, size: float = 1.0) -> Any:
    """Return a scene of a plate on the line of sight that faces the scanner, or is turned."""
    matrix = np.diag([size, size, -1.0, 1.0])
    if turn is not None:
        matrix[:3, :3] = turn @ matrix[:3, :3]
    matrix[2, 3] = distance
    shape = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(matrix),
        "bsdf": {"type": "diffuse", "reflectance": REFLECTANCE},
    }
    return mi.load_dict({"type": "scene", "plate": shape})


def still(scene: Any) -> Any:
    return SimpleNamespace(mitsuba=scene, bodies=(), poses=())


@pytest.mark.parametrize("node", [(1.0, 0.0), (0.0, 0.7), (-0.4, 1.1)])
def test_lines_of_the_beam_keep_their_share_of_its_radius(node: tuple[float, float]) -> None:
    """Claim: at every distance along the axis a line is as many standard deviations away as its node says, w/2 by the
    judge, before, in and behind the waist at 4 m; 2e-6 m for single precision."""
    theta, phi = 0.3, -0.2
    made = launch(bench(), device_frame(bench(), mi.Float(theta), mi.Float(phi)), mi.Point2f(*node))
    along, across, normal = judge.scanner_axes(theta, phi)
    origin = floats(made.origin) - judge.laser_origin(phi, D)
    direction = floats(made.direction)
    for distance in (0.0, 2.0, 4.0, 15.0):
        place = origin + direction * (distance - origin @ along) / (direction @ along)
        away = math.hypot(float(place @ across), float(place @ normal))
        wanted = math.hypot(*node) * 0.5 * float(beam_radius(distance, 1e-3, 4.0, 1.5e-6))
        assert away == pytest.approx(wanted, abs=2e-6)
    # At the waist it lies where the node is, not elsewhere on the circle.
    place = origin + direction * (4.0 - origin @ along) / (direction @ along)
    found = (float(place @ across) / 0.5e-3, float(place @ normal) / 0.5e-3)
    assert found == pytest.approx(node, abs=5e-3)


@pytest.mark.parametrize("stop", [(0.0, 0.0), (1.0, 0.0), (-0.6, 0.5)])
def test_a_lens_takes_its_solid_angle(stop: tuple[float, float]) -> None:
    """Claim: ρ/π cosθ cosθ' A T/r² towards a place of the lens at (d, 0, 0), 45 mm in radius, from 0.6 m ahead."""
    layout = bench(aperture=0.09)
    scene = still(plate(0.6))
    frame = device_frame(layout, mi.Float(0.0), mi.Float(0.0))
    si = meet(scene, mi.Point3f(0.0, 0.0, 0.0), mi.Vector3f(0.0, 0.0, 1.0))
    found, seen = connect(scene, layout, frame, si, mi.Point2f(*stop), mi.Bool(True))
    sight = np.array([BASE + 0.045 * stop[0], 0.045 * stop[1], -0.6])
    r = np.linalg.norm(sight)
    cosine = 0.6 / r
    wanted = REFLECTANCE / math.pi * cosine**2 / r**2 * math.pi * 0.045**2 * 0.5 * 0.8
    assert floats(found)[0] == pytest.approx(wanted, rel=1e-5)
    assert bool(np.asarray(seen.numpy()).ravel()[0])


def pose(turn: Array, place: Array) -> Any:
    return SimpleNamespace(rotation=mi.Matrix3f(turn.tolist()), position=mi.Vector3f(*place.tolist()))


def test_rays_meet_the_nearest_of_moved_plates() -> None:
    """Claim: of planes through places with turned normals the nearer one is met, where t = n·c/(n·u)."""
    flat = mi.load_dict(
        {"type": "scene", "p": {"type": "rectangle", "bsdf": {"type": "diffuse", "reflectance": 0.5}}}
    )
    turns = [Rotation.from_rotvec(v).as_matrix() for v in ([0.3, 0.2, 0.9], [-0.2, 0.5, 0.1])]
    middles = [np.array([0.1, -0.2, 5.0]), np.array([-0.1, 0.1, 3.0])]
    towards = np.array([0.02, -0.01, 1.0]) / np.linalg.norm([0.02, -0.01, 1.0])
    for order in ((0, 1), (1, 0)):
        loaded: Any = SimpleNamespace(
            mitsuba=mi.load_dict({"type": "scene"}),
            bodies=tuple(SimpleNamespace(mitsuba=flat) for _ in order),
            poses=tuple(pose(turns[n], middles[n]) for n in order),
        )
        si = intersect(loaded, mi.Ray3f(mi.Point3f(0.0, 0.0, 0.0), mi.Vector3f(*towards.tolist())))
        normal = turns[1][:, 2]
        t = normal @ middles[1] / (normal @ towards)
        assert floats(si.t)[0] == pytest.approx(t, rel=1e-5)
        np.testing.assert_allclose(floats(si.p), t * towards, atol=1e-5)
        np.testing.assert_allclose(floats(si.n), normal, atol=1e-6)
        np.testing.assert_allclose(floats(si.sh_frame.n), normal, atol=1e-6)


def test_a_ray_is_hidden_by_whatever_stands_in_its_way() -> None:
    """Claim: by what rests, by any of the moving bodies where it is, or by several; not by what lies beyond the ray's
    end or beside it; and a ray that there is not meets nothing.

    Set-up: plates of 2 m, one at rest at x = 0 and three bodies at x = 4, 8 and 4, the last behind the first.
    """
    flat = plate(0.0)
    middles = [np.array([4.0, 0.0, 3.0]), np.array([8.0, 0.0, 4.0]), np.array([4.0, 0.0, 6.0])]
    loaded: Any = SimpleNamespace(
        mitsuba=plate(5.0),
        bodies=tuple(SimpleNamespace(mitsuba=flat) for _ in middles),
        poses=tuple(pose(np.eye(3), middle) for middle in middles),
    )
    x = np.float32([0.0, 4.0, 8.0, 12.0, 4.0, 8.0])
    ray = mi.Ray3f(mi.Point3f(mi.Float(x), 0.0, 0.0), mi.Vector3f(0.0, 0.0, 1.0))
    assert is_occluded(loaded, ray).numpy().tolist() == [True, True, True, False, True, True]
    ray.maxt = mi.Float([4.9, 2.9, 4.1, 9.0, 3.1, 3.9])
    assert is_occluded(loaded, ray).numpy().tolist() == [False, False, True, False, True, False]
    ray.maxt = mi.Float(9.0)
    there = mi.Bool([True, False, True, True, True, False])
    assert is_occluded(loaded, ray, active=there).numpy().tolist() == [True, False, True, False, True, False]


@pytest.mark.parametrize(("aside", "on_axis", "beside"), [(0.001, True, True), (-0.001, True, False),
                                                          (0.026, False, True), (0.049, False, True),
                                                          (0.051, False, False)])  # fmt: skip
def test_a_field_beside_the_laser_reaches_from_infinity_inwards(
    aside: float, on_axis: bool, beside: bool
) -> None:
    """Claim: of 10 mrad, 5 m ahead: within 25 mm about the axis; beside the laser from 0 to 50 mm towards it."""
    frame = device_frame(bench(), mi.Float(0.0), mi.Float(0.0))
    for offset, wanted in ((False, on_axis), (True, beside)):
        view = PathProjection(bench(), offset, 0.01)
        own = view.seen_from(frame)
        lens = BASE if offset else 0.0
        found = view.sees(own, mi.Point3f(lens - aside, 0.0, 5.0))
        assert bool(np.asarray(found.numpy()).ravel()[0]) is wanted
        assert not bool(np.asarray(view.sees(own, mi.Point3f(lens - aside, 0.0, -5.0)).numpy()).ravel()[0])


@pytest.mark.parametrize("offset", [False, True])
@pytest.mark.parametrize("turn", [[0.6, 0.0, 0.0], [0.0, 0.5, 0.0], [0.3, -0.4, 0.0]])
def test_a_pulse_goes_there_and_back(offset: bool, turn: list[float]) -> None:
    """Claim: its path is that to the plate and on to the lens; a beam one standard deviation aside has another, which
    over both axes, in squares, is the spread of the whole beam: by differences of plain geometry."""
    turned = Rotation.from_rotvec(turn).as_matrix()
    shots = Shots(mi.UInt32(0), mi.Float(0.0), mi.Float(0.0))
    projection = PathProjection(bench(), offset, 0.4)
    returns = trace_returns(still(plate(3.0, turned)), projection, probe_beamlets(), shots)
    normal, middle = turned[:, 2], np.array([0.0, 0.0, 3.0])
    lens = np.array([BASE if offset else 0.0, 0.0, 0.0])
    ahead = np.array([0.0, 0.0, 1.0])

    def path(shift: Array) -> float:
        t = normal @ (middle - shift) / (normal @ ahead)
        return float(t + np.linalg.norm(shift + t * ahead - lens))

    assert floats(returns.spots.position)[0] + floats(returns.laid.reference)[0] == pytest.approx(
        path(np.zeros(3)), abs=2e-6
    )
    slopes = [(path(1e-4 * axis) - path(-1e-4 * axis)) / 2e-4 for axis in np.eye(3)[:2]]
    sigma = 0.5 * float(beam_radius(3.0, 1e-3, 4.0, 1.5e-6))
    wanted = sigma * math.hypot(*slopes)
    assert floats(returns.spots.sigma)[0] == pytest.approx(wanted, rel=1e-3)


def test_a_pulse_lasts_no_part_of_the_dwell() -> None:
    """Claim: it is fired in the middle of it, where the continuous beam travels on; both at the same angles."""
    shots = Shots(mi.UInt32(3), mi.Float(0.5), mi.Float(0.1), mi.Float(2e-3), mi.Float(3e-3))
    pulse = PathProjection(bench(), False, 0.01).fired(shots)
    continuous = LineProjection(bench()).fired(shots)
    for fired, share in ((pulse, 0.0), (continuous, 1.0)):
        found = [floats(way)[0] for way in (fired.travel_theta, fired.travel_phi, fired.theta)]
        assert found == pytest.approx([share * 2e-3, share * 3e-3, 0.5])


def test_a_beam_moves_less_across_the_line_where_it_is_deflected() -> None:
    """Claim: by δΘ along the line, and cosΘ δφ across it."""
    shots = Shots(mi.UInt32(0), mi.Float(0.5), mi.Float(0.1), mi.Float(2e-3), mi.Float(3e-3))
    along, across = (floats(way)[0] for way in shots.ways)
    assert (along, across) == pytest.approx((2e-3, 3e-3 * math.cos(0.5)), rel=1e-5)


def test_a_point_images_on_the_line_as_the_judge_projects_it() -> None:
    """Claim: any point, on the beam or beside it, stands at the pixel of its central projection, as wide as lens and
    sensor blur it; of its light as much counts as a Gaussian has within the pixels' height.

    The lens's aperture is a hundredth of a millimetre, so that nothing is out of focus; the point at which the
    receiver looks moves by f δ of a synchronisation error δ. Tolerance: single precision.
    """
    theta, phi, late = 0.17, -0.23, 2e-3
    layout = OpticalLayout(
        LASER, Receiver(baseline=BASE, aperture=1e-5, aberration=2e-5), D, 0.8, 40e-6, 250e-6, -1e-3, 3e-5
    )
    focal, sigma = layout.receiver.focal_length, math.hypot(2e-5, 3e-5)
    u, _, m = (np.asarray(axis) for axis in judge.scanner_axes(theta, phi))
    on_axis = judge.point_from_shot(np.array([2.5, 4.0, 7.0, 5.0]), theta, phi, D)
    points = (
        on_axis
        + np.array([0.0, 4e-3, -9e-3, 0.02])[:, None] * m
        + np.array([0.0, 0.3, -0.2, 0.1])[:, None] * u
    )
    p, q = judge.image_of_point(points, theta, phi, focal, BASE, D)
    shots = Shots(mi.UInt32(0), mi.Float(theta), mi.Float(phi), mi.Float(0.0), mi.Float(0.0))
    frame = device_frame(layout, mi.Float(theta), mi.Float(phi))
    where = mi.Vector3f(*(mi.Float(np.float32(column)) for column in points.T))
    pixel, width, share = (
        floats(each) for each in LineProjection(layout).lay_point(frame, shots, where, None)
    )
    np.testing.assert_allclose(pixel, (p + 1e-3) / 40e-6 - 0.5, atol=2e-3)
    np.testing.assert_allclose(width, sigma / 40e-6, rtol=1e-4)
    wanted = norm.cdf((125e-6 - q) / sigma) - norm.cdf((-125e-6 - q) / sigma)
    assert wanted.min() < 0.2 < 0.9 < wanted.max()
    np.testing.assert_allclose(share, wanted, atol=3e-4)
    shots.synchronisation = mi.Float(late)
    moved = floats(LineProjection(layout).lay_point(frame, shots, where, None)[0]) - pixel
    np.testing.assert_allclose(moved, (focal * np.tan(np.arctan(p / focal) + late) - p) / 40e-6, rtol=3e-3)


def test_points_on_a_leaning_array_are_as_wide_as_it_blurs_them_each_way() -> None:
    """Claim: where an array leans out of focus, the blur along the line makes the width, and that across it decides how
    much falls within the pixels' height; both are those of the array's image, which rays through the pupil test."""
    receiver = Receiver(baseline=BASE, array_tilt=0.5, focus_distance=2.0, aperture=0.03)
    layout = OpticalLayout(LASER, receiver, D, 0.8, 40e-6, 250e-6, -1e-3, 3e-5)
    theta, phi = 0.12, -0.1
    shots = Shots(mi.UInt32(0), mi.Float(theta), mi.Float(phi), mi.Float(0.0), mi.Float(0.0))
    frame = device_frame(layout, mi.Float(theta), mi.Float(phi))
    normal = np.asarray(judge.scanner_axes(theta, phi)[2])
    along, across = np.asarray(judge.scanner_axes(theta, phi)[0]), np.array([0.0, 4e-3, -7e-3])
    points = judge.point_from_shot(np.full(3, 4.0), theta, phi, D) + across[:, None] * normal + 0.0 * along
    where = mi.Vector3f(*(mi.Float(np.float32(column)) for column in points.T))
    _, width, share = (floats(each) for each in LineProjection(layout).lay_point(frame, shots, where, None))
    image = on_array(layout, *image_of(layout, frame, where), shots)
    blur_p, blur_q, q = (floats(part) for part in (image.blur_p, image.blur_q, image.q))
    assert (np.abs(blur_p / blur_q - 1.0) > 0.05).all()
    wanted = norm.cdf((125e-6 - q) / np.sqrt(blur_q)) - norm.cdf((-125e-6 - q) / np.sqrt(blur_q))
    assert wanted.min() < 0.7
    np.testing.assert_allclose(share, wanted, atol=3e-4)
    np.testing.assert_allclose(width, np.sqrt(blur_p) / 40e-6, rtol=1e-4)


@pytest.mark.parametrize("offset", [False, True])
def test_the_field_is_a_cone_at_every_distance(offset: bool) -> None:
    """Claim: of full angle α it holds points within tan(α/2) times their depth of its middle, to all sides of it; on
    the laser's axis or, beside it, from the direction of the beam inwards. Points lie 0.3 mm inside its rim or out."""
    view, half = PathProjection(bench(), offset, 0.02), math.tan(0.01)
    own = view.seen_from(device_frame(bench(), mi.Float(0.0), mi.Float(0.0)))
    for depth in (0.7, 5.0, 9.0):
        middle = (BASE - half * depth) if offset else 0.0
        for turn in (0.3, 1.9, 3.6, 5.1):
            for beyond in (-3e-4, 3e-4):
                away = half * depth + beyond
                point = mi.Point3f(middle + away * math.cos(turn), away * math.sin(turn), depth)
                assert bool(np.asarray(view.sees(own, point).numpy()).ravel()[0]) is (beyond < 0.0)


def test_light_is_as_strong_as_the_laser_and_its_noise() -> None:
    """Claim: the laser's power times each shot's own factor on the line, and the pulses' own on the photodiode; paths
    are unequal where the weakest lacks more than a tenth of the strongest."""
    factors = ShotDepartures(power=mi.Float([0.9, 1.0, 1.2]), pulse=mi.Float([1.1, 0.8, 1.0]))
    shots = Shots(mi.UInt32([0, 1, 2]), mi.Float(0.0), mi.Float(0.0), departures=factors)
    line, path = LineProjection(bench()), PathProjection(bench(), False, 0.01)
    np.testing.assert_allclose(floats(line.power(shots)), np.array([0.9, 1.0, 1.2]) * LASER.power, rtol=1e-6)
    np.testing.assert_allclose(floats(path.power(shots)), [1.1, 0.8, 1.0], rtol=1e-6)
    strength = [mi.Float(values) for values in ([1.0, 0.95, 2.0], [0.91, 0.8, 2.0], [0.95, 0.89, 1.75])]
    assert path.is_unequal(strength).numpy().tolist() == [False, True, True]
