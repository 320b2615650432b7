"""Killed at any moment, a run loses nothing: `dying.py` says what that means, step by step."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="it forks")
def test_a_death_at_any_touch_of_the_disk_loses_nothing(tmp_path: Path) -> None:
    """Claim: after SIGKILL before every open, fsync, rename, unlink, mkdir and rmdir, and within writes, of a new
    result, of one that replaces another and of a pair of files, and at each of these again while the next start mends
    it, the folder holds the old files or the new ones, never some of each, and what is the user's stays."""
    driver = Path(__file__).with_name("dying.py")
    done = subprocess.run([sys.executable, driver, tmp_path], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[0]) > 1000
