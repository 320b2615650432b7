"""Doubts about a scene that only its files and surfaces tell: meshes, and objects that stand in one another."""

from __future__ import annotations

from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.mesh_sizes import mesh_warnings
from scanner_sim.render.device import activate
from scanner_sim.render.guest import guest
from scanner_sim.render.interpenetration import interpenetrations
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.visible import unknown_visible


@guest()
def scene_warnings(scenario: Scenario, *, device: DeviceChoice = "auto") -> tuple[str, ...]:
    """Return what is to be said of a scenario's meshes, and a sentence for each two objects that stand in one another.

    Of meshes: what of their files was left out, mended or assumed, and sizes that hint at another unit of length.
    Of materials that the video camera sees: whether nobody said what they reflect in visible light.
    What moves is looked at when the scan begins, in its middle and at its end. Objects that touch are no doubt.

    Parameters
    ----------
    scenario
        The scene, and the scan that takes its time.
    device
        Where to compute.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used.
    """
    activate(device)
    loaded, duration = load_scene(scenario.scene), scenario.scan.scan_time(scenario.scan_setup)
    unseen = loaded.unknown_visible if scenario.photographed else ()
    times = (0.0, 0.5 * duration, duration) if loaded.bodies else (0.0,)
    said = (*mesh_warnings(scenario, loaded), *(f"scene: {unknown_visible(name)}" for name in unseen))
    return said + tuple(
        f"scene: '{one.objects[0]}' and '{one.objects[1]}' stand in one another by about {one.depth:.2g} m"
        + (f" at {one.time:.3g} s" if len(times) > 1 else "")
        + ", as no solid bodies do"
        for one in interpenetrations(loaded, times)
    )
