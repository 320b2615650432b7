"""The verb ``orbit``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import scenario_of, warn
from scanner_sim.cli.scenarios import load_and_warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.products.files.contents import ORBIT
from scanner_sim.products.files.folder import claim_folder
from scanner_sim.render.libraries import DeviceChoice

if TYPE_CHECKING:
    from scanner_sim.products.timeline import Timeline


def orbit_scenario(
    config: Path,
    folder: Path,
    overrides: Sequence[str],
    *,
    steps: int,
    device: DeviceChoice,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Sweep one orbit of a scenario into a folder.

    Raises
    ------
    ScannerSimError
        If the scenario has no orbit, it, the folder or the device cannot be used, or the disk fails.
    """
    from scanner_sim.products.files.orbit_folder import write_orbit

    scenario = load_and_warn(config, overrides, quiet)
    with claim_folder(folder, overwrite, ORBIT):
        from scanner_sim.validation.studies.sweep import sweep_orbit

        with progress_bar("along the orbit", quiet) as (advance, _), scenario_of(config):
            timeline = sweep_orbit(scenario, steps, device=device, progress=advance)
        paths = write_orbit(timeline, folder, overwrite=overwrite)
    if quiet:
        return
    for sentence in timeline.warnings:
        warn(sentence)
    rows = share_rows(timeline)
    print_rows(rows, left=(0, len(rows[0]) - 1))
    eclipse = 100.0 * (1.0 - float(timeline.sun_visible.mean()))
    print_table(
        {
            "orbit": f"{timeline.period / 60.0:.1f} min in {timeline.times.size} steps, {eclipse:.1f} % in eclipse",
            "folder": str(folder),
            "files": ", ".join(path.name for path in paths),
        }
    )


def share_rows(timeline: Timeline) -> list[list[str]]:
    """Return the table of shares: a heading, then a line for each condition with each target and the estimate.

    An estimate that covers several conditions stands beside the first one.
    """
    beside = {group.conditions[0]: f"{group.estimate} {group.name}" for group in timeline.groups}
    shares = [timeline.shares(track) for track in timeline.tracks]
    rows = [["share of the orbit", *(track.name for track in timeline.tracks), "the paper"]]
    for number, label in enumerate(timeline.labels):
        values = (f"{100.0 * share[number]:.1f} %" for share in shares)
        rows.append([label.name, *values, beside.get(number, "")])
    return rows
