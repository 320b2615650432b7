"""``pose.methods: [camera]``: what it needs, and how many frames it takes."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.cli.tables import named_files
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.warnings import scenario_warnings
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.products.files.contents import planned_track_files

PLATE = {"diameter": "100 mm", "plate": "300 mm", "rows": 2, "columns": 2, "spacing": ["0.6 m", "0.6 m"]}


def scenario(**changes: Any) -> Scenario:
    return load_scenario(
        {
            "schema": 1,
            "scene": {
                "objects": [
                    {"name": "panel", "array": PLATE, "position": ["0 m", "0 m", "5 m"]},
                    {
                        "name": "ball",
                        "shape": "sphere",
                        "diameter": "100 mm",
                        "material": {"reflectance": 0.5},
                        "position": ["0 m", "1 m", "5 m"],
                    },
                ]
            },
            "lighting": {"sun": {"direction": [0.3, -0.5, -0.8]}},
            "scan": {"type": "track", "duration": "1 s", "targets": ["panel"]},
            "pose": {"methods": ["camera", "joint"]},
            **changes,
        }
    )


RASTER = {"rows": 8, "columns": 8, "horizontal": ["-1 deg", "1 deg"], "vertical": ["-1 deg", "1 deg"]}


@pytest.mark.parametrize(
    ("changes", "place", "words"),
    [
        ({"lighting": {}}, "pose.methods", "has no Sun"),
        ({"scan": {"type": "track", "targets": ["ball"]}}, "pose.methods", "array of 4 dots"),
        ({"scene": {"objects": [{"name": "panel", "array": {**PLATE, "rows": 1, "columns": 3},
                                 "position": ["0 m", "0 m", "5 m"]}]}}, "pose.methods", "array of 4 dots"),
        ({"scene": {"objects": [{"name": "panel", "array": {**PLATE, "rows": 1, "columns": 4},
                                 "position": ["0 m", "0 m", "5 m"]}]}}, "pose.methods", "not in one line"),
        ({"camera": {"exposure": {"type": "automatic", "start": "40 ms"}}},
         "camera.exposure.start", "0.04 s is not between shortest, 0.0001 s, and longest, 0.03333 s"),
        ({"camera": {"exposure": {"type": "automatic", "start": "99 us"}}},
         "camera.exposure.start", "9.9e-05 s is not between"),
        ({"scan": RASTER}, "pose.methods", "scan.type is raster"),
        ({"camera": {"frame_rate": "301 Hz", "exposure": {"type": "fixed", "time": "1 ms"}}},
         "camera.frame_rate", "301 frames in 1 s; 300 are possible"),
        ({"pose": {"methods": ["joint"]}, "output": {"frames": True}}, "output.frames", "there are no frames"),
        ({"scan": RASTER, "pose": {"methods": ["joint"]}, "output": {"frames": True}},
         "output.frames", "there are no frames"),
    ],
)  # fmt: skip
def test_what_leaves_the_camera_without_poses_is_named(changes: Any, place: str, words: str) -> None:
    with pytest.raises(ScenarioError) as found:
        scenario(**changes)
    assert place in str(found.value)
    assert words in str(found.value)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (
            [float("nan"), 1.0],
            "principal_point[0]: .nan is not a finite number. Write for example [322.5, 241.0].",
        ),
        ([1.0], "principal_point: this list has 1 entry. Write for example [322.5, 241.0]."),
        ("middle", "principal_point: 'middle' is not possible here. Possible: centre."),
        (3, "principal_point: 3 is not a list."),
    ],
)
def test_a_principal_point_is_a_word_or_a_pixel_and_has_one_fault(value: Any, words: str) -> None:
    with pytest.raises(ScenarioError) as found:
        scenario(camera={"interior": {"principal_point": value}})
    assert len(found.value.faults) == 1
    assert words in str(found.value)


@pytest.mark.parametrize(
    ("camera", "panel", "count"),
    [
        ({}, {}, None),
        # Dots at ±0.3 m in 5 m are 72 pixels of 1200 focal lengths from the middle, u 319.5: the frame ends at 639.5.
        ({"interior": {"principal_point": [567.4, 239.5]}}, {}, None),
        ({"interior": {"principal_point": [567.6, 239.5]}}, {}, 2),
        ({"interior": {"principal_point": [319.5, 71.4]}}, {}, 2),
        ({"mount": {"rotation": {"axis": "y", "angle": "180 deg"}}}, {}, 0),
        ({"mount": {"position": ["0 m", "0 m", "6 m"]}}, {}, 0),
        ({}, {"rotation": {"axis": "y", "angle": "100 deg"}}, 0),
        # What the camera does not measure, it need not see.
        ({"mount": {"position": ["9 m", "0 m", "0 m"]}}, {"methods": ["joint"]}, None),
    ],
)
def test_an_array_that_the_camera_does_not_see_is_warned_of(
    camera: Any, panel: dict[str, Any], count: int | None
) -> None:
    methods = panel.pop("methods", ["camera", "joint"])
    item = {"name": "panel", "array": PLATE, "position": ["0 m", "0 m", "5 m"], **panel}
    said = scenario_warnings(scenario(camera=camera, scene={"objects": [item]}, pose={"methods": methods}))
    found = [words for words in said if words.startswith("camera:")]
    assert len(found) == (count is not None)
    assert all(f"{count} of 4 dots of 'panel'" in words for words in found)


def test_frames_stand_among_the_planned_files() -> None:
    kept = scenario(output={"frames": True}).output
    assert [name for name in planned_track_files(kept, 1, 2) if "frame" in name or "dots" in name] == [
        "frame_00000.png", "frame_00001.png", "frames.json", "dots.csv", "frames.png",
    ]  # fmt: skip
    assert not any("frame" in name for name in planned_track_files(kept.changed(frames=False), 1, 2))
    assert named_files(planned_track_files(kept, 0, 30)).count("frame_") == 2


@pytest.mark.parametrize(
    ("targets", "arrays"),
    [
        (["panel"], ["panel"]),
        (["panel/2"], ["panel"]),
        (["panel/4", "ball", "panel/1"], ["panel"]),
        ([{"target": "node/3"}], ["node"]),
        (["node/1", "node/4", "panel/3"], ["panel", "node"]),
        (["node", "ball"], ["node"]),
        (["ball"], []),
        (None, []),
    ],
)
def test_arrays_are_those_of_which_a_target_is_followed(targets: list[Any] | None, arrays: list[str]) -> None:
    """Claim: each once and in the order of the scene, whether it is named as a whole or by one of its targets; a raster
    follows none."""
    node = {"name": "node", "array": PLATE, "position": ["2 m", "0 m", "5 m"]}
    scan = RASTER if targets is None else {"type": "track", "targets": targets}
    objects = [*scenario().model_dump(mode="json")["scene"]["objects"], node]
    methods = ["camera", "joint"] if arrays else ["joint"]
    found = scenario(scene={"objects": objects}, scan=scan, pose={"methods": methods})
    assert [item.name for item in found.arrays_followed] == arrays
    assert found.pose.by_scanner == ("joint",)


@pytest.mark.parametrize(("duration", "frames"), [(1.0, 30), (0.99, 30), (0.01, 1), (1.01, 31)])
def test_frames_begin_within_the_run(duration: float, frames: int) -> None:
    times = VideoCamera().frame_times(duration)
    np.testing.assert_allclose(times, np.arange(frames) / 30.0)


@pytest.mark.parametrize("duration", [0.7, 1.0, 7.0, 9.1, 13.0])
def test_the_frame_rate_that_is_told_is_taken(duration: float) -> None:
    """Claim: of a run for which there would be too many frames the rate of the remedy is possible, and 1 % more is
    not."""
    scan = {"type": "track", "duration": duration, "targets": ["panel"]}
    exposure = {"type": "fixed", "time": "0.1 ms"}
    with pytest.raises(ScenarioError) as found:
        scenario(scan=scan, camera={"frame_rate": "500 Hz", "exposure": exposure})
    told = re.search(r"Write ([0-9.]+) Hz or less", str(found.value))
    assert told is not None
    rate = float(told[1])
    scenario(scan=scan, camera={"frame_rate": rate, "exposure": exposure})
    with pytest.raises(ScenarioError, match=r"are possible beside a track"):
        scenario(scan=scan, camera={"frame_rate": 1.01 * rate, "exposure": exposure})


@pytest.mark.parametrize("rate", [7.0, 30.0, 60.0, 90.0])
def test_the_exposure_that_is_told_is_taken(rate: float) -> None:
    exposure = {"type": "fixed", "time": 1.02 / rate}
    with pytest.raises(ScenarioError) as found:
        scenario(camera={"frame_rate": rate, "exposure": exposure})
    told = re.search(r"Write ([0-9.]+) s or less", str(found.value))
    assert told is not None
    assert float(told[1]) > 0.999 / rate
    scenario(camera={"frame_rate": rate, "exposure": exposure | {"time": float(told[1])}})
