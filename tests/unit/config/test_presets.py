"""Instruments as files: what a preset must say, and how a scenario is laid over it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from scanner_sim import Scenario, load_scenario
from scanner_sim.config import load_scanner, resolved_yaml, scenario_from_text, scenario_warnings
from scanner_sim.config.outline import outline
from scanner_sim.config.preset import MARKS, preset_text, read_preset, shipped_presets
from scanner_sim.config.scanner import Scanner
from scanner_sim.foundation.errors import InputError, ScenarioError

SCAN = "scan: {rows: 2, columns: 2, horizontal: [-1 deg, 1 deg], vertical: [-1 deg, 1 deg]}\n"
TEXT = preset_text("nrc_2000")
POWER = 'power: {value: 15 mW, mark: printed, source: "the paper, below eq 19 and section 6"}'


def scenario(folder: Path, scanner: str, own: str = TEXT) -> Scenario:
    """Load a scenario with a scanner, beside a preset's file ``mine.yaml``."""
    (folder / "mine.yaml").write_text(own, encoding="utf-8")
    (folder / "scenario.yaml").write_text(f"schema: 1\nscanner: {scanner}\n{SCAN}", encoding="utf-8")
    return load_scenario(folder / "scenario.yaml")


def faults(folder: Path, scanner: str, own: str = TEXT) -> ScenarioError:
    with pytest.raises(ScenarioError) as caught:
        scenario(folder, scanner, own)
    return caught.value


@pytest.mark.parametrize("name", shipped_presets())
def test_a_shipped_preset_gives_every_value_with_mark_and_source(name: str) -> None:
    preset = read_preset(name)
    scanner = load_scanner(name)
    assert scanner.preset == name
    assert not preset.document.faults
    wanted = {
        tuple(step for step in place if not step.startswith("("))
        for place, slot in outline().items()
        if place[:1] == ("scanner",)
        and slot.part is None
        and slot.field is not None
        and slot.field.is_required()
        and place[-1] != "*"
        and place[:2] != ("scanner", "as_built")
    }
    choices = {("scanner", part) for part in ("filter", "position_sensor", "lidar")}
    absent = {place for place in choices if place in preset.stated}
    assert {place for place in wanted if place[:2] not in absent} - choices <= preset.stated.keys()
    for stated in preset.stated.values():
        assert stated.mark in MARKS
        assert len(stated.source) > 2


def test_no_part_of_the_scanner_has_a_number_of_its_own() -> None:
    """Switches and what may be absent apart: whether noise is simulated is no property of an instrument."""
    numbers = [
        place
        for place, slot in outline().items()
        if place[:1] == ("scanner",)
        and slot.field is not None
        and isinstance(slot.field.default, int | float | str | tuple)
        and not isinstance(slot.field.default, bool)
        and place != ("scanner", "preset")
    ]
    assert not numbers


def test_a_scenario_without_a_preset_has_the_default_one() -> None:
    named = {"schema": 1, "scan": {"rows": 1, "columns": 1, "horizontal": (0, 0), "vertical": (0, 0)}}
    assert load_scenario(named) == load_scenario({**named, "scanner": {"preset": "nrc_2000"}})
    assert Scanner() == load_scanner("nrc_2000") == load_scenario(named).scanner


def test_a_scenario_is_laid_over_its_preset_key_by_key(tmp_path: Path) -> None:
    own = TEXT.replace("value: 15 mW", "value: 40 mW").replace("value: 25 mm", "value: 30 mm")
    scanner = scenario(tmp_path, "{preset: mine.yaml, laser: {wavelength: 1.55 um}}", own).scanner
    assert (scanner.laser.power, scanner.laser.wavelength) == (40e-3, 1.55e-6)
    assert scanner.receiver.aperture == 30e-3
    assert scanner.laser.waist_radius == Scanner().laser.waist_radius
    assert scenario(tmp_path, "{laser: {wavelength: 1.55 um}}", own).scanner.laser.power == 15e-3
    assert Path(scanner.preset) == tmp_path / "mine.yaml"


def test_overrides_and_python_are_laid_over_it_alike(tmp_path: Path) -> None:
    scenario(tmp_path, "{}", TEXT.replace("value: 15 mW", "value: 40 mW"))
    changes = [f"scanner.preset={tmp_path / 'mine.yaml'}", "scanner.rate=10 kHz"]
    scanner = load_scenario(tmp_path / "scenario.yaml", changes).scanner
    assert (scanner.laser.power, scanner.rate) == (40e-3, 10e3)
    assert Scanner(preset=str(tmp_path / "mine.yaml"), rate=10e3) == scanner


