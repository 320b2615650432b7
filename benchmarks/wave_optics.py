"""Is σ of each estimator true on lines of wave optics? The table of docs/theory/light.md.

python benchmarks/wave_optics.py
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "statistical"))

ESTIMATORS = (
    "maximum_likelihood",
    "centre_of_mass",
    "blais_rioux_8",
    "blais_rioux_4",
    "blais_rioux_2",
    "gaussian",
    "parabola",
)


def main() -> None:
    """Print, over the ranges, the standard deviation of z (mean over places in a pixel) and the share beyond 3."""
    bench = import_module("test_wave_optics")
    print("| estimator | " + " | ".join(bench.ABERRATIONS) + " |")
    print("|---" * (1 + len(bench.ABERRATIONS)) + "|")
    for peak in ESTIMATORS:
        cells = []
        for kind in bench.ABERRATIONS:
            spreads, beyond = [], []
            for distance in bench.RANGES:
                _, z, status = bench._find(kind, distance, peak)
                parts = [
                    own[good == 0] for own, good in zip(z.reshape(3, -1), status.reshape(3, -1), strict=True)
                ]
                spreads.append(np.mean([part.std() for part in parts]))
                beyond.append(np.mean([np.mean(np.abs(part - part.mean()) > 3.0) for part in parts]))
            cells.append(f"{min(spreads):.2f} to {max(spreads):.2f}; {100.0 * max(beyond):.1f} %")
        print(f"| `{peak}` | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
