"""What rays and beams meet: which object, how far, how steeply, and where on it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mitsuba
import numpy as np
import pytest
from prototype import Laser, Receiver

from scanner_sim.analytic.geometry import point_from_shot
from scanner_sim.render.beam.light import Truth
from scanner_sim.render.beam.surface_positions import surface_positions
from scanner_sim.render.shots import Shots
from scanner_sim.render.survey import look, survey
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

mi: Any = mitsuba

pytestmark = pytest.mark.usefixtures("device")


def plate(name: str, x: float, **keys: object) -> dict[str, object]:
    return {
        "name": name, "shape": "rectangle", "size": (1.0, 1.0), "position": (x, 0.0, 4.0),
        "material": {"reflectance": 0.5}, **keys,
    }  # fmt: skip


def test_rays_meet_objects_by_their_numbers() -> None:
    """Claim: of three plates side by side, one of them tilted and one that moves, each is met where it is by then."""
    motion = {"type": "twist", "velocity": (0.0, 0.0, 1.0)}
    turned = [{"axis": (1.0, 0.0, 0.0), "angle": 0.4}]
    objects = [plate("left", -2.0), plate("going", 0.0, motion=motion), plate("right", 2.0, rotation=turned)]
    loaded = load_scene(Scene(objects=objects))  # type: ignore[arg-type]
    directions = np.array([[-1.0, 0.0, 2.0], [0.0, 0.0, 3.0], [1.0, 0.0, 2.0], [0.0, 1.0, 0.1]])
    found, names = look(loaded, directions, 0.5), [one.name for one in survey(loaded, 0.5)]
    told = [names[number] if number >= 0 else None for number in found.number]
    assert told == ["left", "going", "right", None]
    reach = [math.hypot(2.0, 4.0), 4.5, math.hypot(2.0, 4.0)]
    np.testing.assert_allclose(found.distance, [*reach, math.inf], rtol=1e-6)
    np.testing.assert_allclose(
        found.cosine, [4.0 / reach[0], 1.0, math.cos(0.4) * 4.0 / reach[2], 0.0], rtol=1e-5, atol=1e-7
    )
    middles = [one.points.mean(axis=0) for one in survey(loaded, 0.5)]
    wanted = {"left": (-2.0, 0.0, 4.0), "going": (0.0, 0.0, 4.5), "right": (2.0, 0.0, 4.0)}
    np.testing.assert_allclose(middles, [wanted[name] for name in names], atol=0.01)


def test_a_body_that_turns_is_surveyed_as_it_stands_by_then(tmp_path: Path) -> None:
    """Claim: points lie on the plane that a turned body is in by then, and its triangles are those of its file."""
    file = tmp_path / "m.obj"
    file.write_text("v -1 -0.5 0\nv 1 -0.5 0\nv 1 0.5 0\nv -1 0.5 0\nv 0 0.9 0\nf 1 2 3 4\nf 4 3 5\n")
    motion = {"type": "twist", "velocity": (0.3, 0.0, 1.0), "turn_rate": (0.0, 0.8, 0.0)}
    objects = [
        {"name": "sheet", "mesh": file, "position": (0.0, 0.2, 4.0),
         "material": {"reflectance": 0.5}, "motion": motion},
        plate("beside", 3.0),
    ]  # fmt: skip
    loaded = load_scene(Scene(objects=objects))  # type: ignore[arg-type]
    for time in (0.0, 0.5):
        found = {one.name: one for one in survey(loaded, time)}
        assert (found["sheet"].triangles, found["beside"].triangles) == (3, 2)
        angle = 0.8 * time
        turn = np.array(
            [[math.cos(angle), 0, math.sin(angle)], [0, 1, 0], [-math.sin(angle), 0, math.cos(angle)]]
        )
        own = (found["sheet"].points - [0.3 * time, 0.2, 4.0 + time]) @ turn
        np.testing.assert_allclose(own[:, 2], 0.0, atol=1e-5)
        np.testing.assert_allclose([own[:, 0].min(), own[:, 0].max()], [-1.0, 1.0], atol=0.02)
        np.testing.assert_allclose([own[:, 1].min(), own[:, 1].max()], [-0.5, 0.9], atol=0.02)


def test_beams_meet_surfaces_where_their_distance_ends() -> None:
    """Claim: a beam's point is that of its deflections and distance (eq 3), in the frame of what it meets: a plate that
    was moved and turned; beside all objects that of its Rayleigh length. The radius is a Gaussian beam's there."""
    place, angle = np.array([0.3, -0.2, 5.0]), 0.3
    turned = [{"axis": (0.0, 1.0, 0.0), "angle": angle}]
    objects = [plate("first", 9.0), plate("second", 0.0, position=tuple(place), rotation=turned)]
    loaded, laser = load_scene(Scene(objects=objects)), Laser(waist_distance=1.0)  # type: ignore[arg-type]
    layout = OpticalLayout(laser, Receiver(), 0.05, 0.8, 50e-6, 2e-4, 0.0, 0.0)
    theta, phi = np.array([0.06, -0.1]), np.array([-0.04, 0.2])
    shots = Shots(mi.UInt32([0, 1]), mi.Float(theta.astype(np.float32)), mi.Float(phi.astype(np.float32)))
    truth = Truth(mi.Float([5.0, math.nan]), mi.UInt32([2, 0]), mi.UInt32([1, 0]))
    found = surface_positions(loaded, layout, shots, truth)
    reach = np.array([5.0, laser.rayleigh_length])
    points = point_from_shot(reach, theta, phi, 0.05)
    sine, cosine = math.sin(angle), math.cos(angle)
    rotation = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    wanted = np.stack([(points[0] - place) @ rotation, points[1]])
    np.testing.assert_allclose(found.point.numpy().T, wanted, atol=3e-5)
    wide = laser.waist_radius * np.hypot(1.0, (reach - 1.0) / laser.rayleigh_length)
    np.testing.assert_allclose(found.radius.numpy(), wide, rtol=1e-5)
    np.testing.assert_allclose(found.distance.numpy(), reach, rtol=1e-6)
    axes = [axis.numpy().T for axis in (found.along, found.across, found.normal)]
    np.testing.assert_allclose([np.sum(one * one, axis=1) for one in axes], 1.0, rtol=1e-5)
