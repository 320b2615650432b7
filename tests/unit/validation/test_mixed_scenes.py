"""Scenes drawn by lot, before which ranges must be as good as they say: what is drawn, and between which ends."""

from __future__ import annotations

import math
from typing import Any

import claims
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from scanner_sim.validation.compare import mixed_scenes
from scanner_sim.validation.compare.mixed_scenes import MixedScene

SEEDS = range(300)
HALF = 0.5 * 127 * 1e-3
"""Half of the field of 128 voxels a thousandth of the range apart [rad]."""


def even(values: Any, low: float, high: float) -> bool:
    """Tell whether values are drawn evenly between two ends: none beyond, and a Kolmogorov test at the usual level."""
    given = (np.ravel(values) - low) / (high - low)
    return bool(given.min() >= 0.0 and given.max() <= 1.0 and kstest(given, "uniform").pvalue > claims.LEVEL)


def test_scenes_are_drawn_evenly_in_logarithms() -> None:
    """Claim: ranges from 2.5 to 10 m, voxels a quarter to two thousandths of that apart, seven of ten in motion."""
    scenes = [MixedScene.drawn("clutter", seed, side=77) for seed in range(1500)]
    distance = np.array([scene.distance for scene in scenes])
    assert even(np.log(distance), math.log(2.5), math.log(10.0))
    assert even(np.log([scene.pitch for scene in scenes] / distance), math.log(0.25e-3), math.log(2e-3))
    assert claims.share(sum(scene.motion == "continuous" for scene in scenes), 1500, 0.7)
    assert {(scene.tilt, scene.side) for scene in scenes} == {(math.radians(50.0), 77)}
    near = MixedScene.drawn("clutter", 3, ranges=(0.1, 0.2))
    assert 0.1 < near.distance < 0.2


def test_clutter_fills_the_field_before_its_wall() -> None:
    """Claim: with the field's width w at R: a wall of 1.1 w × 0.8 w at R + 0.6 w, turned up to 40° about each axis;
    twelve things within half of w about the middle, half of them boxes of a tenth to four tenths of w turned anyhow,
    the others spheres as large."""
    R, wide = 5.0, 2.0 * HALF * 5.0
    scenes = [
        mixed_scenes._clutter(np.random.default_rng(seed), MixedScene("clutter", seed, distance=R, pitch=R * 1e-3))
        for seed in SEEDS
    ]  # fmt: skip
    walls, things = [scene[0] for scene in scenes], [item for scene in scenes for item in scene[1:]]
    assert len(things) == 12 * len(SEEDS)
    for wall in walls:
        np.testing.assert_allclose(wall["size"], [1.1 * wide, 0.8 * wide])
        np.testing.assert_allclose(wall["position"], [0.0, 0.15 * wide, R + 0.6 * wide])
    for turned, most in (
        (walls, math.radians(40.0)),
        ([one for one in things if one["shape"] == "box"], math.pi),
    ):
        assert all([turn["axis"] for turn in one["rotation"]] == ["x", "y", "z"] for one in turned)
        assert even([[turn["angle"] for turn in one["rotation"]] for one in turned], -most, most)
    places = np.array([one["position"] for one in things]) - [0.0, 0.0, R]
    assert all(even(places[:, axis] / wide, -0.5, 0.5) for axis in range(3))
    boxes, spheres = ([one for one in things if one["shape"] == shape] for shape in ("box", "sphere"))
    assert claims.share(len(boxes), len(things), 0.5)
    assert even(np.array([one["size"] for one in boxes]) / wide, 0.1, 0.4)
    assert even(np.array([one["diameter"] for one in spheres]) / wide, 0.1, 0.4)
    assert {str(one["material"]) for one in things} == {"{'reflectance': 0.5}"}


