"""Units at the door: ``15 mW`` becomes 0.015, and inside everything is SI.

A unit is compulsory on every dimensional number of a file. From Python a plain number is SI already; a string
with a unit is understood there too. Decibels are power ratios. The parsing is done by pint, which is loaded
when the first quantity is read.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import PydanticCustomError, core_schema

FROM_FILE = {"units": "required"}
"""Validation context that makes units compulsory: pass it where the values come from a file."""

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
_ELECTRONS = re.compile(r"(?<![\w.])e-(?![\w.])")


@cache
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry()
    registry.define("photoelectron = [photoelectrons] = electron")
    registry.define("digital_number = [digital_numbers] = DN")
    return registry


@dataclass(frozen=True)
class Dimension:
    """A pydantic annotation: a float that is written with a unit in files.

    Parameters
    ----------
    unit
        SI unit of the value inside, in pint's spelling; ``1`` for ratios, which may be written as a plain
        number, in per cent or in decibels.
    example
        What a user would write; shown in error messages and in the JSON schema.
    """

    unit: str
    example: str

    def parse(self, text: str) -> float:
        """Return the SI value of ``text``.

        Raises
        ------
        ValueError
            With a sentence for the user, if the text is no number with a unit of this dimension.
        """
        match = _NUMBER.fullmatch(text)
        if match is None:
            raise ValueError(f"'{text}' is not a number with a unit")
        number, unit = float(match[1]), _ELECTRONS.sub("electron", match[2])
        if not math.isfinite(number):
            raise ValueError(f"'{text}' is not finite")
        if self.unit == "1":
            return _ratio(number, unit)
        if not unit:
            raise ValueError(f"'{text}' has no unit")
        return number * _scale(unit, self.unit)

    def format(self, value: float) -> str:
        """Return ``value`` as a file would spell it; parsing the text gives the same float."""
        if self.unit == "1":
            return repr(value)
        return f"{value!r} {self.unit}"

    def validate(self, value: object, info: ValidationInfo) -> float:
        if isinstance(value, str):
            try:
                return self.parse(value)
            except ValueError as error:
                raise PydanticCustomError(
                    "quantity", "{reason}; write for example {example}",
                    {"reason": str(error), "example": self.example},
                ) from None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise PydanticCustomError(
                "quantity", "this is not a number with a unit; write for example {example}",
                {"example": self.example},
            )
        required = isinstance(info.context, dict) and info.context.get("units") == "required"
        if required and self.unit != "1":
            raise PydanticCustomError(
                "unit_missing", "{value} has no unit; write for example {example}",
                {"value": repr(value), "example": self.example},
            )
        return float(value)

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
        text = {"type": "string", "examples": [self.example], "description": f"a quantity in {self.unit}"}
        if self.unit == "1":
            return {"anyOf": [{"type": "number"}, {**text, "description": "a ratio"}], "examples": [self.example]}
        return text


def _ratio(number: float, unit: str) -> float:
    """Return a dimensionless value from a plain number, per cent or decibels (power ratio)."""
    match unit:
        case "":
            return number
        case "%":
            return number / 100.0
        case "dB":
            return float(10.0 ** (number / 10.0))
        case "ppm":
            return number * 1e-6
    raise ValueError(f"'{unit}' is no unit of a ratio")


@cache
def _scale(unit: str, target: str) -> float:
    """Return how many ``target`` one ``unit`` is.

    Raises
    ------
    ValueError
        If the unit is unknown or of another dimension. An angle must name an angular unit: pint counts
        angles as dimensionless, so a bare ``%`` would pass.
    """
    registry = _registry()
    try:
        found = registry.parse_units(unit)
    except Exception:
        raise ValueError(f"'{unit}' is not a known unit") from None
    if target == "rad" and "radian" not in str(registry.Quantity(1.0, found).to_root_units().units):
        raise ValueError(f"'{unit}' is not a unit of angle")
    try:
        return float(registry.Quantity(1.0, found).to(target).magnitude)
    except Exception:
        raise ValueError(f"'{unit}' cannot be converted to {target}") from None


Length = Annotated[float, Dimension("m", "'200 mm'")]
Angle = Annotated[float, Dimension("rad", "'15 deg'")]
Power = Annotated[float, Dimension("W", "'15 mW'")]
Frequency = Annotated[float, Dimension("Hz", "'20 kHz'")]
Time = Annotated[float, Dimension("s", "'50 us'")]
Electrons = Annotated[float, Dimension("electron", "'1000 electron'")]
ElectronRate = Annotated[float, Dimension("electron/s", "'2.5e7 electron/s'")]
ElectronsPerNumber = Annotated[float, Dimension("electron/DN", "'800 electron/DN'")]
Ratio = Annotated[float, Dimension("1", "0.5, '50 %' or '-3 dB'")]
