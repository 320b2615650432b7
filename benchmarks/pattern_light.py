"""How far the light of patterns errs: centres of discs against those with 2048 beamlets in every shot.

Run as ``python benchmarks/pattern_light.py [--beamlets K ...] [--distances D ...] [--attitudes PITCH,YAW ...]``.
Boards of 16 discs, each in its own direction, are followed with 2048 beamlets, each with a moment of its own, in every
shot; from each state of that run the same visit is made again with fewer, and with the same noise. Errors of Θ, φ and
range are in units of the σ that the visit states: root mean squares and the largest; the last columns are mean z² of
both against the truth. The table of docs/theory/light.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from visits import board

from scanner_sim import Tracker
from scanner_sim.render.beam import pattern, splitter
from scanner_sim.render.beam.swept_beamlets import SweptTables
from scanner_sim.tracking.record import PatternRecord, TrackStatus
from scanner_sim.tracking.state import TrackMode

REFERENCE = 2048


@contextmanager
def every_shot_split() -> Iterator[None]:
    """Let every shot be split, into beamlets with a moment of their own each, and nothing be known of edges."""
    kept = splitter._classify_footprints, SweptTables.averaged, pattern.split_beams

    def edge(*given: Any) -> Any:
        return dr.full(mi.UInt32, splitter._EDGE, dr.width(given[-1]))

    splitter._classify_footprints, SweptTables.averaged = edge, SweptTables.of
    pattern.split_beams = lambda *given: splitter.split_beams(*given[:5])
    try:
        yield
    finally:
        splitter._classify_footprints, SweptTables.averaged, pattern.split_beams = kept


def tracker(distance: float, attitude: str, beamlets: int) -> Tracker:
    pitch, yaw = map(float, attitude.split(","))
    overrides = (f"transport.pattern_beamlets={beamlets}",)
    made = board(pitch, yaw, distance, 7, side=4, visits=6, overrides=overrides)
    return Tracker(made, device="cpu", threads=1)


def reference(distance: float, attitude: str) -> list[tuple[Any, PatternRecord]]:
    """Return the states before the visits that measured a disc, and their records."""
    run, found = tracker(distance, attitude, REFERENCE), []
    dr.set_thread_count(1)
    with every_shot_split():
        while not run.finished:
            before = run.state
            record = next(run)
            if record.status == TrackStatus.MEASURED and record.mode in (TrackMode.ACQUIRE, TrackMode.TRACK):
                found.append((before, record))
    return found


def cells(visits: list[tuple[Any, PatternRecord]], run: Tracker) -> Iterator[str]:
    """Yield the cells of a row."""
    apart, ours, theirs = [], [], []
    for state, right in visits:
        record, _ = run.visit(state)
        sigma = np.sqrt(np.diagonal(right.covariance))
        apart.append((record.position - right.position) / sigma)
        ours.append((record.position - record.truth) / np.sqrt(np.diagonal(record.covariance)))
        theirs.append((right.position - right.truth) / sigma)
    for values in (np.sqrt(np.nanmean(np.square(apart), axis=0)), np.nanmax(np.abs(apart), axis=0)):
        yield ", ".join(f"{value:.2f}" for value in values)
    for errors in (ours, theirs):
        yield ", ".join(f"{value:.2f}" for value in np.nanmean(np.square(errors), axis=0))


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--beamlets", type=int, nargs="+", default=[480, 240, 120])
    asked.add_argument("--distances", type=float, nargs="+", default=[4.0, 10.0])
    asked.add_argument("--attitudes", nargs="+", default=["0,0", "40,0"])
    given = asked.parse_args()
    print(f"| disc | beamlets | rms [σ]: Θ, φ, range | largest | z² | z² with {REFERENCE} |")
    print("|---|---|---|---|---|---|")
    for distance in given.distances:
        for attitude in given.attitudes:
            visits = reference(distance, attitude)
            for count in given.beamlets:
                row = cells(visits, tracker(distance, attitude, count))
                print(f"| {distance:g} m, {attitude} | {count} | " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
