"""Garbage waits while kernels are traced: scenes that die between two calls of one kernel would end the process."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario, simulate, track
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.photograph import photograph
from scanner_sim.render import rays
from scanner_sim.render.background.illumination import Sight, trace_sunlight
from scanner_sim.render.background.reference import reference_background, reference_line
from scanner_sim.render.background.sky import light_of
from scanner_sim.render.garbage import each_whole, garbage_waits
from scanner_sim.render.survey import look
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.objects import Scene

pytestmark = pytest.mark.usefixtures("device")

SUN = {"sun": {"direction": (0.1, -0.4, -0.9)}, "earth": {"direction": (0.0, 0.6, 0.8)}}
GREY = {"material": "grey_reference"}
WALLS: list[dict[str, Any]] = [
    {"name": "wall", "shape": "rectangle", "size": (6.0, 6.0), "position": (0.0, 0.0, 6.0)} | GREY,
    {"name": "ball", "shape": "sphere", "diameter": 0.6, "position": (0.3, 0.2, 5.0)}
    | GREY
    | {"motion": {"type": "twist", "velocity": (0.1, 0.0, 0.0)}},
]
SCAN = {"type": "raster", "rows": 4, "columns": 12, "horizontal": (-0.15, 0.15), "vertical": (-0.05, 0.05)}


@pytest.fixture
def traced(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether Python would collect garbage, each time that rays meet surfaces."""
    seen: list[bool] = []
    real = rays.intersect

    def intersect(*given: Any, **options: Any) -> Any:
        seen.append(gc.isenabled())
        return real(*given, **options)

    for name, module in list(sys.modules.items()):
        if name.startswith("scanner_sim.") and getattr(module, "intersect", None) is real:
            monkeypatch.setattr(module, "intersect", intersect)
    return seen


def test_none_is_collected_while_an_image_is_rendered(traced: list[bool]) -> None:
    """Claim: neither for the beams, edges and several surfaces of both rangefinders, nor for the background, nor the
    truth of surfaces."""
    more = {"transport": {"bounces": 2, "background_samples": 2}, "output": {"truth": ["normal"]}}
    scene = {"scene": {"objects": WALLS}, "scan": SCAN, "lighting": SUN, "ranging": "both"}
    scenario = load_scenario({"schema": 1, **scene, **more})
    assert gc.isenabled()
    image = simulate(scenario, device="cpu")
    assert image.valid.any()
    assert len(traced) > 8
    assert not any(traced)
    assert gc.isenabled()


def test_none_is_collected_while_patterns_are_followed(traced: list[bool]) -> None:
    plate = {"name": "node", "array": {"diameter": 0.1, "plate": 0.2}, "position": (0.0, 0.0, 3.0)}
    scan = {"type": "track", "targets": ["node"], "duration": 0.1}
    made = track(load_scenario({"schema": 1, "scene": {"objects": [plate]}, "scan": scan}), device="cpu")
    assert made.records
    assert traced
    assert not any(traced)


def test_none_is_collected_while_frames_are_lit_or_looked_through(traced: list[bool]) -> None:
    """Claim: nor for frames of a video camera, for rays that only ask what there is."""
    camera = VideoCamera.model_validate(
        {
            "interior": {"columns": 24, "rows": 18, "focal_length": 12e-3, "pixel_pitch": 1e-4},
            "sampling": {"samples": 4, "edge_samples": 16, "bounces": 2},
        }
    )
    loaded = load_scene(Scene.model_validate({"objects": WALLS}), band="visible")
    photograph(loaded, camera, Lighting.model_validate(SUN), 0.0)
    assert len(traced) > 1
    before = len(traced)
    look(loaded, np.array([[0.0, 0.0, 1.0]]))
    assert len(traced) > before
    assert not any(traced)


def test_none_is_collected_while_light_is_followed_by_brute_force(traced: list[bool]) -> None:
    """Claim: nor for the judge's lines and backgrounds, nor for sunlight along an orbit."""
    made = Instrument(
        load_scenario({"schema": 1, "scene": {"objects": WALLS[:1]}, "scan": SCAN, "lighting": SUN}),
        device="cpu",
    )
    lamp, still = light_of(made.scenario.lighting.sky()), np.zeros(4)
    reference_line(made.loaded, made.optics, 64, 0.0, 0.0, rays=64)
    reference_background(made.loaded, made.optics, lamp, 64, 0.0, 0.0, bounces=2, samples=4)
    trace_sunlight(made.loaded, made.optics, lamp, Sight(still, still), 2, 0)
    assert len(traced) > 4
    assert not any(traced)


def test_it_is_collected_again_afterwards() -> None:
    """Claim: also after an error, between the items of an iterator, and within another wait not before its end; who
    collects none himself is left in peace."""
    seen: list[bool] = []

    def items() -> Iterator[int]:
        for number in range(3):
            seen.append(gc.isenabled())
            yield number

    for _ in each_whole(items()):
        seen.append(gc.isenabled())
    assert seen == [False, True] * 3
    with pytest.raises(ZeroDivisionError), garbage_waits():
        _ = 1 / 0
    assert gc.isenabled()
    with garbage_waits():
        with garbage_waits():
            pass
        assert not gc.isenabled()
    gc.disable()
    try:
        with garbage_waits():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


LEFT = """
import gc
import mitsuba as mi
from scanner_sim.render.device import activate
activate("cpu", 1)
from test_garbage import WALLS, SUN
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.instrument.photograph import photograph
from scanner_sim.render.background import paths
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.objects import Scene

class Left: pass

left = Left()
left.itself = left
left.scene = mi.load_dict({"type": "scene", "a": {"type": "rectangle"}, "b": {"type": "rectangle"}})
gc.set_threshold(10**9)
loaded = load_scene(Scene.model_validate({"objects": WALLS[:1]}), band="visible")
turn = paths._Tracer.turn

def collecting(*given):
    if gc.isenabled():
        gc.collect()
    return turn(*given)

paths._Tracer.turn = collecting
del left
sizes = {"columns": 24, "rows": 18, "focal_length": 12e-3, "pixel_pitch": 1e-4}
camera = VideoCamera.model_validate({"interior": sizes, "sampling": {"samples": 4, "edge_samples": 4}})
photograph(loaded, camera, Lighting.model_validate(SUN), 0.0)
"""


@pytest.mark.slow
def test_a_scene_that_somebody_left_behind_ends_no_process() -> None:
    """Claim: a scene of his own that is garbage, in a cycle, does not die between a path's first surface and its next,
    where Dr.Jit would write a function twice and abort."""
    command = [sys.executable, "-c", LEFT]
    made = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr[-500:]
