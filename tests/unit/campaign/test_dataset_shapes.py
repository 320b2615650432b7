"""What tells the shapes of a data set's objects apart."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from scanner_sim.campaign.dataset.views import _Shapes, _view
from scanner_sim.config import load_scenario


def test_a_shape_is_the_same_wherever_it_is_and_whatever_it_is_called_or_made_of(tmp_path: Path) -> None:
    """Claim: neither paint, of the whole or of its parts, nor labels, place, motion or what it is fixed to make another
    shape; its size, its unit and its file do."""
    mesh, twin = tmp_path / "a.obj", tmp_path / "b.obj"
    for path in (mesh, twin):
        path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    other = tmp_path / "c.obj"
    other.write_text("v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n")
    scan = {"type": "raster", "rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    carrier = {
        "name": "carrier",
        "shape": "box",
        "size": (1.0, 1.0, 1.0),
        "position": (0.0, 0.0, 9.0),
        "material": "nickel",
    }

    def told(**changes: Any) -> str:
        given = {
            "name": "part",
            "mesh": str(mesh),
            "position": (0.0, 0.0, 5.0),
            "material": "nickel",
        }
        given |= changes
        if "materials" in given:
            del given["material"]
        scene = {"objects": [carrier, given]}
        item = load_scenario({"schema": 1, "scan": scan, "scene": scene}).scene.objects[1]
        return _Shapes().of(item)[0]

    same = [
        {"name": "other"}, {"parent": "carrier"}, {"position": (1.0, 0.0, 4.0)}, {"material": "z93_white"},
        {"materials": {"*": "z93_white"}}, {"label_parts": True}, {"mesh": str(twin)},
        {"rotation": {"axis": "y", "angle": 0.3}}, {"motion": {"type": "twist", "velocity": (0.1, 0.0, 0.0)}},
    ]  # fmt: skip
    assert {told(**changes) for changes in same} == {told()}
    others = [{"mesh": str(other)}, {"length_unit": 1e-3}]
    assert len({told(), *(told(**changes) for changes in others)}) == 3


def test_meshes_that_are_labelled_by_parts_say_so(tmp_path: Path) -> None:
    mesh, result = tmp_path / "a.obj", tmp_path / "runs" / "000003" / "range.exr"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    result.parent.mkdir(parents=True)
    result.touch()
    scan = {"type": "raster", "rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    part = {"mesh": str(mesh), "material": "nickel", "position": (0.0, 0.0, 5.0)}
    objects = [
        {"name": "box", "shape": "box", "size": (1.0, 1.0, 1.0), "material": "nickel"},
        {"name": "whole", **part},
        {"name": "apart", "label_parts": True, **part},
    ]
    scenario = load_scenario({"schema": 1, "scan": scan, "scene": {"objects": objects}})
    store: Any = SimpleNamespace(folder=tmp_path, campaign=SimpleNamespace(scenario=lambda _: scenario))
    assert [one.in_parts for one in _view(store, 3, _Shapes()).objects] == [False, False, True]
