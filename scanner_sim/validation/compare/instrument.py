"""A scenario's instrument as the closed forms take it, and its error budget by them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from scipy.optimize import brentq

from scanner_sim.analytic.budget import InstrumentNumbers, range_budget
from scanner_sim.analytic.echo_budget import EchoInstrument, echo_budget, fused_sigma
from scanner_sim.config.scenario import Scenario
from scanner_sim.optics.as_built import AsBuilt
from scanner_sim.optics.band_irradiance import band_irradiance
from scanner_sim.optics.filter import laser_gain, peak_transmission
from scanner_sim.products.budget import BudgetRow
from scanner_sim.signals.processing import PEAKS
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.studies.budget import HALF, course_time, kelvins_of


def closed_budget(scenario: Scenario, reflectance: float, distance: float) -> dict[str, dict[str, float]]:
    """Return what each source makes of the range of a facing target at a distance [m] by each way, by closed forms.

    The names are those of :func:`scanner_sim.validation.studies.budget.measure_budget`. Time of flight has closed forms
    for the matched filter on a Gaussian pulse only; with others it and the fused range are left out. There are none
    with an estimator of the peak that is the user's own.
    """
    has, found = scenario.scanner.rangefinders, dict[str, dict[str, float]]()
    if "triangulation" in has:
        if PEAKS.is_own(scenario.processing.peak):
            return {}
        found["triangulation"] = range_budget(instrument_of(scenario, reflectance, HALF), distance)
    if "tof" in has and _filtered_gaussian(scenario):
        found["tof"] = echo_budget(echo_instrument_of(scenario, reflectance), distance)
    if len(found) == 2:
        found["fused"] = {"all": fused_sigma(found["triangulation"]["all"], found["tof"]["all"])}
    return found


def _filtered_gaussian(scenario: Scenario) -> bool:
    """Return whether echoes are Gaussian and timed by the matched filter, of which there are closed forms."""
    gaussian = scenario.scanner.lidar.pulse.shape == "gaussian"
    return gaussian and scenario.processing.pulse.timing == "matched_filter"


def closed_crossing(scenario: Scenario, reflectance: float, near: float, far: float) -> float:
    """Return the range [m] from which time of flight is the more precise, by closed forms; NaN where none is between.

    The upward zero of ln(σ_triangulation/σ_TOF) between two ranges.
    """

    def ratio(distance: float) -> float:
        closed = closed_budget(scenario, reflectance, distance)
        return math.log(closed["triangulation"]["all"] / closed["tof"]["all"])

    if "fused" not in closed_budget(scenario, reflectance, near) or not ratio(near) < 0.0 < ratio(far):
        return math.nan
    return float(brentq(ratio, near, far, rtol=1e-4))


def with_closed_forms(
    rows: Sequence[BudgetRow], scenario: Scenario, reflectance: float
) -> tuple[BudgetRow, ...]:
    """Return a budget with the analytic values of what has a closed form."""
    ranges = list(dict.fromkeys(row.range_m for row in rows))
    closed = {distance: closed_budget(scenario, reflectance, distance) for distance in ranges}
    found = [
        replace(row, analytic_m=closed[row.range_m].get(row.mode, {}).get(row.source, math.nan))
        for row in rows
    ]
    by_line = "triangulation" in scenario.scanner.rangefinders
    if by_line and scenario.scanner.laser.speckle and not PEAKS.is_own(scenario.processing.peak):
        found += _ends_of_speckle(instrument_of(scenario, reflectance, HALF), ranges)
    return tuple(found)


def _ends_of_speckle(instrument: InstrumentNumbers, distances: Sequence[float]) -> list[BudgetRow]:
    """Return what speckle would make if all of the spot's blur were the sensor's, or all the lens's."""
    blur = math.hypot(instrument.aberration, instrument.diffusion)
    ends = {
        "speckle_all_diffusion": replace(instrument, aberration=0.0, diffusion=blur),
        "speckle_all_aberration": replace(instrument, aberration=blur, diffusion=0.0),
    }
    return [
        BudgetRow("triangulation", name, x, range_budget(end, x)["speckle"], math.nan, math.nan, math.nan, 0)
        for name, end in ends.items()
        for x in distances
    ]


def _sunlight(scenario: Scenario, response: tuple[float, float]) -> float:
    """Return the Sun's irradiance [W/m²] behind the filter on a target that faces the scanner, over the laser's gain.

    What counts is light to which a detector responds, between two wavelengths [m].
    """
    scanner, sky = scenario.scanner, scenario.lighting.sky()
    sun = scenario.lighting.sun
    if sun == "none" or sky.sun_direction is None:
        return 0.0
    bands = band_irradiance(sun, scanner.filter, response, scanner.laser.wavelength)
    cosine = max(0.0, -float(sky.sun_direction[2]))
    irradiance = float(sum(float(band) for band in bands)) * sky.sun_visible * cosine
    return irradiance / float(laser_gain(scanner.filter, scanner.laser, response))


def echo_instrument_of(scenario: Scenario, reflectance: float) -> EchoInstrument:
    """Return the numbers of a scenario's time-of-flight unit before a target, for the closed forms."""
    scanner = scenario.scanner
    unit, receiver = scanner.lidar, scanner.receiver
    diode, clock, noise = unit.photodiode, unit.digitiser, unit.photodiode.noise
    peak = peak_transmission(scanner.filter)
    passed = float(laser_gain(scanner.filter, scanner.laser, diode.response))
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
        sunlight=_sunlight(scenario, diode.response),
        field=diode.field_of_view,
    )


def instrument_of(scenario: Scenario, reflectance: float, half: float) -> InstrumentNumbers:
    """Return the numbers of a scenario's instrument before a target, for the closed forms."""
    scanner, processing = scenario.scanner, scenario.processing
    laser, mirrors, sensor = scanner.laser, scanner.mirrors, scanner.position_sensor
    noise, receiver = sensor.noise, scanner.receiver
    passed = peak_transmission(scanner.filter) * float(laser_gain(scanner.filter, laser, sensor.response))
    off = scanner.laser_off
    own = scanner.as_built or AsBuilt()
    exposure, subtracted = (1.0 - off) * scanner.dwell, (1.0 - off) / off if off else 0.0
    return InstrumentNumbers(
        estimator=processing.peak,
        corrected=processing.bias_correction != "none",
        array=ClosedForms(scenario).array,
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
        sunlight=_sunlight(scenario, sensor.response),
        height=sensor.height,
        drift_zero=mirrors.drift_zero,
        drift_scale=mirrors.drift_scale,
        kelvins=kelvins_of(mirrors, course_time(scenario)),
        beam_width=processing.validation.beam_width,
        stray=own.stray_light or 0.0,
        pixels=sensor.pixels,
    )
