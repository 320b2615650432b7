"""The verb ``budget``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from scanner_sim.analytic.budget import Instrument, range_budget
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import scenario_of
from scanner_sim.cli.scenarios import load_and_warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import resolved_yaml
from scanner_sim.products.budget import BUDGET, BudgetRow, write_budget
from scanner_sim.products.folder import check_target
from scanner_sim.render.device import DeviceChoice
from scanner_sim.scenario import Scenario

FOLDER = "{}_budget"
"""Name of the output folder for that of a scenario."""


def budget_scenario(
    config: Path,
    folder: Path,
    overrides: Sequence[str],
    *,
    count: int,
    reflectance: float,
    image: bool,
    device: DeviceChoice,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Measure and compute the error budget of a scenario's instrument into a folder.

    Raises
    ------
    ScannerSimError
        If the scenario, the folder or the device cannot be used, or the disk fails.
    """
    scenario = load_and_warn(config, overrides, quiet)
    check_target(folder, overwrite, BUDGET)
    from scanner_sim.budget import HALF, distances_of, dominating, measure_budget

    distances = distances_of(scenario, count)
    dominance = None
    with progress_bar("source by source", quiet) as (advance, say), scenario_of(config):
        rows = measure_budget(scenario, distances, reflectance, device=device, progress=advance)
        if image:
            say("over the image")
            dominance = dominating(scenario, device=device, progress=advance)
    bench = instrument_of(scenario, reflectance, HALF)
    closed = {distance: range_budget(bench, distance) for distance in distances.tolist()}
    rows = tuple(replace(row, analytic_m=closed[row.range_m].get(row.source, math.nan)) for row in rows)
    paths = write_budget(
        rows,
        folder,
        reflectance=reflectance,
        scenario_yaml=resolved_yaml(scenario),
        dominance=dominance,
        overwrite=overwrite,
    )
    if quiet:
        return
    print_rows(budget_rows(rows))
    closing = {"folder": str(folder), "files": ", ".join(path.name for path in paths)}
    if dominance is not None:
        shares = sorted(dominance.shares().items(), key=lambda share: -share[1])
        closing["most of σ"] = ", ".join(f"{name} {100.0 * share:.3g} %" for name, share in shares if share)
    print_table(closing)


def instrument_of(scenario: Scenario, reflectance: float, half: float) -> Instrument:
    """Return the numbers of a scenario's instrument before a target, for the closed forms."""
    from scanner_sim.optics.filter import laser_gain, peak_transmission

    scanner, processing = scenario.scanner, scenario.processing
    laser, mirrors, sensor = scanner.laser, scanner.mirrors, scanner.position_sensor
    noise, receiver = sensor.noise, scanner.receiver
    passed = peak_transmission(scanner.filter) * float(laser_gain(scanner.filter, laser, sensor.response))
    return Instrument(
        estimator=processing.peak,
        corrected=processing.bias_correction != "none",
        focal_length=receiver.focal_length,
        baseline=receiver.baseline,
        aperture=receiver.aperture,
        transmission=receiver.transmission * passed,
        point_spread=receiver.point_spread,
        wavelength=laser.wavelength,
        power=laser.power,
        waist_radius=laser.waist_radius,
        waist_distance=laser.waist_distance,
        m_squared=laser.m_squared,
        pitch=sensor.pitch,
        efficiency=sensor.quantum_efficiency,
        dwell=scanner.dwell,
        reflectance=reflectance,
        shot=float(noise.shot),
        read=sensor.read_noise if noise.read else 0.0,
        dark=sensor.dark_current * scanner.dwell if noise.dark else 0.0,
        step=sensor.electrons_per_number if noise.quantisation else 0.0,
        response=sensor.prnu if noise.prnu else 0.0,
        contrast=math.sqrt(0.5) if laser.speckle else 0.0,  # a grey Lambertian surface depolarises
        sweep=scenario.raster.travel,
        jitter=mirrors.jitter * math.sqrt(1.0 - mirrors.jitter_seen),
        wobble=mirrors.wobble,
        synchronisation=mirrors.synchronisation,
        readout=math.hypot(mirrors.readout_noise, mirrors.readout_step / math.sqrt(12.0)),
        half=half,
    )


def budget_rows(rows: Sequence[BudgetRow]) -> list[list[str]]:
    """Return the table of a budget [mm]: a heading, then for each source simulated and analytic at each range."""
    ranges = list(dict.fromkeys(row.range_m for row in rows))
    chosen = [ranges[round(place * (len(ranges) - 1) / 4)] for place in range(5)]
    chosen = list(dict.fromkeys(chosen))
    table = [["σ of the range [mm]: simulated (analytic)", *(f"{distance:.3g} m" for distance in chosen)]]
    for name in dict.fromkeys(row.source for row in rows):
        own = {row.range_m: row for row in rows if row.source == name}
        cells = (f"{_mm(own[x].simulated_m)} ({_mm(own[x].analytic_m)})" for x in chosen)
        table.append([name, *cells])
    return table


def _mm(metres: float) -> str:
    return "–" if math.isnan(metres) else f"{1e3 * metres:.3g}"
