"""The verb ``orbit``."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from scanner_sim.cli.call import Call, files_of
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.products.files.contents import ORBIT

if TYPE_CHECKING:
    from scanner_sim.products.timeline import Timeline


def orbit_scenario(call: Call, *, steps: int) -> None:
    """Sweep one orbit of a scenario into a folder.

    Raises
    ------
    ScannerSimError
        If the scenario has no orbit, it, the folder or the device cannot be used, or the disk fails.
    """
    from scanner_sim.products.pictures.timeline import draw_timeline
    from scanner_sim.products.timeline import orbit_csv, orbit_json

    scenario = call.scenario()
    with call.claimed(ORBIT):
        from scanner_sim.validation.studies.sweep import sweep_orbit

        with call.work("along the orbit") as (advance, _):
            timeline = sweep_orbit(scenario, steps, device=call.device, progress=advance)
        paths = call.write(
            ORBIT,
            {
                "orbit.json": orbit_json(timeline),
                "orbit.csv": orbit_csv(timeline),
                "orbit.png": partial(draw_timeline, timeline),
                "scenario.yaml": timeline.scenario_yaml,
            },
        )
    call.warn(timeline.warnings)
    if call.quiet:
        return
    rows = share_rows(timeline)
    print_rows(rows, left=(0, len(rows[0]) - 1))
    eclipse = 100.0 * (1.0 - float(timeline.sun_visible.mean()))
    print_table(
        {
            "orbit": f"{timeline.period / 60.0:.1f} min in {timeline.times.size} steps, {eclipse:.1f} % in eclipse",
            **files_of(paths),
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
