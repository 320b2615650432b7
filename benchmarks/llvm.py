"""Which LLVM libraries compile the simulator's kernels: runs shipped scenarios on each library that is named.

    python benchmarks/llvm.py /path/to/libLLVM-16.so.1 /path/to/libLLVM.so.19.1

Each library runs in a process of its own, since an old one aborts it, and with an empty kernel cache. The oldest
major version that works is ``OLDEST_LLVM`` in ``scanner_sim/render/libraries.py``.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

CONFIGS = Path(__file__).parents[1] / "configs"
SMALL = ("scan.rows=8", "scan.columns=8")
RUNS = {
    "triangulation": ("quickstart.yaml", *SMALL),
    "both rangings": ("tof_both.yaml", *SMALL, "output.waveforms=none"),
    "sunlight": ("lighting_normal.yaml", *SMALL),
    "tracking": ("track_moving.yaml", "scan.duration=200 ms"),
}

RUN = """
import sys
from pathlib import Path
from scanner_sim.render import device
path, folder, config, *overrides = sys.argv[1:]
device.OLDEST_LLVM = 0
device.find_llvm = lambda: device.LlvmLibrary(path=Path(path), version=(0, 0, 0))
from scanner_sim.cli import main
sets = [word for override in overrides for word in ("--set", override)]
sys.argv = ["scanner-sim", "run", config, *sets, "--device", "cpu", "-o", folder]
main()
"""


def outcome(library: str, config: str, *overrides: str) -> str:
    """Return how a run on a library ends, in a few words."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", RUN, library, f"{folder}/result", str(CONFIGS / config), *overrides]
        environment = os.environ | {"HOME": folder, "XDG_CACHE_HOME": folder}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return "works"
    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
    return f"status {done.returncode}: {last[:100]}"


def main() -> None:
    for library in sys.argv[1:]:
        print(library)
        for name, (config, *overrides) in RUNS.items():
            print(f"  {name:14} {outcome(library, config, *overrides)}", flush=True)


if __name__ == "__main__":
    main()
