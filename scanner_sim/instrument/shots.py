"""From a scenario whose scan has no rows to a table of its shots."""

from __future__ import annotations

import numpy as np

from scanner_sim.config import resolved_yaml
from scanner_sim.config.calibration import believed_geometry, believed_text
from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.common_errors import ReadingsOfTheta, add_common_errors
from scanner_sim.instrument.memory import BATCH
from scanner_sim.instrument.mesh_sizes import mesh_warnings
from scanner_sim.instrument.simulate import Progress, measure_scans, result_warnings, true_poses
from scanner_sim.products.shots import ShotTable
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice


@guest()
def simulate_shots(
    scenario: Scenario,
    *,
    device: DeviceChoice = "auto",
    progress: Progress | None = None,
    batch: int = BATCH,
    threads: int | None = None,
) -> ShotTable:
    """Simulate any scan whose aims are known beforehand: a Lissajous figure, a spiral, angles from a file, a raster.

    Each shot is judged on its own. What a raster's image adds by comparing neighbours (isolated and mixed voxels, σ by
    uneven light) is left out; a raster is better simulated by :func:`~scanner_sim.instrument.simulate.simulate`.

    Parameters
    ----------
    scenario, device, progress, batch, threads
        As of :func:`~scanner_sim.instrument.simulate.simulate`.

    Returns
    -------
    ShotTable
        In the order of the shots' numbers, which is that of time.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used, ``batch`` is not positive, the memory that is free does not hold the result, or
        the scenario follows targets.
    """
    (layers,), loaded = measure_scans(
        [scenario], device=device, progress=progress, batch=batch, threads=threads
    )
    believed, derived = believed_geometry(scenario), scenario.output.jacobian
    scan, setup = scenario.open_scan, scenario.scan_setup
    columns = np.empty((3, scan.shots))
    for aim in scan.aims(setup, scan.shots):
        columns[:, aim.shot] = aim.time, aim.theta, aim.phi
    readings = ReadingsOfTheta(scenario.scanner.mirrors, columns[1], columns[0])
    add_common_errors(layers, scenario.rangefinders, believed, readings, jacobian=derived)
    return ShotTable(
        channels=layers,
        time=columns[0],
        theta=columns[1],
        phi=columns[2],
        objects=loaded.object_labels.names,
        materials=loaded.material_labels.names,
        seed=scenario.seed,
        scenario_yaml=resolved_yaml(scenario),
        poses=true_poses(scenario),
        calibration_yaml=believed_text(scenario, believed),
        warnings=(*mesh_warnings(scenario, loaded), *result_warnings(layers)),
    )
