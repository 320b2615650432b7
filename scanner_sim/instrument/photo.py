"""The photograph beside a range image: what an ordinary video camera at the scanner sees of the same scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.render.camera import photograph
from scanner_sim.render.device import activate
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scene.files.loader import load_scene


@guest()
def take_photo(scenario: Scenario, *, device: DeviceChoice = "auto") -> NDArray[np.uint8]:
    """Return the picture of the scenario's video camera over the field of view of its scan.

    The surfaces reflect as they do at the laser's wavelength: few reflectances of the library are known in
    visible light. Surfaces without colour look alike in both; a dyed black anodise is too bright. Moving objects stand
    where they are at time 0.

    Parameters
    ----------
    scenario
        Scene, lighting, scan and camera.
    device
        Where to compute.

    Returns
    -------
    ndarray
        Grey levels 0 to 255, shape (rows, columns), uint8; black in the dark.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used.
    """
    activate(device)
    sky, scan = scenario.lighting.sky(), scenario.raster
    return photograph(
        load_scene(scenario.scene.resting_at(0.0)),
        scenario.camera,
        scan.horizontal,
        scan.vertical,
        sky.sun_direction,
        sky.sun_angular_radius,
        sky.earth_direction,
        sky.earth_altitude,
        sky.earth_radius,
        seed=scenario.seed,
    ).grey
