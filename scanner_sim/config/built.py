"""The three instruments of a scenario: as designed, as built, and as believed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from scanner_sim.config.scanner import Scanner
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.foundation.parameters import INDEX, PARAMETERS
from scanner_sim.foundation.parts import Part
from scanner_sim.optics.built_instrument import BuiltInstrument
from scanner_sim.optics.built_receiver import BuiltReceiver


def instrument_as_built(scenario: Scenario) -> BuiltInstrument | None:
    """Return the true instrument of a scenario; None where it is built as designed.

    Raises
    ------
    InputError
        If its base, its image distance or the pitch of its array is not positive.
    """
    own, scanner = scenario.scanner.as_built, scenario.scanner
    if own is None:
        return None
    seed = scenario.transport.seed_of_light(scenario.seed)
    parameters = own.parameters(seed)
    base = scanner.receiver.baseline + float(parameters[INDEX["base"]])
    behind = scanner.receiver.line_image.depth + float(parameters[INDEX["focal_length"]])
    lengths = [("base", "base", base), ("focal_length", "focal_length", behind)]
    if scanner.line_choice != "none":
        pitch = scanner.line_choice.pitch * (1.0 + float(parameters[INDEX["array_scale"]]))
        lengths.append(("array_scale", "pitch", pitch))
    for name, word, found in lengths:
        if found <= 0.0:
            raise InputError(
                f"the instrument as built has a {word} of {found:.4g} m: none can be made.",
                remedy=f"Reduce scanner.as_built.{name}.",
            )
    return BuiltInstrument(own, parameters, scanner.mirrors, base, seed)


class Departures(Protocol):
    """How an instrument departs from its design: as it was built, or as it is believed."""

    def value(self, name: str) -> float:
        """Return a parameter by its name, in SI."""


def scanner_as_built(scanner: Scanner, built: Departures | None) -> Scanner:
    """Return a scanner with the lengths that an instrument has, for light and detectors, or believes to have."""
    if built is None:
        return scanner
    sensor, scale = scanner.line_choice, 1.0 + built.value("array_scale")
    line: dict[str, float] = {}
    if sensor != "none":
        line = {"pitch": sensor.pitch * scale, "offset": sensor.offset * scale + built.value("array_offset")}
    return scanner.changed(
        receiver=BuiltReceiver.of(
            scanner.receiver, built.value("base"), built.value("focal_length"), built.value("array_tilt")
        ),
        mirrors={"axis_separation": scanner.mirrors.axis_separation + built.value("axis_separation")},
        position_sensor=line,
    )


def with_serial_number(scenario: Scenario) -> Scenario:
    """Return a scenario with the serial number of its instrument: departures that a seed draws are those of its own.

    With other seeds the same instrument measures again, with other errors of its mirrors and other light.
    """
    own, again = scenario.scanner.as_built, scenario.changed(transport={"light_seed": None})
    if own is None or own.seed is not None:
        return again
    return again.changed(scanner={"as_built": {"seed": scenario.transport.seed_of_light(scenario.seed)}})


def same_instrument(base: Scenario, changes: Mapping[str, object], source: str) -> Scenario:
    """Return another scene and scan before the very instrument of a scenario, whose departures its own seed draws.

    Parameters
    ----------
    base
        The scenario of the instrument.
    changes
        Values by key, as :meth:`~scanner_sim.Scenario.replace` takes them: the seed of the scan's noise among them.
    source
        What faults are said to be in.

    Raises
    ------
    ScenarioError
        With all faults.
    """
    try:
        return with_serial_number(base).replace(changes)
    except ScenarioError as error:
        raise ScenarioError(error.faults, source=source) from None


def drawn_departures(scenario: Scenario) -> dict[str, str]:
    """Return what was drawn of the instrument as built, as a file would spell it; empty where nothing was.

    It is the truth, which no estimator knows.
    """
    built, own = instrument_as_built(scenario), scenario.scanner.as_built
    if built is None or own is None:
        return {}
    return {
        parameter.name: str(parameter.dimension.format(float(f"{value:.6g}")))
        for parameter, value in zip(PARAMETERS, built.parameters.tolist(), strict=True)
        if isinstance(getattr(own, parameter.name), Part)
    }
