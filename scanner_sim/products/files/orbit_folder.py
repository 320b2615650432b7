"""The folder of an orbit."""

from __future__ import annotations

from pathlib import Path

from scanner_sim.products.files.contents import ORBIT
from scanner_sim.products.files.folder import write_folder, write_text
from scanner_sim.products.pictures.timeline import draw_timeline
from scanner_sim.products.timeline import Timeline, orbit_csv, orbit_json


def write_orbit(timeline: Timeline, folder: str | Path, *, overwrite: bool = False) -> tuple[Path, ...]:
    """Write JSON, CSV, picture and scenario of an orbit.

    Raises
    ------
    InputError, RunError
        As :func:`scanner_sim.products.files.folder.write_folder` does.
    """
    writers = {
        "orbit.json": lambda path: write_text(path, orbit_json(timeline)),
        "orbit.csv": lambda path: write_text(path, orbit_csv(timeline)),
        "orbit.png": lambda path: draw_timeline(timeline, path),
        "scenario.yaml": lambda path: write_text(path, timeline.scenario_yaml),
    }
    return write_folder(folder, ORBIT, writers, overwrite=overwrite)
