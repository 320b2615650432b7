"""Laws of the light: sunlight on the line, laser against Sun, and the full well (eqs 17 to 19, Table 1)."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic import spot, sun
from scanner_sim.foundation.status import Status
from scanner_sim.scene.light.lighting import Lighting, Sun
from scanner_sim.validation.compare import test_bench
from scanner_sim.validation.compare.closed_forms import ClosedForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.law import Law, Measured, Predicted, exact

Array = NDArray[np.float64]

WINDOW = 200e-6
"""Width of the paper's S_CCD [m], the part of the line whose sunlight counts."""
_PRECISION = 5e-4
"""Rounding of simulated light, and the sum over pixels for the window's width."""
_STRENGTHS = (0.8, 1.25)
"""Charge of the brightest pixel over the full well."""


def _sunlit_ranges(setting: ComparisonSetup) -> Iterator[float]:
    closed = ClosedForms(setting.scenario)
    for R in setting.flat.ranges:
        seen = closed.facing(R, setting.flat.reflectance)
        if closed.on_array(seen) and closed.passed(math.atan((closed.d) / R)) > 0.5:
            yield R


def _filtered(setting: ComparisonSetup) -> str:
    closed = ClosedForms(setting.scenario)
    if closed.band is None:
        return "there is no filter, and eqs 17 to 19 are written for one"
    chosen = setting.scenario.lighting.sun
    if chosen != "none" and chosen.spectrum != "planck":
        return "the scenario's Sun has a measured spectrum, and eq 17 is a black body's"
    low, high = setting.scenario.scanner.position_sensor.response
    edge = 0.5 * closed.band.width
    if not low + edge < closed.band.centre < high - edge:
        return "the band reaches beyond the detector's response"
    length = setting.scenario.scanner.position_sensor.pixels * closed.pitch
    if length < 2.0 * WINDOW:
        return f"the array of {1e6 * length:.0f} µm has no room for the window of {1e6 * WINDOW:.0f} µm"
    return "" if next(_sunlit_ranges(setting), None) else "the array sees no spot at these ranges"


def _temperature(setting: ComparisonSetup) -> float:
    chosen = setting.scenario.lighting.sun
    return Sun().temperature if chosen == "none" else chosen.temperature


def _dilution(setting: ComparisonSetup) -> float:
    """Return the square of the Sun's radius over its distance, relative to that of the judge."""
    chosen = setting.scenario.lighting.sun
    if chosen == "none":
        return 1.0
    return float((chosen.radius / chosen.distance * sun.SUN_DISTANCE / sun.SUN_RADIUS) ** 2)


def _lit_layers(setting: ComparisonSetup) -> Iterator[tuple[float, dict[str, Array]]]:
    """Yield ranges, and the layers of one noise-free shot at a wall that scanner and Sun face."""
    chosen = setting.scenario.lighting.sun
    source = (Sun() if chosen == "none" else chosen).changed(direction=(0.0, 0.0, -1.0))
    for R in _sunlit_ranges(setting):
        wall = test_bench.plate(R, setting.flat.reflectance, size=4.0 * R)
        made = test_bench.on_test_bench(
            setting,
            wall,
            seed=setting.seed(9)[0],
            lighting=Lighting(sun=source),
            transport={"background_bounces": 1},
        )
        yield R, test_bench.measure(setting, made, test_bench.directions(0.0, 0.0, made.scanner.mirrors, 0.0))


def _measure_sun(setting: ComparisonSetup) -> dict[str, Measured]:
    return {f"{R:.4g} m": exact(float(layers["background"][0])) for R, layers in _lit_layers(setting)}


def _measure_ratio(setting: ComparisonSetup) -> dict[str, Measured]:
    return {f"{R:.4g} m": exact(float(layers["snr"][0])) for R, layers in _lit_layers(setting)}


def _sun_charge(setting: ComparisonSetup, R: float) -> float:
    """Return the charge of sunlight in the window [electron]: eq 18, repaired, with cos⁴ψ off the axis."""
    closed, scanner = ClosedForms(setting.scenario), setting.scenario.scanner
    assert closed.band is not None
    seen = closed.facing(R, setting.flat.reflectance)
    tangent = float(closed.array.tangent((seen.centre - closed.pixel(0.0)) * closed.pitch))
    irradiance = _dilution(setting) * closed.band.counted(
        scanner.laser.wavelength,
        scanner.position_sensor.response,
        math.atan(tangent),
        _temperature(setting),
    )
    gain = math.pi / 4.0 * scanner.receiver.aperture**2 * closed.peak_transmission
    area = WINDOW * scanner.position_sensor.height
    scale = math.sqrt(math.prod(float(one) for one in closed.array.scale(R)))
    watts = sun.sun_power(setting.flat.reflectance, area, scale, gain, irradiance)
    watts /= (1.0 + tangent**2) ** 2
    efficiency = scanner.position_sensor.quantum_efficiency
    return float(spot.electrons(watts, 1.0 / scanner.rate, scanner.laser.wavelength, efficiency))


