"""A disk that is full, or may not hold larger files: one sentence, and what was there before stays."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from scanner_sim.foundation.errors import RunError
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.image import RangeImage
from scanner_sim.products.settings import Output

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="neither tmpfs nor ulimit")


def image(seed: int) -> RangeImage:
    values = np.random.default_rng(seed).normal(10.0, 1.0, (64, 64)).astype(np.float32)
    layers = dict.fromkeys(("range_m", "P.X", "P.Y", "P.Z", "Y", "truth.range_m"), values)
    return RangeImage(
        channels={**layers, "status": np.zeros((64, 64), np.float32)},
        theta=np.linspace(-0.1, 0.1, 64),
        phi=np.linspace(-0.1, 0.1, 64),
        seed=seed,
        scenario_yaml=f"schema: 1\nseed: {seed}\n",
    )


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A real file system of one megabyte."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", place], capture_output=True)
    if mounted.returncode:
        pytest.skip("only root may mount a file system")
    try:
        yield place
    finally:
        subprocess.run(["umount", place], check=True)


def test_on_a_disk_with_any_room_left_the_result_is_the_old_or_the_new_one(disk: Path) -> None:
    """Claim: wherever the disk becomes full, the old result stands; and from enough room on, the new one does."""
    bare, outcomes = Output(pictures=False), []
    out, filler = disk / "out", disk / "filler"
    write_run(image(2), out, bare)
    new = content(out)
    for room in range(0, 400, 24):
        filler.unlink(missing_ok=True)
        write_run(image(1), out, bare, overwrite=True)
        old = content(out)
        left = shutil.disk_usage(disk).free - 1024 * room
        filler.write_bytes(b"\0" * max(left, 0))
        fault = None
        try:
            write_run(image(2), out, bare, overwrite=True)
        except RunError as error:
            fault = error
        assert content(out) == (new if fault is None else old)
        assert fault is None or ("is full; nothing was changed" in str(fault) and "Make room" in str(fault))
        outcomes.append(fault is None)
    assert outcomes == sorted(outcomes)
    assert set(outcomes) == {False, True}


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
sys.argv = ["scanner-sim", *sys.argv[2:]]
from scanner_sim.cli import main
main()
"""


@pytest.mark.slow
def test_a_limit_on_the_size_of_files_is_one_message(small: Path, tmp_path: Path) -> None:
    """Claim: as `ulimit -f` leaves it, which ends a process by a signal unless that is seen to."""
    # Python itself would cut off the bytecode that it keeps of each module.
    command = [sys.executable, "-B", "-c", LIMITED, "2000", "run", str(small), "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert done.returncode == 1, done.stderr
    assert "may not hold files that large; nothing was changed." in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scenarios"]


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_a_full_disk_is_one_message_in_a_verb(small: Path, disk: Path) -> None:
    from scanner_sim.cli import app

    with contextlib.suppress(OSError), (disk / "filler").open("wb", buffering=0) as stream:
        while stream.write(b"\0" * 4096):
            pass
    result = CliRunner().invoke(app, ["run", str(small), "-o", str(disk / "out")])
    assert result.exit_code == 1
    assert "is full" in result.stderr
    assert os.listdir(disk) == ["filler"]
