"""Tracking scans that are possible but probably not meant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from scanner_sim.optics.galvanometer import Galvanometers
from scanner_sim.scan.lissajous import LissajousPattern
from scanner_sim.scan.schedule import pattern_warnings
from scanner_sim.tracking.record import TrackTarget
from scanner_sim.tracking.scan import TrackScan


def track_warnings(
    scan: TrackScan,
    targets: Sequence[TrackTarget],
    galvanometers: Galvanometers,
    dwell: float,
    max_deflection: float,
) -> Iterator[str]:
    """Yield a sentence for everything about a tracking scan that makes little sense.

    Patterns that the mirrors cannot follow, with the attainable ones; targets whose pattern leaves the field of view;
    targets whose pattern also meets another one; runs that end before every target was visited.

    Parameters
    ----------
    scan, targets
        The scan and its targets.
    galvanometers
        The mirrors' servos.
    dwell
        Time of a voxel [s].
    max_deflection
        Largest deflection of each mirror [rad].
    """
    amplitudes = [_amplitude(scan, target) for target in targets]
    largest = max(amplitudes, default=0.0)
    yield from pattern_warnings(
        _with_amplitude(scan.pattern, largest), galvanometers, dwell, "scan.pattern (tracking)"
    )
    if scan.tracker.search_most > largest:
        pattern = _with_amplitude(scan.pattern, scan.tracker.search_most)
        yield from pattern_warnings(pattern, galvanometers, dwell, "scan.tracker.search_most")
    reach = np.array([1.0, scan.pattern.aspect])
    for target, amplitude in zip(targets, amplitudes, strict=True):
        if (np.abs(target.expected[:2]) + amplitude * reach > max_deflection).any():
            theta, phi = np.degrees(target.expected[:2])
            yield (
                f"scan.targets: '{target.name}' is expected at Θ {theta:.4g}°, φ {phi:.4g}°, where its pattern leaves "
                f"the field of view (scanner.mirrors.max_deflection, {np.degrees(max_deflection):.4g}°); it waits"
            )
    for index, (target, amplitude) in enumerate(zip(targets, amplitudes, strict=True)):
        for other in targets[index + 1 :]:
            away = np.abs(target.expected - other.expected)
            room = max(amplitude, _amplitude(scan, other)) * reach
            size = 0.5 * max(other.appearance.diameter, target.appearance.diameter) / other.expected[2]
            if (away[:2] < room + size).all() and away[2] < target.appearance.depth + other.appearance.depth:
                yield (
                    f"scan.targets: the pattern of '{target.name}' also meets '{other.name}', which lies within the "
                    "range gate; make scan.tracker.track_amplitude or the target's depth smaller"
                )
    period = scan.visiting.period(scan.pattern.points, dwell, len(targets), galvanometers)
    if period * (len(targets) - 1) >= scan.duration:
        yield (
            f"scan.duration: in {scan.duration:.4g} s not all of {len(targets)} targets are visited, "
            f"{1e3 * period:.4g} ms each"
        )


def _amplitude(scan: TrackScan, target: TrackTarget) -> float:
    """Return the amplitude of the pattern that follows a target [rad]."""
    return float(scan.tracker.track_amplitude * 0.5 * target.appearance.diameter / target.expected[2])


def _with_amplitude(pattern: LissajousPattern, amplitude: float) -> LissajousPattern:
    return pattern.model_copy(update={"amplitude": amplitude})
