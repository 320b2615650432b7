"""The folder of a campaign: nothing lost, nothing counted twice, nothing mixed."""

from __future__ import annotations

import contextlib
import errno
import json
import math
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import duckdb
import numpy as np
import pytest

from scanner_sim.campaign import serial
from scanner_sim.campaign import store as store_module
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.result import open_campaign
from scanner_sim.campaign.runs import Campaign
from scanner_sim.campaign.store import PARTS, ROWS, Row, Store, opened, reopened
from scanner_sim.campaign.work import Settings
from scanner_sim.foundation.errors import InputError, RunError

MEASURES = ("sigma_range", "valid_share")


@pytest.fixture
def campaign(tmp_path: Path, small_scenario: str) -> Campaign:
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    plan = "schema: 1\nbase: small.yaml\nvary: [{keys: {scanner.laser.power: [5 mW, 15 mW]}}]\nrepeat: 10\n"
    (tmp_path / "plan.yaml").write_text(plan, encoding="utf-8")
    return read_campaign(tmp_path / "plan.yaml")


def row(campaign: Campaign, run: int, fault: str = "") -> Row:
    measures = (
        {} if fault else {"sigma_range": 0.1 / (run + 3.0), "valid_share": math.nan if run == 4 else 1.0}
    )
    return Row(run, campaign.seed(run), fault, 0.5, measures)


def content(folder: Path) -> dict[str, list[object]]:
    return {name: values.astype(object).tolist() for name, values in open_campaign(folder).table().items()}


def same(one: dict[str, list[object]], other: dict[str, list[object]]) -> bool:
    return repr(one) == repr(other)


