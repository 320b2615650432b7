"""The verb ``show``."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from scanner_sim.cli.tables import print_table
from scanner_sim.config import scenario_from_text
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.products.files.contents import RUN, SHOTS, TRACK
from scanner_sim.products.files.exchange import write_file, write_files
from scanner_sim.products.voxel import VoxelRecord
from scanner_sim.render.libraries import DeviceChoice

if TYPE_CHECKING:
    from scanner_sim.products.image import RangeImage
    from scanner_sim.products.layers import LayeredResult
    from scanner_sim.products.waveforms import WaveformSet

_SHOWN = ("range_m", "sigma_range_m", "Y", "truth.range_m")
"""Channels of every run, which the pictures and tables need."""


def show_result(result: Path, output: Path | None, *, overwrite: bool) -> None:
    """Draw the pictures of a result.

    Raises
    ------
    InputError
        If there is no result, or the folder of the pictures cannot be written to.
    """
    from scanner_sim.cli.running import closing
    from scanner_sim.products.pictures.image import draw_picture, pictures_of

    path, image = _read(result)
    folder = output or path.parent
    writers = {name: partial(draw_picture, image, name) for name in pictures_of(image)}
    paths = write_files(folder, writers, overwrite=overwrite or output is None)
    print_table(closing(image, paths))


def show_shots(result: Path, output: Path | None, *, overwrite: bool) -> None:
    """Draw the pictures of a scan without rows anew.

    Raises
    ------
    InputError
        If there is no such result, or the folder of the pictures cannot be written to.
    """
    from scanner_sim.cli.running import closing_shots
    from scanner_sim.products.files.shots_folder import read_shots
    from scanner_sim.products.pictures.shots import PICTURES_OF_SHOTS

    shots = read_shots(result)
    _check_shown(result, shots)
    writers = {name: partial(draw, shots) for name, draw in PICTURES_OF_SHOTS.items()}
    paths = write_files(output or result, writers, overwrite=overwrite or output is None)
    print_table(closing_shots(shots, paths))


def show_voxel(
    result: Path,
    voxel: tuple[int, int],
    output: Path | None,
    *,
    device: DeviceChoice,
    overwrite: bool,
) -> None:
    """Simulate one voxel of a result again, draw its line, its waveform or both, and print its numbers.

    Raises
    ------
    InputError
        If there is no result or no such voxel, or the folder of the picture cannot be written to.
    """
    path, image = _read(result)
    row, column = voxel
    if not (0 <= row < image.shape[0] and 0 <= column < image.shape[1]):
        raise InputError(
            f"voxel {row} {column} lies outside of the {image.shape[0]} × {image.shape[1]} raster.",
            remedy="Rows and columns count from 0.",
        )
    scenario = scenario_from_text(image.scenario_yaml, name=str(path), stored=True)
    folder = output or path.parent
    write = partial(write_file, overwrite=overwrite or output is None)
    table: dict[str, str] = {}
    pictures: list[Path] = []
    if "triangulation" in scenario.rangefinders:
        from scanner_sim.instrument.simulate import simulate_voxel
        from scanner_sim.products.pictures.voxel import draw_voxel

        record = simulate_voxel(scenario, row, column, device=device)
        pictures.append(write(folder / f"voxel_{row}_{column}.png", lambda to: draw_voxel(record, to)))
        table |= _numbers(record)
    if "tof" in scenario.rangefinders:
        from scanner_sim.instrument.simulate_signals import simulate_waveforms
        from scanner_sim.instrument.time_of_flight import fitted_pulse
        from scanner_sim.products.pictures.waveform import draw_waveform

        waveforms = simulate_waveforms(scenario, [voxel], device=device)
        fit = fitted_pulse(scenario.scanner.lidar, waveforms, 0)
        name = f"waveform_{row}_{column}.png"
        pictures.append(write(folder / name, lambda to: draw_waveform(to, waveforms, 0, fit)))
        table |= _timed_numbers(image, row, column, waveforms)
    print_table(table | {"picture": ", ".join(map(str, pictures))})


def _timed_numbers(image: RangeImage, row: int, column: int, waveforms: WaveformSet) -> dict[str, str]:
    """Return what time of flight made of a voxel as pairs of a word and a phrase."""

    def ranged(prefix: str) -> str:
        r, sigma = (float(image[prefix + name][row, column]) for name in ("range_m", "sigma_range_m"))
        status = Status(int(image[f"{prefix}status"][row, column]))
        return f"{r:.5f} ± {sigma:.5f} m" if math.isfinite(r) else f"none: {status.sentence}"

    delay, sigma = 1e9 * float(waveforms.delay[0]), 1e9 * float(waveforms.sigma[0])
    table = {
        "voxel": f"row {row}, column {column}",
        "echoes": str(int(waveforms.echoes[0])),
        "delay": f"{delay:.4f} ± {sigma:.4f} ns" if math.isfinite(delay) else "none",
        "range by time of flight": ranged("tof."),
    }
    if "fused.range_m" in image:
        table["range by both"] = ranged("fused.")
    true = float(image["truth.range_m"][row, column])
    return table | {"true range": f"{true:.5f} m" if math.isfinite(true) else "none"}


def _numbers(record: VoxelRecord) -> dict[str, str]:
    """Return the numbers of a voxel as pairs of a word and a phrase."""

    def known(value: float, text: str) -> str:
        return text if math.isfinite(value) else "none"

    return {
        "voxel": f"row {record.row}, column {record.column}",
        "direction": f"Θ {math.degrees(record.theta):.4f}°, φ {math.degrees(record.phi):.4f}°",
        "status": f"{record.status.name}: {record.status.sentence}",
        "brightest pixel": f"{record.pixel_signal.max():.4g} electrons (threshold {record.threshold:.4g})",
        "peak": known(
            record.peak_px, f"{record.peak_px:.4f} ± {record.sigma_peak_px:.4f} px, {record.method}"
        ),
        "true peak": known(record.truth_peak_px, f"{record.truth_peak_px:.4f} px"),
        "range": known(record.range_m, f"{record.range_m:.5f} ± {record.sigma_range_m:.5f} m"),
        "σ by uneven spots": known(record.sigma_texture_m, f"{1e3 * record.sigma_texture_m:.3f} mm"),
        "true range": known(record.truth_range_m, f"{record.truth_range_m:.5f} m"),
        "error": known(record.residual_m, f"{1e3 * record.residual_m:.3f} mm, {record.residual_px:.4f} px"),
    }


def _read(result: Path) -> tuple[Path, RangeImage]:
    from scanner_sim.products.files.exr import read_range_image

    path = result / RUN.result if result.is_dir() else result
    if not path.exists():
        if result.is_dir() and (result / SHOTS.result).exists():
            raise InputError(
                f"{result} holds shots, which are no voxels of a raster.", remedy="Leave --voxel out."
            )
        if result.is_dir() and (result / TRACK.result).exists():
            raise InputError(
                f"{result} holds a tracking run, which has patterns and no voxels of a raster.",
                remedy="Leave --voxel out, or use --pattern N.",
            )
        remedy = "Name the folder of a run, or its range.exr."
        raise InputError(f"There is no result {path}.", remedy=remedy)
    image = read_range_image(path)
    _check_shown(path, image)
    return path, image


def _check_shown(path: Path, found: LayeredResult) -> None:
    if missing := [name for name in _SHOWN if name not in found]:
        raise InputError(
            f"{path} has no channel {missing[0]}.", remedy="Run its scenario again: channels were taken out."
        )
