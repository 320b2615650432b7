"""Light that meets several surfaces, in an integrating sphere: from any wall every other wall gets as much."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import drjit as dr
import mitsuba
import numpy as np
import pytest
from claims import mean
from prototype import Laser, Receiver
from pydantic import ValidationError

from scanner_sim.render.beam import bounces
from scanner_sim.render.beam.beamlets import Beamlets, edge_beamlets
from scanner_sim.render.beam.path_projection import PathProjection
from scanner_sim.render.beam.splitter import BOUNCE_CLUSTERS, render_light
from scanner_sim.render.settings import Transport
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

mi: Any = mitsuba

R, RHO = 2.0, 0.6
"""Radius and reflectance of the sphere about the scanner, a Lambertian wall."""
LAYOUT = OpticalLayout(Laser(), Receiver(), 0.0, 1.0, 50e-6, 250e-6, 1e-3, 0.0)

pytestmark = pytest.mark.usefixtures("device")


def sphere(**material: Any) -> Any:
    ball = {"name": "ball", "shape": "sphere", "diameter": 2.0 * R, "position": (0.0, 0.0, 0.0),
            "material": {"reflectance": RHO, **material}}  # fmt: skip
    return load_scene(Scene(objects=(ball,)))


def wall() -> Any:
    """A wall that nothing faces."""
    plane = {"name": "wall", "shape": "rectangle", "size": (9.0, 9.0), "position": (0.0, 0.0, 3.0),
             "material": {"reflectance": RHO}}  # fmt: skip
    return load_scene(Scene(objects=(plane,)))


def walked(paths: int, surfaces: int, seed: Any = 0, *, loaded: Any = None, **own: Any) -> list[Any]:
    """Return way, place, power and whether they are alive, of paths of one shot along z, of power 1."""
    start = mi.Ray3f(dr.zeros(mi.Point3f, paths), mi.Vector3f(0.0, 0.0, 1.0))
    loaded = sphere() if loaded is None else loaded
    si = bounces.meet(loaded, start.o, start.d)
    first = bounces.Vertex(si, dr.ones(mi.Float, paths), si.t, si.is_valid())
    shots = SimpleNamespace(**({"seeds": None, "number": mi.UInt32(5)} | own))
    lane: Any = SimpleNamespace(own=shots, beamlet=dr.arange(mi.UInt32, paths))
    found = []
    for vertex in bounces._walk(loaded, lane, first, surfaces, seed):
        parts = vertex.way, vertex.si.p, vertex.power, vertex.alive
        dr.eval(vertex, *parts)
        found.append([part.numpy().astype(float) for part in parts])
    return found


def test_in_a_sphere_every_wall_is_lit_alike() -> None:
    """Claim: the next point of a path is even over the sphere wherever it was, and independent of the one before; the
    way grows by the chord, 4R/3 on average; power falls by the reflectance, exactly.

    Expected: a chord c and the cosine of the angle at its start go by c = 2R cosθ, and light goes by cosθ: heights over
    any axis are even (Archimedes), of mean 0 and mean square R²/3.
    """
    found = walked(4000, 4)
    assert len(found) == 3
    before, place = np.full(4000, R), np.tile([[0.0], [0.0], [R]], (1, 4000))
    for number, (way, point, power, alive) in enumerate(found, 1):
        assert alive.all()
        np.testing.assert_allclose(power, RHO**number, rtol=1e-5)
        chord = np.linalg.norm(point - place, axis=0)
        np.testing.assert_allclose(way - before, chord, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(np.linalg.norm(point, axis=0), R, rtol=1e-4)
        assert mean(chord, 4.0 * R / 3.0)
        for axis in range(3):
            assert mean(point[axis], 0.0)
            assert mean(point[axis] ** 2, R**2 / 3.0)
            assert mean(point[axis] * place[axis], 0.0)
        before, place = way, point


def test_a_direction_is_drawn_apart_from_the_lobe() -> None:
    """Claim: of a wall that sends a part of the light back the way it came the rest is even about the normal: the next
    walls, but for those whence the light came, have their middle at x = y = 0."""
    tape = {"type": "retroreflector", "retro_share": 0.5, "half_width": 5e-3}
    ((_, point, _, _),) = walked(4000, 2, loaded=sphere(**tape))
    spread = point[:, point[2] > -0.8 * R]
    assert 500 < spread.shape[1] < 3500
    for axis in range(2):
        assert mean(spread[axis], 0.0)


def test_paths_have_random_numbers_of_their_own() -> None:
    """Claim: paths of one shot, of other shots and under other seeds are different ones, the same path is the same."""
    two = [walked(50, 3, **changes)[-1][1] for changes in ({}, {}, {"number": mi.UInt32(6)}, {"seed": 1})]
    np.testing.assert_array_equal(two[0], two[1])
    for other in two[2:]:
        assert (two[0] != other).all()
    assert len(np.unique(two[0][0])) == 50
    lanes = SimpleNamespace(lanes=dr.full(mi.UInt32, 1, 50))
    np.testing.assert_array_equal(walked(50, 3, seeds=lanes)[-1][1], two[3])


def test_a_path_that_leaves_the_scene_is_over() -> None:
    """Claim: off a wall that nothing faces all light is lost, and the way stays as long as it is."""
    ((way, _, _, alive),) = walked(8, 2, loaded=wall())
    assert not alive.any()
    np.testing.assert_allclose(way, 3.0, rtol=1e-6)
    shots = Shots(mi.UInt32([0]), mi.Float([0.0]), mi.Float([0.0]))
    late = bounces.trace_bounces(wall(), PathProjection(LAYOUT, False, 1.0), edge_beamlets(8), 3, shots, 0)
    for values in (late.power, late.position):
        assert values.numpy().tolist() == [0.0] * 16
    assert late.coherence is None


class Told(PathProjection):
    """A projection whose shots have power by their number, and that keeps a fourth of the light, 7 mm wide."""

    def power(self, shots: Any) -> Any:
        return 1.0 + mi.Float(shots.number)

    def sees(self, frame: Any, point: Any) -> Any:  # noqa: ARG002
        return mi.Mask(True)

    def lay_point(self, frame: Any, shots: Any, point: Any, way: Any) -> Any:  # noqa: ARG002
        return dr.select(point.x > 0.0, way, dr.nan), mi.Float(7e-3), mi.Float(0.25)


def test_late_light_stands_in_the_order_of_shots_beamlets_and_surfaces(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: entry (i k + j) (b − 1) + v has the weight of beamlet j, the power of shot i, ρ for each surface after the
    first, what the lens takes in, and what is kept of it; a place is counted from the shot's reference; what is seen
    nowhere or has no place on the coordinate has no power.

    Set-up: a lens that takes in ¹⁄₈ of what is below the middle, and nothing above it.
    """

    def connect(loaded: Any, layout: Any, frame: Any, si: Any, stop: Any, active: Any, coherent: bool) -> Any:
        points.append(si.p.numpy().astype(float))
        return mi.Float(0.125), active & (si.p.y > 0.0)

    points: list[Any] = []
    monkeypatch.setattr(bounces, "connect", connect)
    weights = np.array([0.5, 0.3, 0.2])
    nodes, none = 1e-3 * np.ones((3, 2)), np.zeros(3)
    beamlets = Beamlets(nodes, weights, none, np.zeros((3, 2)), none.copy())
    numbers = np.array([1, 4], dtype=np.uint32)
    shots = Shots(mi.UInt32(numbers), mi.Float([0.1, -0.1]), mi.Float([0.0, 0.0]))
    reference = np.array([0.5, 1.5])
    late = bounces.trace_bounces(
        sphere(), Told(LAYOUT, False, 1.0), beamlets, 5, shots, 3, mi.Float(reference)
    )
    place = np.stack(points)  # surfaces, axes, paths
    power, position, sigma = (
        values.numpy().reshape(2, 3, 4) for values in (late.power, late.position, late.sigma)
    )
    good = ((place[:, 0] > 0.0) & (place[:, 1] > 0.0)).T.reshape(2, 3, 4)
    assert 2 <= good.sum() <= 15
    whole = (
        0.25 * 0.125 * weights[None, :, None] * (1.0 + numbers[:, None, None]) * RHO ** np.arange(1.0, 5.0)
    )
    np.testing.assert_allclose(power, np.where(good, whole, 0.0), rtol=1e-5)
    np.testing.assert_allclose(sigma, 7e-3, rtol=1e-6)
    # The laser stands at the origin, so that the first leg is R.
    steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
    assert (position[~good] == 0.0).all()
    ways = np.cumsum(steps, axis=0).T.reshape(2, 3, 3)
    for shot, beamlet in np.argwhere(good[..., 0]):
        start = R * np.array([np.sin((0.1, -0.1)[shot]), 0.0, np.cos(0.1)])
        way = R + np.linalg.norm(place[0, :, 3 * shot + beamlet] - start) - reference[shot]
        assert position[shot, beamlet, 0] == pytest.approx(way, abs=5e-3)
    for shot, beamlet in np.argwhere(good[..., 0] & good[..., 2]):
        between = position[shot, beamlet, 2] - position[shot, beamlet, 0]
        assert between == pytest.approx(ways[shot, beamlet, 1], rel=1e-4)


