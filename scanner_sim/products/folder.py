"""The output folder: written whole or not at all, and never over something that is not ours."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scanner_sim.errors import InputError, RunError
from scanner_sim.products.exr import write_exr
from scanner_sim.products.image import RangeImage
from scanner_sim.products.points import write_ply
from scanner_sim.products.settings import Output
from scanner_sim.products.summary import summary_json
from scanner_sim.products.waveforms import WaveformSet, write_waveforms

RESULT = "range.exr"
"""The file whose presence makes a folder a result."""

PICTURES = ("range.png", "shaded.png", "signal.png")

FILES = (RESULT, "scenario.yaml", "summary.json", *PICTURES, "points.ply")
"""Every file that a run in the dark may write."""

LIT_PICTURES = ("background.png", "camera.png")
"""Pictures that a run adds where the Sun shines."""

TIMED_PICTURES = ("tof.png",)
"""Pictures that a run adds with time of flight."""

WAVEFORMS = "waveforms.nc"
"""The waveforms of time of flight, where the scenario asks for some."""

Writers = Mapping[str, Callable[[Path], None]]
"""For each file its name, and what writes it to a path."""


@dataclass(frozen=True)
class Kind:
    """A kind of output folder: the file that marks it, and the names of all files that may be ours."""

    result: str
    files: tuple[str, ...]


RUN = Kind(RESULT, (*FILES, *TIMED_PICTURES, *LIT_PICTURES, WAVEFORMS))
"""The folder of a run."""

KEPT = "kept"
"""Where the files of the earlier result wait until all new ones are in place."""

_NO_SPACE = {errno.ENOSPC, errno.EDQUOT}


def planned_files(
    output: Output, *, lit: bool = False, ranging: Literal["triangulation", "tof", "both"] = "triangulation"
) -> tuple[str, ...]:
    """Return the names of the files that a run writes, in the order of presentation; ``lit`` under the Sun."""
    left_out = (() if output.pictures else PICTURES) + (() if output.points else ("points.ply",))
    added: tuple[str, ...] = ()
    if output.pictures:
        added = (() if ranging == "triangulation" else TIMED_PICTURES) + (LIT_PICTURES if lit else ())
        # The charge of the background is one on the line sensor.
        left_out += ("background.png",) if ranging == "tof" else ()
    added += () if output.waveforms == "none" else (WAVEFORMS,)
    return tuple(name for name in (*FILES, *added) if name not in left_out)


def check_target(folder: str | Path, overwrite: bool, kind: Kind = RUN) -> None:
    """Check before the work that its result can be written.

    Nothing is created.

    Raises
    ------
    InputError
        If ``folder`` holds a result and ``overwrite`` is not set, if it holds files of the user with the
        names of ours, if it is no folder, or if it cannot be written to.
    """
    folder = Path(folder)
    try:
        _check_content(folder, overwrite, kind)
        ground = folder
        while not ground.exists():
            ground = ground.parent
        if not ground.is_dir():
            raise InputError(f"{ground} is a file, not a folder.", remedy="Choose another folder with -o.")
        # Asking for permissions is not enough: a file system may be read-only, and root may do everything.
        with tempfile.TemporaryFile(dir=ground):
            pass
    except OSError as error:
        raise _unwritable(folder, error) from None


def write_run(
    image: RangeImage,
    folder: str | Path,
    output: Output | None = None,
    *,
    camera: NDArray[np.uint8] | None = None,
    waveforms: WaveformSet | None = None,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Write all files of a run, as :func:`write_folder` does.

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
    waveforms
        Records of time of flight for ``waveforms.nc``; None writes none.
    overwrite
        Replace an existing result.

    Returns
    -------
    tuple of Path
        The files written. ``background.png`` is among the pictures where there is background light.

    Raises
    ------
    InputError
        As :func:`check_target`.
    RunError
        If the disk is full or fails.
    """
    writers = _writers(image, output or Output(), camera, waveforms)
    return write_folder(folder, RUN, writers, overwrite=overwrite)