def _light_accuracy(setting: ComparisonSetup, R: float) -> float:
    return (setting.scenario.scanner.receiver.aperture / R) ** 2 + _PRECISION


def _predict_sun(setting: ComparisonSetup) -> dict[str, Predicted]:
    cases = {}
    for R in _sunlit_ranges(setting):
        charge = _sun_charge(setting, R)
        cases[f"{R:.4g} m"] = Predicted("sunlight", "electron", charge, _light_accuracy(setting, R) * charge)
    return cases


def _predict_ratio(setting: ComparisonSetup) -> dict[str, Predicted]:
    closed, cases = ClosedForms(setting.scenario), {}
    for R in _sunlit_ranges(setting):
        ratio = closed.facing(R, setting.flat.reflectance).charge / _sun_charge(setting, R)
        cases[f"{R:.4g} m"] = Predicted("SNR", "", ratio, _light_accuracy(setting, R) * ratio)
    return cases


SUNLIGHT = Law(
    "sunlight",
    "Sunlight on the line",
    "eqs 17 and 18, repaired",
    "I = (ρ/π)(S/f²) A T [∫_band E + (B_s/B_p) ∫ E] over the response, photon for photon, cos⁴ψ off the axis: "
    "a wall that the Sun and the scanner face, one reflection. S = 200 µm × the pixels' height.",
    "target",
    _filtered,
    _measure_sun,
    _predict_sun,
    exercises="light",
)
SNR = Law(
    "snr",
    "Laser against sunlight",
    "eq 19 over eq 18",
    "SNR = P f²/(R² S E_eff), with what the pixels' height leaves of the laser's spot. The same wall.",
    "target",
    _filtered,
    _measure_ratio,
    _predict_ratio,
    exercises="light",
)


def _fills(setting: ComparisonSetup) -> str:
    closed = ClosedForms(setting.scenario)
    if not setting.scenario.scanner.position_sensor.noise.saturation:
        return "saturation is switched off"
    if not closed.on_array(closed.facing(setting.middle, setting.flat.reflectance)):
        return "the array sees no spot at this range"
    return "" if closed.passed(0.0) > 0.5 else "the filter blocks the laser's line"


def _well(setting: ComparisonSetup) -> float:
    """Return the charge at which a pixel or the converter is full [electron]."""
    sensor = setting.scenario.scanner.position_sensor
    largest = 2**sensor.adc_bits - 1 - sensor.bias
    return sensor.full_well if sensor.gain is None else min(sensor.full_well, largest * sensor.gain)


def _power(setting: ComparisonSetup, strength: float) -> float:
    """Return the laser's power [W] with which the brightest pixel holds a share of the full well."""
    seen = ClosedForms(setting.scenario).facing(setting.middle, setting.flat.reflectance)
    return setting.scenario.scanner.laser.power * strength * _well(setting) / float(seen.line.max())


def _measure_saturation(setting: ComparisonSetup) -> dict[str, Measured]:
    cases = {}
    for strength in _STRENGTHS:
        plate = test_bench.plate(setting.middle, setting.flat.reflectance, size=0.5 * setting.middle)
        made = test_bench.on_test_bench(setting, plate, seed=setting.seed(10)[0], noise=("saturation",))
        made = made.changed(scanner={"laser": {"power": _power(setting, strength)}})
        aim = test_bench.directions(0.0, 0.0, made.scanner.mirrors, 0.0)
        case = f"{strength:g} times the full well"
        cases[f"charge at {case}"] = exact(float(test_bench.lines(setting, made, aim).max()))
        flagged = test_bench.measure(setting, made, aim)["status"] == Status.SATURATED
        cases[f"flag at {case}"] = exact(float(flagged.mean()))
    return cases


def _predict_saturation(setting: ComparisonSetup) -> dict[str, Predicted]:
    cases, well = {}, _well(setting)
    accuracy = _light_accuracy(setting, setting.middle) + 1e-3
    for strength in _STRENGTHS:
        case, charge = f"{strength:g} times the full well", min(strength, 1.0) * well
        cases[f"charge at {case}"] = Predicted("largest charge", "electron", charge, accuracy * charge)
        cases[f"flag at {case}"] = Predicted("share flagged", "", float(strength > 1.0), 0.0, 1.0, "one")
    return cases


SATURATION = Law(
    "saturation",
    "Full well",
    "the pixel's full well, and the link budget of eq 19",
    "The brightest pixel holds the charge of the link budget, at most the full well, and says so. The laser is as "
    "strong as it takes; no noise.",
    "target",
    _fills,
    _measure_saturation,
    _predict_saturation,
    exercises="peak",
)
