"""New files in the place of old ones: what an interrupt or a failing disk at the last step leaves."""

from __future__ import annotations

import errno
import os
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


@pytest.mark.parametrize(
    ("code", "kind", "words"),
    [
        (errno.ENOSPC, RunError, "The disk that holds {folder} is full; nothing was changed."),
        (errno.EDQUOT, RunError, "The disk that holds {folder} is full; nothing was changed."),
        (errno.EFBIG, RunError, "{folder} may not hold files that large; nothing was changed."),
        (errno.EIO, RunError, "{folder} could not be written: {reason}; nothing was changed."),
        (errno.EACCES, InputError, "{folder} cannot be written to: {reason}."),
        (errno.EROFS, InputError, "{folder} cannot be written to: {reason}."),
    ],
)
def test_what_a_disk_refuses_is_told_by_what_it_is(
    tmp_path: Path, code: int, kind: type[Exception], words: str
) -> None:
    """Claim: a disk that is full or broken is the run's fault, a folder that takes nothing the user's; the sentence
    names the folder, the system's reason where it is the reason, and what is left is what was there."""
    (tmp_path / "a").write_text("old")

    def refused(path: Path) -> None:
        raise OSError(code, os.strerror(code), str(path))

    with pytest.raises(kind) as fault:
        files.write_files(tmp_path, {"a": text("new"), "b": refused}, overwrite=True)
    told = words.format(folder=tmp_path, reason=os.strerror(code))
    assert fault.value.message == told  # type: ignore[attr-defined]
    assert {path.name: path.read_text() for path in tmp_path.iterdir() if path.name[0] != "."} == {"a": "old"}
    whole = OSError(code, os.strerror(code))
    assert isinstance(files.unwritable(tmp_path, whole), RunError) is (
        code in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    )


def test_a_fault_without_a_number_is_told_in_its_own_words(tmp_path: Path) -> None:
    """Claim: as libraries raise them: the sentence is theirs, and what was there stays."""
    (tmp_path / "a").write_text("old")

    def failing(path: Path) -> None:
        raise OSError("encoder error -2 when writing image file")

    with pytest.raises(RunError) as fault:
        files.write_files(tmp_path, {"a": text("new"), "b": failing}, overwrite=True)
    told = "could not be written: encoder error -2 when writing image file; nothing was changed."
    assert fault.value.message == f"{tmp_path} {told}"
    assert (tmp_path / "a").read_text() == "old"


def test_a_file_is_told_from_another_by_its_size_and_its_time(tmp_path: Path) -> None:
    path = tmp_path / "a"
    found = []
    for words, moment in (("one", 10**18), ("two", 10**18 + 1), ("three", 10**18), ("six", 10**18)):
        path.write_text(words)
        os.utime(path, ns=(moment, moment))
        found.append(files._identity(path))
    assert found[0] == found[3]
    assert found[0] not in found[1:3]
    assert found[1] != found[2]
