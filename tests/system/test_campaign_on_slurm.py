"""The recipe of the guide for a cluster with SLURM, run as it stands there.

``sbatch`` and ``scancel`` are small scripts here that start a job's script as a process and end it. This shows that the
recipe, the job's script that dask-jobqueue writes, its workers and the campaign fit together, and that a job that dies
is replaced. It does not show that a real SLURM takes the directives: that was tried by hand, on a cluster of one node.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from scanner_sim import open_campaign
from scanner_sim.cli import app

SBATCH = """\
#!/bin/sh
cp "$1" "$JOBS/$$.sh" || exit 1
setsid sh "$JOBS/$$.sh" > "$JOBS/$$.out" 2>&1 &
echo $! > "$JOBS/$$.pid"
echo "Submitted batch job $$"
"""
SCANCEL = """\
#!/bin/sh
for number; do kill -TERM -- "-$(cat "$JOBS/$number.pid")"; done
"""
PLAN = """\
schema: 1
base: small.yaml
vary: [{keys: {scanner.laser.power: [5 mW, 15 mW]}}]
repeat: 10
measure: [sigma_range, rms_range]
"""
HELD = """\
import time
from pathlib import Path


def held(image):
    while (Path(__file__).parent / "hold").exists():
        time.sleep(0.05)
    return 0.0
"""
SIZES = {"cores=16, processes=16": "cores=1, processes=1", "_jobs=10": "_jobs=2"}


def rows(folder: Path) -> str:
    table = open_campaign(folder).table()
    return repr({name: values.tolist() for name, values in table.items() if name != "seconds"})


def at_work(jobs: Path) -> int:
    """Return how many jobs have had a worker that the scheduler knows."""
    return sum("Registered to" in out.read_text() for out in jobs.glob("*.out"))


def wait_for(campaign: subprocess.Popen[bytes], come: Callable[[], bool]) -> None:
    while not come():
        assert campaign.poll() is None, "it ended by itself"
        time.sleep(0.1)


def recipe(repo_root: Path) -> str:
    """Return the program of the guide, with fewer and smaller jobs and a measure that waits."""
    page = (repo_root / "docs" / "guides" / "campaign.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```text title=\"on_slurm.py\"\n(import subprocess.*?)```", page, re.S)
    for old, new in SIZES.items():
        assert old in text
        text = text.replace(old, new)
    return text.replace('"plan.yaml", ', '"plan.yaml", "--measure", "waiting:held", "--device", "cpu", ')


@pytest.mark.pinned
@pytest.mark.slow
@pytest.mark.usefixtures("device")
@pytest.mark.skipif(sys.platform != "linux", reason="SLURM runs on Linux")
def test_the_recipe_of_the_guide_gives_the_rows_of_one_process(
    tmp_path: Path, small_scenario: str, repo_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the same rows as without a cluster, although a job dies while both are at work; and no job is left."""
    programs, jobs = tmp_path / "bin", tmp_path / "jobs"
    jobs.mkdir()
    programs.mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (programs / name).write_text(text, encoding="utf-8")
        (programs / name).chmod(0o755)
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(PLAN, encoding="utf-8")
    (tmp_path / "waiting.py").write_text(HELD, encoding="utf-8")
    (tmp_path / "on_slurm.py").write_text(recipe(repo_root), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    words = [
        "campaign",
        "plan.yaml",
        "-o",
        "alone",
        "--workers",
        "0",
        "--measure",
        "waiting:held",
        "--device",
        "cpu",
    ]
    assert CliRunner().invoke(app, words).exit_code == 0
    path = f"{programs}{os.pathsep}{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "JOBS": str(jobs)}
    (tmp_path / "hold").touch()
    campaign = subprocess.Popen([sys.executable, "on_slurm.py"], env=environment)
    try:
        wait_for(campaign, lambda: at_work(jobs) == 2)
        os.killpg(int(next(jobs.glob("*.pid")).read_text()), signal.SIGKILL)
        wait_for(campaign, lambda: at_work(jobs) == 3)
        (tmp_path / "hold").unlink()
        assert campaign.wait() == 0
    finally:
        campaign.kill()
        campaign.wait()
        for job in jobs.glob("*.pid"):
            subprocess.run(["kill", "-KILL", "--", f"-{job.read_text().strip()}"], capture_output=True)
    assert rows(tmp_path / "output" / "plan") == rows(tmp_path / "alone")
