"""Scenarios that are measured as the lanes of one launch: what they may differ in, and the lanes of each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.device_streams import RunSeeds, device_seeds
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.settings import Output
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.files.loader import LoadedScene, Pose, device_poses
from scanner_sim.scene.motion import ConstantTwist

_UNMOVED = ConstantTwist(type="twist", velocity=(0.0, 0.0, 0.0), turn_rate=(0.0, 0.0, 0.0))


def takes_seeds(scenario: Scenario) -> bool:
    """Return whether runs of a scenario that differ in their seeds alone can be measured together."""
    return _one_by_one(scenario) is None


def need_one_light(scenario: Scenario) -> None:
    """Raise an InputError if runs of a scenario that differ in their seeds alone cannot be measured together."""
    if (fault := _one_by_one(scenario)) is not None:
        raise fault


def _one_by_one(scenario: Scenario) -> InputError | None:
    """Return why runs that differ in their seeds alone are measured one by one; None where they need not be.

    The light of Sun and Earth is drawn for all shots: its seed must be one that the scenario gives. A seed of the light
    makes the mirrors err alike in all runs, and lanes draw their own errors. They share the instrument, too, so that no
    seed may draw another one.
    """
    transport = scenario.transport
    if not scenario.lighting.sky().dark and transport.background_seed is None:
        return InputError(
            "runs of several seeds see the same light of Sun and Earth only where its seed is given.",
            remedy="Write transport.background_seed, or measure them one by one.",
        )
    if transport.light_seed is not None:
        return InputError(
            "with transport.light_seed the mirrors err alike in all runs, and not by each one's seed.",
            remedy="Leave transport.light_seed out, or measure them one by one.",
        )
    if own_instrument(scenario):
        return InputError(
            "each of several seeds draws an instrument or a vibration of its own.",
            remedy="Write scanner.as_built.seed and leave its vibration out, or measure them one by one.",
        )
    return None


def own_instrument(scenario: Scenario) -> bool:
    """Return whether the scenario's seed makes its instrument, or shakes it."""
    built = scenario.scanner.as_built
    return built is not None and ((built.seed is None and built.is_drawn) or built.vibration is not None)


def alike(one: Scenario, other: Scenario) -> bool:
    """Return whether two scenarios can be measured together.

    They differ in nothing but their seeds, the power of the laser, the files that they write, and, in the dark, in how
    objects move and stand that move in both. With a seed of the light they are measured alone: lanes err by their own.
    """
    return one.transport.light_seed is None and _common(one) == _common(other)


def _common(scenario: Scenario) -> Scenario:
    """Return what scenarios that are measured together have in common."""
    common = scenario.changed(
        seed=0 if takes_seeds(scenario) else scenario.seed,
        scanner={"laser": {"power": 0.0}},
        output=Output(truth=scenario.output.truth),
    )
    if not scenario.lighting.sky().dark:
        return common
    objects = tuple(
        item.in_own_frame().changed(motion=_UNMOVED) if item.moves else item
        for item in scenario.scene.objects
    )
    return common.changed(scene={"objects": objects})


def lanes_of(
    scenarios: Sequence[Scenario], loaded: LoadedScene, aim: Aim
) -> tuple[Aim, RunSeeds, tuple[Pose, ...]]:
    """Return the shots of an aim for each of some scenarios, one after the other, with their seeds and poses."""
    each = aim.repeated(len(scenarios))
    powers = tuple(scenario.scanner.laser.power for scenario in scenarios)
    own = device_seeds(np.array([scenario.seed for scenario in scenarios], dtype=np.uint64))
    seeds = RunSeeds.of(own, len(each.shot), powers if len(set(powers)) > 1 else None)
    moving = [[item for item in scenario.scene.objects if item.moves] for scenario in scenarios]
    if not loaded.bodies:
        return each, seeds, ()
    poses = [
        np.concatenate([item.pose_at(aim.time) for item in items]) for items in zip(*moving, strict=True)
    ]
    return each, seeds, device_poses(poses)