def test_rows_come_back_in_order_with_every_bit(
    campaign: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the same table comes of rows in any order, through text, through Parquet, or some of each."""
    monkeypatch.setattr(store_module, "PART_ROWS", 7)
    found = []
    for name, order in (("a", range(20)), ("b", reversed(range(20)))):
        with opened(tmp_path / name, campaign, MEASURES) as store:
            for run in order:
                store.add(row(campaign, run, "it broke." if run == 2 else ""))
        assert len(list((tmp_path / name / PARTS).iterdir())) == 2
        found.append(content(tmp_path / name))
    assert same(*found)
    assert found[0]["run"] == list(range(20))
    assert found[0]["scanner.laser.power"] == [0.005] * 10 + [0.015] * 10
    assert found[0]["sigma_range"][5] == 0.1 / 8.0
    assert found[0]["fault"][2] == "it broke."
    result = open_campaign(tmp_path / "a")
    array = result.to_xarray()
    assert array["sigma_range"].dims == ("scanner.laser.power", "repeat")
    assert float(array["sigma_range"].sel({"scanner.laser.power": 0.015}).isel(repeat=3)) == 0.1 / 16.0
    assert array["scanner.laser.power"].attrs["units"] == "W"
    assert np.isnan(array["valid_share"].values[0, [2, 4]]).all()
    frame = result.to_pandas()
    assert frame.loc[7, "sigma_range"] == 0.01
    assert "1 failed" in repr(result)
    assert "<table>" in result._repr_html_()


def test_other_programs_read_the_parts(campaign: Campaign, tmp_path: Path) -> None:
    """Claim: DuckDB sees the rows of all parts with their names, types, gaps and faults."""
    with opened(tmp_path / "out", campaign, MEASURES) as store:
        for run in range(20):
            store.add(row(campaign, run, "it broke." if run == 2 else ""))
            if run == 12:
                store.pack()
        store.pack()
    found = duckdb.sql(
        'SELECT "scanner.laser.power", count(*), sum(run), max(fault), max(sigma_range), typeof(any_value(seed)) '
        f"FROM '{tmp_path}/out/parts/*.parquet' WHERE isnan(valid_share) = FALSE OR fault <> '' GROUP BY 1 ORDER BY 1"
    ).fetchall()
    assert found[0][:4] == (0.005, 9, 41, "it broke."), "run 4 has no share"
    assert found[1] == (0.015, 10, 145, "", 0.1 / 13.0, "BIGINT")


def test_a_torn_line_is_no_row_and_the_next_one_takes_its_place(campaign: Campaign, tmp_path: Path) -> None:
    """Claim: whatever length of the last line is on the disk, the rows before count, and the run is done again."""
    folder = tmp_path / "out"
    with opened(folder, campaign, MEASURES) as store:
        for run in range(3):
            store.add(row(campaign, run))
    whole = (folder / ROWS).read_bytes()
    last = whole.rstrip(b"\n").rfind(b"\n") + 1
    for end in (last, last + 1, last + 30, len(whole) - 1):
        (folder / ROWS).write_bytes(whole[:end])
        with opened(folder, campaign, MEASURES) as store:
            assert np.flatnonzero(store.done).tolist() == [0, 1]
            store.add(row(campaign, 2))
        assert (folder / ROWS).read_bytes() == whole


def test_rows_of_runs_that_the_campaign_has_not_are_left_out(campaign: Campaign, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    with opened(folder, campaign, MEASURES) as store:
        store.add(row(campaign, 1))
        runs = len(store.done)
    line = (folder / ROWS).read_bytes()
    beyond = [json.dumps({**json.loads(line), "run": number}).encode() + b"\n" for number in (-1, runs)]
    (folder / ROWS).write_bytes(line + b"".join(beyond))
    with opened(folder, campaign, MEASURES) as store:
        assert np.flatnonzero(store.done).tolist() == [1]


def test_a_death_between_part_and_rows_counts_nothing_twice(campaign: Campaign, tmp_path: Path) -> None:
    """Claim: rows that stand in a part and, because the program died then, still in the file of rows, are one each."""
    folder = tmp_path / "out"
    with opened(folder, campaign, MEASURES) as store:
        for run in range(3):
            store.add(row(campaign, run))
        lines = (folder / ROWS).read_bytes()
        store.pack()
    (folder / ROWS).write_bytes(lines)
    (folder / PARTS / "part-000001.partial").write_bytes(b"PAR1")
    with opened(folder, campaign, MEASURES) as store:
        assert int(store.done.sum()) == 3
        store.add(row(campaign, 3))
        store.add(row(campaign, 3))
        store.pack()
    assert content(folder)["run"] == [0, 1, 2, 3]
    assert len(list((folder / PARTS).glob("*.parquet"))) == 2


def test_a_campaign_goes_on_with_the_runs_that_have_no_row(
    campaign: Campaign, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: whichever were done before, in whatever order, each of the others is made once, and the rows of all are in
    parts; progress ends with as many as there are, and those that failed."""
    made: list[int] = []
    monkeypatch.setattr(
        serial, "work", lambda task: [row(campaign, job.run, made.append(job.run) or "") for job in task.jobs]
    )
    told: list[tuple[int, int, int]] = []
    with opened(tmp_path / "out", campaign, MEASURES) as store:
        for run in (17, 3, 0, 9):
            store.add(row(campaign, run, "it broke." if run == 9 else ""))
    with opened(tmp_path / "out", campaign, MEASURES) as store:
        serial.run_serially(store, Settings(tmp_path / "out"), lambda *counts: told.append(counts))
    assert sorted(made) == [run for run in range(20) if run not in {0, 3, 9, 17}]
    assert told[-1] == (20, 20, 1)
    assert (tmp_path / "out" / ROWS).read_bytes() == b""
    assert content(tmp_path / "out")["run"] == list(range(20))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("repeat: 10", "repeat: 11", "another plan"),
        ("15 mW", "16 mW", "another plan"),
        ("schema: 1", "schema: 1\nset: {scan.rows: 3}", "another base scenario"),
    ],
)
def test_rows_of_two_campaigns_are_not_mixed(
    campaign: Campaign, tmp_path: Path, old: str, new: str, words: str
) -> None:
    with opened(tmp_path / "out", campaign, MEASURES):
        pass
    text = (tmp_path / "plan.yaml").read_text(encoding="utf-8")
    (tmp_path / "other.yaml").write_text(text.replace(old, new), encoding="utf-8")
    other = read_campaign(tmp_path / "other.yaml")
    with pytest.raises(InputError, match=words), opened(tmp_path / "out", other, MEASURES):
        pass
    with (
        pytest.raises(InputError, match="list of measures"),
        opened(tmp_path / "out", campaign, MEASURES[:1]),
    ):
        pass
    with opened(tmp_path / "out", read_campaign(tmp_path / "plan.yaml"), MEASURES):
        pass


def test_a_folder_of_something_else_is_left_alone(campaign: Campaign, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("x", encoding="utf-8")
    with pytest.raises(InputError, match="holds other files"), opened(tmp_path / "out", campaign, MEASURES):
        pass
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["thesis.tex"]
    with pytest.raises(InputError, match="There is no campaign"):
        open_campaign(tmp_path / "out")


def test_two_masters_do_not_write_at_once(campaign: Campaign, tmp_path: Path) -> None:
    with opened(tmp_path / "out", campaign, MEASURES):
        code = (
            "import sys; from pathlib import Path; from scanner_sim.products.files.exchange import held, BusyError\n"
            "try:\n    with held(Path(sys.argv[1])): print('free')\nexcept BusyError: print('busy')"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, tmp_path / "out"], capture_output=True, text=True, check=True
        )
    assert done.stdout.strip() == "busy"


