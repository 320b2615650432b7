"""A changed copy of a scenario: the same checks, messages and places as those of a file."""

from __future__ import annotations

import pickle

import pytest
from html_cells import cells

from scanner_sim.config import load_scenario, resolved_yaml, scenario_from_text
from scanner_sim.config import scenario as config_scenario
from scanner_sim.config.document import read_document
from scanner_sim.config.replacing import make_room, plain, put_overrides
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError


@pytest.fixture
def scenario(small_scenario: str) -> Scenario:
    return scenario_from_text(small_scenario, name="small")


def faults(scenario: Scenario, changes: dict[str, object]) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        scenario.replace(changes)
    return [str(fault) for fault in caught.value.faults]


def test_values_are_replaced_with_units_or_in_si(scenario: Scenario) -> None:
    changed = scenario.replace({"scanner.laser.power": "10 mW", "scanner.rate": 1000.0, "scan.rows": 9})
    assert (changed.scanner.laser.power, changed.scanner.rate, changed.raster.rows) == (0.01, 1000.0, 9)
    assert scenario.scanner.laser.power == 0.015, "the first one stays"
    assert scenario.replace({}) == scenario


@pytest.mark.parametrize(
    "key", ["scene.objects[0].position", "scene.objects.0.position", "scene.objects.wall.position"]
)
def test_lists_go_by_index_or_name(scenario: Scenario, key: str) -> None:
    changed = scenario.replace({key: ("0 m", "0 m", 8)})
    assert changed.scene.objects[0].position == (0.0, 0.0, 8.0)


@pytest.mark.parametrize("key", ["scene.objects[left-wall].position", "scene.objects.left-wall.position"])
def test_names_with_dashes_go_as_others_do(scenario: Scenario, key: str) -> None:
    named = scenario.replace({"scene.objects[0].name": "left-wall"})
    assert named.replace({key: (0.0, 0.0, 8.0)}).scene.objects[0].position == (0.0, 0.0, 8.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scanner.laser.powr": "1 mW"}, "scanner.laser.powr: there is no such key. Did you mean 'power'?"),
        ({"scanner.lazer.power": "1 mW"}, "scanner.lazer: there is no such key. Did you mean 'laser'?"),
        ({"scanner.laser.power": "1 m"}, "scanner.laser.power: 'm' cannot be converted to W."),
        ({"scan.rows": "5"}, "scan.rows: '5' is not a whole number."),
        ({"scene.objects.7.position": [0, 0, 1]}, "scene.objects.7.position: scene.objects has 1 entries"),
        ({"scene.objects.wall.sise": 1}, "scene.objects[0].sise (object 'wall'): there is no such key. Did you"),
        ({"": 1}, "scenario: this is no key."),
        ({"scanner.preset": "x.yaml"}, "scanner.preset: every value of this scenario's instrument is written out"),
        # What contradicts something that was not changed.
        ({"scanner.lidar.pulse.repetition_rate": 100.0, "ranging": "tof"}, "scanner.lidar.pulse.repetition_rate"),
    ],
)  # fmt: skip
def test_faults_are_those_of_a_file(scenario: Scenario, changes: dict[str, object], words: str) -> None:
    (found,) = faults(scenario, changes)
    assert found.startswith(words)


def test_all_faults_come_together(scenario: Scenario) -> None:
    assert (
        len(faults(scenario, {"scanner.laser.powr": 1, "scan.rows": -1, "processing.peak": "centroid"})) == 3
    )


def test_what_excludes_another_value_takes_its_place(scenario: Scenario) -> None:
    pulse = scenario.replace({"scanner.lidar.pulse.energy": "1 uJ"}).scanner.lidar.pulse
    assert (pulse.energy, pulse.peak_power) == (1e-6, None)
    power = scenario.replace({"scanner.lidar.pulse.peak_power": 500.0}).scanner.lidar.pulse
    assert (power.energy, power.peak_power) == (None, 500.0)


def test_a_block_is_completed_by_its_instrument(scenario: Scenario) -> None:
    stronger = scenario.replace({"scanner.laser.power": "1 W"})
    assert stronger.replace({"scanner": {}}) == scenario


def test_a_replaced_scenario_is_the_one_that_a_file_gives(small_scenario: str) -> None:
    """Claim: replacing is the same as writing the value into the file, to the last bit of every number."""
    replaced = scenario_from_text(small_scenario, name="small").replace(
        {"scan.horizontal": ["-3 deg", "1 deg"]}
    )
    written = scenario_from_text(
        small_scenario.replace("horizontal: [-2 deg, 2 deg]", "horizontal: [-3 deg, 1 deg]"), name="x"
    )
    assert replaced == written


def test_scenarios_and_errors_go_to_other_processes(scenario: Scenario) -> None:
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    with pytest.raises(ScenarioError) as caught:
        load_scenario({"schema": 1, "scam": {}})
    for error in (caught.value, InputError("no.", remedy="Yes.")):
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is type(error)
        assert (str(again), again.remedy, again.args) == (str(error), error.remedy, error.args)
        assert getattr(again, "faults", None) == getattr(error, "faults", None)


