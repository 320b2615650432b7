"""Tables of sightings and surveys: what comes back, and every fault at its line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from scanner_sim.calibration import tables
from scanner_sim.calibration.tables import (
    PIXELS,
    SIGMAS,
    WOBBLE,
    SightingTable,
    points_text,
    read_points,
    read_sightings,
    sightings_text,
)
from scanner_sim.foundation.errors import InputError, ScenarioError

HEAD = "station,target,theta_rad,phi_rad,range_m,sigma_theta_rad,sigma_phi_rad,sigma_range_m"
ROW = "s1,near/1,0.1,0.2,3,1e-5,1e-5,1e-4"


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return tmp_path / "table.csv"


def test_sightings_come_back(table: Path) -> None:
    root = np.random.default_rng(3).normal(size=(2, 3, 3)) * [[1e-5], [1e-5], [1e-4]]
    made = SightingTable(
        ("s1", "s2"),
        ("near/1", "near/b"),
        np.array([[0.1, -0.2, 3.0], [0.0, 0.3, 4.5]]),
        root @ np.swapaxes(root, 1, 2),
        np.array([1e-5, 0.0]),
        np.array([300.25, 410.5]),
        np.array([1.25, 1.5]),
        np.array([1e-7, 0.0]),
        np.array([0.25, 1.75]),
    )
    table.write_text(sightings_text(made, "0123456789ab"), encoding="utf-8")
    found = read_sightings(table, "0123456789ab", ("near/1", "near/b"))
    assert (found.station, found.target) == (made.station, made.target)
    np.testing.assert_array_equal(found.position, made.position)
    for name in ("pixels", "image", "image_width", "wobble", "time"):
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name))
    np.testing.assert_allclose(found.covariance, made.covariance, rtol=1e-14)


def test_points_come_back_board_by_board(table: Path) -> None:
    boards = {"a": {"1": (0.0, 0.25, -1e-3), "2": (1.0, 0.0, 0.0)}, "b": {"1": (0.5, 0.5, 0.1)}}
    table.write_text(points_text(boards), encoding="utf-8")
    for name, places in boards.items():
        assert read_points(table, name) == places
    with pytest.raises(InputError, match="no targets of board c"):
        read_points(table, "c")


def test_a_table_ends_at_its_limit(table: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a table of as many lines as may be is read, heading and all, and one of a line more is not."""
    monkeypatch.setattr(tables, "_MOST", 3)
    rows = [HEAD, ROW, ROW.replace("s1", "s2")]
    table.write_text("\n".join(rows) + "\n", encoding="utf-8")
    assert len(read_sightings(table, "0123456789ab", ("near/1",)).station) == 2
    table.write_text("\n".join([*rows, ROW.replace("s1", "s3")]) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="has 4 lines; 3 are read"):
        read_sightings(table, "0123456789ab", ("near/1",))


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([ROW, ROW], "line 3, target: station s1 has seen 'near/1' in line 2 already"),
        (
            [ROW.replace("near", "nera")],
            "line 2, target: there is no target 'nera/1'. Did you mean 'near/1'?",
        ),
        ([ROW.replace("0.1", "x")], "line 2, theta_rad: 'x' is no number"),
        ([ROW.replace("0.1", "nan")], "line 2, theta_rad: nan is not within"),
        ([ROW.replace(",3,", ",-3,")], "line 2, range_m: -3 m is no range"),
        ([ROW.replace("1e-4", "0")], "line 2, sigma_range_m: a standard deviation is above 0"),
        ([ROW.replace("s1", "")], "line 2, station: it is empty"),
        ([ROW + ",1"], "line 2, : it has 9 cells"),
    ],
)
def test_faults_of_rows_have_their_line(table: Path, rows: list[str], words: str) -> None:
    table.write_text("\n".join([HEAD, *rows]), encoding="utf-8")
    with pytest.raises(ScenarioError) as error:
        read_sightings(table, "0123456789ab", ("near/1", "near/2"))
    assert words.replace(", :", ", scenario:") in str(error.value) or words in str(error.value)


@pytest.mark.parametrize(
    ("part", "most", "about"),
    [(PIXELS[0], 1e-4, f"below {SIGMAS[2]}"), (WOBBLE[0], 1e-5, "below 1e-05 rad")],
)
def test_a_part_of_an_error_is_less_than_it(table: Path, part: str, most: float, about: str) -> None:
    """Claim: what unlike pixels make of a range is less than its σ, and wobble less than the smaller σ of the angles;
    as much is refused, and so is less than nothing."""
    beside = {PIXELS[0]: "300,1.5", WOBBLE[0]: "0.1"}[part]
    names = PIXELS if part == PIXELS[0] else WOBBLE
    head, row = f"{HEAD},{','.join(names)}", "s1,near/1,0.1,0.2,3,1e-5,2e-5,1e-4"

    def read(size: float) -> SightingTable:
        table.write_text(f"{head}\n{row},{size!r},{beside}\n", encoding="utf-8")
        return read_sightings(table, "0123456789ab", ("near/1",))

    assert getattr(read(0.999 * most), "pixels" if part == PIXELS[0] else "wobble") == [0.999 * most]
    for wrong in (most, 1.001 * most, -1e-12):
        with pytest.raises(ScenarioError, match=f"line 2, {part}: .*{about}"):
            read(wrong)


