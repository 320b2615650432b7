"""A process of tests that dies says where."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

DIES = """\
import faulthandler
import resource


def test_passes():
    assert True


def test_dies():
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler._sigsegv()
"""


@pytest.mark.slow
def test_a_run_whose_process_dies_says_where(tmp_path: Path) -> None:
    """Claim: the kind of death and the line stand in the summary, and not what runs every test."""
    (tmp_path / "test_of_death.py").write_text(DIES, encoding="utf-8")
    (tmp_path / "conftest.py").write_bytes((Path(__file__).parents[1] / "conftest.py").read_bytes())
    options = ["-q", "-n", "2", "--max-worker-restart", "0", "-p", "no:cacheprovider"]
    made = subprocess.run(
        [sys.executable, "-m", "pytest", *options, tmp_path],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 1, made.stdout + made.stderr
    _, found, summary = made.stdout.partition("died =")
    assert found, made.stdout
    assert "Segmentation fault" in summary
    assert 'test_of_death.py", line 11 in test_dies' in summary
    assert "xdist/remote.py" not in summary
