"""Units at the door: ``15 mW`` becomes 0.015, and inside everything is SI.

A unit is compulsory on every dimensional number of a file. From Python a plain number is SI already; a string
with a unit is understood there too. Decibels are power ratios. The parsing is done by pint, which is loaded
when the first quantity is read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal
from functools import cache, lru_cache
from typing import Annotated, Any

import pint
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import PydanticCustomError, core_schema

from scanner_sim.foundation.errors import printable

FROM_FILE = {"units": "required"}
"""Validation context that makes units compulsory: pass it where the values come from a file."""

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
_QUANTITY_PATTERN = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*[A-Za-zµμ°(].*$"
_RATIO_PATTERN = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*(%|dB|ppm)?\s*$"
_FACTOR = r"[A-Za-zµμ°Ω_]+(?:(?:\^|\*\*)-?\d)?"
_UNIT = re.compile(rf"{_FACTOR}(?:\s*[*/ ]\s*{_FACTOR})*")
_ELECTRONS = re.compile(r"(?<![\w.])e-(?![\w.])")


@cache
def _registry() -> Any:
    registry: Any = pint.UnitRegistry()
    registry.define("photoelectron = [photoelectrons] = electron")
    registry.define("digital_number = [digital_numbers] = DN")
    registry.define("root_hertz = hertz ** 0.5 = rtHz")
    return registry


@dataclass(frozen=True)
class Dimension:
    """A pydantic annotation: a float that is written with a unit in files.

    Parameters
    ----------
    unit
        SI unit of the value inside, in pint's spelling; ``1`` for ratios, which may be written as a plain
        number, in per cent or in decibels.
    examples
        What a user would write; shown in error messages and in the JSON schema.
    spellings
        Further units in which a value may be written back, the preferred ones first.
    """

    unit: str
    examples: tuple[str | float, ...]
    spellings: tuple[str, ...] = ()

    def parse(self, text: str) -> float:
        """Return the SI value of ``text``.

        Decimal prefixes are exact: ``50 um`` is the same float as 50e-6.

        Raises
        ------
        ValueError
            With a sentence for the user, if the text is no number with a unit of this dimension.
        """
        match = _NUMBER.fullmatch(text)
        if match is None:
            raise ValueError(f"'{text}' is not a number with a unit")
        unit = _ELECTRONS.sub("electron", match[2])
        if not math.isfinite(float(match[1])):
            raise ValueError(f"'{text}' is not finite")
        if self.unit == "1":
            return _ratio(match[1], unit)
        if not unit:
            raise ValueError(f"'{text}' has no unit")
        return _convert(match[1], unit, self.unit)

    def format(self, value: float) -> str | float:
        """Return ``value`` as a file would spell it; reading that again gives the same float.

        Ratios stay plain numbers. Of all units that return the float exactly, the one that needs the fewest
        digits is taken, and then the one whose number lies between 0.1 and 1000.
        """
        return value if self.unit == "1" else _formatted(self, value, math.copysign(1.0, value))

    def spelled(self, value: float, unit: str) -> Iterator[str]:
        """Yield the spellings of ``value`` in one unit that are read back as the same float."""
        number = value / _scale(unit, self.unit)
        for digits in (6, 12, 15, 16, 17):
            text = f"{number:.{digits}g} {unit}".replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")
            if self.parse(text) == value:
                yield text
                return

    def validate(self, value: object, info: ValidationInfo) -> float:
        """Return the SI value of what a scenario holds; pydantic's entrance."""
        if isinstance(value, str):
            try:
                return self.parse(value)
            except ValueError as error:
                raise self._error("quantity", str(error)) from None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._error("quantity", "this is not a number with a unit")
        required = isinstance(info.context, dict) and info.context.get("units") == "required"
        # What is not finite is refused as such afterwards.
        if required and self.unit != "1" and abs(value) < math.inf:
            raise self._error("unit_missing", f"{value!r} has no unit")
        try:
            return float(value)
        except OverflowError:
            raise self._error("quantity", "this number is too large") from None

    @property
    def sample(self) -> str:
        """The examples as a phrase for messages."""
        first, *others = (str(example) for example in self.examples)
        return " or ".join(filter(None, (", ".join([first, *others[:-1]]), *others[-1:])))

    def _error(self, kind: str, reason: str) -> PydanticCustomError:
        return PydanticCustomError(
            kind,
            "{reason}; write for example {example}",
            {"reason": printable(reason), "example": self.sample},
        )

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return core_schema.with_info_before_validator_function(
            self.validate,
            handler(source),
            serialization=core_schema.plain_serializer_function_ser_schema(self.format, when_used="json"),
        )

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        examples = list(self.examples)
        if self.unit == "1":
            return {
                "anyOf": [{"type": "number"}, {"type": "string", "pattern": _RATIO_PATTERN}],
                "examples": examples,
            }
        return {"type": "string", "pattern": _QUANTITY_PATTERN, "examples": examples}


