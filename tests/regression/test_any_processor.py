"""The same files on processors and with linear algebra of several kinds."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import every_path
import numpy as np
import pytest

RUN = "from scanner_sim.cli import main; main()"


def beyond_baseline() -> str:
    """NumPy's names of what this processor has beyond the least that NumPy needs."""
    extensions = np.show_config(mode="dicts")["SIMD Extensions"]
    return " ".join(extensions.get("found", []))


# Whichever of the two differed in the first would be seen: both at once take one run.
PLAIN = {"NPY_DISABLE_CPU_FEATURES": beyond_baseline(), "OPENBLAS_CORETYPE": "Nehalem"}
"""A plain processor with old linear algebra."""
OTHER = {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "1"}
"""Other linear algebra: asked of a tracking run, whose filters and poses solve systems of equations."""


def digests(folder: Path, config: Path, overrides: list[str], kind: dict[str, str]) -> dict[str, str]:
    """Run a scenario in a process of its own; return the digest of each file of numbers."""
    sets = [word for override in (*overrides, "output.pictures=false") for word in ("--set", override)]
    command = [sys.executable, "-c", RUN, "run", str(config), *sets, "--device", "cpu", "-o", str(folder)]
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("NPY_", "OPENBLAS_"))
    }
    done = subprocess.run(command, env=environment | kind, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("config", "overrides", "kinds"),
    [
        ("track_two_objects.yaml", ["scan.duration=60 ms"], (PLAIN, OTHER)),
        (every_path.CONFIG, [*every_path.CHANGES, "output.waveforms=[[8, 12]]"], (PLAIN,)),
    ],
    ids=["track", "image"],
)
def test_files_do_not_depend_on_the_processor(
    config: str, overrides: list[str], kinds: tuple[dict[str, str], ...], repo_root: Path, tmp_path: Path
) -> None:
    """Claim: every file of numbers has the same bytes whatever code NumPy and its BLAS choose."""
    path = repo_root / "configs" / config
    usual = digests(tmp_path / "usual", path, overrides, {})
    assert len(usual) >= 4
    for number, kind in enumerate(kinds):
        assert digests(tmp_path / str(number), path, overrides, kind) == usual, kind
