"""Scenarios as text: what YAML means here, how faults are told, overrides, and the way back to text."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from scanner_sim import Scenario, load_scenario
from scanner_sim.cli import app
from scanner_sim.config import json_schema, resolved_yaml, scenario_from_text
from scanner_sim.config.document import read_document
from scanner_sim.config.outline import locations_of_key, outline, slots_of_key
from scanner_sim.foundation.errors import InputError, ScenarioError

GOOD = """\
schema: 1
scanner:
  preset: nrc_2000
  laser: {power: 20 mW}
scene:
  objects:
    - {name: wall, shape: rectangle, size: [4 m, 4 m], position: [0 m, 0 m, 10 m], material: {reflectance: 0.5},
       rotation: {axis: y, angle: 20 deg}}
    - name: w2
      shape: sphere
      diameter: 1 m
      material: z93_white
      rotation: [{axis: x, angle: 5 deg}, {axis: [0, 1, 1], angle: -5 deg}]
scan: {type: raster, rows: 16, columns: 16, horizontal: [-5 deg, 5 deg], vertical: [-5 deg, 5 deg]}
"""


def faults_of(text: str, *overrides: str, tmp_path: Path) -> list[str]:
    path = tmp_path / "scenario.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        load_scenario(path, overrides)
    return [str(fault) for fault in caught.value.faults]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-9", 1e-9),
        ("1.", 1.0),
        (".5", 0.5),
        ("0755", 755),
        ("0x1F", 31),
        ("on", "on"),
        ("yes", "yes"),
        ("off", "off"),
        ("true", True),
        ("~", None),
        ("", None),
        ("1_000", "1_000"),
        ("1:30", "1:30"),
        ("2020-01-01", "2020-01-01"),
        ("15 mW", "15 mW"),
        ("-60 dB", "-60 dB"),
        ("[-15 deg, 15 deg]", ["-15 deg", "15 deg"]),
        ("{a: &x [1], b: *x}", {"a": [1], "b": [1]}),
        ("!!str 5", "5"),
        ("9" * 5000, "9" * 5000),
        ("=", "="),
    ],
)
def test_plain_values_follow_yaml_1_2(text: str, value: Any) -> None:
    document = read_document(text)
    assert not document.faults
    assert document.data == value
    assert type(document.data) is type(value)


@pytest.mark.parametrize("text", [".inf", "-.inf", ".nan", "+.INF"])
def test_values_that_are_not_finite_are_read_as_such(text: str) -> None:
    assert not abs(read_document(text).data) < float("inf")


BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join(['*' + old] * 10)}]\n"
    for old, new in zip("abcdefghi", "bcdefghij", strict=True)
)


@pytest.mark.parametrize(
    ("text", "words", "line"),
    [
        ("a: 1\na: 2\n", "in line 1 and again in line 2", 2),
        ("a: {b: 1, b: 2}\n", "twice in line 1", 1),
        (
            "a: !!python/object/apply:os.system [ls]\n",
            "tag !!python/object/apply:os.system is not allowed",
            1,
        ),
        ("a: !mine 3\n", "tag !mine is not allowed", 1),
        ("1: a\n", "'1' cannot be a key", 1),
        ("true: a\n", "'true' cannot be a key", 1),
        ("? [a, b]\n: c\n", "cannot be a key", 1),
        ("a: &a {b: 1}\nc:\n  <<: *a\n", "merge keys", 3),
        ("a: 1\n---\nb: 2\n", "a second document", 3),
        ("a:\n\tb: 1\n", "a tab", 2),
        ("a: b: c\n", "a colon where no key can stand", 1),
        ("a: [1, 2\nb: 3\n", "not closed", 2),
        ("a: 'x\n", "quotation mark", 2),
        ("a: *b\n", "undefined alias", 1),
        ("a: 1\n b: 2\n", "", 2),
        ("a: 1\n- b\n", "a line that does not fit", 2),
        ("a:\n  b: 1\n c: 2\n", "a line that does not fit", 3),
        ("a: \x07\n", "a character that YAML does not allow", 1),
        ("a: &a [*a]\n", "nested deeper", None),
        ("[" * 5000, "nested deeper", None),
        (BOMB, "repeats itself", None),
    ],
)
def test_tricks_of_yaml_are_faults_with_their_line(text: str, words: str, line: int | None) -> None:
    (fault,) = read_document(text).faults
    assert words in str(fault)
    assert fault.line == line
    assert fault.remedy


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="this PyYAML has no libyaml")
@pytest.mark.parametrize(
    "text",
    [
        "{a: b? c}",
        "a: b\tc",
        "!",
        "{a: !b, c: d}",
        "a: [b,\n\ufeff---\n c]",
        "a: \ud800",
        "a: \x07",
        "a: 'b\n",
    ],
)
def test_libyaml_changes_no_value_no_line_and_no_fault(
    text: str, repo_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: what libyaml reads is what PyYAML reads, and where they differ PyYAML's word holds.

    Set-up: the shipped scenarios and plans, each by itself and after a text that libyaml alone would read otherwise.
    """
    texts = [path.read_text(encoding="utf-8") for path in sorted((repo_root / "configs").rglob("*.yaml"))]
    texts += [text] + [text + "\n" + shipped[:300] for shipped in texts]
    fast = [read_document(every) for every in texts]
    assert all(document.readable for document in fast[: len(fast) // 2])
    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    assert fast == [read_document(every) for every in texts]


def test_a_good_scenario_loads(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text("\ufeff" + GOOD, encoding="utf-8")
    scenario = load_scenario(path)
    assert scenario.scanner.laser.power == 20e-3
    assert scenario == load_scenario(str(path))


def test_a_file_and_a_mapping_are_two_spellings_of_the_same_thing(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(
        "schema: 1\nscan: {rows: 4, columns: 4, horizontal: [-5 deg, 5 deg], vertical: [-0.1 rad, 0.1 rad]}"
    )
    scan = {"rows": 4, "columns": 4, "horizontal": ("-5 deg", "5 deg"), "vertical": (-0.1, 0.1)}
    assert load_scenario(path) == load_scenario({"schema": 1, "scan": scan})
    assert load_scenario(path) == Scenario(schema=1, scan=scan)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("{power: 20 mW}", "{power: 20}", "line 4, scanner.laser.power: 20 has no unit. Write for example 15 mW."),
        ("{power: 20 mW}", "{power: 20 kg}",
         "line 4, scanner.laser.power: 'kg' cannot be converted to W. Write for example 15 mW."),
        ("{power: 20 mW}", "{pover: 20 mW}",
         "line 4, scanner.laser.pover: there is no such key. Did you mean 'power'?"),
        ("{power: 20 mW}", "{baseline: 1 m}",
         "line 4, scanner.laser.baseline: there is no such key here. It belongs to scanner.receiver.baseline"),
        ("{power: 20 mW}", "{power: yes}", "line 4, scanner.laser.power: 'yes' is not a number with a unit."),
        ("{power: 20 mW}", "", "line 4, scanner.laser: nothing (an empty value) is not a block of keys."),
        ("preset: nrc_2000", "preset: nrc_200", "line 3, scanner.preset: there is no preset 'nrc_200'. "
         "Did you mean 'nrc_2000'?"),
        ("size: [4 m, 4 m]", "size: [4 m]",
         "line 7, scene.objects[0].size (object 'wall'): this list has 1 entry. Write for example [4 m, 4 m]."),
        ("size: [4 m, 4 m]", "size: [4 m, 4]", "line 7, scene.objects[0].size[1] (object 'wall'): 4 has no unit."),
        ("size: [4 m, 4 m]", "size: 4 m", "line 7, scene.objects[0].size (object 'wall'): '4 m' is not a list."),
        ("shape: rectangle", "shape: rectangel",
         "line 7, scene.objects[0].shape (object 'wall'): 'rectangel' is no shape. Did you mean 'rectangle'?"),
        ("shape: rectangle", "shap: rectangle",
         "line 7, scene.objects[0].shap (object 'wall'): there is no such key. Did you mean 'shape'?"),
        ("shape: sphere", "shape: sphere\n      mesh: a.ply", "the keys shape and mesh, which exclude one another"),
        ("{reflectance: 0.5}", "{reflectance: 1.5}", "line 7, scene.objects[0].material.reflectance (object 'wall'): "
         "1.5 is not possible; it must be at most 1.0."),
        ("{reflectance: 0.5}", "{reflectance: 50 mm}", "'mm' is no unit of a ratio"),
        ("z93_white", "z93_whit", "line 12, scene.objects[1].material (object 'w2'): There is no material 'z93_whit'. "
         "Did you mean 'z93_white'?"),
        ("{axis: y, angle: 20 deg}", "{axis: w, angle: 20 deg}",
         "line 8, scene.objects[0].rotation.axis (object 'wall'): 'w' is not possible here. Possible: x, y, z."),
        ("{axis: x, angle: 5 deg}", "{axis: x}",
         "line 13, scene.objects[1].rotation[0].angle (object 'w2'): this key is missing. "
         "Write for example 'angle: 15 deg'."),
        ("name: w2", "name: 2 w", "line 9, scene.objects[1].name (object '2 w'): '2 w' is no name"),
        ("columns: 16, ", "", "line 14, scan.columns: this key is missing. Write for example 'columns: 256'."),
        ("columns: 16, ", "columns: 16.5, ", "line 14, scan.columns: 16.5 is not a whole number."),
        ("columns: 16, ", "columns: '16', ", "line 14, scan.columns: '16' is not a whole number."),
        ("columns: 16, ", "columns: true, ", "line 14, scan.columns: true is not a whole number."),
        ("schema: 1", "schema: 2", "line 1, schema: 2 is no version that this program reads. Install a newer"),
        ("schema: 1", "schema: one", "line 1, schema: 'one' is no version that this program reads. Write 'schema: 1'."),
        ("schema: 1", "seed: 1", "schema: this key is missing. Write for example 'schema: 1'."),
        (GOOD, "schema: 1\n", "scan: this key is missing. Write for example 'scan: {type: raster, rows: 256"),
        (GOOD, "- a\n- b\n", "scenario: it holds a list of 2 instead of keys. Begin with 'schema: 1'."),
        (GOOD, "hello", "it holds 'hello' instead of keys"),
        (GOOD, "0", "scenario: it holds 0 instead of keys. Begin with 'schema: 1'."),
        (GOOD, "[]", "scenario: it holds a list of 0 instead of keys. Begin with 'schema: 1'."),
        (GOOD, "false", "scenario: it holds false instead of keys. Begin with 'schema: 1'."),
        (GOOD, "# nothing\n", "scenario: it is empty. Begin with 'schema: 1'"),
    ],
)  # fmt: skip
def test_a_fault_is_one_sentence_with_line_place_and_remedy(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    assert old in GOOD
    (fault,) = faults_of(GOOD.replace(old, new, 1), tmp_path=tmp_path)
    assert message in fault
    assert "(word)" not in fault
    assert "Input should" not in fault


def test_switches_are_true_or_false(tmp_path: Path) -> None:
    text = GOOD + "output: {pictures: no}\n"
    assert faults_of(text, tmp_path=tmp_path) == [
        "line 15, output.pictures: 'no' is not true or false. Write for example true."
    ]


def test_all_faults_are_reported_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = (
        GOOD.replace("20 mW", "20")
        .replace("z93_white", "white")
        .replace("rows: 16", "rows: -1")
        .replace("  preset: nrc_2000\n", "  preset: nrc_2000\n  rate: 1 kHz\n  rate: 2 kHz\n")
        + "sed: 4\n"
    )
    faults = faults_of(text, tmp_path=tmp_path)
    lines = [int(re.match(r"line (\d+)", fault)[1]) for fault in faults]  # type: ignore[index]
    assert len(faults) == 5
    assert lines == sorted(lines)


def test_missing_files_are_faults_with_the_nearest_name(tmp_path: Path) -> None:
    (tmp_path / "part.ply").touch()
    (tmp_path / "notes.txt").touch()
    scene = "schema: 1\nscan: {rows: 1, columns: 1, horizontal: [0 deg, 0 deg], vertical: [0 deg, 0 deg]}\nscene:\n"
    for name, words in (
        ("prt.ply", "there is no file"),
        ("prt.ply", "Did you mean part.ply?"),
        ("notes.txt", "none of the kinds that are read here: .ply, .obj, .stl"),
        (".", "is a folder"),
        ("nowhere/part.ply", "does not exist either"),
        ("3", "not the name of a file"),
    ):
        text = f"{scene}  objects: [{{name: a, material: z93_white, mesh: {name}}}]\n"
        (fault,) = faults_of(text, tmp_path=tmp_path)
        assert words in fault
        assert fault.startswith("line 4, scene.objects[0].mesh (object 'a')")


def test_paths_count_from_the_scenario_and_are_absolute_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "part.ply").touch()
    path = tmp_path / "a" / "scenario.yaml"
    path.write_text(GOOD.replace("shape: sphere\n      diameter: 1 m", "mesh: ../part.ply"))
    monkeypatch.chdir(tmp_path.parent)
    scenario = load_scenario(path)
    assert scenario.scene.objects[1].mesh == tmp_path / "part.ply"
    assert scenario_from_text(resolved_yaml(scenario), name="copy") == scenario


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: None, "There is no file"),
        (lambda path: path.mkdir(), "is a folder, not a scenario"),
        (lambda path: path.write_bytes(b"schema: 1\nname: \xff\xfe\n"), "not a text in UTF-8 (line 2)"),
        (lambda path: path.write_bytes("schema: 1".encode("utf-16")), "not a text in UTF-8 (line 1)"),
        (lambda path: path.write_bytes(b"# " + b"x" * 5_000_000), "larger than 1 MB"),
    ],
)
def test_a_file_that_is_no_scenario_is_refused_with_a_remedy(make: Any, words: str, tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    make(path)
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    assert words in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize("ending", ["yaml", "yml"])
def test_a_misspelt_file_is_found(tmp_path: Path, ending: str) -> None:
    (tmp_path / f"quickstart.{ending}").touch()
    (tmp_path / "quikstart.txt").touch()
    with pytest.raises(InputError, match=rf"Did you mean .*quickstart\.{ending}\?"):
        load_scenario(tmp_path / f"quikstart.{ending}")


def test_overrides_reach_keys_list_entries_and_objects_by_name() -> None:
    scenario = load_scenario(
        {**read_document(GOOD).data},
        [
            "scanner.laser.power=5 mW",
            "scanner.receiver.baseline=0.3 m",
            "scene.objects.w2.position=[1 m, 2 m, 3 m]",
            "scene.objects.0.size.1=3 m",
            "scan.rows=4",
            "scan.rows=5",
            "seed=7",
        ],
    )
    assert scenario.scanner.laser.power == 5e-3
    assert scenario.scanner.receiver.baseline == 0.3
    assert scenario.scene.objects[1].position == (1.0, 2.0, 3.0)
    assert scenario.scene.objects[0].size == (4.0, 3.0)
    assert (scenario.scan.rows, scenario.seed) == (5, 7)


def test_overrides_do_not_change_the_mapping_they_are_put_on() -> None:
    source = read_document(GOOD).data
    load_scenario(source, ["scan.rows=3"])
    assert source["scan"]["rows"] == 16


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("scanner.laser.power", "override 'scanner.laser.power': this is not KEY=VALUE."),
        ("=3", "override '=3': this is not KEY=VALUE."),
        ("a..b=3", "override 'a..b=3': this is not KEY=VALUE."),
        ("scanner.laser.power=5 kg", "scanner.laser.power, set by 'scanner.laser.power=5 kg': 'kg' cannot"),
        ("scanner.laser={pwer: 3 W}", "scanner.laser.pwer, set by 'scanner.laser={pwer: 3 W}': there is no such key."),
        ("scanner.lser.power=3 W", "scanner.lser, set by"),
        ("scene.objects.wal.name=b", "has no entry called 'wal'. Did you mean 'wall'?"),
        ("scene.objects.7.name=b", "scene.objects has 2 entries, counted from 0."),
        ("scene.objects.2.name=b", "scene.objects has 2 entries, counted from 0."),
        ("processing.threshold=.inf", "processing.threshold, set by"),
        ("scan.rows.x=3", "scan.rows is 16, which has no keys."),
        ("scan.rows=[", "override 'scan.rows=[': this is not readable as YAML"),
        ("schema=2", "schema, set by 'schema=2': 2 is no version"),
    ],
)  # fmt: skip
def test_faults_of_overrides_are_named_as_such(override: str, message: str, tmp_path: Path) -> None:
    (fault,) = faults_of(GOOD, override, tmp_path=tmp_path)
    assert message in fault
    assert not fault.startswith("line")