def test_a_part_of_its_own_finds_its_preset_in_the_folder_that_it_is_told(tmp_path: Path) -> None:
    """Claim: a relative path counts from ``context["folder"]``, as those of all parts do, and not from the working
    folder."""
    own = {"preset": "mine.yaml", "rate": 10e3}
    with pytest.raises(InputError, match=r"mine\.yaml"):
        Scanner.model_validate(own)
    (tmp_path / "mine.yaml").write_text(TEXT.replace("value: 15 mW", "value: 40 mW"), encoding="utf-8")
    scanner = Scanner.model_validate(own, context={"folder": tmp_path})
    assert (scanner.laser.power, scanner.rate) == (40e-3, 10e3)


def test_a_word_in_place_of_a_block_replaces_it_and_a_block_in_place_of_a_word(tmp_path: Path) -> None:
    assert scenario(tmp_path, "{filter: none}").scanner.filter == "none"
    block = TEXT[TEXT.index("  filter:\n") : TEXT.index("  position_sensor:\n")]
    bare = TEXT.replace(block, "  filter: {value: none, mark: assumed, source: no filter}\n")
    assert scenario(tmp_path, "{preset: mine.yaml}", bare).scanner.filter == "none"
    (fault, *_) = faults(tmp_path, "{preset: mine.yaml, filter: {bandwidth: 5 nm}}", bare).faults
    assert str(fault).startswith("line 2, scanner.filter.transmission: this key is missing.")


@pytest.mark.parametrize(
    ("given", "energy", "peak"),
    [
        ("{energy: 2 uJ}", 2e-6, None),
        ("{peak_power: 50 W}", None, 50.0),
        ("{width: 1 ns}", None, 100.0),
        ("{peak_power: null, energy: null}", None, 100.0),
        ("{peak_power: null, energy: 2 uJ}", 2e-6, None),
    ],
)
def test_of_power_and_energy_the_scenario_s_takes_the_place_of_the_preset_s(
    given: str, energy: float | None, peak: float | None, tmp_path: Path
) -> None:
    """Two nulls are what results hold that were written when the power had a default of its own."""
    pulse = scenario(tmp_path, f"{{lidar: {{pulse: {given}}}}}").scanner.lidar.pulse
    assert (pulse.energy, pulse.peak_power) == (energy, peak)


