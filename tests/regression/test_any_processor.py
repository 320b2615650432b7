"""The same files on processors and with linear algebra of several kinds."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import every_path
import numpy as np
import pytest

RUNS = """\
import json, sys
from scanner_sim.cli import main
for words in json.loads(sys.argv[1]):
    sys.argv[1:] = words
    try:
        main()
    except SystemExit as end:
        assert not end.code, words
"""
TRACK = "track_two_objects.yaml", ["scan.duration=60 ms"]
IMAGE = (
    every_path.CONFIG,
    [*every_path.CHANGES, "scan.rows=8", "scan.columns=12", "output.waveforms=[[4, 6]]"],
)


def beyond_baseline() -> str:
    """NumPy's names of what this processor has beyond the least that NumPy needs."""
    extensions = np.show_config(mode="dicts")["SIMD Extensions"]
    return " ".join(extensions.get("found", []))


# Whichever of the two differed in the first would be seen: both at once take one process.
PLAIN = {"NPY_DISABLE_CPU_FEATURES": beyond_baseline(), "OPENBLAS_CORETYPE": "Nehalem"}
"""A plain processor with old linear algebra."""
OTHER = {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "1"}
"""Other linear algebra: asked of a tracking run, whose filters and poses solve systems of equations."""


def digests(folder: Path, kind: dict[str, str], *runs: tuple[str, list[str]]) -> dict[str, str]:
    """Run scenarios in a process of its own; return the digest of each file of numbers."""
    root = Path(__file__).resolve().parents[2]
    commands = [
        ["run", str(root / "configs" / config), "--device", "cpu", "-o", str(folder / config)]
        + [word for override in (*overrides, "output.pictures=false") for word in ("--set", override)]
        for config, overrides in runs
    ]
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("NPY_", "OPENBLAS_"))
    }
    command = [sys.executable, "-c", RUNS, json.dumps(commands)]
    done = subprocess.run(command, env=environment | kind, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.glob("*/*"))
    }


@pytest.mark.slow
def test_files_do_not_depend_on_the_processor(tmp_path: Path) -> None:
    """Claim: every file of numbers, of a track and an image, has the same bytes whatever code NumPy and its BLAS
    choose."""
    usual = digests(tmp_path / "usual", {}, TRACK, IMAGE)
    assert len(usual) >= 8
    assert digests(tmp_path / "plain", PLAIN, TRACK, IMAGE) == usual
    told = {name: digest for name, digest in usual.items() if name.startswith(TRACK[0])}
    assert digests(tmp_path / "other", OTHER, TRACK) == told
