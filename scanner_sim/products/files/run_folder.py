"""The folder of a raster scan: which files a run writes, and the writing of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.files.contents import CALIBRATION, LINES, RUN, WAVEFORMS, planned_files
from scanner_sim.products.files.exchange import Writers
from scanner_sim.products.files.exr import write_exr
from scanner_sim.products.files.folder import write_folder, write_text
from scanner_sim.products.files.signal_files import write_signals
from scanner_sim.products.formats.writers import format_writers
from scanner_sim.products.image import RangeImage
from scanner_sim.products.pictures.image import draw_picture, pictures_of
from scanner_sim.products.pictures.style import save_grey
from scanner_sim.products.points import write_ply
from scanner_sim.products.settings import Output
from scanner_sim.products.signal_set import SignalSet
from scanner_sim.products.summary import summary_json


def write_run(
    image: RangeImage,
    folder: str | Path,
    output: Output | None = None,
    *,
    camera: NDArray[np.uint8] | None = None,
    lines: Iterable[SignalSet] | None = None,
    waveforms: Iterable[SignalSet] | None = None,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Write all files of a run, as :func:`~scanner_sim.products.files.folder.write_folder` does.

    Parameters
    ----------
    image
        The result.
    folder
        Where to write; made where it is missing, with its parents.
    output
        Which files; by default all.
    camera
        Grey levels of what a video camera sees, shape (rows, columns), for ``camera.png``; None writes none.
    lines, waveforms
        Parts of ``lines.parquet`` and of ``waveforms.parquet``, each written as it comes; None writes none.
    overwrite
        Replace an existing result.

    Returns
    -------
    tuple of Path
        The files written. ``background.png`` is among the pictures where there is background light.

    Raises
    ------
    InputError
        As :func:`~scanner_sim.products.files.folder.check_target`.
    RunError
        If the disk is full or fails.
    """
    writers = _writers(image, output or Output(), camera, {LINES: lines, WAVEFORMS: waveforms})
    return write_folder(folder, RUN, writers, overwrite=overwrite)


def _writers(
    image: RangeImage,
    output: Output,
    camera: NDArray[np.uint8] | None,
    signals: Mapping[str, Iterable[SignalSet] | None],
) -> Writers:
    """Return what writes the files of a run."""
    writers: dict[str, Callable[[Path], None]] = {
        RUN.result: lambda path: write_exr(path, image, output.compression),
        "scenario.yaml": lambda path: write_text(path, image.scenario_yaml),
        "summary.json": lambda path: write_text(path, summary_json(image)),
    }
    if image.calibration_yaml:
        writers[CALIBRATION] = lambda path: write_text(path, image.calibration_yaml)
    if all(name in image for name in ("P.X", "P.Y", "P.Z")):
        writers["points.ply"] = lambda path: write_ply(path, image)
    if output.pictures:
        writers |= {name: partial(draw_picture, image, name) for name in pictures_of(image)}
        if camera is not None:
            writers["camera.png"] = lambda path: save_grey(camera, path)
    writers |= {**format_writers(image, output.formats), **signal_writers(signals)}
    ordered = planned_files(output, lit=True, rangefinders=("triangulation", "tof"), calibrated=True)
    return {name: writers[name] for name in ordered if name in writers}


def signal_writers(signals: Mapping[str, Iterable[SignalSet] | None]) -> Writers:
    """Return what writes lines and waveforms, by the names of their files; None stands for none."""
    return {name: partial(write_signals, parts=parts) for name, parts in signals.items() if parts is not None}
