"""The aims of a scan with the background that their shots look at.

A raster's background is rendered row by row, each at its time. Other scans have no rows: an even grid about their shots
serves all of them where nothing moves, and one about those of a time slot where something does. Which grid a shot is
given depends on the scan alone, never on the batch.

Approximations of such grids: objects stand still for a slot, in which none moves by more than a pixel (those that are
faster than a pixel in 1/64 s move by more); two rows are interpolated.
"""

from __future__ import annotations

from collections.abc import Iterator

from scanner_sim.instrument.background_rows import rows_about
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.time_slots import TimeSlots, middle
from scanner_sim.render.background.panorama import Panorama
from scanner_sim.scan.protocol import Aim


def lit_aims(instrument: Instrument, batch: int) -> Iterator[tuple[Aim, list[Panorama] | None]]:
    """Yield the aims of an instrument's scan, with the panoramas that its rangefinders see.

    Parameters
    ----------
    instrument
        Before its scene; its scan's aims are known beforehand.
    batch
        Most shots of an aim.

    Yields
    ------
    tuple
        None stands for the background that the instrument has of the whole scan, or for the dark.
    """
    scenario = instrument.scenario
    scan, lit = scenario.open_scan, not scenario.lighting.sky().dark
    if scan.layout == "image" or not lit or not instrument.loaded.bodies:
        for aim in scan.aims(scenario.scan_setup, batch):
            yield aim, None
        return
    (whole,) = scan.aims(scenario.scan_setup, scan.shots)
    rangefinders = instrument.rangefinders
    layout, _ = rangefinders[0].sight
    slots = TimeSlots(instrument.loaded, layout.pitch / layout.receiver.focal_length)
    # Shots stand in the order of their times, so those of a slot stand together.
    found = [slots.at(time) for time in whole.time.tolist()]
    changes = [index for index in range(1, len(found)) if found[index] != found[index - 1]]
    ends = [*changes, len(found)]
    parts = [whole.part(slice(first, last)) for first, last in zip([0, *changes], ends, strict=True)]
    times = [middle(found[last - 1]) for last in ends]
    rows = [rows_about(parts, times, rangefinder.sight[0]) for rangefinder in rangefinders]
    for part, *own in zip(parts, *rows, strict=True):
        seen = [rangefinder.panorama_of(row) for rangefinder, row in zip(rangefinders, own, strict=True)]
        for aim in part.batches(batch):
            yield aim, seen