class _Kelvins(Dimension):
    """Kelvins only: a degree Celsius is no multiple of a kelvin."""

    def parse(self, text: str) -> float:
        match = _NUMBER.fullmatch(text)
        if match is None or not match[2].endswith(("K", "kelvin", "kelvins")):
            raise ValueError(f"'{text}' is not a number of kelvins")
        return super().parse(text)


@lru_cache(maxsize=4096)
def _formatted(dimension: Dimension, value: float, sign: float) -> str:  # noqa: ARG001 (−0 is equal to 0)
    """Return what :meth:`Dimension.format` does: the scenarios of a campaign have most numbers in common."""
    units = dimension.spellings
    if dimension.unit not in units:
        units = (*units, dimension.unit)
    exact = [spelling for unit in units for spelling in dimension.spelled(value, unit)]
    return min(exact, key=_awkwardness, default=f"{value!r} {dimension.unit}")


def _awkwardness(spelling: str) -> tuple[int, bool, bool]:
    """Return how hard a quantity is to read: digits that matter, exponent, size far from one."""
    number = spelling.split()[0]
    digits = len(number.partition("e")[0].strip("-").replace(".", "").strip("0"))
    size = abs(float(number))
    return digits, "e" in number, not (size == 0.0 or 0.1 <= size < 1000.0)


def _ratio(number: str, unit: str) -> float:
    """Return a dimensionless value from a plain number, per cent, ppm or decibels (power ratio)."""
    match unit:
        case "":
            return float(number)
        case "%":
            return float(Decimal(number).scaleb(-2))
        case "ppm":
            return float(Decimal(number).scaleb(-6))
        case "dB":
            exponent = float(number) / 10.0
            if exponent > 300.0:
                raise ValueError(f"{number} dB is too large")
            return float(10.0**exponent)
    raise ValueError(f"'{unit}' is no unit of a ratio")


def _convert(number: str, unit: str, target: str) -> float:
    """Return a number of ``unit`` in ``target``; powers of ten are exact."""
    factor = _scale(unit, target)
    exponent = round(math.log10(factor)) if factor > 0.0 else 0
    if math.isclose(factor, 10.0**exponent, rel_tol=1e-12):
        return float(Decimal(number).scaleb(exponent))
    return float(number) * factor


@cache
def _scale(unit: str, target: str) -> float:
    """Return how many ``target`` one ``unit`` is.

    Raises
    ------
    ValueError
        If the unit is unknown or of another dimension. An angle must name an angular unit: pint counts
        angles as dimensionless, so a bare ``%`` would pass.
    """
    # Only products and quotients of names reach pint: 10**10**10 would keep it busy for ever.
    if not _UNIT.fullmatch(unit):
        raise ValueError(f"'{unit}' is not a known unit")
    registry = _registry()
    try:
        found = registry.parse_units(unit)
    except Exception:
        raise ValueError(f"'{unit}' is not a known unit") from None
    if target.startswith("rad") and "radian" not in str(registry.Quantity(1.0, found).to_root_units().units):
        raise ValueError(f"'{unit}' is not a unit of angle")
    try:
        return float(registry.Quantity(1.0, found).to(target).magnitude)
    except Exception:
        raise ValueError(f"'{unit}' cannot be converted to {target}") from None


Length = Annotated[float, Dimension("m", ("200 mm",), ("m", "mm", "um", "nm"))]
Angle = Annotated[float, Dimension("rad", ("15 deg",), ("deg", "rad", "mrad", "urad"))]
Power = Annotated[float, Dimension("W", ("15 mW",), ("W", "mW", "uW"))]
Frequency = Annotated[float, Dimension("Hz", ("20 kHz",), ("Hz", "kHz", "MHz"))]
Time = Annotated[float, Dimension("s", ("50 us",), ("s", "ms", "us", "ns"))]
Energy = Annotated[float, Dimension("J", ("0.2 uJ",), ("J", "mJ", "uJ", "nJ"))]
Current = Annotated[float, Dimension("A", ("5 nA",), ("A", "mA", "uA", "nA"))]
Responsivity = Annotated[float, Dimension("A/W", ("0.95 A/W",))]
CurrentNoise = Annotated[float, Dimension("A/rtHz", ("2 pA/rtHz",), ("pA/rtHz", "A/rtHz"))]
Electrons = Annotated[float, Dimension("electron", ("1000 electron",))]
ElectronRate = Annotated[float, Dimension("electron/s", ("2.5e7 electron/s",))]
ElectronsPerNumber = Annotated[float, Dimension("electron/DN", ("800 electron/DN",))]
Ratio = Annotated[float, Dimension("1", (0.5, "50 %", "-3 dB"))]
Temperature = Annotated[float, _Kelvins("K", ("5770 K",))]
TemperatureDifference = Annotated[float, _Kelvins("K", ("5 K",))]
TemperatureRate = Annotated[float, Dimension("K/s", ("2 K/h",), ("K/h", "K/min"))]
AnglePerKelvin = Annotated[float, Dimension("rad/K", ("15 urad/K",), ("urad/K",))]
RatioPerKelvin = Annotated[float, Dimension("K^-1", ("50 ppm/K",), ("ppm/K",))]
