"""The verb ``budget``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from scanner_sim.analytic.budget import Instrument, range_budget
from scanner_sim.analytic.echo_budget import EchoInstrument, echo_budget, fused_sigma
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import scenario_of
from scanner_sim.cli.scenarios import load_and_warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import resolved_yaml
from scanner_sim.products.budget import BUDGET, BudgetRow, crossing, write_budget
from scanner_sim.products.folder import claimed
from scanner_sim.render.device import DeviceChoice
from scanner_sim.scenario import Scenario


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
    with claimed(folder, overwrite, BUDGET):
        from scanner_sim.studies.budget import distances_of, measure_budget
        from scanner_sim.studies.dominance import dominating

        distances = distances_of(scenario, count)
        dominance = None
        with progress_bar("source by source", quiet) as (advance, say), scenario_of(config):
            rows = measure_budget(scenario, distances, reflectance, device=device, progress=advance)
            if image:
                say("over the image")
                dominance = dominating(scenario, device=device, progress=advance)
        rows = with_closed_forms(rows, scenario, reflectance)
        paths = write_budget(
            rows,
            folder,
            reflectance=reflectance,
            scenario_yaml=resolved_yaml(scenario),
            light="dark" if scenario.lighting.sky().dark else "lit as the scenario says",
            dominance=dominance,
            overwrite=overwrite,
        )
    if quiet:
        return
    print_rows(budget_rows(rows))
    meeting = crossing(rows, "simulated_m")
    closing = {} if math.isnan(meeting) else {"equally precise at": f"{meeting:.3g} m"}
    closing |= {"folder": str(folder), "files": ", ".join(path.name for path in paths)}
    if dominance is not None:
        shares = sorted(dominance.shares().items(), key=lambda share: -share[1])
        closing["most of σ"] = ", ".join(f"{name} {100.0 * share:.3g} %" for name, share in shares if share)
    print_table(closing)


def with_closed_forms(
    rows: Sequence[BudgetRow], scenario: Scenario, reflectance: float
) -> tuple[BudgetRow, ...]:
    """Return a budget with the analytic values of what has a closed form."""
    from scanner_sim.studies.budget import HALF

    bench, unit = instrument_of(scenario, reflectance, HALF), echo_instrument_of(scenario, reflectance)
    # The closed form is that of the matched filter on a Gaussian pulse.
    lidar = scenario.scanner.lidar
    timed = scenario.processing.pulse.timing == "matched_filter" and lidar.pulse.shape == "gaussian"
    closed: dict[tuple[str, float], dict[str, float]] = {}
    for distance in {row.range_m for row in rows}:
        triangulation = range_budget(bench, distance)
        echo = echo_budget(unit, distance) if timed else {}
        both = fused_sigma(triangulation["all"], echo["all"]) if timed else math.nan
        closed["triangulation", distance] = triangulation
        closed["tof", distance] = echo
        closed["fused", distance] = {"all": both}
    found = [replace(row, analytic_m=closed[row.mode, row.range_m].get(row.source, math.nan)) for row in rows]
    if bench.contrast > 0.0:
        found += _ends_of_speckle(bench, list(dict.fromkeys(row.range_m for row in rows)))
    return tuple(found)


def _ends_of_speckle(bench: Instrument, distances: Sequence[float]) -> list[BudgetRow]:
    """Return what speckle would make if all of the spot's blur were the sensor's, or all the lens's."""
    blur = math.hypot(bench.aberration, bench.diffusion)
    ends = {
        "speckle_all_diffusion": replace(bench, aberration=0.0, diffusion=blur),
        "speckle_all_aberration": replace(bench, aberration=blur, diffusion=0.0),
    }
    return [
        BudgetRow("triangulation", name, x, range_budget(end, x)["speckle"], math.nan, math.nan, math.nan, 0)
        for name, end in ends.items()
        for x in distances
    ]


def _sunlight(scenario: Scenario) -> float:
    """Return the Sun's irradiance [W/m²] that counts behind the filter on a target which faces the scanner."""
    from scanner_sim.optics.filter import band_irradiance

    scanner, sky = scenario.scanner, scenario.lighting.sky()
    sun = scenario.lighting.sun
    if sun == "none" or sky.sun_direction is None:
        return 0.0
    bands = band_irradiance(sun, scanner.filter, scanner.position_sensor.response, scanner.laser.wavelength)
    cosine = max(0.0, -float(sky.sun_direction[2]))
    return float(sum(float(band) for band in bands)) * sky.sun_visible * cosine


