"""From a scenario to a range image, batch by batch; and one voxel."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config import resolved_yaml
from scanner_sim.config.calibration import believed_geometry, believed_text
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.channels import CHANNEL
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.common_errors import ReadingsOfTheta, add_common_errors
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.lit_aims import lit_aims
from scanner_sim.instrument.memory import BATCH, check_shots
from scanner_sim.instrument.mesh_sizes import mesh_warnings
from scanner_sim.instrument.neighbourhood import judge_neighbours
from scanner_sim.instrument.simulate_signals import voxel_shots
from scanner_sim.instrument.together import alike
from scanner_sim.instrument.voxel_records import voxel_record
from scanner_sim.products.files.contents import RUN
from scanner_sim.products.files.folder import check_target
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.image import RangeImage
from scanner_sim.products.true_poses import TruePoses
from scanner_sim.products.voxel import VoxelRecord
from scanner_sim.ranging.ranges import Layers
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.raster import raster_aim
from scanner_sim.scene.files.loader import LoadedScene

Progress = Callable[[int, int], None]
"""Called with the shots done and the shots in all."""


@guest()
def simulate(
    scenario: Scenario,
    *,
    device: DeviceChoice = "auto",
    progress: Progress | None = None,
    batch: int = BATCH,
    threads: int | None = None,
) -> RangeImage:
    """Simulate a raster scan.

    Parameters
    ----------
    scenario
        Instrument, scene, scan and processing.
    device
        Where to compute.
    progress
        Called after each batch.
    batch
        Shots per batch; the result does not depend on it.
    threads
        Threads of the processor; the result does not depend on it.

    Returns
    -------
    RangeImage

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used, ``batch`` is not positive, or the memory that is free does not hold the result.
    """
    (layers,), loaded = measure_scans(
        [scenario], device=device, progress=progress, batch=batch, threads=threads
    )
    names = loaded.object_labels.names, loaded.material_labels.names
    return image_of(scenario, layers, *names, said=mesh_warnings(scenario, loaded))


def simulate_many(
    scenarios: Iterable[Scenario],
    folder: str | Path | None = None,
    layers: Sequence[str] | None = None,
    *,
    overwrite: bool = False,
    device: DeviceChoice = "auto",
    batch: int = BATCH,
    threads: int | None = None,
) -> Iterator[RangeImage]:
    """Simulate raster scans one after the other, and those together that are alike.

    Alike are scenarios that differ in nothing but ``seed``, ``scanner.laser.power``, ``output`` (but for
    ``output.truth``), and, in the dark, in position, rotation and motion of objects that have a ``motion`` in all of
    them (one of no speed will do). Under Sun or Earth their seeds may differ where ``transport.background_seed`` is
    given: they see the same light then. An instrument that the seed draws must be the same, and with a
    ``transport.light_seed`` each is measured alone.
    Many small images cost little more than their shots: each is, to the last bit, what :func:`simulate` makes of its
    scenario alone.

    Parameters
    ----------
    scenarios
        The scenarios, those that are alike next to one another. They are taken as they are needed.
    folder
        Where each image is written before it is yielded, in a folder of its own: ``000000``, ``000001`` and so on, with
        the files that its scenario's ``output`` asks for, but photographs and waveforms. None writes nothing.
    layers
        Names of the layers that the images keep, beside ``status``; None keeps all. Files without a layer are smaller,
        and those that need it are left out: ``points.ply`` the points, a picture its layer.
    overwrite
        Replace results that stand in ``folder`` already.
    device, threads
        As of :func:`simulate`.
    batch
        Shots per batch, and of all scenarios that are measured together; the result does not depend on it.

    Yields
    ------
    RangeImage
        In the order of the scenarios.

    Raises
    ------
    ScenarioError, InputError, RunError
        As :func:`simulate` and :func:`~scanner_sim.products.files.run_folder.write_run`, when the scenario's turn
        comes; InputError too if an image has no such layer.
    """

    def target(number: int) -> Path:
        return Path(folder or "", f"{number:06d}")

    def taken() -> Iterator[Scenario]:
        for number, scenario in enumerate(scenarios):
            if folder is not None:
                check_target(target(number), overwrite, RUN)
            yield scenario

    for number, (scenario, image) in enumerate(_images(taken(), device, batch, threads)):
        found = image if layers is None else image.keeping(layers)
        if folder is not None:
            write_run(found, target(number), scenario.output, overwrite=overwrite)
        yield found


def _images(
    scenarios: Iterable[Scenario], device: DeviceChoice, batch: int, threads: int | None
) -> Iterator[tuple[Scenario, RangeImage]]:
    """Yield the image of each scenario, in their order; those that are alike are simulated together."""
    waiting: list[Scenario] = []
    for scenario in chain(scenarios, [None]):
        if waiting and (scenario is None or not _go_together(waiting, scenario, batch)):
            yield from zip(waiting, _simulate_alike(waiting, device, batch, threads), strict=True)
            waiting = []
        if scenario is not None:
            waiting.append(scenario)


def _go_together(waiting: Sequence[Scenario], scenario: Scenario, batch: int) -> bool:
    """Return whether a scenario can be measured with those that wait, which are alike."""
    first = waiting[0]
    return (len(waiting) + 1) * first.raster.shots <= batch and alike(first, scenario)


@guest()
def _simulate_alike(
    scenarios: Sequence[Scenario], device: DeviceChoice, batch: int, threads: int | None
) -> list[RangeImage]:
    """Return the images of scenarios that are alike."""
    found, loaded = measure_scans(scenarios, device=device, progress=None, batch=batch, threads=threads)
    names = loaded.object_labels.names, loaded.material_labels.names
    return [
        image_of(scenario, layers, *names, said=mesh_warnings(scenario, loaded))
        for scenario, layers in zip(scenarios, found, strict=True)
    ]


def image_of(
    scenario: Scenario,
    layers: Layers,
    objects: tuple[str, ...],
    materials: tuple[str, ...],
    said: tuple[str, ...] = (),
) -> RangeImage:
    """Return the image of a scenario's raster from the layers of its shots, with the names of what stands there.

    ``said`` are warnings about the scene.
    """
    scan = scenario.raster
    theta, phi = scan.angles()
    channels = {name: values.reshape(scan.rows, scan.columns) for name, values in layers.items()}
    judge_neighbours(scenario, channels, np.arange(scan.rows), np.arange(scan.columns))
    believed, derived = believed_geometry(scenario), scenario.output.jacobian
    aim = raster_aim(scan, np.arange(scan.shots, dtype=np.uint32), scenario.scanner.dwell)
    readings = ReadingsOfTheta(scenario.scanner.mirrors, aim.theta, aim.time)
    add_common_errors(channels, scenario.rangefinders, believed, readings, jacobian=derived)
    return RangeImage(
        channels=channels,
        theta=theta,
        phi=phi,
        objects=objects,
        materials=materials,
        seed=scenario.seed,
        scenario_yaml=resolved_yaml(scenario),
        poses=true_poses(scenario),
        calibration_yaml=believed_text(scenario, believed),
        warnings=(*said, *result_warnings(channels)),
    )


def measure_scans(
    scenarios: Sequence[Scenario],
    *,
    device: DeviceChoice,
    progress: Progress | None,
    batch: int,
    threads: int | None,
) -> tuple[list[Layers], LoadedScene]:
    """Measure all shots of scans that are known beforehand, and of scenarios that are alike.

    Returns
    -------
    tuple
        Layers of each scan, of shape (shots,), whose σ are of noise alone, and the loaded scene.

    Notes
    -----
    Other arguments and faults are those of :func:`simulate`.
    """
    scenario, runs = scenarios[0], len(scenarios)
    if batch < 1:
        raise InputError("a batch needs at least one shot.")
    check_shots(scenario, batch)
    instrument, shots, done = (
        Instrument(scenario, device=device, threads=threads),
        scenario.open_scan.shots,
        0,
    )
    layers: Layers = {}
    for aim, backgrounds in lit_aims(instrument, max(batch // runs, 1)):
        if runs == 1:
            samples = instrument.measure(aim, backgrounds=backgrounds, noise_alone=True)
        else:
            samples = instrument.measure_together(aim, scenarios, backgrounds=backgrounds)
        for name in [name for name in samples if name in CHANNEL]:
            if name not in layers:
                layers[name] = np.empty((runs, shots), dtype=np.float32)
            layers[name][:, aim.shot] = samples[name].reshape(runs, -1)
        done += len(aim.shot)
        if progress is not None:
            progress(done, shots)
    return [{name: values[run] for name, values in layers.items()} for run in range(runs)], instrument.loaded


@guest()
def simulate_voxel(
    scenario: Scenario, row: int, column: int, *, device: DeviceChoice = "auto"
) -> VoxelRecord:
    """Simulate one voxel of a raster scan and keep its line: the same numbers as in the whole image.

    Raises
    ------
    InputError
        If the raster has no such voxel, or the scenario no line sensor.
    """
    if "triangulation" not in scenario.rangefinders:
        raise InputError("time of flight reads no line.", remedy="Ask for the waveform instead.")
    voxel_shots(scenario, [(row, column)])
    instrument = Instrument(scenario, device=device)
    return voxel_record(instrument, row, column)


def true_poses(scenario: Scenario) -> TruePoses | None:
    """Return where the objects stand when the scan begins and ends, if the scenario asks for it."""
    if "pose" not in scenario.output.truth:
        return None
    ends = (0.0, scenario.open_scan.scan_time(scenario.scan_setup))
    return TruePoses(ends, {item.name: item.pose_at(np.array(ends)) for item in scenario.scene.objects})


def result_warnings(layers: dict[str, NDArray[np.float32]]) -> tuple[str, ...]:
    """Return sentences on results that look unintended."""
    if not layers["truth.object"].any():
        return ("nothing was hit: no object stands where the scanner points",)
    if not (layers["status"] == Status.VALID).any():
        return ("no voxel has a valid range: see the counts of status",)
    return ()
