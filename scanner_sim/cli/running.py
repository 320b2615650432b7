"""The verb ``run``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scanner_sim.cli.call import Call, files_of
from scanner_sim.cli.plan import plan, slow, sunlit
from scanner_sim.cli.tables import print_table
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.memory import check_memory
from scanner_sim.products.files.contents import RUN, SHOTS, TRACK
from scanner_sim.products.files.folder import ResultFolder, check_target
from scanner_sim.products.formats.writers import check_formats

if TYPE_CHECKING:
    from scanner_sim.products.image import RangeImage
    from scanner_sim.products.layers import LayeredResult
    from scanner_sim.products.shots import ShotTable
    from scanner_sim.tracking.record import Track


def run_scenario(call: Call, *, dry_run: bool) -> None:
    """Simulate a scenario into a folder, with everything that can be refused refused before the work.

    Raises
    ------
    ScannerSimError
        If the scenario, the folder or the device cannot be used, or the disk fails.
    """
    scenario = call.scenario()
    if dry_run:
        check_formats(scenario.output.formats)
        check_target(call.output, call.overwrite, _kind_and_work(scenario)[0])
        print_table(plan(scenario, call.output))
        return
    run_into_folder(scenario, call)


def run_into_folder(scenario: Scenario, call: Call) -> RangeImage | ShotTable | Track:
    """Simulate a scenario into the folder of a call, and return what is in it; faults as :func:`run_scenario`."""
    kind, work = _kind_and_work(scenario)
    check_formats(scenario.output.formats)
    check_memory(scenario)
    call.warn(slow(scenario))
    with call.claimed(kind):
        made = work(scenario, call)
    # Afterwards: the scene is loaded, and its files were read under their names.
    from scanner_sim.instrument.scene_warnings import scene_warnings

    said = getattr(made, "warnings", ())
    call.warn([one for one in scene_warnings(scenario, device=call.device) if one not in said])
    return made


def _kind_and_work(
    scenario: Scenario,
) -> tuple[ResultFolder, Callable[[Scenario, Call], RangeImage | ShotTable | Track]]:
    """Return what the folder of a scenario's result is, and what fills it."""
    from scanner_sim.cli.tracking import run_tracking

    if scenario.scan.layout == "visits":
        return TRACK, run_tracking
    return (RUN, _run_raster) if scenario.scan.layout == "image" else (SHOTS, _run_shots)


def _run_raster(scenario: Scenario, call: Call) -> RangeImage:
    # Loads the renderer: only after everything that can be refused without it.
    from scanner_sim.instrument.photograph import take_photo
    from scanner_sim.instrument.simulate import simulate
    from scanner_sim.instrument.simulate_signals import signal_parts
    from scanner_sim.products.files.run_folder import write_run

    camera = None
    with call.work("simulating", "voxels") as (advance, say):
        image = simulate(scenario, device=call.device, progress=advance)
        if scenario.output.pictures and sunlit(scenario):
            say("taking the photograph")
            camera = take_photo(scenario, device=call.device)
        say("writing")
        lines, waveforms = (
            signal_parts(scenario, name, device=call.device, progress=advance)
            for name in ("triangulation", "tof")
        )
        paths = write_run(
            image,
            call.output,
            scenario.output,
            camera=camera,
            lines=lines,
            waveforms=waveforms,
            overwrite=call.overwrite,
        )
    call.warn(image.warnings)
    if not call.quiet:
        print_table(closing(image, paths))
    return image


def _run_shots(scenario: Scenario, call: Call) -> ShotTable:
    from scanner_sim.instrument.photograph import take_photo
    from scanner_sim.instrument.shots import simulate_shots
    from scanner_sim.products.files.shots_folder import write_shots

    camera = None
    with call.work("simulating", "shots") as (advance, say):
        shots = simulate_shots(scenario, device=call.device, progress=advance)
        if scenario.output.pictures and sunlit(scenario):
            say("taking the photograph")
            camera = take_photo(scenario, device=call.device)
        say("writing")
        paths = write_shots(shots, call.output, scenario.output, camera=camera, overwrite=call.overwrite)
    call.warn(shots.warnings)
    if not call.quiet:
        print_table(closing_shots(shots, paths))
    return shots


def closing(image: RangeImage, paths: Sequence[Path]) -> dict[str, str]:
    """Return the summary of a run as pairs of a word and a phrase."""
    return {"voxels": f"{image.shape[0]} × {image.shape[1]}", **_closing(image, paths)}


def closing_shots(shots: ShotTable, paths: Sequence[Path]) -> dict[str, str]:
    """Return the summary of a scan without rows as pairs of a word and a phrase."""
    return {"shots": f"{len(shots):,} in {shots.time[-1]:.4g} s", **_closing(shots, paths)}


def _closing(image: LayeredResult, paths: Sequence[Path]) -> dict[str, str]:
    from scanner_sim.products.summary import share_beyond

    valid = image.valid
    rows = {
        "with a range": f"{np.count_nonzero(valid):,} ({100.0 * valid.mean():.4g} %)",
    }
    if valid.any():
        ranges, sigmas = image["range_m"][valid], image["sigma_range_m"][valid]
        rows["range"] = f"{np.median(ranges):.4g} m median, {ranges.min():.4g} m to {ranges.max():.4g} m"
        rows["σ of the range"] = f"{1e3 * float(np.median(sigmas)):.3g} mm median"
        if "sigma_texture_m" in image:
            uneven = image["sigma_texture_m"][valid] > np.sqrt(0.5) * sigmas
            rows["σ by uneven spots"] = f"more than noise in {100.0 * uneven.mean():.2g} % of the ranges"
    for way, name in (("time of flight", "tof."), ("both together", "fused.")):
        if "fused.range_m" in image and (image[f"{name}status"] == 0).any():
            sigma = np.nanmedian(image[f"{name}sigma_range_m"])
            rows[f"σ of {way}"] = f"{1e3 * float(sigma):.3g} mm median"
    for way, of in (("", ""), ("fused.", " of both together")):
        share = share_beyond(image, 5.0, way)
        if share is not None:
            rows[f"beyond 5 σ{of}"] = f"{100.0 * share:.2g} % of the ranges whose truth is known"
    for code in Status:
        count = np.count_nonzero(image["status"] == code)
        if count and code is not Status.VALID:
            rows[code.name.lower().replace("_", " ")] = f"{count:,} ({code.sentence})"
    return rows | files_of(paths)
