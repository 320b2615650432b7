"""Tables of results: what each kind of column may hold, how they are spelled, and which files are none of ours."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files import tables
from scanner_sim.products.files.tables import check_columns, read_parquet, texts, write_parquet

KINDS: dict[Any, str] = {
    "any": "numbers",
    "number": "numbers of any sense",
    "finite": "finite numbers",
    "whole": "whole numbers",
    "text": "texts",
}
ALL = {"any", "number", "finite"}


@pytest.mark.parametrize(
    ("values", "fitting"),
    [
        ([1.0, -1e30], ALL), ([1.0, 1e30], ALL), ([1.0, np.nan], {"any", "number"}), ([1.0, 1.0000001e30], {"any"}),
        ([-1.0000001e30, 0.0], {"any"}), ([-np.inf, 1.0], {"any"}), ([np.nan, np.inf], {"any"}), ([], ALL),
        (np.array([1, -2]), {"whole"}), (np.array([1, 2], np.uint8), {"whole"}), (np.array([True]), set()),
        (np.array([1.0], np.float32), set()), (texts(["", "a"]), {"text"}), (texts([]), {"text"}),
        (np.array(["a", None], object), set()), (np.array([1, "a"], object), set()), (np.array(["a"]), set()),
    ],
)  # fmt: skip
def test_columns_are_of_one_kind(values: Any, fitting: set[str]) -> None:
    columns = {"other": np.zeros(2), "a": np.asarray(values)}
    for kind, words in KINDS.items():
        if kind in fitting:
            assert list(check_columns(columns, {"a": kind})) == ["a"]
            assert check_columns(columns, {"a": kind})["a"] is columns["a"]
        else:
            with pytest.raises(ValueError, match=f"^the column a holds something else than {words}$"):
                check_columns(columns, {"a": kind})


def test_columns_that_are_missing_are_told() -> None:
    with pytest.raises(ValueError, match=r"^the column b is missing$"):
        check_columns({"a": np.zeros(1)}, {"a": "any", "b": "any"})


@dataclass(frozen=True)
class Row:
    name: str
    size: float
    count: int


def test_records_are_a_line_each() -> None:
    rows = [Row('a,"b', 1.23456789, 12345678), Row("c", np.nan, 0)]
    assert tables.records_csv(rows) == 'name,size,count\n"a,""b",1.23457,12345678\nc,,0\n'
    assert tables.records_csv([]) == ""


def test_tables_are_spelled_with_twelve_digits() -> None:
    columns = {
        "a": np.array([1.23456789012345, np.nan, 1e-300]),
        "b": np.array([1, -2, 3]),
        "c": texts(["x", "", "y,z"]),
    }
    assert tables.table_csv(columns) == 'a,b,c\n1.23456789012,1,x\n,-2,\n1e-300,3,"y,z"\n'


@pytest.mark.parametrize("given", [{}, {"a": 1}, {"a": "x", "b": 1}, 3])
def test_what_is_said_of_a_table_names_its_first_fault(given: Any) -> None:
    @dataclass(frozen=True)
    class About:
        a: str
        b: int

    expected = {
        "{}": "^a: Field required$", "{'a': 1}": "^a: Input should be a valid string$", "3": "^what is said of it: ",
    }  # fmt: skip
    if str(given) in expected:
        with pytest.raises(ValueError, match=expected[str(given)]):
            tables.read_about(given, About)
    else:
        assert tables.read_about(given, About) == About("x", 1)


@pytest.mark.parametrize(("letters", "fault"), [(1000, ""), (1001, "a text has 1001 bytes")])
def test_texts_are_no_longer_than_any_of_ours(tmp_path: Path, letters: int, fault: str) -> None:
    """Claim: by bytes: an é has two."""
    path = tmp_path / "t.parquet"
    text = "é" + "x" * (letters - 2)
    write_parquet(path, {"a": texts(["", text, text]), "b": np.array([1.0, -np.nan, 3.0])}, {"of": ["é"]})
    assert "é".encode() in path.read_bytes()
    if fault:
        with pytest.raises(InputError, match=f"t.parquet cannot be read as Parquet: {fault}"):
            read_parquet(path)
        return
    columns, about = read_parquet(path)
    assert columns["a"].tolist() == ["", text, text]
    assert columns["b"].view(np.int64).tolist()[1] == np.array([np.nan]).view(np.int64)[0]
    assert about == {"of": ["é"]}


@pytest.mark.parametrize(
    ("columns", "said", "words"),
    [
        ({"a": pyarrow.array([1.0])}, None, "t.parquet was not written by this program"),
        ({"a": pyarrow.array([1.0])}, b"{", "cannot be read as Parquet: "),
        ({"a": pyarrow.array([True])}, b"{}", "no plain numbers and texts, each with a name of its own"),
        ({"a": pyarrow.array([1.0]), "b": pyarrow.array([[1.0]])}, b"{}", "its columns are no plain numbers and texts"),
        ({"a": pyarrow.array(["x"]), "b": pyarrow.array([1], pyarrow.int8())}, b"{}", ""),
        ({"a": pyarrow.array([None, None], pyarrow.string())}, b"{}", ""),
    ],
)  # fmt: skip
def test_files_of_others_are_refused(
    tmp_path: Path, columns: dict[str, Any], said: bytes | None, words: str
) -> None:
    table = pyarrow.table(columns).replace_schema_metadata({tables.ABOUT: said} if said else None)
    pyarrow.parquet.write_table(table, tmp_path / "t.parquet")
    if not words:
        read, about = read_parquet(tmp_path / "t.parquet")
        assert list(read) == list(columns)
        assert about == {}
        return
    with pytest.raises(InputError, match=words) as fault:
        read_parquet(tmp_path / "t.parquet")
    assert bool(fault.value.remedy) is (said is None)


def test_columns_of_one_name_are_refused(tmp_path: Path) -> None:
    table = pyarrow.Table.from_arrays([pyarrow.array([1.0])] * 2, names=["a", "a"])
    pyarrow.parquet.write_table(table.replace_schema_metadata({tables.ABOUT: b"{}"}), tmp_path / "t.parquet")
    with pytest.raises(InputError, match="each with a name of its own"):
        read_parquet(tmp_path / "t.parquet")


@pytest.mark.parametrize(("most", "read"), [(6, True), (5, False)])
def test_cells_of_a_table_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, read: bool
) -> None:
    write_parquet(tmp_path / "t.parquet", {"a": np.zeros(3), "b": np.zeros(3)}, {})
    monkeypatch.setattr(tables, "MOST_CELLS", most)
    if read:
        assert len(read_parquet(tmp_path / "t.parquet")[0]) == 2
    else:
        with pytest.raises(InputError, match="3 rows of 2 columns are too many"):
            read_parquet(tmp_path / "t.parquet")


@pytest.mark.parametrize("name", ["t.parquet", "none.parquet", "no\0name"])
def test_a_folder_is_a_result_by_its_table(tmp_path: Path, name: str) -> None:
    write_parquet(tmp_path / "t.parquet", {"a": np.zeros(1)}, {"of": 1})
    if name == "t.parquet":
        assert tables.read_result(tmp_path, name, "a study")[1] == {"of": 1}
        return
    with pytest.raises(InputError, match=r"^There is no ") as fault:
        tables.read_result(tmp_path, name, "a study")
    assert fault.value.remedy == "Name the folder of a study."
