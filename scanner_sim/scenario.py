"""A scenario: everything that determines a result."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from scanner_sim.parts import Part
from scanner_sim.products.settings import Output
from scanner_sim.render.settings import Transport
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scanner import Scanner
from scanner_sim.scene.objects import Scene
from scanner_sim.signals.processing import Processing


class Scenario(Part):
    """Instrument, scene, scan and processing: the same scenario gives the same bytes.

    In a file every dimensional number has a unit; from Python plain numbers are SI.
    """

    schema_version: Literal[1] = Field(alias="schema")
    """Version of the scenario's form."""
    seed: int = Field(default=0, ge=0, lt=2**63)
    """Seed of every random number."""
    scanner: Scanner = Scanner()
    """The instrument."""
    scene: Scene = Scene()
    """What stands before it."""
    scan: RasterScan
    """Where it points."""
    transport: Transport = Transport()
    """How light is followed."""
    processing: Processing = Processing()
    """How signals become ranges."""
    output: Output = Output()
    """What is written."""

    @model_validator(mode="after")
    def _deflections_are_reached(self) -> Self:
        limit = self.scanner.mirrors.max_deflection
        for name, ends in (("horizontal", self.scan.horizontal), ("vertical", self.scan.vertical)):
            if max(abs(end) for end in ends) > limit:
                raise PydanticCustomError(
                    "deflection",
                    "scan.{name} exceeds the mirrors' largest deflection of {limit} rad "
                    "(scanner.mirrors.max_deflection)",
                    {"name": name, "limit": limit},
                )
        return self

    @model_validator(mode="after")
    def _gate_is_seen(self) -> Self:
        gate = self.processing.range_gate
        nearest, farthest = self.scanner.nearest_range, self.scanner.farthest_range
        if gate is not None and (gate[1] <= nearest or gate[0] >= farthest):
            raise PydanticCustomError(
                "range_gate",
                "processing.range_gate [{near} m, {far} m] lies outside of the ranges that the array sees, "
                "{nearest} m to {farthest} m",
                {"near": gate[0], "far": gate[1], "nearest": nearest, "farthest": farthest},
            )
        return self
