"""Is σ true where a spot falls on more than one surface? The tables of docs/theory/ranging.md.

python benchmarks/uneven.py [scenes of each kind] [first seed] [pulses]

With ``pulses`` it is the σ of time of flight, by the preset ``pulsed_scanner``.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from scanner_sim import simulate
from scanner_sim.validation.compare.mixed_scenes import KINDS, RANGES, MixedCoverage, MixedScene

SIDE = 96
PITCHES = ((0.3, 0.7), (1.0, 3.0), (4.0, 8.0))
"""Least and largest pitch of the raster, in radii of the beam."""
PLAIN = {"processing": {"validation": {"mixed": None, "uneven": False}}}
PULSES = {"scanner": {"preset": "pulsed_scanner"}}
PULSED_RANGES = (15.0, 80.0)
"""Ranges of the scenes that are measured by pulses [m]."""


def row(found: list[MixedCoverage]) -> str:
    """Return the pooled shares, in per cent."""
    size = np.abs(np.concatenate([one.pulls for one in found]))
    kept = 100.0 * np.mean([one.kept for one in found])
    shares = [100.0 * np.mean(part) for part in (size < 1.959964, size > 3.0, size > 6.0)]
    return f"{kept:5.1f} | {shares[0]:5.1f} | {shares[1]:6.2f} | {shares[2]:6.3f}"


def main(scenes: int, first: int, pulses: bool) -> None:
    """Print the table."""
    by: dict[str, Any] = PULSES if pulses else {}
    ranges = PULSED_RANGES if pulses else RANGES
    print("| scene | pitch [w] | | kept | within 1.96 σ | beyond 3 σ | beyond 6 σ |")
    print("|---|---|---|---|---|---|---|")
    for least, most in PITCHES:
        for kind in KINDS:
            now, before = [], []
            for number in range(first, first + scenes):
                drawn = MixedScene.drawn(kind, number, side=SIDE, ranges=ranges)
                beam = drawn.scenario(**by).scanner.laser.radius(drawn.distance)
                pitch = beam * float(np.random.default_rng([number, 7]).uniform(least, most))
                spaced = drawn.at(pitch=pitch)
                now.append(MixedCoverage.of(simulate(spaced.scenario(**by), device="cpu")))
                before.append(MixedCoverage.of(simulate(spaced.scenario(**by, **PLAIN), device="cpu")))
            about = f"| {kind} | {least:g}–{most:g} |"
            print(f"{about} without neighbours | {row(before)} |")
            print(f"{about} as it is | {row(now)} |", flush=True)


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:] if text != "pulses"]
    main(*(numbers + [6, 9000][len(numbers) :]), "pulses" in sys.argv)
