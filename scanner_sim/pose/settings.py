"""How poses come out of tracks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Part
from scanner_sim.pose.weights import Method

MOST_FRAMES = 300
"""Frames of the video camera beside a track: each takes about as long to render as a second of tracking."""


class PoseSettings(Part):
    """Poses of the objects of which at least three targets are tracked."""

    methods: tuple[Literal["uv", "xyz", "joint", "camera"], ...] = Field(
        default=("uv", "xyz", "joint"), examples=[["joint"]]
    )
    """``uv``: from angles (eq 16); ``xyz``: from points (eq 11); ``joint``: from angles and ranges by their covariance;
    ``camera``: from the dots in the video camera's frames, of the arrays that are followed. None: no poses."""
    robust: Literal["none", "huber", "ransac"] = "none"
    """What survives wrong targets: ``huber`` counts doubtful ones less, ``ransac`` leaves out those that agree with no
    common pose."""

    @property
    def by_scanner(self) -> tuple[Method, ...]:
        """The methods that need the scanner's targets."""
        return tuple(method for method in self.methods if method != "camera")

    def cross_checks(self) -> Iterator[Fault]:
        """Yield methods that are named twice."""
        for method in dict.fromkeys(self.methods):
            if self.methods.count(method) > 1:
                yield Fault("methods", f"{method} is named twice.", "Name each method once.")
