"""All poses of a run that follows targets: the scanner's, and those of the video camera beside it."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

from scanner_sim.config import scenario_from_text
from scanner_sim.instrument.camera_poses import KeepFrame, camera_series
from scanner_sim.instrument.closed_loop.poses import poses_of
from scanner_sim.pose.beside import combined_series
from scanner_sim.pose.series import PoseSeries, relative_series
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.tracking.record import Track


def every_pose(
    track: Track,
    *,
    device: DeviceChoice = "auto",
    progress: Callable[[int, int], None] | None = None,
    keep: KeepFrame | None = None,
) -> tuple[PoseSeries, ...]:
    """Return the poses of a run by all methods of its scenario; for ``camera`` its frames are taken now.

    Parameters
    ----------
    track
        A run.
    device
        Where frames are computed.
    progress
        Called with the frames taken and the frames in all.
    keep
        Called with each frame and the dots in it, as :func:`~scanner_sim.instrument.camera_poses.camera_series` says.

    Returns
    -------
    tuple of PoseSeries
        The camera's, then those of :func:`~scanner_sim.instrument.closed_loop.poses.poses_of`, then those that both
        make together, then for each pair of arrays the second seen from the first by the camera.

    Raises
    ------
    InputError
        If the run's scenario cannot be read, or the device cannot be used.
    ScenarioError
        If the scene cannot be loaded.
    """
    scenario = scenario_from_text(track.scenario_yaml, name="scenario of the run", stored=True)
    if "camera" not in scenario.pose.methods:
        return poses_of(track)
    duration = scenario.following.duration
    seen = camera_series(scenario, duration, device=device, progress=progress, keep=keep)
    found = (*seen, *poses_of(track))
    between = (relative_series(a, b) for a, b in combinations(seen, 2))
    return (*found, *combined_series(found), *between)