@pytest.mark.slow
@given(
    power=st.floats(1e-9, 1.0),
    angle=st.floats(-10.0, 10.0),
    reflectance=st.floats(0.0, 1.0),
    position=st.tuples(*[st.floats(-1e5, 1e5)] * 3),
    threshold=st.floats(0.0, 1e6),
    name=st.sampled_from(["true", "on", "null", "a", "e1", "y"]),
)
def test_resolved_yaml_is_the_same_scenario_again(
    power: float, angle: float, reflectance: float, position: Any, threshold: float, name: str
) -> None:
    scenario = load_scenario(
        {
            "schema": 1,
            "scanner": {"laser": {"power": power}},
            "scene": {
                "objects": [
                    {
                        "name": name,
                        "shape": "disc",
                        "diameter": 1.0,
                        "position": position,
                        "rotation": {"axis": "z", "angle": angle},
                        "material": {"reflectance": reflectance},
                    }
                ]
            },
            "scan": {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)},
            "processing": {"threshold": threshold},
        }
    )
    text = resolved_yaml(scenario)
    again = scenario_from_text(text, name="copy")
    assert again == scenario
    assert resolved_yaml(again) == text


def test_resolved_yaml_is_complete_and_readable() -> None:
    text = resolved_yaml(scenario_from_text(GOOD, name="good"))
    assert text.startswith("# Scanner Sim scenario, schema 1")
    for line in ("power: 20 mW", "pitch: 50 um", "rate: 20 kHz", "size: [4 m, 4 m]", "horizontal: [-5 deg, 5 deg]",
                 "reflectance: 0.5", "saturation: true", "range_gate: null"):  # fmt: skip
        assert line in text
    keys = {
        place[-1]
        for place, slot in outline().items()
        if place
        and slot.part is None
        and place[0] == "scanner"
        and place[-1].isidentifier()
        and place[1:2] != ("as_built",)
    }
    assert all(f"{key}:" in text for key in keys)


