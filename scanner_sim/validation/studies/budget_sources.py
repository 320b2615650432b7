"""The sources of error of a budget: which of them an instrument has, and instruments that have one alone."""

from __future__ import annotations

from scanner_sim.config.scanner import Scanner
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.optics.as_built import AsBuilt
from scanner_sim.optics.deflection import ERRORS
from scanner_sim.products.budget import Mode

QUIET, ALL, SUN, STRAY = "estimator", "all", "sun", "stray"

_NOISE = {"shot": "shot", "read": "read", "quantisation": "quantisation", "response": "prnu"}
"""Switch of the line sensor for each source of noise."""
_ECHO_NOISE = ("shot", "amplifier", "quantisation", "clock")
"""Switches of the photodiode, which are the sources of time of flight."""
_UNSTEADY = {
    "triangulation": {"vibration": "vibration", "power": "power_noise"},
    "tof": {"vibration": "vibration", "power": "pulse_noise"},
}
"""Sources in what changes of the instrument as built from shot to shot, and their keys, by way of ranging."""
LIFTED = ("jitter", "wobble")
"""Sources that move the light, and whose error far away is below the rounding of the spot's position."""
LIFT = 32.0
"""By how much these are enlarged, and their errors, which are linear in them, divided again."""


def modes_of(scenario: Scenario) -> tuple[Mode, ...]:
    """Return the ways of ranging in a scenario's budget: with time of flight all that the instrument has, and fused."""
    if "tof" not in scenario.rangefinders:
        return ("triangulation",)
    return ("triangulation", "tof", "fused") if len(scenario.scanner.rangefinders) == 2 else ("tof",)


def sources_of(scenario: Scenario, mode: Mode = "triangulation") -> tuple[str, ...]:
    """Return the names of the sources of error of a way of ranging, ``all`` and ``estimator`` included."""
    scanner = scenario.scanner
    if mode == "fused":
        return (ALL,)
    if mode == "tof":
        switches = scanner.lidar.photodiode.noise
        names = [name for name in _ECHO_NOISE if getattr(switches, name)]
        shot = switches.shot
    else:
        noise, mirrors = scanner.position_sensor.noise, scanner.mirrors
        course = mirrors.temperature
        names = [name for name, switch in _NOISE.items() if getattr(noise, switch)]
        names += ["speckle"] if scanner.laser.speckle else []
        moved = [name for name, keys in ERRORS.items() if any(getattr(mirrors, key) for key in keys)]
        names += [name for name in moved if name != "drift" or course.rate or course.amplitude]
        shot = noise.shot
    own = scanner.as_built or AsBuilt()
    names += [name for name, key in _UNSTEADY[mode].items() if getattr(own, key)]
    names += [STRAY] if shot and own.stray_light and mode == "triangulation" else []
    names += [SUN] if shot and not scenario.lighting.sky().dark else []
    return (*names, QUIET, ALL)


def quietened(scanner: Scanner, name: str) -> Scanner:
    """Return the instrument with one source of error.

    ``sun`` and ``stray`` are measured as shot noise with that light, from whose variance that without it is taken off.
    For ``shot`` the laser is weaker by what is scattered, and nothing is. Temperature changes for ``drift`` alone.
    """
    noise = "shot" if name in (SUN, STRAY) else name
    own = NoiseSwitches() if scanner.line_choice == "none" else scanner.line_choice.noise
    switches = own.only("dark", "saturation", *([_NOISE[noise]] if noise in _NOISE else []))
    heard = {source: source == noise for source in _ECHO_NOISE}
    mirrors = scanner.mirrors.still(but=name)
    if name != "drift":
        mirrors = mirrors.steady()
    if name in LIFTED:
        mirrors = mirrors.changed(**{key: LIFT * getattr(mirrors, key) for key in ERRORS[name]})
    calm, power = scanner.as_built, scanner.laser.power
    if calm is not None:
        keys = {(source, key) for way in _UNSTEADY.values() for source, key in way.items()}
        calm = calm.changed(**{key: None for source, key in keys if source != name})
        if name == "shot":
            power *= 1.0 - (calm.stray_light or 0.0)
            calm = calm.changed(stray_light=None)
    return scanner.changed(
        laser={"speckle": name == "speckle", "power": power},
        mirrors=mirrors,
        position_sensor={"noise": switches},
        lidar={"photodiode": {"noise": heard}},
        as_built=calm,
    )