def test_stripes_cover_the_field_side_by_side() -> None:
    """Claim: on one board through the middle of the field, tilted and turned; each begins where the last ends, dark and
    bright in turn, as wide as drawn; together, seen from before, 1.2 fields wide to either side."""
    scene = MixedScene("stripes", 1, distance=5.0, pitch=5e-3, tilt=math.radians(50.0), widths=(0.02, 0.05))
    every, tilts = [], []
    for seed in SEEDS:
        made = mixed_scenes._stripes(np.random.default_rng(seed), scene)
        (tilt, turn) = (one["angle"] for one in made[0]["rotation"])
        tilts.append((tilt, turn))
        assert all(
            one["rotation"] == [{"axis": "x", "angle": tilt}, {"axis": "y", "angle": turn}] for one in made
        )
        across = Rotation.from_euler("xy", (tilt, turn)).apply([1.0, 0.0, 0.0])
        middles = np.array([one["position"] for one in made]) - [0.0, 0.0, 5.0]
        along = middles @ across
        np.testing.assert_allclose(middles, along[:, None] * across, atol=1e-12)
        widths = np.array([one["size"][0] for one in made])
        np.testing.assert_allclose(along[1:] - along[:-1], 0.5 * (widths[1:] + widths[:-1]))
        wide = 2.4 * HALF * 5.0
        np.testing.assert_allclose([one["size"][1] for one in made], 1.2 * wide / math.cos(tilt))
        first, last = along[0] - 0.5 * widths[0], along[-1] + 0.5 * widths[-1]
        assert first * math.cos(turn) == pytest.approx(-0.5 * wide)
        assert 0.5 * wide <= last * math.cos(turn) < 0.5 * wide + widths[-1]
        greys = [one["material"]["reflectance"] for one in made]
        assert greys == [(0.05, 0.8)[number % 2] for number in range(len(made))]
        every.append(widths[:-1])
    assert even(np.concatenate(every), 0.02, 0.05)
    assert even(tilts, -math.radians(50.0), math.radians(50.0))
    still = mixed_scenes._stripes(np.random.default_rng(1), MixedScene("stripes", 1))
    assert still[0]["rotation"] == [{"axis": "x", "angle": 0.0}, {"axis": "y", "angle": 0.0}]


@pytest.mark.parametrize(
    ("kind", "drawn", "chance"),
    [
        ("glossy", {"weathered_aluminium", "oxidised_inconel", "solar_cell"}, 0.5),
        ("retro", {"retro_sheet"}, 0.3),
    ],
)
def test_materials_are_drawn_by_the_kind_of_scene(kind: Any, drawn: set[str], chance: float) -> None:
    """Claim: bright ones as often as said, each as often as the others; else dull ones, as in sunlight."""
    random = np.random.default_rng(3)
    made = [mixed_scenes._material(random, kind) for _ in range(3000)]
    dull = {mixed_scenes._material(random, "sunlit") for _ in range(200)}
    assert len(dull) == 5
    assert set(made) == drawn | dull
    assert claims.share(sum(name in drawn for name in made), 3000, chance)
    for name in dull:
        assert claims.share(made.count(name), 3000, (1.0 - chance) / 5.0)
    for name in drawn:
        assert claims.share(made.count(name), 3000, chance / len(drawn))


def test_a_scene_is_looked_at_by_a_raster_of_its_pitch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a square field in which neighbours are a pitch apart at the middle; things move sideways where they do;
    the Sun shines from behind the scanner only where it is asked for, from within a box of directions."""
    monkeypatch.setattr(mixed_scenes, "load_scenario", lambda given: given)
    scene = MixedScene("clutter", 5, distance=6.0, pitch=3e-3, side=41, motion="stepped", speed=0.25)
    given: Any = scene.scenario(output={"pictures": False})
    half = 0.5 * 40 * 3e-3 / 6.0
    assert scene.half == pytest.approx(half)
    assert given["scan"] == {
        "type": "raster", "rows": 41, "columns": 41, "horizontal": pytest.approx([-half, half]),
        "vertical": pytest.approx([-half, half]), "motion": "stepped",
    }  # fmt: skip
    motion = {"type": "twist", "velocity": [0.25, 0.0, 0.0]}
    assert all(one["motion"] == motion for one in given["scene"]["objects"])
    assert (given["seed"], given["schema"], given["output"]) == (5, 1, {"pictures": False})
    assert given["lighting"] == {}
    still: Any = scene.at(speed=0.0).scenario()
    assert not any("motion" in one for one in still["scene"]["objects"])
    lit: list[Any] = [MixedScene("sunlit", seed).scenario() for seed in SEEDS]
    suns = np.array([one["lighting"]["sun"]["direction"] for one in lit])
    for axis, (low, high) in enumerate(((-0.8, 0.8), (-0.8, 0.2), (-1.0, -0.3))):
        assert even(suns[:, axis], low, high)
    assert all(one["lighting"]["earth"] == {"direction": [0.0, 1.0, 0.0]} for one in lit)
