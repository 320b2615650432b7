"""New files in the place of old ones: what an interrupt or a failing disk at the last step leaves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.products.files import exchange as files


def text(words: str) -> Callable[[Path], None]:
    return lambda path: path.write_text(words) and None


@pytest.mark.parametrize(
    ("error", "raised"),
    [(KeyboardInterrupt(), KeyboardInterrupt), (RunError("the disk is full.", remedy="Free it."), None)],
)
def test_new_files_that_are_whole_are_put_in_their_place_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, raised: type[BaseException] | None
) -> None:
    """Claim: where an interrupt or the disk breaks off their move, it is tried again: all are there, the old are gone,
    nothing hidden is left; an interrupt then goes on its way."""
    (tmp_path / "old").write_text("o")
    plain, tries = files._place, []

    def place(folder: Path, complete: Path) -> None:
        tries.append(complete)
        if len(tries) == 1:
            raise error
        plain(folder, complete)

    monkeypatch.setattr(files, "_place", place)
    writers = {"a": text("1"), "mark": text("2")}
    if raised is None:
        files.exchange(tmp_path, writers, ("old",), mark="mark")
    else:
        with pytest.raises(raised):
            files.exchange(tmp_path, writers, ("old",), mark="mark")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a": "1", "mark": "2"}


def test_a_writer_that_fails_changes_nothing(tmp_path: Path) -> None:
    """Claim: where one of the new files cannot be written all is as before, whatever broke it."""
    (tmp_path / "old").write_text("o")

    def broken(path: Path) -> None:
        path.write_text("half")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        files.exchange(tmp_path, {"a": text("1"), "b": broken}, ("old",))
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"old": "o"}


def test_a_file_of_somebody_else_stays(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("theirs")
    with pytest.raises(InputError):
        files.exchange(tmp_path, {"a": text("1")}, ())
    assert (tmp_path / "a").read_text() == "theirs"