def test_ways_are_counted_from_the_reference() -> None:
    """Claim: on the coordinate of an echo the way there, between walls, and back to the lens, less the reference."""
    shots = Shots(mi.UInt32([0]), mi.Float([0.0]), mi.Float([0.0]))
    wide = PathProjection(LAYOUT, False, 3.0)
    plain, less = (
        bounces.trace_bounces(sphere(), wide, edge_beamlets(64), 2, shots, 0, reference)
        for reference in (None, mi.Float([1.25]))
    )
    lit = plain.power.numpy() > 0.0
    assert lit.sum() > 10
    np.testing.assert_array_equal(plain.power.numpy(), less.power.numpy())
    np.testing.assert_allclose(plain.position.numpy()[lit] - less.position.numpy()[lit], 1.25, atol=1e-5)
    # Out and back R each, and a chord of 2R at most between them.
    assert plain.position.numpy()[lit].min() > 2.0 * R
    assert plain.position.numpy()[lit].max() < 4.0 * R + 1e-3


def test_light_that_met_several_surfaces_has_no_speckle() -> None:
    """Claim: where spots keep their coherence it is 0, one for each path and surface."""

    class Kept(PathProjection):
        resolution = replace(PathProjection.resolution, keeps_coherence=True)

    shots = Shots(mi.UInt32([0]), mi.Float([0.0]), mi.Float([0.0]))
    late = bounces.trace_bounces(sphere(), Kept(LAYOUT, False, 3.0), edge_beamlets(8), 3, shots, 0)
    assert late.coherence is not None
    assert late.coherence.numpy().tolist() == [0.0] * 16


