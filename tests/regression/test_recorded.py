"""What runs give is what was recorded: a change that moves numbers is seen, and recorded anew on purpose."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recorded

from scanner_sim.validation.reproduce import Item, all_items
from scanner_sim.validation.reproduce.family.book import family

pytestmark = [pytest.mark.pinned, pytest.mark.usefixtures("device")]


@pytest.mark.slow
@pytest.mark.parametrize("name", recorded.RUNS)
def test_a_run_gives_what_was_recorded(name: str) -> None:
    """Claim: texts, and numbers but for what another processor makes of them. `make record` records them anew."""
    known = json.loads((recorded.RECORDS / f"{name}.json").read_text(encoding="utf-8"))
    found = json.loads(json.dumps(recorded.made(name)))
    assert list(recorded.differences(known, found)) == []


def test_there_is_a_record_of_each_run_and_of_nothing_else() -> None:
    assert sorted(path.stem for path in recorded.RECORDS.glob("*.json")) == sorted(recorded.RUNS)


@pytest.mark.parametrize(("name", "items"), [("reproduce", all_items()), ("family", family().items)])
def test_each_item_of_a_record_is_made_and_leaves_no_row_empty(name: str, items: tuple[Item, ...]) -> None:
    """Claim: each of the paper and of later instruments was made, those of the paper with a picture; each of its rows
    has something found, which is a number where it should be, and a verdict."""
    record = json.loads((recorded.RECORDS / f"{name}.json").read_text(encoding="utf-8"))
    for item in items:
        told = record[f"result/{item.key}.json"]
        assert told["key"] == item.key
        assert told["drawn"] or name == "family"
        rows = [key.removesuffix(".what") for key in told if key.endswith(".what")]
        assert rows
        for row in rows:
            assert all(told[f"{row}.{column}"] for column in ("what", "found", "verdict")), (item.key, row)
            assert "nan" not in told[f"{row}.found"], (item.key, row)


RECORD: dict[str, Any] = {
    "range.exr": {"range_m": [1600, 9.0, 1.2, 0.1, -0.2], "empty": [0]},
    "summary.json": {
        "name": "plate",
        "error": 0.004,
        "valid": 1200,
        "small": 3,
        "flag": True,
        "list[0]": None,
    },
    "said": {"lines": ["σ of 7.4 mm at 10 m", "12 of 64 targets"]},
}


@pytest.mark.parametrize(
    ("file", "key", "now"),
    [
        ("range.exr", "range_m", [1600, 9.002, 1.2, 0.1, -0.2]),
        ("range.exr", "range_m", [1600, 9.0, 1.203, 0.1, -0.2]),
        ("range.exr", "range_m", [1600, 9.0, 1.2, -0.1, -0.2]),
        ("range.exr", "range_m", [1600, 9.0, 1.2, -0.2, 0.1]),
        ("range.exr", "range_m", [1590, 9.0, 1.2, 0.1, -0.2]),
        ("range.exr", "range_m", [1600, 9.0, 1.2, 0.1]),
        ("range.exr", "empty", [1, 2.0, 0.0]),
        ("summary.json", "name", "board"),
        ("summary.json", "error", 0.0045),
        ("summary.json", "error", -0.004),
        ("summary.json", "valid", 1203),
        ("summary.json", "small", 4),
        ("summary.json", "flag", False),
        ("summary.json", "list[0]", 0.0),
        ("said", "lines", ["σ of 7.4 m at 10 m", "12 of 64 targets"]),
        ("said", "lines", ["σ of 8.3 mm at 10 m", "12 of 64 targets"]),
        ("said", "lines", ["σ of 7.4 mm at 10 m", "13 of 64 targets"]),
        ("said", "lines", ["σ of 7.4 mm at 10 m"]),
    ],
)
def test_what_differs_is_named(file: str, key: str, now: Any) -> None:
    """Claim: a change beyond what a processor makes is told by its file and name, and nothing else is."""
    found = deepcopy(RECORD)
    found[file][key] = now
    [told] = recorded.differences(RECORD, found)
    assert told.startswith(f"/{file}/{key}")


def test_what_a_processor_makes_does_not_differ() -> None:
    """Claim: a thousandth of a spread, two voxels more, some units of the last digit that is printed."""
    found = deepcopy(RECORD)
    found["range.exr"]["range_m"] = [1598, 9.001, 1.2005, 0.1002, -0.2008]
    found["summary.json"] |= {"error": 0.0043, "valid": 1201}
    found["said"]["lines"][0] = "σ of 7.6 mm at 10 m"
    assert list(recorded.differences(RECORD, found)) == []


def test_what_is_new_or_gone_is_told() -> None:
    found = deepcopy(RECORD)
    found["summary.json"]["more"] = found["summary.json"].pop("small")
    assert sorted(recorded.differences(RECORD, found)) == [
        "/summary.json/more: new",
        "/summary.json/small: gone",
    ]


def test_what_a_day_or_a_release_changes_is_not_recorded(tmp_path: Path) -> None:
    (tmp_path / "fact.json").write_text('{"date": "2026-11-27", "version": "0.1.0", "error": 1.5}')
    (tmp_path / "page.md").write_text("# Facts\nMade on 2026-11-27, seed 2000\nread on 2026-11-23\n")
    assert recorded.digest(tmp_path) == {
        "fact.json": {"error": 1.5},
        "page.md": {"lines": ["# Facts", "read on 2026-11-23"]},
    }


def test_a_layer_is_told_by_its_moments() -> None:
    """Claim: number of values, mean, spread, and covariance with the place along each axis, from −1 to 1."""
    rows, columns = np.linspace(-1.0, 1.0, 5)[:, None], np.linspace(-1.0, 1.0, 9)
    values = 7.0 + 2.0 * rows - 3.0 * columns
    count, mean, spread, down, right = recorded.column(values)
    assert count == 45
    np.testing.assert_allclose([mean, spread**2], [7.0, 4.0 * np.mean(rows**2) + 9.0 * np.mean(columns**2)])
    np.testing.assert_allclose([down, right], [2.0 * np.mean(rows**2), -3.0 * np.mean(columns**2)])
    assert recorded.column(np.full(3, np.nan)) == [0]