@pytest.mark.parametrize(
    "break_it",
    [
        lambda said: said.pop("plan"),
        lambda said: said.update(measures=7),
        lambda said: said["plan"].update(vary=[{"keys": {}}]),
    ],
)
def test_a_damaged_manifest_is_one_message(
    campaign: Campaign, tmp_path: Path, break_it: Callable[[dict], object]
) -> None:
    with opened(tmp_path / "out", campaign, MEASURES):
        pass
    path = tmp_path / "out" / "campaign.json"
    said = json.loads(path.read_text(encoding="utf-8"))
    break_it(said)
    path.write_text(json.dumps(said), encoding="utf-8")
    with pytest.raises(InputError) as fault:
        reopened(tmp_path / "out")
    # What is wrong, in one line.
    assert re.fullmatch(re.escape(f"{path} is damaged: ") + r"\S.*\.", fault.value.message)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    place = tmp_path / "disk"
    place.mkdir()
    if subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", place], capture_output=True
    ).returncode:
        pytest.skip("only root may mount a file system")
    try:
        yield place
    finally:
        subprocess.run(["umount", place], check=True)


def fill(store: Store, campaign: Campaign) -> int:
    """Add rows until the disk is full; return how many there are then."""
    for run in range(1, 20):
        try:
            store.add(row(campaign, run, "x" * 800))
        except RunError as error:
            if "is full; every row before stays" in str(error):
                return run
    raise AssertionError("the disk was not full")


def test_a_full_disk_stops_cleanly_and_the_same_campaign_goes_on(campaign: Campaign, disk: Path) -> None:
    """Claim: rows that were told to be written are there after the disk was full, the next is not, and with room the
    campaign goes on to the same table."""
    folder, filler = disk / "out", disk / "filler"
    with opened(folder, campaign, MEASURES) as store:
        store.add(row(campaign, 0))
    with opened(folder, campaign, MEASURES) as store:
        with contextlib.suppress(OSError), filler.open("wb", buffering=0) as stream:
            while stream.write(b"\0" * 512):
                pass
        written = fill(store, campaign)
    assert 0 < written < 20
    assert int(reopened(folder).done.sum()) == written
    filler.unlink()
    with opened(folder, campaign, MEASURES) as store:
        for run in range(20):
            store.add(row(campaign, run, "x" * 800 if run else ""))
        store.pack()
    assert content(folder)["run"] == list(range(20))


@pytest.mark.parametrize(
    ("values", "unit", "column"),
    [
        ([1.5, 2], None, [1.5, 2.0]),
        ([3, "20 mW", 0.5], "W", [3.0, 0.02, 0.5]),
        (["20 mW", "none"], None, ["20 mW", "none"]),
        ([True, False], None, ["true", "false"]),
        ([True, 2.0], None, ["true", "2.0"]),
        ([[1.0, 2.0], 3.0], None, ["[1.0, 2.0]", "3.0"]),
        ([[1.0, 2.0], [2.0, 3.0]], "m", ["[1.0, 2.0]", "[2.0, 3.0]"]),
    ],
)
def test_a_column_is_of_numbers_where_all_of_its_values_are(
    monkeypatch: pytest.MonkeyPatch, values: list[Any], unit: str | None, column: list[Any]
) -> None:
    """Claim: in SI units, which the column has; else all of its values are texts as a file spells them, without a unit.
    What a distribution draws is a number."""
    parts = {"20 mW": 0.02}
    dimension = None if unit is None else SimpleNamespace(unit=unit, parse=parts.__getitem__)
    monkeypatch.setattr(store_module, "dimension_of", lambda base, key: dimension)
    keys = {"k": SimpleNamespace(list=values), "drawn": SimpleNamespace(list=None)}
    told: Any = SimpleNamespace(base="base", plan=SimpleNamespace(vary=[SimpleNamespace(keys=keys)]))
    found = store_module.column_of(told, "k", values)
    assert found.astype(object).tolist() == column
    assert store_module.column_of(told, "drawn", [0.25, 7]).tolist() == [0.25, 7.0]
    units = store_module.units_of(told, ("sigma_range", "own"))
    known = {"k": unit, "drawn": unit} if unit else {}
    if isinstance(column[0], str):
        known.pop("k", None)
    assert units == {"seconds": "s", "sigma_range": "m"} | known


@pytest.mark.parametrize(
    ("code", "words", "remedy"),
    [
        (errno.ENOSPC, "is full; every row before stays.", "Make room; the same command goes on."),
        (errno.EDQUOT, "is full; every row before stays.", "Make room; the same command goes on."),
        (errno.EFBIG, "may not hold files that large", "Raise the limit"),
        (errno.EIO, "could not be written: of a kind", ""),
    ],
)
def test_a_disk_that_fails_while_rows_come_is_told(
    tmp_path: Path, code: int, words: str, remedy: str
) -> None:
    fault = store_module.disk_fault(tmp_path, OSError(code, "of a kind"))
    assert isinstance(fault, RunError)
    assert str(tmp_path) in fault.message
    assert words in fault.message
    assert remedy in (fault.remedy or "")


