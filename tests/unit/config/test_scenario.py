"""What a scenario refuses because its values contradict one another, and that the fault names its place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from scanner_sim import load_scenario
from scanner_sim.config import scenario_warnings
from scanner_sim.config.schema import _tidy
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.scan.raster import RasterScan, raster_aim, tiled_order

SCAN = {"rows": 8, "columns": 8, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
TARGETS = {
    "name": "t",
    "array": {"diameter": 0.1, "plate": 0.2, "rows": 2, "columns": 2, "spacing": (0.5, 0.5)},
}


def scenario(*overrides: str, **parts: Any) -> Any:
    return load_scenario({"schema": 1, "scan": SCAN, **parts}, overrides)


def faults(*overrides: str, **parts: Any) -> str:
    with pytest.raises(ScenarioError) as caught:
        scenario(*overrides, **parts)
    return str(caught.value)


@pytest.mark.parametrize(
    ("override", "place", "words"),
    [
        ("scanner.receiver.baseline=0 m", "scanner.receiver.baseline", "more than 0 m"),
        ("scanner.receiver.baseline=-1 m", "scanner.receiver.baseline", "more than 0 m"),
        ("scanner.receiver.aperture=200 mm", "scanner.receiver.aperture", "focal length"),
        ("scanner.position_sensor.pixels=4096", "scanner.position_sensor.pixels", "nearer than the base"),
        ("scanner.position_sensor.bias=40000", "scanner.position_sensor.bias", "converter"),
        ("scanner.laser.power=.inf", "scanner.laser.power", "not a finite number"),
        ("scanner.laser.power=0 W", "scanner.laser.power", "at least 1e-12 W"),
        ("scanner.laser.m_squared=0.5", "scanner.laser.m_squared", "at least 1"),
        ("scan.horizontal=[-40 deg, 40 deg]", "scan.horizontal", "beyond the mirrors"),
        ("scan.vertical=[10 deg, -10 deg]", "scan.vertical", "smaller angle first"),
        ("scan.vertical=[5 deg, 5 deg]", "scan.vertical", "both ends are equal"),
        ("scan={rows: 16384, columns: 16384, horizontal: [-1 deg, 1 deg], vertical: [-1 deg, 1 deg]}",
         "scan.rows", "million voxels"),
        ("scan.rows=100000", "scan.rows", "at most 16384"),
        ("processing.range_gate=[0.1 m, 1 m]", "processing.range_gate", "outside of the ranges"),
        ("processing.range_gate=[9 m, 3 m]", "processing.range_gate", "ascend"),
        ("seed=-1", "seed", "at least 0"),
        ("seed=9223372036854775808", "seed", "less than"),
        ("seed=1.5", "seed", "not a whole number"),
        ("scene.objects=[{name: a, shape: disc, diameter: -3 m, material: z93_white}]",
         "scene.objects[0].diameter", "at least"),
        ("scene.objects=[{name: a, shape: disc, diameter: 1 m, material: z93_white, position: [0 m, 0 m, 1e9 m]}]",
         "scene.objects[0].position[2]", "at most"),
        ("scene.objects=[{name: a, shape: disc, diameter: 1 m, material: z93_white, "
         "rotation: {axis: [0, 0, 0], angle: 1 deg}}]", "scene.objects[0].rotation.axis", "no direction"),
    ],
)  # fmt: skip
def test_an_impossible_value_is_named_with_its_place(override: str, place: str, words: str) -> None:
    text = faults(override)
    assert f"{place}, set by" in text or f"{place} (object 'a'), set by" in text
    assert words in text


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        ({"diameter": 0.3}, "scene.objects[0].array.diameter", "does not fit on a plate"),
        ({"spacing": (0.1, 0.5)}, "scene.objects[0].array.spacing", "horizontal spacing"),
        ({"spacing": (0.5, 0.1)}, "scene.objects[0].array.spacing", "vertical spacing"),
    ],
)
def test_targets_fit_their_plates_and_plates_their_spacing(change: Any, place: str, words: str) -> None:
    item = {**TARGETS, "array": {**TARGETS["array"], **change}}
    text = faults(scene={"objects": [item]})
    assert place in text
    assert words in text


def test_spacing_is_free_where_there_is_one_target() -> None:
    item = {**TARGETS, "array": {**TARGETS["array"], "rows": 1, "columns": 1, "spacing": (0.01, 0.01)}}
    assert scenario(scene={"objects": [item]}).scene.objects[0].name == "t"


def test_a_name_is_given_once() -> None:
    text = faults(scene={"objects": [TARGETS, {**TARGETS, "name": "u"}, TARGETS]})
    assert "scene.objects[2].name (object 't'): 't' is already the name of objects[0]" in text


def test_contradictions_of_one_part_are_reported_together() -> None:
    text = faults("scan.horizontal=[-40 deg, 40 deg]", "processing.range_gate=[0.1 m, 1 m]")
    assert "2 faults" in text


def test_one_row_may_have_equal_ends() -> None:
    scan = RasterScan(rows=1, columns=4, horizontal=(-0.1, 0.1), vertical=(0.02, 0.02))
    assert scan.angles()[1].tolist() == [0.02]


def test_tiled_order_visits_every_voxel_once() -> None:
    scan = RasterScan(rows=13, columns=21, horizontal=(-0.1, 0.1), vertical=(-0.1, 0.1))
    order = tiled_order(scan)
    assert sorted(order.tolist()) == list(range(13 * 21))
    aim = raster_aim(scan, order, 50e-6)
    assert aim.theta[order == 20] == 0.1
    assert aim.phi[order == 20] == -0.1
    small = RasterScan(rows=3, columns=5, horizontal=(-0.1, 0.1), vertical=(-0.1, 0.1))
    assert tiled_order(small, 2).tolist() == [0, 1, 5, 6, 2, 3, 7, 8, 4, 9, 10, 11, 12, 13, 14]


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("scene.objects=[]", "empty"),
        ("processing.threshold=1", "noise alone"),
        ("processing.range_gate=[0.1 m, 5 m]", "reaches beyond"),
        (
            "scanner={receiver: {aberration: 0 um}, position_sensor: {diffusion: 1 um}}",
            "narrower than a pixel",
        ),
        ("scene.objects.t.position=[0 m, 0 m, -3 m]", "behind the scanner"),
        ("scene.objects.t.position=[2 m, 0 m, 0 m]", "behind the scanner"),
        ("scene.objects.t.position=[0 m, 0 m, 1 m]", "nearer than"),
        ("scene.objects.t.position=[0 m, 0 m, 0 m]", "stands at the scanner"),
    ],
)
def test_what_makes_little_sense_is_doubted(override: str, words: str) -> None:
    good = {"objects": [{**TARGETS, "position": (0.0, 0.0, 5.0)}]}
    assert not scenario_warnings(scenario("scan.motion=stepped", scene=good))
    assert any(words in sentence for sentence in scenario_warnings(scenario(override, scene=good)))


@pytest.mark.parametrize(("name", "doubted"), [("t", True), ("u", False)])
def test_an_object_with_the_name_of_the_scene_s_file_is_doubted(
    tmp_path: Path, name: str, doubted: bool
) -> None:
    """Claim: results know what a file holds by the name of the file."""
    (tmp_path / f"{name}.xml").touch()
    scene = {"file": tmp_path / f"{name}.xml", "objects": [{**TARGETS, "position": (0.0, 0.0, 5.0)}]}
    found = scenario_warnings(scenario("scan.motion=stepped", scene=scene))
    assert [
        words.startswith("scene.objects[0].name: 't' is the name of scene.file, too") for words in found
    ] == ([True] * doubted)


@pytest.mark.parametrize(("end", "doubted"), [(9.9, False), (10.1, True)])
def test_a_gate_beyond_the_far_end_of_the_array_is_doubted(end: float, doubted: bool) -> None:
    """Claim: an array that starts at f d/R sees as far as R, here 10 m."""
    parts = "scanner.position_sensor.offset=2 mm", f"processing.range_gate=[3 m, {end} m]"
    found = scenario_warnings(scenario(*parts, scene={"objects": [{**TARGETS, "position": (0.0, 0.0, 5.0)}]}))
    assert any("reaches beyond" in sentence for sentence in found) is doubted


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"scanner": {"laser": 3}},
            "scanner.laser: 3 is not a block of keys. Write keys below it; known are power, ",
        ),
        (
            {"scene": 7},
            "scene: 7 is not a block of keys. Write keys below it; known are file, objects, labels.",
        ),
        ({"scan": 5}, "scan: 5 is not a block of keys. Write for example {type: raster, rows: 256, "),
        (
            {"camera": {"exposure": 3}},
            "camera.exposure: 3 is not a block of keys. Write for example {type: fixed, ",
        ),
    ],
)
def test_a_number_where_a_block_stands_is_told_with_its_keys_or_an_example(
    change: dict[str, Any], words: str
) -> None:
    scan = {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    with pytest.raises(ScenarioError) as caught:
        load_scenario({"schema": 1, "scan": scan, **change})
    (fault,) = caught.value.faults
    assert str(fault).startswith(words)


def test_a_schema_says_the_same_in_one_way() -> None:
    """Claim: a lone reference stands by itself with what is said beside it, whichever release of pydantic wraps it;
    titles are left out, but not a key of that name; marks of reST are plain words; a text has no bounds of numbers."""
    made = _tidy({
        "allOf": [{"$ref": "#/$defs/One"}], "description": "See :class:`~a.B`\n  and ``x``.", "title": "Field",
        "properties": {"title": {"title": "Title", "type": "string", "minimum": 3, "const": "a", "enum": ["a"]}},
    })  # fmt: skip
    assert made == {
        "$ref": "#/$defs/One", "description": "See a.B and x.",
        "properties": {"title": {"type": "string", "const": "a"}},
    }  # fmt: skip
    two = {"allOf": [{"$ref": "a"}, {"$ref": "b"}]}
    assert _tidy([two, "text"]) == [two, "text"]
