"""A forgotten unit of length is noticed, with the one that fits; a right one never is."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import trimesh

from scanner_sim import Scenario, Tracker, read_track, simulate, track
from scanner_sim.instrument.scene_warnings import scene_warnings
from scanner_sim.products.files.exr import read_range_image, write_exr
from scanner_sim.products.files.track_folder import write_track
from scanner_sim.products.settings import Output

pytestmark = pytest.mark.usefixtures("device")


def scenario(path: Path, **part: object) -> Scenario:
    item = {"name": "part", "mesh": path, "material": "z93_white", "position": (0.0, 0.0, 4.0), **part}
    scan = {"type": "raster", "rows": 6, "columns": 6, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    return Scenario(schema=1, seed=1, scene={"objects": [item]}, scan=scan, output={"pictures": False})


@pytest.mark.parametrize(
    ("per_metre", "given", "likely"),
    [
        (1000.0, {}, "1 mm"),
        (100.0, {}, "1 cm"),
        (39.37, {}, "1 inch"),
        (1000.0, {"length_unit": 1.0}, "1 mm"),
        (1.0, {"length_unit": 0.001}, "1 m"),
        (1.0, {}, None),
        (1000.0, {"length_unit": 0.001}, None),
        (39.37, {"length_unit": 0.0254}, None),
        (20.0, {"length_unit": 1.0}, None),
        (20.0, {}, None),
    ],
)
def test_a_part_of_40_cm_at_4_m(per_metre: float, given: dict, likely: str | None, tmp_path: Path) -> None:
    """Drawn in some unit, its origin at a corner as CAD programs put it; the last are walls of 8 m, and
    meant so: twice the distance is not too much, though ten fields of view are."""
    box = trimesh.creation.box((0.4, 0.3, 0.2))
    box.apply_translation((0.2, 0.15, 0.1))
    box.apply_scale(per_metre)
    box.export(tmp_path / "part.stl")
    said = [one for one in scene_warnings(scenario(tmp_path / "part.stl", **given)) if "across" in one]
    assert len(said) == (likely is not None)
    assert likely is None or f"length_unit: {likely} " in said[0]


@pytest.mark.parametrize(
    ("position", "middle", "away"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, 4000.0), "4 m"),
        ((0.0, 0.0, 4.0), (0.0, 0.0, 3000.0), "4 m"),
        ((0.0, 0.0, 10.0), (0.0, 0.0, -5000.0), "5 m"),
        ((0.0, 0.0, 10.0), (3000.0, 0.0, -6000.0), "5 m"),
    ],
    ids=["middle alone", "origin", "middle before it", "middle aside"],
)
@pytest.mark.parametrize("turned", [False, True])
def test_a_part_in_millimetres_is_as_far_as_its_middle_or_its_origin(
    position: tuple[float, ...], middle: tuple[float, ...], away: str, turned: bool, tmp_path: Path
) -> None:
    """Claim: the nearer of both, if the origin is not the scanner's own, whichever way the part is turned: of 400 mm
    nothing is said, and 0.4 mm are too small there."""
    x, y, z = middle
    rotation = {"axis": "y", "angle": math.radians(90.0)}
    for size in (400.0, 0.4):
        box = trimesh.creation.box((size, size, size))
        # A quarter turn about y takes x to −z and z to x.
        box.apply_translation((-z, y, x) if turned else (x, y, z))
        box.export(tmp_path / "part.obj")
        given = {"length_unit": 1e-3, "position": position} | ({"rotation": rotation} if turned else {})
        said = [one for one in scene_warnings(scenario(tmp_path / "part.obj", **given)) if "across" in one]
        assert len(said) == (size < 1.0)
        assert all(f"sees at its {away}; with length_unit: 1 m" in one for one in said)


def test_results_keep_what_was_said_of_meshes(tmp_path: Path) -> None:
    """What was mended and doubted stands in the image and its file, whoever simulated."""
    doubtful(tmp_path / "part.obj")
    image = simulate(scenario(tmp_path / "part.obj"), device="cpu")
    assert any("1 face without area left out" in one for one in image.warnings)
    assert any("length_unit: 1 mm" in one for one in image.warnings)
    write_exr(tmp_path / "range.exr", image)
    assert read_range_image(tmp_path / "range.exr").warnings == image.warnings


def test_tracking_runs_keep_what_was_said_of_meshes(tmp_path: Path) -> None:
    """As images do: in the run, in its table, and in the run of a tracker that a program drives."""
    doubtful(tmp_path / "part.obj")
    board = {"name": "board", "array": {"diameter": 0.1, "plate": 0.3}, "position": (0.0, 0.0, 3.0)}
    part = {
        "name": "part",
        "mesh": tmp_path / "part.obj",
        "material": "z93_white",
        "position": (0.0, 0.0, 4.0),
    }
    scan = {"type": "track", "targets": ["board"], "duration": 0.01}
    followed = Scenario(schema=1, seed=1, scene={"objects": [part, board]}, scan=scan)
    run = track(followed, device="cpu")
    assert any("1 face without area left out" in one for one in run.warnings)
    assert any("far more than" in one for one in run.warnings)
    write_track(run, tmp_path / "out", Output(pictures=False))
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"] == list(run.warnings)
    assert read_track(tmp_path / "out").warnings == run.warnings
    tracker = Tracker(followed, device="cpu")
    assert (
        tracker.track([record for record, _ in zip(tracker, range(1), strict=False)]).warnings == run.warnings
    )


def doubtful(path: Path) -> None:
    """Write a box in millimetres, with a face that has no area."""
    box = trimesh.creation.box((400.0, 300.0, 200.0))
    vertices, faces = box.vertices, [*box.faces.tolist(), [0, 0, 1]]
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    path.write_text("\n".join(lines))