def test_a_resolved_scenario_needs_no_preset_any_more(tmp_path: Path) -> None:
    own = TEXT.replace("value: 15 mW", "value: 40 mW")
    first = scenario(tmp_path, "{preset: mine.yaml, filter: none, lidar: {pulse: {energy: 2 uJ}}}", own)
    text = resolved_yaml(first)
    (tmp_path / "mine.yaml").write_text(TEXT.replace("value: 15 mW", "value: 1 mW"))
    assert scenario_from_text(text, name="changed") == first
    (tmp_path / "mine.yaml").unlink()
    assert scenario_from_text(text, name="gone") == first
    assert Scanner.model_validate(first.scanner.model_dump()) == first.scanner
    with pytest.raises(ScenarioError, match="there is no file"):
        scenario_from_text(text.replace("power: 40 mW", "speckle: true", 1), name="incomplete")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (POWER, "power: 15 mW", "line 15, scanner.laser.power: '15 mW' has no mark and no source. "
         "Write for example {value: 15 mW, mark: assumed, source: my data sheet}."),
        (POWER, "power: {value: 15 mW, source: me}", "line 15, scanner.laser.power.mark: nothing"),
        (POWER, "power: {value: 15 mW, mark: prnted, source: me}", "'prnted' is not a mark. Did you mean 'printed'?"),
        (POWER, "power: {value: 15 mW, mark: printed}", "line 15, scanner.laser.power.source: nothing"),
        (POWER, "power: {value: 15 mW, mark: printed, source: ' '}", "' ' is not a source"),
        (POWER, "power: {value: 15 mW, mark: [printed], source: me}", "a list of 1 is not a mark."),
        (POWER, "power: {mark: printed, source: me}", "line 15, scanner.laser.power: nothing (an empty value) is not"),
        (POWER, "power: {value: 15, mark: printed, source: me}", "line 15, scanner.laser.power: 15 has no unit."),
        (POWER, "power: {value: 15 kg, mark: printed, source: me}", "'kg' cannot be converted to W."),
        (POWER, "power: {value: 15 mW, mark: printed, source: me, note: x}", "scanner.laser.power.note: there is no"),
        (POWER, "power: {value: 15 mW, mark: printed, source: me, sourse: x}", "scanner.laser.power.sourse: there is "
         "no such key beside a value. Did you mean 'source'? Possible: value, mark, source."),
        (f"    {POWER}\n", "", "line 14, scanner.laser.power: this key is missing."),
        (POWER, POWER.replace("power:", "pover:", 1), "line 15, scanner.laser.pover: there is no such key. "
         "Did you mean 'power'?"),
        ("value: 25 mm", "value: 250 mm", "scanner.receiver.aperture: 0.25 m is larger than the focal length"),
        (POWER, f"{POWER}\n    {POWER}", "line 16, scanner.laser.power: this key is given in line 15 and"),
        ("schema: 1", "schema: 2", "schema: 2 is no version that this program reads."),
        ("schema: 1", "schema: true", "schema: true is no version that this program reads."),
        ("\nscanner:\n", "\nscanner:\n  preset: nrc_2000\n", "scanner.preset: a preset has no preset of its own."),
        (TEXT, "schema: 1\nabout: x\nscanner: [1]\n", "line 3, scanner: a list of 1 is not a block of keys."),
        (TEXT, "hello", "it holds 'hello' instead of keys."),
        (TEXT, "", "it holds nothing"),
        (TEXT, "a: [", "this is not readable as YAML"),
        ("\nscanner:\n", "\nscaner:\n", "scaner: there is no such key. Did you mean 'scanner'?"),
    ],
)  # fmt: skip
def test_faults_of_a_preset_stand_at_their_lines_in_its_own_file(
    old: str, new: str, words: str, tmp_path: Path
) -> None:
    assert old in TEXT
    error = faults(tmp_path, "{preset: mine.yaml, laser: {drift: 3 kg}}", TEXT.replace(old, new, 1))
    assert error.source == (tmp_path / "mine.yaml").as_posix()
    assert any(words in str(fault) for fault in error.faults), [str(fault) for fault in error.faults]
    with pytest.raises(ScenarioError):
        load_scanner(str(tmp_path / "mine.yaml"))


def test_all_faults_of_a_preset_are_told_at_once(tmp_path: Path) -> None:
    text = (
        TEXT.replace("value: 1.5 um", "value: 1.5")
        .replace("source: f/4", "sorce: f/4")
        .replace("mark: printed,", "mark: yes,", 1)
    )
    told = [str(fault) for fault in faults(tmp_path, "{preset: mine.yaml}", text).faults]
    lines = [int(re.match(r"line (\d+)", fault)[1]) for fault in told]  # type: ignore[index]
    assert len(told) == 4
    assert lines == sorted(lines)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nrc_200", "there is no preset 'nrc_200'. Did you mean 'nrc_2000'?"),
        ("mien.yaml", "Did you mean mine.yaml?"),
        ("nowhere/mine.yaml", "does not exist either"),
        (".yaml", "there is no file"),
        ("5", "5 is not the name of a preset"),
        ("[a]", "a list of 1 is not the name of a preset"),
        ('"a\\0.yaml"', "there is no file"),
        ("folder.yaml", "a folder"),
    ],
)
def test_a_preset_that_is_not_there_is_a_fault_of_the_scenario(name: str, words: str, tmp_path: Path) -> None:
    """Its other faults are told too, as those of a scenario with the default preset."""
    (tmp_path / "folder.yaml").mkdir()
    first, second = faults(tmp_path, f"{{preset: {name}, laser: {{power: 3}}}}").faults
    assert str(first).startswith("line 2, scanner.preset: ")
    assert words in str(first)
    assert "scanner.laser.power: 3 has no unit" in str(second)


def test_from_python_a_preset_that_is_not_there_is_told_as_well(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no preset 'other'"):
        Scanner(preset="other")
    with pytest.raises(InputError, match="there is no file"):
        load_scanner("mine.yaml", tmp_path)


def test_files_that_a_preset_names_lie_beside_it(tmp_path: Path) -> None:
    (tmp_path / "presets").mkdir()
    (tmp_path / "presets" / "pulse.csv").write_text("0,0\n1e-9,1\n2e-9,0\n")
    own = TEXT.replace("shape: {value: gaussian", "shape: {value: pulse.csv")
    (tmp_path / "presets" / "mine.yaml").write_text(own)
    pulse = scenario(tmp_path, "{preset: presets/mine.yaml}").scanner.lidar.pulse
    assert pulse.shape == tmp_path / "presets" / "pulse.csv"


def test_files_that_a_preset_names_may_lie_at_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "pulse.csv").write_text("0,0\n1e-9,1\n2e-9,0\n")
    own = TEXT.replace("shape: {value: gaussian", "shape: {value: ~/pulse.csv")
    pulse = scenario(tmp_path, "{preset: mine.yaml}", own).scanner.lidar.pulse
    assert pulse.shape == tmp_path / "home" / "pulse.csv"