def echo_instrument_of(scenario: Scenario, reflectance: float) -> EchoInstrument:
    """Return the numbers of a scenario's time-of-flight unit before a target, for the closed forms."""
    from scanner_sim.optics.filter import laser_gain, peak_transmission

    scanner = scenario.scanner
    unit, receiver = scanner.lidar, scanner.receiver
    diode, clock, noise = unit.photodiode, unit.digitiser, unit.photodiode.noise
    peak = peak_transmission(scanner.filter)
    passed = float(laser_gain(scanner.filter, scanner.laser, scanner.position_sensor.response))
    return EchoInstrument(
        energy=unit.pulse.pulse_energy,
        pulse=unit.pulse.sigma,
        response=diode.response_sigma,
        aperture=receiver.aperture,
        transmission=receiver.transmission * peak * passed,
        reflectance=reflectance,
        gain=diode.gain,
        excess=diode.excess_noise,
        responsivity=diode.responsivity,
        bulk=diode.bulk_dark_current,
        surface=diode.surface_dark_current,
        shot=float(noise.shot),
        amplifier=diode.amplifier_noise if noise.amplifier else 0.0,
        saturation=diode.saturation if noise.saturation else math.inf,
        interval=1.0 / clock.rate,
        step=clock.step(diode.saturation) if noise.quantisation else 0.0,
        jitter=clock.jitter if noise.clock else 0.0,
        drift=clock.drift if noise.clock else 0.0,
        sunlight=_sunlight(scenario) / passed,
        field=diode.field_of_view,
    )


def instrument_of(scenario: Scenario, reflectance: float, half: float) -> Instrument:
    """Return the numbers of a scenario's instrument before a target, for the closed forms."""
    from scanner_sim.optics.filter import laser_gain, peak_transmission
    from scanner_sim.studies.budget import course_time, kelvins_of

    scanner, processing = scenario.scanner, scenario.processing
    laser, mirrors, sensor = scanner.laser, scanner.mirrors, scanner.position_sensor
    noise, receiver = sensor.noise, scanner.receiver
    passed = peak_transmission(scanner.filter) * float(laser_gain(scanner.filter, laser, sensor.response))
    # In the dark nothing is subtracted.
    off = 0.0 if scenario.lighting.sky().dark else scanner.laser_off
    exposure, subtracted = (1.0 - off) * scanner.dwell, (1.0 - off) / off if off else 0.0
    return Instrument(
        estimator=processing.peak,
        corrected=processing.bias_correction != "none",
        focal_length=receiver.focal_length,
        baseline=receiver.baseline,
        aperture=receiver.aperture,
        transmission=receiver.transmission * passed,
        aberration=receiver.aberration,
        diffusion=sensor.diffusion,
        wavelength=laser.wavelength,
        power=laser.power,
        waist_radius=laser.waist_radius,
        waist_distance=laser.waist_distance,
        m_squared=laser.m_squared,
        pitch=sensor.pitch,
        efficiency=sensor.quantum_efficiency,
        dwell=exposure,
        reflectance=reflectance,
        shot=float(noise.shot),
        read=sensor.read_noise if noise.read else 0.0,
        dark=sensor.dark_current * exposure if noise.dark else 0.0,
        step=sensor.electrons_per_number if noise.quantisation else 0.0,
        response=sensor.prnu if noise.prnu else 0.0,
        contrast=math.sqrt(0.5) if laser.speckle else 0.0,  # a grey Lambertian surface depolarises
        sweep=scenario.raster.travel * exposure / scanner.dwell,
        jitter=mirrors.jitter * math.sqrt(1.0 - mirrors.jitter_seen),
        wobble=mirrors.wobble,
        synchronisation=mirrors.synchronisation,
        readout=math.hypot(mirrors.readout_noise, mirrors.readout_step / math.sqrt(12.0)),
        half=half,
        subtracted=subtracted,
        sunlight=_sunlight(scenario) / float(laser_gain(scanner.filter, laser, sensor.response)),
        height=sensor.height,
        drift_zero=mirrors.drift_zero,
        drift_scale=mirrors.drift_scale,
        kelvins=kelvins_of(mirrors, course_time(scenario)),
    )


def budget_rows(rows: Sequence[BudgetRow]) -> list[list[str]]:
    """Return the table of a budget [mm]: a heading, then for each source simulated and analytic at each range."""
    ranges = list(dict.fromkeys(row.range_m for row in rows))
    chosen = [ranges[round(place * (len(ranges) - 1) / 4)] for place in range(5)]
    chosen = list(dict.fromkeys(chosen))
    table = [["σ of the range [mm]: simulated (analytic)", *(f"{distance:.3g} m" for distance in chosen)]]
    several = len({row.mode for row in rows}) > 1
    for mode, name in dict.fromkeys((row.mode, row.source) for row in rows):
        own = {row.range_m: row for row in rows if (row.mode, row.source) == (mode, name)}
        cells = (f"{_mm(own[x].simulated_m)} ({_mm(own[x].analytic_m)})" for x in chosen)
        table.append([f"{mode}: {name}" if several else name, *cells])
    return table


def _mm(metres: float) -> str:
    return "–" if math.isnan(metres) else f"{1e3 * metres:.3g}"
