"""A scenario: everything that determines a result."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from scanner_sim.errors import Fault
from scanner_sim.parts import Count, Part
from scanner_sim.products.settings import Output
from scanner_sim.render.camera_settings import Camera
from scanner_sim.render.settings import Transport
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scanner import Scanner
from scanner_sim.scene.lighting import Lighting
from scanner_sim.scene.objects import Scene
from scanner_sim.signals.processing import MARGIN, Processing


class Scenario(Part):
    """Instrument, scene, scan and processing: the same scenario gives the same bytes.

    In a file every dimensional number has a unit; from Python plain numbers are SI.
    """

    schema_version: Literal[1] = Field(alias="schema", examples=[1])
    """Version of the scenario's form."""
    seed: Count = Field(default=0, ge=0, lt=2**63)
    """Seed of every random number."""
    scanner: Scanner = Scanner()
    """The instrument."""
    scene: Scene = Scene()
    """What stands before it."""
    lighting: Lighting = Lighting()
    """Sun and Earth; dark by default."""
    scan: RasterScan = Field(
        examples=[
            {
                "type": "raster",
                "rows": 256,
                "columns": 256,
                "horizontal": ["-15 deg", "15 deg"],
                "vertical": ["-15 deg", "15 deg"],
            }
        ]
    )
    """Where it points."""
    transport: Transport = Transport()
    """How light is followed."""
    processing: Processing = Processing()
    """How signals become ranges."""
    camera: Camera = Camera()
    """The video camera beside the scanner: what ``camera.png`` shows where the Sun shines."""
    output: Output = Output()
    """What is written."""

    def contradictions(self) -> Iterator[Fault]:
        """Yield angles beyond the mirrors, range gates beyond the array and estimators that find no room on it."""
        limit = self.scanner.mirrors.max_deflection
        for name, ends in (("horizontal", self.scan.horizontal), ("vertical", self.scan.vertical)):
            if max(abs(end) for end in ends) > limit:
                widest = math.degrees(max(ends, key=abs))
                yield Fault(
                    f"scan.{name}",
                    f"{widest:.6g} deg lies beyond the mirrors, which deflect by up to "
                    f"{math.degrees(limit):.6g} deg ({limit:g} rad) to both sides.",
                    "Narrow the scan, or raise scanner.mirrors.max_deflection.",
                )
        pixels, window = self.scanner.position_sensor.pixels, 2 * MARGIN[self.processing.peak] + 1
        if window > pixels:
            yield Fault(
                "processing.peak",
                f"{self.processing.peak} reads {window} pixels, and the array has {pixels}.",
                "Choose another estimator, or raise scanner.position_sensor.pixels.",
            )
        gate = self.processing.range_gate
        nearest, farthest = self.scanner.nearest_range, self.scanner.farthest_range
        if gate is not None and (gate[1] <= nearest or gate[0] >= farthest):
            beyond = f"{nearest:.4g} m " + ("or more" if math.isinf(farthest) else f"to {farthest:.4g} m")
            yield Fault(
                "processing.range_gate",
                f"[{gate[0]:g} m, {gate[1]:g} m] lies outside of the ranges that the array sees, {beyond}.",
                "Move the gate, or change receiver.baseline, receiver.focal_length or the position_sensor.",
            )
