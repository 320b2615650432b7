"""A gallery of bad input: each ends with status 2 and one message with place and remedy, and leaves nothing behind."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from scanner_sim.cli import app

GOOD = """\
schema: 1
scanner: {preset: nrc_2000}
scene:
  objects:
    - {name: part, mesh: part.ply, material: z93_white, position: [0 m, 0 m, 5 m]}
scan: {type: raster, rows: 4, columns: 4, horizontal: [-1 deg, 1 deg], vertical: [-1 deg, 1 deg]}
"""
PLY = (Path(__file__).parents[1] / "triangle.ply").read_text(encoding="utf-8")
XML = """\
<scene version="3.0.0">
  <shape type="sphere" id="ball"><float name="radius" value="0.5"/></shape>
</scene>
"""
CSV = """\
time_s,x_m,y_m,z_m,qw,qx,qy
0,0,0,5,1,0,0
"""

pytestmark = pytest.mark.usefixtures("device")


def attempt(folder: Path, text: str | bytes, *more: str) -> Any:
    """Run a scenario in a folder that holds a sound mesh and a sound XML file."""
    for name, content in (("part.ply", PLY), ("scene.xml", XML), ("poses.csv", CSV)):
        if not (folder / name).exists():
            (folder / name).write_text(content)
    (folder / "scenario.yaml").write_bytes(text.encode() if isinstance(text, str) else text)
    return CliRunner().invoke(app, ["run", str(folder / "scenario.yaml"), "-o", str(folder / "out"), *more])


def assert_refused(result: Any, folder: Path, *words: str) -> None:
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    assert result.stderr.count("error:") == 1
    for word in words:
        assert word in result.stderr
    assert not (folder / "out").exists()
    assert not list(folder.glob("*.partial*"))


def test_the_scenario_from_which_the_bad_ones_are_made_is_good(tmp_path: Path) -> None:
    result = attempt(tmp_path, GOOD + "output: {pictures: false}\n")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("preset: nrc_2000", "preset: nrc_2000, lasr: {}", ("line 2, scanner.lasr", "Did you mean 'laser'?")),
        ("preset: nrc_2000", "laser: {power: 15}", ("line 2, scanner.laser.power", "no unit", "15 mW")),
        ("preset: nrc_2000", "laser: {power: 15 kg}", ("line 2, scanner.laser.power", "cannot be converted", "15 mW")),
        ("preset: nrc_2000", "laser: {power: .nan}", ("line 2, scanner.laser.power", "not a finite number", "15 mW")),
        ("preset: nrc_2000", "laser: {power: 1e400 W}", ("line 2, scanner.laser.power", "not finite", "15 mW")),
        ("preset: nrc_2000", "receiver: {baseline: 0 m}",
         ("line 2, scanner.receiver.baseline", "more than 0 m", "nrc_2000 has 200 mm")),
        ("preset: nrc_2000", "receiver: {aperture: 0.3 m}",
         ("line 2, scanner.receiver.aperture", "Reduce the aperture")),
        ("schema: 1", "schema: 1\nprocessing: {range_gate: [0.1 m, 1 m]}",
         ("line 2, processing.range_gate", "outside of the ranges", "Move the gate")),
        ("material: z93_white", "material: z39_white",
         ("line 5, scene.objects[0].material", "Did you mean 'z93_white'?")),
        ("mesh: part.ply", "mesh: prt.ply",
         ("line 5, scene.objects[0].mesh", "there is no file", "Did you mean part.ply?")),
        ("mesh: part.ply", "mesh: scene.xml", ("line 5, scene.objects[0].mesh", ".ply, .obj, .stl")),
        ("mesh: part.ply", "mesh: part.ply, motion: {type: file, file: posse.csv}",
         ("line 5, scene.objects[0].motion.file", "there is no file", "Did you mean poses.csv?")),
        ("mesh: part.ply", "mesh: part.ply, motion: {type: file, file: poses.csv}",
         ("line 5, scene.objects[0].motion.file", "poses.csv has no column qz", "first line is time_s,")),
        ("mesh: part.ply", "mesh: part.ply, motion: {type: twits}",
         ("line 5, scene.objects[0].motion.type", "Did you mean 'twist'?")),
        ("mesh: part.ply", "mesh: part.ply, motion: {velocity: [1 m/s, 0 m/s, 0 m/s]}",
         ("line 5, scene.objects[0].motion", "the key 'type' is missing", "twist, waypoints, file")),
        ("mesh: part.ply", "mesh: part.ply, motion: {type: twist, turn_rate: [1 m/s, 0 deg/s, 0 deg/s]}",
         ("line 5, scene.objects[0].motion.turn_rate[0]", "is not a unit of", "1 deg/s")),
        ("scanner:", "scanner: {}\nscanner:", ("line 3, scanner", "given in line 2 and again in line 3", "Keep one")),
        ("schema: 1", "schema: 1\nseed: !!python/object/apply:os.getpid []", ("line 2, seed", "tag", "remove the tag")),
        ("schema: 1", "schema: 1\n\tseed: 1", ("line 2", "a tab", "Indent with spaces")),
        ("rows: 4", "rows: 99999", ("line 6, scan.rows", "at most 16384")),
        ("rows: 4, columns: 4", "rows: 16384, columns: 16384", ("line 6, scan.rows", "GB", "several runs")),
        ("[-1 deg, 1 deg], vertical", "[-60 deg, 1 deg], vertical", ("line 6, scan.horizontal", "max_deflection")),
        (GOOD, "", ("it is empty", "schema: 1")),
        (GOOD, "\x00\x01", ("not readable as YAML",)),
    ],
)  # fmt: skip
def test_a_bad_scenario_is_refused(old: str, new: str, words: tuple[str, ...], tmp_path: Path) -> None:
    assert old in GOOD
    assert_refused(attempt(tmp_path, GOOD.replace(old, new, 1)), tmp_path, *words)


def test_many_faults_are_reported_together(tmp_path: Path) -> None:
    text = (
        GOOD.replace("z93_white", "white").replace("rows: 4", "rows: 0").replace("part.ply", "p.ply")
        + "sed: 1\n"
    )
    assert_refused(attempt(tmp_path, text, "--set", "scanner.rate=5"), tmp_path, "5 faults", "scanner.rate=5")


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    assert_refused(attempt(tmp_path, b"\x76\x2f\x31\x01\xff\xfe"), tmp_path, "UTF-8", "Name a YAML file")


def test_a_missing_scenario_is_refused(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["run", str(tmp_path / "no.yaml"), "-o", str(tmp_path / "out")])
    assert_refused(result, tmp_path, "There is no file", "no.yaml")


def test_a_folder_is_no_scenario(tmp_path: Path) -> None:
    (tmp_path / "scenario.yaml").touch()
    result = CliRunner().invoke(app, ["check", str(tmp_path)])
    assert_refused(result, tmp_path, "is a folder", "Did you mean", "scenario.yaml")


def stl(triangles: int, claimed: int) -> bytes:
    return b"\0" * 80 + struct.pack("<I", claimed) + (struct.pack("<12f", *range(12)) + b"\0\0") * triangles


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("bad.ply", b""),
        ("bad.ply", b"hello\n"),
        ("bad.ply", PLY.replace("vertex 3", "vertex 3000").encode()),
        ("bad.ply", PLY.replace("ascii", "binary_little_endian").encode()),
        ("bad.ply", PLY.replace("3 0 2 1", "3 0 2 7").encode()),
        ("bad.ply", PLY.replace("-1 -1 0", "nan -1 0").encode()),
        ("bad.ply", PLY.replace("face 1", "face 0").replace("3 0 2 1\n", "").encode()),
        ("bad.obj", b""),
        ("bad.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
        ("bad.obj", b"v 0 0 zero\n"),
        ("bad.stl", b""),
        ("bad.stl", b"solid x\n"),
        ("bad.stl", stl(1, 1000)),
    ],
)
def test_a_broken_mesh_is_refused(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    result = attempt(tmp_path, GOOD.replace("part.ply", name))
    assert_refused(result, tmp_path, "scenario.yaml: 1 fault", "scene.objects[0]", "part")


@pytest.mark.parametrize(
    "change",
    [
        lambda xml: "",
        lambda xml: "no xml",
        lambda xml: xml.replace("</shape>", ""),
        lambda xml: xml.replace("sphere", "sphrere"),
        lambda xml: xml.replace('name="radius"', 'name="raduis"'),
        lambda xml: xml.replace("0.5", "half"),
        lambda xml: xml.replace('<shape type="sphere"', '<shape type="ply"').replace(
            '<float name="radius" value="0.5"/>', '<string name="filename" value="gone.ply"/>'
        ),
        lambda xml: '<scene version="3.0.0"></scene>',
        lambda xml: xml.replace("</scene>", '<ref id="nobody"/></scene>'),
        lambda xml: "<bsdf/>",
    ],
)
@pytest.mark.parametrize("place", ["object", "scene"])
def test_a_broken_mitsuba_file_is_refused(change: Callable[[str], str], place: str, tmp_path: Path) -> None:
    (tmp_path / "bad.xml").write_text(change(XML))
    if place == "object":
        text = GOOD.replace("mesh: part.ply, material: z93_white", "file: bad.xml")
    else:
        text = GOOD.replace("scene:\n", "scene:\n  file: bad.xml\n")
    assert_refused(attempt(tmp_path, text), tmp_path, "bad.xml")


def test_check_finds_the_same_faults(tmp_path: Path) -> None:
    (tmp_path / "part.ply").write_text("hello")
    (tmp_path / "scenario.yaml").write_text(GOOD)
    result = CliRunner().invoke(app, ["check", str(tmp_path / "scenario.yaml")])
    assert_refused(result, tmp_path, "part.ply")