def write_folder(
    folder: str | Path, kind: Kind, writers: Writers, *, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write the files of an output folder.

    They are made in a hidden temporary folder beside ``folder`` (inside, where that exists) and moved when
    the last one is on the disk. On any failure, an interrupt included, ``folder`` is as it was before. Files that
    are not ours are never touched; those of an earlier result are all replaced or removed.

    Parameters
    ----------
    folder
        Where to write; made where it is missing, with its parents.
    kind
        What kind of folder it is.
    writers
        The files, in the order of presentation.
    overwrite
        Replace an existing result.

    Returns
    -------
    tuple of Path
        The files written.

    Raises
    ------
    InputError
        As :func:`check_target`.
    RunError
        If the disk is full or fails.
    """
    folder = Path(folder)
    check_target(folder, overwrite, kind)
    made: list[Path] = []
    workshop: Path | None = None
    try:
        made = _make_folders(folder.parent)
        new = not folder.exists()
        workshop = (folder.parent if new else folder) / f".{secrets.token_hex(4)}.partial"
        # Not tempfile.mkdtemp: the result shall have the permissions that any new folder gets.
        workshop.mkdir()
        for name, write in writers.items():
            write(workshop / name)
            _flush(workshop / name)
        if new:
            workshop.rename(folder)
            workshop = None
        else:
            _exchange(workshop, folder, kind, tuple(writers))
        _flush_folder(folder)
        made.clear()
    except OSError as error:
        raise _failure(folder, error) from None
    finally:
        # Old files that could not be put back must not be lost with the temporary folder.
        if workshop is not None and not os.path.lexists(workshop / KEPT):
            shutil.rmtree(workshop, ignore_errors=True)
        for parent in reversed(made):
            with contextlib.suppress(OSError):
                parent.rmdir()
    return tuple(folder / name for name in writers)


def write_text(path: Path, text: str) -> None:
    """Write a text as UTF-8, with the ends of its lines as they are."""
    path.write_bytes(text.encode())


def _writers(
    image: RangeImage, output: Output, camera: NDArray[np.uint8] | None, waveforms: WaveformSet | None
) -> Writers:
    """Return what writes the files of a run."""
    writers: dict[str, Callable[[Path], None]] = {
        RESULT: lambda path: write_exr(path, image, output.compression),
        "scenario.yaml": lambda path: write_text(path, image.scenario_yaml),
        "summary.json": lambda path: write_text(path, summary_json(image)),
        "points.ply": lambda path: write_ply(path, image),
    }
    if output.pictures:
        # Matplotlib takes longer to load than most runs take to write: only where pictures are wanted.
        from scanner_sim.products.pictures import PICTURES_OF, draw_background, lit
        from scanner_sim.products.style import save_grey
        from scanner_sim.products.waveform_picture import draw_grey

        writers |= {name: partial(draw, image) for name, draw in PICTURES_OF.items()}
        if lit(image):
            writers["background.png"] = lambda path: draw_background(image, path)
        if "tof.range_m" in image:
            writers["tof.png"] = lambda path: draw_grey(image, path)
        if camera is not None:
            writers["camera.png"] = lambda path: save_grey(camera, path)
    if waveforms is not None:
        writers[WAVEFORMS] = lambda path: write_waveforms(path, waveforms)
    ordered = planned_files(output, lit=True, ranging="both")
    return {name: writers[name] for name in ordered if name in writers}


def _exchange(workshop: Path, folder: Path, kind: Kind, names: tuple[str, ...]) -> None:
    """Put the new files in the place of the old ones; put the old ones back if that fails half-way."""
    kept = workshop / KEPT
    kept.mkdir()
    try:
        for name in kind.files:
            if os.path.lexists(folder / name):
                os.replace(folder / name, kept / name)
        for name in names:
            os.replace(workshop / name, folder / name)
    except BaseException:
        for name in names:
            if not os.path.lexists(workshop / name):
                os.replace(folder / name, workshop / name)
        for name in os.listdir(kept):
            os.replace(kept / name, folder / name)
        kept.rmdir()
        raise
    kept.rename(workshop / "replaced")


def _check_content(folder: Path, overwrite: bool, kind: Kind) -> None:
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError(f"{folder} is not a folder.", remedy="Choose another folder with -o.")
    present = [name for name in kind.files if os.path.lexists(folder / name)]
    if kind.result in present and not overwrite:
        raise InputError(
            f"{folder} already holds a result.", remedy="Choose another folder with -o, or add --overwrite."
        )
    if present and kind.result not in present:
        raise InputError(
            f"{folder} holds {', '.join(present)} but no {kind.result}: these are not ours to replace.",
            remedy="Choose another folder with -o.",
        )
    if folders := [name for name in present if (folder / name).is_dir()]:
        raise InputError(f"{folder / folders[0]} is a folder.", remedy="Choose another folder with -o.")


def _make_folders(folder: Path) -> list[Path]:
    """Make ``folder`` and its missing parents; return those that were made, outermost first."""
    missing: list[Path] = []
    while not folder.exists():
        missing.insert(0, folder)
        folder = folder.parent
    for path in missing:
        path.mkdir(exist_ok=True)
    return missing


def _flush(path: Path) -> None:
    with open(path, "rb+") as stream:
        os.fsync(stream.fileno())


def _flush_folder(folder: Path) -> None:
    """See the names of ``folder`` onto the disk, where the system can do that."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _unwritable(folder: Path, error: OSError) -> InputError | RunError:
    if error.errno in _NO_SPACE:
        return _failure(folder, error)
    return InputError(
        f"{folder} cannot be written to: {error.strerror}.", remedy="Choose another folder with -o."
    )


def _failure(folder: Path, error: OSError) -> InputError | RunError:
    if error.errno in _NO_SPACE:
        return RunError(
            f"The disk that holds {folder.absolute()} is full; nothing was written.",
            remedy="Make room, or choose another disk with -o.",
        )
    return RunError(f"{folder} could not be written: {error.strerror or error}; nothing was changed.")
