"""The verb ``show``."""

from __future__ import annotations

import math
import os
import secrets
from collections.abc import Callable
from functools import partial
from pathlib import Path

from scanner_sim.cli.running import closing
from scanner_sim.cli.tables import print_table
from scanner_sim.config import scenario_from_text
from scanner_sim.errors import InputError
from scanner_sim.products.exr import read_range_image
from scanner_sim.products.folder import RESULT
from scanner_sim.products.image import RangeImage
from scanner_sim.products.voxel import VoxelRecord
from scanner_sim.render.device import DeviceChoice


def show_result(result: Path, output: Path | None) -> None:
    """Draw the pictures of a result.

    Raises
    ------
    InputError
        If there is no result, or the folder of the pictures cannot be written to.
    """
    from scanner_sim.products.pictures import PICTURES_OF, draw_background, lit

    path, image = _read(result)
    folder = output or path.parent
    pictures = {**PICTURES_OF, **({"background.png": draw_background} if lit(image) else {})}
    drawn = [_drawn(folder / name, partial(draw, image)) for name, draw in pictures.items()]
    print_table(closing(image, drawn))


def show_voxel(result: Path, voxel: tuple[int, int], output: Path | None, *, device: DeviceChoice) -> None:
    """Simulate one voxel of a result again, draw its line and print its numbers.

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
    scenario = scenario_from_text(image.scenario_yaml, name=str(path))
    from scanner_sim.products.pictures import draw_voxel
    from scanner_sim.simulate import simulate_voxel

    record = simulate_voxel(scenario, row, column, device=device)
    picture = _drawn((output or path.parent) / f"voxel_{row}_{column}.png", lambda to: draw_voxel(record, to))
    print_table(_numbers(record) | {"picture": str(picture)})


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
        "true range": known(record.truth_range_m, f"{record.truth_range_m:.5f} m"),
        "error": known(record.residual_m, f"{1e3 * record.residual_m:.3f} mm, {record.residual_px:.4f} px"),
    }


def _read(result: Path) -> tuple[Path, RangeImage]:
    path = result / RESULT if result.is_dir() else result
    if not path.exists():
        remedy = "Name the folder of a run, or its range.exr."
        raise InputError(f"There is no result {path}.", remedy=remedy)
    return path, read_range_image(path)


def _drawn(path: Path, draw: Callable[[Path], None]) -> Path:
    """Draw a picture that appears whole or not at all."""
    unfinished = path.with_name(f".{secrets.token_hex(4)}.partial.png")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draw(unfinished)
        os.replace(unfinished, path)
    except PermissionError as error:
        raise InputError(
            f"{path.parent} cannot be written to: {error.strerror}.", remedy="Choose another folder with -o."
        ) from None
    finally:
        unfinished.unlink(missing_ok=True)
    return path