def test_a_campaign_tells_what_is_left_and_medians_of_what_there_is(
    campaign: Campaign, tmp_path: Path
) -> None:
    """Claim: of twenty runs five are done, one of which failed; a measure that one run lacks has its median still."""
    with opened(tmp_path / "out", campaign, MEASURES) as store:
        for run in (0, 1, 2, 4):
            store.add(row(campaign, run))
        store.add(row(campaign, 7, "it fell."))
    found = open_campaign(tmp_path / "out")
    assert repr(found) == f"Campaign of 20 runs in {tmp_path / 'out'}: 15 left, 1 failed"
    array = found.to_xarray()
    assert (array.attrs["runs"], array.attrs["done"]) == (20, 5)
    done = {0, 1, 2, 4, 7}
    assert array["seed"].values.ravel().tolist() == [campaign.seed(n) if n in done else -1 for n in range(20)]
    assert array["fault"].values.ravel().tolist() == ["it fell." if n == 7 else "" for n in range(20)]
    assert np.isnan(array["seconds"].values.ravel()).tolist() == [n not in done for n in range(20)]
    page = found._repr_html_()
    for name, words in (
        ("sigma_range", f"{np.median(0.1 / (np.array([0, 1, 2, 4]) + 3.0)):.4g} m"),
        ("valid_share", "1"),
    ):
        assert f">{name}<" in page
        assert f">{words}<" in page


@pytest.mark.parametrize(
    ("key", "values", "column", "unit"),
    [
        ("focus_distance", ["infinity", "8 m"], ["infinity", "8 m"], None),
        ("array_tilt", ["ideal", "scheimpflug"], ["ideal", "scheimpflug"], None),
        ("array_tilt", ["10 deg", "45 deg"], [math.radians(10.0), math.pi / 4.0], "rad"),
    ],
)
def test_words_in_the_place_of_quantities_are_texts(
    tmp_path: Path, small_scenario: str, key: str, values: list[str], column: list[object], unit: str | None
) -> None:
    """Claim: a key that takes a length or an angle, or a word instead, is a column of texts where any value is one."""
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    plan = f"schema: 1\nbase: small.yaml\nvary: [{{keys: {{scanner.receiver.{key}: {values}}}}}]\n"
    (tmp_path / "plan.yaml").write_text(plan, encoding="utf-8")
    campaign = read_campaign(tmp_path / "plan.yaml")
    with opened(tmp_path / "out", campaign, MEASURES) as store:
        for run in range(2):
            store.add(row(campaign, run))
    assert content(tmp_path / "out")[f"scanner.receiver.{key}"] == column
    found = open_campaign(tmp_path / "out").to_xarray()[f"scanner.receiver.{key}"]
    assert found.attrs.get("units") == unit


def test_seeds_that_vary_are_a_coordinate(tmp_path: Path, small_scenario: str) -> None:
    """Claim: a plan may vary the seed itself: its axis has the values, and each row its own."""
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    plan = "schema: 1\nbase: small.yaml\nvary: [{keys: {seed: [3, 4]}}]\nrepeat: 2\n"
    (tmp_path / "plan.yaml").write_text(plan, encoding="utf-8")
    campaign = read_campaign(tmp_path / "plan.yaml")
    with opened(tmp_path / "out", campaign, MEASURES) as store:
        for run, seed in enumerate((3, 3, 4, 4)):
            store.add(Row(run, seed, "", 0.5, {"sigma_range": 0.1 * run}))
    array = open_campaign(tmp_path / "out").to_xarray()
    assert array["seed"].values.tolist() == [3.0, 4.0]
    assert array["sigma_range"].sel(seed=4).values.tolist() == [0.2, pytest.approx(0.3)]
    assert content(tmp_path / "out")["seed"] == [3, 3, 4, 4]


@pytest.mark.parametrize("damage", [b"", b'{"schema": 1, "pl', b"7", b"\xff{}"])
def test_a_damaged_manifest_is_told_to_who_goes_on(campaign: Campaign, tmp_path: Path, damage: bytes) -> None:
    """Claim: as to who looks at the campaign: the file is named, and the folder stays as it is."""
    with opened(tmp_path / "out", campaign, MEASURES) as store:
        store.add(row(campaign, 1))
    (tmp_path / "out" / "campaign.json").write_bytes(damage)
    for look in (lambda: reopened(tmp_path / "out"), opened(tmp_path / "out", campaign, MEASURES).__enter__):
        with pytest.raises(InputError, match=r"campaign\.json is damaged"):
            look()
    assert (tmp_path / "out" / "campaign.json").read_bytes() == damage
