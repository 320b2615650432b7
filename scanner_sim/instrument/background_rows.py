"""The rows of φ in which the background of a scan is rendered."""

from __future__ import annotations

import numpy as np

from scanner_sim.config.scenario import Scenario
from scanner_sim.render.background.view import Rows, rows_between
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scan.protocol import Aim


def scan_rows(scenario: Scenario, layout: OpticalLayout) -> Rows:
    """Return the rows that all shots of a scenario's scan look at: a raster's own, each at its time, or an even grid.

    Parameters
    ----------
    scenario
        With a scan whose aims are known beforehand.
    layout
        The optics whose pixels decide how dense an even grid is.
    """
    if scenario.scan.layout == "image":
        raster = scenario.scan
        return Rows(raster.horizontal, raster.angles()[1], raster.row_times(scenario.scanner.dwell))
    scan = scenario.open_scan
    return rows_of(next(scan.aims(scenario.scan_setup, scan.shots)), layout)


def rows_of(aim: Aim, layout: OpticalLayout, time: float | None = None) -> Rows:
    """Return an even grid of rows about the shots of an aim, with moving objects where they are at a time [s]."""
    ends = []
    for angle, travel in ((aim.theta, aim.travel_theta), (aim.phi, aim.travel_phi)):
        reach = 0.5 * np.abs(travel)
        ends.append((float((angle - reach).min()), float((angle + reach).max())))
    return rows_between(ends[0], ends[1], layout, time)
