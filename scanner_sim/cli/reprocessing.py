"""The verb ``reprocess``."""

from __future__ import annotations

from pathlib import Path

from scanner_sim.cli.call import files_of
from scanner_sim.cli.options import beside
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import warn
from scanner_sim.cli.running import closing
from scanner_sim.cli.tables import print_table
from scanner_sim.config import resolved_yaml, scenario_warnings
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.memory import check_memory
from scanner_sim.products.files.contents import LINES, RUN, SIGNALS, WAVEFORMS
from scanner_sim.products.files.exchange import recover
from scanner_sim.products.files.folder import claim_folder, write_folder, write_text
from scanner_sim.products.provenance import versions
from scanner_sim.render.libraries import DeviceChoice


def reprocess_signals(
    folder: Path,
    overrides: list[str],
    output: Path | None,
    *,
    device: DeviceChoice,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Make other noise and ranges of the lines and waveforms that a run has kept.

    Raises
    ------
    ScannerSimError
        If the folder holds none, a value changes the light, or the result cannot be written.
    """
    from scanner_sim.instrument.reprocess import KeptSignals, Reprocessing
    from scanner_sim.products.files.run_folder import signal_writers, write_run

    recover(folder)
    kept = KeptSignals.find(folder)
    scenario = kept.changed(overrides)
    target = output or beside(folder, "_again")
    if target.resolve() == folder.resolve():
        raise InputError(
            f"{target} is the folder whose light is read.", remedy="Choose another folder with -o."
        )
    warnings = list(scenario_warnings(scenario))
    if any(dict(said.made_by) != versions() for said in kept.about.values()):
        warnings.append("the light was made by other versions of the programs: a run of now may differ")
    for sentence in () if quiet else warnings:
        warn(sentence)
    check_memory(scenario)
    kind = RUN if kept.whole else SIGNALS
    with claim_folder(target, overwrite, kind), progress_bar("processing", quiet, "voxels") as (advance, say):
        work = Reprocessing(kept, scenario, device=device)
        lines, waveforms = (work.parts(name) for name in ("triangulation", "tof"))
        if kept.whole:
            image = work.image(advance)
            say("writing")
            paths = write_run(
                image,
                target,
                scenario.output,
                lines=lines,
                waveforms=waveforms,
                overwrite=overwrite,
            )
            table = closing(image, paths)
        else:
            say("writing")
            text = resolved_yaml(scenario)
            writers = {"scenario.yaml": lambda path: write_text(path, text)}
            writers |= signal_writers({LINES: lines, WAVEFORMS: waveforms})
            paths = write_folder(target, kind, writers, overwrite=overwrite)
            table = files_of(paths) | {
                "left out": "range.exr, and what neighbours say of a voxel: isolated and mixed ones, σ by uneven "
                "light. They need every voxel: output.lines: all, with time of flight output.waveforms: all"
            }
    if not quiet:
        print_table(table)
