"""Range images as OpenEXR files: float32 scan lines, with a header that explains itself.

The header holds strings and other standard attributes only, so that ``exrheader``, ``oiiotool`` and Blender
show them. It has no date, host, user or path: the same image gives the same bytes.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNEL, JACOBIAN
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import open_ordinary
from scanner_sim.foundation.status import legend
from scanner_sim.products.files.exr_form import MAGIC, ForeignError, check_form
from scanner_sim.products.image import RangeImage
from scanner_sim.products.layers import numbered
from scanner_sim.products.provenance import software
from scanner_sim.products.true_poses import TruePoses

Compression = Literal["none", "rle", "zips", "zip", "piz"]

PREFIX = "scannerSim."
"""Begin of the names of our own attributes."""

LARGEST = 1 << 36
"""Bytes of a file: more than the largest raster has in all its layers."""

_LARGEST_NUMBER = 1 << 20
"""Number of an object or a material beyond which a legend is damaged."""

_THREADS = min(os.cpu_count() or 1, 8)


def write_exr(path: str | Path, image: RangeImage, compression: Compression = "rle") -> None:
    """Write a range image; an existing file is overwritten.

    Parameters
    ----------
    path
        The file.
    image
        What to write.
    compression
        Lossless compression of the scan lines; programs that read OpenEXR know them all. Of a 512 × 512 image ``rle``
        takes 0.08 s to write and 79 % of the size of the numbers, ``zip`` 0.32 s and 53 %, ``piz`` 0.55 s and 51 %.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    kind = getattr(
        OpenEXR, "NO_COMPRESSION" if compression == "none" else f"{compression.upper()}_COMPRESSION"
    )
    header = {
        "type": OpenEXR.scanlineimage,
        "compression": kind,
        "lineOrder": OpenEXR.INCREASING_Y,
        **_attributes(image),
    }
    file = OpenEXR.File(header, dict(image.channels))
    # Through a stream of Python, a full disk is the operating system's error and not a text of the library.
    with _all_cores(OpenEXR), open(path, "wb") as stream:
        file.write(stream)


