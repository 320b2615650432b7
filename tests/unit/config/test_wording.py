"""Words of messages: what came, and what was probably meant."""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path

import pytest
import yaml

from scanner_sim.config import faults, reading, wording
from scanner_sim.config.document import Document, core_schema, read_document, spell, value_at
from scanner_sim.config.outline import locations_of_key, outline, slot_at
from scanner_sim.config.resolved import _section

WORDS = ["far_field", "nearly", "far_away"]

# Chapter 10.3.2 of YAML 1.2, but for leading zeros, which make no other number here: plain text and what it means.
PLAIN = [
    *[(text, None) for text in ("", "~", "null", "Null", "NULL")],
    *[(text, True) for text in ("true", "True", "TRUE")],
    *[(text, False) for text in ("false", "False", "FALSE")],
    *[("-19", -19), ("+019", 19), ("0o17", 15), ("0x1f", 31)],
    *[("-.5e-3", -5e-4), ("+7.25", 7.25), ("3E2", 300.0), ("2.e+1", 20.0), ("-.INF", -float("inf"))],
    *[
        (text, text)
        for text in ("nUll", "tRue", "no", "On", "~x", "0b11", "0o18", "1e", "e5", ".", "+", "1.5.2")
    ],
    *[(text, text) for text in ("12:30:45", "1_0", "0x", ".infinity", "nan", "1 e5", "2001-12-14")],
]


