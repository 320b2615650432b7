"""What an instrument knows of the laser's light on its line before it sees any, whatever the power of each run."""

from __future__ import annotations

from dataclasses import replace

from scanner_sim.config.scanner import Scanner
from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_streams import RunSeeds
from scanner_sim.foundation.device_types import Float
from scanner_sim.optics.filter import laser_gain
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.signals.line.expected import ExpectedSpot


def expected_spot(scanner: Scanner, transmission: float, known: Calibration | None = None) -> ExpectedSpot:
    """Return the spot of a scanner's laser behind a filter of some peak transmission.

    ``scanner`` has the lengths that it believes to have, and ``known`` is the calibration that tells them.
    """
    passed = laser_gain(scanner.filter, scanner.laser, scanner.position_sensor.response)
    spot = _spot(scanner, transmission * float(passed))
    if known is None:
        return spot
    lens = known.value("radial_1"), known.value("radial_2"), known.value("tangential")
    return replace(spot, lens=lens) if any(lens) else spot


def white_light(
    spot: ExpectedSpot, scanner: Scanner, transmission: float, theta: Float, seeds: RunSeeds | None
) -> tuple[Float, Float]:
    """Return the light of a white surface, as an :class:`ExpectedSpot` has it, on the device beside deflections.

    That of ``spot`` for all shots; or one for each of ``theta``, where these belong to runs of several powers.
    """
    if seeds is None or seeds.powers is None:
        first, second = beside(theta, spot.white, spot.white_by_pixel)
        return first, second
    passed = laser_gain(scanner.filter, scanner.laser, scanner.position_sensor.response)
    lasers = (scanner.changed(laser={"power": power}) for power in seeds.powers)
    spots = [_spot(one, transmission * float(passed)) for one in lasers]
    return seeds.spread([one.white for one in spots]), seeds.spread([one.white_by_pixel for one in spots])


def _spot(scanner: Scanner, share: float) -> ExpectedSpot:
    return ExpectedSpot.of(scanner.laser, scanner.receiver, share, scanner.position_sensor, scanner.exposure)