def test_a_covariance_that_is_none_is_a_fault(table: Path) -> None:
    head = f"{HEAD},cov_theta_phi_rad2"
    table.write_text(f"{head}\n{ROW},2e-10\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="not positive definite"):
        read_sightings(table, "0123456789ab", ("near/1",))
    table.write_text(f"{head}\n{ROW},5e-11\n", encoding="utf-8")
    assert read_sightings(table, "0123456789ab", ("near/1",)).covariance[0, 0, 1] == 5e-11


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no column station"),
        ("station,target\n", "has no column theta_rad"),
        (HEAD, "holds no sightings"),
        (HEAD + ",station\n" + ROW + ",s2", "a column twice"),
        (
            f"# scanner-sim sightings of instrument ba9876543210\n{HEAD}\n{ROW}",
            "of the instrument ba9876543210",
        ),
    ],
)
def test_a_table_that_is_none_is_refused(table: Path, text: str, words: str) -> None:
    table.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        read_sightings(table, "0123456789ab", ("near/1",))


def test_targets_are_neither_named_nor_placed_twice(table: Path) -> None:
    table.write_text("target,x_m,y_m,z_m\na,0,0,0\na,1,0,0\nb,0,0,0\n", encoding="utf-8")
    with pytest.raises(ScenarioError) as error:
        read_points(table, "near")
    assert "line 3, target: 'a' is there twice" in str(error.value)
    assert "line 4, target: 'b' is where 'a' is" in str(error.value)


def test_what_is_no_place_is_nowhere(table: Path) -> None:
    """Claim: a place that cannot be read is one fault, and no other target stands there."""
    table.write_text("target,x_m,y_m,z_m\na,x,0,0\nb,y,0,0\nc,1,0,0\n", encoding="utf-8")
    with pytest.raises(ScenarioError) as error:
        read_points(table, "near")
    assert [(fault.line, fault.location) for fault in error.value.faults] == [(2, "x_m"), (3, "x_m")]


@pytest.mark.parametrize(("share", "possible"), [(0.43, True), (0.44, False)])
@pytest.mark.parametrize("part", ["pixels", "wobble"])
def test_what_a_sighting_has_for_itself_is_a_covariance(
    table: Path, part: str, share: float, possible: bool
) -> None:
    """Claim: with a correlation ρ of angle and range the part q of σ that pixels or wobble make leaves none from
    (1 − q²) = ρ² on, here 0.9² and 0.436."""
    head = f"{HEAD},cov_theta_range_rad_m,{','.join((*PIXELS, *WOBBLE))}"
    sigma = 1e-4 if part == "pixels" else 1e-5
    parts = {"pixels": f"{share * sigma},300,1.5,,", "wobble": f",,,{share * sigma},0.1"}[part]
    table.write_text(f"{head}\n{ROW},{0.9 * 1e-5 * 1e-4},{parts}\n", encoding="utf-8")
    if possible:
        assert getattr(read_sightings(table, "0123456789ab", ("near/1",)), part) == [share * sigma]
        return
    with pytest.raises(ScenarioError, match=r"line 2, .*: without what unlike pixels and wobble do"):
        read_sightings(table, "0123456789ab", ("near/1",))


def test_parts_of_a_sighting_are_below_its_whole(table: Path) -> None:
    """Claim: what unlike pixels and wobble do is less than σ of the range, and of the better angle; each is given with
    all that goes with it, or not at all; a width is above 0."""
    head = f"{HEAD},{','.join((*PIXELS, *WOBBLE))}"
    row = ROW.replace("1e-5,1e-5,", "2e-5,1e-5,")

    def read(parts: str) -> SightingTable:
        table.write_text(f"{head}\n{row},{parts}\n", encoding="utf-8")
        return read_sightings(table, "0123456789ab", ("near/1",))

    found = read("0.97e-4,300.5,1.25,0.97e-5,4.5")
    parts = (found.pixels, found.image, found.image_width, found.wobble, found.time)
    assert [float(part[0]) for part in parts] == [0.97e-4, 300.5, 1.25, 0.97e-5, 4.5]
    none = read(",,,,")
    assert [float(part[0]) for part in (none.pixels, none.image, none.image_width, none.wobble)] == [
        0,
        0,
        1,
        0,
    ]
    for wrong, words in (
        ("1.03e-4,300.5,1.25,,", "are not from 0 to below sigma_range_m"),
        ("-1e-5,300.5,1.25,,", "are not from 0 to below sigma_range_m"),
        ("1e-5,,1.25,,", f"{PIXELS[1]}: it is missing, and {PIXELS[0]} is given"),
        ("1e-5,300.5,,,", f"{PIXELS[2]}: it is missing, and {PIXELS[0]} is given"),
        ("1e-5,300.5,0,,", f"{PIXELS[2]}: a width is above 0"),
        (",,,1.03e-5,4.5", "are not from 0 to below 1e-05 rad"),
        (",,,1e-6,", f"{WOBBLE[1]}: it is missing, and {WOBBLE[0]} is given"),
    ):
        with pytest.raises(ScenarioError, match=re.escape(words)):
            read(wrong)