def test_the_outline_knows_where_a_key_is_legal() -> None:
    assert locations_of_key("baseline") == ["scanner.receiver.baseline"]
    assert "scene.objects[…].array.plate" in locations_of_key("plate")


def test_the_schema_is_draft_2020_12_and_spells_units() -> None:
    schema = json_schema()
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["required"] == ["schema", "scan"]
    power = schema["$defs"]["Laser"]["properties"]["power"]
    assert power["default"] == "15 mW"
    assert power["description"].startswith("Power of the beam")
    for text in ("15 mW", "15000 \u00b5W", "15000 \u03bcW"):
        assert re.search(power["pattern"], text), "the sign for micro and the Greek letter, as they are read"
        told = scenario_from_text(GOOD.replace("20 mW", text), name="told")
        assert told.scanner.laser.power == 0.015
    assert not re.search(power["pattern"], "15")
    assert "exclusiveMinimum" not in json.dumps(power)
    references = re.findall(r'"#/\$defs/(\w+)"', json.dumps(schema))
    assert set(references) == set(schema["$defs"])


@pytest.mark.parametrize(("kind", "part"), [("selfcal", "Board"), ("acceptance", "LengthBar")])
def test_plans_have_a_schema_too(kind: str, part: str) -> None:
    """Claim: the printed schema of a plan has its keys, spells units, and refers to nothing that it has not."""
    printed = CliRunner().invoke(app, ["schema", "--plan", kind])
    assert printed.exit_code == 0, printed.output
    schema = json.loads(printed.output)
    assert schema["title"] == f"Scanner Sim plan for {kind}"
    assert {"schema", "base", "seed"} <= set(schema["properties"])
    assert set(re.findall(r'"#/\$defs/(\w+)"', json.dumps(schema))) == set(schema["$defs"])
    diameter = json.dumps(schema["$defs"][part]["properties"]["diameter"])
    assert "pattern" in diameter
    assert schema["additionalProperties"] is False


def test_every_key_has_a_description_for_editors() -> None:
    schema = json_schema()
    parts = {"Scenario": schema, **schema["$defs"]}
    bare = [
        f"{part}.{key}"
        for part, node in parts.items()
        for key, entry in node.get("properties", {}).items()
        if "description" not in entry and "const" not in entry
    ]
    assert not bare


def test_a_key_has_all_kinds_that_may_stand_there() -> None:
    """Claim: the key itself and each kind: a tilt is a word or an angle; in lists any number; no unknown key."""
    assert len(slots_of_key(["scanner", "receiver", "array_tilt"])) == 3
    assert slots_of_key(["scan", "targets", 3]) == slots_of_key(["scan", "targets", 0]) != []
    assert slots_of_key(["scanner", "receiver", "array_tilts"]) == []
