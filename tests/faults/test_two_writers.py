"""Two runs into one folder: one of them is told."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files.contents import RUN
from scanner_sim.products.files.exchange import held, write_file
from scanner_sim.products.files.folder import claim_folder

CLAIMS = """
import sys
from pathlib import Path
from scanner_sim.products.files.folder import claim_folder
from scanner_sim.products.files.contents import RUN
with claim_folder(Path(sys.argv[1]), False, RUN):
    print("mine", flush=True)
    sys.stdin.read()
"""

WRITES = """
import sys
from pathlib import Path
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files.folder import ResultFolder, write_folder
from scanner_sim.products.files.exchange import exchange
kind, who = ResultFolder("mark", ("mark", "other")), sys.argv[2]
writers = {name: lambda path: path.write_text(who) for name in kind.files}
print("ready", flush=True)
sys.stdin.readline()
try:
    write_folder(Path(sys.argv[1]), kind, writers)
except InputError as error:
    print(error)
else:
    print("written")
"""


def begun(code: str, *arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() in ("mine\n", "ready\n")
    return process


def test_a_folder_in_which_a_run_works_is_refused_at_once(small: Path, tmp_path: Path) -> None:
    """Claim: whoever comes second is told before his work, in one sentence, and the first one is not disturbed."""
    out = tmp_path / "out"
    first = begun(CLAIMS, out)
    try:
        result = CliRunner().invoke(app, ["run", str(small), "-o", str(out)])
        assert result.exit_code == 2
        assert "another run is writing to" in result.stderr
        assert "choose another folder" in result.stderr
        with pytest.raises(InputError, match="another run"), claim_folder(out, True, RUN):
            pass
    finally:
        first.communicate("", timeout=60)
    assert first.returncode == 0
    assert not out.exists()


def test_the_lock_of_a_dead_process_is_free(tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = begun(CLAIMS, out)
    os.kill(first.pid, signal.SIGKILL)
    first.communicate(timeout=60)
    with claim_folder(out, False, RUN):
        assert [path.name for path in out.iterdir()] == [".scanner-sim.lock"]
    assert not list(out.iterdir())


def test_of_writers_that_start_together_one_writes_and_the_others_are_told(tmp_path: Path) -> None:
    """Claim: none is lost in silence: whoever says that he has written, what he wrote is there."""
    out = tmp_path / "out"
    writers = {who: begun(WRITES, out, who) for who in "abcd"}
    for process in writers.values():
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    said = {who: process.communicate(timeout=60)[0].strip() for who, process in writers.items()}
    winners = [who for who, words in said.items() if words == "written"]
    assert len(winners) == 1, said
    assert {path.name: path.read_text() for path in out.iterdir()} == dict.fromkeys(
        ("mark", "other"), winners[0]
    )
    for who in said.keys() - winners:
        assert "already holds a result" in said[who] or "another run is writing" in said[who]


def test_single_files_do_not_wait_for_a_run_beside_them(tmp_path: Path) -> None:
    with held(tmp_path):
        write_file(tmp_path / "picture.png", lambda path: path.write_text("drawn") and None)
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]


def test_a_file_that_is_there_stays_unless_told_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "bias.csv"
    path.write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_file(path, lambda to: to.write_text("theirs") and None)
    assert path.read_text() == "mine"
    write_file(path, lambda to: to.write_text("theirs") and None, overwrite=True)
    assert path.read_text() == "theirs"


def test_a_file_in_the_place_of_a_folder_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(InputError, match="cannot be written to"):
        write_file(tmp_path / "taken" / "picture.png", lambda path: path.write_text("drawn") and None)
    assert (tmp_path / "taken").read_text() == "mine"


def test_a_link_in_the_place_of_the_lock_leads_nowhere(tmp_path: Path) -> None:
    """Claim: a folder that was sent cannot have another file of the user's opened, cut or deleted through it."""
    mine, sent = tmp_path / "mine.txt", tmp_path / "sent"
    mine.write_text("mine")
    sent.mkdir()
    (sent / ".picture.png.lock").symlink_to(mine)
    with pytest.raises(InputError, match="cannot be written to"):
        write_file(sent / "picture.png", lambda path: path.write_text("drawn") and None)
    assert mine.read_text() == "mine"
