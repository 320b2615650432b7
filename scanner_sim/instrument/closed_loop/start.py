"""How a run begins: every target is looked for where the scenario expects it, or where a first frame shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.arithmetic import product
from scanner_sim.instrument.camera_poses import CameraPoses, camera_poses
from scanner_sim.instrument.closed_loop.saved_state import TrackerState, first_state
from scanner_sim.instrument.photograph import take_frames
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.status import PoseStatus
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.tracking.record import TrackTarget
from scanner_sim.tracking.state import pointed

Array = NDArray[np.float64]


def start_of(scenario: Scenario, device: DeviceChoice = "auto") -> TrackerState:
    """Return the state in which a run begins, with what is to be said of it.

    With ``scan.tracker.start: camera`` a frame is exposed first. The clock stands where it can be read, and the targets
    of the arrays whose pose it tells are looked for there, in patterns that reach three standard deviations of the
    pose. Other targets are looked for where they are expected.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used.
    """
    settings, targets = scenario.following.tracker, scenario.targets
    state = first_state(targets, settings)
    if settings.start == "expected":
        return state
    frame = take_frames(scenario, 1, device=device)
    tracks, said = list(state.tracks), []
    for pose in camera_poses(scenario, frame, arrays=scenario.arrays_followed):
        status = PoseStatus(int(pose.status[0]))
        if status is not PoseStatus.VALID:
            said.append(
                f"scan.tracker.start: the camera tells no pose of '{pose.name}' ({status.name}), whose targets are "
                "looked for where they are expected"
            )
            continue
        for number, target in enumerate(targets):
            if target.object == pose.name:
                place, covariance = _place(scenario, pose, target)
                time = float(pose.time[0])
                tracks[number] = replace(
                    pointed(place, settings, time, covariance=covariance), expected=target.expected
                )
    return replace(state, clock=float(frame.available_s[0]), tracks=tuple(tracks), said=tuple(said))


def _place(scenario: Scenario, pose: CameraPoses, target: TrackTarget) -> tuple[Array, Array]:
    """Return (Θ, φ, R) of a target by a pose of its array, shape (3,), and their covariance, shape (3, 3)."""
    arm = product(pose.rotation[0], target.centre[:, None])[:, 0]
    placed = (pose.position[0] + arm)[:, None]
    values, gradients = project(placed, scenario.scanner.mirrors.axis_separation, with_range=True)
    by_shift = gradients[..., 0].T
    rows = np.concatenate([by_shift, np.cross(arm, by_shift)], axis=1)
    return values[:, 0], product(rows, pose.covariance[0], rows.T)
