"""An output that is closed, full, or left by its reader: a clean end with a sensible status."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from scanner_sim.products.files.exr import read_range_image

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a POSIX shell is needed")
FULL = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")


def shell(line: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a line of the shell in which ``scanner-sim`` is the program."""
    program = f'scanner_sim() {{ "{sys.executable}" -m scanner_sim "$@"; }}; {line}'
    command = ["bash", "-c", program, "bash", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=240)


@pytest.mark.parametrize(
    ("line", "status", "words"),
    [
        pytest.param("scanner_sim schema >&-", 0, "", marks=pytest.mark.slow),
        pytest.param("scanner_sim schema >&- 2>&-", 0, "", marks=pytest.mark.slow),
        pytest.param(
            "scanner_sim schema | head -1 >/dev/null; exit ${PIPESTATUS[0]}", 0, "", marks=pytest.mark.slow
        ),
        ("scanner_sim --help | true; exit ${PIPESTATUS[0]}", 0, ""),
        ("scanner_sim run --help | true; exit ${PIPESTATUS[0]}", 0, ""),
        ("scanner_sim --version | true; exit ${PIPESTATUS[0]}", 0, ""),
        ("scanner_sim | true; exit ${PIPESTATUS[0]}", 0, ""),
        ("scanner_sim nonsense 2>&1 | true; exit ${PIPESTATUS[0]}", 2, ""),
        pytest.param("scanner_sim nonsense 2>/dev/full", 2, "", marks=FULL),
        pytest.param(
            "scanner_sim schema >/dev/full",
            1,
            "error: No space left on device.\nMake room on the disk.\n",
            marks=[FULL, pytest.mark.slow],
        ),
        pytest.param("scanner_sim schema >/dev/full 2>/dev/full", 1, "", marks=[FULL, pytest.mark.slow]),
    ],
)
def test_the_end_is_clean(line: str, status: int, words: str) -> None:
    done = shell(line)
    assert (done.returncode, done.stderr) == (status, words)


@pytest.mark.slow
def test_closed_streams_do_not_run_into_the_files_of_a_result(small: Path, tmp_path: Path) -> None:
    """Claim: no file of the result takes the place of a closed stream, into which libraries would write."""
    done = shell('scanner_sim run "$1" -o "$2" <&- >&- 2>&-', small, tmp_path / "out")
    assert done.returncode == 0
    assert read_range_image(tmp_path / "out" / "range.exr").shape == (6, 8)


@FULL
@pytest.mark.slow
def test_a_result_is_written_even_if_nothing_can_be_said_of_it(small: Path, tmp_path: Path) -> None:
    done = shell('scanner_sim run "$1" -o "$2" >/dev/full', small, tmp_path / "out")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert read_range_image(tmp_path / "out" / "range.exr").shape == (6, 8)
