"""The methods that an approach compares: what each asks of the scenario, and whose pose of the result is its."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

from scanner_sim.config.scanner import RangefinderName
from scanner_sim.pose.series import SeriesMethod

MethodName = Literal["camera", "uv", "xyz", "joint", "xyz_tof", "joint_tof"]


class Method(NamedTuple):
    """A way to a pose: its name, what it is in words, the ranging of its runs and how their poses are estimated."""

    name: MethodName
    words: str
    ranging: RangefinderName
    pose: SeriesMethod


METHODS: Final[dict[MethodName, Method]] = {
    method.name: method
    for method in (
        Method("camera", "dots, video camera", "triangulation", "camera"),
        Method("uv", "angles", "triangulation", "uv"),
        Method("xyz", "points, triangulation", "triangulation", "xyz"),
        Method("joint", "joint, triangulation", "triangulation", "joint"),
        Method("xyz_tof", "points, time of flight", "tof", "xyz"),
        Method("joint_tof", "joint, time of flight", "tof", "joint"),
    )
}
"""Methods by name. Those of one ranging are estimated of the same tracks; the camera's frame is taken beside them."""
