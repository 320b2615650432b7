"""The methods that an approach compares: what each asks of the scenario, and whose pose of the result is its."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

from scanner_sim.config.scanner import RangefinderName
from scanner_sim.pose.weights import Method as PoseMethod

MethodName = Literal["uv", "xyz", "joint", "xyz_tof", "joint_tof"]


class Method(NamedTuple):
    """A way to a pose: its name, what it is in words, the ranging of its runs and how their poses are estimated."""

    name: MethodName
    words: str
    ranging: RangefinderName
    pose: PoseMethod


METHODS: Final[dict[MethodName, Method]] = {
    method.name: method
    for method in (
        Method("uv", "angles", "triangulation", "uv"),
        Method("xyz", "points, triangulation", "triangulation", "xyz"),
        Method("joint", "joint, triangulation", "triangulation", "joint"),
        Method("xyz_tof", "points, time of flight", "tof", "xyz"),
        Method("joint_tof", "joint, time of flight", "tof", "joint"),
    )
}
"""Methods by name. Those of one ranging are estimated of the same tracks."""
