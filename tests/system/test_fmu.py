"""A served scanner as a unit of FMI 2.0, stepped by FMPy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from serving import serving
from step_fmu import place

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "docs" / "examples"


@pytest.mark.slow
def test_the_unit_follows_an_object_before_a_chaser(tmp_path: Path) -> None:
    """Claim: FMPy accepts the description, and the unit's pose is that of the object before the chaser, within five of
    its own standard deviations in each of three numbers: once in 10⁶ it would not be, were they normal."""
    fmpy: Any = pytest.importorskip("fmpy", reason="needs FMPy")
    builder: Any = pytest.importorskip("pythonfmu.builder", reason="needs pythonfmu")
    unit = builder.FmuBuilder.build_FMU(
        EXAMPLES / "scanner_fmu.py",
        dest=tmp_path,
        project_files=[EXAMPLES / "client.py", EXAMPLES / "frames.py"],
    )
    config = ROOT / "configs" / "track_moving.yaml"
    more = ("-q", "--set", "scan.duration=5 s", "--set", "output.pictures=false", "-o", str(tmp_path / "out"))
    with serving(config, *more) as (process, address):
        stepped = [sys.executable, str(ROOT / "tests" / "step_fmu.py"), str(unit), address]
        done = subprocess.run(stepped, capture_output=True, text=True, check=False, timeout=300)
        assert done.returncode == 0, done.stderr
        process.terminate()
    said = dict(line.split("=") for line in done.stdout.splitlines() if "=" in line)
    number = {name: float(value) for name, value in said.items()}
    assert fmpy.read_model_description(str(unit), validate=True).fmiVersion == "2.0"
    assert number["status"] == 1.0
    assert number["visits"] > 20
    truth = place(number["time"])
    away = np.array([number[f"pose_{axis}"] - truth[f"object_{axis}"] for axis in "xyz"])
    away[0] += truth["chaser_x"]  # which is not turned
    sigma = np.sqrt([number[f"covariance_{i}_{i}"] for i in (1, 2, 3)])
    assert (np.abs(away) < 5.0 * sigma).all(), (away, sigma)
    assert (sigma < 0.02).all()