def test_another_preset_is_no_other_instrument_where_all_values_are_written(tmp_path: Path) -> None:
    """Claim: an override of the preset of a resolved scenario is refused, and one of its block as a whole is taken."""
    whole = resolved_yaml(scenario(tmp_path, "{laser_off: 0.25}"))
    with pytest.raises(
        ScenarioError, match="every value of this scenario's instrument is written out"
    ) as error:
        scenario_from_text(whole, name="run", overrides=["scanner.preset=laser_camera_system"])
    (fault,) = error.value.faults
    assert fault.location == "scanner.preset, set by 'scanner.preset=laser_camera_system'"
    other = scenario_from_text(whole, name="run", overrides=["scanner={preset: laser_camera_system}"])
    assert other.scanner == load_scanner("laser_camera_system")
    (tmp_path / "part.yaml").write_text(f"schema: 1\n{SCAN}", encoding="utf-8")
    part = load_scenario(tmp_path / "part.yaml", ["scanner.preset=laser_camera_system"])
    assert part.scanner == other.scanner


def test_faults_of_the_scenario_stand_at_its_own_lines(tmp_path: Path) -> None:
    (fault,) = faults(tmp_path, "{preset: mine.yaml, receiver: {focal_length: 20 mm}}").faults
    assert str(fault).startswith("line 2, scanner.receiver.aperture: 0.025 m is larger than the focal length")


def test_the_schema_for_editors_has_the_preset_s_values_as_defaults(repo_root: Path) -> None:
    shown: Any = json.loads((repo_root / "configs" / "scenario.schema.json").read_text(encoding="utf-8"))
    for part in ("Laser", "Digitiser", "PositionSensor", "BandpassFilter", "Scanner"):
        assert "required" not in shown["$defs"][part]
    assert shown["$defs"]["Laser"]["properties"]["power"]["default"] == "15 mW"
    assert shown["$defs"]["Digitiser"]["properties"]["gate"]["default"] == ["0.5 m", "35 m"]


EXTENDING = """\
schema: 1
extends: base.yaml
about: one with a longer base
scanner:
  receiver: {baseline: {value: 300 mm, mark: assumed, source: mine}}
  filter: {value: none, mark: assumed, source: mine}
  lidar: {pulse: {energy: {value: 2 uJ, mark: assumed, source: mine}}}
"""


def test_a_preset_that_extends_another_says_only_what_is_unlike_it(tmp_path: Path) -> None:
    """Claim: values and sources are the own ones where there are any, and the base's elsewhere."""
    (tmp_path / "base.yaml").write_text(TEXT.replace("value: 15 mW", "value: 40 mW"), encoding="utf-8")
    scanner = scenario(tmp_path, "{preset: mine.yaml, rate: 10 kHz}", EXTENDING).scanner
    assert (scanner.laser.power, scanner.receiver.baseline, scanner.rate) == (40e-3, 0.3, 10e3)
    assert (scanner.filter, scanner.lidar.pulse.energy, scanner.lidar.pulse.peak_power) == (
        "none",
        2e-6,
        None,
    )
    stated = read_preset("mine.yaml", tmp_path).stated
    assert stated["scanner", "receiver", "baseline"].source == "mine"
    inherited = ("40 mW", "literature", "base.yaml: the paper, below eq 19 and section 6")
    assert stated["scanner", "laser", "power"] == inherited
    gone = {("scanner", "filter", "bandwidth"), ("scanner", "lidar", "pulse", "peak_power")}
    assert not gone & stated.keys()


def test_a_block_of_a_preset_takes_the_place_of_the_word_that_it_extends(tmp_path: Path) -> None:
    """Claim: what is stated are the block's values with their sources, and no longer the word."""
    block = TEXT[TEXT.index("  filter:\n") : TEXT.index("  position_sensor:\n")]
    bare = TEXT.replace(block, "  filter: {value: none, mark: assumed, source: no filter}\n")
    (tmp_path / "base.yaml").write_text(bare, encoding="utf-8")
    own = f"schema: 1\nextends: base.yaml\nabout: one with a filter\nscanner:\n{block}"
    assert scenario(tmp_path, "{preset: mine.yaml}", own).scanner.filter == Scanner().filter
    stated, before = (read_preset(name, tmp_path).stated for name in ("mine.yaml", "nrc_2000"))
    assert {at: one for at, one in stated.items() if "filter" in at} == {
        at: one for at, one in before.items() if "filter" in at
    }
    assert stated.keys() == before.keys()


