"""How a command ends: which message and which exit status each exception has."""

from __future__ import annotations

import errno
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from scanner_sim.cli import report
from scanner_sim.foundation.errors import Fault, InputError, RunError, ScenarioError


def ended(error: BaseException) -> int:
    """Return the exit status of an exception."""
    with pytest.raises(typer.Exit) as end:
        report._report(error)
    return end.value.exit_code


def lost(status: int | None) -> BrokenPipeError:
    """Return that the reader has gone, while a command ended with a status, or while it went on."""
    error = BrokenPipeError(errno.EPIPE, "gone")
    error.__context__ = None if status is None else typer.Exit(status)
    return error


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (InputError("a b.", remedy="Do c."), 2, "error: a b.\nDo c.\n"),
        (RunError("a b.", remedy="Do c."), 1, "error: a b.\nDo c.\n"),
        (ScenarioError([Fault("k", "bad.", "Write l.")], source="s.yaml"), 2, None),
        (MemoryError(), 1, "error: the memory is exhausted.\nReduce scan.rows or scan.columns.\n"),
        (OSError(errno.ENOSPC, "no room", "f/g"), 1, "error: f/g: no room.\nMake room on the disk.\n"),
        (OSError(errno.EDQUOT, "no room"), 1, "error: no room.\nMake room on the disk.\n"),
        (OSError(errno.EIO, "broken", "f"), 1, "error: f: broken.\n"),
        (OSError(errno.ENAMETOOLONG, "long", "f"), 2, "error: f: long.\n"),
        (OSError("odd"), 1, "error: odd.\n"),
    ],
    ids=["input", "run", "scenario", "memory", "full", "quota", "disk", "name", "odd"],
)
def test_what_a_user_can_mend_is_one_message(
    capsys: pytest.CaptureFixture[str], error: BaseException, status: int, words: str | None
) -> None:
    """Claim: 2 for what was asked, 1 for what befell the run; what to do stands below where there is something to
    do."""
    assert ended(error) == status
    said = capsys.readouterr()
    assert said.out == ""
    if words is not None:
        assert said.err == words
    else:
        assert "k: bad. Write l." in said.err


@pytest.mark.parametrize("shown", [True, False])
def test_an_unexpected_error_is_shown_where_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], shown: bool
) -> None:
    error = ValueError("odd")
    if shown:
        monkeypatch.setenv(report.DEBUG, "1")
        with pytest.raises(ValueError, match="odd"):
            report._report(error)
        # What a user can mend is told as ever.
        assert ended(MemoryError()) == 1
        return
    monkeypatch.delenv(report.DEBUG, raising=False)
    assert ended(error) == 1
    assert capsys.readouterr().err.startswith(
        "error: unexpected ValueError: odd\nThis is a fault of the program."
    )


@pytest.mark.parametrize("missing", [True, False])
def test_imports_that_fail_are_blamed_on_a_missing_library(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], missing: bool
) -> None:
    fault = InputError("no library.", remedy="Install it.") if missing else None
    monkeypatch.setattr(report, "_missing_library", lambda: fault)
    for error in (ImportError("x"), NameError("y")):
        assert ended(error) == (2 if missing else 1)
        assert capsys.readouterr().err.startswith("error: no library." if missing else "error: unexpected")
    assert ended(ValueError("z")) == 1
    assert "unexpected ValueError" in capsys.readouterr().err


@pytest.mark.parametrize(("status", "expected"), [(None, 0), (0, 0), (2, 2)])
def test_a_reader_that_has_gone_is_told_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], status: int | None, expected: int
) -> None:
    """Claim: the status is that of the command whose message was lost, and else nothing is wrong; both streams fall
    silent. Exits that are none of that stay as they are."""
    silenced: list[Any] = []
    monkeypatch.setattr(report, "_silence", silenced.append)
    assert ended(lost(status)) == expected
    assert len(silenced) == 2
    assert capsys.readouterr().err == ""
    made = SystemExit(1)
    made.__context__ = lost(status)
    assert ended(made) == expected
    for plain in (SystemExit(7), typer.Exit(5)):
        with pytest.raises(type(plain)) as same:
            report._report(plain)
        assert same.value is plain


@pytest.mark.parametrize(("number", "word"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")])
def test_a_signal_ends_a_command_with_its_number(
    capsys: pytest.CaptureFixture[str], number: signal.Signals, word: str
) -> None:
    """Claim: 128 and the signal's number, also where a destructor or a library hid what it raised; handlers are as they
    were before."""

    def asked(hidden: str) -> None:
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt:
            if hidden == "changed":
                raise RuntimeError("of a kernel") from None
            if not hidden:
                raise

    before = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    for hidden in ("", "lost", "changed"):
        with pytest.raises(typer.Exit) as end, report.reported():
            asked(hidden)
        assert end.value.exit_code == 128 + number
        assert capsys.readouterr().err.startswith(f"stopped: {word}; nothing is half-written.\n")
        assert {one: signal.getsignal(one) for one in before} == before
    with pytest.raises(typer.Exit) as end, report.reported():
        raise KeyboardInterrupt
    assert end.value.exit_code == 130


def test_a_scenario_found_wrong_later_has_its_file_s_name() -> None:
    """Claim: the file is named as the user named it, with its folder: files of many folders may be called alike."""
    own = Path("there") / "own.yaml"
    with pytest.raises(ScenarioError, match=r"own\.yaml") as caught, report.scenario_of(own):
        raise ScenarioError([Fault("k", "bad.", "")], source="other")
    assert [fault.location for fault in caught.value.faults] == ["k"]
    assert caught.value.source == str(own)


_CLOSED = """
import os, sys
from scanner_sim.cli.report import open_streams
names, lines = ("stdin", "stdout", "stderr"), []
for which in range(8):
    child = os.fork()
    if child == 0:
        kept = [getattr(sys, name) for name in names]
        for number, name in enumerate(names):
            if which >> number & 1:
                os.close(number)
                setattr(sys, name, None)
        open_streams()
        same = all(which >> n & 1 or getattr(sys, name) is kept[n] for n, name in enumerate(names))
        first = os.open(sys.argv[1], os.O_WRONLY | os.O_APPEND)
        if which & 1:
            assert sys.stdin.read() == ""
        for stream in (sys.stdout, sys.stderr):
            print("said", file=stream, flush=True)
        # Nothing is left behind: the file has the number that follows those of the streams.
        numbers = [getattr(sys, name).fileno() for name in names]
        os.write(first, f"{which} {numbers} {first} {same}\\n".encode())
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0, which
"""


def test_no_file_takes_the_place_of_a_closed_stream(tmp_path: Path) -> None:
    """Claim: whichever of the three streams are closed, each is there again under its own number, the first file that
    is opened has the number it would have had, and a stream that was open is left alone."""
    told = tmp_path / "told"
    told.touch()
    done = subprocess.run(
        [sys.executable, "-c", _CLOSED, told],
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == 0, done.stderr
    assert told.read_text().splitlines() == [f"{which} [0, 1, 2] 3 True" for which in range(8)]
    # Four of the eight had this stream.
    assert (done.stdout, done.stderr) == ("said\n" * 4, "said\n" * 4)
