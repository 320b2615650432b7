"""What a run will take: ranges, memory and time, stated before it starts."""

from __future__ import annotations

import math
from pathlib import Path

from scanner_sim.cli.tables import named_files
from scanner_sim.config.scanner import RangefinderName
from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.closed_loop.poses import carriers_of
from scanner_sim.instrument.memory import (
    background_bins,
    background_paths,
    background_rows,
    disk,
    memory,
    patterns,
    period,
)
from scanner_sim.products.files.contents import planned_files, planned_shot_files, planned_track_files
from scanner_sim.scan.protocol import OpenScan

START_SECONDS = 8.0
"""Time to load the renderer and to compile the kernels, on two cores."""
VOXELS_PER_SECOND = 2e5
"""Voxels simulated and written per second, on two cores."""
PATHS_PER_SECOND = 4.4e6
"""Paths of the background followed per second, on two cores."""
PATTERNS_PER_SECOND = 150.0
"""Patterns tracked per second, on two cores, under the Sun."""
FRAME_PIXELS_PER_SECOND = 3e5
"""Pixels of the camera's frames rendered and searched for dots per second, on two cores."""

_LONG = 0.5
"""Time for the background [h] beyond which it is said before."""


def plan(scenario: Scenario, folder: Path) -> dict[str, str]:
    """Return what a run would do, as pairs of a word and a phrase."""
    return {
        **_pointing(scenario),
        "ranges seen": ", ".join(_seen(scenario, name) for name in scenario.rangefinders),
        "objects": ", ".join(item.name for item in scenario.scene.objects) or "none of their own",
        "memory": f"about {memory(scenario) / 1e9:.1f} GB",
        "time": f"about {START_SECONDS + run_seconds(scenario):.0f} s on two processor cores",
        **(
            {"disk": f"about {size / 1e6:,.0f} MB of lines and waveforms"} if (size := disk(scenario)) else {}
        ),
        "folder": str(folder),
        "files": named_files(_files(scenario)),
    }


def _seen(scenario: Scenario, rangefinder: RangefinderName) -> str:
    near, far = scenario.scanner.seen_by(rangefinder)
    beyond = "infinity" if math.isinf(far) else f"{far:.4g} m"
    return f"{near:.4g} m to {beyond}" + (" by time of flight" if rangefinder == "tof" else "")


def _files(scenario: Scenario) -> tuple[str, ...]:
    output, lit, calibrated = scenario.output, sunlit(scenario), scenario.processing.calibration is not None
    if scenario.scan.layout == "image":
        return planned_files(output, lit=lit, rangefinders=scenario.rangefinders, calibrated=calibrated)
    if scenario.scan.layout == "shots":
        return planned_shot_files(output, lit=lit, calibrated=calibrated)
    carriers = carriers_of(scenario.targets) if scenario.pose.by_scanner else ()
    seen = scenario.arrays_followed if "camera" in scenario.pose.methods else ()
    return planned_track_files(scenario.output, max(len(carriers), len(seen)), _frames(scenario))


def _pointing(scenario: Scenario) -> dict[str, str]:
    """Return where a scan points and for how long."""
    scan, setup = scenario.scan, scenario.scan_setup
    last = {"scan takes": f"{scan.scan_time(setup):.4g} s on the instrument"}
    if scan.layout == "visits":
        return _track(scenario) | last
    return _open(scan) | last


def _open(scan: OpenScan) -> dict[str, str]:
    return {
        "voxels" if scan.layout == "image" else "shots": scan.summary,
        "field of view": f"Θ {_degrees(scan.horizontal)}, φ {_degrees(scan.vertical)}",
    }


def _track(scenario: Scenario) -> dict[str, str]:
    scan, names = scenario.following, [target.name for target in scenario.targets]
    shown = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    frames = _frames(scenario)
    return {
        "targets": f"{len(names)}: {shown}",
        "patterns": f"{patterns(scenario):,} of {scan.pattern.points} voxels, {scan.pattern.ratio}",
        "one takes": f"{1e3 * period(scenario):.4g} ms on the instrument",
        **({"camera": f"{frames:,} frames"} if frames else {}),
    }


def _frames(scenario: Scenario) -> int:
    """Return how many frames the camera takes beside a track."""
    if "camera" not in scenario.pose.methods:
        return 0
    return len(scenario.camera.frame_times(scenario.following.duration))


def sunlit(scenario: Scenario) -> bool:
    """Tell whether any of the Sun's disc is in the scenario's sky."""
    return scenario.lighting.sky().sun_visible > 0.0


def slow(scenario: Scenario) -> tuple[str, ...]:
    """Return a sentence where pixels are so fine that their background takes most of an hour, or more."""
    hours = _background_seconds(scenario) / 3600.0
    if hours < _LONG:
        return ()
    return (
        f"scanner.position_sensor.pitch: the background has {background_bins(scenario):,} directions, a pixel wide and "
        f"in each of {background_rows(scenario)[0]:,} rows, and takes about {hours:.2g} h on two processor cores; "
        "larger pixels, a narrower scan or fewer transport.background_samples take less",
    )


def keys() -> list[str]:
    """Return the keys that --set can replace, outside of objects, for completion in a shell."""
    from scanner_sim.config.outline import outline

    found = set()
    for location, slot in outline().items():
        # Of the kinds of a scan's or an object's keys only one is right; a part of the instrument has one kind.
        chosen = location[:1] != ("scanner",) and any(step.startswith("(") for step in location)
        if location and slot.part is None and "*" not in location and not chosen:
            found.add(".".join(step for step in location if not step.startswith("(")))
    return sorted(found)


def _degrees(ends: tuple[float, float]) -> str:
    return f"{math.degrees(ends[0]):.4g}° to {math.degrees(ends[1]):.4g}°"


def run_seconds(scenario: Scenario) -> float:
    """Return about how long a run takes [s] where the program is loaded and its kernels are there."""
    if scenario.scan.layout == "visits":
        interior = scenario.camera.interior
        pixels = _frames(scenario) * interior.rows * interior.columns
        return patterns(scenario) / PATTERNS_PER_SECOND + pixels / FRAME_PIXELS_PER_SECOND
    bounces = scenario.transport.bounces
    slower = 1.0 if bounces == 1 else 0.2 * scenario.transport.bounce_paths * (bounces - 1)
    shots = scenario.open_scan.shots / VOXELS_PER_SECOND * max(slower, 1.0)
    return shots + _background_seconds(scenario)


def _background_seconds(scenario: Scenario) -> float:
    """Return about how long the background is followed; fewer or more bounces than four count in proportion."""
    return background_paths(scenario) / PATHS_PER_SECOND * scenario.transport.background_bounces / 4.0