def test_as_few_paths_as_are_possible_have_the_beams_spread() -> None:
    """Claim: three paths, the fewest, have the mean 0 and with their own width the covariance 1 of the beam on both
    axes, which two, on a line, cannot have: these are refused."""
    paths = edge_beamlets(Transport(bounces=2, bounce_paths=3).bounce_paths)
    spread = paths.nodes.T @ paths.nodes / 3.0 + paths.variances[0] * np.eye(2)
    np.testing.assert_allclose(paths.nodes.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(spread, np.eye(2), atol=1e-12)
    with pytest.raises(ValidationError, match="greater than or equal to 3"):
        Transport(bounces=2, bounce_paths=2)


def test_late_light_of_a_shot_is_the_same_whatever_is_shot_beside_it() -> None:
    """Claim: in a batch of beams on a plate, on its edges and on the wall behind, each has the late light that it has
    alone: groups of one kind hold shots from all over the batch."""
    ball = {"name": "ball", "shape": "sphere", "diameter": 2.0 * R, "material": {"reflectance": RHO}}
    plate = {"name": "plate", "shape": "rectangle", "size": (0.4, 2.0), "position": (0.0, 0.0, 1.0),
             "material": {"reflectance": 0.3}}  # fmt: skip
    loaded, settings = load_scene(Scene(objects=(ball, plate))), Transport(bounces=2, bounce_paths=32)
    edge = float(np.arctan(0.2))
    theta, number = [0.0, edge, 0.3, 0.05, -edge, -0.3], [7, 3, 8, 2, 9, 4]

    def late(some: list[int]) -> dict[int, tuple[float, float]]:
        shots = Shots(
            mi.UInt32([number[one] for one in some]),
            mi.Float([theta[one] for one in some]),
            dr.zeros(mi.Float, len(some)),
        )
        _, lights = render_light(loaded, PathProjection(LAYOUT, False, 3.0), settings, shots, 0)
        found = {}
        for light in lights:
            amount, place = (values.numpy().reshape(-1, light.shots)[-BOUNCE_CLUSTERS:].astype(float)
                             for values in (light.amount, light.position))  # fmt: skip
            for column, index in enumerate(light.index.numpy()):
                power = amount[:, column].sum()
                found[some[index]] = power, float(amount[:, column] @ place[:, column] / power)
        return found

    together = late([0, 1, 2, 3, 4, 5])
    assert set(together) == {0, 1, 2, 3, 4, 5}
    for one in range(6):
        np.testing.assert_allclose(together[one], late([one])[one], rtol=1e-4)