def test_a_chain_of_presets_reaches_to_its_end(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(
        "schema: 1\nextends: nrc_2000\nabout: x\nscanner: {rate: {value: 5 kHz, mark: assumed, source: x}}\n"
    )
    scanner = scenario(tmp_path, "{preset: mine.yaml}", EXTENDING).scanner
    assert (scanner.rate, scanner.laser.power) == (5e3, 15e-3)


@pytest.mark.parametrize(
    ("extends", "words"),
    [
        ("nrc_200", "line 2, extends: there is no preset 'nrc_200'. Did you mean 'nrc_2000'?"),
        ("bas.yaml", "line 2, extends: there is no file"),
        ("7", "line 2, extends: 7 is not the name of a preset. Write for example 'extends: nrc_2000'."),
        ("mine.yaml", "mine.yaml extends mine.yaml: a circle. Let one of them extend nothing."),
    ],
)
def test_what_cannot_be_extended_is_told_with_all_else(extends: str, words: str, tmp_path: Path) -> None:
    own = EXTENDING.replace("base.yaml", extends).replace("300 mm", "300")
    told = [str(fault) for fault in faults(tmp_path, "{preset: mine.yaml}", own).faults]
    assert len(told) == 2
    assert words in told[0]
    assert "scanner.receiver.baseline: 300 has no unit" in told[1]


def test_who_inherits_twice_names_the_one_who_said_it(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(
        "schema: 1\nextends: nrc_2000\nabout: x\nscanner: {rate: {value: 5 kHz, mark: printed, source: sheet}}\n"
    )
    (tmp_path / "mine.yaml").write_text(EXTENDING)
    stated = read_preset("mine.yaml", tmp_path).stated
    assert stated["scanner", "laser", "power"].source == "nrc_2000: the paper, below eq 19 and section 6"
    assert stated["scanner", "rate"] == ("5 kHz", "literature", "base.yaml: sheet")
    assert read_preset("base.yaml", tmp_path).stated["scanner", "rate"].mark == "printed"


def test_ranging_is_what_the_instrument_can_where_nothing_is_said(tmp_path: Path) -> None:
    assert scenario(tmp_path, "{}").ranging == "triangulation"
    timed = scenario(tmp_path, "{preset: pulsed_scanner}")
    assert (timed.ranging, timed.scanner.rangefinders) == ("tof", ("tof",))
    assert scenario_from_text(resolved_yaml(timed), name="again") == timed
    assert Scanner.model_validate(timed.scanner.model_dump()) == timed.scanner
    assert load_scanner("point_gauge").rangefinders == ("triangulation",)


@pytest.mark.parametrize(
    ("scanner", "ranging", "words"),
    [
        ("{preset: pulsed_scanner}", "both", "ranging: pulsed_scanner has no position sensor, which both asks for. "
         "Write ranging: tof, or choose"),
        ("{preset: pulsed_scanner}", "triangulation", "ranging: pulsed_scanner has no position sensor"),
        ("{lidar: none}", "tof", "ranging: nrc_2000 has no time-of-flight unit, which tof asks for. "
         "Write ranging: triangulation"),
    ],
)  # fmt: skip
def test_what_an_instrument_cannot_is_one_fault_with_its_remedy(
    scanner: str, ranging: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario(tmp_path, f"{scanner}\nranging: {ranging}")
    (fault,) = caught.value.faults
    assert words in str(fault)
    assert fault.line == 3


def test_targets_are_not_followed_without_a_line_sensor() -> None:
    """A lidar alone is refused when the scenario is read; with a line sensor beside it it follows targets."""
    disc = {"name": "disc", "array": {"diameter": 0.1, "plate": 0.3}, "position": [0, 0, 8]}
    whole: dict[str, object] = {
        "schema": 1, "ranging": "tof", "scene": {"objects": [disc]},
        "scan": {"type": "track", "targets": ["disc"], "duration": 0.1},
    }  # fmt: skip
    assert load_scenario(whole).scan.type == "track"
    with pytest.raises(ScenarioError) as caught:
        load_scenario(whole | {"scanner": {"position_sensor": "none"}})
    (fault,) = caught.value.faults
    assert fault.location == "scan.type"
    assert "Choose an instrument with a position_sensor" in fault.remedy


@pytest.mark.parametrize("part", ["position_sensor", "lidar"])
def test_a_part_that_is_not_there_is_told_where_it_is_asked_for(part: str) -> None:
    scanner = load_scanner("pulsed_scanner" if part == "position_sensor" else "point_gauge")
    with pytest.raises(InputError, match="and the instrument has no"):
        getattr(scanner, part)
    assert scanner.changed(**{part: {"noise": {"shot": False}}}) == scanner


@pytest.mark.parametrize(
    ("scanner", "words"),
    [
        ("{position_sensor: none, lidar: none}", "scanner.position_sensor: the instrument has neither"),
        ("{filter: {centre: 1.2 um}}", "scanner.filter: its band misses the laser's 1500 nm at all ranges"),
        ("{laser: {wavelength: 0.6 um}}", "scanner.position_sensor.response: it does not reach the laser's 600 nm"),
        ("{preset: pulsed_scanner, laser: {wavelength: 0.6 um}}", "scanner.lidar.photodiode.response: it does not"),
        ("{position_sensor: {offset: -20 mm}}", "scanner.position_sensor.offset: -20 mm is not possible"),
        ("{position_sensor: {offset: 200 mm}}", "scanner.position_sensor.pixels: the array ends at p = 212.8 mm"),
        ("{mirrors: {max_deflection: 0 deg}}", "scanner.mirrors.max_deflection: 0 deg is not possible"),
        ("{lidar: {digitiser: {gate: [35 m, 0.5 m]}}}", "scanner.lidar.digitiser.gate: the ranges must ascend"),
        ("{lidar: {photodiode: {field_of_view: 0 rad}}}", "scanner.lidar.photodiode.field_of_view: 0 rad is not"),
        ("{}\nprocessing: {range_gate: [0.1 m, 1 m]}", "processing.range_gate: [0.1 m, 1 m] lies outside"),
        ("{preset: point_gauge}\nprocessing: {range_gate: [1 m, 2 m]}", "lies outside of the ranges that the array"),
        ("{preset: pulsed_scanner}\nprocessing: {range_gate: [600 m, 700 m]}", "lies outside of what the digitiser"),
    ],
)  # fmt: skip
def test_an_instrument_that_sees_nothing_is_one_fault(scanner: str, words: str, tmp_path: Path) -> None:
    (fault,) = faults(tmp_path, scanner).faults
    assert words in str(fault), str(fault)
    assert fault.remedy
    assert fault.line is not None


def test_a_laser_that_drifts_out_of_its_filter_is_no_fault(tmp_path: Path) -> None:
    assert scenario(tmp_path, "{laser: {drift: 50 nm}}").scanner.laser.line == pytest.approx(1.55e-6)


def test_a_filter_that_misses_near_ranges_alone_is_no_fault(tmp_path: Path) -> None:
    """At 1.56 m the laser's light comes in at 0.13 rad, and the band lies 3 nm off; far ranges pass."""
    narrow = scenario(tmp_path, "{filter: {bandwidth: 4 nm}}")
    assert any("misses the laser" in words for words in scenario_warnings(narrow))


def test_a_circle_of_two_is_told(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(EXTENDING.replace("base.yaml", "mine.yaml"))
    (fault,) = faults(tmp_path, "{preset: mine.yaml}", EXTENDING).faults
    assert "mine.yaml extends base.yaml extends mine.yaml: a circle." in str(fault)


def test_faults_of_what_is_extended_stand_in_its_own_file(tmp_path: Path) -> None:
    for wrong in ("value: 15", "value: 15 mW, made: up"):
        (tmp_path / "base.yaml").write_text(TEXT.replace("value: 15 mW", wrong), encoding="utf-8")
        error = faults(tmp_path, "{preset: mine.yaml}", EXTENDING)
        assert error.source == (tmp_path / "base.yaml").as_posix()
        assert "scanner.laser.power" in str(error.faults[0])


def test_a_line_of_presets_has_an_end(tmp_path: Path) -> None:
    for number in range(30):
        text = EXTENDING.replace("base.yaml", f"{number + 1}.yaml")
        (tmp_path / f"{number}.yaml").write_text(text)
    (tmp_path / "30.yaml").write_text(TEXT)
    (fault,) = faults(tmp_path, "{preset: 0.yaml}").faults
    assert "presets extend one another up to here" in str(fault)
