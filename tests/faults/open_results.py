"""What the verbs do with a result that somebody sent."""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path

from scanner_sim.foundation.errors import InputError


def open_result(path: Path, *, pictures: bool) -> None:
    """Read a result by what it is called, and thoroughly draw and compare what it holds."""
    match path.name:
        case "range.exr":
            _image(path, pictures)
        case "kept":
            _kept(path, pictures)
        case "run":
            _track(path, pictures)
        case "compare.json":
            _comparison(path)
        case "fig12.json":
            _reproduced(path)
        case name:
            _table(path, name)


def _image(path: Path, pictures: bool) -> None:
    from scanner_sim.cli.showing import show_result, show_voxel
    from scanner_sim.products.files.exr import read_range_image
    from scanner_sim.products.pictures.image import about

    image = read_range_image(path)
    repr(image)
    about(image)
    image.to_xarray()
    if pictures:
        show_result(path, path.parent / "out", overwrite=True)
        with contextlib.suppress(InputError):
            show_voxel(path, (1, 2), path.parent / "out", device="cpu", overwrite=True)


def _kept(folder: Path, pictures: bool) -> None:
    from scanner_sim.cli.reprocessing import reprocess_signals
    from scanner_sim.products.files.signal_files import read_signals
    from scanner_sim.products.lines import LineSet
    from scanner_sim.products.pictures.waveform import draw_waveform
    from scanner_sim.products.waveforms import WaveformSet

    if (folder / "lines.parquet").exists():
        lines = read_signals(folder / "lines.parquet", LineSet)
        repr((lines, lines.charge, lines.expected, lines.to_xarray()))
    if (folder / "waveforms.parquet").exists():
        waveforms = read_signals(folder / "waveforms.parquet", WaveformSet)
        repr(waveforms.to_xarray())
        if pictures:
            draw_waveform(folder / "w.png", waveforms, 0, None)
    if pictures:
        reprocess_signals(folder, ["seed=2"], folder.parent / "out", device="cpu", overwrite=True, quiet=True)


def _track(folder: Path, pictures: bool) -> None:
    from scanner_sim.cli.tracking import show_pattern, show_track
    from scanner_sim.products.pose import read_poses
    from scanner_sim.products.track import read_track

    made = read_track(folder)
    read_poses(folder / "pose.parquet")
    if pictures:
        if made.records:
            show_pattern(folder, made.records[-1].number, folder.parent / "out", overwrite=True)
        show_track(folder, folder.parent / "out", device="cpu", overwrite=True)


def _comparison(path: Path) -> None:
    from scanner_sim.validation.compare.baseline import against, read_baseline

    found = read_baseline(path)
    against(found, found)
    against(dataclasses.replace(found, seed=found.seed + 1), found)


def _reproduced(path: Path) -> None:
    from scanner_sim.validation.reproduce.page import page
    from scanner_sim.validation.reproduce.results import picture_of, read_result
    from scanner_sim.validation.reproduce.run import all_items

    item = next(item for item in all_items() if item.key == "fig12")
    path.with_name(picture_of(item)).write_bytes(b"")
    found = read_result(path.parent, item)
    if found is None:
        raise InputError("no result: it would be made again")
    page([item], {item.key: found})


def _table(path: Path, name: str) -> None:
    from scanner_sim.optics.pulse import read_pulse
    from scanner_sim.scene.motion import read_poses
    from scanner_sim.signals.line.bias_table import read_bias

    {"bias.csv": read_bias, "pulse.csv": read_pulse, "motion.csv": read_poses}[name](path)
