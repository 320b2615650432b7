"""What a run will take: ranges, memory and time, told before it starts."""

from __future__ import annotations

import math
from pathlib import Path

from scanner_sim.closed_loop.poses import carriers_of
from scanner_sim.errors import InputError
from scanner_sim.products.run_folder import planned_files
from scanner_sim.products.track import planned_track_files
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scenario import Scenario

START_BYTES = 0.55e9
"""Memory of the program, its kernels and one batch."""
VOXEL_BYTES = 160.0
"""Memory of a voxel: its layers, and what writing and drawing them takes for a while."""
WAVEFORM_BYTES = 14.0
"""Memory of a sample of a waveform that is kept, joined and written."""
START_SECONDS = 8.0
"""Time to load the renderer and to compile the kernels, on two cores."""
VOXELS_PER_SECOND = 2e5
"""Voxels simulated and written per second, on two cores."""
RECORD_BYTES = 64.0
"""Memory of a voxel of a pattern: its samples."""
PATTERNS_PER_SECOND = 150.0
"""Patterns tracked per second, on two cores, under the Sun."""


def plan(scenario: Scenario, folder: Path) -> dict[str, str]:
    """Return what a run would do, as pairs of a word and a phrase."""
    scanner = scenario.scanner
    far = "infinity" if math.isinf(scanner.farthest_range) else f"{scanner.farthest_range:.4g} m"
    return {
        **(_raster(scenario) if isinstance(scenario.scan, RasterScan) else _track(scenario)),
        "ranges seen": f"{scanner.nearest_range:.4g} m to {far}",
        "objects": ", ".join(item.name for item in scenario.scene.objects) or "none of their own",
        "memory": f"about {memory(scenario) / 1e9:.1f} GB",
        "time": f"about {_seconds(scenario):.0f} s on two processor cores",
        "folder": str(folder),
        "files": ", ".join(_files(scenario)),
    }


def _files(scenario: Scenario) -> tuple[str, ...]:
    if isinstance(scenario.scan, RasterScan):
        return planned_files(scenario.output, lit=sunlit(scenario), ranging=scenario.ranging)
    carriers = carriers_of(scenario.targets) if scenario.pose.methods else ()
    return planned_track_files(scenario.output, len(carriers))


def _raster(scenario: Scenario) -> dict[str, str]:
    scan = scenario.raster
    return {
        "voxels": f"{scan.rows} rows × {scan.columns} columns = {scan.shots:,}",
        "field of view": f"Θ {_degrees(scan.horizontal)}, φ {_degrees(scan.vertical)}",
        "scan takes": f"{scan.shots / scenario.scanner.rate:.4g} s on the instrument",
    }


def _track(scenario: Scenario) -> dict[str, str]:
    scan, names = scenario.following, [target.name for target in scenario.targets]
    shown = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
    return {
        "targets": f"{len(names)}: {shown}",
        "patterns": f"{patterns(scenario):,} of {scan.pattern.points} voxels, {scan.pattern.ratio}",
        "one takes": f"{1e3 * period(scenario):.4g} ms on the instrument",
        "scan takes": f"{scan.duration:.4g} s on the instrument",
    }


def period(scenario: Scenario) -> float:
    """Return the time [s] from one visit to a target to the next."""
    scan, scanner = scenario.following, scenario.scanner
    return scan.visiting.period(
        scan.pattern.points, scanner.dwell, len(scenario.targets), scanner.galvanometers
    )


def patterns(scenario: Scenario) -> int:
    """Return about how many patterns a run makes."""
    return math.ceil(scenario.following.duration / period(scenario))


def sunlit(scenario: Scenario) -> bool:
    """Tell whether any of the Sun's disc is in the scenario's sky."""
    return scenario.lighting.sky().sun_visible > 0.0


def memory(scenario: Scenario) -> float:
    """Return roughly how much memory a run takes [byte]."""
    if not isinstance(scenario.scan, RasterScan):
        return START_BYTES + RECORD_BYTES * patterns(scenario) * scenario.scan.pattern.points
    ways = 3.0 if scenario.ranging == "both" else 1.0
    kept = {"none": 0.0, "all": 1.0}.get(str(scenario.output.waveforms), 0.0)
    waveforms = kept * WAVEFORM_BYTES * scenario.scanner.lidar.digitiser.samples
    return START_BYTES + (ways * VOXEL_BYTES + waveforms) * scenario.raster.shots


def check_memory(scenario: Scenario) -> None:
    """Check that a run fits in the memory that is free.

    Raises
    ------
    InputError
        If it does not.
    """
    free = _free_memory()
    if free is not None and memory(scenario) > free:
        raster = isinstance(scenario.scan, RasterScan)
        what = (
            f"{scenario.raster.rows} × {scenario.raster.columns} voxels"
            if raster
            else f"{patterns(scenario):,} patterns"
        )
        raise InputError(
            f"{what} take about {memory(scenario) / 1e9:.1f} GB of memory, and {free / 1e9:.1f} GB are free.",
            remedy=f"Reduce {'scan.rows or scan.columns' if raster else 'scan.duration'}, or scan in several runs.",
        )


def keys() -> list[str]:
    """Return the keys that --set can replace, outside of objects, for completion in a shell."""
    from scanner_sim.config.outline import outline

    return sorted(
        ".".join(place)
        for place, slot in outline().items()
        if place and slot.part is None and not any(step == "*" or step.startswith("(") for step in place)
    )


def _degrees(ends: tuple[float, float]) -> str:
    return f"{math.degrees(ends[0]):.4g}° to {math.degrees(ends[1]):.4g}°"


def _seconds(scenario: Scenario) -> float:
    if not isinstance(scenario.scan, RasterScan):
        return START_SECONDS + patterns(scenario) / PATTERNS_PER_SECOND
    bounces = scenario.transport.bounces
    slower = 1.0 if bounces == 1 else 0.2 * scenario.transport.bounce_paths * (bounces - 1)
    return START_SECONDS + scenario.raster.shots / VOXELS_PER_SECOND * max(slower, 1.0)


def _free_memory() -> float | None:
    """Return the memory that is free or can be freed [byte]; None where the system does not tell."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    kilobytes = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
    return 1024.0 * float(kilobytes[0]) if kilobytes else None
