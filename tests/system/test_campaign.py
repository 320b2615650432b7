"""Campaigns from the command line: the same rows however they are made, and after every death."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from scanner_sim import open_campaign
from scanner_sim.cli import app

PLAN = """\
schema: 1
base: small.yaml
seed: 3
vary:
  - keys: {scanner.laser.power: [5 mW, 15 mW]}
  - keys: {"scene.objects.wall.position[2]": {uniform: [5 m, 9 m]}, processing.threshold: {normal: [6, 0.3]}}
    sample: latin_hypercube
    count: 6
repeat: 2
measure: [sigma_range, rms_range, coverage, valid_share]
"""

HELD = 12
"""Rows after which runs wait while the test says so: no campaign is over before it is killed."""
MEASURE = f"""\
import time
from pathlib import Path

HERE = Path(__file__).parent


def held(image):
    rows = HERE / "killed" / "rows.jsonl"
    while (HERE / "hold").exists() and rows.exists() and rows.read_bytes().count(b"\\n") >= {HELD}:
        time.sleep(0.01)
    return 0.0
"""


@pytest.fixture
def folder(tmp_path: Path, small_scenario: str) -> Path:
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    return tmp_path


def command(*words: object) -> str:
    """Run a verb that succeeds in this process; return what it prints."""
    result = CliRunner().invoke(app, ["campaign", *map(str, words)])
    assert result.exit_code == 0, result.output
    return result.output


def rows(folder: Path) -> str:
    """Return all columns but the time that each run took, to the last bit."""
    table = open_campaign(folder).table()
    return repr({name: values.tolist() for name, values in table.items() if name != "seconds"})


def started(folder: Path, *words: object) -> subprocess.Popen[bytes]:
    code = "import sys; from scanner_sim.cli import main; sys.argv[0] = 'scanner-sim'; main()"
    words = ("campaign", "plan.yaml", "-o", "killed", "--quiet", "--measure", "held_runs:held", *words)
    return subprocess.Popen([sys.executable, "-c", code, *map(str, words)], cwd=folder)


def lines(folder: Path) -> int:
    path = folder / "killed" / "rows.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def wait_for(folder: Path, count: int, process: subprocess.Popen[bytes]) -> None:
    while lines(folder) < count:
        assert process.poll() is None, "it ended by itself"
        time.sleep(0.05)


def workers_of(number: int) -> list[int]:
    """Return the processes that a process has spawned for work."""
    found = []
    for path in Path(f"/proc/{number}/task").glob("*/children"):
        for child in map(int, path.read_text(encoding="ascii").split()):
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(child)
    return found


@pytest.mark.pinned
@pytest.mark.slow
@pytest.mark.usefixtures("device")
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="its workers are found in /proc")
def test_the_rows_are_the_same_on_workers_that_are_killed_and_masters_that_are_killed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: serial, and on two workers of which one and then the master are killed, and then on one: the same rows."""
    pytest.importorskip("distributed", reason="the extra campaign is not installed")
    (folder / "held_runs.py").write_text(MEASURE, encoding="utf-8")
    monkeypatch.chdir(folder)
    command("plan.yaml", "-o", "serial", "--workers", 0, "--quiet", "--measure", "held_runs:held")
    (folder / "hold").touch()
    master = started(folder, "--workers", 2)
    try:
        wait_for(folder, 2, master)
        os.kill(workers_of(master.pid)[0], signal.SIGKILL)
        wait_for(folder, HELD, master)
        orphans = workers_of(master.pid)
    finally:
        master.kill()
        master.wait()
    (folder / "hold").unlink()
    assert lines(folder) < 24
    command("plan.yaml", "-o", "killed", "--workers", 1, "--quiet", "--measure", "held_runs:held")
    assert rows(folder / "killed") == rows(folder / "serial")
    end = time.monotonic() + 60.0
    while left := [number for number in orphans if Path(f"/proc/{number}").exists()]:
        assert time.monotonic() < end, f"workers outlive their master: {left}"
        time.sleep(0.1)


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_a_bad_run_is_a_row_and_every_run_can_be_made_again(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: status, show and rerun tell what happened; a kept run has files, an own function a column."""
    (folder / "my_measures.py").write_text(
        "def nearest(image):\n    return float(image['range_m'][image.valid].min())\n", encoding="utf-8"
    )
    monkeypatch.chdir(folder)
    (folder / "plan.yaml").write_text(
        "schema: 1\nbase: small.yaml\n"
        "vary:\n  - keys: {scanner.rate: [1 kHz, 5 kHz]}\n"
        "  - keys: {ranging: [triangulation, tof], scanner.lidar.pulse.repetition_rate: [2 kHz, 2 kHz]}\n"
        "measure: [sigma_range, valid_share]\nkeep: {runs: [0]}\n",
        encoding="utf-8",
    )
    dry = command("plan.yaml", "-o", "out", "--dry-run")
    assert "4" in dry
    assert "scanner.rate × 2; group_1" not in dry
    assert not (folder / "out").exists()
    done = command("plan.yaml", "-o", "out", "--workers", 0, "--measure", "my_measures:nearest")
    assert "4 of 4 done" in done
    table = open_campaign("out").table()
    assert [bool(fault) for fault in table["fault"]] == [False, False, False, True]
    assert "pulses a second" in table["fault"][3]
    assert np.isnan(table["sigma_range"]).tolist() == [False, False, False, True]
    assert (np.abs(table["nearest"][:3] - 9.0) < 0.1).all()
    assert "pulses a second" in command("status", "out")
    assert "pulses a second" in command("show", "out", "--run", 3)
    assert "5 kHz" in command("show", "out", "--run", 2)
    assert command("show", "out", "--run", 1, "--scenario").startswith("# Scanner Sim scenario")
    assert (folder / "out" / "runs" / "000000" / "range.exr").exists()
    assert "the same numbers" in command("rerun", "out", "--run", 1, "-o", "again")
    assert (folder / "again" / "range.exr").exists()
    assert "report.html" in command("report", "out")
    assert "pulses a second" in (folder / "out" / "report.html").read_text(encoding="utf-8")
    result = CliRunner().invoke(app, ["campaign", "show", "out", "--run", "4"])
    assert (result.exit_code, "there is no run 4" in result.stderr) == (2, True)
    going_on = ["campaign", "plan.yaml", "-o", "out", "--workers", "0"]
    without = CliRunner().invoke(app, going_on)
    assert (without.exit_code, "another list of measures" in without.stderr) == (2, True)


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["plan.yaml", "--measure", "nowhere_to_be_found:f"], "there is no module"),
        (["plan.yaml", "--measure", "math"], "is not MODULE:FUNCTION"),
        (["plan.yaml", "--measure", "math:coverage"], "is a measure of the program"),
        (["plan.yaml", "--measure", "asyncio:run"], "'run' is a column of the campaign already"),
        (["missing.yaml"], "There is no file missing.yaml"),
        (["status", "."], "There is no campaign.json"),
    ],
)
def test_what_cannot_be_used_is_one_message(
    folder: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], fault: str
) -> None:
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(app, ["campaign", *words])
    assert result.exit_code == 2
    assert fault in result.stderr


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_a_track_gives_its_measures(repo_root: Path, tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(
        f"schema: 1\nbase: {repo_root}/configs/track_still.yaml\nset: {{scan.duration: 40 ms}}\nrepeat: 2\n"
        "measure: [lost_tracks, measured_share, rms_target_range, pose_mahalanobis]\n",
        encoding="utf-8",
    )
    command("run", tmp_path / "plan.yaml", "-o", tmp_path / "out", "--workers", 0)
    table = open_campaign(tmp_path / "out").table()
    assert not any(table["fault"])
    assert (table["measured_share"] > 0.0).all()
    assert (table["rms_target_range"] > 0.0).all()
