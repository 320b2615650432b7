"""Writing in a process that was forked after another write: no waiting for threads that are not there."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

FORKS = """
import os, signal, sys, warnings
from pathlib import Path
import numpy as np
from scanner_sim.products.files.exr import read_range_image, write_exr
from scanner_sim.products.image import RangeImage
from scanner_sim.products.files.tables import write_parquet
folder = Path(sys.argv[1])
values = np.random.default_rng(0).normal(size=(256, 256)).astype(np.float32)
names = ("range_m", "P.X", "P.Y", "P.Z", "Y", "truth.range_m")
image = RangeImage(
    channels={**dict.fromkeys(names, values), "status": np.zeros((256, 256), np.float32)},
    theta=np.linspace(-0.1, 0.1, 256), phi=np.linspace(-0.1, 0.1, 256), seed=0, scenario_yaml="",
)
def write(name):
    write_exr(folder / f"{name}.exr", image)
    read_range_image(folder / f"{name}.exr")
    write_parquet(folder / f"{name}.parquet", {"x": np.arange(1000.0)}, {})
write("before")
warnings.simplefilter("ignore", DeprecationWarning)  # of a fork while libraries have threads: just that is tested
child = os.fork()
if child == 0:
    signal.alarm(60)  # where it hangs, it does not stay
    write("after")
    os._exit(0)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system does not fork")
def test_an_image_is_written_in_a_process_forked_after_another_one(tmp_path: Path, python: Any) -> None:
    done = python(FORKS, tmp_path, timeout=120.0)
    assert done.returncode == 0, done.stderr
    for kind in ("exr", "parquet"):
        assert (tmp_path / f"before.{kind}").read_bytes() == (tmp_path / f"after.{kind}").read_bytes()
