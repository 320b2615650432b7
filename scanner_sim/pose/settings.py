"""How poses come out of tracks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Part


class PoseSettings(Part):
    """Poses of the objects of which at least three targets are tracked."""

    methods: tuple[Literal["uv", "xyz", "joint"], ...] = Field(
        default=("uv", "xyz", "joint"), examples=[["joint"]]
    )
    """``uv``: from angles (eq 16); ``xyz``: from points (eq 11); ``joint``: from angles and ranges by their covariance.
    None: no poses."""
    robust: Literal["none", "huber", "ransac"] = "none"
    """What survives wrong targets: ``huber`` counts doubtful ones less, ``ransac`` leaves out those that agree with no
    common pose."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield methods that are named twice."""
        for method in dict.fromkeys(self.methods):
            if self.methods.count(method) > 1:
                yield Fault("methods", f"{method} is named twice.", "Name each method once.")