def read_range_image(path: str | Path) -> RangeImage:
    """Read a range image that :func:`write_exr` wrote.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    RangeImage
        All that was written. Channels unknown to this version are left out, and a warning says so.

    Raises
    ------
    InputError
        If the file is missing, broken, no OpenEXR file or not one of ours.
    """
    _check(Path(path))
    try:
        with _all_cores(OpenEXR), _library_is_quiet():
            file = OpenEXR.File(str(path), separate_channels=True)
            header, layers = file.header(), {name: part.pixels for name, part in file.channels().items()}
    except (RuntimeError, ValueError, TypeError, MemoryError):
        raise InputError(
            f"{path} is a broken or incomplete OpenEXR file.", remedy="Run the scenario again."
        ) from None
    if f"{PREFIX}seed" not in header:
        raise InputError(
            f"{path} is an OpenEXR file, but no range image of this program.",
            remedy="Give the range.exr of an output folder; other programs drop its header when they save.",
        )
    try:
        return _image(header, layers)
    except (LookupError, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(
            f"The header of {path} is damaged ({error}).", remedy="Run the scenario again to replace it."
        ) from None


def _check(path: Path) -> None:
    """Refuse what is not an ordinary file with the form of a range image."""
    with open_ordinary(path, LARGEST) as (stream, size):
        if stream.read(len(MAGIC)) != MAGIC:
            raise InputError(
                f"{path} is not an OpenEXR file.", remedy="Give the range.exr of an output folder."
            )
        stream.seek(0)
        try:
            check_form(stream, size)
        except ForeignError as error:
            raise InputError(
                f"{path} is an OpenEXR file, but no range image of this program: {error}.",
                remedy="Give the range.exr of an output folder.",
            ) from None
        except ValueError as error:
            raise InputError(
                f"{path} is a broken or incomplete OpenEXR file: {error}.", remedy="Run the scenario again."
            ) from None


def _attributes(image: RangeImage) -> dict[str, Any]:
    """Return the header's own attributes, by name, in a fixed order."""
    attributes: dict[str, Any] = {
        "owner": "Scanner Sim",
        "software": software(image.made_by),
        "comments": (
            "Range image of a simulated laser scanner. Units and meanings stand in unit.* and meaning.*, "
            "the names behind numbers in legend.*; NaN marks voxels without a range. Frame: x to the right, "
            "y down, z away from the scanner, which stands at the origin."
        ),
        f"{PREFIX}scenario": image.scenario_yaml,
        f"{PREFIX}seed": str(image.seed),
        f"{PREFIX}warnings": json.dumps(image.warnings, ensure_ascii=False),
        f"{PREFIX}theta": np.array([image.theta[0], image.theta[-1]]),
        f"{PREFIX}phi": np.array([image.phi[0], image.phi[-1]]),
    }
    attributes |= {f"{PREFIX}version.{program}": number for program, number in image.made_by.items()}
    if image.poses is not None:
        attributes[f"{PREFIX}poses"] = json.dumps(image.poses.plain())
    if image.calibration_yaml:
        attributes[f"{PREFIX}calibration"] = image.calibration_yaml
    for name in image.channels:
        attributes[f"unit.{name}"] = CHANNEL[name].unit
        # Derivatives have names that are too long for more than one attribute each.
        if JACOBIAN not in name:
            attributes[f"meaning.{name}"] = CHANNEL[name].meaning
    if any(JACOBIAN in name for name in image.channels):
        attributes[f"meaning.{JACOBIAN}"] = _DERIVED
    attributes["legend.status"] = _lines(legend())
    attributes["legend.truth.object"] = _number_lines(image.objects)
    attributes["legend.truth.material"] = _number_lines(image.materials)
    return attributes


_DERIVED = (
    "J.parameter.X, .Y, .Z and .R: derivatives of the point's coordinates and of the range by the believed parameter; "
    "scannerSim.calibration has its σ and correlations"
)


def _image(header: Mapping[str, Any], layers: Mapping[str, NDArray[np.float32]]) -> RangeImage:
    """Return the image that ``header`` and ``layers`` describe."""
    unknown = [name for name in layers if name not in CHANNEL]
    known = {name: layer for name, layer in layers.items() if name in CHANNEL}
    rows, columns = known["status"].shape
    version = f"{PREFIX}version."
    warnings = json.loads(header[f"{PREFIX}warnings"])
    made_by = {key.removeprefix(version): header[key] for key in header if key.startswith(version)}
    scenario = header[f"{PREFIX}scenario"]
    if not (
        isinstance(warnings, list)
        and all(isinstance(text, str) for text in (*warnings, *made_by.values(), scenario))
    ):
        raise ValueError("warnings, versions or scenario are no texts")
    if unknown:
        warnings.append(f"channels unknown to this version were left out: {', '.join(unknown)}")
    return RangeImage(
        channels=known,
        theta=_steps(header[f"{PREFIX}theta"], columns),
        phi=_steps(header[f"{PREFIX}phi"], rows),
        objects=_names(header["legend.truth.object"]),
        materials=_names(header["legend.truth.material"]),
        seed=int(header[f"{PREFIX}seed"]),
        scenario_yaml=scenario,
        warnings=tuple(warnings),
        made_by=made_by,
        poses=None
        if f"{PREFIX}poses" not in header
        else TruePoses.of_plain(json.loads(header[f"{PREFIX}poses"])),
        calibration_yaml=_text(header.get(f"{PREFIX}calibration", "")),
    )


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError("the calibration is no text")
    return value


def _steps(ends: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return the ``count`` angles between both ends, as the raster makes them."""
    return np.linspace(float(ends[0]), float(ends[1]), count)


def _lines(entries: Mapping[str, str]) -> str:
    return "\n".join(f"{number} {text}" for number, text in entries.items())


def _number_lines(names: tuple[str, ...]) -> str:
    """Return the legend of a truth layer: a line for each number, beginning with 0 for nothing."""
    return _lines({"0": "nothing", **{str(number): name for number, name in numbered(names).items()}})


def _names(text: str) -> tuple[str, ...]:
    """Return the names of a legend that :func:`_number_lines` wrote."""
    entries = [line.partition(" ") for line in text.split("\n")[1:]]
    named = {int(number): name for number, _, name in entries}
    if len(named) < len(entries) or not all(0 < number <= _LARGEST_NUMBER for number in named):
        raise ValueError("numbers of names are repeated or none")
    return tuple(named.get(number, "") for number in range(1, max(named, default=0) + 1))


@contextlib.contextmanager
def _all_cores(OpenEXR: ModuleType) -> Iterator[None]:
    """Let the library work on several threads for a while, unless the program around has chosen a number.

    They are ended afterwards: a process that is forked later would have their pool without them, and wait for ever.
    """
    before = OpenEXR.global_thread_count()
    if before == 0:
        OpenEXR.set_global_thread_count(_THREADS)
    try:
        yield
    finally:
        OpenEXR.set_global_thread_count(before)


@contextlib.contextmanager
def _library_is_quiet() -> Iterator[None]:
    """Keep the library's own words on broken files from the terminal: the exception says it once."""
    try:
        kept = os.dup(2)
    except OSError:
        kept = None
    with contextlib.redirect_stdout(io.StringIO()), open(os.devnull, "w") as nowhere:
        if kept is not None:
            os.dup2(nowhere.fileno(), 2)
        try:
            yield
        finally:
            if kept is not None:
                os.dup2(kept, 2)
                os.close(kept)
