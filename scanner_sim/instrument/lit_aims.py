"""The aims of a scan with the background that their shots look at.

A raster's background is rendered row by row, each at its time. Other scans have no rows: an even grid about their shots
serves all of them where nothing moves, and one about those of a time slot where something does
(:meth:`~scanner_sim.instrument.instrument.Instrument.backgrounds_by_slot`). Which grid a shot is given depends on the
scan alone, never on the batch.
"""

from __future__ import annotations

from collections.abc import Iterator

from scanner_sim.instrument.instrument import Instrument
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
    for shots, seen in instrument.backgrounds_by_slot(whole):
        for aim in whole.part(shots).batches(batch):
            yield aim, seen