@pytest.mark.parametrize("reader", ["libyaml", "python"])
def test_a_plain_word_is_what_yaml_1_2_says(reader: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: read by either reader, as the value of a key and within brackets alike."""
    if reader == "python":
        monkeypatch.setattr(yaml, "__with_libyaml__", False)
    for text, value in PLAIN:
        for line in (f"a: {text}", f"a: [{text or '~'}, 3]"):
            document = read_document(line)
            found = document.data["a"]  # type: ignore[index, call-overload]
            found = found[0] if isinstance(found, list) else found
            assert not document.faults
            assert (found, type(found)) == (value, type(value)), text


def test_a_text_that_would_be_read_as_something_else_is_written_in_quotes() -> None:
    """Claim: quoted where its plain spelling means another value, and nowhere else; it comes back as it was."""
    for text, value in PLAIN:
        if text:
            (line,) = _section(f'{{"a": "{text}"}}').splitlines()
            assert read_document(line).data == {"a": text}
            # A word that YAML itself cannot take as plain may be quoted as well.
            if text not in ("", "."):
                assert (line[3] in "'\"") is (value != text), line


def test_a_dumper_that_is_taught_keeps_what_others_know() -> None:
    """Claim: what plain words mean is taught to the style that is given, and to no class that it is made of."""

    @core_schema
    class _Taught(yaml.SafeLoader):
        """A loader of its own."""

    assert yaml.load("[on, 1e-9]", Loader=_Taught) == ["on", 1e-9]
    assert yaml.safe_load("[on, 1e-9]") == [True, "1e-9"]


def test_the_line_of_a_value_is_that_of_the_nearest_thing_around_it() -> None:
    document = read_document("seed: 4\nscan:\n  rows: 7\n  lines:\n  - far: 1\n  - far: 2\n    near: 3\n")
    lines = {
        ("seed",): 1,
        ("scan", "rows"): 3,
        ("scan", "lines", 1, "near"): 7,
        ("scan", "lines", 1, "gone", "too"): 6,
        ("scan", "lines", 5): 4,
        ("scan", "columns"): 2,
        ("scene", "objects"): None,
        (): None,
    }
    assert {location: document.line(location) for location in lines} == lines


def test_a_location_is_spelt_with_the_name_of_the_outermost_object() -> None:
    data = {
        "scene": {"objects": [{"name": "wall"}, {"name": "door", "parts": [{"name": "lock"}], "size": 3}]}
    }
    assert spell(("scene", "objects", 1, "parts", 0), data) == "scene.objects[1].parts[0] (object 'door')"
    assert spell(("scene", "objects", 0, "size"), data) == "scene.objects[0].size (object 'wall')"
    assert spell(("scene", "objects", 2, "size"), data) == "scene.objects[2].size"
    assert spell(("scene", "objects", 1)) == "scene.objects[1]"
    assert value_at(data, ("scene", "objects", 1, "parts", 0, "name")) == "lock"
    for nowhere in [
        ("scene", "objects", -1),
        ("scene", "objects", 2),
        ("scene", "objects", "1"),
        ("scene", 0),
    ]:
        assert value_at(data, nowhere) is None


def test_a_document_ends_where_its_limits_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: fifty levels are read and one more is not; as many values as are allowed are read and one more is not."""

    def nested(levels: int) -> Document:
        return read_document("[" * levels + "7" + "]" * levels)

    assert nested(50).readable
    assert not nested(51).readable
    monkeypatch.setattr("scanner_sim.config.document.MOST_VALUES", 6)
    assert read_document("a: [1, 2]\nb: {c: 3}\n").readable
    assert not read_document("a: [1, 2]\nb: {c: 3, d: 4}\n").readable


@pytest.mark.parametrize("letters", [1000, 1001])
def test_a_whole_number_of_a_thousand_letters_is_one(letters: int) -> None:
    text = "7" * letters
    assert read_document(text).data == (int(text) if letters == 1000 else text)


@pytest.mark.parametrize(
    ("came", "meant"),
    [
        ("far_feild", "far_field"),
        ("FAR-FIELD", "far_field"),
        ("Far Away", "far_away"),
        ("nearby", "nearly"),
        ("far", None),
        (5, None),
    ],
)
def test_the_word_that_was_probably_meant_is_suggested(came: object, meant: str | None) -> None:
    """Claim: capitals, hyphens and blanks are no other word; what is like none of them gets no suggestion."""
    assert wording.nearest(came, WORDS) == meant
    all_of_them = "Possible: far_field, nearly, far_away."
    assert wording.choice(came, WORDS) == (f"Did you mean '{meant}'? {all_of_them}" if meant else all_of_them)


def test_likeness_is_twice_the_common_letters_over_all() -> None:
    """Claim: of 0.65 and more a word is suggested: 14 of 20 are enough, 14 of 22 and 12 of 19 are not."""
    assert wording.nearest("abcdefg123", ["abcdefghij"]) is not None
    assert wording.nearest("abcdefg1234567", ["abcdefgh"]) is None
    assert wording.nearest("abcdef123", ["abcdefghij"]) is None
    assert wording.nearest("A-B-C", ["a_b_c"]) == wording.nearest("a b c", ["a_b_c"]) == "a_b_c"


def test_what_came_is_shown_in_short() -> None:
    letters = "abcdefghijklmnopqrstuvwxyz0123456789" * 2
    assert wording.shown(None) == "nothing (an empty value)"
    assert wording.shown({"a": 1}) == "a block of keys"
    assert wording.shown([4, 5, 6]) == "a list of 3"
    assert wording.shown(True) == "true"
    assert wording.shown(1e-9) == "1.0e-09"
    assert wording.shown((1, 2)) == "a tuple"
    assert wording.shown(letters[:60]) == f"'{letters[:60]}'"
    assert wording.shown(letters[:61]) == f"'{letters[:57]}…'"
    assert wording.inline_yaml({"b": [1, "on"], "a": "ß"}) == "{b: [1, 'on'], a: ß}"
    assert [wording.capital(text) for text in ("", "write it", "is it?", "do so.")] == [
        "",
        "Write it.",
        "Is it?",
        "Do so.",
    ]


def test_a_misspelt_preset_is_answered_with_the_shipped_one(tmp_path: Path) -> None:
    from scanner_sim.config.preset import read_preset, shipped_presets
    from scanner_sim.foundation.errors import InputError

    names = shipped_presets()
    for name in names:
        misspelt = name[:-2] + name[-1] if len(name) > 4 else name + "x"
        if misspelt in names:
            continue
        with pytest.raises(InputError, match=re.escape(f"there is no preset '{misspelt}'")) as fault:
            read_preset(misspelt, tmp_path)
        assert fault.value.remedy == (
            f"Did you mean '{name}'? Possible: {', '.join(names)}. Or name a file, as my_scanner.yaml."
        )


def test_a_file_that_cannot_be_read_is_told_by_the_system_s_own_word(tmp_path: Path) -> None:
    """Claim: the sentence has the reason alone, without its number and without the name once more."""
    from scanner_sim.config.reading import text_of
    from scanner_sim.foundation.errors import InputError

    path = tmp_path / ("x" * 300)
    with pytest.raises(InputError) as fault:
        text_of(path)
    assert fault.value.message == f"{path} cannot be read: {os.strerror(errno.ENAMETOOLONG)}."


def test_every_entry_has_an_example_of_its_own_kind() -> None:
    """Claim: an example is never empty; of words to choose from it is one of them, and of numbers with a unit one
    that is read."""
    for place, slot in outline().items():
        if slot.field is not None and slot.field.examples:
            continue
        assert slot.example, place
        if slot.choices and slot.dimension is None:
            assert read_document(slot.example).data in slot.choices, place


def test_a_key_that_belongs_elsewhere_is_told_with_two_places() -> None:
    """Claim: the two shortest of those where it is legal, and what is legal here."""
    places = locations_of_key("rate")
    assert len(places) > 2
    problem, remedy = faults._unknown("rate", slot_at(("scanner", "laser")))
    assert problem == "there is no such key here."
    assert remedy.startswith(f"It belongs to {places[0]} or {places[1]}; known here are power, wavelength,")
    assert places[2] not in remedy


@pytest.mark.parametrize(
    ("place", "key", "kinds", "known"),
    [
        (("scan", "(lissajous)"), "duration", "'track'", "type, pattern,"),
        (("scan", "(fixed)"), "rows", "'raster'", "type, direction,"),
        (("scene", "objects", 0, "(sphere)"), "size", "'box' or 'rectangle'", "name, parent,"),
        (("scene", "objects", 0, "(box)", "motion", "(twist)"), "points", "'waypoints'", "type, velocity,"),
        (("camera", "exposure", "(fixed)"), "target", "'automatic'", "type, time"),
    ],
)
def test_a_key_of_another_kind_is_told_with_that_kind(
    place: tuple[str | int, ...], key: str, kinds: str, known: str
) -> None:
    """Claim: where a thing of another kind has the key in the same place, that kind is named, and not the place."""
    problem, remedy = faults._unknown(key, slot_at(place))
    assert problem == "there is no such key here."
    assert remedy.startswith(f"It belongs to the kind {kinds}; known here are {known}")


def test_a_folder_is_answered_with_the_scenario_in_it(tmp_path: Path) -> None:
    assert reading._scenario_in(tmp_path) == "Name a YAML file."
    for name in ("z.yml", "notes.txt", "b.yaml"):
        (tmp_path / name).touch()
        first = "z.yml" if name != "b.yaml" else "b.yaml"
        assert reading._scenario_in(tmp_path) == f"Did you mean {tmp_path / first}?"
