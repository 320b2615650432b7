"""What an instrument asks of a rangefinder: one way from the light of shots to their ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from scanner_sim.foundation.channels import Channel
from scanner_sim.ranging.ranges import Deflections, Layers, Ranges
from scanner_sim.render.background.panorama import Panorama
from scanner_sim.render.background.view import Rows
from scanner_sim.render.beam.light import Truth
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scan.protocol import Aim

SIGMA_Y = Channel("sigma_Y", "electron", "standard deviation of Y by all but speckle", "signal")
LIGHT = ("Y", SIGMA_Y.name)
"""Layers that every rangefinder fills beside its ranges: the light of its shots and σ of it."""


@dataclass(frozen=True)
class Reading:
    """What a rangefinder read of n shots: what their chief rays meet, their ranges, and its own layers."""

    truth: Truth
    ranges: Ranges
    layers: Layers


class Rangefinder(Protocol):
    """A way of ranging, with its detector, its background, its estimator and its channels."""

    @property
    def prefix(self) -> str:
        """Begin of the names of its channels, such as ``tof.``."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What it fills that images do not know."""

    @property
    def sight(self) -> tuple[OpticalLayout, tuple[float, float]]:
        """Optics whose pixels are the bins of its background, and least and largest angle less Θ that it sees [rad]."""

    def panorama_of(self, rows: Rows) -> Panorama:
        """Return what it sees of Sun and Earth in some rows."""

    def measure(
        self, aim: Aim, shots: Shots, deflections: Deflections, background: Panorama | None = None
    ) -> Reading:
        """Return what it reads of n shots.

        Parameters
        ----------
        aim
            The commanded shots.
        shots
            The shots as they are fired, which the light follows and the estimator does not know.
        deflections
            What the encoders read.
        background
            What Sun and Earth make of all that it sees, where it is not that of the scenario's scan.
        """
