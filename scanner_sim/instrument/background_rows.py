"""The rows of φ in which the background of a scan is rendered."""

from __future__ import annotations

from collections.abc import Sequence

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
    (whole,) = scan.aims(scenario.scan_setup, scan.shots)
    return rows_about([whole], [None], layout)[0]


def rows_about(aims: Sequence[Aim], times: Sequence[float | None], layout: OpticalLayout) -> list[Rows]:
    """Return an even grid of rows about the shots of each aim, all of one size.

    Parameters
    ----------
    aims
        The shots.
    times
        For each when moving objects are looked at [s]; None as they were loaded.
    layout
        The optics whose pixels decide how dense the grid is.
    """
    first, last = [], []
    for aim in aims:
        pairs = (aim.theta, 0.5 * np.abs(aim.travel_theta)), (aim.phi, 0.5 * np.abs(aim.travel_phi))
        first.append([float((angle - reach).min()) for angle, reach in pairs])
        last.append([float((angle + reach).max()) for angle, reach in pairs])
    width, height = (np.array(last) - np.array(first)).max(axis=0).tolist()
    return [
        rows_between((left, left + width), (top, top + height), layout, time)
        for (left, top), time in zip(first, times, strict=True)
    ]
