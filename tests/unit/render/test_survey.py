"""What rays from the scanner's origin meet: which object, how far, and how steeply."""

from __future__ import annotations

import math

import numpy as np
import pytest

from scanner_sim.render.survey import look, survey
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

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