def test_a_notebook_shows_every_value_as_text(scenario: Scenario) -> None:
    named = scenario.replace({"scene.objects[0].name": "wall"})
    page = named._repr_html_()
    assert "scanner.laser.power" in page
    assert "scene.objects[0].position" in page
    told = dict(row for row in cells(page) if len(row) == 2)
    assert (told["scan.horizontal"], told["scene.objects[0].name"]) == ("[-2 deg, 2 deg]", "wall")
    assert "<script" not in scenario.changed(scanner={"preset": "<script>.yaml"})._repr_html_()


def test_a_notebook_s_rows_are_values_that_have_no_parts() -> None:
    """Claim: lists of plain values stand in a row; of those that hold lists or blocks each entry has its own; what is
    empty is left out."""
    data = {"a": {"b": [1, 2.5], "c": None}, "d": [[1, 2], [3]], "e": [{"f": True}, 7], "g": {}}
    assert list(config_scenario._values(data, "x")) == [
        ("x.a.b", "[1, 2.5]"), ("x.d[0]", "[1, 2]"), ("x.d[1]", "[3]"), ("x.e[0].f", "true"), ("x.e[1]", "7"),
        ("x.g", "{}"),
    ]  # fmt: skip
    assert config_scenario._first_words({"p": 1.5, "q": 2}) == "p 1.5"
    assert config_scenario._first_words({"p": [1], "q": 2}) == "p, q"
    assert config_scenario._first_words({}) == " "


@pytest.mark.parametrize("bits", [4000, 4001])
def test_whole_numbers_are_kept_up_to_four_bits_for_each_of_a_thousand_digits(bits: int) -> None:
    number = 2 ** (bits - 1)
    assert plain({"a": [number, -3]}) == {"a": [number if bits == 4000 else "a number of 4001 bits", -3]}


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("scan.rows", "override 'scan.rows': this is not KEY=VALUE."),
        ("=3", "override '=3': this is not KEY=VALUE."),
        ("scan..rows=3", "override 'scan..rows=3': this is not KEY=VALUE."),
        ("scan.rows=[", "override 'scan.rows=['"),
        ("seed.of=3", "override 'seed.of=3': seed is 7, which has no keys. Set it as a whole."),
        (
            "scene.objects.wal.size=3",
            "override 'scene.objects.wal.size=3': scene.objects has no entry called 'wal'.",
        ),
        (
            "scene.objects.5.size=3",
            "override 'scene.objects.5.size=3': scene.objects has 1 entries, counted from 0.",
        ),
    ],
)
def test_an_override_that_leads_nowhere_is_told_as_it_was_written(
    small_scenario: str, override: str, words: str
) -> None:
    document = read_document("seed: 7\nscan: {rows: 3}\nscene: {objects: [{name: wall}]}\n")
    found: list[Fault] = []
    assert put_overrides(document, [override, "scan.columns=4"], found) == {
        ("scan", "columns"): "scan.columns=4"
    }
    (fault,) = found
    assert str(fault).startswith(words)
    assert document.data["scan"] == {"rows": 3, "columns": 4}  # type: ignore[index, call-overload]


def test_an_override_takes_the_place_of_what_it_excludes(scenario: Scenario) -> None:
    """Claim: of a scenario in which all is written out, as of one that leaves it to its instrument."""
    short = {
        "schema": 1,
        "scan": {"rows": 2, "columns": 2, "horizontal": [-0.1, 0.1], "vertical": [-0.1, 0.1]},
    }
    asked = ["scanner.lidar.pulse.energy=0.2 uJ"]
    for one in (
        load_scenario(short, asked),
        scenario_from_text(resolved_yaml(scenario), name="run", overrides=asked),
    ):
        assert (one.scanner.lidar.pulse.energy, one.scanner.lidar.pulse.peak_power) == (2e-7, None)
    with pytest.raises(ScenarioError, match="a peak power or an energy, not both"):
        load_scenario(short, [*asked, "scanner.lidar.pulse.peak_power=5 W"])


@pytest.mark.parametrize(
    ("pulse", "changes", "left"),
    [
        ({"energy": 3, "peak_power": 5}, {"a.energy": 3}, {"energy": 3, "peak_power": None}),
        ({"energy": 3, "peak_power": 5}, {"a.energy": 3, "a.peak_power": 5}, {"energy": 3, "peak_power": 5}),
        ({"energy": None, "peak_power": 5}, {"a.energy": None}, {"energy": None, "peak_power": 5}),
        ({"energy": 3, "peak_power": 5}, {"a.width": 7}, {"energy": 3, "peak_power": 5}),
        (4, {"a.energy": 3}, 4),
    ],
)
def test_a_pulse_has_a_peak_power_or_an_energy(
    pulse: object, changes: dict[str, object], left: object
) -> None:
    """Claim: what a new value excludes is taken out, unless it is asked for too; an empty value excludes nothing."""
    data: dict[str, object] = {"a": pulse}
    make_room(data, changes)  # type: ignore[arg-type]
    assert data == {"a": left}
