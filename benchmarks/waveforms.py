"""How many waveforms a second: recorded with noise, detected and timed.

Run as ``python benchmarks/waveforms.py [--records N] [--rounds R]``. The records have 256 samples of the default
receiver; echoes lie at random delays and strengths. The best of the rounds counts, with the median in brackets; the
first compiles and does not.
"""

from __future__ import annotations

import argparse
import time

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from rich.console import Console
from rich.table import Table

from scanner_sim.config.scanner import Scanner
from scanner_sim.detector.photodiode.waveform import record
from scanner_sim.render.device import activate
from scanner_sim.signals.waveform.detection import PulseDetector
from scanner_sim.signals.waveform.settings import PulseDetection

METHODS = ("matched_filter", "gaussian_fit", "leading_edge", "constant_fraction")


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--records", type=int, default=131072)
    arguments.add_argument("--rounds", type=int, default=5)
    arguments.add_argument("--device", default="auto", choices=("auto", "cpu", "cuda"))
    given = arguments.parse_args()
    activate(given.device)
    from scanner_sim.render.beam.light import Light

    m, lidar = given.records, Scanner().lidar
    clock = lidar.digitiser
    random = np.random.default_rng(1)
    shots = dr.arange(auto.UInt32, m)

    def sent(count: int) -> Light:
        floats = [
            (1e-7 / count * random.uniform(0.02, 2.0, count * m)),
            random.uniform(0.0, 2.0, count * m),
            random.uniform(0.0, 0.05, count * m),
            2.0 * random.uniform(1.0, 30.0, m),
        ]
        *clusters, reference = (auto.Float(values.astype(np.float32)) for values in floats)
        return Light(shots, shots, *clusters, reference=reference)

    table = Table("timing", "echoes", "recorded/s", "detected/s", "both/s", title=f"{m} × {clock.samples}")
    for method in METHODS:
        for count in (1, 16) if method == "matched_filter" else (1,):
            echoes = sent(count)
            detector = PulseDetector(lidar.pulse, lidar.photodiode, clock, PulseDetection(timing=method))
            times = []
            for number in range(given.rounds + 1):
                start = time.perf_counter()
                waveforms = record(echoes, shots, lidar.pulse, lidar.photodiode, clock, number, 1e-8)
                dr.sync_thread()
                middle = time.perf_counter()
                detector.detect(waveforms)
                dr.sync_thread()
                if number:
                    times.append((middle - start, time.perf_counter() - middle))
            spent = np.array(times)
            spent = np.column_stack([spent, spent.sum(axis=1)])
            rates = zip(m / spent.min(axis=0), m / np.median(spent, axis=0), strict=True)
            table.add_row(method, str(count), *(f"{best:,.0f} ({usual:,.0f})" for best, usual in rates))
    Console().print(table)


if __name__ == "__main__":
    main()
