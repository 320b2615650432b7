"""What tells the shapes of a data set's objects apart."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from scanner_sim.campaign.dataset.licences import NOT_STATED, licences_of
from scanner_sim.campaign.dataset.views import ViewedObject, _Shapes, _view
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


def test_a_file_is_told_by_the_shapes_that_it_names_too(tmp_path: Path) -> None:
    """Claim: of files with one text, those whose meshes, scenes or buffers beside them differ are other shapes, and a
    copy of all is the same; textures and libraries of materials beside a mesh are paint. The licence of each counts."""
    ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    ply += (
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 {} 0\n3 0 1 2\n"
    )
    named = '<scene version="3.0.0"><shape type="ply"><string name="filename" value="m.ply"/></shape></scene>'
    included = '<scene version="3.0.0"><include filename="a.xml"/></scene>'
    gltf = '{"asset": {"version": "2.0"}, "buffers": [{"uri": "b.bin"}], "images": [{"uri": "c.png"}]}'
    obj = "mtllib d.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    files = {
        "a.xml": named, "i.xml": included, "m.ply": ply.format(1), "g.gltf": gltf, "b.bin": "1", "c.png": "1",
        "o.obj": obj, "d.mtl": "newmtl a\n",
    }  # fmt: skip
    for folder in ("one", "copy", "mesh", "buffer", "paint"):
        (tmp_path / folder).mkdir()
        for name, text in files.items():
            (tmp_path / folder / name).write_text(text, encoding="utf-8")
    (tmp_path / "mesh" / "m.ply").write_text(ply.format(2), encoding="utf-8")
    (tmp_path / "buffer" / "b.bin").write_text("2", encoding="utf-8")
    for name in ("c.png", "d.mtl"):
        (tmp_path / "paint" / name).write_text("newmtl b\n", encoding="utf-8")
    shapes = _Shapes()
    for name, changed in (("a.xml", "mesh"), ("i.xml", "mesh"), ("g.gltf", "buffer"), ("o.obj", "")):
        found = {
            folder: shapes.of_file(tmp_path / folder / name)
            for folder in ("one", "copy", "mesh", "buffer", "paint")
        }
        assert {folder for folder, digest in found.items() if digest != found["one"]} == {changed} - {""}
    (tmp_path / "one" / "m.ply.license").write_text("SPDX-License-Identifier: CC0-1.0\n", encoding="utf-8")
    poses = np.stack([np.eye(4)] * 2)
    seen: Any = SimpleNamespace(objects=(ViewedObject("v", "s", tmp_path / "one" / "i.xml", poses),))
    told = {file.name: file.licence for file in licences_of([seen])}
    assert told == {"i.xml": NOT_STATED, "a.xml": NOT_STATED, "m.ply": "CC0-1.0"}
